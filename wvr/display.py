"""Images on screen: Matplotlib axes with a scalar bar, the world's axes and the volume's outline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .camera import Camera
    from .image import Image
    from .transfer_function import TransferFunction

AXIS_COLORS = ("#d62728", "#2ca02c", "#1f77b4")
# Pairs of corners, x fastest, that the box's edges join.
EDGES = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]


class Shown(NamedTuple):
    """What an image is of, for those who draw around it."""

    camera: Camera
    corners: NDArray[np.float64]
    limits: tuple[float, float]
    transfer_function: TransferFunction | None
    anatomical: str = ""


def plot(image: Image, ax: Axes | None, scalar_bar: bool, axes: bool, outline: bool) -> Axes:
    """As :meth:`wvr.Image.plot`."""
    import matplotlib.pyplot as plt

    width, height = image.size
    if ax is None:
        wide = 1.0 + 0.2 * scalar_bar
        _, ax = plt.subplots(figsize=(wide * 5 * max(width / height, 0.2), 5), layout="constrained")
    assert ax is not None
    background = "white" if image.background is None else image.background
    ax.imshow(image.to_uint8(background), extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    ax.set_axis_off()
    shown = image.shown
    if shown is None:
        return ax
    if scalar_bar and shown.transfer_function is not None:
        _scalar_bar(ax, shown.transfer_function, shown.limits)
    if outline:
        _outline(ax, shown, (width, height), background)
    if axes:
        _orientation(ax, shown, (width, height))
    return ax


def _scalar_bar(ax: Axes, tf: TransferFunction, limits: tuple[float, float]) -> None:
    """Colours of the scalars that there are, as opaque as they are in the middle of the scale."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    from .color import linear_to_srgb

    lo, hi = limits
    lo, hi = max(lo, tf.knots[0]) if tf.knots[0] < hi else lo, min(hi, tf.knots[-1]) if tf.knots[-1] > lo else hi
    if not lo < hi:
        return
    colors = np.clip(linear_to_srgb(tf.color(np.linspace(lo, hi, 256))), 0, 1)
    scale = ScalarMappable(Normalize(lo, hi), ListedColormap(colors))
    ax.figure.colorbar(scale, ax=ax, shrink=0.8, pad=0.02)


def _outline(ax: Axes, shown: Shown, size: tuple[int, int], background: Any) -> None:
    """The edges of the volume's box, in front of it and behind."""
    from .color import linear_rgb

    dark = background != "transparent" and float(np.mean(linear_rgb(background))) < 0.2
    points = shown.camera.project(shown.corners, size)
    for a, b in EDGES:
        if np.all(np.isfinite(points[[a, b]])):
            ax.plot(
                *points[[a, b]].T,
                color="white" if dark else "black",
                linewidth=0.6,
                alpha=0.6,
                scalex=False,
                scaley=False,
            )


def _orientation(ax: Axes, shown: Shown, size: tuple[int, int]) -> None:
    """The world's axes in the lower left corner, as the camera sees them, the nearest drawn last."""
    width, height = size
    right, up, forward = shown.camera.basis()
    length = 0.09 * min(width, height)
    corner = np.array([1.6 * length, height - 1.6 * length])
    names = shown.anatomical or "xyz"
    for axis in sorted(range(3), key=lambda axis: -forward[axis]):
        tip = corner + length * np.array([right[axis], -up[axis]])
        arrow = {"arrowstyle": "-|>", "color": AXIS_COLORS[axis], "linewidth": 1.5, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tuple(tip), tuple(corner), arrowprops=arrow)
        x, y = corner + 1.35 * (tip - corner)
        ax.text(x, y, names[axis], color=AXIS_COLORS[axis], ha="center", va="center", fontsize=9)
