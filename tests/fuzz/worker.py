"""The process that runs cases: it reads numbers, and writes for each what came of it, as a line of JSON."""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import traceback
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from . import memory

KINDS = ("arguments", "files", "scenes")
# Address space of the process, of which libraries take the most, and growth of its memory by a case [bytes].
SPACE, GROWTH = 12 << 30, 300 << 20
# What libtiff prints, which reads some files through Pillow and cannot be told not to; and that a kernel is compiled.
KNOWN = (
    b"tempfile.tif",
    b"TIFF",
    b"LZWDecode",
    b"JPEGLib",
    b"JPEGSetupDecode",
    b"JPEGPreDecode",
    b"Fax3",
    b"wvr: compiling",
    b"wvr: reading",
)


def cases_of(kind: str) -> Any:
    """The class of them, with all that it needs and others do not."""
    return getattr(import_module(f".{kind}", __package__), kind.capitalize())


def rng_of(kind: str, number: int) -> np.random.Generator:
    return np.random.default_rng([KINDS.index(kind), number])


def outcome(target: Any, kind: str, number: int) -> str:
    """What is wrong with a case; nothing if all is right."""
    before = memory.peak(anew=True)
    try:
        found = target.run(rng_of(kind, number))
    except Exception:
        found = f"unclear: {traceback.format_exc()}"
    grown = (getattr(target, "peak", None) or memory.peak()) - before
    return f"blow-up: {grown / 2**20:.0f} MiB. {found}" if grown > GROWTH else found


def main() -> None:
    kind = sys.argv[1]
    resource.setrlimit(resource.RLIMIT_AS, (SPACE, SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    # What libraries print goes to a file, where it is noticed.
    with tempfile.TemporaryDirectory(prefix="wvr-fuzz-") as folder, (Path(folder) / "printed").open("w+b") as printed:
        os.chdir(folder)
        target = cases_of(kind)(Path(folder))
        target.run(rng_of(kind, 0))  # what is compiled or imported once is of no case
        for descriptor in (1, 2):
            os.dup2(printed.fileno(), descriptor)
        print(json.dumps("ready"), file=answers, flush=True)
        for line in sys.stdin:
            printed.seek(0)
            printed.truncate()
            found = outcome(target, kind, int(line))
            printed.seek(0)
            words = [line for line in printed.read(2000).splitlines() if not any(known in line for known in KNOWN)]
            if words and not found:
                found = f"unclear: printed {words[0]!r}"
            print(json.dumps([int(line), found, getattr(target, "subject", "")]), file=answers, flush=True)


if __name__ == "__main__":
    main()
