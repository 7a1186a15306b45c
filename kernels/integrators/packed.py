"""The certified walk in packets: many cells of a ray at a time, in single precision with a bound on what that costs.

The next cells that have something to see are gathered and measured all together, and composed ``LANES`` at a time. A
cell whose bound exceeds its share is spent what the ray has left of the shares of those before, or, like one that no
row holds, integrated in double precision, cut where the scalar reaches control points, as ``certified`` does.
"""

from functools import cache

import warp as wp

from ..field.abreast import LANES as ABREAST
from ..field.abreast import make_abreast
from ..field.cell import DENORMAL
from ..field.cubics import make_placed
from ..field.gradients import ROWS
from ..field.strides import STATE, Rays, make_each
from ..transfer.function import make_transfer
from .crossings import make_crossings
from .cubics import from_start, make_cubics
from .lit import CELLS as LIT_CELLS
from .lit import CUT, JOBS, PLACES, Task, in_lanes
from .lit import SCRATCH as LIT_SCRATCH
from .packet import make_packet
from .pieces import make_pieces
from .shone import Cubic
from .single import CELLS, LANES, make_single

# How far a ray may be astray for cells in single precision [index coordinates].
ASTRAY = 2.0**-23
# Rays at a time, where nothing cuts them.
RAYS = 16
# Memory of a thread [bytes].
SCRATCH = 3 << 16


@cache
def make_double(halves):
    """``double(scene, origin, d, place, start, stop)`` -> segment of a cell in double precision, a bound on its error,
    and the number of its pieces.
    """
    sharp = halves.march.sharp
    finite = halves.field.finite
    real = wp.float64
    Scene = halves.Scene
    centered = halves.field.centered()
    extent = halves.field.extent()
    _, interval, _ = make_transfer(real)
    _, cut = make_pieces(halves)
    linear, crossing = make_cubics(halves)

    @wp.func
    def double(scene: Scene, origin: wp.vec3d, d: wp.vec3d, place: wp.uint64, start: real, stop: real):
        i = int(place & wp.uint64(0x1FFFFF))
        j = int((place >> wp.uint64(21)) & wp.uint64(0x1FFFFF))
        k = int((place >> wp.uint64(42)) & wp.uint64(0x1FFFFF))
        h = real(0.5) * (stop - start)
        here = Cubic()
        here.middle = origin + (start + h) * d
        here.d = d
        here.length = stop - start
        if wp.static(in_lanes(halves)):
            cell = wp.array(ptr=scene.march.scratch + wp.uint64(wp.static(PLACES[0])), shape=(4,), dtype=real)
            for a in range(3):
                cell[a] = here.middle[a]
            cell[3] = h
        p = here.middle - wp.vec3d(real(i), real(j), real(k))
        m = centered(scene.field, i, j, k, p, d, h)
        here.m = m
        here.T = real(1.0)
        # Rounding of a scalar, and that of the place that it is taken at.
        here.blur = scene.march.blur
        if wp.static(sharp):
            here.blur += scene.view.astray * scene.march.astray
        segment = wp.vec4d()
        error = real(0.0)
        pieces = int(0)
        known = here.length > real(0.0)
        if not wp.static(finite):
            known = known and wp.isfinite(wp.abs(m[0]) + wp.abs(m[1]) + wp.abs(m[2]) + wp.abs(m[3]))
        if known:
            kind = int(scene.blocks.kinds[wp.max(k, 0) >> 2, wp.max(j, 0) >> 2, wp.max(i, 0) >> 2])
            if wp.static(sharp):
                flat = m[1] == real(0.0) and m[2] == real(0.0) and m[3] == real(0.0)
                if scene.march.local or flat:
                    low, high = extent(scene.field, i, j, k)
                    size = wp.where(high > -low, high, -low)
                    here.blur = scene.march.ulps[0] * size + DENORMAL
                    here.blur += (scene.march.ulps[1] + real(3.0) * scene.view.astray) * (high - low)
                    if low == high:
                        # Where all corners are equal nothing is rounded.
                        here.blur = real(0.0)
                        kind = interval(scene.transfer, low)
            if kind >= 0:
                segment, error = linear(scene, here, kind)
                pieces = 1
            elif wp.abs(m[1]) > real(4.0) * wp.abs(m[2]) + real(6.0) * wp.abs(m[3]):
                segment, error, pieces = crossing(scene, here)
            else:
                segment, error, pieces = cut(scene, from_start(here))
        return segment, error, pieces

    return double


@wp.func
def depth_of(A: wp.float64):
    """Optical depth of an opacity, to single precision."""
    x = wp.float32(100.0)
    if A < wp.float64(0.25):
        # 2 artanh(A / (2 - A)).
        z = A / (wp.float64(2.0) - A)
        y = z * z
        x9 = wp.float64(wp.static(1.0 / 7.0)) + y * wp.float64(wp.static(1.0 / 9.0))
        x5 = wp.float64(wp.static(1.0 / 3.0)) + y * (wp.float64(0.2) + y * x9)
        x = wp.float32(wp.float64(2.0) * z * (wp.float64(1.0) + y * x5))
    elif A < wp.float64(1.0):
        x = -wp.log(wp.float32(wp.float64(1.0) - A))
    return x


@cache
def make_rays(halves, rays):
    """``march(scene, lines, results)`` of so many rays at a time; what it counts are cells and pieces.

    ``lines`` (rays, 10) are the rays' origins, directions, starts and stops, the transparencies at which they end, and
    what they were allowed in front of that and have not spent; ``results`` (rays, 6) their colours, opacities, counts
    and bounds.
    """
    real = wp.float64
    Scene = halves.Scene
    sharp = halves.march.sharp
    double = make_double(halves)
    ticks = halves.march.ticks and halves.vectors
    begin, stride = make_abreast(CELLS) if ticks and rays == ABREAST else make_each(CELLS, ticks)
    lighted = in_lanes(halves)
    placed = make_placed(halves.vectors)
    cubics = halves.field.cubics(halves.vectors, CELLS)
    measure, compose = make_packet(lighted) if halves.vectors else make_single()
    centered = halves.field.centered_of()
    cut = make_crossings(lighted, halves.cuts.clipped)
    gradients = halves.field.gradients(halves.light.gradient) if lighted else None
    room = rays * CELLS + LANES

    sizes = (8 * STATE * rays, 8 * room, 16 * room, 28 * room, 24 * room, 4 * room, 28 * CELLS, 8 + 8 * JOBS, 48 * JOBS)
    sizes += (8 + 8 * LANES, 16 * rays, 40 * rays)
    places = [LIT_SCRATCH + sum(sizes[:n]) for n in range(len(sizes) + 1)]
    at = wp.constant(wp.types.vector(len(places), int)(*places))
    assert places[-1] <= SCRATCH

    @wp.func
    def march(scene: Scene, lines: wp.array2d(dtype=real), results: wp.array2d(dtype=real)):
        one = real(1.0)
        these = Rays()
        these.lines = lines
        these.state = wp.array(ptr=scene.march.scratch + wp.uint64(at[0]), shape=(rays, STATE), dtype=real)
        numbers = scene.march.scratch + wp.uint64(at[10])
        these.going = wp.array(ptr=numbers, shape=(rays,), dtype=int)
        these.first = wp.array(ptr=numbers + wp.uint64(4 * rays), shape=(rays,), dtype=int)
        these.last = wp.array(ptr=numbers + wp.uint64(8 * rays), shape=(rays,), dtype=int)
        these.count = wp.array(ptr=numbers + wp.uint64(12 * rays), shape=(rays,), dtype=int)
        these.sums = wp.array(ptr=scene.march.scratch + wp.uint64(at[11]), shape=(rays, 5), dtype=real)
        # Cells of all rays, one behind the other.
        cells = wp.array(ptr=scene.march.scratch + wp.uint64(at[1]), shape=(room,), dtype=wp.uint64)
        times = wp.array(ptr=scene.march.scratch + wp.uint64(at[2]), shape=(2, room), dtype=real)
        where = wp.array(ptr=scene.march.scratch + wp.uint64(at[3]), shape=(7, room), dtype=wp.float32)
        found = wp.array(ptr=scene.march.scratch + wp.uint64(at[4]), shape=(6, room), dtype=wp.float32)
        row = wp.array(ptr=scene.march.scratch + wp.uint64(at[5]), shape=(room,), dtype=int)
        cubic = wp.array(ptr=scene.march.scratch + wp.uint64(at[6]), shape=(7, CELLS), dtype=wp.float32)
        # And those that are cut.
        which = wp.array(ptr=scene.march.scratch + wp.uint64(at[7]), shape=(2, 1 + JOBS), dtype=int)
        middle = wp.array(ptr=scene.march.scratch + wp.uint64(at[8]), shape=(6, JOBS), dtype=real)
        if wp.static(lighted):
            next = wp.array(ptr=scene.march.scratch + wp.uint64(at[9]), shape=(2, 1 + LANES), dtype=int)
            to_world = scene.light.shading.to_world
            ahead = scene.light.shading.ahead
            task = Task()
            task.cubic = middle
            task.which = which
            task.found = found
            task.row = row
            task.pieces = these.count
            task.gradient = wp.array(
                ptr=scene.march.scratch + wp.uint64(wp.static(PLACES[2])), shape=(ROWS, JOBS), dtype=wp.float32
            )
            task.numbers = wp.array(
                ptr=scene.march.scratch + wp.uint64(wp.static(PLACES[1])), shape=(24,), dtype=wp.float32
            )
            task.tolerance = wp.float32(scene.march.tolerance)
        spend = wp.vec3(wp.float32(scene.march.cell), wp.float32(scene.march.along), wp.float32(scene.march.brightest))
        # Further than what single precision has room for (S1): all is cut or in double, which counts it.
        astray = bool(False)
        # Rounding of a scalar and of the place that it is taken at, where it does not count for the ray as a whole.
        ulps = wp.vec2d()
        if wp.static(sharp):
            ulps = wp.vec2d(scene.march.ulps[0], scene.march.ulps[1] + real(3.0) * scene.view.astray)
            astray = scene.view.astray > real(ASTRAY)
        last = int(rays)
        for r in range(last):
            these.count[r] = 0
            # A ray of which nothing is left has nothing to spend either.
            lines[r, 8] = wp.max(lines[r, 8], real(1.0e-300))
            for a in range(5):
                these.sums[r, a] = real(0.0)
        begin(scene.field.last, these)
        total = int(1)
        while total > 0:
            # The next cells of all rays that go on.
            total = stride(scene.blocks, scene.march.octants, these, cells, times)
            for r in range(last):
                n = these.last[r] - these.first[r]
                if n > 0:
                    origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                    d = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                    placed(origin, d, cells, times, these.first[r], n, where)
            for first in range(0, total, CELLS):
                n = wp.min(total - first, CELLS)
                cubics(scene.field, cells, where, first, n, cubic)
                measure(scene.march.rows, scene.blocks, spend, cells, wp.vec2i(first, n), cubic, found, row)
            if astray:
                for l in range(total):
                    row[l] = wp.min(row[l], -2 - row[l])
            m = int(1)
            while m > 0:
                # Each goes on until some of its next cells are to be cut.
                if wp.static(lighted):
                    for r in range(last):
                        n = these.first[r]
                        until = wp.min(n + LANES, these.last[r])
                        if one - these.sums[r, 3] >= lines[r, 8]:
                            bare = bool(False)
                            for l in range(n, until):
                                bare = bare or row[l] >= 0
                                next[0, 1 + l - n] = l
                                next[1, 1 + l - n] = r
                            if bare:
                                next[0, 0] = until - n
                                gradients(scene.field, to_world, ahead, lines, cells, times, next, task.gradient)
                                task.what = wp.static(LIT_CELLS)
                                task.clear = wp.float32(one - these.sums[r, 3])
                                task.first = n
                                task.count = until - n
                                cut(scene.march.rows, scene.transfer, spend, scene.light, task)
                m = compose(scene.march.rows, these, times, found, row, spend, astray, which)
                if wp.static(halves.vectors):
                    if m > 0:
                        centered(scene.field, lines, cells, times, which, ulps, middle)
                        if wp.static(lighted):
                            gradients(scene.field, to_world, ahead, lines, cells, times, which, task.gradient)
                            task.what = wp.static(CUT)
                            cut(scene.march.rows, scene.transfer, spend, scene.light, task)
                        else:
                            cut(scene.march.rows, scene.transfer, spend, middle, which, found, row, these.count)
                for i in range(which[0, 0]):
                    l = which[0, i + 1]
                    r = which[1, i + 1]
                    origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                    d = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                    if wp.static(lighted):
                        next[0, 0] = 1
                        next[0, 1] = l
                        next[1, 1] = r
                        gradients(scene.field, to_world, ahead, lines, cells, times, next, task.gradient)
                    segment, error, pieces = double(scene, origin, d, cells[l], times[0, l], times[1, l])
                    A = wp.min(segment[3], one)
                    found[0, l] = depth_of(A)
                    found[1, l] = wp.float32(A)
                    found[2, l] = wp.float32(segment[0])
                    found[3, l] = wp.float32(segment[1])
                    found[4, l] = wp.float32(error)
                    found[5, l] = wp.float32(segment[2])
                    row[l] = -1
                    these.count[r] = these.count[r] + pieces
                if wp.static(lighted):
                    # And those of which the next cells have no light yet.
                    for r in range(last):
                        if these.first[r] < these.last[r] and one - these.sums[r, 3] >= lines[r, 8]:
                            m += 1
        for r in range(last):
            T = one - these.sums[r, 3]
            bound = these.sums[r, 4] + these.sums[r, 3] * scene.march.tinted + real(these.count[r]) * scene.march.sum
            if these.going[r] != 0 or (wp.static(halves.cuts.any or halves.brick) and T < lines[r, 8]):
                # What is behind is not visited; nor is, of a ray that is cut, what is behind this stretch or brick.
                bound += wp.max(T, real(0.0)) * scene.march.brightest
            if scene.stretch == 0:
                # Of the ray as a whole.
                bound += scene.march.veiled
                if not wp.static(sharp):
                    bound += wp.max(scene.view.astray - scene.march.allowed, real(0.0)) * scene.march.astray
            for a in range(4):
                results[r, a] = these.sums[r, a]
            results[r, 4] = real(these.count[r])
            results[r, 5] = bound

    return march


@cache
def make_packed(halves):
    """The march of one ray, as of ``scene``."""
    real = wp.float64
    Scene = halves.Scene
    rays = make_rays(halves, 1)

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, d: wp.vec3d, start: real, end: real):
        lines = wp.zeros(shape=(1, 10), dtype=real)
        results = wp.zeros(shape=(1, 6), dtype=real)
        for a in range(3):
            lines[0, a] = origin[a]
            lines[0, 3 + a] = d[a]
        lines[0, 6] = start
        lines[0, 7] = end
        lines[0, 8] = real(1.0) - scene.opaque
        rays(scene, lines, results)
        color = wp.vec4d(results[0, 0], results[0, 1], results[0, 2], results[0, 3])
        return color, int(results[0, 4]), results[0, 5]

    return march
