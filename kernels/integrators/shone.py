"""A piece of ray in a cell lit in double precision: what ``light.shine`` says of sixteen.

Light is no polynomial: what it does to a piece is taken from a few points, the more the more it changes the pixel over
the tolerance, of halves and halves of these where no number of them would do. Opacity, and the bound, know nothing of
it.
"""

from functools import cache
from itertools import chain

import warp as wp

from ..light.points import CUT, KINDS, Lit, make_shading, make_toward
from ..light.shine import CUSP, GOOD, LEAST, MUCH, PLENTY, ROUGH, THIN, rule

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
    # Rules of few points to many, twice as many each.
    counts = tuple(GOOD)
    rules = [rule(n) for n in counts]
    nodes, shares = (wp.constant(wp.types.vector(sum(GOOD), real)(*chain(*of))) for of in zip(*rules, strict=True))
    good = wp.constant(wp.types.vector(len(GOOD), real)(*(MUCH * GOOD[n] for n in counts)))
    last = len(GOOD) - 1
    # Where a gradient along a piece is asked for, that is a cubic there: off the ends, at which it may jump. And how
    # many sixteenths of each are in its coefficients.
    far = 0.9
    places = wp.constant(wp.vec4d(-far, -far / 3, far / 3, far))
    fit = ((-1, 9, 9, -1), (1, -27, 27, -1), (9, -9, -9, 9), (-9, 27, -27, 9))
    fitted = wp.constant(wp.mat44d(*chain(*fit)))

    @wp.func
    def swing(scene: Scene, middle: wp.vec3d, out: wp.vec3d, eye: wp.vec3d):
        """How much the direction to a light turns from the middle of a part on."""
        most = real(0.0)
        shading = scene.light.shading
        home = shading.home + shading.ahead @ middle
        ahead = shading.ahead @ out
        for l in range(scene.light.lights.shape[0]):
            here = scene.light.lights[wp.max(l, 0)]
            way = toward(here.kind, here.vector, home, eye)
            before = toward(here.kind, here.vector, home - ahead, eye)
            after = toward(here.kind, here.vector, home + ahead, eye)
            most = wp.max(most, wp.max(wp.length(before - way), wp.length(after - way)))
        return most

    @wp.func
    def around(a1: real, a2: real, a3: real, v: real, h: real):
        """How much ``a1 v + a2 v^2 + a3 v^3`` changes at most from v on, to h before and behind it."""
        second = wp.abs(a2 + real(3.0) * v * a3) + h * wp.abs(a3)
        return h * (wp.abs(a1 + v * (real(2.0) * a2 + real(3.0) * v * a3)) + h * second)

    @wp.func
    def reached(begin: real, rate: real, y: real):
        """Where so much opacity is in front, in [-1, 1], extinction there and depth, were extinction linear."""
        depth = -wp.log(wp.max(real(1.0) - y, real(1.0e-300)))
        root = wp.sqrt(wp.max(begin * begin + real(2.0) * rate * depth, real(0.0)))
        return wp.min(real(2.0) * depth / wp.max(begin + root, real(1.0e-300)), real(2.0)) - real(1.0), root, depth

    @wp.func
    def shone(scene: Scene, c: Cubic, k: int, segment: wp.vec4d):
        A = segment[3]
        one = real(1.0)
        half = real(0.5)
        third = real(wp.static(1.0 / 3.0))
        tiny = real(1.0e-300)
        m1 = c.m[1]
        m2 = c.m[2]
        m3 = c.m[3]
        slope = scene.transfer.slope[k]
        shading = scene.light.shading
        to = half * c.length * c.d
        g0 = wp.vec3d()
        g1 = wp.vec3d()
        g2 = wp.vec3d()
        g3 = wp.vec3d()
        # Asked for in one place, since a gradient is much code.
        place = int(0)
        while place < 4:
            found = bare(scene, c.middle + places[place] * to)
            g0 += fitted[0, place] * found
            g1 += fitted[1, place] * found
            g2 += fitted[2, place] * found
            g3 += fitted[3, place] * found
            place += 1
        g0 *= real(wp.static(1.0 / 16.0))
        g1 *= real(wp.static(1.0 / 16.0 / far))
        g2 *= real(wp.static(1.0 / 16.0 / far**2))
        g3 *= real(wp.static(1.0 / 16.0 / far**3))
        # Extinction as if it were linear, from its front and mean.
        extinction = scene.transfer.value[k][3] + (c.m[0] + third * m2 - scene.transfer.knot[k]) * slope[3]
        mid = half * c.length * wp.max(extinction, real(0.0))
        g = half * c.length * slope[3]
        begin = mid + g * (real(2.0) * third * m2 - m1 - m3)
        begin = wp.min(wp.max(begin, real(0.0)), real(1.9) * mid)
        rate = mid - begin
        share = wp.min(wp.max(c.T * A, real(wp.static(THIN))), real(wp.static(PLENTY)) * c.T * A)
        total = real(0.0)
        moved = real(0.0)
        mean = vec6()
        moment = wp.vec3d()
        # A part is that of so much opacity, from y on.
        y = real(0.0)
        part = one
        start = -one
        while y < one:
            stop = one
            if y + part < one:
                stop, _root, _depth = reached(begin, rate, A * (y + part))
            v = half * (start + stop)
            h = half * (stop - start)
            # How much a unit of light changes at most from the middle of the part on (docs/proof-single.md, S21).
            middle = g0 + v * (g1 + v * (g2 + v * g3))
            size = wp.length(middle)
            second = wp.length(g2 + (real(3.0) * v) * g3) + h * wp.length(g3)
            r = h * (wp.length(g1 + v * (real(2.0) * g2 + (real(3.0) * v) * g3)) + h * second)
            most = size + r
            if wp.static(halves.cuts.clipped):
                cut = scene.light.cut
                behind = wp.length(c.middle + start * to - scene.light.cut_point)
                if behind < one and wp.dot(cut, cut) > real(0.0):
                    there = wp.length(towards_cut(scene, c.middle + v * to, middle))
                    most = wp.max(most, real(wp.static(CUT)))
                    size = wp.where(wp.abs(wp.dot(cut, middle)) < r, real(0.0), there)
                    r += real(2.0) * h * wp.length(to) * most
            least = wp.max(size - r, real(0.0))
            none = shading.faint / (most * most + shading.faint)
            fades = shading.faint / (least * least + shading.faint) - none
            turn = wp.min(r / wp.max(size - half * r, tiny), real(wp.static(ROUGH)))
            if wp.static(placed):
                turn = wp.min(turn + swing(scene, c.middle + v * to, h * to, c.eye), real(wp.static(ROUGH)))
            glints = wp.min(real(1.6) * wp.sqrt(shading.shininess) * turn, real(wp.static(ROUGH)))
            if shading.shininess < one:
                glints = real(wp.static(CUSP)) * wp.pow(real(1.6) * turn, shading.shininess)
            glints = (one - none) * glints + fades
            turn = (one - none) * turn + fades
            # And by how much coefficients do, which are linear in the scalar.
            s = c.m[0] + v * (m1 + v * (m2 + v * m3))
            at = factors(scene, k, s)
            rise = factors(scene, k, s + around(m1, m2, m3, v, h)) - at
            change = shading.ambient * wp.abs(rise[0]) + shading.diffuse * (at[1] * turn + wp.abs(rise[1]))
            change += shading.specular * (at[2] * glints + wp.abs(rise[2]))
            matters = share * part * change / scene.march.tolerance
            if matters > good[wp.static(last)] and part > real(wp.static(LEAST)):
                part *= half
            else:
                first = int(0)
                count = int(wp.static(counts[0]))
                n = int(0)
                # Where parts have other light it counts what each of them truly sees: 16 points say that.
                while n < wp.static(last) and (part < one or matters > good[n]):
                    first += count
                    count *= 2
                    n += 1
                for i in range(count):
                    v, root, depth = reached(begin, rate, A * (y + part * nodes[first + i]))
                    vv = v * v
                    w = v * (m1 + v * (m2 + v * m3)) - third * m2
                    W = (vv - one) * (half * m1 + third * v * m2 + real(0.25) * (vv + one) * m3)
                    weight = part * shares[first + i] * wp.exp(depth - mid * (v + one) - g * W)
                    weight *= wp.max(mid + g * w, real(0.0)) / wp.max(root, tiny)
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
                y += part
                start = stop
                # As wide again as halves of halves of the whole go.
                pairs = half * y / part
                if wp.floor(pairs) == pairs:
                    part *= real(2.0)
        total = wp.max(total, tiny)
        result = segment
        for j in range(3):
            I0 = mean[j] / total
            result[j] = I0 * segment[j] + A / total * (slope[j] * (moment[j] - I0 * moved) + mean[3 + j])
        return result

    return shone
