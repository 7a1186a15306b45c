"""A cell of one ray by a row of the transfer function, as ``single`` has many: what is measured, and within what bound.

In functions with returns, instead of what is assigned in branches: compilers for GPUs would keep registers for what is
not there. The numbers S1 to S9 are those of docs/proof-single.md.
"""

from functools import cache

import warp as wp

from ..field.blocks import Blocks, kind_at
from ..field.narrow import Narrow
from ..transfer.rows import Rows, bin, knot, number
from .single import DEEPEST, DEPTH_ULPS, OFFSET_ULPS, SERIES_ULPS, SIGN_ULPS, WIDEST, Measured, moments


@cache
def make_rowed():
    """``by_rows(rows, blocks, spend, cell, c)`` -> ``Measured`` of a ``Narrow``, and its row."""
    real = wp.float32

    @wp.func
    def by_row(rows: Rows, r: int, spend: wp.vec3, c: Narrow, sure: bool):
        """What a row says of a cell; ``sure`` where it is known to hold all that is seen."""
        m1 = c.m1
        m2 = c.m2
        m3 = c.m3
        h = c.h
        R = wp.abs(m1) + wp.abs(m2) * real(wp.static(2.0 / 3.0)) + wp.abs(m3)
        t0 = number(rows, r, 2)
        t1 = number(rows, r, 3)
        t2 = number(rows, r, 4)
        off = (c.base - number(rows, r, 0)) + c.mean
        delta = c.blur + wp.abs(off) * real(wp.static(OFFSET_ULPS))
        # The series.
        ww, vw, vww, wwW = moments(m1, m2, m3)
        L = h + h
        x = wp.max(L * (t0 + off * (t1 + off * t2) + t2 * (real(0.5) * ww)), real(0.0))
        a = real(0.5) * x
        g = h * (t1 + real(2.0) * off * t2)
        ea = wp.exp(-a)
        # Behind the series (S5, S6), where nothing overflows (S9).
        G = wp.abs(g) * R
        Q = h * wp.abs(t2) * (R * R)
        P = G + Q
        # A width below 0 says that the row holds nothing.
        good = (sure and number(rows, r, 1) >= real(0.0)) or wp.abs(off) + (R + delta) <= number(rows, r, 1)
        good = good and R < real(WIDEST) and a < real(DEEPEST)
        aa = a * a
        more = real(wp.static(1.0 / 5040.0)) + aa * real(wp.static(1.0 / 362880.0))
        more = real(wp.static(1.0 / 6.0)) + aa * (real(wp.static(1.0 / 120.0)) + aa * more)
        thin = x * ea * (aa * more)
        A = wp.where(x < real(2.0), x * ea + thin, real(1.0) - ea * ea)
        rest = wp.where(x < real(2.0), thin, A - x * ea)
        straight = t2 == real(0.0) and G <= a * real(wp.static(1.0 + SIGN_ULPS))
        bent = Q * (real(3.3) + real(2.0) * (a + P)) + real(1.65) * (a + P) * (a + P) * (a + P)
        rest = wp.where(straight, rest, bent)
        good = good and (straight or P < real(0.5))
        # All that the cell is off by (S7, S8).
        size = wp.abs(t0) + wp.abs(off) * (wp.abs(t1) + wp.abs(off * t2)) + wp.abs(t2) * (R * R)
        rate = wp.abs(t1) + real(2.0) * (wp.abs(off) + R) * wp.abs(t2)
        steep = number(rows, r, 7)
        result = Measured()
        result.x = x
        result.A = A
        result.V = ea * (g * (ww + g * wwW - a * vww) - a * a * vw)
        result.off = off
        result.e = real(1.00001) * (
            spend[2] * L * (number(rows, r, 5) + rate * delta + real(wp.static(DEPTH_ULPS)) * size)
            + A * (number(rows, r, 6) + steep * delta)
            + steep * R * (rest + real(wp.static(SERIES_ULPS)) * (h * rate * R + a))
        )
        result.e = wp.where(good, result.e, real(wp.inf))
        result.fine = good and result.e <= spend[0] * A + spend[1] * L
        return result

    @wp.func
    def first_row(rows: Rows, c: Narrow, s: real, R: real):
        """The interval of the middle, or where that ends too early a fitted row, which hold all that is seen (S4)."""
        q = wp.clamp((s - rows.low) * rows.scale, real(0.0), real(rows.bins.shape[0] - 1))
        r = bin(rows, int(q))
        off = (c.base - number(rows, r, 0)) + c.mean
        delta = c.blur + wp.abs(off) * real(wp.static(OFFSET_ULPS))
        if wp.abs(off) + (R + delta) <= number(rows, r, 1):
            return r
        level = int(0)
        reach = (R + c.blur) * rows.least
        while level < rows.levels and reach > real(1.0):
            reach *= real(0.5)
            level += 1
        at = wp.clamp((s - rows.low) * rows.fine, real(0.0), real((1 << rows.levels) - 1))
        return rows.fitted + ((2 << rows.levels) - ((2 << rows.levels) >> level)) + (int(at) >> level)

    @wp.func
    def sure_row(rows: Rows, blocks: Blocks, cell: wp.vec3i, c: Narrow, r: int):
        """The interval of a block in one, or of a cell of equal corners, which all that is seen is in; else -1."""
        kind = kind_at(blocks, cell)
        if kind >= 0 or c.blur != real(0.0):
            return wp.max(kind, -1)
        k = wp.where(r < rows.fitted, r, 0)
        while k > 0 and wp.float64(c.base) < knot(rows, k):
            k -= 1
        while k < rows.fitted - 1 and wp.float64(c.base) >= knot(rows, k + 1):
            k += 1
        return k

    @wp.func
    def by_rows(rows: Rows, blocks: Blocks, spend: wp.vec3, cell: wp.vec3i, c: Narrow):
        """A cell by the row that suits it, and which that is."""
        R = wp.abs(c.m1) + wp.abs(c.m2) * real(wp.static(2.0 / 3.0)) + wp.abs(c.m3)
        s = c.base + c.mean
        none = Measured()
        if c.h <= real(0.0):
            none.fine = True
            return none, 0
        if not (s - s == real(0.0) and R - R == real(0.0)):
            none.e = real(wp.inf)
            return none, 0
        r = first_row(rows, c, s, R)
        best = by_row(rows, r, spend, c, False)
        if best.fine:
            return best, r
        other = sure_row(rows, blocks, cell, c, r)
        if other < 0 or other == r:
            return best, r
        return by_row(rows, other, spend, c, True), other

    return by_rows
