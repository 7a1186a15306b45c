"""The methods that the paper compares, at a setting each, and the largest distance at which each is free of aliasing.

The paper's light is that at a slab's front, without splitting; its kernel is taken in proportion to the slice distance,
so that the distances of one row show one scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np

import wvr

from ..base.study import Study
from .aliasing import VISIBLE, aliasing, largest
from .scenes import Scene, key_light

STUDY = Study("angelelli2017")
PAPER = STUDY.paper
VIEWS = 6  # that times are means of; the paper has 100
DISTANCES = (0.25, 0.33, 0.5, 0.67, 1.0, 1.3, 1.5, 2.0, 3.0, 4.0)
SUBSAMPLES = (1, 2, 3, 4, 5)
FINE = 0.125


@dataclass(frozen=True)
class Method:
    """A contender of the paper at one setting: "ray cast", "Phong", "ICS", "SCS", "PI-ICS" or "PI-SCS"."""

    name: str
    distance: float
    subsamples: int = 0

    def renderer(self, scene: Scene, **shadows: Any) -> wvr.Renderer:
        """Ready to render; light is set with each view."""
        if self.name in ("ray cast", "Phong"):
            return wvr.Renderer(scene.volume, scene.tf, integrator=wvr.Riemann(self.distance))
        options: dict[str, Any] = {"splitting": "lie", "received": "front", "image": "slices", "cell": 1.0} | shadows
        sweep = wvr.ConvolutionShadows(self.distance, self.subsamples, self.name.startswith("PI"), **options)
        return wvr.Renderer(scene.volume, scene.tf, shadows=sweep)

    def render(
        self, scene: Scene, renderer: wvr.Renderer | None = None, turn: float = 0.0, **shadows: Any
    ) -> wvr.Image:
        """A view with the light that goes with it."""
        renderer = self.renderer(scene, **shadows) if renderer is None else renderer
        camera = scene.camera(turn)
        light = key_light(camera)
        if self.name == "Phong":
            renderer.lighting = wvr.Lighting(light=light)
        elif renderer.shadows is not None:
            renderer.shadows = replace(renderer.shadows, light=light)
        return renderer.render(camera, (scene.size, scene.size))

    def measured(self, scene: Scene, views: int) -> tuple[wvr.Image, float]:
        """The image, and the mean milliseconds of the processor, of all threads together, of a frame over viewpoints
        all around; what is kept is built before.
        """
        renderer = self.renderer(scene)
        self.render(replace(scene, size=8), renderer)
        start = process_time()
        images = [self.render(scene, renderer, 2 * np.pi * view / views) for view in range(views)]
        return images[0], 1e3 * (process_time() - start) / views

    def __str__(self) -> str:
        subsamples = f", {self.subsamples} subsample{'s' * (self.subsamples > 1)}" if self.subsamples else ""
        return f"{self.name} {self.distance:g}{subsamples}"


def reference(scene: Scene, name: str) -> wvr.Image:
    """A fine image of the same method, which stripes are judged by."""
    return (
        Method(name, FINE / 2).render(scene) if name in ("ray cast", "Phong") else Method("PI-ICS", FINE).render(scene)
    )


def converged(scene: Scene) -> wvr.Image:
    """What all slices converge to, itself: light at their front is not there yet where they are as near."""
    return Method("PI-ICS", FINE).render(scene, splitting="strang", received="traced")


def views_of(quick: bool) -> int:
    """Viewpoints that times are the mean of."""
    return 1 if quick else VIEWS


def threads() -> str:
    """For titles."""
    return f"{wvr.get_num_threads()} threads"


def errors_by_distance(
    scene: Scene, name: str, fine: wvr.Image, subsamples: int = 0, least: float = 0.0, every: bool = False
) -> list[tuple[Method, float]]:
    """Methods and their aliasing for growing distances, up to the first that shows it, or for all."""
    found: list[tuple[Method, float]] = []
    for distance in DISTANCES:
        if distance >= least:
            method = Method(name, distance, subsamples)
            found.append((method, aliasing(method.render(scene), fine)))
            if found[-1][1] > VISIBLE and not every:
                break
    return found


def coarsest(found: list[tuple[Method, float]]) -> Method | None:
    """At the largest distance without aliasing."""
    distance = largest([(method.distance, error) for method, error in found])
    return replace(found[0][0], distance=distance) if distance else None
