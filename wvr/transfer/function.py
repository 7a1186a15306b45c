"""Transfer functions on the device: exact arrays of control points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..kernels.precision import REALS, vec3_of, vec4_of
from ..kernels.transfer.function import make_transfer
from ..transfer_function import TransferFunction

# Magnitudes that a precision holds, with room for what is computed from them.
LARGEST = {"float32": 1e30, "float64": 1e100}
# Least distance of control points that are no jump, for scalars of order one: slopes stay finite, and cubes of scalars
# between them do not underflow.
CLOSEST = {"float32": 2.0**-60, "float64": 2.0**-300}


@dataclass(frozen=True)
class Transfer(Part):
    """The struct of ``kernels.transfer.function``, of scalars minus ``shift``, with extinction per ``unit`` length."""

    function: TransferFunction
    unit: float
    shift: float
    precision: str
    material: bool
    name: ClassVar[str] = "transfer"

    def build(self, keep: Keeper) -> Any:
        factors = transfer_factors(self.function) if self.material else None
        values = transfer_values(self.function, self.unit)
        return transfer_arrays(self.function.knots, values, self.shift, self.precision, keep.device, factors)


def struct_of(built: Any) -> Any:
    """The struct of a transfer function's part: what it built, or the last of that."""
    return built[-1] if isinstance(built, tuple) else built


def transfer_values(tf: TransferFunction, unit: float) -> NDArray[np.float64]:
    """(r, g, b, extinction per ``unit``) at the knots; ``unit`` is the smallest voxel spacing [world length]."""
    return np.concatenate([tf.colors, tf.knot_extinctions(unit)[:, None] * unit], axis=1)


def transfer_factors(tf: TransferFunction) -> NDArray[np.float64]:
    """(ambient, diffuse, specular) coefficients at the knots, 1 where there are none."""
    given = (tf.ambient, tf.diffuse, tf.specular)
    return np.column_stack([np.ones(len(tf.knots)) if factor is None else factor for factor in given])


def transfer_arrays(
    scalars: NDArray[np.float64],
    values: NDArray[np.float64],
    shift: float,
    precision: str,
    device: wp.Device,
    factors: NDArray[np.float64] | None = None,
) -> Any:
    """The struct of ``kernels.transfer.function``, of control points (n,) less ``shift`` and their values (n, 4).

    Where light is, with their ``transfer_factors``.
    """
    real = REALS[precision]
    Transfer, _, _ = make_transfer(real)
    numpy_real = np.dtype(precision)
    knots = _apart(scalars, (scalars - shift).astype(numpy_real))
    n = len(knots)
    widths = np.diff(knots.astype(np.float64))
    # A jump is an interval without width: nothing is ever in it.
    steps = np.where(widths > 0, widths, 1.0)[:, None]

    def values_and_slopes(values: NDArray[np.float64]) -> list[NDArray]:
        flat = np.zeros((1, values.shape[1]))
        slopes = np.concatenate([flat, np.diff(values, axis=0) / steps, flat])
        return [np.ascontiguousarray(a, numpy_real) for a in (np.concatenate([values[:1], values]), slopes)]

    first, last = scalars[0], scalars[-1]
    bins = int(np.clip(8 * n, 512, 8192)) if last > first else 1
    scale = bins / (last - first) if last > first else 1.0
    # Which intervals a bin may need, with a margin for the rounding of its index.
    edges = np.linspace(first, last, bins + 1) - shift
    margin = 4 * np.spacing(np.abs(edges).max().astype(numpy_real)) + 0.01 / scale
    begin = np.searchsorted(knots, edges[:-1] - margin, "right")
    end = np.searchsorted(knots, edges[1:] + margin, "right") + 1
    begin[0], end[-1] = 0, n + 1

    transfer = Transfer()
    transfer.knot = wp.array(np.concatenate([knots[:1], knots]), dtype=real, device=device)
    transfer.value, transfer.slope = (
        wp.array(a, dtype=vec4_of(real), device=device) for a in values_and_slopes(values)
    )
    if factors is not None:
        transfer.factor, transfer.factor_slope = (
            wp.array(a, dtype=vec3_of(real), device=device) for a in values_and_slopes(factors)
        )
    transfer.visible = wp.array(_next_visible(values[:, 3]), dtype=int, device=device)
    transfer.bins = wp.array(np.stack([begin, end], axis=1).astype(np.int32), dtype=wp.vec2i, device=device)
    transfer.low = first - shift
    transfer.scale = scale
    return transfer


def _apart(scalars: NDArray[np.float64], knots: NDArray) -> NDArray:
    """``knots``, rounded from ``scalars``, with those apart that rounding put together: what is no jump stays none."""
    # Probes take scalars as they are, however small.
    size = min(float(np.abs(scalars).max()), 1.0)
    least = knots.dtype.type(CLOSEST[knots.dtype.name] * size)
    if np.all((np.diff(knots) >= least) | (np.diff(scalars) == 0)):
        return knots
    for k in range(1, len(knots)):
        if scalars[k] == scalars[k - 1]:
            knots[k] = knots[k - 1]
        else:
            next_one = np.nextafter(knots[k - 1], knots.dtype.type(np.inf))
            knots[k] = max(knots[k], next_one, knots[k - 1] + least)
    return knots


def _next_visible(extinctions: NDArray[np.float64]) -> NDArray[np.int32]:
    """For each of the n + 1 intervals of n knots, the first from it on that has any extinction, n + 1 if none."""
    ends = np.concatenate([extinctions[:1], extinctions, extinctions[-1:]])
    k = np.arange(len(ends) - 1)
    own = np.where((ends[:-1] > 0) | (ends[1:] > 0), k, len(k))
    return np.minimum.accumulate(own[::-1])[::-1].astype(np.int32)
