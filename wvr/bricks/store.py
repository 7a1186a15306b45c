"""Bricks of a field, as they are asked for: kept as long as there is room, and read ahead of the one that asks."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cached import cached_property
from ..field.base import Field
from ..keep import Keeper
from .brick import Brick, Caster, Halo, Prepared
from .grid import Bricks, Index

# Bytes beside the samples that a renderer keeps of a brick, for each of them: ranges, kinds, masks, octants.
BESIDE = 0.5


class BrickStore:
    """Bricks of a field of which all samples are at hand.

    Parameters
    ----------
    field
        A volume with ``region(low, high)``, samples between two corners, both included.
    room
        Bytes of the bricks that are kept; None is all.
    """

    def __init__(self, field: Any, bricks: Bricks, halo: Halo, room: int | None):
        self.field, self.bricks, self.halo, self.room = field, bricks, halo, room
        self.version = getattr(field, "version", 0)
        self.seen: set[Index] = set()  # in the last frame
        self._kept: OrderedDict[Index, Brick] = OrderedDict()
        self._made: dict[Index, Prepared] = {}
        self._made_of: tuple[Any, ...] | None = None
        self._new = False
        self._keep: Keeper | None = None

    def serves(self, field: Field, bricks: Bricks, halo: Halo, room: int | None) -> bool:
        """Whether its bricks are those of the field as it is now."""
        same = (self.field, self.bricks, self.halo, self.room) == (field, bricks, halo, room)
        return same and self.version == getattr(field, "version", 0)

    def box(self, index: Index) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and last sample of a brick with its halo."""
        return self.halo.box(self.bricks, index)

    def size(self, index: Index) -> int:
        """Bytes that a brick takes."""
        low, high = self.box(index)
        return int(np.prod(high - low + 1) * (self.field.dtype.itemsize + BESIDE))

    def __getitem__(self, index: Index) -> Brick:
        if index not in self._kept:
            low, high = self.box(index)
            self._kept[index] = Brick(self.field.region(low, high), low, self.field)
        self._kept.move_to_end(index)
        if not self.keeps_all:
            assert self.room is not None
            taken = sum(map(self.size, self._kept))
            while taken > self.room and len(self._kept) > 1:
                taken -= self.size(self._kept.popitem(last=False)[0])
        return self._kept[index]

    def made(self, caster: Caster) -> dict[Index, Prepared]:
        """What was prepared of bricks for the caster's scene, by whatever camera, and will be: their parts stay."""
        scene = caster.scene
        given = tuple(getattr(scene, field.name) for field in fields(scene) if field.name not in ("like", "background"))
        versions = tuple(volume.version for volume in scene.volumes())
        astray = caster.view.astray if scene.clips else 0.0
        given = (*given, versions, astray)
        if self._keep is None or self._keep.device != caster.keep.device:
            self._keep, self._made_of = Keeper(caster.keep.device), None
            self._keep.builds = caster.keep.builds
        if given != self._made_of:
            self._made, self._made_of, self._new = {}, given, True
        caster.keep = self._keep
        return self._made

    def end_of_frame(self) -> None:
        """Let go of what was made for another scene, once there is all that this one has of that."""
        if self._keep is not None and self._new:
            self._keep.end_of_frame()
            self._new = False

    @cached_property
    def keeps_all(self) -> bool:
        """Whether all bricks stay."""
        return self.room is None or sum(map(self.size, self.bricks)) <= self.room
