"""The scenes that the benchmarks render, and their true images in float64 on a random subset of pixels.

Smooth blobs, 256^3 uint8, spacing 1 and origin 0: world and index coordinates are the same. S1 is semi-transparent and
about two thirds empty, S2 fog everywhere, S3 three opacity spikes two grey levels wide, which rays sampled once a voxel
step over.
"""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import wvr
from studies.base import reference
from studies.base.scenes import Scene
from wvr.files import whole_file

Floats = NDArray[np.float64]

GREY = np.arange(256.0)
# The reference's cell pieces are halved until no channel of any pixel moves more than this.
CONVERGED = 1e-4
SEED = 0


@dataclass(frozen=True)
class Truth:
    """Premultiplied RGBA (n, 4) of the pixels with flat indices ``pixels`` (n,)."""

    pixels: NDArray[np.int64]
    rgba: Floats
    parts: int  # of a ray's piece in a cell
    change: float  # of any channel against half as many parts

    def errors(self, rgba: NDArray) -> dict[str, float]:
        """Largest and mean absolute error of an image over all channels of the pixels."""
        error = np.abs(rgba.reshape(-1, 4)[self.pixels].astype(np.float64) - self.rgba)
        return {"max error": float(error.max()), "mean error": float(error.mean())}


def transfer_functions() -> dict[str, wvr.TransferFunction]:
    """By scene: control points at every grey level, opacities a voxel."""
    x = GREY / 255
    rgb = np.stack([0.1 + 0.9 * x, 0.2 + 0.5 * x, 0.9 - 0.7 * x], axis=-1)
    ramp = np.clip((GREY - 107) / 148, 0, 1)  # a third of the voxels are above
    opacities = {
        "S1": 0.05 * ramp**2 * (3 - 2 * ramp),
        "S2": 0.004 + 0.026 * x,
        "S3": np.where(np.isin(GREY, (90, 140, 200)), 0.6, 0.0),
    }
    return {name: wvr.TransferFunction.from_arrays(GREY, rgb, opacity) for name, opacity in opacities.items()}


def make_scenes(quick: bool = False) -> list[Scene]:
    """S1, S2 and S3, each with a parallel and a perspective camera; ``quick``: small ones for tests."""
    volume = wvr.datasets.load("blobs", 32 if quick else 256)
    size = (48, 48) if quick else (512, 512)
    return [
        Scene(name, volume, transfer_function, wvr.Camera.fit(volume, parallel=parallel), size)
        for name, transfer_function in transfer_functions().items()
        for parallel in (True, False)
    ]


def truth(scene: Scene, count: int, folder: Path) -> Truth:
    """The reference of ``count`` random pixels, kept in ``folder``."""
    width, height = scene.size
    pixels = np.sort(np.random.default_rng(SEED).choice(width * height, min(count, width * height), replace=False))
    identity = hashlib.sha256(scene.volume.numpy().tobytes() + scene.transfer_function.key)
    identity.update(f"{scene.camera!r} {scene.size} {count} {SEED} {CONVERGED}".encode())
    path = folder / f"reference-{identity.hexdigest()[:16]}.npz"
    if path.exists():
        with np.load(path) as kept:
            return Truth(pixels, kept["rgba"], int(kept["parts"]), float(kept["change"]))
    result = _converged(scene, pixels)
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as file:
        np.savez(file, rgba=result.rgba, parts=result.parts, change=result.change)
    return result


def _converged(scene: Scene, pixels: NDArray[np.int64]) -> Truth:
    result = Truth(pixels, _integrate(scene, pixels, 4), 4, np.inf)
    while result.change > CONVERGED:
        finer = _integrate(scene, pixels, 2 * result.parts)
        change = float(np.abs(finer - result.rgba).max())
        result = replace(result, rgba=finer, parts=2 * result.parts, change=change)
    return result


def _integrate(scene: Scene, pixels: NDArray[np.int64], parts: int) -> Floats:
    origins, directions = (rays.reshape(-1, 3)[pixels] for rays in scene.camera.rays(scene.size))

    def integrate(rows: NDArray[np.int64]) -> Floats:
        return reference.integrate(
            scene.volume, scene.transfer_function, origins[rows], directions[rows], parts, not scene.camera.parallel
        )

    with ThreadPoolExecutor(wvr.get_num_threads()) as pool:
        pieces = np.array_split(np.arange(len(pixels)), 8 * wvr.get_num_threads())
        return np.concatenate(list(pool.map(integrate, pieces)))
