"""Isosurfaces: where the field along a ray crosses levels, in order, each a root of the cubic in a cell.

Above a level is what is at least as much. Which levels the ray is above is counted on from cell to cell, so that a
crossing at a face is neither seen twice nor missed. Where rounding may decide that there is one, the bound has what it
would do to the image (docs/projections.md).
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.cell import at, turns, vec5d, zero
from ..field.walk import ahead, make_gather, make_walk
from ..light.points import make_shading
from ..ray import FAR
from ..segment import over
from ..transfer.function import make_transfer
from .found import Found, Side

# Of a crossing's colour, and of its composition, by rounding.
ULPS = 2.0**-48
# Of a ray that is farther astray than cells are looked at for nothing is known [index coordinates].
ASTRAY = 2.0**-36
# Bricks that are left out have no sample so near to a level, in parts of the range of samples.
NEAR = 2.0**-20


@wp.struct
class Crossings:
    level: wp.array(dtype=wp.float64)  # rising
    color: wp.array2d(dtype=wp.vec4d)  # and opacity of a crossing [state, level]
    strongest: wp.float64  # opacity
    brightest: wp.float64  # largest component of a colour, 1 or more
    opacity: wp.float64  # at which a ray has its place
    off: wp.float64  # rounding of a scalar
    range: wp.float64  # of the samples
    shown: wp.float64  # rounding of the image


@dataclass(frozen=True)
class Half:
    """The device half of isosurfaces."""

    bounded = True
    tabled = False
    borders = True

    def Struct(self, halves):
        return Crossings

    def probe(self, halves):
        return make_probe(halves)

    def told(self, halves):
        return make_told(halves)

    def border(self, halves):
        return make_border(halves)

    def unseen(self, halves):
        return make_unseen(halves)


@wp.func
def count_up_to(level: wp.array(dtype=wp.float64), s: wp.float64):
    """How many levels a scalar is above; none if it is NaN."""
    low = int(0)
    high = level.shape[0]
    while low < high:
        middle = (low + high) >> 1
        if level[middle] <= s:
            low = middle + 1
        else:
            high = middle
    return low


@wp.func
def levels_near(level: wp.array(dtype=wp.float64), s: wp.float64, off: wp.float64):
    """How many levels a scalar is within its rounding of."""
    return count_up_to(level, s + off) - count_up_to(level, s - off)


@wp.func
def sure_way(slope: wp.float64, bend: wp.float64, length: wp.float64, off: wp.float64):
    """1 where a cubic surely rises as long as it is within its rounding of a level, -1 where it falls, else 0."""
    steep = wp.abs(slope)
    sure = steep * steep > wp.float64(32.0) * bend * off and steep * length > wp.float64(32.0) * off
    return wp.where(sure, wp.where(slope > wp.float64(0.0), 1, -1), 0)


@cache
def make_rounding(halves):
    """``rounding(scene)`` of a scalar, that of the place of the ray included; ``unsure(scene, n, found)``: of n levels,
    with two crossings more or less of each, from where it was last sure which there are.
    """
    Scene = halves.Scene

    @wp.func
    def rounding(scene: Scene):
        return scene.march.off + wp.float64(3.0) * scene.view.astray * scene.march.range

    @wp.func
    def unsure(scene: Scene, n: int, found: Found):
        most = wp.min(wp.float64(1.0), wp.float64(2 * n) * scene.march.strongest)
        found.bound += found.clear * scene.march.brightest * most
        return found

    return rounding, unsure


@cache
def make_border(halves):
    """``border`` of ``kernels.probe``."""
    Scene = halves.Scene
    value = halves.field.value(wp.float64)
    rounding, unsure = make_rounding(halves)

    @wp.func
    def border(scene: Scene, p: wp.vec3d, direction: wp.vec3d, loose: wp.float64, found: Found):
        if found.side.near > 0:
            # Nobody goes on from there.
            found = unsure(scene, found.side.near, found)
        found.side = Side()
        found.side.until = -FAR
        slope = scene.march.range * (wp.abs(direction[0]) + wp.abs(direction[1]) + wp.abs(direction[2]))
        s = value(scene.field, p)
        n = levels_near(scene.march.level, s, rounding(scene) + slope * loose)
        if n > 0:
            found = unsure(scene, n, found)
        return found

    return border


@cache
def make_unseen(halves):
    """``unseen`` of ``kernels.bricks.probe``: a ray may only reach a level in a brick that is left out (``NEAR``) along
    what is long.
    """
    Scene = halves.Scene
    _, unsure = make_rounding(halves)

    @wp.func
    def unseen(scene: Scene, direction: wp.vec3d, loose: wp.float64, found: Found):
        n = found.side.near
        steep = wp.abs(direction[0]) + wp.abs(direction[1]) + wp.abs(direction[2])
        if steep * loose > wp.float64(NEAR):
            n += scene.march.level.shape[0]
        if n > 0:
            found = unsure(scene, n, found)
        return found

    return unseen


@cache
def make_probe(halves):
    """``probe`` of ``kernels.probe``."""
    real = wp.float64
    Scene = halves.Scene
    finite = halves.field.finite
    lighted = halves.light is not None
    cubic = halves.field.cubic()
    eye_of, gradient, light, lit, *_ = make_shading(halves)
    _, interval, _ = make_transfer(real)
    rounding, unsure = make_rounding(halves)
    _, enter, _, _ = make_walk(real)
    _, gather = make_gather()

    @wp.func
    def goes_on(scene: Scene, found: Found):
        return found.rgba[3] <= scene.opaque and found.rgba[3] < real(1.0)

    @wp.func
    def crossed(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, t: real, n: int, given: Found):
        """A surface of a level more."""
        found = given
        q = scene.march.color[found.state, wp.max(n, 0)]
        A = q[3]
        s = scene.march.level[wp.max(n, 0)]
        if wp.static(lighted):
            if A > real(0.0):
                p = origin + t * direction
                eye = eye_of(scene, direction)
                I = light(scene, p, gradient(scene, p), eye)
                q = lit(scene, q, interval(scene.transfer, s), s, I)
        found.rgba = over(found.rgba, wp.vec4d(A * q[0], A * q[1], A * q[2], A))
        found.bound += real(ULPS) * scene.march.brightest
        found.length = real(1.0)
        if found.place == -FAR and found.rgba[3] >= scene.march.opacity:
            found.place = t
            found.value = s
        return found

    @wp.func
    def through(
        scene: Scene, origin: wp.vec3d, direction: wp.vec3d, cell: wp.vec3i, span: wp.vec2d, given: Side, so_far: Found
    ):
        """A cell, from when to when the ray is in there."""
        found = so_far
        side = given
        off = rounding(scene)
        length = span[1] - span[0]
        corner = wp.vec3d(real(cell[0]), real(cell[1]), real(cell[2]))
        c = cubic(scene.field, cell[0], cell[1], cell[2], origin + span[0] * direction - corner, direction)
        if not wp.static(finite):
            if not wp.isfinite(c[3]):
                return side, found
        found.count += 1
        two = real(2.0)
        three = real(3.0)
        bend = two * wp.abs(c[2]) + real(6.0) * wp.abs(c[3]) * length
        joined = span[0] <= ahead(side.until)
        near = levels_near(scene.march.level, c[0], two * off)
        if near > 0 or side.near > 0:
            # One crossing, if the ray goes the same way on both sides of the face.
            way = sure_way(c[1], bend, length, off)
            if not joined or way == 0 or way != side.way:
                found = unsure(scene, wp.max(near, side.near), found)
        if near == 0:
            found.clear = real(1.0) - found.rgba[3]
        if not joined:
            side.above = count_up_to(scene.march.level, c[0])
        first, second = turns(c, length)
        t = real(0.0)
        s = c[0]
        stretch = int(0)
        while stretch < 3:
            # Monotone up to here.
            end = length
            if stretch == 0:
                end = first
            elif stretch == 1:
                end = second
            value = at(c, end)
            above = count_up_to(scene.march.level, value)
            while side.above != above and found.rgba[3] < real(1.0):
                rises = above > side.above
                n = wp.where(rises, side.above, side.above - 1)
                goal = scene.march.level[wp.max(n, 0)]
                guess = real(0.5) * (t + end)
                if value != s:
                    guess = t + (end - t) * (goal - s) / (value - s)
                sign = wp.where(rises, real(1.0), real(-1.0))
                t = zero(vec5d(c[0] - goal, c[1], c[2], c[3], real(0.0)), t, end, guess, sign)
                s = goal
                slope = c[1] + t * (two * c[2] + t * three * c[3])
                if sure_way(slope, bend, length, off) == 0:
                    found = unsure(scene, levels_near(scene.march.level, goal, two * off), found)
                found = crossed(scene, origin, direction, span[0] + t, n, found)
                side.above += wp.where(rises, 1, -1)
            close = levels_near(scene.march.level, value, two * off)
            if close == 0:
                found.clear = real(1.0) - found.rgba[3]
            elif end < length:
                # It may turn before the level or behind it.
                found = unsure(scene, close, found)
            t = end
            s = value
            stretch += 1
        side.until = span[1]
        side.near = levels_near(scene.march.level, s, two * off)
        side.way = sure_way(c[1] + length * (two * c[2] + length * three * c[3]), bend, length, off)
        return side, found

    @wp.func
    def probe(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64, given: Found):
        found = given
        side = found.side
        w = enter(scene.field.last, origin, direction, start)
        end = wp.min(stop, w.out)
        # On to where it is sure what there was.
        while w.t < end and (goes_on(scene, found) or side.near > 0):
            w, cells = gather(scene.blocks, w, end)
            for l in range(cells.count):
                if cells.length[l] > real(0.0) and (goes_on(scene, found) or side.near > 0):
                    cell = wp.vec3i(cells.cell[0, l], cells.cell[1, l], cells.cell[2, l])
                    span = wp.vec2d(cells.start[l], cells.start[l] + cells.length[l])
                    side, found = through(scene, origin, direction, cell, span, side, found)
        found.side = side
        if not goes_on(scene, found) and side.near == 0:
            found.done = 1
        if found.rgba[3] > scene.opaque:
            found.bound += (real(1.0) - found.rgba[3]) * scene.march.brightest
        return found

    return probe


@cache
def make_told(halves):
    """``told`` of ``kernels.probe``."""
    Scene = halves.Scene

    @wp.func
    def told(scene: Scene, direction: wp.vec3d, given: Found):
        found = given
        if scene.view.astray > wp.float64(ASTRAY):
            found.bound += scene.march.brightest
        if found.count > 0 or found.bound > wp.float64(0.0):
            found.bound = wp.min(found.bound, scene.march.brightest) + scene.march.shown
        return found

    return told
