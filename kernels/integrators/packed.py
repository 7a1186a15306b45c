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
from .cubics import Cubic, from_start, make_cubics
from .packet import make_packet
from .pieces import make_pieces
from .single import CELLS, LANES, make_single

# How far a ray may be astray for cells in single precision [index coordinates].
ASTRAY = 2.0**-23
# A cell may have so much of what its ray has left.
LEFT = 1 / 16


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
def make_packed(halves):
    """The march, as of ``scene``, without light; what it counts are cells and pieces, and it has a bound."""
    real = wp.float64
    Scene = halves.Scene
    double = make_double(halves)
    begin, stride, more = (make_strides if halves.march.ticks and halves.vectors else make_gathered)(CELLS)
    cubics = halves.field.cubics(halves.vectors, CELLS)
    measure, compose = make_packet() if halves.vectors else make_single()

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, d: wp.vec3d, start: real, end: real):
        one = real(1.0)
        clear = one - scene.opaque
        state = wp.zeros(shape=(16,), dtype=real)
        cells = wp.zeros(shape=(CELLS,), dtype=wp.uint64)
        times = wp.zeros(shape=(2, CELLS), dtype=real)
        cubic = wp.zeros(shape=(7, CELLS), dtype=wp.float32)
        found = wp.zeros(shape=(6, CELLS), dtype=wp.float32)
        row = wp.zeros(shape=(CELLS,), dtype=int)
        sums = wp.zeros(shape=(5,), dtype=real)
        spend = wp.vec3(wp.float32(scene.march.cell), wp.float32(scene.march.along), wp.float32(scene.march.brightest))
        count = int(0)
        done = int(0)
        n = int(0)
        T = one
        # Further than what single precision has room for (S1): all is in double, which counts it.
        astray = bool(False)
        if wp.static(halves.march.sharp):
            astray = scene.view.astray > real(ASTRAY)
        going = begin(scene.field.last, origin, d, start, end, state)
        while going and T >= clear:
            n = stride(scene.blocks, scene.march.octants, start, state, cells, times)
            going = more(state)
            bad = wp.uint64(0)
            if n > 0:
                cubics(scene.field, origin, d, cells, times, n, cubic)
                bad = measure(scene.march.rows, scene.blocks, spend, cells, n, cubic, found, row)
            if astray:
                bad = ~wp.uint64(0)
            done = int(0)
            while done < n and T >= clear:
                these = (bad >> wp.uint64(done)) & wp.uint64(wp.static(2**LANES - 1))
                # What the ray was allowed so far and has not spent.
                left = scene.march.cell * sums[3] + scene.march.along * (times[0, done] - start) - sums[4]
                left = real(0.999) * left / T
                if astray:
                    left = -FAR
                l = int(done)
                while these != wp.uint64(0) and l < n:
                    if (these & wp.uint64(1)) != wp.uint64(0):
                        share = scene.march.cell * real(found[1, l]) + scene.march.along * (times[1, l] - times[0, l])
                        over = real(found[4, l]) - share
                        if over <= real(LEFT) * left:
                            left -= over
                        else:
                            segment, error, pieces = double(scene, origin, d, cells[l], times[0, l], times[1, l])
                            count += pieces
                            A = wp.min(segment[3], one)
                            found[0, l] = depth_of(A)
                            found[1, l] = wp.float32(A)
                            found[2, l] = wp.float32(segment[0])
                            found[3, l] = wp.float32(segment[1])
                            found[4, l] = wp.float32(error)
                            found[5, l] = wp.float32(segment[2])
                            row[l] = -1
                    these = these >> wp.uint64(1)
                    l += 1
                compose(scene.march.rows, found, row, done, sums)
                done += LANES
                T = one - sums[3]
            count += wp.min(done, n)
        bound = sums[4] + sums[3] * scene.march.tinted + real(count) * scene.march.sum
        if going or done < n or (wp.static(halves.cuts.any) and T < clear):
            # What is behind is not visited; nor is, of a ray that is cut, what is behind this stretch.
            bound += wp.max(T, real(0.0)) * scene.march.brightest
        if scene.stretch == 0:
            # Of the ray as a whole.
            bound += scene.march.veiled
            if not wp.static(halves.march.sharp):
                bound += wp.max(scene.view.astray - scene.march.allowed, real(0.0)) * scene.march.astray
        return wp.vec4d(sums[0], sums[1], sums[2], sums[3]), count, bound

    return march
