"""How much there is at most in cells and in blocks of them, in a byte each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..kernels.field.climb import Tops as Struct
from .samples import Data

# Samples that are looked at together: what is computed of them stays in a processor's cache.
AT_A_TIME = 1 << 17


@dataclass(frozen=True)
class Tops(Part):
    """``Tops`` of ``kernels.field.climb``, of values times ``sign`` of samples from ``low`` to ``high``. All codes are
    the largest unless blocks are to be leapt over (``skip``).
    """

    data: Data
    sign: int
    low: float
    high: float
    skip: bool
    name: ClassVar[str] = "tops"

    def build(self, keep: Keeper) -> Any:
        samples = keep(self.data).numpy()
        struct = Struct()
        base, most = sorted((self.sign * self.low, self.sign * self.high))
        known = self.skip and np.isfinite(most - base)
        struct.most = most if known else np.inf
        struct.exact = bool(known and samples.dtype.kind in "iu" and most - base <= 255)
        # The code 0 is that of nothing, but where there is something everywhere.
        struct.least = 0 if struct.exact else 1
        scale = 0.0
        if struct.exact:
            scale = 1.0
        elif known and most > base:
            scale = min(254.0 / max(most - base, 1e-300), 1e300)
        struct.base, struct.scale = base if known else 0.0, scale
        cells = [n - 1 for n in samples.shape]
        codes = np.zeros([-(-n // 4) * 4 for n in cells], np.uint8)
        step = 4 * max(AT_A_TIME // (4 * samples[0].size), 1)
        for z in range(0, cells[0], step):
            part = self._codes(samples[z : z + step + 1], base, scale, struct.exact)
            codes[z : z + len(part), : cells[1], : cells[2]] = part
        levels = [_nodes(codes)]
        while levels[-1].shape[:3] != (1, 1, 1):
            levels.append(_nodes(levels[-1].max(axis=3)))
        # In rows: no axis of an array is longer than 2^31, which there may be more cells than.
        codes = np.concatenate([level.reshape(-1, 64) for level in levels])
        struct.codes = wp.array(codes, dtype=wp.uint8, device=keep.device)
        return struct

    def _codes(self, samples: NDArray, base: float, scale: float, exact: bool) -> NDArray[np.uint8]:
        """Of cells."""
        if not self.skip:
            return np.full([n - 1 for n in samples.shape], 255, np.uint8)
        larger = np.maximum if self.sign > 0 else np.minimum
        with np.errstate(invalid="ignore"):
            for axis in range(3):
                along = np.moveaxis(samples, axis, 0)
                samples = np.moveaxis(larger(along[1:], along[:-1]), 0, axis)
        if exact:
            # Modulo 256, whatever the type.
            start = np.uint8(int(self.low if self.sign > 0 else self.high) % 256)
            tops = samples.astype(np.uint8)
            return tops - start if self.sign > 0 else start - tops
        values = self.sign * samples.astype(np.float64)
        with np.errstate(invalid="ignore", over="ignore"):
            codes = np.ceil((values - base) * scale)
        return np.where(np.isfinite(values), np.clip(codes, 1, 255), 0).astype(np.uint8)


def _nodes(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Of blocks of 4 x 4 x 4 codes [z, y, x], what is in each: [z, y, x, 64]."""
    codes = np.pad(codes, [(0, -n % 4) for n in codes.shape])
    nz, ny, nx = (n // 4 for n in codes.shape)
    return codes.reshape(nz, 4, ny, 4, nx, 4).transpose(0, 2, 4, 1, 3, 5).reshape(nz, ny, nx, 64)
