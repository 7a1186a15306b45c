"""A clip shape: a cylinder with flat ends."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from wvr.cuts.base import Shape
from wvr.kernels.cuts.shapes import Shape as Half
from wvr.kernels.cuts.shapes import slab
from wvr.kernels.ray import FAR
from wvr.validation import finite_vector, positive

ONE = wp.constant(wp.float64(1.0))


@wp.func
def radius(p: wp.vec3d):
    return wp.length(wp.vec2d(p[0], p[1]))


@wp.func
def span(o: wp.vec3d, d: wp.vec3d, grow: wp.float64):
    near = -FAR
    far = FAR
    speed = d[0] * d[0] + d[1] * d[1]
    # From the point that is closest to the axis: no cancellation, however far away the ray begins.
    closest = wp.float64(0.0)
    if speed > wp.float64(0.0):
        closest = -(o[0] * d[0] + o[1] * d[1]) / speed
    wide = wp.max(ONE + grow, wp.float64(0.0))
    within = wide * wide - wp.pow(radius(o + closest * d), wp.float64(2.0))
    if within <= wp.float64(0.0):
        far = -FAR
    elif speed > wp.float64(0.0):
        half = wp.sqrt(within / speed)
        near = closest - half
        far = closest + half
    near, far = slab(o[2], d[2], -(ONE + grow), ONE + grow, near, far)
    return near, far


@wp.func
def inside(p: wp.vec3d):
    return radius(p) <= ONE and wp.abs(p[2]) <= ONE


@wp.func
def surface(p: wp.vec3d):
    r = radius(p)
    if ONE - r < ONE - wp.abs(p[2]):
        return ONE - r, wp.vec3d(-p[0], -p[1], wp.float64(0.0)) / r
    return ONE - wp.abs(p[2]), wp.vec3d(wp.float64(0.0), wp.float64(0.0), -wp.sign(p[2]))


# Around the z axis, of radius 1, from z = -1 to 1.
CYLINDER = Half(span, inside, surface)


@dataclass(frozen=True)
class ClipCylinder(Shape):
    """Keeps a cylinder of a ``radius`` around the line from ``start`` to ``end`` [world coordinates]."""

    start: ArrayLike
    end: ArrayLike
    radius: float
    invert: bool = False
    naive: bool = False
    half: ClassVar[Half] = CYLINDER

    def __post_init__(self):
        start = finite_vector(self.start, "start", "a point of the axis")
        end = finite_vector(self.end, "end", "a point of the axis")
        axis = (end - start) / 2
        if not np.any(axis):
            raise ValueError(f"start and end must not be the same, got {self.start!r}")
        across = np.linalg.svd(axis[None])[2][1:]  # two unit vectors at right angles to the axis and each other
        matrix = np.vstack([across / positive(self.radius, "radius"), axis / (axis @ axis)])
        self.define(matrix, (start + end) / 2, start=start, end=end)
