"""What a thin piece of ray adds, where the scalar is a cubic and the transfer function linear over all that it sees.

The scalar is ``s(v) = m0 + m1 v + m2 v^2 + m3 v^3``, v in [-1, 1] over the piece's length L, its mean
``m0 + m2 / 3``, and w its deviation from that. The optical depth x is exactly that of the mean. With A the opacity and
c' the slope of colour over the scalar, the piece has the colour ``c(mean) A + c' V``, ``V = int w dA``. With
``a = x / 2`` and ``g = tau' L / 2`` the extinction is ``a + g w`` for each v, and the depth up to v
``a (v + 1) + g W(v)``, where W' = w and W(-1) = W(1) = 0. Expanding exp(-depth) about that of the middle gives V in
moments of w, which are polynomials:

    V = exp(-a) (g int w^2 - a^2 int v w - a g int v w^2 - g^2 int w^2 W + ...)

Wherever the extinction is not negative V is off by at most ``R x^3 / 24``, R >= |w| (docs/proof.md, theorem 2).
"""

from functools import cache
from math import exp, factorial

import warp as wp

# Opacity is a polynomial of degree 9 up to this depth: off by less than the next term, in parts of itself.
THIN = 0.4
# Rounding of extinction, in parts of the larger one at the ends of its interval (docs/proof.md, lemma 4).
VALUE = 2.0**-50
TRUNCATED = THIN**10 / factorial(10) / (1.0 - exp(-THIN))


@wp.func
def closer(m2: wp.float64, R: wp.float64, a: wp.float64, g: wp.float64):
    """Another bound of V, in parts of what it is off by: better where extinction varies little (theorem 3)."""
    G = wp.abs(g) * R
    third = wp.float64(wp.static(1.0 / 3.0 * (1.0 + 2.0**-40)))
    spread = third * R * G * (a * a + G * (a + G))
    return spread + a * a * a * (
        wp.float64(wp.static(4.0 / 45.0 * (1.0 + 2.0**-40))) * wp.abs(m2) + wp.float64(0.25) * third * R * a
    )


@cache
def make_series(lanes):
    """For one number or a vector of several at a time (``lanes``, None for one), float64:

    ``deviation(m1, m2, m3)`` -> R, ``opacity(x)``, and ``tilt(m1, m2, m3, R, a, g, A)`` -> V and its bound.
    """
    real = wp.float64
    T = real if lanes is None else wp.types.vector(lanes, real)
    one = wp.constant(real(1.0) if lanes is None else T(*[1.0] * lanes))

    @wp.func
    def times(a: T, b: T):
        if wp.static(lanes is None):
            return a * b
        else:
            return wp.cw_mul(a, b)

    @wp.func
    def deviation(m1: T, m2: T, m3: T):
        return wp.abs(m1) + real(wp.static(2.0 / 3.0)) * wp.abs(m2) + wp.abs(m3)

    @wp.func
    def thin(x: T):
        # In an order that takes few steps one after the other.
        xx = times(x, x)
        A = one * real(wp.static(-1.0 / 40320.0)) + x * real(wp.static(1.0 / 362880.0))
        A = one * real(wp.static(-1.0 / 720.0)) + x * real(wp.static(1.0 / 5040.0)) + times(xx, A)
        A = one * real(wp.static(-1.0 / 24.0)) + x * real(wp.static(1.0 / 120.0)) + times(xx, A)
        A = one * real(-0.5) + x * real(wp.static(1.0 / 6.0)) + times(xx, A)
        return x + times(xx, A)

    @wp.func
    def opacity(x: T):
        if wp.static(lanes is None):
            if x > real(THIN):
                return real(1.0) - wp.exp(-x)
            return thin(x)
        else:
            A = thin(x)
            if wp.max(x) > real(THIN):
                for l in range(wp.static(lanes or 1)):
                    if x[l] > real(THIN):
                        A[l] = real(1.0) - wp.exp(-x[l])
            return A

    @wp.func
    def root(x: T):
        if wp.static(lanes is None):
            return wp.sqrt(x)
        else:
            y = x
            for l in range(wp.static(lanes or 1)):
                y[l] = wp.sqrt(x[l])
            return y

    @wp.func
    def tilt(m1: T, m2: T, m3: T, R: T, a: T, g: T, A: T):
        aa = times(a, a)
        m11 = times(m1, m1)
        m22 = times(m2, m2)
        m33 = times(m3, m3)
        ww = (
            real(wp.static(2.0 / 3.0)) * m11
            + real(0.8) * times(m1, m3)
            + real(wp.static(8.0 / 45.0)) * m22
            + real(wp.static(2.0 / 7.0)) * m33
        )
        vw = real(wp.static(2.0 / 3.0)) * m1 + real(0.4) * m3
        vww = times(m2, real(wp.static(16.0 / 45.0)) * m1 + real(wp.static(32.0 / 105.0)) * m3)
        # Less int w^2 W.
        wwW = (
            times(m11, real(wp.static(2.0 / 15.0)) * m1 + real(wp.static(22.0 / 105.0)) * m3)
            + times(m22, real(wp.static(8.0 / 135.0)) * m1 + real(wp.static(8.0 / 189.0)) * m3)
            + times(m33, real(wp.static(38.0 / 315.0)) * m1 + real(wp.static(2.0 / 77.0)) * m3)
        )
        V = times(g, ww + times(g, wwW) - times(a, vww)) - times(aa, vw)
        error = real(wp.static(1.0 / 3.0 * (1.0 + 2.0**-40))) * times(R, times(aa, a))
        # exp(-a) is the root of exp(-x).
        return times(V, root(one - A)), error

    return deviation, opacity, tilt
