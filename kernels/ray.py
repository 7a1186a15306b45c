"""Rays: which pixel a thread renders, and where its ray enters the volume's box.

All in float64 and, along the ray, relative to its own entry point: rays set up in float32 from a distant camera leave
an error that no step length removes. Lengths along a ray are in units of the smallest voxel spacing.
"""

import warp as wp

# Never reached along any ray.
FAR = wp.constant(wp.float64(1.0e300))
# The bound of a ray that is left to another launch, or more; any other bound is less.
LEAVE = wp.constant(wp.float64(1.0e30))


@wp.struct
class View:
    """Rays are anchored in a plane across the view, near the volume: however far away the camera is, no digits of
    where they are are lost.
    """

    width: int
    height: int
    perspective: bool
    anchor: wp.vec3d  # where the ray of pixel (0, 0) is in that plane [index coordinates]
    right: wp.vec3d  # one pixel to the right
    down: wp.vec3d  # one pixel down
    way: wp.vec3d  # direction of the ray of pixel (0, 0) [world]
    way_right: wp.vec3d  # what a pixel adds to it
    way_down: wp.vec3d
    depth: wp.float64  # from the camera's plane to the anchors', along the view [world length]
    broad: wp.float64  # largest of what the ways of rays are sums of, as long as the view's axis is 1
    rounded: wp.float64  # how far rounding may put that from what it should be
    ends: wp.array2d(dtype=wp.float64)  # of rays, in the same way; empty where they end nowhere
    to_index: wp.mat33d  # world directions to index directions
    unit: wp.float64  # smallest voxel spacing [world length]
    low: wp.vec3d  # the box [index coordinates]
    high: wp.vec3d
    seen_low: wp.vec3d  # the box of all that there is to see, inside that
    seen_high: wp.vec3d
    grain: wp.float64  # above 0: a power of two, of which all places where rays enter are multiples (``bricks.brick``)
    astray: wp.float64  # how far rounding may put a ray from where it should be, in the box [index coordinates]
    stop: wp.array(dtype=int)  # not 0: the rest of the image is no longer asked for; empty where nobody would say so


# Pixels go tile by tile: neighbours in time are neighbours in the cache.
TILE = wp.constant(16)


def tiles(width, height):
    """Number of tiles of an image; the last of a row or column may reach beyond it."""
    return -(-width // int(TILE)) * -(-height // int(TILE))


@wp.func
def stopped(view: View):
    """Whether the rest of the image is no longer asked for."""
    if view.stop.shape[0] == 0:
        return False
    return view.stop[0] != 0


@wp.func
def place(view: View, item: int):
    """Column and row of a work item, whether there is anything to do or not."""
    across = (view.width + TILE - 1) // TILE
    tile = item // (TILE * TILE)
    within = item - tile * TILE * TILE
    row = tile // across
    return (tile - row * across) * TILE + within % TILE, row * TILE + within // TILE


@wp.func
def pixel(view: View, item: int):
    """Column and row of a work item; the row is ``height`` or more where there is nothing to do: beyond the image, or
    when the rest of it is no longer asked for, which may be so at any time: asked again it may say something else.
    """
    x, y = place(view, item)
    if x >= view.width or stopped(view):
        y = view.height
    return x, y


def item(width, x, y):
    """The work item of a pixel: the inverse of ``pixel``."""
    size = int(TILE)
    tile = y // size * -(-width // size) + x // size
    return (tile * size + y % size) * size + x % size


@wp.func
def inverted(direction: wp.vec3d):
    """One over each component; 0 along an axis that a ray is across."""
    inverse = wp.vec3d()
    for a in range(3):
        if direction[a] != wp.float64(0.0):
            inverse[a] = wp.float64(1.0) / direction[a]
    return inverse


@wp.func
def inside(low: wp.vec3d, high: wp.vec3d, origin: wp.vec3d, inverse: wp.vec3d, start: wp.float64, end: wp.float64):
    """The part of [start, end] in which a ray is inside a box, the wrong way round if there is none."""
    # Comparisons, since Warp's min and max also look for NaN.
    for a in range(3):
        if inverse[a] != wp.float64(0.0):
            t0 = (low[a] - origin[a]) * inverse[a]
            t1 = (high[a] - origin[a]) * inverse[a]
            near = wp.where(t0 < t1, t0, t1)
            far = wp.where(t0 < t1, t1, t0)
            start = wp.where(near > start, near, start)
            end = wp.where(far < end, far, end)
        elif origin[a] < low[a] or origin[a] > high[a]:
            end = -FAR
    return start, end


@wp.func
def apart(outer: wp.vec2d, inner: wp.vec2d, start: wp.float64, end: wp.float64):
    """Length inside [start, end] of an outer stretch without the inner one that it contains; either may be the wrong
    way round. Of differences of what is close, so that no rounding of long ones is in it.
    """
    a = wp.max(outer[0], start)
    b = wp.min(outer[1], end)
    c = wp.max(inner[0], start)
    d = wp.min(inner[1], end)
    length = wp.max(b - a, wp.float64(0.0))
    if d > c:
        length = wp.max(c - a, wp.float64(0.0)) + wp.max(b - d, wp.float64(0.0))
    return length


@wp.func
def near_faces(
    low: wp.vec3d,
    high: wp.vec3d,
    origin: wp.vec3d,
    inverse: wp.vec3d,
    e: wp.float64,
    start: wp.float64,
    end: wp.float64,
):
    """Length inside [start, end] between a box of at least 1 along each axis made larger and made smaller by e."""
    edge = wp.vec3d(e, e, e)
    near, far = inside(low - edge, high + edge, origin, inverse, start, end)
    closer = FAR
    closer_far = -FAR
    if e < wp.float64(0.5):
        closer, closer_far = inside(low + edge, high - edge, origin, inverse, start, end)
    return apart(wp.vec2d(near, far), wp.vec2d(closer, closer_far), start, end)


@wp.func
def line(view: View, x: int, y: int):
    """Where a ray is in the plane of its anchor, its direction, both in index coordinates, and where it begins."""
    anchor = view.anchor + wp.float64(x) * view.right + wp.float64(y) * view.down
    way = view.way + wp.float64(x) * view.way_right + wp.float64(y) * view.way_down
    size = wp.length(way)
    direction = (view.unit / size) * (view.to_index @ way)
    first = -FAR
    if view.perspective:
        first = -view.depth * size / view.unit
    return anchor, direction, first


@wp.func
def entry(view: View, x: int, y: int):
    """Entry point and direction in index coordinates, the length inside the box (<= 0: missed), and where the entry is
    from the anchor on.
    """
    anchor, direction, first = line(view, x, y)
    start, end = inside(view.low, view.high, anchor, inverted(direction), first, FAR)
    point = anchor + start * direction
    for a in range(3):
        point[a] = wp.clamp(point[a], view.low[a], view.high[a])
    return point, direction, end - start, start


@wp.func
def obliquity(view: View, x: int, y: int):
    """Length along a ray for a unit of depth [smallest voxel spacing over world length]."""
    way = view.way + wp.float64(x) * view.way_right + wp.float64(y) * view.way_down
    return wp.length(way) / view.unit


@wp.func
def slack(view: View, oblique: wp.float64, depth: wp.float64):
    """How far rounding may put the place of a ray that is at a depth from the camera."""
    ulps = (view.broad + oblique * view.unit) * (wp.abs(depth) + wp.abs(view.depth))
    return oblique * (view.rounded + wp.float64(wp.static(2.0**-49)) * ulps)


@wp.func
def ending(view: View, x: int, y: int):
    """Where a ray ends by the depths of an image, from its anchor on, and how far rounding may put that."""
    end = FAR
    off = wp.float64(0.0)
    if view.ends.shape[0] > 0:
        depth = view.ends[y, x]
        # False for NaN.
        if depth < FAR:
            oblique = obliquity(view, x, y)
            end = (depth - view.depth) * oblique
            off = slack(view, oblique, depth) + wp.float64(wp.static(2.0**-50)) * wp.abs(end)
    return end, off
