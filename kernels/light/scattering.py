"""Single scattering by brute force: from every sample of a ray, rays towards the lights.

The light that arrives at a point is the mean over the directions of a cone about the light's, equally spread over its
solid angle, of what the volume lets through on the way to its edge. Depths are sums of the midpoint rule with an exact
last partial step, in float64. Rays towards a light leap over empty blocks and end where they are dark.
"""

from functools import cache

import warp as wp

from ..field.walk import make_unseen
from ..precision import vec3_of, vec4_of
from ..ray import entry, pixel, stopped
from ..segment import make_absorbed, over
from ..transfer.function import make_transfer
from .points import make_toward

# Optical depth at which a ray is dark: 1e-7 of the light is left, less than float32 can tell from none.
DARK = wp.constant(wp.float64(16.0))


@wp.func
def across(toward: wp.vec3d):
    """Two unit vectors that make a right-handed frame with the third, a unit vector."""
    # The axis that it is farthest from.
    axis = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    if wp.abs(toward[0]) > wp.abs(toward[1]) or wp.abs(toward[0]) > wp.abs(toward[2]):
        axis = wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
        if wp.abs(toward[1]) > wp.abs(toward[2]):
            axis = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    first = wp.normalize(wp.cross(axis, toward))
    return first, wp.cross(toward, first)


@cache
def make_scattering(halves):
    """Kernel ``(base, scene, cone, rgba, samples)`` over work items of ``ray.pixel``.

    ``cone`` holds unit vectors about z, of equal weight. ``samples`` counts field evaluations of the ray and of all
    rays from it towards the lights.
    """
    real = halves.real
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Scene = halves.Scene
    value = halves.field.value(real)
    _, _, classify = make_transfer(real)
    unseen = make_unseen(real)
    toward_of = make_toward(halves.light.kinds)
    absorbed, _ = make_absorbed(wp.float64)

    @wp.func
    def colored(scene: Scene, p: vec3):
        """Colour and extinction at index coordinates p; nothing where data are absent."""
        s = value(scene.field, p)
        if not wp.static(halves.field.finite):
            if not wp.isfinite(s):
                return vec4()
        return classify(scene.transfer, s)

    @wp.func
    def depth_of(scene: Scene, origin: vec3, direction: vec3):
        """Optical depth from a point to the edge of the volume, and the number of samples taken."""
        length = real(1.0e30)
        for a in range(3):
            if direction[a] > real(0.0):
                length = wp.min(length, (real(scene.view.high[a]) - origin[a]) / direction[a])
            elif direction[a] < real(0.0):
                length = wp.min(length, (real(scene.view.low[a]) - origin[a]) / direction[a])
        length = wp.max(length, real(0.0))
        step = real(scene.march.step)
        count = int(wp.ceil(length / step))
        depth = wp.float64(0.0)
        taken = int(0)
        i = int(0)
        idle = bool(True)
        while i < count and depth < DARK:
            if idle:
                ahead = unseen(scene.blocks.kinds, scene.field.last, origin, direction, length, step, i)
                if ahead > i:
                    i = ahead
                    continue
            t = real(i) * step
            h = wp.min(length - t, step)
            q = colored(scene, origin + (t + real(0.5) * h) * direction)
            depth += wp.float64(q[3] * h)
            idle = q[3] <= real(0.0)
            taken += 1
            i += 1
        return depth, taken

    @wp.func
    def arriving(scene: Scene, cone: wp.array(dtype=wp.vec3d), origin: vec3, eye: wp.vec3d):
        """Light that arrives at a point, of all lights, and the number of samples taken; ``eye`` to the viewer."""
        light = wp.vec3d()
        taken = int(0)
        for l in range(scene.light.lights.shape[0]):
            here = scene.light.lights[wp.max(l, 0)]
            place = scene.light.shading.home + scene.light.shading.ahead @ wp.vec3d(origin)
            toward = toward_of(here.kind, here.vector, place, eye)
            first, second = across(toward)
            through = wp.float64(0.0)
            for k in range(cone.shape[0]):
                c = cone[wp.max(k, 0)]
                world = c[0] * first + c[1] * second + c[2] * toward
                d = scene.view.unit * (scene.view.to_index @ world)
                depth, count = depth_of(scene, origin, vec3(d))
                if depth < DARK:
                    through += wp.exp(-depth)
                taken += count
            light += through / wp.float64(cone.shape[0]) * here.color
        return light, taken

    @wp.kernel(enable_backward=False, module="unique")
    def scattering(
        base: int,
        scene: Scene,
        cone: wp.array(dtype=wp.vec3d),
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
    ):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        point, along, inside, _first = entry(scene.view, x, y)
        eye = -wp.normalize(scene.light.shading.ahead @ along)
        origin = vec3(point)
        direction = vec3(along)
        length = real(inside)
        step = real(scene.march.step)
        count = int(wp.ceil(length / step))
        ray = wp.vec4d()
        taken = int(0)
        i = int(0)
        idle = bool(True)
        # A ray may take seconds, so that it does not wait for its end.
        while i < count and ray[3] <= scene.opaque and not stopped(scene.view):
            if idle:
                ahead = unseen(scene.blocks.kinds, scene.field.last, origin, direction, length, step, i)
                if ahead > i:
                    i = ahead
                    continue
            t = real(i) * step
            h = wp.min(length - t, step)
            p = origin + (t + real(0.5) * h) * direction
            q = colored(scene, p)
            taken += 1
            i += 1
            idle = q[3] <= real(0.0)
            if not idle:
                light, more = arriving(scene, cone, p, eye)
                taken += more
                A = absorbed(wp.float64(q[3] * h))
                seen = A * wp.cw_mul(light, wp.vec3d(vec3(q[0], q[1], q[2])))
                ray = over(ray, wp.vec4d(seen[0], seen[1], seen[2], A))
        rgba[y, x] = vec4(ray)
        samples[y, x] = taken

    return scattering
