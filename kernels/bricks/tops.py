"""Which bricks that are not read may have more than what rays have found, and what that comes to.

Values are times a sign: -1 where the smallest are looked for. ``Unread.least`` and ``most`` are what bricks have at
least and at most. Rays go through the bricks that ``brick.owned`` gives them.
"""

import warp as wp

from ..integrators.found import Found
from ..ray import FAR, View, pixel
from .unread import ZERO, Unread, begun, crossing, stepped


@wp.func
def possible(view: View, unread: Unread, x: int, y: int, best: wp.float64):
    """The brick in which there may be most, if that is more than the ``best``, else negative; and what there is along
    all of the ray at least and at most.
    """
    steps = begun(view, unread, x, y)
    least = best
    most = best
    which = int(-1)
    going = steps.length > ZERO
    while going:
        start, _axis, _e0 = crossing(unread, steps, False)
        end, axis, _e1 = crossing(unread, steps, True)
        i = steps.index
        n = unread.number[i[2], i[1], i[0]]
        if n >= 0 and end > start:
            if unread.most[n] > most:
                most = unread.most[n]
                which = n
            least = wp.max(least, unread.least[n])
        index, going = stepped(unread, steps, axis, True)
        if going:
            steps.index = index
    return which, least, most


@wp.kernel(enable_backward=False, module="unique")
def ask_for_most(base: int, view: View, unread: Unread, found: wp.array2d(dtype=Found), asked: wp.array2d(dtype=int)):
    """The number of the brick that each ray asks for."""
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    column = x * unread.stride
    row = y * unread.stride
    best = found[row, column].value
    which, _least, _most = possible(view, unread, column, row, best)
    asked[y, x] = which


@wp.kernel(enable_backward=False, module="unique")
def settle_for_middles(
    base: int, view: View, unread: Unread, found: wp.array2d(dtype=Found), half: wp.array2d(dtype=wp.float64)
):
    """The middle of what the value of a ray may be in place of what was found, and ``half`` of how far that is;
    infinite where nobody knows whether there is any.
    """
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    f = found[y, x]
    which, least, most = possible(view, unread, x, y, f.value)
    if which < 0:
        return
    steps = begun(view, unread, x, y)
    f.value = most
    half[y, x] = wp.float64(wp.inf)
    if least > -wp.float64(wp.inf):
        f.value = least + wp.float64(0.5) * (most - least)
        half[y, x] = wp.float64(0.5) * (most - least)
    f.place = -FAR
    # All of it counts.
    f.length = steps.length
    found[y, x] = f
