"""A piece of ray in a cell lit in double precision: what ``light.shine`` says of sixteen.

Light is no polynomial: what it does to a piece is taken from a few points, the more the more it changes the pixel over
the tolerance. Opacity, and the bound, know nothing of it.
"""

from functools import cache
from itertools import chain

import warp as wp

from ..light.points import KINDS, Lit, make_shading, make_toward
from ..light.shine import FEW, GOOD, MANY, MUCH, PARTS, rule

vec6 = wp.types.vector(6, wp.float64)


@wp.struct
class Cubic:
    """A piece of ray about its middle: ``m0 + m1 v + m2 v^2 + m3 v^3``, v in [-1, 1] over its length."""

    middle: wp.vec3d
    d: wp.vec3d  # direction
    eye: wp.vec3d  # unit vector towards the viewer, where there is light
    m: wp.vec4d
    length: wp.float64
    T: wp.float64  # transparency in front of it
    blur: wp.float64  # rounding of m


@cache
def make_shone(halves):
    """``shone(scene, c, k, segment)`` -> a segment lit, of a ``Cubic`` that stays in interval k."""
    real = wp.float64
    Scene = halves.Scene
    _, _, light, _, factors, bare, towards_cut = make_shading(halves)
    # Lights that are seen in other directions from other places of a ray.
    kinds = (halves.light or Lit()).kinds
    placed = any(kind not in KINDS for kind in kinds)
    toward = make_toward(kinds)
    # Rules of FEW points to MANY, twice as many each.
    rules = [rule(n) for n in GOOD]
    nodes, shares = (wp.constant(wp.types.vector(sum(GOOD), real)(*chain(*of))) for of in zip(*rules, strict=True))
    good = wp.constant(wp.types.vector(len(GOOD), real)(*(MUCH * times for times in GOOD.values())))
    # Where a gradient along a piece is asked for, that is a cubic there: off the ends, at which it may jump.
    near, far = 0.3, 0.9

    @wp.func
    def swing(scene: Scene, c: Cubic, to: wp.vec3d):
        """How much the direction to a light turns from the middle of a piece on."""
        most = real(0.0)
        shading = scene.light.shading
        middle = shading.home + shading.ahead @ c.middle
        out = shading.ahead @ to
        for l in range(scene.light.lights.shape[0]):
            here = scene.light.lights[wp.max(l, 0)]
            way = toward(here.kind, here.vector, middle, c.eye)
            before = toward(here.kind, here.vector, middle - out, c.eye)
            after = toward(here.kind, here.vector, middle + out, c.eye)
            most = wp.max(most, wp.max(wp.length(before - way), wp.length(after - way)))
        return most

    @wp.func
    def shone(scene: Scene, c: Cubic, k: int, segment: wp.vec4d):
        A = segment[3]
        one = real(1.0)
        third = real(wp.static(1.0 / 3.0))
        tiny = real(1.0e-300)
        m1 = c.m[1]
        m2 = c.m[2]
        m3 = c.m[3]
        slope = scene.transfer.slope[k]
        shading = scene.light.shading
        to = real(0.5) * c.length * c.d
        a = bare(scene, c.middle - real(far) * to)
        b = bare(scene, c.middle - real(near) * to)
        e = bare(scene, c.middle + real(near) * to)
        f = bare(scene, c.middle + real(far) * to)
        g0 = (real(9.0) * (b + e) - a - f) / real(16.0)
        g1 = (a - real(27.0) * (b - e) - f) * real(wp.static(1.0 / 16.0 / far))
        g2 = (a - b - e + f) * real(wp.static(9.0 / 16.0 / far**2))
        g3 = (real(3.0) * (b - e) - a + f) * real(wp.static(9.0 / 16.0 / far**3))
        # How much a unit of light changes at most from the middle on (docs/proof-single.md, S21).
        size = wp.length(g0)
        r = wp.length(g1) + wp.length(g2) + wp.length(g3)
        least = wp.max(size - r, real(0.0))
        fades = shading.faint / (least * least + shading.faint)
        turn = wp.min(r / wp.max(size - real(0.5) * r, tiny), one)
        if wp.static(placed):
            turn = wp.min(turn + swing(scene, c, to), one)
        glints = one
        if shading.shininess >= one:
            glints = wp.min(real(1.6) * wp.sqrt(shading.shininess) * turn + fades, one)
        turn = wp.min(turn + fades, one)
        if wp.static(halves.cuts.clipped):
            if wp.length(c.middle - to - scene.light.cut_point) < one:
                turn = one
                glints = one
        # And by how much coefficients do, which are linear in the scalar.
        at = factors(scene, k, c.m[0])
        most = factors(scene, k, c.m[0] + wp.abs(m1) + wp.abs(m2) + wp.abs(m3)) - at
        change = shading.ambient * wp.abs(most[0]) + shading.diffuse * (at[1] * turn + wp.abs(most[1]))
        change += shading.specular * (at[2] * glints + wp.abs(most[2]))
        matters = c.T * A * change / scene.march.tolerance
        first = int(0)
        count = int(wp.static(FEW))
        n = int(0)
        while count < wp.static(MANY) and matters > good[n]:
            first += count
            count *= 2
            n += 1
        parts = int(1)
        while parts < wp.static(PARTS) and matters > real(parts * parts) * good[wp.static(len(GOOD) - 1)]:
            parts += 1
        # Extinction as if it were linear, from its front and mean.
        extinction = scene.transfer.value[k][3] + (c.m[0] + third * m2 - scene.transfer.knot[k]) * slope[3]
        mid = real(0.5) * c.length * wp.max(extinction, real(0.0))
        g = real(0.5) * c.length * slope[3]
        begin = mid + g * (real(2.0) * third * m2 - m1 - m3)
        begin = wp.min(wp.max(begin, real(0.0)), real(1.9) * mid)
        rate = mid - begin
        total = real(0.0)
        moved = real(0.0)
        mean = vec6()
        moment = wp.vec3d()
        for i in range(count * parts):
            n = first + i % count
            y = A * (real(i // count) + nodes[n]) / real(parts)
            depth = -wp.log(wp.max(one - y, tiny))
            root = wp.sqrt(wp.max(begin * begin + real(2.0) * rate * depth, real(0.0)))
            v = wp.min(real(2.0) * depth / wp.max(begin + root, tiny), real(2.0)) - one
            vv = v * v
            w = v * (m1 + v * (m2 + v * m3)) - third * m2
            W = (vv - one) * (real(0.5) * m1 + third * v * m2 + real(0.25) * (vv + one) * m3)
            weight = wp.max(mid + g * w, real(0.0)) / wp.max(root, tiny) * wp.exp(depth - mid * (v + one) - g * W)
            weight *= shares[n]
            p = c.middle + v * to
            gradient = g0 + v * (g1 + v * (g2 + v * g3))
            if wp.static(halves.cuts.clipped):
                gradient = towards_cut(scene, p, gradient)
            I = light(scene, p, gradient, c.eye)
            of = factors(scene, k, c.m[0] + third * m2 + w)
            for j in range(3):
                I[j] = real(shading.ambient) * of[0] + of[1] * I[j]
                I[3 + j] *= of[2]
                moment[j] += weight * w * I[j]
            total += weight
            moved += weight * w
            mean += weight * I
        total = wp.max(total, tiny)
        result = segment
        for j in range(3):
            I0 = mean[j] / total
            result[j] = I0 * segment[j] + A / total * (slope[j] * (moment[j] - I0 * moved) + mean[3 + j])
        return result

    return shone
