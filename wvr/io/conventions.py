"""What stored numbers mean by the conventions of netCDF (CF, https://cfconventions.org), which HDF5 files and Zarr
arrays follow too: which stand for none, and what the others are times and plus.
"""

from __future__ import annotations

import struct
from base64 import b64decode
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..samples import Unsupported, check_apart, in_dtype, rescaled, scaled_dtype

# What is in samples of netCDF that were never written, where no other number is said to be.
UNWRITTEN: dict[str, float] = {
    "i2": -32767,
    "u2": 65535,
    "i4": -2147483647,
    "u4": 2**32 - 1,
    "i8": -(2**63) + 2,
    "u8": 2**64 - 2,
}
UNWRITTEN |= {"f4": 9.969209968386869e36, "f8": 9.969209968386869e36}
# Where xarray has names of dimensions in Zarr 2.
XARRAY = "_ARRAY_DIMENSIONS"


@dataclass(frozen=True)
class Meaning:
    """What stored samples mean.

    Attributes
    ----------
    slope, intercept
        Values are samples times the one, plus the other.
    missing
        Samples that stand for none.
    low, high
        Smallest and largest sample that stands for one; None where any does.
    packed
        Whether those two are of samples, not of values.
    kind
        "u" or "i": integers have a sign, or not, other than their dtype says.
    """

    slope: float = 1.0
    intercept: float = 0.0
    missing: tuple[float, ...] = ()
    low: float | None = None
    high: float | None = None
    packed: bool = True
    kind: str = ""

    @property
    def sparse(self) -> bool:
        """Whether samples may be missing."""
        return bool(self.missing) or self.low is not None or self.high is not None

    def dtype(self, stored: np.dtype) -> np.dtype:
        """Of values, which may be missing, or what is stored of others."""
        if stored.kind not in "biuf":
            return stored
        seen = self._seen(stored)
        if (self.slope, self.intercept) != (1, 0):
            return scaled_dtype(seen, self.slope, self.intercept)
        if seen.kind in "iu" and self.sparse:
            return np.dtype("float32" if seen.itemsize <= 2 else "float64")
        return seen

    def values(self, stored: NDArray) -> NDArray:
        """In that dtype, NaN where they are missing."""
        seen = stored.view(self._seen(stored.dtype))
        gone = self._gone(seen)
        if gone is not None:
            seen = np.where(gone, seen.dtype.type(0), seen)
        scaled = (self.slope, self.intercept) != (1, 0)
        whole = float(self.slope).is_integer() and float(self.intercept).is_integer()
        if seen.dtype.kind in "iu" and whole and seen.size and (scaled or seen.itemsize == 8):
            low, high = sorted(int(end) * int(self.slope) + int(self.intercept) for end in (seen.min(), seen.max()))
            check_apart(low, high, self.slope)
        values = seen * np.float64(self.slope) + self.intercept if scaled else seen
        return in_dtype(values, self.dtype(stored.dtype), gone)

    def all_values(self, stored: NDArray) -> NDArray:
        """Of all samples there are: whole numbers stay such where none is missing."""
        seen = stored.view(self._seen(stored.dtype))
        return rescaled(seen, self.slope, self.intercept) if self._gone(seen) is None else self.values(stored)

    def _seen(self, stored: np.dtype) -> np.dtype:
        return np.dtype(stored.str.replace(stored.kind, self.kind)) if self.kind else stored

    def _gone(self, seen: NDArray) -> NDArray[np.bool_] | None:
        """Which samples are missing; None where none is."""
        if not self.sparse:
            return None
        gone = np.zeros(seen.shape, bool)
        for number in self.missing:
            gone |= seen == seen.dtype.type(number)
        numbers = seen if self.packed else seen * np.float64(self.slope) + self.intercept
        if self.low is not None:
            gone |= numbers < self.low
        if self.high is not None:
            gone |= numbers > self.high
        return gone if gone.any() else None


PLAIN = Meaning()


def meaning_of(attributes: Mapping[str, Any], dtype: np.dtype, unwritten: Any = None) -> Meaning:
    """By the attributes of an array, whose ``unwritten`` samples are so; what is no such number says nothing."""
    if dtype.kind not in "iuf":
        return PLAIN
    flipped = {("i", "true"): "u", ("u", "false"): "i"}
    kind = flipped.get((dtype.kind, text_of(attributes, "_Unsigned").lower()), "")
    slope, intercept = _one(attributes, "scale_factor", 1.0), _one(attributes, "add_offset", 0.0)
    ends: list[Any] = _numbers(attributes, "valid_range")
    if len(ends) != 2:
        ends = [(_numbers(attributes, name) or [None])[0] for name in ("valid_min", "valid_max")]
    # Limits of integers that are none themselves are of what those are scaled to.
    packed = dtype.kind == "f" or not any(isinstance(end, float | np.floating) for end in ends)
    said = [end for end in ends if end is not None]
    if dtype.str[1:] == "i1" and packed and not kind and said and min(said) >= 0 and max(said) > 127:
        # As bytes without a sign are in netCDF 3, which has none.
        kind = "u"
    given = [*_numbers(attributes, "_FillValue"), *_numbers(attributes, "missing_value")]
    if "_FillValue" not in attributes and unwritten is not None and unwritten == _unwritten(dtype):
        given.append(unwritten)
    missing = dict.fromkeys(number for one in given if (number := _missing(one, dtype, kind)) is not None)
    low, high = (
        None if end is None or not np.isfinite(end) else _limit(end, way, dtype, kind, None if packed else intercept)
        for end, way in zip(ends, (-1, 1), strict=True)
    )
    return Meaning(slope, intercept, tuple(missing), low, high, packed, kind)


def meaning_of_zarr(array: Any, filled: bool = True) -> Meaning:
    """Of one of Zarr's, as xarray has it: in Zarr 2 what stands for none is what fills chunks that are not there, where
    that is ``filled`` in by xarray.
    """
    attributes = array.attrs.asdict()
    if filled and array.metadata.zarr_format == 2 and XARRAY in attributes and array.fill_value is not None:
        attributes["_FillValue"] = np.asarray(array.fill_value).item()
    return meaning_of(attributes, np.dtype(array.dtype))


def _unwritten(dtype: np.dtype) -> Any:
    default = UNWRITTEN.get(dtype.str[1:])
    return None if default is None else dtype.type(default)


def _single(value: Any) -> Any:
    """Without an array around it, which netCDF has around texts and numbers."""
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def text_of(attributes: Mapping[str, Any], name: str) -> str:
    """An attribute; empty where it is not there."""
    value = _single(attributes.get(name, ""))
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _one(attributes: Mapping[str, Any], name: str, default: float) -> float:
    found = _numbers(attributes, name)
    if len(found) > 1 or not all(map(np.isfinite, found)):
        raise Unsupported(f"its {name} must be a finite number, got {found}")
    return float(found[0]) if found else default


def _numbers(attributes: Mapping[str, Any], name: str) -> list[Any]:
    """Of an attribute; none of another kind. Zarr's are text where JSON has no such number."""
    value = _single(attributes.get(name))
    if isinstance(value, str | bytes):
        try:
            return [float(value)]
        except ValueError:
            with suppress(ValueError, struct.error):
                return list(struct.unpack("<d", b64decode(value, validate=True)))
    with suppress(ValueError):  # lists of lists
        array = np.ravel(np.asarray(value))
        return array.tolist() if array.dtype.kind in "iuf" else []
    return []


def _missing(number: float, dtype: np.dtype, kind: str) -> float | None:
    """A number as samples are compared with it; None of one that no sample is."""
    if dtype.kind == "f":
        found = _rounded(number, dtype)
        return None if np.isnan(found) else found
    if not np.isfinite(number) or number != int(number):
        return None
    whole = _as_seen(int(number), dtype, kind)
    limits = np.iinfo(dtype if not kind else dtype.str.replace(dtype.kind, kind))
    return whole if limits.min <= whole <= limits.max else None


def _limit(end: Any, outwards: int, dtype: np.dtype, kind: str, intercept: float | None) -> float | None:
    """Of what is valid, as samples are compared with it, or values that an intercept was added to."""
    if intercept is not None:
        # All of these may be of single precision, and products of them so far from each other.
        return end + outwards * 2**-22 * max(abs(end), abs(intercept))
    if dtype.kind == "f":
        return rounded if np.isfinite(rounded := _rounded(end, dtype)) else None
    return _as_seen(end, dtype, kind)


def _rounded(number: float, dtype: np.dtype) -> float:
    with np.errstate(over="ignore"):
        return float(dtype.type(number))


def _as_seen(whole: int, dtype: np.dtype, kind: str) -> int:
    """A sample as its dtype has it, by the sign that it has."""
    if not kind or not np.iinfo(dtype).min <= whole <= np.iinfo(dtype).max:
        return whole
    top = 2 ** (8 * dtype.itemsize)
    return whole % top if kind == "u" else (whole + top // 2) % top - top // 2
