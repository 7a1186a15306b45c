"""Adaptive Simpson's rule for both integrals of a ray: Algorithms 2 and 3 of Campagnolo, Celes and de Figueiredo,
"Accurate Volume Rendering based on Adaptive Numerical Integration" (SIBGRAPI 2015).

A step is sampled at its quarters. With S Simpson's rule over it and D over its halves, E = |D - S| / 15 decides whether
it is taken, halved, or, after a second success, followed by a doubled one; what counts is D + (D - S) / 15, signed.
The inner integral, optical depth, goes first; the interval it settles on is then covered by the outer one, of colour
and opacity together, unless nothing absorbs in it. The tolerance of a step is proportional to its length, so what is
compared is the error per length.

Beyond the paper: t advances (Algorithm 3 leaves that out); an error of optical depth counts by the transparency in
front of it, as one of colour does, which is what it does to the image; samples of the second half of a halved step are
used again; a step that the end of its interval cuts short tells nothing about the next one's length; and a step's four
channels are scaled to the opacity that its optical depth has, which keeps them in range however dense a forced step is.
Blocks without any extinction are leapt over.

Known wrong case: what lies between all five samples of a step is not seen, whatever the tolerance.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.walk import MARGIN, make_walk, make_within
from ..light.points import make_point, make_shading
from ..precision import vec3_of, vec4_of
from ..segment import make_opacities, over, widened
from .steps import Step


@wp.struct
class Adaptive:
    """Lengths in units of the smallest voxel spacing."""

    step: wp.float64  # the first
    shortest: wp.float64
    longest: wp.float64
    tolerance: wp.float64
    scope: wp.float64  # length that the tolerance belongs to; 0 is the ray's own


@dataclass(frozen=True)
class Half:
    """The device half of adaptive Simpson integration."""

    coupled: bool
    bounded = False
    tabled = False

    def Struct(self, halves):
        return Adaptive

    def march(self, halves):
        return make_adaptive(halves)


@cache
def make_adaptive(halves):
    """The march, as of ``scene``; what it counts are field evaluations. One that is traced writes down its steps."""
    real = halves.real
    coupled = halves.march.coupled
    finite = halves.field.finite
    traced = halves.traced
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Scene = halves.Scene
    value = halves.field.value(real)
    lighted = halves.light is not None
    eye_of = make_shading(halves).eye
    seen = make_point(halves)
    opacities = make_opacities(real, 4)
    _, enter, _, skip = make_walk(real)
    within = make_within(real)

    @wp.func
    def emitted(scene: Scene, s: real, origin: vec3, direction: vec3, t: real, eye: vec3):
        """Emission and extinction; nothing where a NaN or infinite sample makes data absent."""
        if not wp.static(finite):
            if not wp.isfinite(s):
                return vec4()
        q = seen(scene, s, origin, direction, t, eye)
        tau = wp.max(q[3], real(0.0))
        return vec4(tau * q[0], tau * q[1], tau * q[2], tau)

    @wp.func
    def sampled(
        scene: Scene, start: vec3, direction: vec3, eye: vec3, step: wp.float64, known: bool, q2: vec4, q4: vec4
    ):
        """Samples at the ends of the quarters of a step from a point; ``known``: the second and the last are given."""
        part = real(wp.float64(0.25) * step)
        quarter = part * direction
        # The field before the transfer function: independent loads, which a CPU core overlaps.
        s1 = value(scene.field, start + quarter)
        s3 = value(scene.field, start + real(3.0) * quarter)
        if not known:
            s2 = value(scene.field, start + real(2.0) * quarter)
            s4 = value(scene.field, within(scene.field.last, start + real(4.0) * quarter))
            q2 = emitted(scene, s2, start, direction, real(2.0) * part, eye)
            q4 = emitted(scene, s4, start, direction, real(4.0) * part, eye)
        q1 = emitted(scene, s1, start, direction, part, eye)
        q3 = emitted(scene, s3, start, direction, real(3.0) * part, eye)
        return q1, q2, q3, q4

    @wp.func
    def mean(q0: vec4, q1: vec4, q2: vec4, q3: vec4, q4: vec4):
        """D + (D - S) / 15 per length."""
        return (
            real(wp.static(7.0 / 90.0)) * (q0 + q4)
            + real(wp.static(32.0 / 90.0)) * (q1 + q3)
            + real(wp.static(12.0 / 90.0)) * q2
        )

    @wp.func
    def error(q0: vec4, q1: vec4, q2: vec4, q3: vec4, q4: vec4):
        """|D - S| / 15 per length, of each channel."""
        return real(wp.static(1.0 / 180.0)) * wp.abs(real(4.0) * (q1 + q3) - real(6.0) * q2 - (q0 + q4))

    @wp.func
    def contribution(q0: vec4, q1: vec4, q2: vec4, q3: vec4, q4: vec4, step: real):
        """Colour and opacity of a step, and the largest error of a channel per length."""
        # Depths up to the samples, by Simpson's rule: at the quarters the areas under its own parabolas.
        x = vec4()
        x[1] = step * real(wp.static(1.0 / 12.0)) * (q0[3] + real(4.0) * q1[3] + q2[3])
        x[0] = step * real(wp.static(1.0 / 48.0)) * (real(5.0) * q0[3] + real(8.0) * q1[3] - q2[3])
        x[2] = x[1] + step * real(wp.static(1.0 / 48.0)) * (real(5.0) * q2[3] + real(8.0) * q3[3] - q4[3])
        x[0] = wp.max(x[0], real(0.0))
        x[2] = wp.max(x[2], real(0.0))
        plain = mean(q0, q1, q2, q3, q4)
        x[3] = step * plain[3]
        A = opacities(x)
        f1 = (real(1.0) - A[0]) * q1
        f2 = (real(1.0) - A[1]) * q2
        f3 = (real(1.0) - A[2]) * q3
        f4 = (real(1.0) - A[3]) * q4
        seen = mean(q0, f1, f2, f3, f4)
        if step * seen[3] < real(0.5) * A[3]:
            # Too dense for the exponential to be resolved: emission counts by extinction alone.
            seen = plain
        segment = vec4()
        if A[3] > real(0.0):
            segment = seen * (A[3] / seen[3])
            segment[3] = A[3]
        return widened(segment), wp.float64(wp.max(error(q0, f1, f2, f3, f4)))

    @wp.func
    def fitted(step: wp.float64, rest: wp.float64):
        """``step``, but all that is left where that is less, or more by mere rounding."""
        return wp.where(rest < step * wp.float64(1.000001), rest, step)

    @wp.func
    def grown(scene: Scene, step: wp.float64, succeeded: bool):
        """The step after one that was taken."""
        return wp.where(succeeded, wp.min(wp.float64(2.0) * step, scene.march.longest), step)

    @wp.func
    def march(scene: Scene, first: wp.vec3d, along: wp.vec3d, begin: wp.float64, finish: wp.float64):
        # Along the stretch in the march's own precision, from where it begins.
        origin = vec3(first + begin * along)
        direction = vec3(along)
        length = real(finish - begin)
        end = wp.float64(length)
        scope = scene.march.scope
        if scope == wp.float64(0.0):
            scope = wp.where(scene.whole > wp.float64(0.0), scene.whole, end)
        tolerance = scene.march.tolerance / scope
        # Steps that rounding lets exceed the shortest are not halved.
        shortest = scene.march.shortest * wp.float64(1.00001)
        ray = wp.vec4d()
        inner = scene.march.step
        outer = scene.march.step
        inner_succeeded = bool(True)
        outer_succeeded = bool(True)
        taken = int(0)
        t = wp.float64(0.0)
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        q0 = emitted(scene, value(scene.field, origin), origin, direction, real(0.0), eye)
        q1 = vec4()
        q2 = vec4()
        q3 = vec4()
        q4 = vec4()
        count = int(1)
        # Where the second half of the step that was halved last begins, its length, and two of its samples.
        other_t = wp.float64(-1.0)
        other_step = wp.float64(0.0)
        other_q2 = vec4()
        other_q4 = vec4()
        # Only where nothing absorbed is it worth asking whether the block is empty.
        idle = bool(True)
        while t < end and ray[3] <= scene.opaque:
            if idle:
                ahead = skip(scene.blocks.kinds, enter(scene.field.last, origin, direction, real(t)), length).t
                if ahead >= length:
                    t = end
                elif ahead > real(t) + real(wp.static(2.0 * MARGIN)):
                    t = wp.float64(ahead - real(wp.static(MARGIN)))
                    q0 = vec4()
                idle = False
                continue
            # The inner integral: as far as optical depth is within tolerance.
            step = fitted(inner, end - t)
            cut = step != inner
            known = t == other_t and step == other_step
            if known:
                q2 = other_q2
                q4 = other_q4
            depth_error = wp.float64(0.0)
            attempt = bool(True)
            while attempt:
                q1, q2, q3, q4 = sampled(scene, origin + real(t) * direction, direction, eye, step, known, q2, q4)
                count += wp.where(known, 2, 4)
                # What is behind the ray's opacity counts for less.
                depth_error = (wp.float64(1.0) - ray[3]) * wp.float64(error(q0, q1, q2, q3, q4)[3])
                attempt = depth_error > tolerance and step > shortest
                if attempt:
                    other_step = wp.float64(0.5) * step
                    other_t = t + other_step
                    other_q2 = q3
                    other_q4 = q4
                    known = other_step >= scene.march.shortest
                    step = wp.max(other_step, scene.march.shortest)
                    q4 = q2
                    q2 = q1
                    inner = step
                    inner_succeeded = False
                    cut = False
            if not cut:
                inner = grown(scene, inner, inner_succeeded)
            inner_succeeded = True
            stop = t + step
            if step >= end - t:
                stop = end
            if q0[3] + q1[3] + q2[3] + q3[3] + q4[3] == real(0.0):
                if wp.static(traced):
                    errors = wp.vec3d(tolerance, depth_error, wp.float64(0.0))
                    record(scene, taken, begin + t, step, errors, ray)
                    taken += 1
                t = stop
                q0 = q4
                idle = True
                continue
            # The outer integral over what the inner one settled on, whose samples are those of a step as long.
            rest = step
            if wp.static(coupled):
                outer = step
                outer_succeeded = bool(True)
            step = fitted(outer, rest)
            fresh = step == rest
            known = bool(False)
            while rest > wp.float64(0.0):
                if not fresh:
                    q1, q2, q3, q4 = sampled(scene, origin + real(t) * direction, direction, eye, step, known, q2, q4)
                    count += wp.where(known, 2, 4)
                fresh = False
                segment, outer_error = contribution(q0, q1, q2, q3, q4, real(step))
                outer_error *= wp.float64(1.0) - ray[3]
                if outer_error > tolerance and step > shortest:
                    other_step = wp.float64(0.5) * step
                    other_t = t + other_step
                    other_q2 = q3
                    other_q4 = q4
                    known = other_step >= scene.march.shortest
                    step = wp.max(other_step, scene.march.shortest)
                    q4 = q2
                    q2 = q1
                    outer = step
                    outer_succeeded = False
                else:
                    ray = over(ray, segment)
                    if wp.static(traced):
                        errors = wp.vec3d(tolerance, depth_error, outer_error)
                        record(scene, taken, begin + t, step, errors, ray)
                        taken += 1
                    if step == outer:
                        outer = grown(scene, outer, outer_succeeded)
                    outer_succeeded = True
                    t += step
                    rest -= step
                    q0 = q4
                    step = fitted(outer, rest)
                    known = t == other_t and step == other_step
                    if known:
                        q2 = other_q2
                        q4 = other_q4
            t = stop
        return ray, count, wp.float64(0.0)

    @wp.func
    def record(scene: Scene, taken: int, t: wp.float64, step: wp.float64, errors: wp.vec3d, ray: wp.vec4d):
        """Write down a step taken from ``t``; ``errors``, per length: tolerance, of depth, of the outer integral."""
        if scene.trace.taken + taken < scene.trace.steps.shape[0]:
            entry = Step()
            entry.t = t
            entry.length = step
            entry.tolerance = errors[0] * step
            entry.depth_error = errors[1] * step
            entry.error = errors[2] * step
            entry.forced = wp.max(errors[1], errors[2]) > errors[0]
            entry.rgba = over(scene.trace.front, ray)
            scene.trace.steps[scene.trace.taken + taken] = entry

    return march
