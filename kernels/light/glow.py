"""A piece of one ray lit in single precision, for GPUs: what ``shine`` says of sixteen.

What light is asked for, and in how many points, is as there; the numbers S19 to S21 are those of docs/proof-single.md.
"""

from functools import cache
from itertools import chain
from typing import NamedTuple

import warp as wp

from .points import CUT, OPPOSITE, Lights
from .shine import CUSP, FEW, GOOD, LEAST, MANY, MUCH, PLENTY, ROUGH, THIN, rule

vec12 = wp.types.vector(12, wp.float32)


def rules():
    """Nodes and weights of the rules of FEW points to MANY, twice as many each."""
    return list(chain(*(zip(*rule(n), strict=True) for n in GOOD)))


@wp.struct
class Surface:
    """What light sees of a cell: the gradient in the world, ``g0 + g1 u + g2 u^2 + g3 u^3``, u in [-1, 1]."""

    g0: wp.vec3
    g1: wp.vec3
    g2: wp.vec3
    g3: wp.vec3
    eye: wp.vec3  # unit vector towards the viewer
    cut: wp.vec3  # normal of the clip that the stretch of the ray begins at, or 0
    behind: wp.float32  # how far behind that the middle is, and the end from there [indices]
    reach: wp.float32
    T: wp.float32  # transparency in front of it
    tolerance: wp.float32  # of a piece, in parts of its opacity
    lights: Lights


@wp.struct
class Thin:
    """A piece about its middle, as of the series, from ``mid - half`` to ``mid + half`` in its cell."""

    x: wp.float32
    A: wp.float32
    V: wp.float32
    g: wp.float32
    m: wp.vec3
    mid: wp.float32
    half: wp.float32


@wp.struct
class Light:
    """Intensities that multiply colour, and of specular light."""

    color: wp.vec3
    glint: wp.vec3


class Glowing(NamedTuple):
    """``surface(lights, gradient)`` -> ``Surface`` of a gradient per index as of ``field.incline``; ``glow(s, p,
    plain, slope)`` -> the colour of a ``Thin`` piece, which is ``plain`` at the mean of its scalars.
    """

    surface: object
    glow: object


@cache
def make_glow(clipped):
    """The ``Glowing`` of rays that clips cut or not."""
    real = wp.float32
    few, some, more, many = (MUCH * times for times in GOOD.values())

    @wp.func
    def surface(lights: Lights, g: vec12):
        s = Surface()
        s.lights = lights
        # What is absent has no gradient.
        size = real(0.0)
        for n in range(12):
            size += wp.abs(g[n])
        if size - size == real(0.0):
            turn = lights.to_world
            s.g0 = turn @ wp.vec3(g[0], g[1], g[2])
            s.g1 = turn @ wp.vec3(g[3], g[4], g[5])
            s.g2 = turn @ wp.vec3(g[6], g[7], g[8])
            s.g3 = turn @ wp.vec3(g[9], g[10], g[11])
        return s

    @wp.func
    def at(s: Surface, u: real):
        g = s.g0 + u * (s.g1 + u * (s.g2 + u * s.g3))
        if wp.static(clipped):
            behind = s.behind + u * s.reach
            if behind < real(1.0) and wp.dot(s.cut, s.cut) > real(0.0):
                side = wp.where(wp.dot(s.cut, g) < real(0.0), real(-1.0), real(1.0))
                strength = wp.max(wp.length(g), real(wp.static(CUT)))
                g = behind * g + ((real(1.0) - behind) * side * strength) * s.cut
        return g

    @wp.func
    def shine(lights: Lights, given: wp.vec3, eye: wp.vec3):
        # Squares of what is large or small are beyond single precision.
        most = wp.max(wp.max(wp.abs(given[0]), wp.abs(given[1])), wp.abs(given[2]))
        one = real(1.0) / wp.clamp(most, real(1.0e-18), real(1.0e18))
        g = one * given
        gg = wp.dot(g, g)
        clear = gg / (gg + lights.sheen.faint * one * one)
        normal = g / wp.sqrt(wp.max(gg, real(1.0e-30)))
        I = Light()
        for l in range(lights.lamps.shape[0]):
            lamp = lights.lamps[wp.max(l, 0)]
            toward = wp.where(lamp.kind == 0, eye, lamp.vector)
            h = toward + eye
            hh = wp.dot(h, h)
            glance = wp.min(wp.abs(wp.dot(normal, h)) / wp.sqrt(wp.max(hh, real(1.0e-30))), real(1.0))
            I.color += (clear * wp.abs(wp.dot(normal, toward)) + (real(1.0) - clear)) * lamp.color
            if glance > real(0.0):
                between = clear * wp.min(hh / real(wp.static(OPPOSITE)), real(1.0))
                I.glint += (between * wp.exp(lights.sheen.shininess * wp.log(glance))) * lamp.glint
        return I

    @wp.func
    def changes(s: Surface, u: real, h: real):
        """How much a unit of light changes at most from u on, to h before and behind it (S21)."""
        sheen = s.lights.sheen
        g = s.g0 + u * (s.g1 + u * (s.g2 + u * s.g3))
        g1 = s.g1 + u * (real(2.0) * s.g2 + u * (real(3.0) * s.g3))
        g2 = s.g2 + u * (real(3.0) * s.g3)
        size = wp.length(g)
        r = h * (wp.length(g1) + h * (wp.length(g2) + h * wp.length(s.g3)))
        most = size + r
        if wp.static(clipped):
            if s.behind + (u - h) * s.reach < real(1.0) and wp.dot(s.cut, s.cut) > real(0.0):
                most = wp.max(most, real(wp.static(CUT)))
                size = wp.where(wp.abs(wp.dot(s.cut, g)) < r, real(0.0), wp.length(at(s, u)))
                r += real(2.0) * h * wp.abs(s.reach) * most
        least = wp.max(size - r, real(0.0))
        none = sheen.faint / (most * most + sheen.faint)
        fades = sheen.faint / (least * least + sheen.faint) - none
        turn = wp.min(r / wp.max(size - real(0.5) * r, real(1.0e-30)), real(wp.static(ROUGH)))
        glints = wp.min(sheen.steep * turn, real(wp.static(ROUGH)))
        if sheen.shininess < real(1.0):
            glints = real(wp.static(CUSP)) * wp.pow(real(1.6) * turn, sheen.shininess)
        seen = real(1.0) - none
        return sheen.diffuse * (seen * turn + fades) + sheen.specular * (seen * glints + fades)

    @wp.func
    def reached(p: Thin, begin: real, rate: real, part: real):
        """Where a part of the opacity is in front, from the front on, depth there, and extinction were that linear."""
        y = p.A * part
        depth = -wp.log(wp.max(real(1.0) - y, real(1.0e-30)))
        if y < real(0.06):
            depth = y * (real(1.0) + y * (real(0.5) + y * real(wp.static(1.0 / 3.0))))
        root = wp.sqrt(wp.max(begin * begin + real(2.0) * rate * depth, real(0.0)))
        return wp.min(real(2.0) * depth / (begin + root + real(1.0e-30)), real(2.0)), depth, root

    @wp.func
    def glow(s: Surface, p: Thin, plain: wp.vec3, slope: wp.vec3):
        third = real(wp.static(1.0 / 3.0))
        tiny = real(1.0e-30)
        half = real(0.5)
        a = half * p.x
        b = wp.clamp(a + p.g * (real(2.0) * third * p.m[1] - p.m[0] - p.m[2]), real(0.0), real(1.9) * a)
        k = a - b
        share = wp.min(wp.max(s.T * p.A, real(wp.static(THIN))), real(wp.static(PLENTY)) * s.T * p.A)
        all = real(0.0)
        moved = real(0.0)
        mean = Light()
        moment = wp.vec3()
        # A part is that of so much opacity, from y on.
        y = real(0.0)
        part = real(1.0)
        start = real(0.0)
        while y < real(1.0):
            stop = real(2.0)
            if y + part < real(1.0):
                stop, _depth, _root = reached(p, b, k, y + part)
            middle = p.mid + p.half * (half * (start + stop) - real(1.0))
            matters = share * part * changes(s, middle, p.half * half * (stop - start)) / s.tolerance
            if matters > real(wp.static(many)) and part > real(wp.static(LEAST)):
                part *= half
            else:
                first = int(0)
                count = int(wp.static(FEW))
                # Where parts have other light it counts what each of them truly sees: 16 points say that.
                if part < real(1.0) or matters > real(wp.static(few)):
                    first = wp.static(FEW)
                    count = wp.static(2 * FEW)
                if part < real(1.0) or matters > real(wp.static(some)):
                    first = wp.static(3 * FEW)
                    count = wp.static(4 * FEW)
                if part < real(1.0) or matters > real(wp.static(more)):
                    first = wp.static(7 * FEW)
                    count = wp.static(MANY)
                for i in range(count):
                    node = s.lights.rules[wp.max(first + i, 0)]
                    along, depth, root = reached(p, b, k, y + part * node[0])
                    v = along - real(1.0)
                    w = v * (p.m[0] + v * (p.m[1] + v * p.m[2])) - third * p.m[1]
                    W = half * p.m[0] + third * v * p.m[1] + real(0.25) * (v * v + real(1.0)) * p.m[2]
                    W *= along * (along - real(2.0))
                    weight = wp.max(a + p.g * w, real(0.0)) / wp.max(root, tiny)
                    weight *= part * node[1] * wp.exp(wp.min(depth - a * along - p.g * W, real(80.0)))
                    I = shine(s.lights, at(s, p.mid + p.half * v), s.eye)
                    all += weight
                    moved += weight * w
                    mean.color += weight * I.color
                    mean.glint += weight * I.glint
                    moment += (weight * w) * I.color
                y += part
                start = stop
                # As wide again as halves of halves of the whole go.
                pairs = half * y / part
                if wp.floor(pairs) == pairs:
                    part *= real(2.0)
        one = real(1.0) / wp.max(all, tiny)
        I0 = one * mean.color
        bright = wp.vec3(s.lights.sheen.ambient) + I0
        color = p.A * plain + p.V * slope
        result = wp.cw_mul(bright, color) + (p.A * one) * (wp.cw_mul(slope, moment - moved * I0) + mean.glint)
        return result

    return Glowing(surface, glow)
