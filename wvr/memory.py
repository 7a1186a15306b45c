"""How much memory is free, and what was freed given back."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp


def free_memory(device: wp.Device) -> float:
    """Bytes that can still be taken on a device."""
    return device.free_memory if device.is_cuda else free_host_memory()


def free_host_memory() -> float:
    """Bytes that can be taken without swapping."""
    try:
        # What the system can give back counts as free, unlike in sysconf.
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        return 1024.0 * int(text.partition("MemAvailable:")[2].split()[0])
    except (OSError, ValueError, IndexError):
        pass
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return float("inf")


def check_room(needed: float, device: wp.Device | None, what: str, instead: str) -> None:
    """Say so where more bytes are needed than can be taken on a device, by default the host, before any is."""
    free, where = (free_host_memory(), "cpu") if device is None else (free_memory(device), device.alias)
    if needed > free:
        raise MemoryError(f"{what} need {gib(needed)} on {where}, which has {gib(free)} free: take {instead}")


def give_back() -> None:
    """Have the system take back memory that is free but kept by the process: where arrays come and go among small ones
    that stay, glibc may keep many times what there is at a time.
    """
    if (trim := _trim()) is not None:
        trim(0)


@cache
def _trim() -> Any:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):
        return None  # other systems give back


def gib(count: float) -> str:
    """So many bytes, in words."""
    return f"{count / 2**30:.1f} GiB"
