"""Images of bricks that are not read, of the ranges of their samples alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.bricks.unread import Unread, map_unread
from ..launch import launch_pixels
from ..scene import Scene
from ..transfer.function import transfer_values
from ..transfer_function import TransferFunction
from .brick import Caster, shared
from .grid import FAR, Bricks, Index, Rect
from .partial import Partial

Floats = NDArray[np.float64]
# Rounding of what is interpolated between control points, in parts of it.
ROUNDED = 2.0**-40


@dataclass(frozen=True)
class Looks:
    """What bricks may look like: extinction per unit length from ``least`` to ``most``, and colours where there is any,
    from ``low`` to ``high``; (n,) and (n, 3).
    """

    least: Floats
    most: Floats
    low: Floats
    high: Floats

    @classmethod
    def of(cls, scene: Scene, ranges: Floats) -> Looks:
        """Of bricks of samples in ``ranges``, (n, 2)."""
        looks = [_looks(tf, scene.unit, ranges) for tf in scene.functions]
        least = np.stack([one.least for one in looks]).min(axis=0)
        partly = scene.clips or scene.segmentation is not None or not getattr(scene.volume.half, "finite", True)
        if partly:
            # Cut away, of a label without a transfer function, or absent.
            least = np.zeros_like(least)
        most = np.stack([one.most for one in looks]).max(axis=0)
        low, high = np.stack([one.low for one in looks]).min(axis=0), np.stack([one.high for one in looks]).max(axis=0)
        low, high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
        return cls(least, most, low, high)

    def __getitem__(self, which: Any) -> Looks:
        return Looks(self.least[which], self.most[which], self.low[which], self.high[which])


def _looks(tf: TransferFunction, unit: float, ranges: Floats) -> Looks:
    values, knots = transfer_values(tf, unit), tf.knots
    tau = values[:, 3]
    # A control point's colour counts where there is extinction at it or at the next on either side.
    near = tau > 0
    near[1:] |= tau[:-1] > 0
    near[:-1] |= tau[1:] > 0
    begin = np.searchsorted(knots, ranges[:, 0], "left")
    end = np.searchsorted(knots, ranges[:, 1], "right")

    def extremes(numbers: Floats, counted: NDArray[np.bool_], where: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Least and greatest, of control points that are counted and of both ends where those count."""
        ends = np.stack([_between(ranges[:, side], knots, numbers) for side in (0, 1)])
        low = np.where(where, ends, np.inf).min(axis=0)
        high = np.where(where, ends, -np.inf).max(axis=0)
        low = np.minimum(low, _least(np.where(counted, numbers, np.inf), begin, end))
        high = np.maximum(high, -_least(np.where(counted, -numbers, np.inf), begin, end))
        # None is negative, and those of nothing stay infinite.
        return low * (1.0 - ROUNDED), high * (1.0 + ROUNDED)

    everywhere = np.ones((2, len(ranges)), bool)
    least, most = extremes(tau, np.ones(len(knots), bool), everywhere)
    # At its ends there is extinction, or next to them.
    seen = np.stack([near[np.clip(place - shift, 0, len(knots) - 1)] for place, shift in ((begin, 0), (end, 1))])
    before = np.stack([near[np.clip(place - shift, 0, len(knots) - 1)] for place, shift in ((begin, 1), (end, 0))])
    colors = [extremes(values[:, c], near, seen | before) for c in range(3)]
    low, high = np.stack([a for a, _ in colors], axis=-1), np.stack([b for _, b in colors], axis=-1)
    return Looks(np.maximum(least, 0.0), most, low, high)


def _between(scalars: Floats, knots: Floats, numbers: Floats) -> Floats:
    """``numbers`` >= 0 of control points, linear between them, to rounding of what they come to: ``np.interp`` has that
    of the largest, and nothing beside a control point of 0.
    """
    k = np.clip(np.searchsorted(knots, scalars, "right") - 1, 0, len(knots) - 2)
    with np.errstate(all="ignore"):
        width = knots[k + 1] - knots[k]
        inside = numbers[k] * ((knots[k + 1] - scalars) / width) + numbers[k + 1] * ((scalars - knots[k]) / width)
    return np.where(scalars < knots[0], numbers[0], np.where(scalars >= knots[-1], numbers[-1], inside))


def _least(numbers: Floats, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Floats:
    """Smallest of ``numbers[begin:end]`` for each, infinite where there is none."""
    rows = [numbers]  # of so many neighbours as a power of two
    while 2 ** len(rows) <= len(numbers):
        last, half = rows[-1], 2 ** (len(rows) - 1)
        rows.append(np.minimum(last[:-half], last[half:]))
    count = end - begin
    level = np.frexp(np.maximum(count, 1))[1] - 1
    result = np.full(len(begin), np.inf)
    for k, row in enumerate(rows):
        here = (level == k) & (count > 0)
        result[here] = np.minimum(row[begin[here]], row[end[here] - 2**k])
    return result


def widened(caster: Caster, ranges: Floats) -> Floats:
    """Ranges of samples that a ray may meet which rounding puts astray."""
    low, high = caster.scene.volume.range
    more = 8 * caster.view.astray * (high - low)
    return ranges + np.array([-more, more])


def struct_of(caster: Caster, numbers: NDArray[np.int32], looks: Looks, bricks: Bricks) -> Any:
    """The struct of kernels for ``numbers`` (z, y, x) of ``bricks``: which of the ``looks`` each has, negative where
    it is left out.
    """
    scene, device = caster.scene, caster.keep.device
    struct = Unread()
    for name, along in zip("xyz", bricks.edges, strict=True):
        faces = np.array(along, np.float64)
        faces[0], faces[-1] = -FAR, FAR
        setattr(struct, name, wp.array(faces, dtype=wp.float64, device=device))
    struct.number = wp.array(np.ascontiguousarray(numbers, np.int32), dtype=int, device=device)
    struct.least, struct.most = (wp.array(a, dtype=wp.float64, device=device) for a in (looks.least, looks.most))
    struct.low, struct.high = (wp.array(a, dtype=wp.vec3d, device=device) for a in (looks.low, looks.high))
    struct.brightest, struct.grain, struct.astray = scene.brightest, caster.grain, caster.view.astray
    struct.densest = float(looks.most.max(initial=0.0))
    return struct


def unread_brick(caster: Caster, index: Index, rect: Rect, looks: Looks) -> Partial:
    """The image of one brick that is not read, which has the first of the ``looks``: bounded for whatever is behind."""
    low, high = caster.bricks.own(index)
    around = Bricks(tuple((-FAR, a, b, FAR) for a, b in zip(low.tolist(), high.tolist(), strict=True)))  # type: ignore[misc]
    numbers = np.zeros((3, 3, 3), np.int32) - 1
    numbers[1, 1, 1] = 0
    struct = struct_of(caster, numbers, looks, around)
    struct.row, struct.column = rect[0].start, rect[1].start
    partial = Partial.nothing(rect, bounded=True)
    caster.view.height, caster.view.width = partial.through.shape
    bound = np.zeros(partial.through.shape)
    with shared(caster.keep.device, (partial.rgbt, wp.vec4d), (bound, wp.float64)) as outputs:
        launch_pixels(map_unread, [caster.view, struct, *outputs], caster.keep.device, caster.view)
        wp.synchronize_device(caster.keep.device)
    return replace(partial, bound=bound)
