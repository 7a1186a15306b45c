"""Samples on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import warp as wp

from ..keep import Keeper, Part
from ..kernels.field.extremes import make_extremes
from ..kernels.field.samples import make_samples
from ..launch import launch
from ..memory import gib

# Bytes of a slice of samples from which on Warp's arrays, which count in 32 bits, do not find them.
SLICE = 1 << 31
# Work items that look through samples at most.
MOST_ITEMS = 1 << 16


@dataclass(frozen=True)
class Data(Part):
    """The samples of a volume as a Warp array, as they were at a ``version``."""

    volume: Any
    version: int
    name: ClassVar[str] = "volume"

    def build(self, keep: Keeper) -> wp.array:
        _, rows, columns = (max(n, 2) for n in self.volume.shape)
        if (size := rows * columns * self.volume.dtype.itemsize) >= SLICE:
            raise ValueError(
                f"volume must have slices array[z] of less than {gib(SLICE)}, got {gib(size)} in an array of shape "
                f"{self.volume.shape}: give memory_limit, which renders it in bricks"
            )
        return self.volume.uploaded(keep.device)


def samples_struct(data: wp.array, shift: float = 0.0) -> Any:
    """The struct of ``kernels.field.samples``."""
    struct = make_samples(data.dtype)()
    struct.data = data
    struct.last = wp.vec3i(*(n - 2 for n in reversed(data.shape)))
    struct.shift = shift
    return struct


def extremes(data: wp.array) -> tuple[float, float, int]:
    """The smallest and the largest finite sample (inf and -inf without one), and how many are not finite: found out
    where the samples are.
    """
    items = min(data.shape[0] * data.shape[1], MOST_ITEMS)
    low, high = (wp.empty(items, dtype=wp.float64, device=data.device) for _ in range(2))
    odd = wp.empty(items, dtype=wp.int64, device=data.device)
    launch(make_extremes(data.dtype), items, [data, low, high, odd], data.device)
    return float(low.numpy().min()), float(high.numpy().max()), int(odd.numpy().sum())
