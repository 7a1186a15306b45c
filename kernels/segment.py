"""What a stretch of ray contributes, and how stretches compose.

A segment is its premultiplied colour and opacity, (r, g, b, A). ``over`` composes two in order of depth. Sums are
float64: a float32 transparency carried by products is rounded the same way each time. Where float64 is slow they are
float32 with what rounding left out beside them, which is as good as one rounding of the result.
"""

from functools import cache
from typing import Any

import warp as wp

from .precision import vec4_of

THIN = wp.constant(0.25)


@wp.func
def widened(v: Any):
    """Four numbers of any precision as float64."""
    return wp.vec4d(v)


@wp.func
def over(front: wp.vec4d, back: wp.vec4d):
    """``front`` before ``back``, both premultiplied colour and opacity."""
    return front + (wp.float64(1.0) - front[3]) * back


@cache
def make_sum(real, doubled):
    """How a march composes its segments: ``Sum``, which begins with nothing; ``add(sum, segment)``, of a segment in any
    precision behind it; ``opacity(sum)``, a ``number``; and ``total(sum)`` in float64. Sums are ``doubled`` or else of
    ``real`` and compensated: transparency comes of the sum itself, each part is rounded in parts of itself, and what
    adding it leaves out (Knuth's sum of two) waits for the next.
    """
    if doubled or real is wp.float64:

        @wp.func
        def add(sum: wp.vec4d, segment: Any):
            return over(sum, widened(segment))

        @wp.func
        def opacity(sum: wp.vec4d):
            return sum[3]

        @wp.func
        def total(sum: wp.vec4d):
            return sum

        return wp.vec4d, add, opacity, total, wp.float64

    vec4 = vec4_of(real)

    @wp.struct
    class Sum:
        whole: vec4
        rest: vec4

    @wp.func
    def add(sum: Sum, segment: Any):
        through = (real(1.0) - sum.whole[3]) - sum.rest[3]
        part = through * vec4(segment) + sum.rest
        result = Sum()
        result.whole = sum.whole + part
        added = result.whole - sum.whole
        result.rest = (sum.whole - (result.whole - added)) + (part - added)
        return result

    @wp.func
    def opacity(sum: Sum):
        return sum.whole[3]

    @wp.func
    def total(sum: Sum):
        return widened(sum.whole) + widened(sum.rest)

    return Sum, add, opacity, total, real


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
