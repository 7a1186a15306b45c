"""Volumes as the studies see them: by name, with the direction that shows them best, and a stand-in for each scan.

The scans and simulations are NRRD files in the folder ``WVR_DATA``, by default ``../shared/data`` beside the
checkout.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import wvr
from wvr.color import linear_to_srgb
from wvr.integrators import Integrator

DATA = Path(os.environ.get("WVR_DATA", Path(__file__).parents[2] / "../shared/data"))

Direction = tuple[float, float, float]


class Source(NamedTuple):
    """A scan: the generated volume that stands in for it, the direction towards the camera, and up."""

    stand_in: str
    direction: Direction
    up: Direction


SCANS = {
    "aneurism": Source("tree", (1, 0.6, 0.4), (0, 0, 1)),
    "bluntfin": Source("turbulence", (-0.6, 0.55, 0.65), (0, 1, 0)),
    "bonsai": Source("tree", (0.35, 0.25, 1), (0, 1, 0)),
    "bucky": Source("blobs", (0.5, 0.7, 1), (0, 1, 0)),
    "cthead": Source("spheres", (0.4, -1, -0.2), (0, 0, -1)),
    "engine": Source("blobs", (0.8, -0.7, -0.6), (0, 0, -1)),
    "neghip": Source("blobs", (0.5, 0.3, 1), (0, 1, 0)),
    "stent": Source("gyroid", (0.25, 1, 0.1), (0, 0, 1)),
    "teapot": Source("spheres", (0.25, -0.45, -1), (0, -1, 0)),
}
GENERATED: dict[str, tuple[Direction, Direction]] = {
    "blobs": ((1, 0.6, 0.4), (0, 0, 1)),
    "marschner_lobb": ((1, 0.6, 0.4), (0, 0, 1)),
    "tree": ((1, 0.5, 0.35), (0, 0, 1)),
    "turbulence": ((1, 0.6, 0.4), (0, 0, 1)),
}

Points = Sequence[tuple[float, Any, float]]


def is_there(name: str) -> bool:
    """Whether the scan itself is there."""
    return (DATA / f"{name}.nrrd").exists()


def load(name: str, quick: bool = False, size: int = 192) -> wvr.Volume:
    """A scan, or its stand-in with ``size`` samples along an axis; ``quick``: a small stand-in."""
    if is_there(name) and not quick:
        return wvr.read(DATA / f"{name}.nrrd")
    return wvr.datasets.load(SCANS[name].stand_in, 32 if quick else size)


def camera(name: str, volume: wvr.Volume, view_angle: float = 30.0) -> wvr.Camera:
    """In the volume's best direction, as far away as shows all of it at 30 degrees."""
    direction, up = GENERATED[name] if name in GENERATED else SCANS[name][1:]
    fit = wvr.Camera.fit(volume, direction=direction, up=up)
    return wvr.Camera(fit.position, fit.target, up=up, view_angle=view_angle)


def stretched(points: Points, span: tuple[float, float], volume: wvr.Volume) -> list[tuple[float, Any, float]]:
    """Control points for scalars that fill ``span``, as they are for a volume whose own fill its range."""
    low, high = volume.range
    scale = (high - low) / (span[1] - span[0])
    return [(low + (s - span[0]) * scale, color, opacity) for s, color, opacity in points]


@dataclass(frozen=True)
class Scene:
    """A volume, how to see it, and from where; ``size`` is that of the image in pixels."""

    name: str
    volume: wvr.Volume
    transfer_function: wvr.TransferFunction
    camera: wvr.Camera
    size: tuple[int, int]

    @property
    def label(self) -> str:
        """Name and projection."""
        return f"{self.name} {'parallel' if self.camera.parallel else 'perspective'}"

    @property
    def measures(self) -> str:
        """Sizes of image and volume."""
        nx, ny, nz = self.volume.dimensions
        return f"{self.size[0]} x {self.size[1]} pixels of {nx} x {ny} x {nz} {self.volume.dtype}"

    def renderer(self, integrator: Integrator, **options: Any) -> wvr.Renderer:
        """One that keeps what it builds; ``options`` are those of :class:`wvr.Renderer`."""
        return wvr.Renderer(self.volume, self.transfer_function, integrator=integrator, **options)

    def render(self, integrator: Integrator, **options: Any) -> wvr.Image:
        """Its image."""
        return self.renderer(integrator, **options).render(self.camera, self.size)

    def timed(self, integrator: Integrator, rounds: int = 2, **options: Any) -> wvr.Image:
        """The image of the fastest of some rounds, kernels and tables being built; ``processor_s`` of its ``stats`` are
        seconds of the processor, of all threads together.
        """
        renderer = self.renderer(integrator, **options)
        renderer.render(self.camera, (8, 8))
        images = [processor_timed(renderer, self) for _ in range(rounds)]
        return min(images, key=lambda image: image.stats["processor_s"])


def processor_timed(renderer: wvr.Renderer, scene: Scene) -> wvr.Image:
    """A scene's image, whose ``stats`` have its ``processor_s``: seconds of the processor, of all threads together."""
    start = process_time()
    image = renderer.render(scene.camera, scene.size)
    image.stats["processor_s"] = process_time() - start
    return image


# Control points of Campagnolo et al. 2015, in the order of its tables. Its scenes are benchmarks, too.
SCENES: dict[str, Points] = {
    "BluntFin": [
        (0.35, (0, 0, 0.6), 0.0),
        (0.75, (0, 0.1, 1), 0.05),
        (1.0, (0, 0.2, 1), 0.03),
        (1.3, (0, 0.8, 0.5), 0.06),
        (1.7, (0.2, 0.9, 0), 0.15),
        (2.3, (1, 0.8, 0), 0.4),
        (3.2, (1, 0.2, 0), 0.6),
        (4.9, (1, 0, 0), 0.8),
    ],
    "Bonsai": [
        (10, (0, 0.5, 0), 0.0),
        (60, (0.1, 0.7, 0), 0.2),
        (110, (0.6, 0.3, 0), 0.2),
        (170, (0.7, 0.3, 0), 0.6),
        (255, (0.9, 0.4, 0), 0.8),
    ],
    "Teapot": [
        (30, (0.6, 0.1, 0), 0.0),
        (52, (0.9, 0.2, 0.1), 0.15),
        (75, (0.8, 0.3, 0.1), 0.03),
        (95, (0.7, 0.6, 0.3), 0.02),
        (125, (1, 0.8, 0.4), 0.12),
        (150, (1, 0.9, 0.7), 0.3),
    ],
    "Engine": [
        (80, (0.2, 0.3, 0.6), 0.0),
        (140, (0.4, 0.5, 0.8), 0.04),
        (175, (0.5, 0.5, 0.6), 0.03),
        (195, (0.9, 0.6, 0.2), 0.03),
        (220, (1, 0.5, 0.1), 0.4),
        (255, (1, 0.8, 0.4), 0.6),
    ],
}


@cache
def make_scene(name: str, quick: bool) -> Scene:
    """A scene of Campagnolo et al. 2015 or, where its volume is not there, its stand-in."""
    stem, points = name.lower(), SCENES[name]
    volume = load(stem, quick)
    if quick or not is_there(stem):
        points = stretched(points, (points[0][0], points[-1][0]), volume)
    size = (80, 60) if quick else (800, 600)
    return Scene(name, volume, wvr.TransferFunction(points), camera(stem, volume, view_angle=20.0), size)


def picture(image: wvr.Image) -> NDArray[np.floating]:
    """As screens show it, before white."""
    return np.clip(linear_to_srgb(image.composited("white")), 0, 1)
