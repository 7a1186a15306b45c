"""How far an image is from a reference: in numbers, pixel by pixel, and as a picture."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cached import cached_property
from .files import known_suffix, whole_file
from .image import Image
from .validation import finite_array, float_array, path_of

LIMITS = (1e-2, 5e-3, 1e-3, 1e-4)
DECADES = tuple(10.0**k for k in range(-9, 1))
CHANNELS = ("red", "green", "blue", "opacity")

Floats = NDArray[np.float64]


class Comparison:
    """Absolute differences of two images; what :func:`compare` returns.

    Parameters
    ----------
    difference
        Of each channel, float64 (height, width, 4).

    Attributes
    ----------
    limits
        The errors that shares are counted over.
    """

    def __init__(self, difference: Floats, limits: Sequence[float]):
        self._difference = _rgba(difference, "difference")
        given = finite_array(limits, "limits", (-1,))
        if np.any(given <= 0):
            raise ValueError(f"limits must be finite and > 0, got {tuple(given.tolist())}")
        self.limits = tuple(given.tolist())

    def difference(self) -> Floats:
        """Absolute difference of each channel, float64 (height, width, 4)."""
        return self._difference

    @cached_property
    def map(self) -> Floats:
        """Largest absolute difference of a pixel's channels, (height, width)."""
        return self._difference.max(axis=2)

    @property
    def channel_max(self) -> Floats:
        """Largest absolute difference of each channel, (4,)."""
        return self._difference.max(axis=(0, 1))

    @property
    def channel_mean(self) -> Floats:
        """Mean absolute difference of each channel, (4,)."""
        return self._difference.mean(axis=(0, 1))

    @property
    def channel_rms(self) -> Floats:
        """Root of the mean squared difference of each channel, (4,)."""
        return np.sqrt(np.mean(self._difference**2, axis=(0, 1)))

    @property
    def max(self) -> float:
        """Largest absolute difference."""
        return float(self._difference.max())

    @property
    def mean(self) -> float:
        """Mean absolute difference of all channels."""
        return float(self._difference.mean())

    @property
    def rms(self) -> float:
        """Root of the mean squared difference of all channels."""
        return float(np.sqrt(np.mean(self._difference**2)))

    @property
    def psnr(self) -> float:
        """Peak signal to noise ratio [dB], the peak being 1; infinite for equal images."""
        return float(-20 * np.log10(self.rms)) if self.rms > 0 else float("inf")

    @property
    def channel_shares(self) -> dict[float, Floats]:
        """By limit: share of rays whose error is larger, of each channel, (4,)."""
        return {limit: np.mean(self._difference > limit, axis=(0, 1)) for limit in self.limits}

    @property
    def shares(self) -> dict[float, float]:
        """By limit: share of rays whose error is larger in any channel."""
        return {limit: float(np.mean(self.map > limit)) for limit in self.limits}

    def histogram(self, decades: Sequence[float] = DECADES) -> tuple[NDArray, Floats]:
        """Rays by their largest error: counts, and the edges between them from 0 to infinity."""
        given = finite_array(decades, "decades", (-1,))
        if np.any(given <= 0) or np.any(np.diff(given) <= 0):
            raise ValueError(f"decades must be > 0 and ascending, got {tuple(given.tolist())}")
        edges = np.array([0.0, *given, np.inf])
        return np.histogram(self.map, edges)[0], edges

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map as a picture with a logarithmic colour scale; the file appears whole or not at all.

        Parameters
        ----------
        path
            The extension, in any case, is one of a format that Matplotlib writes: .png, .svg, .pdf, ...

        Raises
        ------
        ValueError
            For another extension; the message lists those that are accepted.
        OSError
            Where the file cannot be written; ``FileNotFoundError`` where its folder does not exist.
        """
        from matplotlib.colors import LogNorm
        from matplotlib.figure import Figure

        path = path_of(path)
        figure = Figure(figsize=(6, 6 * self.map.shape[0] / self.map.shape[1] + 0.2), layout="constrained")
        # PGF is text with pictures in files of their own.
        formats = sorted(set(figure.canvas.get_supported_filetypes()) - {"pgf"})
        suffix = known_suffix(path, [f".{name}" for name in formats])
        axes = figure.subplots()
        top = 10.0 ** np.ceil(np.log10(max(self.max, 1e-12)))
        shown = axes.imshow(np.maximum(self.map, 1e-300), norm=LogNorm(top * 1e-6, top), cmap="magma")
        axes.set(xticks=[], yticks=[])
        figure.colorbar(shown, label="largest absolute error of a channel", extend="min")
        with whole_file(path) as file:
            figure.savefig(file, format=suffix.removeprefix("."), dpi=150)

    def __str__(self) -> str:
        rows: list[tuple[str, ...]] = [("", *CHANNELS, "any")]
        for name, values, total in (
            ("max", self.channel_max, self.max),
            ("mean", self.channel_mean, self.mean),
            ("RMS", self.channel_rms, self.rms),
        ):
            rows.append((name, *(f"{value:.2e}" for value in values), f"{total:.2e}"))
        for limit, values in self.channel_shares.items():
            rows.append((f"> {limit:g}", *(f"{value:.3%}" for value in values), f"{self.shares[limit]:.3%}"))
        lines = ["".join(f"{cell:>10}" for cell in row) for row in rows]
        return "\n".join([*lines, f"{'PSNR':>10}{self.psnr:>9.1f} dB"])

    def __repr__(self) -> str:
        shares = ", ".join(f"{share:.3%} over {limit:g}" for limit, share in self.shares.items())
        numbers = f"max={self.max:.2e}, mean={self.mean:.2e}, rms={self.rms:.2e}"
        return f"Comparison({', '.join(filter(None, (numbers, shares)))})"


def compare(
    image: Image | NDArray[np.floating], reference: Image | NDArray[np.floating], limits: Sequence[float] = LIMITS
) -> Comparison:
    """Compare an image with a reference.

    Parameters
    ----------
    image, reference
        Images or arrays of linear premultiplied RGBA, both (height, width, 4).
    limits
        Errors, each > 0, that shares of rays are counted over.

    Raises
    ------
    ValueError
        For other or different shapes, pixels of 8 bits, which are sRGB and no light, NaN or infinite values, or a limit
        <= 0.

    Examples
    --------
    >>> import numpy as np, wvr
    >>> wvr.compare(np.full((2, 2, 4), 0.5), np.full((2, 2, 4), 0.498), limits=[1e-3])
    Comparison(max=2.00e-03, mean=2.00e-03, rms=2.00e-03, 100.000% over 0.001)
    """
    arrays = []
    for name, value in (("image", image), ("reference", reference)):
        arrays.append(_rgba(value.rgba if isinstance(value, Image) else value, name))
    if arrays[0].shape != arrays[1].shape:
        raise ValueError(f"image and reference must be of one size, got {arrays[0].shape} and {arrays[1].shape}")
    return Comparison(np.abs(arrays[0] - arrays[1]), limits)


def _rgba(value: Any, name: str) -> Floats:
    """Finite float64 numbers, (height, width, 4)."""
    if getattr(value, "dtype", None) == np.uint8:
        raise ValueError(f"{name} must be linear RGBA, got uint8: compare image.rgba, or what .npy, .tif and .exr keep")
    rgba = float_array(value, name)
    if rgba.ndim != 3 or rgba.shape[2] != 4 or rgba.size == 0:
        raise ValueError(f"{name} must be an Image or an array (height, width, 4), got shape {rgba.shape}")
    if not np.all(np.isfinite(rgba)):
        raise ValueError(f"{name} must be finite, got {np.count_nonzero(~np.isfinite(rgba))} values that are not")
    return rgba
