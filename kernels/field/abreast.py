"""The walk of ``strides`` of several rays abreast, each in a lane: what rays decide differently costs no branches.

Whole numbers of ticks are in double precision, which has them exactly. A step and a leap are the same to a lane: what
it crosses until it leaves a cell, or a cube of empty blocks.
"""

from functools import cache

import warp as wp

from ..vectors import VECTORS
from .blocks import Blocks
from .strides import FULL, Rays

# Rays abreast, and numbers of each.
LANES = 16
STATE = 25

LAYOUT = """
#define GOING(b) __builtin_convertvector(*(const v8i*)(rays.going.data + 8 * (b)) == 1, vq)
#define TRUNC __builtin_elementwise_trunc
#define LESS(a, b) ((a) < (b) ? (a) : (b))
auto bits8 = [](vq a) -> unsigned {
    const auto one = __builtin_convertvector(a != 0, b8);
    uint8_t all;
    __builtin_memcpy(&all, &one, 1);
    return all;
};
enum { NEAR, GAP = 3, INVERSE = 6, WAY = 9, STEP = 12, FLIP = 15, PLACE = 18, TIME, LIMIT, END, TICK, START, OCTANT };
vd* state = (vd*)rays.state.data;  // of eight rays by turns
"""

BEGIN = """
for (int b = 0; b < LANES / 8; ++b, state += STATE) {
    alignas(64) double line[8][8];
    for (int l = 0; l < 8; ++l)
        for (int m = 0; m < 8; ++m) line[m][l] = rays.lines.data[rays.lines.shape[1] * (8 * b + l) + m];
    const vd start = *(const vd*)line[6], end = *(const vd*)line[7];
    vd out = end;
    for (int a = 0; a < 3; ++a) {
        // Where a ray leaves the grid; comparisons are false for NaN.
        const vd origin = *(const vd*)line[a], d = *(const vd*)line[3 + a];
        const vd far = (((d > 0.0) ? (vd){} + (last[a] + 1.0) : (vd){}) - origin) / d;
        out = (d != 0.0) & (far < out) & (vq){} - (last[a] > 0) ? far : out;
    }
    const vd length = out - start, far = 2.0 * length, most = MAX(MAX(ABSD(start), ABSD(out)), length);
    // The power of two that makes it 2^52 ticks or more to the farther end, as of ``strides``.
    const vq exponent = MAX(((vq)most >> 52) & 0x7ff, (vq){} + 100);
    const vd scale = (vd)((2098 - exponent) << 52), all = TRUNC(length * scale);
    vq place = {}, octant = {};
    for (int a = 0; a < 3; ++a) {
        const vd origin = *(const vd*)line[a], d = *(const vd*)line[3 + a], inverse = 1.0 / d;
        const vq up = d > 0.0, moves = (d != 0.0) & (vq){} - (last[a] > 0);
        const vd cell = TRUNC(MIN(MAX(origin + start * d, (vd){}), (vd){} + (double)last[a]));
        const vd next = (cell + (up ? (vd){} + 1.0 : (vd){}) - origin) * inverse - start;
        state[NEAR + a] = TRUNC(((moves & (next < far)) ? MAX(next, (vd){}) : far) * scale);
        state[GAP + a] = TRUNC(((moves & (ABSD(inverse) < far)) ? ABSD(inverse) : far) * scale);
        state[INVERSE + a] = 1.0 / MAX(state[GAP + a], (vd){} + 1.0);
        state[WAY + a] = up ? (vd){} + 1.0 : (vd){} - 1.0;
        state[STEP + a] = (vd)(__builtin_convertvector(state[WAY + a], vq) << (21 * a));
        state[FLIP + a] = (vd)(up ? (vq){} : (vq){} + 3);
        place |= __builtin_convertvector(cell, vq) << (21 * a);
        octant |= up & (1 << a);
    }
    state[PLACE] = (vd)place;
    state[TIME] = start;
    state[LIMIT] = all - 4.0 * ((double)last[0] + last[1] + last[2] + 6.0);
    state[END] = all;
    state[TICK] = (vd)((exponent - 52) << 52);
    state[START] = start;
    state[OCTANT] = (vd)octant;
    *(v8i*)(rays.going.data + 8 * b) = __builtin_convertvector((length > 0.0) & 1, v8i);
}
"""

STRIDE = """
// What is found, of eight rays a row.
struct Found {
    vq place[CELLS];
    vd enter[CELLS], leave[CELLS];
    uint8_t hits[CELLS];
};
// Of a ray that has ended the next faces are no numbers, so that it stays where it is.
struct alignas(64) Walk {
    vd near[3], time;
    vq place, going, octant;
    int rows;
};
const uint64_t* __restrict seen = (const uint64_t*)blocks.masks.data;
const uint8_t* __restrict free = octants.data;
const int64_t nx = blocks.masks.shape[2], nxy = nx * blocks.masks.shape[1], size = nxy * blocks.masks.shape[0];
#define ALL(a, i) (vq){(int64_t)a[i[0]], (int64_t)a[i[1]], (int64_t)a[i[2]], (int64_t)a[i[3]], \\
    (int64_t)a[i[4]], (int64_t)a[i[5]], (int64_t)a[i[6]], (int64_t)a[i[7]]}
// One step or leap of each: whether there is another.
auto step = [&](Walk& w, const vd* s, Found& found) __attribute__((always_inline)) -> bool {
    const vq p = w.place, block = ((p >> 44) * nxy + ((p >> 23) & 0x7ffff) * nx) + ((p >> 2) & 0x7ffff);
    const vq at = block + w.octant, kind = ALL(free, at), none = (kind != 0) & (kind != FULL);
    const bool leaps = bits8(none & w.going);
    vd e[3] = {w.near[0], w.near[1], w.near[2]};
    if (leaps)
        // Faces to cross within the cube of empty blocks.
        for (int a = 0; a < 3; ++a) {
            const vq cross = none & (kind * 4 - 1 - (((p >> (21 * a)) & 3) ^ (vq)s[FLIP + a]));
            e[a] += __builtin_convertvector(cross, vd) * s[GAP + a];
        }
    const vd first = LESS(e[0], e[1]), leave = LESS(first, e[2]);
    const vq ends = leave >= s[LIMIT];
    vq hit = w.going & ~none;
    if (bits8(hit & (kind != FULL))) {
        const vq bit = (p & 3) | ((p >> 19) & 12) | ((p >> 38) & 48), mask = ALL(seen, block);
        hit &= -((mask >> bit) & 1);
    }
    // The cell that a walk ends in reaches to the end of the ray.
    const vd left = (ends ? s[END] : leave) * s[TICK] + s[START];
    const unsigned hits = bits8(hit);
    found.place[w.rows] = p;
    found.enter[w.rows] = w.time;
    found.leave[w.rows] = left;
    found.hits[w.rows] = (uint8_t)hits;
    w.rows += hits != 0;
    w.time = left;
    if (leaps) {
        // What each has crossed then, by a reciprocal, which is off by one at most.
        vq go = {};
        for (int a = 0; a < 3; ++a) {
            const vd way = leave - w.near[a];
            vd k = TRUNC(way * s[INVERSE + a]);
            const vd over = way - k * s[GAP + a];
            k += over >= s[GAP + a] ? (vd){} + 2.0 : over < 0.0 ? (vd){} : (vd){} + 1.0;
            k = k > 0.0 ? k : (vd){};
            w.near[a] += k * s[GAP + a];
            go += __builtin_convertvector(k * s[WAY + a], vq) << (21 * a);
        }
        w.place += go;
    } else
        for (int a = 0; a < 3; ++a) {
            const vq here = w.near[a] == leave;
            w.near[a] = here ? w.near[a] + s[GAP + a] : w.near[a];
            w.place = here ? w.place + (vq)s[STEP + a] : w.place;
        }
    if (bits8(ends & w.going)) {
        w.going &= ~ends;
        for (int a = 0; a < 3; ++a) w.near[a] = ends ? (vd){} + __builtin_nan("") : w.near[a];
        w.place = ends ? p : w.place;
    }
    return w.rows < CELLS && bits8(w.going);
};
alignas(64) Found found[LANES / 8];
Walk walks[LANES / 8];
bool on[LANES / 8];
for (int b = 0; b < LANES / 8; ++b) {
    const vd* s = state + STATE * b;
    Walk& w = walks[b];
    w.time = s[TIME];
    w.place = (vq)s[PLACE];
    w.octant = (vq)s[OCTANT] * size;
    w.going = GOING(b);
    // One that ended by what it has seen, too.
    for (int a = 0; a < 3; ++a) w.near[a] = w.going ? s[NEAR + a] : (vd){} + __builtin_nan("");
    w.rows = 0;
    on[b] = bits8(w.going);
}
for (bool any = true; any;) {
    any = false;
    for (int b = 0; b < LANES / 8; ++b)
        if (on[b]) any |= on[b] = step(walks[b], state + STATE * b, found[b]);
}
// Those of each ray, one behind the other.
int to = 0;
for (int r = 0; r < LANES; ++r) {
    const Found& of = found[r >> 3];
    const int l = r & 7, rows = walks[r >> 3].rows;
    rays.first.data[r] = to;
    for (int i = 0; i < rows; ++i) {
        cells.data[to] = (uint64_t)of.place[i][l];
        times.data[to] = of.enter[i][l];
        times.data[times.shape[1] + to] = of.leave[i][l];
        to += (of.hits[i] >> l) & 1;
    }
    rays.last.data[r] = to;
}
for (int b = 0; b < LANES / 8; ++b) {
    vd* s = state + STATE * b;
    const Walk& w = walks[b];
    for (int a = 0; a < 3; ++a) s[NEAR + a] = w.near[a];
    s[TIME] = w.time;
    s[PLACE] = (vd)w.place;
    v8i* going = (v8i*)(rays.going.data + 8 * b);
    *going = *going == 1 ? __builtin_convertvector(w.going & 1, v8i) : *going;
}
return to;
"""


@cache
def make_abreast(cells):
    """``begin(last, rays)`` and ``stride(blocks, octants, rays, cells, times)``, as of ``strides.make_each``, of
    ``LANES`` rays; there is room for one cell more.
    """
    numbers = {"LANES": LANES, "STATE": STATE, "CELLS": cells, "FULL": FULL}

    def text(of):
        for name, value in numbers.items():
            of = of.replace(name, str(value))
        return VECTORS + of

    @wp.func_native(text(LAYOUT + BEGIN))
    def begin(last: wp.vec3i, rays: Rays): ...

    @wp.func_native(text(LAYOUT + STRIDE))
    def stride(
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        rays: Rays,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
    ) -> int: ...

    return begin, stride
