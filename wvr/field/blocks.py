"""What blocks of cells hold, and which of them there is something to see in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..kernels.field.blocks import BITS, EMPTY, FAR, SEVERAL, Blocks, blocks, make_kinds, make_ranges
from ..kernels.field.strides import make_octants
from ..launch import launch
from ..transfer.function import struct_of
from .base import Field
from .samples import Data, samples_struct


class Seen(NamedTuple):
    """Which blocks and cells there may be something to see in."""

    kinds: wp.array
    masks: wp.array
    skipped: float  # share of blocks with nothing
    low: NDArray[np.float64]  # box of the others, in index coordinates; a point if there are none
    high: NDArray[np.float64]
    held: wp.array | None = None  # where there are labels, the states of blocks

    @property
    def struct(self) -> Any:
        """That of ``kernels.field.blocks``."""
        result = Blocks()
        result.kinds, result.masks = self.kinds, self.masks
        return result


@dataclass(frozen=True)
class Ranges(Part):
    """Smallest and largest sample of each block of cells, in the samples' own dtype."""

    data: Data
    name: ClassVar[str] = "ranges"

    def build(self, keep: Keeper) -> wp.array:
        data = keep(self.data)
        result = keep.empty(blocks(data.shape), wp.types.vector(2, data.dtype))
        launch(make_ranges(data.dtype), rows_of(result), [samples_struct(data), result], keep.device)
        return result


@dataclass(frozen=True)
class Kinds(Part):
    """``Seen`` of a field by one transfer function, in float64; masks only where cells are asked for. Rays in
    ``strides`` go by ``Octants`` on a processor, and ask for no distances of empty blocks there.
    """

    field: Field
    ranges: Ranges
    function: Part
    shift: float
    cells: bool
    strides: bool = False
    name: ClassVar[str] = "kinds"

    def build(self, keep: Keeper) -> Seen:
        ranges = keep(self.ranges)
        transfer = struct_of(keep(self.function))
        data = keep(self.ranges.data)
        field = samples_struct(data, self.shift)
        kinds = keep.empty(ranges.shape, wp.int16)
        masks = keep.empty(ranges.shape if self.cells else (1, 1, 1), wp.uint64)
        struct = Blocks()
        struct.kinds, struct.masks = kinds, masks
        launch(make_kinds(data.dtype), rows_of(kinds), [field, ranges, transfer, self.cells, struct], keep.device)
        found = kinds.numpy()
        if not (self.strides and keep.device.is_cpu):
            kinds.assign(found := spread(found))
        return seen_of(self.field, kinds, masks, found)


@dataclass(frozen=True)
class Everything(Part):
    """``Seen`` of a field of which nothing is skipped."""

    field: Field
    name: ClassVar[str] = "everything"

    def build(self, keep: Keeper) -> Seen:
        shape = blocks(tuple(max(n, 2) for n in self.field.shape))
        kinds, masks = keep.empty(shape, wp.int16), keep.empty(shape, wp.uint64)
        kinds.fill_(int(SEVERAL))
        masks.fill_(2**64 - 1)
        return Seen(kinds, masks, 0.0, *self.field.index_box)


@dataclass(frozen=True)
class Octants(Part):
    """How far there is nothing to see, by the way that a ray goes: ``kernels.field.strides``."""

    kinds: Part
    name: ClassVar[str] = "octants"

    def build(self, keep: Keeper) -> wp.array:
        seen = keep(self.kinds)
        masks = seen.masks
        if masks.shape != seen.kinds.shape:
            # Where cells are not told apart, all of a block or none.
            shown = seen.kinds.numpy() > int(EMPTY)
            masks = wp.array(np.where(shown, np.uint64(2**64 - 1), np.uint64(0)), dtype=wp.uint64, device=keep.device)
        result = keep.empty((8, *masks.shape), wp.uint8)
        launch(make_octants, 8, [masks, result], keep.device)
        return result


def rows_of(blocks: wp.array) -> int:
    """Rows of blocks along x, which kernels over them have for items."""
    return blocks.shape[0] * blocks.shape[1]


def spread(kinds: NDArray[np.int16]) -> NDArray[np.int16]:
    """Kinds in which empty blocks know how far the others are, in Chebyshev's distance, up to ``FAR``."""
    empty = kinds <= int(EMPTY)
    found = np.where(empty, np.int16(EMPTY), kinds)
    # 64 blocks along x a word; beyond the grid nothing is seen.
    columns = kinds.shape[2]
    padded = np.pad(empty, ((0, 0), (0, 0), (0, -columns % 64)), constant_values=True)
    words = np.packbits(padded, axis=2, bitorder="little").view(np.uint64)
    one, most = np.uint64(1), np.uint64(63)
    # Those so far from all others are what is left when the outermost are taken away so many times.
    for _ in range(int(FAR)):
        left, right = np.full_like(words, one), np.full_like(words, one << most)
        left[..., 1:] = words[..., :-1] >> most
        right[..., :-1] = words[..., 1:] << most
        words = words & (words << one | left) & (words >> one | right)
        for axis in range(2):
            before = np.moveaxis(words, axis, 0)
            words = words.copy()
            inner = np.moveaxis(words, axis, 0)
            inner[1:] &= before[:-1]
            inner[:-1] &= before[1:]
        if not words.any():
            break
        found -= np.unpackbits(words.view(np.uint8), axis=2, count=columns, bitorder="little")
    return found


def seen_of(field: Field, kinds: wp.array, masks: wp.array, found: NDArray[np.int16]) -> Seen:
    """``Seen`` of kinds, which the host has ``found``, and masks."""
    seen = found > int(EMPTY)
    low, high = field.index_box
    if not seen.any():
        return Seen(kinds, masks, 1.0, low, low)
    size = 1 << int(BITS)
    for axis in range(3):
        if field.dimensions[axis] > 1:
            at = np.flatnonzero(seen.any(axis=tuple(a for a in range(3) if a != 2 - axis))) * size
            low[axis] = at[0]
            high[axis] = min(high[axis], at[-1] + size)
    return Seen(kinds, masks, 1.0 - float(seen.mean()), low, high)
