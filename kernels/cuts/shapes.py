"""Convex shapes that cut rays: what each kind is in its own coordinates, and what several kinds are together.

A shape is a canonical one under an affine map from index coordinates, which knows of spacings and directions: convex,
so that a ray is inside from one point to another. A kind is told by its number in the tuple of kinds that a kernel
is made for.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..ray import FAR, apart


@wp.struct
class Clip:
    """Visible inside a convex shape or, inverted, outside."""

    kind: int
    invert: bool
    matrix: wp.mat33d  # from index coordinates to those of the shape
    offset: wp.vec3d
    astray: wp.float64  # how far rounding may put a ray from where it should be, in those coordinates


@dataclass(frozen=True)
class Shape:
    """The device half of a kind of shape, in its own coordinates.

    ``span(origin, direction, grow)`` -> where a ray enters and leaves what is within ``grow`` of the shape, or where
    ``grow`` is negative inside it and no nearer to its surface; the wrong way round if it misses. ``grow`` is 0 but for
    bounds, which count what is so near to the surface that rounding decides on its side;
    ``inside(p)`` -> whether a point is inside;
    ``surface(p)`` -> level, positive inside and zero on the surface, and its gradient.
    """

    span: Any
    inside: Any
    surface: Any


@wp.func
def slab(o: wp.float64, d: wp.float64, low: wp.float64, high: wp.float64, near: wp.float64, far: wp.float64):
    """The part of [near, far] in which a coordinate is from low to high; none where low > high."""
    if d != wp.float64(0.0):
        t0 = (low - o) / d
        t1 = (high - o) / d
        near = wp.max(near, wp.where(d > wp.float64(0.0), t0, t1))
        far = wp.min(far, wp.where(d > wp.float64(0.0), t1, t0))
    elif o < low or o > high:
        far = -FAR
    return near, far


@wp.func
def plane_span(o: wp.vec3d, d: wp.vec3d, grow: wp.float64):
    near, far = slab(o[0], d[0], -grow, FAR, -FAR, FAR)
    return near, far


@wp.func
def plane_inside(p: wp.vec3d):
    return p[0] >= wp.float64(0.0)


@wp.func
def plane_surface(p: wp.vec3d):
    return p[0], wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))


@wp.func
def box_span(o: wp.vec3d, d: wp.vec3d, grow: wp.float64):
    near = -FAR
    far = FAR
    half = wp.float64(1.0) + grow
    for a in range(3):
        near, far = slab(o[a], d[a], -half, half, near, far)
    return near, far


@wp.func
def box_inside(p: wp.vec3d):
    return wp.max(wp.abs(p)) <= wp.float64(1.0)


@wp.func
def nearest_face(low: wp.vec3d, high: wp.vec3d, q: wp.vec3d):
    """Level and gradient of the nearest of a box's six faces; the level is positive inside."""
    level = FAR
    slope = wp.vec3d()
    for a in range(3):
        below = q[a] - low[a]
        above = high[a] - q[a]
        if wp.min(below, above) < level:
            level = wp.min(below, above)
            slope = wp.vec3d()
            slope[a] = wp.where(below < above, wp.float64(1.0), -wp.float64(1.0))
    return level, slope


@wp.func
def box_surface(p: wp.vec3d):
    one = wp.vec3d(wp.float64(1.0), wp.float64(1.0), wp.float64(1.0))
    level, slope = nearest_face(-one, one, p)
    return level, slope


@wp.func
def sphere_span(o: wp.vec3d, d: wp.vec3d, grow: wp.float64):
    # From the point that is closest to the centre: no cancellation, however far away the ray begins; and by a direction
    # of order one, whose square is a number however large the sphere.
    size = wp.max(wp.abs(d))
    way = d / size
    speed = wp.dot(way, way)
    closest = -wp.dot(o, way) / speed
    p = o + closest * way
    radius = wp.max(wp.float64(1.0) + grow, wp.float64(0.0))
    inside = radius * radius - wp.dot(p, p)
    near = FAR
    far = -FAR
    if inside > wp.float64(0.0):
        half = wp.sqrt(inside / speed)
        near = (closest - half) / size
        far = (closest + half) / size
    return near, far


@wp.func
def sphere_inside(p: wp.vec3d):
    return wp.dot(p, p) <= wp.float64(1.0)


@wp.func
def sphere_surface(p: wp.vec3d):
    return wp.float64(1.0) - wp.length(p), -wp.normalize(p)


# The half-space x >= 0, the cube |x|, |y|, |z| <= 1 and the unit ball.
PLANE = Shape(plane_span, plane_inside, plane_surface)
BOX = Shape(box_span, box_inside, box_surface)
SPHERE = Shape(sphere_span, sphere_inside, sphere_surface)
# Kinds that every kernel with clips knows: fewer kernels are compiled than if each had its own choice.
KINDS = (PLANE, BOX, SPHERE)


@cache
def make_shapes(kinds):
    """Functions of clips of any of the ``kinds``, in index coordinates:

    ``stretch_inside(clip, origin, direction)``; ``near_surface(clip, origin, direction, start, end)``, the length
    within that in which rounding may put a ray on either side; ``is_inside(clip, p)``; and ``surface_of(clip, p)``,
    whose gradient is that in the shape's own coordinates.
    """
    span, inside, surface = _chained(kinds, 0)

    @wp.func
    def stretch_inside(clip: Clip, origin: wp.vec3d, direction: wp.vec3d):
        near, far = span(clip.kind, clip.matrix @ origin + clip.offset, clip.matrix @ direction, wp.float64(0.0))
        return near, far

    @wp.func
    def near_surface(clip: Clip, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, end: wp.float64):
        o = clip.matrix @ origin + clip.offset
        d = clip.matrix @ direction
        near, far = span(clip.kind, o, d, clip.astray)
        closer, closer_far = span(clip.kind, o, d, -clip.astray)
        return apart(wp.vec2d(near, far), wp.vec2d(closer, closer_far), start, end)

    @wp.func
    def is_inside(clip: Clip, p: wp.vec3d):
        return inside(clip.kind, clip.matrix @ p + clip.offset)

    @wp.func
    def surface_of(clip: Clip, p: wp.vec3d):
        level, slope = surface(clip.kind, clip.matrix @ p + clip.offset)
        return level, slope

    return stretch_inside, near_surface, is_inside, surface_of


def _chained(kinds, number):
    """The functions of the kinds from a ``number`` on, chosen at run time by a first argument."""
    here = kinds[number]
    last = number + 1 == len(kinds)
    here_span, here_inside, here_surface = here.span, here.inside, here.surface
    other_span, other_inside, other_surface = (None,) * 3 if last else _chained(kinds, number + 1)

    @wp.func
    def span(kind: int, o: wp.vec3d, d: wp.vec3d, grow: wp.float64):
        near, far = here_span(o, d, grow)
        if wp.static(not last):
            if kind != wp.static(number):
                near, far = other_span(kind, o, d, grow)
        return near, far

    @wp.func
    def inside(kind: int, p: wp.vec3d):
        if wp.static(not last):
            if kind != wp.static(number):
                return other_inside(kind, p)
        return here_inside(p)

    @wp.func
    def surface(kind: int, p: wp.vec3d):
        level, slope = here_surface(p)
        if wp.static(not last):
            if kind != wp.static(number):
                level, slope = other_surface(kind, p)
        return level, slope

    return span, inside, surface
