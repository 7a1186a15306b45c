"""What a volume's blocks hold and which of them matter.

Ranges and bends depend on the volume alone, the flags and distances that follow on the transfer function too.
A block is ``BLOCK`` cells along each axis, so its range is that of one sample more. Samples that are NaN or infinite
make their cells absent and are left out; a block without any other sample has a range from inf to -inf.

How far the scalar along a ray is from its chord over a step of length h inside a block: in a cell its second derivative
is made of mixed differences alone, at most ``curve``; at each face of cells its slope jumps by the second difference
across it. A kink at u adds u (h - u) / 2 <= h^2 / 8 to the integral of the deviation, and kinks a length w apart
h^3 / 12w + h^2 / 8 in all, because what they add has one maximum. With the directions' worst case, the integral is at
most ``bend[0] h^2 / 8 + bend[1] h^3 / 12``.
"""

from functools import cache

import warp as wp

from .precision import vec3_of
from .transfer import make_transfer, make_transparent

BLOCK = wp.constant(8)
vec8d = wp.types.vector(8, wp.float64)
# A leap ends so much before a face, for the rounding of positions.
MARGIN = 1.0e-4


def blocks(shape):
    """Number of blocks along each axis of samples of a ``shape``, two or more along each."""
    return tuple(-(-(n - 1) // int(BLOCK)) for n in shape)


@cache
def make_ranges(dtype):
    """Kernel ``(base, data, ranges)`` over blocks: smallest and largest finite sample."""
    integer = dtype not in (wp.float16, wp.float32, wp.float64)

    @wp.kernel(enable_backward=False, module="unique")
    def ranges(base: int, data: wp.array3d(dtype=dtype), result: wp.array3d(dtype=wp.vec2d)):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        low = wp.float64(wp.inf)
        high = wp.float64(-wp.inf)
        for k in range(bk * BLOCK, wp.min(bk * BLOCK + BLOCK + 1, data.shape[0])):
            for j in range(bj * BLOCK, wp.min(bj * BLOCK + BLOCK + 1, data.shape[1])):
                for i in range(bi * BLOCK, wp.min(bi * BLOCK + BLOCK + 1, data.shape[2])):
                    s = wp.float64(data[k, j, i])
                    if wp.static(integer) or wp.isfinite(s):
                        low = wp.min(low, s)
                        high = wp.max(high, s)
        result[bk, bj, bi] = wp.vec2d(low, high)

    return ranges


@wp.func
def unravel(n: int, rows: int, columns: int):
    """Indices of element n of an array of any planes."""
    row = n // columns
    plane = row // rows
    return plane, row - plane * rows, n - row * columns


@cache
def make_empty(real):
    """Kernel ``(base, ranges, shift, tf, empty)`` over blocks: whether nothing in a block has any extinction."""
    Transfer, _, _ = make_transfer(real)
    transparent = make_transparent(real)

    @wp.kernel(enable_backward=False, module="unique")
    def empty(
        base: int,
        ranges: wp.array3d(dtype=wp.vec2d),
        shift: wp.float64,
        tf: Transfer,
        result: wp.array3d(dtype=wp.uint8),
    ):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        span = ranges[bk, bj, bi]
        result[bk, bj, bi] = wp.uint8(0)
        if span[0] > span[1] or transparent(tf, real(span[0] - shift), real(span[1] - shift)):
            result[bk, bj, bi] = wp.uint8(1)

    return empty


@cache
def make_bends(dtype):
    """Kernel ``(base, data, scale, bends)`` over blocks: how far the field may be from linear along any ray in it.

    ``scale`` is the length unit over the spacing of each axis. A bend is (kinks, curve and kinks per length); a block
    with an absent cell bends without limit, so that steps in it find where the data end.
    """
    integer = dtype not in (wp.float16, wp.float32, wp.float64)

    @wp.func
    def sample(data: wp.array3d(dtype=dtype), k: int, j: int, i: int):
        return wp.float64(data[k, j, i])

    @wp.kernel(enable_backward=False, module="unique")
    def bends(base: int, data: wp.array3d(dtype=dtype), scale: wp.vec3d, result: wp.array3d(dtype=wp.vec2d)):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        k0 = bk * BLOCK
        j0 = bj * BLOCK
        i0 = bi * BLOCK
        second = wp.vec3d()
        mixed = wp.vec3d()
        present = bool(True)
        for k in range(k0, wp.min(k0 + BLOCK + 1, data.shape[0])):
            for j in range(j0, wp.min(j0 + BLOCK + 1, data.shape[1])):
                for i in range(i0, wp.min(i0 + BLOCK + 1, data.shape[2])):
                    s = sample(data, k, j, i)
                    # Differences backwards, of samples of this block only: steps end where the block ends.
                    k1 = wp.max(k - 1, k0)
                    j1 = wp.max(j - 1, j0)
                    i1 = wp.max(i - 1, i0)
                    sk = sample(data, k1, j, i)
                    sj = sample(data, k, j1, i)
                    si = sample(data, k, j, i1)
                    if i > i0 + 1:
                        second[0] = wp.max(second[0], wp.abs(s - si - (si - sample(data, k, j, i - 2))))
                    if j > j0 + 1:
                        second[1] = wp.max(second[1], wp.abs(s - sj - (sj - sample(data, k, j - 2, i))))
                    if k > k0 + 1:
                        second[2] = wp.max(second[2], wp.abs(s - sk - (sk - sample(data, k - 2, j, i))))
                    # 0 on the block's first faces, where both indices are the same.
                    mixed[0] = wp.max(mixed[0], wp.abs(s - sj - (sk - sample(data, k1, j1, i))))
                    mixed[1] = wp.max(mixed[1], wp.abs(s - si - (sk - sample(data, k1, j, i1))))
                    mixed[2] = wp.max(mixed[2], wp.abs(s - si - (sj - sample(data, k, j1, i1))))
                    if not wp.static(integer):
                        present = present and wp.isfinite(s)
        bend = wp.vec2d(wp.float64(wp.inf), wp.float64(wp.inf))
        if present:
            # s'' is the quadratic form of a matrix without diagonal; its largest eigenvalue is at most sqrt(4/3) of
            # the norm of its three entries.
            form = wp.cw_mul(mixed, wp.vec3d(scale[1] * scale[2], scale[0] * scale[2], scale[0] * scale[1]))
            curve = wp.sqrt(wp.float64(wp.static(4.0 / 3.0))) * wp.length(form)
            jumps = wp.cw_mul(scale, second)
            bend = wp.vec2d(wp.length(jumps), curve + wp.max(wp.cw_mul(scale, jumps)))
        result[bk, bj, bi] = bend

    return bends


@cache
def make_distances(real):
    """Kernel ``(base, ranges, bends, shift, tf, maxima, tolerance, distances)`` over blocks: how long a step may be.

    The longest over which two errors together are within the tolerance: that of optical depth and colour because the
    scalar is not linear, and that of colour because attenuation inside the step is taken to be even, at most
    depth^2 / 8 of the colours' range. Infinite where there is neither. ``maxima`` is that of ``tables.range_maxima``.
    """
    Transfer, interval, _ = make_transfer(real)

    @wp.func
    def largest(maxima: wp.array2d(dtype=vec8d), first: int, last: int):
        """Largest of the entries first .. last: two rows of a power of two cover them."""
        level = int(0)
        while (2 << level) <= last - first + 1:
            level += 1
        return wp.max(maxima[level, first], maxima[level, last + 1 - (1 << level)])

    @wp.kernel(enable_backward=False, module="unique")
    def distances(
        base: int,
        ranges: wp.array3d(dtype=wp.vec2d),
        bends: wp.array3d(dtype=wp.vec2d),
        shift: wp.float64,
        tf: Transfer,
        maxima: wp.array2d(dtype=vec8d),
        tolerance: wp.float64,
        result: wp.array3d(dtype=wp.float32),
    ):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        span = ranges[bk, bj, bi]
        bend = bends[bk, bj, bi]
        # The error is at most a h^2 + b h^3.
        a = wp.float64(0.0)
        b = wp.float64(0.0)
        if span[0] <= span[1]:
            most = largest(maxima, interval(tf, real(span[0] - shift)), interval(tf, real(span[1] - shift)))
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
        h = wp.min(wp.sqrt(tolerance / a), wp.cbrt(tolerance / b))
        if h > wp.float64(0.0) and wp.isfinite(h):
            # The error is convex in h: from too long a step Newton's method comes down to the root.
            for _ in range(5):
                h -= (h * h * (a + h * b) - tolerance) / (h * (wp.float64(2.0) * a + wp.float64(3.0) * h * b))
        result[bk, bj, bi] = wp.float32(h)

    return distances


@cache
def make_leave(real):
    """``leave(last, origin, direction, block, length)``: where a ray leaves a block, at most length, and the axis."""
    vec3 = vec3_of(real)

    @wp.func
    def leave(last: wp.vec3i, origin: vec3, direction: vec3, block: wp.vec3i, length: real):
        # The outermost blocks end with the box.
        end = length
        axis = int(0)
        for a in range(3):
            face = block[a] * BLOCK
            if direction[a] > real(0.0):
                face += BLOCK
            if direction[a] != real(0.0) and face > 0 and face <= last[a]:
                t = (real(face) - origin[a]) / direction[a]
                if t < end:
                    end = t
                    axis = a
        return end, axis

    return leave


@cache
def make_leap(real):
    """``leap(empty, last, origin, direction, start, length)``: where the row of empty blocks ends that a ray is in at
    ``start``, at most ``length``; ``start`` itself where its block is not empty. ``last`` is the field's last cell.
    """
    vec3 = vec3_of(real)
    leave = make_leave(real)

    @wp.func
    def leap(
        empty: wp.array3d(dtype=wp.uint8), last: wp.vec3i, origin: vec3, direction: vec3, start: real, length: real
    ):
        block = wp.vec3i()
        for a in range(3):
            block[a] = wp.min(wp.max(int(origin[a] + start * direction[a]), 0), last[a]) // BLOCK
        end = start
        while end < length and empty[block[2], block[1], block[0]] != wp.uint8(0):
            end, axis = leave(last, origin, direction, block, length)
            if end < length:
                block[axis] += wp.where(direction[axis] > real(0.0), 1, -1)
        return end

    return leap
