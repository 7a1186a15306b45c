"""Quadrature nodes on the device."""

from __future__ import annotations

from functools import cache

import warp as wp

from ..kernels.precision import REALS, vec2_of
from ..kernels.transfer.linear import gauss_nodes


def nodes_array(precision: str, device: wp.Device) -> wp.array:
    """The nodes that ``kernels.transfer.linear`` reads."""
    return _nodes(precision, device.alias)


@cache
def _nodes(precision: str, alias: str) -> wp.array:
    return wp.array(gauss_nodes(precision).astype(precision), dtype=vec2_of(REALS[precision]), device=alias)
