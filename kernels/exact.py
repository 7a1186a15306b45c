"""The exact walk: cell by cell, and in a cell from control point to control point of the transfer function.

On such a piece the scalar s is a cubic in the length u from its start, extinction and colour are linear in s, and the
optical depth D is a quartic in closed form. What the piece adds of colour is
``int c tau exp(-D) du = c0 (1 - exp(-D)) + c' int (s - s0) tau exp(-D) du``; quadrature is left with the last integral,
whose terms have one sign where s is monotone. Where there is light, which is no polynomial, the whole colour is left to
quadrature, with eight nodes or more.

Where a ray runs in the face of two cells, one absent and one not, either may be the one it sees.
"""

from functools import cache

import numpy as np
import warp as wp

from .cell import at, cubic, make_corners, moved, quartic, turns, vec5d, zero
from .importance import BLOCK
from .scene import make_scene
from .segment import CUT, RULES, make_absorbed, over
from .shading import make_shading
from .transfer import make_transfer, make_transparent

# Nodes of the Gauss-Legendre rules of ``segment.gauss_nodes`` by optical depth of a piece: (depth up to, rule). The
# integrand is a polynomial of degree 6 times exp(-quartic). Pieces deeper than the last are cut at multiples of it.
# 1e-12 of the opacity for any cubic.
DEPTHS = ((1e-4, 0), (0.01, 1), (2.0, 2), (4.0, 3))


@cache
def make_jumps(variant):
    """``absolute(v)`` and ``steepest(slope)``, of the three colours; and what a jump of the transfer function does where
    rounding puts the scalar on its wrong side, a unit of length: ``jump(scene, k)`` of interval k, if that is one, and
    ``fuzzy(scene, s)`` of those within ``steps.blur`` of s.
    """
    real = wp.float64
    Scene = make_scene(variant)
    _, interval, _ = make_transfer(real)

    @wp.func
    def absolute(v: wp.vec4d):
        return wp.vec4d(wp.abs(v[0]), wp.abs(v[1]), wp.abs(v[2]), wp.abs(v[3]))

    @wp.func
    def steepest(slope: wp.vec4d):
        # Comparisons, since Warp's max also looks for NaN.
        size = absolute(slope)
        most = wp.where(size[0] > size[1], size[0], size[1])
        return wp.where(size[2] > most, size[2], most)

    @wp.func
    def jump(scene: Scene, k: int):
        size = real(0.0)
        if k > 0 and k < scene.transfer.knot.shape[0] - 1:
            if scene.transfer.knot[k + 1] == scene.transfer.knot[k]:
                low = scene.transfer.value[k]
                high = scene.transfer.value[k + 1]
                most = wp.where(high[3] > low[3], high[3], low[3])
                size = scene.steps.brightest * wp.abs(high[3] - low[3]) + steepest(high - low) * most
        return size

    @wp.func
    def fuzzy(scene: Scene, s: real):
        k = interval(scene.transfer, s)
        size = real(0.0)
        if k > 1:
            if s - scene.transfer.knot[k] <= scene.steps.blur:
                size += jump(scene, k - 1)
        if k < scene.transfer.knot.shape[0] - 2:
            if scene.transfer.knot[wp.max(k + 1, 0)] - s <= scene.steps.blur:
                size += jump(scene, k + 1)
        return size

    return absolute, steepest, jump, fuzzy


@cache
def make_pieces(variant):
    """Of a scalar that is the cubic ``s`` of the length from the start of a piece at p, in direction d:

    ``piece(scene, p, d, eye, s, length, k)`` -> segment in interval k;
    ``cut(scene, p, d, eye, s, length)`` -> segment in whatever intervals there are, what jumps may be off by, and the
    number of its pieces.
    Positions and directions count only where there is light.
    """
    Scene = make_scene(variant)
    _, interval, _ = make_transfer(wp.float64)
    absorbed, _ = make_absorbed(wp.float64)
    sizes = [n for _, n in RULES["float64"]]
    (d0, n0), (d1, n1), (d2, n2), (d3, n3) = [(depth, sizes[rule]) for depth, rule in DEPTHS]
    o1, o2, o3 = np.cumsum(sizes)[:3].tolist()
    opaque = CUT["float64"]
    lighted = variant.lit != ""
    _, gradient, light, lit, _ = make_shading(variant)
    _, _, jump, fuzzy = make_jumps(variant)
    bounded = variant.rule == "certified"

    @wp.func
    def unsure(scene: Scene, s: wp.vec4d, u: wp.float64, length: wp.float64):
        """Length about u in which the scalar is within its rounding of what it is at u."""
        slope = wp.abs(s[1] + u * (wp.float64(2.0) * s[2] + u * wp.float64(3.0) * s[3]))
        bend = wp.abs(wp.float64(2.0) * s[2] + wp.float64(6.0) * u * s[3])
        blur = scene.steps.blur
        reach = length
        if wp.float64(8.0) * blur < slope * reach:
            reach = wp.float64(8.0) * blur / slope
        if wp.float64(32.0) * blur < bend * reach * reach:
            reach = wp.sqrt(wp.float64(32.0) * blur / bend)
        return reach

    @wp.func
    def quadrature(
        scene: Scene,
        p: wp.vec3d,
        d: wp.vec3d,
        eye: wp.vec3d,
        s: wp.vec4d,
        tau: wp.vec4d,
        D: vec5d,
        length: wp.float64,
        front: wp.vec4d,
        k: int,
    ):
        """Integrals of (s - s0) tau exp(-D), and of c tau exp(-D) where c is lit."""
        depth = quartic(D, length)
        first = int(0)
        count = int(n0)
        if depth > wp.float64(d2):
            first = o3
            count = n3
        elif depth > wp.float64(d1):
            first = o2
            count = n2
        elif depth > wp.float64(d0) or wp.static(lighted):
            first = o1
            count = n1
        total = wp.float64(0.0)
        color = wp.vec4d()
        start = wp.float64(0.0)
        reached = wp.float64(0.0)
        while reached < wp.min(depth, wp.float64(opaque)):
            stop = length
            reached += wp.float64(d3)
            if reached < depth:
                behind = D
                behind[0] = -reached
                stop = zero(behind, start, length, wp.float64(0.5) * (start + length), wp.float64(1.0))
            for i in range(first, first + count):
                node = scene.nodes[wp.max(i, 0)]
                u = start + node[0] * (stop - start)
                risen = u * (s[1] + u * (s[2] + u * s[3]))
                weight = (stop - start) * node[1] * at(tau, u) * wp.exp(-quartic(D, u))
                if wp.static(lighted):
                    q = front + risen * scene.transfer.slope[k]
                    I = light(scene, gradient(scene, p + u * d), eye)
                    color += weight * lit(scene, q, k, s[0] + risen, I)
                else:
                    total += weight * risen
            start = stop
        return total, color

    @wp.func
    def piece(scene: Scene, p: wp.vec3d, d: wp.vec3d, eye: wp.vec3d, s: wp.vec4d, length: wp.float64, k: int):
        slope = scene.transfer.slope[k]
        front = scene.transfer.value[k] + (s[0] - scene.transfer.knot[k]) * slope
        tau = slope[3] * s
        # Interpolated towards a knot where it is 0 it may be negative by rounding.
        tau[0] = wp.max(front[3], wp.float64(0.0))
        D = vec5d(
            wp.float64(0.0),
            tau[0],
            wp.float64(0.5) * tau[1],
            wp.float64(wp.static(1.0 / 3.0)) * tau[2],
            wp.float64(0.25) * tau[3],
        )
        A = absorbed(wp.max(quartic(D, length), wp.float64(0.0)))
        segment = A * front
        if wp.static(lighted):
            _moment, segment = quadrature(scene, p, d, eye, s, tau, D, length, front, k)
        elif slope[0] != wp.float64(0.0) or slope[1] != wp.float64(0.0) or slope[2] != wp.float64(0.0):
            moment, _color = quadrature(scene, p, d, eye, s, tau, D, length, front, k)
            segment += moment * slope
        segment[3] = A
        return segment

    @wp.func
    def cut(scene: Scene, p: wp.vec3d, d: wp.vec3d, eye: wp.vec3d, s: wp.vec4d, length: wp.float64):
        segment = wp.vec4d()
        error = wp.float64(0.0)
        count = int(0)
        last = scene.transfer.knot.shape[0] - 1
        m = interval(scene.transfer, s[0])
        first, second = turns(s, length)
        start = wp.float64(0.0)
        value = s[0]
        if wp.static(bounded):
            error += fuzzy(scene, value) * unsure(scene, s, start, length)
        for stretch in range(3):
            # s is monotone up to here.
            end = length
            if stretch == 0:
                end = first
            elif stretch == 1:
                end = second
            final = at(s, end)
            rises = final > value
            if wp.static(bounded):
                error += fuzzy(scene, final) * unsure(scene, s, end, length)
            while start < end:
                stop = end
                knot = scene.transfer.knot[wp.max(wp.where(rises, wp.min(m + 1, last), m), 0)]
                crosses = wp.where(rises, m < last and knot < final, m > 0 and knot > final)
                if crosses:
                    # The secant through both ends is a good guess.
                    guess = start + (end - start) * (knot - value) / (final - value)
                    sign = wp.where(rises, wp.float64(1.0), wp.float64(-1.0))
                    stop = zero(vec5d(s[0] - knot, s[1], s[2], s[3], wp.float64(0.0)), start, end, guess, sign)
                    value = knot
                if wp.static(bounded):
                    error += jump(scene, m) * unsure(scene, s, stop, length)
                if stop > start and scene.transfer.visible[m] == m:
                    part = piece(scene, p + start * d, d, eye, moved(s, start), stop - start, m)
                    segment = over(segment, part)
                    count += 1
                start = stop
                if crosses:
                    m += wp.where(rises, 1, -1)
            value = final
        return segment, error, count

    return piece, cut


@cache
def make_exact(variant):
    """``march(scene, origin, direction, length)`` -> composite of the ray, and the number of pieces integrated."""
    finite = variant.finite
    Scene = make_scene(variant)
    _, corners = make_corners(variant.dtype)
    _, interval, _ = make_transfer(wp.float64)
    transparent = make_transparent(wp.float64)
    eye_of, _, _, _, _ = make_shading(variant)
    piece, cut = make_pieces(variant)

    @wp.func
    def through(scene: Scene, i: int, j: int, k: int, start: wp.vec3d, d: wp.vec3d, eye: wp.vec3d, length: wp.float64):
        """Segment of a cell from the point ``start``, and the number of its pieces."""
        c = corners(scene.field, i, j, k)
        if not wp.static(finite):
            for n in range(8):
                if not wp.isfinite(c[n]):
                    return wp.vec4d(), int(0)
        low = wp.min(c)
        high = wp.max(c)
        if transparent(scene.transfer, low, high):
            return wp.vec4d(), int(0)
        s = cubic(c, start - wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k)), d)
        m = interval(scene.transfer, low)
        if m == interval(scene.transfer, high):
            return piece(scene, start, d, eye, s, length, m), int(1)
        segment, _error, count = cut(scene, start, d, eye, s, length)
        return segment, count

    @wp.func
    def leaving(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, cell: wp.vec3i, axis: int):
        """Where the ray leaves a cell along an axis. The outermost cells end with the box, thin ones included."""
        face = wp.float64(cell[axis])
        if direction[axis] > wp.float64(0.0):
            face += wp.float64(1.0)
            if cell[axis] == scene.field.last[axis]:
                face = scene.view.high[axis]
        elif direction[axis] < wp.float64(0.0):
            if cell[axis] == 0:
                face = scene.view.low[axis]
        else:
            return wp.float64(1.0e300)
        return (face - origin[axis]) / direction[axis]

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, length: wp.float64):
        ray = wp.vec4d()
        count = int(0)
        eye = wp.vec3d()
        if wp.static(variant.lit != ""):
            eye = eye_of(scene, direction)
        last = scene.field.last
        cell = wp.vec3i()
        for a in range(3):
            cell[a] = wp.clamp(int(origin[a]), 0, last[a])
        t = wp.float64(0.0)
        while t < length and ray[3] <= scene.steps.opaque:
            # The cells to be left: this one, or an empty block's last along the ray.
            leaps = scene.empty[cell[2] // BLOCK, cell[1] // BLOCK, cell[0] // BLOCK] != wp.uint8(0)
            far = wp.vec3i()
            leave = wp.vec3d()
            for a in range(3):
                far[a] = cell[a]
                if leaps:
                    far[a] -= far[a] % BLOCK
                    if direction[a] > wp.float64(0.0):
                        far[a] = wp.min(far[a] + BLOCK - 1, last[a])
                leave[a] = leaving(scene, origin, direction, far, a)
            axis = int(wp.argmin(leave))
            end = wp.min(leave[axis], length)
            if leaps:
                for a in range(3):
                    first = cell[a] - cell[a] % BLOCK
                    here = int(origin[a] + end * direction[a])
                    cell[a] = wp.clamp(here, first, wp.min(first + BLOCK - 1, last[a]))
            elif end > t:
                segment, pieces = through(
                    scene, cell[0], cell[1], cell[2], origin + t * direction, direction, eye, end - t
                )
                ray = over(ray, segment)
                count += pieces
            t = wp.max(t, end)
            cell[axis] = far[axis] + wp.where(direction[axis] > wp.float64(0.0), 1, -1)
            if cell[axis] < 0 or cell[axis] > last[axis]:
                t = length
        return ray, count

    return march
