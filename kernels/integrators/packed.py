"""The certified walk in packets: many cells of a ray at a time, in single precision with a bound on what that costs.

The next cells that have something to see are gathered and measured all together, and composed ``LANES`` at a time. A
cell whose bound exceeds its share is spent what the ray has left of the shares of those before, or, like one that no
row holds, integrated in double precision, cut where the scalar reaches control points, as ``certified`` does.
"""

from functools import cache

import warp as wp

from ..field.strides import make_gathered, make_strides
from ..ray import FAR
from ..transfer.function import make_transfer
from .crossings import JOBS, make_crossings
from .cubics import Cubic, from_start, make_cubics
from .packet import make_packet
from .pieces import make_pieces
from .single import CELLS, LANES, make_single

# How far a ray may be astray for cells in single precision [index coordinates].
ASTRAY = 2.0**-23
# A cell may have so much of what its ray has left.
LEFT = 1 / 16
# Rays at a time, where nothing cuts them.
RAYS = 16
# Memory of a thread [bytes].
SCRATCH = 1 << 17


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
                    here.blur = scene.march.ulps[0] * size
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
    """``march(scene, lines, results)`` of so many rays at a time, without light; what it counts are cells and pieces.

    ``lines`` (rays, 9) are the rays' origins, directions, starts and stops, and the transparencies at which they end;
    ``results`` (rays, 6) their colours, opacities, counts and bounds.
    """
    real = wp.float64
    Scene = halves.Scene
    sharp = halves.march.sharp
    double = make_double(halves)
    begin, stride, more = (make_strides if halves.march.ticks and halves.vectors else make_gathered)(CELLS)
    cubics = halves.field.cubics(halves.vectors, CELLS)
    measure, compose = make_packet() if halves.vectors else make_single()
    # What rounding does to a scalar beside jumps and on steep slopes is counted in double precision only.
    lanes = halves.vectors and not sharp
    centered = halves.field.centered_of(CELLS)
    cut = make_crossings()

    sizes = (160 * rays, 8 * CELLS * rays, 16 * CELLS * rays, 24 * CELLS * rays, 4 * CELLS * rays)
    sizes += (28 * CELLS, 64 + 4 * JOBS, 40 * JOBS)
    at = wp.constant(wp.types.vector(len(sizes), int)(*(sum(sizes[:n]) for n in range(len(sizes)))))
    assert sum(sizes) <= SCRATCH

    @wp.func
    def march(scene: Scene, lines: wp.array2d(dtype=real), results: wp.array2d(dtype=real)):
        one = real(1.0)
        # Of each ray its walk, the cells that it found, how many, and how many of those are composed.
        state = wp.array(ptr=scene.march.scratch + wp.uint64(at[0]), shape=(rays, 20), dtype=real)
        cells = wp.array(ptr=scene.march.scratch + wp.uint64(at[1]), shape=(rays, CELLS), dtype=wp.uint64)
        times = wp.array(ptr=scene.march.scratch + wp.uint64(at[2]), shape=(rays, 2, CELLS), dtype=real)
        found = wp.array(ptr=scene.march.scratch + wp.uint64(at[3]), shape=(rays, 6, CELLS), dtype=wp.float32)
        row = wp.array(ptr=scene.march.scratch + wp.uint64(at[4]), shape=(rays, CELLS), dtype=int)
        bad = wp.zeros(shape=(rays,), dtype=wp.uint64)
        sums = wp.zeros(shape=(rays, 5), dtype=real)
        number = wp.zeros(shape=(rays,), dtype=int)
        done = wp.zeros(shape=(rays,), dtype=int)
        going = wp.zeros(shape=(rays,), dtype=int)
        waiting = wp.zeros(shape=(rays,), dtype=int)
        counts = wp.zeros(shape=(rays,), dtype=int)
        cubic = wp.array(ptr=scene.march.scratch + wp.uint64(at[5]), shape=(7, CELLS), dtype=wp.float32)
        # And those that are cut.
        whose = wp.array(ptr=scene.march.scratch + wp.uint64(at[6]), shape=(1 + JOBS,), dtype=int)
        middle = wp.array(ptr=scene.march.scratch + wp.uint64(at[7]), shape=(5, JOBS), dtype=real)
        spend = wp.vec3(wp.float32(scene.march.cell), wp.float32(scene.march.along), wp.float32(scene.march.brightest))
        # Further than what single precision has room for (S1): all is in double, which counts it.
        astray = bool(False)
        if wp.static(sharp):
            astray = scene.view.astray > real(ASTRAY)
        last = int(rays)
        for r in range(last):
            if lines[r, 7] > lines[r, 6]:
                origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                d = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                if begin(scene.field.last, origin, d, lines[r, 6], lines[r, 7], state, r):
                    going[r] = 1
        m = int(1)
        while m > 0:
            # Each ray goes on until it has cells that are to be cut, or ends.
            m = int(0)
            for r in range(last):
                origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                d = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                n = done[r]
                end = number[r]
                T = one - sums[r, 3]
                clear = lines[r, 8]
                waits = bool(False)
                ready = bool(waiting[r] != 0)
                while T >= clear and not waits and (n < end or going[r] != 0):
                    if n >= end:
                        counts[r] = counts[r] + end
                        n = 0
                        end = stride(scene.blocks, scene.march.octants, lines[r, 6], state, cells, times, r)
                        going[r] = wp.where(more(state, r), 1, 0)
                        bad[r] = wp.uint64(0)
                        if end > 0:
                            cubics(scene.field, origin, d, cells, times, r, end, cubic)
                            some = wp.vec2i(r, end)
                            bad[r] = measure(scene.march.rows, scene.blocks, spend, cells, some, cubic, found, row)
                        if astray:
                            bad[r] = ~wp.uint64(0)
                    if n < end and not ready:
                        these = (bad[r] >> wp.uint64(n)) & wp.uint64(wp.static(2**LANES - 1))
                        if these != wp.uint64(0):
                            # What the ray was allowed so far and has not spent.
                            left = scene.march.cell * sums[r, 3] + scene.march.along * (times[r, 0, n] - lines[r, 6])
                            left = real(0.999) * (left - sums[r, 4]) / T
                            if astray:
                                left = -FAR
                            l = int(n)
                            while these != wp.uint64(0) and l < end:
                                if (these & wp.uint64(1)) != wp.uint64(0):
                                    long = times[r, 1, l] - times[r, 0, l]
                                    share = scene.march.cell * real(found[r, 1, l]) + scene.march.along * long
                                    over = real(found[r, 4, l]) - share
                                    if over <= real(LEFT) * left:
                                        left -= over
                                    else:
                                        m += 1
                                        whose[m] = r * CELLS + l
                                        waits = True
                                these = these >> wp.uint64(1)
                                l += 1
                    ready = bool(False)
                    if n < end and not waits:
                        compose(scene.march.rows, found, row, r, n, sums)
                        n += LANES
                        T = one - sums[r, 3]
                waiting[r] = wp.where(waits, 1, 0)
                done[r] = n
                number[r] = end
            whose[0] = m
            if wp.static(lanes):
                if m > 0:
                    centered(scene.field, lines, cells, times, whose, middle)
                    cut(scene.march.rows, scene.transfer, spend, middle, whose, found, row, counts)
            for i in range(whose[0]):
                r = whose[i + 1] // CELLS
                l = whose[i + 1] - r * CELLS
                origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                d = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                segment, error, pieces = double(scene, origin, d, cells[r, l], times[r, 0, l], times[r, 1, l])
                A = wp.min(segment[3], one)
                found[r, 0, l] = depth_of(A)
                found[r, 1, l] = wp.float32(A)
                found[r, 2, l] = wp.float32(segment[0])
                found[r, 3, l] = wp.float32(segment[1])
                found[r, 4, l] = wp.float32(error)
                found[r, 5, l] = wp.float32(segment[2])
                row[r, l] = -1
                counts[r] = counts[r] + pieces
        for r in range(last):
            T = one - sums[r, 3]
            counts[r] = counts[r] + wp.min(done[r], number[r])
            bound = sums[r, 4] + sums[r, 3] * scene.march.tinted + real(counts[r]) * scene.march.sum
            if going[r] != 0 or done[r] < number[r] or (wp.static(halves.cuts.any) and T < lines[r, 8]):
                # What is behind is not visited; nor is, of a ray that is cut, what is behind this stretch.
                bound += wp.max(T, real(0.0)) * scene.march.brightest
            if scene.stretch == 0:
                # Of the ray as a whole.
                bound += scene.march.veiled
                if not wp.static(sharp):
                    bound += wp.max(scene.view.astray - scene.march.allowed, real(0.0)) * scene.march.astray
            for a in range(4):
                results[r, a] = sums[r, a]
            results[r, 4] = real(counts[r])
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
        lines = wp.zeros(shape=(1, 9), dtype=real)
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
