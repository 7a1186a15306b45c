"""What the eye's rays have come to, put into an image: its pixels, and the share of their light that is left."""

from functools import cache

import warp as wp

from ..precision import vec4_of
from .slices import Eye


@wp.kernel(enable_backward=False, module="unique")
def gather(
    base: int,
    seen_by: Eye,
    color: wp.vec3d,
    share: bool,
    fresh: bool,
    result: wp.array2d(dtype=wp.vec3d),
    every: int,
):
    """Adds what one light, ``fresh`` if it is the first, does to pixels that are ``shown``: colour, or the share of it
    that light reaches. Of a row there are ``every`` items, which take pixels by turns.
    """
    item = wp.tid() + base
    y = item // every
    for x in range(item - y * every, result.shape[1], every):
        if seen_by.shown[y, x] != wp.uint8(0):
            plain = seen_by.rgba[y, x]
            lit = seen_by.lit[y, x]
            if share:
                # Where a channel has no emission, the share is that of all; where there is none, all is reached.
                total = plain[0] + plain[1] + plain[2]
                mean = wp.float64(1.0)
                if total > wp.float64(0.0):
                    mean = (lit[0] + lit[1] + lit[2]) / total
                for c in range(3):
                    part = mean
                    if plain[c] > wp.float64(1.0e-6) * total:
                        part = lit[c] / plain[c]
                    lit[c] = part
            lit = wp.cw_mul(color, lit)
            if not fresh:
                lit += result[y, x]
            result[y, x] = lit


@cache
def make_finish(real):
    """Kernels, items as of ``gather``: ``choose(base, image, shown, every)``, the pixels that show anything, and
    ``finish(base, light, rgba, shown, share, image, every)``, an image's colours times shares, or all of it from the
    slices.
    """
    vec4 = vec4_of(real)

    @wp.kernel(enable_backward=False, module="unique")
    def choose(base: int, image: wp.array2d(dtype=vec4), shown: wp.array2d(dtype=wp.uint8), every: int):
        item = wp.tid() + base
        y = item // every
        for x in range(item - y * every, image.shape[1], every):
            shown[y, x] = wp.uint8(wp.where(image[y, x][3] > real(0.0), 1, 0))

    @wp.kernel(enable_backward=False, module="unique")
    def finish(
        base: int,
        light: wp.array2d(dtype=wp.vec3d),
        rgba: wp.array2d(dtype=wp.vec4d),
        shown: wp.array2d(dtype=wp.uint8),
        share: bool,
        image: wp.array2d(dtype=vec4),
        every: int,
    ):
        item = wp.tid() + base
        y = item // every
        for x in range(item - y * every, image.shape[1], every):
            if shown[y, x] != wp.uint8(0):
                q = light[y, x]
                A = real(rgba[y, x][3])
                if share:
                    before = image[y, x]
                    A = before[3]
                    for c in range(3):
                        q[c] *= wp.float64(before[c])
                image[y, x] = vec4(real(q[0]), real(q[1]), real(q[2]), A)

    return choose, finish
