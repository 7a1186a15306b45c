"""A marcher written by hand for AVX-512, ``marcher.cpp``: what a processor can do at most, with no error bound."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from studies.base.peer import NotAvailableError
from studies.base.scenes import Scene

SOURCE = Path(__file__).with_name("marcher.cpp")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC", "-c")
# Table entries a grey level, pixels along a tile, cells along a block.
FINE, TILE, BLOCK = 16, 4, 8
CLEAR = 1 / 1024


class Marcher:
    """A scene of uint8 samples whose axes, spacing and origin are those of indices.

    Raises
    ------
    NotAvailableError
        Without g++ or AVX-512.
    """

    def __init__(self, scene: Scene, step: float, threads: int, folder: Path):
        self._march = _library(folder).march
        self._step, self._pool, self._threads = step, ThreadPoolExecutor(threads), threads
        samples = scene.volume.numpy()
        self._samples = np.concatenate([samples.ravel(), np.zeros(64, np.uint8)])
        self._size = np.array(samples.shape[::-1], np.int32)
        scalars = np.arange(255 * FINE + 1) / FINE
        tf = scene.transfer_function
        opacity = -np.expm1(-tf.extinction(scalars, 1.0) * step)
        self._table = np.array([*tf.color(scalars).T * opacity, opacity], np.float32, order="C")
        self._seen = np.concatenate([_seen(samples, opacity[::FINE] > 0).ravel(), np.zeros(64, np.uint8)])
        width, height = scene.size
        origins, directions = scene.camera.rays(scene.size)
        both = np.concatenate([np.broadcast_to(origins, directions.shape), directions], axis=-1)
        tiled = both.reshape(height // TILE, TILE, width // TILE, TILE, 6).transpose(0, 2, 4, 1, 3)
        self._rays = np.ascontiguousarray(tiled, np.float32).reshape(-1, 6, TILE * TILE)
        self._shape = (height // TILE, width // TILE)

    def render(self) -> NDArray[np.float32]:
        """Premultiplied RGBA (height, width, 4)."""
        tiles = len(self._rays)
        image = np.empty((tiles, 4, TILE * TILE), np.float32)
        ends = np.linspace(0, tiles, 16 * self._threads + 1).astype(int)

        def part(ends: tuple[int, int]) -> None:
            arrays = (self._samples, self._size, self._seen, self._table)
            pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]
            rays, to = (array.ctypes.data_as(ctypes.c_void_p) for array in (self._rays, image))
            numbers = [ctypes.c_float(x) for x in (FINE, self._step, CLEAR)]
            self._march(*pointers, self._table.shape[1], numbers[0], rays, *map(int, ends), *numbers[1:], to)

        list(self._pool.map(part, pairwise(ends)))
        rows, columns = self._shape
        whole = image.reshape(rows, columns, 4, TILE, TILE).transpose(0, 3, 1, 4, 2)
        return whole.reshape(rows * TILE, columns * TILE, 4)


def _seen(samples: NDArray[np.uint8], visible: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Blocks of which some sample, or one between two of a cell, may have extinction: 255."""
    # With a level between two that are visible or not, all between them are asked.
    high = maximum_filter(samples, 2, origin=-1)
    low = 255 - maximum_filter(255 - samples, 2, origin=-1)
    before = np.concatenate([[0], np.cumsum(visible)])
    cells = before[high.astype(int) + 1] > before[low.astype(int)]
    # Between two levels there is extinction if either has some.
    shape = [-(-(n - 1) // BLOCK) * BLOCK for n in samples.shape]
    padded = np.zeros(shape, bool)
    inner = tuple(slice(0, n - 1) for n in samples.shape)
    padded[inner] = cells[inner]
    blocks = padded.reshape(shape[0] // BLOCK, BLOCK, shape[1] // BLOCK, BLOCK, shape[2] // BLOCK, BLOCK)
    return np.where(blocks.any(axis=(1, 3, 5)), np.uint8(255), np.uint8(0))


def _library(folder: Path) -> Any:
    compiler = shutil.which("g++")
    if compiler is None:
        raise NotAvailableError("there is no g++")
    folder.mkdir(parents=True, exist_ok=True)
    library = (folder / "marcher.so").resolve()
    if not library.exists() or library.stat().st_mtime < SOURCE.stat().st_mtime:
        # Linked without -ffast-math: what that adds has the whole process round small numbers to 0 from then on.
        made = library.with_suffix(".o")
        for flags in ((*FLAGS, "-o", made, SOURCE), ("-shared", "-o", library, made)):
            result = subprocess.run([compiler, *flags], capture_output=True, text=True)
            if result.returncode:
                raise NotAvailableError(result.stderr.strip().splitlines()[0] if result.stderr else "g++ failed")
    return ctypes.CDLL(str(library))
