"""Roettger, Guthe, Weiskopf, Ertl and Strasser, "Smart Hardware-Accelerated Volume Rendering" (2003).

Over-sampling and adaptive pre-integration, Figures 4, 6, 7 and 9, the paper's claims and numbers beside what we find.
The volumes are the bonsai and the high-potential iron protein (NegHIP, here 64^3, there 128^3) where they are there,
else generated ones stand in for them.

The paper's views and transfer functions are not published and its pictures are lit; ours are not, so that errors are
those of the integral alone, against ``Exact``. "Slicing" is ``Preintegrated`` with every sample computed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

import wvr
from wvr.color import linear_to_srgb
from wvr.integrators import Integrator

from .base import scenes as views
from .base.harness import COLORS, save_figure
from .base.reference import trilinear
from .base.rows import spread, write_rows
from .base.scenes import Scene, picture
from .base.study import Study
from .slab_passes import Passes

STUDY = Study("roettger2003")
PAPER = STUDY.paper
VISIBLE = 1 / 256  # the step of an 8-bit screen, which an error should stay below
OVERSAMPLING = (1, 2, 4, 8)

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
    "Bonsai, semi-transparent": ("bonsai", BONSAI, 1.0),
    "Bonsai, opaque": ("bonsai", BONSAI, 0.1),
    "Bonsai, leaf": ("bonsai", LEAF, 1.0),
    "NegHIP, semi-transparent": ("neghip", NEGHIP, 1.0),
    "NegHIP, opaque": ("neghip", NEGHIP, 0.05),
}
LEAF_SCENE, TREES = "Bonsai, leaf", ("Bonsai, semi-transparent", "Bonsai, opaque")


@cache
def make_scene(name: str, quick: bool) -> Scene:
    """A scene or, where its volume is not there, a stand-in of the same range of scalars."""
    kind, points, unit = SCENES[name]
    volume = views.load(kind, quick)
    camera = views.camera(kind, volume, view_angle=20.0)
    if name == "Bonsai, leaf":
        # The leaf that hangs to the right of the trunk, in the other bonsai scenes' picture.
        origins, directions = camera.rays((512, 512))
        leaf = origins[258, 325] + directions[258, 325]
        camera = wvr.Camera(camera.position, leaf, up=camera.up, view_angle=2.5)
    tf = wvr.TransferFunction(views.stretched(points, (0, 255), volume), unit_distance=unit)
    return Scene(name, volume, tf, camera, (48, 48) if quick else (512, 512))


@cache
def exact(name: str, quick: bool) -> wvr.Image:
    """The ground truth of a scene."""
    return make_scene(name, quick).render(wvr.Exact())


def slicing(scene: Scene, oversampling: int, rounds: int = 2) -> wvr.Image:
    """Pre-integrated slabs, every one computed."""
    return scene.timed(wvr.Preintegrated(1.0, oversampling), rounds, skip_empty=False, termination=0)


def errors(image: wvr.Image | NDArray[np.floating], truth: wvr.Image) -> dict[str, float]:
    """How far an image is from the exact one."""
    difference = wvr.compare(image, truth, [VISIBLE])
    return {"max": difference.max, "mean": difference.mean, "rays over 1/256 [%]": 100 * difference.shares[VISIBLE]}


# --- Section 3: over-sampling -----------------------------------------------------------------------------------------


@STUDY.part("Figure 4")
def figure4(folder: Path, quick: bool) -> str:
    """A leaf with less and less care, and the errors."""
    scene, truth = make_scene(LEAF_SCENE, quick), exact(LEAF_SCENE, quick)
    images = {f"pre-integrated, {n}x": slicing(scene, n, 1) for n in reversed(OVERSAMPLING)}
    images["samples, 1x"] = scene.render(wvr.Riemann(1.0), termination=0)
    figure = Figure(figsize=(11, 4.45))
    panels = figure.subplots(2, len(images))
    shares = {}
    for i, (name, image) in enumerate(images.items()):
        difference = wvr.compare(image, truth, [VISIBLE])
        shares[name] = difference.shares[VISIBLE]
        panels[0, i].imshow(picture(image))
        shown = panels[1, i].imshow(np.maximum(difference.map, 1e-12), norm=LogNorm(1e-5, 1), cmap="magma")
        panels[0, i].set(title=name, xticks=[], yticks=[])
        panels[1, i].set(xticks=[], yticks=[], xlabel=f"{difference.shares[VISIBLE]:.1%} of rays over 1/256")
    figure.colorbar(shown, ax=panels[1], label="largest error\nof a channel", extend="min")
    save_figure(figure, folder / "figure4")
    return "Rays with an error over 1/256: " + ", ".join(f"{name} {share:.1%}" for name, share in shares.items()) + "."


@STUDY.part("Over-sampling")
def oversampling(folder: Path, quick: bool) -> str:
    """Is four-fold over-sampling needed, and is two-fold almost free?"""
    rows: list[dict[str, Any]] = []
    for name in SCENES:
        scene, truth = make_scene(name, quick), exact(name, quick)
        methods: dict[str, wvr.Image] = {"samples, 1x": scene.timed(wvr.Riemann(1.0), skip_empty=False, termination=0)}
        methods |= {f"pre-integrated, {n}x": slicing(scene, n) for n in OVERSAMPLING}
        methods["adaptive, 1/256"] = scene.timed(wvr.AdaptivePreintegrated(VISIBLE))
        base = methods["pre-integrated, 1x"].stats["processor_s"]
        for method, image in methods.items():
            seconds = image.stats["processor_s"]
            row = {"scene": scene.name, "method": method} | errors(image, truth)
            row |= {"s": seconds, "time over 1x": seconds / base, "M samples": image.stats["samples"] / 1e6}
            rows.append(row)
    paper = PAPER["oversampling"]
    title = (
        f"Over-sampling ({paper['where']}: {paper['needed']}x needed, 2x almost free, highest quality at about "
        f"{paper['time of highest quality over normal']:g} times the time)"
    )
    write_rows(folder, "oversampling", title, rows)
    figure = Figure(figsize=(9, 3.6))
    left, right = figure.subplots(1, 2)
    for i, name in enumerate(SCENES):
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
        axes.grid()
    left.legend(fontsize="small")
    right.legend(fontsize="small")
    save_figure(figure, folder / "oversampling")

    def of(n: int, column: str) -> str:
        return spread([row[column] for row in rows if row["method"] == f"pre-integrated, {n}x"])

    shares = ", ".join(f"{of(n, 'rays over 1/256 [%]')} % at {n}x" for n in OVERSAMPLING)
    times = ", ".join(f"{of(n, 'time over 1x')} times at {n}x" for n in OVERSAMPLING[1:])
    return f"By scene, rays over 1/256: {shares}. Time over that of 1x: {times}."


VIEWS = 20


def views_around(scene: Scene, count: int) -> list[wvr.Camera]:
    """Cameras all around the middle that a scene looks at, as far away as its own and as wide."""
    camera = scene.camera
    target, distance = np.array(camera.target), float(np.linalg.norm(np.array(camera.position) - camera.target))
    heights = 1 - (2 * np.arange(count) + 1) / count
    angles = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - heights**2)
    directions = np.column_stack([ring * np.cos(angles), heights, ring * np.sin(angles)])
    return [
        wvr.Camera(target + distance * one, target, up=(0, 0, 1), view_angle=camera.view_angle) for one in directions
    ]


@STUDY.part("Section 3: several slabs a pass")
def multistep(folder: Path, quick: bool) -> str:
    """Passes over the frame buffer, of one slab or of four: what twice and four times as many slabs cost then."""
    rows: list[dict[str, Any]] = []
    for name in SCENES:
        scene = make_scene(name, quick)
        # The paper's cameras see all of the volume.
        camera = views.camera(SCENES[name][0], scene.volume, view_angle=20.0)
        scene = replace(scene, camera=camera, size=(16, 16) if quick else (192, 192))
        cameras = views_around(scene, 2 if quick else VIEWS)
        for lit in (False, True):
            passes = Passes(scene, lit)
            # Four times as many in a quarter of the views, which is enough for a mean.
            ways = {"1x, one": (1.0, 1, 1), "1x, four": (1.0, 4, 1), "2x, four": (0.5, 4, 1), "4x, four": (0.25, 4, 4)}
            seconds: dict[str, list[float]] = {way: [] for way in ways}
            for i, camera in enumerate(cameras):
                for way, (step, slabs, every) in ways.items():
                    if i % every == 0:
                        seconds[way].append(passes.draw(camera, step, slabs)[1])
            once = np.array(seconds["1x, one"])
            ratios = {way: float(np.mean(seconds[way] / once[:: ways[way][2]])) for way in list(ways)[1:]}
            row: dict[str, Any] = {
                "scene": name,
                "lit": "yes" if lit else "no",
                "1x, one slab a pass, cpu s": once.mean(),
            }
            row |= {f"{way} slabs a pass, over that": ratio for way, ratio in ratios.items()}
            rows.append(row | {"four at once faster by [%]": 100 * (1 / ratios["1x, four"] - 1)})
    low, high = PAPER["oversampling"]["speed-up of four slabs at once, per cent"]
    title = f"Section 3: passes of one slab and of four, {VIEWS} views (the paper: four faster by {low} to {high} %)"
    write_rows(folder, "multistep", title, rows)
    faster, twice, four = (
        spread([row[column] for row in rows])
        for column in (
            "four at once faster by [%]",
            "2x, four slabs a pass, over that",
            "4x, four slabs a pass, over that",
        )
    )
    return (
        f"Four slabs a pass are {faster} % faster than one (the paper: {low} to {high} %); so blended, twice as many "
        f"slabs take {twice} times as long as one slab a pass, four times as many {four} times."
    )


# Of the table of extinction: thin, as in the pictures, and dense.
OPACITIES = {"thin": 4.0, "as shown": 1.0, "dense": 0.25}
GROUNDS = ("white", "black", "gray")


@STUDY.part("Section 3: on a screen")
def screen(folder: Path, quick: bool) -> str:
    """Over-sampling as a screen shows it: sRGB on several backgrounds, with and without light, of several opacities;
    per cent of pixels that are off by more than one and two steps of 255 in any channel.
    """
    rows: list[dict[str, Any]] = []
    for name in ("Bonsai, opaque", "Bonsai, semi-transparent", LEAF_SCENE, "NegHIP, opaque"):
        whole = make_scene(name, quick)
        scene = replace(whole, size=(32, 32) if quick else (256, 256))
        for opacity, unit in OPACITIES.items():
            tf = whole.transfer_function
            assert isinstance(tf.unit_distance, float)
            made = wvr.TransferFunction.from_arrays(tf.knots, tf.colors, tf.opacities, unit * tf.unit_distance)
            denser = replace(scene, transfer_function=made)
            for lit in (False, True):
                light = {"lighting": wvr.Lighting("interpolated")} if lit else {}
                truth = denser.render(wvr.Exact(), **light)
                for n in OVERSAMPLING[1:]:
                    image = denser.render(wvr.Preintegrated(1.0, n), termination=0, **light)
                    row: dict[str, Any] = {
                        "scene": name,
                        "opacity": opacity,
                        "lit": "yes" if lit else "no",
                        "slabs a voxel": n,
                    }
                    for ground in GROUNDS:
                        steps = 255 * np.abs(on_screen(image, ground) - on_screen(truth, ground)).max(axis=2)
                        for limit in (1, 2):
                            row[f"{ground}: over {limit} [%]"] = 100 * float(np.mean(steps > limit))
                    rows.append(row)
    write_rows(folder, "screen", "Pixels off by more than 1 and 2 steps of a screen of 8 bits, sRGB", rows)

    def worst(n: int, limit: int) -> float:
        return max(
            row[f"{ground}: over {limit} [%]"] for row in rows if row["slabs a voxel"] == n for ground in GROUNDS
        )

    return (
        "Pixels over two steps of a screen, at worst: "
        + ", ".join(f"{worst(n, 2):.2g} % at {n}x" for n in OVERSAMPLING[1:])
        + "."
    )


def on_screen(image: wvr.Image, ground: str) -> NDArray[np.float64]:
    """In sRGB, 0 to 1."""
    return np.clip(linear_to_srgb(image.composited(ground).astype(np.float64)), 0, 1)


# --- Section 4: adaptive pre-integration ------------------------------------------------------------------------------


@STUDY.part("Figure 6")
def figure6(folder: Path, quick: bool) -> str:
    """The number of steps of each ray."""
    scenes = [make_scene(name, quick) for name in TREES]
    means = []
    white = PAPER["white of the sampling steps"]["samples"]
    figure = Figure(figsize=(7.5, 3.4 * len(scenes)))
    panels = figure.subplots(len(scenes), 2)
    for (left, right), scene in zip(panels, scenes, strict=True):
        image = scene.render(wvr.AdaptivePreintegrated(VISIBLE))
        left.imshow(picture(image))
        shown = right.imshow(image.samples, cmap="gray", vmin=0, vmax=white)
        left.set(title=scene.name, xticks=[], yticks=[])
        mean = image.samples[image.samples > 0].mean()
        means.append(f"{scene.name} {mean:.0f}")
        right.set(title=f"segments: mean {mean:.0f}, most {image.samples.max()}", xticks=[], yticks=[])
    figure.colorbar(shown, ax=panels, label="segments of a ray", extend="max", shrink=0.5)
    save_figure(figure, folder / "figure6")
    return f"Mean number of segments of rays that have any: {', '.join(means)}."


# Tolerances of which the highest is taken that has no more rays over a step of the screen than four slabs a voxel.
EQUAL = (1 / 256, 1 / 128, 1 / 64, 1 / 32)
# Transparency at which rays end, in all methods alike; it is an error, too.
END = 1 / 1024


def in_turns(scene: Scene, methods: dict[str, Integrator], rounds: int = 3) -> dict[str, tuple[float, wvr.Image]]:
    """Median processor seconds of frames, in which methods take turns and rays end alike, and images."""
    renderers = {name: scene.renderer(integrator, termination=END) for name, integrator in methods.items()}
    images = {name: renderer.render(scene.camera, scene.size) for name, renderer in renderers.items()}
    times: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(rounds):
        for name, renderer in renderers.items():
            start = process_time()
            renderer.render(scene.camera, scene.size)
            times[name].append(process_time() - start)
    return {name: (median(times[name]), image) for name, image in images.items()}


@STUDY.part("Section 5: times")
def speed(folder: Path, quick: bool) -> str:
    """Adaptive steps beside four slabs a voxel, all of them and those that are not leapt over: frames of all five
    scenes, and of the highest of four tolerances with no more rays over 1/256 than slabs have.
    """
    rows = []
    for scene in (make_scene(name, quick) for name in SCENES):
        truth = exact(scene.name, quick)
        methods: dict[str, Integrator] = {"4x, leaping": wvr.Preintegrated(1.0, 4)}
        methods |= {f"adaptive, 1/{1 / t:g}": wvr.AdaptivePreintegrated(t) for t in EQUAL}
        found = in_turns(scene, methods)
        paper = PAPER["seconds"].get(scene.name)
        sliced = slicing(scene, 4, 1)
        base, uniform = found["4x, leaping"]
        shares = {name: errors(image, truth)["rays over 1/256 [%]"] for name, (_, image) in found.items()}
        steps = list(found)[1:]
        alike = next((name for name in reversed(steps) if shares[name] <= shares["4x, leaping"]), steps[0])
        adaptive = found["adaptive, 1/256"][1]
        rows.append(
            {
                "scene": scene.name,
                "paper s": None if paper is None else f"{paper[0]:g}" if paper[0] == paper[1] else "1 to 3",
                "4x, leaping cpu s": base,
                "adaptive 1/256 cpu s": found["adaptive, 1/256"][0],
                "adaptive over leaping": found["adaptive, 1/256"][0] / base,
                "at equal rays": found[alike][0] / base,
                "with": alike.split()[-1],
                "4x rays over 1/256 [%]": shares["4x, leaping"],
                "adaptive rays over 1/256 [%]": shares["adaptive, 1/256"],
                "adaptive rays over, then [%]": shares[alike],
                "4x max error": errors(uniform, truth)["max"],
                "adaptive max error": errors(adaptive, truth)["max"],
                "4x slices M samples": sliced.stats["samples"] / 1e6,
                "4x, leaping M samples": uniform.stats["samples"] / 1e6,
                "adaptive M samples": adaptive.stats["samples"] / 1e6,
                "adaptive most samples of a ray": int(adaptive.samples.max()),
                "rays with more samples than slicing [%]": 100 * float(np.mean(adaptive.samples > sliced.samples)),
            }
        )
    title = f"Section 5: {PAPER['machine']}; here {wvr.get_num_threads()} threads, seconds of processor"
    write_rows(folder, "speed", title, rows)
    most = {row["scene"]: row["adaptive M samples"] for row in rows}
    fewer = all(most[f"{name}, opaque"] < most[f"{name}, semi-transparent"] for name in ("Bonsai", "NegHIP") if most)
    return (
        f"With adaptive steps of 1/256 a frame takes {spread([row['adaptive over leaping'] for row in rows])} of the "
        f"time of four slabs a voxel, at equal rays over 1/256 {spread([row['at equal rays'] for row in rows])}; "
        f"opaque scenes take {'fewer' if fewer else 'more'} samples than semi-transparent ones."
    )


@STUDY.part("Section 5: a higher threshold")
def threshold(folder: Path, quick: bool) -> str:
    """A higher threshold against fewer slices: error against time and samples."""
    scenes = [make_scene(name, quick) for name in TREES]
    tolerances = [2.0**-k for k in range(1, 13)]
    steps = [2.0**k for k in range(4, -4, -1)]
    figure = Figure(figsize=(9, 3.3 * len(scenes)))
    panels = figure.subplots(len(scenes), 2, sharey="row", squeeze=False)
    rows: list[dict[str, Any]] = []
    for scene, (by_time, by_samples) in zip(scenes, panels, strict=True):
        truth = exact(scene.name, quick)
        # Rays end alike, so that what differs is how they step.
        methods = {
            "slicing": [(h, scene.timed(wvr.Preintegrated(h), skip_empty=False, termination=0)) for h in steps],
            "uniform steps, leaping": [(h, scene.timed(wvr.Preintegrated(h), termination=1e-4)) for h in steps],
            "adaptive": [(t, scene.timed(wvr.AdaptivePreintegrated(t), termination=1e-4)) for t in tolerances],
        }
        for i, (name, images) in enumerate(methods.items()):
            measured = [
                {"scene": scene.name, "method": name, "step or threshold": parameter}
                | errors(image, truth)
                | {"s": image.stats["processor_s"], "samples per ray": float(image.samples.mean())}
                for parameter, image in images
            ]
            rows += measured
            for axes, x in ((by_time, "s"), (by_samples, "samples per ray")):
                style = "os^"[i] + "-"
                axes.plot([m[x] for m in measured], [m["mean"] for m in measured], style, color=COLORS[i], label=name)
        by_time.set(xlabel="seconds of the processor", ylabel="mean error")
        by_samples.set(xlabel="samples per ray")
        for axes in (by_time, by_samples):
            axes.set(xscale="log", yscale="log", title=scene.name)
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.grid(which="both")
    panels[0, 0].legend()
    save_figure(figure, folder / "threshold")
    write_rows(folder, "threshold", "A higher threshold against fewer slices", rows)
    fastest = min((row for row in rows if row["method"] == "adaptive"), key=lambda row: row["s"])
    slices = [row for row in rows if row["method"] == "slicing" and row["scene"] == fastest["scene"]]
    alike = min(slices, key=lambda row: abs(np.log(row["s"] / fastest["s"])))
    return (
        f"{fastest['scene']}: the highest threshold, {fastest['step or threshold']:g}, takes {fastest['s']:.2g} s with "
        f"a mean error of {fastest['mean']:.1e}; slices {alike['step or threshold']:g} voxels apart take "
        f"{alike['s']:.2g} s with {alike['mean']:.1e}."
    )


@STUDY.part("Section 5: artefacts")
def artefacts(folder: Path, quick: bool) -> str:
    """Pictures at equal time: a high threshold, and few slices."""
    scenes = [make_scene(name, quick) for name in TREES]
    findings = []
    figure = Figure(figsize=(9, 3.5 * len(scenes)))
    panels = figure.subplots(len(scenes), 3)
    for scene, row in zip(scenes, panels, strict=True):
        truth = exact(scene.name, quick)
        adaptive = scene.timed(wvr.AdaptivePreintegrated(0.25))
        # As many slices as that time allows.
        slices, step = adaptive, 0.5
        while step < 32 and (slices is adaptive or slices.stats["processor_s"] > adaptive.stats["processor_s"]):
            step *= 1.25
            slices = scene.timed(wvr.Preintegrated(step), skip_empty=False, termination=0)
        images = {"exact": truth, "threshold 1/4": adaptive, f"a slice every {step:.2g} voxels": slices}
        for axes, (name, image) in zip(row, images.items(), strict=True):
            axes.imshow(picture(image))
            axes.set(title=name, xticks=[], yticks=[])
            if image is not truth:
                found = errors(image, truth)
                axes.set_xlabel(
                    f"{image.stats['processor_s']:.2f} s, error: max {found['max']:.2f}, mean {found['mean']:.1e}",
                    fontsize="small",
                )
        few, high = (errors(image, truth)["mean"] for image in (slices, adaptive))
        findings.append(
            f"{scene.name}: mean error {high:.1e} with a threshold of 1/4, {few:.1e} with as long for slices"
        )
    save_figure(figure, folder / "artefacts")
    return "; ".join(findings) + "."


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
    table = wvr.preintegrate(scene.transfer_function, 512, length=step, domain=scene.volume.range)
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


@STUDY.part("Figure 7")
def figure7(folder: Path, quick: bool) -> str:
    """What an 8-bit frame buffer loses."""
    scene = make_scene("NegHIP, semi-transparent", quick)
    _, direction, up = views.SCANS["neghip"]
    fit = wvr.Camera.fit(scene.volume, direction=direction, up=up, parallel=True)
    assert fit.parallel_scale is not None
    camera = wvr.Camera(fit.position, fit.target, fit.up, parallel_scale=0.7 * fit.parallel_scale)
    scene = replace(scene, camera=camera, size=(32, 32) if quick else (256, 256))
    truth = scene.render(wvr.Exact())
    buffers = blended(
        scene,
        4,
        {"8 bits, each slab": (1, 255), "8 bits, four slabs at once": (4, 255), "floats, each slab": (1, None)},
    )
    adaptive = scene.render(wvr.AdaptivePreintegrated(VISIBLE))
    images = buffers | {"adaptive, floats": adaptive.rgba}
    rows: list[dict[str, Any]] = [
        {"method": name}
        | errors(rgba, truth)
        | {"thin opacity kept [%]": 100 * float(_thin(rgba, truth).sum() / _thin(truth.rgba, truth).sum())}
        for name, rgba in images.items()
    ]
    title = "Figure 7: the frame buffer, errors against Exact; opacity kept where the exact one is below 1/4"
    write_rows(folder, "figure7", title, rows)
    figure = Figure(figsize=(11, 3.05))
    panels = figure.subplots(1, len(images))
    for axes, (name, rgba) in zip(panels, images.items(), strict=True):
        axes.imshow(np.clip(linear_to_srgb(rgba[..., :3]), 0, 1))
        axes.set(title=name, xticks=[], yticks=[])
    save_figure(figure, folder / "figure7")
    return "Mean errors: " + ", ".join(f"{row['method']} {row['mean']:.1e}" for row in rows) + "."


def _thin(rgba: NDArray[np.floating], truth: wvr.Image) -> NDArray[np.floating]:
    return rgba[..., 3][truth.rgba[..., 3] < 0.25]
