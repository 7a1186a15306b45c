"""The certified walk: cell by cell, each within a bound that is summed along the ray.

A packet of cells that have something to see is gathered and integrated at a time, as vectors, by ``series``: of a cell
whose piece of ray stays in one interval of the transfer function. One that reaches into the next interval by so little
that a straight line will do is counted as such, and its deviation into the bound. Any other is cut where the scalar
reaches a control point. A piece that the series is not good enough for is integrated as ``Exact`` does.

Light is no polynomial: what it does to a piece is taken from a few points, the more the more the piece adds to the
pixel and the smaller the tolerance. Opacity, and the bound, know nothing of it.

What the bounds of pieces are compared with is a share of the opacity that the piece adds: opacities sum to one, so
the bounds sum to no more than that share.
"""

from functools import cache

import numpy as np
import warp as wp

from .blocks import BITS, EMPTY
from .exact import make_jumps, make_pieces
from .ray import FAR
from .scene import make_scene
from .segment import over
from .series import make_series
from .shading import make_shading
from .transfer import make_transfer

# Cells that are integrated at a time.
PACKET = 4
# Points that a piece is lit in, by what it adds to the pixel over the tolerance: (up to, Gauss-Legendre points).
# One that adds more, or is deeper, is integrated as ``Exact`` does.
POINTS = ((1.0, 1), (32.0, 2), (1000.0, 3), (32000.0, 4))
DEEP = 1.0

# The cubic about the middle of a ray's piece in a cell, at local point p, h half its length: (m0, m1, m2, m3), v in
# [-1, 1]. In C++, where the corners share one address and sums may be fused: the frame is a tenth faster.
CENTERED = """
#pragma clang fp contract(fast)
const size_t nx = data.shape[2];
const size_t nxy = nx * data.shape[1];
const auto* c = data.data + (k * nxy + j * nx + i);
const double x = p[0], y = p[1], z = p[2];
const double c000 = double(c[0]) - shift, c010 = double(c[nx]) - shift;
const double c001 = double(c[nxy]) - shift, c011 = double(c[nxy + nx]) - shift;
const double x00 = double(c[1]) - shift - c000, x10 = double(c[nx + 1]) - shift - c010;
const double x01 = double(c[nxy + 1]) - shift - c001, x11 = double(c[nxy + nx + 1]) - shift - c011;
const double v00 = c000 + x * x00, v01 = c001 + x * x01;
const double y0 = c010 + x * x10 - v00, y1 = c011 + x * x11 - v01;
const double v0 = v00 + y * y0, dz = v01 + y * y1 - v0;
const double xy0 = x10 - x00, xyz = x11 - x01 - xy0, xz = x01 - x00 + y * xyz, yz = y1 - y0;
const double dx = x00 + y * xy0 + z * xz, dy = y0 + z * yz, xy = xy0 + z * xyz;
return wp::vec_t<4, double>(
    v0 + z * dz,
    h * (d[0] * dx + d[1] * dy + d[2] * dz),
    h * h * (d[0] * (d[1] * xy + d[2] * xz) + d[1] * d[2] * yz),
    h * h * h * (d[0] * d[1] * d[2] * xyz)
);
"""


@cache
def make_certified(variant):
    """``march(scene, origin, direction, length)`` -> composite, number of cells and pieces, and bound on the error."""
    finite = variant.finite
    real = wp.float64
    Scene = make_scene(variant)
    _, interval, _ = make_transfer(real)
    piece, cut = make_pieces(variant)
    absolute, steepest, jump, fuzzy = make_jumps(variant)
    lighted = variant.lit != ""
    eye_of, gradient, light, lit, _ = make_shading(variant)
    rules = [np.polynomial.legendre.leggauss(n) for _, n in POINTS]
    points = wp.constant(
        wp.types.matrix((4, 4), real)(*np.array([np.pad(x, (0, 4 - len(x))) for x, _ in rules]).ravel())
    )
    weights = wp.constant(
        wp.types.matrix((4, 4), real)(*np.array([np.pad(w, (0, 4 - len(w))) for _, w in rules]).ravel())
    )
    deviation, opacity, tilt = make_series(None)
    deviations, opacities, tilts = make_series(PACKET)
    lanes = wp.types.vector(PACKET, real)
    places = wp.types.vector(PACKET, int)
    flags = wp.types.vector(PACKET, bool)
    cells = wp.types.matrix((3, PACKET), int)

    @wp.func_native(CENTERED)
    def centered(
        data: wp.array3d(dtype=variant.dtype), shift: real, i: int, j: int, k: int, p: wp.vec3d, d: wp.vec3d, h: real
    ) -> wp.vec4d: ...

    @wp.func
    def from_start(m0: real, m1: real, m2: real, m3: real, L: real):
        """The cubic of the length from the start of a piece."""
        h = real(2.0) / L
        return wp.vec4d(
            m0 - m1 + m2 - m3, h * (m1 - real(2.0) * m2 + real(3.0) * m3), h * h * (m2 - real(3.0) * m3), h * h * h * m3
        )

    @wp.func
    def shone(
        scene: Scene,
        middle: wp.vec3d,
        d: wp.vec3d,
        eye: wp.vec3d,
        m0: real,
        m1: real,
        m2: real,
        m3: real,
        L: real,
        k: int,
        A: real,
        T: real,
    ):
        """Lit segment of opacity A, behind transparency T, of a cubic that stays in interval k."""
        third = real(wp.static(1.0 / 3.0))
        slope = scene.transfer.slope[k]
        value = scene.transfer.value[k] + (m0 - scene.transfer.knot[k]) * slope
        half = real(0.5) * L
        segment = wp.vec4d()
        added = T * A / scene.steps.tolerance
        if half * value[3] > real(wp.static(0.5 * DEEP)) or added > real(wp.static(POINTS[3][0])):
            start = middle - half * d
            segment = piece(scene, start, d, eye, from_start(m0, m1, m2, m3, L), L, k)
        elif A > real(0.0):
            rule = int(0)
            if added > real(wp.static(POINTS[2][0])):
                rule = 3
            elif added > real(wp.static(POINTS[1][0])):
                rule = 2
            elif added > real(wp.static(POINTS[0][0])):
                rule = 1
            total = real(0.0)
            for i in range(rule + 1):
                v = points[rule, i]
                off = v * (m1 + v * (m2 + v * m3))
                q = value + off * slope
                vv = v * v
                rise = (
                    real(0.5) * m1 * (vv - real(1.0))
                    + third * m2 * (vv * v + real(1.0))
                    + real(0.25) * m3 * (vv * vv - real(1.0))
                )
                depth = half * (value[3] * (v + real(1.0)) + slope[3] * rise)
                weight = weights[rule, i] * wp.max(q[3], real(0.0)) * wp.exp(-depth)
                I = light(scene, gradient(scene, middle + v * half * d), eye)
                segment += weight * lit(scene, q, k, m0 + off, I)
                total += weight
            if total > real(0.0):
                segment *= A / total
        segment[3] = A
        return segment

    @wp.func
    def linear(
        scene: Scene,
        middle: wp.vec3d,
        d: wp.vec3d,
        eye: wp.vec3d,
        k: int,
        m0: real,
        m1: real,
        m2: real,
        m3: real,
        L: real,
        T: real,
    ):
        """Segment of a cubic that stays in interval k, behind transparency T, and a bound on its colour's error."""
        mean = m0 + real(wp.static(1.0 / 3.0)) * m2
        slope = scene.transfer.slope[k]
        value = scene.transfer.value[k] + (mean - scene.transfer.knot[k]) * slope
        segment = wp.vec4d()
        error = real(0.0)
        x = value[3] * L
        if x > real(0.0):
            A = opacity(x)
            V, off = tilt(m1, m2, m3, deviation(m1, m2, m3), real(0.5) * x, real(0.5) * L * slope[3], A)
            error = off * steepest(slope)
            good = error <= scene.steps.tolerance * A
            if not good:
                error = real(0.0)
            error += scene.steps.blur * (scene.steps.brightest * wp.abs(slope[3]) * L + steepest(slope) * A)
            if wp.static(lighted):
                segment = shone(scene, middle, d, eye, m0, m1, m2, m3, L, k, A, T)
            elif good:
                segment = A * value + V * slope
                segment[3] = A
            else:
                start = middle - real(0.5) * L * d
                segment = piece(scene, start, d, eye, from_start(m0, m1, m2, m3, L), L, k)
        return segment, error

    @wp.func
    def crossing(
        scene: Scene,
        middle: wp.vec3d,
        d: wp.vec3d,
        eye: wp.vec3d,
        m0: real,
        m1: real,
        m2: real,
        m3: real,
        L: real,
        T: real,
    ):
        """Segment of a monotone cubic through several intervals, a bound on its error, and the number of its pieces."""
        segment = wp.vec4d()
        error = real(0.0)
        count = int(0)
        start = real(-1.0)
        value = m0 - m1 + m2 - m3
        final = m0 + m1 + m2 + m3
        last = scene.transfer.knot.shape[0] - 1
        k = interval(scene.transfer, value)
        rises = m1 > real(0.0)
        # The root of a step so small is as exact as numbers are: a step squares the error.
        close = real(1.0e-8) * wp.abs(m1)
        # Length that is on the wrong side of a crossing nevertheless: the slope is at least m1 / 2.
        unsure = wp.min(L, L * (real(4.0e-16) + scene.steps.blur / wp.abs(m1)))
        error += unsure * fuzzy(scene, value)
        while start < real(1.0):
            stop = real(1.0)
            crosses = k < last
            knot = final
            if rises:
                if crosses:
                    knot = scene.transfer.knot[wp.max(k + 1, 0)]
                crosses = knot < final
            else:
                crosses = k > 0
                if crosses:
                    knot = scene.transfer.knot[wp.max(k, 0)]
                crosses = knot > final
            if crosses:
                # Newton's method from the secant through both ends.
                stop = start + (real(1.0) - start) * (knot - value) / (final - value)
                for _ in range(20):
                    off = m0 - knot + stop * (m1 + stop * (m2 + stop * m3))
                    stop -= off / (m1 + stop * (real(2.0) * m2 + stop * real(3.0) * m3))
                    if wp.abs(off) <= close:
                        break
                stop = wp.clamp(stop, start, real(1.0))
                value = knot
            error += (real(1.0) - segment[3]) * unsure * jump(scene, k)
            if stop > start and scene.transfer.visible[k] == k:
                c = real(0.5) * (start + stop)
                w = real(0.5) * (stop - start)
                curve = m2 + real(3.0) * c * m3
                part, off = linear(
                    scene,
                    middle + real(0.5) * L * c * d,
                    d,
                    eye,
                    k,
                    m0 + c * (m1 + c * (m2 + c * m3)),
                    w * (m1 + c * (m2 + curve)),
                    w * w * curve,
                    w * w * w * m3,
                    w * L,
                    T * (real(1.0) - segment[3]),
                )
                error += (real(1.0) - segment[3]) * off
                segment = over(segment, part)
                count += 1
            start = stop
            if crosses:
                k += wp.where(rises, 1, -1)
            else:
                start = real(1.0)
        error += (real(1.0) - segment[3]) * unsure * fuzzy(scene, final)
        return segment, error, count

    @wp.func
    def reached(face: int, origin: real, inverse: real):
        """Where the ray is at a face across an axis; never, where it does not move along the axis or there is none."""
        return wp.where(inverse != real(0.0), (real(face) - origin) * inverse, real(FAR))

    @wp.func
    def outside(last: wp.vec3i, i: int, j: int, k: int):
        """Whether a cell is beyond the grid: whether any of these is negative."""
        return (i | j | k | (last[0] - i) | (last[1] - j) | (last[2] - k)) < 0

    @wp.func
    def landed(i: int, edge: int, passed: bool, way: real, place: real):
        """Index behind a leap from i along an axis: beyond the face ``edge`` if that was passed, else before it."""
        there = int(place)
        if way > real(0.0):
            return wp.where(passed, edge, wp.max(wp.min(there, edge - 1), i))
        if way < real(0.0):
            return wp.where(passed, edge - 1, wp.min(wp.max(there, edge), i))
        return i

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, length: real):
        zero = real(0.0)
        third = real(wp.static(1.0 / 3.0))
        last = scene.field.last
        outer = scene.transfer.knot.shape[0] - 1
        d = direction
        shift = zero
        if wp.static(variant.dtype in (wp.float16, wp.float32, wp.float64)):
            shift = scene.field.shift
        # 0 along an axis without faces to cross.
        inverse = wp.vec3d()
        for axis in range(3):
            if d[axis] != zero and last[axis] > 0:
                inverse[axis] = real(1.0) / d[axis]
        sx = wp.where(d[0] > zero, 1, -1)
        sy = wp.where(d[1] > zero, 1, -1)
        sz = wp.where(d[2] > zero, 1, -1)
        i = wp.max(wp.min(int(origin[0]), last[0]), 0)
        j = wp.max(wp.min(int(origin[1]), last[1]), 0)
        k = wp.max(wp.min(int(origin[2]), last[2]), 0)
        nx = reached(i + wp.max(sx, 0), origin[0], inverse[0])
        ny = reached(j + wp.max(sy, 0), origin[1], inverse[1])
        nz = reached(k + wp.max(sz, 0), origin[2], inverse[2])
        t = zero
        clear = real(1.0) - scene.steps.opaque
        eye = wp.vec3d()
        if wp.static(lighted):
            eye = eye_of(scene, d)
        T = real(1.0)
        red = zero
        green = zero
        blue = zero
        bound = zero
        count = int(0)
        cell = cells()
        start = lanes()
        long = lanes()
        while t < length and T >= clear:
            # The next cells that have something to see.
            n = int(0)
            while n < PACKET and t < length:
                mask = scene.masks[wp.max(k, 0) >> BITS, wp.max(j, 0) >> BITS, wp.max(i, 0) >> BITS]
                if mask == wp.uint64(0):
                    # To where the ray leaves the cube of empty blocks; one of another kind may have no cell to see.
                    kind = int(scene.kinds[wp.max(k, 0) >> BITS, wp.max(j, 0) >> BITS, wp.max(i, 0) >> BITS])
                    reach = wp.max(EMPTY - kind, 0)
                    ex = wp.where(d[0] > zero, (i >> BITS) + reach + 1, (i >> BITS) - reach) << BITS
                    ey = wp.where(d[1] > zero, (j >> BITS) + reach + 1, (j >> BITS) - reach) << BITS
                    ez = wp.where(d[2] > zero, (k >> BITS) + reach + 1, (k >> BITS) - reach) << BITS
                    lx = reached(ex, origin[0], inverse[0])
                    ly = reached(ey, origin[1], inverse[1])
                    lz = reached(ez, origin[2], inverse[2])
                    end = wp.where(lx < ly, lx, ly)
                    end = wp.where(lz < end, lz, end)
                    t = wp.where(end > t, end, t)
                    i = landed(i, ex, lx <= t, inverse[0], origin[0] + t * d[0])
                    j = landed(j, ey, ly <= t, inverse[1], origin[1] + t * d[1])
                    k = landed(k, ez, lz <= t, inverse[2], origin[2] + t * d[2])
                    if outside(last, i, j, k):
                        t = length
                    nx = reached(i + wp.max(sx, 0), origin[0], inverse[0])
                    ny = reached(j + wp.max(sy, 0), origin[1], inverse[1])
                    nz = reached(k + wp.max(sz, 0), origin[2], inverse[2])
                    continue
                # The nearest face; comparisons, since Warp's min also looks for NaN.
                stop = wp.where(nx < ny, nx, ny)
                stop = wp.where(nz < stop, nz, stop)
                stop = wp.where(stop > length, length, stop)
                bit = wp.uint64((k & 3) << 4 | (j & 3) << 2 | i & 3)
                if (mask >> bit) & wp.uint64(1) != wp.uint64(0):
                    cell[0, n] = i
                    cell[1, n] = j
                    cell[2, n] = k
                    start[n] = t
                    long[n] = stop - t
                    n += 1
                t = stop
                hit_x = nx <= stop
                hit_y = ny <= stop
                hit_z = nz <= stop
                i += wp.where(hit_x, sx, 0)
                j += wp.where(hit_y, sy, 0)
                k += wp.where(hit_z, sz, 0)
                if outside(last, i, j, k):
                    t = length
                # From the index, not by adding: rounding must not pile up.
                nx = reached(i + wp.max(sx, 0), origin[0], inverse[0])
                ny = reached(j + wp.max(sy, 0), origin[1], inverse[1])
                nz = reached(k + wp.max(sz, 0), origin[2], inverse[2])
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
                m = centered(scene.field.data, shift, cell[0, l], cell[1, l], cell[2, l], p, d, h)
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
            for l in range(PACKET):
                q = int(
                    scene.kinds[
                        wp.max(cell[2, l], 0) >> BITS, wp.max(cell[1, l], 0) >> BITS, wp.max(cell[0, l], 0) >> BITS
                    ]
                )
                if q < 0:
                    # A scalar that is constant is exact.
                    wide = wp.where(R[l] > zero, R[l] + scene.steps.blur, zero)
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
                            over = scene.transfer.knot[wp.max(q, 0)] - low
                            if over > zero:
                                change = over * absolute(
                                    scene.transfer.slope[wp.max(q - 1, 0)] - scene.transfer.slope[wp.max(q, 0)]
                                )
                                if q > 1:
                                    single[l] = single[l] and low >= scene.transfer.knot[wp.max(q - 1, 0)]
                        if q < outer:
                            over = high - scene.transfer.knot[wp.max(q + 1, 0)]
                            if over > zero:
                                change += over * absolute(
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
                blurred = scene.steps.blur * (scene.steps.brightest * wp.abs(dtau[l]) * L[l] + steep[l] * A[l])
                bent = scene.steps.brightest * fade[l] * L[l] + tint[l] * A[l]
                most = scene.steps.tolerance * A[l] + real(1.0e-300)
                single[l] = single[l] and risk[l] <= most and bent <= most
                risk[l] += bent + blurred
                if not wp.static(finite):
                    single[l] = single[l] and wp.isfinite(R[l])
                simple = simple and single[l]
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
                    center = origin + (start[l] + real(0.5) * L[l]) * d
                    if single[l]:
                        if wp.static(lighted):
                            segment = shone(scene, center, d, eye, m0[l], m1[l], m2[l], m3[l], L[l], q, A[l], T)
                        else:
                            segment = (
                                A[l] * (scene.transfer.value[q] + off[l] * scene.transfer.slope[q])
                                + V[l] * scene.transfer.slope[q]
                            )
                            segment[3] = A[l]
                        error = risk[l]
                    else:
                        pieces = int(0)
                        known = bool(True)
                        if not wp.static(finite):
                            known = wp.isfinite(R[l])
                        if known:
                            if wp.abs(m1[l]) > real(4.0) * wp.abs(m2[l]) + real(6.0) * wp.abs(m3[l]):
                                segment, error, pieces = crossing(
                                    scene, center, d, eye, m0[l], m1[l], m2[l], m3[l], L[l], T
                                )
                            else:
                                s = from_start(m0[l], m1[l], m2[l], m3[l], L[l])
                                segment, error, pieces = cut(scene, origin + start[l] * d, d, eye, s, L[l])
                        count += pieces
                    bound += T * error
                    red += T * segment[0]
                    green += T * segment[1]
                    blue += T * segment[2]
                    T -= T * segment[3]
                    l += 1
            count += n
        total = real(1.0) - T
        if t < length or (wp.static(variant.cut) and T < clear):
            # What is behind is not visited; nor is, of a ray that is cut, what is behind this stretch.
            bound += T * scene.steps.brightest
        bound += total * scene.steps.tinted + scene.steps.veiled
        return wp.vec4d(red, green, blue, total), count, bound

    return march
