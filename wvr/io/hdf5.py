"""HDF5, by h5py: the data set of three axes, or four with time, or that of a name."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cancel import aside
from ..samples import Grid, Unsupported
from .bytes import Flaw, corrupt, empty, needs, opened
from .conventions import meaning_of, text_of
from .coordinates import Axis, places, spatial
from .npy import pick

# Spacing in micrometres, slowest axis first, as ilastik and Fiji write it.
SPACING = "element_size_um"
# Which axes are which, as ilastik writes it.
TAGS = "axistags"
# What netCDF calls a dimension without coordinates.
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"
# What to do about coordinates that are not equally spaced.
ADVICE = "resample the data, or draw them as if they were: wvr.open(path, spacing=...)"
# Filters that the library unpacks without a look at how much there is.
FRAIL = {5: "nbit", 6: "scaleoffset"}


def read_hdf5(path: Path, name: str | None) -> Grid:
    with opened_hdf5(path) as file:
        names = names_of(path, file, (3, 4))
        data = data_of(path, file, pick(path, None if name is None else name.strip("/"), names))
        with corrupt(path):
            array = empty(data.shape, data.dtype, path.stat().st_size, "image")
            aside(data.read_direct, array)
            array = meaning_of(data.attrs, data.dtype, data.fillvalue).all_values(array)
            axes = spatial(names_of_axes(data) or [""] * array.ndim)
            array = array.transpose([n for n in range(array.ndim) if n not in axes] + axes)
            steps, origin = spacing_of(data, axes), np.zeros(3)
            if steps is None:
                steps, origin = places([axis_of(path, file, data, axis) for axis in reversed(axes)], ADVICE)
    return Grid(array, np.diag(steps), origin, "", (path,))


@contextmanager
def opened_hdf5(path: Path) -> Iterator[Any]:
    """The file, by h5py."""
    with needs("h5py", "HDF5", "hdf5"):
        import h5py

    with opened(path) as file:
        start = file.read(8)
        if start[:3] == b"CDF":
            raise Unsupported("it is netCDF 3, not 4: nccopy -k nc4, or wvr.open(xarray.open_dataset(path))")
        if start != b"\x89HDF\r\n\x1a\n":
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


def spacing_of(data: Any, axes: Sequence[int]) -> NDArray[np.float64] | None:
    """Along x, y, z, of which axes are z, y, x; None where it is not said."""
    if SPACING not in data.attrs:
        return None
    spacing = np.ravel(np.asarray(data.attrs[SPACING], np.float64))
    # Of all axes, or of these alone, as they are stored.
    of = range(data.ndim) if len(spacing) == data.ndim else sorted(axes)
    spacing = spacing[-len(of) :]
    if len(spacing) != len(of) or not np.all(spacing > 0) or not np.all(np.isfinite(spacing)):
        raise Flaw(f"its {SPACING} must be three numbers > 0, got {spacing.tolist()}")
    return spacing[[of.index(axis) for axis in reversed(axes)]]


def names_of_axes(data: Any) -> list[str] | None:
    """By its dimension scales, as those of netCDF are, or labels, or as ilastik says; None where it has none."""
    names = [str(dim[0].name).rpartition("/")[2] if len(dim) else dim.label for dim in data.dims]
    if any(names):
        names = [name or f"axis{n}" for n, name in enumerate(names)]
    else:
        with suppress(ValueError, TypeError, KeyError):
            names = [str(axis["key"]) for axis in json.loads(text_of(data.attrs, TAGS))["axes"]]
    return names if len(set(names)) == len(names) == data.ndim else None


def axis_of(path: Path, file: Any, data: Any, number: int) -> Axis:
    """An axis by its dimension scale, which netCDF writes as long as there is something of it."""
    with corrupt(path):
        dim, count = data.dims[number], data.shape[number]
        scale = dim[0] if len(dim) else None
        if scale is None or scale.ndim != 1 or scale.dtype.kind not in "iuf":
            return Axis(dim.label)
        if NO_VARIABLE in text_of(scale.attrs, "NAME"):
            return Axis(dim.label)
        if not scale.id.get_storage_size():
            # Never written.
            return Axis(scale.name.rpartition("/")[2], np.full(count, np.nan))
        held = data_of(path, file, scale.name)
        values = meaning_of(held.attrs, held.dtype, held.fillvalue).all_values(held[:count])
        if len(values) < count:
            values = np.append(values, np.full(count - len(values), np.nan))
        return Axis(scale.name.rpartition("/")[2], values, text_of(held.attrs, "units"))


def _check_held(data: Any) -> None:
    """Where a chunk is not there, the library makes up what it would have held."""
    if data.chunks is None:
        if data.id.get_storage_size() < math.prod(data.shape) * data.dtype.itemsize:
            raise Flaw("some of its samples are missing")
        return
    chunks = [-(-n // chunk) for n, chunk in zip(data.shape, data.chunks, strict=True)]
    if data.id.get_num_chunks() != math.prod(chunks):
        raise Flaw("some of its chunks are missing")
