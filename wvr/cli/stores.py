"""Volumes that stay in a store: how ``wvr render`` reads them, and ``wvr ranges``."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from .stages import Stages

if TYPE_CHECKING:
    from ..bricks.stored import StoredVolume
    from ..volume import Volume
    from .source import Input

Workers = Annotated[int | None, Parameter(validator=Number(gte=1))]
Level = Annotated[int | None, Parameter(validator=Number(gte=0))]


@Parameter(name="*")
@dataclass(frozen=True)
class Streaming:
    """How a store (zarr, OME-Zarr) is read; any other source is with --memory-limit or --workers, too.

    Attributes
    ----------
    memory_limit
        Bytes of samples at a time, such as 2GiB; by default a quarter of what is free.
    workers
        Processes of a Dask cluster on this machine that render.
    scheduler
        Address of a Dask cluster that renders, tcp://...
    budget
        Seconds, or bytes such as 200MB, after which nothing more is read: what was not is in the bound.
    missing
        What cannot be read is an error, or in the bound.
    level
        Of a pyramid, 0 is the finest.
    select
        AXIS:INDEX of axes that are not x, y or z: t:0, c:1. May be given several times.
    """

    memory_limit: str | None = None
    workers: Workers = None
    scheduler: str | None = None
    budget: str | None = None
    missing: Literal["error", "bound"] = "error"
    level: Level = None
    select: Annotated[tuple[str, ...], Parameter(negative="")] = ()

    def load(self, source: str, nan: Literal["error", "transparent"], reading: Input) -> StoredVolume | None:
        """The volume of a store; None where the source is another that is read as a whole."""
        from ..bricks.open import HDF5
        from ..bricks.open import open as open_volume
        from ..sources import ZARR

        store = "://" in source or any((Path(source) / name).exists() for name in ZARR)
        suffixes = (*HDF5, ".npy", ".nii")
        mapped = Path(source).is_file() and Path(source).suffix.lower() in suffixes
        if not store and not (mapped and self != Streaming()):
            if self.level is not None or self.select or self.budget is not None or self.missing == "bound":
                raise ValueError(f"--level, --select, --budget and --missing are for stores (zarr), {source!r} is none")
            return None
        selection: Any = dict(map(_selected, self.select))
        try:
            return open_volume(source, self.level, nan=nan, **reading.of_store(source), **selection)
        except ValueError as error:
            raise ValueError(re.sub(r"wvr\.open\(\.\.\., (\w+)=0\)", r"--select \1:0", str(error))) from None

    def options(self, client: Any) -> dict[str, Any]:
        """Those of ``wvr.render``."""
        budget: Any = self.budget
        if budget is not None:
            with suppress(ValueError):
                budget = float(budget)
        options = {"memory_limit": self.memory_limit, "budget": budget, "missing": self.missing, "client": client}
        defaults = {"memory_limit": None, "budget": None, "missing": "error", "client": None}
        return {name: value for name, value in options.items() if value != defaults[name]}

    @contextmanager
    def client(self) -> Iterator[Any]:
        """A client of the cluster that renders; None where there is none."""
        with clients(self.workers, self.scheduler) as client:
            yield client


def whole(
    source: str,
    level: int | None,
    select: tuple[str, ...],
    nan: Literal["error", "transparent"],
    reading: Input,
    stage: Stages,
) -> Volume:
    """All samples of a source in memory, those of a store included."""
    stored = Streaming(level=level, select=select).load(source, nan, reading)
    if stored is None:
        return reading.load(source, nan, stage)
    stage(f"reading {source}")
    return stored.loaded()


@contextmanager
def clients(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Of a cluster of so many processes on this machine, which ends with it, or at an address; None of neither."""
    from ..io.bytes import needs

    if workers is None and scheduler is None:
        yield None
        return
    if workers is not None and scheduler is not None:
        raise ValueError("give --workers or --scheduler, not both")
    with needs("distributed", "Dask clusters", "distributed"):
        from distributed import Client, LocalCluster
    if scheduler is not None:
        with Client(scheduler, timeout="10 s") as client:
            yield client
        return
    # A port that is free; what workers have to say comes as errors.
    quiet = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    local = LocalCluster(n_workers=workers, threads_per_worker=1, **quiet)
    with local as cluster, Client(cluster) as client:
        yield client


def _selected(text: str) -> tuple[str, int]:
    name, colon, index = text.partition(":")
    if not (name and colon and index.lstrip("-").isdigit()):
        raise ValueError(f"--select must be AXIS:INDEX, such as t:0, got {text!r}")
    return name, int(index)


def ranges(
    source: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    level: Level = None,
    select: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    nan: Literal["error", "transparent"] = "error",
    workers: Workers = None,
    scheduler: str | None = None,
) -> None:
    """Find out the smallest and largest sample of each block of a store, once, so that what cannot be seen is not read.

    What is done is kept: called again, it goes on, and does anew what changed.

    Parameters
    ----------
    source
        A zarr or OME-Zarr store, HDF5, .npy or .nii file.
    output
        The file; by default beside the store, where "wvr render" finds it.
    level
        Of a pyramid, 0 is the finest.
    select
        AXIS:INDEX of axes that are not x, y or z: t:0, c:1. May be given several times.
    nan
        NaN and infinite samples are an error, or transparent.
    workers
        Processes of a Dask cluster on this machine that read.
    scheduler
        Address of a Dask cluster that reads, tcp://...
    """
    from rich.console import Console
    from rich.progress import Progress

    from ..bricks.open import build_ranges
    from ..bricks.open import open as open_volume

    with Stages() as stage:
        stage(f"opening {source}")
        selection: Any = dict(map(_selected, select))
        volume = open_volume(source, level, nan=nan, **selection)
    if volume.place is None and output is None:
        raise ValueError(f"--output must be given, as {source!r} is not a place to write to")
    console = Console(stderr=True)
    shown = Progress(console=console, transient=True, disable=not console.is_terminal)
    with clients(workers, scheduler) as client, shown as progress:
        task = progress.add_task("reading blocks", total=None)
        build_ranges(
            volume, output, client=client, report=lambda done, all: progress.update(task, completed=done, total=all)
        )
    assert volume.ranges is not None
    low, high = volume.ranges.limits()
    print(f"{output or volume.place}: {volume.ranges.known.size} blocks, samples from {low:g} to {high:g}")
