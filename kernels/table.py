"""Pre-integration tables: generation and look-up.

Entry (i, j) is the segment of length ``delta`` whose scalar runs linearly from table value i to j. The transfer
function comes cut into pieces at its own knots, so the table is that of the function itself and not of a resampling.
An elementary interval [k, k + 1] is made of the pieces ``first[k] .. first[k + 1]``; in an entry with r = |j - i|
intervals each has length delta / r.

``incremental`` is the subrange integration of Lum, Wilson and Ma (2004), section 4.1: for each r the intervals are cut
in bins of r; the suffix of one bin over the prefix of the next is an entry. O(n^2) in all, and exact.
``brute`` composes the |j - i| intervals of every entry: O(n^3), the check.
"""

from functools import cache

import warp as wp

from .precision import vec4_of
from .segment import make_absorbed, make_interval, over, widened


@cache
def make_pieces(real):
    """The struct of a cut transfer function and ``elementary(pieces, k, length, reverse)`` -> vec4d."""
    vec4 = vec4_of(real)
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2
    interval = make_interval(real)

    @wp.struct
    class Pieces:
        first: wp.array(dtype=int)  # (n,) first piece of interval k; the last entry closes the last interval
        width: wp.array(dtype=real)  # share of the interval's length that the piece has
        low: wp.array(dtype=vec4)  # (r, g, b, extinction) at the piece's lower end
        high: wp.array(dtype=vec4)  # and at its upper end
        value: wp.array(dtype=vec4)  # (n,) at the table values themselves
        nodes: wp.array(dtype=vec2)

    @wp.func
    def elementary(pieces: Pieces, k: int, length: real, reverse: bool):
        segment = wp.vec4d()
        for p in range(pieces.first[k], pieces.first[k + 1]):
            d = length * pieces.width[p]
            if reverse:
                segment = over(interval(pieces.nodes, pieces.high[p], pieces.low[p], d), segment)
            else:
                segment = over(segment, interval(pieces.nodes, pieces.low[p], pieces.high[p], d))
        return segment

    return Pieces, elementary


@cache
def make_generators(real):
    """Kernels ``diagonal`` (n items), ``incremental`` (items of ``bins``) and ``brute`` (n * n items)."""
    vec4 = vec4_of(real)
    Pieces, elementary = make_pieces(real)
    absorbed, _ = make_absorbed(real)

    @wp.func
    def joined(low: wp.vec4d, high: wp.vec4d, reverse: bool):
        if reverse:
            return over(high, low)
        return over(low, high)

    @wp.func
    def rounded(segment: wp.vec4d):
        return vec4(real(segment[0]), real(segment[1]), real(segment[2]), real(segment[3]))

    @wp.func
    def fill_bin(pieces: Pieces, r: int, start: int, length: real, reverse: bool, table: wp.array2d(dtype=vec4)):
        n = table.shape[0]
        # Suffixes of the bin [start, start + r], kept in the table until their prefix is there.
        segment = wp.vec4d()
        for o in range(r - 1, -1, -1):
            i = start + o
            segment = joined(elementary(pieces, i, length, reverse), segment, reverse)
            if i + r < n:
                if reverse:
                    table[i + r, i] = rounded(segment)
                else:
                    table[i, i + r] = rounded(segment)
        # Prefixes of the next bin complete them.
        segment = wp.vec4d()
        for o in range(1, wp.min(r, n - start - r)):
            i = start + o
            segment = joined(segment, elementary(pieces, i + r - 1, length, reverse), reverse)
            if reverse:
                table[i + r, i] = rounded(joined(widened(table[i + r, i]), segment, reverse))
            else:
                table[i, i + r] = rounded(joined(widened(table[i, i + r]), segment, reverse))

    @wp.kernel(enable_backward=False, module="unique")
    def incremental(
        base: int, pieces: Pieces, bins: wp.array(dtype=wp.vec2i), delta: real, table: wp.array2d(dtype=vec4)
    ):
        item = bins[wp.tid() + base]
        r = item[0]
        fill_bin(pieces, r, item[1], delta / real(r), False, table)
        fill_bin(pieces, r, item[1], delta / real(r), True, table)

    @wp.kernel(enable_backward=False, module="unique")
    def brute(base: int, pieces: Pieces, delta: real, table: wp.array2d(dtype=vec4)):
        item = wp.tid() + base
        i = item // table.shape[1]
        j = item - i * table.shape[1]
        if i == j:
            return
        reverse = i > j
        length = delta / real(wp.abs(j - i))
        segment = wp.vec4d()
        for k in range(wp.min(i, j), wp.max(i, j)):
            segment = joined(segment, elementary(pieces, k, length, reverse), reverse)
        table[i, j] = rounded(segment)

    @wp.kernel(enable_backward=False, module="unique")
    def diagonal(base: int, pieces: Pieces, delta: real, table: wp.array2d(dtype=vec4)):
        i = wp.tid() + base
        value = pieces.value[i]
        A = absorbed(value[3] * delta)
        table[i, i] = vec4(A * value[0], A * value[1], A * value[2], A)

    return diagonal, incremental, brute


@cache
def make_table(real):
    """The struct of a 2D table and ``lookup(table, front, back)`` -> vec4, bilinear between entries."""
    vec4 = vec4_of(real)

    @wp.struct
    class Table:
        rgba: wp.array2d(dtype=vec4)  # [front, back]
        low: real  # scalar of entry 0
        scale: real  # entries per scalar

    @wp.func
    def lookup(table: Table, front: real, back: real):
        last = real(table.rgba.shape[0] - 1)
        u = wp.clamp((front - table.low) * table.scale, real(0.0), last)
        v = wp.clamp((back - table.low) * table.scale, real(0.0), last)
        i = wp.max(wp.min(int(u), table.rgba.shape[0] - 2), 0)
        j = wp.max(wp.min(int(v), table.rgba.shape[0] - 2), 0)
        x = u - real(i)
        y = v - real(j)
        e00 = table.rgba[i, j]
        e10 = table.rgba[i + 1, j]
        e0 = e00 + y * (table.rgba[i, j + 1] - e00)
        e1 = e10 + y * (table.rgba[i + 1, j + 1] - e10)
        return e0 + x * (e1 - e0)

    return Table, lookup
