"""NIfTI-1 and -2 (https://nifti.nimh.nih.gov)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error, rescaled
from .bytes import corrupt, inflated, samples

TYPES = {
    2: "u1",
    4: "i2",
    8: "i4",
    16: "f4",
    64: "f8",
    256: "i1",
    512: "u2",
    768: "u4",
    1024: "i8",
    1280: "u8",
}
COMPONENTS = {32: 2, 1792: 2, 128: 3, 2304: 4}  # complex, complex, RGB, RGBA
# header size: (name, type, byte offset) of the fields that matter
FIELDS = {
    348: (
        ("dim", "8i2", 40), ("datatype", "i2", 70), ("pixdim", "8f4", 76), ("offset", "f4", 108), ("slope", "f4", 112),
        ("intercept", "f4", 116), ("qform", "i2", 252), ("sform", "i2", 254), ("quatern", "3f4", 256),
        ("qoffset", "3f4", 268), ("srow", "(3,4)f4", 280), ("magic", "S4", 344),
    ),
    540: (
        ("magic", "S4", 4), ("datatype", "i2", 12), ("dim", "8i8", 16), ("pixdim", "8f8", 104), ("offset", "i8", 168),
        ("slope", "f8", 176), ("intercept", "f8", 184), ("qform", "i4", 344), ("sform", "i4", 348),
        ("quatern", "3f8", 352), ("qoffset", "3f8", 376), ("srow", "(3,4)f8", 400),
    ),
}  # fmt: skip


def read_nifti(path: Path) -> Grid:
    content = path.read_bytes()
    with corrupt(path):
        if path.name.lower().endswith(".gz"):
            content = inflated(content)
        head, order = _header(content)
        dimension, *dims = head["dim"].tolist()
        if not 1 <= dimension <= 7:
            raise ValueError(f"{dimension} dimensions")
        dims = dims[:dimension] + [1] * (7 - dimension)
    components = COMPONENTS.get(int(head["datatype"]), 1) * int(np.prod(dims[3:]))
    if components != 1:
        raise components_error(str(path), components)
    with corrupt(path):
        dtype = np.dtype(TYPES[int(head["datatype"])]).newbyteorder(order)
        array = samples(memoryview(content)[int(head["offset"]) :], dtype, dims[2::-1])
        # A slope of 0 or NaN means none.
        slope, intercept = (float(head["slope"]), float(head["intercept"])) if head["slope"] else (1.0, 0.0)
        array = rescaled(array, slope, intercept) if np.isfinite(slope) else array
        return Grid(array, *_place(head), anatomical="RAS")


def _header(content: bytes) -> tuple[Any, Literal["<", ">"]]:
    """The header's fields and the file's byte order, known from the header's size at its start."""
    orders: tuple[Literal["<", ">"], ...] = ("<", ">")
    for order in orders:
        size = int(np.frombuffer(content, order + "i4", 1)[0])
        if size in FIELDS:
            names, formats, offsets = zip(*FIELDS[size], strict=True)
            layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
            head = np.frombuffer(content, np.dtype(layout).newbyteorder(order), 1)[0]  # type: ignore[call-overload]
            if head["magic"] not in (b"n+1", b"n+2"):
                raise ValueError(f"magic {head['magic']!r} where n+1 or n+2 is expected")
            return head, order
    raise ValueError("no NIfTI header at its start")


def _place(head: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if head["sform"] > 0:
        rows = head["srow"].astype(np.float64)
        return rows[:, :3], rows[:, 3]
    spacing = np.abs(head["pixdim"][1:4].astype(np.float64))
    if head["qform"] <= 0:
        return np.diag(spacing), np.zeros(3)
    b, c, d = head["quatern"].astype(np.float64)
    a = np.sqrt(max(0.0, 1 - b * b - c * c - d * d))
    rotation = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    flip = -1.0 if head["pixdim"][0] < 0 else 1.0  # "qfac": the handedness of the axes
    return rotation * spacing * [1, 1, flip], head["qoffset"].astype(np.float64)
