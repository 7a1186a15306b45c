"""Adaptive pre-integration, and how long its steps may be in each cube of cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..field.blocks import Ranges, rows_of
from ..field.samples import samples_struct
from ..keep import Keeper, Part
from ..kernels.cuts.labels import MIXED
from ..kernels.field.bends import MORE, cubes, make_bends, make_distances, vec8d
from ..kernels.integrators.adaptive_preintegrated import Half
from ..kernels.precision import REALS
from ..launch import launch
from ..transfer.function import Transfer, transfer_values
from ..transfer.lookup import Lookup
from ..transfer_function import TransferFunction
from ..validation import below_one, define, positive
from .base import Integrator

if TYPE_CHECKING:
    from ..frame import Frame
    from ..scene import Scene


@dataclass(frozen=True)
class AdaptivePreintegrated(Integrator):
    """Pre-integrated segments as long as the field is straight enough where the transfer function sees it.

    The adaptive pre-integration of Roettger et al., "Smart Hardware-Accelerated Volume Rendering" (2003): each cube of
    8 cells along each axis has its longest step, from bounds on the field's second differences and on the transfer
    function's slopes over the cube's range. Blocks without any extinction are leapt over.

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
    traces: ClassVar[bool] = True

    def __post_init__(self) -> None:
        define(self, tolerance=below_one(self.tolerance, "tolerance"))
        define(self, hmin=positive(self.hmin, "hmin"))

    @property
    def order(self) -> float:
        return 2

    @property
    def shortest(self) -> float:
        return self.hmin

    def half(self, scene: Scene) -> Half:
        return Half()

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        return {"shortest": self.hmin, "tolerance": self.tolerance}

    def parts(self, scene: Scene) -> dict[str, Part]:
        functions = tuple(self.function(scene, tf) for tf in scene.functions)
        scale = tuple((scene.unit / np.linalg.norm(scene.volume.index_to_world[:3, :3], axis=0)).tolist())
        kinds = scene.kinds() if scene.segmentation is not None else None
        return {"distance": Distances(Bends(scene.ranges(), scale), functions, self.tolerance, kinds)}

    def table(self, scene: Scene, tf: TransferFunction) -> Part:
        n, domain = scene.table_shape(None)
        precision = self.precision(scene)
        return Lookup(tf, scene.unit, self.hmin, n, domain, "stretchable", scene.shift, precision, False)

    def termination(self, scene: Scene) -> float:
        return min(1 / 256, self.tolerance)

    def check(self, scene: Scene) -> None:
        if scene.volume.blocks() is None:
            raise ValueError(f"integrator must be one that needs no blocks of the volume, got {self!r}")

    def report(self, frame: Frame) -> dict[str, Any]:
        return {"tolerance_covers": "what a linear scalar costs a step; not forced steps, nor their sum along a ray"}


@dataclass(frozen=True)
class Bends(Part):
    """How far the field may be from linear along any ray in each cube, for axes of so many nodes a unit length."""

    ranges: Ranges
    scale: tuple[float, ...]
    name: ClassVar[str] = "bends"

    def build(self, keep: Keeper) -> wp.array:
        data = keep(self.ranges.data)
        result = keep.empty(cubes(data.shape), wp.vec2d)
        inputs = [samples_struct(data), wp.vec3d(*self.scale), result]
        launch(make_bends(data.dtype), result.size, inputs, keep.device)
        return result


@dataclass(frozen=True)
class Distances(Part):
    """How long a step may be in each cube of cells, by a tolerance; where there are labels, by those of the cube."""

    bends: Bends
    functions: tuple[Part, ...]
    tolerance: float
    kinds: Part | None
    name: ClassVar[str] = "distances"

    def build(self, keep: Keeper) -> wp.array:
        each = [self._of(function, keep) for function in self.functions]
        if self.kinds is None:
            return each[0]
        # By its own transfer function in a cube of one, else the shortest of all.
        held = together(keep(self.kinds).held.numpy())
        result = np.min([one.numpy() for one in each], axis=0)
        for state, one in enumerate(each):
            result = np.where(held == state, one.numpy(), result)
        return wp.array(result, dtype=wp.float32, device=keep.device)

    def _of(self, function: Part, keep: Keeper) -> wp.array:
        assert isinstance(function, Transfer)
        ranges = keep(self.bends.ranges)
        result = keep.empty(keep(self.bends).shape, wp.float32)
        maxima = range_maxima(function.function, function.unit, keep.device)
        kernel = make_distances(keep(self.bends.ranges.data).dtype, REALS[function.precision])
        inputs = [ranges, keep(self.bends), wp.float64(function.shift), keep(function), maxima]
        launch(kernel, rows_of(result), [*inputs, wp.float64(self.tolerance), result], keep.device)
        return result


def together(held: NDArray[np.int32]) -> NDArray[np.int32]:
    """States of cubes by those of their blocks: ``MIXED`` where those differ."""
    size = 1 << int(MORE)
    padded = np.pad(held, [(0, -n % size) for n in held.shape], mode="edge")
    blocks = padded.reshape([m for n in padded.shape for m in (n // size, size)])
    least, most = blocks.min(axis=(1, 3, 5)), blocks.max(axis=(1, 3, 5))
    return np.where(least == most, least, np.int32(MIXED))


def range_maxima(tf: TransferFunction, unit: float, device: wp.Device) -> wp.array:
    """Bounds on a transfer function over any range of its n + 1 intervals: row l has at k those of k .. k + 2**l - 1.

    Per interval: how much an error of the scalar changes emission, |tau'| + tau |c'| for extinction tau per ``unit`` of
    length and colours up to 1; extinction; colour; minus colour, so that all are maxima.
    """
    values = transfer_values(tf, unit)
    ends = np.stack([values[[0, *range(len(values))]], values[[*range(len(values)), -1]]])
    extinction = ends[:, :, 3].max(axis=0)
    change = np.abs(ends[1] - ends[0])
    width = np.concatenate([[1.0], np.diff(tf.knots), [1.0]])
    # A jump is infinitely steep, unless nobody sees it.
    with np.errstate(divide="ignore", invalid="ignore"):
        visibility = (change[:, 3] + extinction * change[:, :3].max(axis=1)) / width
    visibility = np.nan_to_num(visibility, nan=0.0, posinf=np.inf)
    # A colour that nobody sees is none.
    colors = np.where(
        extinction[:, None] > 0, np.hstack([ends[:, :, :3].max(axis=0), -ends[:, :, :3].min(axis=0)]), -np.inf
    )
    rows = [np.column_stack([visibility, extinction, colors])]
    while 2 ** len(rows) <= len(extinction):
        half = 2 ** (len(rows) - 1)
        row = rows[-1].copy()
        row[:-half] = np.maximum(row[:-half], row[half:])
        rows.append(row)
    return wp.array(np.stack(rows), dtype=vec8d, device=device)
