"""The eye that passes the slices of light, and what it makes of them.

Light goes ahead by a number of slices, then the eye's rays follow through the slabs between them.
"""

from functools import cache

import warp as wp

from ..bricks.brick import Brick
from ..field.walk import MARGIN, make_walk
from ..precision import vec3_of, vec4_of
from ..ray import FAR, View, ending, entry, inside, inverted, pixel
from ..rays import reaches
from ..segment import make_absorbed, over
from .between import make_between
from .eyes import FOUND, GIVEN, LANES, Task, make_eyes
from .lanes import PARTS, lanes_of
from .points import KINDS, make_shading
from .tissue import make_depth, make_shone_on, make_tissue
from .travel import make_way

# What is seen of a part, as optical depth, up to which it has the light of slices; from twice that on, traced light.
FAINT = 0.05
# Of light.
LEAST = 1.0e-7


@wp.struct
class Eye:
    """What the eye's rays have come to, [y, x] of pixels."""

    shown: wp.array2d(dtype=wp.uint8)  # pixels that are asked for
    rgba: wp.array2d(dtype=wp.vec4d)  # composite without shadows
    lit: wp.array2d(dtype=wp.vec3d)  # its colour with them
    samples: wp.array2d(dtype=int)
    octants: wp.array4d(dtype=wp.uint8)  # as of ``strides``, for several rays at a time


@wp.struct
class Ray:
    """Of a pixel, through slabs of light, from where there is something to see."""

    goes: bool  # through any of them
    onward: bool  # passes slabs in their order
    origin: wp.vec3d
    direction: wp.vec3d
    length: wp.float64
    begin: wp.float64  # where its first slab begins
    apart: wp.float64  # lengths of slabs
    foot: wp.vec3d  # where it is in light's cells, and how that grows by length
    drift: wp.vec3d


@wp.func
def reach(view: View, x: int, y: int):
    """The line of a pixel's ray; from where to where there may be something to see along it, and where it ends."""
    point, way, whole, entered = entry(view, x, y)
    ends, _loose = ending(view, x, y)
    ends -= entered
    enters, leaves = inside(view.seen_low, view.seen_high, point, inverted(way), wp.float64(0.0), whole)
    return point, way, wp.vec3d(enters, wp.min(leaves, ends), ends)


@cache
def make_through(halves):
    """``through(scene, point, way, span, first, count, seen)``: a ray through so many slabs from the ``first``, of an
    opacity that is ``seen`` of it before; its ``span`` is as of ``reach``.
    """
    Scene = halves.Scene

    @wp.func
    def through(
        scene: Scene,
        point: wp.vec3d,
        way: wp.vec3d,
        span: wp.vec3d,
        first: int,
        count: int,
        seen: wp.float64,
    ):
        ray = Ray()
        if not span[1] > span[0]:
            return ray
        sweep = scene.march
        rate = wp.dot(sweep.ahead, way)
        ray.onward = rate > wp.float64(0.0)
        if ray.onward and seen > scene.opaque:
            return ray
        # Slabs behind one another for the eye, each in parts: k-th part of the ray is from t0 + k h on.
        edge = sweep.start + sweep.thickness * wp.float64(wp.where(ray.onward, first, first + count))
        begin = (edge - wp.dot(sweep.ahead, point) - sweep.offset) / rate
        ray.apart = sweep.thickness / wp.abs(rate)
        # Rays begin and end with parts that there is something to see in: what a part is does not depend on that.
        part = ray.apart / wp.float64(sweep.parts)
        _, whole = inside(scene.view.low, scene.view.high, point, inverted(way), wp.float64(0.0), span[2])
        enters = wp.max(begin + wp.floor((span[0] - begin) / part) * part, wp.float64(0.0))
        leaves = wp.min(begin + wp.ceil((span[1] - begin) / part) * part, whole)
        ray.origin = point + enters * way
        ray.direction = way
        ray.length = leaves - enters
        ray.begin = begin - enters
        if ray.begin >= ray.length or ray.begin + wp.float64(count) * ray.apart <= wp.float64(0.0):
            return ray
        ray.goes = bool(True)
        # Where the ray is in light's cells: both linear in its length, for what diverges constant.
        ray.drift = sweep.across @ way
        if sweep.diverging:
            # Rays come from where light does: from inside the volume, where z = 0, too.
            ray.foot = ray.drift / rate
            ray.drift = wp.vec3d()
        else:
            ray.foot = sweep.across @ ray.origin + sweep.shift
        ray.foot -= wp.vec3d(sweep.corner[0], sweep.corner[1], wp.float64(0.0))
        return ray

    return through


@wp.func
def begin(x: int, y: int, fresh: bool, seen_by: Eye):
    """What has been seen of a pixel before, of ``fresh`` ones nothing."""
    if fresh:
        seen_by.rgba[y, x] = wp.vec4d()
        seen_by.lit[y, x] = wp.vec3d()
    return seen_by.rgba[y, x][3]


@wp.func
def leave(
    x: int,
    y: int,
    onward: bool,
    plain: wp.vec3d,
    shone: wp.vec3d,
    opacity: wp.float64,
    evaluated: int,
    seen_by: Eye,
):
    """What a ray has come to: ``opacity`` with what it had before where it goes on in the order of slabs."""
    before = seen_by.rgba[y, x]
    ray = wp.vec4d(plain[0], plain[1], plain[2], opacity)
    if onward:
        ray += before
        ray[3] = opacity
        seen_by.lit[y, x] = shone + seen_by.lit[y, x]
    else:
        seen_by.lit[y, x] = shone + (wp.float64(1.0) - opacity) * seen_by.lit[y, x]
        ray = over(ray, before)
    seen_by.rgba[y, x] = ray
    seen_by.samples[y, x] += evaluated


@cache
def make_abreast(halves):
    """The kernel ``advance`` of ``LANES`` rays at a time."""
    Scene = halves.Scene
    through = make_through(halves)
    lighted = halves.light is not None
    look = make_eyes(halves.field.dtype, FAINT, LEAST, lighted)
    eye_of, *_ = make_shading(halves)

    @wp.kernel(enable_backward=False, module="unique")
    def advance(
        base: int,
        scene: Scene,
        first: int,
        count: int,
        fresh: bool,
        stack: wp.array3d(dtype=wp.float32),
        seen_by: Eye,
    ):
        view = scene.view
        # Of a row of a tile, up to the image's edge.
        x, y = pixel(view, (wp.tid() + base) * LANES)
        last = wp.where(y < view.height, wp.min(LANES, view.width - x), 0)
        asked = int(0)
        for l in range(last):
            asked += int(seen_by.shown[y, x + l])
        if asked == 0:
            return
        lines = wp.zeros(shape=(LANES, 9), dtype=wp.float64)
        if view.ends.shape[0] == 0:
            offs = wp.zeros(shape=(LANES,), dtype=wp.float64)
            limits = wp.vec3d(FAR, wp.float64(0.0), wp.float64(1.0))
            reaches(view, Brick(), x, y, limits, lines, offs)
        else:
            for l in range(last):
                if seen_by.shown[y, x + l] != wp.uint8(0):
                    point, way, span = reach(view, x + l, y)
                    for c in range(3):
                        lines[l, c] = point[c]
                        lines[l, 3 + c] = way[c]
                        lines[l, 6 + c] = span[c]
        rays = wp.zeros(shape=(GIVEN, LANES), dtype=float)
        found = wp.zeros(shape=(FOUND, LANES), dtype=float)
        going = int(0)
        onward = bool(True)
        for l in range(last):
            if seen_by.shown[y, x + l] != wp.uint8(0):
                seen = begin(x + l, y, fresh, seen_by)
                point = wp.vec3d(lines[l, 0], lines[l, 1], lines[l, 2])
                way = wp.vec3d(lines[l, 3], lines[l, 4], lines[l, 5])
                span = wp.vec3d(lines[l, 6], lines[l, 7], lines[l, 8])
                ray = through(scene, point, way, span, first, count, seen)
                if ray.goes:
                    going += 1
                    onward = ray.onward
                    for c in range(3):
                        rays[c, l] = float(ray.origin[c])
                        rays[3 + c, l] = float(ray.direction[c])
                    rays[6, l] = float(ray.length)
                    rays[7, l] = float(ray.begin)
                    rays[8, l] = float(ray.apart)
                    for c in range(2):
                        rays[9 + c, l] = float(ray.foot[c])
                        rays[11 + c, l] = float(ray.drift[c])
                    if onward:
                        rays[13, l] = float(seen)
                    if wp.static(lighted):
                        eye = eye_of(scene, wp.vec3(ray.direction))
                        for c in range(3):
                            rays[14 + c, l] = eye[c]
        if going == 0:
            return
        task = Task()
        task.octants = seen_by.octants
        task.low = view.low
        task.high = view.high
        task.slice = scene.march.lead + wp.where(onward, 0, count)
        task.turn = wp.where(onward, 1, -1)
        task.count = count
        task.least = float(wp.float64(1.0) - scene.opaque)
        if wp.static(lighted):
            look(scene.field, scene.table, scene.march, stack, task, scene.light, rays, found)
        else:
            look(scene.field, scene.table, scene.march, stack, task, rays, found)
        for l in range(last):
            if rays[6, l] > float(0.0):
                plain = wp.vec3d(wp.vec3(found[0, l], found[1, l], found[2, l]))
                shone = wp.vec3d(wp.vec3(found[3, l], found[4, l], found[5, l]))
                leave(x + l, y, onward, plain, shone, wp.float64(found[6, l]), int(found[7, l]), seen_by)

    return advance


@cache
def make_advance(halves):
    """The kernel ``advance`` of a sweep, and how many rays an item of its launch has."""
    preintegrated, traced = halves.march.preintegrated, halves.march.traced
    light = halves.light
    lighted = light is not None
    plain = not lighted or (light.kinds == KINDS and light.gradient == "central" and not light.material)
    if lanes_of(halves) is not None and traced and plain:
        return make_abreast(halves), LANES
    real = halves.real
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    through = make_through(halves)
    Scene = halves.Scene
    value = halves.field.value(real)
    eye_of, *_ = make_shading(halves)
    absorbed, _ = make_absorbed(real)
    _, enter, _, skip = make_walk(real)
    tissue = make_tissue(halves)
    shone_on = make_shone_on(halves)
    depth = make_depth(halves)
    way_of = make_way(real)
    light_on, fading, between = make_between(real, traced, LEAST)
    lanes = lanes_of(halves)
    packed = lanes is not None
    measure = lanes and lanes.measure

    @wp.func
    def received(scene: Scene, stack: wp.array3d(dtype=real), slot: real, u: real, v: real, p: vec3):
        """Light that is on its way to p, and the optical depth of what it has before it."""
        sweep = scene.march
        _, d, slant = way_of(sweep, wp.float64(0.0), u, v)
        # In depth; there is light of slices from the first on.
        back = wp.min(real(sweep.reach / slant), slot * real(sweep.thickness))
        D = depth(scene, p, -back * vec3(d), back * real(slant), sweep.steps)
        thickness = real(sweep.thickness)
        least = real(wp.static(LEAST))
        L = between(stack, slot - back / thickness, u, v, D * thickness / wp.max(back, least))
        return wp.max(L, least), D

    @wp.func
    def both(D: real, L0: real, D0: real, L1: real, D1: real, rest: real):
        """Emission of 1 over an optical depth D for the eye, in light that it receives at its two ends: the integral of
        exp(-u) L(u) for u from 0 to D, log L linear in u, as it is where tissue lies in layers of any profile. With
        the ``rest`` from there on in the light at its end.
        """
        y = wp.abs(D + D1 - D0 + wp.log(L0 / L1))
        stop = L1 * wp.exp(-D1 - D)
        most = wp.max(L0 * wp.exp(-D0), stop)
        rest *= stop
        if y < real(1.0e-4):
            return D * most + rest
        return D * most * absorbed(y) / y + rest

    @wp.kernel(enable_backward=False, module="unique")
    def advance(
        base: int,
        scene: Scene,
        first: int,
        count: int,
        fresh: bool,
        stack: wp.array3d(dtype=real),
        seen_by: Eye,
    ):
        """The eye's rays through ``count`` slabs from the ``first``; ``stack`` is the light of the slices around them.

        Only rays that are ``shown``; ``fresh`` ones have come to nothing yet.
        """
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        if seen_by.shown[y, x] == wp.uint8(0):
            return
        gone = begin(x, y, fresh, seen_by)
        point, way, span = reach(scene.view, x, y)
        ray = through(scene, point, way, span, first, count, gone)
        if not ray.goes:
            return
        sweep = scene.march
        # The slice that its first slab begins at, and how many of them it passes, all in all and by length.
        slice = sweep.lead + wp.where(ray.onward, 0, count)
        turn = wp.where(ray.onward, 1, -1)
        rise = real(wp.float64(turn) / ray.apart)
        origin = vec3(ray.origin)
        direction = vec3(ray.direction)
        length = real(ray.length)
        t0 = real(ray.begin)
        apart = real(ray.apart)
        part = real(ray.apart / wp.float64(sweep.parts))
        u = real(ray.foot[0])
        v = real(ray.foot[1])
        du = real(ray.drift[0])
        dv = real(ray.drift[1])
        onward = ray.onward
        # Light's: what fans out from the eye goes its way.
        way_of_slab = real(wp.where(sweep.diverging, ray.apart, sweep.thickness * sweep.slant))
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        clear = wp.float64(1.0)
        plain = vec3()
        shone = vec3()
        if onward:
            clear = wp.float64(1.0) - gone
        least = wp.float64(1.0) - scene.opaque
        evaluated = int(0)
        k = wp.max(int(wp.floor(-t0 / part)), 0)
        last = count * sweep.parts
        idle = bool(True)
        # What the last part or slab knew of its end, where that is the one before: its scalar, light, and traced light.
        measured = int(-2)
        known = int(-PARTS)  # the first of the parts that are measured together
        seen = wp.zeros(shape=(7, 8), dtype=real)
        even = int(-2)
        traced_to = int(-2)
        back = real(0.0)
        near = real(0.0)
        far = real(0.0)
        L1 = real(0.0)
        D1 = real(0.0)
        while k < last and clear >= least:
            start = t0 + real(k) * part
            a = wp.max(start, real(0.0))
            b = wp.min(start + part, length)
            if a >= length:
                break
            n = k - known
            if idle and (wp.static(not packed) or n >= PARTS):
                end = skip(scene.blocks.kinds, enter(scene.field.last, origin, direction, a), length).t
                ahead = wp.where(end >= length, last, int((end - real(wp.static(MARGIN)) - t0) / part))
                if ahead > k:
                    k = ahead
                    continue
            h = b - a
            front = back
            q = vec4()
            A = real(0.0)
            if wp.static(packed):
                if n >= PARTS:
                    lengths = vec3(t0, part, length)
                    n = measure(scene.field, scene.table, origin, direction, lengths, k, seen)
                    known = k
                    if n > 0:
                        # The next with something to see.
                        evaluated += n
                        k += n
                        idle = True
                        continue
                q = vec4(seen[2, n], seen[3, n], seen[4, n], seen[5, n])
                A = seen[6, n]
                if wp.static(lighted):
                    q = shone_on(scene, q, origin + (a + real(0.5) * h) * direction, seen[1, n], seen[1, n + 1], eye)
            else:
                if wp.static(preintegrated):
                    if measured != k - 1:
                        front = value(scene.field, origin + a * direction)
                    back = value(scene.field, origin + b * direction)
                    measured = k
                q = tissue(scene, origin + a * direction, direction, eye, h, front, back)
                A = absorbed(q[3] * h)
            idle = q[3] <= real(0.0)
            if not idle:
                D = q[3] * h
                # Of the part that a ray ends in all is seen that is left, in its light.
                rest = real(wp.where(clear * (wp.float64(1.0) - wp.float64(A)) < least, 1.0, 0.0))
                A += rest * (real(1.0) - A)
                B = real(0.0)  # of the emission of the part what is seen of it in its light
                if wp.static(traced):
                    visible = D * real(clear)
                    dense = wp.clamp(visible / real(wp.static(FAINT)) - real(1.0), real(0.0), real(1.0))
                    if dense < real(1.0):
                        slab = k // sweep.parts
                        t = t0 + real(slab) * apart
                        if even != slab:
                            near = far
                            if even != slab - 1:
                                near = light_on(stack, slice + turn * slab, u + t * du, v + t * dv)
                            e = t + apart
                            far = light_on(stack, slice + turn * (slab + 1), u + e * du, v + e * dv)
                            even = slab
                        w = (a + real(0.5) * h - t) / apart
                        B = (real(1.0) - dense) * A * fading(near, far, w, q[3] * way_of_slab, h / apart, D)
                    if dense > real(0.0):
                        L0 = L1
                        D0 = D1
                        if traced_to != k - 1:
                            L0, D0 = received(
                                scene,
                                stack,
                                real(slice) + rise * (a - t0),
                                u + a * du,
                                v + a * dv,
                                origin + a * direction,
                            )
                        L1, D1 = received(
                            scene, stack, real(slice) + rise * (b - t0), u + b * du, v + b * dv, origin + b * direction
                        )
                        traced_to = k
                        B += dense * both(D, L0, D0, L1, D1, rest)
                else:
                    t = a + real(0.5) * h
                    if sweep.parts == 1:
                        t = wp.where(onward, start, start + part)  # at the slab's front
                    B = A * between(stack, real(slice) + rise * (t - t0), u + t * du, v + t * dv, real(0.0))
                color = real(clear) * vec3(q[0], q[1], q[2])
                plain += A * color
                shone += B * color
                clear *= wp.float64(1.0) - wp.float64(A)
            evaluated += 1
            k += 1
        leave(x, y, ray.onward, wp.vec3d(plain), wp.vec3d(shone), wp.float64(1.0) - clear, evaluated, seen_by)

    return advance, 1
