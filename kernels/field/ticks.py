"""The walk of one ray in whole numbers, as ``strides`` has it for many cells, with nothing in float64 along the way.

Where a ray is in a cell comes from how many ticks it is to the next faces, exact differences of whole numbers, so that
single precision will do (docs/proof-single.md, S16). GPUs have few units for float64, and plenty for this.
"""

from functools import cache

import warp as wp

from .blocks import BITS, EMPTY, Blocks, kind_at, mask_at

whole3 = wp.types.vector(3, wp.int64)


@wp.struct
class Ticks:
    """Where a ray is, in ticks, of which there are 2^52 to 2^53 to the farther end of its stretch, or in all of it."""

    t: wp.int64
    last: wp.int64  # in the cell where it crosses a face from here on, it ends
    end: wp.int64
    next: whole3  # when it crosses the next face along each axis
    gap: whole3  # and the one behind that, from there on
    cell: wp.vec3i
    place: wp.vec3  # so many ticks before the next face it is at place + rate ticks, from the cell's first corner
    rate: wp.vec3  # above 0 where the ray goes down along the axis
    drift: wp.vec3  # what ``place`` gains with a face
    tick: wp.float32  # a power of two
    blur: wp.float32  # how far faces may be from where they are, in parts of a cell along all axes


@wp.struct
class Passed:
    """A cell that a ray passed: where its middle is in it, half the length, and when it came and went."""

    start: wp.int64
    stop: wp.int64
    cell: wp.vec3i
    middle: wp.vec3
    h: wp.float32
    found: int


@wp.func
def narrowed(n: wp.int64):
    """Ticks in single precision, of their upper and lower half: GPUs have few units for larger conversions."""
    return wp.float32(wp.int32(n >> wp.int64(32))) * wp.float32(4294967296.0) + wp.float32(wp.uint32(n))


@cache
def make_ticks():
    """``enter(last, origin, d, start, end)`` -> ``Ticks``, at their end where there is nothing between start and end;
    ``pass_one(blocks, w)`` -> the walk behind the next cell that has something to see, and that cell.
    """

    @wp.func
    def enter(last: wp.vec3i, origin: wp.vec3d, d: wp.vec3d, start: wp.float64, end: wp.float64):
        w = Ticks()
        out = end
        for a in range(3):
            # Where the ray leaves the grid; comparisons are false for NaN.
            if d[a] != wp.float64(0.0) and last[a] > 0:
                face = wp.float64(wp.where(d[a] > wp.float64(0.0), last[a] + 1, 0))
                there = (face - origin[a]) / d[a]
                out = wp.where(there < out, there, out)
        length = out - start
        if length > wp.float64(0.0):
            # The power of two that makes it 2^52 ticks or more to the farther end, by the exponent, as of ``strides``.
            most = wp.max(length, wp.max(wp.abs(start), wp.abs(out)))
            exponent = (wp.cast(most, wp.int64) >> wp.int64(52)) & wp.int64(0x7FF)
            scale = wp.cast((wp.int64(2046 + 52) - wp.max(exponent, wp.int64(100))) << wp.int64(52), wp.float64)
            tick = wp.float64(1.0) / scale
            w.tick = wp.float32(tick)
            far = wp.float64(2.0) * length
            cells = int(6)
            for a in range(3):
                moves = d[a] != wp.float64(0.0) and last[a] > 0
                at = origin[a] + start * d[a]
                cell = wp.clamp(int(at), 0, last[a])
                w.cell[a] = cell
                way = wp.where(d[a] > wp.float64(0.0), wp.float64(1.0), wp.float64(-1.0))
                gap = far
                next = far
                if moves:
                    face = wp.float64(wp.where(d[a] > wp.float64(0.0), cell + 1, cell))
                    gap = wp.min(wp.float64(1.0) / wp.abs(d[a]), far)
                    next = wp.clamp((face - origin[a]) / d[a] - start, wp.float64(0.0), far)
                w.next[a] = wp.int64(next * scale)
                w.gap[a] = wp.int64(gap * scale)
                w.rate[a] = wp.float32(-d[a] * tick)
                if gap < far:
                    w.place[a] = wp.where(d[a] > wp.float64(0.0), wp.float32(1.0), wp.float32(0.0))
                else:
                    # Rays along faces: few of those are crossed, and far apart.
                    w.place[a] = wp.float32(at - wp.float64(cell) + d[a] * next)
                    w.drift[a] = wp.float32(d[a] * gap - way)
                cells += last[a]
            w.end = wp.int64(length * scale)
            w.last = w.end - wp.int64(4 * cells)
            w.blur = wp.float32(2.0001) * w.tick * wp.float32(cells)
        return w

    @wp.func
    def crossed(ticks: wp.int64, gap: wp.int64, rate: wp.float32):
        """Faces that are crossed in so many ticks from the first on: by a quotient that is off by one at most."""
        n = int(0)
        if ticks >= wp.int64(0):
            n = int(narrowed(ticks) * wp.abs(rate))
            rest = ticks - wp.int64(n) * gap
            n += wp.where(rest >= gap, 2, wp.where(rest < wp.int64(0), 0, 1))
        return n

    @wp.func
    def faces(i: int, rate: wp.float32, reach: int):
        """Faces along an axis to cross inside the cube of blocks that are up to ``reach`` away."""
        within = i & wp.static(2 ** int(BITS) - 1)
        return (reach << BITS) + wp.where(rate < wp.float32(0.0), wp.static(2 ** int(BITS) - 1) - within, within)

    @wp.func
    def leap(given: Ticks, reach: int):
        w = given
        e0 = w.next[0] + wp.int64(faces(w.cell[0], w.rate[0], reach)) * w.gap[0]
        e1 = w.next[1] + wp.int64(faces(w.cell[1], w.rate[1], reach)) * w.gap[1]
        e2 = w.next[2] + wp.int64(faces(w.cell[2], w.rate[2], reach)) * w.gap[2]
        leave = wp.min(e0, wp.min(e1, e2))
        if leave >= w.last:
            w.t = w.end
        else:
            w.t = leave
            for a in range(3):
                n = crossed(leave - w.next[a], w.gap[a], w.rate[a])
                w.next[a] += wp.int64(n) * w.gap[a]
                w.cell[a] += wp.where(w.rate[a] < wp.float32(0.0), n, -n)
                w.place[a] += wp.float32(n) * w.drift[a]
        return w

    @wp.func
    def pass_one(blocks: Blocks, given: Ticks):
        w = given
        found = Passed()
        while found.found == 0 and w.t < w.end:
            mask = mask_at(blocks, w.cell)
            if mask == wp.uint64(0):
                # A block that is not empty may have no cell to see either.
                w = leap(w, wp.max(EMPTY - kind_at(blocks, w.cell), 0))
                continue
            start = w.t
            stop = wp.min(w.next[0], wp.min(w.next[1], w.next[2]))
            ends = stop >= w.last
            leave = wp.where(ends, w.end, stop)
            bit = wp.uint64((w.cell[2] & 3) << 4 | (w.cell[1] & 3) << 2 | w.cell[0] & 3)
            if (mask >> bit) & wp.uint64(1) != wp.uint64(0):
                found.found = 1
                found.cell = w.cell
                found.start = start
                found.stop = leave
                for a in range(3):
                    # Twice the ticks from the middle to the face, a whole number.
                    twice = narrowed(wp.int64(2) * w.next[a] - (start + leave))
                    found.middle[a] = w.place[a] + (wp.float32(0.5) * twice) * w.rate[a]
            w.t = leave
            if not ends:
                for a in range(3):
                    if w.next[a] == stop:
                        w.next[a] += w.gap[a]
                        w.cell[a] += wp.where(w.rate[a] < wp.float32(0.0), 1, -1)
                        w.place[a] += w.drift[a]
        found.h = wp.float32(0.5) * narrowed(found.stop - found.start) * w.tick
        return w, found

    return enter, pass_one
