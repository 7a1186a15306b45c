"""The command line of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from wvr.launch import get_device

from . import frames, limits, papers, parity
from .day import Day, Part

PARTS = (
    Part("Copies and memory", 0.12, limits.work),
    Part("Parity", 0.5, parity.work),
    Part("Frames", 0.22, frames.generated),
    Part("Frames of the papers' volumes", 0.08, frames.papers),
    Part("Campagnolo et al. 2015", 0.05, papers.campagnolo),
    Part("Lum et al. 2004, Table 1", 0.03, papers.lum),
)


def run(
    *,
    device: str = "cuda:0",
    minutes: Annotated[float, Parameter(validator=Number(gt=0))] = 8.0,
    quick: bool = False,
    out: Path = Path("out/benchmarks"),
) -> int:
    """All that is to be known of a GPU: parity with the CPU, frames beside VTK's, limits, and the papers' tables.

    Writes gpu-NAME.json and gpu-NAME.md as it goes. The exit code is 1 where anything failed, a bound is broken or an
    image is not that of the CPU.

    Parameters
    ----------
    device
        CUDA device; "cpu" rehearses, with rays cast as a GPU would.
    minutes
        Time after which it has ended; what there was no time for is said.
    quick
        Small scenes and few of them.
    out
        Folder for the record.
    """
    day = Day(get_device(device), 60 * minutes, out, quick)
    failed = day.run(PARTS)
    for failure in day.failures:
        day.console.print(f"failed: {failure}", highlight=False, markup=False)
    day.console.print(f"{failed} failed; {day.path}.md", highlight=False)
    return int(failed > 0)
