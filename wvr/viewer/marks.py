"""What is drawn over a picture: the bound on its error, and the edges of the volume's box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..display import EDGES
from ..image import Image
from .state import State

Pixels = NDArray[np.uint8]
# Bounds from so many powers of ten below the tolerance up to it, from dark to light.
DECADES = 5.0
# Where pixels are over the tolerance.
OVER = (255, 0, 255)
# Of a line's colour, so much is on the picture.
INK = 0.6


def marked(image: Image, state: State, tolerance: float | None) -> Pixels:
    """An image as screens want it, with the marks of its state."""
    pixels = bounds(image, tolerance) if state.bound and image.error_bound is not None else image.to_uint8()
    if state.outline and image.shown is not None:
        pixels = outlined(pixels, image)
    return pixels


def bounds(image: Image, tolerance: float | None) -> Pixels:
    """Bounds of the pixels on a logarithmic scale in the colours of Matplotlib's magma, the tolerance the brightest;
    pixels over it are pink. Without one the largest bound is the brightest.
    """
    import matplotlib

    assert image.error_bound is not None
    bound = image.error_bound.astype(np.float64)
    most = tolerance or float(bound.max()) or 1.0
    with np.errstate(divide="ignore"):
        part = 1 + np.log10(bound / most) / DECADES
    colors = matplotlib.colormaps["magma"](np.clip(part, 0, 1), bytes=True)[..., :3]
    colors[bound > most] = OVER
    return colors


def outlined(pixels: Pixels, image: Image) -> Pixels:
    """With the edges of the volume's box, where both ends are in front of the camera."""
    assert image.shown is not None
    height, width = pixels.shape[:2]
    pixels = pixels.copy()
    ink = 255 if pixels.mean() < 128 else 0
    points = image.shown.camera.project(image.shown.corners, (width, height))
    for a, b in EDGES:
        start, end = points[a], points[b]
        if not np.all(np.isfinite([start, end])):
            continue
        steps = int(min(np.abs(end - start).max(), 4 * max(width, height))) + 1
        along = np.rint(start + np.linspace(0, 1, steps)[:, None] * (end - start)).astype(int)
        inside = np.all((along >= 0) & (along < (width, height)), axis=1)
        x, y = along[inside].T
        pixels[y, x] = (INK * ink + (1 - INK) * pixels[y, x]).astype(np.uint8)
    return pixels
