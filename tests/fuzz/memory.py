"""How much memory a process takes."""

from __future__ import annotations

import resource
from pathlib import Path


def peak(anew: bool = False) -> int:
    """The most bytes of memory that the process had, since it was asked for ``anew``, where the system tells."""
    try:
        if anew:
            Path("/proc/self/clear_refs").write_text("5")
        return 1024 * int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
    except (OSError, IndexError):
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
