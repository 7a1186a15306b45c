"""What is said while a command works."""

from __future__ import annotations

import logging
import sys
from threading import Timer


class Stages(logging.Handler):
    """Says on stderr what is going on: the log of wvr and, on a terminal after two seconds, a spinner."""

    def __enter__(self) -> Stages:
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
        self.progress = Progress(*columns, console=Console(stderr=True), transient=True)
        self.task = self.progress.add_task("")
        self.timer: Timer | None = None
        self.log = logging.getLogger("wvr")
        self.log.addHandler(self)
        self.log.setLevel(logging.INFO)
        return self

    def __call__(self, name: str) -> None:
        self.progress.update(self.task, description=name)
        if self.timer is None and self.progress.console.is_terminal:
            self.timer = Timer(2, self.progress.start)
            self.timer.daemon = True
            self.timer.start()

    def share(self, done: float) -> None:
        """How much of the image there is."""
        self(f"rendering, {done:.0%}")

    def emit(self, record: logging.LogRecord) -> None:
        print(f"wvr: {record.getMessage()}", file=sys.stderr)
        if "compiling" in record.getMessage():
            self("compiling, then rendering")

    def __exit__(self, *error: object) -> None:
        self.log.removeHandler(self)
        if self.timer is not None:
            self.timer.cancel()
            self.timer.join()
            self.progress.stop()
