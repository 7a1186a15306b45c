"""Pixels in the precision that they are shown in, and what is known of all of them, where they stay on a device."""

from functools import cache

import warp as wp

# Of each thread: fewer write to the same numbers then.
PIXELS = 64


@cache
def make_settle(vec4, shown, bounded):
    """Kernel ``(base, rgba, result, samples, bounds, tolerance, most, counts)`` over one of ``PIXELS`` pixels: ``rgba``
    of vec4 as ``result`` of another, unless they are the same; ``most`` gets the largest opacity and bound, ``counts``
    all samples and how many bounds are above the tolerance, both 0 before. Of a launch of one thread, or on a device
    with atomics. What has no bounds gives its samples in their place.
    """
    bound_of = wp.float32 if bounded else wp.int32

    @wp.kernel(enable_backward=False, module="unique")
    def settle(
        base: int,
        rgba: wp.array2d(dtype=vec4),
        result: wp.array2d(dtype=shown),
        samples: wp.array2d(dtype=wp.int32),
        bounds: wp.array2d(dtype=bound_of),
        tolerance: wp.float32,
        most: wp.array(dtype=wp.float32),
        counts: wp.array(dtype=wp.int64),
    ):
        pixels = rgba.shape[0] * rgba.shape[1]
        # Neighbours of a pixel are of other threads: what they read is next to each other.
        threads = (pixels + wp.static(PIXELS) - 1) // wp.static(PIXELS)
        opaque = wp.float32(0.0)
        largest = wp.float32(0.0)
        total = wp.int64(0)
        over = wp.int64(0)
        for n in range(wp.tid() + base, pixels, threads):
            y = n // rgba.shape[1]
            x = n - y * rgba.shape[1]
            pixel = rgba[y, x]
            if wp.static(vec4 is not shown):
                result[y, x] = shown(pixel)
            opaque = wp.max(opaque, wp.float32(pixel[3]))
            total += wp.int64(samples[y, x])
            if wp.static(bounded):
                largest = wp.max(largest, bounds[y, x])
                if bounds[y, x] > tolerance:
                    over += wp.int64(1)
        wp.atomic_max(most, 0, opaque)
        wp.atomic_add(counts, 0, total)
        if wp.static(bounded):
            wp.atomic_max(most, 1, largest)
            wp.atomic_add(counts, 1, over)

    return settle
