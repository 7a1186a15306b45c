"""The largest or smallest value of the field along a ray: of the cubic in each cell, at its ends and where it turns.

Smallest ones are the largest of what is counted downwards. In vectors a tree says how much there is at most in what
(``field.climb``), so that a ray goes into nothing that cannot exceed what it has already found. One by one peaks do, of
blocks of 4, 16 and 64 cells along each axis; the block of 16 with the highest peak is looked at first.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.cell import at, turns
from ..field.climb import Tops
from ..field.peaks import Peaks, promising
from ..field.walk import cell_at, make_walk
from ..transfer.function import make_transfer
from .found import SHORTEST, Found


@wp.struct
class Extreme:
    # Of values times the sign: one by one, and in vectors.
    peaks: Peaks
    tops: Tops
    off: wp.float64  # rounding of a value
    range: wp.float64  # of the samples


@dataclass(frozen=True)
class Half:
    """The device half of largest and smallest values."""

    sign: int  # 1 for the largest, -1 for the smallest
    bounded = True
    tabled = False
    borders = False

    def Struct(self, halves):
        return Extreme

    def probe(self, halves):
        return make_probe(halves)

    def told(self, halves):
        return make_told(halves)


@cache
def make_probe(halves):
    """``probe`` of ``kernels.probe``."""
    real = wp.float64
    Scene = halves.Scene
    finite = halves.field.finite
    vectors = halves.vectors
    find = (halves.field.climb if vectors else halves.field.seek)(halves.march.sign)
    cubic = halves.field.cubic()
    sign = wp.constant(real(halves.march.sign))
    Walk, enter, _, _ = make_walk(real)

    @wp.func
    def climbed(scene: Scene, walk: Walk, stop: real, found: Found):
        """The same, in vectors."""
        least = real(0.0)
        if not wp.static(finite):
            least = real(2.0) * scene.view.astray
        best = find(scene.field, scene.march.tops, walk, stop, found.value, found.place, least)
        if best[0] > found.value or best[1] != found.place:
            found.held = found.state
        found.value = best[0]
        found.place = best[1]
        found.count += int(best[2])
        return found

    @wp.func
    def sought(scene: Scene, walk: Walk, stop: real, found: Found):
        best = found.value
        place = found.place
        count = int(0)
        w = walk
        while w.t < stop:
            w, crest = find(scene.field, scene.march.peaks, w, stop, best, place)
            known = crest.t < stop
            L = wp.min(w.t, stop) - crest.t
            if not wp.static(finite):
                # An edge or corner that a ray touches among absent cells is not of the ray.
                known = known and wp.isfinite(crest.cubic[3]) and L > real(2.0) * scene.view.astray
            if known:
                count += 1
                c = crest.cubic
                first, second = turns(c, L)
                for n in range(4):
                    u = real(0.0)
                    if n == 1:
                        u = first
                    elif n == 2:
                        u = second
                    elif n == 3:
                        u = L
                    s = wp.min(at(c, u), crest.top)
                    if s > best or (s == best and crest.t + u < place):
                        best = s
                        place = crest.t + u
        if best > found.value or place != found.place:
            found.held = found.state
        found.value = best
        found.place = place
        found.count += count
        return found

    search = climbed if vectors else sought

    @wp.func
    def probe(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64, given: Found):
        found = given
        w = enter(scene.field.last, origin, direction, start)
        end = wp.min(stop, w.out)
        known = bool(False)
        beside = found.hint >= start and found.hint <= end
        if not wp.static(finite):
            # Of a cell that the ray runs in, not of one that it touches to rounding where it begins or ends.
            touched = real(2.0) * scene.view.astray
            beside = found.hint > start + touched and found.hint < end - touched
        if beside:
            # Much the same as what there is beside.
            p = origin + found.hint * direction
            cell = cell_at(scene.field.last, p)
            local = p - wp.vec3d(real(cell[0]), real(cell[1]), real(cell[2]))
            s = sign * cubic(scene.field, cell[0], cell[1], cell[2], local, wp.vec3d())[0]
            if s > found.value and (wp.static(finite) or wp.isfinite(s)):
                found.value = s
                found.place = found.hint
                found.held = found.state
                known = True
        if not wp.static(vectors):
            # The block with the highest peak first.
            if not known:
                begin, until = promising(scene.march.peaks, w, end, found.value)
                found = search(scene, begin, until, found)
        found = search(scene, w, end, found)
        found.length += stop - start
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
        peaks = scene.march
        if found.value > -wp.float64(wp.inf):
            found.value *= wp.float64(wp.static(halves.march.sign))
            if wp.static(halves.cuts.labels is not None):
                scene.transfer = scene.cuts.labels.transfers[found.held]
            q = classify(scene.transfer, found.value)
            found.rgba = wp.vec4d(q[0], q[1], q[2], wp.float64(1.0))
            slope = peaks.range * (wp.abs(direction[0]) + wp.abs(direction[1]) + wp.abs(direction[2]))
            off = peaks.off + peaks.range * wp.float64(3.0) * scene.view.astray + slope * found.loose
            found.bound = wp.min(off, peaks.range + peaks.off)
            if not wp.static(halves.field.finite):
                # How much of that is of cells that are there is not known.
                found.length = wp.min(found.length, wp.float64(SHORTEST))
        else:
            found.length = wp.float64(0.0)
            found.value = wp.float64(wp.nan)
        return found

    return told
