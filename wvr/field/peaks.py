"""How much there is at most in blocks of several sizes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..kernels.field.peaks import Peaks as Struct
from .blocks import Ranges


@dataclass(frozen=True)
class Peaks(Part):
    """Largest value times ``sign`` of blocks of 4, 16 and 64 cells along each axis; infinite unless blocks are to
    be leapt over (``skip``).
    """

    ranges: Ranges
    sign: int
    skip: bool
    name: ClassVar[str] = "peaks"

    def build(self, keep: Keeper) -> Any:
        ranges = keep(self.ranges).numpy()
        low, high = ranges[..., 0], ranges[..., 1]
        tops = _up(self.sign * (high if self.sign > 0 else low).astype(np.float64))
        tops[low > high] = -np.inf  # all absent
        if not self.skip:
            tops[:] = np.inf
        levels = [tops]
        for _ in range(2):
            levels.append(_coarser(levels[-1]))
        struct = Struct()
        struct.fine, struct.middle, struct.coarse = (
            wp.array(level, dtype=wp.float32, device=keep.device) for level in levels
        )
        return struct


def _up(numbers: NDArray[np.float64]) -> NDArray[np.float32]:
    """As float32, no less."""
    with np.errstate(over="ignore"):
        near = numbers.astype(np.float32)
    return np.where(near < numbers, np.nextafter(near, np.float32(np.inf)), near)


def _coarser(tops: NDArray[np.float32]) -> NDArray[np.float32]:
    """The largest of 4 x 4 x 4 at a time."""
    nz, ny, nx = (-(-n // 4) for n in tops.shape)
    padding = [(0, 4 * m - n) for m, n in zip((nz, ny, nx), tops.shape, strict=True)]
    padded = np.pad(tops, padding, constant_values=-np.inf)
    return padded.reshape(nz, 4, ny, 4, nx, 4).max(axis=(1, 3, 5))
