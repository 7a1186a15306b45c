"""Gradients of many cells in single precision, as cubics along their rays, and the scalar's own: in vectors.

Central differences of the samples, interpolated, are trilinear in a cell like the scalar itself, so that each component
is a cubic along a ray. The number S19 is that of docs/proof-single.md.
"""

from functools import cache

import warp as wp

from ..vectors import apart
from .cubics import PAIRS
from .samples import make_samples

# What is said of a cell: three components of four coefficients, the unit vector towards the viewer, m1, m2, m3 of the
# scalar and half the length; and how far from the ray's start the middle is, and the end from there [indices].
ROWS = 21

GRADIENTS = """
const auto* __restrict data = field.data.data;
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const int n = which.data[0];
const int last[3] = {field.last[0], field.last[1], field.last[2]};
float world[9];
double ahead[9];
for (int m = 0; m < 9; ++m) {
    world[m] = (float)to_world.data[m / 3][m % 3];
    ahead[m] = ahead_of.data[m / 3][m % 3];
}
for (int j = 0; j < n; j += 16) {
    // Samples about a cell, x fastest: those that a difference along one axis needs.
    STORE
    alignas(64) float inverse[6][16];
    alignas(64) double line[7][16], start[16], stop[16], corner[3][16];
    for (int l = 0; l < 16; ++l) {
        const int* of = which.data + (j + l < n ? j + l + 1 : n);
        const int i = of[0], ray = of[which.shape[1]];
        const uint64_t q = cells.data[i];
        const int64_t at[3] = {(int64_t)(q & 0x1fffff), (int64_t)((q >> 21) & 0x1fffff), (int64_t)(q >> 42)};
        const auto* a = data + at[2] * nxy + at[1] * nx + at[0];
        const int64_t stride[3] = {1, nx, nxy};
        int64_t go[3][4];
        for (int m = 0; m < 3; ++m) {
            // One-sided at the faces of the box, and where the cell's own differences are asked for.
            const int below = CENTRAL & (at[m] > 0), above = CENTRAL & (at[m] < last[m]);
            go[m][0] = -below * stride[m]; go[m][1] = 0; go[m][2] = stride[m]; go[m][3] = (1 + above) * stride[m];
            inverse[2 * m][l] = below ? 0.5f : 1.0f;
            inverse[2 * m + 1][l] = above ? 0.5f : 1.0f;
            corner[m][l] = (double)at[m];
        }
LOAD
        for (int m = 0; m < 7; ++m) line[m][l] = lines.data[lines.shape[1] * ray + m];
        start[l] = times.data[i];
        stop[l] = times.data[times.shape[1] + i];
    }
    v8f p8[11][2];
    for (int b = 0; b < 2; ++b) {
#define HALF(a) (*(const vd*)(a + 8 * b))
        const vd t = 0.5 * (HALF(start) + HALF(stop));
        for (int m = 0; m < 3; ++m) {
            p8[m][b] = __builtin_convertvector(t * HALF(line[3 + m]) + (HALF(line[m]) - HALF(corner[m])), v8f);
            p8[3 + m][b] = __builtin_convertvector(HALF(line[3 + m]), v8f);
        }
        p8[6][b] = __builtin_convertvector(0.5 * (HALF(stop) - HALF(start)), v8f);
        p8[7][b] = __builtin_convertvector(t - HALF(line[6]), v8f);
        // Towards the viewer: squares of what the world is measured in may be beyond single precision.
        vd e[3];
        for (int m = 0; m < 3; ++m)
            e[m] = ahead[3 * m] * HALF(line[3]) + ahead[3 * m + 1] * HALF(line[4]) + ahead[3 * m + 2] * HALF(line[5]);
        const vd unit = -1.0 / __builtin_elementwise_sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
        for (int m = 0; m < 3; ++m) p8[8 + m][b] = __builtin_convertvector(unit * e[m], v8f);
    }
#define PLACED(m) JOIN(p8[m][0], p8[m][1])
    const vf fx = PLACED(0), fy = PLACED(1), fz = PLACED(2), d0 = PLACED(3), d1 = PLACED(4), d2 = PLACED(5);
    const vf h = PLACED(6);
    const int64_t room = gradient.shape[1];
    float* out = gradient.data + j;
UNPACK
    // A cubic in v of what is trilinear between eight corners.
    auto along = [&](const vf* c, vf* to) {
        const vf x00 = c[1] - c[0], x10 = c[3] - c[2], x01 = c[5] - c[4], x11 = c[7] - c[6];
        const vf v00 = c[0] + fx * x00, v01 = c[4] + fx * x01;
        const vf y0 = c[2] + fx * x10 - v00, y1 = c[6] + fx * x11 - v01, v0 = v00 + fy * y0;
        const vf dz = v01 + fy * y1 - v0, xy0 = x10 - x00, xyz = (x11 - x01) - xy0;
        const vf xz = x01 - x00 + fy * xyz, yz = y1 - y0, dx = x00 + fy * xy0 + fz * xz, dy = y0 + fz * yz;
        to[0] = v0 + fz * dz;
        to[1] = h * (d0 * dx + d1 * dy + d2 * dz);
        to[2] = h * h * (d0 * (d1 * (xy0 + fz * xyz) + d2 * xz) + d1 * (d2 * yz));
        to[3] = h * h * h * (d0 * d1 * d2) * xyz;
    };
    vf c[8], g[3][4], s[4];
#define INVERSE(m) (*(const vf*)inverse[m])
#define CORNERS(expression) for (int m = 0; m < 8; ++m) { \\
        const int x = 1 + (m & 1), y = 1 + ((m >> 1) & 1), z = 1 + (m >> 2); c[m] = expression; }
    CORNERS(AROUND(x, y, z))
    along(c, s);
    CORNERS((AROUND(x + 1, y, z) - AROUND(x - 1, y, z)) * INVERSE(x - 1))
    along(c, g[0]);
    CORNERS((AROUND(x, y + 1, z) - AROUND(x, y - 1, z)) * INVERSE(y + 1))
    along(c, g[1]);
    CORNERS((AROUND(x, y, z + 1) - AROUND(x, y, z - 1)) * INVERSE(z + 3))
    along(c, g[2]);
    // In the world.
    for (int r = 0; r < 3; ++r)
        for (int m = 0; m < 4; ++m)
            *(vf*)(out + (4 * r + m) * room) = world[3 * r] * g[0][m] + world[3 * r + 1] * g[1][m]
                + world[3 * r + 2] * g[2][m];
    for (int m = 0; m < 3; ++m) *(vf*)(out + (12 + m) * room) = PLACED(8 + m);
    for (int m = 1; m < 4; ++m) *(vf*)(out + (14 + m) * room) = s[m];
    *(vf*)(out + 18 * room) = h;
    const vf way = __builtin_elementwise_sqrt(d0 * d0 + d1 * d1 + d2 * d2);
    *(vf*)(out + 19 * room) = PLACED(7) * way;
    *(vf*)(out + 20 * room) = h * way;
}
"""
# Two samples in one: along x before, in and behind a cell, of its four edges; and those of eight edges around.
INTEGER = {
    "STORE": "alignas(64) int pair[16][16];",
    "LOAD": """
        for (int m = 0; m < 4; ++m) {
            const auto* c = a + (m & 1) * nx + (m >> 1) * nxy;
            PAIR p[3];
            __builtin_memcpy(p, c + go[0][0], sizeof(PAIR));
            __builtin_memcpy(p + 1, c + go[0][3] - 1, sizeof(PAIR));
            pair[m][l] = go[0][0] < 0 ? p[0] : TWICE(LOWER((int)p[0]));
            pair[4 + m][l] = go[0][3] > 1 ? p[1] : TWICE(UPPER((int)p[1]));
            const int up = m & 1 ? 3 : 0, along = 1 + (m >> 1);
            __builtin_memcpy(p + 2, a + go[1][up] + go[2][along], sizeof(PAIR));
            pair[8 + m][l] = p[2];
            __builtin_memcpy(p + 2, a + go[1][along] + go[2][up], sizeof(PAIR));
            pair[12 + m][l] = p[2];
        }
""",
    "UNPACK": """
    vf sample[64];
    for (int m = 0; m < 4; ++m) {
#define BOTH(to, i) sample[to] = __builtin_convertvector(LOWER((*(const vi*)pair[i])), vf); \\
        sample[to + 1] = __builtin_convertvector(UPPER((*(const vi*)pair[i])), vf)
        const int up = m & 1 ? 3 : 0, along = 1 + (m >> 1);
        BOTH(16 * along + 4 * (1 + (m & 1)), m);
        BOTH(16 * along + 4 * (1 + (m & 1)) + 2, 4 + m);
        BOTH(16 * along + 4 * up + 1, 8 + m);
        BOTH(16 * up + 4 * along + 1, 12 + m);
    }
#define AROUND(x, y, z) sample[16 * (z) + 4 * (y) + (x)]
""",
}
FLOATING = {
    "STORE": "alignas(64) float sample[64][16];",
    "LOAD": """
        const double base = double(*a);
#define SAMPLE(x, y, z) sample[16 * z + 4 * y + x][l] = (float)(double(a[go[0][x] + go[1][y] + go[2][z]]) - base)
        for (int z = 1; z < 3; ++z)
            for (int y = 1; y < 3; ++y) {
                for (int x = 0; x < 4; ++x) SAMPLE(x, y, z);
                SAMPLE(y, 0, z); SAMPLE(y, 3, z); SAMPLE(y, z, 0); SAMPLE(y, z, 3);
            }
""",
    "UNPACK": "#define AROUND(x, y, z) (*(const vf*)sample[16 * (z) + 4 * (y) + (x)])",
}


@cache
def make_gradients(dtype, central):
    """``gradients(field, to_world, ahead_of, lines, cells, times, which, gradient)`` of cells of several rays:
    ``central`` differences, or the cell's own; the matrices are of gradients and of directions. Other arguments are as
    of ``cubics.make_centered``; ``gradient`` (ROWS, a multiple of sixteen) is what is found.
    """
    Field = make_samples(dtype)
    text = GRADIENTS
    for name, code in (INTEGER if dtype in PAIRS else FLOATING).items():
        text = text.replace(name, code)
    if dtype in PAIRS:
        kind, lower, upper = PAIRS[dtype]
        bits = 4 * wp.types.type_size_in_bytes(dtype) * 2
        twice = f"(({{}} & {2**bits - 1}) * {2**bits + 1})"
        text = text.replace("PAIR ", f"{kind} ").replace("(PAIR)", f"({kind})")
        text = f"#define TWICE(a) {twice.format('(a)')}\n{text}"
        text = f"#define LOWER(a) {lower.format('(a)')}\n#define UPPER(a) {upper.format('(a)')}\n{text}"
    text = text.replace("CENTRAL", str(int(central)))

    @wp.func_native(apart(text))
    def gradients(
        field: Field,
        to_world: wp.mat33d,
        ahead_of: wp.mat33d,
        lines: wp.array2d(dtype=wp.float64),
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        which: wp.array2d(dtype=int),
        gradient: wp.array2d(dtype=wp.float32),
    ): ...

    return gradients
