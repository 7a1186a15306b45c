"""Segments that a clip volume cuts, as in section 2 of Roettger et al., "Smart Hardware-Accelerated Volume Rendering"
(2003): the clip field is taken to be linear between its values at the segment's ends, like the scalar.

From the visible part [r, g] of the segment follow the scalars at its ends and the share b = g - r of its length. A 2D
table knows segments of the whole length only; ``parts`` says what is made of its entry (C, A) for the new scalars:

* "first-order": b C and b A, as the paper's shader does, right where the segment is thin;
* "power": b C and 1 - (1 - A)^b, the opacity of that length, as its text does;
* "ratio": the same opacity, and the colour in proportion to it;
* "isosurface": C and A, for tables of isosurfaces, whose opacity does not depend on the length of a segment;
* "length": integrated anew for its own length, which is what a table of all lengths would hold.

Lit, a segment has the light of its ends moved to the cut: of intensities that are linear along it, the mean over what
is visible is that at a = (r + g) / 2.
"""

from functools import cache

import warp as wp

from ..field.samples import make_value
from ..segment import make_absorbed, widened
from ..transfer.lookup import make_table
from .volumes import make_clipping

PARTS = ("first-order", "power", "ratio", "isosurface", "length")


@cache
def make_factors(dtype):
    """``factors(clipping, a, b)`` -> (r, g) of the segment from point a to point b; nothing is visible if r >= g."""
    _, Clipping = make_clipping(dtype)
    value = make_value(dtype, wp.float64)

    @wp.func
    def factors(clipping: Clipping, a: wp.vec3d, b: wp.vec3d):
        r = wp.float64(0.0)
        g = wp.float64(1.0)
        for n in range(clipping.partial_volumes.shape[0]):
            clip = clipping.partial_volumes[n]
            # Outside its box the field is that of the nearest point, as in a texture.
            p = clip.matrix @ a + clip.offset
            q = clip.matrix @ b + clip.offset
            for axis in range(3):
                p[axis] = wp.clamp(p[axis], clip.low[axis], clip.high[axis])
                q[axis] = wp.clamp(q[axis], clip.low[axis], clip.high[axis])
            sign = wp.where(clip.invert, wp.float64(-1.0), wp.float64(1.0))
            front = sign * (value(clip.field, p) - clip.iso)
            back = sign * (value(clip.field, q) - clip.iso)
            if front < wp.float64(0.0) and back < wp.float64(0.0):
                r = wp.float64(1.0)
            elif front < wp.float64(0.0):
                r = wp.max(r, front / (front - back))
            elif back < wp.float64(0.0):
                g = wp.min(g, front / (front - back))
        return r, g

    return factors


@cache
def make_partial(halves, linear_segment):
    """``partial(scene, a, b, front, back, h)`` -> what is visible of the segment of length h from point a to point b,
    and where its middle is, in parts of the whole.

    ``linear_segment`` is that of ``linear``.
    """
    real = halves.real
    parts = halves.cuts.parts
    Scene = halves.Scene
    _, lookup = make_table(real)
    absorbed, _ = make_absorbed(wp.float64)
    factors = make_factors(halves.cuts.volumes)

    @wp.func
    def partial(scene: Scene, a: wp.vec3d, b: wp.vec3d, front: real, back: real, h: real):
        r, g = factors(scene.cuts.clipping, a, b)
        middle = real(wp.float64(0.5) * (r + g))
        segment = wp.vec4d()
        if r < g:
            s0 = front + real(r) * (back - front)
            s1 = front + real(g) * (back - front)
            if wp.static(parts == "length"):
                return linear_segment(scene.transfer, scene.march.nodes, s0, s1, real(g - r) * h), middle
            # Of the length that the table is for.
            share = (g - r) * wp.float64(h) / scene.march.step
            segment = widened(lookup(scene.table, s0, s1))
            if wp.static(parts == "first-order"):
                segment *= share
            elif wp.static(parts in ("power", "ratio")):
                A = absorbed(-share * wp.log(wp.max(wp.float64(1.0) - segment[3], wp.float64(1.0e-300))))
                if wp.static(parts == "power"):
                    segment *= share
                elif segment[3] > wp.float64(0.0):
                    segment *= A / segment[3]
                segment[3] = A
        return segment, middle

    return partial
