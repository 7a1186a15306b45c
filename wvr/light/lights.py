"""Lights: what shines on a scene, for shading and for shadows. Colours are linear RGB."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..color import linear_rgb
from ..kernels.light.points import DIRECTIONAL, HEADLIGHT, Kind
from ..validation import finite_vector


class Light:
    """What all lights have: a colour, a vector (a direction or a place in the world), and a device ``half`` (as of
    ``kernels.light.points``) that says where the light is by it.
    """

    half: ClassVar[Kind]
    color: Any
    vector: tuple[float, ...] = (0.0, 0.0, 0.0)

    def way(self, forward: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The way it goes, a unit vector, in the middle of a view in a direction; None for light without one way, which
        does not go from slice to slice.
        """
        return None


@dataclass(frozen=True)
class Headlight(Light):
    """A directional light that travels with the camera, from the viewer to the scene.

    Parameters
    ----------
    color
        A colour name, ``"#rrggbb"`` or three linear numbers >= 0.
    """

    color: str | Sequence[float] = (1.0, 1.0, 1.0)
    half: ClassVar[Kind] = HEADLIGHT

    def __post_init__(self) -> None:
        object.__setattr__(self, "color", tuple(linear_rgb(self.color).tolist()))

    def way(self, forward: NDArray[np.float64]) -> NDArray[np.float64]:
        return forward


@dataclass(frozen=True)
class DirectionalLight(Light):
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
    half: ClassVar[Kind] = DIRECTIONAL

    def __post_init__(self) -> None:
        direction = finite_vector(self.direction, "direction", "from the scene towards the light")
        if not np.any(direction):
            raise ValueError(f"direction must not be zero, got {self.direction!r}")
        # Divided by the largest component first, so that neither square nor root leaves the range of numbers.
        direction /= np.abs(direction).max()
        object.__setattr__(self, "direction", tuple((direction / np.linalg.norm(direction)).tolist()))
        object.__setattr__(self, "color", tuple(linear_rgb(self.color).tolist()))

    @property
    def vector(self) -> tuple[float, ...]:  # type: ignore[override]
        return tuple(self.direction)

    def way(self, forward: NDArray[np.float64]) -> NDArray[np.float64]:
        return -np.array(self.direction)


def light_list(light: Any, empty: bool = True) -> tuple[Light, ...]:
    """A light or several as a tuple; none only where that is ``empty``.

    Raises
    ------
    TypeError
        For anything else.
    """
    lights = (light,) if isinstance(light, Light) else light
    if (
        not isinstance(lights, Sequence)
        or (not lights and not empty)
        or not all(isinstance(one, Light) for one in lights)
    ):
        some = "them" if empty else "one or more"
        raise TypeError(
            f"light must be a Headlight or DirectionalLight, another Light, or a sequence of {some}, got {light!r}"
        )
    return tuple(lights)
