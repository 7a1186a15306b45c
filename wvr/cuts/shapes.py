"""Convex shapes that clip. Lengths and positions are world units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kernels.cuts.shapes import BOX, PLANE, SPHERE
from ..kernels.cuts.shapes import Shape as Half
from ..pose import FARTHEST
from ..validation import finite_vector, positive
from .base import Floats, Shape

# Half the width of a box, at least: one over it, in the largest of grids, is a number.
THIN = 1e-150


def _check_size(value: Floats | float, given: Any, name: str) -> None:
    """Say so where there is more than maps to the clip's own coordinates are made of."""
    if np.abs(value).max() > FARTHEST:
        raise ValueError(f"{name} must be within {FARTHEST:g}, got {given!r}")


@dataclass(frozen=True)
class ClipPlane(Shape):
    """Keeps the side of a plane that its normal points to, as VTK does.

    Parameters
    ----------
    point
        Any point of the plane [world coordinates].
    normal
        Direction of any length but zero.
    invert
        Keep the other side.
    naive
        Leave out whole samples instead of cutting the ray: a segment is there, all of it, where its sample is kept
        (the first one, of rules with samples at both ends). For Riemann, Simpson and Preintegrated.

    Raises
    ------
    ValueError
        For a zero normal, NaN or infinite numbers, a point beyond 1e100.
    """

    point: ArrayLike
    normal: ArrayLike
    invert: bool = False
    naive: bool = False
    half: ClassVar[Half] = PLANE

    def __post_init__(self) -> None:
        point = finite_vector(self.point, "point", "a point of the plane")
        _check_size(point, self.point, "point")
        normal = finite_vector(self.normal, "normal", "a direction that is not zero")
        if not np.any(normal):
            raise ValueError(f"normal must not be zero, got {self.normal!r}")
        # Scaled first, so that no square under- or overflows.
        unit = normal / np.abs(normal).max()
        unit /= np.linalg.norm(unit)
        matrix = np.zeros((3, 3))
        matrix[0] = unit
        self.define(matrix, point, point=point, normal=normal)

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        return points[:, 0] >= 0


@dataclass(frozen=True)
class ClipBox(Shape):
    """Keeps a box along the world's axes.

    Parameters
    ----------
    lo, hi
        Its corners, lo < hi along each axis [world coordinates].
    invert
        Keep what is outside.
    naive
        As of :class:`ClipPlane`.

    Raises
    ------
    ValueError
        For lo >= hi along an axis, NaN or infinite numbers.
    """

    lo: ArrayLike
    hi: ArrayLike
    invert: bool = False
    naive: bool = False
    half: ClassVar[Half] = BOX

    def __post_init__(self) -> None:
        lo = finite_vector(self.lo, "lo", "the lower corner of the box")
        hi = finite_vector(self.hi, "hi", "the upper corner of the box")
        if np.any(lo >= hi):
            raise ValueError(f"lo must be below hi along x, y and z, got lo = {self.lo!r} and hi = {self.hi!r}")
        # Of ends so far apart that their difference is infinite, too.
        half = np.maximum(hi / 2 - lo / 2, THIN)
        self.define(np.diag(1 / half), lo / 2 + hi / 2, lo=lo, hi=hi)

    def near(self, points: Floats) -> ClipBox:
        """Faces far beyond the points may be anywhere there: from the middle between such nobody sees the others."""
        first, last = points.min(axis=0), points.max(axis=0)
        size = (last - first).max()
        lo, hi = np.maximum(self.lo, first - size), np.minimum(self.hi, last + size)
        return replace(self, lo=lo, hi=hi) if np.all(lo < hi) else self

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        return np.abs(points).max(axis=1) <= 1


@dataclass(frozen=True)
class ClipSphere(Shape):
    """Keeps a ball.

    Parameters
    ----------
    center
        [world coordinates].
    radius
        [world length], > 0.
    invert
        Keep what is outside.
    naive
        As of :class:`ClipPlane`.

    Raises
    ------
    ValueError
        For a radius that is not > 0, NaN or infinite numbers, a centre or radius beyond 1e100.
    """

    center: ArrayLike
    radius: float
    invert: bool = False
    naive: bool = False
    half: ClassVar[Half] = SPHERE

    def __post_init__(self) -> None:
        center = finite_vector(self.center, "center", "the centre of the sphere")
        radius = positive(self.radius, "radius")
        _check_size(center, self.center, "center")
        _check_size(radius, self.radius, "radius")
        self.define(np.eye(3) / max(radius, THIN), center, center=center)

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        return np.linalg.norm(points, axis=1) <= 1
