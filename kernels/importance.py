"""What a volume's blocks hold and which of them matter: the ranges depend on the volume, the flags on both.

A block is ``BLOCK`` cells along each axis, so its range is that of one sample more. Samples that are NaN or infinite
make their cells absent and are left out; a block without any other sample has a range from inf to -inf.
"""

from functools import cache

import warp as wp

from .precision import vec3_of
from .transfer import make_transfer, make_transparent

BLOCK = wp.constant(8)
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
def make_leap(real):
    """``leap(empty, last, origin, direction, start, length)``: where the row of empty blocks ends that a ray is in at
    ``start``, at most ``length``; ``start`` itself where its block is not empty. ``last`` is the field's last cell.
    """
    vec3 = vec3_of(real)

    @wp.func
    def leap(
        empty: wp.array3d(dtype=wp.uint8), last: wp.vec3i, origin: vec3, direction: vec3, start: real, length: real
    ):
        block = wp.vec3i()
        for a in range(3):
            block[a] = wp.min(wp.max(int(origin[a] + start * direction[a]), 0), last[a]) // BLOCK
        end = start
        while end < length and empty[block[2], block[1], block[0]] != wp.uint8(0):
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
            if end < length:
                block[axis] += wp.where(direction[axis] > real(0.0), 1, -1)
        return end

    return leap
