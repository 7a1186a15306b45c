"""Adaptive pre-integration (Roettger et al. 2003, section 4): the importance volume says how long a segment may be.

A ray goes from block to block. Blocks without any extinction are left at once (space leaping); the others are crossed
in equal steps, as few as the block's sampling distance allows, so that no step reaches into a block with a shorter one.
A step's error counts by the transparency in front of it, so distances grow as a ray becomes opaque: with its cube root,
because the error may grow with the cube of the step.

Segments have their own length: a 2D table says their mean extinction, which makes opacity exact, and the mean emission,
which is exact for the shortest steps and right to first order for longer ones. They are lit by the mean of the light
at their ends, with the coefficients of their middle.
"""

from functools import cache

import warp as wp

from .field import make_field
from .importance import BLOCK, make_leave
from .precision import REALS, vec3_of, vec4_of
from .scene import Step, make_scene
from .segment import make_absorbed, over, widened
from .shading import intensity_of, make_shading
from .table import make_table
from .transfer import make_transfer

# Segments of which the field is sampled before any is composited: independent loads, which a CPU core overlaps.
PACKET = 4


@cache
def make_adaptive_preintegrated(variant):
    """``march(scene, origin, direction, length)`` -> composite of the ray, and the number of its segments.

    A ``variant.traced`` march writes the steps it takes to ``scene.trace``.
    """
    real = REALS[variant.precision]
    finite = variant.finite
    skip = variant.skip
    traced = variant.traced
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    packet = wp.types.vector(PACKET, real)
    Scene = make_scene(variant)
    _, value = make_field(variant.dtype, real)
    _, lookup = make_table(real)
    absorbed, _ = make_absorbed(real)
    leave = make_leave(real)
    lighted = variant.lit != ""
    _, interval, _ = make_transfer(real)
    Intensity = intensity_of(real)
    eye_of, gradient, light, lit, _ = make_shading(variant)

    @wp.func
    def segment(scene: Scene, q: vec4, h: real):
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
    def march(scene: Scene, origin: vec3, direction: vec3, length: real):
        ray = wp.vec4d()
        count = int(0)
        last = scene.field.last
        block = wp.vec3i()
        for a in range(3):
            block[a] = wp.min(wp.max(int(origin[a]), 0), last[a]) // BLOCK
        t = real(0.0)
        front = real(0.0)
        known = bool(False)  # the scalar at t
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        start = Intensity()  # what light does at ``shone``
        shone = real(-1.0)
        while t < length and ray[3] <= scene.steps.opaque:
            end, axis = leave(last, origin, direction, block, length)
            visible = bool(end > t)
            if wp.static(skip):
                visible = visible and scene.empty[block[2], block[1], block[0]] == wp.uint8(0)
            if visible:
                if not known:
                    front = value(scene.field, origin + t * direction)
                fade = wp.pow(wp.max(wp.float64(1.0) - ray[3], wp.float64(1.0e-9)), wp.float64(wp.static(-1.0 / 3.0)))
                distance = wp.float64(scene.distance[block[2], block[1], block[0]]) * fade
                steps = wp.max(int(wp.ceil((end - t) / real(wp.max(distance, scene.steps.shortest)))), 1)
                h = (end - t) / real(steps)
                i = int(0)
                while i < steps and ray[3] <= scene.steps.opaque:
                    s = packet()
                    for l in range(wp.static(PACKET)):
                        if i + l < steps:
                            s[l] = value(scene.field, origin + (t + real(i + l + 1) * h) * direction)
                    for l in range(wp.static(PACKET)):
                        if i + l < steps:
                            if wp.static(finite) or (wp.isfinite(front) and wp.isfinite(s[l])):
                                q = lookup(scene.table, front, s[l])
                                if wp.static(lighted):
                                    if q[3] > real(0.0):
                                        here = t + real(i + l) * h
                                        if shone != here:
                                            start = light(scene, gradient(scene, origin + here * direction), eye)
                                        shone = t + real(i + l + 1) * h
                                        stop = light(scene, gradient(scene, origin + shone * direction), eye)
                                        q = brightened(scene, q, real(0.5) * (front + s[l]), real(0.5) * (start + stop))
                                        start = stop
                                ray = over(ray, segment(scene, q, h))
                            front = s[l]
                            if wp.static(traced):
                                record(scene, count + i + l, t + real(i + l) * h, h, distance, ray)
                    i += wp.static(PACKET)
                count += wp.min(i, steps)
                known = True
            elif end > t:
                known = False
            t = wp.max(t, end)
            block[axis] += wp.where(direction[axis] > real(0.0), 1, -1)
        return ray, count

    @wp.func
    def record(scene: Scene, taken: int, t: real, h: real, distance: wp.float64, ray: wp.vec4d):
        """Write down a step. Its error is at most a h^2 + b h^3, which is the tolerance where h is the distance."""
        if scene.taken + taken < scene.trace.shape[0]:
            step = Step()
            step.t = scene.start + wp.float64(t)
            step.length = wp.float64(h)
            step.tolerance = scene.steps.tolerance
            share = step.length / wp.max(distance, wp.float64(1.0e-30))
            step.depth_error = step.tolerance * share * share * wp.max(share, wp.float64(1.0))
            step.error = step.depth_error
            step.forced = share > wp.float64(1.000001)
            step.rgba = over(scene.front, ray)
            scene.trace[scene.taken + taken] = step

    return march
