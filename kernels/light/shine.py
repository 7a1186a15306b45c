"""Light on pieces of ray, and at places: sixteen at a time in single precision, as text for snippets.

A piece is lit in a few points that see equal parts of its opacity, Gauss and Legendre's, if its extinction were linear,
from what it is in front and as much on the whole: at depths -ln(1 - A y). Its other end is a twentieth of the front at
least, so that weights are finite. Each weighs w_i, what it truly sees over that, in all 1. What the piece adds is
``Ī (A c(mean) + c' V) + c' A sum w_i (I_i - Ī) w(v_i)``, Ī the mean intensity: where light does not change, that of
``series``. One whose light changes by so much that it matters is lit in sixteen points, in lanes at once, and where
those will not do either its halves are, or theirs.
Letters and numbers are those of docs/proof-single.md.
"""

import numpy as np

from .points import CUT, OPPOSITE

# Points of a piece, and of one whose light matters more: of halves of halves of that, no smaller than LEAST.
FEW = 2
MANY = 16
LEAST = 2.0**-16
# What light may change a piece's part of the pixel by, in parts of the tolerance of a piece, that few will do for:
# eight times the whole tolerance, as that bounds what it changes by. And what more points will do for, in parts of
# that, being so much less off (S21). In lanes sixteen cost as much as four.
MUCH = 32.0
GOOD = {2: 1.0, 4: 2.4, 8: 8.0, 16: 30.0}
MORE = GOOD[MANY] * MUCH
# Errors of thin pieces add up where normals reverse at the same place in each, as in layers: one that is less than THIN
# of the pixel counts as that much, so that it is allowed its part of the whole, or a PLENTY-th if that is more.
THIN = 0.1
PLENTY = 512.0
# What light counts for where normals may reverse: that may be between two points.
ROUGH = 16.0
# And powers below 1, which are steep where they are 0.
CUSP = 8.0


def rule(n):
    """Gauss and Legendre's nodes in [0, 1] and weights."""
    x, w = np.polynomial.legendre.leggauss(n)
    return ((1 + x) / 2).tolist(), (w / 2).tolist()


def _text(numbers):
    return ", ".join(f"{a!r}f" for a in numbers)


SHINE = """
// -ln(a) of a in (0, 1] (S20).
auto bare = [](vf a) -> vf {
    const vi e = ((vi)a - 0x3f3504f3) >> 23;
    const vf m = (vf)((vi)a - (e << 23)), z = (m - 1.0f) / (m + 1.0f), zz = z * z;
    const vf p = zz * (1.0f / 3 + zz * (1.0f / 5 + zz * (1.0f / 7 + zz * (1.0f / 9))));
    return __builtin_convertvector(e, vf) * -0.693147180559945f - 2.0f * (z + z * p);
};
const float ambient = (float)lights.shading.ambient, diffuse = (float)lights.shading.diffuse;
const float specular = (float)lights.shading.specular, shininess = (float)lights.shading.shininess;
const float faint = (float)lights.shading.faint, steep = 1.6f * __builtin_sqrtf(shininess);
const int nlights = lights.lights.shape[0];
const auto* __restrict each = lights.lights.data;
// Intensities by gradient and unit vector to the viewer: three that multiply colour, and three of specular light (S20).
auto shine = [&](vf gx, vf gy, vf gz, const vf* eye, vf* I) {
    vf most = MAX(MAX(ABS(gx), ABS(gy)), ABS(gz));
    const vi known = ((vi)(gx + gy + gz) & 0x7f800000) != 0x7f800000;
    most = known ? MAX(most, zero + 1e-18f) : zero + 1e-18f;
    const vf one = 1.0f / most;
    gx = known ? gx * one : zero;
    gy = known ? gy * one : zero;
    gz = known ? gz * one : zero;
    const vf gg = gx * gx + gy * gy + gz * gz, clear = gg / (gg + faint * one * one);
    for (int c = 0; c < 6; ++c) I[c] = zero;
    for (int l = 0; l < nlights; ++l) {
        const auto& light = each[l];
        vf t[3], h[3];
        for (int c = 0; c < 3; ++c) {
            t[c] = light.kind == 0 ? eye[c] : zero + (float)light.vector[c];
            h[c] = t[c] + eye[c];
        }
        const vf hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2];
        const vf inverse = 1.0f / __builtin_elementwise_sqrt(MAX(gg, zero + 1e-30f));
        const vf facing = ABS(gx * t[0] + gy * t[1] + gz * t[2]) * inverse;
        const vf glance = ABS(gx * h[0] + gy * h[1] + gz * h[2]) * inverse
            / __builtin_elementwise_sqrt(MAX(hh, zero + 1e-30f));
        const vf d = clear * facing + (1.0f - clear);
        const vf glint = shininess * bare(MIN(MAX(glance, zero + 1e-30f), zero + 1.0f));
        const vf between = clear * MIN(hh / OPPOSITEf, zero + 1.0f);
        const vf s = glance > 0.0f ? between * fading(MIN(glint, zero + 200.0f)) : zero;
        for (int c = 0; c < 3; ++c) {
            I[c] += (float)light.color[c] * d;
            I[3 + c] += (float)light.color[c] * s;
        }
    }
    for (int c = 0; c < 3; ++c) {
        I[c] *= diffuse;
        I[3 + c] *= specular;
    }
};
""".replace("OPPOSITE", repr(OPPOSITE))
PIECES = """
struct Lit {
    vf x, A, g, m1, m2, m3;  // as of the series
    vf mid, half;  // where it is in its cell
    vf gradient[LIT_ROWS];  // of the cell
    vf V, off;  // off from the row's middle
    vf color[8];  // and the row's
};
// Where a part of the opacity is in front, in [-1, 1], depth there, and extinction were that linear.
auto reached = [&](const Lit& p, vf part, vf& depth, vf& root) -> vf {
    const vf a = 0.5f * p.x, y = p.A * part;
    const vf b = MIN(MAX(a + p.g * (p.m2 * (2.0f / 3) - p.m1 - p.m3), zero), 1.9f * a), k = a - b;
    depth = y < 0.06f ? y * (1.0f + y * (0.5f + y * (1.0f / 3))) : bare(1.0f - y);
    root = __builtin_elementwise_sqrt(MAX(b * b + 2.0f * k * depth, zero));
    return MIN(2.0f * depth / (b + root + 1e-30f), zero + 2.0f) - 1.0f;
};
// Intensities there, w, and what it weighs.
auto sampled = [&](const Lit& p, vf part, vf* I, vf& weight) __attribute__((noinline)) -> vf {
    const vf* G = p.gradient;
    vf depth, root;
    const vf v = reached(p, part, depth, root), s = v + 1.0f, u = p.mid + p.half * v, a = 0.5f * p.x;
    const vf w = v * (p.m1 + v * (p.m2 + v * p.m3)) - p.m2 * (1.0f / 3);
    const vf W = s * (s - 2.0f) * (0.5f * p.m1 + v * p.m2 * (1.0f / 3) + (v * v + 1.0f) * (0.25f * p.m3));
    weight = MAX(a + p.g * w, zero) / MAX(root, zero + 1e-30f) * fading(a * s + p.g * W - depth);
    vf g[3];
    for (int c = 0; c < 3; ++c) g[c] = G[4 * c] + u * (G[4 * c + 1] + u * (G[4 * c + 2] + u * G[4 * c + 3]));
    TOWARDS_CUT
    shine(g[0], g[1], g[2], G + 12, I);
    return w;
};
// How much a unit of light changes at most from u on, to s before and behind it (S21).
auto changes = [&](const vf* G, vf u, vf s) __attribute__((noinline)) -> vf {
    vf square = {}, a[3] = {};
    CUT_NORMAL
    for (int c = 0; c < 3; ++c) {
        const vf g = G[4 * c] + u * (G[4 * c + 1] + u * (G[4 * c + 2] + u * G[4 * c + 3]));
        const vf g1 = G[4 * c + 1] + u * (2.0f * G[4 * c + 2] + u * (3.0f * G[4 * c + 3]));
        const vf g2 = G[4 * c + 2] + u * (3.0f * G[4 * c + 3]), g3 = G[4 * c + 3];
        square += g * g;
        a[0] += g1 * g1;
        a[1] += g2 * g2;
        a[2] += g3 * g3;
        CUT_ACROSS
    }
    for (int c = 0; c < 3; ++c) a[c] = __builtin_elementwise_sqrt(a[c]);
    vf r = s * (a[0] + s * (a[1] + s * a[2])), size = __builtin_elementwise_sqrt(square), most = size + r;
    CUT_BEHIND
    const vf least = MAX(size - r, zero);
    const vf none = faint / (most * most + faint), seen = 1.0f - none, fades = faint / (least * least + faint) - none;
    const vf turn = MIN(r / MAX(size - 0.5f * r, zero + 1e-30f), zero + ROUGH);
    const vf power = CUSP * fading(shininess * bare(MIN(MAX(1.6f * turn, zero + 1e-30f), zero + 1.0f)));
    const vf glints = shininess < 1.0f ? power : MIN(steep * turn, zero + ROUGH);
    return diffuse * (seen * turn + fades) + specular * (seen * glints + fades);
};
// Colour of pieces, of those that are ``wanted``, behind a transparency T.
auto lit = [&](const Lit& p, vi wanted, vf T, vf* out) __attribute__((noinline)) {
    vf mean[6] = {}, moment[3] = {}, moved = {}, all = {}, I[6], weight;
    const float few[] = {FEW_NODES}, shares[] = {FEW_SHARES};
    alignas(64) const float many[] = {MANY_NODES}, shared[] = {MANY_SHARES};
    for (int i = 0; i < FEW; ++i) {
        const vf w = sampled(p, zero + few[i], I, weight);
        weight *= shares[i];
        all += weight;
        moved += weight * w;
        for (int c = 0; c < 6; ++c) mean[c] += weight * I[c];
        for (int c = 0; c < 3; ++c) moment[c] += weight * w * I[c];
    }
    const vf seen = T * p.A, share = MIN(MAX(seen, zero + THIN), PLENTY * seen);
    const vf matters = share * changes(p.gradient, p.mid, p.half);
    const vi finer = wanted & (matters > tolerance * MUCH);
    for (int l = 0; l < 16; ++l) {
        if (!finer[l]) continue;
        Lit q;
        const vf* from = (const vf*)&p;
        vf* to = (vf*)&q;
        for (int i = 0; i < 8 + LIT_ROWS; ++i) to[i] = zero + from[i][l];
        v4f sums[3] = {};
        // Of halves of halves, each from y of the opacity on.
        float y = 0.0f, part = 1.0f, start = -1.0f, most = matters[l];
        while (y < 1.0f) {
            float stop = 1.0f;
            if (part < 1.0f) {
                vf depth, root;
                if (y + part < 1.0f) stop = reached(q, zero + (y + part), depth, root)[0];
                const vf v = zero + 0.5f * (start + stop);
                most = part * share[l] * changes(q.gradient, q.mid + q.half * v, q.half * (0.5f * (stop - start)))[0];
            }
            if (most > tolerance * MORE && part > LEASTf) {
                part *= 0.5f;
                continue;
            }
            const vf w = sampled(q, y + part * *(const vf*)many, I, weight);
            weight *= part * *(const vf*)shared;
            const vf ww = weight * w;
            sums[0] += summed(weight, ww, ww * I[0], ww * I[1]);
            sums[1] += summed(ww * I[2], weight * I[0], weight * I[1], weight * I[2]);
            sums[2] += summed(weight * I[3], weight * I[4], weight * I[5], zero);
            y += part;
            start = stop;
            const float pairs = 0.5f * y / part;
            if (pairs == (float)(int)pairs) part *= 2.0f;
        }
        all[l] = sums[0][0];
        moved[l] = sums[0][1];
        for (int c = 0; c < 3; ++c) {
            moment[c][l] = c < 2 ? sums[0][2 + c] : sums[1][0];
            mean[c][l] = sums[1][1 + c];
            mean[3 + c][l] = sums[2][c];
        }
    }
    const vf one = 1.0f / MAX(all, zero + 1e-30f);
    for (int c = 0; c < 3; ++c) {
        const vf slope = p.color[4 + c], plain = p.A * (p.color[c] + p.off * slope) + p.V * slope, I = one * mean[c];
        out[c] = (ambient + I) * plain + p.A * one * (slope * (moment[c] - I * moved) + mean[3 + c]);
    }
};
"""
# Intensities at places, after ``field.scalars`` and ``lanes.ABSORBED``, by central differences; these are one-sided at
# the faces of the box, beyond which scalars go on linearly.
PLACES = f"""
auto fading = [&](vf y) -> vf {{ return 1.0f - absorbed(y); }};
{SHINE}
auto intensities = [&](const vf* p, const vf* eye, vf* I) __attribute__((noinline)) {{
    const auto& world = lights.to_world.data;
    vf q[3] = {{p[0], p[1], p[2]}}, g[3], w[3];
    for (int c = 0; c < 3; ++c) {{
        q[c] = p[c] + 1.0f;
        g[c] = scalars(q[0], q[1], q[2]);
        q[c] = p[c] - 1.0f;
        g[c] = 0.5f * (g[c] - scalars(q[0], q[1], q[2]));
        q[c] = p[c];
    }}
    for (int c = 0; c < 3; ++c) w[c] = world[c][0] * g[0] + world[c][1] * g[1] + world[c][2] * g[2];
    shine(w[0], w[1], w[2], eye, I);
}};
"""
SUM = """
// Sums of four.
auto summed = [](vf a, vf b, vf c, vf d) -> v4f {
    const vf ab = __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)
        + __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
    const vf cd = __builtin_shufflevector(c, d, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)
        + __builtin_shufflevector(c, d, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
    const vf s = __builtin_shufflevector(ab, cd, 0, 1, 16, 17, 2, 3, 18, 19, 4, 5, 20, 21, 6, 7, 22, 23)
        + __builtin_shufflevector(ab, cd, 8, 9, 24, 25, 10, 11, 26, 27, 12, 13, 28, 29, 14, 15, 30, 31);
    const v8f t = __builtin_shufflevector(s, s, 0, 1, 2, 3, 4, 5, 6, 7)
        + __builtin_shufflevector(s, s, 8, 9, 10, 11, 12, 13, 14, 15);
    return __builtin_shufflevector(t, t, 0, 1, 2, 3) + __builtin_shufflevector(t, t, 4, 5, 6, 7);
};
"""
# Behind a clip's surface, as ``points.make_shading`` has it.
TOWARDS_CUT = """
    const vf behind = G[19] + u * G[20];
    const float cut[3] = {(float)lights.cut[0], (float)lights.cut[1], (float)lights.cut[2]};
    const vf across = cut[0] * g[0] + cut[1] * g[1] + cut[2] * g[2];
    const vf size = __builtin_elementwise_sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    const vf strength = (across < 0.0f ? behind - 1.0f : 1.0f - behind) * MAX(size, zero + CUTf);
    const vi near = (behind < 1.0f) & -(cut[0] != 0.0f || cut[1] != 0.0f || cut[2] != 0.0f);
    for (int c = 0; c < 3; ++c) g[c] = near ? behind * g[c] + strength * cut[c] : g[c];
"""
# By how much light changes there: a normal is that of the clip and the field's, which is one of two by its sign.
CUT_NORMAL = """
    const float cut[3] = {(float)lights.cut[0], (float)lights.cut[1], (float)lights.cut[2]};
    vf across = {};
"""
CUT_BEHIND = """
    const vi near = (G[19] + (u - s) * G[20] < 1.0f) & -(cut[0] != 0.0f || cut[1] != 0.0f || cut[2] != 0.0f);
    const vf b = MIN(G[19] + u * G[20], zero + 1.0f), strength = (1.0f - b) * MAX(size, zero + CUTf);
    most = near ? MAX(most, zero + CUTf) : most;
    size = near ? ABS(across) < r ? zero
                : __builtin_elementwise_sqrt(b * b * square + strength * (2.0f * b * ABS(across) + strength)) : size;
    r += near ? 2.0f * s * ABS(G[20]) * most : zero;
"""


def rows_of(clipped):
    """Rows of ``gradients`` that light asks for."""
    return 21 if clipped else 15


def shining(clipped):
    """The text, of rays that clips cut or not; it needs ``fading``, ``lights`` (a ``points.Lights``) and a
    ``tolerance``, of a piece in parts of its opacity.
    """
    text = SUM + SHINE + PIECES
    cut = {"TOWARDS_CUT": TOWARDS_CUT, "CUT_NORMAL": CUT_NORMAL, "CUT_ACROSS": "across += cut[c] * g;"}
    for name, one in (cut | {"CUT_BEHIND": CUT_BEHIND}).items():
        text = text.replace(name, one.replace("CUTf", f"{CUT!r}f") if clipped else "")
    names = {"LIT_ROWS": str(rows_of(clipped)), "LEAST": repr(LEAST)}
    names |= {"THIN": f"{THIN}f", "PLENTY": f"{PLENTY}f"}
    names |= {"MUCH": f"{MUCH}f", "MORE": f"{MORE}f", "ROUGH": f"{ROUGH}f", "CUSP": f"{CUSP}f"}
    for name, n in (("FEW", FEW), ("MANY", MANY)):
        nodes, shares = rule(n)
        names |= {f"{name}_NODES": _text(nodes), f"{name}_SHARES": _text(shares)}
    names["FEW"] = str(FEW)
    for name, value in names.items():
        text = text.replace(name, value)
    return text
