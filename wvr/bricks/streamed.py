"""An image of a stored volume: its blocks stream by, from the camera outwards, as far as they are seen."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..keep import Keeper
from ..memory import free_host_memory
from ..notices import announce
from ..scene import Scene
from .blocks import Blocks
from .brick import Caster
from .grid import Bricks, Index, Rect, in_order
from .partial import Partial
from .reading import Reading
from .stored import StoredVolume
from .unread import Looks, unread, unread_brick, widened

# Of free memory, what samples take where no limit is given.
SHARE = 1 / 4
# Bricks that are looked through for ones to read ahead.
LOOKED = 24


class Streamed:
    """What is needed to render a stored volume: which bricks there are, and what they may look like.

    Attributes
    ----------
    bricks
        A brick a block, as of :meth:`Bricks.of_chunks`.
    order
        Those in which there may be something to see, from the camera outwards.
    """

    def __init__(self, scene: Scene, camera: Camera, size: tuple[int, int], keep: Keeper, reading: Reading):
        volume: Any = scene.volume
        self.volume: StoredVolume = volume
        self.keep, self.reading = keep, reading
        blocks = Bricks(tuple((*along[:-1], along[-1] - 1) for along in volume.starts))
        self.towards = blocks.first(volume, camera)
        self.bricks = Bricks.of_chunks(volume.starts, self.towards)
        integrator, self.spare = (
            scene.integrator.sharing(scene) if volume.ranges is not None else (scene.integrator, 0.0)
        )
        self.caster = Caster(replace(scene, integrator=integrator), camera, size, self.bricks, keep)
        self.looks, visible = self._looks()
        self.order = [index for index in in_order(self.bricks, volume, camera) if visible[index[::-1]]]
        self.rest: list[Index] = []  # for which there was no time
        self.missing = 0

    def _looks(self) -> tuple[Looks, NDArray[np.bool_]]:
        """Of all bricks, in order (z, y, x), and in which of them there may be something to see."""
        scene, volume = self.caster.scene, self.volume
        shape = tuple(reversed(self.bricks.counts))
        if volume.ranges is None:
            ranges = np.broadcast_to(np.array(volume.range), (*shape, 2))
            visible = np.ones(shape, bool)
        else:
            lit = any(self.caster.halo.samples)
            ranges, known = volume.ranges.around() if lit else volume.ranges.of_bricks(self.towards)
            ranges = np.ldexp(ranges, volume.exponent)
            some = ranges[..., 0] <= ranges[..., 1]
            ranges = np.where((known & some)[..., None], ranges, volume.range)
            visible = some | ~known
            visible &= (Looks.of(scene, ranges.reshape(-1, 2)).most > 0).reshape(shape) | ~known
        return Looks.of(scene, widened(self.caster, ranges.reshape(-1, 2))), visible

    def number(self, index: Index) -> int:
        """Of a brick among the looks."""
        return int(np.ravel_multi_index(index[::-1], tuple(reversed(self.bricks.counts))))

    def render(self) -> tuple[Partial, dict[str, Any]]:
        """The image, and how it came about."""
        start = perf_counter()
        reading, caster = self.reading, self.caster
        if reading.client is not None:
            from .cluster import render

            image, stats = render(self, reading.client)
            return image, {"seconds": perf_counter() - start} | stats
        blocks = self.blocks(int(free_host_memory() * SHARE) if reading.memory is None else reading.memory)
        image = caster.nothing()
        spent = np.zeros(image.through.shape)
        cast = spared = 0
        try:
            for n, index in enumerate(self.order):
                late = reading.seconds is not None and perf_counter() - start >= reading.seconds
                if late or (reading.bytes is not None and blocks.bytes >= reading.bytes):
                    self.rest = self.order[n:]
                    break
                rect = self.wanted(image, index)
                if rect is None:
                    continue
                if (left := self._left_out(image, spent, index, rect)) is not None:
                    image.over(left)
                    spared += 1
                    continue
                self._ahead(blocks, image, n)
                self.cast(blocks, image, index, rect)
                cast += 1
                self.keep.end_of_frame()
        finally:
            blocks.close()
        if self.rest:
            image.over(self._unread())
        total = int(np.prod(self.bricks.counts))
        stats = {
            "seconds": perf_counter() - start,
            "seconds_waiting": blocks.waited,
            "bricks": total,
            "bricks_visible": len(self.order),
            "bricks_rendered": cast,
            "bricks_spared": spared,
            "bricks_unread": len(self.rest),
            "bricks_missing": self.missing,
            "blocks_read": len(blocks.read),
            "blocks_read_again": blocks.again,
            "bytes_read": blocks.bytes,
            "share_read": len(blocks.read) / total,
        }
        return image, stats

    def blocks(self, room: int) -> Blocks:
        """Those of its bricks, in so many bytes."""
        return Blocks(self.volume, self.bricks, self.caster.halo, self.towards, room)

    def wanted(self, image: Partial, index: Index, end: bool = True) -> Rect | None:
        """The pixels that a brick is rendered in; None where there are none, as their rays may have ended."""
        rect = self.caster.footprint(index)
        if rect is not None and self.caster.ended(image, rect):
            if end:
                self.caster.end(image, rect)
            return None
        return rect

    def _ahead(self, blocks: Blocks, image: Partial, n: int) -> None:
        """Have the next bricks read meanwhile."""
        ahead = [index for index in self.order[n + 1 : n + LOOKED] if self.wanted(image, index, end=False)]
        blocks.drop({self.order[n], *ahead})
        for index in (self.order[n], *ahead):
            if not blocks.come(index):
                break

    def _left_out(self, image: Partial, spent: NDArray[np.float64], index: Index, rect: Rect) -> Partial | None:
        """The image of a brick that need not be read, as all that it may look like fits into what is spared for
        that.
        """
        if not self.spare:
            return None
        looks = self.looks[[self.number(index)]]
        low, high = self.bricks.box(index)
        through = float(image.through[rect].max())
        # Somewhere about the middle of it a ray is about so long in it.
        long = float((high - low).min())
        if through * float(np.exp(-looks.least[0] * long) - np.exp(-looks.most[0] * long)) > 2 * self.spare:
            return None
        partial = unread_brick(self.caster, index, rect, looks)
        assert partial.bound is not None
        after = spent[rect] + image.through[rect] * partial.bound
        if after.max() > self.spare:
            return None
        spent[rect] = after
        return partial

    def cast(
        self, blocks: Blocks, image: Partial, index: Index, rect: Rect, front: NDArray[np.float64] | None = None
    ) -> None:
        """Compose the image of a brick into that of what is in front of it, as of ``Caster.cast``."""
        try:
            self.caster.cast(index, blocks[index], image, rect, front)
        except OSError as error:
            if self.reading.missing == "error":
                raise
            announce("%s", error)
            self.missing += 1
            image.over(unread_brick(self.caster, index, rect, self.looks[[self.number(index)]]))

    def _unread(self) -> Partial:
        """What the bricks look like that are not read for want of time, with nothing behind."""
        shape = tuple(reversed(self.bricks.counts))
        numbers = np.full(shape, -1, np.int32)
        for index in self.rest:
            numbers[index[::-1]] = self.number(index)
        whole = self.caster.nothing().rect
        return unread(self.caster, whole, numbers, self.looks, self.bricks)
