"""Pixels in the precision that they are shown in, and the largest opacity of any, where they stay on a device."""

from functools import cache

import warp as wp


@cache
def make_settle(vec4, shown):
    """Kernel ``(base, rgba, result, most)`` over pixels: ``rgba`` of vec4 as ``result`` of another, unless they are the
    same; ``most[0]``, 0 before, gets the largest opacity. Of a launch of one thread, or on a device with atomics.
    """

    @wp.kernel(enable_backward=False, module="unique")
    def settle(
        base: int,
        rgba: wp.array2d(dtype=vec4),
        result: wp.array2d(dtype=shown),
        most: wp.array(dtype=wp.float32),
    ):
        n = wp.tid() + base
        y = n // rgba.shape[1]
        x = n - y * rgba.shape[1]
        pixel = rgba[y, x]
        if wp.static(vec4 is not shown):
            result[y, x] = shown(pixel)
        opacity = wp.float32(pixel[3])
        if opacity > most[0]:
            wp.atomic_max(most, 0, opacity)

    return settle
