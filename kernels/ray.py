"""Rays: which pixel a thread renders, and where its ray enters the volume's box.

All in float64 and, along the ray, relative to its own entry point: rays set up in float32 from a distant camera leave
an error that no step length removes. Lengths along a ray are in units of the smallest voxel spacing.
"""

import warp as wp


@wp.struct
class View:
    width: int
    height: int
    perspective: bool
    origin: wp.vec3d  # perspective: the camera; parallel: the image's centre [index coordinates]
    corner: wp.vec3d  # perspective: direction of view, parallel: origin of the ray, of the centre of pixel (0, 0)
    right: wp.vec3d  # one pixel to the right
    down: wp.vec3d  # one pixel down
    forward: wp.vec3d  # parallel: direction of all rays
    to_index: wp.mat33d  # world directions to index directions
    unit: wp.float64  # smallest voxel spacing [world length]
    low: wp.vec3d  # the box [index coordinates]
    high: wp.vec3d


# Pixels go tile by tile: neighbours in time are neighbours in the cache.
TILE = wp.constant(16)


def tiles(width, height):
    """Number of tiles of an image; the last of a row or column may reach beyond it."""
    return -(-width // int(TILE)) * -(-height // int(TILE))


@wp.func
def pixel(view: View, item: int):
    """Column and row of a work item; the row is ``height`` or more where the item is beyond the image."""
    across = (view.width + TILE - 1) // TILE
    tile = item // (TILE * TILE)
    within = item - tile * TILE * TILE
    row = tile // across
    x = (tile - row * across) * TILE + within % TILE
    y = row * TILE + within // TILE
    if x >= view.width:
        y = view.height
    return x, y


def item(width, x, y):
    """The work item of a pixel: the inverse of ``pixel``."""
    size = int(TILE)
    tile = y // size * -(-width // size) + x // size
    return (tile * size + y % size) * size + x % size


@wp.func
def entry(view: View, x: int, y: int):
    """Entry point and direction in index coordinates, and the length inside the box (<= 0: missed)."""
    across = wp.float64(x) * view.right + wp.float64(y) * view.down + view.corner
    origin = view.origin
    direction = view.forward
    start = wp.float64(-1.0e300)
    if view.perspective:
        direction = wp.normalize(across)
        start = wp.float64(0.0)
    else:
        origin = across
    direction = view.unit * (view.to_index @ direction)
    end = wp.float64(1.0e300)
    for a in range(3):
        if direction[a] != wp.float64(0.0):
            t0 = (view.low[a] - origin[a]) / direction[a]
            t1 = (view.high[a] - origin[a]) / direction[a]
            start = wp.max(start, wp.min(t0, t1))
            end = wp.min(end, wp.max(t0, t1))
        elif origin[a] < view.low[a] or origin[a] > view.high[a]:
            end = wp.float64(-1.0e300)
    point = origin + start * direction
    for a in range(3):
        point[a] = wp.clamp(point[a], view.low[a], view.high[a])
    return point, direction, end - start
