"""Quadrature nodes on the device."""

from __future__ import annotations

from functools import cache

import warp as wp

from ..kernels.precision import REALS, vec2_of
from ..kernels.transfer.linear import RULES, gauss_nodes


def nodes_array(precision: str, device: wp.Device, numbers: tuple[int, ...] | None = None) -> wp.array:
    """Nodes of Gauss-Legendre rules of so many nodes; by default those that ``kernels.transfer.linear`` reads."""
    return _nodes(precision, device.alias, numbers or tuple(n for _, n in RULES[precision]))


@cache
def _nodes(precision: str, alias: str, numbers: tuple[int, ...]) -> wp.array:
    return wp.array(gauss_nodes(numbers).astype(precision), dtype=vec2_of(REALS[precision]), device=alias)
