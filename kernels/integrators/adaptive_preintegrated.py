"""Adaptive pre-integration (Roettger et al. 2003, section 4): segments as long as the scalar along the ray is straight
for the transfer function.

Along a ray the scalar of a cell is a cubic, of which the second derivative is known, where the paper looks a distance
up in a volume of them. Cells with something to see are gathered. Each is a segment, or as many equal parts as make its
error less than the tolerance: with ``v`` in [-1, 1] along it, and ``mean + m1 v + m2 (v^2 - 1/3) + m3 v^3`` the scalar,
the line of the same integral and least squares ``mean + (m1 + 3/5 m3) v`` deviates from it by an integral of at most
``STRAIGHT |m2| + TWISTED |m3|`` half lengths. So much times how much the transfer function changes with a scalar, at
most, is what optical depth and colour are off by; it falls with the square of the number of parts. It counts by the
transparency in front of it.

Segments have their own length, and their table has layers of lengths: mean extinction, which makes opacity exact, and
the mean emission that makes colour exact for the layer's length. Most are about as long as half the longest; where that
makes a difference emission is taken between the two layers next to the length. Segments are lit by the mean of the
light at their ends, with the coefficients of their middle.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.cubics import make_placed
from ..field.strides import STATE, make_strides
from ..field.walk import PACKET, make_gather, make_walk
from ..light.points import intensity_of, make_shading
from ..precision import vec3_of, vec4_of
from ..segment import make_absorbed, over, widened
from ..transfer.function import make_transfer
from ..transfer.lookup import make_bilinear
from .steps import Step

# Cells that are gathered before any is integrated: where a ray ends soon, fewer are in vain.
CELLS = 32
ROOM = CELLS + 8  # as of ``field.strides``
# Integrals of |v^2 - 1/3| and of |v^3 - 3/5 v| over [-1, 1], rounded up.
STRAIGHT = 0.5133
TWISTED = 0.26
# Optical depth that a segment may be apart from the table's.
ALIKE = 0.125
# Light is not asked for again so near to where it was [smallest voxel spacing].
NEAR = 1.0e-4
# Far more parts than are ever taken.
PARTS = 1.0e6


@wp.struct
class Adaptive:
    shortest: wp.float64  # [smallest voxel spacing]
    tolerance: wp.float64  # of a cell
    changes: wp.array2d(dtype=wp.float32)  # how much an error of the scalar changes emission: the host's ``Changes``
    low: wp.float64  # scalar where their bins begin
    scale: wp.float64  # bins per scalar
    longest: wp.float64  # length that the table's first layer is for; each has half that of the one before
    octants: wp.array4d(dtype=wp.uint8)  # of ``field.strides``


@dataclass(frozen=True)
class Half:
    """The device half of adaptive pre-integration."""

    packed: bool = False  # cubics of many cells at a time, in single precision
    bounded = False
    tabled = True

    def Struct(self, halves):
        return Adaptive

    def march(self, halves):
        return make_packed(halves) if self.packed and halves.vectors else make_walked(halves)


@cache
def make_composed(halves):
    """The struct of a ``Lamp``, and ``composed(scene, ray, count, n, times, cubic, lamp)``: the ray behind n cells, the
    number of segments up to there, and what light does there. Cells are as of ``field.cubics``.
    """
    real = halves.real
    finite = halves.field.finite
    traced = halves.traced
    lighted = halves.light is not None
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    Scene = halves.Scene
    Table, place, between = make_bilinear(real)
    absorbed, _ = make_absorbed(real)
    _, interval, _ = make_transfer(real)
    Intensity = intensity_of(real)
    _, gradient, light, lit, *_ = make_shading(halves)

    @wp.struct
    class Lamp:
        """What a ray with light has with it."""

        origin: wp.vec3d
        direction: wp.vec3d
        eye: vec3
        shone: wp.float64  # where light was asked for last,
        light: Intensity  # and what it does there

    @wp.func
    def change(changes: wp.array2d(dtype=wp.float32), low: real, high: real):
        """Largest of the bins from one to another: two rows of a power of two cover them."""
        last = real(changes.shape[1] - 1)
        i = int(wp.clamp(low, real(0.0), last))
        j = int(wp.clamp(high, real(0.0), last))
        level = int(0)
        while (2 << level) <= j - i + 1:
            level += 1
        return real(wp.max(changes[level, wp.max(i, 0)], changes[level, wp.max(j + 1 - (1 << level), 0)]))

    @wp.func
    def looked_up(table: Table, longest: real, front: real, back: real, h: real):
        """Mean emission and extinction of a segment of length h."""
        n = table.rgba.shape[1]
        layers = table.rgba.shape[0] // n
        i, j, x, y = place(table, front, back)
        # That of half the longest is about the length of most; extinction is the same in all.
        q = between(table.rgba, i + wp.min(layers - 1, 1) * n, j, x, y)
        if layers > 1 and q[3] * wp.abs(h - real(0.5) * longest) > real(wp.static(ALIKE)):
            layer = wp.clamp(-wp.log2(h / longest), real(0.0), real(layers - 1))
            k = wp.max(wp.min(int(layer), layers - 2), 0)
            q = between(table.rgba, i + k * n, j, x, y)
            q += (layer - real(k)) * (between(table.rgba, i + (k + 1) * n, j, x, y) - q)
        return q

    @wp.func
    def shine(scene: Scene, lamp: Lamp, t: wp.float64):
        p = vec3(lamp.origin + t * lamp.direction)
        return light(scene, p, gradient(scene, p), lamp.eye)

    @wp.func
    def composed(
        scene: Scene,
        ray: wp.vec4d,
        count: int,
        cells: int,
        times: wp.array2d(dtype=wp.float64),
        cubic: wp.array2d(dtype=real),
        lamp: Lamp,
    ):
        tolerance = real(scene.march.tolerance)
        shortest = real(scene.march.shortest)
        longest = real(scene.march.longest)
        low = real(scene.march.low)
        scale = real(scene.march.scale)
        most = real(scene.march.changes[scene.march.changes.shape[0] - 1, 0])
        for l in range(cells):
            mean = cubic[0, l] + cubic[1, l]
            c1 = cubic[2, l]
            c2 = cubic[3, l]
            c3 = cubic[4, l]
            h = cubic[5, l]
            present = ray[3] <= scene.opaque and h > real(0.0)
            if not wp.static(finite):
                present = present and wp.isfinite(mean + c1 + c2 + c3)
            # What the cell is off by as one segment, and in how many parts it is cut.
            parts = int(wp.where(present, 1, 0))
            error = real(0.0)
            bent = real(wp.static(STRAIGHT)) * wp.abs(c2) + real(wp.static(TWISTED)) * wp.abs(c3)
            if present and bent > real(0.0):
                bent *= h * (real(1.0) - real(ray[3]))
                error = bent * most
                if not error <= tolerance:
                    near = wp.abs(c1) + real(wp.static(2.0 / 3.0)) * wp.abs(c2) + wp.abs(c3)
                    error = bent * change(scene.march.changes, (mean - near - low) * scale, (mean + near - low) * scale)
                    if not error <= tolerance:
                        needed = wp.ceil(wp.sqrt(error / tolerance))
                        room = wp.min(real(2.0) * h / shortest, real(wp.static(PARTS)))
                        parts = wp.max(int(wp.min(needed, room)), 1)
            w = real(1.0)
            if parts > 1:
                w /= real(parts)
            step = real(2.0) * h * w
            n = int(0)
            while n < parts and ray[3] <= scene.opaque:
                s = mean
                slope = c1 + real(0.6) * c3
                if parts > 1:
                    # The cubic about the middle of a part, over [-1, 1] of its own, and its line.
                    v = real(2 * n + 1) * w - real(1.0)
                    s += v * (c1 + v * (c2 + v * c3))
                    s += real(wp.static(1.0 / 3.0)) * (w * w * (c2 + real(3.0) * v * c3) - c2)
                    slope = w * (c1 + v * (real(2.0) * c2 + v * real(3.0) * c3) + real(0.6) * w * w * c3)
                q = looked_up(scene.table, longest, s - slope, s + slope, step)
                if q[3] > real(0.0):
                    A = absorbed(q[3] * step)
                    if wp.static(lighted):
                        t = times[0, l] + wp.float64(real(n) * step)
                        start = lamp.light
                        if wp.abs(lamp.shone - t) > wp.float64(wp.static(NEAR)):
                            start = shine(scene, lamp, t)
                        lamp.shone = t + wp.float64(step)
                        lamp.light = shine(scene, lamp, lamp.shone)
                        color = vec4(q[0] / q[3], q[1] / q[3], q[2] / q[3], real(1.0))
                        q = q[3] * lit(scene, color, interval(scene.transfer, s), s, real(0.5) * (start + lamp.light))
                    q *= A / q[3]
                    q[3] = A
                    ray = over(ray, widened(q))
                if wp.static(traced):
                    whole = wp.float64(error * w * w)
                    t = times[0, l] + wp.float64(real(n) * step)
                    record(scene, count, t, wp.vec3d(wp.float64(step), whole, whole * wp.float64(w)), ray)
                count += 1
                n += 1
        return ray, count, lamp

    @wp.func
    def record(scene: Scene, taken: int, t: wp.float64, numbers: wp.vec3d, ray: wp.vec4d):
        """Write down a step of a length, the bound on the error of all in its cell, and on its own."""
        if scene.trace.taken + taken < scene.trace.steps.shape[0]:
            step = Step()
            step.t = t
            step.length = numbers[0]
            step.tolerance = scene.march.tolerance
            step.depth_error = numbers[2]
            step.error = numbers[2]
            step.forced = numbers[1] > scene.march.tolerance * wp.float64(1.00001)
            step.rgba = over(scene.trace.front, ray)
            scene.trace.steps[scene.trace.taken + taken] = step

    return Lamp, composed


@cache
def make_walked(halves):
    """The march, as of ``scene``; what it counts are segments. One that is traced writes down its steps."""
    real = halves.real
    vec3 = vec3_of(real)
    Scene = halves.Scene
    centered = halves.field.centered()
    eye_of = make_shading(halves).eye
    _, enter, _, _ = make_walk(wp.float64)
    _, gather = make_gather()
    Lamp, composed = make_composed(halves)

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64):
        ray = wp.vec4d()
        count = int(0)
        lamp = Lamp()
        if wp.static(halves.light is not None):
            lamp.origin = origin
            lamp.direction = direction
            lamp.eye = eye_of(scene, vec3(direction))
            lamp.shone = -wp.float64(1.0)
        times = wp.zeros(shape=(1, PACKET), dtype=wp.float64)
        cubic = wp.zeros(shape=(7, PACKET), dtype=real)
        w = enter(scene.field.last, origin, direction, start)
        stop = wp.min(stop, w.out)
        while w.t < stop and ray[3] <= scene.opaque:
            w, cells = gather(scene.blocks, w, stop)
            for l in range(PACKET):
                if l < cells.count:
                    i = cells.cell[0, l]
                    j = cells.cell[1, l]
                    k = cells.cell[2, l]
                    h = wp.float64(0.5) * cells.length[l]
                    p = origin + (cells.start[l] + h) * direction
                    p -= wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k))
                    m = centered(scene.field, i, j, k, p, direction, h)
                    times[0, l] = cells.start[l]
                    cubic[1, l] = real(m[0] + m[2] * wp.float64(wp.static(1.0 / 3.0)))
                    cubic[2, l] = real(m[1])
                    cubic[3, l] = real(m[2])
                    cubic[4, l] = real(m[3])
                    cubic[5, l] = real(h)
            ray, count, lamp = composed(scene, ray, count, cells.count, times, cubic, lamp)
        return ray, count, wp.float64(0.0)

    return march


@cache
def make_packed(halves):
    """The same in single precision, where cubics are computed in vectors."""
    Scene = halves.Scene
    begin, stride, more = make_strides(CELLS)
    placed = make_placed(True)
    cubics = halves.field.cubics(True, CELLS)
    eye_of = make_shading(halves).eye
    Lamp, composed = make_composed(halves)

    @wp.func
    def march(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64):
        ray = wp.vec4d()
        count = int(0)
        lamp = Lamp()
        if wp.static(halves.light is not None):
            lamp.origin = origin
            lamp.direction = direction
            lamp.eye = eye_of(scene, wp.vec3(direction))
            lamp.shone = -wp.float64(1.0)
        state = wp.zeros(shape=(1, STATE), dtype=wp.float64)
        cells = wp.zeros(shape=(ROOM,), dtype=wp.uint64)
        times = wp.zeros(shape=(2, ROOM), dtype=wp.float64)
        where = wp.zeros(shape=(7, ROOM), dtype=wp.float32)
        cubic = wp.zeros(shape=(7, CELLS), dtype=wp.float32)
        going = begin(scene.field.last, origin, direction, start, stop, state, 0)
        while going and ray[3] <= scene.opaque:
            n = stride(scene.blocks, scene.march.octants, state, 0, cells, times, 0)
            going = more(state, 0)
            if n > 0:
                placed(origin, direction, cells, times, 0, n, where)
                cubics(scene.field, cells, where, 0, n, cubic)
                ray, count, lamp = composed(scene, ray, count, n, times, cubic, lamp)
        return ray, count, wp.float64(0.0)

    return march
