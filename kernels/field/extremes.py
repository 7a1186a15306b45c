"""The smallest and the largest finite sample, where samples are."""

from functools import cache

import warp as wp


@cache
def make_extremes(dtype):
    """Kernel ``(base, samples, low, high, odd)``: item n looks through every so manieth row along x from the n-th on:
    the smallest and largest finite sample (inf and -inf where there is none), and how many are not finite.
    """
    floating = dtype in (wp.float16, wp.float32, wp.float64)

    @wp.kernel(enable_backward=False, module="unique")
    def extremes(
        base: int,
        samples: wp.array3d(dtype=dtype),
        low: wp.array(dtype=wp.float64),
        high: wp.array(dtype=wp.float64),
        odd: wp.array(dtype=wp.int64),
    ):
        n = wp.tid() + base
        smallest = wp.float64(wp.inf)
        largest = wp.float64(-wp.inf)
        count = wp.int64(0)
        for row in range(n, samples.shape[0] * samples.shape[1], low.shape[0]):
            z = row // samples.shape[1]
            y = row - z * samples.shape[1]
            for x in range(samples.shape[2]):
                s = wp.float64(samples[z, y, x])
                if wp.static(floating):
                    if not wp.isfinite(s):
                        count += wp.int64(1)
                        continue
                smallest = wp.min(smallest, s)
                largest = wp.max(largest, s)
        low[n] = smallest
        high[n] = largest
        odd[n] = count

    return extremes
