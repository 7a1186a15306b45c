"""Bricks of a stored volume, put together of blocks that are read ahead of where they are rendered.

A brick is its block and the last layers of those before it, as seen from the camera. Whoever goes from the camera
outwards reads each block once: of those that were read the outermost layers stay for a few waves. Blocks of one value
are not read at all.
"""

from __future__ import annotations

from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeoutError
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cancel import Cancelled, waited
from ..memory import give_back
from ..samples import times_power
from .brick import Brick, Halo
from .grid import Bricks, Index
from .ranges import ALL, FIRST, LAST
from .store import BESIDE
from .stored import StoredVolume

# Waves that layers of a block are kept for: those of bricks behind it across a corner.
WAVES = 3
# Bricks that are read ahead.
AHEAD = 2
# Bytes that are read until what is free is given back.
FREED = 1 << 26


class BrickReader:
    """Bricks of a stored volume, with what was read of it.

    Parameters
    ----------
    volume
        Where samples are read.
    room
        Bytes of samples and of what is made of them.
    again
        Blocks may be asked for again at any time: those that were read last are kept.
    """

    def __init__(self, volume: StoredVolume, bricks: Bricks, halo: Halo, first: Index, room: int, again: bool = False):
        self.volume, self.bricks, self.halo, self.first = volume, bricks, halo, first
        self.keeps = again or any(halo.samples)
        self.layered = again and not any(halo.samples)
        self.read: set[Index] = set()
        self.again = 0  # blocks that were read once more
        self.bytes = 0  # of samples that were read
        self.waited = 0.0  # seconds
        self._late = False
        self._full: OrderedDict[Index, NDArray] = OrderedDict()
        self._layers: OrderedDict[Index, dict[tuple[int, int], NDArray]] = OrderedDict()
        self._thin_bytes = 0  # of layers that are left of blocks that there was no room for
        self._coming: dict[Index, Future[Brick]] = {}
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="wvr-read")
        longest = [int(np.diff(along).max()) + 1 + 2 * n for along, n in zip(bricks.edges, halo.samples, strict=True)]
        largest = int(np.prod(longest) * (volume.dtype.itemsize + BESIDE))
        # Each brick is there as blocks and put together, the one that is rendered besides what is made of it.
        self.ahead = int(np.clip(room // largest - 2, 0, AHEAD))
        # Without a halo each block is read once, and only its layers are looked at again.
        self.room = max(room - (self.ahead + 1) * largest, 0) if self.keeps else 0
        if room < 2 * largest:
            raise MemoryError(
                f"memory_limit of {room / 2**20:.0f} MiB is too little for {volume.samples.name}: one brick with the "
                f"blocks that it is made of takes {2 * largest / 2**20:.0f} MiB"
            )

    @property
    def coming(self) -> list[Index]:
        """Bricks that are read ahead."""
        return list(self._coming)

    @property
    def full(self) -> bool:
        """Whether no more are read ahead."""
        return len(self._coming) >= self.ahead

    def come(self, index: Index, needed: set[Index] | None) -> None:
        """Have a brick read ahead, of the blocks that are needed of it; None is all."""
        self._coming[index] = self._pool.submit(self._brick, index, needed)

    def drop(self, index: Index) -> None:
        """Forget what was read ahead and is no longer wanted."""
        self._coming.pop(index).cancel()

    def take(self, index: Index, needed: set[Index] | None = None, until: float | None = None) -> Brick:
        """A brick, as of ``come``.

        Raises
        ------
        OSError
            Where a block cannot be read.
        TimeoutError
            Where it is not there after so many seconds.
        Cancelled
            Where nobody waits for it any more.
        """
        start = perf_counter()
        if index not in self._coming:
            self.come(index, needed)
        try:
            return waited(self._coming.pop(index), until)
        except FutureTimeoutError:
            self._late = True
            raise TimeoutError(f"{self.volume.samples.name} is not read in time") from None
        except (Cancelled, KeyboardInterrupt):
            self._late = True
            raise
        finally:
            self.waited += perf_counter() - start

    def close(self) -> None:
        """Read nothing more; what nobody waits for ends by itself."""
        self._pool.shutdown(wait=not self._late, cancel_futures=True)

    def _brick(self, index: Index, needed: set[Index] | None) -> Brick:
        """In the one thread that reads. Samples of blocks that are not needed are anything with nothing to see."""
        low, high = self.halo.box(self.bricks, index)
        samples = np.empty(tuple((high - low + 1)[::-1]), self.volume.dtype)
        # Its own first, the largest part.
        found: list[Any] = sorted(product(*self.volume.spans(low, high)), key=lambda block: block != index)
        for block in found:
            begin, end = self.volume.block(block)
            begin, end = np.maximum(begin, low), np.minimum(end, high)
            part = tuple(slice(a, b + 1) for a, b in zip((begin - low)[::-1], (end - low)[::-1], strict=True))
            if needed is None or block in needed:
                samples[part] = self._part(block, begin, end)
            else:
                self._fill(samples[part], block, begin, end, (low, high))
        self._trim(index)
        return Brick(samples, low, self.volume)

    def _part(self, block: Index, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Any:
        """Samples of a block from ``begin`` to ``end``; one number where all are equal."""
        low, high = self.volume.block(block)
        if block not in self._full:
            thin = self._thin(block, begin, end)
            ranges = self.volume.ranges
            if ranges is not None and ranges.known[block[::-1]] and not ranges.holes[block[::-1]]:
                least, most = ranges.values[_layer(block, thin)]
                if least == most:
                    return self._sample(least)
            for axis, side in thin:
                layer = self._layers.get(block, {}).get((axis, side))
                if layer is not None:
                    start = low.copy()
                    start[axis] = begin[axis]
                    return layer[_slices(begin - start, end - start)]
            self._read(block, low, high)
        self._full.move_to_end(block)
        return self._full[block][_slices(begin - low, end - low)]

    def _fill(self, part: NDArray, block: Index, begin: NDArray, end: NDArray, box: tuple[NDArray, NDArray]) -> None:
        """What is not needed: of each piece of the brick a sample as there are some, those of more blocks last."""
        first, last = self.volume.block(block)
        spans = []
        for axis, (a, b) in enumerate(zip(begin.tolist(), end.tolist(), strict=True)):
            spans.append([(a, b)])
            if a == first[axis] and box[0][axis] < a:
                spans[axis].append((a, a))
            if b == last[axis] and b < box[1][axis]:
                spans[axis].append((b, b))
        for chosen in product(*spans):
            low, high = np.array(chosen).T
            part[_slices(low - begin, high - begin)] = self._unseen(block, low, high)

    def _unseen(self, block: Index, begin: NDArray[np.int64], end: NDArray[np.int64]) -> Any:
        """A sample as there are some in a part of a block, so that where nothing is seen of those it is not of this."""
        ranges = self.volume.ranges
        if ranges is None or not ranges.known[block[::-1]]:
            return 0  # which no ray meets
        low, high = ranges.values[_layer(block, self._thin(block, begin, end))]
        return np.nan if low > high else self._sample(low)

    def _thin(self, block: Index, begin: NDArray[np.int64], end: NDArray[np.int64]) -> list[tuple[int, int]]:
        """Axes along which a part of a block is a layer of one sample, and which."""
        low, high = self.volume.block(block)
        sides = ((axis, side, at[axis]) for axis in range(3) for side, at in ((FIRST, low), (LAST, high)))
        return [(axis, side) for axis, side, at in sides if begin[axis] == end[axis] == at]

    def _sample(self, limit: Any) -> Any:
        return times_power(np.array(limit), self.volume.exponent)[()] if self.volume.exponent else limit

    def _read(self, block: Index, low: NDArray[np.int64], high: NDArray[np.int64]) -> None:
        samples = self.volume.region(low, high)
        self.again += block in self.read
        self.read.add(block)
        if self.bytes // FREED != (self.bytes + samples.nbytes) // FREED:
            give_back()
        self.bytes += samples.nbytes
        # One that is read for its layers alone, too, has to find room.
        self._make_room(samples.nbytes)
        self._full[block] = samples
        if self.layered:
            self._thin_bytes -= _size(self._layers.pop(block, {}))
        elif not self.keeps:
            # On the sides away from the camera.
            sides = product(range(3), (FIRST, LAST))
            away = [(a, side) for a, side in sides if (block[a] - self.first[a]) * (1 if side == LAST else -1) >= 0]
            self._layers[block] = _outermost(samples, away)

    def _trim(self, index: Index) -> None:
        """Let go of blocks that there is no room for, and of layers that no brick to come needs."""
        self._make_room(0)
        wave = self._distance(index)
        if not self.keeps:
            for block in [block for block in self._layers if self._distance(block) < wave - WAVES]:
                del self._layers[block]

    def _make_room(self, more: int) -> None:
        """Of blocks that were not asked for longest the layers are left, which others need: in half of the room."""
        taken = more + self._thin_bytes + sum(samples.nbytes for samples in self._full.values())
        while self._full and taken > self.room:
            block, samples = self._full.popitem(last=False)
            taken -= samples.nbytes
            if self.layered:
                self._layers[block] = _outermost(samples, list(product(range(3), (FIRST, LAST))))
                self._thin_bytes += (size := _size(self._layers[block]))
                taken += size
        while self._thin_bytes > self.room // 2:
            self._thin_bytes -= _size(self._layers.popitem(last=False)[1])

    def _distance(self, index: Index) -> int:
        return sum(abs(i - j) for i, j in zip(index, self.first, strict=True))


def _outermost(samples: NDArray, sides: list[tuple[int, int]]) -> dict[tuple[int, int], NDArray]:
    """Layers of a block along some of its axes, first or last."""
    return {(axis, side): np.take(samples, [0 if side == FIRST else -1], axis=2 - axis) for axis, side in sides}


def _size(layers: dict[tuple[int, int], NDArray]) -> int:
    return sum(layer.nbytes for layer in layers.values())


def _layer(block: Index, thin: list[tuple[int, int]]) -> tuple[int, ...]:
    """Where the range of a layer of a block is among those of all."""
    sides = [ALL, ALL, ALL]
    for axis, side in thin:
        sides[axis] = side
    return (*block[::-1], *sides[::-1])


def _slices(begin: NDArray[np.int64], end: NDArray[np.int64]) -> tuple[slice, ...]:
    return tuple(slice(a, b + 1) for a, b in zip(begin[::-1].tolist(), end[::-1].tolist(), strict=True))
