"""HDF5, by h5py: the data set of three axes, or four with time, or that of a name."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, Unsupported
from .bytes import Flaw, corrupt, empty, needs, opened
from .npy import pick

# Spacing in micrometres, slowest axis first, as ilastik and Fiji write it.
SPACING = "element_size_um"
# Filters that the library unpacks without a look at how much there is.
FRAIL = {5: "nbit", 6: "scaleoffset"}


def read_hdf5(path: Path, name: str | None) -> Grid:
    with opened_hdf5(path) as file:
        names = names_of(path, file, (3, 4))
        data = data_of(path, file, pick(path, None if name is None else name.strip("/"), names))
        with corrupt(path):
            array = empty(data.shape, data.dtype, path.stat().st_size, "image")
            data.read_direct(array)
            spacing = spacing_of(data)
    return Grid(array, np.diag(spacing), np.zeros(3), "", (path,))


@contextmanager
def opened_hdf5(path: Path) -> Iterator[Any]:
    """The file, by h5py."""
    with needs("h5py", "HDF5", "hdf5"):
        import h5py

    with opened(path) as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            raise Flaw("no HDF5 signature at its start")
    with corrupt(path):
        found = h5py.File(path, "r")
    with found:
        yield found


def names_of(path: Path, file: Any, axes: Container[int]) -> list[str]:
    """Of its data sets of numbers with so many axes."""
    names: list[str] = []

    def listed(name: str, item: Any) -> None:
        numbers = hasattr(item, "shape") and item.shape is not None and item.dtype.kind in "biufc"
        if numbers and len(item.shape) in axes:
            names.append(name)

    with corrupt(path):
        # Links out of the file are not followed.
        file.visititems(listed)
    return names


def data_of(path: Path, file: Any, name: str) -> Any:
    """A data set of which all samples are in the file."""
    with corrupt(path):
        data = file[name]
        if data.external is not None or data.is_virtual:
            raise Flaw(f"the samples of {name!r} are in other files: copy them into one")
        made = data.id.get_create_plist()
        for number in range(made.get_nfilters()):
            if (packed := FRAIL.get(made.get_filter(number)[0])) is not None:
                raise Unsupported(
                    f"{name!r} is packed by {packed}, in which damaged files end the process: h5repack -f GZIP=4"
                )
        _check_held(data)
        return data


def spacing_of(data: Any) -> NDArray[np.float64]:
    """Along x, y, z."""
    spacing = np.ravel(np.asarray(data.attrs.get(SPACING, (1.0, 1.0, 1.0)), np.float64))[::-1][:3]
    if spacing.shape != (3,) or not np.all(spacing > 0) or not np.all(np.isfinite(spacing)):
        raise Flaw(f"its {SPACING} must be three numbers > 0, got {spacing[::-1].tolist()}")
    return spacing


def _check_held(data: Any) -> None:
    """Where a chunk is not there, the library makes up what it would have held."""
    if data.chunks is None:
        if data.id.get_storage_size() < math.prod(data.shape) * data.dtype.itemsize:
            raise Flaw("some of its samples are missing")
        return
    chunks = [-(-n // chunk) for n, chunk in zip(data.shape, data.chunks, strict=True)]
    if data.id.get_num_chunks() != math.prod(chunks):
        raise Flaw("some of its chunks are missing")
