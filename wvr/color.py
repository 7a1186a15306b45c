"""Colours: the sRGB transfer curve of IEC 61966-2-1, both ways, and linear RGB from what users write."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .validation import float_array, near, outside

PLAIN = {"black": "#000000", "white": "#ffffff"}
ACCEPTED = "a colour name, '#rrggbb', or three finite linear numbers >= 0"


def srgb_to_linear(encoded: ArrayLike) -> NDArray[np.float64]:
    """Linear values of sRGB-encoded ones, both with 0 as black and 1 as white; any shape, float64."""
    encoded = np.asarray(encoded, np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: ArrayLike) -> NDArray[np.float64]:
    """sRGB-encoded values of linear ones, both with 0 as black and 1 as white; any shape, float64."""
    linear = np.asarray(linear, np.float64)
    low = 12.92 * np.minimum(linear, 0.0031308)
    return np.where(linear <= 0.0031308, low, 1.055 * np.maximum(linear, 0.0) ** (1 / 2.4) - 0.055)


def is_clear(background: Any) -> bool:
    """Whether nothing is behind."""
    return background is None or (isinstance(background, str) and background == "transparent")


def doubt_bytes(colors: Any, name: str) -> None:
    """Warn of whole numbers that are far above 1, which is white."""
    given = np.asarray(colors) if isinstance(colors, np.ndarray | list | tuple) else np.empty(0)
    if given.dtype.kind in "iu" and given.max(initial=0) > 15:
        warnings.warn(
            f"{name} is in linear numbers, of which 1 is white, and has {given.max()}: say '#rrggbb' for 8-bit colours",
            stacklevel=outside(),
        )


def linear_rgb(color: str | Sequence[float], name: str = "color") -> NDArray[np.float64]:
    """Linear RGB of a colour as users write it.

    Parameters
    ----------
    color
        A string that Matplotlib knows as an opaque colour, such as ``"orange"``, ``"tab:blue"`` or ``"#ff8000"``,
        which is decoded from sRGB; a colour of PyVista; or three linear numbers >= 0, taken as they are (above 1 is
        brighter than white).
    name
        The argument that errors name.

    Returns
    -------
    float64, shape (3,)

    Raises
    ------
    ValueError
        For an unknown name, a colour with transparency, or numbers that are not three, finite and >= 0.
    """
    color = getattr(color, "hex_rgb", color)  # of PyVista
    if isinstance(color, str):
        if re.fullmatch("#[0-9a-fA-F]{6}", color := PLAIN.get(color, color)):
            # Without Matplotlib, which takes a while to import.
            return srgb_to_linear([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        from matplotlib.colors import to_rgba

        try:
            *encoded, alpha = to_rgba(color)
        except ValueError:
            from matplotlib.colors import CSS4_COLORS

            raise ValueError(f"{name} must be {ACCEPTED}, got {color!r}{near(color, list(CSS4_COLORS))}") from None
        if alpha != 1:
            raise ValueError(f"{name} must be opaque, got {color!r}")
        return srgb_to_linear(encoded)
    doubt_bytes(color, name)
    try:
        linear = float_array(color, name)
    except TypeError:
        raise ValueError(f"{name} must be {ACCEPTED}, got {color!r}") from None
    if linear.shape != (3,) or not np.all(np.isfinite(linear) & (linear >= 0)):
        raise ValueError(f"{name} must be {ACCEPTED}, got {color!r}")
    return linear
