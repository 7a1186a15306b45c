"""ICS and SCS as the paper has them, in ``slices``: how far apart slices may be without aliasing, what a subsample
costs beside a convolution of K x K taps, and so what SCS gains, over viewpoints all around.

Stripes are what changes where slices are moved by half their distance: half the difference of two such images, judged
in its worst block. What coarse light does to shading is no stripe and does not count, as it does not in the paper,
which says in Figure 7 that shading goes. They are ``VISIBLE`` from where they are seen on two scans that are not
judged: the engine shows none at 0.003 and specks on a rim at 0.0095, the smooth teapot none at 0.002 and faint rings
at 0.0056.

The largest distances are of one view, of its middle at the size of the paper, and depend on no machine, so that times
may be those of another run. Kernels of other sizes have the same light, so that K changes the time alone. Since nothing
is skipped, slices take the same time wherever they are: of each view ``SOME`` are timed, and there are as many as the
view is deep. Scenes run at a time, a thread each, and times are of that thread.
"""

from __future__ import annotations

import csv
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from os import sched_getaffinity
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import wvr

from ..base.harness import COLORS, ROOT, save_figure
from ..base.rows import write_rows
from ..lighting import panels
from . import methods
from .aliasing import aliasing, largest
from .methods import PAPER, STUDY
from .scenes import SCENES, Scene, make_scene
from .slices import KERNELS, Drawn, Slices

VIEWS = 100  # that times are means of, as in the paper
SOME = 2
SUBSAMPLES = (1, 2, 3, 4)
VISIBLE = 0.005
RECORDED = ROOT / "docs/results"

Found = dict[str, Any]


def image_of(drawn: Drawn) -> wvr.Image:
    return wvr.Image(drawn.rgba, np.zeros(drawn.rgba.shape[:2], np.int32))


def sliced(name: str, quick: bool) -> tuple[Scene, Slices, int]:
    """A scene, its slices, and pixels along a side: of small stand-ins, too, one is smaller than a voxel."""
    wvr.set_num_threads(1)
    scene = make_scene(name, quick)
    return scene, Slices(scene.volume, scene.tf), 2 * scene.size if quick else scene.size


def distances(name: str, quick: bool) -> tuple[list[Found], dict[str, tuple[wvr.Image, str]]]:
    """Of a scene: rows of stripes by distance, and images."""
    scene, slices, size = sliced(name, quick)
    window, camera = size // 2, scene.camera(parallel=True)
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
        limits[subsamples] = limit(found, limits)
    return rows, images


def limit(found: list[tuple[float, float]], limits: dict[int, float]) -> float:
    """The largest distance without stripes, after those of fewer subsamples: where even the finest shows them, that
    one; where more subsamples do not help, as far as fewer got.
    """
    return largest(found, VISIBLE) or max(limits.values(), default=methods.DISTANCES[0])


def times(name: str, quick: bool, rows_of_distances: list[Found]) -> list[Found]:
    """Of a scene, by size of the kernel: what a subsample costs, and ICS and the fastest SCS over the viewpoints."""
    scene, slices, size = sliced(name, quick)
    camera_of, views = scene.camera, 1 if quick else VIEWS
    limits: dict[int, float] = {}
    for subsamples in (0, *SUBSAMPLES):
        of = [row for row in rows_of_distances if row["scene"] == name and int(row["subsamples"]) == subsamples]
        limits[subsamples] = limit([(float(row["distance"]), float(row["stripes"])) for row in of], limits)
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


def of_scenes(work: Any, quick: bool, *given: Any) -> list[Any]:
    """What ``work`` finds of each scene, a processor each."""
    names = list(SCENES)
    if quick:
        return [work(name, quick, *given) for name in names[:2]]
    with ProcessPoolExecutor(len(sched_getaffinity(0)), get_context("spawn")) as pool:
        return list(pool.map(work, names, [quick] * len(names), *([each] * len(names) for each in given)))


@STUDY.part("ICS and SCS slice by slice: distances")
def slice_by_slice(folder: Path, quick: bool) -> str:
    """The paper's algorithm itself: stripes by slice distance and subsamples."""
    results = of_scenes(distances, quick)
    rows = [row for found, _ in results for row in found]
    write_rows(folder, "stripes", "Stripes by slice distance and subsamples", rows)
    for name, (_, images) in zip(SCENES, results, strict=False):
        if images:
            panels(folder, name.replace(", ", "-"), images)
    clean = {m: [r["distance"] for r in rows if r["subsamples"] == m and r["stripes"] <= VISIBLE] for m in (0, 4)}
    return "Without stripes up to " + ", ".join(
        f"{max(found):g} with {m} subsamples" for m, found in clean.items() if found
    )


def known_distances(folder: Path, quick: bool) -> list[Found]:
    """Rows of the part above: of the same run or, since they depend on no machine, as they are recorded."""
    for place in (folder.parent, RECORDED / STUDY.name):
        path = place / "slice_by_slice" / "stripes.csv"
        if path.exists() and not quick:
            with path.open(newline="", encoding="utf-8") as file:
                return list(csv.DictReader(file))
    return [row for found, _ in of_scenes(distances, quick) for row in found]


@STUDY.part("ICS and SCS slice by slice: times")
def slice_times(folder: Path, quick: bool) -> str:
    """Slices saved, the cost of a subsample, and the time, by the size of the kernel."""
    rows = [row for found in of_scenes(times, quick, known_distances(folder, quick)) for row in found]
    views = 1 if quick else VIEWS
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
    last = summary[-2]
    return (
        f"With {last['K']} x {last['K']} taps SCS is {last['mean [%]']:.0f} % faster than ICS in the mean and "
        f"{last['worst [%]']:.0f} % at worst (the paper {paper['mean']} % and {paper['worst']} %); a subsample costs "
        f"{last['a subsample [%]']:.1f} % of a slice at most, and times are within "
        f"{last['off the model [%]']:.0f} % of the model."
    )
