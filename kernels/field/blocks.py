"""Blocks of cells: what they hold and how far around them there is nothing to see.

A block is ``1 << BITS`` cells along each axis, so its range is that of one sample more. Samples that are NaN or
infinite make their cells absent and are left out. With the transfer function, a block is of one kind:

* k >= 0: all that it holds lies in interval k of the transfer function, which is linear there;
* ``SEVERAL``: it needs more than one;
* ``EMPTY - d``: nothing in it has any extinction, nor in the blocks up to d away along any axis.
"""

from functools import cache

import warp as wp

from ..transfer.function import make_transfer, make_transparent, make_visible
from .samples import make_samples

# Cells along an axis of a block, as a power of two; a mask of 64 bits is that of 4 x 4 x 4 cells.
BITS = wp.constant(2)
SEVERAL = wp.constant(-1)
EMPTY = wp.constant(-2)
# How far around a block to look; farther costs more than the longer leaps gain.
FAR = wp.constant(16)


@wp.struct
class Blocks:
    kinds: wp.array3d(dtype=wp.int16)  # [z, y, x] of blocks
    masks: wp.array3d(dtype=wp.uint64)  # of their cells: bit 16 z + 4 y + x is set where there may be something to see


BLOCK_OF = (
    "return blocks.ARRAY.data[((cell[2] >> 2) * blocks.ARRAY.shape[1] + (cell[1] >> 2)) * blocks.ARRAY.shape[2]"
    " + (cell[0] >> 2)];"
)


@wp.func_native(BLOCK_OF.replace("ARRAY", "masks"))
def mask_at(blocks: Blocks, cell: wp.vec3i) -> wp.uint64:
    """The mask of the block of a cell."""
    ...


@wp.func_native(BLOCK_OF.replace("ARRAY", "kinds"))
def kind_at(blocks: Blocks, cell: wp.vec3i) -> int:
    """Its kind."""
    ...


def blocks(shape):
    """Number of blocks along each axis of samples of a ``shape``, two or more along each."""
    return tuple(-(-(n - 1) // (1 << int(BITS))) for n in shape)


@wp.func
def unravel(n: int, rows: int, columns: int):
    """Indices of element n of an array of any planes."""
    row = n // columns
    plane = row // rows
    return plane, row - plane * rows, n - row * columns


# Of a row of blocks along x, 32 at a time: first over y and z for each x, which is as fast as memory is, then over x.
RANGES = """
using A = ACCUMULATOR;
const auto& data = field.data;
const size_t nx = data.shape[2], ny = data.shape[1], nz = data.shape[0];
const size_t count = result.shape[2];
const size_t k1 = bk * 4 + 5 < nz ? bk * 4 + 5 : nz, j1 = bj * 4 + 5 < ny ? bj * 4 + 5 : ny;
A low[129], high[129];
for (size_t first = 0; first < count; first += 32) {
    const size_t x0 = first * 4;
    const size_t n = nx - x0 < 129 ? nx - x0 : 129;
    for (size_t x = 0; x < n; ++x) {
        low[x] = LARGEST;
        high[x] = SMALLEST;
    }
    for (size_t k = bk * 4; k < k1; ++k)
        for (size_t j = bj * 4; j < j1; ++j) {
            const auto* row = data.data + (k * ny + j) * nx + x0;
            for (size_t x = 0; x < n; ++x) {
                const A s = A(row[x]);
                low[x] = (s < low[x] KNOWN) ? s : low[x];
                high[x] = (s > high[x] KNOWN) ? s : high[x];
            }
        }
    for (size_t b = 0; b * 4 + 1 < n && first + b < count; ++b) {
        A least = low[b * 4], most = high[b * 4];
        for (size_t x = b * 4 + 1; x < b * 4 + 5 && x < n; ++x) {
            least = low[x] < least ? low[x] : least;
            most = high[x] > most ? high[x] : most;
        }
        if (least > most) {
            least = A(1);
            most = A(0);
        }
        result.data[(bk * result.shape[1] + bj) * count + first + b] = {(STORED)(least), (STORED)(most)};
    }
}
"""
# Largest and smallest of the types that are not floating point.
LIMITS = {wp.uint8: (255, 0), wp.int8: (127, -128), wp.uint16: (65535, 0), wp.int16: (32767, -32768)}


@cache
def make_ranges(dtype):
    """Kernel ``(base, field, ranges)`` over rows of blocks along x: smallest and largest finite sample of each,
    the wrong way round if there is none.
    """
    Field = make_samples(dtype)
    pair = wp.types.vector(2, dtype)
    name = {wp.float16: "float", wp.float32: "float", wp.float64: "double"}.get(dtype, f"wp::{dtype.__name__}")
    stored = "wp::half" if dtype is wp.float16 else name
    largest, smallest = LIMITS.get(dtype, ("A(INFINITY)", "A(-INFINITY)"))
    text = RANGES.replace("ACCUMULATOR", name).replace("STORED", stored)
    # What is not finite is no less than itself: no difference from itself is 0 then.
    text = text.replace("KNOWN", "" if dtype in LIMITS else "& s - s == A(0)")
    text = text.replace("LARGEST", str(largest)).replace("SMALLEST", str(smallest))

    @wp.func_native(text)
    def row(field: Field, bk: int, bj: int, result: wp.array3d(dtype=pair)): ...

    @wp.kernel(enable_backward=False, module="unique")
    def ranges(base: int, field: Field, result: wp.array3d(dtype=pair)):
        item = wp.tid() + base
        bk = item // result.shape[1]
        row(field, bk, item - bk * result.shape[1], result)

    return ranges


# Whether the corners of each cell may see extinction.
MASK = """
// Smallest and largest of two, four, eight neighbours: along x, then y, then z.
const auto& data = field.data;
const size_t nx = data.shape[2], ny = data.shape[1], nz = data.shape[0];
double low[5][5][4], high[5][5][4];
for (int z = 0; z < 5; ++z) {
    const size_t k = bk * 4 + z < nz ? bk * 4 + z : nz - 1;
    for (int y = 0; y < 5; ++y) {
        const size_t j = bj * 4 + y < ny ? bj * 4 + y : ny - 1;
        const auto* row = data.data + (k * ny + j) * nx;
        double s[5];
        for (int x = 0; x < 5; ++x)
            s[x] = double(row[bi * 4 + x < nx ? bi * 4 + x : nx - 1]) - field.shift;
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
    """``mask_of(field, bk, bj, bi, first, last)``: bits of a block's cells whose corners are neither all at most first
    nor all at least last.
    """

    Field = make_samples(dtype)

    @wp.func_native(MASK)
    def mask_of(field: Field, bk: int, bj: int, bi: int, first: wp.float64, last: wp.float64) -> wp.uint64: ...

    return mask_of


@cache
def make_kinds(dtype):
    """Kernel ``(base, field, ranges, tf, cells, blocks)`` over rows of blocks along x: kinds, of empty ones without
    regard to others, and if ``cells`` are asked for, masks of those that may be seen.
    """
    Transfer, interval, _ = make_transfer(wp.float64)
    nothing, _ = make_transparent(wp.float64)
    visible = make_visible()
    mask_of = make_mask_of(dtype)
    Field = make_samples(dtype)
    pair = wp.types.vector(2, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def kinds(base: int, field: Field, ranges: wp.array3d(dtype=pair), tf: Transfer, cells: bool, blocks: Blocks):
        item = wp.tid() + base
        bk = item // ranges.shape[1]
        bj = item - bk * ranges.shape[1]
        # Most blocks that are empty lie below all that has extinction.
        least = -wp.float64(wp.inf)
        if tf.visible[0] > 0:
            least = tf.knot[wp.min(tf.visible[0], tf.knot.shape[0] - 1)]
        for bi in range(ranges.shape[2]):
            span = ranges[bk, bj, bi]
            low = wp.float64(span[0]) - field.shift
            high = wp.float64(span[1]) - field.shift
            kind = int(EMPTY)
            mask = wp.uint64(0)  # an array of bits
            if low <= high and high >= least:
                first = interval(tf, low)
                end = interval(tf, high)
                if not nothing(tf, first, end, high):
                    kind = SEVERAL
                    if end == first and first < 32768:
                        kind = first
                        mask = ~mask
                    elif cells:
                        under, over = visible(tf, low, high)
                        mask = mask_of(field, bk, bj, bi, under, over)
            blocks.kinds[bk, bj, bi] = wp.int16(kind)
            if cells:
                blocks.masks[bk, bj, bi] = mask

    return kinds
