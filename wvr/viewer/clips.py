"""A plane, a box and a ball that cut, as their users set them: in parts of the volume's box along the world's axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cuts.base import Clip
from ..cuts.shapes import ClipBox, ClipPlane, ClipSphere
from ..validation import finite_vector

Floats = NDArray[np.float64]
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


def clips_of(settings: Settings, corners: Floats) -> list[Clip]:
    """The clips that are on, in the world, of a volume with these corners."""
    clips: list[Clip] = []
    plane, box, sphere = (settings[kind] for kind in ("plane", "box", "sphere"))
    if plane["on"]:
        point, normal = plane_of(plane, corners)
        clips.append(ClipPlane(point.tolist(), normal.tolist(), invert=plane["invert"]))
    if box["on"]:
        lo, hi = box_of(box, corners)
        clips.append(ClipBox(lo.tolist(), hi.tolist(), invert=box["invert"]))
    if sphere["on"]:
        center, radius = sphere_of(sphere, corners)
        clips.append(ClipSphere(center.tolist(), radius, invert=sphere["invert"]))
    return clips


def plane_of(plane: dict[str, Any], corners: Floats) -> tuple[Floats, Floats]:
    """A point of the plane, on the normal through the volume's middle, and the unit normal."""
    normal = finite_vector(plane["normal"], "normal", "of a plane")
    if not np.any(normal):
        raise ValueError("normal must not be zero")
    normal = normal / np.linalg.norm(normal)
    along = corners @ normal
    # 0 keeps all, 1 nothing.
    at = along.min() + plane["at"] * np.ptp(along)
    middle = corners.mean(axis=0)
    return middle + (at - middle @ normal) * normal, normal


def box_of(box: dict[str, Any], corners: Floats) -> tuple[Floats, Floats]:
    """The lower and the upper corner."""
    low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    lo = np.clip(box["lo"], 0, 1 - THIN)
    hi = np.maximum(np.clip(box["hi"], 0, 1), lo + THIN)
    return low + lo * extent, low + hi * extent


def sphere_of(sphere: dict[str, Any], corners: Floats) -> tuple[Floats, float]:
    """Centre and radius."""
    low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    return low + np.array(sphere["center"]) * extent, max(sphere["radius"], THIN) * reach(corners)


def reach(corners: Floats) -> float:
    """The radius of the ball around the volume's box: that of a setting of 1."""
    return float(np.linalg.norm(np.ptp(corners, axis=0))) / 2
