"""Looking up a two-dimensional table of segments by the scalars at their ends."""

from functools import cache

import warp as wp

from ..precision import vec4_of


@cache
def make_bilinear(real):
    """The struct of a 2D table, ``place(table, front, back)`` -> entry and fractions, and
    ``between(entries, i, j, x, y)`` -> vec4 of any of its arrays, bilinear between entries.
    """
    vec4 = vec4_of(real)

    @wp.struct
    class Table:
        rgba: wp.array2d(dtype=vec4)  # [front, back]; of several lengths one behind the other along the first axis
        front: wp.array2d(dtype=vec4)  # lit: diffuse colour and white specular light, weighted towards the front
        back: wp.array2d(dtype=vec4)
        low: real  # scalar of entry 0
        scale: real  # entries per scalar

    @wp.func
    def place(table: Table, front: real, back: real):
        last = real(table.rgba.shape[1] - 1)
        u = wp.clamp((front - table.low) * table.scale, real(0.0), last)
        v = wp.clamp((back - table.low) * table.scale, real(0.0), last)
        i = wp.max(wp.min(int(u), table.rgba.shape[1] - 2), 0)
        j = wp.max(wp.min(int(v), table.rgba.shape[1] - 2), 0)
        return i, j, u - real(i), v - real(j)

    @wp.func
    def between(entries: wp.array2d(dtype=vec4), i: int, j: int, x: real, y: real):
        e00 = entries[i, j]
        e10 = entries[i + 1, j]
        e0 = e00 + y * (entries[i, j + 1] - e00)
        e1 = e10 + y * (entries[i + 1, j + 1] - e10)
        return e0 + x * (e1 - e0)

    return Table, place, between


@cache
def make_table(real):
    """The struct of a 2D table and ``lookup(table, front, back)`` -> vec4."""
    Table, place, between = make_bilinear(real)

    @wp.func
    def lookup(table: Table, front: real, back: real):
        i, j, x, y = place(table, front, back)
        return between(table.rgba, i, j, x, y)

    return Table, lookup
