"""What a sweep sees of tissue, eight places at a time: in vectors what ``tissue`` says in Warp, of whole volumes of
finite samples, in single precision by a table.
"""

from functools import cache
from typing import Any, NamedTuple

import warp as wp

from ..field.grid import Grid
from ..field.samples import make_samples
from ..field.scalars import scalars_of
from ..field.strides import FULL
from ..transfer.lookup import make_table
from ..vectors import VECTORS, wide

LANES = wp.constant(8)
# Parts of a ray that are measured at a time, between eight places.
PARTS = wp.constant(7)
Eight = wp.types.vector(8, wp.float32)

# Columns of as many rows of four as there are lanes.
COLUMNS = {
    8: """
typedef float entry __attribute__((vector_size(16), aligned(4)));
auto turned = [](const entry* e, v8f* q) {
#define HALVES(l) __builtin_shufflevector(e[l], e[l + 4], 0, 1, 2, 3, 4, 5, 6, 7)
#define LOWS(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13)
#define HIGHS(a, b) __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15)
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define ODD(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)
    const v8f h0 = HALVES(0), h1 = HALVES(1), h2 = HALVES(2), h3 = HALVES(3);
    const v8f low0 = LOWS(h0, h1), low1 = LOWS(h2, h3), high0 = HIGHS(h0, h1), high1 = HIGHS(h2, h3);
    q[0] = EVEN(low0, low1);
    q[1] = ODD(low0, low1);
    q[2] = EVEN(high0, high1);
    q[3] = ODD(high0, high1);
};
""",
    16: """
typedef float entry __attribute__((vector_size(16), aligned(4)));
auto turned = [](const entry* e, vf* q) {
#define PAIR2(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7)
#define FOUR(l) JOIN(PAIR2(e[l], e[4 + l]), PAIR2(e[8 + l], e[12 + l]))
#define LOWS(a, b) __builtin_shufflevector(a, b, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29)
#define HIGHS(a, b) __builtin_shufflevector(a, b, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31)
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29)
#define ODD(a, b) __builtin_shufflevector(a, b, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31)
    const vf h0 = FOUR(0), h1 = FOUR(1), h2 = FOUR(2), h3 = FOUR(3);
    const vf low0 = LOWS(h0, h1), low1 = LOWS(h2, h3), high0 = HIGHS(h0, h1), high1 = HIGHS(h2, h3);
    q[0] = EVEN(low0, low1);
    q[1] = ODD(low0, low1);
    q[2] = EVEN(high0, high1);
    q[3] = ODD(high0, high1);
};
""",
}

# Entries of a table, bilinear between them.
ENTRIES = """
const entry* __restrict entries = (const entry*)table.rgba.data;
const int64_t n = table.rgba.shape[1];
auto at = [&](FLOATS s, INTS& i) -> FLOATS {
    const FLOATS u = LESS(MORE((s - table.low) * table.scale, none), none + (float)(n - 1));
    i = MORE(LESS(__builtin_convertvector(u, INTS), first + (int)(n - 2)), first);
    return u - __builtin_convertvector(i, FLOATS);
};
"""

# Extinction between scalars that are ``at`` places: all four that it is between are next to each other.
EXTINCTIONS = """
const float* __restrict taus = (const float*)pairs.data;
auto extinctions = [&](INTS i, FLOATS x, INTS j, FLOATS y) -> FLOATS {
    alignas(64) int place[LANES];
    *(INTS*)place = i * (int)n + j;
    entry e[LANES];
    for (int l = 0; l < LANES; ++l) e[l] = *(const entry*)(taus + 2 * (int64_t)place[l]);
    FLOATS q[4];
    turned(e, q);
    const FLOATS e0 = q[0] + y * (q[2] - q[0]), e1 = q[1] + y * (q[3] - q[1]);
    return MORE(e0 + x * (e1 - e0), none);
};
"""

# Colour times extinction, and that: of sixteen parts.
LOOKUP = """
auto looks_up = [&](const int* row, const float* x, vi is, vf* q) {
    alignas(64) int place[16];
    *(vi*)place = is ? *(const vi*)row * (int)n + *(const vi*)(row + 1) : first;
    entry e[16];
    for (int l = 0; l < 16; ++l) {
        // Of a row two at a time.
        const v8f e0 = *(const v8f*)(entries + place[l]), e1 = *(const v8f*)(entries + place[l] + n);
        const v8f both = e0 + x[l] * (e1 - e0);
        const entry before = __builtin_shufflevector(both, both, 0, 1, 2, 3);
        e[l] = before + x[l + 1] * (__builtin_shufflevector(both, both, 4, 5, 6, 7) - before);
    }
    turned(e, q);
};
"""

ABSORBED = """
#define MORE(a, b) ((a) > (b) ? (a) : (b))
// 1 - exp(-y) of y >= 0: where it is thin by a series, else by that of 2^r.
auto absorbed = [](FLOATS y) -> FLOATS {
    const FLOATS none = {};
    FLOATS thin = none + 1.0f;
    for (int i = 8; i > 1; --i) thin = 1.0f - y * (1.0f / i) * thin;
    const FLOATS z = MORE(y * -1.44269504088896f, none - 115.0f);
    const FLOATS whole = z + 12582912.0f;
    const FLOATS r = (z - (whole - 12582912.0f)) * 0.693147180559945f;
    FLOATS p = r * (1.0f / 720) + (1.0f / 120);
    p = p * r + (1.0f / 24);
    p = p * r + (1.0f / 6);
    p = p * r + 0.5f;
    p = p * r + 1.0f;
    p = p * r + 1.0f;
    const FLOATS left = (FLOATS)((INTS)p + ((INTS)whole << 23));
    return y < 0.5f ? y * thin : 1.0f - left;
};
"""

# Of a ray from its k-th part on: where parts begin, scalars there, colours, extinctions and opacities.
MEASURE = """
const v8f number = {0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f};
const v8f t = MIN(MAX(lengths[0] + (number + (float)k) * lengths[1], none), none + lengths[2]);
#define NEXT(a) __builtin_shufflevector(a, a, 1, 2, 3, 4, 5, 6, 7, 7)
const v8f s = scalars(origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]);
v8i i, j;
const v8f x = at(s, i), y = at(NEXT(s), j);
alignas(32) int wi[8], wj[8];
alignas(32) float wx[8], wy[8];
*(v8i*)wi = i;
*(v8i*)wj = j;
*(v8f*)wx = x;
*(v8f*)wy = y;
entry e[8];
for (int l = 0; l < 8; ++l) {
    const entry* p = entries + wi[l] * n + wj[l];
    const entry e0 = p[0] + wy[l] * (p[1] - p[0]), e1 = p[n] + wy[l] * (p[n + 1] - p[n]);
    e[l] = e0 + wx[l] * (e1 - e0);
}
v8f q[4];
turned(e, q);
const v8f tau = MAX(q[3], none), one = 1.0f / (tau > 0.0f ? tau : none + 1.0f);
v8f* out = (v8f*)seen.data;
out[0] = t;
out[1] = s;
out[2] = q[0] * one;
out[3] = q[1] * one;
out[4] = q[2] * one;
out[5] = tau;
out[6] = absorbed(tau * (NEXT(t) - t));
int l = 0;
while (l < 7 && !(tau[l] > 0.0f)) ++l;
return l;
"""

# What of a straight way is inside of the box, from a to b of it.
INSIDE = """
auto inside = [&](const FLOATS* p, const FLOATS* d, FLOATS& a, FLOATS& b) {
    a = none;
    b = none + 1.0f;
    for (int c = 0; c < 3; ++c) {
        const FLOATS before = (float)low[c] - p[c], behind = (float)high[c] - p[c];
        const INTS out = (LESS(d[c], none) < before) | (MORE(d[c], none) > behind);
        const FLOATS t0 = before / d[c], t1 = behind / d[c];
        const INTS still = d[c] == 0.0f;
        a = out && !still ? MORE(a, LESS(t0, t1)) : a;
        b = out ? (still ? none : LESS(b, MORE(t0, t1))) : b;
    }
};
"""

# One way, its parts together.
DEPTH = """
v8f place[3], along[3], a, b;
for (int c = 0; c < 3; ++c) {
    place[c] = none + p[c];
    along[c] = none + d[c];
}
inside(place, along, a, b);
if (!(b[0] > a[0])) return 0.0f;
const float h = (b[0] - a[0]) / parts;
const v8f number = {0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f};
float total = 0.0f;
for (int m = 0; m < parts; m += 7) {
    const v8f t = a + (number + (float)m) * h;
    const v8f s = scalars(place[0] + t * along[0], place[1] + t * along[1], place[2] + t * along[2]);
    v8i i;
    const v8f x = at(s, i);
#define NEXT(a) __builtin_shufflevector(a, a, 1, 2, 3, 4, 5, 6, 7, 7)
    const v8f e = extinctions(i, x, NEXT(i), NEXT(x));
    for (int l = 0; l < 7 && m + l < parts; ++l) total += e[l];
}
return total * h;
"""

# Those of eight cells of light, of a run.
DEPTHS = """
typedef double place8 __attribute__((vector_size(64), aligned(8)));
const place8 number = {0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};
v8f p[3], d[3], a, b, length;
for (int c = 0; c < 3; ++c) {
    p[c] = __builtin_convertvector(ways.p[c] + number * ways.p_step[c], v8f);
    d[c] = __builtin_convertvector(ways.d[c] + number * ways.d_step[c], v8f);
}
// Where the blocks ahead of all of them are known to be empty up to where they end, there is nothing to look at.
const uint8_t* ahead = octants.data;
v8i block = first, farthest = first, way = first;
for (int c = 2; c >= 0; --c) {
#define BLOCK(p) (MORE(LESS(__builtin_convertvector(p, v8i), first + field.last[c]), first) >> 2)
    const v8i from = BLOCK(p[c]), to = BLOCK(p[c] + d[c]), far = MORE(to - from, from - to);
    block = block * octants.shape[3 - c] + from;
    farthest = MORE(farthest, far);
    way |= (d[c] > 0.0f) & (1 << c);
}
const int64_t blocks = (int64_t)octants.shape[1] * octants.shape[2] * octants.shape[3];
bool seen = false;
for (int l = 0; l < 8; ++l) {
    const int empty = ahead[way[l] * blocks + block[l]];
    seen |= empty == FULL || empty <= farthest[l];
}
if (!seen) return {};
for (int l = 0; l < 8; ++l) length[l] = ways.lengths[l];
inside(p, d, a, b);
const v8f h = MORE(b - a, none) / (float)parts;
for (int c = 0; c < 3; ++c) {
    p[c] += a * d[c];
    d[c] *= h;
}
v8i i, j;
v8f total = none, x = at(scalars(p[0], p[1], p[2]), i);
for (int m = 0; m < parts; ++m) {
    for (int c = 0; c < 3; ++c) p[c] += d[c];
    const v8f y = at(scalars(p[0], p[1], p[2]), j);
    total += extinctions(i, x, j, y);
    i = j;
    x = y;
}
total *= h * length;
wp::vec_t<8, float> result;
for (int l = 0; l < 8; ++l) result[l] = b[l] > a[l] ? total[l] : 0.0f;
return result;
"""


@wp.struct
class Ways:
    """Eight straight ways from p to p + d, evenly apart."""

    p: wp.vec3d  # of the first
    p_step: wp.vec3d
    d: wp.vec3d
    d_step: wp.vec3d
    lengths: Eight


class Lanes(NamedTuple):
    """Functions of ``make_lanes``."""

    measure: Any
    depth: Any
    depths: Any


def lanes_of(halves):
    """``make_lanes`` of what kernels of the halves see, where they see it in vectors; else None."""
    whole = not (halves.cuts.naive or halves.cuts.labels is not None)
    plain = isinstance(halves.field, Grid) and halves.field.finite and halves.real is wp.float32
    return make_lanes(halves.field.dtype) if halves.vectors and plain and whole and halves.march.preintegrated else None


@cache
def make_lanes(dtype):
    """Of samples of a ``dtype``:

    ``measure(field, table, origin, direction, (t0, part, length), k, seen)``: of ``PARTS`` parts of a ray from the k-th
    on, ``seen`` (7, 8) are where they begin and end, scalars there, colours, extinctions, and opacities; -> the first
    of them with something to see, ``PARTS`` if there is none;
    ``depth(field, table, pairs, low, high, p, d, parts)``, times the length of d as of ``tissue``; and
    ``depths(field, table, pairs, octants, low, high, ways, parts)``, those of ``Ways``.
    """
    Field = make_samples(dtype)
    Table, _ = make_table(wp.float32)
    text = VECTORS + wide(scalars_of(dtype) + COLUMNS[8] + ENTRIES, 8)

    @wp.func_native(text + wide(ABSORBED, 8) + MEASURE)
    def measure(
        field: Field,
        table: Table,
        origin: wp.vec3,
        direction: wp.vec3,
        lengths: wp.vec3,
        k: int,
        seen: wp.array2d(dtype=wp.float32),
    ) -> int: ...

    @wp.func_native(text + wide(EXTINCTIONS + INSIDE, 8) + DEPTH)
    def depth(
        field: Field,
        table: Table,
        pairs: wp.array2d(dtype=wp.vec2),
        low: wp.vec3d,
        high: wp.vec3d,
        p: wp.vec3,
        d: wp.vec3,
        parts: int,
    ) -> wp.float32: ...

    @wp.func_native(text + wide(EXTINCTIONS + INSIDE, 8) + DEPTHS.replace("FULL", str(FULL)))
    def depths(
        field: Field,
        table: Table,
        pairs: wp.array2d(dtype=wp.vec2),
        octants: wp.array4d(dtype=wp.uint8),
        low: wp.vec3d,
        high: wp.vec3d,
        ways: Ways,
        parts: int,
    ) -> Eight: ...

    return Lanes(measure, depth, depths)


ALL = "v8f a;\nfor (int l = 0; l < 8; ++l) a[l] = y[l];\na = absorbed(a);\n"


@wp.func_native(VECTORS + wide(ABSORBED, 8) + ALL + "for (int l = 0; l < 8; ++l) y[l] = a[l];\nreturn y;\n")
def absorbed_of(y: Eight) -> Eight: ...
