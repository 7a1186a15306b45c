"""The uniform walk: segments of one length from the entry point, with an exact last partial step.

The rules say what a segment [a, a + h] contributes: constant colour and extinction sampled at its start ("left") or
middle ("midpoint"), the mean extinction and emission of its ends ("trapezoid"), Simpson's rule for the depth and for
the colour that is seen ("simpson"), or the table entry of the scalars at its ends ("preintegrated").
Segments that lie in blocks without any extinction are leapt over; the others stay where they are.
"""

from functools import cache

import warp as wp

from .clip import make_shown
from .field import make_field
from .importance import MARGIN, make_leap
from .lit import make_lit
from .partial import make_partial
from .precision import REALS, vec3_of, vec4_of
from .scene import make_scene
from .segment import make_interval, make_opacities, over, widened
from .shading import intensity_of, make_point, make_shading
from .table import make_table
from .transfer import make_transfer

# A ray advances this many segments at a time, each phase for all of them: independent work that a CPU core overlaps.
PACKET = 4


@cache
def make_linear_segment(real):
    """``linear_segment(tf, nodes, front, back, length)`` -> vec4d: the scalar runs linearly from front to back.

    Exact for any length: composed of the stretches between the transfer function's knots.
    """
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2
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


@cache
def make_uniform(variant):
    """``march(scene, origin, direction, length)`` -> composite of the ray, and the number of its segments."""
    real = REALS[variant.precision]
    rule = variant.rule
    finite = variant.finite
    skip = variant.skip
    ends = rule in ("trapezoid", "simpson", "preintegrated")  # the rule needs the scalar at both ends of a segment
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    packet = wp.types.vector(PACKET, real)
    Scene = make_scene(variant)
    _, value = make_field(variant.dtype, real)
    _, lookup = make_table(real)
    lighted = variant.lit != ""
    Intensity = intensity_of(real)
    eye_of, _, _, _, _ = make_shading(variant)
    seen = make_point(variant)
    light_ends, absorbs, lit_segment = make_lit(variant)
    opacities = make_opacities(real, PACKET)
    linear_segment = make_linear_segment(real)
    leap = make_leap(real)
    shown = make_shown(variant.clips or wp.uint8)
    partial = make_partial(variant, linear_segment)

    @wp.func
    def place(origin: vec3, direction: vec3, t: real):
        """A point of the ray."""
        p = origin + t * direction
        return wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))

    @wp.func
    def drawn(scene: Scene, origin: vec3, direction: vec3, t: real):
        """Whether naive clips leave the sample at t."""
        if wp.static(variant.naive):
            return shown(scene.clipping, place(origin, direction, t))
        return True

    @wp.func
    def present(s: real):
        """Whether there is data: a NaN or infinite sample makes its cells absent."""
        if wp.static(finite):
            return True
        return wp.isfinite(s)

    @wp.func
    def sampled(
        scene: Scene,
        origin: vec3,
        direction: vec3,
        eye: vec3,
        a: real,
        h: real,
        front: real,
        middle: real,
        s: real,
    ):
        """Colour and extinction that a rule gives the segment [a, a + h], from the scalars that it uses."""
        half = real(0.5) * h
        if wp.static(rule == "simpson"):
            qf = seen(scene, front, origin, direction, a, eye)
            qm = seen(scene, middle, origin, direction, a + half, eye)
            qb = seen(scene, s, origin, direction, a + h, eye)
            tau = (qf[3] + real(4.0) * qm[3] + qb[3]) * real(wp.static(1.0 / 6.0))
            # Half the depth will do for that to the middle: what it is off by, O(h^2), multiplies how far the middle's
            # colour is from the mean, also O(h^2).
            through = wp.exp(real(-0.5) * tau * h)
            wm = real(4.0) * qm[3] * through
            wb = qb[3] * through * through
            total = qf[3] + wm + wb
            q = vec4()
            if total > real(0.0):
                q = (qf[3] * qf + wm * qm + wb * qb) / total
                q[3] = tau
            return q
        elif wp.static(rule == "trapezoid"):
            qf = seen(scene, front, origin, direction, a, eye)
            qb = seen(scene, s, origin, direction, a + h, eye)
            tau = qf[3] + qb[3]
            q = vec4()
            if tau > real(0.0):
                q = (qf[3] * qf + qb[3] * qb) / tau
                q[3] = real(0.5) * tau
            return q
        elif wp.static(rule == "left"):
            return seen(scene, s, origin, direction, a, eye)
        else:
            return seen(scene, s, origin, direction, a + half, eye)

    @wp.func
    def ahead_of(scene: Scene, origin: vec3, direction: vec3, length: real, step: real, i: int):
        """The first segment that does not end in the row of empty blocks where segment ``i`` begins."""
        end = leap(scene.empty, scene.field.last, origin, direction, real(i) * step, length)
        if end >= length:
            return int(wp.ceil(length / step))
        return int((end - real(wp.static(MARGIN))) / step)

    @wp.func
    def march(scene: Scene, origin: vec3, direction: vec3, length: real):
        """Composite of the ray, and the number of its segments."""
        step = real(scene.steps.step)
        ray = wp.vec4d()
        count = int(wp.ceil(length / step))
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        front = real(0.0)
        if wp.static(ends):
            front = value(scene.field, origin)
        i = int(0)
        evaluated = int(0)
        # What light does where segment ``shone`` starts.
        start = Intensity()
        shone = int(-1)
        # Only where the last packet was transparent is it worth asking whether the block is.
        idle = bool(True)
        while i < count and ray[3] <= scene.steps.opaque:
            if wp.static(skip):
                if idle:
                    ahead = ahead_of(scene, origin, direction, length, step, i)
                    if ahead > i:
                        i = ahead
                        if wp.static(ends):
                            front = value(scene.field, origin + wp.min(real(i) * step, length) * direction)
                        continue
            before = ray[3]
            s = packet()
            middle = packet()
            for l in range(wp.static(PACKET)):
                a = wp.min(real(i + l) * step, length)
                b = wp.min(real(i + l + 1) * step, length)
                if wp.static(rule == "left"):
                    b = a
                elif wp.static(rule == "midpoint"):
                    b = real(0.5) * (a + b)
                s[l] = value(scene.field, origin + b * direction)
                if wp.static(rule == "simpson"):
                    middle[l] = value(scene.field, origin + real(0.5) * (a + b) * direction)
            if wp.static(rule == "preintegrated"):
                for l in range(wp.static(PACKET)):
                    # The last step is what is left of the ray; lanes beyond have no length.
                    h = wp.clamp(length - real(i + l) * step, real(0.0), step)
                    a = wp.min(real(i + l) * step, length)
                    if h > real(0.0) and present(front) and present(s[l]) and drawn(scene, origin, direction, a):
                        if wp.static(lighted):
                            if absorbs(scene, front, s[l]):
                                if shone != i + l:
                                    start = light_ends(scene, origin, direction, a, eye)
                                stop = light_ends(scene, origin, direction, a + h, eye)
                                whole = i + l < count - 1
                                segment = lit_segment(
                                    scene, origin, direction, eye, a, h, whole, front, s[l], start, stop
                                )
                                ray = over(ray, segment)
                                start = stop
                                shone = i + l + 1
                        elif wp.static(variant.parts is not None):
                            p = place(origin, direction, a)
                            q = place(origin, direction, a + h)
                            ray = over(ray, partial(scene, p, q, front, s[l], h))
                        elif i + l < count - 1:
                            ray = over(ray, widened(lookup(scene.table, front, s[l])))
                        else:
                            ray = over(ray, linear_segment(scene.transfer, scene.nodes, front, s[l], h))
                    front = s[l]
            else:
                red = packet()
                green = packet()
                blue = packet()
                depth = packet()
                for l in range(wp.static(PACKET)):
                    h = wp.clamp(length - real(i + l) * step, real(0.0), step)
                    a = wp.min(real(i + l) * step, length)
                    at = a
                    if wp.static(rule == "midpoint"):
                        at += real(0.5) * h
                    if present(front) and present(middle[l]) and present(s[l]) and drawn(scene, origin, direction, at):
                        q = sampled(scene, origin, direction, eye, a, h, front, middle[l], s[l])
                        red[l] = q[0]
                        green[l] = q[1]
                        blue[l] = q[2]
                        depth[l] = wp.max(q[3], real(0.0)) * h
                    if wp.static(ends):
                        front = s[l]
                if wp.max(depth) > real(0.0):
                    A = opacities(depth)
                    for l in range(wp.static(PACKET)):
                        ray = over(ray, widened(vec4(A[l] * red[l], A[l] * green[l], A[l] * blue[l], A[l])))
            idle = ray[3] == before
            evaluated += wp.min(count - i, wp.static(PACKET))
            i += wp.static(PACKET)
        return ray, evaluated

    return march
