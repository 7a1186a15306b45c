"""The ray caster: a factory that turns what a scene uses into a kernel with nothing else in it.

A ray is a walk of segments composed front to back. How it walks and what a segment contributes is a march:
``march(scene, origin, direction, length)`` -> (vec4d, int), from the entry point in index coordinates. Clips and labels
cut the ray into stretches, which are marched one by one and composed like segments.
"""

from functools import cache

import warp as wp

from .adaptive import make_adaptive
from .adaptive_preintegrated import make_adaptive_preintegrated
from .certified import make_certified
from .clip import make_cut_normal
from .exact import make_exact
from .precision import REALS, vec3_of, vec4_of
from .ray import entry, pixel
from .scene import make_scene
from .segment import over
from .span import make_span
from .uniform import make_uniform

MARCHES = {
    "left": make_uniform,
    "midpoint": make_uniform,
    "trapezoid": make_uniform,
    "simpson": make_uniform,
    "preintegrated": make_uniform,
    "adaptive-coupled": make_adaptive,
    "adaptive-decoupled": make_adaptive,
    "adaptive-preintegrated": make_adaptive_preintegrated,
    "exact": make_exact,
    "certified": make_certified,
}


@cache
def make_raycast(variant):
    """Kernel ``(base, scene, rgba, samples)`` over work items of ``ray.pixel``."""
    real = REALS[variant.precision]
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Scene = make_scene(variant)
    march = MARCHES[variant.rule](variant)
    certified = variant.rule == "certified"

    span = make_span(variant)
    cut_normal = make_cut_normal(variant.clips or wp.uint8)

    @wp.func
    def stretches(scene: Scene, point: wp.vec3d, along: wp.vec3d, length: wp.float64):
        """Composite, count and bound of a ray that is cut."""
        one = wp.float64(1.0)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        opaque = scene.steps.opaque
        if scene.steps.scope == wp.float64(0.0):
            scene.steps.scope = length
        t = wp.float64(0.0)
        while t < length and ray[3] <= opaque:
            state, until = span(scene, point, along, t, length)
            if state >= 0:
                if wp.static(variant.labels is not None):
                    scene.transfer = scene.labels.transfers[state]
                    if wp.static("preintegrated" in variant.rule):
                        scene.table = scene.labels.tables[state]
                # The stretch is seen through those in front of it, and so is its error.
                clear = one - ray[3]
                scene.steps.opaque = one - (one - opaque) / wp.max(clear, wp.float64(1.0e-300))
                start = point + t * along
                if wp.static(variant.lit != "" and variant.clipped):
                    reach = wp.float64(1.0e-6) * scene.view.unit
                    scene.cut = cut_normal(scene.clipping, scene.view.to_index, start, reach)
                    scene.cut_point = start
                origin = vec3(real(start[0]), real(start[1]), real(start[2]))
                direction = vec3(real(along[0]), real(along[1]), real(along[2]))
                stretch = wp.vec4d()
                number = int(0)
                if wp.static(variant.traced):
                    scene.start = t
                    scene.front = ray
                if wp.static(certified):
                    stretch, number, error = march(scene, origin, direction, real(until - t))
                    bound += clear * error
                    # Counted, once a ray.
                    scene.steps.veiled = wp.float64(0.0)
                else:
                    stretch, number = march(scene, origin, direction, real(until - t))
                if wp.static(variant.traced):
                    while scene.taken < scene.trace.shape[0] and scene.trace[scene.taken].length > wp.float64(0.0):
                        scene.taken += 1
                ray = over(ray, stretch)
                count += number
            t = until
        return ray, count, bound

    @wp.kernel(enable_backward=False, module="unique")
    def raycast(base: int, scene: Scene, rgba: wp.array2d(dtype=vec4), samples: wp.array2d(dtype=int)):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        point, along, inside = entry(scene.view, x, y)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        if inside > wp.float64(0.0):
            if wp.static(variant.cut):
                ray, count, bound = stretches(scene, point, along, inside)
            else:
                origin = vec3(real(point[0]), real(point[1]), real(point[2]))
                direction = vec3(real(along[0]), real(along[1]), real(along[2]))
                if wp.static(certified):
                    ray, count, bound = march(scene, origin, direction, real(inside))
                else:
                    ray, count = march(scene, origin, direction, real(inside))
        rgba[y, x] = vec4(real(ray[0]), real(ray[1]), real(ray[2]), real(ray[3]))
        samples[y, x] = count
        if wp.static(certified):
            # Rounded up.
            scene.bound[y, x] = wp.float32(bound * wp.float64(wp.static(1.0 + 2.0**-23)))

    return raycast
