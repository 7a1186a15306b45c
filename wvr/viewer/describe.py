"""States as JSON, for a page to show and to give back after a lost connection."""

from __future__ import annotations

import json
from typing import Any

from ..camera import Camera
from ..preset_points import PRESETS
from ..views import PATIENT, WORLD
from .history import History
from .points import described
from .state import Source, State, lamp_of

Json = dict[str, Any]


def camera_json(camera: Camera) -> Json:
    """A camera, every digit."""
    return {
        "position": camera.position.tolist(),
        "target": camera.target.tolist(),
        "up": camera.up.tolist(),
        "view_angle": camera.view_angle,
        "parallel_scale": camera.parallel_scale,
    }


def source_json(source: Source) -> Json:
    """What a client needs to know once."""
    volume = source.first_volume
    heights, span = source.histogram
    anatomical = getattr(volume, "anatomical", "")
    return {
        "type": "source",
        "title": source.title,
        "about": " × ".join(map(str, volume.dimensions)) + f" {getattr(volume, 'dtype', 'field')}",
        "histogram": [round(height, 4) for height in heights.tolist()],
        "span": span,
        "spacing": volume.smallest_spacing,
        "frames": len(source.given_volumes),
        "views": [*WORLD, *(PATIENT if anatomical else ())],
        "suggestions": list(source.suggestions),
        "presets": list(PRESETS),
    }


def state_json(state: State, history: History[Any]) -> Json:
    """What a client shows of a state."""
    presentation, tf = state.presentation, state.presentation.transfer_function
    lighting, shadows = presentation.lights()
    return {
        "type": "state",
        "points": None if tf is None else described(tf),
        "unit": None if tf is None else tf.unit_distance,
        "function": None if tf is None else tf.to_json(),
        "history": history.depth,
        "clips": state.cuts,
        "lighting": lighting is not None,
        "shadows": shadows is not None,
        "lamp": presentation.lamp or lamp_of(lighting, presentation.camera),
        "placed": presentation.lamp is not None,
        "frame": presentation.frame,
        "bound": state.bound,
        "outline": state.outline,
        "parallel": presentation.camera.parallel,
        "camera": camera_json(presentation.camera),
    }


def dumps(message: Json) -> str:
    """As text, numbers exactly; those that are not finite, which JSON has not, do not occur."""
    return json.dumps(message, allow_nan=False, separators=(",", ":"))
