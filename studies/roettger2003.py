"""Roettger, Guthe, Weiskopf, Ertl and Strasser, "Smart Hardware-Accelerated Volume Rendering" (2003).

Over-sampling and adaptive pre-integration, Figures 4, 6, 7 and 9, the paper's claims and numbers beside what we find:
``python -m studies.roettger2003 [--quick]``. The volumes are the bonsai and the high-potential iron protein (NegHIP,
here 64^3, there 128^3) where they lie in ``../shared/data``, else generated ones stand in for them.

The paper's views and transfer functions are not published and its pictures are lit; ours are not, so that errors are
those of the integral alone, against ``Exact``. "Slicing" is ``Preintegrated`` with every sample computed.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

import wvr
from benchmarks.harness import COLORS, save_figure
from wvr.color import linear_to_srgb

from .common import output, write_rows
from .reference import trilinear

PAPER = json.loads((Path(__file__).parent / "data" / "roettger2003.json").read_text(encoding="utf-8"))
DATA = Path(__file__).parents[1] / "../shared/data"
VISIBLE = 1 / 256  # the step of an 8-bit screen, which an error should stay below
OVERSAMPLING = (1, 2, 4, 8)

# (volume, stand-in, direction towards the camera, up)
VOLUMES: dict[str, tuple[str, str, tuple, tuple]] = {
    "Bonsai": ("bonsai", "tree", (0.35, 0.25, 1), (0, 1, 0)),
    "NegHIP": ("neghip", "blobs", (0.5, 0.3, 1), (0, 1, 0)),
}
BONSAI = [
    (20, (0.1, 0.5, 0), 0.0),
    (40, (0.2, 0.7, 0.05), 0.04),
    (75, (0.5, 0.6, 0.1), 0.015),
    (115, (0.6, 0.35, 0.1), 0.05),
    (165, (0.7, 0.4, 0.2), 0.05),
    (255, (0.9, 0.6, 0.3), 0.3),
]
NEGHIP = [
    (15, (0, 0, 0.8), 0.0),
    (60, (0, 0.2, 1), 0.006),
    (120, (0, 0.8, 0.6), 0.01),
    (180, (1, 0.8, 0), 0.03),
    (255, (1, 0.1, 0), 0.1),
]
# Surfaces of changing colour.
LEAF = [
    (22, (0, 0.25, 0), 0.0),
    (30, (0.05, 0.5, 0), 0.5),
    (40, (0.9, 0.9, 0.1), 0.3),
    (50, (0.2, 0.7, 0.1), 0.6),
    (70, (0.7, 0.2, 0), 0.8),
    (255, (0.9, 0.6, 0.3), 0.9),
]
# Scene: (volume, control points, their unit distance: a tenth of it is ten times the extinction)
SCENES: dict[str, tuple[str, list, float]] = {
    "Bonsai, semi-transparent": ("Bonsai", BONSAI, 1.0),
    "Bonsai, opaque": ("Bonsai", BONSAI, 0.1),
    "Bonsai, leaf": ("Bonsai", LEAF, 1.0),
    "NegHIP, semi-transparent": ("NegHIP", NEGHIP, 1.0),
    "NegHIP, opaque": ("NegHIP", NEGHIP, 0.05),
}


@dataclass(frozen=True)
class Scene:
    """A volume as it is shown."""

    name: str
    volume: wvr.Volume
    tf: wvr.TransferFunction
    camera: wvr.Camera
    size: tuple[int, int]

    def render(self, integrator: Any, **options: Any) -> wvr.Image:
        return wvr.render(self.volume, self.tf, self.camera, self.size, integrator=integrator, **options)

    def timed(self, integrator: Any, rounds: int = 2, **options: Any) -> wvr.Image:
        """The image of the fastest of some rounds."""
        renderer = wvr.Renderer(self.volume, self.tf, integrator=integrator, **options)
        renderer.render(self.camera, (8, 8))  # kernels and tables are built
        images = [renderer.render(self.camera, self.size) for _ in range(rounds)]
        return min(images, key=lambda image: image.stats["seconds_raycast"])

    def slicing(self, oversampling: int, rounds: int = 2) -> wvr.Image:
        """Pre-integrated slabs, every one computed."""
        return self.timed(wvr.Preintegrated(1.0, oversampling), rounds, skip_empty=False, termination=0)


def make_scene(name: str, quick: bool) -> Scene:
    """A scene or, where its volume is not there, a stand-in of the same range of scalars."""
    kind, points, unit = SCENES[name]
    stem, generated, direction, up = VOLUMES[kind]
    path = DATA / f"{stem}.nrrd"
    volume = wvr.read(path) if path.exists() and not quick else wvr.datasets.load(generated, 32 if quick else 128)
    low, high = volume.range
    points = [(low + s / 255 * (high - low), color, opacity) for s, color, opacity in points]
    fit = wvr.Camera.fit(volume, direction=direction, up=up)
    camera = wvr.Camera(fit.position, fit.target, up=up, view_angle=20.0)
    if name == "Bonsai, leaf":
        # The leaf that hangs to the right of the trunk, in the other bonsai scenes' picture.
        origins, directions = camera.rays((512, 512))
        camera = wvr.Camera(fit.position, origins[258, 325] + directions[258, 325], up=up, view_angle=2.5)
    tf = wvr.TransferFunction(points, unit_distance=unit)
    return Scene(name, volume, tf, camera, (48, 48) if quick else (512, 512))


def errors(image: wvr.Image | NDArray[np.floating], exact: wvr.Image) -> dict[str, float]:
    """How far an image is from the exact one."""
    difference = wvr.compare(image, exact, [VISIBLE])
    return {"max": difference.max, "mean": difference.mean, "rays over 1/256 [%]": 100 * difference.shares[VISIBLE]}


def picture(image: wvr.Image) -> NDArray[np.floating]:
    return np.clip(linear_to_srgb(image.composited("white")), 0, 1)


# --- Section 3: over-sampling -----------------------------------------------------------------------------------------


def figure4(folder: Path, scene: Scene) -> None:
    """A leaf with less and less care, and the errors."""
    exact = scene.render(wvr.Exact())
    images = {f"pre-integrated, {n}x": scene.slicing(n, 1) for n in reversed(OVERSAMPLING)}
    images["samples, 1x"] = scene.render(wvr.Riemann(1.0), termination=0)
    figure = Figure(figsize=(11, 4.45), layout="constrained")
    panels = figure.subplots(2, len(images))
    for i, (name, image) in enumerate(images.items()):
        difference = wvr.compare(image, exact, [VISIBLE])
        panels[0, i].imshow(picture(image))
        shown = panels[1, i].imshow(np.maximum(difference.map, 1e-12), norm=LogNorm(1e-5, 1), cmap="magma")
        panels[0, i].set(title=name, xticks=[], yticks=[])
        panels[1, i].set(xticks=[], yticks=[], xlabel=f"{difference.shares[VISIBLE]:.1%} of rays over 1/256")
    figure.colorbar(shown, ax=panels[1], label="largest error\nof a channel", extend="min")
    save_figure(figure, folder / "figure4")


def oversampling(folder: Path, scenes: dict[str, Scene]) -> list[dict[str, Any]]:
    """Is four-fold over-sampling needed, and is two-fold almost free?"""
    rows: list[dict[str, Any]] = []
    for scene in scenes.values():
        exact = scene.render(wvr.Exact())
        methods: dict[str, wvr.Image] = {"samples, 1x": scene.timed(wvr.Riemann(1.0), skip_empty=False, termination=0)}
        methods |= {f"pre-integrated, {n}x": scene.slicing(n) for n in OVERSAMPLING}
        methods["adaptive, 1/256"] = scene.timed(wvr.AdaptivePreintegrated(VISIBLE))
        base = methods["pre-integrated, 1x"].stats["seconds_raycast"]
        for method, image in methods.items():
            seconds = image.stats["seconds_raycast"]
            row = {"scene": scene.name, "method": method} | errors(image, exact)
            row |= {"s": seconds, "time over 1x": seconds / base, "M samples": image.stats["samples"] / 1e6}
            rows.append(row)
    paper = PAPER["oversampling"]
    title = (
        f"Over-sampling ({paper['where']}: {paper['needed']}x needed, 2x almost free, highest quality at about "
        f"{paper['time of highest quality over normal']:g} times the time)"
    )
    write_rows(folder, "oversampling", title, rows)
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for i, name in enumerate(scenes):
        kept = [row for row in rows if row["scene"] == name and row["method"].startswith("pre")]
        left.plot(
            OVERSAMPLING, [row["rays over 1/256 [%]"] for row in kept], "os^Dv"[i] + "-", color=COLORS[i], label=name
        )
        right.plot(OVERSAMPLING, [row["time over 1x"] for row in kept], "os^Dv"[i] + "-", color=COLORS[i])
    left.set(ylabel="rays with an error over 1/256 [%]")
    left.set_yscale("symlog", linthresh=0.01)
    left.set_ylim(0, 100)
    right.plot(OVERSAMPLING, OVERSAMPLING, color="0.6", lw=0.8, label="in proportion")
    right.set(ylabel="time over that of 1x", yscale="log", yticks=OVERSAMPLING, yticklabels=OVERSAMPLING)
    for axes in (left, right):
        axes.set(xscale="log", xlabel="slabs per voxel", xticks=OVERSAMPLING, xticklabels=OVERSAMPLING)
        axes.minorticks_off()
        axes.grid(color="0.9")
    left.legend(frameon=False, fontsize="small")
    right.legend(frameon=False, fontsize="small")
    save_figure(figure, folder / "oversampling")
    return rows


# --- Section 4: adaptive pre-integration ------------------------------------------------------------------------------


def figure6(folder: Path, scenes: list[Scene]) -> None:
    """The number of steps of each ray."""
    white = PAPER["white of the sampling steps"]["samples"]
    figure = Figure(figsize=(7.5, 3.4 * len(scenes)), layout="constrained")
    panels = figure.subplots(len(scenes), 2)
    for (left, right), scene in zip(panels, scenes, strict=True):
        image = scene.render(wvr.AdaptivePreintegrated(VISIBLE))
        left.imshow(picture(image))
        shown = right.imshow(image.samples, cmap="gray", vmin=0, vmax=white)
        left.set(title=scene.name, xticks=[], yticks=[])
        mean = image.samples[image.samples > 0].mean()
        right.set(title=f"segments: mean {mean:.0f}, most {image.samples.max()}", xticks=[], yticks=[])
    figure.colorbar(shown, ax=panels, label="segments of a ray", extend="max", shrink=0.5)
    save_figure(figure, folder / "figure6")


def speed(folder: Path, scenes: list[Scene]) -> None:
    """Times and samples of Figures 6, 7 and 9, beside slicing with four-fold over-sampling."""
    rows = []
    for scene in scenes:
        adaptive, slicing = scene.timed(wvr.AdaptivePreintegrated(VISIBLE)), scene.slicing(4)
        leaping = scene.timed(wvr.Preintegrated(1.0, 4))
        exact = scene.render(wvr.Exact())
        low, high = PAPER["seconds"][scene.name]
        row: dict[str, Any] = {"scene": scene.name, "paper s": f"{low:g}" if low == high else f"{low:g} to {high:g}"}
        for label, image in (("adaptive", adaptive), ("4x slicing", slicing), ("4x, leaping", leaping)):
            row[f"{label} s"] = image.stats["seconds_raycast"]
            row[f"{label} M samples"] = image.stats["samples"] / 1e6
            row[f"{label} max error"] = wvr.compare(image, exact).max
        row["rays with more samples than slicing [%]"] = 100 * float(np.mean(adaptive.samples > slicing.samples))
        rows.append(row)
    title = f"Section 5: {PAPER['machine']}; here {wvr.get_num_threads()} threads, threshold 1/256"
    write_rows(folder, "speed", title, rows)


def threshold(folder: Path, scenes: list[Scene]) -> None:
    """A higher threshold against fewer slices: error against time and samples."""
    tolerances = [2.0**-k for k in range(1, 13)]
    steps = [2.0**k for k in range(4, -4, -1)]
    figure = Figure(figsize=(9, 3.3 * len(scenes)), layout="constrained")
    panels = figure.subplots(len(scenes), 2, sharey="row", squeeze=False)
    rows: list[dict[str, Any]] = []
    for scene, (by_time, by_samples) in zip(scenes, panels, strict=True):
        exact = scene.render(wvr.Exact())
        # Rays end alike, so that what differs is how they step.
        methods = {
            "slicing": [(h, scene.timed(wvr.Preintegrated(h), skip_empty=False, termination=0)) for h in steps],
            "uniform steps, leaping": [(h, scene.timed(wvr.Preintegrated(h), termination=1e-4)) for h in steps],
            "adaptive": [(t, scene.timed(wvr.AdaptivePreintegrated(t), termination=1e-4)) for t in tolerances],
        }
        for i, (name, images) in enumerate(methods.items()):
            measured = [
                {"scene": scene.name, "method": name, "step or threshold": parameter}
                | errors(image, exact)
                | {"s": image.stats["seconds_raycast"], "samples per ray": float(image.samples.mean())}
                for parameter, image in images
            ]
            rows += measured
            for axes, x in ((by_time, "s"), (by_samples, "samples per ray")):
                style = "os^"[i] + "-"
                axes.plot([m[x] for m in measured], [m["mean"] for m in measured], style, color=COLORS[i], label=name)
        by_time.set(xlabel="seconds", ylabel="mean error")
        by_samples.set(xlabel="samples per ray")
        for axes in (by_time, by_samples):
            axes.set(xscale="log", yscale="log", title=scene.name)
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.grid(color="0.9", which="both")
            axes.set_axisbelow(True)
    panels[0, 0].legend(frameon=False)
    save_figure(figure, folder / "threshold")
    write_rows(folder, "threshold", "A higher threshold against fewer slices", rows)


def artefacts(folder: Path, scenes: list[Scene]) -> None:
    """Pictures at equal time: a high threshold, and few slices."""
    figure = Figure(figsize=(9, 3.5 * len(scenes)), layout="constrained")
    panels = figure.subplots(len(scenes), 3)
    for scene, row in zip(scenes, panels, strict=True):
        exact = scene.render(wvr.Exact())
        adaptive = scene.timed(wvr.AdaptivePreintegrated(0.25))
        # As many slices as that time allows.
        slices, step = adaptive, 0.5
        while step < 32 and (slices is adaptive or slices.stats["seconds"] > adaptive.stats["seconds"]):
            step *= 1.25
            slices = scene.timed(wvr.Preintegrated(step), skip_empty=False, termination=0)
        images = {"exact": exact, "threshold 1/4": adaptive, f"a slice every {step:.2g} voxels": slices}
        for axes, (name, image) in zip(row, images.items(), strict=True):
            axes.imshow(picture(image))
            axes.set(title=name, xticks=[], yticks=[])
            if image is not exact:
                found = errors(image, exact)
                axes.set_xlabel(
                    f"{image.stats['seconds']:.2f} s, error: max {found['max']:.2f}, mean {found['mean']:.1e}",
                    fontsize="small",
                )
    save_figure(figure, folder / "artefacts")


# --- Figure 7: the frame buffer ---------------------------------------------------------------------------------------


def blended(
    scene: Scene, oversampling: int, groups: dict[str, tuple[int, int | None]]
) -> dict[str, NDArray[np.float64]]:
    """Slices parallel to the image plane, blended back to front in a frame buffer.

    Parameters
    ----------
    groups
        By name: how many slabs are blended before they are written, and the levels of the buffer's channels (None:
        floats). What is written is rounded, and so is what blending with it leaves in the buffer.
    """
    step = 1.0 / oversampling
    table = wvr.preintegrate(scene.tf, 512, length=step, domain=scene.volume.range)
    origins, directions = scene.camera.rays(scene.size)
    low, high = (np.array(bound, float) for bound in scene.volume.index_box)
    to_index = np.linalg.inv(scene.volume.index_to_world)
    start = origins @ to_index[:3, :3].T + to_index[:3, 3]
    along = directions @ to_index[:3, :3].T
    center = ((low + high) / 2 - start) @ along[0, 0] / (along[0, 0] @ along[0, 0])
    reach = np.linalg.norm(high - low) / 2
    # A parallel view: slices a step apart, at one distance from the camera for all rays.
    nearest, count = center.mean() - reach, oversampling * max(n for n, _ in groups.values())
    count = -(-int(np.ceil(2 * reach / step)) // count) * count
    buffers = {name: np.zeros((*scene.size[::-1], 4)) for name in groups}
    pending = {name: np.zeros((*scene.size[::-1], 4)) for name in groups}

    def scalars(i: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        points = start + (nearest + i * step) * along
        inside = np.all((points >= low) & (points <= high), axis=-1)
        return trilinear(scene.volume.numpy(), np.clip(points, low, high)), inside

    back, back_inside = scalars(count)
    for i in range(count - 1, -1, -1):
        front, front_inside = scalars(i)
        slab = np.where((front_inside & back_inside)[..., None], table.lookup(front, back), 0.0)
        for name, (size, levels) in groups.items():
            pending[name] = slab + (1 - slab[..., 3:]) * pending[name]
            if i % size == 0:
                written = pending[name] if levels is None else np.round(pending[name] * levels) / levels
                buffer = written + (1 - written[..., 3:]) * buffers[name]
                buffers[name] = buffer if levels is None else np.round(buffer * levels) / levels
                pending[name] = np.zeros_like(slab)
        back, back_inside = front, front_inside
    return buffers


def figure7(folder: Path, scene: Scene, quick: bool) -> None:
    """What an 8-bit frame buffer loses."""
    fit = wvr.Camera.fit(scene.volume, direction=VOLUMES["NegHIP"][2], up=VOLUMES["NegHIP"][3], parallel=True)
    assert fit.parallel_scale is not None
    camera = wvr.Camera(fit.position, fit.target, fit.up, parallel_scale=0.7 * fit.parallel_scale)
    scene = replace(scene, camera=camera, size=(32, 32) if quick else (256, 256))
    exact = scene.render(wvr.Exact())
    buffers = blended(
        scene,
        4,
        {"8 bits, each slab": (1, 255), "8 bits, four slabs at once": (4, 255), "floats, each slab": (1, None)},
    )
    adaptive = scene.render(wvr.AdaptivePreintegrated(VISIBLE))
    images = buffers | {"adaptive, floats": adaptive.rgba}
    write_rows(
        folder,
        "figure7",
        "Figure 7: the frame buffer, errors against Exact; opacity kept where the exact one is below 1/4",
        [
            {"method": name}
            | errors(rgba, exact)
            | {"thin opacity kept [%]": 100 * float(_thin(rgba, exact).sum() / _thin(exact.rgba, exact).sum())}
            for name, rgba in images.items()
        ],
    )
    figure = Figure(figsize=(11, 3.05), layout="constrained")
    panels = figure.subplots(1, len(images))
    for axes, (name, rgba) in zip(panels, images.items(), strict=True):
        axes.imshow(np.clip(linear_to_srgb(rgba[..., :3]), 0, 1))
        axes.set(title=name, xticks=[], yticks=[])
    save_figure(figure, folder / "figure7")


def _thin(rgba: NDArray[np.floating], exact: wvr.Image) -> NDArray[np.floating]:
    return rgba[..., 3][exact.rgba[..., 3] < 0.25]


def main(*arguments: str) -> None:
    """Run all parts; ``--quick`` is small and takes generated volumes."""
    quick = "--quick" in arguments
    folder = output("roettger2003")
    scenes = {name: make_scene(name, quick) for name in SCENES}
    leaf = scenes.pop("Bonsai, leaf")
    semi, opaque, neghip, _ = scenes.values()
    figure4(folder, leaf)
    oversampling(folder, {"Bonsai, leaf": leaf} | scenes)
    figure6(folder, [semi, opaque])
    speed(folder, list(scenes.values()))
    threshold(folder, [semi, opaque])
    artefacts(folder, [semi, opaque])
    figure7(folder, neghip, quick)


if __name__ == "__main__":
    main(*sys.argv[1:])
