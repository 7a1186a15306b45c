"""What is said while somebody waits: to the log ``"wvr"``, or on stderr where nobody has set up logging."""

from __future__ import annotations

import logging
import sys

log = logging.getLogger("wvr")


def announce(message: str, *values: object) -> None:
    """Say it at level INFO; ``logging.getLogger("wvr").setLevel("WARNING")`` silences it."""
    if log.hasHandlers():
        log.info(message, *values)
    elif log.level <= logging.INFO:
        print("wvr:", message % values, file=sys.stderr, flush=True)
