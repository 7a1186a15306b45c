"""A plane, a box and a ball that cut, as sliders set them: in parts of the volume's box along the world's axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cuts.base import Clip
from ..cuts.shapes import ClipBox, ClipPlane, ClipSphere
from ..validation import finite_vector

Settings = dict[str, dict[str, Any]]
# Off, and what they are when they are switched on: each cuts away a half, or what is outside of the middle.
DEFAULTS: Settings = {
    "plane": {"on": False, "normal": [0.0, -1.0, 0.0], "at": 0.5, "invert": False},
    "box": {"on": False, "lo": [0.0, 0.0, 0.0], "hi": [1.0, 1.0, 0.5], "invert": False},
    "sphere": {"on": False, "center": [0.5, 0.5, 0.5], "radius": 0.5, "invert": False},
}
# A box is at least so thick.
THIN = 1e-3


def updated(settings: Settings, kind: str, changes: dict[str, Any]) -> Settings:
    """With some numbers of one kind changed.

    Raises
    ------
    ValueError
        For a kind or name that is not there, or a value of another sort.
    """
    if kind not in settings:
        raise ValueError(f"clip must be one of {', '.join(settings)}, got {kind!r}")
    now = dict(settings[kind])
    for name, value in changes.items():
        if name not in now:
            raise ValueError(f"clip {kind} has {', '.join(now)}, got {name!r}")
        old = now[name]
        if isinstance(old, bool):
            now[name] = bool(value)
        elif isinstance(old, list):
            now[name] = finite_vector(value, name, "of a clip").tolist()
        else:
            now[name] = float(np.clip(float(value), 0.0, 1.0))
    return settings | {kind: now}


def clips_of(settings: Settings, corners: NDArray[np.float64]) -> list[Clip]:
    """The clips that are on, in the world, of a volume with these corners."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    clips: list[Clip] = []
    plane, box, sphere = (settings[kind] for kind in ("plane", "box", "sphere"))
    if plane["on"]:
        normal = finite_vector(plane["normal"], "normal", "of a plane")
        if not np.any(normal):
            raise ValueError("normal must not be zero")
        normal /= np.linalg.norm(normal)
        along = corners @ normal
        # The point of the middle's normal line; 0 keeps all, 1 nothing.
        middle = (low + high) / 2
        at = along.min() + plane["at"] * np.ptp(along)
        point = middle + (at - middle @ normal) * normal
        clips.append(ClipPlane(point.tolist(), normal.tolist(), invert=plane["invert"]))
    if box["on"]:
        lo = np.clip(box["lo"], 0, 1 - THIN)
        hi = np.maximum(np.clip(box["hi"], 0, 1), lo + THIN)
        extent = high - low
        clips.append(ClipBox((low + lo * extent).tolist(), (low + hi * extent).tolist(), invert=box["invert"]))
    if sphere["on"]:
        center = low + np.array(sphere["center"]) * (high - low)
        radius = max(sphere["radius"], THIN) * float(np.linalg.norm(high - low)) / 2
        clips.append(ClipSphere(center.tolist(), radius, invert=sphere["invert"]))
    return clips
