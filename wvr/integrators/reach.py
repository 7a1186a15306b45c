"""Where rays have an opacity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from ..keep import Keeper
from ..kernels.integrators.pieces import NODES
from ..kernels.integrators.reach import Half
from ..transfer.nodes import nodes_array
from .base import Integrator

if TYPE_CHECKING:
    from ..scene import Scene


@dataclass(frozen=True)
class Reach(Integrator):
    """Finds where the exact integral along a ray reaches an ``opacity``, and the scalar there, as ``Exact`` walks."""

    opacity: float
    anywhere: ClassVar[bool] = True
    cells: ClassVar[bool] = True
    probes: ClassVar[bool] = True
    asks: ClassVar[tuple[str, ...]] = ("cubic",)

    @property
    def order(self) -> float:
        return float("inf")

    def half(self, scene: Scene) -> Half:
        return Half()

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        return {"nodes": nodes_array("float64", keep.device, NODES), "opacity": self.opacity}

    def precision(self, scene: Scene) -> str:
        return "float64"

    def termination(self, scene: Scene) -> float:
        return 0.0
