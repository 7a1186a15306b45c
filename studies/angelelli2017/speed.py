"""Table 1 with Figure 4, and Figures 5 and 6: what a method costs where it shows no aliasing, and what a subsample."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import wvr

from ..base.harness import COLORS, save_figure
from ..base.rows import write_rows
from ..base.scenes import picture
from ..lighting import panels
from . import methods
from .aliasing import aliasing
from .methods import PAPER, STUDY, Method, coarsest, converged, errors_by_distance, reference, threads, views_of
from .scenes import SCENES, Scene, make_scene


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


def settled(scene: Scene, fine: dict[str, wvr.Image]) -> dict[str, Method]:
    """Every method at its fastest setting without aliasing; where even the finest shows it, that one."""
    best = {}
    for name in ("ray cast", "Phong", "ICS", "PI-ICS"):
        found = errors_by_distance(scene, name, fine.get(name, fine["ICS"]))
        best[name] = coarsest(found) or found[0][0]
    for name in ("SCS", "PI-SCS"):
        # For every number of subsamples the largest distance, which grows; of those the fastest.
        farthest = best[name.replace("SCS", "ICS")].distance
        costs = {}
        for subsamples in methods.SUBSAMPLES:
            method = coarsest(errors_by_distance(scene, name, fine["ICS"], subsamples, farthest))
            if method is not None:
                costs[method] = method.measured(scene, 1)[1]
                farthest = method.distance
        best[name] = min(costs, key=costs.__getitem__) if costs else Method(name, methods.DISTANCES[0], 1)
    return {name: best[name] for name in ("ray cast", "Phong", "ICS", "SCS", "PI-ICS", "PI-SCS")}


@STUDY.part("Figure 5")
def figure5(folder: Path, quick: bool) -> str:
    """Every method at its largest distance without aliasing: what it costs."""
    rows: list[dict[str, Any]] = []
    images = []
    shown, views = [make_scene(name, quick) for name in SCENES], views_of(quick)
    for scene in shown:
        fine = {name: reference(scene, name) for name in ("ray cast", "Phong", "ICS")}
        limits = fine | {"ICS": converged(scene)}
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
                    "mean difference": float(np.abs(image.rgba - limits.get(method.name, limits["ICS"]).rgba).mean()),
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
        times = [Method(name, distance, m).measured(scene, views)[1] for m in (0, *methods.SUBSAMPLES)]
        for m, time in zip((0, *methods.SUBSAMPLES), times, strict=True):
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
