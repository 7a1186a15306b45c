"""Blocks and cells whose samples are on both sides of a level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import warp as wp

from ..keep import Keeper, Part
from ..kernels.field.blocks import Blocks
from ..kernels.field.levels import make_level_kinds
from ..launch import launch
from .base import Field
from .blocks import Ranges, Seen, rows_of, seen_of, spread
from .samples import samples_struct


@dataclass(frozen=True)
class LevelKinds(Part):
    """``Seen`` of a field in which levels are looked for, with a ``margin`` for rounding."""

    field: Field
    ranges: Ranges
    levels: tuple[float, ...]
    margin: float
    name: ClassVar[str] = "kinds"

    def build(self, keep: Keeper) -> Seen:
        ranges, data = keep(self.ranges), keep(self.ranges.data)
        kinds, masks = keep.empty(ranges.shape, wp.int16), keep.empty(ranges.shape, wp.uint64)
        struct = Blocks()
        struct.kinds, struct.masks = kinds, masks
        levels = wp.array(self.levels, dtype=wp.float64, device=keep.device)
        inputs = [samples_struct(data), ranges, levels, self.margin, struct]
        launch(make_level_kinds(data.dtype), rows_of(kinds), inputs, keep.device)
        found = spread(kinds.numpy())
        kinds.assign(found)
        return seen_of(self.field, kinds, masks, found)
