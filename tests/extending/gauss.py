"""An integrator: two samples a segment, at the nodes of Gauss and Legendre, of order 4.

With extinction ``tau`` and colour ``c`` at the two nodes of a segment of length h, its optical depth is
``D = h (tau_1 + tau_2) / 2``. From node to node it is ``D / sqrt(3)`` where extinction is linear, so that the colour is
the opacity ``1 - exp(-D)`` times the mean of c_1 and c_2 weighted by ``tau_1`` and ``tau_2 exp(-D / sqrt(3))``.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from wvr.integrators import Integrator
from wvr.kernels.field.walk import MARGIN, make_walk
from wvr.kernels.light.points import make_point, make_shading
from wvr.kernels.precision import vec3_of, vec4_of
from wvr.kernels.segment import make_absorbed, over, widened
from wvr.validation import positive

APART = 3.0**-0.5  # of the nodes, in parts of a segment


@wp.struct
class Steps:
    step: wp.float64


@dataclass(frozen=True)
class Half:
    """The device half."""

    bounded = False
    tabled = False

    def Struct(self, halves):
        return Steps

    def march(self, halves):
        return make_gauss(halves)


@cache
def make_gauss(halves):
    """The march; what it counts are segments."""
    real = halves.real
    vec3, vec4 = vec3_of(real), vec4_of(real)
    Scene = halves.Scene
    value = halves.field.value(real)
    finite, lit = halves.field.finite, halves.light is not None
    eye_of, *_ = make_shading(halves)
    seen = make_point(halves)
    absorbed, _ = make_absorbed(real)
    _, enter, _, skip = make_walk(real)

    @wp.func
    def segment(scene: Scene, origin: vec3, direction: vec3, eye: vec3, a: real, h: real):
        t0 = a + real(wp.static(0.5 - 0.5 * APART)) * h
        t1 = a + real(wp.static(0.5 + 0.5 * APART)) * h
        s0 = value(scene.field, origin + t0 * direction)
        s1 = value(scene.field, origin + t1 * direction)
        if not wp.static(finite):
            if not (wp.isfinite(s0) and wp.isfinite(s1)):
                return vec4()
        q0 = seen(scene, s0, origin, direction, t0, eye)
        q1 = seen(scene, s1, origin, direction, t1, eye)
        depth = real(0.5) * h * (q0[3] + q1[3])
        w0 = q0[3]
        w1 = q1[3] * wp.exp(real(wp.static(-APART)) * depth)
        if w0 + w1 <= real(0.0):
            return vec4()
        A = absorbed(depth)
        q = A * (w0 * q0 + w1 * q1) / (w0 + w1)
        q[3] = A
        return q

    @wp.func
    def march(scene: Scene, start: wp.vec3d, along: wp.vec3d, begin: wp.float64, stop: wp.float64):
        place = start + begin * along
        origin = vec3(real(place[0]), real(place[1]), real(place[2]))
        direction = vec3(real(along[0]), real(along[1]), real(along[2]))
        length = real(stop - begin)
        step = real(scene.march.step)
        eye = vec3()
        if wp.static(lit):
            eye = eye_of(scene, direction)
        ray = wp.vec4d()
        count = int(0)
        i = int(0)
        end = int(wp.ceil(length / step))
        while i < end and ray[3] <= scene.opaque:
            a = real(i) * step
            clear = skip(scene.blocks.kinds, enter(scene.field.last, origin, direction, a), length).t
            ahead = wp.where(clear >= length, end, int((clear - real(wp.static(MARGIN))) / step))
            if ahead > i:
                i = ahead
                continue
            h = wp.clamp(length - a, real(0.0), step)  # the last one is what is left
            ray = over(ray, widened(segment(scene, origin, direction, eye, a, h)))
            count += 1
            i += 1
        return ray, count, wp.float64(0.0)

    return march


@dataclass(frozen=True)
class Gauss(Integrator):
    """Segments of a fixed ``step`` [smallest voxel spacing]."""

    step: float

    def __post_init__(self):
        positive(self.step, "step")

    @property
    def order(self):
        return 4

    @property
    def shortest(self):
        return self.step

    def half(self, scene):
        return Half()

    def numbers(self, scene, keep):
        return {"step": self.step}
