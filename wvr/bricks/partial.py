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
    rgbt: Floats  # (h, w, 4) premultiplied colour, and transparency
    bound: Floats | None  # (h, w) on the error of any channel, whatever is behind
    samples: NDArray[np.int32]  # (h, w)
    foremost: bool = False  # it has all that is in front of what is composed next

    @property
    def color(self) -> Floats:
        """(h, w, 3)."""
        return self.rgbt[..., :3]

    @property
    def through(self) -> Floats:
        """(h, w) transparency."""
        return self.rgbt[..., 3]

    @classmethod
    def nothing(cls, rect: Rect, bounded: bool) -> Partial:
        """Of an empty part."""
        shape = (rect[0].stop - rect[0].start, rect[1].stop - rect[1].start)
        rgbt = np.zeros((*shape, 4))
        rgbt[..., 3] = 1.0
        return cls(rect, rgbt, np.zeros(shape) if bounded else None, np.zeros(shape, np.int32))

    def at(self, rect: Rect) -> Rect:
        """Where some of its pixels are in its arrays."""
        rows, columns = (
            slice(part.start - own.start, part.stop - own.start) for own, part in zip(self.rect, rect, strict=True)
        )
        return rows, columns

    def part(self, rect: Rect) -> Partial:
        """Some of its pixels, which share its memory."""
        at = self.at(rect)
        bound = None if self.bound is None else self.bound[at]
        return Partial(rect, self.rgbt[at], bound, self.samples[at], self.foremost)

    def rounded(self, brightest: float) -> Partial:
        """The same in single precision, and what that costs in the bound."""
        rgbt, bound = self.rgbt.astype(np.float32), self.bound
        if bound is not None:
            off = np.abs(rgbt - self.rgbt)
            off = off[..., :3].max(axis=-1, initial=0.0) + brightest * off[..., 3]
            bound = np.nextafter((bound + off).astype(np.float32), np.float32(np.inf))
        return Partial(self.rect, rgbt, bound, self.samples)

    def over(self, behind: Partial) -> None:
        """Compose what is behind, which is seen in no pixels but this one's, into this one."""
        here = self.part(behind.rect)
        through = here.through.copy()
        here.rgbt[..., 3] = 0.0
        here.rgbt += through[..., None] * behind.rgbt
        if here.bound is not None and behind.bound is not None:
            here.bound += through * behind.bound
        here.samples += behind.samples
