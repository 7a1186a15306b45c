"""A cell in single precision, and a bound on what it is off by: the numbers S1 to S9 are those of docs/proof-single.md.

The scalar along the piece of ray in the cell is ``s(v) = center + off + w(v)``, v in [-1, 1] over its length L, with
``w = m1 v + m2 (v^2 - 1/3) + m3 v^3``, |w| <= R, of mean zero. A row has extinction ``t0 + t1 q + t2 q^2`` and a linear
colour at q from its center, and how far they are from those of the transfer function in its window. Of such a row the
optical depth is exactly ``x = L (t0 + off (t1 + off t2) + t2 int w^2 / 2)``, and colour is that of the mean times the
opacity and V times its slope, as in ``series``. All rounding is that of another scalar at most ``delta`` away, of
another depth, or of V.

``packet`` says the same in vectors; these are for whoever reads, and for what has none.
"""

from functools import cache

import warp as wp

from ..field.blocks import Blocks
from ..field.strides import Rays
from ..transfer.rows import Rows, bin

# Cells that are measured at a time, and composed at a time.
CELLS = 64
LANES = 16
# A cell may have so much of what its ray has left, as long as all that are composed at a time have no more than that.
LEFT = 1 / 4
# Rounding, in parts of what is rounded: of the scalar from a row's center (S3), of an extinction that is nowhere
# negative (S5), of depth (S7) and of V (S8).
U = 2.0**-24
OFFSET_ULPS = 6 * U
SIGN_ULPS = 16 * U
DEPTH_ULPS = 32 * U
SERIES_ULPS = 32 * U
# What is larger is left to double precision (S9).
WIDEST = 1e12
DEEPEST = 1e4


@wp.func
def moments(m1: wp.float32, m2: wp.float32, m3: wp.float32):
    """Integrals of w^2, v w, v w^2 and w^2 W over v from -1 to 1: w is m1 v + m2 v^2 + m3 v^3 less its mean, W what is
    left of it from v on.
    """
    ww = (
        m1 * (m1 * wp.float32(wp.static(2.0 / 3.0)) + m3 * wp.float32(0.8))
        + m2 * m2 * wp.float32(wp.static(8.0 / 45.0))
        + m3 * m3 * wp.float32(wp.static(2.0 / 7.0))
    )
    vw = m1 * wp.float32(wp.static(2.0 / 3.0)) + m3 * wp.float32(0.4)
    vww = m2 * (m1 * wp.float32(wp.static(16.0 / 45.0)) + m3 * wp.float32(wp.static(32.0 / 105.0)))
    wwW = (
        m1 * m1 * (m1 * wp.float32(wp.static(2.0 / 15.0)) + m3 * wp.float32(wp.static(22.0 / 105.0)))
        + m2 * m2 * (m1 * wp.float32(wp.static(8.0 / 135.0)) + m3 * wp.float32(wp.static(8.0 / 189.0)))
        + m3 * m3 * (m1 * wp.float32(wp.static(38.0 / 315.0)) + m3 * wp.float32(wp.static(2.0 / 77.0)))
    )
    return ww, vw, vww, wwW


@wp.struct
class Measured:
    """A cell by one row: depth, opacity, V, the mean from the row's center, the bound, and whether that will do."""

    x: wp.float32
    A: wp.float32
    V: wp.float32
    off: wp.float32
    e: wp.float32
    fine: bool


@cache
def make_single():
    """``measure(rows, blocks, spend, cells, some, cubic, found, row)`` of cells as ``field.cubics`` has them, ``some``
    being the first and how many; and ``compose(rows, rays, times, found, row, spend, astray, which)`` -> how many cells
    are left to others.

    ``spend`` is what a cell may be off by, in parts of its opacity and of its length, and the brightest colour.
    ``found`` has depth, opacity, V, off and the bound of each cell, infinite where no row will do; ``row`` its row, or
    ``-2 - row`` for one that exceeds its share, and -1 for one that others put there: its colour is in place of V and
    off, and in the last row. ``compose`` puts the next cells of all rays behind what there is, ``LANES`` at a time, as
    long as transparency is what the ray is to be ``clear`` by, up to the first lanes with a cell for which a ``LEFT``
    of what the ray has left of its shares is not enough, or a sixteenth of it where all those together are more than
    it has, or any that exceeds its own where the rays are ``astray``.
    Those are left to others: ``which`` (2, n) has how many and which they are, and behind that their rays.
    """
    real = wp.float32

    @wp.func
    def by_row(rows: Rows, r: int, spend: wp.vec3, cubic: wp.array2d(dtype=real), l: int, sure: bool):
        """What a row says of cell l; ``sure`` where it is known to hold all that is seen."""
        m1 = cubic[2, l]
        m2 = cubic[3, l]
        m3 = cubic[4, l]
        h = cubic[5, l]
        R = wp.abs(m1) + wp.abs(m2) * real(wp.static(2.0 / 3.0)) + wp.abs(m3)
        t0 = rows.row[r, 2]
        t1 = rows.row[r, 3]
        t2 = rows.row[r, 4]
        off = (cubic[0, l] - rows.row[r, 0]) + cubic[1, l]
        delta = cubic[6, l] + wp.abs(off) * real(wp.static(OFFSET_ULPS))
        # The series.
        ww, vw, vww, wwW = moments(m1, m2, m3)
        L = h + h
        x = wp.max(L * (t0 + off * (t1 + off * t2) + t2 * (real(0.5) * ww)), real(0.0))
        a = real(0.5) * x
        g = h * (t1 + real(2.0) * off * t2)
        ea = wp.exp(-a)
        A = wp.where(x < real(2.0), real(2.0) * ea * wp.sinh(a), real(1.0) - ea * ea)
        # Behind the series (S5, S6), where nothing overflows (S9).
        G = wp.abs(g) * R
        Q = h * wp.abs(t2) * (R * R)
        P = G + Q
        # A width below 0 says that the row holds nothing.
        good = (sure and rows.row[r, 1] >= real(0.0)) or wp.abs(off) + (R + delta) <= rows.row[r, 1]
        good = good and R < real(WIDEST) and a < real(DEEPEST)
        rest = A - x * ea
        if x < real(2.0):
            aa = a * a
            more = (
                real(wp.static(1.0 / 120.0))
                + aa * real(wp.static(1.0 / 5040.0))
                + aa * aa * real(wp.static(1.0 / 362880.0))
            )
            rest = x * ea * aa * (real(wp.static(1.0 / 6.0)) + aa * more)
        if t2 != real(0.0) or G > a * real(wp.static(1.0 + SIGN_ULPS)):
            good = good and P < real(0.5)
            rest = Q * (real(3.3) + real(2.0) * (a + P)) + real(1.65) * (a + P) * (a + P) * (a + P)
        # All that the cell is off by (S7, S8).
        size = wp.abs(t0) + wp.abs(off) * (wp.abs(t1) + wp.abs(off * t2)) + wp.abs(t2) * (R * R)
        rate = wp.abs(t1) + real(2.0) * (wp.abs(off) + R) * wp.abs(t2)
        steep = rows.row[r, 7]
        result = Measured()
        result.x = x
        result.A = A
        result.V = ea * (g * (ww + g * wwW - a * vww) - a * a * vw)
        result.off = off
        result.e = real(1.00001) * (
            spend[2] * L * (rows.row[r, 5] + rate * delta + real(wp.static(DEPTH_ULPS)) * size)
            + A * (rows.row[r, 6] + steep * delta)
            + steep * R * (rest + real(wp.static(SERIES_ULPS)) * (h * rate * R + a))
        )
        if not good:
            result.e = real(wp.inf)
        result.fine = good and result.e <= spend[0] * A + spend[1] * L
        return result

    @wp.func
    def measure(
        rows: Rows,
        blocks: Blocks,
        spend: wp.vec3,
        cells: wp.array(dtype=wp.uint64),
        some: wp.vec2i,
        cubic: wp.array2d(dtype=real),
        found: wp.array2d(dtype=real),
        row: wp.array(dtype=int),
    ):
        first = some[0]
        last = (some[1] + 15) & ~15
        for l in range(last):
            R = wp.abs(cubic[2, l]) + wp.abs(cubic[3, l]) * real(wp.static(2.0 / 3.0)) + wp.abs(cubic[4, l])
            s = cubic[0, l] + cubic[1, l]
            # The interval of the middle, and where that ends too early a fitted row, which hold all that is seen (S4).
            r = int(0)
            best = Measured()
            best.e = real(wp.inf)
            if cubic[5, l] <= real(0.0):
                best = Measured()
                best.fine = True
            elif s - s == real(0.0) and R - R == real(0.0):
                q = wp.clamp((s - rows.low) * rows.scale, real(0.0), real(rows.bins.shape[0] - 1))
                r = bin(rows, int(q))
                off = (cubic[0, l] - rows.row[r, 0]) + cubic[1, l]
                delta = cubic[6, l] + wp.abs(off) * real(wp.static(OFFSET_ULPS))
                if wp.abs(off) + (R + delta) > rows.row[r, 1]:
                    level = int(0)
                    reach = (R + cubic[6, l]) * rows.least
                    while level < rows.levels and reach > real(1.0):
                        reach *= real(0.5)
                        level += 1
                    at = wp.clamp((s - rows.low) * rows.fine, real(0.0), real((1 << rows.levels) - 1))
                    r = rows.fitted + ((2 << rows.levels) - ((2 << rows.levels) >> level)) + (int(at) >> level)
                best = by_row(rows, r, spend, cubic, l, False)
                # Of a block in one interval, or a cell of equal corners, all that is seen is in it.
                place = cells[first + l]
                k = int(place >> wp.uint64(44))
                j = int((place >> wp.uint64(23)) & wp.uint64(0x7FFFF))
                i = int((place >> wp.uint64(2)) & wp.uint64(0x7FFFF))
                kind = int(blocks.kinds[k, j, i])
                if kind < 0 and cubic[6, l] == real(0.0):
                    kind = int(0)
                    while kind < rows.fitted - 1 and wp.float64(cubic[0, l]) >= rows.knots[kind + 1]:
                        kind += 1
                if not best.fine and kind >= 0 and kind != r:
                    r = kind
                    best = by_row(rows, r, spend, cubic, l, True)
            row[first + l] = wp.where(best.fine, r, -2 - r)
            found[0, first + l] = best.x
            found[1, first + l] = best.A
            found[2, first + l] = best.V
            found[3, first + l] = best.off
            found[4, first + l] = best.e

    @wp.func
    def share_of(spend: wp.vec3, found: wp.array2d(dtype=real), times: wp.array2d(dtype=wp.float64), l: int):
        return spend[0] * found[1, l] + spend[1] * real(times[1, l] - times[0, l])

    @wp.func
    def compose(
        rows: Rows,
        rays: Rays,
        times: wp.array2d(dtype=wp.float64),
        found: wp.array2d(dtype=wp.float32),
        row: wp.array(dtype=int),
        spend: wp.vec3,
        astray: bool,
        which: wp.array2d(dtype=int),
    ):
        one = wp.float64(1.0)
        listed = int(0)
        for ray in range(rays.going.shape[0]):
            at = rays.first[ray]
            clear = rays.lines[ray, 8]
            waits = bool(False)
            while at < rays.last[ray] and not waits and one - rays.sums[ray, 3] >= clear:
                stop = wp.min(at + LANES, rays.last[ray])
                front = one - rays.sums[ray, 3]
                left = rays.lines[ray, 9] + wp.float64(spend[0]) * rays.sums[ray, 3]
                left += wp.float64(spend[1]) * (times[0, at] - rays.lines[ray, 6]) - rays.sums[ray, 4]
                left = wp.float64(0.999) * left / front
                most = real(wp.static(LEFT)) * real(left)
                together = real(0.0)
                for l in range(at, stop):
                    over = found[4, l] - share_of(spend, found, times, l)
                    if row[l] < -1 and over <= most:
                        together += wp.max(over, real(0.0))
                if together > real(left):
                    most = real(wp.static(1.0 / LANES)) * real(left)
                for l in range(at, stop):
                    if row[l] < -1:
                        if found[4, l] - share_of(spend, found, times, l) <= most and not astray:
                            row[l] = -2 - row[l]
                        else:
                            waits = True
                            listed += 1
                            which[0, listed] = l
                            which[1, listed] = ray
                if not waits:
                    depth = real(0.0)
                    for l in range(at, stop):
                        T = front * wp.float64(wp.exp(-depth))
                        TA = T * wp.float64(found[1, l])
                        TV = T * wp.float64(found[2, l]) + TA * wp.float64(found[3, l])
                        r = row[l]
                        for c in range(3):
                            color = T * wp.float64(found[wp.where(c < 2, c + 2, 5), l])
                            if r >= 0:
                                color = TA * wp.float64(rows.row[r, 8 + c]) + TV * wp.float64(rows.row[r, 12 + c])
                            rays.sums[ray, c] = rays.sums[ray, c] + color
                        rays.sums[ray, 3] = rays.sums[ray, 3] + TA
                        rays.sums[ray, 4] = rays.sums[ray, 4] + T * wp.float64(found[4, l]) * wp.float64(1.00001)
                        depth += found[0, l]
                    at = stop
            rays.count[ray] = rays.count[ray] + at - rays.first[ray]
            rays.first[ray] = at
            if one - rays.sums[ray, 3] < clear and (at < rays.last[ray] or rays.going[ray] != 0):
                rays.going[ray] = 2
        which[0, 0] = listed
        return listed

    return measure, compose
