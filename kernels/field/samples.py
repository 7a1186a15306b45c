"""The scalar field: trilinear interpolation of the samples, in index coordinates, minus a constant.

The constant (``shift``, about the middle of the control points where those are far from 0) is taken from floating-point
samples as they are loaded, so that data such as 1e6 +- 1 keep their range in float32; integers up to 16 bits are exact
without it.
A cell with a NaN or infinite corner has no finite value, which is how absent data travel. What has no weight at a place
says nothing there: faces of absent cells belong to those behind as well, so that steps that end in a face are of the
side that they are on, whichever way samples are stored.
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
def make_layered(real):
    """``layered(last, p)``: p, in a layer of samples where it is next to one: the scalar is that layer's, on whichever
    side rounding puts p.
    """
    vec3 = vec3_of(real)
    # Rounding of a place on a ray, in parts of the grid.
    rounding = 2.0**-22 if real is wp.float32 else 2.0**-40

    @wp.func
    def layered(last: wp.vec3i, p: vec3):
        for a in range(3):
            layer = wp.rint(p[a])
            if wp.abs(p[a] - layer) <= real(rounding) * real(last[a] + 1):
                p[a] = layer
        return p

    return layered


@cache
def make_mix(real, finite):
    """``mix(a, b, u)``: a for u = 0, b for u = 1, linear between; of those that may not be ``finite`` neither matters
    where it has no weight.
    """

    @wp.func
    def mix(a: real, b: real, u: real):
        if not wp.static(finite):
            if u == real(0.0):
                return a
            if u == real(1.0):
                return b
        return a + u * (b - a)

    return mix


@cache
def make_value(dtype, real, finite=True):
    """``value(field, p)`` -> ``real`` at index coordinates ``p``, of samples that are all ``finite`` or not."""
    vec3 = vec3_of(real)
    Field, corner = make_corner(dtype, real)
    layered = make_layered(real)
    mix = make_mix(real, finite)

    @wp.func
    def value(field: Field, p: vec3):
        if not wp.static(finite):
            p = layered(field.last, p)
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
        c00 = mix(c000, corner(field, i1, j, k), x)
        c10 = mix(c010, corner(field, i1, j1, k), x)
        c01 = mix(c001, corner(field, i1, j, k1), x)
        c11 = mix(c011, corner(field, i1, j1, k1), x)
        return mix(mix(c00, c10, y), mix(c01, c11, y), z)

    return value


@cache
def make_differences(dtype, real, kind, finite=True):
    """``differences(field, p)`` -> vec3, the gradient at index coordinates ``p``, in samples, all ``finite`` or not.

    ``kind`` "central": differences of the trilinear field over a voxel to each side, which are those of the samples,
    interpolated; at the box's faces they are one-sided. "cell": the field's own derivatives, which jump at cell faces.
    """
    vec3 = vec3_of(real)
    Field, corner = make_corner(dtype, real)
    central = kind == "central"
    layered = make_layered(real)
    mix = make_mix(real, finite)

    @wp.func
    def bilinear(a: real, b: real, c: real, d: real, u: real, v: real):
        return mix(mix(a, b, u), mix(c, d, u), v)

    @wp.func
    def slope(before: real, low: real, high: real, after: real, u: real, below: int, above: int):
        """Between differences of the samples at both ends of a cell, which reach so many samples away."""
        first = (high - before) / real(1 + below)
        last = (after - low) / real(1 + above)
        return mix(first, last, u)

    @wp.func
    def differences(field: Field, p: vec3):
        if not wp.static(finite):
            p = layered(field.last, p)
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
