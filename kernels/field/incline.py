"""The gradient in one cell along a ray in single precision, as ``gradients`` has those of many.

Each component is a cubic of where the ray is, like the scalar; the number S19 is that of docs/proof-single.md.
"""

from functools import cache

import warp as wp

from .narrow import WIDE
from .samples import make_samples

# Differences at the eight corners, which are trilinear between them: one-sided at the faces of the box.
ALONG = """
const size_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const auto* c = field.data.data + (cell[2] * nxy + cell[1] * nx + cell[0]);
using A = WIDE;
const size_t stride[3] = {1, nx, nxy};
wp::vec_t<12, float> result;
#pragma unroll
for (int a = 0; a < 3; ++a) {
    const bool below = CENTRAL && cell[a] > 0, above = CENTRAL && cell[a] < field.last[a];
    const size_t s = stride[a], back = below ? s : 0, on = above ? 2 * s : s;
    const float low = below ? 0.5f : 1.0f, high = above ? 0.5f : 1.0f;
    float v[8];
    #pragma unroll
    for (int m = 0; m < 8; ++m) {
        const auto* p = c + (m & 1) + (m >> 1 & 1) * nx + (m >> 2) * nxy;
        const bool upper = m >> a & 1;
        v[m] = upper ? (float)(A(p[on - s]) - A(*(p - s))) * high : (float)(A(p[s]) - A(*(p - back))) * low;
    }
    const float x00 = v[1] - v[0], x10 = v[3] - v[2], x01 = v[5] - v[4], x11 = v[7] - v[6];
    const float v00 = v[0] + f[0] * x00, v01 = v[4] + f[0] * x01;
    const float y0 = v[2] + f[0] * x10 - v00, y1 = v[6] + f[0] * x11 - v01, v0 = v00 + f[1] * y0;
    const float dz = v01 + f[1] * y1 - v0, xy0 = x10 - x00, xyz = (x11 - x01) - xy0;
    const float xz = x01 - x00 + f[1] * xyz, yz = y1 - y0, dx = x00 + f[1] * xy0 + f[2] * xz, dy = y0 + f[2] * yz;
    result.c[a] = v0 + f[2] * dz;
    result.c[3 + a] = e[0] * dx + e[1] * dy + e[2] * dz;
    result.c[6 + a] = e[0] * (e[1] * (xy0 + f[2] * xyz) + e[2] * xz) + e[1] * (e[2] * yz);
    result.c[9 + a] = e[0] * e[1] * e[2] * xyz;
}
return result;
"""
vec12 = wp.types.vector(12, wp.float32)


@cache
def make_incline(dtype, central):
    """``incline(field, cell, f, e)`` -> vec12, the gradient per index ``g0 + g1 v + g2 v^2 + g3 v^3``, v in [-1, 1], on
    a piece with its middle at f from a cell's first corner, e from there to its end: by ``central`` differences, or the
    cell's own.
    """
    Field = make_samples(dtype)
    text = ALONG.replace("CENTRAL", "true" if central else "false").replace("WIDE", WIDE.get(dtype, "int"))

    @wp.func_native(text)
    def incline(field: Field, cell: wp.vec3i, f: wp.vec3, e: wp.vec3) -> vec12: ...

    return incline
