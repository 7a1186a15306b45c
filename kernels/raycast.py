"""The kernels that cast rays, one at a time or several: a factory that turns what a scene uses into a kernel with
nothing else in it.

A ray is a walk of segments composed front to back. How it walks and what a segment contributes is a march, as of
``scene.Halves``; clips and labels cut the ray into stretches, which are marched one by one and composed like segments.
"""

from functools import cache

import warp as wp

from .bricks.brick import on_grain, owned
from .cuts.stretches import make_stretches
from .precision import vec4_of
from .ray import FAR, View, ending, entry, inside, inverted, line, pixel


@wp.func
def reach(view: View, x: int, y: int):
    """Where there may be something to see along the ray of a pixel: its line, from where to where, and how far off the
    depth that ends it may be.
    """
    point, along, length, first = entry(view, x, y)
    if view.grain > wp.float64(0.0):
        point = on_grain(point, view.grain)
    end, loose = ending(view, x, y)
    if loose > wp.float64(0.0):
        loose += wp.float64(wp.static(2.0**-50)) * wp.abs(first)
    start = wp.float64(0.0)
    stop = wp.float64(0.0)
    if length > wp.float64(0.0):
        # Rays begin and end with what there is to see.
        start, stop = inside(view.seen_low, view.seen_high, point, inverted(along), wp.float64(0.0), length)
        stop = wp.min(stop, end - first)
    return point, along, start, stop, loose


@cache
def make_bound(halves):
    """``whole(scene, x, y, hit, bound, loose)``: a bound on all of the ray of a pixel, of that on what is along it."""
    Scene = halves.Scene
    edge = halves.march.edge(halves)

    @wp.func
    def whole(scene: Scene, x: int, y: int, hit: bool, bound: wp.float64, loose: wp.float64):
        if loose > wp.float64(0.0):
            most = scene.march.brightest + scene.march.tinted
            bound += most * wp.min(wp.float64(1.0), scene.march.densest * loose)
        anchor, along, begin = line(scene.view, x, y)
        off, cap = edge(scene, anchor, inverted(along), begin, hit)
        # Rounded up.
        return wp.float32(wp.min(bound + off, cap) * wp.float64(wp.static(1.0 + 2.0**-23)))

    return whole


@cache
def make_raycast(halves):
    """Kernel ``(base, scene, rgba, samples, bounds, scratch)`` over work items of ``ray.pixel``; a march that is
    ``bounded`` writes ``bounds``, and ``scratch`` is the address of memory of the thread's own. Of a brick, whose image
    others are seen through, ``rgba`` is float64.
    """
    if halves.rays > 1:
        return make_raycasts(halves)
    vec4 = wp.vec4d if halves.brick else vec4_of(halves.real)
    Scene = halves.Scene
    march = make_stretches(halves) if halves.cuts.any else halves.march.march(halves)
    bounded = halves.march.bounded
    whole = make_bound(halves) if bounded else None
    cast = make_brick_cast(halves, march) if halves.brick else None

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
        if wp.static(halves.scratch > 0):
            scene.march.scratch = scratch
        # Of the whole image, which a brick has a part of.
        column = int(x)
        row = int(y)
        if wp.static(halves.brick):
            column += scene.brick.column
            row += scene.brick.row
        point, along, start, stop, loose = reach(scene.view, column, row)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        if wp.static(halves.brick):
            if stop > start:
                ray, count, bound, stop = cast(scene, x, y, point, along, start, stop)
        elif stop > start:
            ray, count, bound = march(scene, point, along, start, stop)
        rgba[y, x] = vec4(ray)
        samples[y, x] = count
        if wp.static(bounded):
            bounds[y, x] = whole(scene, column, row, stop > start, bound, loose)

    return raycast


@cache
def make_raycasts(halves):
    """The same of a march that takes ``halves.rays`` at a time."""
    vec4 = vec4_of(halves.real)
    Scene = halves.Scene
    rays = halves.rays
    march = halves.march.together(halves)
    whole = make_bound(halves)

    @wp.kernel(enable_backward=False, module="unique")
    def raycasts(
        base: int,
        scene: Scene,
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=wp.float32),
        scratch: wp.uint64,
    ):
        scene.march.scratch = scratch
        first = (wp.tid() + base) * rays
        # Point, direction, start and stop of each ray; its composite, count and bound.
        lines = wp.zeros(shape=(rays, 8), dtype=wp.float64)
        looseness = wp.zeros(shape=(rays,), dtype=wp.float64)
        results = wp.zeros(shape=(rays, 6), dtype=wp.float64)
        last = int(rays)
        for r in range(last):
            x, y = pixel(scene.view, first + r)
            if y < scene.view.height:
                point, along, start, stop, loose = reach(scene.view, x, y)
                for a in range(3):
                    lines[r, a] = point[a]
                    lines[r, 3 + a] = along[a]
                lines[r, 6] = start
                lines[r, 7] = stop
                looseness[r] = loose
        march(scene, lines, results)
        for r in range(last):
            x, y = pixel(scene.view, first + r)
            if y < scene.view.height:
                hit = lines[r, 7] > lines[r, 6]
                bound = wp.float64(0.0)
                if hit:
                    rgba[y, x] = vec4(wp.vec4d(results[r, 0], results[r, 1], results[r, 2], results[r, 3]))
                    bound = results[r, 5]
                else:
                    rgba[y, x] = vec4()
                samples[y, x] = int(results[r, 4])
                bounds[y, x] = whole(scene, x, y, hit, bound, looseness[r])

    return raycasts


@cache
def make_brick_cast(halves, march):
    """``cast(scene, x, y, point, along, start, stop)`` -> composite, count and bound of what a brick has of a ray, and
    where that ends: not behind ``start`` if there is nothing.
    """
    Scene = halves.Scene
    bounded = halves.march.bounded
    anchored = getattr(halves.march, "anchored", False)

    @wp.func
    def cast(scene: Scene, x: int, y: int, point: wp.vec3d, along: wp.vec3d, start: wp.float64, stop: wp.float64):
        one = wp.float64(1.0)
        brick = scene.brick
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        clear = one
        if brick.front.shape[0] > 0:
            clear = brick.front[y, x]
        first, last = owned(brick, point, inverted(along), start, stop)
        if last > first and clear < one - scene.opaque:
            # A ray that is opaque asks for nothing more; whatever is here and behind is between 0 and the brightest.
            if wp.static(bounded):
                ray[3] = one
                bound = scene.march.brightest
        elif last > first:
            scene.opaque = one - (one - scene.opaque) / wp.max(clear, wp.float64(1.0e-300))
            if wp.static(anchored):
                # Segments count from where the ray enters the whole; the brick has those whose middles are in it.
                scene.brick.enter = wp.where(first > start, first, -FAR)
                scene.brick.leave = wp.where(last < stop, last, FAR)
                ray, count, bound = march(scene, point - brick.offset, along, start, stop)
            else:
                # What counts for a ray as a whole counts here by its part.
                scene.stretch = 1
                ray, count, bound = march(scene, point - brick.offset, along, first, last)
                if wp.static(bounded):
                    part = (last - first) / brick.longest
                    bound += brick.opacity * ray[3] + brick.length * (last - first)
                    bound += (
                        wp.max(scene.view.astray - scene.march.allowed, wp.float64(0.0))
                        * brick.astray
                        * (ray[3] + part)
                    )
        return ray, count, bound, wp.where(last > first, stop, start)

    return cast
