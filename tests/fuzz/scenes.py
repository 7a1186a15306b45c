"""Scenes of any size and magnitude: images are finite, and the exact one is within the certified one's bound."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import wvr

CLEAR = (ValueError, TypeError, MemoryError)


class Scenes:
    def __init__(self, folder: Path):
        pass

    def run(self, rng: np.random.Generator) -> str:
        """Render one twice."""
        try:
            volume, tf, camera = _volume(rng), _transfer_function(rng), None
            camera = _camera(volume, rng)
            image = wvr.render(volume, tf, camera, (6, 5), tolerance=float(10 ** rng.uniform(-5, -1)), device="cpu")
            exact = wvr.render(volume, tf, camera, (6, 5), integrator=wvr.Exact(), device="cpu")
        except CLEAR as error:
            return "" if str(error) else f"unclear: an empty {type(error).__name__}"
        if not (
            np.isfinite(image.rgba).all() and np.isfinite(image.error_bound).all() and np.isfinite(exact.rgba).all()
        ):
            return "wrong: an image is not finite"
        off = np.abs(image.rgba.astype(float) - exact.rgba).max(axis=-1) - image.error_bound
        # Both were rounded, and the exact one is as exact as its own termination.
        brightest = max(1.0, float(tf.colors.max()))
        return "" if off.max() <= 2e-6 * brightest else f"wrong: {off.max():.3g} beyond the bound"


def _volume(rng: np.random.Generator) -> wvr.Volume:
    shape = rng.integers(1, 7, 3)
    kind = rng.integers(3)
    kinds = (rng.random(shape), np.indices(shape).sum(axis=0) / 12, rng.random(shape) < 0.5)
    # For every dtype there are kernels to be compiled: it is one.
    array = np.float32(kinds[kind] * (255.0 if rng.random() < 0.5 else 10.0 ** rng.uniform(-20, 20)))
    spacing = 10.0 ** (rng.uniform(-30, 30) + rng.uniform(-3, 3, 3))
    direction = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return wvr.Volume(array, spacing, rng.normal(size=3) * spacing * 100, direction)


def _transfer_function(rng: np.random.Generator) -> wvr.TransferFunction:
    n = int(rng.integers(2, 6))
    scalars = np.sort(rng.random(n)) * rng.choice([1.0, 255.0, 1e6])
    if rng.random() < 0.3:
        scalars[1:] = np.where(rng.random(n - 1) < 0.3, scalars[:-1], scalars[1:])
    opacity = np.where(rng.random(n) < 0.3, rng.integers(0, 2, n), rng.random(n))
    unit = None if rng.random() < 0.5 else float(10 ** rng.uniform(-30, 30))
    return wvr.TransferFunction.from_arrays(np.sort(scalars), rng.random((n, 3)), opacity, unit_distance=unit)


def _camera(volume: wvr.Volume, rng: np.random.Generator) -> wvr.Camera:
    middle, size = volume.corners.mean(axis=0), float(np.ptp(volume.corners, axis=0).max())
    position = middle + rng.normal(size=3) * size * 10 ** rng.uniform(-2, 3)
    target = middle + rng.normal(size=3) * size * 0.3
    if rng.random() < 0.3:
        return wvr.Camera(position, target, rng.normal(size=3), parallel_scale=size * float(rng.random()))
    return wvr.Camera(position, target, rng.normal(size=3), float(rng.uniform(1, 120)))
