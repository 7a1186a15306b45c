"""Samples on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import warp as wp

from ..keep import Keeper, Part
from ..kernels.field.samples import make_samples


@dataclass(frozen=True)
class Data(Part):
    """The samples of a volume as a Warp array, as they were at a ``version``."""

    volume: Any
    version: int
    name: ClassVar[str] = "volume"

    def build(self, keep: Keeper) -> wp.array:
        return self.volume.uploaded(keep.device)


def samples_struct(data: wp.array, shift: float = 0.0) -> Any:
    """The struct of ``kernels.field.samples``."""
    struct = make_samples(data.dtype)()
    struct.data = data
    struct.last = wp.vec3i(*(n - 2 for n in reversed(data.shape)))
    struct.shift = shift
    return struct
