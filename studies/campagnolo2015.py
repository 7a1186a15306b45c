"""Campagnolo, Celes and de Figueiredo, "Accurate Volume Rendering based on Adaptive Numerical Integration" (2015).

Tables I to VI and Figures 2 to 6, the paper's numbers beside ours. The volumes are those of the paper where they are
there, else generated ones stand in for them; its transfer functions and views are not published, so ours look like its
Figure 3, and shares and times compare in kind.

Two choices make the paper's numbers what they are, and are followed here. Its Riemann sum is of first order (five times
the step, five times the error): opacity tau h of samples at the front of a step, without the exponential, called
"Riemann" below; ours, "midpoint", has exact opacities and is of second order. And its tolerance is that of a ray, of
which a step has its share by length (``scope="ray"``); with a tolerance of 0.001 for each step of h0 hardly any step
would ever be halved. Nothing leaps over empty space here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import warp as wp
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from numpy.typing import NDArray

import wvr
from wvr.color import linear_to_srgb
from wvr.launch import get_device

from .base import scenes as views
from .base.harness import COLORS, save_figure
from .base.rows import write_rows
from .base.scenes import SCENES, Scene, make_scene, picture, processor_timed
from .base.study import Study

STUDY = Study("campagnolo2015")
PAPER = STUDY.paper
STEPS = (0.5, 0.4, 0.3, 0.2, 0.1)
TOLERANCES = (0.01, 0.005, 0.001)
REFERENCE_STEP = 0.01
CHANNELS = ("R", "G", "B", "A")


def render(scene: Scene, integrator: Any, skip_empty: bool = False) -> wvr.Image:
    """With every sample computed, and rays followed to where 1e-5 of the light is left."""
    return scene.render(integrator, termination=1e-5, skip_empty=skip_empty)


def riemann(scene: Scene, h: float, skip_empty: bool = False) -> wvr.Image:
    """As the paper sums: the opacity of a step is tau h, at its front."""
    tf = linear_opacity(scene.transfer_function, scene.volume.smallest_spacing, h)
    return render(replace(scene, transfer_function=tf), wvr.Riemann(h, "left"), skip_empty)


def linear_opacity(tf: wvr.TransferFunction, unit: float, h: float, entries: int = 4096) -> wvr.TransferFunction:
    """The transfer function whose exact opacity of a step ``h`` is tau h, the first term of 1 - exp(-tau h)."""
    s = np.union1d(np.linspace(tf.knots[0], tf.knots[-1], entries), tf.knots)
    length = h * unit
    return wvr.TransferFunction.from_arrays(
        s, tf.color(s), np.minimum(tf.extinction(s, unit) * length, 1.0), unit_distance=length
    )


def adaptive(
    tolerance: float, coupling: Literal["coupled", "decoupled"] = "coupled", **options: Any
) -> wvr.AdaptiveSimpson:
    """With the paper's parameters."""
    return wvr.AdaptiveSimpson(tolerance, coupling=coupling, **{"scope": "ray"} | options)


# --- Tables I, II and VI, Figures 4 and 5 -----------------------------------------------------------------------------


@cache
def references(name: str, quick: bool) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """The exact image, and the paper's reference: a fine sum."""
    scene = make_scene(name, quick)
    return render(scene, wvr.Exact(), skip_empty=True).rgba, riemann(scene, REFERENCE_STEP, skip_empty=True).rgba


@STUDY.part("Table I and Figure 4")
def table1(folder: Path, quick: bool) -> str:
    """Rays over the tolerances, Bonsai."""
    return accuracy(folder, "Bonsai", "I", "figure4", quick)


@STUDY.part("Table II and Figure 5")
def table2(folder: Path, quick: bool) -> str:
    """Rays over the tolerances, BluntFin."""
    return accuracy(folder, "BluntFin", "II", "figure5", quick)


def accuracy(folder: Path, name: str, table: str, figure: str, quick: bool) -> str:
    """Rays over the tolerances."""
    scene, (exact, sums) = make_scene(name, quick), references(name, quick)
    images: dict[str, dict[float, wvr.Image]] = {}
    for h in STEPS:
        images[f"Riemann h = {h:g}"] = dict.fromkeys(TOLERANCES, riemann(scene, h))
    for h in STEPS:
        images[f"midpoint h = {h:g}"] = dict.fromkeys(TOLERANCES, render(scene, wvr.Riemann(h)))
    for coupling in ("coupled", "decoupled"):
        images[coupling.capitalize()] = {t: render(scene, adaptive(t, coupling)) for t in TOLERANCES}
    images["Coupled, tolerance of a step"] = {t: render(scene, adaptive(t, scope="step")) for t in TOLERANCES}
    rows = _share_rows(table, images, exact, sums)
    between = wvr.compare(sums, exact)
    rows.append(
        {"method": f"Riemann h = {REFERENCE_STEP:g}", "limit": "max"}
        | {f"{c} of exact": float(m) for c, m in zip(CHANNELS, between.channel_max, strict=True)}
    )
    write_rows(folder, f"table{table}", f"Table {table}: {PAPER[table]['title']}", rows)
    _histogram(folder / figure, scene.name, rows)
    limit = TOLERANCES[-1]

    def worst(method: str, label: str = "of exact") -> str:
        row = next(row for row in rows if row["method"] == method and row["limit"] == limit)
        return f"{max(row[f'{c} {label}'] for c in CHANNELS):.2g} %"

    return (
        f"Rays over {limit:g} in the worst channel: coupled {worst('Coupled')} (paper: {worst('Coupled', 'paper')}), "
        f"decoupled {worst('Decoupled')} ({worst('Decoupled', 'paper')}), the paper's Riemann sum of h = 0.1 "
        f"{worst('Riemann h = 0.1')} ({worst('Riemann h = 0.1', 'paper')}), the midpoint rule of h = 0.1 "
        f"{worst('midpoint h = 0.1')}. The paper's reference, a sum of h = {REFERENCE_STEP:g}, is itself off by up to "
        f"{between.max:.1e}."
    )


def _share_rows(
    table: str, images: dict[str, dict[float, wvr.Image]], exact: NDArray, sums: NDArray
) -> list[dict[str, Any]]:
    """A row for each method and limit: per cent of rays over it, of the paper, against both references."""
    rows = []
    for limit in next(iter(images.values())):
        for method, by_limit in images.items():
            image = by_limit[limit]
            row: dict[str, Any] = {"method": method, "limit": limit, "samples": image.stats["samples"]}
            paper = PAPER[table]["rows"].get(method, {}).get(f"{limit:g}", [None] * 4)
            for label, values in (
                ("paper", paper),
                ("of exact", 100 * wvr.compare(image, exact, [limit]).channel_shares[limit]),
                ("of sum", 100 * wvr.compare(image, sums, [limit]).channel_shares[limit]),
            ):
                row |= {f"{c} {label}": v if v is None else float(v) for c, v in zip(CHANNELS, values, strict=True)}
            rows.append(row)
    return rows


def _histogram(path: Path, name: str, rows: list[dict[str, Any]]) -> None:
    """Share of rays over the smallest tolerance, the paper's and ours."""
    rows = [row for row in rows if row["limit"] == TOLERANCES[-1]]
    figure = Figure(figsize=(9, 6))
    panels = figure.subplots(2, 1, sharey=True)
    for axes, label, title in zip(panels, ("paper", "of exact"), ("the paper", "wvr, against Exact"), strict=True):
        shown = [row for row in rows if row[f"A {label}"] is not None]
        for i, (channel, color) in enumerate(zip(CHANNELS, ("#D55E00", "#009E73", "#0072B2", "0.3"), strict=True)):
            place = np.arange(len(shown)) + 0.2 * (i - 1.5)
            axes.bar(place, [max(row[f"{channel} {label}"], 1e-4) for row in shown], 0.2, color=color, label=channel)
        names = [row["method"].replace(" h", "\nh").replace(", tolerance of", ",\ntolerance\nof") for row in shown]
        axes.set_xticks(np.arange(len(shown)), names)
        axes.tick_params(axis="x", labelsize="x-small")
        axes.set(yscale="log", ylim=(1e-3, 100), ylabel="rays over 0.001 [%]", title=f"{name}: {title}")
        axes.grid(axis="y")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=4)
    save_figure(figure, path)


@STUDY.part("Tables V and VI")
def wide_steps(folder: Path, quick: bool) -> str:
    """Bonsai with steps from 0.4 to 4 voxels."""
    scene, (exact, sums) = make_scene("Bonsai", quick), references("Bonsai", quick)
    limit = TOLERANCES[-1]
    couplings: tuple[Literal["coupled", "decoupled"], ...] = ("coupled", "decoupled")
    methods = {coupling.capitalize(): adaptive(limit, coupling, hmin=0.4, hmax=4.0) for coupling in couplings}
    images = {"Riemann h = 0.1": {limit: riemann(scene, 0.1)}}
    images |= {name: {limit: render(scene, integrator)} for name, integrator in methods.items()}
    shares = _share_rows("VI", images, exact, sums)
    write_rows(folder, "tableVI", f"Table VI: {PAPER['VI']['title']}", shares)
    timed = {"Riemann h = 0.1": wvr.Riemann(0.1)} | methods
    times = fastest(scene, timed, "cpu")
    # The paper's second column, where there is a GPU.
    cuda = [fastest(scene, timed, device.alias) for device in wp.get_cuda_devices()[:1]]
    first = "Riemann h = 0.1"
    rows = []
    # In the paper's order; its names have the tolerance with them.
    for (method, (seconds, rate)), name in zip(PAPER["V"]["rows"].items(), timed, strict=True):
        row = {"method": method, "paper s": seconds, "s": times[name]}
        row |= {"paper ratio": seconds / PAPER["V"]["rows"][first][0], "ratio": times[name] / times[first]}
        row |= {"paper fps, GPU": rate}
        for found in cuda:
            row |= {"fps, GPU": 1 / found[name], "ratio, GPU": found[name] / found[first]}
        rows.append(row)
    write_rows(folder, "tableV", f"Table V: {PAPER['V']['title']}", rows)
    return (
        f"Over {limit:g} in opacity, and time: "
        + "; ".join(
            f"{share['method']} {share['A of exact']:.2g} % (paper: {share['A paper']:.2g} %), {row['ratio']:.2f} "
            f"({row['paper ratio']:.2f})"
            for share, row in zip(shares, rows, strict=True)
        )
        + "."
    )


# --- Tables III and IV ------------------------------------------------------------------------------------------------


def fastest(scene: Scene, integrators: dict[str, Any], device: str, rounds: int = 2) -> dict[str, float]:
    """Seconds: the faster of two rounds, in which the methods take turns; on the CPU those of the processor, of all
    threads together, on a GPU those that casting the rays takes.
    """
    renderers = {
        name: wvr.Renderer(
            scene.volume, scene.transfer_function, integrator=integrator, device=device, skip_empty=False
        )
        for name, integrator in integrators.items()
    }
    for renderer in renderers.values():
        renderer.render(scene.camera, (8, 6))  # kernels are built
    kind = "processor_s" if device == "cpu" else "seconds_raycast"
    times = [
        {name: processor_timed(renderer, scene).stats[kind] for name, renderer in renderers.items()}
        for _ in range(rounds)
    ]
    return {name: min(time[name] for time in times) for name in renderers}


@STUDY.part("Tables III and IV")
def speed(folder: Path, quick: bool) -> str:
    """Table III on the CPU, Table IV on a CUDA device where there is one."""
    scenes = [make_scene(name, quick) for name in SCENES]
    return " ".join(_speed(folder, scenes, device.alias) for device in (get_device("cpu"), *wp.get_cuda_devices()[:1]))


def _speed(folder: Path, scenes: Sequence[Scene], device: str) -> str:
    table = "III" if device == "cpu" else "IV"
    integrators: dict[str, Any] = {f"Riemann h = {h:g}": wvr.Riemann(h) for h in STEPS}
    for tolerance in TOLERANCES:
        for coupling in ("coupled", "decoupled"):
            integrators[f"{coupling.capitalize()} ε = {tolerance:g}"] = adaptive(tolerance, coupling)
    rows: list[dict[str, Any]] = [{"method": name} for name in integrators]
    first = "Riemann h = 0.5"
    for i, scene in enumerate(scenes):
        times = fastest(scene, integrators, device)
        for row in rows:
            paper, base = PAPER[table]["rows"][row["method"]][i], PAPER[table]["rows"][first][i]
            ours = times[row["method"]] if table == "III" else 1 / times[row["method"]]
            row[f"{scene.name} paper"], row[scene.name] = paper, ours
            row[f"{scene.name} paper ratio"] = paper / base if table == "III" else base / paper
            row[f"{scene.name} ratio"] = times[row["method"]] / times[first]
    title = f"Table {table}: {PAPER[table]['title']}; {wvr.get_num_threads()} threads, ratios to {first}"
    write_rows(folder, f"table{table}", title, rows)
    figure = Figure(figsize=(8, 4))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, label, title in zip(panels, ("paper ratio", "ratio"), ("the paper", "wvr"), strict=True):
        for i, scene in enumerate(scenes):
            values = [row[f"{scene.name} {label}"] for row in rows]
            axes.plot(values, np.arange(len(rows)), "os^D"[i], color=COLORS[i], label=scene.name)
        axes.axvline(1, color="0.6", lw=0.8)
        axes.set(xscale="log", title=title, xlabel=f"time over that of {first}")
        axes.xaxis.set_major_locator(FixedLocator([1, 2, 3, 4, 5]))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid()
    panels[0].set_yticks(np.arange(len(rows)), [row["method"] for row in rows], fontsize="small")
    panels[0].invert_yaxis()
    figure.legend(*panels[1].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    save_figure(figure, folder / f"table{table}")
    row = next(row for row in rows if row["method"] == f"Coupled ε = {TOLERANCES[-1]:g}")
    return (
        f"Coupled at {TOLERANCES[-1]:g} takes, over {first} on {device}: "
        + ", ".join(
            f"{scene.name} {row[f'{scene.name} ratio']:.2f} (paper: {row[f'{scene.name} paper ratio']:.2f})"
            for scene in scenes
        )
        + "."
    )


# --- Figures 2, 3 and 6 -----------------------------------------------------------------------------------------------


@STUDY.part("Figure 2")
def figure2(folder: Path, quick: bool) -> str:
    """What a step without a longest length leaps over."""
    scene = make_scene("Bonsai", quick)
    longest = {"no hmax": 1e4, "hmax = 8": 8.0}
    images = {
        name: render(scene, adaptive(TOLERANCES[0], hmax=hmax)).composited("white") for name, hmax in longest.items()
    }
    figure = Figure(figsize=(9, 2.6))
    panels = figure.subplots(1, 3)
    for axes, (name, rgb) in zip(panels, images.items(), strict=False):
        axes.imshow(np.clip(linear_to_srgb(rgb), 0, 1))
        axes.set(title=name, xticks=[], yticks=[])
    difference = np.abs(np.subtract(*images.values())).max(axis=2)
    shown = panels[2].imshow(difference, cmap="magma")
    panels[2].set(title="largest difference of a channel", xticks=[], yticks=[])
    figure.colorbar(shown, ax=panels[2])
    save_figure(figure, folder / "figure2")
    share = np.mean(difference > 1 / 256)
    return f"Without a longest step {share:.2%} of pixels differ by more than 1/256, by {difference.max():.2f} at most."


@STUDY.part("Figure 3")
def figure3(folder: Path, quick: bool) -> str:
    """The scenes and their transfer functions."""
    scenes = [make_scene(name, quick) for name in SCENES]
    figure = Figure(figsize=(7, 6.6))
    panels = figure.subplots(4, 2, height_ratios=[4, 1, 4, 1])
    for i, scene in enumerate(scenes):
        top, bottom = panels[i // 2 * 2, i % 2], panels[i // 2 * 2 + 1, i % 2]
        top.imshow(picture(render(scene, adaptive(TOLERANCES[0]))))
        top.set(title=f"{scene.name}, {' x '.join(map(str, scene.volume.dimensions))}", xticks=[], yticks=[])
        s = np.linspace(*scene.volume.range, 400)
        unit = scene.volume.smallest_spacing
        opacity = -np.expm1(-scene.transfer_function.extinction(s, unit) * unit)
        bottom.bar(s, opacity, s[1] - s[0], color=np.clip(linear_to_srgb(scene.transfer_function.color(s)), 0, 1))
        bottom.set(xlabel="scalar", ylabel="opacity\nof a voxel", xlim=scene.volume.range, ylim=(0, 1))
    save_figure(figure, folder / "figure3")
    stand_ins = [scene.name for scene in scenes if quick or not views.is_there(scene.name.lower())]
    return f"Generated volumes stand in for {', '.join(stand_ins)}." if stand_ins else "The paper's volumes."


@STUDY.part("Figure 6")
def figure6(folder: Path, quick: bool) -> str:
    """The steps of a ray, hmin = 0.4 and hmax = 4, tolerance 0.01."""
    scene = make_scene("Bonsai", quick)
    image = render(scene, adaptive(TOLERANCES[0], hmin=0.4, hmax=4.0))
    alpha = image.rgba[..., 3]
    busiest = np.where((alpha > 0.5) & (alpha < 0.98), image.samples, 0)
    y, x = np.unravel_index(np.argmax(busiest), busiest.shape)
    steps = image.trace(int(x), int(y))
    fine = render(scene, adaptive(1e-6, h0=0.05, hmin=0.01, hmax=0.1)).trace(int(x), int(y))
    figure = Figure(figsize=(8, 5))
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    ends, fine_ends = steps["t"] + steps["length"], fine["t"] + fine["length"]
    top.plot(fine_ends, fine["rgba"][:, 3], color="0.6", lw=1, label="steps of at most 0.1")
    top.plot(ends, steps["rgba"][:, 3], "o", ms=3, color=COLORS[0], label="ends of adaptive steps")
    forced = steps["forced"]
    if forced.any():
        top.plot(ends[forced], steps["rgba"][forced, 3], "o", ms=3, color=COLORS[3], label="forced")
    top.set(ylabel="opacity", title=f"{scene.name}, ray of pixel ({x}, {y}): {len(steps)} steps")
    figure.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    bottom.step(np.append(steps["t"], ends[-1:]), np.append(steps["length"], steps["length"][-1:]), where="post")
    bottom.set(xlabel="position along the ray [voxels]", ylabel="step [voxels]")
    for axes in (top, bottom):
        axes.grid()
    save_figure(figure, folder / "figure6")
    columns = {"forced": forced.astype(int)} | {c: steps["rgba"][:, i] for i, c in enumerate(CHANNELS)}
    columns = {key: steps[key] for key in ("t", "length", "tolerance", "depth_error", "error")} | columns
    rows = [dict(zip(columns, (v.item() for v in row), strict=True)) for row in zip(*columns.values(), strict=True)]
    write_rows(folder, "figure6", f"Figure 6: steps of the ray of pixel ({x}, {y})", rows)
    lengths = steps["length"]
    return (
        f"{len(steps)} steps of {lengths.min():.2g} to {lengths.max():.2g} voxels, {int(forced.sum())} of them forced."
    )
