"""Rays that lie in faces between cells, told from those that are only computed to be there.

In exact arithmetic: of a camera and a grid that are given as numbers, cross products and the inverse are rational.
"""

from __future__ import annotations

from fractions import Fraction
from math import isqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .camera import Camera
from .field.base import Field

Vector = list[Fraction]
# Rounding of a place, and of a direction, in parts of the numbers that are summed up.
ROUNDING = 2.0**-44
# Of what is larger nothing is said: squares and sums are floats.
LARGEST = 10**200


def proven(field: Field, camera: Camera, size: tuple[int, int], astray: float) -> tuple[int, int, int]:
    """Whether rays of an image that are computed to be in a face across an index axis are there, of each axis: 1 if
    all are of which coordinate along it is computed to be whole and the direction to have no part along it; 0 where
    nobody can say. Rays are computed to be at most so far ``astray`` [index coordinates].
    """
    matrix, direction = field.index_to_world[:3, :3], getattr(field, "direction", None)
    columns = [_exact(column) for column in matrix.T]
    if direction is not None:
        spacing = _exact(field.spacing)  # type: ignore[attr-defined]
        columns = [[x * s for x in _exact(column)] for column, s in zip(direction.T, spacing, strict=True)]
    position, origin = _exact(camera.position), _exact(field.index_to_world[:3, 3])
    forward = _less(_exact(camera.target), position)
    right = _cross(forward, _exact(camera.up))
    up = _cross(right, forward)
    pixel = 2 * Fraction(camera.half_height) / size[1]
    found = [0, 0, 0]
    for a in range(3):
        row = _cross(columns[(a + 1) % 3], columns[(a + 2) % 3])
        row = [x / _dot(row, columns[a]) for x in row]
        oblique = [(axis, count) for axis, count in ((right, size[0]), (up, size[1])) if _dot(row, axis) != 0]
        # Where both of an image's axes are oblique to faces, rays are in one by chance.
        if _dot(row, forward) == 0 and len(oblique) == 1 and astray < 0.25:
            axis, count = oblique[0]
            squared = (pixel * _dot(row, axis)) ** 2 / _dot(axis, axis)
            middle = _dot(row, _less(position, origin))
            if max(abs(middle), squared, *map(abs, row)) > LARGEST:
                continue
            if camera.parallel:
                found[a] = _whole(middle, squared, count, astray)
            else:
                # Only rays in the middle have no slope, and the others are computed to have some.
                least = ROUNDING * (1 + camera.half_height * (1 + size[0] / size[1])) * sum(abs(float(x)) for x in row)
                found[a] = (count % 2 == 0 or middle.denominator == 1) and float(squared) ** 0.5 > least
    return int(found[0]), int(found[1]), int(found[2])


def _whole(middle: Fraction, squared: Fraction, count: int, astray: float) -> bool:
    """Whether those of ``count`` coordinates are whole that may be computed to be: around the ``middle``, a step apart
    of which the square is given.
    """
    step = float(squared) ** 0.5
    off = (np.arange(count) - 0.5 * (count - 1)) * step
    places = float(middle) + off
    wide = 2 * astray + ROUNDING * float(np.abs(places).max() + np.abs(off).max())
    near = np.flatnonzero(np.abs(places - np.rint(places)) <= wide)
    exact = _root(squared)
    for ahead in (Fraction(2 * k - count + 1, 2) for k in near.tolist()):
        if exact is None and ahead != 0:
            return False
        if (middle + ahead * (exact or 0)).denominator != 1:
            return False
    return True


def _root(squared: Fraction) -> Fraction | None:
    """The root of the square of a rational number; None of others."""
    root = Fraction(isqrt(squared.numerator), isqrt(squared.denominator))
    return root if root * root == squared else None


def _exact(v: ArrayLike) -> Vector:
    return [Fraction(x) for x in np.asarray(v, np.float64).tolist()]


def _less(a: Vector, b: Vector) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a: Vector, b: Vector) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))
