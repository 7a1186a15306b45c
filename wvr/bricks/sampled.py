"""Some of the samples of a volume in a store, to suggest a transfer function and a view by."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import TYPE_CHECKING

import numpy as np

from ..notices import announce
from ..volume import Volume

if TYPE_CHECKING:
    from .stored import StoredVolume


def sampled(volume: StoredVolume, most: int) -> Volume:
    """All samples in memory if they take at most so many bytes, else those of blocks that are evenly apart.

    Such blocks are put side by side and stretched over those that were left out: the box is the same, and what is in
    it, is at most as far from its place as blocks are apart.
    """
    along = blocks_that_fit(volume, most)
    picked = [_picked(volume, axis, n) for axis, n in enumerate(along)]
    ends = [np.cumsum([0, *(volume.starts[a][i + 1] - volume.starts[a][i] for i in picked[a])]) for a in range(3)]
    samples = np.empty([int(end[-1]) for end in reversed(ends)], volume.dtype)
    if samples.shape != volume.shape:
        announce(
            "%s has no coarser level: what suits it is said by %d of its %d blocks",
            volume.samples.name,
            math.prod(along),
            math.prod(volume.blocks_along),
        )
    for k, j, i in np.ndindex(*reversed(along)):
        low, high = volume.block((picked[0][i], picked[1][j], picked[2][k]))
        part = tuple(slice(ends[a][n], ends[a][n + 1]) for a, n in ((2, k), (1, j), (0, i)))
        samples[part] = volume.region(low, high)
    lengths, all_of = np.array(samples.shape[::-1]), np.array(volume.shape[::-1])
    stretch = np.where(lengths > 1, (all_of - 1) / np.maximum(lengths - 1, 1), 1.0)
    result = Volume(samples, volume.spacing * stretch, volume.origin, volume.direction, volume.nan)
    result.anatomical = volume.anatomical
    return result


def blocks_that_fit(volume: StoredVolume, most: int) -> list[int]:
    """How many blocks there is room for along x, y, z: along each axis the same share of them, one at least."""
    counts = volume.blocks_along
    longest = max(counts)

    def of(number: int) -> list[int]:
        return [-(-number * count // longest) for count in counts]

    def too_many(number: int) -> bool:
        samples = math.prod(_samples(volume, axis, count) for axis, count in enumerate(of(number)))
        return samples * volume.dtype.itemsize > most

    return of(bisect_left(range(2, longest + 1), True, key=too_many) + 1)


def _picked(volume: StoredVolume, axis: int, count: int) -> list[int]:
    """So many blocks along an axis, evenly apart; the first and the last are two of three, but not of two."""
    last = volume.blocks_along[axis] - 1
    margin = 0.0 if count > 2 else last / (2 * count)
    return np.rint(np.linspace(margin, last - margin, count)).astype(int).tolist()


def _samples(volume: StoredVolume, axis: int, count: int) -> int:
    starts = volume.starts[axis]
    return sum(starts[i + 1] - starts[i] for i in _picked(volume, axis, count))
