"""What the eye's rays have come to, put into an image: its pixels, and the share of their light that is left."""

from functools import cache

import warp as wp

from ..precision import vec4_of
from .slices import Eye


@wp.struct
class Turn:
    """Of one light among all, what is put into the image with the last."""

    color: wp.vec3d
    first: bool
    last: bool
    share: bool  # of the image's colours; else all of it is of the slices


@cache
def make_shares(real):
    """Kernels of which a row has ``every`` items, that take its pixels by turns: ``choose(base, image, shown, every)``,
    the pixels that show anything, and ``gather(base, seen_by, turn, sums, image, every)``, which puts what all lights
    do to them into an image; ``sums`` holds it from light to light, and is not looked at where there is one.
    """
    vec4 = vec4_of(real)

    @wp.kernel(enable_backward=False, module="unique")
    def choose(base: int, image: wp.array2d(dtype=vec4), shown: wp.array2d(dtype=wp.uint8), every: int):
        item = wp.tid() + base
        y = item // every
        for x in range(item - y * every, image.shape[1], every):
            shown[y, x] = wp.uint8(wp.where(image[y, x][3] > real(0.0), 1, 0))

    @wp.kernel(enable_backward=False, module="unique")
    def gather(
        base: int,
        seen_by: Eye,
        turn: Turn,
        sums: wp.array2d(dtype=wp.vec3d),
        image: wp.array2d(dtype=vec4),
        every: int,
    ):
        item = wp.tid() + base
        y = item // every
        for x in range(item - y * every, image.shape[1], every):
            if seen_by.shown[y, x] != wp.uint8(0):
                plain = seen_by.rgba[y, x]
                # What is curved is summed by lines, which may be on the far side of nothing.
                lit = wp.max(seen_by.lit[y, x], wp.vec3d())
                if turn.share:
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
                lit = wp.cw_mul(turn.color, lit)
                if not turn.first:
                    lit += sums[y, x]
                if turn.last:
                    A = real(plain[3])
                    if turn.share:
                        before = image[y, x]
                        A = before[3]
                        for c in range(3):
                            lit[c] *= wp.float64(before[c])
                    image[y, x] = vec4(real(lit[0]), real(lit[1]), real(lit[2]), A)
                else:
                    sums[y, x] = lit

    return choose, gather
