"""The field inside one cell: its eight corners, and the cubic that it is along a ray, in float64.

With the ray's position linear in t, trilinear interpolation is ``s(t) = c0 + c1 t + c2 t^2 + c3 t^3``, a vec4d. What
is looked for along it is kept in a bracket.
"""

from functools import cache

import warp as wp

from .samples import make_corner

vec5d = wp.types.vector(5, wp.float64)
vec8d = wp.types.vector(8, wp.float64)
# What is off where numbers underflow, of a scalar along a ray, in cells however long (docs/proof.md, lemma 4).
DENORMAL = wp.constant(wp.float64(1e-120))
# And a few numbers, of lengths of order one.
UNDERFLOW = wp.constant(wp.float64(2.0**-1066))


@cache
def make_corners(dtype):
    """The struct of a field and ``corners(field, i, j, k)`` -> vec8d: samples of a cell, x fastest, less the shift."""
    Field, corner = make_corner(dtype, wp.float64)

    @wp.func
    def corners(field: Field, i: int, j: int, k: int):
        return vec8d(
            corner(field, i, j, k),
            corner(field, i + 1, j, k),
            corner(field, i, j + 1, k),
            corner(field, i + 1, j + 1, k),
            corner(field, i, j, k + 1),
            corner(field, i + 1, j, k + 1),
            corner(field, i, j + 1, k + 1),
            corner(field, i + 1, j + 1, k + 1),
        )

    return Field, corners


@wp.func
def cubic(c: vec8d, p: wp.vec3d, d: wp.vec3d):
    """Coefficients of the field at ``p + t d``, ``p`` from the cell's first corner."""
    x00 = c[1] - c[0]
    x10 = c[3] - c[2]
    x01 = c[5] - c[4]
    x11 = c[7] - c[6]
    v00 = c[0] + p[0] * x00
    v01 = c[4] + p[0] * x01
    y0 = c[2] + p[0] * x10 - v00
    y1 = c[6] + p[0] * x11 - v01
    v0 = v00 + p[1] * y0
    z = v01 + p[1] * y1 - v0
    # Mixed differences at p.
    xy0 = x10 - x00
    xyz = x11 - x01 - xy0
    xy = xy0 + p[2] * xyz
    x0 = x00 + p[1] * xy0
    xz = x01 - x00 + p[1] * xyz
    yz = y1 - y0
    x = x0 + p[2] * xz
    y = y0 + p[2] * yz
    return wp.vec4d(
        v0 + p[2] * z,
        x * d[0] + y * d[1] + z * d[2],
        xy * d[0] * d[1] + xz * d[0] * d[2] + yz * d[1] * d[2],
        xyz * d[0] * d[1] * d[2],
    )


@wp.func
def at(c: wp.vec4d, t: wp.float64):
    """The cubic at t."""
    return c[0] + t * (c[1] + t * (c[2] + t * c[3]))


@wp.func
def quartic(p: vec5d, t: wp.float64):
    """The quartic at t."""
    return p[0] + t * (p[1] + t * (p[2] + t * (p[3] + t * p[4])))


@wp.func
def moved(c: wp.vec4d, t: wp.float64):
    """The cubic about t: its value at ``u`` is that of ``c`` at ``t + u``."""
    three = wp.float64(3.0)
    return wp.vec4d(at(c, t), c[1] + t * (wp.float64(2.0) * c[2] + t * three * c[3]), c[2] + t * three * c[3], c[3])


@wp.func
def turns(c: wp.vec4d, end: wp.float64):
    """Where the cubic turns inside (0, end), in order; ``end`` in place of those that are not there."""
    # Roots of c1 + 2 c2 t + 3 c3 t^2, without cancellation, nor under- or overflow of squares.
    first = end
    second = end
    size = wp.max(wp.abs(c[1]), wp.max(wp.abs(c[2]), wp.abs(c[3])))
    if size > wp.float64(0.0):
        a = wp.float64(3.0) * c[3] / size
        b = c[2] / size
        l = c[1] / size
        discriminant = b * b - a * l
        if discriminant > wp.float64(0.0):
            q = -(b + wp.where(b < wp.float64(0.0), -wp.sqrt(discriminant), wp.sqrt(discriminant)))
            # Compared without dividing: there may be no quadratic or linear term to divide by.
            if wp.abs(l) < wp.abs(q) * end and l * q > wp.float64(0.0):
                first = l / q
            if wp.abs(q) < wp.abs(a) * end and q * a > wp.float64(0.0):
                second = q / a
    return wp.min(first, second), wp.max(first, second)


@wp.func
def zero(p: vec5d, start: wp.float64, end: wp.float64, guess: wp.float64, sign: wp.float64):
    """Where a quartic monotone on [start, end] is zero; ``sign`` is 1 if it rises. The nearer end if it has no zero."""
    low = start
    high = end
    t = wp.clamp(guess, start, end)
    for _ in range(100):
        value = quartic(p, t)
        if value * sign > wp.float64(0.0):
            high = t
        else:
            low = t
        slope = p[1] + t * (wp.float64(2.0) * p[2] + t * (wp.float64(3.0) * p[3] + t * wp.float64(4.0) * p[4]))
        # A Newton step, or half the bracket where that would leave it.
        step = wp.float64(0.0)
        if slope != wp.float64(0.0):
            step = value / slope
        tried = t - step
        if slope * sign <= wp.float64(0.0) or tried < low or tried > high:
            tried = low + wp.float64(0.5) * (high - low)
        if wp.abs(tried - t) <= wp.float64(4.0e-16) * end:
            return tried
        t = tried
    return t


@wp.func
def rise(c: wp.vec4d, end: wp.float64):
    """Where a cubic that is not above zero at 0 first is inside (0, end); ``end`` if it is not."""
    first, second = turns(c, end)
    start = wp.float64(0.0)
    found = end
    stretch = int(0)
    # Not written out, here and below: a root is much code.
    while stretch < 3:
        # Monotone up to here.
        stop = end
        if stretch == 0:
            stop = first
        elif stretch == 1:
            stop = second
        if found == end and stop > start and at(c, stop) > wp.float64(0.0):
            low = at(c, start)
            # The secant through both ends is a good guess.
            guess = start - (stop - start) * low / (at(c, stop) - low)
            found = zero(vec5d(c[0], c[1], c[2], c[3], wp.float64(0.0)), start, stop, guess, wp.float64(1.0))
        start = stop
        stretch += 1
    return found


# In parts of a cell's length, what is not worth being known more exactly.
SHORT = wp.constant(1.0e-9)


@wp.func
def length_within(c: wp.vec4d, end: wp.float64, e: wp.float64):
    """Length inside (0, end) along which a cubic is within e of zero, or a little more."""
    last = at(c, end)
    slope = wp.abs(c[1]) - end * (wp.float64(2.0) * wp.abs(c[2]) + end * wp.float64(3.0) * wp.abs(c[3]))
    if wp.float64(2.0) * e < wp.float64(SHORT) * end * slope:
        # It is nowhere less steep than that.
        if wp.min(c[0], last) > e or wp.max(c[0], last) < -e:
            return wp.float64(0.0)
        return wp.float64(2.0) * e / slope
    first, second = turns(c, end)
    start = wp.float64(0.0)
    total = wp.float64(0.0)
    stretch = int(0)
    while stretch < 3:
        # Monotone up to here.
        stop = end
        if stretch == 0:
            stop = first
        elif stretch == 1:
            stop = second
        sign = wp.where(at(c, stop) > at(c, start), wp.float64(1.0), wp.float64(-1.0))
        low = sign * at(c, start)
        high = sign * at(c, stop)
        if stop > start and low <= e and high >= -e:
            rising = sign * c
            slope = (high - low) / (stop - start)
            near = start
            far = stop
            if low < -e:
                p = vec5d(rising[0] + e, rising[1], rising[2], rising[3], wp.float64(0.0))
                near = zero(p, start, stop, start - (low + e) / slope, wp.float64(1.0))
            if high > e:
                p = vec5d(rising[0] - e, rising[1], rising[2], rising[3], wp.float64(0.0))
                far = zero(p, start, stop, near + wp.float64(2.0) * e / slope, wp.float64(1.0))
            # Where they are is known to 4e-16 of the length.
            total += wp.max(far - near, wp.float64(0.0)) + wp.float64(1.0e-15) * end
        start = stop
        stretch += 1
    return wp.min(total, end)


@cache
def make_cubic(dtype):
    """``cubic`` of ``grid.Grid``."""
    Field, corners = make_corners(dtype)

    @wp.func
    def along(field: Field, i: int, j: int, k: int, p: wp.vec3d, d: wp.vec3d):
        return cubic(corners(field, i, j, k), p, d)

    return along


@cache
def make_extent(dtype):
    """``extent`` of ``grid.Grid``."""
    Field, corners = make_corners(dtype)

    @wp.func
    def extent(field: Field, i: int, j: int, k: int):
        c = corners(field, i, j, k)
        low = c[0]
        high = c[0]
        # Comparisons, which are false for NaN.
        for n in range(1, 8):
            low = wp.where(c[n] < low, c[n], low)
            high = wp.where(c[n] > high, c[n], high)
        return low, high

    return extent


# In C++, where the corners share one address and sums may be fused: the frame is a tenth faster.
CENTERED = """
#pragma clang fp contract(fast)
const auto& data = field.data;
const double shift = SHIFT;
const size_t nx = data.shape[2];
const size_t nxy = nx * data.shape[1];
const auto* c = data.data + (k * nxy + j * nx + i);
const double x = p[0], y = p[1], z = p[2];
const double c000 = double(c[0]) - shift, c010 = double(c[nx]) - shift;
const double c001 = double(c[nxy]) - shift, c011 = double(c[nxy + nx]) - shift;
const double x00 = double(c[1]) - shift - c000, x10 = double(c[nx + 1]) - shift - c010;
const double x01 = double(c[nxy + 1]) - shift - c001, x11 = double(c[nxy + nx + 1]) - shift - c011;
const double v00 = c000 + x * x00, v01 = c001 + x * x01;
const double y0 = c010 + x * x10 - v00, y1 = c011 + x * x11 - v01;
const double v0 = v00 + y * y0, dz = v01 + y * y1 - v0;
const double xy0 = x10 - x00, xyz = x11 - x01 - xy0, xz = x01 - x00 + y * xyz, yz = y1 - y0;
const double dx = x00 + y * xy0 + z * xz, dy = y0 + z * yz, xy = xy0 + z * xyz;
return wp::vec_t<4, double>(
    v0 + z * dz,
    h * (d[0] * dx + d[1] * dy + d[2] * dz),
    h * h * (d[0] * (d[1] * xy + d[2] * xz) + d[1] * d[2] * yz),
    h * h * h * (d[0] * d[1] * d[2] * xyz)
);
"""


@cache
def make_centered(dtype):
    """``centered`` of ``grid.Grid``."""
    Field, _ = make_corner(dtype, wp.float64)
    shift = "field.shift" if dtype in (wp.float16, wp.float32, wp.float64) else "0.0"

    @wp.func_native(CENTERED.replace("SHIFT", shift))
    def centered(field: Field, i: int, j: int, k: int, p: wp.vec3d, d: wp.vec3d, h: wp.float64) -> wp.vec4d: ...

    return centered
