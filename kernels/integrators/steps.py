"""The steps of a ray, written down."""

import warp as wp


@wp.struct
class Step:
    """A step that a ray took; lengths in units of the smallest voxel spacing, errors absolute in any channel."""

    t: wp.float64  # where it starts
    length: wp.float64
    tolerance: wp.float64  # that of its length
    depth_error: wp.float64  # estimate, for its length, of the interval of the inner integral that it lies in
    error: wp.float64  # estimate of the outer integral; 0 where nothing absorbs
    forced: bool  # taken in spite of an estimate above the tolerance
    rgba: wp.vec4d  # the ray's composite at its end


@wp.struct
class Trace:
    steps: wp.array(dtype=Step)
    taken: int  # steps in stretches of the ray before this one
    front: wp.vec4d  # composite of those before
