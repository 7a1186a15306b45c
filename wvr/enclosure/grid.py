"""A grid of samples in balls: where a ray is in it, and the cubic that the trilinear field is along it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from flint import arb
from numpy.typing import NDArray

from .balls import Break, Cubic, Gap, break_of, lerp, within

Vector = list[arb]
Cell = tuple[int, int, int]
HALF = arb(0.5)


class Ray(NamedTuple):
    """World ``origin`` and unit ``direction``; t >= 0 where it ``starts`` at its origin."""

    origin: Vector
    direction: Vector
    starts: bool

    def at(self, t: arb) -> Vector:
        return [o + t * d for o, d in zip(self.origin, self.direction, strict=True)]


class Place(NamedTuple):
    """The cells that a ray may be in, more than one where it runs along their faces or so close that nobody can tell,
    and how far from those faces it may be, in each axis.
    """

    cells: list[Cell]
    apart: arb


def exact(numbers: Any) -> Vector:
    """Floats as balls without radius."""
    return [arb(float(number)) for number in numbers]


def dot(a: Vector, b: Vector) -> arb:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Grid:
    """Samples at ``origin + direction @ (spacing * (i, j, k))``; an axis with one is a cell, constant, around it."""

    def __init__(self, samples: NDArray, spacing: Any, origin: Any, direction: Any):
        self.samples = samples
        self.number = samples.shape[::-1]
        columns = [[arb(float(x)) * arb(float(h)) for x in axis] for axis, h in zip(direction.T, spacing, strict=True)]
        self.smallest = dot(columns[0], columns[0]).sqrt()
        for column in columns[1:]:
            self.smallest = self.smallest.min(dot(column, column).sqrt())
        # Rows of the inverse, times the determinant; divided by it last, whole indices stay whole.
        self.rows = [cross(columns[1], columns[2]), cross(columns[2], columns[0]), cross(columns[0], columns[1])]
        self.determinant = dot(columns[0], self.rows[0])
        self.origin = exact(origin)

    def through(self, ray: Ray) -> Passage:
        """The grid as a ray passes it."""
        start = [a - b for a, b in zip(ray.origin, self.origin, strict=True)]
        origin, direction = ([dot(row, v) / self.determinant for row in self.rows] for v in (start, ray.direction))
        return Passage(self, origin, direction)

    def sample(self, i: int, j: int, k: int) -> Any:
        """A Python number."""
        return self.samples[k, j, i].item()

    def corners(self, cell: Cell) -> list[Any]:
        """The eight samples of a cell, x fastest."""
        ends = [(i, min(i + 1, n - 1)) for i, n in zip(cell, self.number, strict=True)]
        return [self.sample(i, j, k) for k in ends[2] for j in ends[1] for i in ends[0]]


class Passage:
    """A grid, and a ray in its index coordinates."""

    def __init__(self, grid: Grid, origin: Vector, direction: Vector):
        self.grid, self.origin, self.direction = grid, origin, direction

    def breaks(self) -> list[Break]:
        """Where it crosses faces. Axes along which it may not move at all have none."""
        found = []
        for o, d, n in zip(self.origin, self.direction, self.grid.number, strict=True):
            if not d.contains(0):
                faces = _box(n) if n == 1 else [arb(i) for i in range(n)]
                found += [break_of((face - o) / d) for face in faces]
        return found

    def misses(self, t: arb) -> bool:
        """Whether it is outside the grid at all places of a ball."""
        for o, d, n in zip(self.origin, self.direction, self.grid.number, strict=True):
            low, high = _box(n)
            if o + t * d < low or o + t * d > high:
                return True
        return False

    def place(self, gap: Gap) -> Place | None:
        """Where it is between two breaks: no cells outside the grid; None where it cannot be told."""
        options, apart = [], arb(0)
        for o, d, n in zip(self.origin, self.direction, self.grid.number, strict=True):
            if d.contains(0):
                cells, width = _beside(o + gap.ball * d, n)
            else:
                cells, width = _inside(o + gap.middle * d, n), arb(0)
            if cells == []:
                return Place([], arb(0))
            options.append(cells)
            apart += width
        known = [cells for cells in options if cells is not None]
        # So close to faces that what is beside them can be told by how close.
        if len(known) < 3 or not apart < 0.25:
            return None
        return Place(list(product(*known)), apart)  # type: ignore[arg-type]

    def cubic(self, place: Place, middle: arb, numbers: Callable[[Cell], list[Any]]) -> Cubic:
        """What trilinear interpolation of cells' ``numbers`` is along the ray, of the length from ``middle``."""
        cell = place.cells[0]
        c = [[arb(number)] for number in numbers(cell)]
        for o, d, i in zip(self.origin, self.direction, cell, strict=True):
            at = o + middle * d - i
            c = [lerp(low, high, at, d) for low, high in zip(c[::2], c[1::2], strict=True)]
        found = Cubic(c[0][0], c[0][1], c[0][2], c[0][3])
        if place.apart.is_zero():
            return found
        # Each step to the cell beside changes it by no more than both slopes, and these are, as little beyond a
        # cell as this, no more than (1 + 2 / 4)^2 of the range of samples: 2 (9 / 4) < 8.
        every = [number for one in place.cells for number in numbers(one)]
        off = within(8 * place.apart * (arb(max(every)) - arb(min(every))))
        return found._replace(a=found.a + off, smooth=False)


def _box(n: int) -> tuple[arb, arb]:
    """From where to where a grid is along an axis."""
    return (-HALF, HALF) if n == 1 else (arb(0), arb(n - 1))


def _inside(p: arb, n: int) -> list[int] | None:
    """The cell at a coordinate that is not that of a face."""
    if n == 1:
        return [0] if abs(p) < HALF else [] if abs(p) > HALF else None
    i = p.floor().unique_fmpz()
    if i is None:
        return None
    return [int(i)] if 0 <= i <= n - 2 else []


def _beside(p: arb, n: int) -> tuple[list[int] | None, arb]:
    """The cells that a coordinate may be in that hardly changes, and how far apart it may be from their face."""
    low, high = _box(n)
    if p < low or p > high:
        return [], arb(0)
    if not (p >= low and p <= high):
        return None, arb(0)
    if n == 1:
        return [0], arb(0)
    first, last = (p.lower().ceil() - 1).unique_fmpz(), p.upper().floor().unique_fmpz()
    assert first is not None and last is not None  # of exact numbers
    cells = list(range(max(int(first), 0), min(int(last), n - 2) + 1))
    if len(cells) > 2:
        return None, arb(0)
    return cells, p.upper() - p.lower() if len(cells) > 1 else arb(0)


def finite(numbers: list[Any]) -> bool:
    return bool(np.all(np.isfinite(numbers)))
