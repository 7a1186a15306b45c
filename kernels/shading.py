"""Blinn-Phong lighting of a point by the gradient of the field, in world space.

What light does to a point is an intensity: three numbers that multiply diffuse colour and three of specular light. It
is linear in no way, but it is what is interpolated along a segment (Lum, Wilson and Ma 2004, section 3). Surfaces have
two sides: the sign of the gradient says nothing. Where there is none, no direction of light is invented: with
f = g^2 / (g^2 + faint) the intensity fades to that of emission which faces every light, without specular light.
A face that a clip cuts is lit by the clip's normal, which a voxel behind it has become the field's.
"""

from functools import cache

import warp as wp

from .field import make_differences
from .precision import REALS, vec3_of, vec4_of
from .scene import make_scene
from .transfer import make_transfer


def intensity_of(real):
    """(diffuse red, green, blue, specular red, green, blue)."""
    return wp.types.vector(6, real)


# Least gradient of a clip's surface [range of the transfer function a voxel].
CUT = 0.01


@cache
def make_shine(variant):
    """``surface(scene, gradient)`` -> unit normal and how clear it is, 0 to 1; ``shine(scene, normal, clear, eye)`` ->
    intensity.
    """
    real = REALS[variant.precision]
    vec3 = vec3_of(real)
    Intensity = intensity_of(real)
    Scene = make_scene(variant)

    @wp.func
    def surface(scene: Scene, g: vec3):
        square = wp.dot(g, g)
        normal = vec3()
        if square > real(0.0):
            normal = g / wp.sqrt(square)
        return normal, square / (square + real(scene.shading.faint))

    @wp.func
    def shine(scene: Scene, normal: vec3, clear: real, eye: vec3):
        I = Intensity()
        for l in range(scene.lights.shape[0]):
            toward = eye
            here = scene.lights[wp.max(l, 0)]
            if not here.headlight:
                toward = vec3(real(here.toward[0]), real(here.toward[1]), real(here.toward[2]))
            diffuse = clear * wp.abs(wp.dot(normal, toward)) + (real(1.0) - clear)
            specular = real(0.0)
            half = wp.normalize(toward + eye)
            glance = wp.abs(wp.dot(normal, half))
            if glance > real(0.0):
                specular = clear * wp.pow(glance, real(scene.shading.shininess))
            for c in range(3):
                I[c] += real(here.color[c]) * diffuse
                I[c + 3] += real(here.color[c]) * specular
        for c in range(3):
            I[c] *= real(scene.shading.diffuse)
            I[c + 3] *= real(scene.shading.specular)
        return I

    return surface, shine


@cache
def make_shading(variant):
    """``eye(scene, direction)`` -> unit vector towards the viewer; ``gradient(scene, p)`` and
    ``light(scene, gradient, eye)`` -> intensity; ``lit(scene, q, k, s, I)`` -> colour and extinction q at scalar s of
    interval k, with intensity I; ``factors(scene, k, s)`` -> ambient, diffuse and specular coefficient.
    """
    real = REALS[variant.precision]
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Intensity = intensity_of(real)
    Scene = make_scene(variant)
    differences = make_differences(variant.dtype, real, variant.gradient)
    mat33 = wp.mat33d if real is wp.float64 else wp.mat33
    surface, shine = make_shine(variant)

    @wp.func
    def eye(scene: Scene, direction: vec3):
        ahead = scene.shading.ahead @ wp.vec3d(
            wp.float64(direction[0]), wp.float64(direction[1]), wp.float64(direction[2])
        )
        ahead = wp.normalize(ahead)
        return -vec3(real(ahead[0]), real(ahead[1]), real(ahead[2]))

    @wp.func
    def towards_cut(scene: Scene, p: vec3, g: vec3):
        """Where the ray enters through a clip the surface is the clip's; a voxel behind it, it is the field's."""
        normal = vec3(real(scene.cut[0]), real(scene.cut[1]), real(scene.cut[2]))
        behind = wp.length(p - vec3(real(scene.cut_point[0]), real(scene.cut_point[1]), real(scene.cut_point[2])))
        if behind < real(1.0) and wp.dot(normal, normal) > real(0.0):
            # Two gradients with one of two signs: that which agrees with the normal.
            side = wp.where(wp.dot(normal, g) < real(0.0), real(-1.0), real(1.0))
            strength = wp.max(wp.length(g), real(wp.static(CUT)))
            g = behind * g + (real(1.0) - behind) * side * strength * normal
        return g

    @wp.func
    def gradient(scene: Scene, p: vec3):
        """Scalars per world length; 0 where data are absent."""
        g = differences(scene.field, p)
        if not wp.static(variant.finite):
            if not (wp.isfinite(g[0]) and wp.isfinite(g[1]) and wp.isfinite(g[2])):
                return vec3()
        g = mat33(scene.shading.to_world) @ g
        if wp.static(variant.clipped):
            g = towards_cut(scene, p, g)
        return g

    @wp.func
    def light(scene: Scene, g: vec3, eye: vec3):
        normal, clear = surface(scene, g)
        return shine(scene, normal, clear, eye)

    @wp.func
    def factors(scene: Scene, k: int, s: real):
        if wp.static(variant.material):
            return scene.transfer.factor[k] + (s - scene.transfer.knot[k]) * scene.transfer.factor_slope[k]
        return vec3(real(1.0), real(1.0), real(1.0))

    @wp.func
    def lit(scene: Scene, q: vec4, k: int, s: real, I: Intensity):
        f = factors(scene, k, s)
        ambient = real(scene.shading.ambient) * f[0]
        return vec4(
            q[0] * (ambient + f[1] * I[0]) + f[2] * I[3],
            q[1] * (ambient + f[1] * I[1]) + f[2] * I[4],
            q[2] * (ambient + f[1] * I[2]) + f[2] * I[5],
            q[3],
        )

    return eye, gradient, light, lit, factors


@cache
def make_point(variant):
    """``seen(scene, s, origin, direction, t, eye)`` -> colour and extinction at scalar s, where the ray is at t: lit if
    the ``variant`` is.
    """
    real = REALS[variant.precision]
    vec3 = vec3_of(real)
    Scene = make_scene(variant)
    _, interval, classify = make_transfer(real)
    _, gradient, light, lit, _ = make_shading(variant)

    @wp.func
    def seen(scene: Scene, s: real, origin: vec3, direction: vec3, t: real, eye: vec3):
        q = classify(scene.transfer, s)
        if wp.static(variant.lit != ""):
            if q[3] > real(0.0):
                I = light(scene, gradient(scene, origin + t * direction), eye)
                q = lit(scene, q, interval(scene.transfer, s), s, I)
        return q

    return seen
