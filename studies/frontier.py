"""Speed against accuracy: every integrator over its step or tolerance, on scans and generated volumes.

``python -m studies.frontier [--quick]``. For each volume a chart and a table: median seconds a frame, largest and mean
error of all channels against ``Exact``, with a smooth, a sharp (isosurfaces two grey levels wide) and an opaque
transfer function; VTK's processor ray caster among them. Then time against size of the volume and of the image, against
how much of the volume is visible, and against threads.

Scans are those in ``../shared/data``; generated volumes need nothing. Seconds are those of a frame of a renderer that
has its tables. A ray ends when no more is left than the method may err by: a quarter of the tolerance, or, of a step h,
h^order / 1024, so that no method waits for what it cannot see. VTK ends where its fixed point does; its image has 8
bits a channel and is drawn about a pixel wider than its rays are apart, as its largest errors, at outlines, show.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

import wvr
from benchmarks.harness import COLORS, Contender, interleave, save_figure, timed
from benchmarks.scenes import Scene
from benchmarks.vtk_cpu import NotAvailableError, VtkCpu
from wvr.color import linear_to_srgb
from wvr.integrators import Integrator

from .common import output, write_rows

DATA = Path(__file__).parents[1] / "../shared/data"
STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


@dataclass(frozen=True)
class Method:
    """An integrator as a function of its step or tolerance, and how its line is drawn."""

    name: str
    make: Callable[[float], Integrator]
    values: Sequence[float]
    color: str
    style: str

    def termination(self, value: float) -> float:
        """What the method may err by anyway."""
        return value / 4 if self.values is TOLERANCES else min(value, 1.0) ** self.make(value).order / 1024


METHODS = (
    Method("Riemann, left", lambda h: wvr.Riemann(h, "left"), STEPS, COLORS[0], "<:"),
    Method("Riemann, midpoint", wvr.Riemann, STEPS, COLORS[0], "o-"),
    Method("Riemann, trapezoid", lambda h: wvr.Riemann(h, "trapezoid"), STEPS, COLORS[0], "s--"),
    Method("Simpson", wvr.Simpson, STEPS, COLORS[1], "^-"),
    Method("Preintegrated", wvr.Preintegrated, STEPS, COLORS[2], "D-"),
    Method("AdaptivePreintegrated", wvr.AdaptivePreintegrated, TOLERANCES, COLORS[5], "s-"),
    Method("Certified", wvr.Certified, TOLERANCES, COLORS[4], "o-"),
    Method("AdaptiveSimpson, coupled", lambda e: wvr.AdaptiveSimpson(e, scope="ray"), TOLERANCES, COLORS[3], "v-"),
    Method(
        "AdaptiveSimpson, decoupled",
        lambda e: wvr.AdaptiveSimpson(e, coupling="decoupled", scope="ray"),
        TOLERANCES,
        COLORS[3],
        "P--",
    ),
)
# What uint8 samples are multiplied by: on uint16 VTK is more accurate.
VTK = {"VTK": 1, "VTK, uint16": 257}
VTK_STYLES = {"VTK": "x-", "VTK, uint16": "+--"}
VTK_STEPS = STEPS[:-1]

# Of a volume: scalars of three surfaces, from where on it is visible, and the direction towards the camera, and up.
SCANS: dict[str, tuple[tuple[float, float, float], float, tuple, tuple]] = {
    "bonsai": ((40, 110, 180), 25, (0.35, 0.25, 1), (0, 1, 0)),
    "bluntfin": ((0.8, 1.3, 2.5), 0.5, (-0.6, 0.55, 0.65), (0, 1, 0)),
    "engine": ((90, 150, 210), 70, (0.8, -0.7, -0.6), (0, 0, -1)),
    "aneurism": ((50, 110, 180), 25, (1, 0.6, 0.4), (0, 0, 1)),
}
GENERATED = {
    "blobs": ((90, 140, 200), 60, (1, 0.6, 0.4), (0, 0, 1)),
    "tree": ((40, 120, 180), 15, (1, 0.5, 0.35), (0, 0, 1)),
    "marschner_lobb": ((0.3, 0.5, 0.7), 0.2, (1, 0.6, 0.4), (0, 0, 1)),
    "turbulence": ((1.0, 1.5, 2.0), 0.7, (1, 0.6, 0.4), (0, 0, 1)),
}
PAINT = ((0.10, 0.35, 0.75), (0.90, 0.60, 0.10), (0.80, 0.15, 0.10))


def make_volumes(quick: bool) -> Iterable[tuple[str, wvr.Volume]]:
    """The scans that are there, and the generated volumes."""
    for name in () if quick else SCANS:
        if (path := DATA / f"{name}.nrrd").exists():
            yield name, wvr.read(path)
    for name in ("blobs",) if quick else GENERATED:
        yield name, wvr.datasets.load(name, 32 if quick else 256)


def make_scenes(name: str, volume: wvr.Volume, size: tuple[int, int]) -> dict[str, Scene]:
    """By transfer function: a volume in perspective."""
    surfaces, threshold, direction, up = (SCANS | GENERATED)[name]
    low, high = volume.range
    ramp = (threshold, *surfaces)
    colors = (PAINT[0], *PAINT)

    def rising(*opacities: float) -> wvr.TransferFunction:
        return wvr.TransferFunction(zip(ramp, colors, (0.0, *opacities), strict=True))

    transfer_functions = {
        "smooth": rising(0.01, 0.03, 0.08),
        "sharp": wvr.TransferFunction.isosurfaces(surfaces, PAINT, opacity=0.6, width=2 * (high - low) / 255),
        "opaque": rising(0.4, 0.8, 0.95),
    }
    camera = wvr.Camera.fit(volume, direction=direction, up=up)
    return {kind: Scene(name, volume, tf, camera, size) for kind, tf in transfer_functions.items()}


# --- Time against error -----------------------------------------------------------------------------------------------


def frontier(folder: Path, name: str, scenes: Mapping[str, Scene], rounds: int, quick: bool) -> None:
    """Every method on every scene of a volume: the table and the chart."""
    rows: list[dict[str, Any]] = []
    pictures = {}
    for kind, scene in scenes.items():
        exact = wvr.render(
            scene.volume, scene.transfer_function, scene.camera, scene.size, integrator=wvr.Exact(), device="cpu"
        )
        pictures[kind] = np.clip(linear_to_srgb(exact.composited("white")), 0, 1)
        rows += ({"volume": name, "scene": kind} | row for row in _measure(scene, exact.rgba, rounds, quick))
    size = scenes["smooth"].measures
    write_rows(folder, name, f"{name}: {size}, {wvr.get_num_threads()} threads", rows)
    save_figure(_frontier_chart(rows, pictures, f"{name}: {size}"), folder / name)


def _measure(scene: Scene, exact: NDArray[np.floating], rounds: int, quick: bool) -> list[dict[str, Any]]:
    """A row for each method and parameter; all take turns."""
    images: dict[str, NDArray] = {}
    rows: dict[str, dict[str, Any]] = {}
    contenders: dict[str, Contender] = {}

    def add(method: str, value: float, contend: Callable[[str], Contender]) -> None:
        key = f"{method} {value:g}"
        rows[key] = {"method": method, "step or tolerance": value}
        contenders[key] = contend(key)

    for method in METHODS:
        for value in method.values[:2] if quick else method.values:
            renderer = wvr.Renderer(
                scene.volume,
                scene.transfer_function,
                integrator=method.make(value),
                termination=method.termination(value),
                device="cpu",
            )
            add(method.name, value, lambda key, r=renderer: _frame(images, key, r, scene))  # type: ignore[misc]
    with ExitStack() as stack:
        for name, scale in VTK.items():
            if scale > 1 and scene.volume.dtype != np.uint8:
                continue
            vtk = stack.enter_context(VtkCpu(scene, scale, wvr.get_num_threads()))
            try:
                for value in VTK_STEPS[:2] if quick else VTK_STEPS:
                    vtk.frame(value)
                    images[f"{name} {value:g}"] = vtk.image()
                    add(name, value, lambda key, v=vtk, h=value: lambda: v.frame(h))  # type: ignore[misc]
            except NotAvailableError as error:
                print(f"{name} is not available: {error}")
        times = interleave(contenders, rounds)
    for key, row in rows.items():
        errors = wvr.compare(images[key], exact)
        row |= {"seconds": median(t.wall for t in times[key]), "max error": errors.max, "mean error": errors.mean}
    return list(rows.values())


def _frame(images: dict[str, NDArray], key: str, renderer: wvr.Renderer, scene: Scene) -> Contender:
    def work() -> None:
        images[key] = renderer.render(scene.camera, scene.size).rgba

    return timed(work)


def _frontier_chart(rows: list[dict[str, Any]], pictures: Mapping[str, NDArray], title: str) -> Figure:
    """A column for each transfer function: the scene, largest error and mean error over time."""
    styles = {m.name: (m.color, m.style) for m in METHODS} | {n: (COLORS[6], s) for n, s in VTK_STYLES.items()}
    figure = Figure(figsize=(10, 10), layout="constrained")
    panels = figure.subplots(3, len(pictures), height_ratios=[1, 1.15, 1.15])
    for column, (kind, picture) in zip(panels.T, pictures.items(), strict=True):
        column[0].imshow(picture)
        column[0].set(title=kind, xticks=[], yticks=[])
        for axes, error in zip(column[1:], ("max error", "mean error"), strict=True):
            axes.sharex(panels[1, 0])
            axes.sharey(panels[list(column).index(axes), 0])
            for name, (color, style) in styles.items():
                points = [(r["seconds"], r[error]) for r in rows if r["scene"] == kind and r["method"] == name]
                if points:
                    axes.plot(*zip(*points, strict=True), style, color=color, label=name, ms=4.5, lw=1.2)
            axes.set(xscale="log", yscale="log")
            _plain_seconds(axes.xaxis)
            axes.grid(color="0.9")
        column[2].set_xlabel("time a frame [s]")
    panels[1, 0].set_ylabel("largest error of a channel in [0, 1]")
    panels[2, 0].set_ylabel("mean error of all channels in [0, 1]")
    figure.suptitle(title)
    figure.legend(*panels[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _plain_seconds(axis: Axis) -> None:
    """Ticks such as 0.05 instead of powers of ten."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


# --- Time against size ------------------------------------------------------------------------------------------------

SCALED: dict[str, Integrator] = {
    "Riemann(1)": wvr.Riemann(1.0),
    "Preintegrated(0.5)": wvr.Preintegrated(0.5),
    "Certified(1/512)": wvr.Certified(1 / 512),
    "AdaptiveSimpson(1/512)": wvr.AdaptiveSimpson(1 / 512, scope="ray"),
}


def scaling(folder: Path, rounds: int, quick: bool) -> None:
    """One chart and table: time against each size, all else being equal."""
    base = 24 if quick else 256
    pixels = 32 if quick else 512
    rows: list[dict[str, Any]] = []

    def measure(against: str, cases: Iterable[tuple[float, Scene]]) -> None:
        for x, scene in cases:
            rows.extend({"against": against, "x": x} | row for row in _seconds(scene, rounds))

    def blobs(n: int, size: int) -> Scene:
        return make_scenes("blobs", wvr.datasets.load("blobs", n), (size, size))["smooth"]

    measure(
        "samples along an axis of the volume", ((n, blobs(n, pixels)) for n in (base // 4, base // 2, base, 2 * base))
    )
    fog = blobs(base, pixels)
    sizes = [pixels // 4, pixels // 2, pixels, 2 * pixels]
    measure("pixels along a side of the image", ((n, blobs(base, n)) for n in sizes))
    measure("visible blocks [%]", _occupancies(fog))
    measure("threads", _threads(fog))
    write_rows(folder, "scaling", f"Seconds a frame; {fog.measures} where nothing else is said", rows)
    save_figure(_scaling_chart(rows), folder / "scaling")


def _seconds(scene: Scene, rounds: int) -> list[dict[str, Any]]:
    renderers = {
        name: wvr.Renderer(scene.volume, scene.transfer_function, integrator=integrator, device="cpu")
        for name, integrator in SCALED.items()
    }
    contenders = {
        name: timed(lambda r=renderer: r.render(scene.camera, scene.size))  # type: ignore[misc]
        for name, renderer in renderers.items()
    }
    times = interleave(contenders, rounds)
    return [{"method": name, "seconds": median(t.wall for t in runs)} for name, runs in times.items()]


def _occupancies(scene: Scene) -> Iterable[tuple[float, Scene]]:
    """The scene with ever less of it visible, thin enough for every ray to go through."""
    samples = scene.volume.numpy()
    pieces = [range(0, n - 1, 8) for n in samples.shape]
    largest = np.array(
        [samples[k : k + 9, j : j + 9, i : i + 9].max() for k in pieces[0] for j in pieces[1] for i in pieces[2]]
    )
    for share in (1.0, 0.5, 0.2, 0.1, 0.05, 0.02):
        threshold = float(np.quantile(largest, 1 - share))
        tf = wvr.TransferFunction([(threshold, PAINT[0], 0.0), (255, PAINT[1], 0.02)])
        visible = round(100 * float(np.mean(largest > threshold)), 1)
        if visible > 0:
            yield visible, Scene(scene.name, scene.volume, tf, scene.camera, scene.size)


def _threads(scene: Scene) -> Iterable[tuple[float, Scene]]:
    """The scene as it is, on ever more threads."""
    before = wvr.get_num_threads()
    try:
        for n in sorted({1, 2, before}):
            wvr.set_num_threads(n)
            yield n, scene
    finally:
        wvr.set_num_threads(before)


def _scaling_chart(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(9, 6.6), layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    for axes, against in zip(panels.flat, dict.fromkeys(row["against"] for row in rows), strict=True):
        for i, name in enumerate(SCALED):
            points = [(r["x"], r["seconds"]) for r in rows if r["against"] == against and r["method"] == name]
            axes.plot(*zip(*points, strict=True), "osD^v"[i] + "-", color=COLORS[i], label=name, ms=5)
        axes.set(xscale="log", yscale="log", xlabel=against)
        ticks = sorted({row["x"] for row in rows if row["against"] == against})
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_major_formatter("{x:.4g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(color="0.9")
    for axes in panels[:, 0]:
        axes.set_ylabel("time a frame [s]")
        _plain_seconds(axes.yaxis)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    return figure


def main(*arguments: str) -> None:
    """Run all parts; ``--quick`` is small and takes generated volumes."""
    quick = "--quick" in arguments
    folder = output("frontier")
    rounds = 1 if quick else 3
    for name, volume in make_volumes(quick):
        frontier(folder, name, make_scenes(name, volume, (64, 64) if quick else (512, 512)), rounds, quick)
    scaling(folder, rounds, quick)


if __name__ == "__main__":
    main(*sys.argv[1:])
