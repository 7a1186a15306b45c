"""The stretches that clips cut rays into, of several rays abreast: ``stretches`` says the same of one.

The first stretch of each ray is marched, all at a time, then the second of those that have one, and so on. A ray takes
part until nothing of it is left, or what is left is behind the transparency at which it ends.
"""

from functools import cache

import warp as wp

from ..field.walk import ahead
from .volumes import make_clip_span, make_near_surfaces


@cache
def make_stretches_abreast(halves):
    """``march(scene, lines, results)`` as of ``integrators.packed.make_rays``, of whole rays that clips cut."""
    real = wp.float64
    Scene = halves.Scene
    cuts = halves.cuts
    rays = halves.rays
    march = halves.march.together(halves)
    clip_span = make_clip_span(cuts.kinds, cuts.volumes, True)
    near_surfaces = make_near_surfaces(cuts.kinds, cuts.volumes)

    @wp.func
    def stretches(scene: Scene, lines: wp.array2d(dtype=real), results: wp.array2d(dtype=real)):
        one = real(1.0)
        # Of the stretch that each ray is at, what ``lines`` and ``results`` are of the ray.
        parts = wp.zeros(shape=(rays, 10), dtype=real)
        found = wp.zeros(shape=(rays, 6), dtype=real)
        # That a piece may change a channel by, in parts of its opacity.
        most = scene.march.brightest + scene.march.tinted
        for r in range(rays):
            origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
            direction = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
            for a in range(3):
                parts[r, a] = origin[a]
                parts[r, 3 + a] = direction[a]
            parts[r, 7] = lines[r, 6]
            parts[r, 9] = lines[r, 9]
            if lines[r, 7] > lines[r, 6]:
                loose = near_surfaces(scene.cuts.clipping, origin, direction, lines[r, 6], lines[r, 7])
                results[r, 5] = most * wp.min(one, scene.march.densest * loose)
        going = bool(True)
        while going:
            going = False
            for r in range(rays):
                # The next stretch that is visible.
                visible = bool(False)
                t = parts[r, 7]
                until = t
                if until < lines[r, 7]:
                    origin = wp.vec3d(lines[r, 0], lines[r, 1], lines[r, 2])
                    direction = wp.vec3d(lines[r, 3], lines[r, 4], lines[r, 5])
                    T = one - results[r, 3]
                    while until < lines[r, 7] and not visible:
                        t = until
                        visible, until, loose = clip_span(scene.cuts.clipping, origin, direction, t, lines[r, 7])
                        # What begins right behind t is not looked for.
                        loose += ahead(t) - t
                        results[r, 5] = results[r, 5] + T * most * wp.min(one, scene.march.densest * loose)
                    parts[r, 8] = lines[r, 8] / wp.max(T, real(1.0e-300))
                parts[r, 6] = wp.where(visible, t, until)
                parts[r, 7] = until
                going = going or visible
            if going:
                march(scene, parts, found)
                scene.stretch += 1
                for r in range(rays):
                    if parts[r, 7] > parts[r, 6]:
                        T = one - results[r, 3]
                        for a in range(4):
                            results[r, a] = results[r, a] + T * found[r, a]
                        results[r, 4] = results[r, 4] + found[r, 4]
                        results[r, 5] = results[r, 5] + T * found[r, 5]
                        parts[r, 9] = real(0.0)
                        T = one - results[r, 3]
                        if T < lines[r, 8]:
                            # It has ended: by rounding of the sum alone, the march has not counted what is behind.
                            if one - found[r, 3] >= parts[r, 8]:
                                results[r, 5] = results[r, 5] + T * scene.march.brightest
                            parts[r, 7] = lines[r, 7]

    return stretches
