"""The walk of ``walk`` in whole numbers: times along a ray are fractions of it, so that a step is a few additions.

A ray is 2^52 to 2^53 ticks long up to where a stretch of it ends, a tick a power of two. What rounding to ticks adds
up to over a grid of n cells along all axes together is less than 2 n of them. Where a cell is taken to end so much
too early or too late, the next begins there: the field has no jumps, so what a ray sees changes by that squared
(docs/proof-single.md, S12). A stretch ends ``4 n`` ticks early, in its last cell, so that no index is ever beyond the
grid.

Octants say of each block, for each of the eight ways that a ray may go, how far there is nothing to see ahead: the
number of blocks along each axis of the largest cube with this one in its corner that is empty; or that all of its
cells may be seen.
"""

from functools import cache

import warp as wp

from .blocks import Blocks
from .walk import PACKET, make_gather, make_walk

# How far to look, and what is said of a block whose cells may all be seen.
FARTHEST = 100
FULL = 255


# Row by row, from the far end of the grid on: what the rows ahead say of each place and the one ahead of it, all at a
# time, then along the row. Beyond the grid nothing is seen.
OCTANTS = """
const int64_t nz = masks.shape[0], ny = masks.shape[1], nx = masks.shape[2];
const int64_t sx = way & 1 ? 1 : -1, sy = way & 2 ? 1 : -1, sz = way & 4 ? 1 : -1;
uint8_t* all = octants.data + way * nz * ny * nx;
for (int64_t a = 0; a < nz; ++a)
    for (int64_t b = 0; b < ny; ++b) {
        const int64_t k = sz > 0 ? nz - 1 - a : a, j = sy > 0 ? ny - 1 - b : b;
        const uint64_t* seen = (const uint64_t*)masks.data + (k * ny + j) * nx;
        uint8_t* row = all + (k * ny + j) * nx;
        const uint8_t* ahead[3] = {b ? row + sy * nx : nullptr, a ? row + sz * ny * nx : nullptr,
            a && b ? row + (sz * ny + sy) * nx : nullptr};
        for (int64_t i = 0; i < nx; ++i) row[i] = FARTHEST - 1;
        for (const uint8_t* other : ahead)
            if (other) {
                for (int64_t i = 0; i < nx; ++i) row[i] = other[i] < row[i] ? other[i] : row[i];
                if (sx > 0)
                    for (int64_t i = 0; i < nx - 1; ++i) row[i] = other[i + 1] < row[i] ? other[i + 1] : row[i];
                else
                    for (int64_t i = 1; i < nx; ++i) row[i] = other[i - 1] < row[i] ? other[i - 1] : row[i];
            }
        int before = FARTHEST - 1;
        for (int64_t c = 0; c < nx; ++c) {
            const int64_t i = sx > 0 ? nx - 1 - c : c;
            const int least = row[i] < before ? row[i] : before;
            before = seen[i] ? 0 : least + 1;
            row[i] = (uint8_t)before;
            before = before < FARTHEST - 1 ? before : FARTHEST - 1;
        }
    }
for (int64_t i = 0; i < nz * ny * nx; ++i)
    if (((const uint64_t*)masks.data)[i] == ~0ULL) all[i] = FULL;
"""


@wp.func_native(OCTANTS.replace("FARTHEST", str(FARTHEST)).replace("FULL", str(FULL)))
def octant(way: int, masks: wp.array3d(dtype=wp.uint64), octants: wp.array4d(dtype=wp.uint8)): ...


@wp.kernel(enable_backward=False, module="unique")
def make_octants(base: int, masks: wp.array3d(dtype=wp.uint64), octants: wp.array4d(dtype=wp.uint8)):
    """Octants of one way that a ray may go, of eight work items: bit a is set where it goes up along axis a."""
    octant(wp.tid() + base, masks, octants)


# What a walk is at, in words: three axes and what is like them; then when it began to be in a cell, which, and when it
# ends; its octant, the length of a tick, and where it starts.
STATE = 28
LAYOUT = """
enum { NEXT, GAP = 4, STEP = 8, FLIP = 12, INVERSE = 16, TIME = 20, PLACE, END, WAY, TICK, START, STATE = 28 };
"""

BEGIN = """
double last_out = end;
for (int a = 0; a < 3; ++a) {
    // Where the ray leaves the grid; comparisons are false for NaN.
    const double out = d[a] != 0.0 && last[a] > 0 ? ((d[a] > 0.0 ? last[a] + 1 : 0) - origin[a]) / d[a] : end;
    last_out = out < last_out ? out : last_out;
}
const double length = last_out - start;
if (!(length > 0.0)) return false;
// The power of two that makes it 2^52 ticks or more to the farther end, by the exponent: times are rounded to parts of
// that, however short the stretch is.
const double before = fabs(start), behind = fabs(last_out), farther = before > behind ? before : behind;
const double most = farther > length ? farther : length;
int64_t bits;
__builtin_memcpy(&bits, &most, 8);
const int64_t exponent = (bits >> 52) & 0x7ff;
bits = (2046 + 52 - (exponent > 100 ? exponent : 100)) << 52;
double scale;
__builtin_memcpy(&scale, &bits, 8);
typedef int64_t word __attribute__((may_alias));
word* s = (word*)state.data + STATE * ray;
double* f = state.data + STATE * ray;
const int64_t all = (int64_t)(length * scale);
const double far = 2.0 * length;
uint64_t place = 0;
for (int a = 0; a < 3; ++a) {
    const bool moves = d[a] != 0.0 && last[a] > 0;
    const double inverse = moves ? 1.0 / d[a] : 0.0, at = origin[a] + start * d[a];
    int64_t cell = at > 0.0 ? (int64_t)at : 0;
    cell = cell < last[a] ? cell : last[a];
    place |= (uint64_t)cell << (21 * a);
    double gap = fabs(inverse), next = (double(cell + (d[a] > 0.0)) - origin[a]) * inverse - start;
    gap = moves && gap < far ? gap : far;
    next = moves && next < far ? next : far;
    s[NEXT + a] = (int64_t)((next > 0.0 ? next : 0.0) * scale);
    s[GAP + a] = (int64_t)(gap * scale);
    s[STEP + a] = (d[a] > 0.0 ? 1LL : -1LL) * (1LL << (21 * a));
    s[FLIP + a] = d[a] > 0.0 ? 0 : 3;
    f[INVERSE + a] = 1.0 / (double)(s[GAP + a] > 0 ? s[GAP + a] : 1);
}
s[NEXT + 3] = all - 4 * ((int64_t)last[0] + last[1] + last[2] + 6);
s[GAP + 3] = s[STEP + 3] = s[FLIP + 3] = 0;
f[INVERSE + 3] = 0.0;
s[TIME] = 0;
s[PLACE] = (int64_t)place;
s[END] = all;
s[WAY] = (d[0] > 0.0) | (d[1] > 0.0) << 1 | (d[2] > 0.0) << 2;
f[TICK] = 1.0 / scale;
f[START] = start;
return true;
"""

# Nothing but what is visited decides a branch.
STRIDE = """
typedef int64_t word __attribute__((may_alias));
typedef int64_t v2q __attribute__((vector_size(16), aligned(8), may_alias));
typedef int64_t v4q __attribute__((vector_size(32), aligned(8), may_alias));
typedef double v4d __attribute__((vector_size(32), aligned(8), may_alias));
typedef int64_t vq __attribute__((vector_size(64), aligned(8), may_alias));
typedef double vd __attribute__((vector_size(64), aligned(8), may_alias));
struct Walk {
    v2q near, rest;  // the next face across x and y, and across z, and when the walk ends
    int64_t t, n;
    uint64_t p;
};
const auto& masks = blocks.masks;
struct Grid {
    const uint64_t* seen;
    int64_t nx, nxy, size;
    const uint8_t* free;
};
const Grid grid = {(const uint64_t*)masks.data, masks.shape[2], masks.shape[2] * masks.shape[1],
    masks.shape[2] * masks.shape[1] * masks.shape[0], octants.data};
// One step or leap: whether there is another. Times that cells are entered and left follow each other in ``found``.
static constexpr auto step = [](Walk& w, const word* s, const Grid& grid, const uint8_t* free, word* found)
    __attribute__((always_inline)) -> bool {
    const uint64_t p = w.p;
    const int64_t block = (int64_t)(p >> 44) * grid.nxy + (int64_t)((p >> 23) & 0x7ffff) * grid.nx
        + (int64_t)((p >> 2) & 0x7ffff);
    const int64_t empty = free[block];
    if (__builtin_expect((uint64_t)(empty - 1) < FARTHEST, 0)) {
        // Faces to cross within the cube of empty blocks, when the ray leaves it, and what it has crossed then, by a
        // reciprocal in double, which is off by one at most.
        const v4q n = __builtin_shufflevector(w.near, w.rest, 0, 1, 2, 3), gap = *(const v4q*)(s + GAP);
        const v4q within = (((v4q){} + (int64_t)p) >> (v4q){0, 21, 42, 0}) & 3;
        const v4q e = n + ((v4q){} + (empty * 4 - 1) - (within ^ *(const v4q*)(s + FLIP))) * gap;
        const v2q least = __builtin_elementwise_min(
            __builtin_shufflevector(e, e, 0, 1), __builtin_shufflevector(e, e, 2, 3));
        const int64_t leave = least[0] < least[1] ? least[0] : least[1];
        if (leave >= w.rest[1]) return false;
        const v4q way = leave - n;
        v4q k = __builtin_convertvector(__builtin_convertvector(way, v4d) * *(const v4d*)(s + INVERSE), v4q);
        const v4q over = way - k * gap;
        k += 1 - (over >= gap) + (over < 0);
        k = __builtin_elementwise_max(k, (v4q){});
        const v4q m = n + k * gap, d = k * *(const v4q*)(s + STEP);
        w.near = __builtin_shufflevector(m, m, 0, 1);
        w.rest = __builtin_shufflevector(m, m, 2, 3);
        w.p += (uint64_t)(d[0] + d[1] + d[2]);
        w.t = leave;
        return true;
    }
    const uint64_t mask = grid.seen[block];
    v2q m = __builtin_elementwise_min(w.near, w.rest);
    m = __builtin_elementwise_min(m, __builtin_shufflevector(m, m, 1, 0));
    const int bit = (int)((p & 3) | ((p >> 19) & 12) | ((p >> 38) & 48));
    const v2q a = w.near == m, b = w.rest == m;
    word* at = found + w.n;
    at[0] = (int64_t)p;
    at[ROOM] = w.t;
    at[2 * ROOM] = w.t = m[0];
    w.n += (int64_t)((mask >> bit) & 1);
    const v2q d = (a & *(const v2q*)(s + STEP)) + (b & *(const v2q*)(s + STEP + 2));
    w.p += (uint64_t)(d[0] + d[1]);
    w.near += a & *(const v2q*)(s + GAP);
    w.rest += b & *(const v2q*)(s + GAP + 2);
    return m[0] < s[NEXT + 3];
};
static constexpr auto load = [](const word* s) __attribute__((always_inline)) -> Walk {
    return {*(const v2q*)(s + NEXT), *(const v2q*)(s + NEXT + 2), s[TIME], 0, (uint64_t)s[PLACE]};
};
static constexpr auto store = [](const Walk& w, word* s, bool going, word* found) __attribute__((always_inline)) {
    *(v2q*)(s + NEXT) = w.near;
    *(v2q*)(s + NEXT + 2) = w.rest;
    s[TIME] = going ? w.t : s[END];
    s[PLACE] = (int64_t)w.p;
    // The cell that the walk ends in reaches to the end of the ray.
    if (w.n > 0 && found[2 * ROOM + w.n - 1] >= s[NEXT + 3]) found[2 * ROOM + w.n - 1] = s[END];
};
word* s = (word*)state.data + STATE * ray;
alignas(64) word found[3 * ROOM];
const uint8_t* free = grid.free + s[WAY] * grid.size;
Walk w = load(s);
bool going = true;
while (going && w.n < CELLS) going = step(w, s, grid, free, found);
store(w, s, going, found);
const double tick = state.data[STATE * ray + TICK], start = state.data[STATE * ray + START];
for (int l = 0; l < w.n; l += 8) {
    *(vq*)(cells.data + first + l) = *(const vq*)(found + l);
    for (int a = 0; a < 2; ++a)
        *(vd*)(times.data + a * times.shape[1] + first + l) =
            __builtin_convertvector(*(const vq*)(found + (1 + a) * ROOM + l), vd) * tick + start;
}
return (int)w.n;
"""


@wp.struct
class Rays:
    """Several rays on their way."""

    lines: wp.array2d(dtype=wp.float64)  # (n, 9): origin, direction, start, stop, and the transparency at which it ends
    state: wp.array2d(dtype=wp.float64)  # of the walk
    going: wp.array(dtype=int)  # 1 as long as there is more to walk, then 0; 2 of one that ended before
    first: wp.array(dtype=int)  # its next cells: from where,
    last: wp.array(dtype=int)  # and to where
    sums: wp.array2d(dtype=wp.float64)  # (n, 5): colour, opacity and bound, so far
    count: wp.array(dtype=int)  # cells and pieces, so far


@cache
def make_strides(cells):
    """``begin(last, origin, d, start, end, state, ray)`` -> whether there is anything between start and end;
    ``stride(blocks, octants, state, ray, cells, times, first)`` -> the number of cells that it found, the next with
    something to see, ``cells`` at most, or fewer where the stretch ends; ``more(state, ray)`` says whether it goes on.
    They are put into ``cells``, 21 bits an axis, from ``first`` on, where there is room for eight more; ``times``
    (2, n) are when the ray enters and leaves them. ``state`` (n, STATE) is of several rays, each by its number.
    """

    @wp.func_native(LAYOUT + BEGIN)
    def begin(
        last: wp.vec3i,
        origin: wp.vec3d,
        d: wp.vec3d,
        start: wp.float64,
        end: wp.float64,
        state: wp.array2d(dtype=wp.float64),
        ray: int,
    ) -> bool: ...

    @wp.func_native(
        LAYOUT + STRIDE.replace("CELLS", str(cells)).replace("ROOM", str(cells + 8)).replace("FARTHEST", str(FARTHEST))
    )
    def stride(
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        state: wp.array2d(dtype=wp.float64),
        ray: int,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        first: int,
    ) -> int: ...

    @wp.func_native(LAYOUT + "const int64_t* s = (const int64_t*)state.data + STATE * ray; return s[TIME] < s[END];")
    def more(state: wp.array2d(dtype=wp.float64), ray: int) -> bool: ...

    return begin, stride, more


@cache
def make_gathered(cells):
    """The same by ``walk.gather``, whose times are exact but for rounding of each by itself."""
    _, enter, _, _ = make_walk(wp.float64)
    _, gather = make_gather()
    room = cells - PACKET

    @wp.func
    def begin(
        last: wp.vec3i,
        origin: wp.vec3d,
        d: wp.vec3d,
        start: wp.float64,
        end: wp.float64,
        state: wp.array2d(dtype=wp.float64),
        ray: int,
    ):
        w = enter(last, origin, d, start)
        for a in range(3):
            state[ray, a] = wp.float64(w.cell[a])
            state[ray, 4 + a] = origin[a]
            state[ray, 7 + a] = d[a]
            state[ray, 10 + a] = wp.float64(last[a])
        state[ray, 3] = start
        state[ray, 13] = wp.min(end, w.out)
        state[ray, 14] = start
        return start < state[ray, 13]

    @wp.func
    def stride(
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        state: wp.array2d(dtype=wp.float64),
        ray: int,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        first: int,
    ):
        last = wp.vec3i(int(state[ray, 10]), int(state[ray, 11]), int(state[ray, 12]))
        w = enter(
            last,
            wp.vec3d(state[ray, 4], state[ray, 5], state[ray, 6]),
            wp.vec3d(state[ray, 7], state[ray, 8], state[ray, 9]),
            state[ray, 14],
        )
        w.cell = wp.vec3i(int(state[ray, 0]), int(state[ray, 1]), int(state[ray, 2]))
        w.t = state[ray, 3]
        n = int(0)
        while w.t < state[ray, 13] and n <= room:
            w, few = gather(blocks, w, state[ray, 13])
            for l in range(PACKET):
                if l < few.count:
                    cells[first + n] = (
                        wp.uint64(few.cell[0, l])
                        | wp.uint64(few.cell[1, l]) << wp.uint64(21)
                        | wp.uint64(few.cell[2, l]) << wp.uint64(42)
                    )
                    times[0, first + n] = few.start[l]
                    times[1, first + n] = few.start[l] + few.length[l]
                    n += 1
        for a in range(3):
            state[ray, a] = wp.float64(w.cell[a])
        state[ray, 3] = w.t
        return n

    @wp.func
    def more(state: wp.array2d(dtype=wp.float64), ray: int):
        return state[ray, 3] < state[ray, 13]

    return begin, stride, more


@cache
def make_each(cells, ticks):
    """``begin(last, rays)`` of ``rays.lines``, and ``stride(blocks, octants, rays, cells, times)`` -> how many cells
    the next of all rays are that are ``going``, those of each one behind the other.
    """
    enter, next, more = (make_strides if ticks else make_gathered)(cells)

    @wp.func
    def begin(last: wp.vec3i, rays: Rays):
        for r in range(rays.going.shape[0]):
            origin = wp.vec3d(rays.lines[r, 0], rays.lines[r, 1], rays.lines[r, 2])
            d = wp.vec3d(rays.lines[r, 3], rays.lines[r, 4], rays.lines[r, 5])
            rays.going[r] = 0
            if rays.lines[r, 7] > rays.lines[r, 6]:
                if enter(last, origin, d, rays.lines[r, 6], rays.lines[r, 7], rays.state, r):
                    rays.going[r] = 1

    @wp.func
    def stride(
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        rays: Rays,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
    ):
        total = int(0)
        for r in range(rays.going.shape[0]):
            rays.first[r] = total
            if rays.going[r] == 1:
                total += next(blocks, octants, rays.state, r, cells, times, total)
                rays.going[r] = wp.where(more(rays.state, r), 1, 0)
            rays.last[r] = total
        return total

    return begin, stride
