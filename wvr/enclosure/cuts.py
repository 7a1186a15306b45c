"""Clips and labels in balls: where along a ray they may change, and what holds between two such places."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Protocol

from flint import arb

from ..cuts.base import Clip
from ..cuts.labels import Segmentation
from ..cuts.shapes import ClipBox, ClipPlane, ClipSphere
from ..cuts.volumes import ClipVolume
from ..transfer_function import TransferFunction
from ..volume import Volume
from .balls import Break, Cubic, Gap, break_of, moved, parts, within, zeros
from .grid import Cell, Grid, Passage, Ray, Vector, dot, exact
from .material import small


class Kept(Protocol):
    """What a clip keeps, without ``invert``, of a ray that it was made for."""

    def breaks(self, low: arb, high: arb) -> list[Break]:
        """Where that may change, on a part of the ray."""

    def keeps(self, gap: Gap) -> bool | None:
        """Whether it keeps what is between two of those; None where nobody can tell."""


class Sides:
    """What is on the one side of each of some planes, ``(point, normal)``, and on them."""

    def __init__(self, ray: Ray, planes: list[tuple[Vector, Vector]]):
        # Distances, times any number > 0, are place + speed t.
        self.lines = []
        for point, normal in planes:
            start = [a - b for a, b in zip(ray.origin, point, strict=True)]
            self.lines.append((dot(normal, start), dot(normal, ray.direction)))

    def breaks(self, low: arb, high: arb) -> list[Break]:
        return [break_of(-place / speed) for place, speed in self.lines if not speed.contains(0)]

    def keeps(self, gap: Gap) -> bool | None:
        # Where the speed may be 0, what is all along the gap.
        distances = [p + s * (gap.ball if s.contains(0) else gap.middle) for p, s in self.lines]
        if any(distance < 0 for distance in distances):
            return False
        return True if all(distance >= 0 for distance in distances) else None


class Ball:
    """What is in a ball, and on its surface."""

    def __init__(self, ray: Ray, center: Vector, radius: arb):
        start = [a - b for a, b in zip(ray.origin, center, strict=True)]
        self.closest = -dot(start, ray.direction)
        off = [a + self.closest * d for a, d in zip(start, ray.direction, strict=True)]
        self.squared = radius**2 - dot(off, off)

    def breaks(self, low: arb, high: arb) -> list[Break]:
        if self.squared < 0:
            return []
        if not self.squared > 0:
            return [break_of(self.closest + within(self.squared.upper().sqrt()), once=False)]
        half = self.squared.sqrt()
        return [break_of(self.closest - half), break_of(self.closest + half)]

    def keeps(self, gap: Gap) -> bool | None:
        distance = self.squared - (gap.middle - self.closest) ** 2
        return True if distance >= 0 else False if distance < 0 else None


class Above:
    """What has at least a level, of another volume."""

    def __init__(self, ray: Ray, volume: Volume, iso: float):
        self.passage = grid_of(volume).through(ray)
        self.iso = arb(iso)

    def breaks(self, low: arb, high: arb) -> list[Break]:
        found = self.passage.breaks()
        for gap in list(parts([break_of(low), *found, break_of(high)])):
            if isinstance(gap, Break) or not (gap.end > low and gap.start < high):
                continue
            place = self.passage.place(gap)
            if place is None:
                found.append(break_of(gap.ball, once=False))
                continue
            numbers = [arb(number) for cell in place.cells for number in self.passage.grid.corners(cell)]
            if all(n >= self.iso for n in numbers) or all(n < self.iso for n in numbers):
                continue
            c = self.passage.cubic(place, gap.middle, self.passage.grid.corners)
            first, last = (gap.start - gap.middle).lower(), (gap.end - gap.middle).upper()
            found += shifted(zeros(c, [self.iso], first, last, (last - first) * small()), gap.middle)
        return found

    def keeps(self, gap: Gap) -> bool | None:
        place = self.passage.place(gap)
        if place is None:
            return None
        if not place.cells:
            return False
        numbers = [arb(number) for cell in place.cells for number in self.passage.grid.corners(cell)]
        if all(n >= self.iso for n in numbers):
            return True
        level = self.passage.cubic(place, gap.middle, self.passage.grid.corners).a - self.iso
        return True if level >= 0 else False if level < 0 else None


def kept_of(clip: Clip, ray: Ray) -> Kept:
    """A clip as a ray meets it."""
    if isinstance(clip, ClipPlane):
        return Sides(ray, [(exact(clip.point), exact(clip.normal))])
    if isinstance(clip, ClipBox):
        lo, hi, zero = exact(clip.lo), exact(clip.hi), [arb(0), arb(0), arb(0)]
        planes = []
        for axis in range(3):
            for corner, way in ((lo, 1), (hi, -1)):
                normal = list(zero)
                normal[axis] = arb(way)
                planes.append((corner, normal))
        return Sides(ray, planes)
    if isinstance(clip, ClipSphere):
        return Ball(ray, exact(clip.center), arb(float(clip.radius)))
    assert isinstance(clip, ClipVolume)  # of ``check``
    return Above(ray, clip.volume, float(clip.iso))


def check(clips: tuple[Clip, ...]) -> None:
    """Say so where a clip is none that rays are enclosed with."""
    for clip in clips:
        # Not what is derived of them, whose device halves may be anything.
        if type(clip) not in (ClipPlane, ClipBox, ClipSphere, ClipVolume):
            raise TypeError(
                f"clip must be ClipPlane, ClipBox, ClipSphere or ClipVolume for an enclosure, got {type(clip).__name__}"
            )
        if clip.naive or clip.parts is not None:
            raise ValueError(f"clip must cut rays exactly for an enclosure, without naive or parts, got {clip!r}")


def grid_of(volume: Volume) -> Grid:
    return Grid(volume.host(), volume.spacing, volume.origin, volume.direction)


def shifted(breaks: list[Break], t: arb) -> list[Break]:
    """Breaks of a length from t as breaks of the ray."""
    return [Break((one.low + t).lower(), (one.high + t).upper(), one.once) for one in breaks]


class Labels:
    """Labels of a grid's samples, by the transfer function that each has: those with equal ones are one state.

    ``functions`` are those of the states; a state beyond them is transparent.
    """

    def __init__(self, segmentation: Segmentation):
        self.samples = segmentation.labels.host()
        self.functions: list[TransferFunction] = []
        self.states = {label: self._state(tf) for label, tf in segmentation.transfer_functions.items()}
        self.other = self._state(segmentation.other)

    def _state(self, tf: TransferFunction | None) -> int:
        if tf is None:
            return -1
        if tf not in self.functions:
            self.functions.append(tf)
        return self.functions.index(tf)

    def corners(self, grid: Grid, cell: Cell) -> list[int]:
        """The states of a cell's corners, x fastest."""
        ends = [(i, min(i + 1, n - 1)) for i, n in zip(cell, grid.number, strict=True)]
        found = [self.samples[k, j, i].item() for k in ends[2] for j in ends[1] for i in ends[0]]
        return [self.states.get(label, self.other) for label in found]

    def along(self, passage: Passage, gap: Gap) -> list[tuple[Break | Gap, int | None]]:
        """What a gap between faces of cells is made of, of lengths from its middle, and the states, None where one
        cannot be told.
        """
        place = passage.place(gap)
        assert place is not None
        whole = Gap(gap.start - gap.middle, gap.end - gap.middle, arb(0))
        states = sorted({state for cell in place.cells for state in self.corners(passage.grid, cell)})
        if len(states) == 1:
            return [(whole, states[0])]

        def indicator(state: int) -> Callable[[Cell], list[int]]:
            return lambda cell: [int(one == state) for one in self.corners(passage.grid, cell)]

        weights = {state: passage.cubic(place, gap.middle, indicator(state)) for state in states}
        low, high = whole.start.lower(), whole.end.upper()
        breaks = [break_of(whole.start), break_of(whole.end)]
        for one, two in combinations(states, 2):
            a, b, c, d = (x - y for x, y in zip(weights[one][:4], weights[two][:4], strict=True))
            ahead = Cubic(a, b, c, d, weights[one].smooth)
            breaks += zeros(ahead, [arb(0)], low, high, (high - low) * small())
        found: list[tuple[Break | Gap, int | None]] = []
        for part in parts(breaks):
            if isinstance(part, Break):
                found.append((part, None))
                continue
            here = {state: moved(weight, part.middle).a for state, weight in weights.items()}
            most = [s for s, w in here.items() if all(w > other for t, other in here.items() if t != s)]
            found.append((part, most[0] if most else None))
        return found
