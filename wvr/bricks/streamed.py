"""An image of a stored volume: its blocks stream by, from the camera outwards, as far as they are seen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..keep import Keeper
from ..launch import in_turn
from ..memory import free_host_memory
from ..notices import announce
from ..samples import times_power
from ..scene import Scene
from . import extremes, limited, rest
from .allowance import Allowance
from .blocks import BrickReader
from .finder import Findings, caster_of
from .grid import Bricks, Index, Rect, in_order
from .partial import Partial
from .pieces import Piece, Pieces
from .reading import Reading
from .stored import StoredVolume
from .unread import Looks, unread_brick, widened

# Of free memory, what samples take where no limit is given.
SHARE = 1 / 4
# Bricks that are looked through for ones to read ahead, from the camera outwards, and in another order.
LOOKED, FEW = 24, 8


class Streamed:
    """What is needed to render a stored volume: which bricks there are, and what they may look like.

    Attributes
    ----------
    bricks
        A brick a block, as of :meth:`Bricks.of_chunks`.
    order
        Those in which there may be something to see, from the camera outwards.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int],
        keep: Keeper,
        reading: Reading,
        ends: NDArray[np.float64] | None = None,
        only: tuple[int, int] | None = None,
    ):
        volume: Any = scene.volume
        self.volume: StoredVolume = volume
        self.keep, self.reading = keep, reading
        blocks = Bricks(tuple((*along[:-1], along[-1] - 1) for along in volume.starts))
        self.towards = blocks.first(volume, camera)
        self.bricks = Bricks.of_chunks(volume.starts, self.towards)
        integrator, self.spare = (
            scene.integrator.sharing(scene) if volume.ranges is not None else (scene.integrator, 0.0)
        )
        scene = replace(scene, integrator=integrator)
        self.caster = caster_of(scene, camera, size, self.bricks, keep, ends, only=only)
        self.looks, visible = self._looks()
        self.order = [index for index in in_order(self.bricks, volume, camera) if visible[index[::-1]]]
        self.unneeded: set[Index] = set()  # of those, whose pieces with something to see no ray meets
        self.rest: list[Index] = []  # for which there was no time
        self.missing = 0
        self.said: set[str] = set()

    def _looks(self) -> tuple[Looks, NDArray[np.bool_]]:
        """Of all bricks, in order (z, y, x), and in which of them there may be something to see."""
        scene, volume = self.caster.scene, self.volume
        shape = tuple(reversed(self.bricks.counts))
        self.pieces = None
        # What there is at most in pieces, where largest or smallest values are looked for.
        self.tops = np.full((2, 2, 2, *shape), self._top(np.array(volume.range)))
        if volume.ranges is None:
            ranges = np.broadcast_to(np.array(volume.range), (*shape, 2))
            visible = np.ones(shape, bool)
            pieces = np.ones((2, 2, 2, *shape), bool)
        else:
            lit = any(self.caster.halo.samples)
            ranges, known = volume.ranges.around() if lit else volume.ranges.of_pieces(self.towards)
            ranges = times_power(ranges, volume.exponent)
            some = ranges[..., 0] <= ranges[..., 1]
            pieces = some | ~known
            here = some & known
            seen = widened(self.caster, ranges[here])
            own = scene.integrator.sees(scene, seen)
            pieces[here] = Looks.of(scene, seen).most > 0 if own is None else own
            if scene.integrator.seeks:
                self.tops = np.where(known, np.where(some, self._top(ranges), -np.inf), self.tops)
            every = (0, 1, 2) if not lit else ()
            low = np.where(known, ranges[..., 0], -np.inf).min(axis=every)
            high = np.where(known, ranges[..., 1], np.inf).max(axis=every)
            ranges = np.stack([low, high], axis=-1)
            certain = (low <= high) & np.isfinite(low) & np.isfinite(high)
            ranges = np.where(certain[..., None], ranges, volume.range)
            visible = np.asarray(pieces.any(axis=every))
        self.limits = ranges
        if not any(self.caster.halo.samples):
            self.pieces = Pieces(self.caster, pieces, self.towards)
        return Looks.of(scene, widened(self.caster, ranges.reshape(-1, 2))), visible

    def _top(self, ranges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of ranges, the largest, or minus the smallest."""
        return -ranges[..., 0] if self.caster.scene.integrator.seeks < 0 else ranges[..., 1]

    def number(self, index: Index) -> int:
        """Of a brick among the looks."""
        return int(np.ravel_multi_index(index[::-1], tuple(reversed(self.bricks.counts))))

    def render(self) -> tuple[Partial, dict[str, Any]]:
        """The image, and how it came about."""
        start, allowance = perf_counter(), Allowance(self.reading)
        reading = self.reading
        if reading.client:
            from .cluster import render

            image, stats = render(self, reading.client)
            return image, {"seconds": perf_counter() - start} | stats
        room = int(free_host_memory() * SHARE) if reading.memory is None else reading.memory
        if reading.budgeted:
            # Half for images of bricks.
            room //= 2
        integrator = self.caster.scene.integrator
        seeks, partly = integrator.seeks, reading.budgeted or reading.missing == "bound"
        blocks = self.blocks(room, again=reading.budgeted or bool(seeks))
        self.spared = 0
        try:
            if seeks:
                image, cast = extremes.render(self, blocks, allowance)
            elif integrator.probes and partly:
                image, cast = rest.render(self, blocks, allowance)
            elif reading.budgeted:
                image, cast = limited.render(self, blocks, allowance, room)
            else:
                image, cast = self._outwards(blocks)
        finally:
            blocks.close()
        total = int(np.prod(self.bricks.counts))
        stats = {
            "seconds": perf_counter() - start,
            "seconds_waiting": blocks.waited,
            "bricks": total,
            "bricks_visible": len(self.order),
            "bricks_rendered": cast,
            "bricks_spared": self.spared,
            "bricks_unread": len(self.rest),
            "bricks_missing": self.missing,
            "blocks_read": len(blocks.read),
            "blocks_read_again": blocks.again,
            "bytes_read": blocks.bytes,
            "share_read": len(blocks.read) / total,
        }
        return image, stats

    def _outwards(self, blocks: BrickReader) -> tuple[Partial, int]:
        """The image, and how many bricks were rendered, from the camera outwards."""
        caster = self.caster
        image = caster.nothing()
        spent = np.zeros(image.through.shape)
        cast = 0
        for n, index in enumerate(in_turn(self.order)):
            rect = self.wanted(image, index)
            if rect is None:
                continue
            # What is read ahead is needed.
            needed = None if index in blocks.coming else self.needed(image, index, rect)
            if needed is not None and not needed:
                # Rays that ended before it are at an end for good.
                caster.end(image, rect)
                continue
            if (left := self._left_out(image, spent, index, rect)) is not None:
                image.over(left)
                self.spared += 1
                continue
            self.ahead(blocks, image, self.order[n : n + LOOKED], needed)
            self.cast(blocks, image, index, rect, needed)
            cast += 1
            self.keep.end_of_frame()
        return image, cast

    def through(
        self, blocks: BrickReader, image: Any, order: list[Index], allowance: Allowance, ends: Callable[[], bool]
    ) -> Iterator[tuple[Index, bool | None]]:
        """Look into bricks in an order, as long as the allowance does not end: each, and whether it could be read, None
        where no ray needs it. Where bytes are counted none is read ahead, so that what is read is of no timing.
        """
        for n, index in enumerate(order):
            rect = self.wanted(image, index)
            needed = None if rect is None else self.needed(image, index, rect)
            read = None
            if rect is not None and needed != set():
                if ends():
                    return
                try:
                    with allowance.work("brick"):
                        if allowance.bytes is None:
                            self.ahead(blocks, image, order[n : n + FEW], needed)
                        read = self.cast(blocks, image, index, rect, needed, until=allowance.left)
                except TimeoutError:
                    return
                self.keep.end_of_frame()
            yield index, read

    def blocks(self, room: int, again: bool = False) -> BrickReader:
        """Those of its bricks, in so many bytes; ``again``, if they are not asked for from the camera outwards."""
        return BrickReader(self.volume, self.bricks, self.caster.halo, self.towards, room, again)

    def wanted(self, image: Partial, index: Index, end: bool = True) -> Rect | None:
        """The pixels that a brick is rendered in; None where there are none, as their rays may have ended."""
        rect = self.caster.footprint(index)
        if rect is not None and self.caster.ended(image, rect):
            if end:
                self.caster.end(image, rect)
            return None
        return rect

    def needed(
        self, image: Partial, index: Index, rect: Rect, front: NDArray[np.float64] | None = None
    ) -> set[Index] | None:
        """The blocks that are needed of a brick, an empty set where no ray meets what there is to see; None is all."""
        if self.pieces is None:
            return None
        if index in self.unneeded:
            return set()
        blocks = self.pieces.needed(index, rect, self._going(image, rect, front))
        if not blocks:
            self.unneeded.add(index)
        return blocks

    def _going(
        self, image: Partial, rect: Rect, front: NDArray[np.float64] | None
    ) -> Callable[[Piece], NDArray[np.bool_]]:
        """Which rays go on into a piece."""
        if isinstance(image, Findings) and self.caster.scene.integrator.seeks:
            values = image.part(rect).values
            return lambda piece: values < self.tops[piece]
        through = image.part(rect).through
        going = (through if front is None else through * front[image.at(rect)]) >= self.caster.ending
        return lambda piece: going

    def needs(self, index: Index) -> set[Index]:
        """The blocks that are needed of a brick, whatever is in front of it."""
        rect = self.caster.footprint(index)
        if rect is None:
            return set()
        needed = self.needed(Partial.nothing(rect, False), index, rect)
        return set(product(*self.volume.spans(*self.caster.halo.box(self.bricks, index)))) if needed is None else needed

    def ahead(self, blocks: BrickReader, image: Partial, order: list[Index], needed: set[Index] | None) -> None:
        """Have the first brick read, and the next ones meanwhile."""
        for index in blocks.coming:
            if self.wanted(image, index, end=False) is None:
                blocks.drop(index)
        if order[0] not in blocks.coming:
            blocks.come(order[0], needed)
        for index in order[1:]:
            if blocks.full:
                break
            rect = None if index in blocks.coming else self.wanted(image, index, end=False)
            if rect is not None and (these := self.needed(image, index, rect)) != set():
                blocks.come(index, these)

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
        self,
        blocks: BrickReader,
        image: Partial,
        index: Index,
        rect: Rect,
        needed: set[Index] | None,
        front: NDArray[np.float64] | None = None,
        until: float | None = None,
    ) -> bool:
        """Compose the image of a brick into that of what is in front of it, as of ``Caster.cast``; False where it could
        not be read.

        Parameters
        ----------
        until
            Seconds after which it is no longer waited for.

        Raises
        ------
        TimeoutError
            Then.
        """
        try:
            self.caster.cast(index, blocks.take(index, needed, until), image, rect, front)
        except OSError as error:
            if self.reading.missing == "error" or isinstance(error, TimeoutError):
                raise
            # A block may be of several bricks.
            if (said := str(error).partition("; missing=")[0]) not in self.said:
                announce("%s", said)
                self.said.add(said)
            self.missing += 1
            if not isinstance(image, Findings):
                image.over(unread_brick(self.caster, index, rect, self.looks[[self.number(index)]]))
            return False
        return True
