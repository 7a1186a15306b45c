"""Adaptive pre-integration, and how much a transfer function makes of an error of the scalar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..field.blocks import Octants
from ..keep import Keeper, Part
from ..kernels.integrators.adaptive_preintegrated import Half
from ..transfer.function import transfer_values
from ..transfer.lookup import Stretchable
from ..transfer_function import TransferFunction
from ..validation import below_one, define, positive
from .base import Integrator

if TYPE_CHECKING:
    from ..frame import Frame
    from ..scene import Scene

# Over the range of the volume, a power of two.
BINS = 256
# Samples along an axis that the walk in whole numbers can count.
MOST = 2**20


@dataclass(frozen=True)
class AdaptivePreintegrated(Integrator):
    """Pre-integrated segments as long as the field is straight enough where the transfer function sees it.

    The adaptive pre-integration of Roettger et al., "Smart Hardware-Accelerated Volume Rendering" (2003): the step
    follows from the second derivative of the scalar, which is known exactly along the ray in each cell, and from how
    much the transfer function makes of a deviation there. Cells without any extinction are leapt over. A segment has
    the line of the same integral as the scalar's, and a table of all lengths.

    Parameters
    ----------
    tolerance
        Error of optical depth or colour that the segments in a cell may have because the scalar is not linear along
        them, in (0, 1), weighted by the transparency in front of them. A bound but where they are forced; the errors
        of a ray's cells mostly cancel, at worst they add up.
    hmin
        A segment of this length is forced: taken whatever its error [smallest voxel spacing], > 0.

    Notes
    -----
    Colours are taken to be at most 1. ``image.samples`` counts segments, ``image.trace(x, y)`` gives those of a ray.
    Unless ``termination`` says otherwise, rays end when a transparency of 1/256 is left, as in the paper, or of
    ``tolerance`` where that is less.
    """

    tolerance: float
    hmin: float = 0.125
    traces: ClassVar[bool] = True
    splits: ClassVar[bool] = True
    cells: ClassVar[bool] = True
    asks: ClassVar[tuple[str, ...]] = ("centered",)

    def __post_init__(self) -> None:
        define(self, tolerance=below_one(self.tolerance, "tolerance"))
        define(self, hmin=positive(self.hmin, "hmin"))

    @property
    def order(self) -> float:
        return 2

    @property
    def shortest(self) -> float:
        return self.hmin

    def _packed(self, scene: Scene) -> bool:
        """Whether cells may be computed many at a time, in single precision."""
        fits = max(scene.volume.entire.shape) <= MOST and scene.segmentation is None
        return fits and self.precision(scene) == "float32" and hasattr(scene.volume.half, "cubics")

    def half(self, scene: Scene) -> Half:
        return Half(self._packed(scene))

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        edges = bins(scene.scalars)
        numbers = {
            "shortest": self.hmin,
            "tolerance": self.tolerance,
            "low": edges[0] - scene.shift,
            "scale": BINS / (edges[-1] - edges[0]),
            "longest": longest(scene),
        }
        if self._packed(scene) and keep.device.is_cpu:
            numbers["octants"] = keep(Octants(scene.kinds()))
        return numbers

    def parts(self, scene: Scene) -> dict[str, Part]:
        return {"changes": Changes(tuple(scene.functions), scene.unit, scene.scalars)}

    def table(self, scene: Scene, tf: TransferFunction) -> Part:
        # Half as many as for steps of one length: what counts beside more exact entries is that they stay in a cache.
        n, domain = scene.table_shape(tf, 256)
        return Stretchable(tf, scene.unit, longest(scene), n, domain, scene.shift, self.precision(scene))

    def termination(self, scene: Scene) -> float:
        return min(1 / 256, self.tolerance)

    def report(self, frame: Frame) -> dict[str, Any]:
        covers = (
            "for the segments in a cell, that the scalar is not linear along them; not forced ones, nor the look-up "
            "between table entries, nor that segments add up"
        )
        return {"tolerance_covers": covers}


def longest(scene: Scene) -> float:
    """Diagonal of a cell [smallest voxel spacing]."""
    corners = scene.volume.index_to_world[:3, :3] @ [[1, 1, 1, 1], [1, 1, -1, -1], [1, -1, 1, -1]]
    return float(np.linalg.norm(corners, axis=0).max() / scene.unit)


@dataclass(frozen=True)
class Changes(Part):
    """How much an error of the scalar changes emission, at most, by scalar: of ``BINS`` over a domain, for the largest
    of several transfer functions. Row l has at k the largest of bins k .. k + 2**l - 1.
    """

    functions: tuple[TransferFunction, ...]
    unit: float
    domain: tuple[float, float]
    name: ClassVar[str] = "changes"

    def build(self, keep: Keeper) -> wp.array:
        edges = bins(self.domain)
        rows = [np.max([changes(tf, self.unit, edges) for tf in self.functions], axis=0)]
        while 2 ** len(rows) <= BINS:
            half = 2 ** (len(rows) - 1)
            row = rows[-1].copy()
            row[:-half] = np.maximum(row[:-half], row[half:])
            rows.append(row)
        with np.errstate(over="ignore"):
            return wp.array(np.stack(rows).astype(np.float32), dtype=wp.float32, device=keep.device)


def bins(domain: tuple[float, float]) -> NDArray[np.float64]:
    """Edges of bins over a domain; neither samples nor control points are likely to lie on them."""
    width = (domain[1] - domain[0]) / (BINS - 1)
    return domain[0] + width * (np.arange(BINS + 1, dtype=np.float64) - 0.31)


def changes(tf: TransferFunction, unit: float, edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest change of emission or extinction by the scalar between each edge and the next, and a little to each side
    for rounding: |tau'| + tau |c'| for extinction tau per ``unit`` of length and colours up to 1.
    """
    values = transfer_values(tf, unit)
    change = np.abs(np.diff(values, axis=0))
    extinction = np.maximum(values[1:, 3], values[:-1, 3])
    # A jump is infinitely steep, unless nobody sees it.
    with np.errstate(divide="ignore", invalid="ignore"):
        steepness = (change[:, 3] + extinction * change[:, :3].max(axis=1)) / np.diff(tf.knots)
    # Nothing changes beyond the outermost control points.
    steepness = np.concatenate([[0.0], np.nan_to_num(steepness, nan=0.0, posinf=np.inf), [0.0]])
    margin = 0.13 * (edges[1] - edges[0])
    first = np.searchsorted(tf.knots, edges[:-1] - margin, "left")
    last = np.searchsorted(tf.knots, edges[1:] + margin, "right")
    return np.array([steepness[a : b + 1].max() for a, b in zip(first, last, strict=True)], np.float64)
