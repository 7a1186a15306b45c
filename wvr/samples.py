"""Samples on their way into a volume: which dtypes it keeps, and what becomes of the others."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

DTYPES = ("uint8", "int8", "uint16", "int16", "float16", "float32", "float64")

NanPolicy = Literal["error", "transparent"]


class Grid(NamedTuple):
    """What a file holds: ``array[z, y, x]``, the world steps along x, y, z as columns, the first sample's position.

    ``anatomical`` is as of :class:`wvr.Volume`.
    """

    array: NDArray
    steps: NDArray[np.float64]
    origin: NDArray[np.float64]
    anatomical: str = ""


def narrowed(array: NDArray) -> NDArray:
    """The array itself, or for bool and wide integers its values in the smallest accepted dtype that holds them all."""
    if array.dtype.kind not in "biu" or array.dtype.newbyteorder("=").name in DTYPES or array.size == 0:
        return array
    lo, hi = int(array.min()), int(array.max())
    for name in ("uint8", "int8", "uint16", "int16"):
        if np.iinfo(name).min <= lo and hi <= np.iinfo(name).max:
            return array.astype(name)
    if max(-lo, hi) > 2**53:
        raise ValueError(f"samples of {array.dtype} from {lo} to {hi} fit no accepted dtype exactly; scale them first")
    return array.astype(np.float64)


def rescaled(array: NDArray, slope: float, intercept: float) -> NDArray:
    """``slope * array + intercept``: exact integers for whole numbers, else float32, or float64 for wide samples."""
    if (slope, intercept) == (1, 0):
        return array
    if array.dtype.kind in "iu" and float(slope).is_integer() and float(intercept).is_integer():
        return array.astype(np.int64) * int(slope) + int(intercept)
    wide = array.dtype.itemsize > (4 if array.dtype.kind == "f" else 2)
    return (array * np.float64(slope) + intercept).astype(np.float64 if wide else np.float32)


def components_error(what: str, count: int) -> ValueError:
    """What to raise where ``what`` has ``count`` components a sample."""
    return ValueError(
        f"{what} has {count} components a sample, a volume has one: load the data with another tool, pick a component "
        f"(array[..., 0]) or combine them (e.g. their norm) and pass the result to wvr.Volume"
    )
