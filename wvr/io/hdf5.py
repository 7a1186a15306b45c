"""HDF5, by h5py: the data set of three axes, or four with time, or that of a name."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..samples import Grid
from .bytes import Flaw, corrupt, empty, needs, opened
from .npy import pick

# Spacing in micrometres, slowest axis first, as ilastik and Fiji write it.
SPACING = "element_size_um"


def read_hdf5(path: Path, name: str | None) -> Grid:
    with needs("h5py", "HDF5", "hdf5"):
        import h5py

    size = 0
    with opened(path) as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            raise Flaw("no HDF5 signature at its start")
        size = path.stat().st_size
    with corrupt(path):
        found = h5py.File(path, "r")
    with found as file:
        names: list[str] = []
        with corrupt(path):
            # Links out of the file are not followed.
            file.visititems(lambda found, item: _listed(names, found, item))
        chosen = pick(path, None if name is None else name.strip("/"), names)
        with corrupt(path):
            data = file[chosen]
            if data.external is not None or data.is_virtual:
                raise Flaw(f"the samples of {chosen!r} are in other files: copy them into one")
            _check_held(data)
            array = empty(data.shape, data.dtype, size, "image")
            data.read_direct(array)
            spacing = np.ravel(np.asarray(data.attrs.get(SPACING, (1.0, 1.0, 1.0)), np.float64))[::-1][:3]
            if spacing.shape != (3,):
                raise Flaw(f"its {SPACING} must be three numbers, got {spacing.tolist()}")
    return Grid(array, np.diag(spacing), np.zeros(3), "", (path,))


def _listed(names: list[str], name: str, item: Any) -> None:
    if hasattr(item, "shape") and item.shape is not None and len(item.shape) in (3, 4) and item.dtype.kind in "biufc":
        names.append(name)


def _check_held(data: Any) -> None:
    """Where a chunk is not there, the library makes up what it would have held."""
    if data.chunks is None:
        if data.id.get_storage_size() < math.prod(data.shape) * data.dtype.itemsize:
            raise Flaw("some of its samples are missing")
        return
    chunks = [-(-n // chunk) for n, chunk in zip(data.shape, data.chunks, strict=True)]
    if data.id.get_num_chunks() != math.prod(chunks):
        raise Flaw("some of its chunks are missing")
