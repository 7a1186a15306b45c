"""The one kernel that casts rays: a factory that turns what a scene uses into a kernel with nothing else in it.

A ray is a walk of segments composed front to back. How it walks and what a segment contributes is a march, as of
``scene.Halves``; clips and labels cut the ray into stretches, which are marched one by one and composed like segments.
"""

from functools import cache

import warp as wp

from .cuts.stretches import make_stretches
from .precision import vec4_of
from .ray import entry, inside, inverted, line, pixel


@cache
def make_raycast(halves):
    """Kernel ``(base, scene, rgba, samples, bounds, scratch)`` over work items of ``ray.pixel``; a march that is
    ``bounded`` writes ``bounds``, and ``scratch`` is the address of memory of the thread's own.
    """
    if halves.rays > 1:
        return make_raycasts(halves)
    vec4 = vec4_of(halves.real)
    Scene = halves.Scene
    march = make_stretches(halves) if halves.cuts.any else halves.march.march(halves)
    bounded = halves.march.bounded
    edge = halves.march.edge(halves) if bounded else None

    @wp.kernel(enable_backward=False, module="unique")
    def raycast(
        base: int,
        scene: Scene,
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=wp.float32),
        scratch: wp.uint64,
    ):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        view = scene.view
        if wp.static(halves.scratch > 0):
            scene.march.scratch = scratch
        point, along, length = entry(view, x, y)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        start = wp.float64(0.0)
        stop = wp.float64(0.0)
        if length > wp.float64(0.0):
            # Rays begin and end with what there is to see.
            start, stop = inside(view.seen_low, view.seen_high, point, inverted(along), wp.float64(0.0), length)
            if stop > start:
                ray, count, bound = march(scene, point, along, start, stop)
        rgba[y, x] = vec4(ray)
        samples[y, x] = count
        if wp.static(bounded):
            anchor, along, first = line(view, x, y)
            off, cap = edge(scene, anchor, inverted(along), first, stop > start)
            # Rounded up.
            bounds[y, x] = wp.float32(wp.min(bound + off, cap) * wp.float64(wp.static(1.0 + 2.0**-23)))

    return raycast


@cache
def make_raycasts(halves):
    """The same of a march that takes ``halves.rays`` at a time."""
    vec4 = vec4_of(halves.real)
    Scene = halves.Scene
    rays = halves.rays
    march = halves.march.together(halves)
    edge = halves.march.edge(halves)

    @wp.kernel(enable_backward=False, module="unique")
    def raycasts(
        base: int,
        scene: Scene,
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=wp.float32),
        scratch: wp.uint64,
    ):
        view = scene.view
        scene.march.scratch = scratch
        first = (wp.tid() + base) * rays
        lines = wp.zeros(shape=(rays, 8), dtype=wp.float64)
        results = wp.zeros(shape=(rays, 6), dtype=wp.float64)
        last = int(rays)
        for r in range(last):
            x, y = pixel(view, first + r)
            if y < view.height:
                point, along, length = entry(view, x, y)
                if length > wp.float64(0.0):
                    start, stop = inside(view.seen_low, view.seen_high, point, inverted(along), wp.float64(0.0), length)
                    for a in range(3):
                        lines[r, a] = point[a]
                        lines[r, 3 + a] = along[a]
                    lines[r, 6] = start
                    lines[r, 7] = stop
        march(scene, lines, results)
        for r in range(last):
            x, y = pixel(view, first + r)
            if y < view.height:
                hit = lines[r, 7] > lines[r, 6]
                bound = wp.float64(0.0)
                if hit:
                    rgba[y, x] = vec4(wp.vec4d(results[r, 0], results[r, 1], results[r, 2], results[r, 3]))
                    bound = results[r, 5]
                else:
                    rgba[y, x] = vec4()
                samples[y, x] = int(results[r, 4])
                anchor, along, begin = line(view, x, y)
                off, cap = edge(scene, anchor, inverted(along), begin, hit)
                bounds[y, x] = wp.float32(wp.min(bound + off, cap) * wp.float64(wp.static(1.0 + 2.0**-23)))

    return raycasts
