"""The stretches that clips and labels cut a ray into, marched one by one and composed like segments."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.walk import ahead
from ..ray import LEAVE
from ..segment import over
from .labels import make_label_span, make_labels
from .shapes import KINDS
from .volumes import make_clip_span, make_clipping, make_cut_normal, make_near_surfaces


@dataclass(frozen=True)
class Cuts:
    """The device half of clips and labels."""

    kinds: tuple = KINDS  # of clip shapes
    volumes: type = wp.uint8  # of the samples of clip volumes
    clipped: bool = False  # clips cut the ray
    naive: bool = False  # clips leave out samples
    parts: str | None = None  # clips cut segments, as ``partial`` does
    labels: type | None = None  # of the states as they are stored, where labels say which transfer function holds

    def Struct(self, real):
        return _make_struct(self.volumes, self.labels or wp.uint8, real)

    @property
    def any(self) -> bool:
        """Whether a ray is marched in stretches."""
        return self.clipped or self.labels is not None

    @property
    def used(self) -> bool:
        """Whether there are any clips or labels."""
        return self.any or self.naive or self.parts is not None


@cache
def _make_struct(volumes, labels, real):
    _, Clipping = make_clipping(volumes)
    Labels = make_labels(labels, real)

    @wp.struct
    class CutsStruct:
        clipping: Clipping
        labels: Labels

    return CutsStruct


@cache
def make_span(halves):
    """``span(scene, origin, direction, t, length)`` -> the transfer function that holds from t on, negative where
    nothing is visible; until where: more than t, at most ``length``; and of a march that is ``bounded`` the length of
    that in which it may be another one.
    """
    Scene = halves.Scene
    cuts = halves.cuts
    clipped = cuts.clipped
    labelled = cuts.labels is not None
    clip_span = make_clip_span(cuts.kinds, cuts.volumes, halves.march.bounded)
    label_span = make_label_span(cuts.labels or wp.uint8, halves.real, halves.march.bounded)

    @wp.func
    def span(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64):
        state = int(0)
        until = length
        # What begins right behind t is not looked for.
        loose = ahead(t) - t
        if wp.static(clipped):
            visible, until, unsure = clip_span(scene.cuts.clipping, origin, direction, t, length)
            state = wp.where(visible, 0, -1)
            loose += unsure
        if wp.static(labelled):
            if state >= 0:
                state, until, unsure = label_span(scene.cuts.labels, origin, direction, t, until, scene.view.astray)
                loose += unsure
                if state >= scene.cuts.labels.transfers.shape[0]:
                    state = -1
        return state, until, loose

    return span


@cache
def make_stretches(halves):
    """A march, as of ``scene``, of a ray that is cut: each stretch is marched, and is seen through those in front."""
    Scene = halves.Scene
    cuts = halves.cuts
    march = halves.march.march(halves)
    bounded = halves.march.bounded
    span = make_span(halves)
    near_surfaces = make_near_surfaces(cuts.kinds, cuts.volumes)
    cut_normal = make_cut_normal(cuts.kinds, cuts.volumes)
    lit = halves.light is not None and cuts.clipped
    leaves = halves.leaves

    @wp.func
    def stretches(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, start: wp.float64, stop: wp.float64):
        one = wp.float64(1.0)
        ray = wp.vec4d()
        count = int(0)
        bound = wp.float64(0.0)
        opaque = scene.opaque
        if wp.static(not halves.brick):
            scene.whole = stop - start
        if wp.static(bounded):
            # That a piece may change a channel by, in parts of its opacity.
            most = scene.march.brightest + scene.march.tinted
            if wp.static(cuts.clipped):
                loose = near_surfaces(scene.cuts.clipping, origin, direction, start, stop)
                bound = most * wp.min(one, scene.march.densest * loose)
        t = start
        while t < stop and ray[3] <= opaque:
            state, until, loose = span(scene, origin, direction, t, stop)
            clear = one - ray[3]
            if wp.static(bounded):
                bound += clear * most * wp.min(one, scene.march.densest * loose)
            if state >= 0:
                if wp.static(cuts.labels is not None):
                    scene.transfer = scene.cuts.labels.transfers[state]
                    if wp.static(halves.march.tabled):
                        scene.table = scene.cuts.labels.tables[state]
                scene.opaque = one - (one - opaque) / wp.max(clear, wp.float64(1.0e-300))
                if wp.static(lit):
                    reach = wp.float64(1.0e-6) * scene.view.unit
                    point = origin + t * direction
                    scene.light.cut = cut_normal(scene.cuts.clipping, scene.view.to_index, point, reach)
                    scene.light.cut_point = point
                if wp.static(halves.traced):
                    scene.trace.front = ray
                stretch, number, error = march(scene, origin, direction, t, until)
                if wp.static(leaves):
                    if error >= LEAVE:
                        # However little of it is seen, all of the ray is left to another launch.
                        return ray, count, error
                bound += clear * error
                scene.stretch += 1
                if wp.static(halves.traced):
                    steps = scene.trace
                    while steps.taken < steps.steps.shape[0] and steps.steps[steps.taken].length > wp.float64(0.0):
                        steps.taken += 1
                    scene.trace.taken = steps.taken
                ray = over(ray, stretch)
                count += number
                if wp.static(bounded):
                    if ray[3] > opaque and one - stretch[3] >= one - scene.opaque:
                        # By rounding of the sum alone, so that the march has not counted what is behind.
                        bound += (one - ray[3]) * scene.march.brightest
            t = until
        return ray, count, bound

    return stretches
