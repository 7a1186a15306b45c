"""Section 2 of Roettger, Guthe, Weiskopf, Ertl and Strasser, "Smart Hardware-Accelerated Volume Rendering" (2003):
volumetric clipping, and the labels that it makes possible.

Figures 2, 3 and 8, and the choices for the colour of a cut segment; errors are against ``Exact`` with the same clip
volume.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from wvr.color import linear_to_srgb
from wvr.kernels.cuts.partial import PARTS

from .base import scenes as views
from .base.harness import save_figure
from .base.rows import write_rows
from .base.scenes import Scene, picture
from .base.study import Study
from .roettger2003 import VISIBLE, errors, make_scene
from .slab_passes import Passes, factors

STUDY = Study("clipping")
PAPER = STUDY.paper

# The shell of carbon atoms red, the holes in its rings and what is inside green.
BUCKY = [(0, (0.1, 0.6, 0.1), 0.0), (40, (0.1, 0.7, 0.1), 0.3), (110, (0.9, 0.8, 0.1), 0.5), (200, (0.8, 0.05, 0), 0.9)]
SLICES = 32


@dataclass(frozen=True)
class Cut:
    """A volume and the ball that is kept of it, as a clip volume."""

    volume: wvr.Volume
    tf: wvr.TransferFunction
    camera: wvr.Camera
    ball: wvr.Volume
    size: tuple[int, int]

    def render(self, integrator: Any, **clip: Any) -> wvr.Image:
        clips = [wvr.ClipVolume(self.ball, 0.0, **clip)]
        return wvr.render(
            self.volume, self.tf, self.camera, self.size, integrator=integrator, clip=clips, termination=0
        )

    def sliced(self, oversampling: int = 1, **clip: Any) -> wvr.Image:
        """By as many slabs along the volume's edge as the paper has, or more."""
        step = (max(self.volume.dimensions) - 1) / (SLICES * oversampling)
        return self.render(wvr.Preintegrated(step), **clip)


@cache
def make_bucky(quick: bool) -> Cut:
    """The bucky ball where it is there, else a stand-in; the ball's radius is a distance of two voxels of its field."""
    volume = views.load("bucky", quick, 32)
    low, high = volume.range
    tf = wvr.TransferFunction([(low + s / 255 * (high - low), color, opacity) for s, color, opacity in BUCKY])
    middle, edge = volume.corners.mean(axis=0), float(np.ptp(volume.corners[:, 0]))
    n = 64
    k, j, i = (np.indices((n, n, n)) / (n - 1) - 0.5) * edge
    distance = 0.36 * edge - np.sqrt(i * i + j * j + k * k)
    ball = wvr.Volume(distance, np.full(3, edge / (n - 1)), middle - edge / 2)
    camera = wvr.Camera.fit(volume, direction=(0.25, 0.15, 1), up=(0, 1, 0))
    camera = wvr.Camera(camera.position, camera.target, camera.up, view_angle=16.0)
    return Cut(volume, tf, camera, ball, (48, 48) if quick else (400, 400))


@STUDY.part("Figure 2")
def figure2(folder: Path, quick: bool) -> str:
    """The table of factors: ends of the scalar range, visible share, middle of what is visible."""
    values = (np.arange(256) + 0.5) / 256
    figure = Figure(figsize=(9, 2.6), layout="constrained")
    for axes, (name, table) in zip(figure.subplots(1, 4), factors(*np.meshgrid(values, values)).items(), strict=True):
        axes.imshow(table, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(0, 1, 0, 1))
        axes.set(title=name, xlabel="clip value, front", ylabel="back" if name == "r" else "")
    save_figure(figure, folder / "figure2")
    # The table in the kernel that draws with it, beside the factors themselves.
    cut = make_bucky(quick)
    slab = Scene("bucky", cut.volume, cut.tf, cut.camera, cut.size)
    step = (max(cut.volume.dimensions) - 1) / SLICES
    image, _ = Passes(slab, False, clip_values(cut.ball)).draw(cut.camera, step, 1)
    found = errors(image, cut.sliced(parts="first-order"))
    return (
        f"The table's look-ups draw the bucky ball of {SLICES} slabs as the factors themselves do, but for the clip "
        f"volume's 8 bits: mean difference {found['mean']:.1e}."
    )


def clip_values(field: wvr.Volume) -> NDArray[np.uint8]:
    """As the paper has clip volumes: 8 bits, what is below half is clipped; a distance of two voxels to each side."""
    return np.rint(255 * np.clip(0.5 + field.numpy() / (4 * field.smallest_spacing), 0, 1)).astype(np.uint8)


@STUDY.part("Figure 3")
def figure3(folder: Path, quick: bool) -> str:
    """Few slices, naive and accurate; then every choice for the colour of a cut segment."""
    cut = make_bucky(quick)
    exact = cut.render(wvr.Exact())
    shown = {
        f"naive, {SLICES} slices": cut.sliced(naive=True),
        f"segments cut, {SLICES} slices": cut.sliced(parts="first-order"),
        f"rays cut, {SLICES} slices": cut.sliced(),
        "certified, 1/512": cut.render(wvr.Certified(1 / 512)),
    }
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    panels = figure.subplots(2, len(shown))
    for (above, below), (name, image) in zip(panels.T, shown.items(), strict=True):
        difference = wvr.compare(image, exact, [VISIBLE])
        above.imshow(picture(image))
        mesh = below.imshow(np.maximum(difference.map, 1e-12), norm=LogNorm(1e-5, 1), cmap="magma")
        above.set(title=name, xticks=[], yticks=[])
        below.set(xticks=[], yticks=[], xlabel=f"max {difference.max:.2g}, mean {difference.mean:.1e}")
    figure.colorbar(mesh, ax=panels[1], label="largest error\nof a channel", extend="min")
    save_figure(figure, folder / "figure3")
    rows: list[dict[str, Any]] = []
    for oversampling in (1, 4):
        ways: dict[str, Any] = (
            {"naive": {"naive": True}} | {f"parts={p!r}": {"parts": p} for p in PARTS} | {"rays cut": {}}
        )
        for name, clip in ways.items():
            rows.append(
                {"slices": SLICES * oversampling, "method": name} | errors(cut.sliced(oversampling, **clip), exact)
            )
    rows.append({"method": "Certified(1/512)"} | errors(shown["certified, 1/512"], exact))
    write_rows(folder, "figure3", "Figure 3: the bucky ball cut by a clip volume, errors against Exact", rows)
    mean = {row["method"]: row["mean"] for row in rows if row.get("slices") in (SLICES, None)}
    first = mean["parts='first-order'"]
    return (
        f"Mean errors in {SLICES} slices: naive {mean['naive']:.1e}, segments cut "
        f"{first:.1e}, rays cut {mean['rays cut']:.1e}; certified {mean['Certified(1/512)']:.1e}."
    )


@STUDY.part("Isosurfaces")
def isosurfaces(folder: Path, quick: bool) -> str:
    """Does the length of a cut segment matter where the transfer function is a set of isosurfaces?"""
    cut = make_bucky(quick)
    low, high = cut.volume.range
    rows: list[dict[str, Any]] = []
    for opacity in (0.6, 0.99, 1.0):
        values = [low + share * (high - low) for share in (0.25, 0.6)]
        tf = wvr.TransferFunction.isosurfaces(values, ["green", "red"], opacity, width=0.04 * (high - low))
        scene = replace(cut, tf=tf)
        exact = scene.render(wvr.Exact())
        for parts in ("length", "power", "isosurface"):
            row: dict[str, Any] = {"peak opacity": opacity, "parts": parts}
            rows.append(row | errors(scene.sliced(4, parts=parts), exact))
    write_rows(folder, "isosurfaces", "Isosurfaces of a finite width, cut segments", rows)
    last = {row["parts"]: row["mean"] for row in rows[-3:]}
    return "Mean errors where they are opaque: " + ", ".join(f"{name} {mean:.1e}" for name, mean in last.items()) + "."


@STUDY.part("Figure 8, as in the paper")
def passes(folder: Path, quick: bool) -> str:
    """Bonsai in four slabs a voxel, four a pass, without leaping, lit or not, whole and with a clip volume."""
    scene = make_scene("Bonsai, opaque", quick)
    scene = replace(scene, size=(24, 24) if quick else (256, 256))
    # All but a ball around the crown's front, as a clip volume of 64^3.
    low, high = scene.volume.corners.min(axis=0), scene.volume.corners.max(axis=0)
    places = np.stack(np.meshgrid(*[np.linspace(0, 1, 64)] * 3, indexing="ij"), axis=-1)[..., ::-1] * (high - low) + low
    away = np.linalg.norm(places - (low + (0.5, 0.6, 0.8) * (high - low)), axis=-1) - 0.3 * (high - low).max()
    clip = np.rint(255 * np.clip(0.5 + away / (4 * (high - low).max() / 63), 0, 1)).astype(np.uint8)
    rows: list[dict[str, Any]] = []
    images = {}
    for lit in (False, True):
        seconds: dict[str, list[float]] = {"whole": [], "cut": []}
        drawn = {"whole": Passes(scene, lit), "cut": Passes(scene, lit, clip)}
        for _ in range(1 if quick else 3):
            for name, one in drawn.items():
                images[name, lit], time = one.draw(scene.camera, 0.25, 4)
                seconds[name].append(time)
        row: dict[str, Any] = {"lit": "yes" if lit else "no"}
        row |= {f"{name} cpu s": float(np.median(times)) for name, times in seconds.items()}
        rows.append(row | {"cut over whole": row["cut cpu s"] / row["whole cpu s"]})
    paper = PAPER["clipping"]
    ratio = paper["cut"] / paper["whole"]
    write_rows(
        folder, "passes", f"Figure 8 by passes of four slabs; the paper's cut takes {ratio:.2f} times as long", rows
    )
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("whole", "cut"), strict=True):
        rgba = images[name, True]
        shown = rgba[..., :3] + (1 - rgba[..., 3:])
        axes.imshow(np.clip(linear_to_srgb(shown), 0, 1))
        axes.set(title=f"{name}, lit", xticks=[], yticks=[])
    save_figure(figure, folder / "passes")
    unlit, shaded = (row["cut over whole"] for row in rows)
    return (
        f"Drawn as the paper does, without leaping, a clip volume and the table of factors take {unlit:.2f} times as "
        f"long as the whole without light and {shaded:.2f} times with; in the paper {ratio:.2f} times."
    )


@STUDY.part("Figure 8")
def figure8(folder: Path, quick: bool) -> str:
    """Bonsai with and without clipping, four slabs a voxel and certified."""
    scene = make_scene("Bonsai, opaque", quick)
    middle = scene.volume.corners.mean(axis=0)
    plane = wvr.ClipPlane(middle, (0.2, 0.1, -1))
    rows: list[dict[str, Any]] = []
    images: dict[str, wvr.Image] = {}
    for name, clip in (("whole", None), ("cut", plane)):
        exact = scene.render(wvr.Exact(), clip=clip)
        for label, integrator in (
            ("4x slicing, leaping", wvr.Preintegrated(1.0, 4)),
            ("certified", wvr.Certified(1 / 512)),
        ):
            image = scene.timed(integrator, clip=clip)
            images[f"{name}, {label}"] = image
            row: dict[str, Any] = {"scene": name, "method": label, "s": image.stats["seconds_raycast"]}
            rows.append(row | errors(image, exact))
    paper = PAPER["clipping"]
    write_rows(
        folder, "figure8", f"Figure 8: Bonsai; the paper's {paper['whole']:g} s whole and {paper['cut']:g} s cut", rows
    )
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("whole, certified", "cut, certified"), strict=True):
        axes.imshow(picture(images[name]))
        axes.set(title=name.split(",")[0], xticks=[], yticks=[])
    save_figure(figure, folder / "figure8")
    time = {(row["scene"], row["method"]): row["s"] for row in rows}
    return (
        f"Certified, the cut takes {time['cut', 'certified'] / time['whole', 'certified']:.2f} times as long as the "
        f"whole; the paper's accurate clipping {paper['cut'] / paper['whole']:.2f} times."
    )


@STUDY.part("Labels")
def labels(folder: Path, quick: bool) -> str:
    """A ball of samples inside the bucky ball, which has a transfer function of its own: whole, and cut open."""
    cut = make_bucky(quick)
    middle = cut.volume.corners.mean(axis=0)
    places = np.moveaxis(np.indices(cut.volume.shape)[::-1], 0, -1) * cut.volume.spacing + cut.volume.origin
    inside = np.linalg.norm(places - middle, axis=-1) < 0.25 * np.ptp(cut.volume.corners[:, 0])
    low, high = cut.volume.range
    shell = [(low + 0.25 * (high - low), "black", 0.0), (low + 0.7 * (high - low), "steelblue", 0.25)]
    core = [(low, (0.9, 0.3, 0.05), 0.2), (high, (1, 0.8, 0.2), 0.6)]
    segmentation = wvr.Segmentation(
        inside.astype(np.uint8), {0: wvr.TransferFunction(shell), 1: wvr.TransferFunction(core)}
    )
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    plane = wvr.ClipPlane(middle, cut.camera.target - cut.camera.position)
    for axes, (name, clip) in zip(figure.subplots(1, 2), {"two labels": None, "cut open": plane}.items(), strict=True):
        image = wvr.render(cut.volume, None, cut.camera, cut.size, segmentation=segmentation, clip=clip)
        axes.imshow(picture(image))
        axes.set(title=name, xticks=[], yticks=[])
    save_figure(figure, folder / "labels")
    return "A label's boundary is cut as exactly as a clip."
