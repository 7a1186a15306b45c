"""Clips along a ray, in float64 and in index coordinates of the volume: which stretches they leave.

A clip volume is a field on a grid of its own, visible where it is at least ``iso``; along a ray it is a cubic in each
of its cells, and changes where the cubic crosses ``iso``. Several clips leave what all of them do.
"""

from functools import cache

import warp as wp

from ..field.blocks import BITS
from ..field.cell import SHORT, cubic, length_within, make_corners, rise, vec8d
from ..field.samples import make_value
from ..field.walk import ahead, cell_at, make_walk
from ..ray import FAR, inside, inverted, near_faces
from .shapes import Clip, make_shapes, nearest_face


@cache
def make_clipping(dtype):
    """The structs of a clip volume of ``dtype`` samples and of all clips of a scene."""
    Field, _ = make_corners(dtype)
    pair = wp.types.vector(2, dtype)

    @wp.struct
    class ClipVolume:
        """Visible where a field is at least ``iso`` or, inverted, elsewhere."""

        field: Field
        ranges: wp.array3d(dtype=pair)  # [z, y, x] of blocks
        iso: wp.float64
        invert: bool
        low: wp.vec3d  # its box, in its own index coordinates; outside the field is below iso
        high: wp.vec3d
        matrix: wp.mat33d  # from the index coordinates of the scene's volume to its own
        offset: wp.vec3d
        astray: wp.float64  # how far rounding may put a ray from where it should be, in its own index coordinates
        extent: wp.vec2d  # range and largest size of all samples
        tiny: wp.float64  # what the field along a ray is off by where numbers underflow

    @wp.struct
    class Clipping:
        shapes: wp.array(dtype=Clip)  # that cut rays
        volumes: wp.array(dtype=ClipVolume)
        naive_shapes: wp.array(dtype=Clip)  # that leave out samples
        naive_volumes: wp.array(dtype=ClipVolume)
        partial_volumes: wp.array(dtype=ClipVolume)  # that cut segments

    return ClipVolume, Clipping


@wp.func
def blurred(span: wp.float64, size: wp.float64, astray: wp.float64):
    """What a field along a ray may be off by where samples are in a ``span`` and up to a ``size``, and the ray is
    astray by so much in the field's index coordinates (docs/proof.md, lemma 11).
    """
    return span * (wp.float64(3.0) * astray + wp.float64(wp.static(2.0**-45))) + size * wp.float64(wp.static(2.0**-49))


@cache
def make_clip_span(kinds, dtype, bounded=False):
    """``clip_span(clipping, origin, direction, t, length)``: whether a ray is visible from t on, and until where; and
    ``bounded``, on how much of that rounding may decide but for what ``near_surfaces`` has.
    """
    ClipVolume, Clipping = make_clipping(dtype)
    _, corners = make_corners(dtype)
    _, enter, leap, _ = make_walk(wp.float64)
    stretch_inside, *_ = make_shapes(kinds)

    @wp.func
    def loose_in(
        clip: ClipVolume,
        cell: wp.vec3i,
        bits: int,
        level: wp.vec4d,
        span: wp.vec2d,
        origin: wp.vec3d,
        direction: wp.vec3d,
        stretch: wp.vec2d,
    ):
        """How much is loose at most of a stretch of ray in a cell, or a block of ``1 << bits`` along each axis, whose
        samples are in a ``span`` and where the field less iso is the cubic ``level``: what is near enough to iso for
        the cell itself, and what is near the faces to others.
        """
        size = wp.float64(1 << bits)
        low = wp.vec3d(wp.float64(cell[0]), wp.float64(cell[1]), wp.float64(cell[2]))
        high = low + wp.vec3d(size, size, size)
        for a in range(3):
            if clip.field.last[a] == 0:
                # One layer of cells has no faces inside the box.
                low[a] -= size
                high[a] += size
        loose = near_faces(low, high, origin, inverted(direction), clip.astray, stretch[0], stretch[1])
        if span[0] < span[1]:
            most = wp.max(wp.abs(span[0]), wp.abs(span[1]))
            blur = blurred(span[1] - span[0], most, clip.astray) + clip.tiny
            loose += length_within(level, stretch[1] - stretch[0], blur)
        return loose

    @wp.func
    def volume_span(clip: ClipVolume, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64):
        """Whether the field is at least iso from t on, until where that is known not to change, and how much of that
        is loose but for the box's faces.
        """
        loose = wp.float64(0.0)
        blur = wp.float64(0.0)
        if wp.static(bounded):
            blur = blurred(clip.extent[0], clip.extent[1], clip.astray) + clip.tiny
        o = clip.matrix @ origin + clip.offset
        d = clip.matrix @ direction
        near, far = inside(clip.low, clip.high, o, inverted(d), -FAR, FAR)
        here = ahead(t)
        if here >= far or near >= far:
            return False, FAR, loose
        if here < near:
            return False, near, loose
        above = bool(False)
        known = bool(False)
        w = enter(clip.field.last, o, d, here)
        while w.t < far and w.t < length:
            i = wp.max(w.cell[0], 0)
            j = wp.max(w.cell[1], 0)
            k = wp.max(w.cell[2], 0)
            span = clip.ranges[k >> BITS, j >> BITS, i >> BITS]
            low = wp.float64(span[0])
            high = wp.float64(span[1])
            bits = int(BITS)
            c = vec8d()
            if low < high and low - blur < clip.iso and high + blur >= clip.iso:
                bits = 0
                c = corners(clip.field, i, j, k)
                low = wp.min(c)
                high = wp.max(c)
            after = leap(w, bits, 0)
            # The outermost cells end with the box.
            after.t = wp.where(after.t >= w.out, far, wp.min(after.t, far))
            if after.t > w.t:
                level = wp.vec4d()
                if low - blur < clip.iso and high + blur >= clip.iso:
                    corner = wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k))
                    level = cubic(c, o + w.t * d - corner, d)
                    level[0] -= clip.iso
                    if wp.static(bounded):
                        # What is near enough to iso for any cell or, if that is long, for this one and at its faces.
                        near_iso = after.t - w.t
                        if low < high:
                            near_iso = length_within(level, after.t - w.t, blur)
                        if near_iso > wp.float64(SHORT) * (after.t - w.t):
                            # A block of equal samples is as large as it is.
                            cells = wp.vec3i(i >> bits << bits, j >> bits << bits, k >> bits << bits)
                            span_of = wp.vec2d(low, high)
                            stretch = wp.vec2d(w.t, after.t)
                            near_iso = wp.min(near_iso, loose_in(clip, cells, bits, level, span_of, o, d, stretch))
                        loose += near_iso
                if low >= clip.iso or high < clip.iso:
                    if known and above != (low >= clip.iso):
                        return above, w.t, loose
                    above = low >= clip.iso
                else:
                    if not known:
                        above = level[0] >= wp.float64(0.0)
                    # Beyond rounding: a ray in the surface would change sides without end.
                    level = wp.where(above, -level, level)
                    level[0] -= blurred(high - low, wp.max(wp.abs(low), wp.abs(high)), wp.float64(0.0)) + clip.tiny
                    u = rise(level, after.t - w.t)
                    if u < after.t - w.t:
                        return above, w.t + u, loose
                known = True
            w = after
        return above, w.t, loose

    @wp.func
    def clip_span(clipping: Clipping, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64):
        # Visible until the first of all clips ends; else at least until the last of those that hide it does.
        visible = bool(True)
        until = length
        loose = wp.float64(0.0)
        for n in range(clipping.shapes.shape[0] + clipping.volumes.shape[0]):
            shown = bool(False)
            end = FAR
            if n < clipping.shapes.shape[0]:
                clip = clipping.shapes[n]
                near, far = stretch_inside(clip, origin, direction)
                here = ahead(t)
                within = here >= near and here < far
                if within:
                    end = far
                elif here < near and near < far:
                    end = near
                shown = within != clip.invert
            else:
                volume = clipping.volumes[n - clipping.shapes.shape[0]]
                known, changes, unsure = volume_span(volume, origin, direction, t, length)
                loose += unsure
                shown = known != volume.invert
                end = changes
            if shown:
                if visible:
                    until = wp.min(until, end)
            else:
                until = wp.where(visible, end, wp.max(until, end))
                visible = False
        return visible, wp.min(until, length), loose

    return clip_span


@cache
def make_near_surfaces(kinds, dtype):
    """``near_surfaces(clipping, origin, direction, start, stop)``: length of a ray that is so near to surfaces of
    shapes and to faces of clip volumes' boxes that rounding may put it on either side (docs/proof.md, lemma 11).
    """
    _, Clipping = make_clipping(dtype)
    _, near_surface, _, _ = make_shapes(kinds)

    @wp.func
    def near_surfaces(clipping: Clipping, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64):
        length = wp.float64(0.0)
        for n in range(clipping.shapes.shape[0]):
            length += near_surface(clipping.shapes[n], origin, direction, start, stop)
        for n in range(clipping.volumes.shape[0]):
            clip = clipping.volumes[n]
            o = clip.matrix @ origin + clip.offset
            inverse = inverted(clip.matrix @ direction)
            length += near_faces(clip.low, clip.high, o, inverse, clip.astray, start, stop)
        return length

    return near_surfaces


@cache
def make_shown(kinds, dtype):
    """``shown(clipping, p)``: whether a point is visible to the naive clips."""
    _, Clipping = make_clipping(dtype)
    value = make_value(dtype, wp.float64)
    *_, is_inside, _ = make_shapes(kinds)

    @wp.func
    def shown(clipping: Clipping, p: wp.vec3d):
        for n in range(clipping.naive_shapes.shape[0]):
            clip = clipping.naive_shapes[n]
            if is_inside(clip, p) == clip.invert:
                return False
        for n in range(clipping.naive_volumes.shape[0]):
            volume = clipping.naive_volumes[n]
            q = volume.matrix @ p + volume.offset
            above = bool(True)
            for a in range(3):
                above = above and q[a] >= volume.low[a] and q[a] <= volume.high[a]
            if above:
                above = value(volume.field, q) >= volume.iso
            if above == volume.invert:
                return False
        return True

    return shown


@cache
def make_cut_normal(kinds, dtype):
    """``cut_normal(clipping, to_index, p, reach)``: of the surface that a ray is cut by at point p, the unit normal in
    the world, towards what is cut away; zero without any within ``reach``. ``to_index`` is that of ``ray.View``.
    """
    ClipVolume, Clipping = make_clipping(dtype)
    _, corners = make_corners(dtype)
    *_, surface_of = make_shapes(kinds)

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
        for n in range(clipping.shapes.shape[0]):
            clip = clipping.shapes[n]
            level, slope = surface_of(clip, p)
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
