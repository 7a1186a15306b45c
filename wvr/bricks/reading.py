"""How much may be read, kept and waited for."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from ..validation import choice, positive, real

Missing = Literal["error", "bound"]
UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}
# Least memory for samples that anything is rendered with.
LEAST = 1 << 20


@dataclass(frozen=True)
class Reading:
    """What a frame may take.

    Attributes
    ----------
    memory
        Bytes of samples and of what is made of them at a time; None is no limit.
    seconds, bytes
        After so long, or once so much is read, nothing more is.
    missing
        What becomes of chunks that cannot be read: an error, or a wider bound.
    client
        A ``distributed.Client`` whose workers render; None is one that is active, if there is one, False none.
    """

    memory: int | None = None
    seconds: float | None = None
    bytes: int | None = None
    missing: Missing = "error"
    client: Any = None

    @classmethod
    def of(
        cls,
        memory_limit: int | str | None = None,
        budget: float | str | None = None,
        missing: Missing = "error",
        client: Any = None,
    ) -> Reading:
        """As users say it; see :func:`wvr.render`."""
        choice(missing, "missing", get_args(Missing))
        memory = None if memory_limit is None else parsed_bytes(memory_limit, "memory_limit")
        if memory is not None and memory < LEAST:
            raise ValueError(f"memory_limit must be at least {LEAST} bytes, got {memory_limit!r}")
        seconds = bytes_ = None
        if isinstance(budget, str):
            bytes_ = parsed_bytes(budget, "budget", 'seconds or a text such as "500 MB"')
        elif budget is not None:
            seconds = real(budget, "budget", 'seconds or a text such as "500 MB"')
            seconds = seconds and positive(budget, "budget")
        return cls(memory, seconds, bytes_, missing, checked_client(client))

    @property
    def budgeted(self) -> bool:
        """Whether not all may be read."""
        return self.seconds is not None or self.bytes is not None

    @property
    def limited(self) -> bool:
        """Whether it is for bricks alone."""
        return replace(self, client=self.client or None) != Reading()


def checked_client(client: Any) -> Any:
    """What is a ``distributed.Client``, None or False."""
    if client is not None and client is not False and not hasattr(client, "scheduler_info"):
        raise TypeError(f"client must be a distributed.Client, or False for none, got {type(client).__name__}")
    return client


def active_client() -> Any:
    """The one that Dask's own computations would take now, if it has workers; nothing is imported for it."""
    distributed = sys.modules.get("distributed")
    if distributed is None:
        return None
    try:
        client = distributed.default_client()
    except ValueError:
        return None
    # One that is awaited, or in a task of a worker, is not for a call that waits itself.
    usable = client.status == "running" and not client.asynchronous
    return client if usable and client.scheduler_info(n_workers=-1)["workers"] else None


def parsed_bytes(given: Any, name: str, what: str = 'bytes, a number or a text such as "4 GiB"') -> int:
    """Bytes, as a number or a text such as ``"4 GiB"``."""
    if isinstance(given, str):
        match = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmgt]?i?)b?\s*", given.lower())
        if match and match[2] in UNITS:
            try:
                return int(float(match[1]) * UNITS[match[2]])
            except (ValueError, OverflowError):
                pass
    elif isinstance(given, int | float | np.number) and not isinstance(given, bool) and given > 0 and given < 2**63:
        return int(given)
    raise ValueError(f"{name} must be {what}, got {given!r}")
