"""Angelelli and Bruckner, "Performance and Quality Analysis of Convolution-Based Volume Illumination" (2017).

Figures 1 and 3 to 7 and Table 1, the paper's numbers beside ours, then what the paper leaves open: how fast the image
converges in the slice distance, how good the model is, and a new volume each frame.
Head, abdomen and bonsai (for the carp) are those of ``../shared/data`` where they lie there, else generated volumes
stand in; the cardiac ultrasound is generated. Transfer functions and views are not published, so times compare in kind.

What is judged by eye in the paper is a number here, ``aliasing``, and a local one, since stripes are seen where they
are: an image's difference to a fine one of the same method, sRGB-encoded on white, loses its mean over a window of
``WINDOW`` pixels, since stripes of slices and rings of steps are finer than shading; of its root mean square in blocks
of ``BLOCK`` pixels, those at least half of which show anything, the worst counts. It is compared with ``VISIBLE``,
which was set on two other scans than those judged, by looking at ICS with slices 0.35 to 1.4 voxels apart: the engine
shows no stripes at 0.014 and does at 0.018, the smooth teapot none at 0.009 and faint ones at 0.012. The largest
distance without aliasing is where a line through the logarithms of distances and of aliasing crosses it.
The paper's light is that at a slab's front, without splitting; its kernel is taken in proportion to the slice distance,
so that the distances of one row show one scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr

from .base import scenes
from .base.harness import COLORS, save_figure
from .base.rows import spread, write_rows
from .base.scenes import picture
from .base.study import Study
from .lighting import panels

STUDY = Study("angelelli2017")
PAPER = STUDY.paper
SIZE = 512  # of the paper
VIEWS = 6  # that times are means of; the paper has 100
WINDOW = 9
BLOCK = 32
VISIBLE = 0.013
DISTANCES = (0.25, 0.33, 0.5, 0.67, 1.0, 1.3, 1.5, 2.0, 3.0, 4.0)
SUBSAMPLES = (1, 2, 3, 4, 5)
FINE = 0.125

# (volume, control points, direction towards the camera, up), in the order of the paper's Figure 5.
SCENES: dict[str, tuple[str, list, tuple, tuple]] = {
    "bonsai": (
        "bonsai",
        [(38, (0.1, 0.35, 0.05), 0.0), (50, (0.25, 0.6, 0.1), 0.5), (95, (0.5, 0.4, 0.15), 0.7), (140, "peru", 0.9)],
        (0.3, 0.3, 1),
        (0, 1, 0),
    ),
    "head, skin": (
        "cthead",
        [(350, "peachpuff", 0.0), (700, "peachpuff", 0.6), (1300, "ivory", 0.9)],
        (-0.6, -1, -0.15),
        (0, 0, -1),
    ),
    "head, bone": (
        "cthead",
        [(800, "salmon", 0.0), (1050, "salmon", 0.03), (1200, "ivory", 0.05), (1350, "ivory", 0.8)],
        (-0.6, -1, -0.15),
        (0, 0, -1),
    ),
    "abdomen": (
        "stent",
        [(180, "firebrick", 0.0), (260, "firebrick", 0.25), (420, "ivory", 0.5), (800, "white", 0.9)],
        (0.25, 1, 0.1),
        (0, 0, 1),
    ),
    "ultrasound": (
        "heart",
        [(62, "darkred", 0.0), (75, "salmon", 0.3), (160, "mistyrose", 0.5)],
        (0.25, -1, 0.35),
        (0, 0, 1),
    ),
}


@dataclass(frozen=True)
class Scene:
    """What is shown, and from where."""

    name: str
    volume: wvr.Volume
    tf: wvr.TransferFunction
    direction: tuple[float, float, float]
    up: tuple[float, float, float]
    size: int

    def camera(self, turn: float = 0.0) -> wvr.Camera:
        """Turned about the upward axis [radians]."""
        axis = np.array(self.up, float)
        d = np.array(self.direction, float)
        turned = d * np.cos(turn) + np.cross(axis, d) * np.sin(turn) + axis * (axis @ d) * (1 - np.cos(turn))
        return wvr.Camera.fit(self.volume, turned, self.up, view_angle=20.0)


def make_scene(name: str, quick: bool, size: int | None = None) -> Scene:
    """A scene of the paper or its stand-in; ``quick``: a small stand-in."""
    source, points, direction, up = SCENES[name]
    if source == "heart":
        data = wvr.datasets.load("heart", 32 if quick else 192).numpy()
        # Cropped as a sonographer does, to look into the ventricles.
        volume = wvr.Volume(np.ascontiguousarray(data[:, data.shape[1] // 2 :]))
    else:
        volume = scenes.load(source, quick)
        if quick or not scenes.is_there(source):
            points = scenes.stretched(points, (0, 1.1 * points[-1][0]), volume)
    return Scene(name, volume, wvr.TransferFunction(points), direction, up, 32 if quick else size or SIZE)


def key_light(camera: wvr.Camera) -> wvr.DirectionalLight:
    """From the viewer's upper left."""
    right, up, forward = camera.basis()
    return wvr.DirectionalLight(tuple(up - right - 1.8 * forward))


# --- Methods and what they are judged by ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Method:
    """A contender of the paper at one setting: "ray cast", "Phong", "ICS", "SCS", "PI-ICS" or "PI-SCS"."""

    name: str
    distance: float
    subsamples: int = 0

    def renderer(self, scene: Scene, **shadows: Any) -> wvr.Renderer:
        """Ready to render; light is set with each view."""
        if self.name in ("ray cast", "Phong"):
            return wvr.Renderer(scene.volume, scene.tf, integrator=wvr.Riemann(self.distance))
        options: dict[str, Any] = {"splitting": "lie", "received": "front", "image": "slices", "cell": 1.0} | shadows
        sweep = wvr.ConvolutionShadows(self.distance, self.subsamples, self.name.startswith("PI"), **options)
        return wvr.Renderer(scene.volume, scene.tf, shadows=sweep)

    def render(
        self, scene: Scene, renderer: wvr.Renderer | None = None, turn: float = 0.0, **shadows: Any
    ) -> wvr.Image:
        """A view with the light that goes with it."""
        renderer = self.renderer(scene, **shadows) if renderer is None else renderer
        camera = scene.camera(turn)
        light = key_light(camera)
        if self.name == "Phong":
            renderer.lighting = wvr.Lighting(light=light)
        elif renderer.shadows is not None:
            renderer.shadows = replace(renderer.shadows, light=light)
        return renderer.render(camera, (scene.size, scene.size))

    def measured(self, scene: Scene, views: int) -> tuple[wvr.Image, float]:
        """The image, and the mean milliseconds of a frame over viewpoints all around; what is kept is built before."""
        renderer = self.renderer(scene)
        self.render(replace(scene, size=8), renderer)
        images = [self.render(scene, renderer, 2 * np.pi * view / views) for view in range(views)]
        return images[0], 1e3 * float(np.mean([image.stats["seconds"] for image in images]))

    def __str__(self) -> str:
        subsamples = f", {self.subsamples} subsample{'s' * (self.subsamples > 1)}" if self.subsamples else ""
        return f"{self.name} {self.distance:g}{subsamples}"


def aliasing(image: wvr.Image, fine: wvr.Image) -> float:
    """Root mean square of what is fine in the difference, in the worst block."""
    difference = picture(image) - picture(fine)
    window = np.lib.stride_tricks.sliding_window_view(
        np.pad(difference, [(WINDOW // 2,) * 2] * 2 + [(0, 0)], "edge"), (WINDOW, WINDOW), (0, 1)
    )
    shown = fine.rgba[..., 3] > 0
    square = np.where(shown, np.square(difference - window.mean((-2, -1))).mean(-1), 0)
    sums, counts = blocks(square), blocks(shown)
    enough = counts >= min(0.5 * BLOCK**2, counts.max())
    return float(np.sqrt((sums[enough] / counts[enough]).max()))


def blocks(values: NDArray) -> NDArray[np.float64]:
    """Sums over blocks of ``BLOCK`` by ``BLOCK`` pixels."""
    height, width = (n - n % BLOCK for n in values.shape)
    return values[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).sum((1, 3), dtype=float)


def reference(scene: Scene, name: str) -> wvr.Image:
    """What a method converges to."""
    return (
        Method(name, FINE / 2).render(scene) if name in ("ray cast", "Phong") else Method("PI-ICS", FINE).render(scene)
    )


def views_of(quick: bool) -> int:
    """Viewpoints that times are the mean of."""
    return 1 if quick else VIEWS


def threads() -> str:
    """For titles."""
    return f"{wvr.get_num_threads()} threads"


def errors_by_distance(
    scene: Scene, name: str, fine: wvr.Image, subsamples: int = 0, least: float = 0.0, every: bool = False
) -> list[tuple[Method, float]]:
    """Methods and their aliasing for growing distances, up to the first that shows it, or for all."""
    found: list[tuple[Method, float]] = []
    for distance in DISTANCES:
        if distance >= least:
            method = Method(name, distance, subsamples)
            found.append((method, aliasing(method.render(scene), fine)))
            if found[-1][1] > VISIBLE and not every:
                break
    return found


def coarsest(found: list[tuple[Method, float]]) -> Method | None:
    """At the largest distance without aliasing: between the last that is free of it and the first that shows it."""
    clean = [(method, error) for method, error in takewhile(lambda one: one[1] <= VISIBLE, found)]
    if not clean or len(clean) == len(found):
        return clean[-1][0] if clean else None
    (last, low), (first, high) = clean[-1], found[len(clean)]
    share = np.log(VISIBLE / low) / np.log(high / low)
    distance = last.distance * (first.distance / last.distance) ** share
    return replace(last, distance=round(float(distance), 3))


# --- Figures 1 and 3, Figure 4 and Table 1 ----------------------------------------------------------------------------


@STUDY.part("Figure 1")
def figure1(folder: Path, quick: bool) -> str:
    """The paper's teaser: what supersampling saves, and where it shows."""
    methods = {
        "Phong": Method("Phong", 0.33),
        "ICS 0.33": Method("ICS", 0.33),
        "ICS 1": Method("ICS", 1.0),
        "SCS 1.3, 4 subsamples": Method("SCS", 1.3, 4),
        "SCS 1.5, 5 subsamples": Method("SCS", 1.5, 5),
        "SCS 1.3, 1 subsample": Method("SCS", 1.3, 1),
    }
    scene, views = make_scene("bonsai", quick), views_of(quick)
    fine = reference(scene, "ICS")
    images, rows = {}, []
    for name, method in methods.items():
        image, ms = method.measured(scene, views)
        paper = PAPER["figure 1"].get(name)
        row: dict[str, Any] = {"method": name, "ms": ms, "paper ms": paper}
        if name != "Phong":
            row |= {"aliasing": aliasing(image, fine), "mean difference": float(np.abs(image.rgba - fine.rgba).mean())}
        rows.append(row)
        images[name] = image, f"{row['ms']:.0f} ms" + (f", the paper's {paper}" if paper else "")
    for row in rows:
        row["of ICS 0.33"] = row["ms"] / rows[1]["ms"]
        row["paper of ICS 0.33"] = row["paper ms"] / rows[1]["paper ms"] if row["paper ms"] else None
    write_rows(folder, "figure1", f"Figure 1: {scene.name} for the carp, {views} views, {threads()}", rows)
    panels(folder, "figure1", images)
    panels(folder, "figure1-closeup", images, zoom=4)
    ours, paper = rows[3]["of ICS 0.33"], rows[3]["paper of ICS 0.33"]
    clean = ", ".join(f"{row['method']} {row['aliasing']:.4f}" for row in rows[1:])
    return f"SCS 1.3 takes {ours:.2f} of the time of ICS 0.33, the paper's {paper:.2f}. Aliasing: {clean}."


@STUDY.part("Figure 3")
def figure3(folder: Path, quick: bool) -> str:
    """Aliasing by slice distance."""
    scene = make_scene("head, bone", quick)
    names = ("ray cast", "ICS", "PI-ICS")
    found = {name: errors_by_distance(scene, name, reference(scene, name), every=True) for name in names}
    rows: list[dict[str, Any]] = [{"distance": distance} for distance in DISTANCES]
    figure = Figure(figsize=(5, 3.4), layout="constrained")
    axes = figure.subplots()
    for i, (name, errors) in enumerate(found.items()):
        best = coarsest(errors)
        for row, (_, error) in zip(rows, errors, strict=True):
            row[name] = error
        axes.loglog(
            DISTANCES,
            [error for _, error in errors],
            "os^"[i] + "-",
            ms=4,
            color=COLORS[i],
            label=f"{name}, up to {best.distance:g}" if best else f"{name}, none",
        )
    axes.axhline(VISIBLE, color="0.6", lw=0.8)
    axes.set(xlabel="slice distance, step [voxels]", ylabel="aliasing", title=scene.name)
    axes.set_xticks(DISTANCES, [f"{d:g}" for d in DISTANCES], fontsize="x-small")
    axes.minorticks_off()
    axes.legend(frameon=False)
    axes.grid(color="0.9")
    save_figure(figure, folder / "figure3-aliasing")
    write_rows(folder, "figure3", f"Figure 3: aliasing by distance, {scene.name}; visible from {VISIBLE:.1e}", rows)
    images = {}
    for name in names[1:]:
        for method, error in found[name]:
            if method.distance in (0.5, 1.0, 2.0):
                images[f"{name} {method.distance:g}"] = method.render(scene), f"aliasing {error:.4f}"
    panels(folder, "figure3", images, zoom=2)
    largest = {name: coarsest(errors) for name, errors in found.items()}
    return "Free of aliasing up to " + ", ".join(
        f"{m.distance:g} ({n})" if m else f"none ({n})" for n, m in largest.items()
    )


@STUDY.part("Figure 4 and Table 1")
def table1(folder: Path, quick: bool) -> str:
    """Time and difference over slice distances and subsamples."""
    scene, views = make_scene("ultrasound", quick), views_of(quick)
    rows, images = [], {}
    first: wvr.Image | None = None
    paper = PAPER["table 1"]
    for distance in (0.2, 0.4, 0.6, 0.8):
        for subsamples in range(4):
            method = Method("SCS" if subsamples else "ICS", distance, subsamples)
            image, ms = method.measured(scene, views)
            first = image if first is None else first
            rows.append(
                {
                    "distance": distance,
                    "subsamples": subsamples,
                    "ms": ms,
                    "paper ms": paper["milliseconds"][f"{distance:g}"][subsamples],
                    "difference": float(np.abs(image.rgba - first.rgba).mean()),
                    "paper difference": paper["difference"][f"{distance:g}"][subsamples],
                }
            )
            if subsamples in (0, 3) and distance in (0.2, 0.8):
                images[f"{distance:g}, {subsamples} subsamples"] = image, f"difference {rows[-1]['difference']:.4f}"
    for row in rows:
        row |= {"of first": row["ms"] / rows[0]["ms"], "paper of first": row["paper ms"] / rows[0]["paper ms"]}
    write_rows(folder, "table1", f"Table 1 and Figure 4: {scene.name}, {views} views, {threads()}", rows)
    panels(folder, "figure4", images)
    last = rows[-1]
    return (
        f"0.8 with 3 subsamples takes {last['of first']:.2f} of the time of 0.2 without "
        f"(the paper {last['paper of first']:.2f}), "
        f"difference {last['difference']:.4f} (the paper {last['paper difference']:.4f})."
    )


# --- Figures 5, 6 and 7 -----------------------------------------------------------------------------------------------


def settled(scene: Scene, fine: dict[str, wvr.Image]) -> dict[str, Method]:
    """Every method at its fastest setting without aliasing; where even the finest shows it, that one."""
    methods = {}
    for name in ("ray cast", "Phong", "ICS", "PI-ICS"):
        found = errors_by_distance(scene, name, fine.get(name, fine["ICS"]))
        methods[name] = coarsest(found) or found[0][0]
    for name in ("SCS", "PI-SCS"):
        # For every number of subsamples the largest distance, which grows; of those the fastest.
        farthest = methods[name.replace("SCS", "ICS")].distance
        costs = {}
        for subsamples in SUBSAMPLES:
            method = coarsest(errors_by_distance(scene, name, fine["ICS"], subsamples, farthest))
            if method is not None:
                costs[method] = method.measured(scene, 1)[1]
                farthest = method.distance
        methods[name] = min(costs, key=costs.__getitem__) if costs else Method(name, DISTANCES[0], 1)
    return {name: methods[name] for name in ("ray cast", "Phong", "ICS", "SCS", "PI-ICS", "PI-SCS")}


@STUDY.part("Figure 5")
def figure5(folder: Path, quick: bool) -> str:
    """Every method at its largest distance without aliasing: what it costs."""
    rows: list[dict[str, Any]] = []
    images = []
    shown, views = [make_scene(name, quick) for name in SCENES], views_of(quick)
    for scene in shown:
        fine = {name: reference(scene, name) for name in ("ray cast", "Phong", "ICS")}
        for method in settled(scene, fine).values():
            image, ms = method.measured(scene, views)
            truth = fine.get(method.name, fine["ICS"])
            rows.append(
                {
                    "scene": scene.name,
                    "method": method.name,
                    "distance": method.distance,
                    "subsamples": method.subsamples,
                    "ms": ms,
                    "aliasing": aliasing(image, truth),
                    "mean difference": float(np.abs(image.rgba - truth.rgba).mean()),
                }
            )
            images.append((f"{method}\n{ms:.0f} ms", image))
        by_name = {row["method"]: row["ms"] for row in rows[-6:]}
        for row in rows[-6:]:
            row |= {
                "faster than ICS [%]": 100 * (by_name["ICS"] / row["ms"] - 1),
                "of Phong": row["ms"] / by_name["Phong"],
            }
    title = f"Figure 5: methods at their largest distance without aliasing, {views} views, {threads()}"
    write_rows(folder, "figure5", title, rows)
    gain = {row["scene"]: row["faster than ICS [%]"] for row in rows if row["method"] == "SCS"}
    paper = PAPER["speed-up over ICS, per cent"]
    best = {name: max(row["faster than ICS [%]"] for row in rows if row["scene"] == name) for name in gain}
    slices: dict[str, dict[str, float]] = {row["scene"]: {} for row in rows}
    for row in rows:
        slices[row["scene"]][row["method"]] = row["distance"]
    saved = [100 * (distance["SCS"] / distance["ICS"] - 1) for distance in slices.values()]
    claims = [
        {"SCS over ICS [%]": "mean", "paper": paper["mean"], "here": float(np.mean(list(gain.values())))},
        {"SCS over ICS [%]": "worst", "paper": paper["worst"], "here": min(gain.values())},
        {"SCS over ICS [%]": "slices saved, mean", "paper": paper["mean"], "here": float(np.mean(saved))},
        {"SCS over ICS [%]": "slices saved, worst", "paper": paper["worst"], "here": min(saved)},
        {
            "SCS over ICS [%]": "best method, mean",
            "paper": f"> {paper['average']}",
            "here": float(np.mean([*best.values()])),
        },
    ] + [
        {"SCS over ICS [%]": f"sharp: {name}", "paper": f"> {paper['sharp']}", "here": gain[name]}
        for name in ("bonsai", "ultrasound")
    ]
    write_rows(folder, "claims", "Speed-ups of section 5.3", claims)
    figure = Figure(figsize=(15, 2.9 * len(shown)), layout="constrained")
    for axes, (text, image) in zip(figure.subplots(len(shown), 6).flat, images, strict=True):
        axes.imshow(picture(image))
        axes.set_title(text, fontsize="small")
        axes.axis("off")
    save_figure(figure, folder / "figure5")
    return (
        "; ".join(f"{row['SCS over ICS [%]']} {row['here']:.0f} % (the paper {row['paper']})" for row in claims) + "."
    )


@STUDY.part("Figure 6")
def figure6(folder: Path, quick: bool) -> str:
    """What a subsample costs."""
    scene, views = make_scene("ultrasound", quick), views_of(quick)
    rows = []
    figure = Figure(figsize=(5, 3.4), layout="constrained")
    axes = figure.subplots()
    for i, (name, distance) in enumerate((n, d) for n in ("SCS", "PI-SCS") for d in (1.0, 2.0)):
        times = [Method(name, distance, m).measured(scene, views)[1] for m in (0, *SUBSAMPLES)]
        for m, time in zip((0, *SUBSAMPLES), times, strict=True):
            rows.append({"method": name, "distance": distance, "subsamples": m, "ms": time, "of none": time / times[0]})
        axes.plot(
            np.array(times) / times[0], "os^D"[i] + "-", ms=4, color=COLORS[i], label=f"{name}, distance {distance:g}"
        )
    axes.set(xlabel="subsamples", ylabel="time over that of none", title=scene.name)
    axes.legend(frameon=False)
    axes.grid(color="0.9")
    save_figure(figure, folder / "figure6")
    write_rows(folder, "figure6", f"Figure 6: cost of a subsample, {scene.name}, {views} views, {threads()}", rows)
    four = {row["method"]: row["of none"] for row in rows if row["subsamples"] == 4 and row["distance"] == 1}
    return "Four subsamples cost " + " and ".join(f"{c:.2f} times none ({name})" for name, c in four.items()) + "."


@STUDY.part("Figure 7")
def figure7(folder: Path, quick: bool) -> str:
    """Ultrasound, supersampled at ever larger distances: shading on surfaces goes, far shadows stay."""
    methods = [
        Method("ICS", 0.67),
        Method("SCS", 1.34, 1),
        Method("SCS", 2.0, 2),
        Method("ICS", 2.0),
        Method("SCS", 3.0, 4),
        Method("Phong", 0.33),
    ]
    scene = make_scene("ultrasound", quick)
    fine = reference(scene, "ICS")
    images, rows = {}, []
    for method in methods:
        image = method.render(scene)
        images[str(method)] = image, ""
        if method.name != "Phong":
            rows.append(
                {
                    "method": str(method),
                    "aliasing": aliasing(image, fine),
                    "mean difference": float(np.abs(image.rgba - fine.rgba).mean()),
                }
            )
            images[str(method)] = image, f"aliasing {rows[-1]['aliasing']:.4f}"
    write_rows(folder, "figure7", "Figure 7: the generated ultrasound against slices a voxel eighth apart", rows)
    panels(folder, "figure7", images)
    return "Aliasing: " + ", ".join(f"{row['method']} {row['aliasing']:.4f}" for row in rows) + "."


# --- What the paper leaves open ---------------------------------------------------------------------------------------


VARIANTS: dict[str, dict[str, Any]] = {
    "paper: Lie, front light, fixed kernel": {"kernel": "fixed"},
    "Lie, front light": {},
    "Lie, traced light": {"received": "traced"},
    "Strang, front light": {"splitting": "strang"},
    "Strang, traced light": {"splitting": "strang", "received": "traced"},
    "the same, fixed kernel": {"splitting": "strang", "received": "traced", "kernel": "fixed"},
}


@STUDY.part("Order of convergence")
def convergence(folder: Path, quick: bool) -> str:
    """Order of the image in the slice distance, on a smooth scene."""
    volume = wvr.datasets.load("blobs", 48)
    tf = wvr.TransferFunction([(0, "orange", 0.0), (255, "royalblue", 0.4)])
    scene = Scene("blobs", volume, tf, (1, 0.6, 0.4), (0, 0, 1), 24 if quick else 128)
    distances = np.array([2.0, 1.0, 0.5, 0.25])
    fine = Method("ICS", 1 / 32).render(scene, **VARIANTS["Strang, traced light"]).rgba
    rows = []
    figure = Figure(figsize=(5, 3.6), layout="constrained")
    axes = figure.subplots()
    for i, (name, options) in enumerate(VARIANTS.items()):
        errors = [float(np.abs(Method("ICS", d).render(scene, **options).rgba - fine).mean()) for d in distances]
        order = float(np.polyfit(np.log(distances), np.log(errors), 1)[0])
        rows.append(
            {"variant": name} | {f"{d:g}": e for d, e in zip(distances, errors, strict=True)} | {"order": order}
        )
        axes.loglog(distances, errors, "os^DvP"[i] + "-", ms=4, color=COLORS[i], label=f"{name}: {order:.1f}")
    axes.set(xlabel="slice distance [voxels]", ylabel="mean error")
    axes.set_xticks(distances, [f"{d:g}" for d in distances])
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize="x-small", title="order", title_fontsize="x-small")
    axes.grid(color="0.9")
    save_figure(figure, folder / "convergence")
    write_rows(folder, "convergence", "Mean error against slices 1/32 voxel apart, Strang and traced light", rows)
    return "Orders: " + ", ".join(f"{row['variant']} {row['order']:.2f}" for row in rows) + "."


@STUDY.part("The model")
def model(folder: Path, quick: bool) -> str:
    """How far light that diffuses is from light that is scattered once in a cone, and which spread is the nearest."""
    return " ".join(
        _model(folder, make_scene(name, quick, 192), 8 if quick else 64) for name in ("bonsai", "head, bone")
    )


def _model(folder: Path, scene: Scene, directions: int) -> str:
    camera, size = scene.camera(), (scene.size, scene.size)
    light, name = key_light(camera), scene.name.split(",")[0]
    unlit = wvr.render(scene.volume, scene.tf, camera, size)

    def swept(angle: float) -> wvr.Image:
        return Method("ICS", 0.5, 1).render(scene, spread=angle, **VARIANTS["Strang, traced light"])

    rows, nearest, images = [], [], {}
    for angle in (0.0, 5.0, 20.0, 40.0):
        truth = wvr.single_scattering(
            scene.volume, scene.tf, camera, size, light=light, spread=angle, directions=directions
        )
        seen = truth.rgba[..., 3] > 0
        shadow = float(np.abs(unlit.rgba - truth.rgba)[seen][:, :3].mean())

        def compared(image: wvr.Image, truth: wvr.Image = truth, seen: NDArray = seen, shadow: float = shadow) -> dict:
            difference = np.abs(image.rgba - truth.rgba)[seen][:, :3]
            return {
                "mean difference": float(difference.mean()),
                "of what shadows do [%]": 100 * float(difference.mean()) / shadow,
                "brighter [%]": 100 * float(image.rgba[seen][:, :3].mean() / truth.rgba[seen][:, :3].mean() - 1),
            }

        image = swept(angle)
        rows.append({"spread": angle} | compared(image) | {"reference s": truth.stats["seconds"]})
        rows[-1]["sweep s"] = image.stats["seconds"]
        if angle == 20:
            images["scattered, 20 degrees"] = truth, f"{truth.stats['seconds']:.0f} s"
            images["swept, 20 degrees"] = image, f"mean difference {rows[-1]['mean difference']:.3f}"
            for wide in (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0):
                other = swept(wide)
                nearest.append({"spread of the sweep": wide} | compared(other))
                if wide == 60:
                    images["swept, 60 degrees"] = other, f"mean difference {nearest[-1]['mean difference']:.3f}"
    title = (
        f"Sweep, slices 0.5 apart with 1 subsample, against single scattering, {directions} directions: {scene.name}"
    )
    write_rows(folder, f"model-{name}", title, rows)
    write_rows(folder, f"nearest-{name}", "Sweeps of other spreads against single scattering of 20 degrees", nearest)
    panels(folder, f"model-{name}", images)
    means = ", ".join(f"{row['mean difference']:.3f} at {row['spread']:g}" for row in rows)
    best = min(nearest, key=lambda row: row["mean difference"])
    return (
        f"{scene.name}: mean difference {means} degrees; a cone of 20 is nearest to a spread of "
        f"{best['spread of the sweep']:g}: {best['mean difference']:.3f}."
    )


@STUDY.part("Default shadows")
def default(folder: Path, quick: bool) -> str:
    """Stripes at the default and how far it is from what it converges to, beside cells of one and light at the front of
    slices; that cells blur fine shading counts as aliasing here.
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
            if name == "bonsai" and setting != "cells of 1":
                images[setting] = image, f"aliasing {rows[-1]['aliasing']:.3f}"
        if name == "bonsai":
            images["fine"] = fine, "slices 0.5 apart, cells of 0.5"
    write_rows(folder, "default", f"Default shadows, {SIZE} x {SIZE}, {threads()}", rows)
    panels(folder, "default", images)
    panels(folder, "default-closeup", images, zoom=3)
    by_setting = {s: [row["aliasing"] for row in rows if row["shadows"] == s] for s in settings}
    return "Aliasing: " + ", ".join(f"{spread(errors)} ({s})" for s, errors in by_setting.items()) + "."


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
