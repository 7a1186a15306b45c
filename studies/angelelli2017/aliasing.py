"""What is judged by eye in the paper is a number here, ``aliasing``, and a local one, since stripes are seen where they
are: an image's difference to a fine one of the same method, sRGB-encoded on white, loses its mean over a window of
``WINDOW`` pixels, since stripes of slices and rings of steps are finer than shading; of its root mean square in blocks
of ``BLOCK`` pixels, those at least half of which show anything, the worst counts. It is compared with ``VISIBLE``,
which was set on two other scans than those judged, by looking at ICS with slices 0.35 to 1.4 voxels apart: the engine
shows no stripes at 0.014 and does at 0.018, the smooth teapot none at 0.009 and faint ones at 0.012. The largest
distance without aliasing is where a line through the logarithms of distances and of aliasing crosses it.

A fine image shows more, too. What is aliasing and nothing else is what changes where slices and cells lie elsewhere:
half the difference between an image and one with them ``moved``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from warp import vec2d

import wvr
from wvr.light import sweep

from ..base.scenes import picture

WINDOW = 9
BLOCK = 32
VISIBLE = 0.013


def aliasing(image: wvr.Image, fine: wvr.Image) -> float:
    """Root mean square of what is fine in the difference, in the worst block."""
    difference = picture(image) - picture(fine)
    window = np.lib.stride_tricks.sliding_window_view(
        np.pad(difference, [(WINDOW // 2,) * 2] * 2 + [(0, 0)], "edge"), (WINDOW, WINDOW), (0, 1)
    )
    shown = fine.rgba[..., 3] > 0
    square = np.where(shown, np.square(difference - window.mean((-2, -1))).mean(-1), 0)
    sums, counts = blocks(square), blocks(shown)
    enough = counts >= min(0.5 * BLOCK**2, counts.max())
    return float(np.sqrt((sums[enough] / counts[enough]).max()))


@contextmanager
def moved(slices: float = 0.0, cells: float = 0.0) -> Iterator[None]:
    """Sweeps begin so many slices earlier, and so many cells more to the side along either axis; both at most one."""
    usual = sweep.place

    def elsewhere(*given: Any) -> Any:
        struct, (rows, columns), variance = usual(*given)
        struct.start = float(struct.start) - slices * float(struct.thickness)
        struct.slices += 1
        struct.corner = vec2d(*(float(c) - cells for c in struct.corner))
        return struct, (rows + 1, columns + int(sweep.RUN)), variance

    with patch.object(sweep, "place", elsewhere):
        yield


def blocks(values: NDArray) -> NDArray[np.float64]:
    """Sums over blocks of ``BLOCK`` by ``BLOCK`` pixels."""
    height, width = (n - n % BLOCK for n in values.shape)
    return values[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).sum((1, 3), dtype=float)


def largest(found: Sequence[tuple[float, float]], visible: float = VISIBLE) -> float | None:
    """The largest distance without aliasing, of growing distances and their aliasing: between the last that is free of
    it and the first that shows it.
    """
    clean = list(takewhile(lambda one: one[1] <= visible, found))
    if not clean or len(clean) == len(found):
        return clean[-1][0] if clean else None
    (last, low), (first, high) = clean[-1], found[len(clean)]
    return round(float(last * (first / last) ** (np.log(visible / low) / np.log(high / low))), 3)
