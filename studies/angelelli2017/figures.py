"""Figures 1, 3 and 7: where aliasing shows, and what subsamples do about it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..base.harness import COLORS, save_figure
from ..base.rows import write_rows
from ..lighting import panels
from . import methods
from .aliasing import VISIBLE, aliasing
from .methods import PAPER, STUDY, Method, coarsest, converged, errors_by_distance, reference, threads, views_of
from .scenes import make_scene


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
    fine, limit = reference(scene, "ICS"), converged(scene)
    images, rows = {}, []
    for name, method in methods.items():
        image, ms = method.measured(scene, views)
        paper = PAPER["figure 1"].get(name)
        row: dict[str, Any] = {"method": name, "ms": ms, "paper ms": paper}
        if name != "Phong":
            row |= {"aliasing": aliasing(image, fine), "mean difference": float(np.abs(image.rgba - limit.rgba).mean())}
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
    rows: list[dict[str, Any]] = [{"distance": distance} for distance in methods.DISTANCES]
    figure = Figure(figsize=(5, 3.4), layout="constrained")
    axes = figure.subplots()
    for i, (name, errors) in enumerate(found.items()):
        best = coarsest(errors)
        for row, (_, error) in zip(rows, errors, strict=True):
            row[name] = error
        axes.loglog(
            methods.DISTANCES,
            [error for _, error in errors],
            "os^"[i] + "-",
            ms=4,
            color=COLORS[i],
            label=f"{name}, up to {best.distance:g}" if best else f"{name}, none",
        )
    axes.axhline(VISIBLE, color="0.6", lw=0.8)
    axes.set(xlabel="slice distance, step [voxels]", ylabel="aliasing", title=scene.name)
    axes.set_xticks(methods.DISTANCES, [f"{d:g}" for d in methods.DISTANCES], fontsize="x-small")
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
    fine, limit = reference(scene, "ICS"), converged(scene)
    images, rows = {}, []
    for method in methods:
        image = method.render(scene)
        images[str(method)] = image, ""
        if method.name != "Phong":
            rows.append(
                {
                    "method": str(method),
                    "aliasing": aliasing(image, fine),
                    "mean difference": float(np.abs(image.rgba - limit.rgba).mean()),
                }
            )
            images[str(method)] = image, f"aliasing {rows[-1]['aliasing']:.4f}"
    write_rows(folder, "figure7", "Figure 7: the generated ultrasound against what it converges to", rows)
    panels(folder, "figure7", images)
    return "Aliasing: " + ", ".join(f"{row['method']} {row['aliasing']:.4f}" for row in rows) + "."
