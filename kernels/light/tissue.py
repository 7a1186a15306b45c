"""What a sweep sees of tissue: stretches of a straight way, by the scalars at their ends or in their middle."""

from functools import cache

import warp as wp

from ..cuts.labels import make_label_at
from ..cuts.volumes import make_shown
from ..field.walk import make_walk
from ..precision import vec3_of, vec4_of
from ..transfer.function import make_transfer
from ..transfer.lookup import make_table
from .lanes import lanes_of
from .points import make_point, make_shading

# Optical depth behind which light is seen by nobody: a transparency of 1e-6.
DARK = 14.0
# That find where clips and labels end, to 1/128 of a part of a way.
HALVINGS = 6


@cache
def make_there(halves):
    """``there(scene, p)``: the transfer function of a point that clips and labels leave, negative for others."""
    Scene = halves.Scene
    vec3 = vec3_of(halves.real)
    cuts = halves.cuts
    clipped = cuts.naive
    labelled = cuts.labels is not None
    shown = make_shown(cuts.kinds, cuts.volumes)
    label_at = make_label_at(cuts.labels or wp.uint8, halves.real)

    @wp.func
    def there(scene: Scene, p: vec3):
        state = int(0)
        if wp.static(clipped or labelled):
            place = wp.vec3d(p)
            if wp.static(clipped):
                if not shown(scene.cuts.clipping, place):
                    return -1
            if wp.static(labelled):
                state = label_at(scene.cuts.labels, place)
                if state >= scene.cuts.labels.transfers.shape[0]:
                    state = -1
        return state

    return there


@cache
def make_border(halves):
    """``border(scene, p, d, state)``: where between p and p + d, in parts of that, a ``state`` ends that p has and
    p + d has not.
    """
    real = halves.real
    vec3 = vec3_of(real)
    Scene = halves.Scene
    there = make_there(halves)

    @wp.func
    def border(scene: Scene, p: vec3, d: vec3, state: int):
        low = real(0.0)
        high = real(1.0)
        for _ in range(HALVINGS):
            middle = real(0.5) * (low + high)
            if there(scene, p + middle * d) == state:
                low = middle
            else:
                high = middle
        return real(0.5) * (low + high)

    return border


@cache
def make_shone_on(halves):
    """``shone_on(scene, q, p, front, back, eye)``: colour and extinction of a part of a ray, p its middle, in the
    lights of the scene.
    """
    real = halves.real
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    lighted = halves.light is not None
    Scene = halves.Scene
    _, interval, _ = make_transfer(real)
    _, gradient, light_of, lit, *_ = make_shading(halves)

    @wp.func
    def shone_on(scene: Scene, q: vec4, p: vec3, front: real, back: real, eye: vec3):
        if wp.static(lighted):
            if q[3] > real(0.0):
                I = light_of(scene, p, gradient(scene, p), eye)
                s = real(0.5) * (front + back)
                return lit(scene, q, interval(scene.transfer, s), s, I)
        return q

    return shone_on


@cache
def make_tissue(halves):
    """``tissue(scene, start, direction, eye, h, front, back)`` -> colour and extinction of a stretch of a ray of length
    h, ``front`` and ``back`` the scalars at its ends, which only tables ask for.
    """
    real = halves.real
    vec3 = vec3_of(real)
    vec4 = vec4_of(real)
    preintegrated = halves.march.preintegrated
    finite = halves.field.finite
    labelled = halves.cuts.labels is not None
    whole = not (halves.cuts.naive or labelled)
    Scene = halves.Scene
    value = halves.field.value(real)
    _, lookup = make_table(real)
    seen = make_point(halves)
    shone_on = make_shone_on(halves)
    there, border = make_there(halves), make_border(halves)

    @wp.func
    def piece(scene: Scene, state: int, start: vec3, direction: vec3, eye: vec3, h: real, front: real, back: real):
        """Of one transfer function."""
        q = vec4()
        if state < 0:
            return q
        middle = real(0.5) * h
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
                    q = shone_on(scene, q, start + middle * direction, front, back, eye)
        else:
            s = value(scene.field, start + middle * direction)
            if wp.static(finite) or wp.isfinite(s):
                q = seen(scene, s, start, direction, middle, eye)
        return q

    @wp.func
    def tissue(scene: Scene, start: vec3, direction: vec3, eye: vec3, h: real, front: real, back: real):
        if wp.static(whole):
            return piece(scene, 0, start, direction, eye, h, front, back)
        first = there(scene, start)
        second = there(scene, start + h * direction)
        if first == second:
            return piece(scene, first, start, direction, eye, h, front, back)
        x = border(scene, start, h * direction, first)
        y = real(1.0) - x
        middle = front + x * (back - front)
        q = piece(scene, first, start, direction, eye, x * h, front, middle)
        r = piece(scene, second, start + x * h * direction, direction, eye, y * h, middle, back)
        total = x * q[3] + y * r[3]
        if total > real(0.0):
            q = (x * q[3] * q + y * r[3] * r) / total
        q[3] = total
        return q

    return tissue


@cache
def make_depth(halves):
    """``depth(scene, p, d, length, parts)``: optical depth of the straight way from p to p + d, as much of it as is
    inside the box, looked at in so many parts; from DARK on perhaps less than it is.
    """
    real = halves.real
    vec3 = vec3_of(real)
    lanes = lanes_of(halves)
    if lanes is not None:
        return make_depth_in_lanes(halves, lanes.depth)
    preintegrated = halves.march.preintegrated
    finite = halves.field.finite
    labelled = halves.cuts.labels is not None
    whole = not (halves.cuts.naive or labelled)
    Scene = halves.Scene
    value = halves.field.value(real)
    _, lookup = make_table(real)
    _, interval, _ = make_transfer(real)
    _, enter, _, skip = make_walk(real)
    there, border = make_there(halves), make_border(halves)

    @wp.func
    def extinction(scene: Scene, state: int, p: vec3, front: real, back: real):
        """Of a stretch of one transfer function, p its middle."""
        if state < 0:
            return real(0.0)
        if wp.static(preintegrated):
            if not wp.static(finite):
                if not (wp.isfinite(front) and wp.isfinite(back)):
                    return real(0.0)
            if wp.static(labelled):
                scene.table = scene.cuts.labels.tables[state]
            return wp.max(lookup(scene.table, front, back)[3], real(0.0))
        s = value(scene.field, p)
        if not wp.static(finite):
            if not wp.isfinite(s):
                return real(0.0)
        if wp.static(labelled):
            scene.transfer = scene.cuts.labels.transfers[state]
        k = interval(scene.transfer, s)
        return wp.max(scene.transfer.value[k][3] + (s - scene.transfer.knot[k]) * scene.transfer.slope[k][3], real(0.0))

    @wp.func
    def depth(scene: Scene, p: vec3, d: vec3, length: real, parts: int):
        a = real(0.0)
        b = real(1.0)
        for c in range(3):
            low = real(scene.view.low[c]) - p[c]
            high = real(scene.view.high[c]) - p[c]
            if wp.where(d[c] < real(0.0), d[c], real(0.0)) < low or wp.where(d[c] > real(0.0), d[c], real(0.0)) > high:
                if d[c] == real(0.0):
                    return real(0.0)
                t0 = low / d[c]
                t1 = high / d[c]
                a = wp.max(a, wp.min(t0, t1))
                b = wp.min(b, wp.max(t0, t1))
        if b <= a:
            return real(0.0)
        if skip(scene.blocks.kinds, enter(scene.field.last, p, d, a), b).t >= b:
            return real(0.0)
        # Parts are from q to q + e.
        h = (b - a) / real(parts)
        e = h * d
        q = p + a * d
        total = real(0.0)
        front = real(0.0)
        back = real(0.0)
        first = int(0)
        second = int(0)
        if wp.static(preintegrated):
            back = value(scene.field, q)
        if not wp.static(whole):
            second = there(scene, q)
        n = int(0)
        while n < parts and total * h * length < real(wp.static(DARK)):
            front = back
            first = second
            if wp.static(preintegrated):
                back = value(scene.field, q + e)
            x = real(1.0)
            if not wp.static(whole):
                second = there(scene, q + e)
                if first != second:
                    x = border(scene, q, e, first)
                    middle = front + x * (back - front)
                    rest = extinction(scene, second, q + real(0.5) * (real(1.0) + x) * e, middle, back)
                    total += (real(1.0) - x) * rest
                    total += x * extinction(scene, first, q + real(0.5) * x * e, front, middle)
            if x == real(1.0):
                total += extinction(scene, first, q + real(0.5) * e, front, back)
            q += e
            n += 1
        return total * h * length

    return depth


def make_depth_in_lanes(halves, measured):
    """The same in vectors."""
    real = halves.real
    vec3 = vec3_of(real)
    Scene = halves.Scene

    @wp.func
    def depth(scene: Scene, p: vec3, d: vec3, length: real, parts: int):
        view = scene.view
        table = scene.table
        low = view.low
        return length * measured(scene.field, table, scene.march.pairs, low, view.high, p, d, parts)

    return depth
