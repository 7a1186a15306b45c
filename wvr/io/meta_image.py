"""MetaImage (https://itk.org/Wiki/MetaIO/Documentation)."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..samples import Anatomy, Grid, Unsupported, components_error, rescaled
from .bytes import Fields, Flaw, corrupt, header, opened, samples
from .nrrd import data_file

TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG": "i4",
    "MET_ULONG": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
# Fields that mean the same, and their first names.
ALIASES = {
    "ElementByteOrderMSB": "BinaryDataByteOrderMSB",
    **dict.fromkeys(("Position", "Origin"), "Offset"),
    **dict.fromkeys(("Rotation", "Orientation"), "TransformMatrix"),
}


def read_meta_image(path: Path) -> Grid:
    with opened(path) as file:
        lines, _ = header(file, lambda line: line.lstrip().startswith(b"ElementDataFile"))
        head = _head(lines)
        start, name = file.tell(), head["ElementDataFile"]
        components = head.numbers("ElementNumberOfChannels", int, 1)[0] if "ElementNumberOfChannels" in head else 1
        shape = head.sizes("DimSize")[::-1]
        if "NDims" in head and head.numbers("NDims", int, 1)[0] != len(shape):
            raise Flaw(f"its NDims is {head['NDims']}, its DimSize {head['DimSize']}")
        if head["ElementType"] not in TYPES:
            raise Flaw(f"its ElementType {head['ElementType']!r} is none of {', '.join(TYPES)}")
    if components != 1:
        raise components_error(str(path), components)
    if len(shape) not in (3, 4):
        raise Unsupported(f"{path} must have three dimensions, or four with time, got DimSize = {head['DimSize']}")
    data = path if name.upper() == "LOCAL" else data_file(path, name, r"%0?\d*d")
    with corrupt(path):
        steps, origin = _place(head, len(shape))
    with opened(data) as file:
        file.seek(start if data == path else 0)
        array = _samples(head, file, shape)
        slope, intercept = (
            head.numbers(name, float, 1)[0] if (name := f"ElementToIntensityFunction{end}") in head else default
            for end, default in (("Slope", 1.0), ("Offset", 0.0))
        )
        array = rescaled(array, slope, intercept)
    anatomical: Anatomy = "LPS" if "AnatomicalOrientation" in head else ""
    return Grid(array, steps, origin, anatomical, tuple(dict.fromkeys((path, data))))


def _head(lines: list[str]) -> Fields:
    head = Fields()
    for line in lines:
        name, equals, value = line.partition("=")
        if line.strip() and not equals:
            raise Flaw(f"the line {line[:80]!r} of its header is no field")
        name = name.strip()
        head.setdefault(ALIASES.get(name, name), value.strip())
    return head


def _samples(head: Fields, file: BinaryIO, shape: list[int]) -> NDArray:
    big = head.get("BinaryDataByteOrderMSB", "False").lower() == "true"
    dtype = np.dtype(TYPES[head["ElementType"]])
    if head.get("BinaryData", "True").lower() == "false":
        return samples(file, dtype, shape, "text")
    dtype = dtype.newbyteorder(">" if big else "<")
    skip = head.numbers("HeaderSize", int, 1)[0] if "HeaderSize" in head else 0
    packing = "zlib" if head.get("CompressedData", "False").lower() == "true" else "raw"
    if skip < -1 or (skip and packing != "raw"):
        raise Flaw(f"its HeaderSize must be >= 0, or -1 for raw samples at its end, got {skip}")
    return samples(file, dtype, shape, packing, max(skip, 0), tail=skip == -1)


def _place(head: Fields, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # Samples may be smaller than they are apart, which counts.
    apart = next((name for name in ("ElementSpacing", "ElementSize") if name in head), None)
    spacing = np.array([1.0] * n if apart is None else head.numbers(apart, float, n))
    origin = np.array(head.numbers("Offset", float, n) if "Offset" in head else [0.0] * n)
    matrix = np.eye(n)
    if "TransformMatrix" in head:
        matrix = np.array(head.numbers("TransformMatrix", float, n * n)).reshape(n, n)
    # Rows of the file's matrix are the axes' directions, as ITK (whose format it is) reads and writes it.
    return matrix[:3, :3].T * spacing[:3], origin[:3]
