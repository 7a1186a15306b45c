"""The certified walk: cell by cell, each within a bound that is summed along the ray.

A packet of cells that have something to see is gathered and integrated at a time, as vectors, by ``series``: of a cell
whose piece of ray stays in one interval of the transfer function. One that reaches into the next interval by so little
that a straight line will do is counted as such, and its deviation into the bound. Any other is cut where the scalar
reaches a control point. A piece that the series is not good enough for is integrated as ``Exact`` does.

What the bounds of pieces are compared with is a share of the opacity that the piece adds: opacities sum to one, so
the bounds sum to no more than that share.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.absent import exact
from ..field.cell import DENORMAL
from ..field.walk import PACKET, lanes, make_gather, make_walk
from ..light.points import make_shading
from ..ray import FAR, inside
from ..transfer.function import make_transfer
from ..transfer.rows import Rows
from .cubics import from_start, make_cubics
from .lone import make_lone
from .packed import RAYS, SCRATCH, make_packed, make_rays
from .pieces import VALUE, make_jumps, make_pieces
from .series import make_series
from .shone import Cubic, make_shone


@wp.struct
class Certificate:
    """How a tolerance is spent."""

    tolerance: wp.float64  # of what a piece adds, in parts of its opacity
    brightest: wp.float64  # largest component of a colour, 1 or more
    tinted: wp.float64  # error of a simpler transfer function, in parts of a ray's opacity
    veiled: wp.float64  # and of any ray, rounding included
    sum: wp.float64  # of each cell and piece, by rounding of sums
    densest: wp.float64  # largest extinction of a unit of length
    astray: wp.float64  # what a ray is off by for a unit that it is astray: sharp, the scalar; else any channel
    allowed: wp.float64  # that is in ``veiled``
    ulps: wp.vec2d  # rounding of a scalar along a ray, in parts of the largest corner and of the range of a cell
    blur: wp.float64  # the same of any cell
    local: bool  # cells differ much in it
    nodes: wp.array(dtype=wp.vec2d)  # of ``pieces.NODES``
    cell: wp.float64  # of a cell in single precision, in parts of its opacity,
    along: wp.float64  # and of its length
    rows: Rows
    octants: wp.array4d(dtype=wp.uint8)  # of ``field.strides``
    scratch: wp.uint64  # memory of the thread's own, ``packed.SCRATCH`` bytes


@dataclass(frozen=True)
class Half:
    """The device half of certified integration."""

    sharp: bool  # what rounding of a scalar does counts piece by piece: there are jumps, or slopes are steep
    single: bool = False  # rounding to single precision is little beside the tolerance
    ticks: bool = False  # so are times along a ray as of ``field.strides``
    bounded = True
    tabled = False

    def Struct(self, halves):
        return Certificate

    def march(self, halves):
        if self.single and halves.vectors:
            return make_packed(halves)
        return make_lone(halves) if halves.leaves else make_certified(halves)

    def leaves(self, halves):
        """Without vectors a ray that single precision is not good enough for is left to another launch."""
        return self.single and self.ticks and not halves.vectors

    @property
    def rays(self):
        return RAYS if self.single else 1

    @property
    def scratch(self):
        return SCRATCH if self.single else 0

    def together(self, halves):
        """The march of so many rays at a time, as of ``packed``."""
        return make_rays(halves, self.rays)

    def edge(self, halves):
        return make_edge(halves)

    def limits(self, halves):
        return make_limits(halves)


@cache
def make_limits(halves):
    """``limits(scene)`` -> what a unit of length of a ray may change, a bound that is little beside the tolerance, and
    the largest that there need be: both images have colours between 0 and the brightest, this one but for series and
    rounding.
    """
    Scene = halves.Scene

    @wp.func
    def limits(scene: Scene):
        cap = scene.march.brightest + wp.float64(2.0) * scene.march.tolerance + scene.march.veiled
        return scene.march.brightest * scene.march.densest, wp.float64(1.0e-6) * scene.march.tolerance, cap

    return limits


@cache
def make_edge(halves):
    """``edge(scene, anchor, inverse, first, hit)`` -> a bound on what it does to a ray that the box and where it begins
    may be a little off, for ``ray.line`` of it and whether it has ``hit`` the box of what there is to see; and the
    largest bound that there need be.
    """
    Scene = halves.Scene
    limits = make_limits(halves)
    absent = not halves.field.finite
    zero = wp.float64(0.0)

    @wp.func
    def edge(scene: Scene, anchor: wp.vec3d, inverse: wp.vec3d, first: wp.float64, hit: bool):
        view = scene.view
        most, little, cap = limits(scene)
        e = wp.float64(2.0) * view.astray
        least = wp.float64(1.0)
        steepest = wp.float64(1.0)
        for a in range(3):
            size = wp.abs(inverse[a])
            steepest = wp.where(size > steepest, size, steepest)
            least = wp.where(size < least, size, least)
        bound = wp.float64(6.0) * most * e * steepest
        if hit and least > zero and bound < little:
            return bound, cap
        # Where there is something to see up to a face of the box, up to which of both sides of it?
        low = view.seen_low
        high = view.seen_high
        closer_low = low
        closer_high = high
        thin = bool(False)
        holes = wp.vec3i()
        if wp.static(absent):
            # What there is to see may end at absent cells.
            for a in range(3):
                holes[a] = wp.where(exact(scene.proven[a], anchor[a], inverse[a]), 0, 1)
        for a in range(3):
            if low[a] <= view.low[a] or holes[a] != 0:
                low[a] -= e
                closer_low[a] += e
            if high[a] >= view.high[a] or holes[a] != 0:
                high[a] += e
                closer_high[a] -= e
            # Nothing is inside; as where there is nothing to see.
            thin = thin or closer_low[a] > closer_high[a]
        start, end = inside(low, high, anchor, inverse, first - e, FAR)
        if not end > start:
            return zero, cap
        nearer, farther = inside(closer_low, closer_high, anchor, inverse, first + e, FAR)
        loose = end - start
        if farther > nearer and not thin:
            loose -= farther - nearer
        return most * (loose + wp.float64(wp.static(2.0**-48)) * (end - start)), cap

    return edge


@cache
def make_certified(halves):
    """The march, as of ``scene``; what it counts are cells and pieces, and it has a bound."""
    finite = halves.field.finite
    lighted = halves.light is not None
    sharp = halves.march.sharp
    real = wp.float64
    Scene = halves.Scene
    centered = halves.field.centered()
    _, interval, _ = make_transfer(real)
    _, cut = make_pieces(halves)
    _, crossing = make_cubics(halves)
    shone = make_shone(halves)
    absolute, steepest = make_jumps(halves)[:2]
    extent = halves.field.extent()
    eye_of = make_shading(halves).eye
    deviations, opacities, tilts = make_series(PACKET)
    _, enter, _, _ = make_walk(real)
    _, gather = make_gather()
    places = wp.types.vector(PACKET, int)
    flags = wp.types.vector(PACKET, bool)
    ones = wp.constant(lanes(*[1.0] * PACKET))

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, begin: real, end: real):
        zero = real(0.0)
        third = real(wp.static(1.0 / 3.0))
        outer = scene.transfer.knot.shape[0] - 1
        d = direction
        clear = real(1.0) - scene.opaque
        eye = wp.vec3d()
        if wp.static(lighted):
            eye = eye_of(scene, d)
        # Rounding of a scalar, and that of the place that it is taken at.
        blurred = scene.march.blur
        ulps = scene.march.ulps[1]
        if wp.static(sharp):
            blurred += scene.view.astray * scene.march.astray
            ulps += real(3.0) * scene.view.astray
        T = real(1.0)
        red = zero
        green = zero
        blue = zero
        bound = zero
        count = int(0)
        walk = enter(scene.field.last, origin, direction, begin)
        end = wp.min(end, walk.out)
        while walk.t < end and T >= clear:
            walk, packet = gather(scene.blocks, walk, end)
            n = packet.count
            cell = packet.cell
            start = packet.start
            long = packet.length
            # All of them at a time; what is beyond the last of the ray's has no length.
            m0 = lanes()
            m1 = lanes()
            m2 = lanes()
            m3 = lanes()
            L = lanes()
            for l in range(PACKET):
                h = real(0.5) * long[l]
                L[l] = wp.where(l < n, long[l], zero)
                p = origin + (start[l] + h) * d - wp.vec3d(real(cell[0, l]), real(cell[1, l]), real(cell[2, l]))
                m = centered(scene.field, cell[0, l], cell[1, l], cell[2, l], p, d, h)
                m0[l] = m[0]
                m1[l] = m[1]
                m2[l] = m[2]
                m3[l] = m[3]
            R = deviations(m1, m2, m3)
            mean = m0 + third * m2
            single = flags(True)
            at = places()
            knot = lanes()
            tau = lanes()
            dtau = lanes()
            steep = lanes()
            fade = lanes()
            tint = lanes()
            blur = blurred * ones
            for l in range(PACKET):
                q = int(packet.kind[l])
                uniform = bool(False)
                if wp.static(sharp):
                    if scene.march.local or (q < 0 and R[l] == zero):
                        low, high = extent(scene.field, cell[0, l], cell[1, l], cell[2, l])
                        uniform = low == high
                        size = wp.where(high > -low, high, -low)
                        blur[l] = scene.march.ulps[0] * size + ulps * (high - low) + DENORMAL
                if q < 0:
                    wide = R[l]
                    if wp.static(sharp):
                        # Where all corners are equal nothing is rounded.
                        wide = wp.where(uniform, zero, wide + blur[l])
                    low = mean[l] - wide
                    high = mean[l] + wide
                    q = interval(scene.transfer, low)
                    if q < outer:
                        single[l] = high <= scene.transfer.knot[wp.max(q + 1, 0)]
                    if not single[l]:
                        # Nearly so, if it only reaches into the intervals next to the mean's: off by most at its ends.
                        q = interval(scene.transfer, mean[l])
                        change = wp.vec4d()
                        # The series is for extinctions >= 0, which a line drawn too far need not have.
                        rate = scene.transfer.slope[wp.max(q, 0)][3]
                        middle = scene.transfer.value[wp.max(q, 0)][3] + rate * (
                            mean[l] - scene.transfer.knot[wp.max(q, 0)]
                        )
                        single[l] = middle >= wp.abs(rate) * wide
                        if q > 0:
                            past = scene.transfer.knot[wp.max(q, 0)] - low
                            if past > zero:
                                change = past * absolute(
                                    scene.transfer.slope[wp.max(q - 1, 0)] - scene.transfer.slope[wp.max(q, 0)]
                                )
                                if q > 1:
                                    single[l] = single[l] and low >= scene.transfer.knot[wp.max(q - 1, 0)]
                        if q < outer:
                            past = high - scene.transfer.knot[wp.max(q + 1, 0)]
                            if past > zero:
                                change += past * absolute(
                                    scene.transfer.slope[wp.max(q + 1, 0)] - scene.transfer.slope[wp.max(q, 0)]
                                )
                                if q + 1 < outer:
                                    single[l] = single[l] and high <= scene.transfer.knot[wp.max(q + 2, 0)]
                        fade[l] = change[3]
                        tint[l] = steepest(change)
                q = wp.max(q, 0)
                at[l] = q
                knot[l] = scene.transfer.knot[q]
                tau[l] = scene.transfer.value[q][3]
                slope = scene.transfer.slope[q]
                dtau[l] = slope[3]
                steep[l] = steepest(slope)
            off = mean - knot
            x = wp.cw_mul(tau + wp.cw_mul(dtau, off), L)
            for l in range(PACKET):
                x[l] = wp.where(x[l] > zero, x[l], zero)
            A = opacities(x)
            V, risk = tilts(m1, m2, m3, R, real(0.5) * x, real(0.5) * wp.cw_mul(dtau, L), A)
            risk = wp.cw_mul(risk, steep)
            simple = bool(True)
            for l in range(PACKET):
                bent = scene.march.brightest * fade[l] * L[l] + tint[l] * A[l]
                most = scene.march.tolerance * A[l] + real(1.0e-300)
                single[l] = single[l] and risk[l] <= most and bent <= most
                risk[l] += bent
                if not wp.static(finite):
                    single[l] = single[l] and wp.isfinite(R[l])
                simple = simple and single[l]
            if wp.static(sharp):
                for l in range(PACKET):
                    risk[l] += blur[l] * (scene.march.brightest * wp.abs(dtau[l]) * L[l] + steep[l] * A[l])
                    risk[l] += real(VALUE) * scene.march.brightest * (tau[l] * L[l] + x[l])
            if simple and not wp.static(lighted):
                for l in range(PACKET):
                    value = scene.transfer.value[wp.max(at[l], 0)]
                    slope = scene.transfer.slope[wp.max(at[l], 0)]
                    TA = T * A[l]
                    TV = T * V[l] + TA * off[l]
                    red += TA * value[0] + TV * slope[0]
                    green += TA * value[1] + TV * slope[1]
                    blue += TA * value[2] + TV * slope[2]
                    bound += T * risk[l]
                    T -= TA
            else:
                l = int(0)
                while l < n:
                    segment = wp.vec4d()
                    error = zero
                    q = wp.max(at[l], 0)
                    here = Cubic()
                    here.middle = origin + (start[l] + real(0.5) * L[l]) * d
                    here.d = d
                    here.eye = eye
                    here.m = wp.vec4d(m0[l], m1[l], m2[l], m3[l])
                    here.length = L[l]
                    here.T = T
                    here.blur = blur[l]
                    if single[l]:
                        segment = (
                            A[l] * (scene.transfer.value[q] + off[l] * scene.transfer.slope[q])
                            + V[l] * scene.transfer.slope[q]
                        )
                        segment[3] = A[l]
                        if wp.static(lighted):
                            segment = shone(scene, here, q, segment)
                        error = risk[l]
                    else:
                        pieces = int(0)
                        known = bool(True)
                        if not wp.static(finite):
                            known = wp.isfinite(R[l])
                        if known:
                            if wp.abs(m1[l]) > real(4.0) * wp.abs(m2[l]) + real(6.0) * wp.abs(m3[l]):
                                segment, error, pieces = crossing(scene, here)
                            else:
                                segment, error, pieces = cut(scene, from_start(here))
                        count += pieces
                    bound += T * error
                    red += T * segment[0]
                    green += T * segment[1]
                    blue += T * segment[2]
                    T -= T * segment[3]
                    l += 1
            count += n
        total = real(1.0) - T
        if walk.t < end or (wp.static(halves.cuts.any or halves.brick) and T < clear):
            # What is behind is not visited; nor is, of a ray that is cut, what is behind this stretch or brick.
            bound += T * scene.march.brightest
        bound += total * scene.march.tinted + real(count) * scene.march.sum
        if scene.stretch == 0:
            # Of the ray as a whole.
            bound += scene.march.veiled
            if not wp.static(sharp):
                bound += wp.max(scene.view.astray - scene.march.allowed, zero) * scene.march.astray
        return wp.vec4d(red, green, blue, total), count, bound

    return march
