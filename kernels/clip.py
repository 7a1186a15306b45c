"""Clipping: which stretches of a ray are visible, in float64 and in index coordinates of the volume.

A plane, box or sphere is the half-space x >= 0, the cube |x|, |y|, |z| <= 1 or the unit ball under an affine map, which
knows of spacings and directions: convex, so that a ray is inside from one point to another. A clip volume is a field on
a grid of its own, visible where it is at least ``iso``; along a ray it is a cubic in each of its cells, and changes
where the cubic crosses ``iso``. Several clips leave what all of them do.
"""

from functools import cache

import warp as wp

from .cell import cubic, make_corners, rise, vec8d
from .field import make_field
from .importance import BLOCK
from .walk import FAR, ahead, cell_at, entering, leaving

PLANE = wp.constant(0)
BOX = wp.constant(1)
SPHERE = wp.constant(2)


@wp.struct
class Clip:
    """Visible inside a convex shape or, inverted, outside."""

    kind: int
    invert: bool
    matrix: wp.mat33d  # from index coordinates to those of the shape
    offset: wp.vec3d


@wp.func
def stretch_inside(clip: Clip, origin: wp.vec3d, direction: wp.vec3d):
    """Where a ray enters and leaves the shape, the wrong way round if it misses it."""
    o = clip.matrix @ origin + clip.offset
    d = clip.matrix @ direction
    near = -FAR
    far = FAR
    if clip.kind == SPHERE:
        # From the point that is closest to the centre: no cancellation, however far away the ray begins.
        speed = wp.dot(d, d)
        closest = -wp.dot(o, d) / speed
        p = o + closest * d
        inside = wp.float64(1.0) - wp.dot(p, p)
        near = FAR
        far = -FAR
        if inside > wp.float64(0.0):
            half = wp.sqrt(inside / speed)
            near = closest - half
            far = closest + half
    else:
        for a in range(3):
            if clip.kind == BOX or a == 0:
                # Up to x = 1 for the box only.
                low = wp.where(clip.kind == BOX, -wp.float64(1.0), wp.float64(0.0))
                high = wp.where(clip.kind == BOX, wp.float64(1.0), FAR)
                if d[a] != wp.float64(0.0):
                    t0 = (low - o[a]) / d[a]
                    t1 = (high - o[a]) / d[a]
                    near = wp.max(near, wp.min(t0, t1))
                    far = wp.min(far, wp.max(t0, t1))
                elif o[a] < low or o[a] > high:
                    far = -FAR
    return near, far


@wp.func
def is_inside(clip: Clip, p: wp.vec3d):
    """Whether a point is inside the shape."""
    q = clip.matrix @ p + clip.offset
    if clip.kind == PLANE:
        return q[0] >= wp.float64(0.0)
    if clip.kind == SPHERE:
        return wp.dot(q, q) <= wp.float64(1.0)
    return wp.max(wp.abs(q)) <= wp.float64(1.0)


@cache
def make_clipping(dtype):
    """The structs of a clip volume of ``dtype`` samples and of all clips of a scene."""
    Field, _ = make_corners(dtype)

    @wp.struct
    class ClipVolume:
        """Visible where a field is at least ``iso`` or, inverted, elsewhere."""

        field: Field
        ranges: wp.array3d(dtype=wp.vec2d)  # [z, y, x] of blocks, as of ``importance``
        iso: wp.float64
        invert: bool
        low: wp.vec3d  # its box, in its own index coordinates; outside the field is below iso
        high: wp.vec3d
        matrix: wp.mat33d  # from the index coordinates of the scene's volume to its own
        offset: wp.vec3d

    @wp.struct
    class Clipping:
        shapes: wp.array(dtype=Clip)  # that cut rays
        volumes: wp.array(dtype=ClipVolume)
        naive_shapes: wp.array(dtype=Clip)  # that leave out samples
        naive_volumes: wp.array(dtype=ClipVolume)
        partial_volumes: wp.array(dtype=ClipVolume)  # that cut segments

    return ClipVolume, Clipping


@cache
def make_clip_span(dtype):
    """``clip_span(clipping, origin, direction, t, length)``: whether a ray is visible from t on, and until where."""
    ClipVolume, Clipping = make_clipping(dtype)
    _, corners = make_corners(dtype)

    @wp.func
    def volume_span(clip: ClipVolume, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64):
        """Whether the field is at least iso from t on, and until where that is known not to change."""
        last = clip.field.last
        o = clip.matrix @ origin + clip.offset
        d = clip.matrix @ direction
        near = -FAR
        far = FAR
        for a in range(3):
            if d[a] != wp.float64(0.0):
                t0 = (clip.low[a] - o[a]) / d[a]
                t1 = (clip.high[a] - o[a]) / d[a]
                near = wp.max(near, wp.min(t0, t1))
                far = wp.min(far, wp.max(t0, t1))
            elif o[a] < clip.low[a] or o[a] > clip.high[a]:
                far = -FAR
        here = ahead(t)
        if here >= far or near >= far:
            return False, FAR
        if here < near:
            return False, near
        inside = bool(False)
        known = bool(False)
        cell = cell_at(last, o + here * d)
        while here < far and here < length:
            span = clip.ranges[cell[2] // BLOCK, cell[1] // BLOCK, cell[0] // BLOCK]
            low = span[0]
            high = span[1]
            size = int(BLOCK)
            c = vec8d()
            if low < clip.iso and high >= clip.iso:
                size = 1
                c = corners(clip.field, cell[0], cell[1], cell[2])
                low = wp.min(c)
                high = wp.max(c)
            end, axis = leaving(last, o, d, cell, size)
            stop = wp.min(end, far)
            if stop > here:
                if low >= clip.iso or high < clip.iso:
                    if known and inside != (low >= clip.iso):
                        return inside, here
                    inside = low >= clip.iso
                else:
                    local = o + here * d - wp.vec3d(wp.float64(cell[0]), wp.float64(cell[1]), wp.float64(cell[2]))
                    above = cubic(c, local, d)
                    above[0] -= clip.iso
                    if not known:
                        inside = above[0] >= wp.float64(0.0)
                    u = rise(wp.where(inside, -above, above), stop - here)
                    if u < stop - here:
                        return inside, here + u
                known = True
                here = stop
            if stop < far:
                cell = entering(last, o, d, cell, size, end, axis)
        return inside, here

    @wp.func
    def clip_span(clipping: Clipping, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64):
        # Visible until the first of all clips ends; else at least until the last of those that hide it does.
        visible = bool(True)
        until = length
        for n in range(clipping.shapes.shape[0] + clipping.volumes.shape[0]):
            shown = bool(False)
            end = FAR
            if n < clipping.shapes.shape[0]:
                clip = clipping.shapes[n]
                near, far = stretch_inside(clip, origin, direction)
                here = ahead(t)
                inside = here >= near and here < far
                if inside:
                    end = far
                elif here < near and near < far:
                    end = near
                shown = inside != clip.invert
            else:
                volume = clipping.volumes[n - clipping.shapes.shape[0]]
                known, changes = volume_span(volume, origin, direction, t, length)
                shown = known != volume.invert
                end = changes
            if shown:
                if visible:
                    until = wp.min(until, end)
            else:
                until = wp.where(visible, end, wp.max(until, end))
                visible = False
        return visible, wp.min(until, length)

    return clip_span


@cache
def make_shown(dtype):
    """``shown(clipping, p)``: whether a point is visible to the naive clips."""
    _, Clipping = make_clipping(dtype)
    _, value = make_field(dtype, wp.float64)

    @wp.func
    def shown(clipping: Clipping, p: wp.vec3d):
        for n in range(clipping.naive_shapes.shape[0]):
            clip = clipping.naive_shapes[n]
            if is_inside(clip, p) == clip.invert:
                return False
        for n in range(clipping.naive_volumes.shape[0]):
            volume = clipping.naive_volumes[n]
            q = volume.matrix @ p + volume.offset
            inside = bool(True)
            for a in range(3):
                inside = inside and q[a] >= volume.low[a] and q[a] <= volume.high[a]
            if inside:
                inside = value(volume.field, q) >= volume.iso
            if inside == volume.invert:
                return False
        return True

    return shown


@cache
def make_cut_normal(dtype):
    """``cut_normal(clipping, to_index, p, reach)``: of the surface that a ray is cut by at point p, the unit normal in
    the world, towards what is cut away; zero without any within ``reach``. ``to_index`` is that of ``ray.View``.
    """
    ClipVolume, Clipping = make_clipping(dtype)
    _, corners = make_corners(dtype)

    @wp.func
    def gradient(clip: ClipVolume, q: wp.vec3d):
        cell = cell_at(clip.field.last, q)
        c = corners(clip.field, cell[0], cell[1], cell[2])
        local = q - wp.vec3d(wp.float64(cell[0]), wp.float64(cell[1]), wp.float64(cell[2]))
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        x = cubic(c, local, wp.vec3d(one, zero, zero))
        y = cubic(c, local, wp.vec3d(zero, one, zero))
        z = cubic(c, local, wp.vec3d(zero, zero, one))
        return x[0] - clip.iso, wp.vec3d(x[1], y[1], z[1])

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
    def nearer(
        distance: wp.float64,
        normal: wp.vec3d,
        level: wp.float64,
        slope: wp.vec3d,
        to_index: wp.mat33d,
        matrix: wp.mat33d,
        invert: bool,
    ):
        """Distance and normal of the surface where a level is zero, if that is nearer than another surface."""
        world = wp.transpose(matrix @ to_index) @ slope
        steep = wp.length(world)
        if steep > wp.float64(0.0) and wp.abs(level) < distance * steep:
            return wp.abs(level) / steep, wp.where(invert, world, -world) / steep
        return distance, normal

    @wp.func
    def cut_normal(clipping: Clipping, to_index: wp.mat33d, p: wp.vec3d, reach: wp.float64):
        distance = reach
        normal = wp.vec3d()
        one = wp.vec3d(wp.float64(1.0), wp.float64(1.0), wp.float64(1.0))
        for n in range(clipping.shapes.shape[0]):
            clip = clipping.shapes[n]
            q = clip.matrix @ p + clip.offset
            level = q[0]
            slope = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
            if clip.kind == SPHERE:
                level = wp.float64(1.0) - wp.length(q)
                slope = -wp.normalize(q)
            elif clip.kind == BOX:
                level, slope = nearest_face(-one, one, q)
            distance, normal = nearer(distance, normal, level, slope, to_index, clip.matrix, clip.invert)
        for n in range(clipping.volumes.shape[0]):
            volume = clipping.volumes[n]
            q = volume.matrix @ p + volume.offset
            level, slope = gradient(volume, q)
            distance, normal = nearer(distance, normal, level, slope, to_index, volume.matrix, volume.invert)
            # Its own box cuts too.
            level, slope = nearest_face(volume.low, volume.high, q)
            distance, normal = nearer(distance, normal, level, slope, to_index, volume.matrix, volume.invert)
        return normal

    return cut_normal
