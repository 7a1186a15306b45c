"""Lum, Wilson and Ma, "High-Quality Lighting and Efficient Pre-Integration for Volume Rendering" (2004): section 3.

What each way to light a pre-integrated segment is off by, against many parts of the same linear scalar, so that light
alone is compared; how many samples a voxel one sample of light needs to catch up; Table 2 (frames a second); Figures 1,
2, 7, 8 and the colour plates. Volumes of ``../shared/data`` where they lie there, else generated ones stand in.
``python -m studies.lighting [--quick]``.
"""

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from benchmarks.harness import COLORS, save_figure
from wvr.color import linear_to_srgb
from wvr.integrators import Integrator
from wvr.lighting import MODES

from .campagnolo2015 import DATA
from .common import output, seconds, write_rows

# Table 2 of the paper, frames a second: (interpolated, single sample).
PAPER = {
    ("skull", True): (4.4, 5.0),
    ("skull", False): (2.2, 2.6),
    ("vortex", True): (8.1, 10.5),
    ("vortex", False): (5.4, 8.1),
}
LIGHT = wvr.DirectionalLight((1.0, 0.8, 1.0))
# One part of a linear scalar is lit as by the tables, but from control point to control point.
EXACT = "interpolated, without a table"
STEPS = (1.0, 0.5, 0.25, 0.125)


@dataclass(frozen=True)
class Scene:
    """What is lit, and from where it is seen."""

    name: str
    volume: wvr.Volume
    tf: wvr.TransferFunction
    camera: wvr.Camera

    def renderer(self, step: float, entries: int = 8) -> wvr.Renderer:
        """With tables so dense, ``entries`` for a 255th of the range, that their own error does not count."""
        integrator = wvr.Preintegrated(step, table_size=255 * entries + 1)
        return wvr.Renderer(self.volume, self.tf, integrator=integrator, termination=0)

    def render(self, renderer: wvr.Renderer, mode: str, size: int, parts: int = 32) -> wvr.Image:
        """Lit segments."""
        renderer.lighting = wvr.Lighting(mode, LIGHT, supersample=parts)
        return renderer.render(self.camera, (size, size))


def spikes(scalars: list[float], colors: list[str], opacity: float = 0.6, width: float = 2.0) -> wvr.TransferFunction:
    """Isosurfaces two values wide."""
    return wvr.TransferFunction.isosurfaces(scalars, colors=colors, opacity=opacity, width=width)


def scenes(quick: bool) -> dict[str, Scene]:
    """By name; what the paper calls skull and vortex are stand-ins."""
    n = 32 if quick else 128

    def scene(
        name: str, stem: str | None, generated: str, tf: wvr.TransferFunction, direction: tuple, up: tuple = (0, 0, 1)
    ) -> Scene:
        path = DATA / f"{stem}.nrrd"
        if stem is not None and path.exists() and not quick:
            volume = wvr.read(path)
        else:
            data = wvr.datasets.load(generated, n).numpy().astype(np.float64)
            low, high = tf.knots[0], tf.knots[-1]
            # The same transfer function fits: from below its first control point to above its last.
            margin = 0.1 * (high - low)
            share = (data - data.min()) / (data.max() - data.min())
            volume = wvr.Volume((low - margin + share * (high - low + 2 * margin)).astype(np.float32))
        return Scene(name, volume, tf, wvr.Camera.fit(volume, direction=direction, up=up))

    three = ["tab:red", "tab:green", "tab:blue"]
    x = np.linspace(-1, 1, n)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(x, x, x)))
    sphere = wvr.Volume((255 * np.clip(1 - radius, 0, 1)).astype(np.float32))
    made = [
        Scene("sphere", sphere, spikes([60, 120, 180], three, 0.4), wvr.Camera.fit(sphere, direction=(1, 0.6, 0.4))),
        scene("engine", "engine", "spheres", spikes([130, 210], ["tab:gray", "tab:orange"], 0.8), (1, 0.6, 0.5)),
        scene(
            "bonsai",
            "bonsai",
            "blobs",
            spikes([50, 90, 150], ["tab:green", "tab:orange", "tab:brown"], 0.8, 6.0),
            (1, 0.3, 0.5),
            (0, 1, 0),
        ),
        scene("bucky", "bucky", "spheres", spikes([80, 140, 200], three, 0.8, 8.0), (1, 0.7, 0.5)),
        scene(
            "skull", "cthead", "spheres", spikes([600, 1300], ["peru", "ivory"], 0.6, 60.0), (0.4, -1, -0.2), (0, 0, -1)
        ),
        scene("vortex", None, "turbulence", spikes([90, 130, 170], three, 0.8, 4.0), (1, 0.6, 0.4)),
    ]
    return {one.name: one for one in made}


def color_error(image: wvr.Image, truth: wvr.Image) -> tuple[float, float]:
    """Mean and largest difference of a colour channel, of the pixels that show anything."""
    seen = truth.rgba[..., 3] > 0
    difference = np.abs(image.rgba[..., :3] - truth.rgba[..., :3])[seen]
    return float(difference.mean()), float(difference.max())


def modes(folder: Path, made: dict[str, Scene], size: int, entries: int) -> None:
    """What light alone is off by in each mode, and when the standard one catches up."""
    rows, chart = [], {}
    for name in ("sphere", "engine", "bonsai"):
        scene = made[name]
        errors: dict[str, list[float]] = {mode: [] for mode in (*MODES[:-1], EXACT)}
        for step in STEPS:
            renderer = scene.renderer(step, entries)
            truth = scene.render(renderer, "supersampled", size)
            for mode, found in errors.items():
                shown = ("supersampled", size, 1) if mode == EXACT else (mode, size)
                found.append(color_error(scene.render(renderer, *shown), truth)[0])
        chart[name] = errors
        reach = [
            step for step, error in zip(STEPS, errors["center"], strict=True) if error <= errors["interpolated"][0]
        ]
        for mode, found in errors.items():
            row = {"scene": name, "mode": mode} | {
                f"{1 / step:g} a voxel": error for step, error in zip(STEPS, found, strict=True)
            }
            row["order"] = -float(np.polyfit(np.log(1 / np.array(STEPS)), np.log(found), 1)[0])
            row["over center"] = found[0] / errors["center"][0]
            if mode == "center":
                row["as good as interpolated at 1"] = f"{1 / reach[0]:g} a voxel" if reach else "none of these"
            rows.append(row)
    title = f"Mean error of light alone, {size} x {size}; against 32 parts of the same linear scalar"
    write_rows(folder, "modes", title, rows)
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for axes, (name, errors) in zip(figure.subplots(1, len(chart), sharey=True), chart.items(), strict=True):
        for i, (mode, found) in enumerate(errors.items()):
            axes.loglog([1 / step for step in STEPS], found, marker="os^vDP"[i], ms=4, color=COLORS[i], label=mode)
        axes.set(title=name, xlabel="samples a voxel")
        axes.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        axes.minorticks_off()
        axes.grid(color="0.9")
    figure.axes[0].set_ylabel("mean error of a colour channel")
    figure.axes[0].legend(frameon=False, fontsize="x-small")
    save_figure(figure, folder / "modes")


def timed(scene: Scene, mode: str, skip: bool) -> wvr.Renderer:
    """As a user would render it, one sample a voxel."""
    lighting = wvr.Lighting(mode, LIGHT)
    return wvr.Renderer(scene.volume, scene.tf, integrator=wvr.Preintegrated(1.0), lighting=lighting, skip_empty=skip)


def table2(folder: Path, made: dict[str, Scene], size: int) -> None:
    """Frames a second of interpolated light and of one sample, with and without leaping over empty space."""
    rows = []
    for name in ("skull", "vortex"):
        scene = made[name]
        for skip in (True, False):
            rate = {
                mode: 1 / seconds(partial(timed(scene, mode, skip).render, scene.camera, (size, size)))
                for mode in ("interpolated", "center")
            }
            ours, paper = rate["center"] / rate["interpolated"], PAPER[name, skip]
            rows.append(
                {
                    "scene": name,
                    "skips empty": "yes" if skip else "no",
                    "interpolated fps": rate["interpolated"],
                    "single sample fps": rate["center"],
                    "times as long": ours,
                    "paper interpolated fps": paper[0],
                    "paper single sample fps": paper[1],
                    "paper times as long": paper[1] / paper[0],
                }
            )
    title = (
        f"Lum et al. 2004, Table 2, stand-ins for skull and vortex, {size} x {size}, {wvr.get_num_threads()} threads"
    )
    write_rows(folder, "table2", title, rows)


def panels(folder: Path, name: str, images: dict[str, tuple[wvr.Image, str]], zoom: int = 1) -> None:
    """Images side by side, cut to what there is to see or the middle of it, with what is said of each."""
    seen = np.argwhere(next(iter(images.values()))[0].rgba[..., 3] > 0)
    low, high = seen.min(axis=0), seen.max(axis=0) + 1
    middle, half = (low + high) // 2, int((high - low).max() // (2 * zoom)) + 2
    figure = Figure(figsize=(3.1 * len(images), 3.7), layout="constrained")
    for axes, (title, (image, said)) in zip(np.ravel(figure.subplots(1, len(images))), images.items(), strict=True):
        pixels: NDArray = linear_to_srgb(np.clip(image.rgba[..., :3], 0, 1))
        rows, columns = (slice(max(m - half, 0), m + half) for m in middle)
        axes.imshow(pixels[rows, columns], interpolation="nearest")
        axes.set_title(f"{title}\n{said}", fontsize="small")
        axes.axis("off")
    save_figure(figure, folder / name)


def lit_panels(folder: Path, figure: str, scene: Scene, shown: tuple[str, ...], size: int, zoom: int = 1) -> None:
    """Modes at one sample a voxel beside many parts; a zoom shows the middle."""
    renderer = scene.renderer(1.0, 4)
    truth = scene.render(renderer, "supersampled", size)
    images = {}
    for mode in shown:
        image = scene.render(renderer, mode, size)
        images[mode] = image, "mean error {:.1e}, max {:.2f}".format(*color_error(image, truth))
    images["32 parts"] = truth, "reference"
    panels(folder, figure, images, zoom)


def discontinuities(folder: Path, size: int) -> None:
    """Figure 2: nested surfaces within one step of each other; second differences along a scan line say what jumps."""
    n = 64
    x = np.linspace(-1, 1, n)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(x, x, x)))
    # Clipped to where the surfaces are, so that the table is dense there.
    volume = wvr.Volume(np.clip(255 * (1 - radius), 96, 112).astype(np.float32))
    tf = spikes([100, 104, 108], ["tab:red", "tab:green", "tab:blue"], 0.9, 1.0)
    scene = Scene("nested", volume, tf, wvr.Camera.fit(volume, direction=(1, 0.6, 0.4)))
    renderer = scene.renderer(2.0, 4)
    truth = scene.render(renderer, "supersampled", size)
    rows, images = [], {}
    for mode in ("center", "closest-isosurface", "isosurface", "interpolated"):
        image = scene.render(renderer, mode, size)
        line = image.rgba[size // 2, :, :3] - truth.rgba[size // 2, :, :3]
        mean, worst = color_error(image, truth)
        jump = float(np.abs(np.diff(line, 2, axis=0)).max())
        rows.append({"mode": mode, "mean error": mean, "max error": worst, "largest second difference": jump})
        images[mode] = image, f"mean error {mean:.1e}, jumps {jump:.3f}"
    images["32 parts"] = truth, "reference"
    title = "Three surfaces within a step: light against 32 parts, and second differences of it along a scan line"
    write_rows(folder, "figure2", title, rows)
    panels(folder, "figure2", images)


def figure1(folder: Path, scene: Scene, size: int) -> None:
    """Two thin surfaces: point samples miss them, pre-integrated segments do not."""
    lighting = wvr.Lighting(light=LIGHT)
    truth = wvr.render(scene.volume, scene.tf, scene.camera, (size, size), integrator=wvr.Exact(), lighting=lighting)
    images = {}
    methods: dict[str, Integrator] = {
        "point samples": wvr.Riemann(1.0),
        "pre-integrated": wvr.Preintegrated(1.0),
        "certified": wvr.Certified(1e-3),
    }
    for name, integrator in methods.items():
        image = wvr.render(scene.volume, scene.tf, scene.camera, (size, size), integrator=integrator, lighting=lighting)
        images[name] = image, "mean error {:.1e}, max {:.2f}".format(*color_error(image, truth))
    images["exact"] = truth, "reference"
    panels(folder, "figure1", images)


def main(*arguments: str) -> None:
    """Run all parts; ``--quick`` is small."""
    quick = "--quick" in arguments
    folder = output("lum2004")
    size = 48 if quick else 384
    made = scenes(quick)
    modes(folder, made, size, 2 if quick else 8)
    table2(folder, made, 64 if quick else 512)
    discontinuities(folder, size)
    figure1(folder, made["engine"], size)
    lit_panels(folder, "figure7", made["vortex"], ("center", "interpolated"), size)
    lit_panels(folder, "figure8", made["bonsai"], ("center", "isosurface", "interpolated"), size)
    lit_panels(folder, "plates", made["bucky"], ("interpolated", "center"), size, zoom=2)


if __name__ == "__main__":
    main(*sys.argv[1:])
