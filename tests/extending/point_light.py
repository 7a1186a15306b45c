"""A light at a place, which shines on all sides with the same strength however far away."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import warp as wp

from wvr.color import linear_rgb
from wvr.kernels.light.points import Kind
from wvr.light.lights import Light
from wvr.validation import finite_vector


@wp.func
def toward_place(vector: wp.vec3d, place: wp.vec3d, eye: wp.vec3d):
    return wp.normalize(vector - place)


PLACE = Kind(toward_place)


@dataclass(frozen=True)
class PointLight(Light):
    """A light at a ``place`` [world coordinates] of a ``color``."""

    place: Sequence[float]
    color: str | Sequence[float] = (1.0, 1.0, 1.0)
    half: ClassVar[Kind] = PLACE

    def __post_init__(self):
        place = finite_vector(self.place, "place", "where the light is")
        object.__setattr__(self, "place", tuple(place.tolist()))
        object.__setattr__(self, "color", tuple(linear_rgb(self.color).tolist()))

    @property
    def vector(self):
        return self.place
