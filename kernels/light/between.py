"""Light where it is asked for, which is kept in the cells of slices."""

from functools import cache

import warp as wp

# The same in vectors, after ``eyes.NUMBERS``: of slices in cells one by one.
LIGHT = """
const int rows = stack.shape[1], columns = stack.shape[2];
// Light of a slice, linear between cells; 1 beyond its border.
auto linear = [&](const float* L, float u, float v) __attribute__((noinline)) -> float {
    if (!(u >= 0.0f && v >= 0.0f && u <= (float)(columns - 1) && v <= (float)(rows - 1))) return 1.0f;
    const int i = MORE(LESS((int)u, columns - 2), 0), j = MORE(LESS((int)v, rows - 2), 0);
    const float x = u - (float)i, y = v - (float)j;
    const float* c = L + (int64_t)j * columns + i;
    const float a = c[0] + x * (c[1] - c[0]), b = c[columns] + x * (c[columns + 1] - c[columns]);
    return a + y * (b - a);
};
// By a quadratic B-spline, three rows of four cells each: where they are, and what of them counts. Behind the last
// slice there is room for one more cell.
struct Spot {
    bool inner;
    int64_t middle;
    float before, behind;
    v4f across;
};
auto spot = [&](float u, float v) -> Spot {
    const bool inner = u >= 0.5f && v >= 0.5f && u <= (float)columns - 1.5f && v <= (float)rows - 1.5f;
    if (!inner) return {};
    const int i = LESS((int)(u + 0.5f), columns - 2), j = LESS((int)(v + 0.5f), rows - 2);
    const float x = u - (float)i, y = v - (float)j;
    const float x0 = 0.5f * (0.5f - x) * (0.5f - x), y0 = 0.5f * (0.5f - y) * (0.5f - y);
    return {true, (int64_t)j * columns + i - 1, y0, y0 + y, {x0, 1.0f - 2.0f * x0 - x, x0 + x, 0.0f}};
};
auto light = [&](int number, float u, float v) -> float {
    const float* L = stack.data + (int64_t)number * rows * columns;
    const Spot s = spot(u, v);
    if (!s.inner) return linear(L, u, v);
    const float* c = L + s.middle;
    const v4f a = *(const v4f*)(c - columns), b = *(const v4f*)c, d = *(const v4f*)(c + columns);
    const v4f of = s.across * (b + s.before * (a - b) + s.behind * (d - b));
    return of[0] + of[1] + of[2];
};
// That of a slice and of the next, of the same cells.
auto two_lights = [&](int number, float u, float v, float& near, float& far) {
    const int64_t slice = (int64_t)rows * columns;
    const float* L = stack.data + number * slice;
    const Spot s = spot(u, v);
    if (!s.inner) {
        near = linear(L, u, v);
        far = linear(L + slice, u, v);
        return;
    }
    const float* c = L + s.middle;
#define TWO_OF(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7)
    auto row = [&](const float* c) -> v8f { return TWO_OF(*(const v4f*)c, *(const v4f*)(c + slice)); };
    const v8f a = row(c - columns), b = row(c), d = row(c + columns);
    const v8f of = TWO_OF(s.across, s.across) * (b + s.before * (a - b) + s.behind * (d - b));
    near = of[0] + of[1] + of[2];
    far = of[4] + of[5] + of[6];
};
// Light from L0 to L1 between two slices, as below.
auto faded = [&](vf L0, vf L1, vf s, vf x, vf part, vf D) -> vf {
    if (!bits(x > 0.01f)) return L0 + s * (L1 - L0);
    const vf one = LESS(LESS(x, none + 8.0f), ABS(logarithm(MORE(L0, none + LEAST) / MORE(L1, none + LEAST))));
    auto grown = [&](vf s) -> vf {
        const vf w = s * s * (one * one) * (1.0f / 6);
        const vf more = 0.3f * (1.0f + w * (1.0f / 7) * (1.0f + w * (1.0f / 12 + w * (1.0f / 220))));
        return s * (1.0f + w * (1.0f + w * more));
    };
    const vf y = part * (L0 > L1 ? one : -one);
    const vf L = (grown(1.0f - s) * L0 + grown(s) * L1) / grown(none + 1.0f);
    return L * (1.0f + y * (D * (1.0f / 12) + y * (1.0f / 24)));
};
"""


@cache
def make_between(real, smooth, least):
    """``light_on(stack, number, u, v)``, that of a slice, ``smooth`` or linear between its cells;
    ``fading(L0, L1, s, x, part, D)``, from one slice to the next; and ``between(stack, slot, u, v, x)``, both. Light of
    less than ``least`` is as good as none.
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
    def fading(L0: real, L1: real, s: real, x: real, part: real, D: real):
        """Light between two slices, s of the way: of L'' = x^2 L, x what tissue there takes of log L a slab, if light
        does go by as much, else as much as it goes by. So it is exact where tissue is uniform, and linear where light
        goes for another reason, a surface or a shadow's edge. In the mean of what is emitted in a ``part`` of the slab
        about there, which is D deep for the eye, to second order.
        """
        dark = real(wp.static(least))
        one = wp.min(wp.min(x, real(8.0)), wp.abs(wp.log(wp.max(L0, dark) / wp.max(L1, dark))))
        y = part * wp.where(L0 > L1, one, -one)
        L = (grown(real(1.0) - s, one) * L0 + grown(s, one) * L1) / grown(real(1.0), one)
        return L * (real(1.0) + y * (D / real(12.0) + y / real(24.0)))

    @wp.func
    def between(stack: wp.array3d(dtype=real), slot: real, u: real, v: real, x: real):
        """Light at a place in the stack, as ``fading``."""
        number = wp.clamp(int(slot), 0, stack.shape[0] - 2)
        near = light_on(stack, number, u, v)
        return fading(near, light_on(stack, number + 1, u, v), slot - real(number), x, real(0.0), real(0.0))

    return light_on, fading, between
