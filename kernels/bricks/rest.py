"""What bricks that were not read may add to sums along rays, and whether surfaces may be in them.

``Unread.least`` and ``most`` are what samples of bricks are at least and at most.
"""

import warp as wp

from ..integrators.found import Found
from ..ray import View, pixel
from .unread import ONE, ZERO, Unread, begun, crossing, doubtful, stepped


@wp.struct
class Sums:
    mean: bool  # else the integral
    partly: bool  # something is cut away or absent, nobody knows where
    unit: wp.float64  # of length [world length]


@wp.struct
class Rest:
    """Of a ray in bricks that were not read."""

    length: wp.float64
    least: wp.float64  # of the sum of samples along it
    most: wp.float64
    low: wp.float64  # of samples
    high: wp.float64
    bricks: int


@wp.func
def rest_of(view: View, unread: Unread, x: int, y: int):
    """All of it along the ray of a pixel."""
    rest = Rest()
    rest.low = wp.float64(wp.inf)
    rest.high = -wp.float64(wp.inf)
    steps = begun(view, unread, x, y)
    going = steps.length > ZERO
    while going:
        start, _axis, _e0 = crossing(unread, steps, False)
        end, axis, _e1 = crossing(unread, steps, True)
        n = unread.number[steps.index[2], steps.index[1], steps.index[0]]
        if n >= 0 and end > start:
            rest.length += end - start
            rest.least += (end - start) * unread.least[n]
            rest.most += (end - start) * unread.most[n]
            rest.low = wp.min(rest.low, unread.least[n])
            rest.high = wp.max(rest.high, unread.most[n])
            rest.bricks += 1
        index, going = stepped(unread, steps, axis, True)
        if going:
            steps.index = index
    return rest


@wp.kernel(enable_backward=False, module="unique")
def settle_for_sums(
    base: int,
    view: View,
    unread: Unread,
    sums: Sums,
    found: wp.array2d(dtype=Found),
    half: wp.array2d(dtype=wp.float64),
):
    """What a ray sums up, with the middle of what there may be in bricks that were not read, and ``half`` of how far
    that is; infinite where nobody knows whether there is any.
    """
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    rest = rest_of(view, unread, x, y)
    if rest.bricks == 0:
        return
    f = found[y, x]
    if f.count == 0:
        f.value = ZERO
    off = wp.float64(wp.inf)
    if sums.partly and sums.mean:
        # Of any length that is there the mean is among those of its parts.
        low = rest.low
        high = rest.high
        if f.length > ZERO:
            low = wp.min(low, f.value / f.length)
            high = wp.max(high, f.value / f.length)
            off = wp.float64(0.5) * (high - low)
        # A length that is found is what it is known to be: the rest may not be there.
        f.length = wp.where(f.length > ZERO, f.length, rest.length)
        f.value = f.length * (low + wp.float64(0.5) * (high - low))
    else:
        if sums.partly:
            rest.least = wp.min(rest.low, ZERO) * rest.length
            rest.most = wp.max(rest.high, ZERO) * rest.length
        if f.length > f.loose or not sums.partly:
            off = wp.float64(0.5) * (rest.most - rest.least)
        f.length += rest.length
        f.value += rest.least + wp.float64(0.5) * (rest.most - rest.least)
        off *= wp.where(sums.mean, ONE / f.length, sums.unit)
    # Sums of as many numbers.
    f.count += 4 * rest.bricks
    half[y, x] = off
    found[y, x] = f


@wp.kernel(enable_backward=False, module="unique")
def settle_for_surfaces(
    base: int, view: View, unread: Unread, found: wp.array2d(dtype=Found), half: wp.array2d(dtype=wp.float64)
):
    """In ``half`` whatever may be behind what a ray has found, where it meets bricks that were not read, or may."""
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    f = found[y, x]
    if f.done == 1:
        return
    rest = rest_of(view, unread, x, y)
    meets = rest.bricks > 0
    steps = begun(view, unread, x, y)
    if steps.length <= ZERO:
        i = steps.index
        meets = unread.number[i[2], i[1], i[0]] >= 0 and doubtful(view, unread, steps, x, y) > ZERO
    if meets:
        half[y, x] = wp.max(half[y, x], (ONE - f.rgba[3]) * unread.brightest)
