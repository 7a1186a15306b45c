"""The most along a ray, or the least, in vectors: what ``peaks.make_seek`` and ``integrators.extremes`` say.

The faces ahead along the three axes, where they are and where those behind them are go on by themselves, so that a step
waits for nothing but a minimum. Cells with a corner above what is known wait until there are eight, of which the cubics
are computed together.
"""

from functools import cache

import warp as wp

from ..vectors import VECTORS
from .peaks import Peaks, Walk
from .samples import make_samples

CLIMB = """
typedef double v4d __attribute__((vector_size(32), aligned(8)));
typedef long long v4q __attribute__((vector_size(32), aligned(8)));
typedef int v4i __attribute__((vector_size(16), aligned(4)));
typedef bool b4 __attribute__((ext_vector_type(4)));
const auto* __restrict data = field.data.data;
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const double shift = SHIFT, sign = SIGN;
const auto &p = walk.origin, &d = walk.direction, &o = walk.anchor, &v = walk.inverse;
double most = best, nearest = place;
int count = 0;

// Cells that wait: where the ray enters and leaves them, their largest corner, faces ahead and first corner.
alignas(64) double enters[8], leaves[8], tops[8];
alignas(32) double faces[8][4];
int64_t firsts[8];
const v4i up = {v[0] > 0.0, v[1] > 0.0, v[2] > 0.0, 0}, way = {2 * up[0] - 1, 2 * up[1] - 1, 2 * up[2] - 1, 0};
auto solve = [&](int n) __attribute__((noinline)) {
    for (int l = n; l < 8; ++l) {
        enters[l] = leaves[l] = enters[0];
        tops[l] = -INFINITY;
        firsts[l] = firsts[0];
        for (int a = 0; a < 3; ++a) faces[l][a] = faces[0][a];
    }
    typedef ACCUMULATOR row __attribute__((vector_size(8 * sizeof(ACCUMULATOR))));
    alignas(64) ACCUMULATOR corners[8][8];
    alignas(64) double ahead[3][8];
    for (int l = 0; l < 8; ++l) {
        const auto* q = data + firsts[l];
        for (int m = 0; m < 8; ++m) corners[m][l] = q[(m >> 2) * nxy + ((m >> 1) & 1) * nx + (m & 1)];
        for (int a = 0; a < 3; ++a) ahead[a][l] = faces[l][a];
    }
    vd s[8];
    for (int m = 0; m < 8; ++m) s[m] = sign * (__builtin_convertvector(*(const row*)corners[m], vd) - shift);
#define ALL(a) (*(const vd*)(a))
#define CELL(a) (ALL(ahead[a]) - (double)up[a])
    // The cubic, as ``cell.cubic`` has it.
    const vd t = ALL(enters), L = ALL(leaves) - t, top = ALL(tops);
    const vd x = p[0] + t * d[0] - CELL(0), y = p[1] + t * d[1] - CELL(1), z = p[2] + t * d[2] - CELL(2);
    const vd x00 = s[1] - s[0], x10 = s[3] - s[2];
    const vd x01 = s[5] - s[4], x11 = s[7] - s[6];
    const vd v00 = s[0] + x * x00, v01 = s[4] + x * x01;
    const vd y0 = s[2] + x * x10 - v00, y1 = s[6] + x * x11 - v01;
    const vd v0 = v00 + y * y0, dz = v01 + y * y1 - v0;
    const vd xy0 = x10 - x00, xyz = x11 - x01 - xy0, xy = xy0 + z * xyz;
    const vd xz = x01 - x00 + y * xyz, yz = y1 - y0;
    const vd dx = x00 + y * xy0 + z * xz, dy = y0 + z * yz;
    const vd c0 = v0 + z * dz, c1 = d[0] * dx + d[1] * dy + d[2] * dz;
    const vd c2 = d[0] * (d[1] * xy + d[2] * xz) + d[1] * d[2] * yz, c3 = d[0] * d[1] * d[2] * xyz;
    // It lies below the coefficients of Bernstein's polynomials.
    const vd near = c0 + (1.0 / 3.0) * L * c1, far = near + (1.0 / 3.0) * L * (c1 + L * c2);
    const vd last = c0 + L * (c1 + L * (c2 + L * c3));
    const vd bound = MIN(MAX(MAX(c0, last), MAX(near, far)), top);
    const vq known = (c3 - c3 == 0.0) & (L > least);
    auto which = [](vq a) -> int {
        const auto one = __builtin_convertvector(a, b8);
        uint8_t all;
        __builtin_memcpy(&all, &one, 1);
        return all;
    };
    int lanes = which(known & ((bound > most) | ((bound == most) & (t < nearest))));
    if (!lanes) return;
    count += __builtin_popcount(lanes);
    // Where it turns, as ``cell.turns`` has it; 0 where it does not.
    const vd size = MAX(MAX(ABSD(c1), MAX(ABSD(c2), ABSD(c3))), (vd){} + 1.0e-300);
    const vd a = 3.0 * c3 / size, b = c2 / size, c = c1 / size, square = b * b - a * c;
    const vd root = __builtin_elementwise_sqrt(MAX(square, (vd){}));
    const vd q = b < 0.0 ? root - b : -(b + root);
    const vq one = (square > 0.0) & (c * q > 0.0) & (ABSD(c) < ABSD(q) * L);
    const vq other = (square > 0.0) & (q * a > 0.0) & (ABSD(q) < ABSD(a) * L);
    const vd u = one ? c / q : (vd){}, w = other ? q / a : (vd){};
    const vd places[4] = {(vd){}, MIN(u, w), MAX(u, w), L};
    vd value = (vd){} - INFINITY, at = t;
    for (int n = 0; n < 4; ++n) {
        const vd there = MIN(c0 + places[n] * (c1 + places[n] * (c2 + places[n] * c3)), top);
        at = there > value ? t + places[n] : at;
        value = there > value ? there : value;
    }
    for (; lanes; lanes &= lanes - 1) {
        const int l = __builtin_ctz(lanes);
        if (value[l] > most || (value[l] == most && at[l] < nearest)) {
            most = value[l];
            nearest = at[l];
        }
    }
};

// Along the axes: faces ahead, those behind them, where both are; and where the block or cell is in its array.
struct Ahead {
    v4d face, next, at, then, size;
    int64_t place;
};
const v4d anchor = {o[0], o[1], o[2], -1.0e300}, inverse = {v[0], v[1], v[2], 1.0};
const v4d origin = {p[0], p[1], p[2], 0.0}, direction = {d[0], d[1], d[2], 0.0};
const v4i end = {walk.last[0], walk.last[1], walk.last[2], 0};
const wp::array_t<float>* levels[3] = {&peaks.fine, &peaks.middle, &peaks.coarse};
int64_t rows[4], planes[4], jumps[4][8];
for (int k = 0; k < 4; ++k) {
    rows[k] = k ? levels[k - 1]->shape[2] : nx;
    planes[k] = k ? rows[k] * levels[k - 1]->shape[1] : nxy;
    for (int m = 0; m < 8; ++m)
        jumps[k][m] = (m & 1 ? way[0] : 0) + (m & 2 ? way[1] * rows[k] : 0) + (m & 4 ? way[2] * planes[k] : 0);
}
// In the block of 1 << 2 k cells along each axis that has a cell.
auto enter = [&](v4i cell, int k) __attribute__((always_inline)) {
    Ahead r;
    const v4i block = cell >> (2 * k);
    r.face = __builtin_convertvector((block + up) << (2 * k), v4d);
    r.size = __builtin_convertvector(way << (2 * k), v4d);
    r.at = (r.face - anchor) * inverse;
    r.next = r.face + r.size;
    r.then = (r.next - anchor) * inverse;
    r.place = block[2] * planes[k] + block[1] * rows[k] + block[0];
    return r;
};
auto axes = [](v4q a) -> int {
    const b4 one = __builtin_convertvector(a, b4);
    uint8_t all;
    __builtin_memcpy(&all, &one, 1);
    return all & 7;
};
auto first = [](v4d a) __attribute__((always_inline)) {
    const v4d m = MIN(a, __builtin_shufflevector(a, a, 2, 3, 0, 1));
    return MIN(m, __builtin_shufflevector(m, m, 1, 0, 3, 2));
};
// Returns whether that is into another block of the next size.
auto step = [&](Ahead& r, v4d reached, int k) __attribute__((always_inline)) {
    const auto passed = r.at <= reached;
    const v4i within = __builtin_convertvector(r.face, v4i) & ((4 << (2 * k)) - 1);
    const v4q border = (v4q)passed & __builtin_convertvector(within == 0, v4q);
    r.at = passed ? r.then : r.at;
    r.face = passed ? r.next : r.face;
    r.next = r.face + r.size;
    r.then = (r.next - anchor) * inverse;
    r.place += jumps[k][axes((v4q)passed)];
    return axes(border) != 0;
};
double t = walk.t;
Ahead r = enter(v4i{walk.cell[0], walk.cell[1], walk.cell[2], 0}, 1);
int k = 1, n = 0;
while (t < stop) {
    const double peak = levels[k - 1]->data[r.place];
    const v4d reached = first(r.at);
    const v4i low = __builtin_convertvector(r.face, v4i) - (up << (2 * k));
    const bool promising = (peak > most) | ((peak == most) & (t < nearest));
    if (promising) {
        // What is in there?
        const v4i cell = __builtin_convertvector(origin + t * direction, v4i);
        const v4i there = MAX(MIN(cell, MIN(low + ((1 << (2 * k)) - 1), end)), low);
        if (k > 1) {
            r = enter(there, --k);
            continue;
        }
        const double out = reached[0] < stop ? reached[0] : stop;
        Ahead c = enter(there, 0);
        do {
            const auto* q = data + c.place;
            const ACCUMULATOR a[8] = {q[0], q[1], q[nx], q[nx + 1], q[nxy], q[nxy + 1], q[nxy + nx], q[nxy + nx + 1]};
            ACCUMULATOR m[4];
            for (int i = 0; i < 4; ++i) m[i] = a[2 * i] ABOVE a[2 * i + 1] ? a[2 * i] : a[2 * i + 1];
            for (int i = 0; i < 2; ++i) m[i] = m[2 * i] ABOVE m[2 * i + 1] ? m[2 * i] : m[2 * i + 1];
            const double top = sign * ((double)(m[0] ABOVE m[1] ? m[0] : m[1]) - shift);
            const v4d next = first(c.at);
            const double then = next[0] > t ? next[0] : t;
            enters[n] = t;
            leaves[n] = then < stop ? then : stop;
            tops[n] = top;
            *(v4d*)faces[n] = c.face;
            firsts[n] = c.place;
            n += (top > most) | ((top == most) & (t < nearest));
            step(c, next, 0);
            t = then;
            if (n == 8) {
                solve(8);
                n = 0;
            }
        } while (t < out);
    }
    t = reached[0] > t ? reached[0] : t;
    if (step(r, reached, k) && !promising && k < 3) {
        ++k;
        r = enter(__builtin_convertvector(r.face, v4i) - (up << (2 * k - 2)), k);
    }
}
if (n) solve(n);
return wp::vec_t<3, double>(most, nearest, count);
"""


@cache
def make_climb(dtype, sign):
    """``climb(field, peaks, walk, stop, best, place, least)`` -> the best value times the sign on the way to ``stop``,
    where it is (the nearest of equal ones), and how many cells were solved, from the best that is known and its place
    on. Cells in which the ray is no longer than ``least`` are left out, as are those that are not finite.
    """
    Field = make_samples(dtype)
    shift = "field.shift" if dtype in (wp.float16, wp.float32, wp.float64) else "0.0"
    types = {wp.float16: "float", wp.float32: "float", wp.float64: "double"}
    text = CLIMB.replace("SHIFT", shift).replace("SIGN", str(sign)).replace("ABOVE", ">" if sign > 0 else "<")

    @wp.func_native(VECTORS + text.replace("ACCUMULATOR", types.get(dtype, "int32_t")))
    def climb(
        field: Field,
        peaks: Peaks,
        walk: Walk,
        stop: wp.float64,
        best: wp.float64,
        place: wp.float64,
        least: wp.float64,
    ) -> wp.vec3d: ...

    return climb
