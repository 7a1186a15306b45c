"""The certified walk of one ray in single precision, cell by cell: what GPUs run, where ``packed`` has packets.

In float64 are where the ray begins, once, of cells that are cut how far control points are, and of few of them the
cubic. Nothing is kept but a few numbers, none in arrays. A ray that needs more, beyond what it may be off by, is left
to ``certified``, all of it, in a launch of its own: those registers are then not everybody's.
"""

from functools import cache

import warp as wp

from ..field.cubics import TINY
from ..field.narrow import FACE_ULPS
from ..field.ticks import make_ticks, narrowed
from ..light.glow import Surface, Thin, make_glow
from ..light.points import make_shading
from ..ray import LEAVE
from ..transfer.rows import number
from .packed import ASTRAY
from .parts import Cut, make_parts
from .rowed import make_rowed
from .single import LEFT

# Compilers for GPUs would convert again from float64, cell by cell, what they can, and compute ahead what few need.
KEPT = """
#ifdef __CUDA_ARCH__
asm volatile("" : "+f"(x));
#endif
return x;
"""


@wp.func_native(KEPT)
def kept(x: wp.float32) -> wp.float32: ...


@wp.func
def once(x: wp.float64):
    """In single precision, for a whole ray."""
    return kept(wp.float32(x))


@wp.struct
class Sum:
    """A sum in single precision, and what its additions rounded away."""

    high: wp.float32
    low: wp.float32


@wp.func
def plus(s: Sum, x: wp.float32):
    """The sum and x."""
    high = s.high + x
    part = high - s.high
    s.low += (s.high - (high - part)) + (x - part)
    s.high = high
    return s


@wp.func
def total(s: Sum):
    """What it comes to."""
    return wp.float64(s.high) + wp.float64(s.low)


@wp.struct
class Seen:
    """What a ray has seen so far."""

    red: Sum
    green: Sum
    blue: Sum
    depth: Sum
    bound: Sum
    T: wp.float32
    count: int
    left_over: int


@cache
def make_lone(halves):
    """The march, as of ``scene``; what it counts are cells and pieces."""
    real = wp.float32
    Scene = halves.Scene
    enter, pass_one = make_ticks()
    narrow = halves.field.narrow()
    centered = halves.field.centered()
    by_rows = make_rowed()
    lighted = halves.light is not None
    clipped = halves.cuts.clipped
    sharp = halves.march.sharp
    cut = make_parts(sharp, lighted, clipped)
    incline = halves.field.incline(halves.light.gradient) if lighted else None
    surface_of, glow = make_glow(clipped)
    eye_of = make_shading(halves).eye

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, begin: wp.float64, end: wp.float64):
        spend = wp.vec3(once(scene.march.cell), once(scene.march.along), wp.float32(scene.march.brightest))
        # A ray of which nothing is left has nothing to spend either.
        clear = wp.max(once(wp.float64(1.0) - scene.opaque), real(1.0e-30))
        d = wp.vec3(once(direction[0]), once(direction[1]), once(direction[2]))
        walk = enter(scene.field.last, origin, direction, begin, end)
        # In double precision there is nothing but that and the direction.
        start = origin + begin * direction
        ulps = real(wp.static(FACE_ULPS)) + real(9.0) * walk.blur
        blurs = wp.vec2()
        if wp.static(sharp):
            # Of a scalar, in parts of the largest corner and of the range, and of where it is.
            blurs = wp.vec2(once(scene.march.ulps[0]), once(scene.march.ulps[1] + wp.float64(3.0) * scene.view.astray))
        # All that changes is in structs: what is assigned in branches would keep registers for what is not there.
        ray = Seen()
        ray.T = real(1.0)
        if scene.view.astray > wp.float64(ASTRAY):
            # Further than what single precision has room for (S1).
            ray.left_over = 1
        eye = wp.vec3()
        turned = wp.vec3()
        long = real(0.0)
        tolerance = real(0.0)
        if wp.static(lighted):
            towards = eye_of(scene, direction)
            eye = wp.vec3(once(towards[0]), once(towards[1]), once(towards[2]))
            tolerance = once(scene.march.tolerance)
            if wp.static(clipped):
                normal = scene.light.cut
                turned = wp.vec3(once(normal[0]), once(normal[1]), once(normal[2]))
                long = walk.tick * wp.length(d)
        while walk.t < walk.end and ray.T >= clear and ray.left_over == 0:
            walk, here = pass_one(scene.blocks, walk)
            if here.found != 0:
                c = narrow(scene.field, here.cell, here.middle, d, here.h, ulps)
                one, row = by_rows(scene.march.rows, scene.blocks, spend, here.cell, c)
                L = c.h + c.h
                T = ray.T
                ray.count += 1
                # What the ray was allowed so far and has not spent.
                left = spend[0] * (real(1.0) - T) + spend[1] * (narrowed(here.start) * walk.tick)
                left = real(0.99) * (left - ray.bound.high) / T
                over = real(wp.static(LEFT)) * wp.max(left, real(0.0))
                surface = Surface()
                if wp.static(lighted):
                    surface = surface_of(scene.light, incline(scene.field, here.cell, here.middle, c.h * d))
                    surface.eye = eye
                    surface.tolerance = tolerance
                    surface.T = T
                    if wp.static(clipped):
                        surface.cut = turned
                        surface.behind = real(0.5) * narrowed(here.start + here.stop) * long
                        surface.reach = real(0.5) * narrowed(here.stop - here.start) * long
                if one.fine or one.e <= spend[0] * one.A + spend[1] * L + over:
                    rows = scene.march.rows
                    slope = wp.vec3(number(rows, row, 12), number(rows, row, 13), number(rows, row, 14))
                    plain = wp.vec3(number(rows, row, 8), number(rows, row, 9), number(rows, row, 10))
                    color = one.A * plain + (one.V + one.A * one.off) * slope
                    if wp.static(lighted):
                        if one.A > real(0.0):
                            m = wp.vec3(c.m1, c.m2, c.m3)
                            g = c.h * (number(rows, row, 3) + real(2.0) * one.off * number(rows, row, 4))
                            whole = Thin(one.x, one.A, one.V, g, m, real(0.0), real(1.0))
                            color = glow(surface, whole, plain + one.off * slope, slope)
                    ray.red = plus(ray.red, T * color[0])
                    ray.green = plus(ray.green, T * color[1])
                    ray.blue = plus(ray.blue, T * color[2])
                    ray.bound = plus(ray.bound, T * one.e)
                    ray.depth = plus(ray.depth, one.x)
                elif (c.mean + c.m1 + c.m2 + c.m3) - (c.mean + c.m1 + c.m2 + c.m3) == real(0.0):
                    # Cut, by the same cubic, or where that is not good enough by one in double precision (S23).
                    middle = wp.float64(c.base) + wp.float64(c.mean - c.m2 * real(wp.static(1.0 / 3.0)))
                    m = wp.vec3(c.m1, c.m2, c.m3)
                    blur = c.blur
                    part = Cut()
                    tries = int(2)
                    while tries > 0:
                        tries -= 1
                        part = cut(scene.march.rows, scene.transfer, spend, middle, m, c.h, blur, surface)
                        if part.whole != 0 and part.e <= spend[0] * part.A + spend[1] * L + over:
                            break
                        if tries == 0:
                            ray.left_over = 1
                        tick = wp.float64(0.5) * wp.float64(kept(walk.tick))
                        h = wp.float64(here.stop - here.start) * tick
                        p = start + (wp.float64(here.start + here.stop) * tick) * direction
                        i = here.cell[0]
                        j = here.cell[1]
                        k = here.cell[2]
                        p -= wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k))
                        cubic = centered(scene.field, i, j, k, p, h * direction, wp.float64(1.0))
                        middle = cubic[0]
                        m = wp.vec3(real(cubic[1]), real(cubic[2]), real(cubic[3]))
                        blur = real(0.0)
                        if wp.static(sharp):
                            blur = blurs[0] * (wp.abs(c.base) + real(2.0) * c.most) + blurs[1] * (real(4.0) * c.most)
                            blur += real(wp.static(TINY))
                    ray.count += part.pieces
                    ray.red = plus(ray.red, T * part.color[0])
                    ray.green = plus(ray.green, T * part.color[1])
                    ray.blue = plus(ray.blue, T * part.color[2])
                    ray.bound = plus(ray.bound, T * part.e)
                    ray.depth = plus(ray.depth, part.x)
                # Else absent.
                ray.T = wp.exp(-ray.depth.high)
        opacity = wp.float64(1.0) - wp.exp(-total(ray.depth))
        error = wp.float64(1.00001) * total(ray.bound)
        error += opacity * scene.march.tinted + wp.float64(ray.count) * scene.march.sum
        behind = walk.t < walk.end
        if wp.static(halves.cuts.any or halves.brick):
            # Of a ray that is cut, what is behind this stretch or brick; as whoever has those says whether it ended.
            ended = wp.float64(wp.static(1.0 + 2.0**-40)) * (wp.float64(1.0) - scene.opaque)
            behind = behind or wp.float64(1.0) - opacity <= ended
        if behind:
            # It is not visited.
            error += (wp.float64(1.0) - opacity) * scene.march.brightest
        if scene.stretch == 0:
            # Of the ray as a whole.
            error += scene.march.veiled
            if not wp.static(sharp):
                error += wp.max(scene.view.astray - scene.march.allowed, wp.float64(0.0)) * scene.march.astray
        if ray.left_over != 0:
            error = LEAVE
        return wp.vec4d(total(ray.red), total(ray.green), total(ray.blue), opacity), ray.count, error

    return march
