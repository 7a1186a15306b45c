"""Time against error of every integrator, on scans and simulations, and time against size.

For each volume a chart and a table: median seconds a frame, largest and mean error of all channels against ``Exact``,
with a smooth, a sharp (isosurfaces two grey levels wide) and an opaque transfer function; VTK's processor ray caster
and OSPRay among them. Then certified images that are asked to be as accurate as each of these was found to be, and time
against size of the volume and of the image, against how much of the volume is visible, and against threads.

Seconds are those of a frame of a renderer that has its tables. A ray ends when no more is left than the method may err
by: a quarter of the tolerance, or, of a step h, h^order / 1024, so that no method waits for what it cannot see. VTK
ends where its fixed point does; its image has 8 bits a channel and is drawn about a pixel wider than its rays are
apart, as its largest errors, at outlines, show. OSPRay's last step reaches beyond the volume.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

import wvr
from wvr.integrators import Integrator

from .base import scenes as views
from .base.harness import COLORS, Contender, interleave, save_figure, timed
from .base.ospray_cpu import OsprayCpu
from .base.peer import Peer
from .base.rows import write_rows
from .base.scenes import Scene, picture
from .base.study import Study
from .base.vtk_cpu import VtkCpu

STUDY = Study("frontier", "Time against error of every integrator")

STEPS: Sequence[float] = (2.0, 1.0, 0.5, 0.25, 0.125)
TOLERANCES: Sequence[float] = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
QUICK = slice(1, 3)  # of the steps or tolerances
# Slow frames are measured once; of fast ones the median is taken over as many as fit into these seconds, up to 7.
PATIENCE = 2.0


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
# Other renderers: a process for a scene and a number of threads, and how their lines are drawn.
PEERS: Mapping[str, tuple[Callable[[Scene, int], Peer], str, str]] = {
    "VTK": (lambda scene, threads: VtkCpu(scene, 1, threads), COLORS[6], "x-"),
    "VTK, uint16": (lambda scene, threads: VtkCpu(scene, 257, threads), COLORS[6], "+--"),
    "OSPRay": (OsprayCpu, COLORS[7], "x-"),
}
PEER_STEPS = STEPS[:-1]

# Of a volume: where three surfaces are, and from where on it is visible, as shares of its range.
SURFACES = {
    "bonsai": ((0.16, 0.43, 0.71), 0.1),
    "bluntfin": ((0.17, 0.27, 0.52), 0.1),
    "aneurism": ((0.2, 0.43, 0.71), 0.1),
    "blobs": ((0.35, 0.55, 0.78), 0.24),
}
PAINT = ((0.10, 0.35, 0.75), (0.90, 0.60, 0.10), (0.80, 0.15, 0.10))


def make_scenes(name: str, volume: wvr.Volume, size: tuple[int, int]) -> dict[str, Scene]:
    """By transfer function: a volume in perspective."""
    low, high = volume.range
    surfaces, threshold = (low + (high - low) * np.array(shares) for shares in SURFACES[name])
    ramp = (threshold, *surfaces)
    colors = (PAINT[0], *PAINT)

    def rising(*opacities: float) -> wvr.TransferFunction:
        return wvr.TransferFunction(zip(ramp, colors, (0.0, *opacities), strict=True))

    transfer_functions = {
        "smooth": rising(0.01, 0.03, 0.08),
        "sharp": wvr.TransferFunction.isosurfaces(surfaces, PAINT, opacity=0.6, width=2 * (high - low) / 255),
        "opaque": rising(0.4, 0.8, 0.95),
    }
    camera = views.camera(name, volume)
    return {kind: Scene(name, volume, tf, camera, size) for kind, tf in transfer_functions.items()}


# --- Time against error -----------------------------------------------------------------------------------------------


@STUDY.part("Time against error: Bonsai")
def bonsai(folder: Path, quick: bool) -> str:
    """CT of a tree: leaves and branches in empty space."""
    return frontier(folder, "bonsai", quick)


@STUDY.part("Time against error: BluntFin")
def bluntfin(folder: Path, quick: bool) -> str:
    """Density of a flow, floats: smooth, visible nearly everywhere."""
    return frontier(folder, "bluntfin", quick)


@STUDY.part("Time against error: Aneurism")
def aneurism(folder: Path, quick: bool) -> str:
    """Angiogram: vessels, 99 % of the volume empty."""
    return frontier(folder, "aneurism", quick)


def frontier(folder: Path, name: str, quick: bool) -> str:
    """Every method on every scene of a volume: the table, the chart, and what follows."""
    volume = views.load(name, quick)
    scenes = make_scenes(name, volume, (64, 64) if quick else (320, 320))
    rows: list[dict[str, Any]] = []
    pictures = {}
    for kind, scene in scenes.items():
        exact = scene.render(wvr.Exact(), device="cpu")
        pictures[kind] = picture(exact)
        rows += ({"volume": name, "scene": kind} | row for row in _measure(scene, exact.rgba, quick))
    size = scenes["smooth"].measures
    write_rows(folder, name, f"{name}: {size}, {wvr.get_num_threads()} threads", rows)
    save_figure(_frontier_chart(rows, pictures, f"{name}: {size}"), folder / name)
    save_figure(_short_chart(rows), folder / f"{name}-short")
    return " ".join(_finding(kind, [row for row in rows if row["scene"] == kind]) for kind in scenes)


GOAL = 1e-3


def _finding(kind: str, rows: list[dict[str, Any]]) -> str:
    """Who is first below an error, largest and mean, and what peers reach."""

    def first(error: str) -> str:
        there = [row for row in rows if row[error] <= GOAL]
        if not there:
            return f"no method has a {error} below {GOAL:g}"
        best = min(there, key=lambda row: row["seconds"])
        return f"a {error} below {GOAL:g} is first reached by {_called(best)}, in {best['seconds']:.2g} s"

    said = [f"{kind.capitalize()}: {first('max error')}; {first('mean error')}."]
    for peer in PEERS:
        if not (theirs := [row for row in rows if row["method"] == peer]):
            continue
        best = min(theirs, key=lambda row: row["mean error"])
        faster = [row for row in rows if row["seconds"] <= best["seconds"] and row["method"] not in PEERS]
        ours = min(faster, key=lambda row: row["mean error"], default=None)
        than = (
            "nothing of wvr is as fast"
            if ours is None
            else f"{_called(ours)} is as fast and has {ours['mean error']:.1e}"
        )
        said.append(f"{peer}'s smallest mean error is {best['mean error']:.1e}, in {best['seconds']:.2g} s; {than}.")
    return " ".join(said)


def _called(row: dict[str, Any]) -> str:
    return f"{row['method']} {row['step or tolerance']:g}"


def _measure(scene: Scene, exact: NDArray[np.floating], quick: bool) -> list[dict[str, Any]]:
    """A row for each method and parameter; all take turns."""
    images: dict[str, NDArray] = {}
    rows: dict[str, dict[str, Any]] = {}
    contenders: dict[str, Contender] = {}

    def add(method: str, value: float, contend: Callable[[str], Contender]) -> None:
        key = f"{method} {value:g}"
        rows[key] = {"method": method, "step or tolerance": value}
        contenders[key] = contend(key)

    for method in METHODS:
        for value in method.values[QUICK] if quick else method.values:
            renderer = scene.renderer(method.make(value), termination=method.termination(value), device="cpu")
            add(method.name, value, lambda key, r=renderer: _frame(images, key, r, scene))  # type: ignore[misc]
    with ExitStack() as stack:
        for name, peer in _peers(stack, scene, quick).items():
            for value in PEER_STEPS[QUICK] if quick else PEER_STEPS:
                peer.frame(value)
                images[f"{name} {value:g}"] = peer.image()
                add(name, value, lambda key, p=peer, h=value: lambda: p.frame(h))  # type: ignore[misc]
        times = take_turns(contenders, quick)
    for key, row in rows.items():
        errors = wvr.compare(images[key], exact)
        row |= {"seconds": times[key], "max error": errors.max, "mean error": errors.mean}
    return list(rows.values())


def _peers(stack: ExitStack, scene: Scene, quick: bool) -> dict[str, Peer]:
    """Those that can render a scene here, running as long as ``stack`` is open."""
    there = {}
    for name, (start, _, _) in PEERS.items():
        # On uint8 samples that are spread over uint16 VTK is more accurate.
        if name == "VTK, uint16" and (quick or scene.volume.dtype != np.uint8):
            continue
        peer = stack.enter_context(start(scene, wvr.get_num_threads()))
        if why := peer.missing():
            print(f"{name} is not available: {why}")
        else:
            there[name] = peer
    return there


def take_turns(contenders: Mapping[str, Contender], quick: bool) -> dict[str, float]:
    """Median seconds of contenders that take turns, slow ones less often."""
    first = {name: run().wall for name, run in contenders.items()}
    rounds = {name: 1 if quick else int(np.clip(PATIENCE / wall, 1, 7)) for name, wall in first.items()}
    most = max(rounds.values())
    times = interleave(contenders, most, {name: -(-most // n) for name, n in rounds.items()})
    return {name: median(t.wall for t in runs) for name, runs in times.items()}


def _frame(images: dict[str, NDArray], key: str, renderer: wvr.Renderer, scene: Scene) -> Contender:
    def work() -> None:
        images[key] = renderer.render(scene.camera, scene.size).rgba

    return timed(work)


def _frontier_chart(rows: list[dict[str, Any]], pictures: Mapping[str, NDArray], title: str) -> Figure:
    """A column for each transfer function: the scene, largest error and mean error over time."""
    figure = Figure(figsize=(10, 10))
    panels = figure.subplots(3, len(pictures), height_ratios=[1, 1.15, 1.15])
    for column, (kind, shown) in zip(panels.T, pictures.items(), strict=True):
        column[0].imshow(shown)
        column[0].set(title=kind, xticks=[], yticks=[])
        for axes, error in zip(column[1:], ("max error", "mean error"), strict=True):
            axes.sharex(panels[1, 0])
            axes.sharey(panels[list(column).index(axes), 0])
            _lines(axes, [row for row in rows if row["scene"] == kind], [m.name for m in METHODS] + list(PEERS), error)
        column[2].set_xlabel("time a frame [s]")
    panels[1, 0].set_ylabel("largest error of a channel in [0, 1]")
    panels[2, 0].set_ylabel("mean error of all channels in [0, 1]")
    figure.suptitle(title)
    figure.legend(*panels[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


# What a reader who chooses wants to see first.
SHORT = ("Certified", "Preintegrated", "Riemann, midpoint", "VTK", "OSPRay")


def _short_chart(rows: list[dict[str, Any]]) -> Figure:
    """Mean error over time of uniform sampling, the certified images and peers, by transfer function."""
    kinds = list(dict.fromkeys(row["scene"] for row in rows))
    figure = Figure(figsize=(9, 3.4))
    panels = figure.subplots(1, len(kinds), sharex=True, sharey=True)
    for axes, kind in zip(panels, kinds, strict=True):
        _lines(axes, [row for row in rows if row["scene"] == kind], SHORT, "mean error")
        axes.set(title=kind, xlabel="time a frame [s]")
    panels[0].set_ylabel("mean error of all channels in [0, 1]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


def _lines(axes: Axes, rows: list[dict[str, Any]], methods: Iterable[str], error: str) -> None:
    """The error of some methods over time."""
    styles = {m.name: (m.color, m.style) for m in METHODS} | {name: one[1:] for name, one in PEERS.items()}
    for name in methods:
        points = [(row["seconds"], row[error]) for row in rows if row["method"] == name]
        if points:
            color, style = styles[name]
            axes.plot(*zip(*points, strict=True), style, color=color, label=name, ms=4.5, lw=1.2)
    axes.set(xscale="log", yscale="log")
    _plain_seconds(axes.xaxis)
    axes.grid()


def _plain_seconds(axis: Axis) -> None:
    """Ticks such as 0.05 instead of powers of ten."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


# --- As accurate as each peer -----------------------------------------------------------------------------------------

PEER_STEP = 1.0  # what both are used with


@STUDY.part("Certified, as accurate as each peer")
def peers(folder: Path, quick: bool) -> str:
    """Each peer with a sample a voxel, and the certified image that is asked for the largest error the peer has."""
    rows: list[dict[str, Any]] = []
    for name in ("bonsai",) if quick else ("bonsai", "bluntfin", "aneurism"):
        scenes = make_scenes(name, views.load(name, quick), (64, 64) if quick else (512, 512))
        for kind, scene in scenes.items():
            rows += ({"scene": f"{name} {kind}"} | row for row in _against_peers(scene, quick))
    title = f"512 x 512 pixels, {wvr.get_num_threads()} threads, a sample a voxel"
    write_rows(folder, "peers", title, rows)
    if not rows:
        return "No peer can render here."
    slower = [row for row in rows if row["times"] < 1]
    said = [f"{len(rows) - len(slower)} of {len(rows)} certified images are there before the peer's."]
    for peer in dict.fromkeys(row["peer"] for row in rows):
        times = [row["times"] for row in rows if row["peer"] == peer]
        said.append(
            f"{peer} takes {min(times):.2g} to {max(times):.2g} times as long, {median(times):.2g} in the median."
        )
    return " ".join(said)


def _against_peers(scene: Scene, quick: bool) -> list[dict[str, Any]]:
    exact = scene.render(wvr.Exact(), device="cpu").rgba
    rows = []
    with ExitStack() as stack:
        for name, peer in _peers(stack, scene, quick).items():
            peer.frame(PEER_STEP)
            error = wvr.compare(peer.image(), exact)
            images: dict[str, NDArray] = {}
            renderer = scene.renderer(wvr.Certified(error.max), device="cpu")
            ours = _frame(images, "ours", renderer, scene)
            times = take_turns({"theirs": partial(peer.frame, PEER_STEP), "ours": ours}, quick)
            left = wvr.compare(images["ours"], exact)
            rows.append(
                {
                    "peer": name,
                    "peer s": times["theirs"],
                    "peer max error": error.max,
                    "peer mean error": error.mean,
                    "certified s": times["ours"],
                    "certified max error": left.max,
                    "certified mean error": left.mean,
                    "times": times["theirs"] / times["ours"],
                }
            )
    return rows


# --- Time against size ------------------------------------------------------------------------------------------------

DEFAULT = "Certified(1/512)"
SCALED: dict[str, Integrator] = {
    "Riemann(1)": wvr.Riemann(1.0),
    "Preintegrated(0.5)": wvr.Preintegrated(0.5),
    DEFAULT: wvr.Certified(1 / 512),
    "AdaptiveSimpson(1/512)": wvr.AdaptiveSimpson(1 / 512, scope="ray"),
}


@STUDY.part("Time against size")
def scaling(folder: Path, quick: bool) -> str:
    """Time against the size of volume and image, what is visible of the volume, and threads, all else being equal."""
    base = 24 if quick else 256
    pixels = 32 if quick else 256
    rows: list[dict[str, Any]] = []

    def measure(against: str, cases: Iterable[tuple[float, Scene]]) -> None:
        for x, scene in cases:
            rows.extend({"against": against, "x": x} | row for row in _seconds(scene, quick))

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

    def growth(against: str, method: str) -> str:
        points = sorted((r["x"], r["seconds"]) for r in rows if r["against"] == against and r["method"] == method)
        (x0, first), (x1, last) = points[0], points[-1]
        return f"{last / first:.2g} times the time from {x0:g} to {x1:g}"

    return (
        f"{DEFAULT}: "
        + "; ".join(
            f"{against}, {growth(against, DEFAULT)}" for against in dict.fromkeys(row["against"] for row in rows)
        )
        + "."
    )


def _seconds(scene: Scene, quick: bool) -> list[dict[str, Any]]:
    renderers = {name: scene.renderer(integrator, device="cpu") for name, integrator in SCALED.items()}
    contenders = {
        name: timed(lambda r=renderer: r.render(scene.camera, scene.size))  # type: ignore[misc]
        for name, renderer in renderers.items()
    }
    return [{"method": name, "seconds": seconds} for name, seconds in take_turns(contenders, quick).items()]


def _occupancies(scene: Scene) -> Iterable[tuple[float, Scene]]:
    """The scene with ever less of it visible, of pieces of 8 x 8 x 8 cells; thin enough for every ray to go through."""
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
            yield visible, replace(scene, transfer_function=tf)


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
    figure = Figure(figsize=(9, 6.6))
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
        axes.grid()
    for axes in panels[:, 0]:
        axes.set_ylabel("time a frame [s]")
        _plain_seconds(axes.yaxis)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure
