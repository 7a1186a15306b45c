"""Peaks: how much there is at most in blocks of 4, 16 and 64 cells along each axis, and rays that leap by that.

From block to block as ``walk.leap`` goes, in C++: that is nearly all that a maximum along a ray costs. ``climb`` says
the same in vectors; this is for what has none.
"""

from functools import cache

import warp as wp

from .samples import make_samples
from .walk import make_walk


@wp.struct
class Peaks:
    """Largest samples of blocks [z, y, x], rounded up; minus infinity where all is absent."""

    fine: wp.array3d(dtype=wp.float32)
    middle: wp.array3d(dtype=wp.float32)
    coarse: wp.array3d(dtype=wp.float32)


# Of a block only those indices are known that the ray has entered it by; others are when it is gone into (``refine``).
WAY = """
struct Way {
    const wp::vec_t<3, double> &p, &d, &o, &v;
    const wp::vec_t<3, int>& last;
    double t;
    int c[3];
    // To the next block of 1 << bits cells; whether that is in another one of four times the size.
    CUDA_CALLABLE inline bool step(int bits) {
        int edge[3];
        double at[3];
        for (int a = 0; a < 3; ++a) {
            edge[a] = ((c[a] >> bits) + (v[a] > 0.0)) << bits;
            at[a] = ((double)edge[a] - o[a]) * v[a];
        }
        double end = at[0] < at[1] ? at[0] : at[1];
        end = at[2] < end ? at[2] : end;
        t = end > t ? end : t;
        int changed = 0;
        for (int a = 0; a < 3; ++a) {
            int n = edge[a] - (v[a] < 0.0);
            n = n < last[a] ? n : last[a];
            n = at[a] <= t ? n : c[a];
            changed |= n ^ c[a];
            c[a] = n;
        }
        return changed >> (bits + 2) != 0;
    }
    // The cell of a block of 1 << bits cells, of which the ray is in the block.
    CUDA_CALLABLE inline void refine(int bits) {
        for (int a = 0; a < 3; ++a) {
            const int low = c[a] >> bits << bits, high = low + (1 << bits) - 1;
            int n = (int)(p[a] + t * d[a]);
            if (v[a] > 0.0) {
                n = n < high ? n : high;
                n = n > c[a] ? n : c[a];
            } else {
                n = n > low ? n : low;
                n = n < c[a] ? n : c[a];
            }
            c[a] = n < last[a] ? n : last[a];
        }
    }
    CUDA_CALLABLE inline double top(const wp::array_t<float>& peaks, int bits) const {
        const int k = c[2] >> bits, j = c[1] >> bits, i = c[0] >> bits;
        return (double)peaks.data[((size_t)k * peaks.shape[1] + j) * peaks.shape[2] + i];
    }
};
const auto &p = walk.origin, &d = walk.direction;
Way w = {p, d, walk.anchor, walk.inverse, walk.last, walk.t,
    {walk.cell[0], walk.cell[1], walk.cell[2]}};
"""
SEEK = """
const wp::array_t<float>* levels[3] = {&peaks.fine, &peaks.middle, &peaks.coarse};
const auto& data = field.data;
const double shift = SHIFT, sign = SIGN, third = 1.0 / 3.0;
const size_t nx = data.shape[2], nxy = nx * data.shape[1];
wp::vec_t<10, double> found;
int level = 0;
while (w.t < stop) {
    if (level >= 0) {
        const int bits = 2 * level + 2;
        const double top = w.top(*levels[level], bits);
        if (top > best || (top == best && w.t < place)) {
            // What is in there?
            w.refine(bits);
            --level;
        } else if (w.step(bits) && level < 2)
            ++level;
        continue;
    }
    const double t = w.t;
    const int i = w.c[0], j = w.c[1], k = w.c[2];
    const auto* q = data.data + (k * nxy + j * nx + i);
    const ACCUMULATOR a[8] = {q[0], q[1], q[nx], q[nx + 1], q[nxy], q[nxy + 1], q[nxy + nx], q[nxy + nx + 1]};
    ACCUMULATOR m[4];
    for (int n = 0; n < 4; ++n) m[n] = a[2 * n] ABOVE a[2 * n + 1] ? a[2 * n] : a[2 * n + 1];
    for (int n = 0; n < 2; ++n) m[n] = m[2 * n] ABOVE m[2 * n + 1] ? m[2 * n] : m[2 * n + 1];
    const double top = sign * ((double)(m[0] ABOVE m[1] ? m[0] : m[1]) - shift);
    if (w.step(0)) level = 0;
    if (!(top > best || (top == best && t < place))) continue;
    double s[8];
    for (int n = 0; n < 8; ++n) s[n] = sign * ((double)a[n] - shift);
    // The cubic, as ``cell.cubic`` has it.
    const double x = p[0] + t * d[0] - i, y = p[1] + t * d[1] - j, z = p[2] + t * d[2] - k;
    const double x00 = s[1] - s[0], x10 = s[3] - s[2], x01 = s[5] - s[4], x11 = s[7] - s[6];
    const double v00 = s[0] + x * x00, v01 = s[4] + x * x01;
    const double y0 = s[2] + x * x10 - v00, y1 = s[6] + x * x11 - v01;
    const double v0 = v00 + y * y0, dz = v01 + y * y1 - v0;
    const double xy0 = x10 - x00, xyz = x11 - x01 - xy0, xy = xy0 + z * xyz;
    const double xz = x01 - x00 + y * xyz, yz = y1 - y0;
    const double dx = x00 + y * xy0 + z * xz, dy = y0 + z * yz;
    const double c0 = v0 + z * dz, c1 = d[0] * dx + d[1] * dy + d[2] * dz;
    const double c2 = d[0] * (d[1] * xy + d[2] * xz) + d[1] * d[2] * yz, c3 = d[0] * d[1] * d[2] * xyz;
    // It lies below the coefficients of Bernstein's polynomials.
    const double L = (w.t < stop ? w.t : stop) - t;
    const double near = c0 + third * L * c1, far = near + third * L * (c1 + L * c2);
    const double last = c0 + L * (c1 + L * (c2 + L * c3));
    double most = c0 > last ? c0 : last;
    most = near > most ? near : most;
    most = far > most ? far : most;
    if (!(most > best || (most == best && t < place))) continue;
    const double all[10] = {w.t, (double)w.c[0], (double)w.c[1], (double)w.c[2], t, top, c0, c1, c2, c3};
    for (int n = 0; n < 10; ++n) found[n] = all[n];
    return found;
}
found[0] = w.t;
found[4] = stop;
return found;
"""
PROMISING = """
Way begin = w;
double most = best, until = w.t;
int bits = 6;
while (w.t < stop) {
    if (w.top(bits == 6 ? peaks.coarse : peaks.middle, bits) > most) {
        w.refine(bits);
        if (bits == 6) {
            bits = 4;
            continue;
        }
        most = w.top(peaks.middle, 4);
        begin.t = w.t;
        for (int a = 0; a < 3; ++a) begin.c[a] = w.c[a];
        if (w.step(4)) bits = 6;
        until = w.t < stop ? w.t : stop;
    } else if (w.step(bits))
        bits = 6;
}
wp::vec_t<5, double> found;
found[0] = begin.t;
for (int a = 0; a < 3; ++a) found[a + 1] = begin.c[a];
found[4] = until;
return found;
"""
Walk, *_ = make_walk(wp.float64)
vec5d = wp.types.vector(5, wp.float64)
vec10d = wp.types.vector(10, wp.float64)


@wp.struct
class Crest:
    """A cell in which there may be more, times a sign, than along the ray before."""

    t: wp.float64  # where the ray enters it
    cubic: wp.vec4d  # from there on
    top: wp.float64  # largest sample


@cache
def make_seek(dtype, sign):
    """``seek(field, peaks, walk, stop, best, place)`` -> the walk behind the next cell in which there may be more,
    times the sign, than the best, or as much before its place, and that cell, which is at ``stop`` if there is none.
    """
    Field = make_samples(dtype)
    shift = "field.shift" if dtype in (wp.float16, wp.float32, wp.float64) else "0.0"

    text = SEEK.replace("SHIFT", shift).replace("SIGN", str(sign)).replace("ABOVE", ">" if sign > 0 else "<")
    types = {wp.float16: "float", wp.float32: "float", wp.float64: "double"}

    @wp.func_native(WAY + text.replace("ACCUMULATOR", types.get(dtype, "int32_t")))
    def next_crest(
        field: Field, peaks: Peaks, walk: Walk, stop: wp.float64, best: wp.float64, place: wp.float64
    ) -> vec10d: ...

    @wp.func
    def seek(field: Field, peaks: Peaks, walk: Walk, stop: wp.float64, best: wp.float64, place: wp.float64):
        f = next_crest(field, peaks, walk, stop, best, place)
        crest = Crest()
        crest.t = f[4]
        crest.top = f[5]
        crest.cubic = wp.vec4d(f[6], f[7], f[8], f[9])
        walk.t = f[0]
        walk.cell = wp.vec3i(int(f[1]), int(f[2]), int(f[3]))
        return walk, crest

    return seek


@wp.func_native(WAY + PROMISING)
def highest_peak(peaks: Peaks, walk: Walk, stop: wp.float64, best: wp.float64) -> vec5d: ...


@wp.func
def promising(peaks: Peaks, walk: Walk, stop: wp.float64, best: wp.float64):
    """The walk in the block of 16 cells with the highest peak, if that is above the best, and where it leaves that."""
    found = highest_peak(peaks, walk, stop, best)
    walk.t = found[0]
    walk.cell = wp.vec3i(int(found[1]), int(found[2]), int(found[3]))
    return walk, found[4]
