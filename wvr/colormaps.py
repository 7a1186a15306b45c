"""Colours and opacities as plotting libraries name them: colour maps, lists, and PyVista's opacity names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .color import linear_rgb, srgb_to_linear
from .validation import any_array, finite_array, integer, near

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

Floats = NDArray[np.float64]
Colors: TypeAlias = Union[str, "Colormap", Sequence[Any]]
Opacity: TypeAlias = str | ArrayLike

NAMES = ("linear", "geom", "sigmoid", "foreground")
# Entries of a named opacity.
ENTRIES = 256
# Colours of a map at most, beyond any that can be told apart.
MOST_COLORS = 1 << 16
# By how much opacity between two control points may differ from linear, about.
CURVED = 1 / 1024


def entries(colormap: Colors, n_colors: int | None = None) -> Floats:
    """Linear RGB of the entries of a colour map or list of colours, (n, 3)."""
    import matplotlib
    from matplotlib.colors import Colormap

    if isinstance(colormap, str):
        if colormap not in matplotlib.colormaps:
            hint = near(colormap, list(matplotlib.colormaps))
            raise ValueError(f"colormap must be one of matplotlib.colormaps, such as 'viridis', got {colormap!r}{hint}")
        colormap = matplotlib.colormaps[colormap]
    if isinstance(colormap, list | tuple) or (isinstance(colormap, np.ndarray) and colormap.ndim):
        if len(colormap) < 2:
            raise ValueError(f"colormap must be a list of two or more colours, got {colormap!r}")
        rgb = np.array([linear_rgb(color, f"colormap[{i}]") for i, color in enumerate(colormap)])
    elif isinstance(colormap, Colormap):
        rgb = srgb_to_linear(colormap(np.arange(max(colormap.N, 2)))[:, :3])
    else:
        raise TypeError(
            f"colormap must be a Matplotlib colour map, the name of one, or a list of colours, got {colormap!r}"
        )
    if n_colors is None:
        return rgb
    at = np.linspace(0, len(rgb) - 1, integer(n_colors, "n_colors", 2, MOST_COLORS))
    return np.stack([np.interp(at, np.arange(len(rgb)), channel) for channel in rgb.T], axis=-1)


def opacities(opacity: Opacity) -> Floats:
    """Numbers equally spaced over the domain, two or more, of a name, a list or a number."""
    if isinstance(opacity, str):
        return _named(opacity)
    numbers = any_array(opacity, "opacity")
    given = finite_array(np.repeat(numbers, 2) if numbers.ndim == 0 else numbers, "opacity", (-1,))
    if len(given) < 2:
        raise ValueError(
            f"opacity must be one number, or two or more equally spaced over the domain, got {len(given)} in a list"
        )
    check_opacity(given)
    return given


def _named(name: str) -> Floats:
    """As :func:`pyvista.opacity_transfer_function` defines them, without its rounding to 8 bits."""
    base, turned = (name[:-2], True) if name.endswith("_r") else (name, False)
    if base == "linear":
        values = np.array([0.0, 1.0])
    elif base == "geom":
        values = np.geomspace(1e-6, 255, ENTRIES) / 255
    elif base == "foreground" and not turned:
        values = np.ones(ENTRIES)
        values[0] = 0.0
    elif match := re.fullmatch(r"sigmoid(?:_(\d+(?:\.\d+)?))?", base):
        steepness = float(match[1] or 10)
        values = 1 / (1 + np.exp(-np.linspace(-steepness, steepness, ENTRIES)))
    else:
        raise ValueError(
            f"opacity must be numbers from 0 to 1, 'linear', 'geom', 'sigmoid', 'sigmoid_5' (or another number), one "
            f"of these with '_r', or 'foreground', got {name!r}{near(name, NAMES)}"
        )
    return values[::-1] if turned else values


def sampled(rgb: Floats, opacity: Floats) -> tuple[Floats, Floats, Floats]:
    """Control points from 0 to 1 with colour and opacity, both linear between those given, of any number each.

    Between two opacities there are as many more as it takes for opacity to be linear, to 1/512, where extinction is.
    """
    n, m = len(rgb), len(opacity)
    # Ticks count in units of 1 / ((n - 1) (m - 1)) of the domain, so that points which coincide are equal.
    color_ticks, opacity_ticks = np.arange(n) * (m - 1), np.arange(m) * (n - 1)
    ticks = np.union1d(color_ticks, opacity_ticks).astype(np.float64)
    added = [
        start + (n - 1) * (value - first) / (last - first)
        for start, first, last in zip(opacity_ticks, opacity, opacity[1:], strict=False)
        for value in _between(min(first, last), max(first, last))
    ]
    extra = np.array(added)
    near_ticks = np.abs(extra - ticks[np.searchsorted(ticks, extra).clip(1) - 1]) < 1e-6
    near_ticks |= np.abs(extra - ticks[np.searchsorted(ticks, extra).clip(0, len(ticks) - 1)]) < 1e-6
    ticks = np.union1d(ticks, extra[~near_ticks])
    colors = np.stack([np.interp(ticks, color_ticks, channel) for channel in rgb.T], axis=-1)
    return ticks / ticks[-1], colors, np.interp(ticks, opacity_ticks, opacity)


def _between(low: float, high: float) -> list[float]:
    """Opacities between two, so close that linear extinction between neighbours is linear opacity to ``CURVED``.

    Over a step d from an opacity o it is off by about d^2 / (8 (1 - o - d)).
    """
    values: list[float] = []
    value = low
    while value < 1 - CURVED:
        value += np.sqrt(16 * CURVED**2 + 8 * CURVED * (1 - value)) - 4 * CURVED
        if value >= high:
            break
        values.append(float(value))
    return values


def check_opacity(opacity: Floats) -> None:
    if np.any(wrong := (opacity < 0) | (opacity > 1)):
        worst = float(opacity[wrong][0])
        hint = "; divide 8-bit ones by 255" if 1 < worst <= 255 else ""
        raise ValueError(f"opacity must be in [0, 1], got {worst!r}{hint}")
