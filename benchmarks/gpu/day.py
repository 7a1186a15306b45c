"""A run that ends in time: parts with a share of the time each, and a record that is whole whenever it is cut off."""

from __future__ import annotations

import multiprocessing
import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer
from time import perf_counter
from typing import Any, NamedTuple

import warp as wp
from rich.console import Console

from studies.base.harness import machine, write_json
from studies.base.rows import text
from wvr.files import write_text

Row = dict[str, Any]
# Work by name: each makes a row, and is done one after the other.
Work = Iterator[tuple[str, Callable[[], Row]]]

FAILED, SKIPPED = "failed", "skipped"
# Of the time, what is left for a part that takes longer than it may.
LAST = 0.06


class Part(NamedTuple):
    """What is done, in a ``share`` of the time."""

    title: str
    share: float
    work: Callable[[Day], Work]


@dataclass
class Day:
    """What is measured on a device, and the record of it.

    Attributes
    ----------
    until
        When the part that is at work has to be done [seconds of ``perf_counter``].
    rows
        By the title of a part.
    """

    device: wp.Device
    seconds: float
    out: Path
    quick: bool = False
    console: Console = field(default_factory=lambda: Console(width=200))
    rows: dict[str, list[Row]] = field(default_factory=dict)
    start: float = field(default_factory=perf_counter)
    until: float = 0.0

    @property
    def left(self) -> float:
        """Seconds that the part at work still has, 0 or more."""
        return max(0.0, self.until - perf_counter())

    @property
    def failures(self) -> list[str]:
        """What failed, with the names of part and row."""
        rows = [(title, row) for title, part in self.rows.items() for row in part]
        return [f"{title}, {row['name']}: {row[FAILED]}" for title, row in rows if FAILED in row]

    @property
    def path(self) -> Path:
        """Of the record, without its suffix: named by the device."""
        return self.out / f"gpu-{re.sub('[^a-z0-9]+', '-', self.device.name.lower()).strip('-')}"

    def run(self, parts: Sequence[Part]) -> int:
        """Do all parts, each until its share of the time is over, and write the record after each row.

        Returns
        -------
        int
            How many rows failed. What there was no time for is skipped, and says so.
        """
        # Whatever hangs: nothing else ends a kernel that does not end.
        end = Timer(self.seconds, self._abandon)
        end.daemon = True
        end.start()
        share = 0.0
        try:
            for part in parts:
                share += part.share
                self.until = self.start + (1 - LAST) * share * self.seconds
                self._part(part)
        finally:
            end.cancel()
        self.write()
        return len(self.failures)

    def _part(self, part: Part) -> None:
        rows = self.rows.setdefault(part.title, [])
        try:
            for name, work in part.work(self):
                rows.append(row := {"name": name})
                if self.left == 0:
                    row[SKIPPED] = "no time left"
                else:
                    row[FAILED] = "did not end"
                    self.write()
                    row |= self._done(work)
                    if row[FAILED] is None:
                        del row[FAILED]
                self._say(part.title, row)
        except Exception as error:  # while it gets ready
            rows.append({"name": "all", FAILED: repr(error)})
            self._say(part.title, rows[-1])
        self.write()

    @staticmethod
    def _done(work: Callable[[], Row]) -> Row:
        try:
            return {FAILED: None} | work()
        except Exception as error:  # of whatever kind: the next one is tried
            return {FAILED: repr(error)}

    def _say(self, title: str, row: Row) -> None:
        said = ", ".join(f"{key} {text(value)}" for key, value in row.items() if key != "name")
        spent = perf_counter() - self.start
        self.console.print(f"{spent:5.0f} s  {title}, {row['name']}: {said}", highlight=False, markup=False)

    def _abandon(self) -> None:
        self.write()
        self.console.print(f"ended after {self.seconds:.0f} s; {self.path}.json has what there is")
        for process in multiprocessing.active_children():
            process.kill()
        os._exit(1)

    def write(self) -> None:
        """The record, as JSON and as a page."""
        spent = perf_counter() - self.start
        where = machine()
        record = {"device": self.device.name, "seconds": spent, "machine": where, "parts": self.rows}
        self.out.mkdir(parents=True, exist_ok=True)
        write_json(self.path.with_suffix(".json"), record)
        write_text(self.path.with_suffix(".md"), page(self.device.name, spent, where, self.rows, self.failures))


def page(device: str, spent: float, where: dict[str, Any], rows: dict[str, list[Row]], failures: Sequence[str]) -> str:
    """The record, to be read."""
    lines = [f"# {device}", "", f"{spent:.0f} seconds. " + (f"{len(failures)} failed:" if failures else "None failed.")]
    lines += ["", *(f"- {failure}" for failure in failures), *([""] if failures else [])]
    for title, part in rows.items():
        columns = list(dict.fromkeys(key for row in part for key in row))
        lines += [f"## {title}", "", " | ".join(["", *columns, ""]).strip()]
        lines += ["| --- " + "| ---: " * (len(columns) - 1) + "|"]
        lines += ["| " + " | ".join(text(row.get(column)) for column in columns) + " |" for row in part]
        lines += [""]
    return "\n".join([*lines, "## Machine", "", *(f"- {name}: {value}" for name, value in where.items()), ""])
