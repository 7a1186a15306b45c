"""Small blocks of cells: what they hold and how far around them there is nothing to see.

A block is ``1 << BITS`` cells along each axis, so its range is that of one sample more. Samples that are NaN or
infinite make their cells absent and are left out. With the transfer function, a block is of one kind:

* k >= 0: all that it holds lies in interval k of the transfer function, which is linear there;
* ``SEVERAL``: it needs more than one;
* ``EMPTY - d``: nothing in it has any extinction, nor in the blocks up to d away along any axis.
"""

from functools import cache

import warp as wp

from .importance import unravel
from .transfer import make_transfer, make_transparent

BITS = wp.constant(2)
SEVERAL = wp.constant(-1)
EMPTY = wp.constant(-2)
# How far around a block to look; farther costs more than the longer leaps gain.
FAR = wp.constant(16)


def blocks(shape):
    """Number of blocks along each axis of samples of a ``shape``, two or more along each."""
    return tuple(-(-(n - 1) // (1 << int(BITS))) for n in shape)


@cache
def make_ranges(dtype):
    """Kernel ``(base, data, ranges)`` over blocks: smallest and largest finite sample, the wrong way round if none."""
    integer = dtype not in (wp.float16, wp.float32, wp.float64)
    pair = wp.types.vector(2, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def ranges(base: int, data: wp.array3d(dtype=dtype), result: wp.array3d(dtype=pair)):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        low = data[bk << BITS, bj << BITS, bi << BITS]
        high = low
        known = wp.static(integer) or wp.isfinite(wp.float64(low))
        for k in range(bk << BITS, wp.min((bk + 1 << BITS) + 1, data.shape[0])):
            for j in range(bj << BITS, wp.min((bj + 1 << BITS) + 1, data.shape[1])):
                for i in range(bi << BITS, wp.min((bi + 1 << BITS) + 1, data.shape[2])):
                    s = data[k, j, i]
                    if wp.static(integer):
                        low = wp.min(low, s)
                        high = wp.max(high, s)
                    elif wp.isfinite(wp.float64(s)):
                        if not known:
                            low = s
                            high = s
                            known = True
                        low = wp.min(low, s)
                        high = wp.max(high, s)
        if not known:
            low = dtype(1.0)
            high = dtype(0.0)
        result[bk, bj, bi] = pair(low, high)

    return ranges


@cache
def make_kinds(dtype):
    """Kernel ``(base, ranges, shift, tf, kinds)`` over blocks; empty ones without regard to others yet."""
    Transfer, interval, _ = make_transfer(wp.float64)
    transparent = make_transparent(wp.float64)
    pair = wp.types.vector(2, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def kinds(
        base: int,
        ranges: wp.array3d(dtype=pair),
        shift: wp.float64,
        tf: Transfer,
        result: wp.array3d(dtype=wp.int16),
    ):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        span = ranges[bk, bj, bi]
        low = wp.float64(span[0]) - shift
        high = wp.float64(span[1]) - shift
        kind = int(SEVERAL)
        if low > high or transparent(tf, low, high):
            kind = int(EMPTY)
        else:
            first = interval(tf, low)
            if interval(tf, high) == first and first < 32768:
                kind = first
        result[bk, bj, bi] = wp.int16(kind)

    return kinds


# Bit 16 z + 4 y + x of a block's mask is set where the corners of that cell may see extinction.
MASK = """
// Smallest and largest of two, four, eight neighbours: along x, then y, then z.
const size_t nx = data.shape[2], ny = data.shape[1], nz = data.shape[0];
double low[5][5][4], high[5][5][4];
for (int z = 0; z < 5; ++z) {
    const size_t k = bk * 4 + z < nz ? bk * 4 + z : nz - 1;
    for (int y = 0; y < 5; ++y) {
        const size_t j = bj * 4 + y < ny ? bj * 4 + y : ny - 1;
        const auto* row = data.data + (k * ny + j) * nx;
        double s[5];
        for (int x = 0; x < 5; ++x)
            s[x] = double(row[bi * 4 + x < nx ? bi * 4 + x : nx - 1]) - shift;
        for (int x = 0; x < 4; ++x) {
            low[z][y][x] = s[x] < s[x + 1] ? s[x] : s[x + 1];
            high[z][y][x] = s[x] > s[x + 1] ? s[x] : s[x + 1];
        }
    }
}
for (int z = 0; z < 5; ++z)
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x) {
            low[z][y][x] = low[z][y][x] < low[z][y + 1][x] ? low[z][y][x] : low[z][y + 1][x];
            high[z][y][x] = high[z][y][x] > high[z][y + 1][x] ? high[z][y][x] : high[z][y + 1][x];
        }
unsigned long long mask = 0;
for (int z = 0; z < 4; ++z)
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x) {
            const double a = low[z][y][x] < low[z + 1][y][x] ? low[z][y][x] : low[z + 1][y][x];
            const double b = high[z][y][x] > high[z + 1][y][x] ? high[z][y][x] : high[z + 1][y][x];
            mask |= (unsigned long long)(!(b <= first) & !(a >= last)) << (16 * z + 4 * y + x);
        }
return mask;
"""


@cache
def make_mask_of(dtype):
    """``mask_of(data, bk, bj, bi, first, last)``: bits of a block's cells whose corners are neither all at most first
    nor all at least last.
    """

    @wp.func_native(MASK)
    def mask_of(
        data: wp.array3d(dtype=dtype),
        shift: wp.float64,
        bk: int,
        bj: int,
        bi: int,
        first: wp.float64,
        last: wp.float64,
    ) -> wp.uint64: ...

    return mask_of


@cache
def make_visible():
    """``visible(tf, low, high)`` -> (first, last): of scalars from low to high, those up to first have no extinction,
    nor have those from last on.
    """
    Transfer, interval, _ = make_transfer(wp.float64)

    @wp.func
    def visible(tf: Transfer, low: wp.float64, high: wp.float64):
        first = -wp.float64(wp.inf)
        last = wp.float64(wp.inf)
        begin = interval(tf, low)
        end = interval(tf, high)
        k = tf.visible[begin]
        if k > begin:
            first = tf.knot[k]
            if tf.knot[wp.min(k + 1, tf.knot.shape[0] - 1)] == first:
                # A jump, whose upper value holds at the knot itself: all that is less has none.
                first -= wp.float64(wp.static(2.0**-52)) * wp.abs(first) + wp.float64(wp.static(2.0**-1022))
        k = end
        while k > begin and tf.visible[k] != k:
            k -= 1
        if k < end:
            last = tf.knot[k + 1]
        return first, last

    return visible


@cache
def make_masks(dtype):
    """Kernel ``(base, data, ranges, shift, tf, kinds, masks)`` over blocks: which cells may see extinction."""
    Transfer, _, _ = make_transfer(wp.float64)
    visible = make_visible()
    mask_of = make_mask_of(dtype)
    pair = wp.types.vector(2, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def masks(
        base: int,
        data: wp.array3d(dtype=dtype),
        ranges: wp.array3d(dtype=pair),
        shift: wp.float64,
        tf: Transfer,
        kinds: wp.array3d(dtype=wp.int16),
        result: wp.array3d(dtype=wp.uint64),
    ):
        bk, bj, bi = unravel(wp.tid() + base, result.shape[1], result.shape[2])
        mask = wp.uint64(0)  # an array of bits
        kind = int(kinds[bk, bj, bi])
        if kind >= 0:
            mask = ~mask
        elif kind == SEVERAL:
            span = ranges[bk, bj, bi]
            first, last = visible(tf, wp.float64(span[0]) - shift, wp.float64(span[1]) - shift)
            mask = mask_of(data, shift, bk, bj, bi, first, last)
        result[bk, bj, bi] = mask

    return masks


@wp.kernel(enable_backward=False, module="unique")
def spread(base: int, axis: int, before: wp.array3d(dtype=wp.int16), after: wp.array3d(dtype=wp.int16)):
    """Chebyshev distance, up to ``FAR``, to the nearest block that is not empty, axis by axis: what the axes before
    have found along theirs, now along this one too. Kinds in, kinds out.
    """
    place = wp.vec3i()
    bk, bj, bi = unravel(wp.tid() + base, before.shape[1], before.shape[2])
    place[0] = bk
    place[1] = bj
    place[2] = bi
    kind = int(before[bk, bj, bi])
    if kind <= EMPTY:
        # Before the first axis nothing is known of others.
        near = FAR
        if axis > 0:
            near = EMPTY - kind
        r = int(1)
        while r <= near:
            for side in range(-1, 2, 2):
                other = place
                other[axis] += side * r
                if other[axis] >= 0 and other[axis] < before.shape[axis]:
                    there = int(before[other[0], other[1], other[2]])
                    free = int(-1)
                    if there <= EMPTY:
                        free = FAR
                        if axis > 0:
                            free = EMPTY - there
                    near = wp.min(near, wp.max(r - 1, free))
            r += 1
        kind = EMPTY - near
    after[bk, bj, bi] = wp.int16(kind)
