"""The transfer function on the device: piecewise linear colour and extinction, exact between arbitrary knots.

The n knots cut the scalars into n + 1 intervals, the outer two constant. Equal bins over the knots' range say which
intervals reach into a bin; a bisection among those, mostly of length one, finds the interval. No resampling: a spike
of any width is there.
"""

from functools import cache

import warp as wp

from .precision import vec3_of, vec4_of


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
    """``transparent(tf, low, high)``: whether there is no extinction at any scalar in [low, high]."""
    Transfer, interval, _ = make_transfer(real)

    @wp.func
    def transparent(tf: Transfer, low: real, high: real):
        end = interval(tf, high)
        # Of an interval that is only touched where it begins, nothing else counts.
        if end > 0 and high == tf.knot[end] and tf.value[end][3] == real(0.0):
            end -= 1
        return tf.visible[interval(tf, low)] > end

    return transparent
