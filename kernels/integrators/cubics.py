"""Pieces of ray in a cell about their middle: lit, in one interval of the transfer function, or across several.

Light is no polynomial: what it does to a piece is taken from a few points, the more the more the piece adds to the
pixel and the smaller the tolerance. Opacity, and the bound, know nothing of it.
"""

from functools import cache

import numpy as np
import warp as wp

from ..field.cell import vec5d, zero
from ..light.points import make_shading
from ..segment import over
from ..transfer.function import make_transfer
from .pieces import Piece, make_jumps, make_pieces
from .series import closer, make_series

# Points that a piece is lit in, by what it adds to the pixel over the tolerance: (up to, Gauss-Legendre points).
# One that adds more, or is deeper, is integrated as ``Exact`` does.
POINTS = ((1.0, 1), (32.0, 2), (1000.0, 3), (32000.0, 4))
DEEP = 1.0


@wp.struct
class Cubic:
    """A piece of ray about its middle: ``m0 + m1 v + m2 v^2 + m3 v^3``, v in [-1, 1] over its length."""

    middle: wp.vec3d
    d: wp.vec3d  # direction
    eye: wp.vec3d  # unit vector towards the viewer, where there is light
    m: wp.vec4d
    length: wp.float64
    T: wp.float64  # transparency in front of it
    blur: wp.float64  # rounding of m


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
    result.s = wp.vec4d(
        m[0] - m[1] + m[2] - m[3],
        h * (m[1] - wp.float64(2.0) * m[2] + wp.float64(3.0) * m[3]),
        h * h * (m[2] - wp.float64(3.0) * m[3]),
        h * h * h * m[3],
    )
    return result


@cache
def make_shone(halves):
    """``shone(scene, c, k, A)`` -> lit segment of opacity A of a ``Cubic`` that stays in interval k."""
    real = wp.float64
    Scene = halves.Scene
    piece, _ = make_pieces(halves)
    _, gradient, light, lit, _ = make_shading(halves)
    rules = [np.polynomial.legendre.leggauss(n) for _, n in POINTS]
    points = wp.constant(
        wp.types.matrix((4, 4), real)(*np.array([np.pad(x, (0, 4 - len(x))) for x, _ in rules]).ravel())
    )
    weights = wp.constant(
        wp.types.matrix((4, 4), real)(*np.array([np.pad(w, (0, 4 - len(w))) for _, w in rules]).ravel())
    )

    @wp.func
    def shone(scene: Scene, c: Cubic, k: int, A: real):
        third = real(wp.static(1.0 / 3.0))
        m0 = c.m[0]
        m1 = c.m[1]
        m2 = c.m[2]
        m3 = c.m[3]
        slope = scene.transfer.slope[k]
        value = scene.transfer.value[k] + (m0 - scene.transfer.knot[k]) * slope
        half = real(0.5) * c.length
        segment = wp.vec4d()
        added = c.T * A / scene.march.tolerance
        if half * value[3] > real(wp.static(0.5 * DEEP)) or added > real(wp.static(POINTS[3][0])):
            segment = piece(scene, from_start(c), k)
        elif A > real(0.0):
            rule = int(0)
            if added > real(wp.static(POINTS[2][0])):
                rule = 3
            elif added > real(wp.static(POINTS[1][0])):
                rule = 2
            elif added > real(wp.static(POINTS[0][0])):
                rule = 1
            total = real(0.0)
            for i in range(rule + 1):
                v = points[rule, i]
                off = v * (m1 + v * (m2 + v * m3))
                q = value + off * slope
                vv = v * v
                rise = (
                    real(0.5) * m1 * (vv - real(1.0))
                    + third * m2 * (vv * v + real(1.0))
                    + real(0.25) * m3 * (vv * vv - real(1.0))
                )
                depth = half * (value[3] * (v + real(1.0)) + slope[3] * rise)
                weight = weights[rule, i] * wp.max(q[3], real(0.0)) * wp.exp(-depth)
                p = c.middle + v * half * c.d
                I = light(scene, p, gradient(scene, p), c.eye)
                segment += weight * lit(scene, q, k, m0 + off, I)
                total += weight
            if total > real(0.0):
                segment *= A / total
        segment[3] = A
        return segment

    return shone


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
    shone = make_shone(halves)
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
            if wp.static(halves.light is not None):
                segment = shone(scene, c, k, A)
            elif good:
                segment = A * value + V * slope
                segment[3] = A
            else:
                segment = piece(scene, from_start(c), k)
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
            # Length that is on the wrong side of a crossing nevertheless: the slope is at least m1 / 2.
            unsure = c.length * wp.min(real(1.0), real(4.0e-16) + c.blur / wp.abs(m1))
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
