"""Runs studies, part by part, and keeps what is done: ``out/STUDY/PART/`` with all results of a part and ``part.json``.

A part's folder appears whole or not at all. It is kept on resuming if it was made by the same code on the same machine
with the same packages, threads and size. A part that fails is reported and does not stop the others.
"""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from . import report
from .base.harness import DIRTY, PACKAGES, RESULTS, ROOT, SOURCES, STYLE, machine, write_json
from .base.study import Part, Study

NAMES = (
    "frontier",
    "lum2004",
    "lighting",
    "roettger2003",
    "clipping",
    "campagnolo2015",
    "angelelli2017",
    "stability",
    "enclosure",
    "hunt",
    "faults",
    "cuda",
    "gallery",
)
RECORDED = ROOT / "docs/results"
RECORD = "part.json"
# What every record has.
KEYS = {"quick", "command", "machine", "seconds", "files"}

log = logging.getLogger("wvr")


def find(names: Iterable[str] = NAMES) -> list[Study]:
    """Studies by name; one part of a study by ``NAME/PART``.

    Raises
    ------
    ValueError
        For a name that is none.
    """
    names = list(names)
    if unknown := [name for name in names if name.partition("/")[0] not in NAMES]:
        raise ValueError(f"studies are {', '.join(NAMES)}, got {', '.join(unknown)}")
    found = []
    for name in names:
        study, _, part = name.partition("/")
        found.append(import_module(f"{__package__}.{study}").STUDY)
        if part:
            found[-1] = found[-1].only(part)
    return found


def run(studies: Sequence[Study], out: Path, quick: bool = False, resume: bool = False) -> list[str]:
    """Run studies, then write the report of all that is in ``out``.

    Parameters
    ----------
    studies
        Of :func:`find`.
    out
        Folder of the results and of ``report.html``.
    quick
        Small scenes and generated volumes only.
    resume
        Keep parts that were finished by the same code.

    Returns
    -------
    list of str
        The parts that failed, with the reason.

    Raises
    ------
    OSError
        Where another run writes into the folder.
    """
    with _alone(out):
        return _run_alone(studies, out, quick, resume)


def _run_alone(studies: Sequence[Study], out: Path, quick: bool, resume: bool) -> list[str]:
    facts = machine()
    identity = _identity(facts, quick)
    todo = [(study, part) for study in studies for part in study.parts.values()]
    expected = [_seconds(out / study.name / part.name) for study, part in todo]
    known = [seconds for seconds in expected if seconds]
    typical = sum(known) / len(known) if known else 1.0
    failed: list[str] = []
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn() if not known else TextColumn("{task.percentage:.0f}%"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console()
    try:
        with Progress(*columns, console=console if console.is_terminal else Console(width=160)) as progress:
            task = progress.add_task("", total=sum(seconds or typical for seconds in expected))
            for (study, part), seconds in zip(todo, expected, strict=True):
                progress.update(task, description=f"{study.name}: {part.title}")
                folder = out / study.name / part.name
                if not (resume and _done(folder, identity)):
                    record = {"quick": quick, "command": _command(study, quick), "machine": facts}
                    if error := _run(part, folder, quick, record, identity):
                        failed.append(f"{study.name}, {part.title}: {error}")
                progress.advance(task, seconds or typical)
    finally:
        report.write(out, records(out))
    return failed


def records(out: Path) -> list[tuple[Study, dict[str, dict[str, Any]]]]:
    """Of all studies: the records of their parts by name, empty where a part was not run."""
    return [(study, {part: _read(out / study.name / part) for part in study.parts}) for study in find()]


def record(out: Path) -> Path:
    """Copy results that are whole, and of committed code, and a page of them, to where the documentation shows them.

    Raises
    ------
    ValueError
        Where results are of code that nobody else has; nothing is copied then.
    """
    whole = [
        (study, {p: r for p, r in parts.items() if "identity" in r and not r["quick"]}) for study, parts in records(out)
    ]
    if unknown := [f"{study.name}, {part}" for study, parts in whole for part, r in parts.items() if not committed(r)]:
        raise ValueError(
            f"results of code that is not committed are not recorded: commit, and run {'; '.join(unknown)}"
        )
    for study, parts in whole:
        for part, found in parts.items():
            folder = RECORDED / study.name / part
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            for name in (RECORD, *found["files"]):
                if Path(name).suffix in (".csv", ".png") or name == RECORD:
                    shutil.copy(out / study.name / part / name, folder)
    return report.write_page(RECORDED, records(RECORDED))


def committed(record: dict[str, Any]) -> bool:
    """Whether a record is of the code of a commit, as far as it says."""
    commit = record["machine"]["commit"]
    return commit is not None and not commit.endswith(DIRTY)


def _run(part: Part, folder: Path, quick: bool, record: dict[str, Any], identity: str) -> str | None:
    """Do the work of a part in a folder that then takes the place of an earlier one; why it failed, if it did."""
    working = folder.with_name(f".{folder.name}")
    shutil.rmtree(working, ignore_errors=True)
    working.mkdir(parents=True)
    start, error = time.perf_counter(), None
    try:
        with rc_context(STYLE):
            record["finding"] = part.work(working, quick)
        record["identity"] = identity
    except Exception as reason:
        traceback.print_exc()
        record["error"] = error = f"{type(reason).__name__}: {reason}"
    record["seconds"] = time.perf_counter() - start
    # In the order in which they were made.
    record["files"] = [path.name for path in sorted(working.iterdir(), key=lambda path: path.stat().st_mtime_ns)]
    write_json(working / RECORD, record)
    shutil.rmtree(folder, ignore_errors=True)
    working.rename(folder)
    return error


def _read(folder: Path) -> dict[str, Any]:
    """The record of a part; empty where there is none, or one that is damaged and counts as none."""
    path = folder / RECORD
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        log.warning("%s is damaged, its part counts as not done: %s", path, error)
        return {}
    if not isinstance(found, dict) or not found.keys() >= KEYS:
        log.warning("%s is damaged, its part counts as not done: no record with %s", path, ", ".join(sorted(KEYS)))
        return {}
    return found


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """No other run writes into the same folder, where the system knows locks; a killed one lets go of its."""
    out.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (out / ".lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OSError(f"{out} is in use by another run: wait for its end, or give another folder") from None
        yield


def _done(folder: Path, identity: str) -> bool:
    """Whether a part was finished by the same code, and all that it made is there."""
    found = _read(folder)
    return found.get("identity") == identity and all((folder / name).exists() for name in found["files"])


def _seconds(folder: Path) -> float | None:
    """How long a part took last."""
    return _read(folder).get("seconds")


def _identity(facts: dict[str, Any], quick: bool) -> str:
    """Of all that results depend on: the code itself rather than its commit, which knows nothing of local changes."""
    code = hashlib.sha256()
    for path in sorted(
        path
        for name in SOURCES
        for path in (ROOT / name).rglob("*")
        if path.suffix in (".py", ".json") and ROOT / RESULTS not in path.parents
    ):
        code.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    rest = {name: facts[name] for name in ("cpu", "cores", "devices", "python", *PACKAGES)}
    return hashlib.sha256(json.dumps([code.hexdigest(), rest, quick]).encode()).hexdigest()


def _command(study: Study, quick: bool) -> str:
    return f"wvr study {study.asked}{' --quick' if quick else ''}"
