"""The scalar field: trilinear interpolation of the samples, in index coordinates, minus a constant.

The constant (``shift``, about the middle of the control points where those are far from 0) is taken from floating-point
samples as they are loaded, so that data such as 1e6 +- 1 keep their range in float32; integers up to 16 bits are exact
without it.
A cell with a NaN or infinite corner has no finite value, which is how absent data travel.
"""

from functools import cache

import warp as wp

from ..precision import vec3_of


@cache
def make_samples(dtype):
    """The struct of a field of ``dtype`` samples."""

    @wp.struct
    class Field:
        data: wp.array3d(dtype=dtype)  # [z, y, x]
        last: wp.vec3i  # the last cell along x, y, z: two less than the samples, of which there are at least two
        shift: wp.float64  # a float32 number, but for float64 samples

    return Field


@cache
def make_corner(dtype, real):
    """The struct of a field of ``dtype`` samples, and ``corner(field, i, j, k)`` -> ``real``, a sample less shift."""
    shifted = dtype in (wp.float16, wp.float32, wp.float64)
    wide = wp.float64 if dtype is wp.float64 else real
    Field = make_samples(dtype)

    @wp.func
    def corner(field: Field, i: int, j: int, k: int):
        if wp.static(shifted):
            return real(wide(field.data[k, j, i]) - wide(field.shift))
        return real(field.data[k, j, i])

    return Field, corner


@cache
def make_whole(dtype):
    """The struct of a field of integer samples, and ``whole(field, i, j, k)`` -> int, a sample as it is."""
    Field = make_samples(dtype)

    @wp.func
    def whole(field: Field, i: int, j: int, k: int):
        return int(field.data[k, j, i])

    return Field, whole


@cache
def make_value(dtype, real):
    """``value(field, p)`` -> ``real`` at index coordinates ``p``."""
    vec3 = vec3_of(real)
    Field, corner = make_corner(dtype, real)

    @wp.func
    def value(field: Field, p: vec3):
        # The outer max with 0 also tells the compiler that no index is negative, which saves Warp's wrap-around.
        i = wp.max(wp.min(int(p[0]), field.last[0]), 0)
        j = wp.max(wp.min(int(p[1]), field.last[1]), 0)
        k = wp.max(wp.min(int(p[2]), field.last[2]), 0)
        x = p[0] - real(i)
        y = p[1] - real(j)
        z = p[2] - real(k)
        i1 = i + 1
        j1 = j + 1
        k1 = k + 1
        c000 = corner(field, i, j, k)
        c010 = corner(field, i, j1, k)
        c001 = corner(field, i, j, k1)
        c011 = corner(field, i, j1, k1)
        c00 = c000 + x * (corner(field, i1, j, k) - c000)
        c10 = c010 + x * (corner(field, i1, j1, k) - c010)
        c01 = c001 + x * (corner(field, i1, j, k1) - c001)
        c11 = c011 + x * (corner(field, i1, j1, k1) - c011)
        c0 = c00 + y * (c10 - c00)
        c1 = c01 + y * (c11 - c01)
        return c0 + z * (c1 - c0)

    return value


@cache
def make_differences(dtype, real, kind):
    """``differences(field, p)`` -> vec3, the gradient at index coordinates ``p``, in samples.

    ``kind`` "central": differences of the trilinear field over a voxel to each side, which are those of the samples,
    interpolated; at the box's faces they are one-sided. "cell": the field's own derivatives, which jump at cell faces.
    """
    vec3 = vec3_of(real)
    Field, corner = make_corner(dtype, real)
    central = kind == "central"

    @wp.func
    def bilinear(a: real, b: real, c: real, d: real, u: real, v: real):
        low = a + u * (b - a)
        return low + v * (c + u * (d - c) - low)

    @wp.func
    def slope(before: real, low: real, high: real, after: real, u: real, below: int, above: int):
        """Between differences of the samples at both ends of a cell, which reach so many samples away."""
        first = (high - before) / real(1 + below)
        last = (after - low) / real(1 + above)
        return first + u * (last - first)

    @wp.func
    def differences(field: Field, p: vec3):
        i = wp.max(wp.min(int(p[0]), field.last[0]), 0)
        j = wp.max(wp.min(int(p[1]), field.last[1]), 0)
        k = wp.max(wp.min(int(p[2]), field.last[2]), 0)
        x = p[0] - real(i)
        y = p[1] - real(j)
        z = p[2] - real(k)
        i1 = i + 1
        j1 = j + 1
        k1 = k + 1
        c000 = corner(field, i, j, k)
        c100 = corner(field, i1, j, k)
        c010 = corner(field, i, j1, k)
        c110 = corner(field, i1, j1, k)
        c001 = corner(field, i, j, k1)
        c101 = corner(field, i1, j, k1)
        c011 = corner(field, i, j1, k1)
        c111 = corner(field, i1, j1, k1)
        # Means over the faces of the cell.
        x0 = bilinear(c000, c010, c001, c011, y, z)
        x1 = bilinear(c100, c110, c101, c111, y, z)
        y0 = bilinear(c000, c100, c001, c101, x, z)
        y1 = bilinear(c010, c110, c011, c111, x, z)
        z0 = bilinear(c000, c100, c010, c110, x, y)
        z1 = bilinear(c001, c101, c011, c111, x, y)
        if not wp.static(central):
            return vec3(x1 - x0, y1 - y0, z1 - z0)
        il = wp.max(i - 1, 0)
        jl = wp.max(j - 1, 0)
        kl = wp.max(k - 1, 0)
        ih = wp.max(wp.min(i + 2, field.last[0] + 1), 0)
        jh = wp.max(wp.min(j + 2, field.last[1] + 1), 0)
        kh = wp.max(wp.min(k + 2, field.last[2] + 1), 0)
        xl = bilinear(
            corner(field, il, j, k), corner(field, il, j1, k), corner(field, il, j, k1), corner(field, il, j1, k1), y, z
        )
        xh = bilinear(
            corner(field, ih, j, k), corner(field, ih, j1, k), corner(field, ih, j, k1), corner(field, ih, j1, k1), y, z
        )
        yl = bilinear(
            corner(field, i, jl, k), corner(field, i1, jl, k), corner(field, i, jl, k1), corner(field, i1, jl, k1), x, z
        )
        yh = bilinear(
            corner(field, i, jh, k), corner(field, i1, jh, k), corner(field, i, jh, k1), corner(field, i1, jh, k1), x, z
        )
        zl = bilinear(
            corner(field, i, j, kl), corner(field, i1, j, kl), corner(field, i, j1, kl), corner(field, i1, j1, kl), x, y
        )
        zh = bilinear(
            corner(field, i, j, kh), corner(field, i1, j, kh), corner(field, i, j1, kh), corner(field, i1, j1, kh), x, y
        )
        return vec3(
            slope(xl, x0, x1, xh, x, i - il, ih - i1),
            slope(yl, y0, y1, yh, y, j - jl, jh - j1),
            slope(zl, z0, z1, zh, z, k - kl, kh - k1),
        )

    return differences
