"""Cameras that a panel asks for: of views by name, reset, and of another projection."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..camera import Camera
from ..cuts.labels import Segmentation
from ..defaults import framed_by
from ..field.base import Field
from ..framing import framed, visible_points
from ..integrators import Integrator
from ..validation import choice
from ..views import NAMES, View, named_view
from . import trackball
from .state import Presentation


def viewed(
    name: str, volume: Field, presentation: Presentation, labels: Segmentation | None, method: Integrator | None
) -> Camera:
    """A view by name with all that a ``method`` shows in the frame; ``"reset"`` is from where the camera is."""
    choice(name, "name", ("reset", *NAMES))
    camera = presentation.camera
    _, up, forward = camera.basis()
    view = View(-forward, up) if name == "reset" else named_view(name, volume)
    tf = presentation.transfer_function
    shown: Any = labels.for_volume(volume) if labels is not None else None if tf is None else framed_by(method, tf)
    found = visible_points(volume, shown, presentation.clips)
    aspect = presentation.size[0] / presentation.size[1]
    return framed(found, *view, view_angle=camera.view_angle, aspect=aspect, parallel=camera.parallel)


def zoomed(camera: Camera, notches: float) -> Camera:
    """Nearer by so many notches of a wheel."""
    return trackball.zoom(camera, 2 * notches)


def focused(camera: Camera, target: Sequence[float]) -> Camera:
    """Turning around a point, which comes to the middle."""
    return trackball.focus(camera, np.array(target))


def projected(camera: Camera, parallel: bool) -> Camera:
    """Orthographic or not; what is at the target keeps its size."""
    if parallel == camera.parallel:
        return camera
    distance = float(np.linalg.norm(camera.position - camera.target))
    position, target, up, angle = camera.position, camera.target, camera.up, camera.view_angle
    if parallel:
        return Camera(position, target, up, angle, distance * camera.half_height)
    scale = camera.parallel_scale
    assert scale is not None
    away = scale / float(np.tan(np.radians(angle) / 2))
    return Camera(target + (position - target) / distance * away, target, up, angle)
