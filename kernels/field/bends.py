"""How long a segment may be in each cube of cells, which is of several blocks so that steps may be longer.

How far the scalar along a ray is from its chord over a step of length h inside a cube: in a cell its second derivative
is made of mixed differences alone, at most ``curve``; at each face of cells its slope jumps by the second difference
across it. A kink at u adds u (h - u) / 2 <= h^2 / 8 to the integral of the deviation, and kinks a length w apart
h^3 / 12w + h^2 / 8 in all, because what they add has one maximum. With the directions' worst case, the integral is at
most ``bend[0] h^2 / 8 + bend[1] h^3 / 12``.
"""

from functools import cache

import warp as wp

from ..transfer.function import make_transfer
from .blocks import BITS, unravel
from .cell import vec8d
from .samples import make_samples

# Cells along an axis of a cube, as a power of two.
CUBE = wp.constant(3)
MORE = wp.constant(int(CUBE) - int(BITS))


def cubes(shape):
    """Number of cubes along each axis of samples of a ``shape``, two or more along each."""
    return tuple(-(-(n - 1) // (1 << int(CUBE))) for n in shape)


@cache
def make_bends(dtype):
    """Kernel ``(base, field, scale, bends)`` over cubes: how far the field may be from linear along any ray in it.

    ``scale`` is the length unit over the spacing of each axis. A bend is (kinks, curve and kinks per length); a cube
    with an absent cell bends without limit, so that steps in it find where the data end.
    """
    Field = make_samples(dtype)

    @wp.func
    def sample(data: wp.array3d(dtype=dtype), k: int, j: int, i: int):
        return wp.float64(data[k, j, i])

    @wp.func
    def larger(most: wp.float64, difference: wp.float64):
        # Comparisons, since Warp's max also looks for NaN.
        size = wp.abs(difference)
        return wp.where(size > most, size, most)

    @wp.kernel(enable_backward=False, module="unique")
    def bends(base: int, field: Field, scale: wp.vec3d, result: wp.array3d(dtype=wp.vec2d)):
        data = field.data
        ck, cj, ci = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        k0 = wp.max(ck << CUBE, 0)
        j0 = wp.max(cj << CUBE, 0)
        i0 = wp.max(ci << CUBE, 0)
        sx = wp.float64(0.0)
        sy = wp.float64(0.0)
        sz = wp.float64(0.0)
        yz = wp.float64(0.0)
        xz = wp.float64(0.0)
        xy = wp.float64(0.0)
        total = wp.float64(0.0)
        # Differences of samples of this cube only: steps end where the cube ends.
        k1 = wp.min(k0 + (1 << CUBE), data.shape[0] - 1)
        j1 = wp.min(j0 + (1 << CUBE), data.shape[1] - 1)
        i1 = wp.min(i0 + (1 << CUBE), data.shape[2] - 1)
        for k in range(k0, k1 + 1):
            ka = wp.min(k + 1, k1)
            kb = wp.min(k + 2, k1)
            for j in range(j0, j1 + 1):
                ja = wp.min(j + 1, j1)
                jb = wp.min(j + 2, j1)
                s = sample(data, k, j, i0)
                y = sample(data, k, ja, i0)
                z = sample(data, ka, j, i0)
                # Along the row: this sample, the one behind, and its neighbours across.
                before = wp.float64(0.0)
                for i in range(i0, i1 + 1):
                    ia = wp.min(i + 1, i1)
                    next_s = sample(data, k, j, ia)
                    next_y = sample(data, k, ja, ia)
                    next_z = sample(data, ka, j, ia)
                    total += s - s
                    dx = next_s - s
                    dy = y - s
                    dz = z - s
                    xy = larger(xy, next_y - y - dx)
                    xz = larger(xz, next_z - z - dx)
                    yz = larger(yz, sample(data, ka, ja, i) - z - dy)
                    if i > i0 and i < i1:
                        sx = larger(sx, dx - before)
                    if j + 1 < j1:
                        sy = larger(sy, sample(data, k, jb, i) - y - dy)
                    if k + 1 < k1:
                        sz = larger(sz, sample(data, kb, j, i) - z - dz)
                    before = dx
                    s = next_s
                    y = next_y
                    z = next_z
        second = wp.vec3d(sx, sy, sz)
        mixed = wp.vec3d(yz, xz, xy)
        # A sample that is not finite is not its own equal, nor is what it is added to.
        present = total == wp.float64(0.0)
        bend = wp.vec2d(wp.float64(wp.inf), wp.float64(wp.inf))
        if present:
            # s'' is the quadratic form of a matrix without diagonal; its largest eigenvalue is at most sqrt(4/3) of
            # the norm of its three entries.
            form = wp.cw_mul(mixed, wp.vec3d(scale[1] * scale[2], scale[0] * scale[2], scale[0] * scale[1]))
            curve = wp.sqrt(wp.float64(wp.static(4.0 / 3.0))) * wp.length(form)
            jumps = wp.cw_mul(scale, second)
            bend = wp.vec2d(wp.length(jumps), curve + wp.max(wp.cw_mul(scale, jumps)))
        result[ck, cj, ci] = bend

    return bends


@cache
def make_distances(dtype, real):
    """Kernel ``(base, ranges, bends, shift, tf, maxima, tolerance, distances)`` over rows of cubes along x: how long a
    step may be, by the ranges of blocks.

    The longest over which two errors together are within the tolerance: that of optical depth and colour because the
    scalar is not linear, and that of colour because attenuation inside the step is taken to be even, at most
    depth^2 / 8 of the colours' range. Infinite where there is neither. ``maxima`` is that of the host's
    ``range_maxima``.
    """
    Transfer, interval, _ = make_transfer(real)
    pair = wp.types.vector(2, dtype)

    @wp.func
    def largest(maxima: wp.array2d(dtype=vec8d), first: int, last: int):
        """Largest of the entries first .. last: two rows of a power of two cover them."""
        level = int(0)
        while (2 << level) <= last - first + 1:
            level += 1
        return wp.max(maxima[level, first], maxima[level, last + 1 - (1 << level)])

    @wp.func
    def range_of(ranges: wp.array3d(dtype=pair), ck: int, cj: int, ci: int):
        """Smallest and largest of the blocks of a cube, the wrong way round if there is none."""
        span = pair(dtype(1), dtype(0))
        for bk in range(ck << MORE, wp.min((ck + 1) << MORE, ranges.shape[0])):
            for bj in range(cj << MORE, wp.min((cj + 1) << MORE, ranges.shape[1])):
                for bi in range(ci << MORE, wp.min((ci + 1) << MORE, ranges.shape[2])):
                    one = ranges[bk, bj, bi]
                    if one[0] <= one[1]:
                        known = span[0] <= span[1]
                        span[0] = wp.where(known and span[0] < one[0], span[0], one[0])
                        span[1] = wp.where(known and span[1] > one[1], span[1], one[1])
        return span

    @wp.kernel(enable_backward=False, module="unique")
    def distances(
        base: int,
        ranges: wp.array3d(dtype=pair),
        bends: wp.array3d(dtype=wp.vec2d),
        shift: wp.float64,
        tf: Transfer,
        maxima: wp.array2d(dtype=vec8d),
        tolerance: wp.float64,
        result: wp.array3d(dtype=wp.float32),
    ):
        item = wp.tid() + base
        ck = item // result.shape[1]
        cj = item - ck * result.shape[1]
        for ci in range(result.shape[2]):
            span = range_of(ranges, ck, cj, ci)
            bend = bends[ck, cj, ci]
            # The error is at most a h^2 + b h^3.
            a = wp.float64(0.0)
            b = wp.float64(0.0)
            if span[0] <= span[1]:
                low = real(wp.float64(span[0]) - shift)
                high = real(wp.float64(span[1]) - shift)
                most = largest(maxima, interval(tf, low), interval(tf, high))
                extinction = most[1]
                if extinction > wp.float64(0.0):
                    colors = wp.max(wp.max(most[2] + most[5], most[3] + most[6]), most[4] + most[7])
                    a = extinction * extinction * colors / wp.float64(8.0)
                    if wp.isinf(bend[0]):
                        a = bend[0]
                # A jump is infinitely visible, unless there is nothing that bends.
                if most[0] > wp.float64(0.0) and bend[0] > wp.float64(0.0):
                    a += most[0] * bend[0] / wp.float64(8.0)
                if most[0] > wp.float64(0.0) and bend[1] > wp.float64(0.0):
                    b = most[0] * bend[1] / wp.float64(12.0)
            h = wp.float64(wp.inf)
            if a > wp.float64(0.0) or b > wp.float64(0.0):
                h = wp.min(wp.sqrt(tolerance / a), wp.cbrt(tolerance / b))
            if h > wp.float64(0.0) and wp.isfinite(h):
                # The error is convex in h: from too long a step Newton's method comes down to the root.
                for _ in range(5):
                    h -= (h * h * (a + h * b) - tolerance) / (h * (wp.float64(2.0) * a + wp.float64(3.0) * h * b))
            result[ck, cj, ci] = wp.float32(h)

    return distances
