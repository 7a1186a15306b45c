"""Light where it is asked for, which is kept in the cells of slices."""

from functools import cache

import warp as wp


@cache
def make_between(real, smooth, least):
    """``light_on(stack, number, u, v)``, that of a slice, ``smooth`` or linear between its cells;
    ``fading(L0, L1, s, x)``, from one slice to the next; and ``between(stack, slot, u, v, x)``, both. Light of less
    than ``least`` is as good as none.
    """

    @wp.func
    def linear(stack: wp.array3d(dtype=real), number: int, u: real, v: real):
        """Light of a slice, linear between cells, as graphics hardware has it; 1 beyond its border."""
        rows = stack.shape[1]
        columns = stack.shape[2]
        if not (u >= real(0.0) and v >= real(0.0) and u <= real(columns - 1) and v <= real(rows - 1)):
            return real(1.0)
        i = wp.max(wp.min(int(u), columns - 2), 0)
        j = wp.max(wp.min(int(v), rows - 2), 0)
        x = u - real(i)
        y = v - real(j)
        a = stack[number, j, i]
        b = stack[number, j + 1, i]
        a += x * (stack[number, j, i + 1] - a)
        b += x * (stack[number, j + 1, i + 1] - b)
        return a + y * (b - a)

    @wp.func
    def around(stack: wp.array3d(dtype=real), number: int, j: int, i: int, before: real, behind: real):
        """Of three cells of a row, as much of the first and of the last."""
        here = stack[number, j, i]
        return here + before * (stack[number, j, i - 1] - here) + behind * (stack[number, j, i + 1] - here)

    @wp.func
    def spline(stack: wp.array3d(dtype=real), number: int, u: real, v: real):
        """The same by a quadratic B-spline, which blurs alike wherever cells lie, so that they do not show."""
        rows = stack.shape[1]
        columns = stack.shape[2]
        if not (u >= real(0.5) and v >= real(0.5) and u <= real(columns) - real(1.5) and v <= real(rows) - real(1.5)):
            return linear(stack, number, u, v)
        i = wp.min(int(u + real(0.5)), columns - 2)
        j = wp.min(int(v + real(0.5)), rows - 2)
        x = u - real(i)
        y = v - real(j)
        x0 = real(0.5) * (real(0.5) - x) * (real(0.5) - x)
        y0 = real(0.5) * (real(0.5) - y) * (real(0.5) - y)
        a = around(stack, number, j - 1, i, x0, x0 + x)
        b = around(stack, number, j, i, x0, x0 + x)
        c = around(stack, number, j + 1, i, x0, x0 + x)
        return b + y0 * (a - b) + (y0 + y) * (c - b)

    light_on = spline if smooth else linear

    @wp.func
    def grown(s: real, x: real):
        """sinh(x s) / x for x up to 8."""
        w = s * s * x * x / real(6.0)
        more = real(0.3) * (real(1.0) + w / real(7.0) * (real(1.0) + w * (real(1.0 / 12.0) + w / real(220.0))))
        return s * (real(1.0) + w * (real(1.0) + w * more))

    @wp.func
    def fading(L0: real, L1: real, s: real, x: real):
        """Light between two slices, s of the way: of L'' = x^2 L, x what tissue there takes of log L a slab, if light
        does go by as much, else as much as it goes by. So it is exact where tissue is uniform, and linear where light
        goes for another reason, a surface or a shadow's edge.
        """
        dark = real(wp.static(least))
        one = wp.min(wp.min(x, real(8.0)), wp.abs(wp.log(wp.max(L0, dark) / wp.max(L1, dark))))
        return (grown(real(1.0) - s, one) * L0 + grown(s, one) * L1) / grown(real(1.0), one)

    @wp.func
    def between(stack: wp.array3d(dtype=real), slot: real, u: real, v: real, x: real):
        """Light at a place in the stack, as ``fading``."""
        number = wp.clamp(int(slot), 0, stack.shape[0] - 2)
        return fading(light_on(stack, number, u, v), light_on(stack, number + 1, u, v), slot - real(number), x)

    return light_on, fading, between
