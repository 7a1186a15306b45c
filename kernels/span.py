"""The stretches that clips and labels cut a ray into."""

from functools import cache

import warp as wp

from .clip import make_clip_span
from .label import make_label_span
from .scene import make_scene


@cache
def make_span(variant):
    """``span(scene, origin, direction, t, length)`` -> the transfer function that holds from t on, negative where
    nothing is visible, and until where: more than t, at most ``length``.
    """
    Scene = make_scene(variant)
    clipped = variant.clipped
    labelled = variant.labels is not None
    clip_span = make_clip_span(variant.clips or wp.uint8)
    label_span = make_label_span(variant.labels or wp.uint8, variant.precision)

    @wp.func
    def span(scene: Scene, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64):
        state = int(0)
        until = length
        if wp.static(clipped):
            visible, until = clip_span(scene.clipping, origin, direction, t, length)
            state = wp.where(visible, 0, -1)
        if wp.static(labelled):
            if state >= 0:
                state, until = label_span(scene.labels, scene.field.last, origin, direction, t, until)
                if state >= scene.labels.transfers.shape[0]:
                    state = -1
        return state, until

    return span
