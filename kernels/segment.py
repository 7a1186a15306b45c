"""What a stretch of ray contributes, and how stretches compose.

A segment is its premultiplied colour and opacity, (r, g, b, A). ``over`` composes two in order of depth. Sums are
float64: a float32 transparency carried by products is rounded the same way each time.
"""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

from .precision import REALS, vec4_of

# Gauss-Legendre rules for an interval with linear extinction and colour, by optical depth: (depth up to, nodes).
# Deeper than the last, the integral ends at depth CUT, behind which nothing is seen at the precision.
# 1e-7 relative in float32 and 1e-13 in float64, for depths 1e-12 to 1e6 and any slope.
RULES = {
    "float32": ((0.01, 3), (0.5, 5), (4.0, 10), (np.inf, 14)),
    "float64": ((0.1, 6), (0.5, 8), (4.0, 16), (np.inf, 28)),
}
CUT = {"float32": 17.0, "float64": 37.0}

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


@cache
def make_absorbed(real):
    """``absorbed(x)`` = 1 - exp(-x) for x >= 0, relatively accurate (Warp has no expm1), and ``thin(x)`` below THIN."""
    # The series x (1 - x/2 (1 - x/3 (...))), cut where the next term rounds to nothing.
    terms = 7 if real is wp.float32 else 13

    @wp.func
    def thin(x: real):
        series = real(1.0)
        for i in range(wp.static(terms - 1)):
            series = real(1.0) - x * real(wp.static(1.0 / (terms - i))) * series
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
def make_interval(real):
    """``interval(nodes, front, back, length)`` -> vec4d of a segment whose colour and extinction are linear.

    ``front`` and ``back`` are (r, g, b, extinction) at its ends; ``nodes`` are those of ``gauss_nodes``.
    """
    vec4 = vec4_of(real)
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2
    precision = next(name for name, t in REALS.items() if t is real)
    absorbed, _ = make_absorbed(real)
    (d0, n0), (d1, n1), (d2, n2), (_, n3) = RULES[precision]
    cut = CUT[precision]

    @wp.func
    def interval(nodes: wp.array(dtype=vec2), front: vec4, back: vec4, length: real):
        # Extinction interpolated towards a knot where it is 0 may be negative by rounding.
        a = wp.max(front[3], real(0.0)) * length
        b = wp.max(back[3], real(0.0)) * length - a
        depth = a + real(0.5) * b
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
        # W1 = int u dA, the back end's share of the opacity A; the front end's is A - W1.
        W1 = real(0.0)
        for i in range(first, first + count):
            u = nodes[i][0] * end
            W1 += nodes[i][1] * end * u * (a + b * u) * wp.exp(-u * (a + real(0.5) * b * u))
        A = absorbed(depth)
        color = A * front + W1 * (back - front)
        color[3] = A
        return widened(color)

    return interval
