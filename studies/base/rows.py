"""What the studies share: how results are written, and timing."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from statistics import median
from typing import Any

from rich.console import Console
from rich.table import Table

from wvr.files import write_text

from .harness import machine, write_json

Rows = Sequence[Mapping[str, Any]]


def write_rows(folder: Path, name: str, title: str, rows: Rows) -> None:
    """Print a table and write it as ``name.csv`` and, with the machine, ``name.json``."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = Table(*columns, title=title)
    for row in rows:
        table.add_row(*(text(row.get(column)) for column in columns))
    console = Console()
    (console if console.is_terminal else Console(width=200)).print(table)
    lines = StringIO(newline="")
    writer = csv.DictWriter(lines, columns)
    writer.writeheader()
    writer.writerows(rows)
    write_text(folder / f"{name}.csv", lines.getvalue())
    write_json(folder / f"{name}.json", {"title": title, "machine": machine(), "rows": [dict(row) for row in rows]})


def text(value: Any) -> str:
    """A cell of a table."""
    return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


def spread(values: Sequence[float]) -> str:
    """From the smallest to the largest."""
    return f"{min(values):.2g} to {max(values):.2g}"


def seconds(work: Callable[[], object], rounds: int = 5) -> float:
    """Median seconds of the processor, of all threads together, that ``work`` takes after one uncounted run."""
    work()
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return median(times)
