"""The cubic of one cell along a ray in single precision, as ``cubics`` has many, and how far rounding takes it.

The numbers S1 to S3 and S16 are those of docs/proof-single.md.
"""

from functools import cache

import warp as wp

from .cubics import CORNER_ULPS, NARROWED, TINY, U
from .samples import make_samples

# Rounding of the scalar where the place in a cell comes from its faces (S16), in parts of the largest difference.
FACE_ULPS = 320 * U

# A cell's first corner and differences that it is made of, and in the last place the ulps of the corner where it is
# rounded: of integers exact.
CORNERS = """
const size_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const auto* c = field.data.data + (k * nxy + j * nx + i);
using A = WIDE;
const A c0 = A(c[0]), c2 = A(c[nx]), c4 = A(c[nxy]), c6 = A(c[nxy + nx]), shift = A(SHIFT);
const A base = c0 - shift, back = c0 - base;
const bool exact = (c0 - (base + back)) + (back - shift) == A(0) && A((float)base) == base;
const float all[9] = {
    (float)base, narrowed(c2 - c0), narrowed(c4 - c0), narrowed(c6 - c0), narrowed(A(c[1]) - c0),
    narrowed(A(c[nx + 1]) - c2), narrowed(A(c[nxy + 1]) - c4), narrowed(A(c[nxy + nx + 1]) - c6), exact ? 0.0f : ULPS
};
wp::vec_t<9, float> result;
for (int i = 0; i < 9; ++i) result.c[i] = all[i];
return result;
"""
vec9 = wp.types.vector(9, wp.float32)
# What differences of floating-point samples are taken in.
WIDE = {wp.float64: "double", wp.float32: "float", wp.float16: "float"}


@wp.struct
class Narrow:
    """The scalar along a piece of ray, ``base + mean + m1 v + m2 (v^2 - 1/3) + m3 v^3``, v in [-1, 1], half its length,
    and what rounding takes it away at most.
    """

    base: wp.float32
    mean: wp.float32
    m1: wp.float32
    m2: wp.float32
    m3: wp.float32
    h: wp.float32
    blur: wp.float32
    most: wp.float32  # the largest difference of corners


@cache
def make_narrow(dtype):
    """``narrow(field, cell, f, d, h, ulps)`` -> the ``Narrow`` of a piece with its middle at f from a cell's first
    corner, direction d and half the length h; ``ulps`` is the rounding that it has, in parts of the largest difference.
    """
    real = wp.float32
    Field = make_samples(dtype)
    wide = WIDE.get(dtype, "int")
    shift = "field.shift" if dtype in WIDE else "0"

    text = NARROWED + CORNERS if wide == "double" else CORNERS.replace("narrowed(", "(float)(")

    @wp.func_native(text.replace("WIDE", wide).replace("SHIFT", shift).replace("ULPS", f"{CORNER_ULPS!r}f"))
    def corners(field: Field, i: int, j: int, k: int) -> vec9: ...

    @wp.func
    def narrow(field: Field, cell: wp.vec3i, f: wp.vec3, d: wp.vec3, h: real, ulps: real):
        # Corners, relative to the first.
        c = corners(field, cell[0], cell[1], cell[2])
        e010 = c[1]
        e001 = c[2]
        x00 = c[4]
        x10 = c[5]
        x01 = c[6]
        x11 = c[7]
        wide = wp.max(
            wp.max(wp.max(wp.abs(e010), wp.abs(e001)), wp.max(wp.abs(c[3]), wp.abs(x00))),
            wp.max(wp.max(wp.abs(x10), wp.abs(x01)), wp.abs(x11)),
        )
        # The cubic (S2), and its rounding (S3).
        xy0 = x10 - x00
        xyz = (x11 - x01) - xy0
        v00 = f[0] * x00
        v01 = e001 + f[0] * x01
        y0 = e010 + f[0] * x10 - v00
        y1 = c[3] + f[0] * x11 - v01
        v0 = v00 + f[1] * y0
        dz = v01 + f[1] * y1 - v0
        xz = (x01 - x00) + f[1] * xyz
        yz = y1 - y0
        dx = x00 + f[1] * xy0 + f[2] * xz
        dy = y0 + f[2] * yz
        xy = xy0 + f[2] * xyz
        result = Narrow()
        result.base = c[0]
        e = h * d
        result.m1 = e[0] * dx + e[1] * dy + e[2] * dz
        result.m2 = e[0] * (e[1] * xy + e[2] * xz) + e[1] * (e[2] * yz)
        result.m3 = e[0] * e[1] * e[2] * xyz
        result.mean = v0 + f[2] * dz + result.m2 * real(wp.static(1.0 / 3.0))
        result.h = h
        result.most = wide
        result.blur = wide * ulps + (wp.abs(c[0]) + real(wp.static(TINY))) * c[8]
        if wide > real(0.0):
            result.blur += real(wp.static(TINY))
        return result

    return narrow
