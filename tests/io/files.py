"""Files of every kind, made from their formats' definitions, with one field in one place."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
import vtk

from wvr.volume import Volume

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


def amira(data: bytes, order="BINARY-LITTLE-ENDIAN", kind="short", packing="", before=b"", more="") -> bytes:
    """A lattice of which the matrix is a quarter turn and a shift, in Amira's rows; its box ends at the last sample."""
    matrix = "0 1 0 0 -1 0 0 0 0 0 1 0 10 20 30 1"
    first = "Lattice { float[2] Flow } @1\n" if before else ""
    head = (
        f"# AmiraMesh {order} 2.1\n\n\ndefine Lattice 5 3 4\n\nParameters {{\n"
        f'    Content "5x3x4 {kind}, uniform coordinates",\n    BoundingBox 0 6 0 4 0 9,\n'
        f'    CoordType "uniform",\n    TransformationMatrix {matrix}\n}}\n\n{first}'
        f"Lattice {{ {kind} Data }} @{2 if before else 1}{packing}\n{more}\n# Data section follows\n@1\n"
    )
    return head.encode() + (before + b"\n@2\n" if before else b"") + data + b"\n"


def runs(content: bytes) -> bytes:
    """Packed as HxByteRLE does: every second run as it is, the others of equal bytes."""
    packed, at = b"", 0
    while at < len(content):
        equal = 1
        while equal < 127 and content[at : at + 1] * (equal + 1) == content[at : at + equal + 1]:
            equal += 1
        part = content[at : at + 3]
        packed += bytes([equal]) + content[at : at + 1] if equal > 1 else bytes([128 + len(part)]) + part
        at += equal if equal > 1 else len(part)
    return packed


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


def dicom(
    path: Path,
    array,
    position,
    slope=1,
    intercept=0,
    number=1,
    series="1.2.3",
    orientation=(0, 1, 0, -1, 0, 0),
    spacing=(SPACING[1], SPACING[0]),
):
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
    data.PixelSpacing, data.SliceThickness = list(spacing), 99.0
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
