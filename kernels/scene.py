"""What a kernel is made of, and the struct of all that it reads: put together from the halves that it is given.

A half is what an object that a user holds (a field, cuts, light, an integrator) brings to the device: an object with a
struct and with functions. It is hashable, and equal halves make the same kernel; a kernel contains nothing else.
"""

import dataclasses
from functools import cache
from typing import Any

import warp as wp

from .bricks.brick import Brick
from .cuts.stretches import Cuts
from .field.blocks import Blocks
from .integrators.steps import Trace
from .light.points import Lights, Lit
from .ray import View
from .transfer.function import make_transfer
from .transfer.lookup import make_table


@dataclasses.dataclass(frozen=True)
class Halves:
    """What a kernel is specialised for.

    ``march`` is the half of an integrator: ``Struct(halves)``; ``tabled``, whether segments are looked up in a table;
    ``bounded``, whether there is a bound; ``anchored``, whether segments count from where a ray enters the volume, so
    that of a brick they are those of ``scene.brick``; and ``march(halves)`` -> a function ``march(scene, origin,
    direction, start, stop)`` -> (composite, count, bound): premultiplied colour and opacity of the stretch of a ray
    from ``start`` to ``stop``, how much it cost, and a bound on the error of any channel, 0 where the method gives
    none. The ray is at ``origin + t direction`` in index coordinates, all in float64, lengths in units of the smallest
    voxel spacing.
    """

    real: type  # of everything along a ray but the sums: float32 or float64
    field: Any
    march: Any
    cuts: Cuts = dataclasses.field(default_factory=Cuts)
    light: Lit | None = None
    vectors: bool = False  # there are vectors to compute with, as clang has them
    again: bool = False  # of rays that a launch before left to this one
    traced: bool = False  # the steps of a ray are written down, by a march that has them
    brick: bool = False  # of a part of a grid, as of ``bricks``

    @property
    def rays(self) -> int:
        """Rays of a work item: several of a march that takes them at a time, where a ray knows only its own light."""
        apart = self.cuts.labels is not None or (self.cuts.clipped and self.light is not None)
        return 1 if apart or not self.vectors else getattr(self.march, "rays", 1)

    @property
    def leaves(self) -> bool:
        """Whether rays may be left to another launch, of these halves ``again``: with an infinite bound."""
        return not self.again and getattr(self.march, "leaves", lambda halves: False)(self)

    @property
    def launches(self) -> tuple["Halves", ...]:
        """Of the launches of an image, one after the other."""
        return (self, dataclasses.replace(self, again=True)) if self.leaves else (self,)

    @property
    def scratch(self) -> int:
        """Bytes of memory that a thread has for itself, where its march asks for some."""
        return getattr(self.march, "scratch", 0) if self.vectors else 0

    @property
    def Scene(self) -> Any:
        """The struct that functions take as ``scene``: the same where halves differ in other things.

        Functions take structs by value, so it has nothing that is not used.
        """
        return _make_scene(
            self.real,
            self.field,
            self.march.Struct(self),
            self.march.tabled,
            self.cuts.Struct(self.real) if self.cuts.used else None,
            self.light is not None,
            self.traced,
            self.brick,
        )


@cache
def _make_scene(real, field, March, tabled, CutsStruct, lit, traced, brick):
    members = {
        "view": View,
        "field": field.Struct,
        "blocks": Blocks,
        "transfer": make_transfer(real)[0],
        "march": March,
        "opaque": wp.float64,  # a ray ends when its opacity exceeds this
        "whole": wp.float64,  # length of the ray, where it is marched in stretches, of which
        "stretch": int,  # so many came before
    }
    if not field.finite:
        members["proven"] = wp.vec3i  # of each axis, whether rays computed to be in faces across it are there
    if tabled:
        members["table"] = make_table(real)[0]
    if CutsStruct is not None:
        members["cuts"] = CutsStruct
    if lit:
        members["light"] = Lights
    if traced:
        members["trace"] = Trace
    if brick:
        members["brick"] = Brick
    return wp.struct(type("Scene", (), {"__annotations__": members, "__module__": __name__}))
