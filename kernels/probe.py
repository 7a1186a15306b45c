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

from .cuts.stretches import make_span
from .cuts.volumes import make_near_surfaces
from .integrators.found import Found, nothing
from .ray import FAR, TILE, ending, entry, inside, inverted, line, near_faces, obliquity, pixel, slack

# What clips and labels leave of a ray may be missed where it is shorter [smallest voxel spacing].
SHORTEST = 1.0e-6


@cache
def make_probing(halves):
    """Kernel ``(base, scene, rgba, samples, bounds, values, depths)`` over work items of ``ray.pixel``.

    Values and depths, from the camera's plane along the view, are NaN where there is none; bounds are infinite where
    rounding decides whether there is any.
    """
    Scene = halves.Scene
    cuts = halves.cuts
    probe = halves.march.probe(halves)
    told = halves.march.told(halves)
    borders = halves.march.borders
    border = halves.march.border(halves) if borders else None
    span = make_span(halves)
    near_surfaces = make_near_surfaces(cuts.kinds, cuts.volumes)

    @wp.func
    def along(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64, given: Found):
        """What there is on the part of a ray that clips and labels leave."""
        found = given
        if wp.static(cuts.clipped):
            found.loose += near_surfaces(scene.cuts.clipping, origin, direction, start, stop)
        surfaces = found.loose
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
                found = border(scene, origin + t * direction, direction, surfaces + before + loose, found)
            before = loose
            if state >= 0:
                found.state = state
                if wp.static(cuts.labels is not None):
                    scene.transfer = scene.cuts.labels.transfers[state]
                found = probe(scene, origin, direction, t, until, found)
            t = until
        if wp.static(borders):
            found = border(scene, origin + stop * direction, direction, surfaces + before, found)
        return found

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
        view = scene.view
        zero = wp.float64(0.0)
        point, direction, length, first = entry(view, x, y)
        end, loose = ending(view, x, y)
        anchor, direction, begin = line(view, x, y)
        found = nothing()
        # Rounding decides where the box begins and ends, where the camera is in it, and the image's depths.
        found.loose = near_faces(
            view.low, view.high, anchor, inverted(direction), wp.float64(2.0) * view.astray, begin, end + loose
        )
        oblique = obliquity(view, x, y)
        start = zero
        stop = zero
        if length > zero:
            start, stop = inside(view.seen_low, view.seen_high, point, inverted(direction), zero, length)
            stop = wp.min(stop, end - first)
            if loose > zero:
                found.loose += loose + wp.float64(wp.static(2.0**-50)) * wp.abs(first)
            if first == begin:
                found.loose += slack(view, oblique, zero)
        hit = stop > start
        if hit:
            if wp.static(halves.vectors):
                # On a processor the pixel before in the tile is done, whatever the number of threads.
                if x % TILE > 0:
                    found.hint = (depths[y, x - 1] - view.depth) * oblique - first
            found = along(scene, point, direction, start, stop, found)
        if wp.static(borders):
            if not hit and found.loose > zero:
                found = border(scene, point, direction, found.loose, found)
        found = told(scene, direction, found)
        some = found.length > zero
        value = wp.float64(wp.nan)
        depth = wp.float64(wp.nan)
        if some:
            value = found.value
            if found.place > -FAR:
                depth = view.depth + (first + found.place) / oblique
        if not wp.static(borders):
            # Whether there is anything at all, what is too short does not tell.
            short = wp.where(some, found.length, wp.where(hit, wp.float64(SHORTEST), zero))
            if found.loose > zero and found.loose >= short:
                found.bound = wp.float64(wp.inf)
        rgba[y, x] = found.rgba
        samples[y, x] = found.count
        bounds[y, x] = found.bound
        values[y, x] = value
        depths[y, x] = depth

    return probing
