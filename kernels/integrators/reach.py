"""Where a ray has an opacity, and the scalar there: in the cell in which the exact integral reaches it."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.walk import make_gather, make_walk
from ..ray import FAR
from ..segment import over
from .exact import make_through
from .found import Found
from .pieces import Piece


@wp.struct
class Opacity:
    nodes: wp.array(dtype=wp.vec2d)  # of ``pieces.NODES``
    opacity: wp.float64


@dataclass(frozen=True)
class Half:
    """The device half of places of an opacity."""

    bounded = False
    sharp = False  # as of ``certified``
    tabled = False
    borders = False

    def Struct(self, halves):
        return Opacity

    def probe(self, halves):
        return make_probe(halves)

    def told(self, halves):
        return make_told(halves)


@cache
def make_probe(halves):
    """``probe`` of ``kernels.probe``."""
    Scene = halves.Scene
    through = make_through(halves)
    value = halves.field.value(wp.float64)
    _, enter, _, _ = make_walk(wp.float64)
    _, gather = make_gather()

    @wp.func
    def reached(scene: Scene, cell: wp.vec3i, piece: Piece, ray: wp.vec4d, whole: wp.float64):
        """Length of a piece of ray in a cell at which the ray has the opacity, which it has at the piece's end."""
        goal = scene.march.opacity
        low = wp.float64(0.0)
        high = piece.length
        at_low = ray[3] - goal
        at_high = whole - goal
        here = piece
        half = wp.float64(0.5)
        # The method of Illinois: a secant that does not keep the same end for ever.
        for _ in range(60):
            if at_high > wp.float64(0.0) and high - low > wp.float64(1.0e-14) * piece.length:
                t = wp.clamp(low - at_low * (high - low) / (at_high - at_low), low, high)
                if t <= low or t >= high:
                    t = half * (low + high)
                here.length = t
                segment, _count = through(scene, cell, here)
                miss = over(ray, segment)[3] - goal
                if miss < wp.float64(0.0):
                    low = t
                    at_low = miss
                    at_high *= half
                else:
                    high = t
                    at_high = miss
                    at_low *= half
        return high

    @wp.func
    def probe(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64, given: Found):
        found = given
        here = Piece()
        here.d = direction
        w = enter(scene.field.last, origin, direction, start)
        end = wp.min(stop, w.out)
        while w.t < end and found.place == -FAR:
            w, cells = gather(scene.blocks, w, end)
            for l in range(cells.count):
                if found.place == -FAR and cells.length[l] > wp.float64(0.0):
                    here.start = origin + cells.start[l] * direction
                    here.length = cells.length[l]
                    cell = wp.vec3i(cells.cell[0, l], cells.cell[1, l], cells.cell[2, l])
                    segment, pieces = through(scene, cell, here)
                    found.count += pieces
                    ray = over(found.rgba, segment)
                    if ray[3] >= scene.march.opacity:
                        length = reached(scene, cell, here, found.rgba, ray[3])
                        found.place = cells.start[l] + length
                        found.value = value(scene.field, origin + found.place * direction)
                        found.length = found.place
                        found.done = 1
                    found.rgba = ray
        return found

    return probe


@cache
def make_told(halves):
    """``told`` of ``kernels.probe``."""
    Scene = halves.Scene

    @wp.func
    def told(scene: Scene, direction: wp.vec3d, found: Found):
        return found

    return told
