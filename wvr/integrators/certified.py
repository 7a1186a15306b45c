"""Certified integration, and how it spends its tolerance: the one place where shares of it are set.

Rounding comes first: of cuts at control points, of sums, of times along a ray and of the image. What it leaves is
shared out between what may lie behind the end of a ray (a quarter), the pieces of a ray in parts of the opacity that
they add, which sums to one (a quarter for the series, a quarter for lines drawn too far), and the simpler transfer
function (a quarter: colour, extinction in parts of itself, extinction times length). A cell in single precision has
three eighths in parts of its opacity and an eighth in parts of its length in place of both quarters of pieces, and what
the simpler transfer function leaves of its own, three quarters of that in parts of its opacity.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from math import inf, isinf
from typing import TYPE_CHECKING, Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..field.blocks import Octants
from ..keep import Keeper
from ..kernels.field.cell import DENORMAL
from ..kernels.integrators.certified import Half
from ..kernels.integrators.pieces import ACCURACY, NODES, VALUE
from ..kernels.integrators.series import TRUNCATED
from ..transfer.function import transfer_values
from ..transfer.nodes import nodes_array
from ..transfer.rows import FittedRows
from ..transfer.simplify import SimplifiedTransfer
from ..transfer_function import TransferFunction
from ..validation import at_most, below_one, define
from .base import Integrator

if TYPE_CHECKING:
    from ..frame import Frame
    from ..scene import Scene

# Unit roundoff of float64.
U = 2.0**-53
# What pieces are off by, in parts of what they add and of the brightest colour: opacity as a polynomial, also in what
# it is multiplied with; quadrature, of scalars whose colours may be twice the brightest apart; products of a few
# rounded numbers and exponentials (docs/proof.md, lemma 8).
PIECES = 4 * TRUNCATED + 2 * ACCURACY + 64 * U
# What the sums are off by for each of a ray's cells and pieces, in parts of the brightest colour (lemma 9).
SUM = 6 * U
# Cells and pieces that a tolerance allows for, for each sample along the volume's axes; a ray counts what it has.
COUNTED = 16
# How far a ray may be from where it should be that a tolerance allows for [index coordinates]; an image counts what it
# has.
ASTRAY = 2.0**-36
# Rounding of sums in single precision (docs/proof-single.md, S11), in the same parts, and the share of a tolerance that
# it may be.
SINGLE = 128 * 2.0**-24
LITTLE = 1 / 8
# Bounds are rounded up to float32 numbers.
UP = 2.0**-22
# Range of samples, in parts of that of control points, from which rounding is counted cell by cell.
OUTLYING = 16
# Samples along an axis that places of cells in single precision count.
MOST = 2**20


@dataclass(frozen=True)
class Budget:
    """What a tolerance is spent on, for colours up to ``brightest`` along rays up to ``longest`` unit lengths."""

    rounding: float
    least: float  # of that, what no scene is without
    rest: float
    brightest: float
    longest: float
    blur: float  # rounding of a scalar along a ray
    densest: float  # largest extinction of a unit of length
    slopes: float  # what a unit of the scalar changes along a ray, where that is counted for the whole ray
    sharp: bool  # rounding of the scalar counts piece by piece, else in ``rounding``
    single: bool  # cells are measured in single precision
    ticks: bool  # and when a ray enters them is counted in ticks
    opacity: float  # of ``rounding``, what a brick's rays count in parts of their opacity there,
    length: float  # and for each unit of their length

    @property
    def behind(self) -> float:
        """Transparency at which a ray ends."""
        return self.rest / 4 / self.brightest

    @property
    def piece(self) -> float:
        """Of a piece's series, and of its line drawn too far, in parts of the opacity that it adds."""
        return self.rest / 4

    @property
    def cell(self) -> float:
        """Of a cell in single precision, in parts of the opacity that it adds: in place of both shares of ``piece``."""
        return 3 * self.rest / 8

    @property
    def along(self) -> float:
        """And of its length."""
        return self.rest / 8 / self.longest

    @property
    def color(self) -> float:
        """Deviation of a simpler transfer function's colour."""
        return self.rest / 12

    @property
    def relative(self) -> float:
        """Of its extinction, in parts of itself."""
        return self.rest / 12 / self.brightest

    @property
    def absolute(self) -> float:
        """Of its extinction per unit length, elsewhere."""
        return self.rest / 12 / (self.brightest * self.longest)


_budgets: WeakKeyDictionary[Scene, Budget] = WeakKeyDictionary()


@dataclass(frozen=True)
class Certified(Integrator):
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
    ``image.error_bound`` is the bound that each ray came to: what was left out behind the end of the ray, the simpler
    transfer function, the series, and rounding. It is at most the tolerance but for rays along which the scalar is that
    of a jump, or in a face of the volume, the surface of a clip or a boundary of labels, so that rounding alone says on
    which side they are; ``image.stats["rays_over_tolerance"]`` counts them. Sums are float64 whatever the image's
    precision. Of float32 images most cells are computed in single precision on a CPU, where a bound that counts all
    rounding allows it; float64 images have none of that; ``image.stats["walk"]`` says which it was. ``image.samples``
    counts cells and pieces of cells. ``termination``, where it is given, ends rays at that transparency instead, and
    the bound says what that costs. A tolerance of less than 2.2 times what rounding comes to in any scene is refused,
    for a float32 or a float64 image; with ``precision="auto"`` the image is float64 where rounding to float32 would
    take more than an eighth of the tolerance.
    """

    tolerance: float
    anywhere: ClassVar[bool] = True
    cells: ClassVar[bool] = True
    splits: ClassVar[bool] = True
    asks: ClassVar[tuple[str, ...]] = ("centered", "extent")

    def __post_init__(self) -> None:
        define(self, tolerance=below_one(self.tolerance, "tolerance"))

    @property
    def order(self) -> float:
        return float("inf")

    def shown(self, scene: Scene) -> str:
        if scene.precision != "auto":
            return scene.precision
        # A tolerance of which rounding to float32 would take more than an eighth.
        return "float64" if self.tolerance < 4 * float(np.finfo("float32").eps) * scene.brightest else "float32"

    def precision(self, scene: Scene) -> str:
        return "float64"

    def budget(self, scene: Scene) -> Budget:
        """What is spent on what; counted once a scene, and for all its bricks."""
        key = scene.like or scene
        if key not in _budgets:
            _budgets[key] = self._budget(scene)
        return _budgets[key]

    def _budget(self, scene: Scene) -> Budget:
        brightest, longest = scene.brightest, scene.volume.longest
        entire = scene.volume.entire
        sums = SUM * COUNTED * sum(entire.shape)
        least = brightest * (PIECES + sums + float(np.finfo(self.shown(scene)).eps) / 2)
        blurred = blur(scene)
        densest = max(float(transfer_values(tf, scene.unit)[:, 3].max()) for tf in scene.functions)
        # What rounding of the scalar comes to along any ray: little, unless slopes are steep or there are jumps.
        slopes = max(_steepest(tf, scene.unit, brightest * longest) for tf in scene.functions)
        # Where intervals meet, the line of either may be taken.
        gentle = inf if isinf(slopes) else 2 * (blurred + 3 * ASTRAY * np.ptp(scene.volume.range)) * slopes
        gentle += VALUE * brightest * densest * longest
        sharp = bool(gentle >= self.tolerance / 32)
        single = self._single(scene)
        # What times in ticks come to (docs/proof-single.md, S12).
        ticked = 36 * max(entire.shape) ** 2 * longest * 2.0**-52 * densest * brightest
        if not sharp and scene.volume.half.finite:
            gently = 2 * max(entire.shape) ** 2 * longest * 2.0**-52 * self.tolerance
            ticked = min(ticked, gently * (1 + longest * densest))
        ticks = single and ticked <= LITTLE * self.tolerance
        gentle, slopes = (0.0, 0.0) if sharp else (gentle, slopes)
        # Bricks count what is partly for the opacity and partly for the length of a ray once for each.
        again = gentle if entire is not scene.volume else 0.0
        rounding = least + gentle + again + single * SINGLE * brightest + ticks * ticked
        rest = self.tolerance * (1 - UP) - rounding
        opacity = brightest * (PIECES + single * SINGLE) + gentle
        length = (brightest * sums + gentle + ticks * ticked) / longest
        parts = {"sharp": sharp, "single": single, "ticks": ticks, "opacity": opacity, "length": length}
        return Budget(rounding, least, rest, brightest, longest, blurred, densest, slopes, **parts)

    def _single(self, scene: Scene) -> bool:
        """Whether most cells may be computed in single precision."""
        plain = scene.segmentation is None and hasattr(scene.volume.half, "cubics")
        plain = plain and (scene.lighting is None or scene.lighting.in_lanes(scene))
        little = SINGLE * scene.brightest <= LITTLE * self.tolerance and self.shown(scene) == "float32"
        return plain and little and max(scene.volume.entire.shape) <= MOST

    def half(self, scene: Scene) -> Half:
        budget = self.budget(scene)
        return Half(budget.sharp, budget.single, budget.ticks)

    def strides(self, scene: Scene) -> bool:
        budget = self.budget(scene)
        return budget.single and budget.ticks

    def function(self, scene: Scene, tf: TransferFunction) -> SimplifiedTransfer:
        shares = self.budget(scene)
        deviations = (shares.color, shares.relative, shares.absolute)
        return SimplifiedTransfer(tf, scene.unit, scene.shift, scene.material, *deviations)

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        shares = self.budget(scene)
        points = [keep(self.function(scene, tf))[0] for tf in scene.functions]
        absolute = max(one.absolute for one in points)
        tinted = max(one.color + shares.brightest * one.relative for one in points)
        # What a simpler transfer function leaves of its quarter.
        left = max(shares.rest / 4 - tinted - shares.brightest * absolute * shares.longest, 0.0)
        numbers = {
            "tolerance": shares.piece,
            "brightest": shares.brightest,
            "tinted": tinted,
            "veiled": shares.rounding + shares.brightest * absolute * shares.longest,
            "sum": SUM * shares.brightest,
            "densest": shares.densest,
            "astray": 3 * float(np.ptp(scene.volume.range)) * (1.0 if shares.sharp else 2 * shares.slopes),
            "allowed": ASTRAY,
            "ulps": wp.vec2d(*_ulps(scene)),
            "blur": shares.blur,
            "local": bool(np.ptp(scene.volume.range) > OUTLYING * max(np.ptp(tf.knots) for tf in scene.functions)),
            "nodes": nodes_array("float64", keep.device, NODES),
            "cell": shares.cell + 3 * left / 4,
            "along": shares.along + left / 4 / shares.longest,
        }
        if shares.single:
            low, high = np.array(scene.volume.range) - scene.shift
            rows = FittedRows(self.function(scene, scene.functions[0]), float(low), float(high))
            numbers["rows"] = keep(rows)
            if keep.device.is_cpu:
                numbers["octants"] = keep(Octants(scene.kinds()))
        return numbers

    def spent(self, scene: Scene, keep: Keeper) -> dict[str, float]:
        shares = self.budget(scene)
        absolute = max(keep(self.function(scene, tf))[0].absolute for tf in scene.functions)
        astray = 0.0 if shares.sharp else 6 * float(np.ptp(scene.volume.range)) * shares.slopes
        return {"opacity": shares.opacity, "length": shares.length + shares.brightest * absolute, "astray": astray}

    def sharing(self, scene: Scene) -> tuple[Integrator, float]:
        half = self.tolerance / 2
        return (self, 0.0) if half < 8 * self.budget(scene).least else (Certified(half), half)

    def termination(self, scene: Scene) -> float:
        return self.budget(scene).behind

    def check(self, scene: Scene) -> None:
        least = 2.2 * self.budget(scene).least
        if self.tolerance < least:
            farther = (
                "" if self.shown(scene) == "float64" else ' for a float32 image; precision="float64" reaches farther'
            )
            bright = f" for colours up to {scene.brightest:.3g}" if scene.brightest > 1 else ""
            raise ValueError(
                f"tolerance must be at least {at_most(least)}{bright}{farther}, or rounding exceeds it; "
                f"got {self.tolerance!r}"
            )

    def report(self, frame: Frame) -> dict[str, Any]:
        extras = [name for name in ("lighting", "shadows") if getattr(frame.scene, name) is not None]
        covered = f"opacity and the unlit integral, not the {' and '.join(extras)}" if extras else "all channels"
        assert frame.error_bound is not None
        budget, over = self.budget(frame.scene), frame.rays.over
        if over and frame.scene.termination is None and not frame.partly:
            warnings.warn(
                f"{over} of {frame.error_bound.size} rays are bounded by more than the tolerance {self.tolerance:g}, "
                f"at most by {at_most(frame.rays.bound)}: along jumps or very steep slopes of the "
                "transfer function, and faces of the box, absent cells, clips and labels, rounding alone may do that; "
                "image.error_bound says where",
                RuntimeWarning,
                stacklevel=6,
            )
        return {
            "bound_covers": f"{covered}: where rays ended, a simpler transfer function, series and rounding",
            "rays_over_tolerance": over,
            "walk": "float32" if budget.single and (frame.keep.device.is_cpu or budget.ticks) else "float64",
        }


def blur(scene: Scene) -> float:
    """Rounding of a scalar along a ray in float64: of interpolating samples less the shift, and of places in a grid."""
    low, high = np.array(scene.volume.range) - scene.shift
    return float(_ulps(scene) @ [max(abs(low), abs(high)), high - low]) + float(DENORMAL)


def _ulps(scene: Scene) -> NDArray[np.float64]:
    """The same in parts of the largest sample and of the range."""
    return 2.0**-52 * np.array([8.0, 6.0 * max(scene.volume.entire.shape)])


def _steepest(tf: TransferFunction, unit: float, length: float) -> float:
    """What a unit of the scalar changes along a ray of a ``length``, at most; infinite where there is a jump."""
    values = transfer_values(tf, unit)
    change = np.abs(np.diff(values, axis=0))
    seen = (values[1:, 3] > 0) | (values[:-1, 3] > 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slopes = np.nan_to_num(change / np.diff(tf.knots)[:, None], nan=0.0, posinf=np.inf)[seen]
    most = slopes.max(axis=0, initial=0.0)
    with np.errstate(over="ignore"):
        return float(length * most[3] + most[:3].max())
