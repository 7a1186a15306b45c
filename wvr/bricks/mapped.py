"""Files whose samples are read where they lie: HDF5, and those that are mapped into memory (.npy, .nii, raw)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..io.bytes import layout_of, needs
from ..io.hdf5 import SPACING
from .arrays import named, of_array, placed
from .stored import StoredVolume


class Hdf5:
    """A data set of an HDF5 file, opened where it is read first: in each process of its own."""

    def __init__(self, path: str, name: str):
        with needs("h5py", "HDF5", "distributed"):
            import h5py
        self.path, self.name = str(Path(path).resolve()), name.strip("/")
        with h5py.File(self.path, "r") as file:
            data = file[self.name]
            self.shape, self.dtype, self.chunks = data.shape, data.dtype, data.chunks
            spacing = np.ravel(np.asarray(data.attrs.get(SPACING, (1.0, 1.0, 1.0)), np.float64))[::-1][:3]
        self.spacing = spacing if spacing.shape == (3,) and np.all(spacing > 0) else np.ones(3)
        self._file: Any = None

    def __getitem__(self, key: tuple) -> NDArray:
        import h5py

        if self._file is None:
            self._file = h5py.File(self.path, "r")
        return self._file[self.name][key]

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_file": None}


def hdf5_name(path: str, scalars: str | None) -> str:
    with needs("h5py", "HDF5", "distributed"):
        import h5py
    names: list[str] = []

    def listed(name: str, item: Any) -> None:
        if getattr(item, "shape", None) is not None and len(item.shape) >= 3 and item.dtype.kind in "biuf":
            names.append(name)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(listed)
    except OSError as error:
        raise OSError(f"{path} could not be opened as HDF5: {error}") from error
    return named(names, scalars, path)


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
        held, size = os.path.getsize(path), offset + int(np.prod(self.shape)) * self.dtype.itemsize
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
        try:
            opened: Any = np.load(path, mmap_mode="r", allow_pickle=False)
        except ValueError as error:
            raise OSError(f"{path} could not be mapped: {error}") from error
        order = "F" if opened.flags.f_contiguous and not opened.flags.c_contiguous else "C"
        array = Mapped(path, opened.dtype, opened.shape, opened.offset, order)
    else:
        if shape is None or dtype is None:
            raise ValueError("shape and dtype are for raw files, and go together")
        counts, kind = layout_of(shape, dtype, offset)
        array = Mapped(path, kind, counts, offset)
    return of_array(array, path, None, selection, marks=FileMark(array.path))


def nifti(path: Path, selection: dict) -> StoredVolume:
    import nibabel
    from nibabel.filebasedimages import ImageFileError

    from ..io.nifti import place_of

    try:
        image: Any = nibabel.load(path)
        head = image.header
        steps, origin = place_of(path, head)
    except ImageFileError as error:
        raise OSError(f"{path} could not be opened as NIfTI: {error}") from error
    shape = tuple(int(n) for n in head.get_data_shape())
    array = Mapped(str(path), head.get_data_dtype(), shape, int(image.dataobj.offset), "F")
    names = ["x", "y", "z", "t", "u", "v", "w"][: len(shape)]
    slope, intercept = float(image.dataobj.slope), float(image.dataobj.inter)
    scale = (slope or 1.0, intercept if slope else 0.0)
    volume = of_array(array, str(path), None, selection, names, scale=scale, marks=FileMark(array.path))
    result = placed(volume, steps, origin)
    result.anatomical = "RAS"
    return result
