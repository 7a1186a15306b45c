"""A transfer function with fewer control points, and how far it is from the one given.

Every control point that a cell sees cuts its piece of ray in two. Colour maps have hundreds that change nothing at the
tolerance of an image: colour may be off by d in all that a ray adds, whose opacities sum to one, and extinction by a
share r of itself likewise, or by any amount times the ray's length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..transfer_function import TransferFunction
from .function import transfer_arrays, transfer_factors, transfer_values

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Simplified:
    """Control points that are left, and the largest deviations between them; of extinction both may add up."""

    knots: Floats  # (m,)
    values: Floats  # (m, 4) colour and extinction
    color: float  # of a channel
    relative: float  # of extinction, in parts of the smaller one
    absolute: float  # of extinction, where it is not counted as relative


@dataclass(frozen=True)
class SimplifiedTransfer(Part):
    """(Simplified, struct of ``kernels.transfer.function`` in float64); deviations as of :func:`simplify`."""

    function: TransferFunction
    unit: float
    shift: float
    material: bool
    color: float
    relative: float
    absolute: float
    name: ClassVar[str] = "simplified"

    def build(self, keep: Keeper) -> tuple[Simplified, Any]:
        tf = self.function
        values, factors = transfer_values(tf, self.unit), None
        if self.material:
            # Coefficients of light belong to the control points there are.
            points, factors = Simplified(tf.knots, values, 0.0, 0.0, 0.0), transfer_factors(tf)
        else:
            points = simplify(tf.knots, values, self.color, self.relative, self.absolute)
        return points, transfer_arrays(points.knots, points.values, self.shift, "float64", keep.device, factors)


def simplify(knots: Floats, values: Floats, color: float, relative: float, absolute: float) -> Simplified:
    """Leave out control points as long as lines between the others deviate by at most so much.

    Jumps stay as they are, and so does what has no extinction.

    Parameters
    ----------
    knots, values
        (n,) ascending scalars and (n, 4) colour and extinction at them.
    color, relative, absolute
        Deviations that are allowed, as in :class:`Simplified`.
    """
    n = len(knots)
    tau = values[:, 3]
    jumps = np.concatenate([[0], np.cumsum(np.diff(knots) == 0)])
    clear = np.concatenate([[0], np.cumsum(tau == 0)])
    worst = np.zeros(3)

    def deviations(i: int, j: int) -> Floats | None:
        """Of the line from i to j; None where it must not be drawn."""
        if j == i + 1:
            return np.zeros(3)
        if jumps[j] > jumps[i]:
            return None
        zeros = clear[j + 1] - clear[i]
        if zeros:
            # Its colours are never seen.
            return np.zeros(3) if zeros == j + 1 - i else None
        t = ((knots[i + 1 : j] - knots[i]) / (knots[j] - knots[i]))[:, None]
        line = values[i] + t * (values[j] - values[i])
        off = np.abs(line - values[i + 1 : j])
        small = off[:, 3] <= absolute
        least = np.minimum(line[:, 3], tau[i + 1 : j])
        result = np.array(
            [
                off[:, :3].max(),
                (off[:, 3] / least).max(where=~small, initial=0.0),
                off[:, 3].max(where=small, initial=0.0),
            ]
        )
        return result if result[0] <= color and result[1] <= relative else None

    kept = [0]
    while kept[-1] < n - 1:
        i = kept[-1]
        # As far as it goes: twice as far each time, then halving what is left.
        good, found, bad = i + 1, np.zeros(3), i + 2
        while bad < n and (tried := deviations(i, bad)) is not None:
            good, found, bad = bad, tried, i + 2 * (bad - i)
        bad = min(bad, n)
        while bad - good > 1:
            middle = (good + bad) // 2
            tried = deviations(i, middle)
            if tried is None:
                bad = middle
            else:
                good, found = middle, tried
        worst = np.maximum(worst, found)
        kept.append(good)
    return Simplified(knots[kept], values[kept], *worst.tolist())
