"""Blinn-Phong lighting of a point by the gradient of the field, in world space.

What light does to a point is an intensity: three numbers that multiply diffuse colour and three of specular light. It
is linear in no way, but it is what is interpolated along a segment (Lum, Wilson and Ma 2004, section 3). Surfaces have
two sides: the sign of the gradient says nothing. Where there is none, no direction of light is invented: with
f = g^2 / (g^2 + faint) the intensity fades to that of emission which faces every light, without specular light. This
fades, too, where a light is right behind what is seen.
A face that a clip cuts is lit by the clip's normal, which a voxel behind it has become the field's.

A light is of a kind, told by its number in the tuple of kinds that a kernel is made for.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import warp as wp

from ..precision import vec3_of, vec4_of
from ..transfer.function import make_transfer


@wp.struct
class Light:
    kind: int
    vector: wp.vec3d  # what the kind makes of it, in world space: a direction or a place
    color: wp.vec3d


@wp.struct
class Shading:
    ambient: wp.float64
    diffuse: wp.float64
    specular: wp.float64
    shininess: wp.float64
    faint: wp.float64  # square of the gradient where light has half faded [ranges of the transfer function per voxel]^2
    parts: int  # that a segment is lit in, by the mode "supersampled"
    to_world: wp.mat33d  # index gradients to world gradients
    ahead: wp.mat33d  # index directions to world directions
    home: wp.vec3d  # where index (0, 0, 0) is


@wp.struct
class Lamp:
    """A light in single precision, of a kind of ``KINDS``; colours are with the coefficients."""

    kind: int
    vector: wp.vec3
    color: wp.vec3
    glint: wp.vec3


@wp.struct
class Sheen:
    """``Shading`` in single precision."""

    ambient: wp.float32
    diffuse: wp.float32
    specular: wp.float32
    shininess: wp.float32
    steep: wp.float32  # what specular light of powers from 1 on changes by at most, a unit that a normal turns
    faint: wp.float32


@wp.struct
class Lights:
    shading: Shading
    lights: wp.array(dtype=Light)
    sheen: Sheen
    lamps: wp.array(dtype=Lamp)
    to_world: wp.mat33  # of ``shading``
    rules: wp.array(dtype=wp.vec2)  # of ``glow.rules``
    cut: wp.vec3d  # normal of the clip that the stretch of the ray begins at, in world space, or 0
    cut_point: wp.vec3d  # and where that is


@dataclass(frozen=True)
class Kind:
    """The device half of a kind of light: ``toward(vector, place, eye)`` -> the unit vector from a place to it, by what
    the light has and the unit vector to the viewer, all in world space and float64.
    """

    toward: Any


@wp.func
def toward_viewer(vector: wp.vec3d, place: wp.vec3d, eye: wp.vec3d):
    return eye


@wp.func
def toward_direction(vector: wp.vec3d, place: wp.vec3d, eye: wp.vec3d):
    return vector


HEADLIGHT = Kind(toward_viewer)
DIRECTIONAL = Kind(toward_direction)
# Kinds that every kernel with light knows: fewer kernels are compiled than if each had its own choice.
KINDS = (HEADLIGHT, DIRECTIONAL)


@dataclass(frozen=True)
class Lit:
    """The device half of lighting."""

    kinds: tuple = KINDS  # of lights
    mode: str = "point"  # how a segment is lit, a mode of ``segments``, or "point" where every sample is
    gradient: str = "central"  # that light sees: "central" differences or those of the "cell"
    material: bool = False  # ambient, diffuse and specular coefficients vary with the scalar


def intensity_of(real):
    """(diffuse red, green, blue, specular red, green, blue)."""
    return wp.types.vector(6, real)


@cache
def make_toward(kinds, number=0):
    """``toward(kind, vector, place, eye)`` of lights of any of the ``kinds`` from a ``number`` on."""
    last = number + 1 == len(kinds)
    here = kinds[number].toward
    other = None if last else make_toward(kinds, number + 1)

    @wp.func
    def toward(kind: int, vector: wp.vec3d, place: wp.vec3d, eye: wp.vec3d):
        if wp.static(not last):
            if kind != wp.static(number):
                return other(kind, vector, place, eye)
        return here(vector, place, eye)

    return toward


# Square of the sum of the unit vectors to a light and to the viewer up to which specular light fades: where they are
# opposite there is no way half between them, and rounding would choose one.
OPPOSITE = 1e-4
# Least gradient of a clip's surface [range of the transfer function a voxel].
CUT = 0.01


@cache
def make_shine(halves):
    """``surface(scene, gradient)`` -> unit normal and how clear it is, 0 to 1; ``shine(scene, p, normal, clear, eye)``
    -> intensity at index coordinates p.
    """
    real = halves.real
    vec3 = vec3_of(real)
    Intensity = intensity_of(real)
    Scene = halves.Scene
    toward_of = make_toward((halves.light or Lit()).kinds)

    @wp.func
    def surface(scene: Scene, g: vec3):
        square = wp.dot(g, g)
        normal = vec3()
        if square > real(0.0):
            normal = g / wp.sqrt(square)
        return normal, square / (square + real(scene.light.shading.faint))

    @wp.func
    def shine(scene: Scene, p: vec3, normal: vec3, clear: real, eye: vec3):
        I = Intensity()
        shading = scene.light.shading
        place = shading.home + shading.ahead @ wp.vec3d(p)
        viewer = wp.vec3d(eye)
        for l in range(scene.light.lights.shape[0]):
            here = scene.light.lights[wp.max(l, 0)]
            toward = vec3(toward_of(here.kind, here.vector, place, viewer))
            diffuse = clear * wp.abs(wp.dot(normal, toward)) + (real(1.0) - clear)
            specular = real(0.0)
            half = toward + eye
            # No more than 1 by rounding, which powers make any number of.
            glance = wp.min(wp.abs(wp.dot(normal, wp.normalize(half))), real(1.0))
            if glance > real(0.0):
                between = wp.min(wp.dot(half, half) / real(wp.static(OPPOSITE)), real(1.0))
                specular = clear * between * wp.pow(glance, real(shading.shininess))
            for c in range(3):
                I[c] += real(here.color[c]) * diffuse
                I[c + 3] += real(here.color[c]) * specular
        for c in range(3):
            I[c] *= real(shading.diffuse)
            I[c + 3] *= real(shading.specular)
        return I

    return surface, shine


class Shader(NamedTuple):
    """Device functions that light a point.

    ``eye(scene, direction)`` -> unit vector towards the viewer; ``gradient(scene, p)`` -> that of the field in the
    world; ``light(scene, p, gradient, eye)`` -> intensity; ``lit(scene, q, k, s, I)`` -> colour and extinction q at
    scalar s of interval k, with intensity I; ``factors(scene, k, s)`` -> ambient, diffuse and specular coefficient;
    ``bare(scene, p)`` -> the gradient as if nothing were cut, and ``towards_cut(scene, p, bare)`` -> as it is.
    """

    eye: Any
    gradient: Any
    light: Any
    lit: Any
    factors: Any
    bare: Any
    towards_cut: Any


@cache
def make_shading(halves):
    """The ``Shader`` of a kernel."""
    real = halves.real
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Intensity = intensity_of(real)
    Scene = halves.Scene
    differences = halves.field.differences(real, (halves.light or Lit()).gradient)
    mat33 = wp.mat33d if real is wp.float64 else wp.mat33
    surface, shine = make_shine(halves)
    material = halves.light is not None and halves.light.material

    @wp.func
    def eye(scene: Scene, direction: vec3):
        return -vec3(wp.normalize(scene.light.shading.ahead @ wp.vec3d(direction)))

    @wp.func
    def towards_cut(scene: Scene, p: vec3, g: vec3):
        """Where the ray enters through a clip the surface is the clip's; a voxel behind it, it is the field's."""
        normal = vec3(scene.light.cut)
        behind = wp.length(p - vec3(scene.light.cut_point))
        if behind < real(1.0) and wp.dot(normal, normal) > real(0.0):
            # Two gradients with one of two signs: that which agrees with the normal.
            side = wp.where(wp.dot(normal, g) < real(0.0), real(-1.0), real(1.0))
            strength = wp.max(wp.length(g), real(wp.static(CUT)))
            g = behind * g + (real(1.0) - behind) * side * strength * normal
        return g

    @wp.func
    def bare(scene: Scene, p: vec3):
        """Ranges of the transfer function per smallest voxel spacing; 0 where data are absent."""
        g = differences(scene.field, p)
        if not wp.static(halves.field.finite):
            if not (wp.isfinite(g[0]) and wp.isfinite(g[1]) and wp.isfinite(g[2])):
                return vec3()
        return mat33(scene.light.shading.to_world) @ g

    @wp.func
    def gradient(scene: Scene, p: vec3):
        g = bare(scene, p)
        if wp.static(halves.cuts.clipped):
            g = towards_cut(scene, p, g)
        return g

    @wp.func
    def light(scene: Scene, p: vec3, g: vec3, eye: vec3):
        normal, clear = surface(scene, g)
        return shine(scene, p, normal, clear, eye)

    @wp.func
    def factors(scene: Scene, k: int, s: real):
        if wp.static(material):
            return scene.transfer.factor[k] + (s - scene.transfer.knot[k]) * scene.transfer.factor_slope[k]
        return vec3(real(1.0), real(1.0), real(1.0))

    @wp.func
    def lit(scene: Scene, q: vec4, k: int, s: real, I: Intensity):
        f = factors(scene, k, s)
        ambient = real(scene.light.shading.ambient) * f[0]
        return vec4(
            q[0] * (ambient + f[1] * I[0]) + f[2] * I[3],
            q[1] * (ambient + f[1] * I[1]) + f[2] * I[4],
            q[2] * (ambient + f[1] * I[2]) + f[2] * I[5],
            q[3],
        )

    return Shader(eye, gradient, light, lit, factors, bare, towards_cut)


@cache
def make_point(halves):
    """``seen(scene, s, origin, direction, t, eye)`` -> colour and extinction at scalar s, where the ray is at t: lit if
    there is light.
    """
    real = halves.real
    vec3 = vec3_of(real)
    Scene = halves.Scene
    _, interval, classify = make_transfer(real)
    _, gradient, light, lit, *_ = make_shading(halves)

    @wp.func
    def seen(scene: Scene, s: real, origin: vec3, direction: vec3, t: real, eye: vec3):
        q = classify(scene.transfer, s)
        if wp.static(halves.light is not None):
            if q[3] > real(0.0):
                p = origin + t * direction
                I = light(scene, p, gradient(scene, p), eye)
                q = lit(scene, q, interval(scene.transfer, s), s, I)
        return q

    return seen
