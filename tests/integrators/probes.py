"""What there is along a ray, enclosed: an oracle that shares no code with those who probe, but with enclosures."""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

from flint import arb, ctx

from wvr.cuts.base import clip_list
from wvr.enclosure.balls import Break, Cubic, Gap, moved, parts, zeros
from wvr.enclosure.grid import finite
from wvr.enclosure.rays import Scene, Walk, camera_ray

BITS = 256
LEAST = arb(2) ** -100


class Stretch(NamedTuple):
    """Of a ray in one cell and of one label: the cubic of the length from a place, and from where to where that is."""

    cubic: Cubic
    start: arb
    end: arb
    place: arb
    state: int


def stretches(scene, camera, size, pixel):
    """All of a ray that is kept, from front to back, none with any doubt."""
    found = []
    walk = Walk(scene)
    ray = camera_ray(camera, size, *pixel)
    walk.passage = walk.grid.through(ray)
    faces = walk.passage.breaks()
    low = reduce(arb.min, (face.low for face in faces))
    high = reduce(arb.max, (face.high for face in faces))
    if ray.starts:
        faces.append(Break(arb(0), arb(0)))
    from wvr.enclosure.cuts import kept_of

    walk.kept = [(clip.invert, kept_of(clip, ray)) for clip in scene.clips]
    cuts = [one for _, kept in walk.kept for one in kept.breaks(low, high)]
    for part in parts([*faces, *cuts]):
        if isinstance(part, Break) or (ray.starts and part.middle < 0):
            continue
        place = walk.passage.place(part)
        if place is not None and not place.cells:
            continue
        kept = walk._kept(part)
        if kept is False:
            continue
        assert kept and place is not None and len(place.cells) == 1, "a ray that the oracle cannot tell"
        if not finite(walk.grid.corners(place.cells[0])):
            continue
        c = walk.passage.cubic(place, part.middle, walk.grid.corners)
        for stretch, state in walk._states(part):
            if isinstance(stretch, Gap) and state is not None and state >= 0:
                found.append(Stretch(c, stretch.start, stretch.end, part.middle, state))
    return found


def extremes(c, start, end):
    """What the cubic is at both ends and where it turns, as balls."""
    slope = Cubic(c.b, 2 * c.c, 3 * c.d, arb(0))
    turns = zeros(slope, [arb(0)], start.lower(), end.upper(), LEAST)
    return [moved(c, u).a for u in (start, *(turn.ball for turn in turns), end)]


def project(scene, camera, size, pixel):
    """(value, radius) of the largest, smallest, mean value and of the line integral; None if there is nothing."""
    with ctx.workprec(BITS):
        found = stretches(scene, camera, size, pixel)
        if not found:
            return None
        values = [value for one in found for value in extremes(one.cubic, one.start, one.end)]
        total, length = arb(0), arb(0)
        for one in found:
            c = one.cubic
            for sign, u in ((-1, one.start), (1, one.end)):
                total += sign * u * (c.a + u * (c.b / 2 + u * (c.c / 3 + u * c.d / 4)))
            length += one.end - one.start
        results = {
            "max": reduce(arb.max, values),
            "min": reduce(arb.min, values),
            "mean": total / length,
            "sum": total,
        }
        return {name: (float(ball.mid()), float(ball.rad())) for name, ball in results.items()}


def crossings(scene, camera, size, pixel, levels):
    """(distance along the ray [world length], level, state) of each, in order: where a level's side changes."""
    with ctx.workprec(BITS):
        found = []
        for level in levels:
            above, until = None, None
            for one in stretches(scene, camera, size, pixel):
                start, end = one.start.lower(), one.end.upper()
                breaks = sorted(zeros(one.cubic, [arb(level)], start, end, LEAST), key=lambda crossing: crossing.low)
                edges = [start, *(edge for one in breaks for edge in (one.low, one.high)), end]
                if until is None or not until.overlaps(one.place + one.start):
                    above = None
                at = one.place + start
                for low, high in zip(edges[::2], edges[1::2], strict=True):
                    # Between two breaks; nothing is there where one is at an end.
                    if high - low > arb(2) ** -60:
                        off = moved(one.cubic, ((low + high) / 2).mid()).a - level
                        assert off > 0 or off < 0, "a ray that the oracle cannot tell"
                        side = bool(off > 0)
                        if above is not None and side != above:
                            found.append((float(at.mid()), level, one.state))
                        above = side
                    at = one.place + high
                until = one.place + one.end
        return sorted(found)


def scene_of(volume, tf=None, clip=None, segmentation=None):
    return Scene(volume, tf, clip_list(clip), segmentation)
