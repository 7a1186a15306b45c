"""A ray of a scene enclosed: from break to break, composed front to back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from ..camera import Camera
from ..cuts.base import Clip
from ..cuts.labels import Segmentation
from ..transfer_function import TransferFunction
from ..volume import Volume
from .balls import Break, Gap, parts
from .cuts import Labels, grid_of, kept_of
from .grid import Ray, cross, dot, exact, finite
from .material import CLEAR, NOTHING, Material, Segment, Span, over, small, union

# Bits of balls' middles, doubled as long as that helps.
LEAST, MOST = 192, 1536


@dataclass(frozen=True)
class Scene:
    """What is to be seen, checked."""

    volume: Volume
    transfer_function: TransferFunction | None
    clips: tuple[Clip, ...] = ()
    segmentation: Segmentation | None = None

    def enclose(self, camera: Camera, size: tuple[int, int], x: int, y: int, width: float) -> NDArray[np.float64]:
        """Lower and upper value of a pixel's channels, shape (2, 4), no further apart than ``width`` if possible."""
        precision = LEAST
        best = np.array([[-np.inf] * 4, [np.inf] * 4])
        while True:
            with ctx.workprec(precision):
                found = bounds(Walk(self).ray(camera_ray(camera, size, x, y)))
            before = np.ptp(best, axis=0).max()
            best = np.array([np.maximum(best[0], found[0]), np.minimum(best[1], found[1])])
            reached = np.ptp(best, axis=0).max()
            if reached <= width or precision >= MOST or reached > before / 2:
                return best
            precision *= 2


def bounds(segment: Segment) -> NDArray[np.float64]:
    """Of the channels, rounded outwards; no channel is below 0, and opacity not above 1."""
    channels = [*segment.color, 1 - segment.clear]
    low = np.array([max(_beyond(channel.lower(), -np.inf), 0.0) for channel in channels])
    high = np.array([_beyond(channel.upper(), np.inf) for channel in channels])
    high[3] = min(high[3], 1.0)
    return np.array([low, high])


def _beyond(exact: arb, way: float) -> float:
    """A float that is an exact number, or beyond it on one side."""
    if not exact.is_finite():
        return way
    near = float(exact)
    passed = arb(near) >= exact if way > 0 else arb(near) <= exact
    return near if passed else float(np.nextafter(near, way))


def camera_ray(camera: Camera, size: tuple[int, int], x: int, y: int) -> Ray:
    """The ray through the centre of a pixel, as the camera's numbers say."""
    width, height = size
    position, target = exact(camera.position), exact(camera.target)
    forward = unit([a - b for a, b in zip(target, position, strict=True)])
    right = unit(cross(forward, exact(camera.up)))
    up = cross(right, forward)
    if camera.parallel_scale is None:
        half = (arb(camera.view_angle) * arb.pi() / 360).tan()
    else:
        half = arb(camera.parallel_scale)
    across, above = (2 * x + 1 - width) * half / height, (height - 1 - 2 * y) * half / height
    offset = [across * r + above * u for r, u in zip(right, up, strict=True)]
    if camera.parallel_scale is not None:
        return Ray([p + o for p, o in zip(position, offset, strict=True)], forward, False)
    return Ray(position, unit([f + o for f, o in zip(forward, offset, strict=True)]), True)


def unit(v: list[arb]) -> list[arb]:
    length = dot(v, v).sqrt()
    return [x / length for x in v]


class Walk:
    """A scene in balls of one precision."""

    def __init__(self, scene: Scene):
        self.grid = grid_of(scene.volume)
        self.clips = scene.clips
        self.labels = None if scene.segmentation is None else Labels(scene.segmentation)
        functions: Any = [scene.transfer_function] if self.labels is None else self.labels.functions
        self.materials = [Material(tf, self.grid.smallest) for tf in functions]
        self.anything: Span = union([NOTHING, *(material.whole for material in self.materials)])

    def ray(self, ray: Ray) -> Segment:
        """The segment that a whole ray is."""
        self.passage = self.grid.through(ray)
        faces = self.passage.breaks()
        low = reduce(arb.min, (face.low for face in faces))
        high = reduce(arb.max, (face.high for face in faces))
        if ray.starts:
            faces.append(Break(arb(0), arb(0)))
        self.kept = [(clip.invert, kept_of(clip, ray)) for clip in self.clips]
        cuts = [one for _, kept in self.kept for one in kept.breaks(low, high)]
        result = CLEAR
        for part in parts([*faces, *cuts]):
            result = over(result, self._part(part, ray.starts))
            if result.clear < small():
                return over(result, self.anything.anyhow())
        # No colour is brighter than the brightest that there is.
        shades = [
            one.intersection(c * (1 - result.clear)) for one, c in zip(result.color, self.anything.color, strict=True)
        ]
        return Segment((shades[0], shades[1], shades[2]), result.clear)

    def _part(self, part: Break | Gap, starts: bool) -> Segment:
        if isinstance(part, Break):
            return CLEAR if part.once or self.passage.misses(part.ball) else self._unknown(part)
        if starts and part.middle < 0:
            return CLEAR
        place = self.passage.place(part)
        if place is not None and not place.cells:
            return CLEAR
        kept = self._kept(part)
        if kept is False:
            return CLEAR
        if kept is None or place is None:
            return self._unknown(part)
        present = [cell for cell in place.cells if finite(self.grid.corners(cell))]
        if not present:
            return CLEAR
        if len(present) < len(place.cells):
            return self._unknown(part)
        numbers = [number for cell in present for number in self.grid.corners(cell)]
        low, high = min(numbers), max(numbers)
        if all(material.transparent(low, high) for material in self.materials):
            return CLEAR
        c = self.passage.cubic(place, part.middle, self.grid.corners)
        result = CLEAR
        for stretch, state in self._states(part):
            if state is None:
                segment = CLEAR if isinstance(stretch, Break) and stretch.once else self._unknown(stretch)
            elif state < 0 or isinstance(stretch, Break):
                continue
            else:
                segment = self.materials[state].segment(c, stretch.start, stretch.end)
            result = over(result, segment)
        return result

    def _states(self, gap: Gap) -> Iterator[tuple[Break | Gap, int | None]]:
        """Which material holds where, of lengths from the middle of a gap in one cell."""
        if self.labels is None:
            yield Gap(gap.start - gap.middle, gap.end - gap.middle, arb(0)), 0
        else:
            yield from self.labels.along(self.passage, gap)

    def _kept(self, gap: Gap) -> bool | None:
        """Whether all clips keep what is between two breaks."""
        known = [None if (kept := one.keeps(gap)) is None else kept != invert for invert, one in self.kept]
        return False if False in known else None if None in known else True

    def _unknown(self, part: Break | Gap) -> Segment:
        """Anything that there is, or nothing."""
        length = part.high - part.low if isinstance(part, Break) else part.ball.upper() - part.ball.lower()
        return self.anything.along(length)
