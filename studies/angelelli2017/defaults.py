"""Shadows as users have them: stripes and errors at the default, what it costs, and a new volume each frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np

import wvr

from ..base import scenes
from ..base.rows import spread, write_rows
from ..lighting import panels
from .aliasing import aliasing, moved
from .methods import STUDY, threads
from .scenes import SCENES, SIZE, Scene, key_light, make_scene


@STUDY.part("Default shadows")
def default(folder: Path, quick: bool) -> str:
    """Stripes at the default and how far it is from what it converges to, beside cells of one and light at the front of
    slices; that cells blur fine shading counts as aliasing here, but not in what changes where slices, cells and parts
    are moved by half.
    """
    front = {"slice_distance": 1.0, "preintegrated": False, "received": "front", "splitting": "lie"}
    settings: dict[str, dict[str, Any]] = {
        "default": {},
        "cells of 1": {"cell": 1.0},
        "front of slices 1 apart": front,
    }
    rows: list[dict[str, Any]] = []
    images = {}
    for name in SCENES:
        scene = make_scene(name, quick)
        camera, size = scene.camera(), (scene.size, scene.size)
        sweep = wvr.ConvolutionShadows(light=key_light(camera))
        renderer = wvr.Renderer(scene.volume, scene.tf, shadows=replace(sweep, slice_distance=0.5, cell=0.5))
        fine = renderer.render(camera, size)
        for setting, given in settings.items():
            renderer.shadows = replace(sweep, **given)
            renderer.render(camera, (8, 8))
            start = process_time()
            image = renderer.render(camera, size)
            spent = process_time() - start
            difference = np.abs(image.rgba - fine.rgba)[fine.rgba[..., 3] > 0]
            rows.append({"shadows": setting, "scene": name, "aliasing": aliasing(image, fine)})
            rows[-1] |= {"mean difference": float(difference.mean()), "processor s": spent}
            half_part = 0.5 / renderer.shadows.parts
            for what, way in {
                "slices": (0.5, 0.0),
                "cells": (0.0, 0.5),
                "parts": (half_part, 0.0),
                "all": (0.5 + half_part, 0.5),
            }.items():
                with moved(*way):
                    rows[-1][f"moved: {what}"] = 0.5 * aliasing(renderer.render(camera, size), image)
            if name == "bonsai" and setting != "cells of 1":
                images[setting] = image, f"aliasing {rows[-1]['aliasing']:.3f}"
        if name == "bonsai":
            images["fine"] = fine, "slices 0.5 apart, cells of 0.5"
    write_rows(folder, "default", f"Default shadows, {SIZE} x {SIZE}, {threads()}", rows)
    panels(folder, "default", images)
    panels(folder, "default-closeup", images, zoom=3)

    def found(column: str) -> str:
        return ", ".join(f"{spread([r[column] for r in rows if r['shadows'] == s])} ({s})" for s in settings)

    return f"Aliasing: {found('aliasing')}; of that what changes where all is moved: {found('moved: all')}."


@STUDY.part("What shadows cost")
def cost(folder: Path, quick: bool) -> str:
    """The image with shadows against that without, and plain sampling, in one run."""
    volume, size = scenes.load("bonsai", quick), (32, 32) if quick else (SIZE, SIZE)
    points = [(38, "black", 0.0), (45, "green", 0.01), (80, "orange", 0.05), (160, "sienna", 0.3), (255, "white", 0.6)]
    tf = wvr.TransferFunction(scenes.stretched(points, (0, 255), volume))
    camera = scenes.camera("bonsai", volume)
    sweep = wvr.ConvolutionShadows(light=wvr.DirectionalLight((-1, 1.2, 1)))
    settings: dict[str, dict[str, Any]] = {
        "default": {},
        "cells of 1": {"cell": 1.0},
        "slices 2 apart": {"slice_distance": 2.0},
        "headlight": {"light": wvr.Headlight()},
    }
    shadows = {name: replace(sweep, **given) for name, given in settings.items()}
    sampled = wvr.Renderer(volume, tf, integrator=wvr.Riemann(0.5), skip_empty=False)
    renderers = {"none": wvr.Renderer(volume, tf), "none, Riemann(0.5) without skipping": sampled}
    renderers |= {name: wvr.Renderer(volume, tf, shadows=one) for name, one in shadows.items()}
    times: dict[str, list[float]] = {name: [] for name in renderers}
    for _ in range(2 if quick else 8):
        for name, renderer in renderers.items():
            # Of the processor, which others may share: of all threads together.
            start = process_time()
            renderer.render(camera, size)
            times[name].append(process_time() - start)
    rows: list[dict[str, Any]] = []
    for name, renderer in renderers.items():
        rows.append({"shadows": name, "s": median(times[name][1:])})
        rows[-1]["times"] = rows[-1]["s"] / rows[0]["s"]
        if renderer.shadows is not None:
            fine = wvr.Renderer(
                volume, tf, shadows=replace(renderer.shadows, slice_distance=0.5, subsamples=1, cell=0.5)
            )
            error = np.abs(renderer.render(camera, size).rgba - fine.render(camera, size).rgba)
            rows[-1]["mean difference"] = float(error[..., :3].mean())
    write_rows(folder, "cost", f"What shadows cost: Bonsai, {size[0]} x {size[1]}, {threads()}", rows)
    usual = next(row for row in rows if row["shadows"] == "default")
    return (
        f"Default shadows take {usual['times']:.1f} times the certified image without, in all {usual['s']:.2g} s of "
        f"the processor (Riemann(0.5) without skipping {rows[1]['s']:.2g} s); mean difference "
        f"{usual['mean difference']:.1e}."
    )


@STUDY.part("A new volume each frame")
def streaming(folder: Path, quick: bool) -> str:
    """A beating heart: what a frame costs, and what is built for it."""
    size, n, frames = (32, 32, 3) if quick else (SIZE, 128, 20)
    tf = wvr.TransferFunction(SCENES["ultrasound"][1])
    renderer = None
    rows, images = [], {}
    for frame in range(frames):
        data = wvr.datasets.load("heart", n, phase=frame / frames).numpy()
        volume = wvr.Volume(np.ascontiguousarray(data[:, n // 2 :]))
        if renderer is None:
            scene = Scene("ultrasound", volume, tf, *SCENES["ultrasound"][2:], size)
            shadows = wvr.ConvolutionShadows(light=key_light(scene.camera()))
            renderer = wvr.Renderer(volume, tf, integrator=wvr.Preintegrated(1.0), shadows=shadows)
        renderer.volume = volume
        before = renderer.builds.copy()
        image = renderer.render(scene.camera(), (size, size))
        built = ", ".join(sorted(part for part, count in (renderer.builds - before).items() if count))
        rows.append({"frame": frame, "ms": 1e3 * image.stats["seconds"], "built": built})
        if frame % -(-frames // 5) == 0:
            images[f"frame {frame} of {frames}"] = image, f"{rows[-1]['ms']:.0f} ms"
    write_rows(folder, "streaming", f"A new volume each frame, {size} x {size}, {threads()}", rows)
    panels(folder, "streaming", images)
    later = [row["ms"] for row in rows[1:]]
    return f"A frame takes {min(later):.0f} to {max(later):.0f} ms; built for it: {rows[-1]['built']}."
