"""Reading and writing: sample order, place in the world, dtypes, and that no broken file passes for a good one."""

from __future__ import annotations

import bz2
import gc
import gzip
import hashlib
import io
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import tifffile
import vtk
from PIL import Image

from wvr.io import from_pyvista, read, read_raw, to_pyvista
from wvr.volume import Volume

DATA = Path(__file__).parents[1] / "../shared/data"
VTK_DTYPES = ("uint8", "int8", "uint16", "int16", "float32", "float64")

# A field no two samples of which agree, a turned and anisotropic place: x goes along world y, y along -x.
FIELD = (np.arange(4 * 3 * 5).reshape(4, 3, 5) * 13 - 200).astype(np.int16)
SPACING, ORIGIN = (1.5, 2.0, 3.0), (10.0, 20.0, 30.0)
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def check(volume: Volume, array=FIELD, spacing=SPACING, origin=ORIGIN, direction=TURNED):
    assert volume.dtype == array.dtype
    np.testing.assert_array_equal(volume.numpy(), array)
    np.testing.assert_allclose(volume.spacing, spacing, rtol=1e-6)
    np.testing.assert_allclose(volume.origin, origin, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(volume.direction, direction, atol=1e-6)


def nrrd(data: bytes, encoding="raw", kind="short", more="", place=True) -> bytes:
    directions = (
        "space: left-posterior-superior\nspace directions: (0,1.5,0) (-2,0,0) (0,0,3)\nspace origin: (10,20,30)\n"
    )
    head = f"NRRD0004\n# a: b\ntype: {kind}\ndimension: 3\nsizes: 5 3 4\nkey:=value: x\nencoding: {encoding}\n"
    return (
        (head + (directions if place else "") + ("" if "endian" in more else "endian: little\n") + more).encode()
        + b"\n"
        + data
    )


def meta(data: bytes, compressed=False, kind="MET_SHORT", file="LOCAL", more="") -> bytes:
    head = (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nCompressedData = {compressed}\n{more}"
        f"TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30\nElementSpacing = 1.5 2 3\nDimSize = 5 3 4\n"
        f"ElementType = {kind}\nElementDataFile = {file}\n"
    )
    return head.encode() + data


def nifti(
    data: bytes, order="<", version=1, form="sform", code=4, bits=16, slope=0.0, intercept=0.0, dims=(3, 5, 3, 4)
):
    """A header from the struct offsets of nifti1.h and nifti2.h; quaternion (cos 45, 0, 0, sin 45): a quarter turn."""
    dim = (*dims, 1, 1, 1, 1, 1)[:8]
    pixdim = (1.0, *SPACING, 0, 0, 0, 0)
    quatern = (0.0, 0.0, np.sqrt(0.5), *ORIGIN)
    srow = np.column_stack([TURNED * SPACING, ORIGIN]).ravel()
    forms = (form == "qform", form == "sform")
    head = bytearray(352 if version == 1 else 544)

    def put(kind, offset, *values):
        struct.pack_into(order + kind, head, offset, *values)

    if version == 1:
        put("i", 0, 348), put("8h", 40, *dim), put("2h", 70, code, bits), put("8f", 76, *pixdim)
        put("3f", 108, 352, slope, intercept), put("2h", 252, *forms), put("6f", 256, *quatern), put("12f", 280, *srow)
        head[344:348] = b"n+1\0"
    else:
        put("i", 0, 540), put("2h", 12, code, bits), put("8q", 16, *dim), put("8d", 104, *pixdim)
        put("q2d", 168, 544, slope, intercept), put("2i", 344, *forms), put("6d", 352, *quatern), put("12d", 400, *srow)
        head[4:12] = b"n+2\0\r\n\x1a\n"
    return bytes(head) + data


def npy(array) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def image(array=FIELD, name="values") -> pv.ImageData:
    grid = pv.ImageData(dimensions=array.shape[::-1], spacing=SPACING, origin=ORIGIN)
    grid.SetDirectionMatrix(*TURNED.ravel())
    grid.point_data[name] = array.ravel()
    return grid


def vti(path: Path, grid=None, mode="appended", encode=False, compress=True):
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetInputData(image() if grid is None else grid)
    writer.SetFileName(str(path))
    writer.SetDataMode({"ascii": 0, "binary": 1, "appended": 2}[mode])
    writer.SetEncodeAppendedData(encode)
    if not compress:
        writer.SetCompressorTypeToNone()
    writer.Write()


def legacy(path: Path, grid, binary=True):
    writer = vtk.vtkGenericDataObjectWriter()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    writer.SetFileType(2 if binary else 1)
    writer.Write()


def dicom(path: Path, array, position, slope=1, intercept=0, number=1, series="1.2.3", orientation=(0, 1, 0, -1, 0, 0)):
    pydicom = pytest.importorskip("pydicom")
    head = pydicom.dataset.FileMetaDataset()
    head.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    head.MediaStorageSOPClassUID = pydicom.uid.CTImageStorage
    head.MediaStorageSOPInstanceUID = f"1.2.3.{number}"
    data = pydicom.dataset.FileDataset(str(path), {}, file_meta=head, preamble=b"\0" * 128)
    data.SOPClassUID, data.SOPInstanceUID, data.Modality = (
        head.MediaStorageSOPClassUID,
        head.MediaStorageSOPInstanceUID,
        "CT",
    )
    data.SeriesInstanceUID, data.InstanceNumber = series, number
    data.Rows, data.Columns = array.shape[:2]
    data.PixelSpacing, data.SliceThickness = [SPACING[1], SPACING[0]], 99.0
    data.ImageOrientationPatient, data.ImagePositionPatient = list(orientation), list(position)
    data.SamplesPerPixel, data.PhotometricInterpretation = (1, "MONOCHROME2") if array.ndim == 2 else (3, "RGB")
    data.BitsAllocated = data.BitsStored = 8 * array.itemsize
    data.HighBit, data.PixelRepresentation = 8 * array.itemsize - 1, int(array.dtype.kind == "i")
    if array.ndim == 3:
        data.PlanarConfiguration = 0
    data.RescaleSlope, data.RescaleIntercept = slope, intercept
    data.PixelData = array.tobytes()
    data.save_as(path, enforce_file_format=True)


def dicom_series(folder: Path, **options):
    """Slices whose names and instance numbers are in another order than their positions."""
    folder.mkdir()
    for k, name in enumerate("dbac"):
        dicom(folder / name, FIELD[k], (10, 20, 30 + 3 * k), number=9 - k, **options)


LITTLE, BIG = FIELD.astype("<i2").tobytes(), FIELD.astype(">i2").tobytes()

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
    path.write_bytes(
        nrrd(LITTLE, place=False, more="spacings: 1.5 2 3\naxis mins: 10 20 30\ncenters: node cell node\n")
    )
    check(read(path), origin=(10, 21, 30), direction=np.eye(3))
    path.write_bytes(nrrd(LITTLE, place=False))
    check(read(path), spacing=(1, 1, 1), origin=(0, 0, 0), direction=np.eye(3))


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


def test_raw(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"head" + LITTLE)
    volume = read_raw(path, (4, 3, 5), "int16", SPACING, ORIGIN, TURNED, offset=4)
    check(volume)
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


# --- Dtypes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "values, expected",
    [
        (np.array([False, True]), "uint8"),
        (np.array([0, 255], np.int64), "uint8"),
        (np.array([-128, 127], np.int32), "int8"),
        (np.array([-1, 128], np.int32), "int16"),
        (np.array([0, 65535], np.uint32), "uint16"),
        (np.array([-32768, 32767], np.int64), "int16"),
        (np.array([-1, 32768], np.int64), "float64"),
        (np.array([0, 2**53], np.uint64), "float64"),
    ],
)
def test_narrowing_is_exact(tmp_path, values, expected):
    np.save(tmp_path / "a.npy", np.resize(values, (2, 2, 2)))
    volume = read(tmp_path / "a.npy")
    assert volume.dtype == expected
    np.testing.assert_array_equal(volume.numpy().ravel()[:2], values)
    if values.dtype != bool:
        assert from_pyvista(image(np.resize(values, (2, 2, 2)))).dtype == expected


def test_narrowing_refuses_what_no_dtype_holds(tmp_path):
    np.save(tmp_path / "a.npy", np.full((2, 2, 2), 2**53 + 1))
    with pytest.raises(ValueError, match="9007199254740993 fit no accepted dtype exactly"):
        read(tmp_path / "a.npy")


@pytest.mark.parametrize(
    "kind, dtype", [("uchar", "u1"), ("int8_t", "i1"), ("unsigned short", "u2"), ("float", "f4"), ("double", "f8")]
)
def test_nrrd_types(tmp_path, kind, dtype):
    array = (FIELD % 100).astype(dtype)
    (tmp_path / "a.nrrd").write_bytes(nrrd(array.tobytes(), kind=kind))
    check(read(tmp_path / "a.nrrd"), array)


@pytest.mark.parametrize(
    "kind, dtype",
    [("MET_UCHAR", "u1"), ("MET_CHAR", "i1"), ("MET_USHORT", "u2"), ("MET_FLOAT", "f4"), ("MET_DOUBLE", "f8")],
)
def test_meta_types(tmp_path, kind, dtype):
    array = (FIELD % 100).astype(dtype)
    (tmp_path / "a.mha").write_bytes(meta(array.tobytes(), kind=kind))
    check(read(tmp_path / "a.mha"), array)


@pytest.mark.parametrize("code, dtype", [(2, "u1"), (256, "i1"), (512, "u2"), (16, "f4"), (64, "f8")])
def test_nifti_types(tmp_path, code, dtype):
    array = (FIELD % 100).astype(dtype)
    (tmp_path / "a.nii").write_bytes(nifti(array.tobytes(), code=code, bits=8 * array.itemsize))
    check(read(tmp_path / "a.nii"), array)


def test_nan(tmp_path):
    array = np.full((2, 2, 2), np.nan, np.float32)
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(ValueError, match="8 NaN"):
        read(tmp_path / "a.npy")
    assert read(tmp_path / "a.npy", nan="transparent").has_nonfinite
    array.tofile(tmp_path / "a.raw")
    assert read_raw(tmp_path / "a.raw", (2, 2, 2), "float32", nan="transparent").has_nonfinite
    assert from_pyvista(image(array), nan="transparent").has_nonfinite


# --- PyVista --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", VTK_DTYPES)
def test_pyvista_round_trip_shares_memory(dtype):
    array = (FIELD % 100).astype(dtype)
    volume = Volume(array, SPACING, ORIGIN, TURNED)
    grid = to_pyvista(volume)
    assert np.shares_memory(grid.point_data["values"], array)
    assert grid.active_scalars_name == "values" and grid.point_data["values"].dtype == dtype
    again = from_pyvista(grid)
    check(again, array)
    assert np.shares_memory(again.numpy(), array)
    corner = [grid.bounds[i] for i in (0, 2, 4)]
    np.testing.assert_allclose(corner, volume.corners.min(axis=0))
    del grid, volume
    gc.collect()
    np.testing.assert_array_equal(again.numpy(), (FIELD % 100).astype(dtype))


def test_pyvista_round_trip_of_others():
    half = to_pyvista(Volume(FIELD.astype(np.float16)))
    assert half.point_data["values"].dtype == np.float32
    np.testing.assert_array_equal(from_pyvista(half).numpy(), FIELD.astype(np.float32))
    frozen = FIELD.copy()
    frozen.flags.writeable = False
    check(from_pyvista(to_pyvista(Volume(frozen, SPACING, ORIGIN, TURNED))))
    sheared = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    check(from_pyvista(to_pyvista(Volume(FIELD, SPACING, ORIGIN, sheared))), direction=sheared)


def test_pyvista_array_outlives_its_grid():
    volume = from_pyvista(image())
    gc.collect()
    check(volume)


def test_pyvista_extent_and_negative_spacing():
    grid = image()
    grid.SetExtent(2, 6, -1, 1, 3, 6)  # VTK's origin is where index (0, 0, 0) would be
    check(from_pyvista(grid), origin=np.array(grid.points[0], np.float64))
    assert not np.allclose(grid.points[0], ORIGIN)
    grid = image()
    grid.SetSpacing(-1.5, 2, 3)
    check(from_pyvista(grid), direction=TURNED * [-1, 1, 1])


def test_vti_with_extent(tmp_path):
    grid = image()
    grid.SetExtent(2, 6, -1, 1, 3, 6)
    vti(tmp_path / "a.vti", grid)
    check(read(tmp_path / "a.vti"), origin=np.array(grid.points[0], np.float64))


def test_cell_data_sits_at_centres(tmp_path):
    grid = pv.ImageData(dimensions=(6, 4, 5), spacing=SPACING, origin=ORIGIN)
    grid.SetDirectionMatrix(*TURNED.ravel())
    grid.cell_data["c"] = FIELD.ravel()
    centre = grid.cell_centers().points[0].astype(np.float64)
    check(from_pyvista(grid), origin=centre)
    vti(tmp_path / "a.vti", grid)
    check(read(tmp_path / "a.vti"), origin=centre)
    flat = pv.ImageData(dimensions=(6, 4, 1))
    flat.cell_data["c"] = FIELD[0].ravel()
    check(from_pyvista(flat), FIELD[:1], (1, 1, 1), (0.5, 0.5, 0), np.eye(3))


def test_scalars_by_name(tmp_path):
    grid = image(name="first")
    grid.point_data["second"] = (FIELD + 1).ravel()
    grid.set_active_scalars("first")
    vti(tmp_path / "a.vti", grid)
    check(read(tmp_path / "a.vti"))
    check(read(tmp_path / "a.vti", scalars="second"), FIELD + 1)
    with pytest.raises(ValueError, match="'third' is unknown; there are 'first', 'second'"):
        read(tmp_path / "a.vti", scalars="third")
    grid.point_data.active_scalars_name = None
    with pytest.raises(ValueError, match="none is active; there are 'first', 'second'"):
        from_pyvista(grid)
    with pytest.raises(ValueError, match="no point or cell array"):
        from_pyvista(pv.ImageData(dimensions=(2, 2, 2)))
    np.save(tmp_path / "a.npy", FIELD)
    with pytest.raises(ValueError, match="without a name"):
        read(tmp_path / "a.npy", scalars="first")


def test_volume_methods():
    check(Volume.from_pyvista(Volume(FIELD, SPACING, ORIGIN, TURNED).to_pyvista()))


# --- Refusals -------------------------------------------------------------------------------------------------------


def test_components(tmp_path):
    grid = image()
    grid.point_data["values"] = np.zeros((60, 3))
    with pytest.raises(ValueError, match="3 components"):
        from_pyvista(grid)
    four = nrrd(b"").replace(b"dimension: 3", b"dimension: 4").replace(b"sizes: 5 3 4", b"sizes: 6 5 3 4")
    (tmp_path / "a.nrrd").write_bytes(four.replace(b"directions: ", b"directions: none "))
    (tmp_path / "a.mha").write_bytes(meta(b"", more="ElementNumberOfChannels = 2\n"))
    (tmp_path / "a.nii").write_bytes(nifti(b"", code=128))
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((6, 5, 3), np.uint8), photometric="rgb")
    for name, count in (("a.nrrd", 6), ("a.mha", 2), ("a.nii", 3), ("a.tif", 3)):
        with pytest.raises(ValueError, match=rf"{count} components a sample.*array\[\.\.\., 0\]"):
            read(tmp_path / name)


def test_other_grids(tmp_path):
    grid = pv.RectilinearGrid([0.0, 1, 3], [0.0, 1], [0.0, 1])
    grid["s"] = np.arange(12.0)
    legacy(tmp_path / "a.vtk", grid)
    grid.save(tmp_path / "a.vtr")
    for name in ("a.vtk", "a.vtr"):
        with pytest.raises(ValueError, match=r"(?i)rectilinear ?grid; .*resample"):
            read(tmp_path / name)
    with pytest.raises(TypeError, match="got RectilinearGrid"):
        from_pyvista(grid)


def test_missing_and_unknown(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.nrrd"):
        read(tmp_path / "none.nrrd")
    with pytest.raises(FileNotFoundError, match="no TIFF or DICOM images"):
        read(tmp_path)
    (tmp_path / "a.xyz").write_text("x")
    with pytest.raises(ValueError, match=r"unknown extension; accepted are \.nrrd, .*\.npy"):
        read(tmp_path / "a.xyz")


def broken_candidates(folder: Path) -> list[Path]:
    for name, content in {
        "raw.nrrd": nrrd(LITTLE),
        "gzip.nrrd": nrrd(gzip.compress(LITTLE), "gzip"),
        "raw.mha": meta(LITTLE),
        "zlib.mha": meta(zlib.compress(LITTLE), True),
        "raw.nii": nifti(LITTLE),
        "gzip.nii.gz": gzip.compress(nifti(LITTLE)),
        "a.npy": npy(FIELD),
    }.items():
        (folder / name).write_bytes(content)
    vti(folder / "compressed.vti")
    vti(folder / "bare.vti", compress=False)
    vti(folder / "binary.vti", mode="binary")
    vti(folder / "ascii.vti", mode="ascii")
    legacy(folder / "binary.vtk", image())
    tifffile.imwrite(folder / "plain.tif", FIELD, photometric="minisblack")
    tifffile.imwrite(folder / "zlib.tif", FIELD, photometric="minisblack", compression="zlib")
    pages = [Image.fromarray(page) for page in FIELD.astype(np.uint16)]
    pages[0].save(folder / "lzw.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    with tifffile.TiffWriter(folder / "pages.tif") as file:
        for page in FIELD:
            file.write(page, contiguous=False, metadata=None)
    dicom(folder / "a.dcm", FIELD[0], ORIGIN)
    return sorted(folder.iterdir())


def test_truncated_files_are_noticed(tmp_path, capfd):
    """Cut anywhere, a file is refused, or it was only padding that went and the samples are all there."""
    (tmp_path / "good").mkdir()
    for path in broken_candidates(tmp_path / "good"):
        whole, content = read(path).numpy(), path.read_bytes()
        cut = tmp_path / path.name
        refused = 0
        cuts = sorted({0, 1, 10, *range(30, len(content), 37), *range(len(content) - 6, len(content))})
        for length in cuts:
            cut.write_bytes(content[:length])
            try:
                np.testing.assert_array_equal(read(cut).numpy(), whole, f"{path.name} cut to {length}")
            except OSError as error:
                assert path.name in str(error)
                refused += 1
        assert refused >= 0.75 * len(cuts), path.name
    printed = capfd.readouterr()
    assert printed.out == printed.err == ""


@pytest.mark.parametrize("name", ["gzip.nrrd", "zlib.mha", "gzip.nii.gz", "zlib.tif"])
def test_damaged_compressed_samples_are_noticed(tmp_path, name, capfd):
    """Formats with a check sum: whatever bit flips in the compressed samples, what is read is right or refused."""
    rng = np.random.default_rng(0)
    (tmp_path / "good").mkdir()
    broken_candidates(tmp_path / "good")
    content = (tmp_path / "good" / name).read_bytes()
    start = content.index(b"\x78\x9c" if "zlib" in name else b"\x1f\x8b")
    for _ in range(40):
        damaged = bytearray(content)
        damaged[rng.integers(start, min(start + 70, len(content)))] ^= 1 << rng.integers(8)
        (tmp_path / name).write_bytes(damaged)
        try:
            np.testing.assert_array_equal(read(tmp_path / name).numpy(), FIELD)
        except OSError as error:
            assert name in str(error)
    assert capfd.readouterr().err == ""


def test_nonsense_is_refused(tmp_path, capfd):
    noise = np.random.default_rng(0).bytes(5000)
    for ending in ("nrrd", "nhdr", "mha", "nii", "nii.gz", "vti", "vtk", "tif", "dcm", "npy"):
        for content in (b"", b"\n", noise, b"NRRD0004\nsizes: x y\n\n", b"\x93NUMPY" + noise, b"II*\0" + noise):
            path = tmp_path / f"a.{ending}"
            path.write_bytes(content)
            with pytest.raises(OSError, match=re.escape(path.name)):
                read(path)
    assert capfd.readouterr().err == ""


def test_too_many_bytes_are_refused(tmp_path):
    for name, content in (
        ("a.nrrd", nrrd(LITTLE + b"!")),
        ("a.mha", meta(LITTLE + b"!")),
        ("a.nii", nifti(LITTLE + b"!")),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(OSError, match="120 bytes of samples expected, got 121"):
            read(tmp_path / name)


# --- Real volumes ---------------------------------------------------------------------------------------------------


def listed_volumes() -> list[tuple[str, ...]]:
    """Rows of the data folder's table: file, dims, spacing, dtype, range, sha256."""
    if not (DATA / "README.md").exists():
        return []
    rows = [line.split("|") for line in (DATA / "README.md").read_text().splitlines() if line.startswith("| ")]
    return [tuple(c.strip() for c in (*r[1:6], r[9])) for r in rows if r[1].strip().endswith(".nrrd")]


@pytest.mark.skipif(not listed_volumes(), reason="no folder of real volumes beside the checkout")
def test_real_volumes():
    for file, dims, spacing, dtype, span, digest in listed_volumes():
        path = DATA / file
        assert hashlib.sha256(path.read_bytes()).hexdigest() == digest.strip("`")
        if "comp." in dims:
            with pytest.raises(ValueError, match="4 components"):
                read(path)
            continue
        volume = read(path)
        assert tuple(volume.dimensions) == tuple(int(n) for n in dims.split(" x ")), file
        np.testing.assert_allclose(volume.spacing, [float(s) for s in spacing.split(",")], atol=5e-6)
        assert volume.dtype == dtype
        np.testing.assert_allclose(volume.range, [float(s) for s in span.split(" .. ")], atol=5e-5)
        # The format stores x fastest: the same bytes in the same order.
        content = path.read_bytes()
        assert volume.numpy().tobytes() == gzip.decompress(content[content.index(b"\n\n") + 2 :])
        np.testing.assert_array_equal(volume.direction, np.eye(3))
    np.testing.assert_allclose(read(DATA / "bluntfin.nrrd").origin, (-7.8157, 0, 0), atol=1e-4)
