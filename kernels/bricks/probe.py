"""Values and places along rays, looked for in bricks: what a ray has found so far goes on from brick to brick.

A half that has ``borders`` also has ``unseen(halves)`` -> ``unseen(scene, direction, loose, found)`` -> ``Found``, of
the beginning or end of a ray in a brick that is left out, where so much of the ray is loose.
"""

from functools import cache

import warp as wp

from ..cuts.volumes import make_near_surfaces
from ..integrators.found import Found, nothing
from ..probe import make_along, make_doubted, make_settled, outset
from ..ray import View, inverted, pixel
from .brick import owned

# Of ``Found.ends``: the ray's beginning, its end, and how near it is to clips.
BEGUN = wp.constant(1)
ENDED = wp.constant(2)
NEAR = wp.constant(4)


@wp.kernel(enable_backward=False, module="unique")
def begin_probing(base: int, view: View, found: wp.array2d(dtype=Found)):
    """Nothing is found along any ray."""
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    ray = outset(view, x, y)
    f = nothing()
    f.loose = ray.loose
    found[y, x] = f


@cache
def make_brick_probing(halves):
    """Kernel ``(base, scene, found)``: what there is in a brick besides."""
    Scene = halves.Scene
    cuts = halves.cuts
    along = make_along(halves)
    borders = halves.march.borders
    border = halves.march.border(halves) if borders else None
    near_surfaces = make_near_surfaces(cuts.kinds, cuts.volumes)
    doubted = make_doubted(halves)

    @wp.kernel(enable_backward=False, module="unique")
    def probing(base: int, scene: Scene, found: wp.array2d(dtype=Found)):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        f = found[y, x]
        if f.done == 1:
            return
        ray = outset(scene.view, x + scene.brick.column, y + scene.brick.row)
        point = ray.point - scene.brick.offset
        start, stop = owned(scene.brick, ray.point, inverted(ray.direction), ray.start, ray.stop)
        if wp.static(borders):
            if ray.stop <= ray.start and ray.loose > wp.float64(0.0):
                # It may touch the box there.
                zero = wp.float64(0.0)
                before, after = owned(scene.brick, ray.point, inverted(ray.direction), zero, zero)
                if before <= after:
                    f = border(scene, point, ray.direction, ray.loose, f)
                    f.ends = BEGUN | ENDED
                    found[y, x] = f
        if stop > start:
            begins = start == ray.start
            ends = stop == ray.stop
            if wp.static(cuts.clipped):
                if (f.ends & NEAR) == 0:
                    f.loose += near_surfaces(scene.cuts.clipping, point, ray.direction, ray.start, ray.stop)
            column = x + scene.brick.column
            row = y + scene.brick.row
            f.grazed = doubted(scene, column, row, point, ray.direction, start, stop)
            f = along(scene, point, ray.direction, start, stop, begins, ends, f)
            f.ends = f.ends | NEAR | wp.where(begins, BEGUN, 0) | wp.where(ends, ENDED, 0)
            found[y, x] = f

    return probing


@cache
def make_telling(halves):
    """Kernel ``(base, scene, found, rgba, samples, bounds, values, depths)``: as of ``probe.make_probing``, of all that
    was found; of the scene the samples are not asked for.
    """
    Scene = halves.Scene
    settled = make_settled(halves)
    borders = halves.march.borders
    unseen = halves.march.unseen(halves) if borders else None

    @wp.kernel(enable_backward=False, module="unique")
    def telling(
        base: int,
        scene: Scene,
        found: wp.array2d(dtype=Found),
        rgba: wp.array2d(dtype=wp.vec4d),
        samples: wp.array2d(dtype=int),
        bounds: wp.array2d(dtype=wp.float64),
        values: wp.array2d(dtype=wp.float64),
        depths: wp.array2d(dtype=wp.float64),
    ):
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        ray = outset(scene.view, x, y)
        f = found[y, x]
        if wp.static(borders):
            if (f.ends & BEGUN) == 0 or (f.ends & ENDED) == 0:
                f = unseen(scene, ray.direction, ray.loose, f)
        f, value, depth = settled(scene, ray, f)
        rgba[y, x] = f.rgba
        samples[y, x] = f.count
        bounds[y, x] = f.bound
        values[y, x] = value
        depths[y, x] = depth

    return telling
