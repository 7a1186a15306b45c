"""Stress of the numerics: what breaks where, for inputs far from ordinary.

First part, pre-integration tables: optical depth from 1e-12 to 1e6, sizes from 2 to 4096, opacity 0 and 1, spikes one
entry wide, steps, nearest-neighbour and random transfer functions, every generator and weighting, both precisions. For
each the largest error against adaptive quadrature at entries drawn at random, and the number of entries that are NaN,
infinite, negative, or have an opacity outside [0, 1]; these must all be 0.
"""

from __future__ import annotations

import zlib
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from benchmarks.harness import save_figure

from .common import write_rows
from .reference import quadrature
from .study import Study

STUDY = Study("stability", "Stability: what breaks where, for inputs far from ordinary")

DEPTHS = (1e-12, 1e-9, 1e-6, 1e-4, 1e-2, 0.1, 1.0, 10.0, 1e3, 1e6)
SIZES = (2, 3, 16, 64, 256, 1024)
LARGE = 4096  # a few tables only: half a gigabyte each
SCHEMES = ("incremental", "weighted", "lum", "brute", "approximate")
BRUTE_UP_TO = 256
BASELINES = ("lum", "approximate")  # without a promise
# The bounds that are promised.
PROMISED = {"float32": 2e-6, "float64": 1e-12}
COUNTS = ("NaN or Inf", "negative", "opacity outside [0, 1]")


def make_transfer_function(kind: str, n: int, depth: float, rng: np.random.Generator) -> tuple:
    """A transfer function over [0, 1] whose largest extinction times the length is ``depth``; and that length."""
    s, heights = {
        "constant": (np.array([0.0, 1.0]), np.ones(2)),
        "ramp": (np.array([0.0, 1.0]), np.array([0.0, 1.0])),
        # One entry wide, between two entries at its sides.
        "spike": (0.37 + np.array([-0.37, -0.5 / n, 0.0, 0.5 / n, 0.63]), np.array([0.0, 0.0, 1.0, 0.0, 0.0])),
        "step": (np.array([0.0, 0.43, 0.43, 1.0]), np.array([0.0, 0.0, 1.0, 1.0])),
        "nearest": (np.repeat(np.linspace(0, 1, 17), 2)[1:-1], np.repeat(rng.random(16), 2)),
        "random": (np.linspace(0, 1, 24), rng.random(24) ** 3),
    }[kind]
    # Opacity cannot say more than an extinction of 16.6: longer segments do.
    length = max(depth / 16.0, 1.0)
    opacity = -np.expm1(-heights / heights.max() * depth / length)
    return wvr.TransferFunction.from_arrays(s, rng.random((len(s), 3)), opacity), length


def make_table(scheme: str, tf: wvr.TransferFunction, n: int, length: float, precision: str) -> wvr.Table:
    """The table of a generator or weighting."""
    if scheme == "brute":
        return wvr.preintegrate(tf, n, length, (0, 1), "brute", precision=precision)
    if scheme == "approximate":
        return wvr.preintegrate(tf, n, length, (0, 1), "approximate", precision=precision)
    weights = {"incremental": None, "weighted": "lighting", "lum": "lum"}[scheme]
    return wvr.preintegrate(tf, n, length, (0, 1), weights=weights, precision=precision)


def faults(table: wvr.Table, scheme: str) -> dict[str, int]:
    """Entries that no segment can have."""
    counts = dict.fromkeys(COUNTS, 0)
    for entries in (table.rgba, table.front, table.back):
        if entries is not None:
            # A weighted entry is a difference: rounding below zero, of the size of a rounding, is none.
            tiny = -np.finfo(entries.dtype).eps if entries is not table.rgba else 0.0
            counts["NaN or Inf"] += int(np.count_nonzero(~np.isfinite(entries)))
            counts["negative"] += int(np.count_nonzero(entries < tiny))
    alpha = table.rgba[..., 3]
    counts["opacity outside [0, 1]"] = int(np.count_nonzero((alpha < 0) | (alpha > 1)))
    return counts


def error(table: wvr.Table, scheme: str, tf: wvr.TransferFunction, pairs: NDArray[np.int64], length: float) -> float:
    """Largest error at the entries ``pairs``."""
    scalars = np.linspace(0, 1, len(table.rgba))
    worst = 0.0
    for i, j in pairs:
        if scheme in ("weighted", "lum"):
            assert table.back is not None
            exact = quadrature(tf, scalars[i], scalars[j], length, ramp=lambda t: t)
            worst = max(worst, float(np.abs(table.back[i, j] - exact).max()))
        exact = quadrature(tf, scalars[i], scalars[j], length)
        worst = max(worst, float(np.abs(table.rgba[i, j] - exact).max()))
    return worst


def sweep(depths: tuple[float, ...], sizes: tuple[int, ...], entries: int) -> list[dict]:
    """A row for every combination."""
    kinds = ("constant", "ramp", "spike", "step", "nearest", "random")
    cases: list[tuple[str, float, int, str, tuple[str, ...]]] = [
        (*case, SCHEMES) for case in product(kinds, depths, sizes, ("float32", "float64"))
    ]
    if max(sizes) >= 1024:
        cases += [
            (*case, ("weighted",)) for case in product(("spike", "random"), (1e-12, 1.0, 1e6), (LARGE,), PROMISED)
        ]
    rows = []
    for kind, depth, n, precision, schemes in cases:
        # The same transfer function and entries for both precisions and all schemes.
        rng = np.random.default_rng(zlib.crc32(f"{kind} {depth} {n}".encode()))
        tf, length = make_transfer_function(kind, n, depth, rng)
        i = rng.integers(0, n, entries)
        pairs = np.stack([i, np.clip(i + rng.choice([-2, -1, 0, 1, 2, n // 3, -n // 3], entries), 0, n - 1)], axis=1)
        for scheme in schemes:
            if scheme == "brute" and n > BRUTE_UP_TO:
                continue
            table = make_table(scheme, tf, n, length, precision)
            rows.append(
                {
                    "scheme": scheme,
                    "precision": precision,
                    "kind": kind,
                    "depth": depth,
                    "n": n,
                    "max error": error(table, scheme, tf, pairs, length),
                    **faults(table, scheme),
                }
            )
    return rows


def summarize(rows: list[dict]) -> list[dict]:
    """By scheme and precision: the worst of all."""
    result = []
    for scheme, precision in product(SCHEMES, PROMISED):
        those = [row for row in rows if (row["scheme"], row["precision"]) == (scheme, precision)]
        worst = max(those, key=lambda row: row["max error"])
        result.append(
            {
                "scheme": scheme,
                "precision": precision,
                "tables": len(those),
                "max error": worst["max error"],
                "at": f"{worst['kind']}, depth {worst['depth']:g}, n = {worst['n']}",
                **{count: sum(row[count] for row in those) for count in COUNTS},
            }
        )
    return result


def heat_map(rows: list[dict], depths: tuple[float, ...]) -> Figure:
    """Largest error by scheme and optical depth."""
    figure = Figure(figsize=(8, 3.2))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, precision in zip(panels, PROMISED, strict=True):
        cells = np.array(
            [
                [
                    max(
                        row["max error"]
                        for row in rows
                        if (row["scheme"], row["precision"], row["depth"]) == (scheme, precision, depth)
                    )
                    for depth in depths
                ]
                for scheme in SCHEMES
            ]
        )
        shown = axes.imshow(np.maximum(cells, 1e-18), norm=LogNorm(1e-18, 1e-2), cmap="viridis", aspect="auto")
        for (y, x), value in np.ndenumerate(cells):
            axes.text(x, y, f"{np.log10(max(value, 1e-18)):.0f}", ha="center", va="center", fontsize=7, color="w")
        axes.set_xticks(range(len(depths)), [f"{depth:g}" for depth in depths], rotation=60, fontsize=7)
        axes.set_yticks(range(len(SCHEMES)), SCHEMES)
        axes.set(title=f"{precision} (promised: {PROMISED[precision]:g})", xlabel="largest extinction × length")
    figure.colorbar(shown, ax=panels, label="largest abs error (cells: log10)")
    return figure


@STUDY.part("Pre-integration tables")
def tables(folder: Path, quick: bool) -> str:
    """Largest error of every generator over optical depth, table size, transfer function and precision."""
    depths = (1e-12, 1e-2, 1.0, 1e6) if quick else DEPTHS
    rows = sweep(depths, (2, 16) if quick else SIZES, 3 if quick else 6)
    summary = summarize(rows)
    write_rows(folder, "tables", "Pre-integration tables under stress", summary)
    save_figure(heat_map(rows, depths), folder / "tables")
    kept = [row for row in summary if row["scheme"] not in BASELINES]
    broken = [
        row for row in kept if any(row[count] for count in COUNTS) or row["max error"] > PROMISED[row["precision"]]
    ]
    if broken:
        raise AssertionError(f"promises broken: {broken}")
    return (
        f"{sum(row['tables'] for row in summary)} tables, no entry that no segment can have; "
        + "; ".join(
            f"in {precision} at most {max(r['max error'] for r in kept if r['precision'] == precision):.1e} off "
            f"(promised: {promised:g})"
            for precision, promised in PROMISED.items()
        )
        + "."
    )
