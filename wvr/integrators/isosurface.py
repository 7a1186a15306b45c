"""Isosurfaces of the trilinear field, exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import warp as wp

from ..field.levels import LevelKinds
from ..keep import Keeper, Part
from ..kernels.integrators.isosurface import ASTRAY, NEAR, Half
from ..transfer_function import MAX_OPACITY, TransferFunction
from ..validation import any_array, define, finite_array, share
from .base import Integrator
from .projection import check_field, rounding

if TYPE_CHECKING:
    from ..field.base import Field
    from ..frame import Frame
    from ..scene import Scene


# Colours of one surface, and of the first to the last of several, all bright enough for light to tell their shape.
ONE = ("#dccfb4", "#dccfb4")
SEVERAL = ("#5d8fd0", "#e8a04a", "#fff3dc")


@dataclass(frozen=True)
class Isosurface(Integrator):
    """Surfaces where the trilinear field has a value: every crossing along a ray, in order, each an exact root.

    Colour and opacity of a crossing are those that the transfer function has at the value: opacity that of its
    ``unit_distance``, 1 for a surface that hides what is behind. Where nothing is said of colours one surface is ivory
    and several go from blue to ivory; a colour map spans their values. Surfaces are lit by the gradient of the field,
    and composited front to back. Where data end, at the faces of the volume, of clips and of labels, there is none.

    ``image.error_bound`` is that of ``rgba`` without light: where rounding may decide on whether a ray crosses a
    surface, as where it just touches it, the bound has what that would do (docs/projections.md). ``image.depth()`` is
    where the ray's opacity reaches one half, or what is asked for: the first crossing, of opaque surfaces.

    Parameters
    ----------
    values
        One or more scalars, in any order.
    reached
        Opacity at which a ray has its place; :meth:`Image.depth` asks for another.
    """

    values: Sequence[float] | float
    reached: float = field(default=0.5, repr=False, kw_only=True)
    anywhere: ClassVar[bool] = True
    cells: ClassVar[bool] = True
    probes: ClassVar[bool] = True
    surfaces: ClassVar[bool] = True
    asks: ClassVar[tuple[str, ...]] = ("cubic",)

    def __post_init__(self) -> None:
        levels = np.unique(finite_array(np.atleast_1d(any_array(self.values, "values")), "values", (-1,)))
        if not len(levels):
            raise ValueError("values must be one or more scalars, got none")
        define(self, values=tuple(levels.tolist()), reached=share(self.reached, "reached"))

    @property
    def order(self) -> float:
        return float("inf")

    def half(self, scene: Scene) -> Half:
        return Half()

    def precision(self, scene: Scene) -> str:
        return "float64"

    def termination(self, scene: Scene) -> float:
        return 0.0

    def domain(self, volume: Field) -> tuple[float, float]:
        first, *_, last = (*self._levels, *self._levels)
        return (first, last) if first < last else volume.range

    @property
    def colors(self) -> Sequence[str]:  # type: ignore[override]
        return SEVERAL if len(self._levels) > 1 else ONE

    def framed(self, tf: TransferFunction) -> TransferFunction:
        least = self._levels[0]
        return TransferFunction([(least, "white", 0.0), (least, "white", 1.0)])

    def kinds(self, scene: Scene) -> Part:
        return LevelKinds(scene.volume, scene.ranges(), self._levels, self._margin(scene))

    def sees(self, scene: Scene, ranges: np.ndarray) -> np.ndarray:
        margin = self._margin(scene) + NEAR * float(np.subtract(*scene.volume.range[::-1]))
        levels = np.array(self._levels)
        first = np.searchsorted(levels, ranges[:, 0] - margin, "left")
        return np.asarray(first < np.searchsorted(levels, ranges[:, 1] + margin, "right"))

    def _margin(self, scene: Scene) -> float:
        """How near to a level samples count as on both sides."""
        low, high = scene.volume.range
        return 2 * (rounding(scene) + 3 * ASTRAY * (high - low))

    @property
    def _levels(self) -> tuple[float, ...]:
        assert isinstance(self.values, tuple)
        return self.values

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        low, high = scene.volume.range
        colors = np.stack([surfaces(tf, self._levels, scene.unit) for tf in scene.functions])
        return {
            "level": wp.array(self._levels, dtype=wp.float64, device=keep.device),
            "color": wp.array(colors, dtype=wp.vec4d, device=keep.device),
            "strongest": float(colors[..., 3].max()),
            "brightest": scene.brightest,
            "opacity": self.reached,
            "off": rounding(scene),
            "range": high - low,
            "shown": scene.brightest * float(np.finfo(self.shown(scene)).eps) / 2,
        }

    def check(self, scene: Scene) -> None:
        check_field(scene)

    def misses(self, low: float, high: float) -> str:
        if any(low <= level <= high for level in self._levels):
            return ""
        return f"the isosurfaces are at {', '.join(f'{level:g}' for level in self._levels)}; give values between those"

    def reaching(self, opacity: float) -> Isosurface:
        return replace(self, reached=opacity)

    def report(self, frame: Frame) -> dict[str, Any]:
        lit = "" if frame.scene.lighting is None else ", not light"
        return {"bound_covers": f"all channels{lit}: crossings that rounding decides on, and rounding"}


def surfaces(tf: TransferFunction, levels: tuple[float, ...], unit: float) -> np.ndarray:
    """Colour of each level, and its opacity in the unit distance; shape (n, 4)."""
    distance = unit if tf.unit_distance is None else tf.unit_distance
    assert not isinstance(distance, str)  # a renderer has asked for_volume
    opacity = -np.expm1(-tf.extinction(levels, unit) * distance)
    opacity[opacity > MAX_OPACITY - 1e-12] = 1.0
    return np.concatenate([tf.color(levels), opacity[:, None]], axis=1)
