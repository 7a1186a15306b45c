"""The kernels that cast rays, one at a time or several: a factory that turns what a scene uses into a kernel with
nothing else in it.

A ray is a walk of segments composed front to back. How it walks and what a segment contributes is a march, as of
``scene.Halves``; clips and labels cut the ray into stretches, which are marched one after the other and composed like
segments.
"""

from functools import cache

import warp as wp

from .bricks.brick import Brick, clearing, has, on_grain, owned, unspent
from .cuts.abreast import make_stretches_abreast
from .cuts.stretches import make_stretches
from .field.absent import make_grazed
from .precision import vec4_of
from .ray import FAR, LEAVE, TILE, View, ending, entry, inside, inverted, line, pixel, place
from .rays import reaches


@wp.func
def reach(view: View, x: int, y: int):
    """Where there may be something to see along the ray of a pixel: its line, from where to where, and how far off the
    depth that ends it may be.
    """
    point, along, length, first = entry(view, x, y)
    if view.grain > wp.float64(0.0):
        point = on_grain(point, view.grain)
    end, loose = ending(view, x, y)
    if length <= wp.float64(0.0):
        # There is nothing to end.
        loose = wp.float64(0.0)
    elif loose > wp.float64(0.0):
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
    """``around(scene, x, y, point, along, start, stop, loose)`` -> what to add to a bound on what is along the ray of a
    pixel from start to stop, so that it holds for all of it, and the largest bound that there need be.
    """
    Scene = halves.Scene
    edge = halves.march.edge(halves)
    limits = halves.march.limits(halves)
    holes = not halves.field.finite
    grazed = make_grazed(halves) if holes else None

    @wp.func
    def around(
        scene: Scene,
        x: int,
        y: int,
        point: wp.vec3d,
        along: wp.vec3d,
        start: wp.float64,
        stop: wp.float64,
        loose: wp.float64,
    ):
        hit = stop > start
        off = wp.float64(0.0)
        cap = FAR
        if loose > wp.float64(0.0):
            most = scene.march.brightest + scene.march.tinted
            off = most * wp.min(wp.float64(1.0), scene.march.densest * loose)
        edges = bool(True)
        if wp.static(halves.brick):
            edges = scene.brick.edges
        anchor, way, begin = line(scene.view, x, y)
        if edges:
            more, cap = edge(scene, anchor, inverted(way), begin, hit)
            off += more
        if wp.static(holes):
            most, _, _ = limits(scene)
            if hit and most > wp.float64(0.0):
                little = scene.march.tolerance / (wp.float64(1024.0) * most)
                off += most * grazed(scene, anchor, point, along, start, stop, little)
        return off, cap

    return around


def outputs(halves):
    """The types of an image's ``rgba`` and ``bounds``."""
    return (wp.vec4d, wp.float64) if halves.brick else (vec4_of(halves.real), wp.float32)


@cache
def make_put(halves):
    """``put(x, y, rgba, samples, bounds, ray, count, bound)``: the composite of a ray, count and bound into a pixel.

    Of a brick they are composed into what is in front of it, whose ``rgba`` are colour and transparency.
    """
    vec4, real = outputs(halves)
    bounded = halves.march.bounded

    @wp.func
    def put(
        x: int,
        y: int,
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=real),
        ray: wp.vec4d,
        count: int,
        bound: wp.float64,
    ):
        # Rounding may be on the far side of nothing, or of all that there is: the truth never is.
        ray = wp.max(ray, wp.vec4d())
        ray[3] = wp.min(ray[3], wp.float64(1.0))
        if wp.static(halves.brick):
            front = rgba[y, x]
            T = front[3]
            rgba[y, x] = front + T * wp.vec4d(ray[0], ray[1], ray[2], -ray[3])
            samples[y, x] = samples[y, x] + count
            if wp.static(bounded):
                bounds[y, x] = bounds[y, x] + T * bound
        else:
            rgba[y, x] = vec4(ray)
            samples[y, x] = count
            if wp.static(bounded):
                # Rounded up.
                bounds[y, x] = real(bound * wp.float64(wp.static(1.0 + 2.0**-23)))

    return put


@cache
def make_raycast(halves):
    """Kernel ``(base, scene, rgba, samples, bounds, scratch)`` over work items of ``ray.pixel``; a march that is
    ``bounded`` writes ``bounds``, infinite where it ``leaves`` a ray to another launch, and ``scratch`` is the address
    of memory of the thread's own. The image of a brick is composed into that of what is in front of it; of a ray that
    is left to another launch nothing is, and its count is -1 less what it was.
    """
    if halves.rays > 1:
        return make_raycasts(halves)
    vec4, real = outputs(halves)
    Scene = halves.Scene
    march = make_stretches(halves) if halves.cuts.any else halves.march.march(halves)
    bounded = halves.march.bounded
    around = make_bound(halves) if bounded else None
    enter, leave = make_brick_part(halves) if halves.brick else (None, None)
    anchored = getattr(halves.march, "anchored", False)
    put = make_put(halves)
    leaves = halves.leaves

    # On GPUs one ray a thread, without a loop around it: what might be left of the ray before would keep registers. Two
    # blocks a multiprocessor leave 128 of them.
    bounds_of = (256, 2) if leaves and not halves.cuts.any and halves.light is None else None

    @wp.kernel(enable_backward=False, module="unique", grid_stride=False, launch_bounds=bounds_of)
    def raycast(
        base: int,
        scene: Scene,
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=real),
        scratch: wp.uint64,
    ):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        if wp.static(halves.again):
            if wp.static(halves.brick):
                if samples[y, x] >= 0:
                    return
                samples[y, x] = -1 - samples[y, x]
            elif bounds[y, x] < real(wp.inf):
                return
        if wp.static(halves.scratch > 0):
            scene.march.scratch = scratch
        # Of the whole image, which a brick has a part of.
        column = int(x)
        row = int(y)
        clear = wp.float64(0.0)
        if wp.static(halves.brick):
            column += scene.brick.column
            row += scene.brick.row
            front = rgba[y, x]
            clear = clearing(scene.brick, x, y, front[3], wp.float64(1.0) - scene.opaque)
            if not enter(scene, x, y, clear, rgba, bounds):
                return
        point, along, start, stop, loose = reach(scene.view, column, row)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        off = wp.float64(0.0)
        cap = wp.float64(0.0)
        if wp.static(bounded and not halves.brick):
            # Before, while the ray's line is known.
            off, cap = around(scene, column, row, point, along, start, stop, loose)
        if wp.static(halves.brick):
            first, last = owned(scene.brick, point, inverted(along), start, stop)
            loose = wp.where(has(first, last, stop, loose), loose, wp.float64(0.0))
            if last > first:
                scene.opaque = wp.float64(1.0) - clear
                point -= scene.brick.offset
                if wp.static(anchored):
                    # Segments count from where the ray enters the whole; the brick has those whose middles are in it.
                    scene.brick.enter = wp.where(first > start, first, -FAR)
                    scene.brick.leave = wp.where(last < stop, last, FAR)
                    ray, count, bound = march(scene, point, along, start, stop)
                else:
                    scene.stretch = 1
                    scene.whole = stop - start
                    ray, count, bound = march(scene, point, along, first, last)
                if wp.static(bounded):
                    ray, bound = leave(scene, ray, bound, last - first, wp.float64(1.0) - scene.opaque)
            if wp.static(bounded):
                off, cap = around(scene, column, row, point, along, first, last, loose)
        elif stop > start:
            ray, count, bound = march(scene, point, along, start, stop)
        if wp.static(bounded):
            total = wp.min(bound + off, cap)
            if wp.static(leaves):
                if wp.static(halves.brick):
                    if bound >= LEAVE:
                        samples[y, x] = -1 - samples[y, x]
                        return
                total = wp.where(bound >= LEAVE, wp.float64(wp.inf), total)
            bound = total
        put(x, y, rgba, samples, bounds, ray, count, bound)

    return raycast


@cache
def make_raycasts(halves):
    """The same of a march that takes ``halves.rays`` at a time."""
    vec4, real = outputs(halves)
    Scene = halves.Scene
    rays = halves.rays
    assert rays == TILE
    march = make_stretches_abreast(halves) if halves.cuts.any else halves.march.together(halves)
    limits = halves.march.limits(halves)
    holes = not halves.field.finite
    around = make_bound(halves)
    enter, leave = make_brick_part(halves) if halves.brick else (None, None)
    put = make_put(halves)

    @wp.kernel(enable_backward=False, module="unique")
    def raycasts(
        base: int,
        scene: Scene,
        rgba: wp.array2d(dtype=vec4),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=real),
        scratch: wp.uint64,
    ):
        scene.march.scratch = scratch
        first = (wp.tid() + base) * rays
        # Of the whole image, which a brick has a part of.
        column = int(0)
        row = int(0)
        if wp.static(halves.brick):
            column = scene.brick.column
            row = scene.brick.row
            scene.stretch = 1
        # Point, direction, start, stop, end and what is unspent of each ray; its composite, count and bound, and what
        # is to be added.
        lines = wp.zeros(shape=(rays, 10), dtype=wp.float64)
        results = wp.zeros(shape=(rays, 6), dtype=wp.float64)
        offs = wp.zeros(shape=(rays,), dtype=wp.float64)
        clear = wp.float64(1.0) - scene.opaque
        cap = FAR
        # Rays that are looked at, of a row of a tile: all up to the image's edge, or those of ``going``.
        last = int(rays)
        going = wp.zeros(shape=(rays,), dtype=int)
        if scene.view.ends.shape[0] == 0:
            x, y = pixel(scene.view, first)
            last = wp.where(y < scene.view.height, wp.min(last, scene.view.width - x), 0)
            if last > 0:
                most, little, cap = limits(scene)
                brick = Brick()
                if wp.static(halves.brick):
                    brick = scene.brick
                    most = wp.where(brick.edges, most, wp.float64(0.0))
                if wp.static(holes):
                    # That is for one after the other.
                    most = wp.float64(0.0)
                reaches(scene.view, brick, x + column, y + row, wp.vec3d(clear, most, little), lines, offs)
            for r in range(last):
                going[r] = 1
                if wp.static(holes):
                    point = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                    along = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                    start = lines[r, 6]
                    stop = lines[r, 7]
                    off, most = around(scene, x + r + column, y + row, point, along, start, stop, wp.float64(0.0))
                    offs[r] = off
                if wp.static(halves.brick):
                    hit = lines[r, 7] > lines[r, 6]
                    if hit:
                        front = rgba[y, x + r]
                        lines[r, 8] = clearing(scene.brick, x + r, y, front[3], clear)
                        hit = enter(scene, x + r, y, lines[r, 8], rgba, bounds)
                    if hit:
                        # What each telescopes to over the bricks in front is no part of what cells there were off by.
                        all = scene.march.cell + scene.march.tinted + scene.brick.opacity
                        length = scene.march.along * lines[r, 6]
                        lines[r, 9] = unspent(scene.brick, rgba[y, x + r][3], bounds[y, x + r], all, length)
                    else:
                        lines[r, 7] = lines[r, 6]
                        going[r] = wp.where(offs[r] > wp.float64(0.0), 1, 0)
            for r in range(last, rays):
                # Beyond the image.
                lines[r, 7] = lines[r, 6]
        else:
            for r in range(last):
                x, y = pixel(scene.view, first + r)
                looked = y < scene.view.height
                if wp.static(halves.brick):
                    if looked:
                        front = rgba[y, x]
                        lines[r, 8] = clearing(scene.brick, x, y, front[3], clear)
                        looked = enter(scene, x, y, lines[r, 8], rgba, bounds)
                if looked:
                    going[r] = 1
                    point, along, start, stop, loose = reach(scene.view, x + column, y + row)
                    if not wp.static(halves.brick):
                        lines[r, 8] = clear
                    if wp.static(halves.brick):
                        end = stop
                        start, stop = owned(scene.brick, point, inverted(along), start, stop)
                        loose = wp.where(has(start, stop, end, loose), loose, wp.float64(0.0))
                        point -= scene.brick.offset
                    for a in range(3):
                        lines[r, a] = point[a]
                        lines[r, 3 + a] = along[a]
                    lines[r, 6] = start
                    lines[r, 7] = stop
                    off, most = around(scene, x + column, y + row, point, along, start, stop, loose)
                    offs[r] = off
                    cap = most
        some = bool(False)
        for r in range(last):
            some = some or lines[r, 7] > lines[r, 6]
        if some:
            march(scene, lines, results)
        # Cancelled meanwhile or not: their pixels are where they were.
        x, y = place(scene.view, first)
        for r in range(last):
            if going[r] != 0:
                ray = wp.vec4d()
                bound = wp.float64(0.0)
                if lines[r, 7] > lines[r, 6]:
                    ray = wp.vec4d(results[r, 0], results[r, 1], results[r, 2], results[r, 3])
                    bound = results[r, 5]
                    if wp.static(halves.brick):
                        ray, bound = leave(scene, ray, bound, lines[r, 7] - lines[r, 6], lines[r, 8])
                put(x + r, y, rgba, samples, bounds, ray, int(results[r, 4]), wp.min(bound + offs[r], cap))

    return raycasts


@cache
def make_brick_part(halves):
    """``enter(scene, x, y, clear, rgba, bounds)`` -> whether a brick's ray is still to be seen, which ends at the
    transparency ``clear``: one that is opaque asks for nothing more, and whatever is here and behind, between 0 and the
    brightest, is in its bound; and
    ``leave(scene, ray, bound, length, clear)`` -> the composite of a length of ray, and the bound on it, of what a
    march came to that ends it at the transparency ``clear``.
    """
    Scene = halves.Scene
    bounded = halves.march.bounded
    zero = wp.constant(wp.float64(0.0))

    @wp.func
    def enter(
        scene: Scene,
        x: int,
        y: int,
        clear: wp.float64,
        rgba: wp.array2d(dtype=wp.vec4d),
        bounds: wp.array2d(dtype=wp.float64),
    ):
        going = clear <= wp.float64(1.0)
        if wp.static(bounded):
            front = rgba[y, x]
            if not going and front[3] > zero:
                bounds[y, x] = bounds[y, x] + front[3] * scene.march.brightest
                rgba[y, x] = wp.vec4d(front[0], front[1], front[2], zero)
        return going

    @wp.func
    def leave(scene: Scene, ray: wp.vec4d, bound: wp.float64, length: wp.float64, clear: wp.float64):
        # What counts for a ray as a whole counts here by its part.
        brick = scene.brick
        astray = wp.max(scene.view.astray - scene.march.allowed, zero) * brick.astray
        bound += brick.opacity * ray[3] + brick.length * length + astray * (ray[3] + length / brick.longest)
        if wp.float64(1.0) - ray[3] < wp.float64(wp.static(1.0 - 2.0**-40)) * clear:
            # It has ended: the march counts what is behind, so that nobody else has to.
            ray[3] = wp.float64(1.0)
        return ray, bound

    return enter, leave
