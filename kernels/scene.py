"""What a ray-casting kernel is specialised for, and the struct of all that it reads."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from .field import make_field
from .precision import REALS
from .ray import View
from .table import make_table
from .transfer import make_transfer


@dataclass(frozen=True)
class Variant:
    """What a kernel is specialised for."""

    dtype: type  # of the stored samples
    precision: str  # "float32" or "float64", of everything along a ray but the sums
    rule: str  # how a ray is integrated, a key of ``raycast.MARCHES``
    finite: bool  # no sample is NaN or infinite


@wp.struct
class Steps:
    """Lengths in units of the smallest voxel spacing; a rule reads those it knows."""

    step: wp.float64
    shortest: wp.float64
    longest: wp.float64
    tolerance: wp.float64
    opaque: wp.float64  # a ray ends when its opacity exceeds this


@cache
def make_scene(variant):
    """The struct with all that a kernel of ``variant`` reads."""
    real = REALS[variant.precision]
    Field, _ = make_field(variant.dtype, real)
    Transfer, _, _ = make_transfer(real)
    Table, _ = make_table(real)
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2

    @wp.struct
    class PointScene:
        view: View
        steps: Steps
        field: Field
        transfer: Transfer

    @wp.struct
    class TableScene:
        view: View
        steps: Steps
        field: Field
        transfer: Transfer
        table: Table
        nodes: wp.array(dtype=vec2)

    return TableScene if variant.rule == "preintegrated" else PointScene
