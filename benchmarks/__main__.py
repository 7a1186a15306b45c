"""``python -m benchmarks``: measure, show the tables, and write them with the charts."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from types import ModuleType
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number
from matplotlib import rc_context
from rich.console import Console

from studies.base.harness import RESULTS, ROOT, STYLE, Settings, markdown, rich_table, save, save_figure
from wvr.files import write_text

from . import certified, clipping, cold, kernels, lit, peers, projections, throughput, viewer
from .gpu import command as gpu

ENTRIES: dict[str, ModuleType] = {
    "throughput": throughput,
    "certified": certified,
    "clipping": clipping,
    "peers": peers,
    "cold": cold,
    "projections": projections,
    "lit": lit,
    "viewer": viewer,
}
# Of all charts, the one that reports show.
RECORDED_CHART = "peers.png"

app = App(name="benchmarks", help_format="plaintext")
app.command(gpu.run, name="gpu")
app.command(kernels.run, name="kernels")


@app.default
def run(
    *names: str,
    rounds: Annotated[int, Parameter(validator=Number(gte=1))] = 5,
    quick: bool = False,
    out: Path = Path("out/benchmarks"),
    record: str | None = None,
) -> None:
    """Measure wvr's speed and accuracy.

    Parameters
    ----------
    names
        What to measure: throughput, certified, clipping, peers, cold, projections, viewer; all by default.
    rounds
        How often each contender runs.
    quick
        Small scenes, to try the benchmarks themselves.
    out
        Folder for tables (JSON, Markdown), charts (PNG, SVG) and the reference's pixels, which are kept.
    record
        Also copy the tables and the chart of the peers to the folder of this name in benchmarks/results.
    """
    if unknown := sorted(set(names) - set(ENTRIES)):
        raise ValueError(f"names must be of {', '.join(ENTRIES)}, got {', '.join(unknown)}")
    settings = Settings(rounds, quick, out)
    out.mkdir(parents=True, exist_ok=True)
    console = Console()
    if not console.is_terminal:
        console.width = 160
    for name in names or ENTRIES:
        entry = ENTRIES[name]
        with console.status(f"measuring {name}"):
            result = entry.measure(settings)
        console.print(rich_table(result))
        for note in result.notes:
            console.print(f"- {note}", highlight=False, markup=False)
        save(result, out / f"{name}.json")
        write_text(out / f"{name}.md", markdown(result))
        files = [out / f"{name}.json", out / f"{name}.md"]
        with rc_context(STYLE):
            for stem, figure in entry.charts(result).items():
                save_figure(figure, out / stem)
                files.append(out / f"{stem}.png")
        if record is not None:
            folder = ROOT / RESULTS / record
            folder.mkdir(parents=True, exist_ok=True)
            for file in files:
                if file.suffix != ".png" or file.name == RECORDED_CHART:
                    shutil.copy(file, folder)


if __name__ == "__main__":
    try:
        app()
    except ValueError as error:
        sys.exit(str(error))
