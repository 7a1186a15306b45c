"""The transfer function on the device: piecewise linear colour and extinction, exact between arbitrary knots.

The n knots cut the scalars into n + 1 intervals, the outer two constant. Equal bins over the knots' range say which
intervals reach into a bin; a bisection among those, mostly of length one, finds the interval. No resampling: a spike
of any width is there.
"""

from functools import cache

import warp as wp

from ..precision import vec3_of, vec4_of


@cache
def make_transfer(real):
    """The struct, ``interval(tf, s)`` -> index, and ``classify(tf, s)`` -> (r, g, b, extinction) at scalar ``s``."""
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)

    @wp.struct
    class Transfer:
        knot: wp.array(dtype=real)  # (n + 1,) where interval k begins; that of interval 0 is never compared
        value: wp.array(dtype=vec4)  # (n + 1,) (r, g, b, extinction) at the knot
        slope: wp.array(dtype=vec4)  # (n + 1,) its slope in the interval
        factor: wp.array(dtype=vec3)  # (n + 1,) ambient, diffuse, specular coefficient at the knot, if there are any
        factor_slope: wp.array(dtype=vec3)
        visible: wp.array(dtype=int)  # (n + 1,) first interval from k on with any extinction, n + 1 if there is none
        bins: wp.array(dtype=wp.vec2i)  # first interval that reaches into the bin, and one past the last
        low: real  # the bins' origin
        scale: real  # bins per scalar

    @wp.func
    def interval(tf: Transfer, s: real):
        last = real(tf.bins.shape[0] - 1)
        span = tf.bins[wp.max(int(wp.clamp((s - tf.low) * tf.scale, real(0.0), last)), 0)]
        k = span[0]
        end = span[1]
        while end - k > 1:
            middle = (k + end) >> 1
            if s >= tf.knot[middle]:
                k = middle
            else:
                end = middle
        return wp.max(k, 0)

    @wp.func
    def classify(tf: Transfer, s: real):
        k = interval(tf, s)
        return tf.value[k] + (s - tf.knot[k]) * tf.slope[k]

    return Transfer, interval, classify


@cache
def make_transparent(real):
    """``nothing(tf, first, end, high)``: whether there is no extinction from interval ``first`` to scalar ``high`` in
    interval ``end``; ``transparent(tf, low, high)``: whether there is none at any scalar in [low, high].
    """
    Transfer, interval, _ = make_transfer(real)

    @wp.func
    def nothing(tf: Transfer, first: int, end: int, high: real):
        # Of an interval that is only touched where it begins, nothing else counts.
        if end > 0 and high == tf.knot[end] and tf.value[end][3] == real(0.0):
            end -= 1
        return tf.visible[first] > end

    @wp.func
    def transparent(tf: Transfer, low: real, high: real):
        return nothing(tf, interval(tf, low), interval(tf, high), high)

    return nothing, transparent


@cache
def make_visible():
    """``visible(tf, low, high)`` -> (first, last): of scalars from low to high, those up to first have no extinction,
    nor have those from last on.
    """
    Transfer, interval, _ = make_transfer(wp.float64)

    @wp.func
    def visible(tf: Transfer, low: wp.float64, high: wp.float64):
        first = -wp.float64(wp.inf)
        last = wp.float64(wp.inf)
        begin = interval(tf, low)
        end = interval(tf, high)
        k = tf.visible[begin]
        if k > begin:
            first = tf.knot[k]
            if tf.knot[wp.min(k + 1, tf.knot.shape[0] - 1)] == first:
                # A jump, whose upper value holds at the knot itself: all that is less has none.
                first -= wp.float64(wp.static(2.0**-52)) * wp.abs(first) + wp.float64(wp.static(2.0**-1022))
        k = end
        while k > begin and tf.visible[k] != k:
            k -= 1
        if k < end:
            last = tf.knot[k + 1]
        return first, last

    return visible
