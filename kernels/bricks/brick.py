"""Bricks: parts of a grid that are rendered one by one, each as of the rays of the whole.

Where a ray enters the whole is rounded to a multiple of a power of two, so that neither taking a brick's offset from it
nor a face from that rounds: places along the ray of a face that two bricks share are the same number in both, and what
the one leaves is where the other begins. A ray in such a face belongs to the brick that the face is the lower one of
(docs/proof.md, lemma 13).
"""

import warp as wp


@wp.struct
class Brick:
    low: (
        wp.vec3d
    )  # what is its own of the whole [index coordinates of that]; far beyond it where it has the whole's face
    high: wp.vec3d
    offset: wp.vec3d  # its first sample, whole numbers
    edges: bool  # rays may begin or end in what there is to see: at the whole's faces, or at the camera
    column: int  # of the image, that its first pixel is
    row: int
    front: wp.array2d(dtype=wp.float64)  # transparency in front of its image, where something is
    foremost: bool  # its image has all that is in front
    enter: wp.float64  # of a ray
    leave: wp.float64
    opacity: wp.float64  # rounding of a ray, in parts of its opacity in the brick,
    length: wp.float64  # and for each unit of its length
    astray: wp.float64  # that the opacity and the whole's longest ray allow for it to be astray, both
    longest: wp.float64


@wp.func
def on_grain(p: wp.vec3d, grain: wp.float64):
    """The nearest multiple."""
    return grain * wp.vec3d(wp.rint(p[0] / grain), wp.rint(p[1] / grain), wp.rint(p[2] / grain))


@wp.func
def owned(brick: Brick, point: wp.vec3d, inverse: wp.vec3d, start: wp.float64, stop: wp.float64):
    """What of a ray's [start, stop] is in the brick, the wrong way round if there is nothing."""
    for a in range(3):
        if inverse[a] != wp.float64(0.0):
            t0 = (brick.low[a] - point[a]) * inverse[a]
            t1 = (brick.high[a] - point[a]) * inverse[a]
            start = wp.max(start, wp.min(t0, t1))
            stop = wp.min(stop, wp.max(t0, t1))
        elif point[a] < brick.low[a] or point[a] >= brick.high[a]:
            stop = start - wp.float64(1.0)
    return start, stop


@wp.func
def has(first: wp.float64, last: wp.float64, end: wp.float64, loose: wp.float64):
    """Whether what is ``owned`` of a ray may have its end, which may be so far from where it is said to be."""
    return first <= end + loose and last >= end - loose


@wp.func
def clearing(brick: Brick, x: int, y: int, front: wp.float64, limit: wp.float64):
    """The transparency at which a ray ends that ends at a ``limit`` in all, of the brick alone; above 1 where it ended
    in front of it. ``front`` is what the image lets through so far.
    """
    if brick.front.shape[0] > 0:
        front *= brick.front[y, x]
    return limit / wp.max(front, wp.float64(1.0e-300))


@wp.func
def unspent(brick: Brick, T: wp.float64, bound: wp.float64, opacity: wp.float64, length: wp.float64):
    """What a ray was allowed to be off by in front of the brick and is not, of an image whose bound and transparency
    these are, in parts of that: for ``opacity``, as much as it had, and for a ``length``.
    """
    # Of next to nothing it would be more than single precision holds.
    if not brick.foremost or T < wp.float64(1.0e-20):
        return wp.float64(0.0)
    return wp.max(opacity * (wp.float64(1.0) - T) + length - bound, wp.float64(0.0)) / T


@wp.func
def middles_before(t: wp.float64, step: wp.float64, count: int):
    """Of so many segments from 0 on, how many have their middles before t."""
    half = wp.float64(0.5)
    n = int(wp.clamp(wp.ceil(t / step - half), wp.float64(0.0), wp.float64(count)))
    while n > 0 and (wp.float64(n) - half) * step >= t:
        n -= 1
    while n < count and (wp.float64(n) + half) * step < t:
        n += 1
    return n
