"""What a probe has found along a ray so far; it goes on from stretch to stretch."""

import warp as wp

from ..ray import FAR

# What is left of a ray may be missed where it is shorter [smallest voxel spacing].
SHORTEST = 1.0e-6
# Of a ray that is longer in faces of absent cells, where rounding decides on which side, any isosurface is in doubt.
GRAZED = 2.0**-24


@wp.struct
class Side:
    """Of a ray among isosurfaces, what goes on from cell to cell."""

    above: int  # so many levels
    until: wp.float64  # where the cell before ended; -FAR if there was none
    near: int  # so many levels are so near to where it ended that rounding decides
    way: int  # and 1 if it surely rose there, -1 if it fell, 0 if neither is sure


@wp.struct
class Found:
    """Lengths in units of the smallest voxel spacing from where the ray enters the box."""

    rgba: wp.vec4d
    value: wp.float64
    place: wp.float64  # where the value is taken; -FAR while there is none
    hint: wp.float64  # where the ray beside has its value; -FAR if that is not known
    length: wp.float64  # of what was probed
    loose: wp.float64  # of that and of what is beside it, where rounding decides on which it is
    grazed: wp.float64  # of the part that is probed, in faces of absent cells
    bound: wp.float64
    clear: wp.float64  # of isosurfaces, transparency where it was last sure which crossings there are
    count: int  # what it cost
    state: int  # of labels, that of the stretch
    held: int  # and that of the value
    side: Side
    done: int  # 1 if nothing more is asked for
    ends: int  # of a ray in bricks, which of ``kernels.bricks.probe`` is done


@wp.func
def nothing():
    """At the beginning of a ray."""
    found = Found()
    found.value = -wp.float64(wp.inf)
    found.place = -FAR
    found.hint = -FAR
    found.clear = wp.float64(1.0)
    found.side.until = -FAR
    return found
