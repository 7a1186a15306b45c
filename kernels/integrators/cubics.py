"""Pieces of ray in a cell about their middle: in one interval of the transfer function, or across several."""

from functools import cache

import warp as wp

from ..field.cell import vec5d, zero
from ..segment import over
from ..transfer.function import make_transfer
from .alone import make_lit_piece
from .lit import in_lanes
from .pieces import Piece, make_jumps, make_pieces
from .series import closer, make_series
from .shone import Cubic, make_shone


@wp.func
def from_start(c: Cubic):
    """The same as a cubic of the length from its start."""
    half = wp.float64(0.5) * c.length
    h = wp.float64(2.0) / c.length
    m = c.m
    result = Piece()
    result.start = c.middle - half * c.d
    result.d = c.d
    result.eye = c.eye
    result.length = c.length
    result.blur = c.blur
    result.T = c.T
    result.s = wp.vec4d(
        m[0] - m[1] + m[2] - m[3],
        h * (m[1] - wp.float64(2.0) * m[2] + wp.float64(3.0) * m[3]),
        h * h * (m[2] - wp.float64(3.0) * m[3]),
        h * h * h * m[3],
    )
    return result


@cache
def make_cubics(halves):
    """``linear(scene, c, k)`` -> segment of a ``Cubic`` that stays in interval k, and a bound on its colour's error;
    ``crossing(scene, c)`` -> segment of a monotone one through several intervals, a bound on its error, and the number
    of its pieces.
    """
    real = wp.float64
    Scene = halves.Scene
    _, interval, _ = make_transfer(real)
    piece, _ = make_pieces(halves)
    lanes = in_lanes(halves)
    lighted = halves.light is not None and not lanes
    shone = make_shone(halves)
    lit_piece = make_lit_piece(halves) if lanes else None
    jumps = make_jumps(halves)
    steepest, jump, fuzzy, smeared = jumps.steepest, jumps.jump, jumps.fuzzy, jumps.smeared
    sharp = halves.march.sharp
    deviation, opacity, tilt = make_series(None)

    @wp.func
    def linear(scene: Scene, given: Cubic, k: int):
        c = given
        mean = c.m[0] + real(wp.static(1.0 / 3.0)) * c.m[2]
        R = deviation(c.m[1], c.m[2], c.m[3])
        if k > 0 and k < scene.transfer.knot.shape[0] - 1:
            # It is within the interval but for rounding; and a cubic that is deviates by no more than this.
            low = scene.transfer.knot[k]
            high = scene.transfer.knot[k + 1]
            if R > real(8.0) * (high - low):
                mean = wp.clamp(mean, low, high)
                c.m = wp.vec4d(mean, real(0.0), real(0.0), real(0.0))
                R = real(0.0)
            mean = wp.clamp(mean, low, high)
        slope = scene.transfer.slope[k]
        value = scene.transfer.value[k] + (mean - scene.transfer.knot[k]) * slope
        segment = wp.vec4d()
        error = real(0.0)
        x = value[3] * c.length
        if x > real(0.0):
            A = opacity(x)
            V, off = tilt(c.m[1], c.m[2], c.m[3], R, real(0.5) * x, real(0.5) * c.length * slope[3], A)
            second = closer(c.m[2], R, real(0.5) * x, real(0.5) * c.length * slope[3])
            error = wp.where(second < off, second, off) * steepest(slope)
            good = error <= scene.march.tolerance * A
            if not good:
                error = real(0.0)
            if wp.static(sharp):
                error += smeared(scene, k, c.length, A, c.blur)
            if good:
                segment = A * value + V * slope
                segment[3] = A
            else:
                segment = piece(scene, from_start(c), k)
            if wp.static(lighted):
                segment = shone(scene, c, k, segment)
            if wp.static(lanes):
                segment = lit_piece(scene, c.middle, c.d, c.length, c.m, k, segment)
        return segment, error

    @wp.func
    def crossing(scene: Scene, c: Cubic):
        segment = wp.vec4d()
        error = real(0.0)
        count = int(0)
        m0 = c.m[0]
        m1 = c.m[1]
        m2 = c.m[2]
        m3 = c.m[3]
        start = real(-1.0)
        value = m0 - m1 + m2 - m3
        final = m0 + m1 + m2 + m3
        last = scene.transfer.knot.shape[0] - 1
        k = interval(scene.transfer, value)
        rises = m1 > real(0.0)
        # The root of a step so small is as exact as numbers are: a step squares the error.
        close = real(1.0e-8) * wp.abs(m1)
        unsure = real(0.0)
        if wp.static(sharp):
            # Length that is on the wrong side of a crossing nevertheless: the slope is at least m1 / 2, and where that
            # is above 9 blur the field rises or falls as well.
            unsure = c.length
            if real(18.0) * c.blur < wp.abs(m1):
                unsure *= real(4.0e-16) + c.blur / wp.abs(m1)
            error += unsure * fuzzy(scene, value, c.blur)
        part = c
        while start < real(1.0):
            stop = real(1.0)
            crosses = k < last
            knot = final
            if rises:
                if crosses:
                    knot = scene.transfer.knot[wp.max(k + 1, 0)]
                crosses = knot < final
            else:
                crosses = k > 0
                if crosses:
                    knot = scene.transfer.knot[wp.max(k, 0)]
                crosses = knot > final
            if crosses:
                # Newton's method from the secant through both ends.
                stop = start + (real(1.0) - start) * (knot - value) / (final - value)
                found = bool(False)
                for _ in range(8):
                    off = m0 - knot + stop * (m1 + stop * (m2 + stop * m3))
                    stop -= off / (m1 + stop * (real(2.0) * m2 + stop * real(3.0) * m3))
                    found = wp.abs(off) <= close
                    if found:
                        break
                if not found:
                    sign = wp.where(rises, real(1.0), real(-1.0))
                    stop = zero(vec5d(m0 - knot, m1, m2, m3, real(0.0)), start, real(1.0), stop, sign)
                stop = wp.clamp(stop, start, real(1.0))
                value = knot
            if wp.static(sharp):
                error += (real(1.0) - segment[3]) * unsure * jump(scene, k, c.blur)
            if stop > start and scene.transfer.visible[k] == k:
                v = real(0.5) * (start + stop)
                w = real(0.5) * (stop - start)
                curve = m2 + real(3.0) * v * m3
                part.middle = c.middle + real(0.5) * c.length * v * c.d
                part.m = wp.vec4d(
                    m0 + v * (m1 + v * (m2 + v * m3)), w * (m1 + v * (m2 + curve)), w * w * curve, w * w * w * m3
                )
                part.length = w * c.length
                part.T = c.T * (real(1.0) - segment[3])
                added, off = linear(scene, part, k)
                error += (real(1.0) - segment[3]) * off
                segment = over(segment, added)
                count += 1
            start = stop
            if crosses:
                k += wp.where(rises, 1, -1)
            else:
                start = real(1.0)
        if wp.static(sharp):
            error += (real(1.0) - segment[3]) * unsure * fuzzy(scene, final, c.blur)
        return segment, error, count

    return linear, crossing
