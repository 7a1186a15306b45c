"""A heart that beats."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .fields import axes, coverage, rounded


def heart(size: int, phase: float = 0.0, seed: int = 1) -> NDArray:
    """Two ventricles that beat, as a 4D ultrasound probe at the top sees them: blood 20, muscle 120, outside 40.

    ``phase`` 0 is the end of filling, 0.35 that of contraction, and 1 is 0 again. The left ventricle ejects 58 % of its
    blood, the volume of its wall stays. Echoes have the statistics of speckle, which changes smoothly over a cycle.
    """
    cycle = phase % 1.0
    # How contracted: 0 to 1 and back, each a half wave.
    squeeze = np.sin(np.pi / 2 * (cycle / 0.35 if cycle < 0.35 else (1 - cycle) / 0.65)) ** 2
    z, y, x = axes(size)
    voxel = np.float32(2 / (size - 1))

    def spheroid(center: tuple[float, float, float], across: float, along: float) -> NDArray:
        """Depth below the surface, exact in first order."""
        p, q, r = ((a - np.float32(c)) for a, c in zip((x, y, z), center, strict=True))
        radius = np.sqrt((p * p + q * q) / np.float32(across**2) + r * r / np.float32(along**2))
        steep = np.sqrt((p * p + q * q) / np.float32(across**4) + r * r / np.float32(along**4))
        return (1 - radius) * radius / np.maximum(steep, voxel)

    # Volumes over 4 pi / 3: the wall's is what lies between 0.31 x 0.62 and 0.45 x 0.74.
    wall = 0.45**2 * 0.74 - 0.31**2 * 0.62
    inner, length = 0.31 * (1 - 0.3 * squeeze), 0.62 * (1 - 0.15 * squeeze)
    around = 0.74 * (1 - 0.08 * squeeze)
    left = -0.18, 0.0, -0.1
    left_blood = spheroid(left, inner, length)
    left_wall = spheroid(left, np.sqrt((wall + inner**2 * length) / around), around)
    right = 0.28 - 0.06 * squeeze, 0.0, -0.15
    right_blood = spheroid(right, 0.34 * (1 - 0.15 * squeeze), 0.52 * (1 - 0.12 * squeeze))
    right_wall = spheroid(right, 0.34 * (1 - 0.15 * squeeze) + 0.08, 0.52 * (1 - 0.12 * squeeze) + 0.08)
    muscle = np.maximum(left_wall, np.minimum(right_wall, -left_wall))
    # Two papillary muscles rise from the wall of the left ventricle.
    for side in (-1, 1):
        foot = left[0] - 0.5 * inner, 0.75 * side * inner, left[2] + 0.05
        muscle_here = spheroid(foot, 0.3 * inner, 0.45 * length)
        left_blood = np.minimum(left_blood, -muscle_here)
    blood = np.maximum(left_blood, np.minimum(right_blood, -left_wall))
    level = 40 + 80 * coverage(muscle / voxel)
    level += (20 - level) * coverage(blood / voxel)
    # The pyramid in front of the probe.
    below = np.float32(1.15) - z
    seen = np.minimum(0.72 * below - np.maximum(np.abs(x), np.abs(y)), 2.1 - np.sqrt(x * x + y * y + below * below))
    return rounded(level * (0.45 + 0.55 * _speckle(size, cycle, seed)) * coverage(seen / voxel))


def _speckle(size: int, cycle: float, seed: int) -> NDArray[np.float32]:
    """Amplitude of the echo of many scatterers, Rayleigh-distributed with mean 1, blurred as a probe does.

    It turns from one field into another and back, so that neighbours in time look alike, and a cycle is closed.
    """
    rng = np.random.default_rng(seed)
    turn = np.cos(2 * np.pi * cycle), np.sin(2 * np.pi * cycle)
    squares = np.zeros((size, size, size), np.float32)
    for _ in ("in phase", "in quadrature"):
        echo = np.zeros_like(squares)
        for weight in turn:
            echo += np.float32(weight) * rng.standard_normal(squares.shape, np.float32)
        for axis in (0, 1, 2):
            # Finer along the beam.
            for _ in range(1 if axis == 0 else 2):
                echo = (np.roll(echo, 1, axis) + 2 * echo + np.roll(echo, -1, axis)) / np.float32(4)
        squares += echo**2
    return np.sqrt(squares * np.float32(4 / np.pi) / squares.mean())
