"""Frames with a camera that moves: S1 to S3 and the papers' volumes, beside VTK's ray caster for GPUs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

import wvr
from benchmarks.scenes import transfer_functions
from studies.base.peer import NotAvailableError
from studies.base.scenes import SCENES, Scene, is_there, make_scene
from studies.base.vtk_cpu import VtkGpu
from wvr.integrators import Integrator

from .day import Day, Row, Work
from .parity import rays_of

INTEGRATORS: dict[str, Integrator] = {
    "Certified(1/512)": wvr.Certified(1 / 512),
    "Riemann(0.5)": wvr.Riemann(0.5),
    "Preintegrated(1)": wvr.Preintegrated(1.0),
}
# That of VTK, which has no bound to choose one by.
STEP = 0.5
# How often the camera moves on round the whole scene.
STEPS = 48
# Seconds of frames, after which there are enough, and how many there are at least.
ENOUGH, LEAST = 0.5, 3


def generated(day: Day) -> Work:
    """S1 to S3 of all sizes, the smallest first: of one size wvr and VTK, one after the other."""
    sides, widths = ([16, 24], [32]) if day.quick else ([256, 512, 1024], [512, 1024])
    functions = transfer_functions()
    for side in sides:
        volume = steady(wvr.datasets.load("blobs", side))
        for (name, tf), width in product(functions.items(), widths):
            scene = Scene(f"{name} {side}³ {width}²", volume, tf, wvr.Camera.fit(volume), (width, width))
            yield from contenders(day, scene, lit=name == "S1")


def papers(day: Day) -> Work:
    """The volumes of Campagnolo et al. 2015, or what stands in for them."""
    for name, width in product(SCENES, [32] if day.quick else [512, 1024]):
        made = make_scene(name, day.quick)
        whose = "" if is_there(name.lower()) and not day.quick else " (stand-in)"
        scene = replace(made, name=f"{name}{whose} {width}²", volume=steady(made.volume), size=(width, width))
        yield from contenders(day, scene, lit=False)


def steady(volume: wvr.Volume) -> wvr.Volume:
    """The same, whose samples nobody can write to: it need not be looked at before each frame."""
    samples = volume.numpy()
    samples.flags.writeable = False
    return wvr.Volume(samples, volume.spacing, volume.origin, volume.direction)


def contenders(day: Day, scene: Scene, lit: bool) -> Work:
    """Frames of a scene, a row for each way of making them; ratios are to VTK's."""
    vtk: dict[str, float] = {}
    yield f"{scene.name} VTK, step {STEP:g}", partial(of_vtk, scene, vtk)
    for name, integrator in INTEGRATORS.items():
        yield f"{scene.name} {name}", partial(of_wvr, day, scene, vtk, integrator=integrator)
    if lit:
        options: dict[str, Any] = {"integrator": INTEGRATORS["Certified(1/512)"], "lighting": wvr.Lighting()}
        yield f"{scene.name} Certified(1/512) lit", partial(of_wvr, day, scene, vtk, **options)


def of_wvr(day: Day, scene: Scene, vtk: dict[str, float], **options: Any) -> Row:
    """Frames by wvr: whole ones, with the image brought to the host; those whose image stays; and rays alone."""
    with rays_of(day.device):
        renderer = wvr.Renderer(scene.volume, scene.transfer_function, device=day.device, **options)
        start = perf_counter()
        renderer.render(scene.camera, scene.size)
        first = perf_counter() - start
        rays: list[float] = []
        stay: list[float] = []

        def frame(camera: wvr.Camera) -> object:
            begin = perf_counter()
            image = renderer.render(camera, scene.size)
            stay.append(perf_counter() - begin)
            rays.append(image.stats["seconds_raycast"])
            return image.rgba

        row = summed(moving(scene, frame))
    row |= {"stays [ms]": 1e3 * median(stay), "rays [ms]": 1e3 * median(rays), "first frame [s]": first}
    return row | ({"× VTK": row["frame [ms]"] / vtk["frame [ms]"]} if vtk else {})


def of_vtk(scene: Scene, found: dict[str, float]) -> Row:
    """Frames by VTK, the image brought to the host too; ``found`` gets the time where a GPU draws."""
    try:
        with VtkGpu(scene) as vtk:
            first = vtk.frame(STEP).wall
            drawn_by = vtk.renderer()
            row = summed(moving(scene, lambda camera: vtk.frame(STEP, camera)))
    except NotAvailableError as error:
        return {"not available": str(error)}
    found["frame [ms]"] = row["frame [ms]"]
    return row | {"first frame [s]": first, "drawn by": drawn_by}


def moving(scene: Scene, frame: Callable[[wvr.Camera], object]) -> list[float]:
    """Seconds of frames from cameras that go round a scene."""
    times: list[float] = []
    for camera in around(scene):
        start = perf_counter()
        frame(camera)
        times.append(perf_counter() - start)
        if sum(times) > ENOUGH and len(times) >= LEAST:
            break
    return times


def around(scene: Scene) -> Iterator[wvr.Camera]:
    """From as far as the scene's, about the axis that is up."""
    way, up = scene.camera.position - scene.camera.target, scene.camera.up / np.linalg.norm(scene.camera.up)
    for angle in np.arange(STEPS) * (2 * np.pi / STEPS):
        along = (way @ up) * up
        turned = along + np.cos(angle) * (way - along) + np.sin(angle) * np.cross(up, way)
        yield wvr.Camera(scene.camera.target + turned, scene.camera.target, up, scene.camera.view_angle)


def summed(times: list[float]) -> Row:
    """The median and the slowest."""
    return {
        "frame [ms]": 1e3 * median(times),
        "slowest [ms]": 1e3 * max(times),
        "frames a second": 1 / median(times),
        "frames": len(times),
    }
