"""The eye's rays through slices of light, sixteen abreast, in vectors: what ``slices`` says of one, of whole volumes of
finite samples in single precision by a table, in traced light.

Each ray is at a part of its own. What dense tissue receives is only needed in sums, so it waits until there are sixteen
places to trace light back from.
"""

from functools import cache

import warp as wp

from ..field.samples import make_samples
from ..field.scalars import scalars_of
from ..field.strides import FULL
from ..transfer.lookup import make_table
from ..vectors import VECTORS, wide
from .between import LIGHT
from .lanes import ABSORBED, COLUMNS, ENTRIES, EXTINCTIONS, INSIDE, LOOKUP
from .points import Lights
from .shine import PLACES
from .travel import Sweep

# Rays abreast.
LANES = 16
# Numbers of each: origin, direction and length, where parts begin, distance of slices, where it is in light's cells and
# what that grows by, what is already hidden of it, and the unit vector to the viewer.
GIVEN = 17
# How far behind a face a ray is in the block behind it.
OUTSIDE = 1.0e-3
# And what it has come to: colour without shadows and with, opacity, and parts that were looked at.
FOUND = 8

TASK = """
const auto& octants = task.octants;
const auto& pairs = sweep.pairs;
const wp::vec_t<3, double>&low = task.low, &high = task.high;
const auto& side = sweep.side.data;
const int slice = task.slice, turn = task.turn, count = task.count;
const float least = task.least;
const float* given = rays.data;
"""

NUMBERS = """
auto sum = [](vf a) -> float {
    const v8f low = __builtin_shufflevector(a, a, 0, 1, 2, 3, 4, 5, 6, 7);
    const v8f b = low + __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15);
    const v4f c = __builtin_shufflevector(b, b, 0, 1, 2, 3) + __builtin_shufflevector(b, b, 4, 5, 6, 7);
    return (c[0] + c[1]) + (c[2] + c[3]);
};
// Of x > 0.
auto logarithm = [](vf x) -> vf {
    const vi bits = (vi)x, e = (bits - 0x3f3504f3) >> 23;
    const vf m = (vf)(bits - (e << 23)), z = (m - 1.0f) / (m + 1.0f), q = z * z;
    const vf p = 1.0f + q * (1.0f / 3 + q * (1.0f / 5 + q * (1.0f / 7 + q * (1.0f / 9))));
    return 2.0f * z * p + __builtin_convertvector(e, vf) * 0.693147180559945f;
};
"""

# Places where light is asked for, and parts of rays between two of them each.
TRACED = """
struct Waiting {
    float place[6][16 + POINTS];  // x, y, z, u, v, and of the slices
    float L[16 + POINTS], D[16 + POINTS];
    float part[4][POINTS];  // its color, and optical depth
    float rest[POINTS];  // as much of the light at its end is seen as if it went on forever
    int from[POINTS], to[POINTS], lane[POINTS];
    int ends[16];  // the place where the last part of a ray ended
    int places, parts;
};
alignas(64) Waiting waiting;
waiting.places = 16;
waiting.parts = 0;
for (int l = 0; l < 16; ++l) waiting.ends[l] = l;
alignas(64) float shone[3][16] = {}, near[16] = {}, far[16] = {};
#define AT(a, l) (*(vf*)((a) + (l)))
auto trace = [&]() __attribute__((noinline)) {
    Waiting& w = waiting;
    if (w.parts == 0) return;
    for (int l = w.places; l & 15; ++l)
        for (int c = 0; c < 6; ++c) w.place[c][l] = w.place[c][w.places - 1];
    for (int l = 16; l < w.places; l += 16) {
        const vf u = AT(w.place[3], l), v = AT(w.place[4], l), slot = AT(w.place[5], l);
        vf d[3], p[3], slant = none + (float)sweep.slant;
        const vf i = u + (float)sweep.corner[0], j = v + (float)sweep.corner[1];
        for (int c = 0; c < 3; ++c) {
            d[c] = none + (float)sweep.along[c];
            if (sweep.diverging) d[c] += i * (float)side[c][0] + j * (float)side[c][1];
            p[c] = AT(w.place[c], l);
        }
        if (sweep.diverging) slant = __builtin_elementwise_sqrt(1.0f + (float)sweep.widening * (i * i + j * j));
        // There is light of slices from the first on.
        const vf back = LESS((float)sweep.reach / slant, slot * (float)sweep.thickness);
        for (int c = 0; c < 3; ++c) d[c] *= -back;
        vf a, b;
        inside(p, d, a, b);
        const vf h = MORE(b - a, none) * (1.0f / (float)sweep.steps);
        for (int c = 0; c < 3; ++c) {
            p[c] += a * d[c];
            d[c] *= h;
        }
        vi from, to;
        vf total = none, x = at(scalars(p[0], p[1], p[2]), from);
        for (int m = 0; m < sweep.steps; ++m) {
            for (int c = 0; c < 3; ++c) p[c] += d[c];
            const vf y = at(scalars(p[0], p[1], p[2]), to);
            total += extinctions(from, x, to, y);
            from = to;
            x = y;
        }
        const vf D = AT(w.D, l) = b > a ? total * h * back * slant : none;
        const vf s = slot - back / (float)sweep.thickness;
        const vi number = MORE(LESS(__builtin_convertvector(s, vi), first + (int)(stack.shape[0] - 2)), first);
        const vf share = s - __builtin_convertvector(number, vf);
        alignas(64) int slices[16];
        alignas(64) float before[16], after[16];
        *(vi*)slices = number;
        for (int n = 0; n < 16; ++n) two_lights(slices[n], w.place[3][l + n], w.place[4][l + n], before[n], after[n]);
        const vf takes = D * (float)sweep.thickness / MORE(back, none + LEAST);
        AT(w.L, l) = MORE(faded(AT(before, 0), AT(after, 0), share, takes, none, none), none + LEAST);
    }
    for (int l = 0; l < w.parts; l += 16) {
        alignas(64) float L0[16], D0[16], L1[16], D1[16];
        for (int n = 0; n < 16; ++n) {
            const int i = l + n < w.parts ? l + n : l;
            L0[n] = w.L[w.from[i]];
            D0[n] = w.D[w.from[i]];
            L1[n] = w.L[w.to[i]];
            D1[n] = w.D[w.to[i]];
        }
        // Emission of 1 over an optical depth D in light whose logarithm is linear in it.
        const vf D = AT(w.part[3], l), l0 = AT(L0, 0), l1 = AT(L1, 0), d0 = AT(D0, 0), d1 = AT(D1, 0);
        const vf y = ABS(D + d1 - d0 + logarithm(l0 / l1));
        const vf start = l0 * (1.0f - absorbed(d0)), stop = l1 * (1.0f - absorbed(d1 + D)), most = MORE(start, stop);
        const vf whole = D * most * (y < 1.0e-4f ? none + 1.0f : absorbed(y) / MORE(y, none + 1.0e-4f));
        const vf seen = whole + AT(w.rest, l) * stop;
        for (int c = 0; c < 3; ++c) AT(w.part[c], l) *= seen;
        for (int n = 0; n < 16 && l + n < w.parts; ++n)
            for (int c = 0; c < 3; ++c) shone[c][w.lane[l + n]] += w.part[c][l + n];
    }
    for (int n = 0; n < 16; ++n) {
        const int i = w.ends[n];
        w.L[n] = w.L[i];
        w.D[n] = w.D[i];
        w.ends[n] = n;
    }
    w.places = 16;
    w.parts = 0;
};
"""

# In lights of the scene, a part in its middle.
LIT_PART = """
        if (bits(seen)) {
            const vf m = a + 0.5f * length, eye[3] = {none + of(14), none + of(15), none + of(16)};
            const vf p[3] = {of(0) + m * of(3), of(1) + m * of(4), of(2) + m * of(5)};
            vf I[6];
            intensities(p, eye, I);
            for (int c = 0; c < 3; ++c) q[c] = (ambient + I[c]) * q[c] + I[3 + c] * tau;
        }
"""

# Which parts of each ray there may be something to see in, block by block: numbers of the places that they are between.
WALK = """
#define GIVEN(m) (*(const vf*)(given + 16 * (m)))
#define FLOOR __builtin_elementwise_floor
#define CEIL __builtin_elementwise_ceil
#define INT(a) __builtin_convertvector(a, vi)
#define FLOAT(a) __builtin_convertvector(a, vf)
const vf o[3] = {GIVEN(0), GIVEN(1), GIVEN(2)}, d[3] = {GIVEN(3), GIVEN(4), GIVEN(5)};
const vf length = GIVEN(6), t0 = GIVEN(7), part = GIVEN(8) * (1.0f / (float)sweep.parts), rate = 1.0f / part;
const vf last = none + (float)(count * sweep.parts), stop = LESS(length, t0 + last * part), FAR = none + 1.0e30f;
vf inverse[3];
for (int c = 0; c < 3; ++c) inverse[c] = 1.0f / d[c];
const int bx = octants.shape[3], by = octants.shape[2];
const vi way = ((d[0] > 0.0f) & 1) | ((d[1] > 0.0f) & 2) | ((d[2] > 0.0f) & 4);
alignas(64) const uint8_t* ahead[16];
for (int l = 0; l < 16; ++l) ahead[l] = octants.data + (int64_t)way[l] * octants.shape[1] * by * bx;
#define AT_INT(a) (*(vi*)(a))
const vf number = __builtin_convertvector((vi){0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, vf);
// Of each ray; parts are listed from next to until.
alignas(64) float places[16][FIRST + PLACES + 32], next[16], until[16], gone[16], plain[3][16] = {}, looked[16] = {};
alignas(64) int many[16];
vf t = MORE(t0, none);
vi on = stop > t;
AT(next, 0) = AT(until, 0) = MORE(FLOOR(-t0 * rate), none);
AT(gone, 0) = GIVEN(13);
// More of them, as many as there is room for: whether there is still some.
auto list = [&](int l) -> bool {
    float* to = places[l] + FIRST;
    float k = next[l];
    int n = many[l], more = (int)(until[l] - k);
    const int fresh = (more > 0) & (to[n - 1] != k);
    to[n] = k;  // which is there already if it is not fresh, or is of no part
    n += fresh;
    more = MORE(LESS(more, PLACES - n), 0);
    for (int m = 0; m < more; m += 16) *(vf*)(to + n + m) = k + 1.0f + (number + (float)m);
    n += more;
    k += (float)more;
    next[l] = k;
    many[l] = n;
    return n < PLACES;
};
auto walk = [&]() {
    vi walks = on;
    for (int l = 0; l < 16; ++l) {
        many[l] = 0;
        places[l][FIRST - 1] = -9.0f;
        if (next[l] < until[l] && !list(l)) walks[l] = 0;
    }
    walks &= t < stop;
    while (bits(walks)) {
        vi b[3];
        for (int c = 0; c < 3; ++c) b[c] = MORE(LESS(INT(o[c] + t * d[c]), first + field.last[c]), first) >> 2;
        alignas(64) int of[16], kind[16];
        AT_INT(of) = (b[2] * by + b[1]) * bx + b[0];
        for (int l = 0; l < 16; ++l) kind[l] = ahead[l][of[l]];
        const vi empty = (AT_INT(kind) != 0) & (AT_INT(kind) != FULL), full = walks & ~empty;
        const vi reach = empty ? AT_INT(kind) : first + 1;
        vf leave = FAR;
        for (int c = 0; c < 3; ++c) {
            const vi face = (d[c] > 0.0f ? b[c] + reach : b[c] + 1 - reach) << 2;
            leave = d[c] != 0.0f ? LESS(leave, (FLOAT(face) - o[c]) * inverse[c]) : leave;
        }
        leave = LESS(MORE(leave, t), stop);
        vi taken = walks;
        if (bits(full)) {
            const vf from = MORE(AT(next, 0), FLOOR((t - MORE(none + OUTSIDE, t * 4.0e-7f) - t0) * rate));
            // What goes on where the last ended is one with it. Else that is listed first, and where there is no more
            // room the rest is for the next time.
            const vi begins = full & (from > AT(until, 0));
            for (unsigned m = bits(begins & (AT(next, 0) < AT(until, 0))); m; m &= m - 1) {
                const int l = __builtin_ctz(m);
                if (!list(l)) taken[l] = 0;
            }
            AT(next, 0) = begins & taken ? from : AT(next, 0);
            AT(until, 0) = full & taken ? LESS(CEIL((leave - t0) * rate), last) : AT(until, 0);
        }
        // Which is another number however long rays are.
        t = taken ? leave + MORE(none + OUTSIDE, leave * 3.0e-7f) : t;
        walks = taken & (t < stop) & (FLOAT(AT_INT(many)) + (AT(until, 0) - AT(next, 0)) < (float)PLACES);
    }
    for (unsigned m = bits(on & (AT(next, 0) < AT(until, 0))); m; m &= m - 1) list(__builtin_ctz(m));
};
"""

# What a ray makes of its parts.
LOOK = """
// The numbers before those of a, the first of which is of b.
#define BEHIND(a, b) __builtin_shufflevector(a, b, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14)
const float in_parts = 1.0f / (float)sweep.parts;
alignas(64) float even[16];
AT(even, 0) = none - 2.0f;
alignas(64) float traced[16];
AT(traced, 0) = none - 2.0f;
auto look = [&](int l) -> bool {
    const int n = many[l];
    const float* k = places[l] + FIRST;
    auto of = [&](int m) -> float { return given[16 * m + l]; };
    const float begin = t0[l], h = part[l], apart = of(8), u0 = of(9), v0 = of(10), du = of(11), dv = of(12);
    const float rise = (float)turn / apart;
    // Light's: what fans out from the eye goes its way.
    const float way_of_slab = sweep.diverging ? apart : (float)(sweep.thickness * sweep.slant);
    alignas(64) float where[PLACES + 32], x[PLACES + 32];
    alignas(64) int row[PLACES + 32];
    for (int i = 0; i < n; i += 16) {
        const vf t = LESS(MORE(begin + *(const vf*)(k + i) * h, none), none + of(6));
        vi r;
        *(vf*)(where + i) = t;
        *(vf*)(x + i) = at(scalars(of(0) + t * of(3), of(1) + t * of(4), of(2) + t * of(5)), r);
        *(vi*)(row + i) = r;
    }
    // Of sixteen each first what does not depend on those before, and last what nothing depends on: processors work on
    // several at a time.
    struct Parts {
        vi is;
        vf q[4], length, D, A;
    };
    struct Thin {
        vf before, behind, share, tau, part, D, color[3];
    };
    Parts all[BATCHES];
    Thin thins[BATCHES];
    for (int i = 0, e = 0; i + 1 < n; i += 16, ++e) {
        Parts& w = all[e];
        w.is = (number < (float)(n - 1 - i)) & (*(const vf*)(k + i + 1) == *(const vf*)(k + i) + 1.0f);
        looks_up(row + i, x + i, w.is, w.q);
        // Behind the last there is anything at all.
        w.length = w.is ? *(const vf*)(where + i + 1) - *(const vf*)(where + i) : none;
        w.q[3] = w.is ? MORE(w.q[3], none) : none;
        w.D = w.q[3] * w.length;
        w.A = absorbed(w.D);
    }
    vf sums[7] = {};  // colour, parts, colour in the light of slices
    float before = 1.0f - gone[l];
    int many_thin = 0;
    bool goes = true;
    for (int i = 0, e = 0; i + 1 < n && goes; i += 16, ++e) {
        const vf a = *(const vf*)(where + i), length = all[e].length, tau = all[e].q[3], D = all[e].D, A = all[e].A;
        const vi is = all[e].is;
        vf* q = all[e].q;
        if (!bits(tau > 0.0f)) {
            sums[3] += is ? none + 1.0f : none;
            continue;
        }
        // What is left of light before each.
        vf left = 1.0f - A;
#define BEFORE(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p) \
    left *= __builtin_shufflevector(left, none + 1.0f, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p)
        left = BEHIND(left, none + 1.0f);
        BEFORE(16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14);
        BEFORE(16, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13);
        BEFORE(16, 16, 16, 16, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11);
        BEFORE(16, 16, 16, 16, 16, 16, 16, 16, 0, 1, 2, 3, 4, 5, 6, 7);
        const vf clear = left * before, behind = clear * (1.0f - A);
        const vi lasts = clear >= least, seen = (tau > 0.0f) & lasts;
        sums[3] += is & lasts ? none + 1.0f : none;
        const vf dense = LESS(MORE(D * clear * (1.0f / FAINT) - 1.0f, none), none + 1.0f);
        const vf one = clear / tau;
        LIT_PART
        // Of the part that a ray ends in all is seen that is left, in its light.
        const vi ends = seen & (behind < least);
        const vf whole = ends ? none + 1.0f : A;
        const vf color[3] = {seen ? q[0] * one : none, seen ? q[1] * one : none, seen ? q[2] * one : none};
        const unsigned thin = bits(seen & (dense < 1.0f)), deep = bits(seen & (dense > 0.0f));
        if (thin) {
            // Light of slices, linear between them: slab by slab of those that there are such parts in.
            const vf slab = FLOOR((*(const vf*)(k + i) + 0.5f) * in_parts);
            alignas(64) float slabs[16];
            AT(slabs, 0) = slab;
            Thin& w = thins[many_thin++];
            float number = even[l], from = near[l], to = far[l];
            w.before = w.behind = none;
            vi asks = seen & (dense < 1.0f);
            for (unsigned m = thin; m; m = bits(asks)) {
                const float s = slabs[__builtin_ctz(m)];
                if (s != number) {
                    const float t = begin + s * apart, u = u0 + t * du, v = v0 + t * dv;
                    const int first = slice + turn * (int)s;
                    from = s == number + 1.0f ? to : light(first, u, v);
                    to = light(first + turn, u + apart * du, v + apart * dv);
                    number = s;
                }
                const vi here = slab == s;
                w.before = here ? none + from : w.before;
                w.behind = here ? none + to : w.behind;
                asks &= ~here;
            }
            even[l] = number;
            near[l] = from;
            far[l] = to;
            w.share = seen ? (a + 0.5f * length - (begin + slab * apart)) * (1.0f / apart) : none;
            w.tau = dense < 1.0f ? tau * way_of_slab : none;
            w.part = length * (1.0f / apart);
            w.D = D;
            const vf B = seen ? (1.0f - dense) * whole : none;
            for (int c = 0; c < 3; ++c) w.color[c] = B * color[c];
        }
        if (deep) {
            Waiting& w = waiting;
            alignas(64) float parts[4][16], rests[16];
            for (int c = 0; c < 3; ++c) AT(parts[c], 0) = color[c] * dense;
            AT(parts[3], 0) = D;
            AT(rests, 0) = ends ? none + 1.0f : none;
            auto asked = [&](float t) -> int {
                const int j = w.places++;
                for (int c = 0; c < 3; ++c) w.place[c][j] = of(c) + t * of(3 + c);
                w.place[3][j] = u0 + t * du;
                w.place[4][j] = v0 + t * dv;
                w.place[5][j] = (float)slice + rise * (t - begin);
                return w.ends[l] = j;
            };
            for (unsigned m = deep; m; m &= m - 1) {
                const int j = __builtin_ctz(m), to = w.parts++;
                w.from[to] = traced[l] == k[i + j] ? w.ends[l] : asked(where[i + j]);
                w.to[to] = asked(where[i + j + 1]);
                w.lane[to] = l;
                for (int c = 0; c < 4; ++c) w.part[c][to] = parts[c][j];
                w.rest[to] = rests[j];
                traced[l] = k[i + j] + 1.0f;
            }
            if (w.places > POINTS - 16) trace();
        }
        for (int c = 0; c < 3; ++c) sums[c] += whole * color[c];
        before = behind[15];
        goes = before >= least;
    }
    for (int e = 0; e < many_thin; ++e) {
        const Thin& w = thins[e];
        const vf L = faded(w.before, w.behind, w.share, w.tau, w.part, w.D);
        for (int c = 0; c < 3; ++c) sums[4 + c] += L * w.color[c];
    }
    for (int c = 0; c < 3; ++c) {
        plain[c][l] += sum(sums[c]);
        shone[c][l] += sum(sums[4 + c]);
    }
    looked[l] += sum(sums[3]);
    gone[l] = goes ? 1.0f - before : 1.0f;
    return goes;
};
while (bits(on)) {
    walk();
    for (unsigned m = bits(on); m; m &= m - 1) {
        const int l = __builtin_ctz(m);
        if (!look(l) || (!(next[l] < until[l]) && !(t[l] < stop[l]))) on[l] = 0;
    }
}
trace();
float* out = found.data;
for (int l = 0; l < 16; ++l) {
    for (int c = 0; c < 3; ++c) {
        out[16 * c + l] = plain[c][l];
        out[16 * (3 + c) + l] = shone[c][l];
    }
    out[16 * 6 + l] = gone[l];
    out[16 * 7 + l] = looked[l];
}
"""


@wp.struct
class Task:
    """Which light rays pass, and how they end."""

    octants: wp.array4d(dtype=wp.uint8)  # as of ``strides``
    low: wp.vec3d  # the box of all that there is to see
    high: wp.vec3d
    slice: int  # of the stack, at which the first slab begins
    turn: int  # from one to the next
    count: int  # of slabs
    least: wp.float32  # where less is seen of rays they end


@cache
def make_eyes(dtype, faint, least, lighted):
    """``look(field, table, sweep, stack, task, lights, rays, found)``, of samples of a ``dtype``: ``LANES`` rays
    through slabs of the light of the ``stack``. ``rays`` are (GIVEN, LANES), those without a length left out; what they
    have come to is ``found`` (FOUND, LANES). Tissue is ``faint`` up to an optical depth, and light at ``least``, as of
    ``slices``. Without ``lighted`` there are no ``lights``, nor vectors to the viewer.
    """
    Field = make_samples(dtype)
    Table, _ = make_table(wp.float32)
    text = TASK + wide(scalars_of(dtype) + COLUMNS[16] + ENTRIES + EXTINCTIONS + ABSORBED + INSIDE, LANES)
    lit, lit_part = (PLACES, LIT_PART) if lighted else ("", "")
    text += NUMBERS + LOOKUP + lit + LIGHT + TRACED + WALK + LOOK.replace("LIT_PART", lit_part)
    numbers = {
        "POINTS": 128,
        "PLACES": 48,
        "BATCHES": 4,
        "FIRST": 16,
        "FAINT": f"{faint}f",
        "LEAST": f"{least}f",
        "FULL": FULL,
    }
    numbers |= {"OUTSIDE": f"{OUTSIDE}f"}
    for name, value in numbers.items():
        text = text.replace(name, str(value))

    if lighted:

        @wp.func_native(VECTORS + text)
        def look_lit(
            field: Field,
            table: Table,
            sweep: Sweep,
            stack: wp.array3d(dtype=wp.float32),
            task: Task,
            lights: Lights,
            rays: wp.array2d(dtype=wp.float32),
            found: wp.array2d(dtype=wp.float32),
        ): ...

        return look_lit

    @wp.func_native(VECTORS + text)
    def look(
        field: Field,
        table: Table,
        sweep: Sweep,
        stack: wp.array3d(dtype=wp.float32),
        task: Task,
        rays: wp.array2d(dtype=wp.float32),
        found: wp.array2d(dtype=wp.float32),
    ): ...

    return look
