"""The exact integral."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ..keep import Keeper
from ..kernels.integrators.exact import Half
from ..kernels.integrators.pieces import NODES
from ..transfer.nodes import nodes_array
from .base import Integrator

if TYPE_CHECKING:
    from ..scene import Scene

# What light, which is no polynomial, may change between the points of a piece that it is taken from.
LIGHT = 1e-6


@dataclass(frozen=True)
class Exact(Integrator):
    """Ground truth: cell by cell, exact but for float64 rounding, and quadrature that is proved to 1e-12.

    Inside a cell the scalar along a ray is a cubic; it is cut where it crosses control points of the transfer
    function. On each piece extinction is a cubic too and the optical depth a quartic in closed form, and
    ``int c tau exp(-D) = c_0 (1 - exp(-D)) + c' int (s - s_0) tau exp(-D)``, c' the slope of colour over the scalar,
    leaves one integral to quadrature. Cells whose eight samples see only a transparent part of the transfer function
    are skipped.

    Notes
    -----
    Quadrature is off by at most 1e-12 of a piece's opacity, times what colour changes between two control points
    (``kernels.integrators.pieces.deepest`` has the proof); found were 4e-14 at most. With rounding, images are within
    1e-12 of the truth, 3e-12 where clips or labels cut, in parts of the brightest colour, in all scenes that were held
    against enclosures
    (:func:`wvr.enclose`; docs/enclosure.md has the numbers) but where rounding of the scalar, some 1e-15 of the largest
    sample, or of lengths, some 1e-15 of the volume's, meets steep slopes: a spike as narrow as 1e-13 of the samples is
    off by up to 0.05, and a ray along a jump, or along a face of the box or of an absent cell, is on either side of it.
    Clips that are far away or large for the volume are as exact as float64 is at that distance, and those that a ray
    just touches half as many digits.

    Light is no polynomial: it is taken from 2 to 16 points of a piece, the more the more it turns there, or of its
    halves, or theirs. Even in noise colour is within 1e-5 of what smaller and smaller steps come to (found were 5e-6).
    Opacity knows nothing of light.

    Always in float64, whatever ``precision`` is asked for, and so is the image. ``image.samples`` counts the pieces
    that were integrated. Rays do not end early unless ``termination`` says so.
    """

    anywhere: ClassVar[bool] = True
    cells: ClassVar[bool] = True
    splits: ClassVar[bool] = True
    asks: ClassVar[tuple[str, ...]] = ("cubic",)

    @property
    def order(self) -> float:
        return float("inf")

    def half(self, scene: Scene) -> Half:
        return Half()

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        return {"nodes": nodes_array("float64", keep.device, NODES), "tolerance": LIGHT}

    def shown(self, scene: Scene) -> str:
        return "float64"

    def termination(self, scene: Scene) -> float:
        return 0.0
