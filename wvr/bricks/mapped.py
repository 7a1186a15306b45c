"""Files whose samples are read where they lie: HDF5, and those that are mapped into memory (.npy, .nii, raw)."""

from __future__ import annotations

import math
import os
from hashlib import blake2b
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files import regular
from ..io.bytes import corrupt, layout_of, opened
from ..io.conventions import Meaning, meaning_of
from ..io.hdf5 import axis_of, data_of, names_of, names_of_axes, opened_hdf5, spacing_of
from ..io.nifti import layout
from ..io.npy import LONGEST, header_of
from .arrays import named, of_array, placed, placed_by
from .stored import Marked, StoredVolume


def stamp(path: str) -> tuple[int, ...]:
    """What tells a file from the one that was there before, written anew or replaced."""
    found = os.stat(path)
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


class Hdf5:
    """A data set of an HDF5 file, opened where it is read first, and again once the file is another: in each process of
    its own.
    """

    def __init__(self, path: str, name: str):
        self.path, self.name = str(Path(path).resolve()), name.strip("/")
        with opened_hdf5(Path(path)) as file:
            data = data_of(Path(path), file, self.name)
            with corrupt(Path(path)):
                self.shape, self.dtype, self.chunks = data.shape, data.dtype, data.chunks
                self.meaning = meaning_of(data.attrs, data.dtype, data.fillvalue)
                self.names = names_of_axes(data)
        self._shut()

    def _shut(self) -> None:
        self._file: Any = None
        self._stamp: tuple[int, ...] = ()
        self._lock = Lock()

    def __getitem__(self, key: tuple) -> NDArray:
        import h5py

        with self._lock:
            now = stamp(self.path)
            if self._file is None or self._stamp != now:
                if self._file is not None:
                    self._file.close()
                self._file, self._stamp = h5py.File(self.path, "r"), now
            data = self._file[self.name]
            if data.shape != self.shape or data.dtype != self.dtype:
                raise OSError(
                    f"{self.path} was replaced: {self.name} was {self.shape} {self.dtype}, is {data.shape} {data.dtype}"
                )
            return data[key]

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in ("_file", "_stamp", "_lock")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._shut()


def hdf5_name(path: str, scalars: str | None) -> str:
    with opened_hdf5(Path(path)) as file:
        return named(names_of(Path(path), file, range(3, 33)), scalars, path)


def hdf5(array: Hdf5, selection: dict) -> StoredVolume:
    name, mark = f"{array.path}:{array.name}", FileMark(array.path)
    volume = of_array(array, name, array.chunks, selection, array.names, meaning=array.meaning, marks=mark)
    path = Path(array.path)
    with opened_hdf5(path) as file:
        data = data_of(path, file, array.name)
        with corrupt(path):
            spacing = spacing_of(data, volume.samples.axes)
        if spacing is not None:
            return placed(volume, spacing, np.zeros(3))
        return placed_by(volume, lambda axis: axis_of(path, file, data, axis))


class FileMark:
    """What tells whether a file changed: a digest of its size and time."""

    def __init__(self, path: str):
        self.path = path

    def __call__(self) -> Marked:
        found = os.stat(self.path)
        text = blake2b(f"{found.st_size} {found.st_mtime_ns}".encode(), digest_size=8).hexdigest()
        return lambda spans: np.full([len(along) for along in spans], text, "U16")


class Mapped:
    """Bare samples of a file, mapped where they are read first, and again once the file is another: in each process of
    its own.
    """

    def __init__(
        self, path: str, dtype: Any, shape: tuple[int, ...], offset: int = 0, order: str = "C", headed: bool = False
    ):
        self.path, self.dtype, self.shape = str(Path(path).resolve()), np.dtype(dtype), tuple(map(int, shape))
        self.offset, self.order, self.headed = offset, order, headed
        self._size = offset + math.prod(self.shape) * self.dtype.itemsize
        self._held(os.path.getsize(path))
        self._head = self._headed()
        self._map: Any = None
        self._stamp: tuple[int, ...] = ()

    def _headed(self) -> bytes:
        """A digest of what is before the samples, where that says how they lie."""
        with open(self.path, "rb") as file:
            return blake2b(file.read(self.offset)).digest() if self.headed else b""

    def _held(self, held: int) -> None:
        """What lies beyond the end of a file that is mapped ends the process that looks at it."""
        if held < self._size:
            raise OSError(
                f"{self.path} has {held} bytes, {self.shape} samples of {self.dtype} are {self._size}: it is cut short"
            )

    def __getitem__(self, key: tuple) -> NDArray:
        now = stamp(self.path)
        if self._map is None or self._stamp != now:
            self._held(now[2])
            if self._headed() != self._head:
                raise OSError(f"{self.path} was replaced by one with another header: open it anew")
            order: Any = self.order
            self._map, self._stamp = np.memmap(self.path, self.dtype, "r", self.offset, self.shape, order), now
        return self._map[key]

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_map": None}


def mapped(path: str, raw: tuple, selection: dict) -> StoredVolume:
    shape, dtype, offset = raw
    if path.lower().endswith(".npy") and shape is None and dtype is None:
        with opened(Path(path)) as file:
            head = header_of(file.read(LONGEST))
            array = Mapped(path, head.dtype, head.shape, head.length, "F" if head.fortran else "C", headed=True)
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
        array = Mapped(str(data), dtype, dims, start, "F", headed=data == path)
    names = ["x", "y", "z", "t", "u", "v", "w"][: len(dims)]
    volume = of_array(
        array, str(path), None, selection, names, meaning=Meaning(slope, intercept), marks=FileMark(array.path)
    )
    result = placed(volume, steps, origin)
    result.anatomical = "RAS"
    return result
