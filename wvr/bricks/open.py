"""Stores of all kinds as volumes that are read as they are seen: ``wvr.open``, and ``wvr.build_ranges``."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..io.bytes import needs
from ..io.conventions import XARRAY, meaning_of_zarr, text_of
from ..io.coordinates import Axis
from ..io.space import in_units_of_first
from ..notices import announce
from ..samples import NanPolicy, Unsupported
from ..sources import axis_of, decoded
from ..validation import path_of
from .arrays import named, of_array, placed, placed_by
from .mapped import Hdf5, hdf5, hdf5_name, mapped, nifti
from .ranges import attach, build, sidecar
from .reading import active_client, checked_client
from .stored import Marked, StoredVolume

Place = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
HDF5 = (".h5", ".hdf5", ".hdf", ".nc", ".nc4")


def open(
    store: Any,
    level: int | None = None,
    *,
    scalars: str | None = None,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    shape: tuple[int, int, int] | None = None,
    dtype: Any = None,
    offset: int = 0,
    nan: NanPolicy = "error",
    ranges: str | os.PathLike[str] | None = None,
    **selection: int | str,
) -> StoredVolume:
    """A volume whose samples stay where they are, and are read as they are seen.

    Parameters
    ----------
    store
        - a zarr array (version 2 or 3) or an OME-Zarr pyramid: a path, a URL that fsspec opens, a ``zarr.Array`` or
          ``zarr.Group``;
        - a ``dask.array``, or any array with chunks that is sliced as NumPy's are;
        - an xarray ``DataArray`` or ``Dataset``: dimensions by name, coordinates that are equally spaced;
        - an HDF5 or netCDF 4 file, or an ``h5py.Dataset``; as in Zarr, fills, valid ranges, slopes and signs are
          applied as the conventions of netCDF have them, and missing samples are NaN;
        - a .npy, .nii or (with ``shape`` and ``dtype``) raw file, mapped into memory; a ``numpy.memmap``.
    level
        Of a pyramid: 0, the default, is the finest one.
    scalars
        Array of a group, variable of a dataset, or data set of a file, with several.
    spacing, origin
        As of :class:`wvr.Volume`; by default those that the store says.
    shape, dtype, offset
        Samples along z, y, x of a raw file, their type and the bytes before them.
    nan
        ``"error"``, for NaN or infinite samples where they are read, or ``"transparent"``.
    ranges
        File of :func:`wvr.build_ranges`; by default the one beside the store, if it is there.
    **selection
        Index along each axis that is not x, y or z, by its name (``t=3``, ``c=0``); of xarray also a label, as text;
        axes of one index need none.

    Raises
    ------
    OSError
        Where it cannot be opened.
    ValueError
        For a level, name or axis that is not there, and for axes of several indices that are not selected.
    TypeError
        For anything else, and for samples that are no numbers.
    ImportError
        Where a package is missing: ``pip install 'wvr[distributed]'`` has all.

    Examples
    --------
    >>> import numpy as np, wvr
    >>> volume = wvr.open(np.zeros((300, 200, 100), np.uint8), spacing=(1, 1, 2))
    >>> volume.shape, volume.blocks_along
    ((300, 200, 100), (1, 2, 3))
    """
    raw = (shape, dtype, offset)
    if isinstance(store, str | os.PathLike):
        path_of(store, "store")
        volume, beside = _path(str(store), level, scalars, selection, raw)
    else:
        _has_no_use(f"a {type(store).__name__}", shape=shape, dtype=dtype, offset=offset or None)
        volume, beside = _object(store, level, scalars, selection)
    if volume.unplaced and spacing is None:
        raise ValueError(volume.unplaced)
    result = StoredVolume(
        volume.samples,
        volume.spacing if spacing is None else spacing,
        volume.origin if origin is None else origin,
        volume.direction,
        nan,
        volume.anatomical,
    )
    result.coarse, result.place = volume.coarse, beside
    if (coarse := volume.coarse) is not None:
        # Of the same policy, and where the volume is.
        coarse.nan = result.nan
        if spacing is not None or origin is not None:
            moved = result.index_to_world @ np.linalg.inv(volume.index_to_world) @ coarse.index_to_world
            result.coarse = placed(coarse, moved[:3, :3], moved[:3, 3])
    found = beside if ranges is None else path_of(ranges, "ranges")
    if found is not None and found.exists():
        attach(result, found)
    elif ranges is not None:
        raise FileNotFoundError(f"ranges must be a file of wvr.build_ranges, {str(ranges)!r} is not there")
    return result


def build_ranges(
    store: Any,
    output: str | os.PathLike[str] | None = None,
    *,
    client: Any = None,
    report: Callable[[int, int], None] | None = None,
    **options: Any,
) -> StoredVolume:
    """Find out the smallest and largest sample of each block of a store, once: what has nothing to see is then never
    read, and what was not read is in the bound of an image.

    All is read, a few blocks at a time. What is done is saved every ten seconds and at the end; called again, it goes
    on from there, and does anew what changed since (by sizes and times of files, where a store has such).

    Parameters
    ----------
    store
        As of :func:`wvr.open`, or a volume that it returned.
    output
        The file; by default beside the store, where :func:`wvr.open` finds it. Of what has no place, such as arrays,
        they are kept with the volume alone.
    client
        A ``distributed.Client`` whose workers read; by default one that is active, False is none.
    report
        Called with how many blocks are done, and how many there are.
    **options
        Of :func:`wvr.open`.

    Returns
    -------
    StoredVolume
        The volume with its ranges.

    Raises
    ------
    OSError
        Where a block cannot be read, or the file not be written.
    """
    if checked_client(client) is None:
        client = active_client()
    if report is not None and not callable(report):
        raise TypeError(f"report must be called with two numbers, got {report!r}")
    if isinstance(store, StoredVolume):
        if options:
            raise TypeError(
                f"{', '.join(options)}: keywords of wvr.open are for what it opens, store is a volume already"
            )
        volume = store
    else:
        volume = open(store, **options)
    path = volume.place if output is None else path_of(output, "output")
    volume.ranges = build(volume, path, client or None, report)
    vars(volume).pop("range", None)
    return volume


Opened = tuple[StoredVolume, Path | None]
# What has a use for a keyword.
USES = {"level": "pyramids (OME-Zarr)", "scalars": "stores with several arrays"}
USES |= dict.fromkeys(("shape", "dtype", "offset"), "raw files")


def _has_no_use(kind: str, **given: Any) -> None:
    """Refuse what is given, of a store that has no use for it."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} is for {USES[name]}, got {value!r} for {kind}")


def _path(name: str, level: int | None, scalars: str | None, selection: dict, raw: tuple) -> Opened:
    url = "://" in name
    path = Path(name)
    suffix = path.suffix.lower()
    if not url and not path.exists():
        raise FileNotFoundError(f"{name!r} is not there")
    layout = {"shape": raw[0], "dtype": raw[1], "offset": raw[2] or None}
    if not url and path.is_file():
        _has_no_use(repr(name), level=level)
        if suffix in HDF5:
            _has_no_use(repr(name), **layout)
            volume = hdf5(Hdf5(name, hdf5_name(name, scalars)), selection)
            return volume, sidecar(name, volume.samples.array.name, selection)
        _has_no_use(repr(name), scalars=scalars)
        if raw[0] is not None or raw[1] is not None or suffix == ".npy":
            return mapped(name, raw, selection), sidecar(name, selection=selection)
        _has_no_use(repr(name), **layout)
        if suffix == ".nii":
            return nifti(path, selection), sidecar(name, selection=selection)
        raise ValueError(
            f"store must be zarr, HDF5, .npy, .nii, or a raw file with shape and dtype, got {name!r}: wvr.read reads "
            f"other files, .nii.gz among them, as a whole"
        )
    _has_no_use(repr(name), **layout)
    with needs("zarr >= 3 (and that Python >= 3.11)", "zarr", "distributed"):
        import zarr
        import zarr.abc  # which zarr 2 has not
    with _sound(name):
        return _node(zarr.open(name, mode="r"), level, scalars, selection, None if url else path)


def _object(store: Any, level: int | None, scalars: str | None, selection: dict) -> Opened:
    module = type(store).__module__.partition(".")[0]
    if isinstance(store, StoredVolume):
        raise TypeError("store is a volume of wvr.open already")
    if module == "zarr":
        root = getattr(store.store, "root", None)
        return _node(store, level, scalars, selection, None if root is None else Path(root) / store.path)
    _has_no_use(f"a {type(store).__name__}", level=level)
    if module == "xarray":
        return _xarray(store, scalars, selection), None
    _has_no_use(f"a {type(store).__name__}", scalars=scalars)
    if module == "h5py":
        return hdf5(Hdf5(store.file.filename, store.name), selection), sidecar(
            store.file.filename, store.name, selection
        )
    if isinstance(store, type) or not all(hasattr(store, name) for name in ("shape", "dtype", "__getitem__")):
        raise TypeError(
            f"store must be a path, a zarr array or group, a dask array, an xarray object, an h5py data set or an "
            f"array, got {type(store).__name__}"
        )
    chunks = store.chunks if module == "dask" else None
    return of_array(store, type(store).__name__, chunks, selection), None


# Zarr.


@contextmanager
def _sound(name: str) -> Iterator[None]:
    """Turns what is raised for nonsense in a store's files into an ``OSError`` that names it."""
    try:
        yield
    except Unsupported as error:
        raise Unsupported(f"{name}: {error}") from None
    except Exception as error:
        if isinstance(error, (ImportError, MemoryError)) or (
            type(error) in (ValueError, TypeError) and name in str(error)
        ):
            raise
        raise OSError(f"{name!r} is no sound zarr store ({type(error).__name__}: {error})") from error


def _node(node: Any, level: int | None, scalars: str | None, selection: dict, path: Path | None) -> Opened:
    if hasattr(node, "shape"):
        _has_no_use(f"an array, {path or node.name}", level=level, scalars=scalars)
        # Those of Zarr 2 are said by xarray alone.
        names = getattr(node.metadata, "dimension_names", None) or node.attrs.get(XARRAY)
        volume = _zarr_array(node, str(path or node.name), selection, names)
        if names is not None and None not in names:
            beside = _beside(node)
            volume = placed_by(volume, lambda axis: _axis(beside, str(names[axis]), node.shape[axis]))
        return volume, None if path is None else sidecar(path, selection=selection)
    attributes = node.attrs.asdict()
    pyramids = attributes.get("ome", attributes).get("multiscales")
    if pyramids and scalars is None:
        return _pyramid(node, pyramids[0], level, selection, path)
    names = [name for name, array in node.arrays() if array.ndim >= 3]
    chosen = named(names, scalars, str(path or node.name))
    volume, _ = _node(node[chosen], level, None, selection, path)
    return volume, None if path is None else sidecar(path, chosen, selection)


def _zarr_array(array: Any, name: str, selection: dict, names: Any = None, filled: bool = True) -> StoredVolume:
    from .blosc import checked

    known = None if names is None or None in names else [str(one) for one in names]
    meaning = meaning_of_zarr(array, filled)
    volume = of_array(checked(array), name, array.chunks, selection, known, meaning=meaning)
    root = getattr(array.store, "root", None)
    if root is None:
        return volume
    if _place(array.metadata.encode_chunk_key((10, *range(1, array.ndim)))) != (10, *range(1, array.ndim)):
        # Of other names nothing is known.
        return volume
    samples = volume.samples
    marks = _ZarrMarks(Path(root) / array.path, array.metadata, samples.axes, samples.fixed, array.chunks, array.shards)
    return volume.at(marks=marks)


def _beside(array: Any) -> Any:
    """The group that an array is in; None of one alone."""
    import zarr

    parent = array.path.rpartition("/")[0]
    with suppress(OSError, ValueError, KeyError):
        if array.path:
            return zarr.open_group(array.store, path=parent, mode="r")
        if (root := getattr(array.store, "root", None)) is not None:
            return zarr.open_group(str(Path(root).parent), mode="r")
        if hasattr(array.store, "fs"):
            # Of a URL.
            parent = array.store.path.rpartition("/")[0]
            return zarr.open_group(zarr.storage.FsspecStore(array.store.fs, read_only=True, path=parent), mode="r")
    return None


def _axis(group: Any, name: str, count: int) -> Axis:
    """Of so many samples, by the array of its name beside it; of coordinates none is missing."""
    from .blosc import checked

    array = None if group is None else group.get(name)
    if array is None or getattr(array, "shape", None) != (count,) or np.dtype(array.dtype).kind not in "iuf":
        return Axis(name)
    values = meaning_of_zarr(array, filled=False).all_values(np.asarray(checked(array)[:]))
    return Axis(name, values, text_of(array.attrs.asdict(), "units"))


class _ZarrMarks:
    """What tells whether chunks of a folder changed: sizes and times of their files."""

    def __init__(self, folder: Path, metadata: Any, axes: tuple, fixed: tuple, chunks: tuple, shards: Any):
        self.folder, self.metadata, self.axes, self.fixed, self.chunks = folder, metadata, axes, fixed, chunks
        self.files = shards or chunks  # samples along each axis of a file
        self.description = self._described()

    def _described(self) -> dict[str, Any]:
        """What a file says of how chunks lie; empty where there is none."""
        for name in ("zarr.json", ".zarray"):
            with suppress(OSError, ValueError):
                given = json.loads((self.folder / name).read_text())
                return {key: value for key, value in given.items() if key not in ("attributes", "dimension_names")}
        return {}

    def _same(self) -> None:
        """Say so where chunks are those of another array, which may have grown."""
        was, now = self.description, self._described()
        if not was or was == now:
            return
        reach = [now.get("shape", [])[axis : axis + 1] for axis in (*(a for a, _ in self.fixed), *self.axes)]
        least = [*([at + 1] for _, at in self.fixed), *([was["shape"][axis]] for axis in self.axes)]
        if was | {"shape": 0} != now | {"shape": 0} or any(a < b for a, b in zip(reach, least, strict=True)):
            raise OSError(f"{self.folder} was replaced by another array, or is gone: open it anew")

    def __call__(self) -> Marked:
        """Of the files that there are now.

        Raises
        ------
        OSError
            Where the array is another.
        """
        self._same()
        files = dict(_stamps(str(self.folder)))

        def marked(spans: list[list[range]]) -> NDArray[np.str_]:
            # Which blocks have a file, by its number along each axis of theirs.
            blocks: list[dict[int, list[int]]] = [{} for _ in spans]
            for axis, along, found in zip(self.axes, spans, blocks, strict=True):
                for n, span in enumerate(along):
                    for number in sorted({chunk * self.chunks[axis] // self.files[axis] for chunk in span}):
                        found.setdefault(number, []).append(n)
            texts: dict[tuple[int, ...], list[str]] = {}
            for key, stamp in sorted(files.items()):
                place = _place(key)
                whole = len(place) == len(self.chunks)
                if whole and all(place[axis] == at // self.files[axis] for axis, at in self.fixed):
                    those = (found.get(place[axis], []) for axis, found in zip(self.axes, blocks, strict=True))
                    for block in product(*those):
                        texts.setdefault(block, []).append(f"{key} {stamp}")
            marks = np.full([len(along) for along in spans], "none", "U16")
            for block, parts in texts.items():
                marks[block] = blake2b(";".join(parts).encode(), digest_size=6).hexdigest()
            return marks

        return marked


def _place(key: str) -> tuple[int, ...]:
    """Of a chunk's file, by its name ("c/1/2/3", "1.2.3"): its number along each axis; empty of others."""
    parts = key.replace(".", "/").removeprefix("c/").split("/")
    return tuple(map(int, parts)) if all(map(str.isdecimal, parts)) else ()


def _stamps(folder: str, inside: str = "") -> Iterator[tuple[str, str]]:
    """Of all files in a folder, by their paths in it: size and time."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with suppress(OSError):
                if entry.is_dir():
                    yield from _stamps(entry.path, f"{inside}{entry.name}/")
                else:
                    status = entry.stat()
                    yield inside + entry.name, f"{status.st_size:x} {status.st_mtime_ns:x}"


def _pyramid(node: Any, pyramid: dict, level: int | None, selection: dict, path: Path | None) -> Opened:
    """OME-Zarr 0.4 (zarr 2) and 0.5 (zarr 3): axes by name, scale and translation of each level."""
    what = str(path or node.name)
    levels = pyramid["datasets"]
    if level is not None and (isinstance(level, bool) or not isinstance(level, int) or not 0 <= level < len(levels)):
        raise ValueError(f"level must be from 0 to {len(levels) - 1} of {what}, got {level!r}")
    names = [axis if isinstance(axis, str) else axis["name"] for axis in pyramid.get("axes", ["t", "c", "z", "y", "x"])]
    units = [None if isinstance(axis, str) else axis.get("unit") for axis in pyramid.get("axes", names)]
    common = pyramid.get("coordinateTransformations", [])

    def at(number: int) -> StoredVolume:
        entry = levels[number]
        # Chunks of an image that are not there are as any others.
        volume = _zarr_array(node[entry["path"]], f"{what}, level {number}", selection, names, filled=False)
        scale, translation = np.ones(len(names)), np.zeros(len(names))
        own = entry.get("coordinateTransformations", [])
        if not any(transformation["type"] == "scale" for transformation in own):
            # Where nothing is said, as before version 0.4, all levels fill the same box.
            scale = np.divide(node[levels[0]["path"]].shape, node[entry["path"]].shape)
            translation = (scale - 1) / 2
        for transformation in (*own, *common):
            kind = transformation["type"]
            if kind in ("scale", "translation") and len(transformation.get(kind, names)) != len(names):
                raise ValueError(f"{what} has {len(names)} axes and the {kind} {transformation[kind]}")
            if kind == "scale" and kind in transformation:
                scale, translation = scale * transformation[kind], translation * transformation[kind]
            elif kind == "translation" and kind in transformation:
                translation = translation + transformation[kind]
            elif kind != "identity":
                volume.unplaced = f"{what} has a transformation of type {kind!r} that is not known here: give spacing"
                return volume
        axes = list(reversed(volume.samples.axes))
        factors = _lengths([units[axis] for axis in axes], what)
        return placed(volume, factors * scale[axes], factors * translation[axes])

    volume = at(level or 0)
    if not volume.unplaced and len(levels) > 1 and (level or 0) < len(levels) - 1:
        coarse = at(len(levels) - 1)
        volume.coarse = None if coarse.unplaced else coarse
    return volume, None if path is None else sidecar(path, levels[level or 0]["path"], selection)


def _lengths(units: list[str | None], what: str) -> NDArray[np.float64]:
    """What lengths along x, y, z are times, so that all are in the unit of x."""
    factors = in_units_of_first(units)
    if factors is None and len(set(units)) > 1:
        announce("%s has axes x, y, z in units %s, which are taken as one", what, units)
    return np.ones(3) if factors is None else factors


# xarray.


def _xarray(data: Any, scalars: str | None, selection: dict) -> StoredVolume:
    if hasattr(data, "data_vars"):
        names = [str(key) for key, value in data.data_vars.items() if value.ndim >= 3]
        data = data[named(names, scalars, "the dataset")]
    elif scalars is not None:
        raise ValueError(f"scalars is for datasets with several variables, got {scalars!r} for a DataArray")
    labels = {name: value for name, value in selection.items() if isinstance(value, str)}
    data = decoded(data).sel(labels)
    rest = {name: value for name, value in selection.items() if name not in labels}
    names = [str(dim) for dim in data.dims]
    inside = data.variable._data
    chunks = getattr(data, "chunks", None)
    # What is not Dask's is sliced by xarray, which leaves it in its file.
    volume = of_array(inside if chunks else _Lazy(data), str(data.name or "DataArray"), chunks, rest, names)
    return placed_by(volume, lambda axis: axis_of(data, data.dims[axis]))


class _Lazy:
    """A DataArray that is sliced without its coordinates."""

    def __init__(self, data: Any):
        self.array, self.shape, self.dtype = data, data.shape, data.dtype

    def __getitem__(self, key: tuple) -> NDArray:
        return self.array[key].values
