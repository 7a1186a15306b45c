"""The certified walk: cell by cell, each within a bound that is summed along the ray.

A packet of cells that have something to see is gathered and integrated at a time, as vectors, by ``series``: of a cell
whose piece of ray stays in one interval of the transfer function. One that reaches into the next interval by so little
that a straight line will do is counted as such, and its deviation into the bound. Any other is cut where the scalar
reaches a control point. A piece that the series is not good enough for is integrated as ``Exact`` does.

Light is no polynomial: what it does to a piece is taken from a few points, the more the more the piece adds to the
pixel and the smaller the tolerance. Opacity, and the bound, know nothing of it.

What the bounds of pieces are compared with is a share of the opacity that the piece adds: opacities sum to one, so
the bounds sum to no more than that share.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

from ..field.walk import PACKET, lanes, make_gather, make_walk
from ..light.points import make_shading
from ..segment import over
from ..transfer.function import make_transfer
from .pieces import Piece, make_jumps, make_pieces
from .series import make_series

# Points that a piece is lit in, by what it adds to the pixel over the tolerance: (up to, Gauss-Legendre points).
# One that adds more, or is deeper, is integrated as ``Exact`` does.
POINTS = ((1.0, 1), (32.0, 2), (1000.0, 3), (32000.0, 4))
DEEP = 1.0


@wp.struct
class Certificate:
    """How a tolerance is spent."""

    tolerance: wp.float64  # of what a piece adds, in parts of its opacity
    brightest: wp.float64  # largest component of a colour, 1 or more
    tinted: wp.float64  # error of a simpler transfer function, in parts of a ray's opacity
    veiled: wp.float64  # and of any ray, rounding included
    ulps: wp.vec2d  # rounding of a scalar along a ray, in parts of the largest corner and of the range of a cell
    blur: wp.float64  # the same of any cell
    local: bool  # cells differ much in it
    nodes: wp.array(dtype=wp.vec2d)  # of ``pieces.NODES``


@dataclass(frozen=True)
class Half:
    """The device half of certified integration."""

    sharp: bool  # what rounding of a scalar does counts piece by piece: there are jumps, or slopes are steep
    bounded = True
    tabled = False

    def Struct(self, halves):
        return Certificate

    def march(self, halves):
        return make_certified(halves)


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
            error = off * steepest(slope)
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
                for _ in range(20):
                    off = m0 - knot + stop * (m1 + stop * (m2 + stop * m3))
                    stop -= off / (m1 + stop * (real(2.0) * m2 + stop * real(3.0) * m3))
                    if wp.abs(off) <= close:
                        break
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


@cache
def make_certified(halves):
    """The march, as of ``scene``; what it counts are cells and pieces, and it has a bound."""
    finite = halves.field.finite
    lighted = halves.light is not None
    sharp = halves.march.sharp
    real = wp.float64
    Scene = halves.Scene
    centered = halves.field.centered()
    _, interval, _ = make_transfer(real)
    _, cut = make_pieces(halves)
    _, crossing = make_cubics(halves)
    shone = make_shone(halves)
    absolute, steepest = make_jumps(halves)[:2]
    extent = halves.field.extent()
    eye_of = make_shading(halves).eye
    deviations, opacities, tilts = make_series(PACKET)
    _, enter, _, _ = make_walk(real)
    _, gather = make_gather()
    places = wp.types.vector(PACKET, int)
    flags = wp.types.vector(PACKET, bool)
    ones = wp.constant(lanes(*[1.0] * PACKET))

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, begin: real, end: real):
        zero = real(0.0)
        third = real(wp.static(1.0 / 3.0))
        outer = scene.transfer.knot.shape[0] - 1
        d = direction
        clear = real(1.0) - scene.opaque
        eye = wp.vec3d()
        if wp.static(lighted):
            eye = eye_of(scene, d)
        T = real(1.0)
        red = zero
        green = zero
        blue = zero
        bound = zero
        count = int(0)
        walk = enter(scene.field.last, origin, direction, begin)
        end = wp.min(end, walk.out)
        while walk.t < end and T >= clear:
            walk, packet = gather(scene.blocks, walk, end)
            n = packet.count
            cell = packet.cell
            start = packet.start
            long = packet.length
            # All of them at a time; what is beyond the last of the ray's has no length.
            m0 = lanes()
            m1 = lanes()
            m2 = lanes()
            m3 = lanes()
            L = lanes()
            for l in range(PACKET):
                h = real(0.5) * long[l]
                L[l] = wp.where(l < n, long[l], zero)
                p = origin + (start[l] + h) * d - wp.vec3d(real(cell[0, l]), real(cell[1, l]), real(cell[2, l]))
                m = centered(scene.field, cell[0, l], cell[1, l], cell[2, l], p, d, h)
                m0[l] = m[0]
                m1[l] = m[1]
                m2[l] = m[2]
                m3[l] = m[3]
            R = deviations(m1, m2, m3)
            mean = m0 + third * m2
            single = flags(True)
            at = places()
            knot = lanes()
            tau = lanes()
            dtau = lanes()
            steep = lanes()
            fade = lanes()
            tint = lanes()
            blur = scene.march.blur * ones
            for l in range(PACKET):
                q = int(packet.kind[l])
                uniform = bool(False)
                if wp.static(sharp):
                    if scene.march.local or (q < 0 and R[l] == zero):
                        low, high = extent(scene.field, cell[0, l], cell[1, l], cell[2, l])
                        uniform = low == high
                        size = wp.where(high > -low, high, -low)
                        blur[l] = scene.march.ulps[0] * size + scene.march.ulps[1] * (high - low)
                if q < 0:
                    wide = R[l]
                    if wp.static(sharp):
                        # Where all corners are equal nothing is rounded.
                        wide = wp.where(uniform, zero, wide + blur[l])
                    low = mean[l] - wide
                    high = mean[l] + wide
                    q = interval(scene.transfer, low)
                    if q < outer:
                        single[l] = high <= scene.transfer.knot[wp.max(q + 1, 0)]
                    if not single[l]:
                        # Nearly so, if it only reaches into the intervals next to the mean's: off by most at its ends.
                        q = interval(scene.transfer, mean[l])
                        change = wp.vec4d()
                        # The series is for extinctions >= 0, which a line drawn too far need not have.
                        rate = scene.transfer.slope[wp.max(q, 0)][3]
                        middle = scene.transfer.value[wp.max(q, 0)][3] + rate * (
                            mean[l] - scene.transfer.knot[wp.max(q, 0)]
                        )
                        single[l] = middle >= wp.abs(rate) * wide
                        if q > 0:
                            past = scene.transfer.knot[wp.max(q, 0)] - low
                            if past > zero:
                                change = past * absolute(
                                    scene.transfer.slope[wp.max(q - 1, 0)] - scene.transfer.slope[wp.max(q, 0)]
                                )
                                if q > 1:
                                    single[l] = single[l] and low >= scene.transfer.knot[wp.max(q - 1, 0)]
                        if q < outer:
                            past = high - scene.transfer.knot[wp.max(q + 1, 0)]
                            if past > zero:
                                change += past * absolute(
                                    scene.transfer.slope[wp.max(q + 1, 0)] - scene.transfer.slope[wp.max(q, 0)]
                                )
                                if q + 1 < outer:
                                    single[l] = single[l] and high <= scene.transfer.knot[wp.max(q + 2, 0)]
                        fade[l] = change[3]
                        tint[l] = steepest(change)
                q = wp.max(q, 0)
                at[l] = q
                knot[l] = scene.transfer.knot[q]
                tau[l] = scene.transfer.value[q][3]
                slope = scene.transfer.slope[q]
                dtau[l] = slope[3]
                steep[l] = steepest(slope)
            off = mean - knot
            x = wp.cw_mul(tau + wp.cw_mul(dtau, off), L)
            for l in range(PACKET):
                x[l] = wp.where(x[l] > zero, x[l], zero)
            A = opacities(x)
            V, risk = tilts(m1, m2, m3, R, real(0.5) * x, real(0.5) * wp.cw_mul(dtau, L), A)
            risk = wp.cw_mul(risk, steep)
            simple = bool(True)
            for l in range(PACKET):
                bent = scene.march.brightest * fade[l] * L[l] + tint[l] * A[l]
                most = scene.march.tolerance * A[l] + real(1.0e-300)
                single[l] = single[l] and risk[l] <= most and bent <= most
                risk[l] += bent
                if not wp.static(finite):
                    single[l] = single[l] and wp.isfinite(R[l])
                simple = simple and single[l]
            if wp.static(sharp):
                for l in range(PACKET):
                    risk[l] += blur[l] * (scene.march.brightest * wp.abs(dtau[l]) * L[l] + steep[l] * A[l])
            if simple and not wp.static(lighted):
                for l in range(PACKET):
                    value = scene.transfer.value[wp.max(at[l], 0)]
                    slope = scene.transfer.slope[wp.max(at[l], 0)]
                    TA = T * A[l]
                    TV = T * V[l] + TA * off[l]
                    red += TA * value[0] + TV * slope[0]
                    green += TA * value[1] + TV * slope[1]
                    blue += TA * value[2] + TV * slope[2]
                    bound += T * risk[l]
                    T -= TA
            else:
                l = int(0)
                while l < n:
                    segment = wp.vec4d()
                    error = zero
                    q = wp.max(at[l], 0)
                    here = Cubic()
                    here.middle = origin + (start[l] + real(0.5) * L[l]) * d
                    here.d = d
                    here.eye = eye
                    here.m = wp.vec4d(m0[l], m1[l], m2[l], m3[l])
                    here.length = L[l]
                    here.T = T
                    here.blur = blur[l]
                    if single[l]:
                        if wp.static(lighted):
                            segment = shone(scene, here, q, A[l])
                        else:
                            segment = (
                                A[l] * (scene.transfer.value[q] + off[l] * scene.transfer.slope[q])
                                + V[l] * scene.transfer.slope[q]
                            )
                            segment[3] = A[l]
                        error = risk[l]
                    else:
                        pieces = int(0)
                        known = bool(True)
                        if not wp.static(finite):
                            known = wp.isfinite(R[l])
                        if known:
                            if wp.abs(m1[l]) > real(4.0) * wp.abs(m2[l]) + real(6.0) * wp.abs(m3[l]):
                                segment, error, pieces = crossing(scene, here)
                            else:
                                segment, error, pieces = cut(scene, from_start(here))
                        count += pieces
                    bound += T * error
                    red += T * segment[0]
                    green += T * segment[1]
                    blue += T * segment[2]
                    T -= T * segment[3]
                    l += 1
            count += n
        total = real(1.0) - T
        if walk.t < end or (wp.static(halves.cuts.any) and T < clear):
            # What is behind is not visited; nor is, of a ray that is cut, what is behind this stretch.
            bound += T * scene.march.brightest
        bound += total * scene.march.tinted
        if scene.stretch == 0:
            # Of the ray as a whole.
            bound += scene.march.veiled
        # Both images have colours between 0 and the brightest, this one but for series and rounding.
        most = scene.march.brightest + real(2.0) * scene.march.tolerance + scene.march.veiled
        if bound > most:
            bound = most
        return wp.vec4d(red, green, blue, total), count, bound

    return march
