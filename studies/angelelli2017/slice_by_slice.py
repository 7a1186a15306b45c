"""ICS and SCS as the paper has them, in ``slices``: how far apart slices may be without aliasing, what a subsample
costs beside a convolution of K x K taps, and so what SCS gains, over viewpoints all around.

Stripes are what changes where slices are moved by half their distance: half the difference of two such images, judged
in its worst block. What coarse light does to shading is no stripe and does not count, as it does not in the paper,
which says in Figure 7 that shading goes. They are ``VISIBLE`` from where they are seen on two scans that are not
judged: the engine shows none at 0.003 and specks on a rim at 0.0095, the smooth teapot none at 0.002 and faint rings
at 0.0056.

The largest distances are of one view, of its middle at the size of the paper. Kernels of other sizes have the same
light, so that K changes the time alone. Since nothing is skipped, slices take the same time wherever they are: of each
view ``SOME`` are timed, and there are as many as the view is deep. Scenes run at a time, a thread each, and times are
of that thread.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from os import sched_getaffinity
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import wvr

from ..base.harness import COLORS, save_figure
from ..base.rows import write_rows
from ..lighting import panels
from . import methods
from .aliasing import aliasing, largest
from .methods import PAPER, STUDY
from .scenes import SCENES, make_scene
from .slices import KERNELS, Drawn, Slices

VIEWS = 100  # that times are means of, as in the paper
SOME = 2
SUBSAMPLES = (1, 2, 3, 4)
VISIBLE = 0.005

Found = dict[str, Any]


def image_of(drawn: Drawn) -> wvr.Image:
    return wvr.Image(drawn.rgba, np.zeros(drawn.rgba.shape[:2], np.int32))


def one(name: str, quick: bool) -> tuple[list[Found], list[Found], dict[str, tuple[wvr.Image, str]]]:
    """Of a scene: rows of distances, rows of times by kernel, and images."""
    wvr.set_num_threads(1)
    scene = make_scene(name, quick)
    # Of small stand-ins, too, a pixel is smaller than a voxel.
    size = 2 * scene.size if quick else scene.size
    window = size // 2
    slices, camera = Slices(scene.volume, scene.tf), scene.camera(parallel=True)
    images: dict[str, tuple[wvr.Image, str]] = {}
    limits: dict[int, float] = {}
    rows: list[Found] = []
    for subsamples in (0, *SUBSAMPLES):
        found: list[tuple[float, float]] = []
        for distance in methods.DISTANCES:
            if distance < max(limits.values(), default=0.0):
                continue
            here, nearer = (
                image_of(slices.draw(camera, size, distance, subsamples, window=window, nearer=nearer))
                for nearer in (0.0, 0.5)
            )
            found.append((distance, 0.5 * aliasing(here, nearer)))
            rows.append({"scene": name, "subsamples": subsamples, "distance": distance, "stripes": found[-1][1]})
            if distance in (1.0, 1.5) and subsamples in (0, 3):
                images[f"{distance:g} apart, {subsamples} subsamples"] = here, f"stripes {found[-1][1]:.4f}"
            if found[-1][1] > VISIBLE:
                break
        # Where even the finest shows them, that one; where more subsamples do not help, as far as fewer got.
        limits[subsamples] = largest(found, VISIBLE) or max(limits.values(), default=methods.DISTANCES[0])
    return rows, times(slices, scene.camera, size, name, limits, 1 if quick else VIEWS), images


def times(slices: Slices, camera_of: Any, size: int, name: str, limits: dict[int, float], views: int) -> list[Found]:
    """By size of the kernel: what a subsample costs, and ICS and the fastest SCS over the viewpoints."""
    rows: list[Found] = []
    first = camera_of(parallel=True)
    for taps in KERNELS:
        slice_s, count = {}, {}
        for subsamples, distance in limits.items():
            runs = [slices.draw(first, size, distance, subsamples, taps, some=8) for _ in range(3)]
            slice_s[subsamples], count[subsamples] = min(some.seconds for some in runs), runs[0].slices
        slope, start = np.polyfit([*slice_s], [*slice_s.values()], 1)
        best = min(SUBSAMPLES, key=lambda m: slice_s[m] * count[m])
        spent = np.zeros((views, 2))
        number = np.zeros((views, 2))
        for view in range(views):
            camera = camera_of(2 * np.pi * view / views, parallel=True)
            for column, subsamples in enumerate((0, best)):
                drawn = slices.draw(camera, size, limits[subsamples], subsamples, taps, some=SOME)
                spent[view, column], number[view, column] = drawn.seconds * drawn.slices, drawn.slices
        (ics, scs), (ics_slices, scs_slices) = spent.mean(0), number.mean(0)
        ratio = ics_slices / scs_slices
        predicted = ratio / (1 + best * slope / start)
        rows.append({"scene": name, "K": taps, "ICS distance": limits[0], "SCS distance": limits[best]})
        rows[-1] |= {"subsamples": best, "ICS slices": ics_slices, "SCS slices": scs_slices}
        rows[-1] |= {"slices saved [%]": 100 * (ratio - 1), "a subsample of a slice [%]": 100 * slope / start}
        rows[-1] |= {"slice ms": 1e3 * start, "ICS s": ics, "SCS s": scs, "faster [%]": 100 * (ics / scs - 1)}
        rows[-1] |= {"model [%]": 100 * (predicted - 1), "time over model's": scs / ics * predicted}
    return rows


@STUDY.part("ICS and SCS slice by slice")
def slice_by_slice(folder: Path, quick: bool) -> str:
    """The paper's algorithm itself: slices saved, the cost of a subsample, and the time, by the size of the kernel."""
    names = list(SCENES)
    if quick:
        results = [one(name, quick) for name in names[:2]]
    else:
        with ProcessPoolExecutor(len(sched_getaffinity(0)), get_context("spawn")) as pool:
            results = list(pool.map(one, names, [quick] * len(names)))
    distances = [row for rows, _, _ in results for row in rows]
    rows = [row for _, found, _ in results for row in found]
    views = 1 if quick else VIEWS
    write_rows(folder, "stripes", "Stripes by slice distance and subsamples", distances)
    write_rows(folder, "slices", f"ICS and SCS at their largest distances without aliasing, {views} views", rows)
    summary: list[Found] = []
    paper = PAPER["speed-up over ICS, per cent"]
    for taps in KERNELS:
        of = [row for row in rows if row["K"] == taps]
        gain, saved = ([row[key] for row in of] for key in ("faster [%]", "slices saved [%]"))
        summary.append({"K": taps, "mean [%]": np.mean(gain), "worst [%]": min(gain), "best [%]": max(gain)})
        summary[-1] |= {"slices saved, mean [%]": np.mean(saved), "slices saved, worst [%]": min(saved)}
        summary[-1]["a subsample [%]"] = max(row["a subsample of a slice [%]"] for row in of)
        summary[-1]["off the model [%]"] = max(100 * abs(row["time over model's"] - 1) for row in of)
    summary.append({"K": "paper", "mean [%]": paper["mean"], "worst [%]": paper["worst"], "best [%]": paper["sharp"]})
    write_rows(folder, "summary", "SCS over ICS, by the size of the kernel", summary)
    figure = Figure(figsize=(5, 3.4), layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(dict.fromkeys(row["scene"] for row in rows)):
        of = [row for row in rows if row["scene"] == name]
        axes.plot(KERNELS, [row["faster [%]"] for row in of], "os^Dv"[i] + "-", ms=4, color=COLORS[i], label=name)
        axes.plot(KERNELS, [row["model [%]"] for row in of], ":", color=COLORS[i])
    axes.axhline(paper["mean"], color="0.6", lw=0.8)
    axes.set(xlabel="taps of the kernel along an axis", ylabel="SCS faster than ICS [%]", ylim=(0, None))
    axes.set_xticks(KERNELS)
    axes.legend(frameon=False)
    axes.grid(color="0.9")
    save_figure(figure, folder / "slice-by-slice")
    for name, (_, _, images) in zip(names, results, strict=False):
        if images:
            panels(folder, name.replace(", ", "-"), images)
    last = summary[-2]
    return (
        f"With {last['K']} x {last['K']} taps SCS is {last['mean [%]']:.0f} % faster than ICS in the mean and "
        f"{last['worst [%]']:.0f} % at worst (the paper {paper['mean']} % and {paper['worst']} %); a subsample costs "
        f"{last['a subsample [%]']:.1f} % of a slice at most, and times are within "
        f"{last['off the model [%]']:.0f} % of the model."
    )
