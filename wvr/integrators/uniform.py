"""Integrators with steps of one length. Lengths are in units of the smallest voxel spacing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from ..keep import Keeper, Part
from ..kernels.integrators.uniform import Half
from ..transfer.lookup import Lookup
from ..transfer.nodes import nodes_array
from ..transfer_function import TransferFunction
from ..validation import choice, define, integer, positive
from .base import Integrator

if TYPE_CHECKING:
    from ..scene import Scene


class Uniform(Integrator):
    """What they have in common."""

    clips: ClassVar[tuple[str, ...]] = ("naive",)
    splits: ClassVar[bool] = True
    step: float

    @property
    def shortest(self) -> float:
        return self.step

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        return {"step": self.shortest}


@dataclass(frozen=True)
class Riemann(Uniform):
    """Sums of point samples a fixed step apart, with an exact last partial step and exact opacity of each segment.

    Parameters
    ----------
    step
        Length of a segment [smallest voxel spacing], > 0.
    rule
        Where a segment is sampled: ``"midpoint"`` (order 2), ``"left"`` (order 1) or ``"trapezoid"`` (order 2: the
        mean extinction and emission of both ends).

    Notes
    -----
    Post-classified: between two samples the transfer function is not seen, so features of it that are thinner than
    ``step`` times the field's slope are missed.
    """

    step: float
    rule: Literal["midpoint", "left", "trapezoid"] = "midpoint"

    def __post_init__(self) -> None:
        define(self, step=positive(self.step, "step"))
        choice(self.rule, "rule", ("midpoint", "left", "trapezoid"))

    @property
    def order(self) -> float:
        return 1 if self.rule == "left" else 2

    def half(self, scene: Scene) -> Half:
        return Half(self.rule)


@dataclass(frozen=True)
class Simpson(Uniform):
    """Simpson's rule in segments of a fixed step, with an exact last partial step and exact opacity of each segment.

    With extinction ``tau`` and colour ``c`` at the front, middle and back of a segment of length h, its optical depth
    is ``D = h (tau_f + 4 tau_m + tau_b) / 6`` and its colour the opacity ``1 - exp(-D)`` times the mean of c_f, c_m and
    c_b weighted by ``tau_f``, ``4 tau_m exp(-D/2)`` and ``tau_b exp(-D)``. These weights' sum is Simpson's rule for the
    opacity itself; dividing by it makes colour exact where it is constant, never brighter than the brightest of the
    three, and of order 4 although half the depth is but a first guess of that to the middle.

    Parameters
    ----------
    step
        Length of a segment [smallest voxel spacing], > 0.

    Notes
    -----
    Order 4 where field and transfer function are smooth. Across a kink, of the field at a cell face or of the
    transfer function at a control point, order 2; across a jump of the transfer function order 1.
    """

    step: float

    def __post_init__(self) -> None:
        define(self, step=positive(self.step, "step"))

    @property
    def order(self) -> float:
        return 4

    def half(self, scene: Scene) -> Half:
        return Half("simpson")


# Entries of a table along an axis: a gigabyte in single precision.
LARGEST_TABLE = 8192


@dataclass(frozen=True)
class Preintegrated(Uniform):
    """Segments looked up in a 2D table by the scalars at their ends, linear in between.

    Lum, Wilson and Ma, "High-Quality Lighting and Efficient Pre-Integration for Volume Rendering" (2004).

    Parameters
    ----------
    step
        Length of a segment at ``oversampling=1`` [smallest voxel spacing], > 0. The last, shorter one is exact.
    oversampling
        Segments per ``step``, >= 1: Roettger et al. (2003) need four a voxel.
    table_size
        Entries along an axis of the table, >= 2. None, the default: two or more a grey level, 257 at least, for integer
        samples of up to 256 levels; one a level for up to 512; else 512, or up to 1024 that have jumps of the transfer
        function at entries, one exactly, two where half an entry is between them, and more as nearly as can be.
    generator
        ``"incremental"`` (exact, O(n^2)), ``"brute"`` (the same table, O(n^3)) or ``"approximate"`` (attenuation inside
        a segment left out: order 1).

    Notes
    -----
    No feature of the transfer function is missed, however thin. What remains is the field's own curvature along a
    segment (order 2) and the bilinear look-up between table entries, whatever the step: where a field stays at the
    value of a jump, that has to be an entry.
    """

    step: float = 1.0
    oversampling: int = 1
    table_size: int | None = None
    generator: Literal["incremental", "brute", "approximate"] = "incremental"
    segments: ClassVar[bool] = True
    clips: ClassVar[tuple[str, ...]] = ("naive", "parts")

    def __post_init__(self) -> None:
        define(self, step=positive(self.step, "step"))
        define(self, oversampling=integer(self.oversampling, "oversampling", 1))
        if self.table_size is not None:
            define(self, table_size=integer(self.table_size, "table_size", 2, LARGEST_TABLE))
        choice(self.generator, "generator", ("incremental", "brute", "approximate"))

    @property
    def order(self) -> float:
        return 1 if self.generator == "approximate" else 2

    @property
    def unlit(self) -> str | None:
        if self.generator != "approximate":
            return None
        return (
            'lighting weighs where in a segment it is lit, which generator="approximate" leaves out; '
            'take "incremental" or "brute"'
        )

    @property
    def shortest(self) -> float:
        return self.step / self.oversampling

    def half(self, scene: Scene) -> Half:
        return Half("preintegrated")

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        return {"step": self.shortest, "nodes": nodes_array(self.precision(scene), keep.device)}

    def table(self, scene: Scene, tf: TransferFunction) -> Part:
        n, domain = scene.table_shape(tf) if self.table_size is None else (self.table_size, scene.scalars)
        precision, lit = self.precision(scene), scene.lighting is not None
        return Lookup(tf, scene.unit, self.shortest, n, domain, self.generator, scene.shift, precision, lit)
