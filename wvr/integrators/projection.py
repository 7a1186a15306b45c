"""Exact projections: the largest, smallest or mean value along each ray, or the line integral."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np
import warp as wp

from ..field.blocks import Everything, Ranges
from ..field.peaks import Peaks
from ..field.tops import Tops
from ..keep import Keeper, Part
from ..kernels.field.cell import UNDERFLOW
from ..kernels.integrators import extremes, totals
from ..transfer.function import Transfer
from ..transfer_function import TransferFunction
from ..validation import choice
from .base import Integrator

if TYPE_CHECKING:
    from ..field.base import Field
    from ..frame import Frame
    from ..scene import Scene

# Of the colours' range, up to what the largest values are as good as none for who frames them.
DARK = 0.25
# Size of a sample of which cubics and sums are finite.
LARGEST = 1e200
What = Literal["max", "min", "mean", "sum"]
# As others call them.
WORDS = {"average": "mean", "additive": "sum", "integral": "sum"}


@dataclass(frozen=True)
class Projection(Integrator):
    """The field itself along each ray, exactly: a maximum or minimum intensity projection, a mean, a line integral.

    In a cell the trilinear field along a ray is a cubic. ``"max"`` and ``"min"`` are the largest of its values at the
    ends and where it turns, over all cells; ``"sum"`` is its integral in closed form [scalar x world length], of which
    a digitally reconstructed radiograph is one; ``"mean"`` is that over the length of the ray in the volume.

    ``image.values`` has the values, float64, NaN where a ray misses the volume or all that clips, labels and absent
    samples leave; ``image.error_bound`` is a bound on *their* error, by rounding alone (docs/projections.md), infinite
    where rounding decides whether a ray meets anything. ``image.rgba`` is the transfer function's colour of the value,
    opaque; opacities do not matter. ``image.depth()`` says where the value is taken: of equal ones the nearest,
    of ones that only rounding tells apart either.

    Parameters
    ----------
    what
        ``"max"``, ``"min"``, ``"mean"`` or ``"sum"``.

    Notes
    -----
    Rays leap over blocks of 4 to 64 cells that cannot exceed what was found before, and begin where the pixel beside
    has its value, or in the most promising block; on a CPU over cells, too, of which a byte each says how much there is
    at most. ``image.samples`` counts the cells that were solved. With a
    segmentation, ``"max"`` and ``"min"`` are over all labels that have a transfer function, in the colours of the
    label's; ``"mean"`` and ``"sum"`` over the same, in the colours of the transfer function that is given besides.
    """

    what: What = "max"
    anywhere: ClassVar[bool] = True
    probes: ClassVar[bool] = True
    valued: ClassVar[bool] = True
    surfaces: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if isinstance(self.what, str) and self.what in WORDS:
            raise ValueError(f"what must be {WORDS[self.what]!r} for the {self.what}, got {self.what!r}")
        choice(self.what, "what", get_args(What))

    @property
    def order(self) -> float:
        return float("inf")

    @property
    def unlit(self) -> str:
        return "a projection is of values, which light does not change"

    @property
    def seeks(self) -> int:  # type: ignore[override]
        return {"max": 1, "min": -1}.get(self.what, 0)

    @property
    def asks(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("cubic", "seek", "climb") if self.seeks else ("cubic",)

    def half(self, scene: Scene) -> Any:
        return extremes.Half(self.seeks) if self.seeks else totals.Half()

    def precision(self, scene: Scene) -> str:
        return "float64"

    def termination(self, scene: Scene) -> float:
        return 0.0

    def domain(self, volume: Field) -> tuple[float, float]:
        if self.what != "sum":
            return volume.range
        # Of rays along the axes of the grid, which are what there is; a box of corners would be far larger.
        low, high = volume.range
        if not hasattr(volume, "host"):
            longest = volume.longest * volume.smallest_spacing
            return min(low, 0.0) * longest, max(high, 0.0) * longest
        samples = volume.host()
        found = [0.0]
        for axis, length in enumerate(np.linalg.norm(volume.index_to_world[:3, :3], axis=0)[::-1]):
            sums = np.sum(samples, axis=axis, dtype=np.float64, where=np.isfinite(samples)) * length
            found += [float(sums.min()), float(sums.max())]
        return min(found), max(found)

    def framed(self, tf: TransferFunction) -> TransferFunction:
        if self.what != "max":
            return tf
        # What is dark beside the rest hardly shows.
        low, high = tf.knots[0], tf.knots[-1]
        least = low + DARK * (high - low)
        return TransferFunction([(least, "white", 0.0), (least, "white", 1.0)])

    def kinds(self, scene: Scene) -> Part:
        return Everything(scene.volume)

    def sees(self, scene: Scene, ranges: np.ndarray) -> np.ndarray:
        return np.ones(len(ranges), bool)

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        low, high = scene.volume.range
        numbers: dict[str, Any] = {"off": rounding(scene), "range": high - low}
        if self.seeks:
            ranges, skip = scene.ranges(), bool(scene.skip_empty)
            numbers["peaks"] = keep(Peaks(ranges, self.seeks, skip))
            if keep.device.is_cpu:
                numbers["tops"] = keep(Tops(ranges.data, self.seeks, float(low), float(high), skip))
            return numbers
        return numbers | {"unit": scene.unit, "mean": self.what == "mean", "largest": max(abs(low), abs(high))}

    def parts(self, scene: Scene) -> dict[str, Part]:
        if self.seeks:
            return {}
        assert scene.transfer_function is not None
        colors = Transfer(scene.transfer_function, scene.unit, 0.0, "float64", False)
        return {"colors": colors, "flat": Flat(scene.ranges(), bool(scene.skip_empty) and scene.volume.half.finite)}

    def reaching(self, opacity: float) -> Projection:
        return self

    def check(self, scene: Scene) -> None:
        check_field(scene)
        if not self.seeks and scene.transfer_function is None:
            raise ValueError(
                f"transfer_function must be given besides a segmentation for Projection({self.what!r}): a {self.what} "
                f"over several labels has the colour of none of them"
            )

    def report(self, frame: Frame) -> dict[str, Any]:
        return {"bound_covers": "values: rounding"}


def check_field(scene: Scene) -> None:
    """Refuse fields without ranges of blocks, and samples of which cubics or sums along rays would overflow."""
    # One in a store is rendered in bricks, which have them.
    if scene.volume.blocks() is None and not scene.volume.stored:
        raise ValueError(
            f"integrator must be one that only samples the volume, such as Riemann or Simpson, got "
            f"{scene.integrator!r}: a {type(scene.volume).__name__} does not say what ranges its blocks have (blocks)"
        )
    low, high = scene.volume.range if scene.volume.shifts else (0.0, 0.0)
    if max(abs(low), abs(high)) > LARGEST:
        raise ValueError(
            f"volume has samples from {low:.3g} to {high:.3g}: {scene.integrator!r} takes those of sizes up to "
            f"{LARGEST:.0e}; scale them first"
        )


def rounding(scene: Scene) -> float:
    """Of a scalar along a ray, and of the largest in a cell: docs/projections.md."""
    low, high = scene.volume.range
    entire = scene.volume.entire
    edges = np.linalg.norm(entire.index_to_world[:3, :3], axis=0)
    # What underflows, times up to three lengths of a ray in a cell.
    denormal = float(UNDERFLOW) * float(edges.sum() / edges.min()) ** 3
    cells = float(max(entire.shape))
    return 2.0**-48 * max(abs(low), abs(high)) + (2.0**-43 + 6 * 2.0**-52 * cells) * (high - low) + denormal


@dataclass(frozen=True)
class Flat(Part):
    """The one value of blocks that have but one; NaN of others, and of all unless those are to ``skip``."""

    ranges: Ranges
    skip: bool
    name: ClassVar[str] = "flat"

    def build(self, keep: Keeper) -> wp.array:
        ranges = keep(self.ranges).numpy()
        low, high = ranges[..., 0].astype(np.float64), ranges[..., 1].astype(np.float64)
        return wp.array(np.where((low == high) & self.skip, low, np.nan), dtype=wp.float64, device=keep.device)
