"""Fields that follow from a formula or a spectrum, and what all generated ones share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def axes(size: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Coordinates z, y, x in [-1, 1] at the samples, shaped to broadcast to (z, y, x)."""
    line = np.linspace(-1, 1, size, dtype=np.float32)
    return line[:, None, None], line[:, None], line


def marschner_lobb(size: int) -> NDArray:
    """The test signal of Marschner & Lobb, "An Evaluation of Reconstruction Filters for Volume Rendering", 1994."""
    alpha, frequency = 0.25, 6.0
    z, y, x = (axis.astype(np.float64) for axis in axes(size))
    ripple = np.cos(2 * np.pi * frequency * np.cos(np.pi / 2 * np.hypot(x, y)))
    return ((1 - np.sin(np.pi / 2 * z) + alpha * (1 + ripple)) / (2 * (1 + alpha))).astype(np.float32)


def spheres(size: int) -> NDArray:
    """A ball (255) within two shells (170, 85), edges linear over two voxels."""
    z, y, x = axes(size)
    radius = np.sqrt(x * x + y * y + z * z)
    voxel = 2 / (size - 1)
    field = np.zeros_like(radius)
    for inner, outer, level in ((-1.0, 0.25, 255), (0.45, 0.55, 170), (0.75, 0.85, 85)):
        depth = np.minimum(radius - inner, outer - radius) / voxel
        field += level * coverage(depth)
    return rounded(field)


def coverage(depth: NDArray) -> NDArray:
    """Share of a voxel that is inside, from the depth below the surface in voxels: smooth over two."""
    return np.clip(0.5 + depth / 2, 0, 1)


def rounded(field: NDArray) -> NDArray[np.uint8]:
    return np.clip(np.rint(field), 0, 255).astype(np.uint8)


# Ellipsoids of the three-dimensional Shepp-Logan head phantom as in M. Schabel's phantom3d (MATLAB Central 9416), with
# the higher contrast of P. Toft, "The Radon Transform", 1996: grey value in tenths, half axes, centre, rotation about z
# in degrees.
SHEPP_LOGAN = (
    (10, (0.69, 0.92, 0.81), (0.0, 0.0, 0.0), 0),
    (-8, (0.6624, 0.874, 0.78), (0.0, -0.0184, 0.0), 0),
    (-2, (0.11, 0.31, 0.22), (0.22, 0.0, 0.0), -18),
    (-2, (0.16, 0.41, 0.28), (-0.22, 0.0, 0.0), 18),
    (1, (0.21, 0.25, 0.41), (0.0, 0.35, -0.15), 0),
    (1, (0.046, 0.046, 0.05), (0.0, 0.1, 0.25), 0),
    (1, (0.046, 0.046, 0.05), (0.0, -0.1, 0.25), 0),
    (1, (0.046, 0.023, 0.05), (-0.08, -0.605, 0.0), 0),
    (1, (0.023, 0.023, 0.02), (0.0, -0.606, 0.0), 0),
    (1, (0.023, 0.046, 0.02), (0.06, -0.605, 0.0), 0),
)


def shepp_logan(size: int) -> NDArray:
    """The head phantom, each sample the sum of the ellipsoids it is in: no smoothing."""
    z, y, x = axes(size)
    field = np.zeros((size, size, size), np.int8)
    for grey, (a, b, c), (cx, cy, cz), degrees in SHEPP_LOGAN:
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        along, across = cos * (x - cx) + sin * (y - cy), cos * (y - cy) - sin * (x - cx)
        disc = (along / a) ** 2 + (across / b) ** 2
        field += np.int8(grey) * (disc + ((z - cz) / c) ** 2 <= 1)
    return field / np.float32(10)


def blobs(size: int, seed: int = 1, count: int = 60) -> NDArray:
    """A sum of Gaussians, 8 to 16 % of the cube wide, scaled to 0 .. 255."""
    rng = np.random.default_rng(seed)
    centre, width = rng.uniform(0.1, 0.9, (count, 3, 1)), rng.uniform(0.08, 0.16, (count, 1, 1))
    height = rng.uniform(0.5, 1.0, count)
    line = np.linspace(0, 1, size)
    gx, gy, gz = np.exp(-(((line - centre) / width) ** 2) / 2).transpose(1, 0, 2)
    plane = (gy[:, :, None] * gx[:, None, :]).reshape(count, -1)
    field = ((gz.T * height).astype(np.float32) @ plane.astype(np.float32)).reshape(size, size, size)
    lo, hi = field.min(), field.max()
    return rounded((field - lo) * (255 / (hi - lo)))


def gyroid(size: int, periods: float = 3.0) -> NDArray:
    """Schoen's minimal surface, the zero of sin x cos y + sin y cos z + sin z cos x."""
    z, y, x = (np.float32(np.pi * periods) * axis for axis in axes(size))
    return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def turbulence(size: int, seed: int = 1) -> NDArray:
    """Vorticity magnitude of :func:`vorticity`, scaled to a root mean square of 1."""
    squares = np.sum([component**2 for component in vorticity(size, seed)], axis=0)
    # Two samples resolve no wave at all.
    mean = max(float(squares.mean(dtype=np.float64)), float(np.finfo(np.float32).tiny))
    return np.sqrt(squares / np.float32(mean))


def vorticity(size: int, seed: int) -> list[NDArray[np.float32]]:
    """Components of the curl of a periodic velocity of random, divergence-free waves with Kolmogorov's spectrum.

    Wave numbers reach 24; neither they nor the energy ``E(k) ~ k**(-5/3)`` depend on ``size``, so other sizes sample
    the same flow, as far as they resolve it.
    """
    top = 24
    line = np.arange(-top, top + 1)
    k = np.stack(np.meshgrid(line, line, line, indexing="ij"))  # along z, y, x
    length = np.sqrt((k**2).sum(axis=0))
    kept = (length > 0) & (length <= top) & (length < size / 2)
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *k.shape))
    # Amplitude of a wave: E(k) is shared by the 4 pi k**2 waves of its shell.
    wave = (real + 1j * imaginary) * np.where(kept, length.clip(1) ** (-11 / 6), 0)
    curl = 1j * np.cross(k, wave, axis=0)  # blind to the divergence that the waves have
    curl += curl[:, ::-1, ::-1, ::-1].conj()  # a real field: opposite waves are conjugate
    spectra = np.zeros((3, size, size, size // 2 + 1), np.complex64)
    inside = np.abs(line) < size / 2
    right = inside & (line >= 0)
    for spectrum, waves in zip(spectra, curl, strict=True):
        spectrum[np.ix_(line[inside], line[inside], line[right])] = waves[np.ix_(inside, inside, right)]
    return [np.fft.irfftn(spectrum, (size, size, size), axes=(0, 1, 2)).astype(np.float32) for spectrum in spectra]
