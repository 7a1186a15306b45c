"""What cuts and labels cost: frames of one scene with and without them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import wvr
from studies.base.harness import Result, Row, Settings, bars, integrator_name, interleave, machine, summarize, timed
from studies.base.scenes import make_scene

BASELINE = "none"
INTEGRATORS = (wvr.Certified(1 / 512), wvr.Preintegrated(0.5))


def measure(settings: Settings) -> Result:
    """Seconds a frame and pieces or segments a ray."""
    scene = make_scene("Bonsai", settings.quick)
    camera = wvr.Camera.fit(scene.volume)
    size = (48, 48) if settings.quick else (512, 512)
    rows: list[Row] = []
    for integrator in INTEGRATORS:
        renderers = {
            name: wvr.Renderer(scene.volume, scene.transfer_function, integrator=integrator, device="cpu", **options)
            for name, options in cuts(scene.volume, scene.transfer_function).items()
        }
        samples = {name: float(r.render(camera, size).samples.mean()) for name, r in renderers.items()}
        contenders = {name: timed(partial(r.render, camera, size)) for name, r in renderers.items()}
        measured = summarize(integrator_name(integrator), interleave(contenders, settings.rounds), BASELINE)
        rows += [replace(row, extra={"samples per ray": samples[row.name]}) for row in measured]
    notes = [
        "Two labels have transfer functions that differ by a thousandth of their opacity: halves of the volume, layers "
        "four voxels thick, and what is below and above the middle of the scalars' range.",
        "The clip volume is a ball on a grid of its own, 64 x 64 x 64.",
    ]
    title = f"Cuts and labels on the CPU: {size[0]} x {size[1]} pixels of Bonsai"
    return Result("clipping", title, BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {"clipping": bars(result, lambda row: (row.wall, row.fastest, row.slowest), "Seconds a frame")}


def cuts(volume: wvr.Volume, tf: wvr.TransferFunction) -> dict[str, dict[str, Any]]:
    """Options of the renderer by what they do."""
    low, high = volume.corners.min(axis=0), volume.corners.max(axis=0)
    middle, edge = (low + high) / 2, high - low
    k, j, i = np.indices((64, 64, 64)) / 63 - 0.5
    ball = wvr.Volume(np.clip(255 - 255 * np.sqrt(i * i + j * j + k * k), 0, 255).astype(np.uint8), edge / 63, low)
    other = wvr.TransferFunction.from_arrays(tf.knots, tf.colors, 0.999 * tf.opacities, tf.unit_distance)
    functions = {0: tf, 1: other}
    half, layers = np.zeros((2, *volume.shape), np.uint8)
    half[..., volume.shape[2] // 2 :] = 1
    layers[np.arange(volume.shape[0]) // 4 % 2 == 1] = 1
    by_scalar = (volume.numpy() > np.mean(volume.range)).astype(np.uint8)
    return {
        "none": {},
        "plane that keeps all": {"clip": wvr.ClipPlane(low - edge, edge)},
        "plane through the middle": {"clip": wvr.ClipPlane(middle, (1, 0.3, 0.2))},
        "clip volume": {"clip": wvr.ClipVolume(ball, 127.5)},
        "two labels, halves": {"segmentation": wvr.Segmentation(half, functions)},
        "two labels, layers": {"segmentation": wvr.Segmentation(layers, functions)},
        "two labels, by scalar": {"segmentation": wvr.Segmentation(by_scalar, functions)},
    }
