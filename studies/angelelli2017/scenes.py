"""The scenes of the paper's Figure 5, or stand-ins: what is shown, from where, in which light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import wvr

from ..base import scenes

SIZE = 512  # of the paper

# (volume, control points, direction towards the camera, up), in the order of the paper's Figure 5.
SCENES: dict[str, tuple[str, list, tuple, tuple]] = {
    "bonsai": (
        "bonsai",
        [(38, (0.1, 0.35, 0.05), 0.0), (50, (0.25, 0.6, 0.1), 0.5), (95, (0.5, 0.4, 0.15), 0.7), (140, "peru", 0.9)],
        (0.3, 0.3, 1),
        (0, 1, 0),
    ),
    "head, skin": (
        "cthead",
        [(350, "peachpuff", 0.0), (700, "peachpuff", 0.6), (1300, "ivory", 0.9)],
        (-0.6, -1, -0.15),
        (0, 0, -1),
    ),
    "head, bone": (
        "cthead",
        [(800, "salmon", 0.0), (1050, "salmon", 0.03), (1200, "ivory", 0.05), (1350, "ivory", 0.8)],
        (-0.6, -1, -0.15),
        (0, 0, -1),
    ),
    "abdomen": (
        "stent",
        [(180, "firebrick", 0.0), (260, "firebrick", 0.25), (420, "ivory", 0.5), (800, "white", 0.9)],
        (0.25, 1, 0.1),
        (0, 0, 1),
    ),
    "ultrasound": (
        "heart",
        [(62, "darkred", 0.0), (75, "salmon", 0.3), (160, "mistyrose", 0.5)],
        (0.25, -1, 0.35),
        (0, 0, 1),
    ),
}


@dataclass(frozen=True)
class Scene:
    """What is shown, and from where."""

    name: str
    volume: wvr.Volume
    tf: wvr.TransferFunction
    direction: tuple[float, float, float]
    up: tuple[float, float, float]
    size: int

    def camera(self, turn: float = 0.0, parallel: bool = False) -> wvr.Camera:
        """Turned about the upward axis [radians]."""
        axis = np.array(self.up, float)
        d = np.array(self.direction, float)
        turned = d * np.cos(turn) + np.cross(axis, d) * np.sin(turn) + axis * (axis @ d) * (1 - np.cos(turn))
        if parallel:
            return wvr.Camera.fit(self.volume, turned, self.up, parallel=True)
        return wvr.Camera.fit(self.volume, turned, self.up, view_angle=20.0)


def make_scene(name: str, quick: bool, size: int | None = None) -> Scene:
    """A scene of the paper or its stand-in; ``quick``: a small stand-in."""
    source, points, direction, up = SCENES[name]
    if source == "heart":
        data = wvr.datasets.load("heart", 32 if quick else 192).numpy()
        # Cropped as a sonographer does, to look into the ventricles.
        volume = wvr.Volume(np.ascontiguousarray(data[:, data.shape[1] // 2 :]))
    else:
        volume = scenes.load(source, quick)
        if quick or not scenes.is_there(source):
            points = scenes.stretched(points, (0, 1.1 * points[-1][0]), volume)
    return Scene(name, volume, wvr.TransferFunction(points), direction, up, 32 if quick else size or SIZE)


def key_light(camera: wvr.Camera) -> wvr.DirectionalLight:
    """From the viewer's upper left."""
    right, up, forward = camera.basis()
    return wvr.DirectionalLight(tuple(up - right - 1.8 * forward))
