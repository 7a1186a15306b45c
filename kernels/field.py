"""The scalar field: trilinear interpolation of the samples, in index coordinates, minus a constant.

The constant (``shift``, mid-range of the transfer function) is taken from floating-point samples as they are loaded,
so that data such as 1e6 +- 1 keep their range in float32; integers up to 16 bits are exact without it.
A cell with a NaN or infinite corner has no finite value, which is how absent data travel.
"""

from functools import cache

import warp as wp

from .precision import vec3_of


@cache
def make_samples(dtype):
    """The struct of a field of ``dtype`` samples."""

    @wp.struct
    class Field:
        data: wp.array3d(dtype=dtype)  # [z, y, x]
        last: wp.vec3i  # the last cell along x, y, z: two less than the samples, of which there are at least two
        shift: wp.float64  # a float32 number

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
def make_field(dtype, real):
    """The struct of a field of ``dtype`` samples, and ``value(field, p)`` -> ``real`` at index coordinates ``p``."""
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

    return Field, value
