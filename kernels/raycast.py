"""The one kernel that casts rays: a factory that turns what a scene uses into a kernel with nothing else in it.

A ray is a walk of segments composed front to back. How it walks and what a segment contributes is a march, as of
``scene.Halves``; clips and labels cut the ray into stretches, which are marched one by one and composed like segments.
"""

from functools import cache

import warp as wp

from .cuts.stretches import make_stretches
from .precision import vec4_of
from .ray import ending, entry, inside, inverted, line, pixel


@cache
def make_raycast(halves):
    """Kernel ``(base, scene, rgba, samples, bounds)`` over work items of ``ray.pixel``; a march that is ``bounded``
    writes ``bounds``.
    """
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
    ):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        view = scene.view
        point, along, length, first = entry(view, x, y)
        end, loose = ending(view, x, y)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        start = wp.float64(0.0)
        stop = wp.float64(0.0)
        if length > wp.float64(0.0):
            # Rays begin and end with what there is to see.
            start, stop = inside(view.seen_low, view.seen_high, point, inverted(along), wp.float64(0.0), length)
            stop = wp.min(stop, end - first)
            if stop > start:
                ray, count, bound = march(scene, point, along, start, stop)
        rgba[y, x] = vec4(ray)
        samples[y, x] = count
        if wp.static(bounded):
            if loose > wp.float64(0.0):
                loose += wp.float64(wp.static(2.0**-50)) * wp.abs(first)
                most = scene.march.brightest + scene.march.tinted
                bound += most * wp.min(wp.float64(1.0), scene.march.densest * loose)
            anchor, along, begin = line(view, x, y)
            off, cap = edge(scene, anchor, inverted(along), begin, stop > start)
            # Rounded up.
            bounds[y, x] = wp.float32(wp.min(bound + off, cap) * wp.float64(wp.static(1.0 + 2.0**-23)))

    return raycast
