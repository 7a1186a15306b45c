"""What a stretch of ray contributes, and how stretches compose.

A segment is its premultiplied colour and opacity, (r, g, b, A). ``over`` composes two in order of depth. Sums are
float64: a float32 transparency carried by products is rounded the same way each time.
"""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from .precision import REALS, vec3_of, vec4_of

# Gauss-Legendre rules for an interval with linear extinction and colour, by optical depth: (depth up to, nodes).
# Deeper than the last, the integral ends at depth CUT, behind which nothing is seen at the precision.
# 1e-7 relative in float32 and 1e-13 in float64, for depths 1e-12 to 1e6 and any slope.
RULES = {
    "float32": ((0.01, 3), (0.5, 5), (4.0, 10), (np.inf, 14)),
    "float64": ((0.1, 6), (0.5, 8), (4.0, 16), (np.inf, 28)),
}
CUT = {"float32": 17.0, "float64": 37.0}
# Below this depth three terms of a series are good enough (next term: depth^3 / 60 of the result, 5e-7), and need
# no exponential; most intervals of a table are fainter.
FAINT = {"float32": 0.03, "float64": 1e-4}

THIN = wp.constant(0.25)


def gauss_nodes(precision):
    """Nodes and weights on [0, 1] of all rules of a precision, one after the other: float64, shape (sum of n, 2)."""
    rules = [np.polynomial.legendre.leggauss(n) for _, n in RULES[precision]]
    return np.concatenate([np.stack([(x + 1) / 2, w / 2], axis=1) for x, w in rules])


@wp.func
def widened(v: Any):
    """Four numbers of any precision as float64."""
    return wp.vec4d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]), wp.float64(v[3]))


@wp.func
def over(front: wp.vec4d, back: wp.vec4d):
    """``front`` before ``back``, both premultiplied colour and opacity."""
    return front + (wp.float64(1.0) - front[3]) * back


@wp.func
def over_moment(
    front: wp.vec4d, front_moment: wp.vec4d, front_length: wp.float64, back: wp.vec4d, back_moment: wp.vec4d
):
    """First moment, about the start of ``front``, of what ``over(front, back)`` emits and absorbs."""
    return front_moment + (wp.float64(1.0) - front[3]) * (back_moment + front_length * back)


@cache
def make_absorbed(real):
    """``absorbed(x)`` = 1 - exp(-x) for x >= 0, relatively accurate (Warp has no expm1), and ``thin(x)`` below THIN."""
    # The series x (1 - x/2 (1 - x/3 (...))), cut where the next term rounds to nothing.
    terms = 7 if real is wp.float32 else 13
    # A constant, not wp.static of the loop's variable: that would change the module's hash once it was evaluated.
    inverse = wp.constant(wp.types.vector(terms - 1, real)(*(1.0 / (terms - i) for i in range(terms - 1))))

    @wp.func
    def thin(x: real):
        series = real(1.0)
        for i in range(wp.static(terms - 1)):
            series = real(1.0) - x * inverse[i] * series
        return x * series

    @wp.func
    def absorbed(x: real):
        if x < real(THIN):
            return thin(x)
        return real(1.0) - wp.exp(-x)

    return absorbed, thin


@cache
def make_opacities(real, lanes):
    """``opacities(depths)``: opacity of each of a vector of optical depths, without a branch where all are thin."""
    absorbed, thin = make_absorbed(real)
    vector = wp.types.vector(lanes, real)

    @wp.func
    def opacities(depths: vector):
        A = vector()
        if wp.max(depths) < real(THIN):
            for l in range(wp.static(lanes)):
                A[l] = thin(depths[l])
        else:
            for l in range(wp.static(lanes)):
                A[l] = absorbed(depths[l])
        return A

    return opacities


@cache
def make_shares(real):
    """``shares(nodes, a, c)`` -> (A, U, D) of an interval with linear extinction.

    ``a`` and ``c`` are the extinction at its low and high end times its length; A is its opacity and
    ``U[m-1] = int u^m dA(u)``, m = 1, 2, 3, where u runs from 0 at the front to 1 at the back, going up from the low
    end; D is the same going down from the high end. An emission e0 + e1 u + e2 u^2 contributes
    ``e0 A + e1 U[0] + e2 U[1]``, and ``e0 U[0] + e1 U[1] + e2 U[2]`` to the first moment about the front.
    """
    vec3 = vec3_of(real)
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2
    precision = next(name for name, t in REALS.items() if t is real)
    absorbed, _ = make_absorbed(real)
    (d0, n0), (d1, n1), (d2, n2), (_, n3) = RULES[precision]
    cut = CUT[precision]
    faint = FAINT[precision]

    @wp.func
    def faint_shares(a: real, c: real, A: real):
        # Fractions are static: Warp would round them to float32 first.
        # U_m = A - m int u^(m-1) A(u) du, and A(u) = D - D^2/2 + D^3/6 with D = u (a + (c - a) u/2).
        aa = a * a
        ac = a * c
        cc = c * c
        half = real(0.5)
        sixth = real(wp.static(1.0 / 6.0))
        I1 = real(wp.static(1.0 / 3.0)) * a + sixth * c
        I2 = real(wp.static(2.0 / 15.0)) * aa + real(0.15) * ac + real(0.05) * cc
        I3 = a * (real(wp.static(2.0 / 35.0)) * aa + real(wp.static(29.0 / 280.0)) * ac) + cc * (
            real(wp.static(1.0 / 14.0)) * a + real(wp.static(1.0 / 56.0)) * c
        )
        J1 = real(wp.static(5.0 / 24.0)) * a + real(0.125) * c
        J2 = real(wp.static(11.0 / 120.0)) * aa + real(wp.static(7.0 / 60.0)) * ac + real(wp.static(1.0 / 24.0)) * cc
        J3 = a * (real(wp.static(93.0 / 2240.0)) * aa + real(wp.static(37.0 / 448.0)) * ac) + cc * (
            real(wp.static(27.0 / 448.0)) * a + real(wp.static(1.0 / 64.0)) * c
        )
        K1 = real(0.15) * a + real(0.1) * c
        K2 = real(wp.static(29.0 / 420.0)) * aa + real(wp.static(2.0 / 21.0)) * ac + real(wp.static(1.0 / 28.0)) * cc
        K3 = a * (real(wp.static(65.0 / 2016.0)) * aa + real(wp.static(23.0 / 336.0)) * ac) + cc * (
            real(wp.static(5.0 / 96.0)) * a + real(wp.static(1.0 / 72.0)) * c
        )
        return vec3(
            A - (I1 - half * I2 + sixth * I3),
            A - real(2.0) * (J1 - half * J2 + sixth * J3),
            A - real(3.0) * (K1 - half * K2 + sixth * K3),
        )

    @wp.func
    def quadrature(nodes: wp.array(dtype=vec2), a: real, b: real, depth: real):
        first = int(0)
        count = int(n0)
        if depth > real(d2):
            first = wp.static(n0 + n1 + n2)
            count = int(n3)
        elif depth > real(d1):
            first = wp.static(n0 + n1)
            count = int(n2)
        elif depth > real(d0):
            first = int(n0)
            count = int(n1)
        end = real(1.0)
        if depth > real(cut):
            end = real(wp.static(2.0 * cut)) / (a + wp.sqrt(wp.max(a * a + real(wp.static(2.0 * cut)) * b, real(0.0))))
        W = vec3()
        for i in range(first, first + count):
            u = nodes[i][0] * end
            udA = u * nodes[i][1] * end * (a + b * u) * wp.exp(-u * (a + real(0.5) * b * u))
            W += udA * vec3(real(1.0), u, u * u)
        return W

    @wp.func
    def shares(nodes: wp.array(dtype=vec2), low: real, high: real):
        # Extinction interpolated towards a knot where it is 0 may be negative by rounding.
        a = wp.max(low, real(0.0))
        c = wp.max(high, real(0.0))
        depth = real(0.5) * (a + c)
        A = real(0.0)
        U = vec3()
        D = vec3()
        if depth < real(faint):
            A = depth * (
                real(1.0)
                - depth * (real(0.5) - depth * (real(wp.static(1.0 / 6.0)) - depth * real(wp.static(1.0 / 24.0))))
            )
            U = faint_shares(a, c, A)
            D = faint_shares(c, a, A)
        else:
            A = absorbed(depth)
            U = quadrature(nodes, a, c - a, depth)
            D = quadrature(nodes, c, a - c, depth)
        return A, U, D

    return shares


@cache
def make_interval(real):
    """``interval(nodes, front, back, length)`` -> vec4d of a segment whose colour and extinction are linear.

    ``front`` and ``back`` are (r, g, b, extinction) at its ends; ``nodes`` are those of ``gauss_nodes``.
    """
    vec4 = vec4_of(real)
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2
    shares = make_shares(real)

    @wp.func
    def interval(nodes: wp.array(dtype=vec2), front: vec4, back: vec4, length: real):
        A, U, _ = shares(nodes, front[3] * length, back[3] * length)
        color = A * front + U[0] * (back - front)
        color[3] = A
        return widened(color)

    return interval
