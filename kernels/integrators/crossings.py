"""Cells in which the scalar reaches control points, in lanes: as ``packed.make_double`` has them, and why it holds.

The cubic of a cell is cut where it turns into parts that rise or fall. A part goes through its intervals of the
transfer function one by one, in a lane of its own; where the series does not hold for all of an interval, in as many
steps as it takes. Where the scalar reaches a control point is found in double precision, what is between in single.
Letters and numbers are those of docs/proof-single.md.
"""

from functools import cache

import warp as wp

from ..field.gradients import ROWS
from ..light.points import Lights
from ..light.shine import rows_of
from ..transfer.function import make_transfer
from ..transfer.rows import Rows
from ..vectors import VECTORS, apart
from .lit import JOBS, MEMBERS, Task, light_text
from .packet import COLUMNS, FADING, SERIES
from .series import VALUE
from .single import DEEPEST, SERIES_ULPS, WIDEST, U

# Rounding of a scalar on a part, of how it is evaluated and of where it turns, in parts of its coefficients (S13).
RIPPLE = 2.0**-46
# Newton's method ends where a residual is so little, in parts of the scalars of a part.
CLOSE = 1e-11
# Rounding of a piece's numbers to single precision (S14), and of what a part comes to, in parts of its opacity (S15).
ROUNDED = 2 * U
ADDED = 64 * U
# Of opacity (S14), in parts of it.
OPACITY_ULPS = 16 * U
# What a line that is drawn too far adds where its extinction falls below 0 (S13).
FALLEN = 4.3
# What a piece may be off by in any case, in parts of the brightest colour.
LITTLE = 1e-11
# Steps of a part, of which one more is left to others.
STEPS = 48

# Parts of cells that rise or fall.
PARTS = """
struct Part {
    double m0, m1, m2, m3, h, begin, end;  // a cubic in v from -1 to 1, half the length, the scalar at its ends
    int first, last, job;  // the first and the last interval, and the cell
    bool inside;  // it ends in the last
    float blur;  // rounding of the scalar
    float mid, wide;  // of the cell
    float x, A, color[3], e, pieces;
};
const float *__restrict table = rows.row.data, *__restrict bins = rows.bins.data;
const double* __restrict knots = rows.knots.data;
const int* __restrict seen = transfer.visible.data;
const auto *__restrict values = transfer.value.data, *__restrict slopes = transfer.slope.data;
int *some = which.data, *rays = some + which.shape[1];
const int64_t wide = found.shape[1];
const int outer = rows.fitted - 1, nbins = rows.bins.shape[0];
const float bright = spend[2], share = spend[0] - (ADDED) * bright, absolute = spend[1];
const double low = rows.low, scale = rows.scale;
auto interval = [&](double s) -> int {
    double q = (s - low) * scale;
    q = q > 0.0 ? q : 0.0;
    int k = (int)bins[4 * (q < nbins - 1 ? (int)q : nbins - 1)];
    while (k > 0 && s < knots[k]) --k;
    while (k < outer && s >= knots[k + 1]) ++k;
    return k;
};
Part parts[3 * JOBS];
float unseen[JOBS];  // bounds on what is not visited
int number = 0;
const int n = some[0];
const double* of = cubic.data;
// Of those that rise or fall all the way and begin and end in the intervals of their bins, these; else -1.
alignas(32) int in[2][JOBS];
alignas(64) double tips[2][JOBS];
for (int j = 0; j < n; j += 8) {
#define ROW(i) (*(const vd*)(of + i * JOBS + j))
    const vd m0 = ROW(0), m1 = ROW(1), m2 = ROW(2), m3 = ROW(3), ends[2] = {m0 - m1 + m2 - m3, m0 + m1 + m2 + m3};
    vq sure = (ABSD(m1) > 2.0 * ABSD(m2) + 3.0 * ABSD(m3)) & (ABSD(m0) + ABSD(m1) + ABSD(m2) + ABSD(m3) < 1e300);
    v8i k[2];
    for (int e = 0; e < 2; ++e) {
        alignas(64) double from[8], to[8];
        alignas(32) int bin[8], of_bin[8];
        const vd q = MIN(MAX((ends[e] - low) * scale, (vd){}), (vd){} + (nbins - 1.0));
        *(v8i*)bin = __builtin_convertvector(q, v8i);
#pragma clang loop vectorize(disable)
        for (int l = 0; l < 8; ++l) {
            const int a = (int)bins[4 * bin[l]];
            of_bin[l] = a;
            from[l] = knots[a];
            to[l] = knots[MIN(a + 1, outer)];
        }
        k[e] = *(const v8i*)of_bin;
        sure &= ((ends[e] >= *(const vd*)from) | __builtin_convertvector(k[e] == 0, vq))
            & ((ends[e] < *(const vd*)to) | __builtin_convertvector(k[e] == outer, vq));
    }
    for (int e = 0; e < 2; ++e) {
        *(v8i*)(in[e] + j) = k[e] | ~__builtin_convertvector(sure, v8i);
        *(vd*)(tips[e] + j) = ends[e];
    }
}
for (int j = 0; j < n; ++j) {
    const double m0 = of[j], m1 = of[JOBS + j], m2 = of[2 * JOBS + j], m3 = of[3 * JOBS + j], half = of[4 * JOBS + j];
    const float blur = (float)of[5 * JOBS + j];
    unseen[j] = 0.0f;
    const bool simple = in[0][j] >= 0;
    if (!simple && !(fabs(m0) + fabs(m1) + fabs(m2) + fabs(m3) < 1e300)) continue;
    double turn[3];
    int turns = 0;
    if (!simple && !(fabs(m1) > 2.0 * fabs(m2) + 3.0 * fabs(m3))) {
        const double square = m2 * m2 - 3.0 * m3 * m1;
        if (square > 0.0) {
            const double root = -(m2 + (m2 < 0.0 ? -sqrt(square) : sqrt(square)));
            const double a = fabs(m1) < fabs(root) ? m1 / root : 1.0;
            const double b = fabs(root) < 3.0 * fabs(m3) ? root / (3.0 * m3) : 1.0;
            turn[0] = a < b ? a : b;
            turn[1] = a < b ? b : a;
            turns = (turn[0] < 1.0) + (turn[1] < 1.0);
        }
    }
    turn[turns] = 1.0;
    double from = -1.0;
    for (int i = 0; i <= turns; ++i) {
        Part& p = parts[number];
        double w = 1.0;
        if (simple) {
            p.m0 = m0;
            p.m1 = m1;
            p.m2 = m2;
            p.m3 = m3;
            p.h = half;
            p.mid = 0.0f;
            p.wide = 1.0f;
            p.begin = tips[0][j];
            p.end = tips[1][j];
        } else {
            const double v = 0.5 * (from + turn[i]), bend = m2 + 3.0 * v * m3;
            w = 0.5 * (turn[i] - from);
            from = turn[i];
            p.m0 = m0 + v * (m1 + v * (m2 + v * m3));
            p.m1 = w * (m1 + v * (m2 + bend));
            p.m2 = w * w * bend;
            p.m3 = w * w * w * m3;
            p.h = w * half;
            p.mid = (float)v;
            p.wide = (float)w;
            p.begin = p.m0 - p.m1 + p.m2 - p.m3;
            p.end = p.m0 + p.m1 + p.m2 + p.m3;
        }
        p.job = j;
        // From the interval before the first with something to see, which it leaves where that begins, to the last.
        const int a = simple ? in[0][j] : interval(p.begin), b = simple ? in[1][j] : interval(p.end);
        const int s = p.end > p.begin ? 1 : -1;
        const int least = seen[MIN(a, b)], most = MAX(a, b);
        int first = a, last = b;
        // Whether an interval with nothing to see is to be visited: what rounding takes beyond it counts, if it can.
        auto missed = [&](int k) -> bool {
            const float slope = table[16 * k + 11];
            if (blur > 0.0f && slope < __builtin_inff()) unseen[j] += 2.0f * bright * (float)(w * half) * blur * slope;
            return blur > 0.0f && !(slope < __builtin_inff());
        };
        if (least > most) {
            const bool before = missed(a), behind = missed(b);
            if (!before && !behind) continue;
            first = last = before ? a : b;
        } else {
            int highest = most;
            while (seen[highest] != highest) --highest;
            first = s > 0 ? least : highest;
            last = s > 0 ? highest : least;
            first = first == a ? a : first - s;
            if (first != a && missed(a)) first = a;
            if (last != b && missed(b)) last = b;
        }
        p.blur = blur;
        p.first = first;
        p.last = last;
        p.inside = last == b;
        ++number;
    }
}
"""

CROSSINGS = """
// Sixteen of them at a time: where each has got to, how far it may go at once, and what it has come to.
alignas(64) double m[4][16] = {}, half[16] = {}, begin[16] = {}, end[16] = {}, sign[16], at[16], room[16], off_knot[16];
alignas(64) double sum[5][16];
alignas(64) float error[16], pieces_of[16], blur[16] = {};
alignas(64) int k[16] = {}, last[16] = {}, inside[16] = {}, steps[16], part[16];
int next = 0, busy = 0;
LIT_LANES
auto take = [&](int l) {
    part[l] = next < number ? next++ : -1;
    const Part& p = parts[part[l] < 0 ? 0 : part[l]];
    busy += part[l] >= 0;
    // One without a part stays where it is.
    const bool idle = part[l] < 0;
    const double used = idle ? 0.0 : 1.0;
    m[0][l] = used * p.m0; m[1][l] = used * p.m1; m[2][l] = used * p.m2; m[3][l] = used * p.m3;
    half[l] = used * p.h; begin[l] = used * p.begin; end[l] = used * p.end;
    sign[l] = p.end > p.begin ? 1.0 : -1.0;
    blur[l] = idle ? 0.0f : p.blur;
    at[l] = -1.0; room[l] = 2.0; off_knot[l] = 0.0;
    k[l] = p.first; last[l] = idle ? p.first : p.last; inside[l] = -(int)(idle | p.inside); steps[l] = 0;
    for (int i = 0; i < 5; ++i) sum[i][l] = 0.0;
    error[l] = pieces_of[l] = 0.0f;
    LIT_TAKEN
};
if (number) for (int l = 0; l < 16; ++l) take(l);
while (busy) {
    // Where they reach the control points at the ends of their intervals, or end themselves.
    alignas(64) double exit[16], knot[16], value[16], rate[16];
    for (int l = 0; l < 16; ++l) {
        exit[l] = knots[MIN(k[l] + (sign[l] > 0.0), outer)];
        knot[l] = knots[k[l]];
        value[l] = values[k[l]].c[3];
        rate[l] = slopes[k[l]].c[3];
    }
#define HALF(a) (*(const vd*)(a + 8 * b))
#define HALF_OF(a) (*(vd*)(a + 8 * b))
#define MASK(a) __builtin_convertvector(*(const v8i*)((const int*)&a + 8 * b), vq)
#define EACH for (int b = 0; b < 2; ++b)
    const vi on_last = *(const vi*)k == *(const vi*)last, ends = on_last & *(const vi*)inside;
    vd v[2], F[2], stop[2];
    EACH {
        // From a parabola that has the slope at the start, and both ends.
        const vd a = HALF(begin), s1 = HALF(m[1]) - 2.0 * HALF(m[2]) + 3.0 * HALF(m[3]);
        const vd rise = HALF(exit) - a, square = s1 * s1 + (HALF(end) - a - 2.0 * s1) * rise;
        const vd slope = s1 + HALF(sign) * __builtin_elementwise_sqrt(MAX(square, (vd){}));
        v[b] = MASK(ends) ? (vd){} + 1.0 : MIN(MAX(2.0 * rise / slope - 1.0, HALF(at)), (vd){} + 1.0);
    }
    for (int i = 0;; ++i) {
        vq far[2], any = {};
        EACH {
            const vd m1 = HALF(m[1]), m2 = HALF(m[2]), m3 = HALF(m[3]);
            F[b] = MASK(ends) ? (vd){} : (HALF(m[0]) - HALF(exit)) + v[b] * (m1 + v[b] * (m2 + v[b] * m3));
            any |= far[b] = ABSD(F[b]) > CLOSE * ABSD(HALF(end) - HALF(begin));
        }
        if (!__builtin_reduce_or(any) || i == 6) break;
        EACH {
            const vd slope = HALF(m[1]) + v[b] * (2.0 * HALF(m[2]) + v[b] * (3.0 * HALF(m[3])));
            v[b] = far[b] ? MIN(MAX(v[b] - F[b] / slope, HALF(at)), (vd){} + 1.0) : v[b];
        }
    }
    // The piece up to there, or as far as the lane may go.
    alignas(64) float n[11][16], most[16], worst[16];
    vf c[8], color[8];
    columns(table, k, c);
    columns(table + 8, k, color);
    EACH {
        const vd m1 = HALF(m[1]), m2 = HALF(m[2]), m3 = HALF(m[3]), from = HALF(at);
        stop[b] = MIN(v[b], from + HALF(room));
        const vd w = 0.5 * (stop[b] - from), mid = 0.5 * (stop[b] + from), bend = m2 + 3.0 * mid * m3;
        const vd n2 = w * w * bend, mean = HALF(m[0]) + mid * (m1 + mid * (m2 + mid * m3)) + n2 * (1.0 / 3);
#define NARROW(i, a) *(v8f*)(n[i] + 8 * b) = __builtin_convertvector(a, v8f)
        NARROW(0, w * (m1 + mid * (m2 + bend)));
        NARROW(1, n2);
        NARROW(2, w * w * w * m3);
        NARROW(3, w * HALF(half));
        NARROW(4, mean - __builtin_convertvector(*(const v8f*)((const float*)c + 8 * b), vd));
        NARROW(5, MAX(HALF(off_knot), ABSD(F[b])) + RIPPLE * (ABSD(m1) + ABSD(m2) + ABSD(m3)));
        // What of a part is behind its last piece.
        NARROW(6, (MASK(on_last) & (stop[b] == v[b])) ? (1.0 - stop[b]) * HALF(half) : (vd){});
        NARROW(7, 2.0 * w * HALF(half) * (HALF(value) + (mean - HALF(knot)) * HALF(rate)));
        NARROW(8, w * HALF(half) * HALF(rate));
        NARROW(9, mid);
        NARROW(10, w);
    }
#define WHOLE(i) (*(const vf*)n[i])
    const vf m1 = WHOLE(0), m2 = WHOLE(1), m3 = WHOLE(2), h = WHOLE(3), off = WHOLE(4);
    const vf rounded = *(const vf*)blur, astray = WHOLE(5) + rounded;
    const vf steep = c[7], L = h + h, R = ABS(m1) + ABS(m2) * (2.0f / 3) + ABS(m3);
    const vf ww = m1 * (m1 * (2.0f / 3) + m3 * 0.8f) + m2 * m2 * (8.0f / 45) + m3 * m3 * (2.0f / 7);
    const vf line = WHOLE(7), x = MAX(line, zero), slope = WHOLE(8);
    const Thin thin = series(m1, m2, m3, ww, x, slope);
    // What the series leaves out: by theorem 2 or theorem 3 of the proof.
    const vf a = 0.5f * x, G = ABS(slope) * R;
    const vf closer = R * G * (a * (a + G) + G * G) * 0.33334f + a * a * a * (0.0889f * ABS(m2) + 0.08334f * R * a);
    // What it is off by (S13, S14).
    const vf delta = (ABS(off) + R) * (ROUNDED) + rounded;
    const vf over = astray * color[3] + (VALUE) * (ABS(c[2]) + ABS(c[3]) * c[1]);
    const vf d = line < 0.0f ? over + over : over;
    const vf linear = bright * (L * d + WHOLE(6) * over)
        + thin.A * (bright * (OPACITY_ULPS) + c[6] + steep * delta + astray * color[7]);
    const vf e = 1.00001f * (linear
        + steep * (FALLEN * R * (L * d) + MIN(R * thin.rest, closer) + (SERIES_ULPS) * R * (G + a)));
    *(vf*)most = share * thin.A + absolute * L + (LITTLE) * bright;
    // A width below 0 says that the row holds nothing; and nothing overflows (S9).
    const vi holds = (c[1] >= zero) & (R < WIDEST) & (x < 2.0f * DEEPEST);
    // Nor would a shorter piece do where what it is off by in parts of its length is too much.
    *(vf*)worst = (holds & (linear <= *(const vf*)most)) ? e : zero + __builtin_inff();
    const vi good = (e <= *(const vf*)most) & (astray <= rows.narrow) & holds;
    // Behind what there is of the part (S15).
    auto add = [&](int i, vf a) {
        EACH HALF_OF(sum[i]) += __builtin_convertvector(*(const v8f*)((const float*)&a + 8 * b), vd);
    };
    v8f front[2];
    EACH front[b] = __builtin_convertvector(HALF(sum[0]), v8f);
    const vf T = fading(JOIN(front[0], front[1])), TA = good ? T * thin.A : zero;
    const vf TV = good ? T * thin.V + TA * off : zero;
    add(0, good ? x : zero);
    add(1, TA);
    COLORED
    *(vf*)error += good ? T * e : zero;
    *(vf*)pieces_of += good ? zero + 1.0f : zero;
    // On to the next interval, or the next step in this one.
    alignas(64) int on[16];
    EACH {
        const vq fine = MASK(good), reached = (stop[b] == v[b]) & fine;
        HALF_OF(at) = fine ? stop[b] : HALF(at);
        // Behind a shorter step it may still be where it was.
        HALF_OF(off_knot) = reached ? ABSD(F[b]) : HALF(off_knot);
        HALF_OF(room) = reached ? (vd){} + 2.0 : HALF(room);
        *(v8i*)(on + 8 * b) = __builtin_convertvector(reached, v8i);
        const vq way = __builtin_convertvector(HALF(sign), vq) & ~MASK(on_last);
        *(v8i*)(k + 8 * b) += __builtin_convertvector(reached & way, v8i);
    }
    *(vi*)steps += 1;
    const vi done = *(const vi*)on & on_last, stuck = ~good | (*(const vi*)steps > STEPS);
    for (unsigned some = bits((done | stuck) & (*(const vi*)part >= 0)); some; some &= some - 1) {
        const int l = __builtin_ctz(some);
        Part& p = parts[part[l]];
        if (done[l]) {
            p.x = (float)sum[0][l]; p.A = (float)sum[1][l]; p.pieces = pieces_of[l];
            for (int i = 0; i < 3; ++i) p.color[i] = (float)sum[2 + i][l];
            p.e = error[l] + bright * (ADDED) * p.A;
        } else {
            // So much of it that it will do, or it is left to others.
            const float part_of = 0.9f * cbrtf(most[l] / worst[l]);
            if (steps[l] <= STEPS && part_of > 1.0f / 64) {
                room[l] = part_of * (stop[l >> 3][l & 7] - at[l]);
                continue;
            }
            p.pieces = -1.0f;
        }
        --busy;
        take(l);
    }
}
// The parts of a cell one behind the other.
int total = 0;
for (int j = 0, i = 0; j < n; ++j) {
    const int cell = some[1 + j], ray = rays[1 + j];
    float x = 0.0f, A = 0.0f, color[3] = {}, e = unseen[j], count = 0.0f;
    bool left = false;
    for (; i < number && parts[i].job == j; ++i) {
        const Part& p = parts[i];
        const float T = 1.0f - A;
        x += p.x;
        A += T * p.A;
        for (int c = 0; c < 3; ++c) color[c] += T * p.color[c];
        e += T * p.e;
        count += MAX(p.pieces, 0.0f);
        left |= p.pieces < 0.0f;
    }
    float* to = found.data + cell;
    const float all[6] = {x, A, color[0], color[1], e, color[2]};
    for (int i = 0; i < 6; ++i) to[i * wide] = all[i];
    *(row.data + cell) = -1;
    *(pieces.data + ray) += (int)count;
    if (left) {
        some[++total] = cell;
        rays[total] = ray;
    }
}
some[0] = total;
"""


# What a lane has of light, what it takes of a part, and what is seen of a piece, without and with.
DARK = {
    "LIT_LANES": "",
    "LIT_TAKEN": "",
    "COLORED": "for (int i = 0; i < 3; ++i) add(2 + i, TA * color[i] + TV * color[4 + i]);",
}
LIT = {
    "LIT_LANES": f"alignas(64) float gradient_of[{ROWS}][16] = {{}}, mid_of[16] = {{}}, wide_of[16] = {{}};",
    "LIT_TAKEN": f"""
    for (int i = 0; i < {ROWS}; ++i) gradient_of[i][l] = *(gradient.data + i * gradient.shape[1] + p.job);
    mid_of[l] = p.mid;
    wide_of[l] = p.wide;
""",
    "COLORED": """
    const vf span = *(const vf*)wide_of;
    Lit p = {x, thin.A, slope, m1, m2, m3, *(const vf*)mid_of + span * WHOLE(9), span * WHOLE(10)};
    p.V = thin.V;
    p.off = off;
    for (int i = 0; i < 8; ++i) p.color[i] = color[i];
    for (int i = 0; i < LIT_ROWS; ++i) p.gradient[i] = *(const vf*)gradient_of[i];
    vf shone[3];
    lit(p, good, T, shone);
    for (int i = 0; i < 3; ++i) add(2 + i, good ? T * shone[i] : zero);
""",
}


@cache
def make_crossings(lighted=False, clipped=False):
    """``cut(rows, transfer, spend, cubic, which, found, row, pieces)``; where it is ``lighted``, of rays that clips cut
    or not, ``cut(rows, transfer, spend, lights, task)``, a ``lit.Task``, and that lights cells as well: compilers take
    long enough for one of them.

    ``which`` (2, n) has how many cells and which they are, and behind that their rays: in the end, of those that are
    left to others. ``cubic`` (6, JOBS) is as of ``field.cubics.make_centered``; ``rows``, ``spend``, ``found`` and
    ``row`` are as of ``single``, where it puts what they are; ``pieces`` counts those of each ray.
    """
    Transfer, _, _ = make_transfer(wp.float64)
    text = PARTS + CROSSINGS
    numbers = {
        "OPACITY_ULPS": OPACITY_ULPS,
        "SERIES_ULPS": SERIES_ULPS,
        "ROUNDED": ROUNDED,
        "ADDED": ADDED,
        "FALLEN": FALLEN,
        "LITTLE": LITTLE,
        "VALUE": VALUE,
        "WIDEST": WIDEST,
        "DEEPEST": DEEPEST,
    }
    for name, value in numbers.items():
        text = text.replace(name, f"{value!r}f")
    for name, value in {"RIPPLE": RIPPLE, "CLOSE": CLOSE, "STEPS": STEPS, "JOBS": JOBS}.items():
        text = text.replace(name, repr(value))

    for name, code in (LIT if lighted else DARK).items():
        text = text.replace(name, code)
    text = text.replace("LIT_ROWS", str(rows_of(clipped)))
    if lighted:
        members = "".join(f"auto& {name} = task.{name};\n" for name in MEMBERS)
        text = apart(FADING + SERIES + COLUMNS + members + light_text(clipped) + text)

        @wp.func_native(text)
        def cut(rows: Rows, transfer: Transfer, spend: wp.vec3, lights: Lights, task: Task): ...

    else:
        # The pragma of the first is at the beginning.
        @wp.func_native(VECTORS + FADING + SERIES + COLUMNS + text)
        def cut(
            rows: Rows,
            transfer: Transfer,
            spend: wp.vec3,
            cubic: wp.array2d(dtype=wp.float64),
            which: wp.array2d(dtype=int),
            found: wp.array2d(dtype=wp.float32),
            row: wp.array(dtype=int),
            pieces: wp.array(dtype=int),
        ): ...

    return cut
