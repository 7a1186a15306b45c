"""Pieces of ray in a cell, from control point to control point of the transfer function, as exact as float64 is.

On such a piece the scalar s is a cubic in the length u from its start, extinction and colour are linear in s, and the
optical depth D is a quartic in closed form. What the piece adds of colour is
``int c tau exp(-D) du = c0 (1 - exp(-D)) + c' int (s - s0) tau exp(-D) du``; quadrature is left with the last integral,
whose terms have one sign where s is monotone. What ``cut`` cuts is lit, by ``shone``.
"""

from functools import cache
from math import expm1, factorial
from typing import Any, NamedTuple

import warp as wp

from ..field.cell import at, moved, quartic, turns, vec5d, zero
from ..segment import make_absorbed, over
from ..transfer.function import make_transfer
from ..transfer.linear import CUT
from .alone import make_lit_piece
from .lit import in_lanes
from .series import VALUE
from .shone import Cubic, make_shone

# Nodes of the Gauss-Legendre rules, of which a piece takes the first that is exact to ACCURACY at its optical depth; it
# is cut at multiples of the last one's.
NODES = (8, 12, 20, 28, 40)
# Of quadrature, in parts of a piece's opacity and of what colour changes between two control points.
ACCURACY = 1e-12


def deepest(n):
    """The optical depth X up to which n nodes are exact to ``ACCURACY``.

    On a piece of depth X the integrand is a polynomial of degree 6, from 0 to 1 times an extinction that integrates to
    X, times exp(-D), D a polynomial of degree 4 that rises from 0 to X. A polynomial of degree K - 1 in D is within
    ``e = 2 (X / 4)^K / K!`` of exp(-D) (interpolation at Chebyshev's points; its K-th derivative is 1 at most), and the
    rule is exact for what it makes of the integrand if 6 + 4 (K - 1) <= 2 n - 1. Weights are positive and the rule is
    exact for the extinction, so that integral and rule are off by X e at most, each. The opacity is 1 - exp(-X).
    """
    K = (2 * n - 7) // 4 + 1
    low, high = 0.0, 16.0
    while high - low > 1e-9 * high:
        X = (low + high) / 2
        error = 2 * X * 2 * (X / 4) ** K / factorial(K) / -expm1(-X)
        low, high = (X, high) if error <= ACCURACY else (low, X)
    return low


@wp.struct
class Piece:
    """Of a ray in a cell, where the scalar is the cubic ``s`` of the length from the start."""

    start: wp.vec3d
    d: wp.vec3d  # direction
    eye: wp.vec3d  # unit vector towards the viewer, where there is light
    s: wp.vec4d
    length: wp.float64
    blur: wp.float64  # rounding of s, where there is a bound
    T: wp.float64  # transparency in front of it, where there is light


class Jumps(NamedTuple):
    """Device functions for what rounding of the scalar by up to ``blur`` does.

    ``absolute(v)``: of all channels; ``steepest(slope)``: the largest of the three colours, without sign;
    ``jump(scene, k, blur)``: what it does on the wrong side of interval k, a unit of length, if that is a jump or so
    narrow that rounding may miss it; ``fuzzy(scene, s, blur)``: the same of all intervals within ``blur`` of s;
    ``smeared(scene, k, length, A, blur)``: within interval k, over a length in which the opacity is A.
    """

    absolute: Any
    steepest: Any
    jump: Any
    fuzzy: Any
    smeared: Any


@cache
def make_jumps(halves):
    """The ``Jumps`` of a kernel."""
    real = wp.float64
    Scene = halves.Scene
    _, interval, _ = make_transfer(real)

    @wp.func
    def absolute(v: wp.vec4d):
        return wp.vec4d(wp.abs(v[0]), wp.abs(v[1]), wp.abs(v[2]), wp.abs(v[3]))

    @wp.func
    def steepest(slope: wp.vec4d):
        # Comparisons, since Warp's max also looks for NaN.
        size = absolute(slope)
        most = wp.where(size[0] > size[1], size[0], size[1])
        return wp.where(size[2] > most, size[2], most)

    @wp.func
    def jump(scene: Scene, k: int, blur: real):
        size = real(0.0)
        if k > 0 and k < scene.transfer.knot.shape[0] - 1:
            if scene.transfer.knot[k + 1] - scene.transfer.knot[k] <= real(4.0) * blur:
                low = scene.transfer.value[k]
                high = scene.transfer.value[k + 1]
                most = wp.where(high[3] > low[3], high[3], low[3])
                size = scene.march.brightest * wp.abs(high[3] - low[3]) + steepest(high - low) * most
        return size

    @wp.func
    def fuzzy(scene: Scene, s: real, blur: real):
        last = scene.transfer.knot.shape[0] - 1
        k = interval(scene.transfer, s)
        size = jump(scene, k, blur)
        j = k
        while j > 0 and s - scene.transfer.knot[wp.max(j, 0)] <= blur:
            j -= 1
            size += jump(scene, j, blur)
        j = k
        while j < last and scene.transfer.knot[wp.max(j + 1, 0)] - s <= blur:
            j += 1
            size += jump(scene, j, blur)
        return size

    @wp.func
    def smeared(scene: Scene, k: int, length: real, A: real, blur: real):
        change = absolute(scene.transfer.slope[k]) * (real(2.0) * blur)
        if k > 0 and k < scene.transfer.knot.shape[0] - 1:
            # All that there is in the interval.
            most = absolute(scene.transfer.value[k + 1] - scene.transfer.value[k])
            for n in range(4):
                change[n] = wp.where(change[n] < most[n], change[n], most[n])
        # And the values at its ends.
        near = scene.transfer.value[k][3]
        far = near
        if k < scene.transfer.knot.shape[0] - 1:
            far = scene.transfer.value[k + 1][3]
        change[3] += real(VALUE) * wp.where(far > near, far, near)
        return scene.march.brightest * change[3] * length + steepest(change) * A

    return Jumps(absolute, steepest, jump, fuzzy, smeared)


@cache
def make_pieces(halves):
    """``piece(scene, here, k)`` -> segment of a ``Piece`` in interval k;
    ``cut(scene, here)`` -> segment of one in whatever intervals there are, what jumps may be off by, and the number of
    its pieces.
    """
    Scene = halves.Scene
    _, interval, _ = make_transfer(wp.float64)
    absorbed, _ = make_absorbed(wp.float64)
    rules = len(NODES)
    numbers = wp.constant(wp.types.vector(rules, int)(*NODES))
    depths = wp.constant(wp.types.vector(rules, wp.float64)(*map(deepest, NODES)))
    opaque = CUT["float64"]
    lanes = in_lanes(halves)
    lighted = halves.light is not None and not lanes
    lit_piece = make_lit_piece(halves) if lanes else None
    shone = make_shone(halves) if lighted else None
    jumps = make_jumps(halves)
    jump, fuzzy, smeared = jumps.jump, jumps.fuzzy, jumps.smeared
    sharp = halves.march.sharp

    @wp.func
    def unsure(s: wp.vec4d, u: wp.float64, length: wp.float64, blur: wp.float64):
        """Length about u in which the scalar is within its rounding of what it is at u."""
        slope = wp.abs(s[1] + u * (wp.float64(2.0) * s[2] + u * wp.float64(3.0) * s[3]))
        bend = wp.abs(wp.float64(2.0) * s[2] + wp.float64(6.0) * u * s[3])
        reach = length
        if wp.float64(8.0) * blur < slope * reach:
            reach = wp.float64(8.0) * blur / slope
        if wp.float64(32.0) * blur < bend * reach * reach:
            reach = wp.sqrt(wp.float64(32.0) * blur / bend)
        return reach

    @wp.func
    def quadrature(scene: Scene, here: Piece, tau: wp.vec4d, D: vec5d):
        """Integral of (s - s0) tau exp(-D)."""
        s = here.s
        depth = quartic(D, here.length)
        first = int(0)
        count = numbers[0]
        for rule in range(rules - 1):
            if depth > depths[rule]:
                first += count
                count = numbers[rule + 1]
        total = wp.float64(0.0)
        start = wp.float64(0.0)
        reached = wp.float64(0.0)
        while reached < wp.min(depth, wp.float64(opaque)):
            stop = here.length
            reached += depths[rules - 1]
            if reached < depth:
                behind = D
                behind[0] = -reached
                guess = wp.float64(0.5) * (start + here.length)
                stop = zero(behind, start, here.length, guess, wp.float64(1.0))
            for i in range(first, first + count):
                node = scene.march.nodes[wp.max(i, 0)]
                u = start + node[0] * (stop - start)
                risen = u * (s[1] + u * (s[2] + u * s[3]))
                total += (stop - start) * node[1] * at(tau, u) * wp.exp(-quartic(D, u)) * risen
            start = stop
        return total

    @wp.func
    def piece(scene: Scene, given: Piece, k: int):
        here = given
        slope = scene.transfer.slope[k]
        if k > 0 and k < scene.transfer.knot.shape[0] - 1:
            # It is within the interval but for rounding; and a cubic that is has no larger terms than these.
            low = scene.transfer.knot[k]
            high = scene.transfer.knot[k + 1]
            u = here.length
            wide = u * (wp.abs(here.s[1]) + u * (wp.abs(here.s[2]) + u * wp.abs(here.s[3])))
            if wide > wp.float64(64.0) * (high - low):
                here.s = wp.vec4d(here.s[0], wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
            here.s[0] = wp.clamp(here.s[0], low, high)
        front = scene.transfer.value[k] + (here.s[0] - scene.transfer.knot[k]) * slope
        tau = slope[3] * here.s
        # Interpolated towards a knot where it is 0 it may be negative by rounding.
        tau[0] = wp.max(front[3], wp.float64(0.0))
        D = vec5d(
            wp.float64(0.0),
            tau[0],
            wp.float64(0.5) * tau[1],
            wp.float64(wp.static(1.0 / 3.0)) * tau[2],
            wp.float64(0.25) * tau[3],
        )
        A = absorbed(wp.max(quartic(D, here.length), wp.float64(0.0)))
        segment = A * front
        if slope[0] != wp.float64(0.0) or slope[1] != wp.float64(0.0) or slope[2] != wp.float64(0.0):
            segment += quadrature(scene, here, tau, D) * slope
            if k > 0 and k < scene.transfer.knot.shape[0] - 1:
                # Of colours between those of its ends.
                for n in range(3):
                    one = A * scene.transfer.value[k][n]
                    other = A * scene.transfer.value[k + 1][n]
                    segment[n] = wp.clamp(segment[n], wp.min(one, other), wp.max(one, other))
        segment[3] = A
        return segment

    @wp.func
    def cut(scene: Scene, here: Piece):
        s = here.s
        length = here.length
        blur = here.blur
        segment = wp.vec4d()
        error = wp.float64(0.0)
        count = int(0)
        last = scene.transfer.knot.shape[0] - 1
        m = interval(scene.transfer, s[0])
        first, second = turns(s, length)
        start = wp.float64(0.0)
        value = s[0]
        part = here
        if wp.static(sharp):
            error += fuzzy(scene, value, blur) * unsure(s, start, length, blur)
        stretch = int(0)
        # Not written out: what is in it is most of a kernel.
        while stretch < 3:
            # s is monotone up to here.
            end = length
            if stretch == 0:
                end = first
            elif stretch == 1:
                end = second
            final = at(s, end)
            rises = final > value
            if wp.static(sharp):
                error += fuzzy(scene, final, blur) * unsure(s, end, length, blur)
            while start < end:
                stop = end
                knot = scene.transfer.knot[wp.max(wp.where(rises, wp.min(m + 1, last), m), 0)]
                crosses = wp.where(rises, m < last and knot < final, m > 0 and knot > final)
                if crosses:
                    # The secant through both ends is a good guess.
                    guess = start + (end - start) * (knot - value) / (final - value)
                    sign = wp.where(rises, wp.float64(1.0), wp.float64(-1.0))
                    stop = zero(vec5d(s[0] - knot, s[1], s[2], s[3], wp.float64(0.0)), start, end, guess, sign)
                    value = knot
                if wp.static(sharp):
                    error += jump(scene, m, blur) * unsure(s, stop, length, blur)
                if stop > start and scene.transfer.visible[m] == m:
                    part.start = here.start + start * here.d
                    part.s = moved(s, start)
                    part.length = stop - start
                    added = piece(scene, part, m)
                    if wp.static(halves.light is not None):
                        h = wp.float64(0.5) * part.length
                        c = moved(part.s, h)
                        terms = wp.vec4d(c[0], h * c[1], h * h * c[2], h * h * h * c[3])
                        middle = part.start + h * part.d
                        if wp.static(lanes):
                            added = lit_piece(scene, middle, part.d, part.length, terms, m, added)
                        else:
                            cubic = Cubic()
                            cubic.middle = middle
                            cubic.d = part.d
                            cubic.eye = part.eye
                            cubic.m = terms
                            cubic.length = part.length
                            cubic.T = here.T * (wp.float64(1.0) - segment[3])
                            added = shone(scene, cubic, m, added)
                    if wp.static(sharp):
                        error += smeared(scene, m, part.length, added[3], blur)
                    segment = over(segment, added)
                    count += 1
                start = stop
                if crosses:
                    m += wp.where(rises, 1, -1)
            value = final
            stretch += 1
        return segment, error, count

    return piece, cut
