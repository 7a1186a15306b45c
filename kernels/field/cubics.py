"""Cubics of many cells of a ray in single precision, and how far rounding takes the scalar from that of the field.

In vectors, and the same in Warp for whoever reads, and for what has none. The numbers S1 to S3 are those of
docs/proof-single.md.
"""

from functools import cache

import warp as wp

from ..vectors import VECTORS
from .samples import make_samples

# Rounding of the scalar, in parts of the largest difference that a cell's corners are computed from, and of the
# corner that they are counted from where that is rounded itself.
U = 2.0**-24
FIELD_ULPS = 256 * U
CORNER_ULPS = 4 * U
# And of what underflows: next to nothing beside control points, of which some are above 2^-31.
TINY = 2.0**-120

# Where cells are: in double, then relative to the cell's corner in single; and half the way through them (S1).
PLACED = """
const int64_t room = where.shape[1];
for (int l = first; l < first + n; l += 8) {
    const vq q = *(const vq*)(cells.data + l);
    const vd t0 = *(const vd*)(times.data + l), t1 = *(const vd*)(times.data + times.shape[1] + l);
    const vd t = 0.5 * (t0 + t1), h = 0.5 * (t1 - t0);
    float* to = where.data + l;
#define PUT(i, a) *(v8f*)(to + (i) * room) = __builtin_convertvector(a, v8f)
#define WHOLE(shift) __builtin_convertvector(__builtin_convertvector((q >> shift) & 0x1fffff, v8i), vd)
    PUT(0, t * d[0] + (origin[0] - WHOLE(0)));
    PUT(1, t * d[1] + (origin[1] - WHOLE(21)));
    PUT(2, t * d[2] + (origin[2] - WHOLE(42)));
    PUT(3, h);
    for (int a = 0; a < 3; ++a) PUT(4 + a, h * d[a]);
}
"""

CUBICS = """
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1], room = where.shape[1];
const auto* __restrict data = field.data.data;
uint64_t* __restrict place = cells.data + first;
float* __restrict from = where.data + first;
const int padded = (n + 15) & -16;
for (int l = n; l < padded; ++l) {
    place[l] = place[n - 1];
    for (int a = 0; a < 7; ++a) from[a * room + l] = a < 3 ? from[a * room + n - 1] : 0.0f;
}
alignas(64) int64_t at[CELLS];
STORE
for (int l = 0; l < padded; l += 8) {
    const vq q = *(const vq*)(place + l);
    *(vq*)(at + l) = (q >> 42) * nxy + ((q >> 21) & 0x1fffff) * nx + (q & 0x1fffff);
}
// Corners of all.
EACH_CELL
for (int l = 0; l < padded; ++l) {
    const auto* c = data + at[l];
LOAD
}
for (int u = 0; u < padded; u += 16) {
#define FROM(a) *(const vf*)(from + (a) * room + u)
    const vf fx = FROM(0), fy = FROM(1), fz = FROM(2), hx = FROM(4), hy = FROM(5), hz = FROM(6);
    // Relative to the first.
CORNERS
    const vf wide = MAX(
        MAX(MAX(ABS(e010), ABS(e001)), MAX(ABS(e011), ABS(x00))), MAX(MAX(ABS(x10), ABS(x01)), ABS(x11)));
    const vf xy0 = x10 - x00, xz0 = x01 - x00, xyz = (x11 - x01) - xy0;
    const vf v00 = fx * x00, v01 = e001 + fx * x01, y0 = e010 + fx * x10 - v00, y1 = e011 + fx * x11 - v01;
    const vf v0 = v00 + fy * y0, dz = v01 + fy * y1 - v0, xz = xz0 + fy * xyz, yz = y1 - y0;
    const vf dx = x00 + fy * xy0 + fz * xz, dy = y0 + fz * yz, xy = xy0 + fz * xyz;
    const vf m2 = hx * (hy * xy + hz * xz) + hy * (hz * yz);
    float* out = cubic.data + u;
    *(vf*)out = base;
    *(vf*)(out + CELLS) = v0 + fz * dz + m2 * (1.0f / 3);
    *(vf*)(out + 2 * CELLS) = hx * dx + hy * dy + hz * dz;
    *(vf*)(out + 3 * CELLS) = m2;
    *(vf*)(out + 4 * CELLS) = hx * (hy * hz) * xyz;
    *(vf*)(out + 5 * CELLS) = FROM(3);
    *(vf*)(out + 6 * CELLS) = wide * (FIELD_ULPS) ROUNDED;
}
"""
# What differs still does in single precision.
NARROWED = """
auto narrowed = [](double a) -> float { return (float)a != 0.0f || a == 0.0 ? (float)a : 0x1p-149f; };
"""
# Pairs of corners along x, two numbers in one.
INTEGER = {
    "STORE": "alignas(64) int pair[4][CELLS];",
    "EACH_CELL": "",
    "LOAD": """
    PAIR p[4];
    __builtin_memcpy(p, c, sizeof(PAIR));
    __builtin_memcpy(p + 1, c + nx, sizeof(PAIR));
    __builtin_memcpy(p + 2, c + nxy, sizeof(PAIR));
    __builtin_memcpy(p + 3, c + nxy + nx, sizeof(PAIR));
    for (int m = 0; m < 4; ++m) pair[m][l] = p[m];
""",
    "CORNERS": """
#define NUMBER(a) __builtin_convertvector(a, vf)
#define LOW(m) LOWER((*(const vi*)(pair[m] + u)))
#define HIGH(m) UPPER((*(const vi*)(pair[m] + u)))
    const vi c0 = LOW(0), c2 = LOW(1), c4 = LOW(2), c6 = LOW(3);
    const vf base = NUMBER(c0), e010 = NUMBER(c2 - c0), e001 = NUMBER(c4 - c0), e011 = NUMBER(c6 - c0);
    const vf x00 = NUMBER(HIGH(0) - c0), x10 = NUMBER(HIGH(1) - c2), x01 = NUMBER(HIGH(2) - c4);
    const vf x11 = NUMBER(HIGH(3) - c6);
""",
}
FLOATING = {
    "STORE": NARROWED + "alignas(64) float pair[9][CELLS];",
    "EACH_CELL": "",
    "LOAD": """
    const double c0 = double(c[0]), c2 = double(c[nx]), c4 = double(c[nxy]), c6 = double(c[nxy + nx]);
    pair[0][l] = (float)(c0 - field.shift);
    pair[8][l] = (double)pair[0][l] == c0 - field.shift ? 0.0f : CORNER_ULPS;
    pair[1][l] = narrowed(c2 - c0);
    pair[2][l] = narrowed(c4 - c0);
    pair[3][l] = narrowed(c6 - c0);
    pair[4][l] = narrowed(double(c[1]) - c0);
    pair[5][l] = narrowed(double(c[nx + 1]) - c2);
    pair[6][l] = narrowed(double(c[nxy + 1]) - c4);
    pair[7][l] = narrowed(double(c[nxy + nx + 1]) - c6);
""",
    "CORNERS": """
#define CORNER(m) *(const vf*)(pair[m] + u)
    const vf base = CORNER(0), e010 = CORNER(1), e001 = CORNER(2), e011 = CORNER(3);
    const vf x00 = CORNER(4), x10 = CORNER(5), x01 = CORNER(6), x11 = CORNER(7);
    const vf coarse = (ABS(base) + TINY) * CORNER(8);
""",
}
# Pairs of float32 likewise, whose differences single precision has as exactly as double rounded.
SINGLE = {
    "STORE": "alignas(64) int64_t pair[4][CELLS];",
    # Gathers would wait for lines of the cache one after the other.
    "EACH_CELL": "#pragma clang loop vectorize(disable)",
    "LOAD": """
    __builtin_memcpy(pair[0] + l, c, 8);
    __builtin_memcpy(pair[1] + l, c + nx, 8);
    __builtin_memcpy(pair[2] + l, c + nxy, 8);
    __builtin_memcpy(pair[3] + l, c + nxy + nx, 8);
""",
    "CORNERS": """
#define HALF(m, b) *(const vf*)(pair[m] + u + 8 * b)
#define EACH(m, i) __builtin_shufflevector(HALF(m, 0), HALF(m, 1), i, i + 2, i + 4, i + 6, i + 8, i + 10, i + 12, \\
    i + 14, i + 16, i + 18, i + 20, i + 22, i + 24, i + 26, i + 28, i + 30)
    const vf c0 = EACH(0, 0), c2 = EACH(1, 0), c4 = EACH(2, 0), c6 = EACH(3, 0);
    const vf e010 = c2 - c0, e001 = c4 - c0, e011 = c6 - c0;
    const vf x00 = EACH(0, 1) - c0, x10 = EACH(1, 1) - c2, x01 = EACH(2, 1) - c4, x11 = EACH(3, 1) - c6;
    v8f base8[2], coarse8[2];
    for (int b = 0; b < 2; ++b) {
        alignas(64) float half[16];
        *(vf*)half = c0;
        const vd exact = __builtin_convertvector(*(const v8f*)(half + 8 * b), vd) - field.shift;
        base8[b] = __builtin_convertvector(exact, v8f);
        const auto same = __builtin_convertvector(base8[b], vd) == exact;
        coarse8[b] = __builtin_convertvector(same ? (vd){} : (vd){} + CORNER_ULPS, v8f);
    }
    const vf base = JOIN(base8[0], base8[1]), coarse = (ABS(base) + TINY) * JOIN(coarse8[0], coarse8[1]);
""",
}
# How two integers lie in a larger one: its type, and either of them.
PAIRS = {
    wp.uint8: ("uint16_t", "({} & 255)", "({} >> 8)"),
    wp.int8: ("uint16_t", "(({} << 24) >> 24)", "(({} << 16) >> 24)"),
    wp.uint16: ("int32_t", "({} & 65535)", "(({} >> 16) & 65535)"),
    wp.int16: ("int32_t", "(({} << 16) >> 16)", "({} >> 16)"),
}


CENTERED = """
const auto* __restrict data = field.data.data;
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const int n = which.data[0];
for (int j = 0; j < n; j += 8) {
    STORE
    alignas(64) double start[8], stop[8];
    vd r[8], line[6];
    alignas(64) int64_t place[8];
    for (int l = 0; l < 8; ++l) {
        const int* of = which.data + (j + l < n ? j + l + 1 : n);
        const int i = of[0], ray = of[which.shape[1]];
        const uint64_t q = cells.data[i];
        const auto* c = data + (int64_t)(q >> 42) * nxy + (int64_t)((q >> 21) & 0x1fffff) * nx
            + (int64_t)(q & 0x1fffff);
LOAD
        r[l] = *(const vd*)(lines.data + lines.shape[1] * ray);
        place[l] = (int64_t)q;
        start[l] = times.data[i];
        stop[l] = times.data[times.shape[1] + i];
    }
    // Rays' numbers by what they are.
#define OF_TWO(i, a) __builtin_shufflevector(r[i], r[i + 1], a, a + 8, a + 2, a + 10, a + 4, a + 12, a + 6, a + 14)
#define FIRST4(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define LAST4(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)
    for (int odd = 0; odd < 2; ++odd) {
        vd two[4];
        for (int i = 0; i < 4; ++i) two[i] = odd ? OF_TWO(2 * i, 1) : OF_TWO(2 * i, 0);
        const vd a = FIRST4(two[0], two[1]), b = FIRST4(two[2], two[3]);
        line[odd] = __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11);
        line[4 + odd] = __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15);
        line[2 + odd] = __builtin_shufflevector(
            LAST4(two[0], two[1]), LAST4(two[2], two[3]), 0, 1, 2, 3, 8, 9, 10, 11);
    }
CORNERS
#define OF(a) (*(const vd*)a)
    const vd h = 0.5 * (OF(stop) - OF(start)), t = OF(start) + h, d0 = line[3], d1 = line[4], d2 = line[5];
    const vq q = *(const vq*)place;
#define PLACE(a, shift) (line[a] + t * d##a - __builtin_convertvector((q >> shift) & 0x1fffff, vd))
    const vd x = PLACE(0, 0), y = PLACE(1, 21), z = PLACE(2, 42);
    const vd x00 = corner[1] - corner[0], x10 = corner[3] - corner[2];
    const vd x01 = corner[5] - corner[4], x11 = corner[7] - corner[6];
    const vd v00 = corner[0] + x * x00, v01 = corner[4] + x * x01;
    const vd y0 = corner[2] + x * x10 - v00, y1 = corner[6] + x * x11 - v01;
    const vd v0 = v00 + y * y0, dz = v01 + y * y1 - v0, xy0 = x10 - x00, xyz = x11 - x01 - xy0;
    const vd xz = x01 - x00 + y * xyz, yz = y1 - y0;
    const vd dx = x00 + y * xy0 + z * xz, dy = y0 + z * yz, xy = xy0 + z * xyz;
    const int64_t room = cubic.shape[1];
    double* to = cubic.data + j;
    *(vd*)to = v0 + z * dz;
    *(vd*)(to + room) = h * (d0 * dx + d1 * dy + d2 * dz);
    *(vd*)(to + 2 * room) = h * h * (d0 * (d1 * xy + d2 * xz) + d1 * (d2 * yz));
    *(vd*)(to + 3 * room) = h * h * h * (d0 * d1 * d2 * xyz);
    *(vd*)(to + 4 * room) = h;
    vd low = corner[0], high = low;
    for (int m = 1; m < 8; ++m) low = MIN(low, corner[m]), high = MAX(high, corner[m]);
    *(vd*)(to + 5 * room) = high > low ? ulps[0] * MAX(high, -low) + ulps[1] * (high - low) + TINY : (vd){};
}
"""
# Corners as numbers of their own, of integers in pairs.
CENTERED_OF = {
    "STORE": "alignas(64) double stored[8][8];",
    "LOAD": """
        for (int m = 0; m < 8; ++m)
            stored[m][l] = double(c[(m >> 2) * nxy + ((m >> 1) & 1) * nx + (m & 1)]) SHIFTED;
""",
    "CORNERS": """
    vd corner[8];
    for (int m = 0; m < 8; ++m) corner[m] = *(const vd*)stored[m];
""",
}
CENTERED_OF_PAIRS = {
    "STORE": "alignas(32) int pair[4][8];",
    "LOAD": INTEGER["LOAD"],
    "CORNERS": """
    vd corner[8];
    for (int m = 0; m < 4; ++m) {
        corner[2 * m] = __builtin_convertvector(LOWER((*(const v8i*)pair[m])), vd);
        corner[2 * m + 1] = __builtin_convertvector(UPPER((*(const v8i*)pair[m])), vd);
    }
""",
}


def paired(dtype, text):
    """A text that reads pairs of samples, where they are integers."""
    if dtype not in PAIRS:
        return text
    kind, lower, upper = PAIRS[dtype]
    text = text.replace("PAIR", kind)
    return f"#define LOWER(a) {lower.format('(a)')}\n#define UPPER(a) {upper.format('(a)')}\n{text}"


@cache
def make_centered(dtype):
    """``centered(field, lines, cells, times, which, ulps, cubic)``: ``cell.make_centered`` of cells of several rays.
    ``which`` (2, n) has how many and which they are, and behind that their rays; ``lines`` have the rays' origins and
    directions; ``ulps`` is what the scalar is off by in parts of the largest corner and of the range of a cell.

    Rows of ``cubic`` (6, a multiple of eight) are the four coefficients, half the length and what the scalar is off by.
    """
    Field = make_samples(dtype)
    text = CENTERED.replace("TINY", repr(TINY))
    for name, code in (CENTERED_OF_PAIRS if dtype in PAIRS else CENTERED_OF).items():
        text = text.replace(name, code)
    text = text.replace("SHIFTED", "- field.shift" if dtype in (wp.float16, wp.float32, wp.float64) else "")

    @wp.func_native(VECTORS + paired(dtype, text))
    def centered(
        field: Field,
        lines: wp.array2d(dtype=wp.float64),
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        which: wp.array2d(dtype=int),
        ulps: wp.vec2d,
        cubic: wp.array2d(dtype=wp.float64),
    ): ...

    return centered


@cache
def make_placed(vectors):
    """``placed(origin, d, cells, times, first, n, where)``: n cells of a ray from ``first`` on, places with 21 bits an
    axis, that it enters and leaves at ``times`` (2, m). Rows of ``where`` (7, m) are the middle of the ray in a cell,
    from the cell's corner on, half the length, and half the way along each axis. There is room for seven more.
    """
    real = wp.float32

    @wp.func_native(VECTORS + PLACED)
    def in_vectors(
        origin: wp.vec3d,
        d: wp.vec3d,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        first: int,
        n: int,
        where: wp.array2d(dtype=wp.float32),
    ): ...

    @wp.func
    def one_by_one(
        origin: wp.vec3d,
        d: wp.vec3d,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        first: int,
        n: int,
        where: wp.array2d(dtype=wp.float32),
    ):
        for l in range(first, first + n):
            place = cells[l]
            h = wp.float64(0.5) * (times[1, l] - times[0, l])
            t = wp.float64(0.5) * (times[0, l] + times[1, l])
            where[3, l] = real(h)
            for a in range(3):
                cell = int((place >> wp.uint64(21 * a)) & wp.uint64(0x1FFFFF))
                where[a, l] = real(origin[a] + t * d[a] - wp.float64(cell))
                where[4 + a, l] = real(h * d[a])

    return in_vectors if vectors else one_by_one


@cache
def make_cubics(dtype, count):
    """``cubics(field, cells, where, first, n, cubic)``: of n cells, up to ``count``, that are placed from ``first`` on.
    Rows of ``cubic`` are the corner that the scalar is counted from, the scalar's mean from there, ``m1``, ``m2``,
    ``m3`` and half the length, of ``mean + m1 v + m2 (v^2 - 1/3) + m3 v^3`` with v in [-1, 1], and what rounding takes
    it away at most: 0 where all corners are equal, and exact.

    Up to a multiple of sixteen, more of no length follow, also of ``cells``.
    """
    Field = make_samples(dtype)
    integer = dtype in PAIRS
    text = CUBICS.replace("ROUNDED", "" if integer else "+ coarse + MIN(wide * 0x1p29f, zero + TINY)")
    for name, code in (INTEGER if integer else SINGLE if dtype is wp.float32 else FLOATING).items():
        text = text.replace(name, code)
    text = paired(dtype, text)
    for name, value in {
        "FIELD_ULPS": f"{FIELD_ULPS!r}f",
        "CORNER_ULPS": f"{CORNER_ULPS!r}f",
        "TINY": f"{TINY!r}f",
        "CELLS": str(count),
    }.items():
        text = text.replace(name, value)

    @wp.func_native(VECTORS + text)
    def cubics(
        field: Field,
        cells: wp.array(dtype=wp.uint64),
        where: wp.array2d(dtype=wp.float32),
        first: int,
        n: int,
        cubic: wp.array2d(dtype=wp.float32),
    ): ...

    return cubics


@cache
def make_cubics_one_by_one(dtype):
    """The same, cell by cell."""
    real = wp.float32
    Field = make_samples(dtype)

    @wp.func
    def corner(field: Field, i: int, j: int, k: int):
        return wp.float64(field.data[k, j, i])

    @wp.func
    def narrowed(a: wp.float64):
        return wp.where(real(a) != real(0.0) or a == wp.float64(0.0), real(a), real(wp.static(2.0**-149)))

    @wp.func
    def cubics(
        field: Field,
        cells: wp.array(dtype=wp.uint64),
        where: wp.array2d(dtype=wp.float32),
        first: int,
        n: int,
        cubic: wp.array2d(dtype=wp.float32),
    ):
        last = (n + 15) & ~15
        for l in range(last):
            at = first + l
            if l >= n:
                at = first + n - 1
                cells[first + l] = cells[at]
            place = cells[at]
            i = int(place & wp.uint64(0x1FFFFF))
            j = int((place >> wp.uint64(21)) & wp.uint64(0x1FFFFF))
            k = int((place >> wp.uint64(42)) & wp.uint64(0x1FFFFF))
            fx = where[0, at]
            fy = where[1, at]
            fz = where[2, at]
            h = where[3, at]
            hx = where[4, at]
            hy = where[5, at]
            hz = where[6, at]
            if l >= n:
                h = real(0.0)
                hx = real(0.0)
                hy = real(0.0)
                hz = real(0.0)
            # Corners, relative to the first.
            c0 = corner(field, i, j, k)
            c2 = corner(field, i, j + 1, k)
            c4 = corner(field, i, j, k + 1)
            c6 = corner(field, i, j + 1, k + 1)
            base = real(c0 - field.shift)
            e010 = narrowed(c2 - c0)
            e001 = narrowed(c4 - c0)
            e011 = narrowed(c6 - c0)
            x00 = narrowed(corner(field, i + 1, j, k) - c0)
            x10 = narrowed(corner(field, i + 1, j + 1, k) - c2)
            x01 = narrowed(corner(field, i + 1, j, k + 1) - c4)
            x11 = narrowed(corner(field, i + 1, j + 1, k + 1) - c6)
            wide = wp.max(
                wp.max(wp.max(wp.abs(e010), wp.abs(e001)), wp.max(wp.abs(e011), wp.abs(x00))),
                wp.max(wp.max(wp.abs(x10), wp.abs(x01)), wp.abs(x11)),
            )
            # The cubic (S2), and its rounding (S3).
            xy0 = x10 - x00
            xyz = (x11 - x01) - xy0
            v00 = fx * x00
            v01 = e001 + fx * x01
            y0 = e010 + fx * x10 - v00
            y1 = e011 + fx * x11 - v01
            v0 = v00 + fy * y0
            dz = v01 + fy * y1 - v0
            xz = (x01 - x00) + fy * xyz
            yz = y1 - y0
            dx = x00 + fy * xy0 + fz * xz
            dy = y0 + fz * yz
            xy = xy0 + fz * xyz
            m2 = hx * (hy * xy + hz * xz) + hy * (hz * yz)
            blur = wide * real(wp.static(FIELD_ULPS))
            if wide > real(0.0):
                blur += real(wp.static(TINY))
            if wp.float64(base) != c0 - field.shift:
                blur += (wp.abs(base) + real(wp.static(TINY))) * real(wp.static(CORNER_ULPS))
            cubic[0, l] = base
            cubic[1, l] = v0 + fz * dz + m2 * real(wp.static(1.0 / 3.0))
            cubic[2, l] = hx * dx + hy * dy + hz * dz
            cubic[3, l] = m2
            cubic[4, l] = hx * (hy * hz) * xyz
            cubic[5, l] = h
            cubic[6, l] = blur

    return cubics
