"""Lum, Wilson and Ma, "High-Quality Lighting and Efficient Pre-Integration for Volume Rendering" (2004): the tables.

Table 1 (time to build an n x n table, brute force against incremental subrange integration), the accuracy of every
generator, and what a look-up between entries costs in accuracy.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import warp as wp
from matplotlib.figure import Figure

import wvr
from wvr.launch import get_device
from wvr.transfer.preintegration import generate
from wvr.transfer.running import Cut

from .base.harness import COLORS, save_figure
from .base.reference import quadrature
from .base.rows import seconds, write_rows
from .base.study import Study
from .brute_hoisted import build_hoisted, make_hoisted

STUDY = Study("lum2004")
# Table 1 of the paper, seconds by table size: (brute force, incremental). Its machine is of 2004; the ratio compares.
PAPER = {int(n): tuple(times) for n, times in STUDY.paper["seconds by table size"].items()}
LENGTHS = (0.25, 0.5, 0.75, 1.0)


def random_transfer_function(knots: int = 256, seed: int = 0) -> wvr.TransferFunction:
    """Colours and opacities at random at every grey level, mostly thin."""
    rng = np.random.default_rng(seed)
    return wvr.TransferFunction.from_arrays(np.linspace(0, 255, knots), rng.random((knots, 3)), rng.random(knots) ** 3)


@STUDY.part("Table 1")
def table1(folder: Path, quick: bool) -> str:
    """Time to build a table against its size, on the CPU and every CUDA device."""
    sizes, brute_up_to = ([32, 64, 128], 128) if quick else (list(PAPER), 2048)
    findings = []
    for device in (get_device("cpu"), *wp.get_cuda_devices()):
        hoisted = make_hoisted()
        rows = [table1_row(n, device, hoisted, n <= brute_up_to) for n in sizes]
        name = f"table1-{device.alias.replace(':', '')}"
        write_rows(folder, name, f"Lum et al. 2004, Table 1, on {device.name}, {wvr.get_num_threads()} threads", rows)
        save_figure(_speed_chart(rows), folder / name)
        last = max((row for row in rows if "brute s" in row), key=lambda row: row["n"])
        findings.append(
            f"{device.name}: at n = {last['n']} brute force takes {last['brute s']:.3g} s, incremental integration "
            f"{last['incremental s']:.3g} s: {last['brute ratio']:.0f} times, in the paper {last['paper ratio']:.0f}. "
            f"Weighted tables take {last['weighted s'] / last['incremental s']:.1f} times as long as plain ones."
        )
    return " ".join(findings)


def table1_row(n: int, device: wp.Device, hoisted: Any, with_brute: bool) -> dict:
    """Of tables with n x n entries, built on a device."""
    cut = Cut(random_transfer_function(), n, (0, 255), 1.0)
    colors = cut.colors(None)

    def time(generator: str, weights: str | None = None, lengths: tuple = (1.0,), rounds: int = 5) -> float:
        def build() -> None:
            for length in lengths:
                generate(colors, cut, length, generator, weights, "float32", device)
            wp.synchronize_device(device)

        return seconds(build, rounds)

    blank = np.empty((n, n, 4), np.float32)
    row = {
        "n": n,
        "incremental s": time("incremental"),
        "weighted s": time("incremental", "lighting"),
        f"3D x{len(LENGTHS)} s": time("incremental", None, LENGTHS),
        "writing s": seconds(lambda: blank.fill(1.0)),
    }
    if with_brute:
        row["brute s"] = time("brute", rounds=1)
        row["hoisted s"] = seconds(lambda: build_hoisted(hoisted, cut, device), 1)
        row["brute ratio"] = row["brute s"] / row["incremental s"]
        row["hoisted ratio"] = row["hoisted s"] / row["incremental s"]
    if n in PAPER:
        row["paper s"] = PAPER[n][1]
        row["paper brute s"] = PAPER[n][0]
        row["paper ratio"] = PAPER[n][0] / PAPER[n][1]
    return row | {"n / 9": n / 9}


def _speed_chart(rows: list[dict]) -> Figure:
    figure = Figure(figsize=(8, 3.6))
    time_axes, ratio_axes = figure.subplots(1, 2)
    series = (
        ("brute s", "brute force"),
        ("hoisted s", "brute force, corrections hoisted"),
        ("weighted s", "incremental, weighted"),
        ("incremental s", "incremental"),
        ("writing s", "writing the table only"),
        ("paper brute s", "paper (2004): brute force"),
        ("paper s", "paper (2004): incremental"),
    )
    for i, (key, label) in enumerate(series):
        points = [(row["n"], row[key]) for row in rows if key in row]
        style = "--" if key.startswith("paper") else "-"
        time_axes.plot(*zip(*points, strict=True), style, marker="os^vD+x"[i], color=COLORS[i], label=label, ms=4)
    time_axes.set(xscale="log", yscale="log", xlabel="table size n", ylabel="time to build [s]")
    for i, (key, label) in enumerate(
        (
            ("brute ratio", "brute force / incremental"),
            ("hoisted ratio", "brute force, corrections hoisted / incremental"),
            ("paper ratio", "paper (2004)"),
            ("n / 9", "n / 9"),
        )
    ):
        points = [(row["n"], row[key]) for row in rows if key in row]
        ratio_axes.plot(*zip(*points, strict=True), marker="os^."[i], color=COLORS[i], label=label, ms=4)
    ratio_axes.set(xscale="log", yscale="log", xlabel="table size n", ylabel="speed-up")
    for axes in (time_axes, ratio_axes):
        axes.set_xscale("log", base=2)
        axes.grid()
        axes.legend(fontsize="x-small")
    return figure


SPIKES = wvr.TransferFunction.isosurfaces(
    [64, 192], colors=[(0.9, 0.1, 0.05), (0.05, 0.2, 0.9)], opacity=0.99, width=24
)


@STUDY.part("Accuracy of the tables")
def accuracy(folder: Path, quick: bool) -> str:
    """Every generator against adaptive quadrature, at entries drawn at random."""
    n, entries = (64, 5) if quick else (512, 40)
    cases = {
        "ramp": wvr.TransferFunction([(0, (1, 0, 0), 0.0), (255, (0, 1, 0.5), 0.9)]),
        "random": random_transfer_function(64),
        "opaque spikes": SPIKES,
    }
    rng = np.random.default_rng(1)
    scalars = np.linspace(0, 255, n)
    rows = []
    for name, tf in cases.items():
        for length in (0.01, 1.0, 30.0):
            pairs = rng.integers(0, n, (entries, 2))
            exact = np.array([quadrature(tf, scalars[i], scalars[j], length) for i, j in pairs])
            row: dict = {"transfer function": name, "length": length}
            generators: tuple[Literal["incremental", "brute", "approximate"], ...]
            generators = ("incremental", "brute", "approximate")
            for generator in generators:
                for precision in ("float32", "float64"):
                    table = wvr.preintegrate(tf, n, length, (0, 255), generator, precision=precision)
                    row[f"{generator} {precision}"] = float(np.abs(table.rgba[tuple(pairs.T)] - exact).max())
            line = wvr.preintegrate(tf, n, domain=(0, 255), generator="running")
            front, back = scalars[pairs].T
            row["running"] = float(np.abs(line.lookup(front, back, length) - exact).max())
            rows.append(row)
    write_rows(folder, "accuracy", f"Max abs error against quadrature, n = {n}, {entries} entries", rows)

    def worst(column: str) -> float:
        return max(row[column] for row in rows)

    return (
        f"Incremental integration is off by up to {worst('incremental float32'):.1e} in float32 and "
        f"{worst('incremental float64'):.1e} in float64, approximate by {worst('approximate float64'):.1e}."
    )


@STUDY.part("Look-up between entries")
def lookups(folder: Path, quick: bool) -> str:
    """What looking up between entries costs: bilinear, nearest, a 3D table at other lengths, running integrals."""
    sizes = [16, 64] if quick else [16, 32, 64, 128, 256, 512, 1024, 2048]
    segments = 20 if quick else 400
    tf = random_transfer_function(33, seed=3)
    rng = np.random.default_rng(2)
    front = rng.uniform(0, 255, segments)
    back = np.clip(front + rng.normal(0, 8, segments), 0, 255)  # neighbouring samples are alike
    other = rng.uniform(0.1, 1.0, segments)
    exact = np.array([quadrature(tf, a, b, 1.0) for a, b in zip(front, back, strict=True)])
    exact_other = np.array([quadrature(tf, a, b, d) for a, b, d in zip(front, back, other, strict=True)])

    def error(values: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
        return float(np.abs(values - truth).max()), float(np.abs(values - truth).mean())

    line = wvr.preintegrate(tf, 256, domain=(0, 255), generator="running")
    rows = []
    for n in sizes:
        table = wvr.preintegrate(tf, n, 1.0, (0, 255), precision="float64")
        at = [np.rint(s / 255 * (n - 1)).astype(int) for s in (front, back)]
        row: dict = {"n": n}
        methods = {
            "bilinear": error(table.lookup(front, back), exact),
            "nearest": error(table.rgba[at[0], at[1]], exact),
            "running integrals": error(line.lookup(front, back, 1.0), exact),
            "running integrals, other lengths": error(line.lookup(front, back, other), exact_other),
        }
        if n <= 512:
            lengths = np.linspace(0.125, 1.0, 8)
            table3 = wvr.preintegrate(tf, n, lengths.tolist(), (0, 255))
            methods["3D, other lengths"] = error(table3.lookup(front, back, other), exact_other)
        for name, (worst, mean) in methods.items():
            row[f"{name} max"], row[f"{name} mean"] = worst, mean
        rows.append(row)
    write_rows(folder, "lookups", "Error of a look-up between entries, 33 random control points", rows)
    figure = Figure(figsize=(6, 3.8))
    axes = figure.subplots()
    names = list(dict.fromkeys(key[:-4] for row in rows for key in row if key.endswith(" max")))
    for i, name in enumerate(names):
        points = [(row["n"], row[f"{name} max"]) for row in rows if f"{name} max" in row]
        axes.plot(*zip(*points, strict=True), marker="os^vD"[i], color=COLORS[i], label=name, ms=4)
    axes.set(yscale="log", xlabel="table size n", ylabel="largest absolute error of RGBA")
    axes.set_xscale("log", base=2)
    axes.grid()
    axes.legend(fontsize="x-small")
    save_figure(figure, folder / "lookups")
    first, last = rows[0], rows[-1]
    return (
        f"Bilinear look-up is off by {first['bilinear max']:.1e} at n = {first['n']} and {last['bilinear max']:.1e} at "
        f"n = {last['n']}: larger tables do reduce the error, as the paper says."
        if last["bilinear max"] < first["bilinear max"]
        else "Larger tables did not reduce the error of a look-up here."
    )


@STUDY.part("Self-attenuation")
def order_of_spikes(folder: Path, quick: bool) -> str:
    """Two opaque spikes: what neglecting self-attenuation does to the table."""
    n = 64 if quick else 256
    tables = {
        "incremental": wvr.preintegrate(SPIKES, n, 3.0, (0, 255)).rgba,
        "approximate": wvr.preintegrate(SPIKES, n, 3.0, (0, 255), "approximate").rgba,
    }
    figure = Figure(figsize=(8, 3.6))
    panels = figure.subplots(1, 3)
    for axes, (name, rgba) in zip(panels, tables.items(), strict=False):
        axes.imshow(np.clip(rgba[..., :3], 0, 1) ** (1 / 2.2), origin="lower", extent=(0, 255, 0, 255))
        axes.set(title=name, xlabel="scalar at the back", ylabel="scalar at the front")
    difference = np.abs(tables["incremental"] - tables["approximate"])[..., :3].max(axis=-1)
    shown = panels[2].imshow(difference, origin="lower", extent=(0, 255, 0, 255), cmap="magma")
    panels[2].set(title="largest difference", xlabel="scalar at the back", ylabel="scalar at the front")
    figure.colorbar(shown, ax=panels[2], shrink=0.75)
    save_figure(figure, folder / "opaque-spikes")
    return f"Without self-attenuation an entry is off by up to {difference.max():.2f} of a colour in [0, 1]."
