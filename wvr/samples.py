"""Samples on their way into a volume: which dtypes it keeps, and what becomes of the others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

DTYPES = ("uint8", "int8", "uint16", "int16", "float16", "float32", "float64")

NanPolicy = Literal["error", "transparent"]
Anatomy = Literal["", "RAS", "LPS"]
# Whole numbers up to here are numbers of double precision.
EXACT = 2**53


class Unsupported(ValueError):  # noqa: N818 - of a file
    """A file is sound, and no volume."""


class Grid(NamedTuple):
    """What a file holds: ``array[z, y, x]``, or ``[time, z, y, x]``, the world steps along x, y, z as columns, the
    first sample's position, which way a patient's world goes (as of :class:`wvr.Volume`), and the files that were read.
    """

    array: NDArray
    steps: NDArray[np.float64]
    origin: NDArray[np.float64]
    anatomical: Anatomy = ""
    files: tuple[Path, ...] = ()


def times_power(numbers: NDArray, exponent: int) -> NDArray[np.float64]:
    """Numbers times ``2**exponent``, each on the side of 0 that it is on, however little it is."""
    found = np.ldexp(numbers.astype(np.float64), exponent)
    return np.where((found == 0) & (numbers != 0), np.copysign(np.nextafter(0.0, 1.0), numbers), found)


def narrowed(array: NDArray) -> NDArray:
    """The array itself, or for bool and wide integers its values in the smallest accepted dtype that holds them all."""
    if array.dtype.kind not in "biu" or array.dtype.newbyteorder("=").name in DTYPES or array.size == 0:
        return array
    lo, hi = int(array.min()), int(array.max())
    for name in ("uint8", "int8", "uint16", "int16"):
        if np.iinfo(name).min <= lo and hi <= np.iinfo(name).max:
            return array.astype(name)
    if max(-lo, hi) > EXACT:
        raise Unsupported(f"samples of {array.dtype} from {lo} to {hi} fit no accepted dtype exactly; scale them first")
    return array.astype(np.float64)


def rescaled(array: NDArray, slope: float, intercept: float) -> NDArray:
    """``slope * array + intercept``: exact integers for whole numbers, else float32 or, where that does not tell
    them apart, float64."""
    if (slope, intercept) == (1, 0):
        return array
    ends = [int(array.min()), int(array.max())] if array.dtype.kind in "iu" and array.size else []
    if ends and float(slope).is_integer() and float(intercept).is_integer():
        lo, hi = sorted(int(slope) * end + int(intercept) for end in ends)
        if max(-lo, hi) <= EXACT:
            # On the way numbers may wrap, and back.
            product = array.astype(np.int64).view(np.uint64) * np.uint64(int(slope) % 2**64)
            return (product + np.uint64(int(intercept) % 2**64)).view(np.int64)
        check_apart(lo, hi, slope)
    return in_dtype(array * np.float64(slope) + intercept, scaled_dtype(array.dtype, slope, intercept, ends))


def check_apart(low: int, high: int, step: float) -> None:
    """Refuses whole numbers that far apart which float64 does not hold, to 1/128 of that."""
    if max(-low, high) > EXACT * max(1.0, abs(step) / 128):
        raise Unsupported(
            f"samples from {low} to {high} are beyond 2**53, which float64 does not hold: subtract what they have in "
            f"common first"
        )


def in_dtype(values: NDArray, dtype: np.dtype, gone: NDArray[np.bool_] | None = None) -> NDArray:
    """In another dtype, NaN where they are gone."""
    values = values.astype(dtype, copy=False)
    if gone is not None:
        values = np.where(gone, dtype.type(np.nan), values)
    return values


def scaled_dtype(stored: np.dtype, slope: float, intercept: float, ends: Sequence[int] = ()) -> np.dtype:
    """Of ``slope * samples + intercept``: float32 where that tells samples apart, of integers those between ``ends`` or
    all that there may be.
    """
    narrow, wide = np.dtype("float32"), np.dtype("float64")
    if stored.kind == "f":
        # Of any magnitude: what is added may leave nothing of them.
        return narrow if stored.itemsize <= 4 and not intercept and 2**-20 <= abs(slope) <= 1 else wide
    if stored.itemsize > 2:
        return wide
    limits = np.iinfo(np.uint8 if stored.kind == "b" else stored)
    largest = max(abs(slope * end + intercept) for end in ends or (int(limits.min), int(limits.max)))
    if float(slope).is_integer() and float(intercept).is_integer():
        return narrow if largest <= 2**24 else wide
    # To 1/128 of what lies between two samples.
    return narrow if abs(slope) >= 2**-100 and largest <= min(2**17 * abs(slope), 2.0**100) else wide


def components_error(what: str, count: int) -> Unsupported:
    """What to raise where ``what`` has ``count`` components a sample."""
    return Unsupported(
        f"{what} has {count} components a sample, a volume has one: load the data with another tool, pick a component "
        f"(array[..., 0]) or combine them (e.g. their norm) and pass the result to wvr.Volume"
    )
