"""Samples come in the order and at the place that a file says, of every kind of file."""

from __future__ import annotations

import bz2
import gzip
import struct
import zlib

import numpy as np
import pytest
import tifffile
import vtk
from PIL import Image

from wvr.io import read, read_raw

from .files import (
    BIG,
    FIELD,
    LITTLE,
    ORIGIN,
    SPACING,
    TURNED,
    check,
    dicom,
    dicom_series,
    image,
    legacy,
    meta,
    nifti,
    nrrd,
    vti,
)

# --- Sample order and place -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, content",
    {
        "raw.nrrd": nrrd(LITTLE),
        "gzip.nrrd": nrrd(gzip.compress(LITTLE), "gzip"),
        "members.nrrd": nrrd(gzip.compress(LITTLE[:50]) + gzip.compress(LITTLE[50:]), "gz"),
        "bzip2.nrrd": nrrd(bz2.compress(LITTLE), "bzip2"),
        "text.nrrd": nrrd(" ".join(map(str, FIELD.ravel())).encode(), "ascii"),
        "big.nrrd": nrrd(BIG, more="endian: big\n", kind="int16"),
        "skip.nrrd": nrrd(b"one\ntwo\n--" + LITTLE, more="line skip: 2\nbyte skip: 2\n"),
        "tail.nrrd": nrrd(b"anything" + LITTLE, more="byteskip: -1\n", kind="signed short int"),
        "crlf.nrrd": nrrd(b"").replace(b"\n", b"\r\n") + LITTLE,
        "raw.mha": meta(LITTLE),
        "zlib.mha": meta(zlib.compress(LITTLE), True, more="CompressedDataSize = 1\n"),
        "big.mha": meta(BIG, more="BinaryDataByteOrderMSB = True\n"),
        "tail.mha": meta(b"anything" + LITTLE, more="HeaderSize = -1\n"),
        "s1.nii": nifti(LITTLE),
        "q1.nii": nifti(LITTLE, form="qform"),
        "s1.nii.gz": gzip.compress(nifti(LITTLE)),
        "big.nii": nifti(BIG, ">"),
        "s2.nii": nifti(LITTLE, version=2),
        "q2.nii": nifti(BIG, ">", version=2, form="qform"),
        "4d.NII": nifti(LITTLE, dims=(4, 5, 3, 4, 1)),
    }.items(),
)
def test_order_and_place(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    check(read(tmp_path / name))


@pytest.mark.parametrize("options", [{}, {"encode": True}, {"compress": False}, {"mode": "binary"}, {"mode": "ascii"}])
def test_vti(tmp_path, options):
    vti(tmp_path / "a.vti", **options)
    check(read(tmp_path / "a.vti"))


@pytest.mark.parametrize("binary", [True, False])
def test_legacy_vtk(tmp_path, binary):
    legacy(tmp_path / "a.vtk", image(), binary)
    check(read(str(tmp_path / "a.vtk")), direction=np.eye(3))  # the format has no direction


def test_handwritten_legacy_vtk(tmp_path):
    head = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 5 3 4\n"
    body = "ORIGIN 10 20 30\nSPACING 1.5 2 3\n"
    body += f"POINT_DATA 60\nSCALARS s short 1\nLOOKUP_TABLE default\n{' '.join(map(str, FIELD.ravel()))}\n"
    (tmp_path / "a.vtk").write_text(head + body)
    check(read(tmp_path / "a.vtk"), direction=np.eye(3))


def test_detached_data(tmp_path):
    (tmp_path / "s.raw").write_bytes(LITTLE)
    (tmp_path / "a.nhdr").write_bytes(nrrd(b"", more="data file: s.raw\n").rstrip(b"\n"))
    (tmp_path / "a.mhd").write_bytes(meta(b"", file="s.raw"))
    check(read(tmp_path / "a.nhdr"))
    check(read(tmp_path / "a.mhd"))
    (tmp_path / "s.raw").unlink()
    for name in ("a.nhdr", "a.mhd"):
        with pytest.raises(FileNotFoundError, match=r"s\.raw"):
            read(tmp_path / name)


def test_nrrd_spacings_and_axis_mins(tmp_path):
    path = tmp_path / "a.nrrd"
    for name in ("centers", "centerings"):
        more = f"spacings: 1.5 2 3\naxis mins: 10 20 30\n{name}: node cell node\n"
        path.write_bytes(nrrd(LITTLE, place=False, more=more))
        check(read(path), origin=(10, 21, 30), direction=np.eye(3))
    path.write_bytes(nrrd(LITTLE, place=False))
    check(read(path), spacing=(1, 1, 1), origin=(0, 0, 0), direction=np.eye(3))


def test_meta_images_are_as_far_apart_as_their_spacing_says(tmp_path):
    """Also where their samples are said to be larger, before it; the size stands in for a spacing that is not given."""
    path = tmp_path / "a.mha"
    path.write_bytes(meta(LITTLE, more="ElementSize = 9 9 9\n"))
    check(read(path))
    path.write_bytes(meta(LITTLE).replace(b"ElementSpacing", b"ElementSize"))
    check(read(path))


def test_nifti_without_form_and_with_slope(tmp_path):
    path = tmp_path / "a.nii"
    path.write_bytes(nifti(LITTLE, form=None))
    check(read(path), origin=(0, 0, 0), direction=np.eye(3))
    path.write_bytes(nifti(LITTLE, slope=2, intercept=-1024))
    check(read(path), FIELD * 2 - 1024)
    path.write_bytes(nifti(LITTLE, slope=0.5, intercept=0.25))
    check(read(path), (FIELD * 0.5 + 0.25).astype(np.float32))
    path.write_bytes(nifti(LITTLE, slope=np.nan))
    check(read(path))


@pytest.mark.parametrize("qfac", [1.0, -1.0])
def test_nifti_quaternion_against_vtk(tmp_path, qfac):
    b, c, d = 0.1, -0.5, 0.3
    content = bytearray(nifti(LITTLE, form="qform"))
    struct.pack_into("<f", content, 76, qfac)
    struct.pack_into("<3f", content, 256, b, c, d)
    (tmp_path / "a.nii").write_bytes(content)
    reader = vtk.vtkNIFTIImageReader()
    reader.SetFileName(str(tmp_path / "a.nii"))
    reader.Update()
    matrix = reader.GetQFormMatrix()
    expected = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
    if qfac < 0:  # VTK turns the slices' order instead of the axis
        expected[:, 2] *= -1
    volume = read(tmp_path / "a.nii")
    np.testing.assert_allclose(volume.direction, expected, atol=1e-6)
    assert np.sign(np.linalg.det(volume.direction)) == qfac


def test_tiff(tmp_path):
    array = FIELD.astype(np.uint16)
    plain = {"spacing": (1, 1, 1), "origin": (0, 0, 0), "direction": np.eye(3)}
    tifffile.imwrite(tmp_path / "a.tif", array, photometric="minisblack")
    check(read(tmp_path / "a.tif"), array, **plain)
    tifffile.imwrite(tmp_path / "z.TIFF", FIELD, photometric="minisblack", compression="zlib")
    check(read(tmp_path / "z.TIFF"), FIELD, **plain)
    options = {"imagej": True, "resolution": (1 / 1.5, 1 / 2), "metadata": {"axes": "ZYX", "spacing": 3.0}}
    tifffile.imwrite(tmp_path / "imagej.tif", array, **options)
    check(read(tmp_path / "imagej.tif"), array, **plain | {"spacing": SPACING})
    sizes = {"axes": "ZYX", "PhysicalSizeX": 1.5, "PhysicalSizeY": 2.0, "PhysicalSizeZ": 3.0}
    tifffile.imwrite(tmp_path / "a.ome.tif", FIELD.astype(np.float32), metadata=sizes)
    check(read(tmp_path / "a.ome.tif"), FIELD.astype(np.float32), **plain | {"spacing": SPACING})


def test_tiff_with_lzw(tmp_path):
    pages = [Image.fromarray(page) for page in FIELD.astype(np.uint16)]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    np.testing.assert_array_equal(read(tmp_path / "a.tif").numpy(), FIELD.astype(np.uint16))
    assert read(tmp_path / "a.tif").dtype == np.uint16


@pytest.mark.parametrize("shape", [(1, 3, 5), (4, 1, 5), (4, 3, 1), (1, 1, 1)])
def test_tiff_with_thin_axes(tmp_path, shape):
    array = np.resize(FIELD, shape)
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        for page in array:
            file.write(page, contiguous=False, metadata=None)
    np.testing.assert_array_equal(read(tmp_path / "a.tif").numpy(), array)


def test_tiff_without_all_its_samples(tmp_path):
    tiles = iter([np.ones((16, 16), np.uint8), None, np.ones((16, 16), np.uint8)])  # None: no bytes, read as zeros
    options = {"tile": (16, 16), "compression": "zlib", "photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "a.tif", tiles, shape=(3, 16, 16), dtype="uint8", **options)
    with pytest.raises(OSError, match="some of its samples are missing"):
        read(tmp_path / "a.tif")


def test_tiff_folder_in_natural_order(tmp_path):
    array = np.concatenate([FIELD, FIELD + 1000, FIELD + 2000])
    for k, page in enumerate(array):
        tifffile.imwrite(tmp_path / f"slice{k}.tif", page)  # slice10 after slice9, not after slice1
    (tmp_path / "notes.txt").write_text("not an image")
    check(read(tmp_path), array, (1, 1, 1), (0, 0, 0), np.eye(3))
    tifffile.imwrite(tmp_path / "slice5.tif", page[:2])
    with pytest.raises(ValueError, match=r"slice5\.tif holds \(1, 2, 5\) int16, one slice \(1, 3, 5\)"):
        read(tmp_path)


def test_dicom_folder(tmp_path):
    dicom_series(tmp_path / "a")
    check(read(tmp_path / "a"))
    dicom_series(tmp_path / "whole", intercept=-1024)
    check(read(tmp_path / "whole"), FIELD - 1024)
    dicom_series(tmp_path / "real", slope=0.5)
    check(read(tmp_path / "real"), (FIELD * 0.5).astype(np.float32))
    single = tmp_path / "one.dcm"
    dicom(single, FIELD[2], ORIGIN)
    check(read(single), FIELD[2:3], spacing=(1.5, 2, 99))


def test_dicom_folder_refusals(tmp_path):
    dicom_series(tmp_path / "gap")
    (tmp_path / "gap" / "b").unlink()
    with pytest.raises(ValueError, match="not evenly spaced"):
        read(tmp_path / "gap")
    dicom_series(tmp_path / "two")
    dicom(tmp_path / "two" / "e", FIELD[0], (0, 0, 0), series="1.2.4")
    with pytest.raises(ValueError, match="2 DICOM series"):
        read(tmp_path / "two")
    dicom(tmp_path / "rgb.dcm", np.zeros((3, 5, 3), np.uint8), ORIGIN)
    with pytest.raises(ValueError, match="3 components"):
        read(tmp_path / "rgb.dcm")


def test_npy(tmp_path):
    plain = ((1, 1, 1), (0, 0, 0), np.eye(3))
    for array in (FIELD, np.asfortranarray(FIELD), FIELD.astype(">f4"), FIELD.astype(np.float16)):
        np.save(tmp_path / "a.npy", array)
        check(read(tmp_path / "a.npy"), array.astype(array.dtype.newbyteorder("=")), *plain)


# --- Raw ------------------------------------------------------------------------------------------------------------


def test_raw(tmp_path, monkeypatch):
    path = tmp_path / "a.bin"
    path.write_bytes(b"head" + LITTLE)
    volume = read_raw(path, (4, 3, 5), "int16", SPACING, ORIGIN, TURNED, offset=4)
    check(volume)
    # However little memory is free: it is not copied.
    monkeypatch.setattr("wvr.volume.free_host_memory", lambda: 1.0)
    check(read_raw(path, (4, 3, 5), "int16", SPACING, ORIGIN, TURNED, offset=4))
    monkeypatch.undo()
    assert isinstance(volume.numpy().base, np.memmap) and not volume.numpy().flags.writeable
    path.write_bytes(BIG)
    check(read_raw(path, (4, 3, 5), np.int16, SPACING, ORIGIN, TURNED, byteorder="big"))
    path.write_bytes(FIELD.astype(">i4").tobytes())
    check(read_raw(path, (4, 3, 5), "int32", SPACING, ORIGIN, TURNED, byteorder="big"))


def test_raw_refusals(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(LITTLE)
    for wrong in ({"shape": (4, 3, 6)}, {"dtype": "uint8"}, {"offset": 2}):
        with pytest.raises(OSError, match=r"has 120 bytes; .* are \d+ bytes"):
            read_raw(path, **{"shape": (4, 3, 5), "dtype": "int16"} | wrong)
    for wrong, message in (
        ({"shape": (12, 5)}, "shape"),
        ({"shape": (0, 3, 5)}, "shape"),
        ({"offset": -1}, "offset"),
        ({"byteorder": "middle"}, "byteorder"),
    ):
        with pytest.raises(ValueError, match=message):
            read_raw(path, **{"shape": (4, 3, 5), "dtype": "int16"} | wrong)
    with pytest.raises(FileNotFoundError):
        read_raw(tmp_path / "none.bin", (4, 3, 5), "int16")
