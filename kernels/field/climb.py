"""The most along a ray, or the least, in vectors: what ``peaks.make_seek`` and ``integrators.extremes`` say.

A tree of nodes with 4 x 4 x 4 children each, down to cells. Of all children of a node it is known at once which the ray
goes through, from where it is at the faces between them, and which may have more than what is known, from a code of a
byte each. No way is walked. Cells that are left wait until there are eight, of which the cubics are computed together.
"""

from functools import cache

import warp as wp

from ..vectors import VECTORS
from .samples import make_samples
from .walk import make_walk


@wp.struct
class Tops:
    """How much there is at most, times a sign, in cells, blocks of 4 x 4 x 4 cells, of 16 x 16 x 16 and so on.

    The code of a value is (value - base) scale, rounded up; one child's is at least that of all there is in it. Where
    it is less than the ``least``, there is nothing.
    """

    codes: wp.array2d(
        dtype=wp.uint8
    )  # of the nodes [z, y, x] of a level, each with its children [z, y, x]; cells first
    base: wp.float64
    scale: wp.float64
    least: int
    exact: bool  # codes are those of no other values
    most: wp.float64  # of all there is


# Levels that there is room for. An axis of an array has less than 2^31 samples.
LEVELS = 16

CLIMB = """
// Of numbers, which are not NaN where it matters.
#define LESS(a, b) ((a) < (b) ? (a) : (b))
#define MORE(a, b) ((a) > (b) ? (a) : (b))
typedef uint8_t v64 __attribute__((vector_size(64), aligned(1)));
typedef bool b64 __attribute__((ext_vector_type(64)));
const auto* __restrict data = field.data.data;
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const double shift = SHIFT, sign = SIGN, from = walk.t, far = 1.0e300;
const auto &p = walk.origin, &d = walk.direction;
double most = best, nearest = place;
int count = 0;

// Where the ray is at faces: those at the ends of the grid are as far as can be, as are all across a ray along them.
double anchor[3], inverse[3], ends[3];
for (int a = 0; a < 3; ++a) {
    const double way = walk.inverse[a];
    // Of what is not a part in 1e30 of a cell on all of the way, nothing is seen.
    const double still = 1.0e30 * MORE(stop, 1.0);
    const bool along = walk.anchor[a] == -far || !(way < still && way > -still);
    anchor[a] = along ? walk.cell[a] + 0.5 : walk.anchor[a];
    inverse[a] = along ? far : way;
    ends[a] = walk.last[a] + 1;
}
auto at = [&](vd face, int a, bool outer) __attribute__((always_inline)) {
    const vd there = (face - anchor[a]) * inverse[a];
    if (!outer) return there;
    const double behind = inverse[a] > 0.0 ? far : -far;
    return face <= 0.0 ? (vd){} - behind : face >= ends[a] ? (vd){} + behind : there;
};

// Cells that wait: their indices along x, y, z.
alignas(32) int cells[3][8];
int n = 0;
auto solve = [&]() __attribute__((noinline)) {
    for (int l = n; l < 8; ++l)
        for (int a = 0; a < 3; ++a) cells[a][l] = cells[a][0];
    // Two corners along x at a time.
    typedef STORED pairs __attribute__((vector_size(16 * sizeof(STORED))));
    alignas(64) STORED corners[4][16];
    for (int l = 0; l < 8; ++l) {
        const auto* q = data + (cells[2][l] * nxy + cells[1][l] * nx + cells[0][l]);
        for (int m = 0; m < 4; ++m) {
            corners[m][2 * l] = q[(m >> 1) * nxy + (m & 1) * nx];
            corners[m][2 * l + 1] = q[(m >> 1) * nxy + (m & 1) * nx + 1];
        }
    }
    vd s[8];
    for (int m = 0; m < 4; ++m) {
        const pairs both = *(const pairs*)corners[m];
        const auto low = __builtin_shufflevector(both, both, 0, 2, 4, 6, 8, 10, 12, 14);
        const auto high = __builtin_shufflevector(both, both, 1, 3, 5, 7, 9, 11, 13, 15);
        s[2 * m] = sign * (__builtin_convertvector(low, vd) - shift);
        s[2 * m + 1] = sign * (__builtin_convertvector(high, vd) - shift);
    }
    vd top = s[0], t = (vd){} + from, out = (vd){} + stop, cell[3];
    for (int m = 1; m < 8; ++m) top = MORE(top, s[m]);
    for (int a = 0; a < 3; ++a) {
        cell[a] = __builtin_convertvector(*(const v8i*)cells[a], vd);
        const vd low = at(cell[a], a, true), high = at(cell[a] + 1.0, a, true);
        t = MORE(t, LESS(low, high));
        out = LESS(out, MORE(low, high));
    }
    // The cubic, as ``cell.cubic`` has it.
    const vd L = out - t;
    const vd x = p[0] + t * d[0] - cell[0], y = p[1] + t * d[1] - cell[1], z = p[2] + t * d[2] - cell[2];
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
    const vd near = c0 + (1.0 / 3.0) * L * c1, later = near + (1.0 / 3.0) * L * (c1 + L * c2);
    const vd last = c0 + L * (c1 + L * (c2 + L * c3));
    const vd bound = LESS(MORE(MORE(c0, last), MORE(near, later)), top);
    const vq known = (c3 - c3 == 0.0) & (L > least);
    auto which = [](vq a) -> int {
        const auto one = __builtin_convertvector(a, b8);
        uint8_t all;
        __builtin_memcpy(&all, &one, 1);
        return all;
    };
    int lanes = which(known & ((bound > most) | ((bound == most) & (t < nearest)))) & ((1 << n) - 1);
    n = 0;
    if (!lanes) return;
    count += __builtin_popcount(lanes);
    // Where it turns, as ``cell.turns`` has it; 0 where it does not.
    const vd size = MORE(MORE(ABSD(c1), MORE(ABSD(c2), ABSD(c3))), (vd){} + 1.0e-300);
    const vd a = 3.0 * c3 / size, b = c2 / size, c = c1 / size, square = b * b - a * c;
    const vd root = __builtin_elementwise_sqrt(MORE(square, (vd){}));
    const vd q = b < 0.0 ? root - b : -(b + root);
    const vq one = (square > 0.0) & (c * q > 0.0) & (ABSD(c) < ABSD(q) * L);
    const vq other = (square > 0.0) & (q * a > 0.0) & (ABSD(q) < ABSD(a) * L);
    const vd u = one ? c / q : (vd){}, w = other ? q / a : (vd){};
    const vd places[4] = {(vd){}, LESS(u, w), MORE(u, w), L};
    vd value = (vd){} - INFINITY, where = t;
    for (int m = 0; m < 4; ++m) {
        const vd there = LESS(c0 + places[m] * (c1 + places[m] * (c2 + places[m] * c3)), top);
        where = there > value ? t + places[m] : where;
        value = there > value ? there : value;
    }
    for (; lanes; lanes &= lanes - 1) {
        const int l = __builtin_ctz(lanes);
        if (value[l] > most || (value[l] == most && where[l] < nearest)) {
            most = value[l];
            nearest = where[l];
        }
    }
};

// Nodes: first cells, the code that there is of one, the time at which it is entered, and those children that the ray
// goes through and that have enough. Times are rounded by far less than ``slop``.
struct Node {
    int first[3], code;
    float t;
    uint64_t left;
};
// Of levels, more than there is memory for: the last is of 4^16 cells along an axis.
Node lists[LEVELS][64];
int counts[LEVELS], nexts[LEVELS];
int64_t begins[LEVELS], rows[LEVELS], planes[LEVELS], size = 0;
int root = 0;
for (;; ++root) {
    const int bits = 2 * root + 2;
    rows[root] = ((int64_t)walk.last[0] >> bits) + 1;
    planes[root] = rows[root] * (((int64_t)walk.last[1] >> bits) + 1);
    begins[root] = size;
    const int64_t all = planes[root] * (((int64_t)walk.last[2] >> bits) + 1);
    size += 64 * all;
    if (all == 1) break;
}
// In the order of the ray: a bit b is that of the child b ^ flip.
const int flip = (inverse[0] < 0.0 ? 3 : 0) | (inverse[1] < 0.0 ? 12 : 0) | (inverse[2] < 0.0 ? 48 : 0);
auto ordered = [&](uint64_t a) __attribute__((always_inline)) {
    const uint64_t masks[6] = {0x5555555555555555, 0x3333333333333333, 0x0f0f0f0f0f0f0f0f,
        0x00ff00ff00ff00ff, 0x0000ffff0000ffff, 0x00000000ffffffff};
    for (int m = 0; m < 6; ++m)
        if (flip >> m & 1) a = (a >> (1 << m) & masks[m]) | (a & masks[m]) << (1 << m);
    return a;
};
const float slop = 2.4e-7f * (float)MORE(from < 0.0 ? -from : from, stop < 0.0 ? -stop : stop) + 1.0e-30f;
const vf begin = zero + (float)from, end = zero + (float)stop;
// The least codes that matter: of what is entered before the nearest place of the most, and of what is entered behind.
int before, behind;
float till;
auto raise = [&]() __attribute__((always_inline)) {
    const double x = (most - tops.base) * tops.scale;
    const bool some = x > (double)tops.least;
    before = some ? (int)__builtin_ceil(x) : tops.least;
    behind = most >= tops.most ? 256 : !some ? tops.least + (tops.exact && x == tops.least)
        : tops.exact ? (int)x + 1 : before;
    till = (float)nearest + slop;
};
raise();
// Those of 4 x 4 x 4 children that the ray goes through and that have a code at least.
auto through = [&](const v4f* enters, const v4f* leaves, const uint8_t* codes, int code)
    __attribute__((always_inline)) {
#define ALONG(a) __builtin_shufflevector(a, a, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3)
#define ACROSS(a) __builtin_shufflevector(a, a, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3)
#define ALL(a, m) __builtin_shufflevector(a, a, m, m, m, m, m, m, m, m, m, m, m, m, m, m, m, m)
    const vf in = MORE(MORE(ALONG(enters[0]), ACROSS(enters[1])), begin);
    const vf out = LESS(LESS(ALONG(leaves[0]), ACROSS(leaves[1])), end) + slop;
    const v4f late = leaves[2] + slop;
    const uint64_t crossed = (uint64_t)bits(MORE(in, ALL(enters[2], 0)) <= LESS(out, ALL(late, 0)))
        | (uint64_t)bits(MORE(in, ALL(enters[2], 1)) <= LESS(out, ALL(late, 1))) << 16
        | (uint64_t)bits(MORE(in, ALL(enters[2], 2)) <= LESS(out, ALL(late, 2))) << 32
        | (uint64_t)bits(MORE(in, ALL(enters[2], 3)) <= LESS(out, ALL(late, 3))) << 48;
    const auto enough = __builtin_convertvector(*(const v64*)codes >= (uint8_t)code, b64);
    uint64_t promising;
    __builtin_memcpy(&promising, &enough, 8);
    return code > 255 ? 0 : crossed & promising;
};
auto there = [&](int level, const int* first) __attribute__((always_inline)) {
    const int bits = 2 * level + 2;
    const int64_t i = first[0] >> bits, j = first[1] >> bits, k = first[2] >> bits;
    return tops.codes.data + begins[level] + 64 * (k * planes[level] + j * rows[level] + i);
};
auto wait = [&](const int* first, uint64_t left) __attribute__((always_inline)) {
    for (; left; left &= left - 1) {
        const int child = __builtin_ctzll(left);
        cells[0][n] = first[0] + (child & 3);
        cells[1][n] = first[1] + (child >> 2 & 3);
        cells[2][n] = first[2] + (child >> 4);
        if (++n == 8) {
            solve();
            raise();
        }
    }
};
// Times at 24 faces that are so many cells apart.
typedef float faces24[24];
auto clock = [&](const int* first, int apart, faces24* times) __attribute__((always_inline)) {
    const vd faces = {0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};
    for (int a = 0; a < 3; ++a) {
        const bool outer = first[a] == 0 || first[a] + 16 * apart >= (int)ends[a];
        for (int m = 0; m < 24; m += 8)
            *(v8f*)&times[a][m] = __builtin_convertvector(at(first[a] + apart * (m + faces), a, outer), v8f);
    }
};
// What is left of a node that has a ``place`` among the faces.
auto look = [&](Node& node, int level, const faces24* times, const int* place) __attribute__((always_inline)) {
    v4f enters[3], leaves[3];
    node.t = -INFINITY;
    for (int a = 0; a < 3; ++a) {
        const float* face = &times[a][place[a]];
        const v4f here = *(const v4f*)face, next = *(const v4f*)(face + 1);
        enters[a] = LESS(here, next);
        leaves[a] = MORE(here, next);
        const float t = LESS(face[0], face[4]);
        node.t = MORE(node.t, t);
    }
    node.left = through(enters, leaves, there(level, node.first), node.t < till ? before : behind);
};
// All that is left of a node, at once.
auto list = [&](int level, const int* first, uint64_t left) __attribute__((always_inline)) {
    const int apart = 1 << (2 * level - 2);
    alignas(32) faces24 times[3];
    clock(first, apart, times);
    const uint8_t* codes = there(level, first);
    int found = 0;
    for (left = ordered(left); left; left &= left - 1) {
        const int child = __builtin_ctzll(left) ^ flip;
        const int place[3] = {4 * (child & 3), 4 * (child >> 2 & 3), 4 * (child >> 4)};
        Node& node = lists[level][found];
        for (int a = 0; a < 3; ++a) node.first[a] = first[a] + apart * place[a];
        node.code = codes[child];
        look(node, level - 1, times, place);
        found += node.left != 0;
    }
    counts[level] = found;
    nexts[level] = 0;
};
const int nowhere[3] = {0, 0, 0};
Node top;
alignas(32) faces24 times[3];
for (int a = 0; a < 3; ++a) top.first[a] = 0;
clock(top.first, 1 << 2 * root, times);
look(top, root, times, nowhere);
if (root)
    list(root, top.first, top.left);
else
    wait(top.first, top.left);
for (int level = root; level && level <= root;) {
    if (nexts[level] == counts[level]) {
        ++level;
        continue;
    }
    Node* nodes = lists[level] + nexts[level]++;
    if (most == -INFINITY) {
        // Where there may be most.
        Node* most = nodes;
        for (Node* other = nodes; other < lists[level] + counts[level]; ++other)
            most = other->code > most->code ? other : most;
        const Node first = *most;
        for (; most > nodes; --most) *most = most[-1];
        *nodes = first;
    }
    if (nodes->code < (nodes->t < till ? before : behind)) continue;
    if (level == 1)
        wait(nodes->first, nodes->left);
    else
        list(--level, nodes->first, nodes->left);
}
if (n) solve();
return wp::vec_t<3, double>(most, nearest, count);
"""

Walk, *_ = make_walk(wp.float64)


@cache
def make_climb(dtype, sign):
    """``climb(field, tops, walk, stop, best, place, least)`` -> the best value times the sign on the way to ``stop``,
    where it is (the nearest of equal ones), and how many cells were solved, from the best that is known and its place
    on. Cells in which the ray is no longer than ``least`` are left out, as are those that are not finite.
    """
    Field = make_samples(dtype)
    shift = "field.shift" if dtype in (wp.float16, wp.float32, wp.float64) else "0.0"
    stored = {wp.float16: "float", wp.float32: "float", wp.float64: "double"}.get(dtype, f"{dtype.__name__}_t")
    text = CLIMB.replace("LEVELS", str(LEVELS))
    text = text.replace("SHIFT", shift).replace("SIGN", str(sign)).replace("STORED", stored)

    @wp.func_native(VECTORS + text)
    def climb(
        field: Field,
        tops: Tops,
        walk: Walk,
        stop: wp.float64,
        best: wp.float64,
        place: wp.float64,
        least: wp.float64,
    ) -> wp.vec3d: ...

    return climb
