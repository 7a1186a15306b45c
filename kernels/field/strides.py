"""The walk of ``walk`` in whole numbers: times along a ray are fractions of it, so that a step is a few additions.

A stretch of ray is 2^49 to 2^50 ticks long, a tick a power of two. What rounding to ticks adds up to over a grid of n
cells along all axes together is less than 2 n of them. Where a cell is taken to end so much too early or too late, the
next begins there: the field has no jumps, so what a ray sees changes by that squared (docs/proof-single.md, S12). A
stretch ends ``4 n`` ticks early, in its last cell, so that no index is ever beyond the grid.

Octants say of each block, for each of the eight ways that a ray may go, how far there is nothing to see ahead: the
number of blocks along each axis of the largest cube with this one in its corner that is empty.
"""

from functools import cache

import warp as wp

from .blocks import Blocks
from .walk import PACKET, make_gather, make_walk

# How far to look.
FARTHEST = 100


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
"""


@wp.func_native(OCTANTS.replace("FARTHEST", str(FARTHEST)))
def octant(way: int, masks: wp.array3d(dtype=wp.uint64), octants: wp.array4d(dtype=wp.uint8)): ...


@wp.kernel(enable_backward=False, module="unique")
def make_octants(base: int, masks: wp.array3d(dtype=wp.uint64), octants: wp.array4d(dtype=wp.uint8)):
    """Octants of one way that a ray may go, of eight work items: bit a is set where it goes up along axis a."""
    octant(wp.tid() + base, masks, octants)


BEGIN = """
double last_out = end;
for (int a = 0; a < 3; ++a) {
    // Where the ray leaves the grid; comparisons are false for NaN.
    const double out = d[a] != 0.0 && last[a] > 0 ? ((d[a] > 0.0 ? last[a] + 1 : 0) - origin[a]) / d[a] : end;
    last_out = out < last_out ? out : last_out;
}
const double length = last_out - start;
if (!(length > 0.0)) return false;
// The power of two that makes the length 2^49 ticks or more, by its exponent.
int64_t bits;
__builtin_memcpy(&bits, &length, 8);
const int64_t exponent = (bits >> 52) & 0x7ff;
bits = (2046 + 49 - (exponent > 100 ? exponent : 100)) << 52;
double scale;
__builtin_memcpy(&scale, &bits, 8);
typedef int64_t word __attribute__((may_alias));
word* s = (word*)state.data + 20 * ray;
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
    s[a] = (int64_t)((next > 0.0 ? next : 0.0) * scale);
    s[5 + a] = (int64_t)(gap * scale);
    s[8 + a] = (d[a] > 0.0 ? 1LL : -1LL) * (1LL << (21 * a));
    state.data[20 * ray + 15 + a] = 1.0 / (double)(s[5 + a] > 0 ? s[5 + a] : 1);
}
s[3] = 0;
s[4] = (int64_t)place;
s[11] = all - 4 * ((int64_t)last[0] + last[1] + last[2] + 6);
s[12] = all;
s[13] = (d[0] > 0.0) | (d[1] > 0.0) << 1 | (d[2] > 0.0) << 2;
state.data[20 * ray + 14] = 1.0 / scale;
return true;
"""

# In a function of its own, which has all registers for itself.
STRIDE = """
typedef int64_t word __attribute__((may_alias));
auto walk = [](word* s, const uint64_t* __restrict seen, const uint8_t* __restrict free, const int64_t nx,
    const int64_t nxy, uint64_t* __restrict place, word* __restrict ticks) __attribute__((noinline)) -> int64_t {
    int64_t n0 = s[0], n1 = s[1], n2 = s[2], t = s[3], n = 0;
    uint64_t p = (uint64_t)s[4];
    const int64_t last = s[11], end = s[12];
    while (n < CELLS) {
        const int64_t block = (int64_t)(p >> 44) * nxy + (int64_t)((p >> 23) & 0x7ffff) * nx
            + (int64_t)((p >> 2) & 0x7ffff);
        const int64_t empty = free[block];
        if (__builtin_expect(empty != 0, 0)) {
            // Faces to cross within the cube of empty blocks, and when the ray leaves it.
            const int64_t g0 = s[5], g1 = s[6], g2 = s[7], s0 = s[8], s1 = s[9], s2 = s[10];
            const int64_t out = empty * 4 - 1;
            const int64_t i0 = p & 3, i1 = (p >> 21) & 3, i2 = (p >> 42) & 3;
            const int64_t e0 = n0 + (out - (s0 > 0 ? i0 : 3 - i0)) * g0, e1 = n1 + (out - (s1 > 0 ? i1 : 3 - i1)) * g1;
            const int64_t e2 = n2 + (out - (s2 > 0 ? i2 : 3 - i2)) * g2;
            int64_t leave = e0 < e1 ? e0 : e1;
            leave = e2 < leave ? e2 : leave;
            if (leave >= last) {
                t = end;
                break;
            }
            // Faces across each axis until then: by a reciprocal in double, which is off by one at most.
            const double* one = (const double*)s + 15;
            auto crossed = [&](int64_t next, int a) -> int64_t {
                int64_t k = (int64_t)((double)(leave - next) * one[a]);
                const int64_t rest = leave - next - k * s[5 + a];
                k += (rest >= s[5 + a]) - (rest < 0) + 1;
                return k > 0 ? k : 0;
            };
            const int64_t k0 = crossed(n0, 0), k1 = crossed(n1, 1), k2 = crossed(n2, 2);
            n0 += k0 * g0;
            n1 += k1 * g1;
            n2 += k2 * g2;
            p += (uint64_t)(k0 * s0 + k1 * s1 + k2 * s2);
            t = leave;
            continue;
        }
        const uint64_t mask = seen[block];
        int64_t m = n0 < n1 ? n0 : n1;
        m = n2 < m ? n2 : m;
        const int bit = (int)((p & 3) | ((p >> 19) & 12) | ((p >> 38) & 48));
        place[n] = p;
        ticks[n] = t;
        ticks[n + CELLS] = m;
        const int64_t on = (int64_t)((mask >> bit) & 1);
        n += on;
        if (__builtin_expect(m >= last, 0)) {
            ticks[n - on + CELLS] = end;
            t = end;
            break;
        }
        t = m;
        const int64_t h0 = -(int64_t)(n0 == m), h1 = -(int64_t)(n1 == m), h2 = -(int64_t)(n2 == m);
        // Read anew, which is faster than to keep them.
        const word* k = s;
        asm("" : "+r"(k));
        p += (uint64_t)((h0 & k[8]) + (h1 & k[9]) + (h2 & k[10]));
        n0 += h0 & k[5];
        n1 += h1 & k[6];
        n2 += h2 & k[7];
    }
    s[0] = n0;
    s[1] = n1;
    s[2] = n2;
    s[3] = t;
    s[4] = (int64_t)p;
    return n;
};
const auto& masks = blocks.masks;
const int64_t nx = masks.shape[2], nxy = nx * masks.shape[1];
double* when = times.data + ray * 2 * CELLS;
word* ticks = (word*)when;
word* s = (word*)state.data + 20 * ray;
const int64_t n = walk(s, (const uint64_t*)masks.data, octants.data + s[13] * nxy * masks.shape[0], nx, nxy,
    cells.data + ray * CELLS, ticks);
const double tick = state.data[20 * ray + 14];
typedef double vd __attribute__((vector_size(64), aligned(8), may_alias));
typedef long long vq __attribute__((vector_size(64), aligned(8), may_alias));
for (int64_t m = 0; m <= CELLS; m += CELLS)
    for (int64_t l = m; l < m + n; l += 8)
        *(vd*)(when + l) = __builtin_convertvector(*(const vq*)(ticks + l), vd) * tick + start;
return (int)n;
"""


@cache
def make_strides(cells):
    """Of several rays, each by its number: ``begin(last, origin, d, start, end, state, ray)`` -> whether there is
    anything between start and end; ``stride(blocks, octants, start, state, cells, times, ray)`` -> the number of cells
    that it found, the next with something to see, as many as there is room for, or fewer where the stretch ends; and
    ``more(state, ray)`` -> whether the ray goes on. ``cells`` have 21 bits an axis; ``times`` are when the ray enters
    and leaves them.
    """

    @wp.func_native(BEGIN)
    def begin(
        last: wp.vec3i,
        origin: wp.vec3d,
        d: wp.vec3d,
        start: wp.float64,
        end: wp.float64,
        state: wp.array2d(dtype=wp.float64),
        ray: int,
    ) -> bool: ...

    @wp.func_native(STRIDE.replace("CELLS", str(cells)))
    def stride(
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        start: wp.float64,
        state: wp.array2d(dtype=wp.float64),
        cells: wp.array2d(dtype=wp.uint64),
        times: wp.array3d(dtype=wp.float64),
        ray: int,
    ) -> int: ...

    @wp.func_native("const int64_t* s = (const int64_t*)state.data + 20 * ray; return s[3] < s[12];")
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
        return start < state[ray, 13]

    @wp.func
    def stride(
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        start: wp.float64,
        state: wp.array2d(dtype=wp.float64),
        cells: wp.array2d(dtype=wp.uint64),
        times: wp.array3d(dtype=wp.float64),
        ray: int,
    ):
        last = wp.vec3i(int(state[ray, 10]), int(state[ray, 11]), int(state[ray, 12]))
        w = enter(
            last,
            wp.vec3d(state[ray, 4], state[ray, 5], state[ray, 6]),
            wp.vec3d(state[ray, 7], state[ray, 8], state[ray, 9]),
            start,
        )
        w.cell = wp.vec3i(int(state[ray, 0]), int(state[ray, 1]), int(state[ray, 2]))
        w.t = state[ray, 3]
        n = int(0)
        while w.t < state[ray, 13] and n <= room:
            w, few = gather(blocks, w, state[ray, 13])
            for l in range(PACKET):
                if l < few.count:
                    cells[ray, n] = (
                        wp.uint64(few.cell[0, l])
                        | wp.uint64(few.cell[1, l]) << wp.uint64(21)
                        | wp.uint64(few.cell[2, l]) << wp.uint64(42)
                    )
                    times[ray, 0, n] = few.start[l]
                    times[ray, 1, n] = few.start[l] + few.length[l]
                    n += 1
        for a in range(3):
            state[ray, a] = wp.float64(w.cell[a])
        state[ray, 3] = w.t
        return n

    @wp.func
    def more(state: wp.array2d(dtype=wp.float64), ray: int):
        return state[ray, 3] < state[ray, 13]

    return begin, stride, more
