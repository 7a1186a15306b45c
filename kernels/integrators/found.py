"""What a probe has found along a ray so far; it goes on from stretch to stretch."""

import warp as wp

from ..ray import FAR


@wp.struct
class Found:
    """Lengths in units of the smallest voxel spacing from where the ray enters the box."""

    rgba: wp.vec4d
    value: wp.float64
    place: wp.float64  # where the value is taken; -FAR while there is none
    hint: wp.float64  # where the ray beside has its value; -FAR if that is not known
    length: wp.float64  # of what was probed
    loose: wp.float64  # of that and of what is beside it, where rounding decides on which it is
    bound: wp.float64
    clear: wp.float64  # of isosurfaces, transparency where it was last sure which crossings there are
    count: int  # what it cost
    state: int  # of labels, that of the stretch
    held: int  # and that of the value


@wp.func
def nothing():
    """At the beginning of a ray."""
    found = Found()
    found.value = -wp.float64(wp.inf)
    found.place = -FAR
    found.hint = -FAR
    found.clear = wp.float64(1.0)
    return found
