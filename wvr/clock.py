"""How long stages of a frame take, on a device that works while the host goes on."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import warp as wp


class Clock:
    """Marks between stages: by the clock where launches are waited for, by events of CUDA where nobody waits."""

    def __init__(self, device: wp.Device):
        self.device = device
        self._marks: list[Any] = []
        self.mark()

    def mark(self) -> None:
        """Here, behind all that was launched so far, the next stage begins."""
        if self.device.is_cuda:
            self._marks.append(self.device.stream.record_event(wp.Event(self.device, enable_timing=True)))
        else:
            self._marks.append(perf_counter())

    def seconds(self) -> list[float]:
        """Of each stage; the last mark has to be behind the device."""
        pairs = zip(self._marks, self._marks[1:], strict=False)
        if self.device.is_cuda:
            return [wp.get_event_elapsed_time(*pair, synchronize=False) / 1000 for pair in pairs]
        return [end - start for start, end in pairs]
