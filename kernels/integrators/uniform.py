"""The uniform walk: segments of one length from the start, with an exact last partial step.

The rules say what a segment [a, a + h] contributes: constant colour and extinction sampled at its start ("left") or
middle ("midpoint"), the mean extinction and emission of its ends ("trapezoid"), Simpson's rule for the depth and for
the colour that is seen ("simpson"), or the table entry of the scalars at its ends ("preintegrated").
Segments that lie in blocks without any extinction are leapt over; the others stay where they are.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..bricks.brick import middles_before
from ..cuts.partial import make_partial
from ..cuts.volumes import make_shown
from ..field.walk import make_unseen, make_within
from ..light.points import intensity_of, make_point, make_shading
from ..light.segments import make_lit, make_stretch
from ..precision import vec2_of, vec3_of, vec4_of
from ..segment import make_opacities, make_sum
from ..transfer.linear import make_linear_segment
from ..transfer.lookup import make_table

# A ray advances this many segments at a time, each phase for all of them: independent work that a CPU core overlaps.
PACKET = 4


@dataclass(frozen=True)
class Half:
    """The device half of integrators with steps of one length."""

    rule: str
    bounded = False
    anchored = True

    @property
    def tabled(self):
        return self.rule == "preintegrated"

    def Struct(self, halves):
        return make_struct(halves.real)

    def march(self, halves):
        return make_uniform(halves)


@cache
def make_struct(real):
    """The struct of what the march reads."""

    @wp.struct
    class Uniform:
        step: wp.float64  # [smallest voxel spacing]
        nodes: wp.array(dtype=vec2_of(real))  # of ``linear.gauss_nodes``, for a table's last partial step

    return Uniform


@cache
def make_uniform(halves):
    """The march, as of ``scene``; what it counts are segments."""
    real = halves.real
    rule = halves.march.rule
    finite = halves.field.finite
    cuts = halves.cuts
    ends = rule in ("trapezoid", "simpson", "preintegrated")  # the rule needs the scalar at both ends of a segment
    vec2 = vec2_of(real)
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    packet = wp.types.vector(PACKET, real)
    Scene = halves.Scene
    value = halves.field.value(real)
    _, lookup = make_table(real)
    lighted = halves.light is not None
    Intensity = intensity_of(real)
    eye_of = make_shading(halves).eye
    seen = make_point(halves)
    light_ends, absorbs, lit_segment = make_lit(halves)
    opacities = make_opacities(real, PACKET)
    Sum, add, opacity, total, number = make_sum(real, halves.vectors)
    linear_segment = make_linear_segment(real)
    unseen = make_unseen(real)
    within = make_within(real)
    shown = make_shown(cuts.kinds, cuts.volumes)
    partial = make_partial(halves, linear_segment)
    Stretch = make_stretch(real)

    @wp.func
    def point(origin: vec3, direction: vec3, t: real):
        """A point of the ray."""
        return wp.vec3d(origin + t * direction)

    @wp.func
    def drawn(scene: Scene, origin: vec3, direction: vec3, t: real):
        """Whether naive clips leave the sample at t."""
        if wp.static(cuts.naive):
            return shown(scene.cuts.clipping, point(origin, direction, t))
        return True

    @wp.func
    def present(s: real):
        """Whether there is data: a NaN or infinite sample makes its cells absent."""
        if wp.static(finite):
            return True
        return wp.isfinite(s)

    @wp.func
    def sampled(scene: Scene, origin: vec3, direction: vec3, eye: vec3, a: real, h: real, scalars: vec3):
        """Colour and extinction that a rule gives the segment [a, a + h], of the scalars at its front and middle and
        the one that is sampled last.
        """
        half = real(0.5) * h
        front = scalars[0]
        middle = scalars[1]
        s = scalars[2]
        if wp.static(rule == "simpson"):
            qf = seen(scene, front, origin, direction, a, eye)
            qm = seen(scene, middle, origin, direction, a + half, eye)
            qb = seen(scene, s, origin, direction, a + h, eye)
            tau = (qf[3] + real(4.0) * qm[3] + qb[3]) * real(wp.static(1.0 / 6.0))
            # Half the depth will do for that to the middle: what it is off by, O(h^2), multiplies how far the middle's
            # colour is from the mean, also O(h^2).
            through = wp.exp(real(-0.5) * tau * h)
            wm = real(4.0) * qm[3] * through
            wb = qb[3] * through * through
            total = qf[3] + wm + wb
            q = vec4()
            if total > real(0.0):
                q = (qf[3] * qf + wm * qm + wb * qb) / total
                q[3] = tau
            return q
        elif wp.static(rule == "trapezoid"):
            qf = seen(scene, front, origin, direction, a, eye)
            qb = seen(scene, s, origin, direction, a + h, eye)
            tau = qf[3] + qb[3]
            q = vec4()
            if tau > real(0.0):
                q = (qf[3] * qf + qb[3] * qb) / tau
                q[3] = real(0.5) * tau
            return q
        elif wp.static(rule == "left"):
            return seen(scene, s, origin, direction, a, eye)
        else:
            return seen(scene, s, origin, direction, a + half, eye)

    @wp.func
    def lit_cut(
        scene: Scene,
        origin: vec3,
        direction: vec3,
        ends_at: vec2,
        front: real,
        back: real,
        first: Intensity,
        second: Intensity,
    ):
        """A segment between two places on the ray that clips cut, with the mean of the light at both its ends there."""
        a = ends_at[0]
        b = ends_at[1]
        segment, middle = partial(scene, point(origin, direction, a), point(origin, direction, b), front, back, b - a)
        I = first + middle * (second - first)
        for c in range(3):
            segment[c] = (wp.float64(scene.light.shading.ambient) + wp.float64(I[c])) * segment[c] + wp.float64(
                I[c + 3]
            ) * segment[3]
        return segment

    @wp.func
    def march(scene: Scene, start: wp.vec3d, along: wp.vec3d, begin: wp.float64, stop: wp.float64):
        # Along the stretch in the march's own precision, from where it begins.
        origin = vec3(start + begin * along)
        direction = vec3(along)
        length = real(stop - begin)
        step = real(scene.march.step)
        ray = Sum()
        opaque = number(scene.opaque)
        count = int(wp.ceil(length / step))
        i = int(0)
        end = count
        if wp.static(halves.brick):
            wide = wp.float64(scene.march.step)
            i = middles_before(scene.brick.enter - begin, wide, count)
            end = middles_before(scene.brick.leave - begin, wide, count)
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        front = real(0.0)
        if wp.static(ends):
            front = value(scene.field, within(scene.field.last, origin + real(i) * step * direction))
        evaluated = int(0)
        # What light does where segment ``shone`` starts.
        first = Intensity()
        shone = int(-1)
        # Only where the last packet was transparent is it worth asking whether the block is.
        idle = bool(True)
        while i < end and opacity(ray) <= opaque:
            if idle:
                ahead = unseen(scene.blocks.kinds, scene.field.last, origin, direction, length, step, i)
                if ahead > i:
                    i = ahead
                    if wp.static(ends):
                        front = value(scene.field, origin + wp.min(real(i) * step, length) * direction)
                    continue
            before = opacity(ray)
            s = packet()
            middle = packet()
            for l in range(wp.static(PACKET)):
                a = wp.min(real(i + l) * step, length)
                b = wp.min(real(i + l + 1) * step, length)
                if wp.static(rule == "left"):
                    b = a
                elif wp.static(rule == "midpoint"):
                    b = real(0.5) * (a + b)
                place = origin + b * direction
                if b >= length:
                    place = within(scene.field.last, place)
                s[l] = value(scene.field, place)
                if wp.static(rule == "simpson"):
                    middle[l] = value(scene.field, origin + real(0.5) * (a + b) * direction)
            if wp.static(rule == "preintegrated"):
                for l in range(wp.static(PACKET)):
                    # The last step is what is left of the ray; lanes beyond have no length.
                    h = wp.clamp(length - real(i + l) * step, real(0.0), step)
                    if wp.static(halves.brick):
                        h = wp.where(i + l < end, h, real(0.0))
                    a = wp.min(real(i + l) * step, length)
                    if h > real(0.0) and present(front) and present(s[l]) and drawn(scene, origin, direction, a):
                        if wp.static(lighted):
                            if absorbs(scene, front, s[l]):
                                if shone != i + l:
                                    first = light_ends(scene, origin, direction, a, eye)
                                second = light_ends(scene, origin, direction, a + h, eye)
                                if wp.static(cuts.parts is not None):
                                    ends_at = vec2(a, a + h)
                                    ray = add(
                                        ray, lit_cut(scene, origin, direction, ends_at, front, s[l], first, second)
                                    )
                                else:
                                    part = Stretch()
                                    part.origin = origin
                                    part.direction = direction
                                    part.eye = eye
                                    part.t = a
                                    part.h = h
                                    part.front = front
                                    part.back = s[l]
                                    ray = add(ray, lit_segment(scene, part, i + l < count - 1, first, second))
                                first = second
                                shone = i + l + 1
                        elif wp.static(cuts.parts is not None):
                            seen_part, _middle = partial(
                                scene, point(origin, direction, a), point(origin, direction, a + h), front, s[l], h
                            )
                            ray = add(ray, seen_part)
                        elif i + l < count - 1:
                            ray = add(ray, lookup(scene.table, front, s[l]))
                        else:
                            ray = add(ray, linear_segment(scene.transfer, scene.march.nodes, front, s[l], h))
                    front = s[l]
            else:
                red = packet()
                green = packet()
                blue = packet()
                depth = packet()
                for l in range(wp.static(PACKET)):
                    h = wp.clamp(length - real(i + l) * step, real(0.0), step)
                    if wp.static(halves.brick):
                        h = wp.where(i + l < end, h, real(0.0))
                    a = wp.min(real(i + l) * step, length)
                    at = a
                    if wp.static(rule == "midpoint"):
                        at += real(0.5) * h
                    if present(front) and present(middle[l]) and present(s[l]) and drawn(scene, origin, direction, at):
                        q = sampled(scene, origin, direction, eye, a, h, vec3(front, middle[l], s[l]))
                        red[l] = q[0]
                        green[l] = q[1]
                        blue[l] = q[2]
                        depth[l] = wp.max(q[3], real(0.0)) * h
                    if wp.static(ends):
                        front = s[l]
                if wp.max(depth) > real(0.0):
                    A = opacities(depth)
                    for l in range(wp.static(PACKET)):
                        ray = add(ray, vec4(A[l] * red[l], A[l] * green[l], A[l] * blue[l], A[l]))
            idle = opacity(ray) == before
            evaluated += wp.min(end - i, wp.static(PACKET))
            i += wp.static(PACKET)
        return total(ray), evaluated, wp.float64(0.0)

    return march
