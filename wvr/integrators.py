"""The integrators: how a ray's integral is approximated. Lengths are in units of the smallest voxel spacing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from .validation import choice, positive


class Integrator(Protocol):
    """What the renderer asks of an integrator."""

    @property
    def rule(self) -> str:
        """Key of ``kernels.raycast.MARCHES``."""

    @property
    def steps(self) -> dict[str, float]:
        """Fields of ``kernels.scene.Steps``."""

    @property
    def order(self) -> float:
        """Order of convergence in the step on smooth integrands."""


@dataclass(frozen=True)
class Riemann:
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
    rule: str = "midpoint"

    def __post_init__(self) -> None:
        positive(self.step, "step")
        choice(self.rule, "rule", ("midpoint", "left", "trapezoid"))

    @property
    def steps(self) -> dict[str, float]:
        return {"step": self.step}

    @property
    def order(self) -> int:
        return 1 if self.rule == "left" else 2


@dataclass(frozen=True)
class Simpson:
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
    rule: ClassVar[str] = "simpson"

    def __post_init__(self) -> None:
        positive(self.step, "step")

    @property
    def steps(self) -> dict[str, float]:
        return {"step": self.step}

    @property
    def order(self) -> int:
        return 4


@dataclass(frozen=True)
class Exact:
    """Ground truth: cell by cell, exact but for float64 rounding and Gauss-Legendre quadrature to about 1e-12.

    Inside a cell the scalar along a ray is a cubic; it is cut where it crosses control points of the transfer
    function. On each piece extinction is a cubic too and the optical depth a quartic in closed form, and
    ``int c tau exp(-D) = c_0 (1 - exp(-D)) + c' int (s - s_0) tau exp(-D)``, c' the slope of colour over the scalar,
    leaves one integral to quadrature. Cells whose eight samples see only a transparent part of the transfer function
    are skipped.

    Notes
    -----
    Always in float64, whatever ``precision`` is asked for, and so is the image. ``image.samples`` counts the pieces
    that were integrated. Rays do not end early unless ``termination`` says so.
    """

    rule: ClassVar[str] = "exact"
    termination: ClassVar[float] = 0.0

    @property
    def steps(self) -> dict[str, float]:
        return {}

    @property
    def order(self) -> float:
        return float("inf")


@dataclass(frozen=True)
class Preintegrated:
    """Segments looked up in a 2D table by the scalars at their ends, linear in between.

    Lum, Wilson and Ma, "High-Quality Lighting and Efficient Pre-Integration for Volume Rendering" (2004).

    Parameters
    ----------
    step
        Length of a segment at ``oversampling=1`` [smallest voxel spacing], > 0. The last, shorter one is exact.
    oversampling
        Segments per ``step``, >= 1: Roettger et al. (2003) need four a voxel.
    table_size
        Entries along an axis of the table, >= 2. None, the default: two a grey level for integer samples of up to 256
        levels, one for up to 512, else 512.
    generator
        ``"incremental"`` (exact, O(n^2)), ``"brute"`` (the same table, O(n^3)) or ``"approximate"`` (attenuation inside
        a segment left out: order 1).

    Notes
    -----
    No feature of the transfer function is missed, however thin. What remains is the field's own curvature along a
    segment (order 2) and the bilinear look-up between table entries.
    """

    step: float = 1.0
    oversampling: int = 1
    table_size: int | None = None
    generator: str = "incremental"
    rule: ClassVar[str] = "preintegrated"

    def __post_init__(self) -> None:
        positive(self.step, "step")
        if self.oversampling != int(self.oversampling) or self.oversampling < 1:
            raise ValueError(f"oversampling must be an integer >= 1, got {self.oversampling!r}")
        if self.table_size is not None and (self.table_size != int(self.table_size) or self.table_size < 2):
            raise ValueError(f"table_size must be an integer >= 2 or None, got {self.table_size!r}")
        choice(self.generator, "generator", ("incremental", "brute", "approximate"))

    @property
    def steps(self) -> dict[str, float]:
        return {"step": self.step / self.oversampling}

    @property
    def order(self) -> int:
        return 1 if self.generator == "approximate" else 2


@dataclass(frozen=True)
class AdaptivePreintegrated:
    """Pre-integrated segments as long as the field is straight enough where the transfer function sees it.

    The adaptive pre-integration of Roettger et al., "Smart Hardware-Accelerated Volume Rendering" (2003): each block of
    8 cells along each axis has its longest step, from bounds on the field's second differences and on the transfer
    function's slopes over the block's range. Blocks without any extinction are leapt over.

    Parameters
    ----------
    tolerance
        Error of optical depth or colour that a step may have because the scalar is not linear along it, in (0, 1),
        weighted by the transparency in front of it. A bound for each step that is not forced; the errors of a ray's
        steps mostly cancel, at worst they add up.
    hmin
        A step of this length is forced: taken whatever its error [smallest voxel spacing], > 0.

    Notes
    -----
    Colours are taken to be at most 1. ``image.samples`` counts segments, ``image.trace(x, y)`` gives those of a ray.
    Unless ``termination`` says otherwise, rays end when a transparency of 1/256 is left, as in the paper, or of
    ``tolerance`` where that is less.
    """

    tolerance: float
    hmin: float = 0.125
    rule: ClassVar[str] = "adaptive-preintegrated"

    def __post_init__(self) -> None:
        if positive(self.tolerance, "tolerance") >= 1:
            raise ValueError(f"tolerance must be below 1, got {self.tolerance!r}")
        positive(self.hmin, "hmin")

    @property
    def steps(self) -> dict[str, float]:
        return {"shortest": self.hmin, "tolerance": self.tolerance}

    @property
    def termination(self) -> float:
        return min(1 / 256, self.tolerance)

    @property
    def order(self) -> int:
        return 2


@dataclass(frozen=True)
class AdaptiveSimpson:
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
    coupling: str = "coupled"
    scope: str = "step"

    def __post_init__(self) -> None:
        if positive(self.tolerance, "tolerance") >= 1:
            raise ValueError(f"tolerance must be below 1, got {self.tolerance!r}")
        for name in ("h0", "hmin", "hmax"):
            positive(getattr(self, name), name)
        if self.hmin > self.hmax:
            raise ValueError(f"hmin must be at most hmax = {self.hmax!r}, got {self.hmin!r}")
        if not self.hmin <= self.h0 <= self.hmax:
            raise ValueError(f"h0 must be from hmin = {self.hmin!r} to hmax = {self.hmax!r}, got {self.h0!r}")
        choice(self.coupling, "coupling", ("coupled", "decoupled"))
        choice(self.scope, "scope", ("step", "ray"))

    @property
    def rule(self) -> str:
        return f"adaptive-{self.coupling}"

    @property
    def steps(self) -> dict[str, float]:
        scope = self.h0 if self.scope == "step" else 0.0
        return {
            "step": self.h0,
            "shortest": self.hmin,
            "longest": self.hmax,
            "tolerance": self.tolerance,
            "scope": scope,
        }

    @property
    def order(self) -> int:
        return 4


@dataclass(frozen=True)
class Certified:
    """Every channel of every pixel within a tolerance of the true integral, with a bound for each pixel.

    Cell by cell; in a cell the scalar along the ray is a cubic, cut where it reaches control points of the transfer
    function. On each piece the optical depth is exact, and colour to a series whose error is bounded; where that bound
    is too large, the piece is integrated by quadrature as ``Exact`` does. A ray ends when what may lie behind fits into
    what is left of the tolerance. Beforehand the transfer function loses control points that matter less than the
    tolerance. What has no extinction is not visited, cell by cell.

    Parameters
    ----------
    tolerance
        Largest absolute error of any channel, in (0, 1).

    Notes
    -----
    ``image.error_bound`` is the bound that each ray came to, at most the tolerance: what was left out behind the end of
    the ray, the simpler transfer function, the series, and rounding. Sums are float64 whatever the image's precision.
    ``image.samples`` counts cells and pieces of cells. ``termination``, where it is given, ends rays at that
    transparency instead, and the bound says what that costs.
    """

    tolerance: float
    rule: ClassVar[str] = "certified"

    def __post_init__(self) -> None:
        if positive(self.tolerance, "tolerance") >= 1:
            raise ValueError(f"tolerance must be below 1, got {self.tolerance!r}")

    @property
    def steps(self) -> dict[str, float]:
        return {}

    @property
    def order(self) -> float:
        return float("inf")
