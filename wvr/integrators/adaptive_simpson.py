"""Adaptive Simpson integration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from ..keep import Keeper
from ..kernels.integrators.adaptive_simpson import Half
from ..validation import below_one, choice, define, positive
from .base import Integrator

if TYPE_CHECKING:
    from ..frame import Frame
    from ..scene import Scene


@dataclass(frozen=True)
class AdaptiveSimpson(Integrator):
    """Steps whose length follows an error estimate, by Simpson's rule for optical depth and for colour and opacity.

    Algorithms 2 and 3 of Campagnolo, Celes and de Figueiredo, "Accurate Volume Rendering based on Adaptive Numerical
    Integration" (2015).

    Parameters
    ----------
    tolerance
        Error that the estimates may have in any channel, in (0, 1). It is an estimate, not a bound: forced steps and
        what lies between the samples are not covered.
    h0
        Length of the first step [smallest voxel spacing], from ``hmin`` to ``hmax``.
    hmin
        A step of this length is forced: taken whatever its estimate, > 0. Only the end of an interval makes a shorter.
    hmax
        No step is longer: what may be stepped over in a volume that looks empty or smooth.
    coupling
        The inner integral finds an interval in which optical depth is within tolerance, which the outer integral then
        covers: ``"coupled"`` begins it with a step as long as the interval, ``"decoupled"`` carries on with its own.
    scope
        What the tolerance belongs to. ``"step"``: one of length ``h0``, others in proportion to their length, so that a
        ray of length l may err by ``tolerance * l / h0``. ``"ray"``: the whole ray, of which a step has its share by
        length. The paper leaves it open; its numbers are those of ``"ray"``.

    Notes
    -----
    A step has five samples, so features of the transfer function or the field that are thinner than ``hmax / 4`` may be
    missed. ``image.samples`` counts field evaluations, ``image.trace(x, y)`` gives the steps of a ray.
    """

    tolerance: float
    h0: float = 0.5
    hmin: float = 0.1
    hmax: float = 2.0
    coupling: Literal["coupled", "decoupled"] = "coupled"
    scope: Literal["step", "ray"] = "step"
    traces: ClassVar[bool] = True
    splits: ClassVar[bool] = True

    def __post_init__(self) -> None:
        define(self, tolerance=below_one(self.tolerance, "tolerance"))
        for name in ("h0", "hmin", "hmax"):
            define(self, **{name: positive(getattr(self, name), name)})
        if self.hmin > self.hmax:
            raise ValueError(f"hmin must be at most hmax = {self.hmax!r}, got {self.hmin!r}")
        if not self.hmin <= self.h0 <= self.hmax:
            raise ValueError(f"h0 must be from hmin = {self.hmin!r} to hmax = {self.hmax!r}, got {self.h0!r}")
        choice(self.coupling, "coupling", ("coupled", "decoupled"))
        choice(self.scope, "scope", ("step", "ray"))

    @property
    def order(self) -> float:
        return 4

    @property
    def shortest(self) -> float:
        return self.hmin

    def half(self, scene: Scene) -> Half:
        return Half(self.coupling == "coupled")

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        scope = self.h0 if self.scope == "step" else 0.0
        lengths = {"step": self.h0, "shortest": self.hmin, "longest": self.hmax}
        return lengths | {"tolerance": self.tolerance, "scope": scope}

    def report(self, frame: Frame) -> dict[str, Any]:
        whole = "a ray" if self.scope == "ray" else f"a step of {self.h0:g} voxel spacings"
        covers = (
            f"the error estimates of {whole}, shared out by length; not forced steps, nor what lies between samples"
        )
        return {"tolerance_covers": covers}
