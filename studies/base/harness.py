"""Fair timing: contenders take turns, so that a busy machine slows them alike; medians; what the machine is; output.

A contender is a function that does its work once and returns how long that took, as :func:`timed` makes it. One that
works in another process measures there.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from io import BytesIO
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import warp as wp
from cycler import cycler
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from PIL import Image as PillowImage
from rich.table import Table

import wvr
from wvr.files import whole_file, write_text
from wvr.launch import get_device

ROOT = Path(__file__).parents[2]
# All that results depend on, but for those that are recorded there.
SOURCES = ("wvr", "kernels", "studies", "benchmarks")
RESULTS = Path("benchmarks/results")
# How a commit ends whose sources are not as committed.
DIRTY = "-dirty"
PACKAGES = ("numpy", "scipy", "warp-lang", "vtk", "pyvista", "wvr")
# Bytes of a picture that is made smaller.
LARGE = 1 << 18
# Okabe and Ito's colours, which colour-blind readers can tell apart.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000", "#F0E442")
# One style for all charts, for ``matplotlib.rc_context``. Their background is white whatever the page's, so that they
# can be read on a dark one.
STYLE = {
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=COLORS),
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "grid.color": "0.9",
    "image.cmap": "magma",
    "legend.frameon": False,
    "savefig.dpi": 150,
    "svg.hashsalt": "wvr",
}


@dataclass(frozen=True)
class Settings:
    """What the command line asks of every entry."""

    rounds: int = 5
    quick: bool = False
    out: Path = Path("out/benchmarks")

    @property
    def pixels(self) -> int:
        """Pixels that errors are taken over."""
        return 50 if self.quick else 1000


class Time(NamedTuple):
    """Seconds by the clock, and of all threads of the process."""

    wall: float
    cpu: float


Contender = Callable[[], Time]


@dataclass(frozen=True)
class Row:
    """One contender in one group; contenders of a group took turns."""

    group: str
    name: str
    rounds: int
    wall: float  # median seconds
    fastest: float
    slowest: float
    cpu: float  # median seconds
    ratio: float  # median wall seconds relative to the baseline's
    extra: dict[str, float | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """All that an entry measured, and where."""

    entry: str
    title: str
    baseline: str
    rows: list[Row]
    notes: list[str]
    machine: dict[str, Any]


def integrator_name(integrator: wvr.Riemann | wvr.Preintegrated | wvr.Certified) -> str:
    """As in code, without what is left at its default."""
    number = f"{integrator.tolerance:.3g}" if isinstance(integrator, wvr.Certified) else str(integrator.step)
    return f"{type(integrator).__name__}({number})"


def timed(work: Callable[[], object]) -> Contender:
    """``work`` as a contender of this process."""

    def run() -> Time:
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        return Time(time.perf_counter() - wall, time.process_time() - cpu)

    return run


def interleave(
    contenders: Mapping[str, Contender], rounds: int, every: Mapping[str, int] | None = None
) -> dict[str, list[Time]]:
    """Times of all contenders, which take turns in each round, after one uncounted round to warm up.

    ``every`` lets slow contenders run in every n-th round only.
    """
    for run in contenders.values():
        run()
    times: dict[str, list[Time]] = {name: [] for name in contenders}
    for i in range(rounds):
        for name, run in contenders.items():
            if i % (every or {}).get(name, 1) == 0:
                times[name].append(run())
    return times


def summarize(
    group: str,
    times: Mapping[str, list[Time]],
    baseline: str,
    extra: Callable[[str, float], dict[str, float | None]] = lambda name, wall: {},
) -> list[Row]:
    """A row for each contender; ``extra(name, median wall seconds)`` gives its further columns."""
    reference = median(t.wall for t in times[baseline])
    rows = []
    for name, runs in times.items():
        walls = [t.wall for t in runs]
        wall, cpu = median(walls), median(t.cpu for t in runs)
        rows.append(Row(group, name, len(runs), wall, min(walls), max(walls), cpu, wall / reference, extra(name, wall)))
    return rows


def processor_ratios(times: Mapping[str, list[Time]], other: str) -> dict[str, float]:
    """Processor seconds in parts of those of another contender, by name; none where that did not run."""
    if other not in times:
        return {}
    theirs = median(time.cpu for time in times[other])
    return {name: median(time.cpu for time in runs) / theirs for name, runs in times.items()}


# --- The machine ----------------------------------------------------------------------------------------------------


def machine() -> dict[str, Any]:
    """What the numbers depend on besides the code."""
    get_device("cpu")  # starts Warp, which then knows its devices
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "cpu": _cpu(),
        "cores": wvr.get_num_threads(),
        "memory_gib": _memory(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "os": platform.platform(),
        "devices": {device.alias: device.name for device in wp.get_devices()},
        "python": platform.python_version(),
        **{package: _version(package) for package in PACKAGES},
        "commit": _commit(),
    }


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _memory() -> float | None:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30, 1)
    except (AttributeError, ValueError, OSError):
        return None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _commit() -> str | None:
    """The commit, with ``-dirty`` where any source of the results is not as committed."""

    def git(*command: str) -> str:
        command = ("git", "-C", str(ROOT), *command)
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        commit = git("describe", "--always")
        return commit + DIRTY * bool(git("status", "--porcelain", "--", *SOURCES, f":!{RESULTS.as_posix()}"))
    except (OSError, subprocess.CalledProcessError):
        return None


# --- Files ----------------------------------------------------------------------------------------------------------


def write_json(path: Path, value: Any) -> None:
    """``value`` as a JSON file that appears whole or not at all."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def save(result: Result, path: Path) -> None:
    """``result`` as a JSON file."""
    write_json(path, asdict(result))


def load(path: Path) -> Result:
    """What :func:`save` wrote."""
    fields = json.loads(path.read_text(encoding="utf-8"))
    return Result(**{**fields, "rows": [Row(**row) for row in fields["rows"]]})


# --- Tables and charts ----------------------------------------------------------------------------------------------


def cells(result: Result) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the table, as text."""
    extras = list(dict.fromkeys(name for row in result.rows for name in row.extra))
    header = ["group", "contender", "runs", "wall [s]", "min–max [s]", "CPU [s]", f"× {result.baseline}", *extras]
    return header, [
        [
            row.group,
            row.name,
            str(row.rounds),
            _number(row.wall),
            f"{_number(row.fastest)}–{_number(row.slowest)}",
            _number(row.cpu),
            _number(row.ratio),
            *(_number(row.extra.get(name)) for name in extras),
        ]
        for row in result.rows
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def rich_table(result: Result) -> Table:
    """The table for a terminal; a rule between groups."""
    header, rows = cells(result)
    table = Table(title=result.title)
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i < 2 else "right")
    for row, following in zip(rows, [*rows[1:], None], strict=True):
        table.add_row(*row, end_section=following is None or following[0] != row[0])
    return table


def markdown(result: Result) -> str:
    """The table, the notes and the machine."""
    header, rows = cells(result)
    lines = [header, ["---"] * 2 + ["---:"] * (len(header) - 2), *rows]
    facts = [f"- {name}: {value}" for name, value in result.machine.items()]
    return "\n".join(
        [
            f"# {result.title}",
            "",
            *("| " + " | ".join(line) + " |" for line in lines),
            "",
            *(f"- {note}" for note in result.notes),
            "",
            "## Machine",
            "",
            *facts,
            "",
        ]
    )


def bars(result: Result, value: Callable[[Row], tuple[float, float, float]], label: str) -> Figure:
    """A horizontal bar for each row, grouped; ``value(row)`` is its median and the ends of its range.

    A single group has its contenders' names at the axis instead of a legend.
    """
    groups = list(dict.fromkeys(row.group for row in result.rows))
    names = list(dict.fromkeys(row.name for row in result.rows))
    figure = Figure(figsize=(7, 1.2 + 0.24 * len(result.rows) + 0.3 * len(groups)))
    axes = figure.subplots()
    middles, y = [], 0.0
    for group in groups:
        rows = [row for row in result.rows if row.group == group]
        middles.append(y + (len(rows) - 1) / 2)
        for row in rows:
            middle, low, high = value(row)
            i = names.index(row.name)
            whisker = [[middle - low], [high - middle]]
            handle = axes.barh(y, middle, 0.9, xerr=whisker, color=COLORS[i % len(COLORS)], ecolor="0.3", capsize=2)
            handle.set_label(row.name if not any(h == row.name for h in axes.get_legend_handles_labels()[1]) else "_")
            y += 1
        y += 0.7
    if len(groups) > 1:
        axes.set_yticks(middles, groups)
        figure.legend(loc="outside upper center", ncols=3, fontsize="small")
    else:
        axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel(label)
    axes.grid(axis="x")
    return figure


def errors_against_time(result: Result) -> Figure:
    """A panel for each group: largest (filled) and mean error over seconds a frame, both logarithmic."""
    groups = list(dict.fromkeys(row.group for row in result.rows))
    names = list(dict.fromkeys(row.name for row in result.rows))
    columns = min(2, len(groups))
    shape = -(-len(groups) // columns), columns
    figure = Figure(figsize=(7, 0.8 + 2.2 * shape[0]))
    panels = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False)
    for axes, group in zip(panels.flat, groups, strict=False):
        for row in result.rows:
            if row.group != group:
                continue
            i = names.index(row.name)
            # Seven markers and eight colours: no two of 56 look alike.
            style = {"color": COLORS[i % len(COLORS)], "marker": "osD^vP*"[i % 7], "linestyle": ""}
            axes.plot(row.wall, row.extra["max error"], label=row.name, **style)
            axes.plot(row.wall, row.extra["mean error"], fillstyle="none", **style)
        axes.set(xscale="log", yscale="log", title=group)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid()
    for axes in panels.flat[len(groups) :]:
        axes.set_visible(False)
    figure.supxlabel("Time a frame, wall clock [s]")
    figure.supylabel("Absolute error of premultiplied RGBA (filled: max, open: mean)", fontsize="medium")
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize="small")
    return figure


def save_figure(figure: Figure, stem: Path) -> None:
    """``figure`` as PNG and SVG files."""
    png = BytesIO()
    figure.savefig(png, format="png")
    with whole_file(stem.with_name(f"{stem.name}.png")) as file:
        file.write(smaller(png.getvalue()))
    figure.set_layout_engine("none")  # laid out it is
    with whole_file(stem.with_name(f"{stem.name}.svg")) as file:
        figure.savefig(file, format="svg", metadata={"Date": None})


def smaller(png: bytes) -> bytes:
    """The same PNG file or, of a large one, one with 256 colours, dithered: a quarter as large, and no eye sees it."""
    if len(png) <= LARGE:
        return png
    with PillowImage.open(BytesIO(png)) as image:
        few = image.convert("RGB").quantize(256, PillowImage.Quantize.MEDIANCUT)
    made = BytesIO()
    few.save(made, "PNG", optimize=True)
    return made.getvalue()
