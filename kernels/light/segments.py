"""Lit segments of the uniform pre-integrated walk: a scalar that is linear between two samples, and light.

The modes are those of Lum, Wilson and Ma (2004), section 3, and what they are compared with. What a table says of a
segment is lit by the intensities at its ends with its front- and back-weighted integrals ("interpolated"), by their
mean ("average", Roettger et al. 2003), or by that of the mean normal ("center"). "isosurface" goes from control point
to control point and lights each stretch at its denser end, the crossing of a peak; "closest-isosurface" lights all of
them as the first. "supersampled" interpolates over several parts, each with its own gradients.
"""

from functools import cache

import warp as wp

from ..precision import vec3_of, vec4_of
from ..segment import over, widened
from ..transfer.function import make_transfer
from ..transfer.linear import make_shares
from ..transfer.lookup import make_bilinear
from .points import Lit, intensity_of, make_shading, make_shine


@cache
def make_stretch(real):
    """The struct of a segment [t, t + h] of a ray whose scalar runs linearly from ``front`` to ``back``."""
    vec3 = vec3_of(real)

    @wp.struct
    class Stretch:
        origin: vec3  # of the ray
        direction: vec3
        eye: vec3  # unit vector towards the viewer
        t: real
        h: real
        front: real
        back: real

    return Stretch


@cache
def make_lit(halves):
    """``ends(scene, origin, direction, t, eye)`` -> what is kept of a segment's end for the next one;
    ``absorbs(scene, front, back)``: whether a segment has any extinction;
    ``lit_segment(scene, stretch, whole, start, stop)`` -> vec4d of a segment, ``whole`` if the table is for its length,
    with what ``ends`` gave at its ends. The march has quadrature ``nodes``.
    """
    real = halves.real
    mode = (halves.light or Lit()).mode
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Intensity = intensity_of(real)
    Scene = halves.Scene
    Stretch = make_stretch(real)
    material = (halves.light or Lit()).material
    _, interval, _ = make_transfer(real)
    _, place, between = make_bilinear(real)
    shares = make_shares(real)
    _, gradient, light, _, factors, *_ = make_shading(halves)
    surface, shine = make_shine(halves)

    @wp.func
    def ends(scene: Scene, origin: vec3, direction: vec3, t: real, eye: vec3):
        p = origin + t * direction
        g = gradient(scene, p)
        if wp.static(mode == "center" and halves.cuts.parts is None):
            normal, clear = surface(scene, g)
            return Intensity(normal[0], normal[1], normal[2], clear, real(0.0), real(0.0))
        return light(scene, p, g, eye)

    @wp.func
    def product(a: real, da: real, b: real, db: real, c: real, dc: real, A: real, U: vec3):
        """What a product of three linear functions comes to, of values at the front and changes up to the back."""
        return (
            a * b * c * A
            + (da * b * c + a * db * c + a * b * dc) * U[0]
            + (da * db * c + da * b * dc + a * db * dc) * U[1]
            + da * db * dc * U[2]
        )

    @wp.func
    def stretch(scene: Scene, k: int, start: real, stop: real, length: real, I: Intensity, J: Intensity):
        """Scalar from start to stop inside interval k, intensity from I to J, all linear: exact."""
        slope = scene.transfer.slope[k]
        q = scene.transfer.value[k] + (start - scene.transfer.knot[k]) * slope
        dq = (stop - start) * slope
        A, U, _ = shares(scene.march.nodes, q[3] * length, (q[3] + dq[3]) * length)
        f = factors(scene, k, start)
        df = factors(scene, k, stop) - f
        result = vec4()
        for c in range(3):
            ambient = product(q[c], dq[c], f[0], df[0], real(1.0), real(0.0), A, U)
            diffuse = product(q[c], dq[c], f[1], df[1], I[c], J[c] - I[c], A, U)
            specular = product(real(1.0), real(0.0), f[2], df[2], I[c + 3], J[c + 3] - I[c + 3], A, U)
            result[c] = real(scene.light.shading.ambient) * ambient + diffuse + specular
        result[3] = A
        return widened(result)

    @wp.func
    def piecewise(scene: Scene, part: Stretch, I: Intensity, J: Intensity):
        """A segment from control point to control point, with intensities I and J at its ends where they count."""
        front = part.front
        back = part.back
        k = interval(scene.transfer, front)
        end = interval(scene.transfer, back)
        step = wp.where(back < front, -1, 1)
        segment = wp.vec4d()
        s = front
        x = real(0.0)
        going = bool(True)
        first = Intensity()
        found = bool(False)
        while going:
            stop = back
            y = real(1.0)
            going = k != end
            if going:
                # Upwards an interval ends where the next begins, downwards where it begins itself.
                stop = scene.transfer.knot[wp.where(step > 0, k + 1, k)]
                y = (stop - front) / (back - front)
            if scene.transfer.visible[k] == k and y > x:
                if wp.static(mode in ("isosurface", "closest-isosurface")):
                    if wp.static(mode == "isosurface") or not found:
                        rate = scene.transfer.slope[k][3] * real(step)
                        peak = part.t + wp.where(rate > real(0.0), y, x) * part.h
                        p = part.origin + peak * part.direction
                        first = light(scene, p, gradient(scene, p), part.eye)
                        found = True
                    segment = over(segment, stretch(scene, k, s, stop, (y - x) * part.h, first, first))
                else:
                    near = I + x * (J - I)
                    segment = over(segment, stretch(scene, k, s, stop, (y - x) * part.h, near, I + y * (J - I)))
            s = stop
            x = y
            k += step
        return segment

    @wp.func
    def absorbs(scene: Scene, front: real, back: real):
        low = interval(scene.transfer, wp.min(front, back))
        return scene.transfer.visible[low] <= interval(scene.transfer, wp.max(front, back))

    @wp.func
    def lit_segment(scene: Scene, part: Stretch, whole: bool, start: Intensity, stop: Intensity):
        I = start
        J = stop
        if wp.static(mode == "center"):
            m = real(0.5) * (start + stop)
            middle = part.origin + (part.t + real(0.5) * part.h) * part.direction
            I = shine(scene, middle, wp.normalize(vec3(m[0], m[1], m[2])), m[3], part.eye)
            J = I
        elif wp.static(mode == "average"):
            I = real(0.5) * (start + stop)
            J = I
        if wp.static(mode in ("center", "average", "interpolated")):
            if whole:
                i, j, x, y = place(scene.table, part.front, part.back)
                if wp.static(mode != "interpolated" and not material):
                    # One light, of which both weights together are the table without any.
                    q = between(scene.table.rgba, i, j, x, y)
                    one = vec4()
                    for c in range(3):
                        one[c] = (real(scene.light.shading.ambient) + I[c]) * q[c] + I[c + 3] * q[3]
                    one[3] = q[3]
                    return widened(one)
                f = between(scene.table.front, i, j, x, y)
                b = between(scene.table.back, i, j, x, y)
                plain = f + b
                if wp.static(material):
                    plain = between(scene.table.rgba, i, j, x, y)
                result = vec4()
                for c in range(3):
                    result[c] = (
                        real(scene.light.shading.ambient) * plain[c]
                        + f[c] * I[c]
                        + b[c] * J[c]
                        + f[3] * I[c + 3]
                        + b[3] * J[c + 3]
                    )
                result[3] = plain[3]
                return widened(result)
            return piecewise(scene, part, I, J)
        elif wp.static(mode == "supersampled"):
            segment = wp.vec4d()
            share = real(1.0) / real(scene.light.shading.parts)
            some = part
            some.h = share * part.h
            for n in range(scene.light.shading.parts):
                reached = real(n + 1) * share
                some.back = part.front + reached * (part.back - part.front)
                J = stop
                if n + 1 < scene.light.shading.parts:
                    J = ends(scene, part.origin, part.direction, part.t + reached * part.h, part.eye)
                some.t = part.t + real(n) * share * part.h
                segment = over(segment, piecewise(scene, some, I, J))
                some.front = some.back
                I = J
            return segment
        else:
            return piecewise(scene, part, I, J)

    return ends, absorbs, lit_segment
