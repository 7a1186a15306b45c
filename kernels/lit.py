"""Lit segments of the uniform pre-integrated walk: a scalar that is linear between two samples, and light.

The modes are those of Lum, Wilson and Ma (2004), section 3, and what they are compared with. What a table says of a
segment is lit by the intensities at its ends with its front- and back-weighted integrals ("interpolated"), by their
mean ("average", Roettger et al. 2003), or by that of the mean normal ("center"). "isosurface" goes from control point
to control point and lights each stretch at its denser end, the crossing of a peak; "closest-isosurface" lights all of
them as the first. "supersampled" interpolates over several parts, each with its own gradients.
"""

from functools import cache

import warp as wp

from .precision import REALS, vec3_of, vec4_of
from .scene import make_scene
from .segment import make_shares, over, widened
from .shading import intensity_of, make_shading, make_shine
from .table import make_bilinear
from .transfer import make_transfer


@cache
def make_lit(variant):
    """``ends(scene, origin, direction, t, eye)`` -> what is kept of a segment's end for the next one;
    ``absorbs(scene, front, back)``: whether a segment has any extinction;
    ``lit_segment(scene, origin, direction, eye, t, h, whole, front, back, start, stop)`` -> vec4d of a segment from t,
    ``whole`` if the table is for its length, with scalars front and back and what ``ends`` gave there.
    """
    real = REALS[variant.precision]
    mode = variant.lit
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Intensity = intensity_of(real)
    Scene = make_scene(variant)
    _, interval, _ = make_transfer(real)
    _, place, between = make_bilinear(real)
    shares = make_shares(real)
    _, gradient, light, _, factors = make_shading(variant)
    surface, shine = make_shine(variant)

    @wp.func
    def ends(scene: Scene, origin: vec3, direction: vec3, t: real, eye: vec3):
        g = gradient(scene, origin + t * direction)
        if wp.static(mode == "center"):
            normal, clear = surface(scene, g)
            return Intensity(normal[0], normal[1], normal[2], clear, real(0.0), real(0.0))
        return light(scene, g, eye)

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
        A, U, _ = shares(scene.nodes, q[3] * length, (q[3] + dq[3]) * length)
        f = factors(scene, k, start)
        df = factors(scene, k, stop) - f
        result = vec4()
        for c in range(3):
            ambient = product(q[c], dq[c], f[0], df[0], real(1.0), real(0.0), A, U)
            diffuse = product(q[c], dq[c], f[1], df[1], I[c], J[c] - I[c], A, U)
            specular = product(real(1.0), real(0.0), f[2], df[2], I[c + 3], J[c + 3] - I[c + 3], A, U)
            result[c] = real(scene.shading.ambient) * ambient + diffuse + specular
        result[3] = A
        return widened(result)

    @wp.func
    def piecewise(
        scene: Scene,
        origin: vec3,
        direction: vec3,
        eye: vec3,
        t: real,
        h: real,
        front: real,
        back: real,
        I: Intensity,
        J: Intensity,
    ):
        """A segment from control point to control point, with intensities I and J at its ends where they count."""
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
                        peak = wp.where(rate > real(0.0), y, x)
                        first = light(scene, gradient(scene, origin + (t + peak * h) * direction), eye)
                        found = True
                    segment = over(segment, stretch(scene, k, s, stop, (y - x) * h, first, first))
                else:
                    segment = over(segment, stretch(scene, k, s, stop, (y - x) * h, I + x * (J - I), I + y * (J - I)))
            s = stop
            x = y
            k += step
        return segment

    @wp.func
    def absorbs(scene: Scene, front: real, back: real):
        low = interval(scene.transfer, wp.min(front, back))
        return scene.transfer.visible[low] <= interval(scene.transfer, wp.max(front, back))

    @wp.func
    def lit_segment(
        scene: Scene,
        origin: vec3,
        direction: vec3,
        eye: vec3,
        t: real,
        h: real,
        whole: bool,
        front: real,
        back: real,
        start: Intensity,
        stop: Intensity,
    ):
        I = start
        J = stop
        if wp.static(mode == "center"):
            m = real(0.5) * (start + stop)
            I = shine(scene, wp.normalize(vec3(m[0], m[1], m[2])), m[3], eye)
            J = I
        elif wp.static(mode == "average"):
            I = real(0.5) * (start + stop)
            J = I
        if wp.static(mode in ("center", "average", "interpolated")):
            if whole:
                i, j, x, y = place(scene.table, front, back)
                f = between(scene.table.front, i, j, x, y)
                b = between(scene.table.back, i, j, x, y)
                plain = f + b
                if wp.static(variant.material):
                    plain = between(scene.table.rgba, i, j, x, y)
                result = vec4()
                for c in range(3):
                    result[c] = (
                        real(scene.shading.ambient) * plain[c]
                        + f[c] * I[c]
                        + b[c] * J[c]
                        + f[3] * I[c + 3]
                        + b[3] * J[c + 3]
                    )
                result[3] = plain[3]
                return widened(result)
            return piecewise(scene, origin, direction, eye, t, h, front, back, I, J)
        elif wp.static(mode == "supersampled"):
            segment = wp.vec4d()
            part = real(1.0) / real(scene.shading.parts)
            s = front
            for n in range(scene.shading.parts):
                share = real(n + 1) * part
                end = front + share * (back - front)
                J = stop
                if n + 1 < scene.shading.parts:
                    J = ends(scene, origin, direction, t + share * h, eye)
                a = t + real(n) * part * h
                segment = over(segment, piecewise(scene, origin, direction, eye, a, part * h, s, end, I, J))
                s = end
                I = J
            return segment
        else:
            return piecewise(scene, origin, direction, eye, t, h, front, back, I, J)

    return ends, absorbs, lit_segment
