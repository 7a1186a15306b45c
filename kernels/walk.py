"""Walking a ray through a grid, by cells or by cubes of cells: where it leaves one, and which it enters.

Indices are counted on from face to face, never computed from positions alone, which may round to either side of a face.
"""

import warp as wp

from .ray import FAR


@wp.func
def ahead(t: wp.float64):
    """A point of a ray so little behind t that nothing is missed, but clear of the rounding of t: what holds there
    holds from t on [smallest voxel spacing].
    """
    return t + wp.max(wp.float64(1.0e-11), wp.float64(1.0e-14) * t)


@wp.func
def cell_at(last: wp.vec3i, p: wp.vec3d):
    """The cell, at most ``last``, that a point is in."""
    cell = wp.vec3i()
    for a in range(3):
        cell[a] = wp.clamp(int(p[a]), 0, last[a])
    return cell


@wp.func
def leaving(last: wp.vec3i, origin: wp.vec3d, direction: wp.vec3d, cell: wp.vec3i, size: int):
    """Where a ray leaves the cube of ``size`` cells that a cell is in, and across which axis.

    It never leaves the grid: the outermost cubes have no end.
    """
    end = FAR
    axis = int(0)
    for a in range(3):
        face = cell[a] - cell[a] % size
        if direction[a] > wp.float64(0.0):
            face += size
        if direction[a] != wp.float64(0.0) and face > 0 and face <= last[a]:
            t = (wp.float64(face) - origin[a]) / direction[a]
            if t < end:
                end = t
                axis = a
    return end, axis


@wp.func
def entering(
    last: wp.vec3i, origin: wp.vec3d, direction: wp.vec3d, cell: wp.vec3i, size: int, end: wp.float64, axis: int
):
    """The cell behind the face across ``axis`` that a ray leaves the cube of ``cell`` through at ``end``."""
    there = cell
    for a in range(3):
        first = cell[a] - cell[a] % size
        there[a] = wp.clamp(int(origin[a] + end * direction[a]), first, wp.min(first + size - 1, last[a]))
    first = cell[axis] - cell[axis] % size
    there[axis] = wp.where(direction[axis] > wp.float64(0.0), first + size, first - 1)
    return there
