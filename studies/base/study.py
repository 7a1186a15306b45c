"""What a study is: parts, one a table or figure, each with what its paper reported and what follows from our numbers.

A module of ``studies`` is a study if it has a ``STUDY``, which the parts join::

    STUDY = Study("lum2004")

    @STUDY.part("Table 1")
    def table1(folder: Path, quick: bool) -> str:
        \"""Time to build a table.\"""
        write_rows(folder, "table1", "Table 1", rows)
        save_figure(figure, folder / "table1")
        return f"At n = {n} brute force takes {ratio:.0f} times as long."

All that a part writes into its folder is its result: CSV and JSON, charts as SVG and PNG. ``quick`` is small, takes
generated volumes only, and shows that the study works. What a paper reported lies in ``studies/data/NAME.json``:
numbers with the page or table they are from, and under ``"claims"``, by part, where and what, our verdict (one of
``VERDICTS``) and why. The paper's page in docs/ has them in a table.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from inspect import getdoc
from pathlib import Path
from typing import Any

DATA = Path(__file__).parents[1] / "data"
VERDICTS = ("confirmed", "confirmed in kind", "not confirmed", "cannot be tested here")

Work = Callable[[Path, bool], str]


@dataclass(frozen=True)
class Part:
    """A table, a figure or several of one kind: ``work(folder, quick)`` fills the folder and says what follows."""

    name: str
    title: str
    work: Work

    @property
    def what(self) -> str:
        """The first paragraph of its docstring."""
        return " ".join((getdoc(self.work) or "").partition("\n\n")[0].split())


class Study:
    """Parts in the order in which they join.

    Parameters
    ----------
    name
        That of the module, and of the file of the paper's numbers, if there is one.
    title
        By default the citation of the paper.
    """

    def __init__(self, name: str, title: str | None = None):
        path = DATA / f"{name}.json"
        self.name = name
        #: The paper's numbers.
        self.paper: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        self.title = self.paper["paper"] if title is None else title
        self.parts: dict[str, Part] = {}
        #: How the runner is asked for it.
        self.asked = name

    def only(self, part: str) -> Study:
        """With one of its parts alone."""
        if part not in self.parts:
            raise ValueError(f"parts of {self.name} are {', '.join(self.parts)}, got {part}")
        alone = copy(self)
        alone.parts, alone.asked = {part: self.parts[part]}, f"{self.name}/{part}"
        return alone

    def part(self, title: str) -> Callable[[Work], Work]:
        """Decorator of what does the work of a part; the part has its name."""

        def join(work: Work) -> Work:
            self.parts[work.__name__] = Part(work.__name__, title, work)
            return work

        return join

    def claim(self, part: str) -> dict[str, str]:
        """``where`` and ``says``: what the paper reported; ``verdict``, ``why``: ours. Empty where it does not."""
        return self.paper.get("claims", {}).get(part, {})
