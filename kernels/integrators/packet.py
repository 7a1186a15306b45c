"""Cells of a ray sixteen at a time: in vectors what ``single`` says in Warp, and why it holds."""

from functools import cache

import warp as wp

from ..field.blocks import Blocks
from ..field.strides import Rays
from ..transfer.rows import Rows
from ..vectors import VECTORS, apart
from . import single
from .single import CELLS

# Constants that a text has by their names.
NAMES = ("LEFT", "OFFSET_ULPS", "SIGN_ULPS", "DEPTH_ULPS", "SERIES_ULPS", "WIDEST", "DEEPEST")

FADING = """
// exp(-y) of y >= 0 (S10).
auto fading = [](vf y) -> vf {
    const vf z = MAX(y * -1.44269504088896f, (vf){} - 115.0f);
    const vf whole = z + 12582912.0f;
    const vf r = (z - (whole - 12582912.0f)) * 0.693147180559945f;
    vf p = r * (1.0f / 720) + (1.0f / 120);
    p = p * r + (1.0f / 24);
    p = p * r + (1.0f / 6);
    p = p * r + 0.5f;
    p = p * r + 1.0f;
    p = p * r + 1.0f;
    return (vf)((vi)p + ((vi)whole << 23));
};
"""

SERIES = """
// Opacity and V of a straight piece, and what the series leaves out in parts of R where it is nowhere negative (S5).
struct Thin {
    vf A, V, rest;
};
auto series = [&](vf m1, vf m2, vf m3, vf ww, vf x, vf g) -> Thin {
    const vf vw = m1 * (2.0f / 3) + m3 * 0.4f, vww = m2 * (m1 * (16.0f / 45) + m3 * (32.0f / 105));
    const vf wwW = m1 * m1 * (m1 * (2.0f / 15) + m3 * (22.0f / 105))
        + m2 * m2 * (m1 * (8.0f / 135) + m3 * (8.0f / 189)) + m3 * m3 * (m1 * (38.0f / 315) + m3 * (2.0f / 77));
    const vf a = 0.5f * x, ea = fading(a), aa = a * a, xe = x * ea;
    const vf more = xe * (aa * (1.0f / 6 + aa * (1.0f / 120 + aa * (1.0f / 5040 + aa * (1.0f / 362880)))));
    const vf A = x < 2.0f ? xe + more : 1.0f - ea * ea;
    return {A, ea * (g * (ww + g * wwW - a * vww) - aa * vw), x < 2.0f ? more : A - xe};
};
"""

# Numbers 0 to 7 of sixteen rows of which each is sixteen, at a time.
COLUMNS = """
#define LO32(x, y) __builtin_shufflevector(x, y, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29)
#define HI32(x, y) __builtin_shufflevector(x, y, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31)
#define LO64(x, y) __builtin_shufflevector(x, y, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29)
#define HI64(x, y) __builtin_shufflevector(x, y, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30, 31)
#define LO128(x, y) __builtin_shufflevector(x, y, 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10, 11, 24, 25, 26, 27)
#define HI128(x, y) __builtin_shufflevector(x, y, 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14, 15, 28, 29, 30, 31)
auto columns = [](const float* from, const int* which, vf* to) {
    v8f q[16];
    vf a[8], b[8], c[8];
    for (int l = 0; l < 16; ++l) q[l] = *(const v8f*)(from + 16 * (int64_t)which[l]);
    for (int l = 0; l < 8; ++l) a[l] = JOIN(q[l], q[l + 8]);
    for (int l = 0; l < 8; l += 2) {
        b[l] = LO32(a[l], a[l + 1]);
        b[l + 1] = HI32(a[l], a[l + 1]);
    }
    for (int l = 0; l < 8; l += 4) {
        c[l] = LO64(b[l], b[l + 2]);
        c[l + 1] = HI64(b[l], b[l + 2]);
        c[l + 2] = LO64(b[l + 1], b[l + 3]);
        c[l + 3] = HI64(b[l + 1], b[l + 3]);
    }
    for (int l = 0; l < 4; ++l) {
        to[l] = LO128(c[l], c[l + 4]);
        to[l + 4] = HI128(c[l], c[l + 4]);
    }
};
"""

# The first three of four numbers of sixteen records.
RECORDS = """
auto records = [](const float* from, const int* which, vf* to) {
    v4f q[16];
    vf a[4];
    for (int l = 0; l < 16; ++l) q[l] = *(const v4f*)(from + 4 * (int64_t)which[l]);
    for (int l = 0; l < 4; ++l) {
        const v8f low = JOIN8(q[l], q[l + 4]), high = JOIN8(q[l + 8], q[l + 12]);
        a[l] = JOIN(low, high);
    }
    const vf b0 = LO32(a[0], a[1]), b1 = LO32(a[2], a[3]);
    to[0] = LO64(b0, b1);
    to[1] = HI64(b0, b1);
    to[2] = LO64(HI32(a[0], a[1]), HI32(a[2], a[3]));
};
"""

MEASURE = (
    VECTORS
    + FADING
    + SERIES
    + COLUMNS
    + RECORDS
    + """
const float *__restrict table = rows.row.data, *__restrict bins = rows.bins.data;
const double* __restrict knots = rows.knots.data;
const int16_t* __restrict kinds = blocks.kinds.data;
const int nbins = rows.bins.shape[0], levels = rows.levels, fitted = rows.fitted;
const float share = spend[0], absolute = spend[1], bright = spend[2];
const uint64_t* __restrict place = cells.data + some[0];
const int64_t room = found.shape[1];
int last = -1;
for (int u = 0; u < some[1]; u += 16) {
    const float* of = cubic.data + u;
    const vf base = *(const vf*)of, mean = *(const vf*)(of + CELLS), m1 = *(const vf*)(of + 2 * CELLS);
    const vf m2 = *(const vf*)(of + 3 * CELLS), m3 = *(const vf*)(of + 4 * CELLS), h = *(const vf*)(of + 5 * CELLS);
    const vf blur = *(const vf*)(of + 6 * CELLS), L = h + h;
    const vf R = ABS(m1) + ABS(m2) * (2.0f / 3) + ABS(m3), s = base + mean;
    int* r = row.data + some[0] + u;
    float* out = found.data + some[0] + u;
    auto fit = [&]() -> vi {  // the smallest window that may hold the cell
        const vi j = MIN((((vi)MAX((R + blur) * rows.least, zero + 1.0f) + 0x7fffff) >> 23) - 127, (vi){} + levels);
        const vf q = MIN(MAX((s - rows.low) * rows.fine, zero), zero + (float)((1 << levels) - 1));
        return fitted + ((2 << levels) - (((vi){} + (2 << levels)) >> j)) + (__builtin_convertvector(q, vi) >> j);
    };
    vf center, width, t0, t1, t2, dt, dc, steep;
    auto spread = [&](const float* a) {
        center = zero + a[0]; width = zero + a[1]; t0 = zero + a[2]; t1 = zero + a[3];
        t2 = zero + a[4]; dt = zero + a[5]; dc = zero + a[6]; steep = zero + a[7];
    };
    auto fetch = [&]() {
        vf c[8];
        columns(table, r, c);
        center = c[0]; width = c[1]; t0 = c[2]; t1 = c[3]; t2 = c[4]; dt = c[5]; dc = c[6]; steep = c[7];
    };
    vf off, delta;
    vi good, crosses = {};
    // Whether rows hold all that cells see (S4).
    auto holds = [&]() {
        off = (base - center) + mean;
        delta = blur + ABS(off) * (OFFSET_ULPS);
        good = (ABS(off) + (R + delta) <= width) | !(h > 0.0f);
    };
    auto all = [&](vi g) -> bool { return bits(g) == 0xffff; };
    bool held = false;
    if (last >= 0) {  // as before
        spread(table + 16 * (int64_t)last);
        holds();
        held = all(good);
        *(vi*)r = (vi){} + last;
    }
    if (!held) {
        // The interval of the middle, and where that ends too early a fitted row.
        const vf q = MIN(MAX((s - rows.low) * rows.scale, zero), zero + (float)(nbins - 1));
        *(vi*)r = __builtin_convertvector(q, vi);
        vf of_bin[3];
        records(bins, r, of_bin);
        vi k = __builtin_convertvector(of_bin[0], vi);
        center = of_bin[1];
        width = of_bin[2];
        holds();
        const bool known = all(good);
        if (!known) {
            // Those that end in another interval than their mean is in.
            const vf far = off + m2 * (2.0f / 3), odd = m1 + m3;
            crosses = (ABS(off) <= width) & (MAX(ABS(far + odd), ABS(far - odd)) > width + delta);
            k = good ? k : fit();
        }
        const bool same = all(k == k[0]);
        *(vi*)r = k;
        if (same) spread(table + 16 * (int64_t)k[0]);
        else fetch();
        if (!known) holds();
        last = same && known ? k[0] : -1;
    }
    for (bool again = true;; again = false) {
        const vf ww = m1 * (m1 * (2.0f / 3) + m3 * 0.8f) + m2 * m2 * (8.0f / 45) + m3 * m3 * (2.0f / 7);
        const vf slope = t1 + 2.0f * off * t2;
        const vf x = MAX(L * (t0 + off * (t1 + off * t2) + t2 * (0.5f * ww)), zero);
        const vf a = 0.5f * x, g = h * slope;
        const Thin thin = series(m1, m2, m3, ww, x, g);
        const vf A = thin.A, V = thin.V;
        // Behind the series (S5, S6).
        const vf G = ABS(g) * R, Q = h * ABS(t2) * (R * R), P = G + Q, aP = a + P;
        const vi straight = (t2 == 0.0f) & (G <= a * (1.0f + SIGN_ULPS));
        const vf rest = straight ? thin.rest : Q * (3.3f + 2.0f * aP) + 1.65f * (aP * aP * aP);
        // And nothing may overflow (S9).
        good &= (straight | (P < 0.5f)) & (R < WIDEST) & (a < DEEPEST);
        // All that the cell is off by (S7, S8).
        const vf size = ABS(t0) + ABS(off) * (ABS(t1) + ABS(off * t2)) + ABS(t2) * (R * R);
        const vf rate = ABS(t1) + 2.0f * (ABS(off) + R) * ABS(t2);
        const vf e = 1.00001f * (bright * L * (dt + rate * delta + (DEPTH_ULPS) * size) + A * (dc + steep * delta)
            + steep * R * (rest + (SERIES_ULPS) * (h * rate * R + a)));
        const vi none = !(h > 0.0f);
        const vi fine = (good & (e <= share * A + absolute * L)) | none;
        *(vf*)out = x;
        *(vf*)(out + room) = A;
        *(vf*)(out + 2 * room) = none ? zero : V;
        *(vf*)(out + 3 * room) = none ? zero : off;
        *(vf*)(out + 4 * room) = none ? zero : good ? e : zero + __builtin_inff();
        if (all(fine)) break;
        bool other = false;
        if (again) {
            // Of a block in one interval, or a cell of equal corners, all that is seen is in it (S4).
            alignas(64) int sure[16];
            *(vi*)sure = fine;
            for (unsigned ask = bits(~(fine | crosses)); ask; ask &= ask - 1) {
                const int l = __builtin_ctz(ask);
                const uint64_t q = place[u + l];
                int k = kinds[((q >> 44) * blocks.kinds.shape[1] + ((q >> 23) & 0x7ffff)) * blocks.kinds.shape[2]
                    + ((q >> 2) & 0x7ffff)];
                if (k < 0) {
                    if (of[6 * CELLS + l] != 0.0f) continue;
                    k = r[l] < fitted ? r[l] : 0;
                    while (k > 0 && of[l] < knots[k]) --k;
                    while (k < fitted - 1 && of[l] >= knots[k + 1]) ++k;
                }
                other |= r[l] != k;
                r[l] = k;
                sure[l] = -1;
            }
            const vi window = *(vi*)sure;
            if (other) {
                fetch();
                holds();
                good |= window & (R == R) & (width >= zero);  // but for rows that hold nothing
            }
        }
        if (other) continue;
        // What is left to others.
        *(vi*)r = fine ? *(vi*)r : -2 - *(vi*)r;
        break;
    }
}
"""
)

# Of each ray sixteen cells at a time, behind those that ``sums`` has.
COMPOSE = (
    FADING
    + """
const float* __restrict table = rows.row.data;
const int64_t room = found.shape[1];
const double share = spend[0], along = spend[1];
int* some = which.data;
int *firsts = rays.first.data, *lasts = rays.last.data, *states = rays.going.data, *counts = rays.count.data;
int* rows_of = row.data;
const double* time = times.data;
int listed = 0;
const vi lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
auto sum = [](vf a) -> float {
    const v8f b = __builtin_shufflevector(a, a, 0, 1, 2, 3, 4, 5, 6, 7)
        + __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15);
    v4f c = __builtin_shufflevector(b, b, 0, 1, 2, 3) + __builtin_shufflevector(b, b, 4, 5, 6, 7);
    c += __builtin_shufflevector(c, c, 2, 3, 0, 1);
    return c[0] + c[1];
};
for (int ray = 0; ray < rays.going.shape[0]; ++ray) {
    double* total = rays.sums.data + 5 * ray;
    const double *line = rays.lines.data + rays.lines.shape[1] * ray, clear = line[8];
    int at = firsts[ray];
    const int stop = LIGHTED ? MIN(at + 16, lasts[ray]) : lasts[ray];
    for (; at < stop && 1.0 - total[3] >= clear; at += 16) {
        const int n = MIN(stop - at, 16);
        const vi mine = lane < n;
        const float* in = found.data + at;
        auto of = [&](int i) -> vf { return mine ? *(const vf*)(in + i * room) : zero; };
        const vf A = of(1), e = of(4);
        const double front = 1.0 - total[3];
        vi k = mine ? *(const vi*)(rows_of + at) : (vi){} + rows_of[at];
        if (bits(k < -1)) {
            // So much each of what the ray was allowed so far and has not spent, as long as there is anything.
            const double left = line[9] + share * total[3] + along * (time[at] - line[6]) - total[4];
            const float most = astray ? -__builtin_inff() : (float)(0.999 * left / front);
            v8f long8[2];
            for (int b = 0; b < 2; ++b) {
                const double* t = time + at + 8 * b;
                long8[b] = __builtin_convertvector(*(const vd*)(t + times.shape[1]) - *(const vd*)t, v8f);
            }
            const vf over = e - (spend[0] * A + spend[1] * JOIN(long8[0], long8[1]));
            // Behind the last of the ray's, times are whatever was there.
            const vi open = (k < -1) & mine;
            vi spent = open & (over <= (LEFT) * most);
            // Or less each, where all of them are more than there is.
            if (sum(spent ? MAX(over, zero) : zero) > most) spent = open & (over <= most * (1.0f / 16));
            k = spent ? -2 - k : k;
            const unsigned left_over = bits(open & ~spent);
            *(vi*)(rows_of + at) = mine ? k : *(const vi*)(rows_of + at);
            // Those that are spent have no light yet.
            if (left_over | (LIGHTED && bits(spent))) {
                for (unsigned rest = left_over; rest; rest &= rest - 1) {
                    ++listed;
                    some[listed] = at + __builtin_ctz(rest);
                    some[which.shape[1] + listed] = ray;
                }
                break;
            }
            k = mine ? k : k[0];
        }
        const vf x = of(0), V = of(2), off = of(3);
        // Transparency before each: prefix sums of depth (S11).
        vf p = x;
        p += __builtin_shufflevector(p, zero, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14);
        p += __builtin_shufflevector(p, zero, 16, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13);
        p += __builtin_shufflevector(p, zero, 16, 16, 16, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11);
        p += __builtin_shufflevector(p, zero, 16, 16, 16, 16, 16, 16, 16, 16, 0, 1, 2, 3, 4, 5, 6, 7);
        const vf T = fading(__builtin_shufflevector(p, zero, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14));
        const vf TA = T * A, TV = T * V + TA * off;
        v4f color[4] = {};
        if (bits(k != k[0]) == 0 && k[0] >= 0) {
            const float* a = table + 16 * (int64_t)k[0];
            color[0] = sum(TA) * *(const v4f*)(a + 8) + sum(TV) * *(const v4f*)(a + 12);
        } else {
            alignas(64) int r[16];
            *(vi*)r = MAX(k, (vi){});
            vf by_row = TA, by_slope = TV;
            const unsigned cut = bits((k < 0) & mine);
            if (cut) {
                // Of a cell that was cut, its colour is in place of what others have.
                alignas(64) float t[16];
                *(vf*)t = T;
                by_row = k < 0 ? zero : TA;
                by_slope = k < 0 ? zero : TV;
                for (unsigned rest = cut; rest; rest &= rest - 1) {
                    const int l = __builtin_ctz(rest);
                    color[l & 3] += t[l] * (v4f){in[2 * room + l], in[3 * room + l], in[5 * room + l], 0.0f};
                }
            }
            // Colours and slopes of two rows at a time.
            vf both[2] = {};
#define FOUR(l) l, l, l, l
#define OF_ROW(l) *(const v8f*)(table + 16 * (int64_t)r[l] + 8)
#define TWO(l) \\
            both[(l >> 1) & 1] += JOIN(OF_ROW(l), OF_ROW(l + 1)) * __builtin_shufflevector( \\
                by_row, by_slope, FOUR(l), FOUR(l + 16), FOUR(l + 1), FOUR(l + 17));
            TWO(0) TWO(2) TWO(4) TWO(6) TWO(8) TWO(10) TWO(12) TWO(14)
            both[0] += both[1];
            for (int m = 0; m < 4; ++m) color[m] += *((const v4f*)both + m);
        }
        color[0] = (color[0] + color[1]) + (color[2] + color[3]);
        for (int c = 0; c < 3; ++c) total[c] += front * color[0][c];
        total[3] += front * sum(TA);
        total[4] += front * 1.00001f * sum(T * e);
    }
    at = MIN(at, stop);
    counts[ray] += at - firsts[ray];
    firsts[ray] = at;
    int& going = states[ray];
    if (1.0 - total[3] < clear && (at < lasts[ray] || going)) going = 2;
}
some[0] = listed;
"""
)


def _filled(text):
    """A text with the numbers of ``single``."""
    for name in NAMES:
        text = text.replace(name, f"{getattr(single, name)!r}f")
    return text.replace("CELLS", str(CELLS))


@cache
def make_packet(lighted=False):
    """``measure`` and ``compose`` as of ``single``; where cells are ``lighted`` in between, ``LANES`` of each ray at a
    time, and none that was just spent.
    """

    @wp.func_native(_filled(MEASURE))
    def measure(
        rows: Rows,
        blocks: Blocks,
        spend: wp.vec3,
        cells: wp.array(dtype=wp.uint64),
        some: wp.vec2i,
        cubic: wp.array2d(dtype=wp.float32),
        found: wp.array2d(dtype=wp.float32),
        row: wp.array(dtype=int),
    ): ...

    # With registers of its own.
    composed = apart(_filled(COMPOSE.replace("LIGHTED", str(int(lighted)))))

    @wp.func_native(composed + "return *which.data;")
    def compose(
        rows: Rows,
        rays: Rays,
        times: wp.array2d(dtype=wp.float64),
        found: wp.array2d(dtype=wp.float32),
        row: wp.array(dtype=int),
        spend: wp.vec3,
        astray: bool,
        which: wp.array2d(dtype=int),
    ) -> int: ...

    return measure, compose
