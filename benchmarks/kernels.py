"""``python -m benchmarks kernels``: what a GPU's thread needs for each kernel, and what it executes of it, beside what
that was when it was recorded.

No GPU is asked. ``pip install nvidia-cuda-nvcc`` brings the assembler, which knows of registers; what is executed, a C
compiler of this machine runs.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import wvr
from studies.base import cuda, ptx
from studies.base.harness import RESULTS, ROOT
from studies.base.rows import text, write_rows
from studies.base.scenes import make_scene
from studies.cuda import rows_of

from .scenes import make_scenes

# What each column may grow by before it counts: in parts of itself, and by as much.
GROWTH = {
    "instructions": (0.05, 20.0),
    "float64 [%]": (0.0, 1.0),
    "registers": (0.0, 4.0),
    "stack [bytes]": (0.05, 16.0),
    "spills [bytes]": (0.05, 16.0),
}
CERTIFIED = "Certified(1/512)"
INTEGRATORS = {
    CERTIFIED: wvr.Certified(1 / 512),
    "Riemann(0.5)": wvr.Riemann(0.5),
    "Preintegrated(1)": wvr.Preintegrated(1.0),
}
JUMPS = wvr.TransferFunction(
    [
        (0, "black", 0.0),
        (120, "navy", 0.0),
        (120, "teal", 0.02),
        (200, "gold", 0.05),
        (200, "white", 0.2),
        (255, "white", 0.3),
    ]
)
# Pixels along a side of images whose instructions are counted.
PIXELS = 64

Row = dict[str, Any]


def run(*names: str, record: bool = False, out: Path = Path("out/benchmarks")) -> int:
    """Instructions, the share of float64, registers, stack and spills of all kernels; the exit code is 1 if any grew.

    Then what is executed: rays of S1 to S3 and Bonsai are cast by the code for CUDA, on the CPU, and counted.

    Parameters
    ----------
    names
        Scenes whose kernels are asked for (``studies.base.cuda.scenes``), by default all; with names nothing is run.
    record
        Make what is found the record that others are compared with.
    out
        Folder for the tables.
    """
    console = Console(width=160)
    folder = ROOT / RESULTS if record else out
    folder.mkdir(parents=True, exist_ok=True)
    grown = []
    tables = {"kernels": (f"Kernels for sm_{cuda.ARCH}", rows_of(cuda.kernels(list(names) or None)))}
    if not names:
        tables["executed"] = f"Executed for a pixel, of code for sm_{cuda.ARCH}", list(executed())
    for name, (title, rows) in tables.items():
        write_rows(folder, name, title, rows)
        grown += regressions(recorded(name), rows)
    table = Table("kernel", "column", "recorded", "now", title="What grew")
    for row in grown:
        table.add_row(*map(text, row))
    console.print(table if grown else "Nothing grew.")
    return int(bool(grown))


def executed() -> Iterator[Row]:
    """Of each integrator and scene: the image by CUDA's code beside the usual one, and what it took for a pixel."""
    if not ptx.has_compiler():
        return
    scenes = [scene for scene in make_scenes() if not scene.camera.parallel]
    sharp = replace(scenes[0], name="S1, two jumps", transfer_function=JUMPS)
    cases = [(scene, name) for name in INTEGRATORS for scene in [*scenes, make_scene("Bonsai", False)]]
    cases.append((sharp, CERTIFIED))
    launches: dict[str, Counter[str]] = {}
    with ptx.cast_by_cuda(launches) as usual:
        for scene, name in cases:
            launches.clear()
            renderer = scene.renderer(INTEGRATORS[name], device="cpu")
            image = renderer.render(scene.camera, (PIXELS, PIXELS))
            with usual():
                reference = renderer.render(scene.camera, (PIXELS, PIXELS))
                exact = scene.renderer(wvr.Exact(), device="cpu").render(scene.camera, (PIXELS, PIXELS))
            total = sum(launches.values(), Counter())
            error = np.abs(image.rgba - exact.rgba).max(axis=-1)
            bounded = image.error_bound is not None
            yield {
                "kernel": f"{scene.name} {name}",
                "off the CPU": float(np.abs(image.rgba - reference.rgba).max()),
                "off exact": float(error.max()),
                "bounds broken": int(np.sum(error > image.error_bound)) if bounded else None,
                "instructions": sum(total.values()) / image.samples.size,
                "float64 [%]": 100 * ptx.float64(total),
            }


def recorded(name: str) -> list[Row]:
    """The rows of a record, none where nothing was recorded."""
    if not (ROOT / RESULTS / f"{name}.csv").exists():
        return []
    with (ROOT / RESULTS / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return [{k: v if k == "kernel" else float(v) for k, v in row.items() if v} for row in csv.DictReader(file)]


def regressions(before: Iterable[Row], now: Iterable[Row]) -> list[tuple[str, str, float, float]]:
    """(kernel, column, recorded, now) of all that grew by more than it may; new kernels and columns are none."""
    known = {row["kernel"]: row for row in before}
    return [
        (row["kernel"], column, known[row["kernel"]][column], row[column])
        for row in now
        for column, (share, least) in GROWTH.items()
        if column in row
        and column in known.get(row["kernel"], {})
        and row[column] > known[row["kernel"]][column] * (1 + share) + least
    ]
