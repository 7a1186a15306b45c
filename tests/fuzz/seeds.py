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

from ..io.files import BIG, FIELD, LITTLE, amira, dicom, image, legacy, meta, nifti, npy, nrrd, runs, vti

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
        "raw.am": amira(LITTLE),
        "text.am": amira(TEXT, "ASCII", before=b"0 1\n" * 60),
        "zip.am": amira(packed := zlib.compress(LITTLE), packing=f"(HxZip,{len(packed)})"),
        "runs.am": amira(packed := runs(LITTLE[::2]), kind="byte", packing=f"(HxByteRLE,{len(packed)})"),
        "s1.nii": nifti(LITTLE, slope=2, intercept=-5),
        "q2.nii": nifti(BIG, ">", version=2, form="qform"),
        "q1.nii.gz": gzip.compress(nifti(LITTLE, form="qform")),
        "4d.nii": nifti(LITTLE + LITTLE, dims=(4, 5, 3, 4, 2)),
        "times.npy": npy(np.stack([FIELD, FIELD])),
        "times.nrrd": _four(nrrd(LITTLE * 2)),
        "a.npy": npy(FIELD),
        "fortran.npy": npy(np.asfortranarray(FIELD.astype(np.float32))),
    }


def _four(content: bytes) -> bytes:
    """An NRRD file with two volumes in time."""
    content = content.replace(b"dimension: 3", b"dimension: 4").replace(b"sizes: 5 3 4", b"sizes: 5 3 4 2")
    return content.replace(b"(0,0,3)\n", b"(0,0,3) none\nkinds: space space space time\n")


def _pairs() -> dict[str, bytes]:
    """Headers with their samples in files beside them."""
    head = bytearray(nifti(b"")[:348])
    head[108:112], head[344:348] = bytes(4), b"ni1\0"
    return {
        "nrrd/a.nhdr": nrrd(b"", more="data file: a.raw\n"),
        "nrrd/a.raw": LITTLE,
        "bzip2/a.nhdr": nrrd(b"", "bzip2", more="data file: a.bz2\nbyte skip: 2\n"),
        "bzip2/a.bz2": bz2.compress(b"--" + LITTLE),
        "meta/a.mhd": meta(b"", True, file="a.zraw"),
        "meta/a.zraw": zlib.compress(LITTLE),
        "pair/a.hdr": bytes(head),
        "pair/a.img": LITTLE,
    }


def _pieces() -> bytes:
    """Two that tile a VTI file, in text."""
    parts = []
    for first, last in ((0, 1), (2, 3)):
        text = " ".join(map(str, FIELD[first : last + 1].ravel()))
        parts.append(
            f'<Piece Extent="0 4 0 2 {first} {last}"><PointData Scalars="a"><DataArray type="Int16" Name="a" '
            f'format="ascii">{text}</DataArray></PointData></Piece>'
        )
    return (
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian"><ImageData WholeExtent="0 4 0 2 0 3" '
        f'Origin="0 0 0" Spacing="1 2 3">{"".join(parts)}</ImageData></VTKFile>'
    ).encode()


def make(folder: Path) -> list[Path]:
    """Write all; files, folders of slices, and folders of a header and its samples."""
    for name, content in _pairs().items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    (folder / "pieces.vti").write_bytes(_pieces())
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
    grid = image()
    grid.cell_data["cells"] = np.arange(24.0)
    grid.field_data["f"] = [1.0, 2.0]
    legacy(folder / "cells.vtk", grid)
    vti(folder / "cells.vti", grid)
    for kind in ("LZ4", "LZMA"):
        _by_vtk(folder / f"{kind}.vti", kind)
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
    grey = [Image.fromarray(page.astype(np.uint8)) for page in FIELD]
    for kind in ("packbits", "jpeg"):
        grey[0].save(folder / f"{kind}.tif", save_all=True, append_images=grey[1:], compression=kind)
    tifffile.imwrite(folder / "big.tif", FIELD, photometric="minisblack", bigtiff=True, byteorder=">", tile=(16, 16))
    times = np.stack([FIELD, FIELD]).astype(np.uint16)
    tifffile.imwrite(folder / "times.ome.tif", times, metadata={"axes": "TZYX", "PhysicalSizeZ": 2, "Name": "ö"})
    np.savez_compressed(folder / "two.npz", a=FIELD)
    np.savez(folder / "plain.npz", a=FIELD)
    dicom(folder / "a.dcm", FIELD[0], (1, 2, 3))
    _other_dicom(folder)
    _compressed_dicom(folder)
    _by_packages(folder)
    _stores(folder)
    for name in ("series", "png", "jpeg", "bmp", "tiff"):
        (folder / name).mkdir()
    for k, page in enumerate(FIELD):
        dicom(folder / "series" / f"IM{k}", page, (10, 20, 30 + 3 * k), number=k)
        Image.fromarray(page.astype(np.uint8)).save(folder / "png" / f"{k}.png")
        Image.fromarray(page.astype(np.uint8)).save(folder / "jpeg" / f"{k}.jpg")
        Image.fromarray(page.astype(np.uint8)).save(folder / "bmp" / f"{k}.bmp")
        tifffile.imwrite(folder / "tiff" / f"{k}.tif", page)
    return sorted(folder.iterdir())


def _by_vtk(path: Path, compressor: str) -> None:
    import vtk

    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(image())
    writer.SetFileName(str(path))
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    writer.SetBlockSize(48)
    writer.Write()


def _other_dicom(folder: Path) -> None:
    """In other transfer syntaxes, with several frames, and as dose and older files are."""
    source = pydicom.dcmread(folder / "a.dcm")
    for name, syntax in {
        "implicit": pydicom.uid.ImplicitVRLittleEndian,
        "deflated": pydicom.uid.DeflatedExplicitVRLittleEndian,
        "big": pydicom.uid.ExplicitVRBigEndian,
    }.items():
        source.file_meta.TransferSyntaxUID = syntax
        source.PixelData = BIG[:30] if name == "big" else LITTLE[:30]
        order = {"implicit_vr": name == "implicit", "little_endian": name != "big"}
        pydicom.dcmwrite(folder / f"{name}.dcm", source, force_encoding=True, **order)
    frames = pydicom.dcmread(folder / "a.dcm")
    frames.NumberOfFrames, frames.PixelData, frames.GridFrameOffsetVector = 4, LITTLE, [0, 3, 6, 9]
    frames.DoseGridScaling = "1e-3"
    frames.save_as(folder / "dose.dcm")
    (folder / "old.dcm").write_bytes((folder / "implicit.dcm").read_bytes()[132:])


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
    with mrcfile.new(folder / "a.mrc.gz", compression="gzip") as file:
        file.set_data(FIELD.astype(np.float32))
    for name, options in {
        "plain": {},
        "chunks": {"chunks": (2, 3, 2), "compression": "gzip"},
        "filters": {"chunks": (4, 3, 5), "compression": "lzf", "shuffle": True, "fletcher32": True},
        "offset": {"chunks": (2, 2, 2), "scaleoffset": 0, "maxshape": (None, None, None)},
    }.items():
        with h5py.File(folder / f"{name}.h5", "w", libver="latest" if name == "filters" else "earliest") as file:
            group = file.create_group("g") if name == "chunks" else file
            group.create_dataset("v", data=FIELD, **options).attrs["element_size_um"] = (3.0, 2.0, 1.0)


def _stores(folder: Path) -> None:
    """Zarr of both versions, in chunks and in shards, and a pyramid; nothing where its package is not there."""
    try:
        import zarr
    except ImportError:  # Python 3.10
        return

    for name, version, options in (
        ("two.zarr", 2, {}),
        ("three.zarr", 3, {}),
        ("shards.zarr", 3, {"shards": (4, 2, 4)}),
    ):
        array = zarr.create_array(
            folder / name, shape=FIELD.shape, chunks=(2, 2, 2), dtype="i2", zarr_format=version, **options
        )
        array[:] = FIELD
    group = zarr.open_group(folder / "pyramid.zarr", mode="w", zarr_format=2)
    for level in range(2):
        part = FIELD[:: 2**level, :: 2**level, :: 2**level]
        group.create_array(str(level), shape=part.shape, chunks=(2, 3, 3), dtype="i2")[:] = part
    scales = [[{"type": "scale", "scale": [3.0 * k, 2.0 * k, 1.5 * k]}] for k in (1, 2)]
    group.attrs["multiscales"] = [
        {
            "version": "0.4",
            "axes": [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"],
            "datasets": [{"path": str(k), "coordinateTransformations": scale} for k, scale in enumerate(scales)],
        }
    ]
