"""Edits of a transfer function's control points, each a new one; every number that is not edited stays exact."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..color import linear_rgb, linear_to_srgb
from ..transfer_function import MAX_OPACITY, TransferFunction


def moved(tf: TransferFunction, index: int, scalar: float, opacity: float) -> TransferFunction:
    """A point elsewhere, but not past its neighbours; two may meet, which is a jump."""
    knots, opacities = tf.knots.copy(), tf.opacities.copy()
    low, high = _room(tf, index)
    knots[index], opacities[index] = np.clip(scalar, low, high), np.clip(opacity, 0, 1)
    return _with(tf, knots, tf.colors, opacities)


def colored(tf: TransferFunction, index: int, color: Any) -> TransferFunction:
    """A point of another colour."""
    colors = tf.colors.copy()
    colors[_checked(tf, index)] = linear_rgb(color)
    return _with(tf, tf.knots, colors, tf.opacities)


def added(tf: TransferFunction, scalar: float, opacity: float | None = None) -> TransferFunction:
    """A point more, of the colour that is there, and of its opacity unless one is given."""
    if not np.isfinite(scalar) or scalar in tf.knots:
        raise ValueError(f"scalar must be finite and no control point's, got {scalar!r}")
    index = int(np.searchsorted(tf.knots, scalar))
    if opacity is None:
        # Between control points it is the optical depth that is linear.
        opacity = float(-np.expm1(-np.interp(scalar, tf.knots, _depths(tf))))
    knots = np.insert(tf.knots, index, scalar)
    colors = np.insert(tf.colors, index, tf.color(scalar), axis=0)
    values = {
        name: None if old is None else np.insert(old, index, np.interp(scalar, tf.knots, old))
        for name, old in tf.materials().items()
    }
    return TransferFunction.from_arrays(
        knots, colors, np.insert(tf.opacities, index, np.clip(opacity, 0, 1)), tf.unit_distance, **values
    )


def removed(tf: TransferFunction, index: int) -> TransferFunction:
    """A point less; two have to stay."""
    index = _checked(tf, index)
    if len(tf.knots) <= 2:
        raise ValueError("points must be at least two, so this one stays")
    values = {name: None if old is None else np.delete(old, index) for name, old in tf.materials().items()}
    return TransferFunction.from_arrays(
        np.delete(tf.knots, index),
        np.delete(tf.colors, index, 0),
        np.delete(tf.opacities, index),
        tf.unit_distance,
        **values,
    )


def rescaled(tf: TransferFunction, factor: float) -> TransferFunction:
    """All of it denser or thinner: extinctions times ``factor``."""
    if not (np.isfinite(factor) and factor > 0):
        raise ValueError(f"factor must be finite and > 0, got {factor!r}")
    return _with(tf, tf.knots, tf.colors, -np.expm1(-factor * _depths(tf)))


def described(tf: TransferFunction) -> list[list[Any]]:
    """Scalar, sRGB colour as #rrggbb, and opacity of each point, for an editor to draw."""
    encoded = np.rint(np.clip(linear_to_srgb(tf.colors), 0, 1) * 255).astype(int)
    colors = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in encoded]
    return [list(point) for point in zip(tf.knots.tolist(), colors, tf.opacities.tolist(), strict=True)]


def _room(tf: TransferFunction, index: int) -> tuple[float, float]:
    """Scalars that a point may have: between its neighbours, at most two of all points at one."""
    i, knots = _checked(tf, index), tf.knots
    low = -np.inf if i == 0 else knots[i - 1]
    high = np.inf if i == len(knots) - 1 else knots[i + 1]
    if i > 1 and knots[i - 2] == low:
        low = np.nextafter(low, np.inf)
    if i < len(knots) - 2 and knots[i + 2] == high:
        high = np.nextafter(high, -np.inf)
    return float(low), float(high)


def _depths(tf: TransferFunction) -> Any:
    """Optical depths of a unit distance."""
    return -np.log1p(-np.minimum(tf.opacities, MAX_OPACITY))


def _checked(tf: TransferFunction, index: int) -> int:
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(tf.knots):
        raise ValueError(f"index must be one of {len(tf.knots)} control points, got {index!r}")
    return index


def _with(tf: TransferFunction, knots: Any, colors: Any, opacities: Iterable[float]) -> TransferFunction:
    return TransferFunction.from_arrays(knots, colors, list(opacities), tf.unit_distance, **tf.materials())
