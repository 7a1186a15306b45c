"""Axes by their names, and the steps along them by their coordinates."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ..samples import Unsupported

# Names of dimensions, in lower case, and the axis that they are.
DIMENSIONS = {
    "x": ("x", "lon", "longitude", "column", "columns", "col", "easting", "i"),
    "y": ("y", "lat", "latitude", "row", "rows", "northing", "j"),
    "z": ("z", "lev", "level", "depth", "height", "altitude", "alt", "slice", "slices", "plane", "k"),
}
AXIS_OF = {name: axis for axis, names in DIMENSIONS.items() for name in names}
# Coordinates that differ by less than this part of a step are equally spaced: those of float32 files do.
UNEVEN = 1e-3


def spatial(names: Sequence[str], fixed: Collection[str] = ()) -> list[int]:
    """Which axes are z, y, x: by their names, or else the last three, of those that are not fixed."""
    left = [n for n, name in enumerate(names) if name not in fixed]
    by_axis = {AXIS_OF.get(names[n].lower()): n for n in left}
    return [by_axis[axis] for axis in "zyx"] if by_axis.keys() >= {"x", "y", "z"} else left[-3:]


def steps_of(coordinates: NDArray | None, name: str, advice: str) -> tuple[float, float]:
    """First coordinate and step along an axis; 0 and 1 where it has no coordinates that are numbers."""
    if coordinates is None or coordinates.ndim != 1 or coordinates.dtype.kind not in "iuf":
        return 0.0, 1.0
    values = coordinates.astype(np.float64)
    if len(values) == 1:
        return float(values[0]), 1.0
    step = (values[-1] - values[0]) / (len(values) - 1)
    gaps = np.diff(values)
    if step == 0 or not np.all(np.abs(gaps - step) <= UNEVEN * abs(step)):
        ends = f"{values[0]:g}, {values[-1]:g}, {len(values)}"
        raise Unsupported(
            f"coordinates {name!r} must be equally spaced, got steps from {gaps.min():g} to {gaps.max():g}: "
            f"{advice.format(name=name, ends=ends)}"
        )
    return float(values[0]), float(step)
