"""Files whose samples are read where they lie: HDF5, and those that are mapped into memory (.npy, .nii, raw)."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import regular
from ..io.bytes import corrupt, layout_of, opened
from ..io.hdf5 import data_of, names_of, opened_hdf5, spacing_of
from ..io.nifti import layout
from ..io.npy import LONGEST, header_of
from .arrays import named, of_array, placed
from .stored import StoredVolume


class Hdf5:
    """A data set of an HDF5 file, opened where it is read first: in each process of its own."""

    def __init__(self, path: str, name: str):
        self.path, self.name = str(Path(path).resolve()), name.strip("/")
        with opened_hdf5(Path(path)) as file:
            data = data_of(Path(path), file, self.name)
            with corrupt(Path(path)):
                self.shape, self.dtype, self.chunks = data.shape, data.dtype, data.chunks
                self.spacing = spacing_of(data)
        self._file: Any = None

    def __getitem__(self, key: tuple) -> NDArray:
        import h5py

        if self._file is None:
            self._file = h5py.File(self.path, "r")
        return self._file[self.name][key]

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_file": None}


def hdf5_name(path: str, scalars: str | None) -> str:
    with opened_hdf5(Path(path)) as file:
        return named(names_of(Path(path), file, range(3, 33)), scalars, path)


def hdf5(array: Hdf5, selection: dict) -> StoredVolume:
    volume = of_array(array, f"{array.path}:{array.name}", array.chunks, selection, marks=FileMark(array.path))
    return placed(volume, array.spacing, np.zeros(3))


class FileMark:
    """What tells whether a file changed."""

    def __init__(self, path: str):
        self.path = path

    def __call__(self) -> Callable[[Any], str]:
        found = os.stat(self.path)
        text = f"{found.st_size:x}.{found.st_mtime_ns:x}"[-16:]
        return lambda spans: text


class Mapped:
    """Bare samples of a file, mapped where they are read first: in each process of its own."""

    def __init__(self, path: str, dtype: Any, shape: tuple[int, ...], offset: int = 0, order: str = "C"):
        self.path, self.dtype, self.shape = str(Path(path).resolve()), np.dtype(dtype), tuple(map(int, shape))
        self.offset, self.order = offset, order
        held, size = os.path.getsize(path), offset + math.prod(self.shape) * self.dtype.itemsize
        if held < size:
            raise OSError(f"{path} has {held} bytes, {self.shape} samples of {self.dtype} are {size}: it is cut short")
        self._map: Any = None

    def __getitem__(self, key: tuple) -> NDArray:
        if self._map is None:
            order: Any = self.order
            self._map = np.memmap(self.path, self.dtype, "r", self.offset, self.shape, order)
        return self._map[key]

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_map": None}


def mapped(path: str, raw: tuple, selection: dict) -> StoredVolume:
    shape, dtype, offset = raw
    if path.lower().endswith(".npy") and shape is None and dtype is None:
        with opened(Path(path)) as file:
            head = header_of(file.read(LONGEST))
            array = Mapped(path, head.dtype, head.shape, head.length, "F" if head.fortran else "C")
    else:
        if shape is None or dtype is None:
            raise ValueError("shape and dtype are for raw files, and go together")
        counts, kind = layout_of(shape, dtype, offset)
        regular(Path(path))
        array = Mapped(path, kind, counts, offset)
    return of_array(array, path, None, selection, marks=FileMark(array.path))


def nifti(path: Path, selection: dict) -> StoredVolume:
    data, dtype, dims, start, slope, intercept, (steps, origin) = layout(path)
    with corrupt(path):
        array = Mapped(str(data), dtype, dims, start, "F")
    names = ["x", "y", "z", "t", "u", "v", "w"][: len(dims)]
    volume = of_array(array, str(path), None, selection, names, scale=(slope, intercept), marks=FileMark(array.path))
    result = placed(volume, steps, origin)
    result.anatomical = "RAS"
    return result
