"""The best image for what may be read: bricks in the order of what each adds to the bound.

Rays say which brick adds most to the bound of each, by what its range allows and what is in front of it; those that add
most to all rays together are read, and rays asked again. The image is what all that was read allows, with that between
which the rest may be: its middle or, of a pyramid, what the coarsest level shows there, as far as that is between.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..frame import Frame
from ..kernels.bricks.unread import show_unread, weigh_unread
from ..launch import launch_pixels
from .allowance import Allowance
from .blocks import BrickReader
from .brick import shared
from .grid import Index
from .partial import Partial
from .unread import struct_of

if TYPE_CHECKING:
    from .streamed import Streamed

# Rays along an axis that say what is read next, while they find something.
RAYS = 128
# Bricks that are read before rays are asked again: so many, and in parts of those that were.
FEWEST, PART = 4, 1 / 4
# And so many times as many are looked at for what they cost: in blocks, and this for what is done without any.
LOOKED, SHARED = 4, 0.25
# Bytes of a pixel of a brick's image, with those of the copy that kernels read.
PIXEL = 88
# So many pixels of all images can be counted.
MOST = 2**31 - 1


class Limited:
    """Bricks that were read, in any order, and what the others may look like.

    Parameters
    ----------
    room
        Bytes of images of bricks; once those are used up, nothing more is read.
    """

    def __init__(self, march: Streamed, room: int, allowance: Allowance):
        self.march, self.room, self.allowance = march, room, allowance
        self.coarse: NDArray[np.float64] | None = None
        self.partials: dict[Index, Partial] = {}
        self.needs = cache(march.needs)
        shape = tuple(reversed(march.bricks.counts))
        self.numbers = np.full(shape, -1, np.int32)
        for index in march.order:
            self.numbers[index[::-1]] = march.number(index)

    @property
    def full(self) -> bool:
        """Whether there is no room for more."""
        width, height = self.march.caster.size
        pixels = sum(partial.samples.size for partial in self.partials.values())
        return PIXEL * pixels >= self.room or pixels + width * height > MOST

    def cast(self, blocks: BrickReader, index: Index) -> None:
        """Read a brick."""
        march = self.march
        rect = march.caster.footprint(index)
        assert rect is not None
        partial = Partial.nothing(rect, march.caster.bounded)
        if needed := self.needs(index):
            with self.allowance.work("brick"):
                march.cast(blocks, partial, index, rect, needed, until=self.allowance.left)
            march.keep.end_of_frame()
        self.partials[index] = partial

    def next(self, blocks: BrickReader) -> list[Index]:
        """Bricks to be read now, from the camera outwards; none where all that is left fits into what is spared."""
        march = self.march
        width, height = march.caster.size
        steps = sorted({max(1, min(width, height) // RAYS), 1}, reverse=True)
        for step in steps:
            struct = self._struct()
            struct.stride = step
            largest = np.zeros((-(-height // step), -(-width // step)), np.int32)
            widths = np.zeros((*largest.shape, 2))
            with self.allowance.work("ray", largest.size):
                self._launch(weigh_unread, struct, (largest, int), (widths, wp.vec2d))
            asking = (widths[..., 1] > march.spare) & (largest >= 0)
            if asking.any():
                break
        else:
            return []
        added = np.bincount(largest[asking], widths[asking, 0], self.numbers.size)
        count = max(FEWEST, int(PART * len(self.partials)))
        best = np.argsort(-added, kind="stable")[: LOOKED * count]
        worth = {self.index(n): float(added[n]) for n in best if added[n] > 0}
        needs = {index: self.needs(index) for index in worth}
        have = set(blocks.read)
        chosen: set[Index] = set()
        while needs and len(chosen) < count:
            # For what it costs: blocks that are read for others are there.
            index = max(needs, key=lambda one: worth[one] / (len(needs[one] - have) + SHARED))
            chosen.add(index)
            have |= needs.pop(index)
        return [index for index in march.order if index in chosen]

    def index(self, number: int) -> Index:
        """Of a brick, by its number."""
        k, j, i = (int(n) for n in np.unravel_index(number, self.numbers.shape))
        return i, j, k

    def image(self) -> Partial:
        """What all of it comes to."""
        march, caster = self.march, self.march.caster
        result = caster.nothing()
        least, most = np.zeros_like(result.rgbt), np.zeros_like(result.rgbt)
        self._launch(show_unread, self._struct(), (least, wp.vec4d), (most, wp.vec4d))
        least = np.maximum(least, 0.0)
        if caster.scene.lighting is None:
            # Bounds of bricks come to more than there can be.
            top = np.array([*3 * (caster.scene.brightest,), 1.0])
            least, most = np.minimum(least, top), np.minimum(most, top)
        shown = 0.5 * (least + most)
        if (coarse := self.coarse) is not None:
            # Where it says more than nothing.
            open_ = ((most - least).max(axis=-1) > 2 * march.caster.scene.integrator.tolerance)[..., None]  # type: ignore[attr-defined]
            shown = np.where(open_, np.clip(coarse, least, most), shown)
        result.bound = np.maximum(most - shown, shown - least).max(axis=-1)
        result.rgbt[..., :3], result.rgbt[..., 3] = shown[..., :3], 1.0 - shown[..., 3]
        for partial in self.partials.values():
            result.part(partial.rect).samples[...] += partial.samples
        return result

    def stand_in(self, read: bool) -> None:
        """Have the image of the coarsest level of a pyramid, if there is one; of one that was read before unless it may
        be ``read``.
        """
        march = self.march
        scene = march.caster.given
        volume = march.volume.preview if read else vars(march.volume).get("preview")
        if volume is None or scene.segmentation is not None or not (self.numbers >= 0).any():
            return
        caster = march.caster
        scene = replace(scene, volume=volume, like=None)
        image = Frame(scene, caster.camera, caster.size, march.keep, caster.ends)
        self.coarse = image.render().rgba.astype(np.float64)

    def _struct(self) -> Any:
        march, device = self.march, self.march.keep.device
        struct = struct_of(march.caster, self.numbers, march.looks, march.bricks)
        if not self.partials:
            return struct
        read = np.full(self.numbers.shape, -1, np.int32)
        for n, index in enumerate(self.partials):
            read[index[::-1]] = n
        partials = list(self.partials.values())
        rects = [(r.start, c.start, r.stop - r.start, c.stop - c.start) for r, c in (p.rect for p in partials)]
        first = np.cumsum([0, *(p.samples.size for p in partials)])[:-1]
        bounds: list[Any] = [p.bound for p in partials]
        struct.read = wp.array(read, dtype=int, device=device)
        struct.rects = wp.array(np.array(rects, np.int32), dtype=wp.vec4i, device=device)
        struct.first = wp.array(first.astype(np.int32), dtype=int, device=device)
        struct.rgbt = wp.array(np.concatenate([p.rgbt.reshape(-1, 4) for p in partials]), dtype=wp.vec4d, device=device)
        struct.bounds = wp.array(np.concatenate([b.ravel() for b in bounds]), dtype=wp.float64, device=device)
        return struct

    def _launch(self, kernel: wp.Kernel, struct: Any, *outputs: tuple[NDArray, Any]) -> None:
        view, device = self.march.caster.view, self.march.keep.device
        view.height, view.width = outputs[0][0].shape[:2]
        with shared(device, *outputs) as arrays:
            launch_pixels(kernel, [view, struct, *arrays], device, view)
            wp.synchronize_device(device)


def render(march: Streamed, blocks: BrickReader, allowance: Allowance, room: int) -> tuple[Partial, int]:
    """The image of what a budget allows, and how many bricks were rendered."""
    limited = Limited(march, room, allowance)
    pixels = march.caster.size[0] * march.caster.size[1]
    # It is wanted in any case: what it takes is known then.
    limited.stand_in(read=not allowance.ends(0))

    def ends(what: str) -> bool:
        # Rays are asked once more in the end, all of them, from both sides.
        coming = allowance.expected(what) + 2 * allowance.expected("ray", pixels)
        return allowance.ends(blocks.bytes, coming) or limited.full

    done = False
    while not done and not ends("batch"):
        with allowance.work("batch"):
            batch = limited.next(blocks)
        if not batch:
            break
        for index in batch:
            if done := ends("brick"):
                break
            try:
                limited.cast(blocks, index)
            except TimeoutError:
                done = True
                break
    march.rest = [index for index in march.order if index not in limited.partials]
    return limited.image(), len(limited.partials)
