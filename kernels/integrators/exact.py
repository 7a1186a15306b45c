"""The exact walk: cell by cell, and in a cell from control point to control point of the transfer function.

Where a ray runs in the face of two cells, one absent and one not, either may be the one it sees.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.walk import make_gather, make_walk
from ..light.points import make_shading
from ..segment import over
from ..transfer.function import make_transfer
from .pieces import Piece, make_pieces


@wp.struct
class ExactNodes:
    nodes: wp.array(dtype=wp.vec2d)  # of ``pieces.NODES``
    tolerance: wp.float64  # of light, as of ``shone``


@dataclass(frozen=True)
class Half:
    """The device half of the exact integral."""

    bounded = False
    sharp = False  # as of ``certified``
    tabled = False

    def Struct(self, halves):
        return ExactNodes

    def march(self, halves):
        return make_exact(halves)


@cache
def make_through(halves):
    """``through(scene, cell, here)``: segment of a piece in a cell, and the number of its own pieces."""
    finite = halves.field.finite
    Scene = halves.Scene
    cubic = halves.field.cubic()
    _, interval, _ = make_transfer(wp.float64)
    piece, cut = make_pieces(halves)

    @wp.func
    def through(scene: Scene, cell: wp.vec3i, here: Piece):
        corner = wp.vec3d(wp.float64(cell[0]), wp.float64(cell[1]), wp.float64(cell[2]))
        here.s = cubic(scene.field, cell[0], cell[1], cell[2], here.start - corner, here.d)
        if not wp.static(finite):
            # It has all corners in it.
            if not wp.isfinite(here.s[3]):
                return wp.vec4d(), int(0)
        # All that it can be.
        L = here.length
        wide = L * (wp.abs(here.s[1]) + L * (wp.abs(here.s[2]) + L * wp.abs(here.s[3])))
        k = interval(scene.transfer, here.s[0] - wide)
        if k == interval(scene.transfer, here.s[0] + wide):
            if scene.transfer.visible[k] != k:
                return wp.vec4d(), int(0)
            if wp.static(halves.light is None):
                return piece(scene, here, k), int(1)
        segment, _error, count = cut(scene, here)
        return segment, count

    return through


@cache
def make_exact(halves):
    """The march, as of ``scene``; what it counts are pieces that are integrated."""
    Scene = halves.Scene
    eye_of = make_shading(halves).eye
    through = make_through(halves)
    _, enter, _, _ = make_walk(wp.float64)
    _, gather = make_gather()

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64):
        ray = wp.vec4d()
        count = int(0)
        here = Piece()
        here.d = direction
        if wp.static(halves.light is not None):
            here.eye = eye_of(scene, direction)
        w = enter(scene.field.last, origin, direction, start)
        stop = wp.min(stop, w.out)
        while w.t < stop and ray[3] <= scene.opaque:
            w, cells = gather(scene.blocks, w, stop)
            for l in range(cells.count):
                if ray[3] <= scene.opaque and cells.length[l] > wp.float64(0.0):
                    here.start = origin + cells.start[l] * direction
                    here.length = cells.length[l]
                    here.T = wp.float64(1.0) - ray[3]
                    segment, pieces = through(
                        scene, wp.vec3i(cells.cell[0, l], cells.cell[1, l], cells.cell[2, l]), here
                    )
                    ray = over(ray, segment)
                    count += pieces
        return ray, count, wp.float64(0.0)

    return march
