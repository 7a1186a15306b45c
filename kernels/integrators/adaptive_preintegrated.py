"""Adaptive pre-integration (Roettger et al. 2003, section 4): each cube of cells says how long a segment in it may be.

A ray crosses a cube in equal steps, as few as the cube's sampling distance allows, so that no step reaches into a cube
with a shorter one. Blocks without any extinction are leapt over (space leaping), which leaves out the steps up to the
first block in a cube with any.
A step's error counts by the transparency in front of it, so distances grow as a ray becomes opaque: with its cube root,
because the error may grow with the cube of the step.

Segments have their own length: a 2D table says their mean extinction, which makes opacity exact, and the mean emission,
which is exact for the shortest steps and right to first order for longer ones. They are lit by the mean of the light
at their ends, with the coefficients of their middle.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.bends import CUBE
from ..field.blocks import BITS, EMPTY
from ..field.walk import MARGIN, make_reached, make_walk, make_within
from ..light.points import intensity_of, make_shading
from ..precision import vec3_of, vec4_of
from ..segment import make_absorbed, over, widened
from ..transfer.function import make_transfer
from ..transfer.lookup import make_table
from .steps import Step

# Segments of which the field is sampled before any is composited: independent loads, which a CPU core overlaps.
PACKET = 4


@wp.struct
class Stretchable:
    shortest: wp.float64  # [smallest voxel spacing]
    tolerance: wp.float64  # of a step
    distance: wp.array3d(dtype=wp.float32)  # [z, y, x] of cubes: how long a step may be, as of ``bends``


@dataclass(frozen=True)
class Half:
    """The device half of adaptive pre-integration."""

    bounded = False
    tabled = True

    def Struct(self, halves):
        return Stretchable

    def march(self, halves):
        return make_adaptive_preintegrated(halves)


@cache
def make_adaptive_preintegrated(halves):
    """The march, as of ``scene``; what it counts are segments. One that is traced writes down its steps."""
    real = halves.real
    finite = halves.field.finite
    traced = halves.traced
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    packet = wp.types.vector(PACKET, real)
    Scene = halves.Scene
    value = halves.field.value(real)
    _, lookup = make_table(real)
    absorbed, _ = make_absorbed(real)
    Walk, enter, leap, _ = make_walk(real)
    reached = make_reached(real)
    within = make_within(real)
    lighted = halves.light is not None
    _, interval, _ = make_transfer(real)
    Intensity = intensity_of(real)
    eye_of, gradient, light, lit, _ = make_shading(halves)

    @wp.func
    def segment(q: vec4, h: real):
        """What a segment of length h contributes, of mean emission and extinction q."""
        if q[3] > real(0.0):
            A = absorbed(q[3] * h)
            q *= A / q[3]
            q[3] = A
        return widened(q)

    @wp.func
    def brightened(scene: Scene, q: vec4, s: real, I: Intensity):
        """Mean emission lit."""
        color = q / q[3]
        color[3] = real(1.0)
        return q[3] * lit(scene, color, interval(scene.transfer, s), s, I)

    @wp.func
    def entered(w: Walk):
        """Where the ray entered the cube that it is in, or began in it."""
        t = real(0.0)
        for a in range(3):
            edge = w.cell[a] >> CUBE
            face = wp.where(w.inverse[a] > real(0.0), edge, edge + 1) << CUBE
            # Along an axis without faces to cross it is far ahead.
            at = reached(real(face), w.anchor[a], w.inverse[a])
            t = wp.where(at <= w.t and at > t, at, t)
        return t

    @wp.func
    def march(scene: Scene, first: wp.vec3d, along: wp.vec3d, begin: wp.float64, end: wp.float64):
        # Along the stretch in the march's own precision, from where it begins.
        origin = vec3(first + begin * along)
        direction = vec3(along)
        length = real(end - begin)
        ray = wp.vec4d()
        count = int(0)
        front = real(0.0)
        known = bool(False)  # the scalar at t
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        start = Intensity()  # what light does at ``shone``
        shone = real(-1.0)
        w = enter(scene.field.last, origin, direction, real(0.0))
        while w.t < length and ray[3] <= scene.opaque:
            come = w.t
            t = come
            i = wp.max(w.cell[0], 0)
            j = wp.max(w.cell[1], 0)
            k = wp.max(w.cell[2], 0)
            kind = int(scene.blocks.kinds[k >> BITS, j >> BITS, i >> BITS])
            visible = kind > EMPTY
            if visible:
                t = entered(w)
            w = leap(w, wp.where(visible, CUBE, BITS), wp.max(EMPTY - kind, 0))
            # The outermost blocks end with the box.
            w.t = wp.where(w.t >= w.out, length, wp.min(w.t, length))
            visible = visible and w.t > come
            if visible:
                fade = wp.pow(wp.max(wp.float64(1.0) - ray[3], wp.float64(1.0e-9)), wp.float64(wp.static(-1.0 / 3.0)))
                distance = wp.float64(scene.march.distance[k >> CUBE, j >> CUBE, i >> CUBE]) * fade
                steps = wp.max(int(wp.ceil((w.t - t) / real(wp.max(distance, scene.march.shortest)))), 1)
                h = (w.t - t) / real(steps)
                skipped = wp.max(int((come - t) / h - real(wp.static(MARGIN))), 0)
                if not known or skipped > 0:
                    front = value(scene.field, origin + (t + real(skipped) * h) * direction)
                n = int(skipped)
                while n < steps and ray[3] <= scene.opaque:
                    s = packet()
                    for l in range(wp.static(PACKET)):
                        if n + l < steps:
                            p = origin + (t + real(n + l + 1) * h) * direction
                            if n + l + 1 == steps:
                                p = within(scene.field.last, p)
                            s[l] = value(scene.field, p)
                    for l in range(wp.static(PACKET)):
                        if n + l < steps:
                            if wp.static(finite) or (wp.isfinite(front) and wp.isfinite(s[l])):
                                q = lookup(scene.table, front, s[l])
                                if wp.static(lighted):
                                    if q[3] > real(0.0):
                                        here = t + real(n + l) * h
                                        if shone != here:
                                            p = origin + here * direction
                                            start = light(scene, p, gradient(scene, p), eye)
                                        shone = t + real(n + l + 1) * h
                                        p = origin + shone * direction
                                        stop = light(scene, p, gradient(scene, p), eye)
                                        q = brightened(scene, q, real(0.5) * (front + s[l]), real(0.5) * (start + stop))
                                        start = stop
                                ray = over(ray, segment(q, h))
                            front = s[l]
                            if wp.static(traced):
                                at = begin + wp.float64(t + real(n + l) * h)
                                record(scene, count + n - skipped + l, at, h, distance, ray)
                    n += wp.static(PACKET)
                count += wp.min(n, steps) - skipped
                known = True
            elif w.t > come:
                known = False
        return ray, count, wp.float64(0.0)

    @wp.func
    def record(scene: Scene, taken: int, t: wp.float64, h: real, distance: wp.float64, ray: wp.vec4d):
        """Write down a step. Its error is at most a h^2 + b h^3, which is the tolerance where h is the distance."""
        if scene.trace.taken + taken < scene.trace.steps.shape[0]:
            step = Step()
            step.t = t
            step.length = wp.float64(h)
            step.tolerance = scene.march.tolerance
            share = step.length / wp.max(distance, wp.float64(1.0e-30))
            step.depth_error = step.tolerance * share * share * wp.max(share, wp.float64(1.0))
            step.error = step.depth_error
            step.forced = share > wp.float64(1.000001)
            step.rgba = over(scene.trace.front, ray)
            scene.trace.steps[scene.trace.taken + taken] = step

    return march
