"""How a mouse moves a camera: the trackball of VTK (vtkInteractorStyleTrackballCamera), as functions of cameras.

Pixels count to the right and downwards. Angles a pixel are VTK's: 200 degrees across the picture, whatever its size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera

Floats = NDArray[np.float64]
# Degrees that a drag across the picture turns.
TURN = 200.0
# A drag over half the picture's height is so many notches of a wheel, and a notch is that factor.
NOTCHES, NOTCH = 10.0, 1.1


def rotate(camera: Camera, dx: float, dy: float, size: tuple[int, int]) -> Camera:
    """Around the target: about the upward direction, and about that to the right."""
    width, height = size
    # VTK takes the two one after the other, and then makes the upward direction orthogonal again.
    azimuth, elevation = np.radians(-TURN / width * dx), np.radians(TURN / height * dy)
    about = _unit(camera.up)
    offset = _turned(camera.position - camera.target, about, azimuth)
    right = _unit(np.cross(-offset, about))
    offset = _turned(offset, right, -elevation)
    upward = np.cross(right, -_unit(offset))
    return _moved(camera, camera.target + offset, camera.target, upward)


def spin(camera: Camera, start: tuple[float, float], end: tuple[float, float], size: tuple[int, int]) -> Camera:
    """About the direction of view, by the angle between two places as seen from the middle of the picture."""
    middle = np.array(size) / 2
    before, after = np.array(start) - middle, np.array(end) - middle
    angle = np.arctan2(before[0] * after[1] - before[1] * after[0], before @ after)
    _, _, forward = camera.basis()
    return _moved(camera, camera.position, camera.target, _turned(camera.up, forward, -angle))


def pan(camera: Camera, dx: float, dy: float, size: tuple[int, int]) -> Camera:
    """Across the direction of view, such that what is in the plane of the target stays under the mouse."""
    right, up, _ = camera.basis()
    half = camera.half_height
    if not camera.parallel:
        half *= float(np.linalg.norm(camera.position - camera.target))
    step = 2 * half / size[1] * (dy * up - dx * right)
    return _moved(camera, camera.position + step, camera.target + step, camera.up)


def zoom(camera: Camera, notches: float) -> Camera:
    """Nearer to the target by so many notches of a wheel; an orthographic view shows less."""
    factor = NOTCH ** float(np.clip(notches, -100, 100))
    if camera.parallel_scale is not None:
        scale = camera.parallel_scale / factor
        return Camera(camera.position, camera.target, camera.up, camera.view_angle, scale)
    return _moved(camera, camera.target + (camera.position - camera.target) / factor, camera.target, camera.up)


def drag(camera: Camera, dy: float, size: tuple[int, int]) -> Camera:
    """Zoom by a drag: upwards is nearer."""
    return zoom(camera, -NOTCHES * dy / (size[1] / 2))


def focus(camera: Camera, target: Floats) -> Camera:
    """Turn around another target, which comes to the middle; the direction of view stays."""
    return _moved(camera, camera.position + (target - camera.target), target, camera.up)


def _moved(camera: Camera, position: Floats, target: Floats, up: Floats) -> Camera:
    try:
        return Camera(position, target, up, camera.view_angle, camera.parallel_scale)
    except ValueError:  # at the target, or along the upward direction: it stays
        return camera


def _turned(vector: Floats, axis: Floats, angle: float) -> Floats:
    """Rotated about a unit vector, by Rodrigues' formula."""
    across = np.cross(axis, vector)
    return vector * np.cos(angle) + across * np.sin(angle) + axis * (axis @ vector) * (1 - np.cos(angle))


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)
