"""The one walk of a ray through a grid: it enters at a cell, leaps over cubes of blocks, and gathers cells.

Indices are counted on from face to face, never computed from positions alone, which may round to either side of a face;
where a face is comes from its index, never by adding, so that rounding does not pile up. A walk ends where an index
leaves the grid. Nothing is ever read out of bounds.
"""

from functools import cache

import warp as wp

from ..precision import vec3_of
from .blocks import BITS, EMPTY, Blocks
from .samples import make_layered

# A leap of a march in float32 ends so much before a face, for the rounding of positions.
MARGIN = 1.0e-4
# Cells that are gathered at a time.
PACKET = 4
lanes = wp.types.vector(PACKET, wp.float64)


@wp.func
def ahead(t: wp.float64):
    """A point of a ray so little behind t that nothing is missed, but clear of the rounding of t: what holds there
    holds from t on [smallest voxel spacing].
    """
    return t + wp.max(wp.float64(1.0e-11), wp.float64(1.0e-14) * t)


@wp.func
def cell_at(last: wp.vec3i, p: wp.vec3d):
    """The cell, at most ``last``, that a point is in."""
    cell = wp.vec3i()
    for a in range(3):
        cell[a] = wp.clamp(int(p[a]), 0, last[a])
    return cell


@cache
def make_within(real):
    """``within(last, p)``: p, an end of a ray, or the nearest point of the box, as rounding may put it out of there,
    and scalars beyond those that there are may look like anything; ``layered``.
    """
    vec3 = vec3_of(real)
    layered = make_layered(real)

    @wp.func
    def within(last: wp.vec3i, p: vec3):
        for a in range(3):
            p[a] = wp.clamp(p[a], real(0.0), real(last[a] + 1))
        return layered(last, p)

    return within


@cache
def make_reached(real):
    """``reached(face, anchor, inverse)``: where a ray is at a face across an axis, by what a walk has of the axis."""

    @wp.func
    def reached(face: real, anchor: real, inverse: real):
        return (face - anchor) * inverse

    return reached


@cache
def make_walk(real):
    """The struct of a walk, and

    ``enter(last, origin, direction, t)`` -> a walk at t, in a grid up to the cell ``last``;
    ``leap(walk, bits, reach)`` -> the walk where it leaves the cube of blocks of ``1 << bits`` cells along each axis
    that are up to ``reach`` away from its own, in the cell behind; its t never falls;
    ``skip(kinds, walk, stop)`` -> the walk where a row of empty blocks ends that it is in, at most at ``stop``.
    """
    vec3 = vec3_of(real)
    far = 1.0e300 if real is wp.float64 else 1.0e30
    reached = make_reached(real)

    @wp.struct
    class Walk:
        origin: vec3
        direction: vec3
        anchor: vec3  # the ray is at a face at (face - anchor) inverse, never along an axis without faces to cross
        inverse: vec3
        last: wp.vec3i  # cell of the grid
        cell: wp.vec3i
        t: real
        out: real  # where it leaves the grid: computed as all faces are, so that no index is beyond the grid before

    @wp.func
    def enter(last: wp.vec3i, origin: vec3, direction: vec3, t: real):
        w = Walk()
        w.origin = origin
        w.direction = direction
        w.last = last
        w.t = t
        w.out = real(far)
        for a in range(3):
            w.cell[a] = wp.max(wp.min(int(origin[a] + t * direction[a]), last[a]), 0)
            w.anchor[a] = -real(far)
            w.inverse[a] = real(1.0)
            if direction[a] != real(0.0) and last[a] > 0:
                w.anchor[a] = origin[a]
                w.inverse[a] = real(1.0) / direction[a]
                face = wp.where(direction[a] > real(0.0), last[a] + 1, 0)
                w.out = wp.min(w.out, reached(real(face), origin[a], w.inverse[a]))
        return w

    @wp.func
    def landed(i: int, edge: int, passed: bool, way: real, place: real):
        """Index behind a leap from i along an axis: beyond the face ``edge`` if that was passed, else before it."""
        there = int(place)
        if way > real(0.0):
            return wp.where(passed, edge, wp.max(wp.min(there, edge - 1), i))
        return wp.where(passed, edge - 1, wp.min(wp.max(there, edge), i))

    @wp.func
    def leap(w: Walk, bits: int, reach: int):
        o = w.origin
        d = w.direction
        v = w.inverse
        i = w.cell[0]
        j = w.cell[1]
        k = w.cell[2]
        ex = wp.where(v[0] > real(0.0), (i >> bits) + reach + 1, (i >> bits) - reach) << bits
        ey = wp.where(v[1] > real(0.0), (j >> bits) + reach + 1, (j >> bits) - reach) << bits
        ez = wp.where(v[2] > real(0.0), (k >> bits) + reach + 1, (k >> bits) - reach) << bits
        tx = reached(real(ex), w.anchor[0], v[0])
        ty = reached(real(ey), w.anchor[1], v[1])
        tz = reached(real(ez), w.anchor[2], v[2])
        # Comparisons, since Warp's min also looks for NaN.
        end = wp.where(tx < ty, tx, ty)
        end = wp.where(tz < end, tz, end)
        t = wp.where(end > w.t, end, w.t)
        w.t = t
        # A ray in the box's upper face stays in the last cell.
        w.cell = wp.vec3i(
            wp.min(landed(i, ex, tx <= t, v[0], o[0] + t * d[0]), w.last[0]),
            wp.min(landed(j, ey, ty <= t, v[1], o[1] + t * d[1]), w.last[1]),
            wp.min(landed(k, ez, tz <= t, v[2], o[2] + t * d[2]), w.last[2]),
        )
        return w

    @wp.func
    def skip(kinds: wp.array3d(dtype=wp.int16), w: Walk, stop: real):
        going = bool(True)
        while going:
            kind = int(kinds[wp.max(w.cell[2], 0) >> BITS, wp.max(w.cell[1], 0) >> BITS, wp.max(w.cell[0], 0) >> BITS])
            going = kind <= EMPTY
            if going:
                w = leap(w, BITS, EMPTY - kind)
                if w.t >= stop or w.t >= w.out:
                    w.t = stop
                    going = False
        return w

    return Walk, enter, leap, skip


@cache
def make_unseen(real):
    """``unseen(kinds, last, origin, direction, length, step, i)``: of segments of a length ``step``, the first from i
    on that does not end in the row of empty blocks where segment i begins.
    """
    vec3 = vec3_of(real)
    _, enter, _, skip = make_walk(real)

    @wp.func
    def unseen(
        kinds: wp.array3d(dtype=wp.int16),
        last: wp.vec3i,
        origin: vec3,
        direction: vec3,
        length: real,
        step: real,
        i: int,
    ):
        end = skip(kinds, enter(last, origin, direction, real(i) * step), length).t
        if end >= length:
            return int(wp.ceil(length / step))
        return wp.max(int((end - real(wp.static(MARGIN))) / step), i)

    return unseen


@cache
def make_gather():
    """The struct of a packet and ``gather(blocks, walk, stop)`` -> (walk, packet): the next ``PACKET`` cells that have
    something to see, or fewer where the ray reaches ``stop``, which is not behind the walk's ``out``.
    """
    real = wp.float64
    Walk, _, leap, _ = make_walk(real)
    reached = make_reached(real)
    cells = wp.types.matrix((3, PACKET), int)
    numbers = wp.types.vector(PACKET, int)

    @wp.struct
    class Packet:
        count: int
        cell: cells
        kind: numbers  # of its block
        start: lanes
        length: lanes

    @wp.func
    def gather(blocks: Blocks, w: Walk, stop: real):
        found = Packet()
        n = int(0)
        # Of the walk in numbers of its own, which compilers keep at hand.
        v = w.inverse
        o = w.anchor
        i = w.cell[0]
        j = w.cell[1]
        k = w.cell[2]
        t = w.t
        sx = wp.where(v[0] > real(0.0), 1, -1)
        sy = wp.where(v[1] > real(0.0), 1, -1)
        sz = wp.where(v[2] > real(0.0), 1, -1)
        # The next faces, and where they are.
        fx = real(i + wp.max(sx, 0))
        fy = real(j + wp.max(sy, 0))
        fz = real(k + wp.max(sz, 0))
        nx = reached(fx, o[0], v[0])
        ny = reached(fy, o[1], v[1])
        nz = reached(fz, o[2], v[2])
        while n < PACKET and t < stop:
            mask = blocks.masks[wp.max(k, 0) >> BITS, wp.max(j, 0) >> BITS, wp.max(i, 0) >> BITS]
            if mask == wp.uint64(0):
                # A block that is not empty may have no cell to see either.
                kind = int(blocks.kinds[wp.max(k, 0) >> BITS, wp.max(j, 0) >> BITS, wp.max(i, 0) >> BITS])
                w.cell = wp.vec3i(i, j, k)
                w.t = t
                w = leap(w, BITS, wp.max(EMPTY - kind, 0))
                i = w.cell[0]
                j = w.cell[1]
                k = w.cell[2]
                t = w.t
                fx = real(i + wp.max(sx, 0))
                fy = real(j + wp.max(sy, 0))
                fz = real(k + wp.max(sz, 0))
                nx = reached(fx, o[0], v[0])
                ny = reached(fy, o[1], v[1])
                nz = reached(fz, o[2], v[2])
                continue
            # The nearest face; comparisons, since Warp's min also looks for NaN.
            end = wp.where(nx < ny, nx, ny)
            end = wp.where(nz < end, nz, end)
            end = wp.where(end > stop, stop, end)
            # A face that was passed already but for rounding.
            end = wp.where(end < t, t, end)
            bit = wp.uint64((k & 3) << 4 | (j & 3) << 2 | i & 3)
            if (mask >> bit) & wp.uint64(1) != wp.uint64(0):
                found.cell[0, n] = i
                found.cell[1, n] = j
                found.cell[2, n] = k
                found.kind[n] = int(blocks.kinds[wp.max(k, 0) >> BITS, wp.max(j, 0) >> BITS, wp.max(i, 0) >> BITS])
                found.start[n] = t
                found.length[n] = end - t
                n += 1
            t = end
            step_x = wp.where(nx <= end, sx, 0)
            step_y = wp.where(ny <= end, sy, 0)
            step_z = wp.where(nz <= end, sz, 0)
            i += step_x
            j += step_y
            k += step_z
            fx += real(step_x)
            fy += real(step_y)
            fz += real(step_z)
            nx = reached(fx, o[0], v[0])
            ny = reached(fy, o[1], v[1])
            nz = reached(fz, o[2], v[2])
        w.cell = wp.vec3i(i, j, k)
        w.t = t
        found.count = n
        return w, found

    return Packet, gather
