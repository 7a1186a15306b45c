"""A cell in which the scalar reaches control points, of one ray, in single precision: as ``crossings`` has sixteen.

How far control points are from its middle comes from double precision; all else is single, with what that may be off
by. Letters and numbers are those of docs/proof-single.md (S13, S14, S17, S22, S23).
"""

from functools import cache

import warp as wp

from ..light.glow import Surface, Thin, make_glow
from ..transfer.function import make_transfer
from ..transfer.rows import Rows, bin, jump, knot, number
from .crossings import ADDED, OPACITY_ULPS, ROUNDED
from .single import SERIES_ULPS, U, moments

# Rounding of a scalar on a part, of how it is evaluated and of where it turns, in parts of its coefficients; of a
# piece's extinction, and of where it ends, in parts of the cell's length.
RIPPLE = 64 * U
LINE_ULPS = 8 * U
ENDS_ULPS = 4 * U
# Pieces of a cell, of which one more is left to others, and steps of Newton's method.
PIECES = 32
STEPS = 8


@wp.struct
class Cut:
    """What a cell comes to: depth, opacity, colour, what it may be off by, its pieces, and whether nothing is missing;
    and where a piece begins.
    """

    x: wp.float32
    A: wp.float32
    color: wp.vec3
    e: wp.float32
    pieces: int
    whole: int
    v: wp.float32
    to: wp.float32  # the part that rises or falls ends there,
    final: wp.float32  # with that scalar
    rises: int
    k: int  # interval
    room: wp.float32  # so far it may go at once
    before: wp.float32  # how far the scalar is off the control point where it begins
    stop: wp.float32  # where it ends
    astray: wp.float32  # how far the scalar may be beyond the interval
    ripple: wp.float32  # rounding of the scalar
    going: int


@wp.struct
class Added:
    """What a piece adds: colour and opacity, depth, what it may be off by, and whether the series holds for it."""

    color: wp.vec3
    A: wp.float32
    x: wp.float32
    e: wp.float32
    good: int


@cache
def make_thin():
    """``thin(m1, m2, m3, R, x, g)`` -> (A, V, rest) of a straight piece: opacity, V, and what the series leaves out at
    most, in parts of the slope of colour, by the better of theorems 2 and 3.
    """
    real = wp.float32

    @wp.func
    def thin(m1: real, m2: real, m3: real, R: real, x: real, g: real):
        ww, vw, vww, wwW = moments(m1, m2, m3)
        a = real(0.5) * x
        aa = a * a
        ea = wp.exp(-a)
        more = real(wp.static(1.0 / 5040.0)) + aa * real(wp.static(1.0 / 362880.0))
        more = real(wp.static(1.0 / 6.0)) + aa * (real(wp.static(1.0 / 120.0)) + aa * more)
        rest = x * ea * (aa * more)
        A = wp.where(x < real(2.0), x * ea + rest, real(1.0) - ea * ea)
        rest = wp.where(x < real(2.0), rest, A - x * ea)
        V = ea * (g * (ww + g * wwW - a * vww) - aa * vw)
        G = wp.abs(g) * R
        closer = R * G * (a * (a + G) + G * G) * real(0.33334)
        closer += aa * a * (real(0.0889) * wp.abs(m2) + real(0.08334) * R * a)
        return A, V, wp.min(R * rest, closer) + real(wp.static(SERIES_ULPS)) * R * (G + a)

    return thin


@cache
def make_parts(sharp=False, lighted=False, clipped=False):
    """``cut(rows, transfer, spend, m0, m, h, blur, surface)`` -> ``Cut`` of the cubic about the middle,
    m0 + m[0] v + m[1] v^2 + m[2] v^3, of half a length h and rounded by ``blur``; of transfer functions that are
    ``sharp`` or not, of rays that are ``lighted``, with a ``Surface``, and that clips cut or not.
    """
    real = wp.float32
    Transfer, _, _ = make_transfer(wp.float64)
    thin = make_thin()
    glow = make_glow(clipped).glow

    @wp.func
    def interval_of(rows: Rows, s: wp.float64):
        last = real(rows.bins.shape[0] - 1)
        k = bin(rows, int(wp.clamp((real(s) - rows.low) * rows.scale, real(0.0), last)))
        while k > 0 and s < knot(rows, k):
            k -= 1
        while k < rows.fitted - 1 and s >= knot(rows, k + 1):
            k += 1
        return k

    @wp.func
    def root(m: wp.vec3, target: real, start: real, end: real, rises: bool, close: real):
        """Where w, which rises or falls from start to end, is the target, and how far it is off there."""
        low = start
        high = end
        wl = start * (m[0] + start * (m[1] + start * m[2]))
        wh = end * (m[0] + end * (m[1] + end * m[2]))
        v = wp.clamp(start + (end - start) * ((target - wl) / (wh - wl)), start, end)
        off = real(0.0)
        for _ in range(STEPS):
            off = v * (m[0] + v * (m[1] + v * m[2])) - target
            if wp.abs(off) <= close:
                break
            if (off > real(0.0)) == rises:
                high = v
            else:
                low = v
            slope = m[0] + v * (real(2.0) * m[1] + v * (real(3.0) * m[2]))
            tried = v - off / slope
            # False for NaN.
            inside = tried >= low and tried <= high
            v = wp.where(inside, tried, real(0.5) * (low + high))
        off = v * (m[0] + v * (m[1] + v * m[2])) - target
        return v, wp.abs(off)

    @wp.func
    def turns(m: wp.vec3):
        """Where w turns in (-1, 1), in order; 1 in place of those that are not there."""
        one = real(1.0)
        square = m[1] * m[1] - real(3.0) * m[2] * m[0]
        if wp.abs(m[0]) > real(2.0) * wp.abs(m[1]) + real(3.0) * wp.abs(m[2]) or not square > real(0.0):
            return one, one
        q = -(m[1] + wp.where(m[1] < real(0.0), -wp.sqrt(square), wp.sqrt(square)))
        # Infinite or no numbers where they are not chosen.
        first = wp.where(wp.abs(m[0]) < wp.abs(q), m[0] / q, one)
        second = wp.where(wp.abs(q) < real(3.0) * wp.abs(m[2]), q / (real(3.0) * m[2]), one)
        return wp.min(first, second), wp.max(first, second)

    @wp.func
    def beyond(rows: Rows, k: int):
        """What extinction and colour of an interval are off by where it is drawn a unit too far."""
        if wp.static(sharp):
            return jump(rows, k, 0), jump(rows, k, 1)
        return number(rows, k, 11), number(rows, k, 15)

    @wp.func
    def near(m: wp.vec3, v: real, e: real):
        """Length about v in which w is within e of what it is there, on a part that rises or falls (S22)."""
        slope = wp.abs(m[0] + v * (real(2.0) * m[1] + v * (real(3.0) * m[2])))
        bend = real(2.0) * wp.abs(m[1]) + real(6.0) * wp.abs(m[2])
        if slope * slope > real(2.0) * bend * e:
            times = wp.where(slope * slope > real(32.0) * bend * e, real(2.2), real(4.5))
            return wp.min(times * e / slope, real(2.0))
        least = real(2.0) * wp.abs(m[1]) - real(6.0) * wp.abs(m[2])
        reach = real(2.0)
        if least > real(0.0):
            reach = wp.min(reach, real(4.5) * wp.sqrt(e / least))
        if m[2] != real(0.0):
            reach = wp.min(reach, real(4.5) * wp.cbrt(real(0.5) * e / wp.abs(m[2])))
        return reach

    @wp.func
    def leapt(rows: Rows, spend: wp.vec3, k: int, upper: bool):
        """What the jump at an end of interval k is, a unit of length."""
        n = wp.where(upper, 4, 2)
        return spend[2] * jump(rows, k, n) + jump(rows, k, n + 1)

    @wp.func
    def fuzzy(rows: Rows, spend: wp.vec3, m0: wp.float64, m: wp.vec3, v: real, c: Cut):
        """What jumps may do where a part begins or ends next to one, a unit of half the length."""
        total = real(0.0)
        value = v * (m[0] + v * (m[1] + v * m[2]))
        for side in range(2):
            size = leapt(rows, spend, c.k, side == 1)
            if size > real(0.0):
                away = real(knot(rows, c.k + side) - m0) - value
                if wp.abs(away) <= real(2.0) * c.ripple:
                    total += size * near(m, v, real(4.0) * c.ripple)
        return total

    @wp.func
    def piece(
        rows: Rows, transfer: Transfer, spend: wp.vec3, m0: wp.float64, m: wp.vec3, h: real, c: Cut, surface: Surface
    ):
        """From where ``c`` is to where it stops, in its interval."""
        zero = real(0.0)
        k = c.k
        outer = rows.fitted - 1
        ripple = c.ripple
        w = real(0.5) * (c.stop - c.v)
        mid = real(0.5) * (c.stop + c.v)
        wide = real(2.0) * w * h
        bend = m[1] + real(3.0) * mid * m[2]
        n1 = w * (m[0] + mid * (m[1] + bend))
        n2 = w * w * bend
        n3 = w * w * w * m[2]
        mean = mid * (m[0] + mid * (m[1] + mid * m[2])) + n2 * real(wp.static(1.0 / 3.0))
        R = wp.abs(n1) + wp.abs(n2) * real(wp.static(2.0 / 3.0)) + wp.abs(n3)
        # Extinction from the end of the interval that has less of it, next to which it has no ulps.
        rate = real(transfer.slope[k][3])
        next = wp.min(k + 1, outer)
        at = wp.where(transfer.value[next][3] < transfer.value[k][3], next, k)
        inner = k > 0 and k < outer
        from_knot = wp.where(inner, mean - real(knot(rows, at) - m0), zero)
        least = real(transfer.value[wp.where(inner, at, k)][3])
        line = least + from_knot * rate
        x = wp.max(wide * line, zero)
        A, V, rest = thin(n1, n2, n3, R, x, w * h * rate)
        from_center = real(m0 - wp.float64(number(rows, k, 0)))
        off = mean + from_center
        steep = number(rows, k, 7)
        rest = steep * rest
        blur = ripple + (wp.abs(off) + wp.abs(from_center) + R) * real(wp.static(ROUNDED))
        # What it is off by, of where it is cut, of its ends, and the series.
        fade, tint = beyond(rows, k)
        over = c.astray * fade
        d = wp.where(line < zero, over + over, over) + wp.abs(rate) * ripple
        d += real(wp.static(LINE_ULPS)) * (least + wp.abs(from_knot * rate))
        e = (spend[2] + real(3.3) * steep * R) * wide * d
        e += (least + wp.abs(rate) * (wp.abs(from_knot) + R)) * h * real(wp.static(ENDS_ULPS)) * spend[2]
        e += A * (number(rows, k, 6) + steep * blur + c.astray * tint)
        e += A * real(wp.static(OPACITY_ULPS)) * spend[2]
        result = Added()
        result.x = x
        result.A = A
        result.e = e + rest
        slope = wp.vec3(number(rows, k, 12), number(rows, k, 13), number(rows, k, 14))
        color = wp.vec3(number(rows, k, 8), number(rows, k, 9), number(rows, k, 10)) + off * slope
        result.color = A * color + V * slope
        if wp.static(lighted):
            if A > zero:
                lit = Thin(x, A, V, w * h * rate, wp.vec3(n1, n2, n3), mid, w)
                result.color = glow(surface, lit, color, slope)
        good = rest + A * number(rows, k, 6) <= real(0.5) * (spend[0] * A + spend[1] * wide) + real(1.0e-11)
        result.good = wp.where(good and wide * d < real(0.25), 1, 0)
        return result

    @wp.func
    def cut(
        rows: Rows, transfer: Transfer, spend: wp.vec3, m0: wp.float64, m: wp.vec3, h: real, blur: real, given: Surface
    ):
        one = real(1.0)
        zero = real(0.0)
        size = wp.abs(m[0]) + wp.abs(m[1]) + wp.abs(m[2])
        ripple = real(wp.static(RIPPLE)) * size + blur
        first, second = turns(m)
        outer = rows.fitted - 1
        value = -m[0] + m[1] - m[2]
        c = Cut()
        c.v = -one
        c.k = interval_of(rows, m0 + wp.float64(value))
        c.to = first
        c.final = first * (m[0] + first * (m[1] + first * m[2]))
        c.rises = wp.where(c.final > value, 1, 0)
        c.room = real(2.0)
        c.ripple = ripple
        if wp.static(sharp):
            c.e = h * fuzzy(rows, spend, m0, m, -one, c)
        steps = int(0)
        # False for NaN.
        c.going = wp.where(size < real(1.0e12) and real(2.0) * ripple <= rows.narrow, 1, 0)
        while c.going != 0 and steps < PIECES:
            steps += 1
            rises = c.rises != 0
            # To the control point at the end of the interval, or where the part ends.
            target = real(knot(rows, wp.clamp(wp.where(rises, c.k + 1, c.k), 0, outer)) - m0)
            crosses = wp.where(rises, c.k < outer and target < c.final, c.k > 0 and target > c.final)
            stop, behind = root(m, wp.where(crosses, target, c.final), c.v, c.to, rises, real(wp.static(2 * U)) * size)
            stop = wp.where(crosses, stop, c.to)
            behind = wp.where(crosses, behind, zero)
            ends = c.v + c.room >= stop
            c.stop = wp.where(ends, stop, c.v + c.room)
            behind = wp.where(ends, behind, zero)
            c.astray = wp.max(c.before, behind) + ripple
            T = one - c.A
            # Beyond intervals that are next nothing is known (S13, S22); false for NaN.
            good = real(2.0) * c.astray <= rows.narrow
            if not good:
                steps = int(wp.static(PIECES))
            elif c.stop > c.v:
                if transfer.visible[c.k] == c.k:
                    surface = given
                    if wp.static(lighted):
                        surface.T = T * given.T
                    added = piece(rows, transfer, spend, m0, m, h, c, surface)
                    good = added.good != 0
                    if good:
                        c.color = c.color + T * added.color
                        c.e = c.e + T * added.e
                        c.A = c.A + T * added.A
                        c.x = c.x + added.x
                        c.pieces = c.pieces + 1
                else:
                    # The scalar may be a little on the other side.
                    fade, _tint = beyond(rows, c.k)
                    c.e = c.e + T * spend[2] * ((c.stop - c.v) * h) * c.astray * fade
            if not good:
                c.room = real(0.5) * (c.stop - c.v)
            else:
                c.v = c.stop
                # Behind a shorter step it may still be where it was.
                c.before = wp.where(ends, behind, c.before)
                c.room = real(2.0)
                if ends:
                    if wp.static(sharp):
                        if crosses:
                            size = leapt(rows, spend, c.k, rises)
                            if size > zero:
                                c.e = c.e + h * size * near(m, c.stop, ripple + behind)
                        else:
                            c.e = c.e + h * fuzzy(rows, spend, m0, m, c.stop, c)
                    if crosses:
                        c.k = c.k + wp.where(rises, 1, -1)
                        if wp.static(sharp):
                            # Jumps have no length.
                            while jump(rows, c.k, 0) < zero:
                                c.k = c.k + wp.where(rises, 1, -1)
                    elif c.to < one:
                        # On to the next part.
                        value = c.final
                        c.to = wp.where(c.to < second, second, one)
                        c.final = c.to * (m[0] + c.to * (m[1] + c.to * m[2]))
                        c.rises = wp.where(c.final > value, 1, 0)
                    else:
                        c.going = 0
                        c.whole = 1
        c.e = real(1.0001) * (c.e + c.A * real(wp.static(ADDED)) * spend[2])
        return c

    return cut
