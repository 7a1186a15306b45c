"""The eye that passes the slices of light, and what it makes of them.

Light goes ahead by a number of slices, then the eye's rays follow through the slabs between them.
"""

from functools import cache

import warp as wp

from ..field.walk import MARGIN, make_walk
from ..precision import vec3_of, vec4_of
from ..ray import ending, entry, inside, inverted, pixel
from ..segment import make_absorbed, over, widened
from ..transfer.function import make_transfer
from ..transfer.lookup import make_table
from .points import make_point, make_shading
from .travel import make_there


@wp.struct
class Eye:
    """What the eye's rays have come to, [y, x] of pixels."""

    shown: wp.array2d(dtype=wp.uint8)  # pixels that are asked for
    rgba: wp.array2d(dtype=wp.vec4d)  # composite without shadows
    lit: wp.array2d(dtype=wp.vec3d)  # its colour with them
    samples: wp.array2d(dtype=int)


@cache
def make_advance(halves):
    """The kernel ``advance`` of a sweep."""
    real = halves.real
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    preintegrated = halves.march.preintegrated
    finite = halves.field.finite
    lighted = halves.light is not None
    Scene = halves.Scene
    labelled = halves.cuts.labels is not None
    value = halves.field.value(real)
    _, lookup = make_table(real)
    _, interval, _ = make_transfer(real)
    eye_of, gradient, light_of, lit, _ = make_shading(halves)
    seen = make_point(halves)
    absorbed, _ = make_absorbed(real)
    _, enter, _, skip = make_walk(real)
    there = make_there(halves)

    @wp.func
    def tissue(scene: Scene, origin: vec3, direction: vec3, eye: vec3, a: real, h: real, front: real, back: real):
        """Colour and extinction of the stretch [a, a + h] of a ray; the scalars at its ends are for the table."""
        q = vec4()
        middle = a + real(0.5) * h
        p = origin + middle * direction
        state = there(scene, p)
        if state < 0:
            return q
        if wp.static(labelled):
            scene.transfer = scene.cuts.labels.transfers[state]
            if wp.static(preintegrated):
                scene.table = scene.cuts.labels.tables[state]
        if wp.static(preintegrated):
            if wp.static(finite) or (wp.isfinite(front) and wp.isfinite(back)):
                q = lookup(scene.table, front, back)
                if q[3] > real(0.0):
                    tau = q[3]
                    q /= tau
                    q[3] = tau
                    if wp.static(lighted):
                        I = light_of(scene, p, gradient(scene, p), eye)
                        s = real(0.5) * (front + back)
                        q = lit(scene, q, interval(scene.transfer, s), s, I)
        else:
            s = value(scene.field, p)
            if wp.static(finite) or wp.isfinite(s):
                q = seen(scene, s, origin, direction, middle, eye)
        return q

    @wp.func
    def light_at(stack: wp.array3d(dtype=real), number: int, u: real, v: real):
        """Light of a slice, linear between cells; 1 beyond its border."""
        rows = stack.shape[1]
        columns = stack.shape[2]
        if not (u >= real(0.0) and v >= real(0.0) and u <= real(columns - 1) and v <= real(rows - 1)):
            return real(1.0)
        i = wp.max(wp.min(int(u), columns - 2), 0)
        j = wp.max(wp.min(int(v), rows - 2), 0)
        x = u - real(i)
        y = v - real(j)
        a = stack[number, j, i]
        b = stack[number, j + 1, i]
        a += x * (stack[number, j, i + 1] - a)
        b += x * (stack[number, j + 1, i + 1] - b)
        return a + y * (b - a)

    @wp.kernel(enable_backward=False, module="unique")
    def advance(
        base: int,
        scene: Scene,
        first: int,
        count: int,
        stack: wp.array3d(dtype=real),
        seen_by: Eye,
    ):
        """The eye's rays through ``count`` slabs from the ``first``; ``stack`` is the light of the slices around them.

        Only rays that are ``shown``.
        """
        sweep = scene.march
        x, y = pixel(scene.view, wp.tid() + base)
        if y >= scene.view.height:
            return
        if seen_by.shown[y, x] == wp.uint8(0):
            return
        before = seen_by.rgba[y, x]
        point, way, whole, entered = entry(scene.view, x, y)
        ends, _loose = ending(scene.view, x, y)
        view = scene.view
        enters, leaves = inside(view.seen_low, view.seen_high, point, inverted(way), wp.float64(0.0), whole)
        leaves = wp.min(leaves, ends - entered)
        if not leaves > enters:
            return
        # Rays begin and end with what there is to see.
        point += enters * way
        reach = leaves - enters
        # Slices behind one another for the eye: i-th slab of the ray is from a + i h on.
        z = wp.dot(sweep.ahead, point) + sweep.offset
        rate = wp.dot(sweep.ahead, way)
        onward = rate > wp.float64(0.0)
        if onward and before[3] > scene.opaque:
            return
        edge = sweep.start + sweep.thickness * wp.float64(wp.where(onward, first, first + count))
        begin = (edge - z) / rate
        step = sweep.thickness / wp.abs(rate)
        if begin >= reach or begin + wp.float64(count) * step <= wp.float64(0.0):
            return
        # Where the ray is in light's cells: both linear in its length, for what diverges constant.
        foot = sweep.across @ point + sweep.shift
        drift = sweep.across @ way
        if sweep.diverging:
            # Rays come from where light does: from inside the volume, where z = 0, too.
            foot = drift / rate
            drift = wp.vec3d()
        u = real(foot[0] - sweep.corner[0])
        v = real(foot[1] - sweep.corner[1])
        du = real(drift[0])
        dv = real(drift[1])
        origin = vec3(point)
        direction = vec3(way)
        length = real(reach)
        t0 = real(begin)
        h0 = real(step)
        eye = vec3()
        if wp.static(lighted):
            eye = eye_of(scene, direction)
        ray = wp.vec4d()
        shone = wp.vec3d()
        if onward:
            ray = before
            shone = seen_by.lit[y, x]
        evaluated = int(0)
        i = wp.max(int(wp.floor(-t0 / h0)), 0)
        idle = bool(True)
        known = int(-2)  # slab whose end's light is ``far``
        measured = int(-2)  # and whose end's scalar is ``front``
        far = real(0.0)
        front = real(0.0)
        while i < count and ray[3] <= scene.opaque:
            start = t0 + real(i) * h0
            a = wp.max(start, real(0.0))
            b = wp.min(start + h0, length)
            if a >= length:
                break
            if idle:
                end = skip(scene.blocks.kinds, enter(scene.field.last, origin, direction, a), length).t
                ahead = wp.where(end >= length, count, int((end - real(wp.static(MARGIN)) - t0) / h0))
                if ahead > i:
                    i = ahead
                    continue
            h = (b - a) / real(sweep.parts)
            if wp.static(preintegrated):
                if measured != i - 1:
                    front = value(scene.field, origin + a * direction)
            near = real(0.0)
            bright = bool(False)
            for n in range(sweep.parts):
                begins = a + real(n) * h
                back = front
                if wp.static(preintegrated):
                    back = value(scene.field, origin + (begins + h) * direction)
                q = tissue(scene, origin, direction, eye, begins, h, front, back)
                front = back
                if q[3] > real(0.0):
                    if not bright:
                        slot = wp.where(onward, i, count - i)
                        near = far
                        if known != i - 1:
                            near = light_at(stack, slot, u + start * du, v + start * dv)
                        slot = wp.where(onward, i + 1, count - i - 1)
                        e = start + h0
                        far = light_at(stack, slot, u + e * du, v + e * dv)
                        known = i
                        bright = True
                    w = (begins + real(0.5) * h - start) / h0
                    if sweep.front and sweep.parts == 1:
                        w = wp.where(onward, real(0.0), real(1.0))
                    L = near + w * (far - near)
                    A = absorbed(q[3] * h)
                    c = widened(vec4(A * q[0], A * q[1], A * q[2], A))
                    through = (wp.float64(1.0) - ray[3]) * wp.float64(L)
                    shone += through * wp.vec3d(c[0], c[1], c[2])
                    ray = over(ray, c)
            idle = known != i
            measured = i
            evaluated += sweep.parts
            i += 1
        if not onward:
            shone += (wp.float64(1.0) - ray[3]) * seen_by.lit[y, x]
            ray = over(ray, before)
        seen_by.rgba[y, x] = ray
        seen_by.lit[y, x] = shone
        seen_by.samples[y, x] += evaluated

    return advance


@wp.kernel(enable_backward=False, module="unique")
def gather(
    base: int,
    rgba: wp.array2d(dtype=wp.vec4d),
    lit_rgb: wp.array2d(dtype=wp.vec3d),
    color: wp.vec3d,
    share: bool,
    result: wp.array2d(dtype=wp.vec3d),
):
    """Adds what one light does to each pixel: colour, or the share of it that light reaches."""
    item = wp.tid() + base
    y = item // rgba.shape[1]
    x = item - y * rgba.shape[1]
    plain = rgba[y, x]
    lit = lit_rgb[y, x]
    if share:
        # Where a channel has no emission, the share is that of all channels; where there is none, all is reached.
        total = plain[0] + plain[1] + plain[2]
        mean = wp.float64(1.0)
        if total > wp.float64(0.0):
            mean = (lit[0] + lit[1] + lit[2]) / total
        for c in range(3):
            part = mean
            if plain[c] > wp.float64(1.0e-6) * total:
                part = lit[c] / plain[c]
            lit[c] = part
    result[y, x] += wp.cw_mul(color, lit)


@cache
def make_finish(real):
    """Kernels ``choose(base, image, shown)``: the pixels that show anything, and ``finish(base, light, rgba, share,
    image)``: an image's colours times shares, or all of it from the slices.
    """
    vec4 = vec4_of(real)

    @wp.kernel(enable_backward=False, module="unique")
    def choose(base: int, image: wp.array2d(dtype=vec4), shown: wp.array2d(dtype=wp.uint8)):
        item = wp.tid() + base
        y = item // image.shape[1]
        x = item - y * image.shape[1]
        shown[y, x] = wp.uint8(wp.where(image[y, x][3] > real(0.0), 1, 0))

    @wp.kernel(enable_backward=False, module="unique")
    def finish(
        base: int,
        light: wp.array2d(dtype=wp.vec3d),
        rgba: wp.array2d(dtype=wp.vec4d),
        share: bool,
        image: wp.array2d(dtype=vec4),
    ):
        item = wp.tid() + base
        y = item // image.shape[1]
        x = item - y * image.shape[1]
        q = light[y, x]
        if share:
            for c in range(3):
                q[c] *= wp.float64(image[y, x][c])
            image[y, x] = vec4(real(q[0]), real(q[1]), real(q[2]), image[y, x][3])
        else:
            image[y, x] = vec4(real(q[0]), real(q[1]), real(q[2]), real(rgba[y, x][3]))

    return choose, finish
