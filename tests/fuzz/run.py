"""Runs cases in workers, which are replaced when they die or hang."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
# How long a case may take of a processor, which others may keep busy, and a worker until it is ready: it compiles
# kernels [s].
LIMITS = {"files": 10.0, "arguments": 60.0, "scenes": 60.0}
# So many times as long by the clock, for what sleeps.
PATIENCE = 6
READY = 300.0
COMMAND = (sys.executable, "-m", "tests.fuzz.worker")


class Found(NamedTuple):
    """What came of a case that is not right."""

    kind: str
    number: int
    outcome: str
    note: str
    subject: str = ""  # what it was about, such as a format that was read or refused


class Worker:
    def __init__(self, kind: str):
        self.process = subprocess.Popen(
            [*COMMAND, kind], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.limit = LIMITS[kind]
        if self._line(READY) is None:
            error = self.process.stderr.read().decode(errors="replace") if self.process.poll() is not None else ""
            raise RuntimeError(f"the worker for {kind} does not start: {error}")

    def _line(self, limit: float) -> bytes | None:
        """The next answer; None where there is none in time, or the process died."""
        begun, used = time.monotonic(), self._used()
        while self._used() - used < limit and time.monotonic() - begun < PATIENCE * limit:
            if select.select([self.process.stdout], [], [], min(limit, 1.0))[0]:
                return self.process.stdout.readline() or None
        return None

    def _used(self) -> float:
        """Time of a processor that the process took [s], or the clock's where the system does not tell."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        except (OSError, IndexError, ValueError):
            return time.monotonic()

    def run(self, number: int) -> tuple[str, str, str]:
        """Outcome, note and subject of a case."""
        self.process.stdin.write(f"{number}\n".encode())
        self.process.stdin.flush()
        line = self._line(self.limit)
        if line is not None:
            _, note, subject = json.loads(line)
            return (note.partition(":")[0] if note else "right"), note, subject
        try:
            code = self.process.wait(timeout=1)
        except subprocess.TimeoutExpired:
            return "hang", f"no end within {self.limit:g} s", ""
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return "crash", name, ""

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()


def run(kind: str, numbers: Iterable[int]) -> Iterator[Found]:
    """Run cases of a kind; yields what came of each."""
    worker = None
    try:
        for number in numbers:
            worker = Worker(kind) if worker is None else worker
            outcome, note, subject = worker.run(number)
            yield Found(kind, number, outcome, note, subject)
            if outcome in ("hang", "crash"):
                worker.end()
                worker = None
    finally:
        if worker is not None:
            worker.end()
