"""Lum, Wilson and Ma, "High-Quality Lighting and Efficient Pre-Integration for Volume Rendering" (2004): section 3.

What each way to light a pre-integrated segment is off by, against many parts of the same linear scalar, so that light
alone is compared; how many samples a voxel one sample of light needs to catch up; Table 2 (frames a second); Figures 1,
2, 7, 8 and the colour plates. Scans where they are there, else generated volumes stand in.
"""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from statistics import median
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from wvr.color import linear_to_srgb
from wvr.integrators import Integrator
from wvr.light.lighting import MODES, Mode

from .base import scenes as views
from .base.harness import COLORS, interleave, save_figure, timed
from .base.rows import spread, write_rows
from .base.scenes import Scene
from .base.study import Study

STUDY = Study("lighting")
LIGHT = wvr.DirectionalLight((1.0, 0.8, 1.0))
# One part of a linear scalar is lit as by the tables, but from control point to control point.
EXACT = "interpolated, without a table"
STEPS = (1.0, 0.5, 0.25, 0.125)


def dense(scene: Scene, step: float, entries: int = 4) -> wvr.Renderer:
    """With tables so dense, ``entries`` for a 255th of the range, that their own error does not count."""
    return scene.renderer(wvr.Preintegrated(step, table_size=255 * entries + 1), termination=0)


def lit(renderer: wvr.Renderer, scene: Scene, mode: str, parts: int = 32) -> wvr.Image:
    """Segments lit in a mode."""
    renderer.lighting = wvr.Lighting(cast(Mode, mode), LIGHT, supersample=parts)
    return renderer.render(scene.camera, scene.size)


def spikes(scalars: list[float], colors: list[str], opacity: float = 0.6, width: float = 2.0) -> wvr.TransferFunction:
    """Isosurfaces two values wide."""
    return wvr.TransferFunction.isosurfaces(scalars, colors=colors, opacity=opacity, width=width)


def ball(n: int) -> wvr.Volume:
    """Scalars that fall from 255 in the middle by the distance from it."""
    x = np.linspace(-1, 1, n)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(x, x, x)))
    return wvr.Volume((255 * np.clip(1 - radius, 0, 1)).astype(np.float32))


THREE = ["tab:red", "tab:green", "tab:blue"]
# Volume (a scan or a generated one), surfaces. What the paper calls skull and vortex are stand-ins.
SCENES: dict[str, tuple[str, wvr.TransferFunction]] = {
    "engine": ("engine", spikes([130, 210], ["tab:gray", "tab:orange"], 0.8)),
    "bonsai": ("bonsai", spikes([50, 90, 150], ["tab:green", "tab:orange", "tab:brown"], 0.8, 6.0)),
    "bucky": ("bucky", spikes([80, 140, 200], THREE, 0.8, 8.0)),
    "skull": ("cthead", spikes([600, 1300], ["peru", "ivory"], 0.6, 60.0)),
    "vortex": ("turbulence", spikes([90, 130, 170], THREE, 0.8, 4.0)),
}


@cache
def make_scene(name: str, quick: bool) -> Scene:
    """A scene, by a name of ``SCENES`` or "sphere"."""
    size = (48, 48) if quick else (384, 384)
    if name == "sphere":
        volume = ball(32 if quick else 128)
        return Scene(name, volume, spikes([60, 120, 180], THREE, 0.4), wvr.Camera.fit(volume), size)
    kind, tf = SCENES[name]
    scan = kind in views.SCANS
    volume = views.load(kind, quick, 128) if scan else wvr.datasets.load(kind, 32 if quick else 128)
    if quick or not (scan and views.is_there(kind)):
        # The same transfer function fits: from below its first control point to above its last.
        data = volume.numpy().astype(np.float64)
        low, high = float(tf.knots[0]), float(tf.knots[-1])
        share = (data - data.min()) / (data.max() - data.min())
        volume = wvr.Volume((low + (1.2 * share - 0.1) * (high - low)).astype(np.float32))
    return Scene(name, volume, tf, views.camera(kind, volume), size)


def color_error(image: wvr.Image, truth: wvr.Image) -> tuple[float, float]:
    """Mean and largest difference of a colour channel, of the pixels that show anything."""
    seen = truth.rgba[..., 3] > 0
    difference = np.abs(image.rgba[..., :3] - truth.rgba[..., :3])[seen]
    return float(difference.mean()), float(difference.max())


@STUDY.part("Error of light alone")
def modes(folder: Path, quick: bool) -> str:
    """What light alone is off by in each mode, against 32 parts, and when the standard one catches up."""
    rows: list[dict[str, Any]] = []
    chart: dict[str, dict[str, list[float]]] = {}
    for name in ("sphere", "engine", "bonsai"):
        scene = make_scene(name, quick)
        errors: dict[str, list[float]] = {mode: [] for mode in (*MODES[:-1], EXACT)}
        for step in STEPS:
            renderer = dense(scene, step, 2 if quick else 8)
            truth = lit(renderer, scene, "supersampled")
            for mode, found in errors.items():
                image = lit(renderer, scene, "supersampled", 1) if mode == EXACT else lit(renderer, scene, mode)
                found.append(color_error(image, truth)[0])
        chart[name] = errors
        reach = [step for step, error in zip(STEPS, errors["center"], strict=True) if error <= errors[EXACT][0]]
        for mode, found in errors.items():
            row: dict[str, Any] = {"scene": name, "mode": mode}
            row |= {f"{1 / step:g} a voxel": error for step, error in zip(STEPS, found, strict=True)}
            row["order"] = -float(np.polyfit(np.log(1 / np.array(STEPS)), np.log(found), 1)[0])
            row["over center"] = found[0] / errors["center"][0]
            if mode == "center":
                row["as good as interpolated at 1"] = f"{1 / reach[0]:g} a voxel" if reach else "none of these"
            rows.append(row)
    write_rows(folder, "modes", "Mean error of light alone; against 32 parts of the same linear scalar", rows)
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for axes, (name, errors) in zip(figure.subplots(1, len(chart), sharey=True), chart.items(), strict=True):
        for i, (mode, found) in enumerate(errors.items()):
            axes.loglog([1 / step for step in STEPS], found, marker="os^vDP"[i], ms=4, color=COLORS[i], label=mode)
        axes.set(title=name, xlabel="samples a voxel")
        axes.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        axes.minorticks_off()
    figure.axes[0].set_ylabel("mean error of a colour channel")
    figure.axes[0].legend(frameon=False, fontsize="x-small")
    save_figure(figure, folder / "modes")
    shares = ", ".join(f"{row['over center']:.2f} on the {row['scene']}" for row in rows if row["mode"] == EXACT)
    return f"At one sample a voxel interpolated light has a part of the error of a single sample: {shares}."


def renderer(scene: Scene, mode: Mode, skip: bool) -> wvr.Renderer:
    """As a user would render it, one sample a voxel."""
    return scene.renderer(wvr.Preintegrated(1.0), lighting=wvr.Lighting(mode, LIGHT), skip_empty=skip)


@STUDY.part("Table 2")
def table2(folder: Path, quick: bool) -> str:
    """Frames a second of interpolated light and of one sample, with and without leaping over empty space."""
    rows: list[dict[str, Any]] = []
    for name in ("skull", "vortex"):
        scene = replace(make_scene(name, quick), size=(64, 64) if quick else (512, 512))
        for skip, masking in ((True, "with masking"), (False, "without masking")):
            # Taking turns, by processor time, which a busy machine changes less.
            work = {
                mode: timed(partial(renderer(scene, mode, skip).render, scene.camera, scene.size))
                for mode in ("interpolated", "center")
            }
            cpu = {name: median(time.cpu for time in times) for name, times in interleave(work, 5).items()}
            rate = {mode: wvr.get_num_threads() / seconds for mode, seconds in cpu.items()}
            paper = STUDY.paper["frames a second"][masking][name]
            rows.append(
                {
                    "scene": name,
                    "skips empty": "yes" if skip else "no",
                    "interpolated fps": rate["interpolated"],
                    "single sample fps": rate["center"],
                    "times as long": rate["center"] / rate["interpolated"],
                    "paper interpolated fps": paper[0],
                    "paper single sample fps": paper[1],
                    "paper times as long": paper[1] / paper[0],
                }
            )
    write_rows(folder, "table2", "Table 2, stand-ins for skull and vortex", rows)
    ours, paper = (spread([row[f"{who}times as long"] for row in rows]) for who in ("", "paper "))
    return f"Interpolated light takes {ours} times as long as a single sample, in the paper {paper} times."


def panels(folder: Path, name: str, images: dict[str, tuple[wvr.Image, str]], zoom: int = 1) -> None:
    """Images side by side, cut to what there is to see or the middle of it, with what is said of each."""
    seen = np.argwhere(next(iter(images.values()))[0].rgba[..., 3] > 0)
    low, high = seen.min(axis=0), seen.max(axis=0) + 1
    middle, half = (low + high) // 2, int((high - low).max() // (2 * zoom)) + 2
    rows, columns = (slice(max(m - half, 0), m + half) for m in middle)
    shape = next(iter(images.values()))[0].rgba[rows, columns].shape
    figure = Figure(figsize=(3.1 * len(images), 3.1 * shape[0] / shape[1] + 0.55), layout="constrained")
    for axes, (title, (image, said)) in zip(np.ravel(figure.subplots(1, len(images))), images.items(), strict=True):
        pixels: NDArray = linear_to_srgb(np.clip(image.rgba[..., :3], 0, 1))
        axes.imshow(pixels[rows, columns], interpolation="nearest")
        axes.set_title(f"{title}\n{said}", fontsize="small")
        axes.axis("off")
    save_figure(figure, folder / name)


def lit_panels(folder: Path, figure: str, scene: Scene, shown: tuple[str, ...], zoom: int = 1) -> str:
    """Modes at one sample a voxel beside many parts; a zoom shows the middle."""
    renderer = dense(scene, 1.0)
    truth = lit(renderer, scene, "supersampled")
    images, said = {}, []
    for mode in shown:
        image = lit(renderer, scene, mode)
        mean, worst = color_error(image, truth)
        images[mode] = image, f"mean error {mean:.1e}, max {worst:.2f}"
        said.append(f"{mode} {mean:.1e}")
    images["32 parts"] = truth, "reference"
    panels(folder, figure, images, zoom)
    return f"Mean errors of light: {', '.join(said)}."


@STUDY.part("Figure 1")
def figure1(folder: Path, quick: bool) -> str:
    """Two thin surfaces: point samples miss them, pre-integrated segments do not."""
    scene, lighting = make_scene("engine", quick), wvr.Lighting(light=LIGHT)
    truth = scene.render(wvr.Exact(), lighting=lighting)
    images, said = {}, []
    methods: dict[str, Integrator] = {
        "point samples": wvr.Riemann(1.0),
        "pre-integrated": wvr.Preintegrated(1.0),
        "certified": wvr.Certified(1e-3),
    }
    for name, integrator in methods.items():
        image = scene.render(integrator, lighting=lighting)
        mean, worst = color_error(image, truth)
        images[name] = image, f"mean error {mean:.1e}, max {worst:.2f}"
        said.append(f"{name} {mean:.1e}")
    images["exact"] = truth, "reference"
    panels(folder, "figure1", images)
    return f"Mean errors: {', '.join(said)}."


@STUDY.part("Figure 2")
def figure2(folder: Path, quick: bool) -> str:
    """Two surfaces within one step, then in two: the paper's Figure 2. Second differences along a scan line say what
    jumps, over those of the same line in many parts.
    """
    # Two tilted surfaces two and a half voxels apart, the one in front plane and the other wavy: along a scan line they
    # go from one step of four voxels to the next one after the other.
    z, _, x = np.indices((64, 64, 64)).astype(float)
    front = 28 + 0.15 * x
    apart = 2.5 + np.sin(2 * np.pi * x / 24)
    volume = wvr.Volume(np.clip(100 + 4 * (z - front) / apart, 92, 112).astype(np.float32))
    tf = spikes([100, 104], ["tab:red", "tab:blue"], 0.35, 1.0)
    size = (128, 16) if quick else (512, 64)
    middle = volume.corners.mean(axis=0)
    scale = 30 * size[1] / size[0]
    camera = wvr.Camera(middle - (0, 0, 100), middle, up=(0, 1, 0), parallel_scale=scale)
    scene = Scene("nested", volume, tf, camera, size)
    renderer = dense(scene, 4.0, 16)
    truth = lit(renderer, scene, "supersampled")
    rows: list[dict[str, Any]] = []
    images = {}
    for mode in ("center", "closest-isosurface", "isosurface", "interpolated"):
        image = lit(renderer, scene, mode)
        line = (image.rgba - truth.rgba)[size[1] // 2, :, :3]
        mean, worst = color_error(image, truth)
        jump = float(np.abs(np.diff(line, 2, axis=0)).max())
        rows.append({"mode": mode, "mean error": mean, "max error": worst, "largest second difference": jump})
        images[mode] = image, f"mean {mean:.1e}, jumps {jump:.1e}"
    images["32 parts"] = truth, "reference"
    write_rows(folder, "figure2", "Two surfaces that leave one step: light against 32 parts, and its jumps", rows)
    figure = Figure(figsize=(7, 6.2), layout="constrained")
    for axes, (title, (image, said)) in zip(figure.subplots(len(images), 1), images.items(), strict=True):
        axes.imshow(linear_to_srgb(np.clip(image.rgba[..., :3], 0, 1)), interpolation="nearest")
        axes.set(title=f"{title}: {said}", xticks=[], yticks=[])
    save_figure(figure, folder / "figure2")
    jumps = {row["mode"]: row["largest second difference"] for row in rows}
    return (
        f"Along a scan line the closest surface's light jumps by {jumps['closest-isosurface']:.1e}, that of each "
        f"surface by {jumps['isosurface']:.1e}, interpolated light by {jumps['interpolated']:.1e}, one sample's by "
        f"{jumps['center']:.1e}."
    )


@STUDY.part("Figure 7")
def figure7(folder: Path, quick: bool) -> str:
    """Many transparent surfaces."""
    return lit_panels(folder, "figure7", make_scene("vortex", quick), ("center", "interpolated"))


@STUDY.part("Figure 8")
def figure8(folder: Path, quick: bool) -> str:
    """Teeth, thin and bright: standard light, special-case surfaces and interpolated light; and the same of Bonsai."""
    scene = make_scene("skull", quick)
    if not quick and views.is_there("cthead"):
        scene = replace(scene, transfer_function=spikes([1500], ["ivory"], 0.95, 150.0))
        # From the front.
        scene = replace(scene, camera=wvr.Camera.fit(scene.volume, direction=(0.3, -1, 0), up=(0, 0, -1)))
        low, high = scene.volume.corners.min(axis=0), scene.volume.corners.max(axis=0)
        target = low + np.array(TEETH) * (high - low)
        position = np.array(scene.camera.position) - scene.camera.target + target
        scene = replace(scene, camera=wvr.Camera(position, target, up=(0, 0, -1), view_angle=5.0))
    shown = ("center", "isosurface", "interpolated")
    teeth = lit_panels(folder, "figure8", scene, shown)
    bonsai = lit_panels(folder, "figure8-bonsai", make_scene("bonsai", quick), shown)
    return f"Teeth: {teeth} Bonsai: {bonsai}"


# Where the teeth are, in parts of the volume's box.
TEETH = (0.5, 0.15, 0.76)


@STUDY.part("Colour plates")
def plates(folder: Path, quick: bool) -> str:
    """The bucky ball, plate 1, and its middle, plates 2 and 3."""
    scene = make_scene("bucky", quick)
    first = lit_panels(folder, "plate1", scene, ("interpolated",))
    return f"Whole: {first} Middle: {lit_panels(folder, 'plates', scene, ('interpolated', 'center'), zoom=2)}"
