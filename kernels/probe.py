"""The one kernel that looks for values and places along rays, as that of ``raycast`` does for light.

A half of an integrator that ``probes`` has, in place of a march,

* ``probe(halves)`` -> ``probe(scene, origin, direction, start, stop, found)`` -> ``Found``, after the stretch of a ray
  from ``start`` to ``stop``; its ``loose`` grows by what rounding decides on in there;
* ``told(halves)`` -> ``told(scene, direction, found)`` -> what a whole ray comes to: ``value``, ``rgba`` and ``bound``,
  and the ``length`` that this is of, 0 for nothing at all;
* ``borders``, and if so ``border(halves)`` -> ``border(scene, p, direction, loose, found)`` -> ``Found``, of each place
  where a stretch begins or ends, around which so much of the ray is loose: its bound then has all that this may do.
"""

from functools import cache

import warp as wp

from .bricks.brick import on_grain
from .cuts.stretches import make_span
from .cuts.volumes import make_near_surfaces
from .field.absent import make_grazed
from .integrators.found import GRAZED, SHORTEST, Found, nothing
from .ray import FAR, TILE, View, ending, entry, inside, inverted, line, near_faces, obliquity, pixel, slack


@wp.struct
class Outset:
    """A ray before anything is found along it."""

    point: wp.vec3d  # where it enters the box
    direction: wp.vec3d
    first: wp.float64  # where that is from the anchor on
    oblique: wp.float64
    start: wp.float64  # of what there may be to find
    stop: wp.float64
    loose: wp.float64  # length of which rounding decides whether it is in the box, and before the depth that ends it


@wp.func
def outset(view: View, x: int, y: int):
    """The ray of a pixel."""
    ray = Outset()
    zero = wp.float64(0.0)
    point, direction, length, first = entry(view, x, y)
    if view.grain > zero:
        point = on_grain(point, view.grain)
    end, loose = ending(view, x, y)
    anchor, direction, begin = line(view, x, y)
    ray.point = point
    ray.direction = direction
    ray.first = first
    ray.oblique = obliquity(view, x, y)
    # Rounding decides where the box begins and ends, where the camera is in it, and the image's depths.
    ray.loose = near_faces(
        view.low, view.high, anchor, inverted(direction), wp.float64(2.0) * view.astray, begin, end + loose
    )
    if length > zero:
        start, stop = inside(view.seen_low, view.seen_high, point, inverted(direction), zero, length)
        ray.start = start
        ray.stop = wp.min(stop, end - first)
        if loose > zero:
            ray.loose += loose + wp.float64(wp.static(2.0**-50)) * wp.abs(first)
        if first == begin:
            ray.loose += slack(view, ray.oblique, zero)
    return ray


@cache
def make_along(halves):
    """``along(scene, origin, direction, start, stop, begins, ends, found)``: what there is on the part of a ray that
    clips and labels leave, ``grazed`` of which is in faces of absent cells; ``begins`` and ``ends``, whether the ray
    does so there.
    """
    Scene = halves.Scene
    cuts = halves.cuts
    probe = halves.march.probe(halves)
    borders = halves.march.borders
    border = halves.march.border(halves) if borders else None
    span = make_span(halves)

    @wp.func
    def along(
        scene: Scene,
        origin: wp.vec3d,
        direction: wp.vec3d,
        start: wp.float64,
        stop: wp.float64,
        begins: bool,
        ends: bool,
        given: Found,
    ):
        found = given
        surfaces = found.loose
        if wp.static(borders):
            # That much more or less of cells beside absent ones, and of their fields.
            scene.march.off += wp.float64(3.0) * scene.march.range * given.grazed
            if given.grazed > wp.float64(GRAZED):
                found.bound += FAR
        else:
            found.loose += given.grazed
        before = wp.float64(0.0)
        t = start
        while t < stop:
            state = int(0)
            until = stop
            loose = wp.float64(0.0)
            if wp.static(cuts.any):
                state, until, loose = span(scene, origin, direction, t, stop)
            found.loose += loose
            if wp.static(borders):
                if begins or wp.static(cuts.any):
                    found = border(scene, origin + t * direction, direction, surfaces + before + loose, found)
            before = loose
            if state >= 0:
                found.state = state
                if wp.static(cuts.labels is not None):
                    scene.transfer = scene.cuts.labels.transfers[state]
                found = probe(scene, origin, direction, t, until, found)
            t = until
        if wp.static(borders):
            if ends or wp.static(cuts.any):
                found = border(scene, origin + stop * direction, direction, surfaces + before, found)
        return found

    return along


@cache
def make_doubted(halves):
    """``doubted(scene, x, y, p, direction, start, stop)`` -> how much of the part from start to stop of the ray of a
    pixel, from p on, is in faces of absent cells, where rounding decides on which side.
    """
    Scene = halves.Scene
    holes = halves.march.bounded and not halves.field.finite
    # What is behind the faces of a brick may be absent.
    grazed = make_grazed(halves, outer=halves.brick) if holes else None

    @wp.func
    def doubted(scene: Scene, x: int, y: int, p: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64):
        length = wp.float64(0.0)
        if wp.static(holes):
            anchor, _direction, _begin = line(scene.view, x, y)
            length = grazed(scene, anchor, p, direction, start, stop, wp.float64(wp.static(2.0**-37)))
        return length

    return doubted


@cache
def make_settled(halves):
    """``settled(scene, ray, found)`` -> what all of a ray comes to, its value and depth."""
    Scene = halves.Scene
    told = halves.march.told(halves)
    borders = halves.march.borders

    @wp.func
    def settled(scene: Scene, ray: Outset, given: Found):
        zero = wp.float64(0.0)
        found = told(scene, ray.direction, given)
        some = found.length > zero
        value = wp.float64(wp.nan)
        depth = wp.float64(wp.nan)
        if some:
            value = found.value
            if found.place > -FAR:
                depth = scene.view.depth + (ray.first + found.place) / ray.oblique
        if not wp.static(borders):
            # Whether there is anything at all, what is too short does not tell.
            hit = ray.stop > ray.start
            short = wp.where(some, found.length, wp.where(hit, wp.float64(SHORTEST), zero))
            if found.loose > zero and found.loose >= short:
                found.bound = wp.float64(wp.inf)
        return found, value, depth

    return settled


@cache
def make_probing(halves):
    """Kernel ``(base, scene, rgba, samples, bounds, values, depths)`` over work items of ``ray.pixel``.

    Values and depths, from the camera's plane along the view, are NaN where there is none; bounds are infinite where
    rounding decides whether there is any.
    """
    Scene = halves.Scene
    cuts = halves.cuts
    along = make_along(halves)
    settled = make_settled(halves)
    borders = halves.march.borders
    border = halves.march.border(halves) if borders else None
    near_surfaces = make_near_surfaces(cuts.kinds, cuts.volumes)
    doubted = make_doubted(halves)

    @wp.kernel(enable_backward=False, module="unique")
    def probing(
        base: int,
        scene: Scene,
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
        point = ray.point
        direction = ray.direction
        found = nothing()
        found.loose = ray.loose
        if ray.stop > ray.start:
            if wp.static(halves.vectors):
                # On a processor the pixel before in the tile is done, whatever the number of threads.
                if x % TILE > 0:
                    found.hint = (depths[y, x - 1] - scene.view.depth) * ray.oblique - ray.first
            if wp.static(cuts.clipped):
                found.loose += near_surfaces(scene.cuts.clipping, point, direction, ray.start, ray.stop)
            found.grazed = doubted(scene, x, y, point, direction, ray.start, ray.stop)
            found = along(scene, point, direction, ray.start, ray.stop, True, True, found)
        elif wp.static(borders):
            if found.loose > wp.float64(0.0):
                found = border(scene, point, direction, found.loose, found)
        found, value, depth = settled(scene, ray, found)
        rgba[y, x] = found.rgba
        samples[y, x] = found.count
        bounds[y, x] = found.bound
        values[y, x] = value
        depths[y, x] = depth

    return probing
