"""Sound files of every format, as small as can be, to be damaged."""

from __future__ import annotations

import bz2
import gzip
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pydicom
import tifffile
from PIL import Image

from ..io.files import BIG, FIELD, LITTLE, dicom, image, legacy, meta, nifti, npy, nrrd, vti

TEXT = " ".join(map(str, FIELD.ravel())).encode()


def contents() -> dict[str, bytes]:
    """Files that are made of bytes."""
    return {
        "raw.nrrd": nrrd(LITTLE, more="kinds: domain domain domain\nspace units: mm mm mm\n"),
        "axes.nrrd": nrrd(LITTLE, place=False, more="spacings: 1 2 NaN\naxis mins: 0 1 2\ncenters: node cell node\n"),
        "big.nrrd": nrrd(BIG, more="endian: big\n"),
        "skip.nrrd": nrrd(b"one\ntwo\n--" + LITTLE, more="line skip: 2\nbyte skip: 2\n"),
        "gzip.nrrd": nrrd(gzip.compress(LITTLE), "gzip"),
        "bzip2.nrrd": nrrd(bz2.compress(LITTLE), "bzip2"),
        "text.nrrd": nrrd(TEXT, "ascii"),
        "raw.mha": meta(LITTLE, more="AnatomicalOrientation = RAI\nHeaderSize = 0\n"),
        "zlib.mha": meta(zlib.compress(LITTLE), True),
        "text.mha": meta(TEXT).replace(b"BinaryData = True", b"BinaryData = False"),
        "s1.nii": nifti(LITTLE, slope=2, intercept=-5),
        "q2.nii": nifti(BIG, ">", version=2, form="qform"),
        "q1.nii.gz": gzip.compress(nifti(LITTLE, form="qform")),
        "4d.nii": nifti(LITTLE + LITTLE, dims=(4, 5, 3, 4, 2)),
        "a.npy": npy(FIELD),
        "fortran.npy": npy(np.asfortranarray(FIELD.astype(np.float32))),
    }


def make(folder: Path) -> list[Path]:
    """Write all; files, and folders of slices."""
    for name, content in contents().items():
        (folder / name).write_bytes(content)
    for name, options in {
        "compressed": {},
        "bare": {"compress": False},
        "base64": {"encode": True},
        "binary": {"mode": "binary"},
        "inline": {"mode": "binary", "compress": False},
        "ascii": {"mode": "ascii"},
    }.items():
        vti(folder / f"{name}.vti", **options)
    legacy(folder / "binary.vtk", image())
    legacy(folder / "ascii.vtk", image(), binary=False)
    tifffile.imwrite(folder / "plain.tif", FIELD, photometric="minisblack")
    tifffile.imwrite(folder / "zlib.tif", FIELD, photometric="minisblack", compression="zlib")
    tifffile.imwrite(
        folder / "imagej.tif", FIELD.astype(np.uint16), imagej=True, metadata={"axes": "ZYX", "spacing": 3.0}
    )
    tifffile.imwrite(folder / "a.ome.tif", FIELD, metadata={"axes": "ZYX", "PhysicalSizeX": 1.5})
    pages = [Image.fromarray(page) for page in FIELD.astype(np.uint16)]
    pages[0].save(folder / "lzw.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    np.savez_compressed(folder / "two.npz", a=FIELD)
    np.savez(folder / "plain.npz", a=FIELD)
    dicom(folder / "a.dcm", FIELD[0], (1, 2, 3))
    _compressed_dicom(folder)
    _by_packages(folder)
    for name in ("series", "png", "jpeg", "tiff"):
        (folder / name).mkdir()
    for k, page in enumerate(FIELD):
        dicom(folder / "series" / f"IM{k}", page, (10, 20, 30 + 3 * k), number=k)
        Image.fromarray(page.astype(np.uint8)).save(folder / "png" / f"{k}.png")
        Image.fromarray(page.astype(np.uint8)).save(folder / "jpeg" / f"{k}.jpg")
        tifffile.imwrite(folder / "tiff" / f"{k}.tif", page)
    return sorted(folder.iterdir())


def _compressed_dicom(folder: Path) -> None:
    pixels = FIELD[0].astype(np.uint8)
    syntaxes = {"JPEG2000": pydicom.uid.JPEG2000Lossless, "JPEG": pydicom.uid.JPEGBaseline8Bit}
    for name, syntax in syntaxes.items():
        encoded = BytesIO()
        Image.fromarray(pixels).save(encoded, name)
        dicom(folder / f"{name}.dcm", pixels, (1, 2, 3))
        data = pydicom.dcmread(folder / f"{name}.dcm")
        data.file_meta.TransferSyntaxUID = syntax
        data.PixelData = pydicom.encaps.encapsulate([encoded.getvalue()])
        data["PixelData"].is_undefined_length = True
        data.save_as(folder / f"{name}.dcm")
    dicom(folder / "rle.dcm", FIELD[0], (1, 2, 3))
    data = pydicom.dcmread(folder / "rle.dcm")
    data.compress(pydicom.uid.RLELossless)
    data.save_as(folder / "rle.dcm")


def _by_packages(folder: Path) -> None:
    import h5py
    import mrcfile
    import nibabel

    nibabel.save(nibabel.MGHImage(FIELD.T, np.eye(4)), folder / "a.mgh")
    nibabel.save(nibabel.MGHImage(FIELD.T, np.eye(4)), folder / "a.mgz")
    with mrcfile.new(folder / "a.mrc") as file:
        file.set_data(FIELD)
    for name, options in {"plain": {}, "chunks": {"chunks": (2, 3, 2), "compression": "gzip"}}.items():
        with h5py.File(folder / f"{name}.h5", "w") as file:
            file.create_dataset("v", data=FIELD, **options)
