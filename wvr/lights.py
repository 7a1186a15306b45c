"""Lights: what shines on a scene, for shading and for shadows. Colours are linear RGB."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .color import linear_rgb
from .validation import finite_vector


@dataclass(frozen=True)
class Headlight:
    """A directional light that travels with the camera, from the viewer to the scene.

    Parameters
    ----------
    color
        A colour name, ``"#rrggbb"`` or three linear numbers >= 0.
    """

    color: str | Sequence[float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "color", tuple(linear_rgb(self.color).tolist()))


@dataclass(frozen=True)
class DirectionalLight:
    """A light that is infinitely far away.

    Parameters
    ----------
    direction
        From the scene towards the light, in world space; any length but 0.
    color
        A colour name, ``"#rrggbb"`` or three linear numbers >= 0.

    Raises
    ------
    ValueError
        For a direction that is not three finite numbers or is zero, or a colour that is none.
    """

    direction: Sequence[float]
    color: str | Sequence[float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        direction = finite_vector(self.direction, "direction", "from the scene towards the light")
        if not np.any(direction):
            raise ValueError(f"direction must not be zero, got {self.direction!r}")
        # Divided by the largest component first, so that neither square nor root leaves the range of numbers.
        direction /= np.abs(direction).max()
        object.__setattr__(self, "direction", tuple((direction / np.linalg.norm(direction)).tolist()))
        object.__setattr__(self, "color", tuple(linear_rgb(self.color).tolist()))


Light = Headlight | DirectionalLight
