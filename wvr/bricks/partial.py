"""Images of parts of a volume, and how they are composed.

What a part does to what is behind it is the map ``X -> C + T X``, X the colour behind, between 0 and the brightest, and
opacity a channel of colour 1. The bound of a part is that of the map, whatever X is: ``b = sup_X |F(X) - f(X)|``. So
``|F1(F2(X)) - f1(f2(X))| <= |F1(Y) - f1(Y)| + |f1(Y) - f1(Z)| <= b1 + T1 b2``, Y = F2(X), Z = f2(X), without a term
for the error of T1 (docs/proof.md, lemma 13).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .grid import Rect

Floats = NDArray[np.floating]


@dataclass
class Partial:
    """What a part of a volume does in some of an image's pixels: its ``rect``."""

    rect: Rect
    color: Floats  # (h, w, 3) premultiplied
    through: Floats  # (h, w) transparency
    bound: Floats | None  # (h, w) on the error of any channel, whatever is behind
    samples: NDArray[np.int32]  # (h, w)

    @classmethod
    def of(cls, rect: Rect, rgba: Floats, samples: NDArray[np.int32], bounds: NDArray[np.float32] | None) -> Partial:
        """Of colour and opacity."""
        bound = None if bounds is None else bounds.astype(np.float64)
        return cls(rect, rgba[..., :3].copy(), 1.0 - rgba[..., 3], bound, samples.copy())

    @classmethod
    def nothing(cls, rect: Rect, bounded: bool) -> Partial:
        """Of an empty part."""
        shape = (rect[0].stop - rect[0].start, rect[1].stop - rect[1].start)
        samples = np.zeros(shape, np.int32)
        return cls(rect, np.zeros((*shape, 3)), np.ones(shape), np.zeros(shape) if bounded else None, samples)

    def rounded(self, brightest: float) -> Partial:
        """The same in single precision, and what that costs in the bound."""
        color, through = self.color.astype(np.float32), self.through.astype(np.float32)
        bound = self.bound
        if bound is not None:
            off = np.abs(color - self.color).max(axis=-1, initial=0.0) + brightest * np.abs(through - self.through)
            bound = np.nextafter((bound + off).astype(np.float32), np.float32(np.inf))
        return Partial(self.rect, color, through, bound, self.samples)

    def over(self, behind: Partial) -> None:
        """Compose what is behind, which is seen in no pixels but this one's, into this one."""
        rows, columns = (
            slice(back.start - own.start, back.stop - own.start)
            for own, back in zip(self.rect, behind.rect, strict=True)
        )
        at = rows, columns
        through = self.through[at]
        self.color[at] += through[..., None] * behind.color
        if self.bound is not None and behind.bound is not None:
            self.bound[at] += through * behind.bound
        self.through[at] = through * behind.through
        self.samples[at] += behind.samples
