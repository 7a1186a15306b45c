"""What of a volume is visible, and a camera that frames it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .camera import Camera, not_along
from .cuts.base import Clip
from .cuts.labels import Segmentation
from .field.base import Field
from .transfer_function import TransferFunction

Floats = NDArray[np.float64]
# What says which samples are seen: a transfer function, or labels that have one each.
Showing: TypeAlias = TransferFunction | Segmentation
# Blocks along the longest axis that are looked at for what is visible.
BLOCKS = 48
# Samples along it that are looked at.
SAMPLES = 160
# Optical depth of a block, seen from a side, that counts as visible.
FAINT = 0.02
# Of the picture, left free on each side.
MARGIN = 0.04


def visible_depths(volume: Field, shown: Showing) -> tuple[NDArray[np.floating], int]:
    """Mean optical depth of blocks of samples [z, y, x], seen from a side, and the samples along a block.

    Of a volume with at most 160 samples along an axis, equally spaced ones of a larger; ``shown`` is the transfer
    function, or labels that have some.
    """
    samples = volume.host()  # type: ignore[attr-defined]
    step = max(1, -(-max(samples.shape) // SAMPLES))
    some = samples[::step, ::step, ::step]
    per_voxel = _extinction(some, shown, step, volume.smallest_spacing) * volume.smallest_spacing
    width = max(1, -(-max(some.shape) // BLOCKS))
    # As long as a block is on average, in voxels of the smallest spacing.
    lengths = np.linalg.norm(volume.index_to_world[:3, :3], axis=0) / volume.smallest_spacing
    return block_means(per_voxel, width) * (width * step * float(np.mean(lengths))), width * step


def visible_points(volume: Field, shown: Showing | None, clips: Sequence[Clip] = ()) -> Floats:
    """World positions of the corners of blocks in which there is something to see, shape (n, 3), without ``clips``
    only of blocks at the ends of rows of them, which all the others are between.

    Where there is nothing, or nothing is known, the corners of the volume's box.
    """
    last = np.array(volume.shape) - 1.0
    corners = np.array([[(c >> a) & 1 for a in range(3)] for c in range(8)])
    chosen: Callable[[NDArray[np.bool_]], NDArray[np.intp]] = np.argwhere if clips else ends_of_rows
    # What a sample is seen in are the cells on both sides of it.
    if shown is not None and hasattr(volume, "host"):
        depths, width = visible_depths(volume, shown)
        found = chosen(depths > FAINT)
        nodes = ((found[:, None, :] + corners) * width - (1 - corners)).reshape(-1, 3)
    elif isinstance(shown, TransferFunction) and (blocks := blocks_of(volume)) is not None:
        starts, ranges = blocks
        found = chosen(most_extinction(ranges, shown, volume.smallest_spacing) > 0)
        ends = [np.stack([along[:-1] - 1, along[1:]], axis=-1) for along in map(np.array, reversed(starts))]
        nodes = np.stack([ends[a][found[:, a, None], corners[:, a]] for a in range(3)], axis=-1).reshape(-1, 3)
    else:
        return volume.corners
    # A single layer of samples is a voxel thick.
    half = np.where(last == 0, 0.5, 0.0)
    nodes = np.clip(nodes, -half, last + half)
    points = nodes[:, ::-1] @ volume.index_to_world[:3, :3].T + volume.index_to_world[:3, 3]
    kept = np.ones(len(points), bool)
    for clip in clips:
        kept &= clip.keeps(points)
    if kept.any():
        return points[kept]
    return points if len(points) else volume.corners


def ends_of_rows(there: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Places, shape (n, 3), of what is there, but for what has others before and behind it along some axis."""
    for axis in range(3):
        row = np.moveaxis(there, axis, 0)
        before, behind = (np.logical_or.accumulate(row[way]) for way in (slice(None), slice(None, None, -1)))
        between = before[:-2] & behind[-3::-1]
        row = row.copy()
        row[1:-1] &= ~between
        there = np.moveaxis(row, 0, axis)
    return np.argwhere(there)


def blocks_of(volume: Field) -> tuple[Sequence[Sequence[int]], NDArray[np.float64]] | None:
    """First samples of blocks along x, y, z, with one past the last, and their smallest and largest samples (bz, by,
    bx, 2), of a volume in a store whose ranges are known.
    """
    known = getattr(volume, "ranges", None)
    if known is None or not known.known.all():
        return None
    return known.starts, known.whole()


def most_extinction(ranges: NDArray[np.float64], tf: TransferFunction, smallest_spacing: float) -> Floats:
    """The largest extinction [1/world length] of scalars in ranges (..., 2); 0 of ranges the wrong way round."""
    low, high = ranges[..., 0], ranges[..., 1]
    most = np.maximum(tf.extinction(low, smallest_spacing), tf.extinction(high, smallest_spacing))
    for knot, extinction in zip(tf.knots, tf.knot_extinctions(smallest_spacing), strict=True):
        most = np.where((low <= knot) & (knot <= high), np.maximum(most, extinction), most)
    return np.where(low <= high, most, 0.0)


def _extinction(some: NDArray, shown: Showing, step: int, smallest_spacing: float) -> NDArray[np.float32]:
    if not isinstance(shown, Segmentation):
        return extinction_of(some, shown, smallest_spacing)
    states = shown.states.of_label[shown.labels.host()[::step, ::step, ::step]]
    result = np.zeros(some.shape, np.float32)
    if states.shape == some.shape:  # else the scene says that it is not
        for state, tf in enumerate(shown.states.functions):
            result[states == state] = extinction_of(some[states == state], tf, smallest_spacing)
    return result


def extinction_of(samples: NDArray, tf: TransferFunction, smallest_spacing: float) -> NDArray[np.float32]:
    """Extinction of samples [1/world length]; 0 where they are not finite."""
    if samples.dtype.kind in "iu" and samples.size > 2**16:
        lo, hi = int(samples.min()), int(samples.max())
        table = tf.extinction(np.arange(lo, hi + 1), smallest_spacing).astype(np.float32)
        return table[samples.astype(np.int64) - lo]
    values = samples.astype(np.float64)
    return np.where(np.isfinite(values), tf.extinction(values, smallest_spacing), 0.0).astype(np.float32)


def block_means(values: NDArray[np.floating], width: int) -> NDArray[np.floating]:
    """Means over blocks of ``width`` samples along each axis, those at the end of what there is."""
    for axis in range(3):
        starts = np.arange(0, values.shape[axis], width)
        counts = np.diff(np.append(starts, values.shape[axis]))
        shape = [-1 if a == axis else 1 for a in range(3)]
        values = np.add.reduceat(values, starts, axis) / counts.reshape(shape).astype(np.float32)
    return values


def framed(
    points: ArrayLike,
    direction: ArrayLike,
    up: ArrayLike,
    view_angle: float = 30.0,
    aspect: float = 1.0,
    parallel: bool = False,
) -> Camera:
    """The nearest camera that looks along -``direction`` and has all ``points`` in view, in the middle.

    With u to the right, v upwards and w towards the camera, a camera at (x, y, z) sees what has
    |u - x| <= t (z - w), t the tangent of half the angle of view: the largest u + t w and smallest u - t w of all
    points say how far away and where it must be, and likewise upwards.
    """
    points = np.asarray(points, np.float64)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    probe = Camera(direction, (0, 0, 0), not_along(up, direction), view_angle)
    right, upward, forward = probe.basis()
    u, v, w = (points - middle) @ right, (points - middle) @ upward, -(points - middle) @ forward
    tall = np.tan(np.radians(view_angle) / 2) * (1 - 2 * MARGIN)
    wide = tall * aspect
    if parallel:
        x, y = (u.min() + u.max()) / 2, (v.min() + v.max()) / 2
        scale = max(np.ptp(v) / 2, np.ptp(u) / 2 / aspect, 1e-9 * float(np.abs(points).max() or 1)) / (1 - 2 * MARGIN)
        distance = 2 * max(float(np.ptp(points, axis=0).max()), scale)
        target = middle + x * right + y * upward
        return Camera(target - distance * forward, target, upward, view_angle, scale)
    left_end, right_end = (u - wide * w).min(), (u + wide * w).max()
    bottom, top = (v - tall * w).min(), (v + tall * w).max()
    z = max((right_end - left_end) / (2 * wide), (top - bottom) / (2 * tall))
    x, y = (right_end + left_end) / 2, (top + bottom) / 2
    z = max(z, w.max() + 1e-3 * float(np.ptp(w) or 1.0))
    target = middle + x * right + y * upward
    return Camera(target - z * forward, target, upward, view_angle)
