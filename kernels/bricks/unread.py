"""What bricks may look like of which only the range of samples is known.

In a stretch of length l the extinction is between a and b, and a colour, where there is extinction, between low and
high. So what is seen of X through it is between

    F+(X) = high + (X - high) exp(-(X < high ? b : a) l)  and  F-(X) = low + (X - low) exp(-(X > low ? b : a) l),

whatever the order of samples in it. The first is convex in X and the second concave, so that X -> C + T X, with T the
mean of both transparencies and C in the middle of what is left at X = 0 and X = brightest, is off by most at those two
(docs/proof.md, lemma 14).
"""

import warp as wp

from ..ray import FAR, View, ending, entry, inverted, line, near_faces, pixel
from .brick import on_grain

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))


@wp.struct
class Unread:
    """Bricks of a grid. Places of faces are those of ``brick.Brick``: far beyond the grid at its ends."""

    x: wp.array(dtype=wp.float64)  # faces along x, y, z
    y: wp.array(dtype=wp.float64)
    z: wp.array(dtype=wp.float64)
    number: wp.array3d(dtype=int)  # [z, y, x] which of the ranges a brick has, negative where it is left out
    least: wp.array(dtype=wp.float64)  # extinction
    most: wp.array(dtype=wp.float64)
    low: wp.array(dtype=wp.vec3d)  # colour where there is extinction
    high: wp.array(dtype=wp.vec3d)
    brightest: wp.float64
    densest: wp.float64  # largest extinction of any
    grain: wp.float64
    astray: wp.float64  # how far a ray may be from where it should be
    column: int  # of the image, that the first pixel is
    row: int
    # Of bricks that are read, where not all of them are:
    read: wp.array3d(dtype=int)  # [z, y, x] which image of these is a brick's, negative where it has none
    rects: wp.array(dtype=wp.vec4i)  # row, column, height and width of each
    first: wp.array(dtype=int)  # its first pixel
    rgbt: wp.array(dtype=wp.vec4d)  # colour and transparency
    bounds: wp.array(dtype=wp.float64)
    stride: int  # every so many pixels of the image are looked at


@wp.func
def between(faces: wp.array(dtype=wp.float64), p: wp.float64):
    """Number of the interval that p is in, its lower end included."""
    n = int(0)
    last = faces.shape[0] - 2
    while n < last and p >= faces[n + 1]:
        n += 1
    return n


@wp.func
def face(unread: Unread, axis: int, n: int):
    if axis == 0:
        return unread.x[n]
    if axis == 1:
        return unread.y[n]
    return unread.z[n]


@wp.func
def ends(X: wp.float64, low: wp.float64, high: wp.float64, thin: wp.float64, thick: wp.float64):
    """F-(X) and F+(X) for the transparencies of a and b."""
    most = high + (X - high) * wp.where(X < high, thick, thin)
    least = low + (X - low) * wp.where(X > low, thick, thin)
    return least, most


@wp.func
def seen_through(unread: Unread, n: int, short: wp.float64, long: wp.float64):
    """Colour and opacity of a stretch of a length from ``short`` to ``long``, and the bound on both."""
    half = wp.float64(0.5)
    thin = wp.exp(-unread.least[n] * short)
    thick = wp.exp(-unread.most[n] * long)
    T = half * (thin + thick)
    ray = wp.vec4d()
    bound = half * (thin - thick)
    for c in range(3):
        least0, most0 = ends(ZERO, unread.low[n][c], unread.high[n][c], thin, thick)
        least1, most1 = ends(unread.brightest, unread.low[n][c], unread.high[n][c], thin, thick)
        top = wp.max(most0, most1 - T * unread.brightest)
        bottom = wp.min(least0, least1 - T * unread.brightest)
        ray[c] = half * (top + bottom)
        bound = wp.max(bound, half * (top - bottom))
    ray[3] = ONE - T
    return ray, bound * wp.float64(wp.static(1.0 + 2.0**-40)) + unread.brightest * wp.float64(wp.static(2.0**-48))


@wp.struct
class Steps:
    """A ray's way through the bricks."""

    point: wp.vec3d
    inverse: wp.vec3d
    index: wp.vec3i
    length: wp.float64  # of the ray in the grid, up to the depth that ends it
    loose: wp.float64  # how far off that may be


@wp.func
def begun(view: View, unread: Unread, x: int, y: int):
    """At the first brick of a ray, whose length is 0 or less where it misses the grid."""
    steps = Steps()
    point, along, length, first = entry(view, x + unread.column, y + unread.row)
    end, loose = ending(view, x + unread.column, y + unread.row)
    steps.point = on_grain(point, unread.grain)
    steps.inverse = inverted(along)
    steps.length = wp.min(length, end - first)
    if loose > ZERO and length > ZERO:
        steps.loose = loose + wp.float64(wp.static(2.0**-50)) * wp.abs(first)
    p = steps.point
    # A ray that begins in a face and goes down has no length in the first brick.
    steps.index = wp.vec3i(between(unread.x, p[0]), between(unread.y, p[1]), between(unread.z, p[2]))
    return steps


@wp.func
def crossing(unread: Unread, steps: Steps, ahead: bool):
    """Where a ray leaves the brick that it is in, or (not ``ahead``) entered it, at most at the ray's end, or its
    beginning; the axis of that face, negative where it is none; and what being astray does to it.
    """
    t = wp.where(ahead, steps.length, ZERO)
    axis = int(-1)
    for a in range(3):
        v = steps.inverse[a]
        if v != ZERO:
            upper = (v > ZERO) == ahead
            at = (face(unread, a, steps.index[a] + wp.where(upper, 1, 0)) - steps.point[a]) * v
            if (ahead and at < t) or (not ahead and at > t):
                t = at
                axis = a
    e = unread.astray + wp.where(ahead, steps.loose, ZERO)
    if axis >= 0:
        e *= ONE + wp.abs(steps.inverse[axis])
    return t, axis, e


@wp.func
def stepped(unread: Unread, steps: Steps, axis: int, ahead: bool):
    """The index of the next brick, and whether there is one."""
    i = steps.index
    if axis < 0:
        return i, False
    up = (steps.inverse[axis] > ZERO) == ahead
    i[axis] += wp.where(up, 1, -1)
    count = wp.vec3i(unread.x.shape[0] - 1, unread.y.shape[0] - 1, unread.z.shape[0] - 1)
    return i, i[axis] >= 0 and i[axis] < count[axis]


@wp.func
def doubtful(view: View, unread: Unread, steps: Steps, x: int, y: int):
    """Length of a ray of which rounding decides whether it is in the box, or before the depth that ends it."""
    anchor, along, begin = line(view, x + unread.column, y + unread.row)
    e = wp.float64(2.0) * unread.astray
    return steps.loose + near_faces(view.low, view.high, anchor, inverted(along), e, begin - e, FAR)


@wp.kernel(enable_backward=False, module="unique")
def map_unread(
    base: int, view: View, unread: Unread, rgbt: wp.array2d(dtype=wp.vec4d), bounds: wp.array2d(dtype=wp.float64)
):
    """What they do to what is behind, along the ray of each work item of ``ray.pixel``."""
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    steps = begun(view, unread, x, y)
    ray = wp.vec4d()
    bound = ZERO
    T = ONE
    going = steps.length > ZERO
    while going:
        start, _axis, e0 = crossing(unread, steps, False)
        end, axis, e1 = crossing(unread, steps, True)
        n = unread.number[steps.index[2], steps.index[1], steps.index[0]]
        if n >= 0 and end > start:
            e = e0 + e1
            part, off = seen_through(unread, n, wp.max(end - start - e, ZERO), wp.min(end - start + e, steps.length))
            ray += T * part
            bound += T * off
            T -= T * part[3]
        index, going = stepped(unread, steps, axis, True)
        if going:
            steps.index = index
    rgbt[y, x] = wp.vec4d(ray[0], ray[1], ray[2], T)
    bounds[y, x] = wp.min(
        bound + unread.brightest * unread.densest * doubtful(view, unread, steps, x, y), unread.brightest
    )


@wp.func
def known(unread: Unread, steps: Steps, x: int, y: int):
    """Where among the pixels of bricks that are read the one is that a ray is in; negative where there is none."""
    n = int(-1)
    at = int(-1)
    if unread.read.shape[0] > 0:
        n = unread.read[steps.index[2], steps.index[1], steps.index[0]]
    if n >= 0:
        rect = unread.rects[n]
        row = y - rect[0]
        column = x - rect[1]
        if row >= 0 and row < rect[2] and column >= 0 and column < rect[3]:
            at = unread.first[n] + row * rect[3] + column
    return at


@wp.kernel(enable_backward=False, module="unique")
def weigh_unread(
    base: int, view: View, unread: Unread, largest: wp.array2d(dtype=int), widths: wp.array2d(dtype=wp.vec2d)
):
    """Which brick adds most to the bound of a ray, and how much that one and all of them add; by the middle of what is
    in front of each.
    """
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    column = x * unread.stride
    row = y * unread.stride
    steps = begun(view, unread, column, row)
    most = ZERO
    total = ZERO
    which = int(-1)
    T = ONE
    going = steps.length > ZERO
    while going:
        start, _axis, _e0 = crossing(unread, steps, False)
        end, axis, _e1 = crossing(unread, steps, True)
        i = steps.index
        n = unread.number[i[2], i[1], i[0]]
        if end > start:
            at = known(unread, steps, column, row)
            if at >= 0:
                pixels = unread.rgbt[at]
                T *= pixels[3]
            elif n >= 0:
                part, off = seen_through(unread, n, end - start, end - start)
                total += T * off
                if T * off > most:
                    most = T * off
                    which = (i[2] * unread.number.shape[1] + i[1]) * unread.number.shape[2] + i[0]
                T *= ONE - part[3]
        index, going = stepped(unread, steps, axis, True)
        if going:
            steps.index = index
    largest[y, x] = which
    widths[y, x] = wp.vec2d(most, total)


@wp.kernel(enable_backward=False, module="unique")
def show_unread(
    base: int, view: View, unread: Unread, least: wp.array2d(dtype=wp.vec4d), most: wp.array2d(dtype=wp.vec4d)
):
    """What there is to see at least and at most, colour and opacity, with nothing behind: of bricks that are read as
    they are, else between what they may look like, from face to face from the back.
    """
    x, y = pixel(view, wp.tid() + base)
    if y >= view.height:
        return
    steps = begun(view, unread, x, y)
    low = wp.vec4d()
    high = wp.vec4d()
    going = steps.length > ZERO
    while going:
        _t, axis, _e = crossing(unread, steps, True)
        index, going = stepped(unread, steps, axis, True)
        if going:
            steps.index = index
    going = steps.length > ZERO
    while going:
        start, axis, e0 = crossing(unread, steps, False)
        end, _axis, e1 = crossing(unread, steps, True)
        n = unread.number[steps.index[2], steps.index[1], steps.index[0]]
        at = known(unread, steps, x, y)
        if at >= 0:
            if end > start:
                pixels = unread.rgbt[at]
                T = pixels[3]
                color = wp.vec4d(pixels[0], pixels[1], pixels[2], ONE - T)
                off = unread.bounds[at]
                for c in range(4):
                    low[c] = wp.max(color[c] + T * low[c] - off, ZERO)
                    high[c] = color[c] + T * high[c] + off
        elif n >= 0:
            if end > start:
                e = e0 + e1
                thin = wp.exp(-unread.least[n] * wp.max(end - start - e, ZERO))
                thick = wp.exp(-unread.most[n] * wp.min(end - start + e, steps.length))
                for c in range(4):
                    dark = ONE
                    bright = ONE
                    if c < 3:
                        dark = unread.low[n][c]
                        bright = unread.high[n][c]
                    _least, up = ends(high[c], dark, bright, thin, thick)
                    down, _most = ends(low[c], dark, bright, thin, thick)
                    high[c] = up
                    low[c] = down
        index, going = stepped(unread, steps, axis, False)
        if going:
            steps.index = index
    loose = doubtful(view, unread, steps, x, y)
    off = unread.brightest * (wp.float64(wp.static(2.0**-40)) + wp.min(ONE, unread.densest * loose))
    for c in range(4):
        low[c] -= off
        high[c] += off
    least[y, x] = low
    most[y, x] = high
