"""Axes by their names, and the steps along them by their coordinates."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..samples import Unsupported
from .space import in_units_of_first

# Names of dimensions, in lower case, and the axis that they are.
DIMENSIONS = {
    "x": ("x", "lon", "longitude", "column", "columns", "col", "easting", "i"),
    "y": ("y", "lat", "latitude", "row", "rows", "northing", "j"),
    "z": ("z", "lev", "level", "depth", "height", "altitude", "alt", "slice", "slices", "plane", "k"),
}
AXIS_OF = {name: axis for axis, names in DIMENSIONS.items() for name in names}
# Coordinates that differ by less than this part of a step, and by what their dtype rounds, are equally spaced.
UNEVEN = 1e-3


class Axis(NamedTuple):
    """What a file or an array says of an axis; coordinates are None where it has none."""

    name: str
    coordinates: NDArray | None = None
    unit: str = ""

    @property
    def numbers(self) -> NDArray[np.float64] | None:
        """Its coordinates; None where it has none that are numbers."""
        given = self.coordinates
        if given is None or given.ndim != 1 or given.dtype.kind not in "iuf" or not len(given):
            return None
        return given.astype(np.float64)


def spatial(names: Sequence[str], fixed: Collection[str] = ()) -> list[int]:
    """Which axes are z, y, x: by their names, or else the last three, of those that are not fixed."""
    left = [n for n, name in enumerate(names) if name not in fixed]
    by_axis = {AXIS_OF.get(names[n].lower()): n for n in left}
    return [by_axis[axis] for axis in "zyx"] if by_axis.keys() >= {"x", "y", "z"} else left[-3:]


def places(axes: Sequence[Axis], advice: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps along axes and where they start: lengths in the first one's unit, others as they are."""
    found = np.array([_place(axis, advice) for axis in axes])
    factors = in_units_of_first([axis.unit for axis in axes])
    starts, steps = (found if factors is None else found * factors[:, None]).T
    return steps, starts


def _place(axis: Axis, advice: str) -> tuple[float, float]:
    """First coordinate and step along an axis; 0 and 1 where it has no coordinates that are numbers."""
    values = axis.numbers
    if values is None or axis.coordinates is None:
        return 0.0, 1.0
    if missing := np.count_nonzero(~np.isfinite(values)):
        raise _uneven(axis, f"{missing} of {len(values)} are missing", values, advice)
    if len(values) == 1:
        return float(values[0]), 1.0
    step = (values[-1] - values[0]) / (len(values) - 1)
    gaps = np.diff(values)
    dtype = axis.coordinates.dtype
    rounding = np.finfo(dtype).eps * np.abs(values).max() if dtype.kind == "f" else 0.0
    # Not so much that it says nothing.
    uneven = UNEVEN * abs(step) + min(2 * rounding, abs(step) / 8)
    if step == 0 or not np.all(np.abs(gaps - step) <= uneven):
        raise _uneven(axis, f"got steps from {gaps.min():g} to {gaps.max():g}", values, advice)
    return float(values[0]), float(step)


def _uneven(axis: Axis, found: str, values: NDArray, advice: str) -> Unsupported:
    ends = f"{values[0]:g}, {values[-1]:g}, {len(values)}"
    return Unsupported(
        f"coordinates {axis.name!r} must be equally spaced, {found}: {advice.format(name=axis.name, ends=ends)}"
    )
