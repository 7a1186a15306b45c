"""A segment along which the scalar is linear: between control points colour and extinction are linear too."""

from functools import cache

import numpy as np
import warp as wp

from ..precision import name_of, vec2_of, vec3_of, vec4_of
from ..segment import make_absorbed, over, widened
from .function import make_transfer

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


def gauss_nodes(numbers):
    """Nodes and weights on [0, 1] of rules of so many nodes, one after the other: float64, shape (sum of n, 2)."""
    rules = [np.polynomial.legendre.leggauss(n) for n in numbers]
    return np.concatenate([np.stack([(x + 1) / 2, w / 2], axis=1) for x, w in rules])


@cache
def make_shares(real):
    """``shares(nodes, a, c)`` -> (A, U, D) of an interval with linear extinction.

    ``a`` and ``c`` are the extinction at its low and high end times its length; A is its opacity and
    ``U[m-1] = int u^m dA(u)``, m = 1, 2, 3, where u runs from 0 at the front to 1 at the back, going up from the low
    end; D is the same going down from the high end. An emission e0 + e1 u + e2 u^2 contributes
    ``e0 A + e1 U[0] + e2 U[1]``, and ``e0 U[0] + e1 U[1] + e2 U[2]`` to the first moment about the front.
    """
    vec3 = vec3_of(real)
    vec2 = vec2_of(real)
    precision = name_of(real)
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
    vec2 = vec2_of(real)
    shares = make_shares(real)

    @wp.func
    def interval(nodes: wp.array(dtype=vec2), front: vec4, back: vec4, length: real):
        A, U, _ = shares(nodes, front[3] * length, back[3] * length)
        color = A * front + U[0] * (back - front)
        color[3] = A
        return widened(color)

    return interval


@cache
def make_linear_segment(real):
    """``linear_segment(tf, nodes, front, back, length)`` -> vec4d: the scalar runs linearly from front to back.

    Exact for any length: composed of the stretches between the transfer function's knots.
    """
    vec2 = vec2_of(real)
    Transfer, find, _ = make_transfer(real)
    interval = make_interval(real)

    @wp.func
    def value(tf: Transfer, k: int, s: real):
        return tf.value[k] + (s - tf.knot[k]) * tf.slope[k]

    @wp.func
    def linear_segment(tf: Transfer, nodes: wp.array(dtype=vec2), front: real, back: real, length: real):
        k = find(tf, front)
        end = find(tf, back)
        step = wp.where(back < front, -1, 1)
        segment = wp.vec4d()
        s = front
        while k != end:
            # Upwards an interval ends where the next begins, downwards where it begins itself.
            knot = tf.knot[wp.where(step > 0, k + 1, k)]
            segment = over(
                segment, interval(nodes, value(tf, k, s), value(tf, k, knot), length * (knot - s) / (back - front))
            )
            s = knot
            k += step
        share = length
        if s != front:
            share = length * (back - s) / (back - front)
        return over(segment, interval(nodes, value(tf, k, s), value(tf, k, back), share))

    return linear_segment
