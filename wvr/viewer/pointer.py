"""What a mouse and keys do to a camera: those of VTK's trackball, and of PyVista where there are some."""

from __future__ import annotations

from typing import Any

from ..camera import Camera
from . import trackball

# Pixels that an arrow key is worth, in parts of the picture; and notches of the zoom.
STEP = 0.05
# A wheel's delta a notch.
DELTA = 100.0
ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}


class Pointer:
    """Where a button went down and how far the pointer has come since.

    Events are those of rendercanvas: x and y in logical pixels, buttons 1 (left), 2 (right) and 3 (middle).
    """

    def __init__(self) -> None:
        self._at: tuple[float, float] | None = None
        self._button = 0

    @property
    def down(self) -> bool:
        """Whether a button is held."""
        return self._at is not None

    def press(self, event: dict[str, Any]) -> None:
        self._at, self._button = (float(event["x"]), float(event["y"])), int(event["button"])

    def release(self) -> None:
        self._at = None

    def move(self, camera: Camera, event: dict[str, Any], size: tuple[int, int]) -> Camera:
        """The camera after a drag: the left button turns; with control it spins, with shift, as the middle one, it
        pans; with both, as the right one, it zooms. ``size`` is in logical pixels.
        """
        if self._at is None:
            return camera
        before, self._at = self._at, (float(event["x"]), float(event["y"]))
        dx, dy = self._at[0] - before[0], self._at[1] - before[1]
        modifiers = set(event.get("modifiers", ()))
        shift, control = "Shift" in modifiers, bool({"Control", "Meta"} & modifiers)
        if self._button == 2 or (self._button == 1 and shift and control):
            return trackball.drag(camera, dy, size)
        if self._button == 3 or (self._button == 1 and shift):
            return trackball.pan(camera, dx, dy, size)
        if self._button == 1 and control:
            return trackball.spin(camera, before, self._at, size)
        return trackball.rotate(camera, dx, dy, size) if self._button == 1 else camera


def wheel(camera: Camera, event: dict[str, Any]) -> Camera:
    """Nearer as the wheel turns away from its user."""
    return trackball.zoom(camera, -2 * float(event["dy"]) / DELTA)


def arrow(camera: Camera, key: str, shift: bool, size: tuple[int, int]) -> Camera:
    """Arrows turn, with shift they pan."""
    dx, dy = (STEP * step * length for step, length in zip(ARROWS[key], size, strict=True))
    return (trackball.pan if shift else trackball.rotate)(camera, dx, dy, size)
