"""The line integral of the field along a ray, and its mean: of the cubic in each cell, in closed form.

Blocks whose samples are all the same are one step.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.blocks import BITS
from ..field.cell import UNDERFLOW
from ..field.walk import make_walk
from ..transfer.function import make_transfer
from .found import Found


@wp.struct
class Total:
    flat: wp.array3d(dtype=wp.float64)  # of each block, the one value that it has; NaN where there are several
    unit: wp.float64  # of length [world length]
    mean: bool  # else the integral
    off: wp.float64  # rounding of a scalar
    largest: wp.float64  # size of a sample
    range: wp.float64  # of the samples
    colors: make_transfer(wp.float64)[0]


@dataclass(frozen=True)
class Half:
    """The device half of line integrals."""

    bounded = True
    tabled = False
    borders = False

    def Struct(self, halves):
        return Total

    def probe(self, halves):
        return make_probe(halves)

    def told(self, halves):
        return make_told(halves)


@cache
def make_probe(halves):
    """``probe`` of ``kernels.probe``; what it sums up is ``Found.value``, and the length that this is of."""
    real = wp.float64
    Scene = halves.Scene
    finite = halves.field.finite
    cubic = halves.field.cubic()
    _, enter, leap, _ = make_walk(real)

    @wp.func
    def probe(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64, given: Found):
        found = given
        w = enter(scene.field.last, origin, direction, start)
        end = wp.min(stop, w.out)
        total = real(0.0)
        length = real(0.0)
        count = int(0)
        while w.t < end:
            i = wp.max(w.cell[0], 0)
            j = wp.max(w.cell[1], 0)
            k = wp.max(w.cell[2], 0)
            value = scene.march.flat[k >> BITS, j >> BITS, i >> BITS]
            known = bool(True)
            after = leap(w, wp.where(value == value, int(BITS), 0), 0)
            L = wp.min(after.t, end) - w.t
            if value != value:
                p = w.origin + w.t * w.direction - wp.vec3d(real(i), real(j), real(k))
                c = cubic(scene.field, i, j, k, p, w.direction)
                if not wp.static(finite):
                    known = wp.isfinite(c[3])
                value = c[0] + L * (real(0.5) * c[1] + L * (real(wp.static(1.0 / 3.0)) * c[2] + L * real(0.25) * c[3]))
            if known:
                total += L * value
                length += L
                count += 1
            w = after
        if found.count == 0:
            found.value = real(0.0)
        found.value += total
        found.length += length
        found.count += count
        return found

    return probe


@cache
def make_told(halves):
    """``told`` of ``kernels.probe``."""
    Scene = halves.Scene
    _, _, classify = make_transfer(wp.float64)

    @wp.func
    def told(scene: Scene, direction: wp.vec3d, given: Found):
        found = given
        sums = scene.march
        if found.length > wp.float64(0.0):
            # Of each step's product, which may underflow.
            tiny = UNDERFLOW * wp.float64(found.count)
            # Sums of as many numbers as there are steps, and each of a few products.
            ulps = wp.float64(2 * found.count + 512) * wp.float64(wp.static(2.0**-53))
            off = sums.off + sums.range * wp.float64(3.0) * scene.view.astray + ulps * sums.largest
            if sums.mean:
                found.value /= found.length
                off += tiny / found.length
                found.bound = wp.min(
                    off + wp.float64(2.0) * sums.largest * found.loose / found.length, sums.range + off
                )
            else:
                found.value *= sums.unit
                found.bound = sums.unit * (off * found.length + sums.largest * found.loose + tiny)
                # A unit of length may be so small that products with it underflow.
                found.bound += UNDERFLOW
            q = classify(sums.colors, found.value)
            found.rgba = wp.vec4d(q[0], q[1], q[2], wp.float64(1.0))
        else:
            found.value = wp.float64(wp.nan)
        return found

    return told
