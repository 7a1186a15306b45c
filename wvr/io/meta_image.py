"""MetaImage (https://itk.org/Wiki/MetaIO/Documentation)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error
from .bytes import corrupt, inflated, samples

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


def read_meta_image(path: Path) -> Grid:
    content = path.read_bytes()
    with corrupt(path):
        end = re.search(rb"ElementDataFile\s*=\s*([^\r\n]*)\r?\n?", content)
        if end is None:
            raise ValueError("no ElementDataFile in its header")
        lines = content[: end.end()].decode("latin-1").splitlines()
        head = {name.strip(): value.strip() for name, value in (line.split("=", 1) for line in lines if line.strip())}
        name = head["ElementDataFile"]
        components = int(head.get("ElementNumberOfChannels", 1))
        shape = [int(n) for n in head["DimSize"].split()][::-1]
    if components != 1:
        raise components_error(str(path), components)
    if len(shape) != 3:
        raise ValueError(f"{path} must have three dimensions, got DimSize = {head['DimSize']}")
    if name.startswith("LIST") or "%" in name:
        raise ValueError(f"{path} spreads its samples over several files ({name!r}); only one is supported: merge them")
    data = (
        memoryview(content)[end.end() :] if name.upper() == "LOCAL" else memoryview((path.parent / name).read_bytes())
    )
    with corrupt(path):
        return Grid(_samples_of(head, data, shape), *_place(head), "LPS" if "AnatomicalOrientation" in head else "")


def _field(head: dict[str, str], names: str, default: str) -> str:
    """The first field there is of several that mean the same."""
    return next((head[name] for name in names.split() if name in head), default)


def _samples_of(head: dict[str, str], data: memoryview, shape: Sequence[int]) -> NDArray:
    big = _field(head, "BinaryDataByteOrderMSB ElementByteOrderMSB", "False").lower() == "true"
    dtype = np.dtype(TYPES[head["ElementType"]]).newbyteorder(">" if big else "<")
    if head.get("BinaryData", "True").lower() == "false":
        return np.array(bytes(data).split()).astype(dtype).reshape(shape)
    skip = int(head.get("HeaderSize", 0))
    data = data[-int(np.prod(shape)) * dtype.itemsize :] if skip == -1 else data[skip:]
    compressed = head.get("CompressedData", "False").lower() == "true"
    return samples(inflated(data) if compressed else data, dtype, shape)


def _place(head: dict[str, str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    spacing = np.array(_field(head, "ElementSpacing ElementSize", "1 1 1").split(), np.float64).reshape(3)
    origin = np.array(_field(head, "Offset Position Origin", "0 0 0").split(), np.float64).reshape(3)
    matrix = _field(head, "TransformMatrix Rotation Orientation", "1 0 0 0 1 0 0 0 1").split()
    # Rows of the file's matrix are the axes' directions, as ITK (whose format it is) reads and writes it.
    return np.array(matrix, np.float64).reshape(3, 3).T * spacing, origin
