"""Volumes of whatever users hold: files, arrays of any library, xarray, PyVista datasets."""

from __future__ import annotations

import errno
import os
import warnings
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cancel import aside
from .copied import Copied, has_memory
from .field.base import Field
from .io.conventions import PLAIN, Meaning, meaning_of, meaning_of_zarr
from .io.coordinates import AXIS_OF, UNEVEN, Axis, places
from .launch import get_device
from .samples import NanPolicy, narrowed
from .validation import any_array, choice, computed, outside, path_of
from .volume import Axes, Volume

if TYPE_CHECKING:
    import pyvista as pv
    import xarray as xr

# Attributes of arrays of xarray that have them as they are stored.
PACKED = {"_FillValue", "missing_value", "scale_factor", "add_offset", "_Unsigned"}
# What to do about coordinates that are not.
ADVICE = (
    "resample the data, e.g. da.interp({name}=numpy.linspace({ends})), or leave the coordinates out: "
    "da.drop_vars({name!r})"
)
# What a zarr store has in its folder.
ZARR = ("zarr.json", ".zarray", ".zgroup")
# Samples at most of a grid that another one is resampled on.
RESAMPLED = 256**3


def as_volume(
    data: Any,
    spacing: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    *,
    axes: Axes | None = None,
    scalars: str | None = None,
    nan: NanPolicy | None = None,
) -> Volume:
    """The volume of anything that holds one.

    Parameters
    ----------
    data
        - a :class:`Volume`, which is returned as it is;
        - the path of a file or folder, as for :func:`wvr.read`, of a zarr store, as for :func:`wvr.open`, or the name
          of a dataset (:mod:`wvr.datasets`);
        - an array of three axes: NumPy, Warp, anything with DLPack (PyTorch, JAX, CuPy) or that NumPy takes (lists,
          Dask, Zarr). Axes of one sample before the last three are left out. Bool and wide integers become the smallest
          dtype that holds every value; masked samples are transparent;
        - an xarray ``DataArray``, or a ``Dataset`` of one: dimensions named x, y, z (or lon, lat, depth, ...) are put
          in order whatever it is, equally spaced coordinates become spacing and origin, missing values are transparent;
        - a PyVista or VTK dataset: an ``ImageData`` as it is, a rectilinear one likewise if it is equally spaced.
          Others are resampled on a regular grid, with a warning that says how; what is outside is transparent.
    spacing, origin
        As of :class:`Volume`, x, y, z [world length], of arrays, which do not say; by default 1 and 0.
    axes
        Of an array: ``"zyx"``, the default, array[z, y, x], x the fastest, as NumPy arrays from files of slices are; or
        ``"xyz"``, array[x, y, z], as :func:`pyvista.wrap` takes them.
    scalars
        Which array of a dataset, or file, with several; by default the active one.
    nan
        ``"error"`` or ``"transparent"``, as of :class:`Volume`; by default an error for samples of arrays and files,
        and transparent where the data have a way of saying that samples are missing (masks, xarray).

    Raises
    ------
    TypeError
        For anything else.
    ValueError
        For coordinates that are not equally spaced, several variables, and as :class:`Volume`.
    OSError
        As :func:`wvr.read`.

    Warns
    -----
    UserWarning
        Where an array's shape or memory looks like another order of its axes and ``axes`` are not given, and where data
        are resampled.

    Examples
    --------
    >>> import numpy as np, wvr
    >>> wvr.as_volume(np.zeros((40, 20, 10), bool), axes="xyz")
    Volume(x=40, y=20, z=10, uint8, spacing=(1.0, 1.0, 1.0))
    """
    choice(axes, "axes", (None, *get_args(Axes)))
    choice(nan, "nan", (None, *get_args(NanPolicy)))
    if not isinstance(scalars, str | None):
        raise TypeError(f"scalars must be the name of an array or None, got {scalars!r}")
    is_array = not isinstance(data, Field | str | os.PathLike)
    module = type(data).__module__.partition(".")[0]
    of_library = module in ("pyvista", "vtkmodules", "vtk", "xarray")
    for name, value in (("spacing", spacing), ("origin", origin), ("axes", axes)):
        if value is not None and (not is_array or of_library):
            raise ValueError(f"{name} is for arrays, a {type(data).__name__} says so itself, got {value!r}")
    for name, value in (("scalars", scalars), ("nan", nan)):
        if value is not None and isinstance(data, Field):
            raise ValueError(f"{name} is for what becomes a volume, got {value!r} for a {type(data).__name__}")
    if scalars is not None and is_array and not of_library:
        raise ValueError(f"scalars is for datasets and files with several arrays, got {scalars!r} for an array")
    if isinstance(data, Field):
        return data  # type: ignore[return-value]
    if isinstance(data, str | os.PathLike):
        return _named(data, scalars, nan or "error")
    if module == "xarray":
        return _from_xarray(data, scalars, nan or "transparent")
    if of_library:
        return _from_dataset(data, scalars, nan)
    return _from_array(data, spacing, origin, axes, nan)


def _named(name: str | os.PathLike[str], scalars: str | None, nan: NanPolicy) -> Volume:
    from . import datasets
    from .io import read

    known = datasets.names()
    if any((Path(name) / inside).exists() for inside in ZARR):
        from .bricks.open import open as open_volume

        return open_volume(name, scalars=scalars, nan=nan)  # type: ignore[return-value]
    if not Path(name).exists() and str(name) in known:
        if scalars is not None:
            raise ValueError(f"scalars is for files with several arrays, got {scalars!r} for the dataset {str(name)!r}")
        return datasets.load(str(name))
    if not Path(name).exists() and not Path(name).suffix:
        near = get_close_matches(str(name), known, 1)
        hint = f"; did you mean the dataset {near[0]!r}?" if near else ""
        raise FileNotFoundError(f"{str(name)!r} is neither a file or folder nor a dataset of wvr.datasets{hint}")
    path = path_of(name, "data")
    if not path.exists() and path.parent.is_dir():
        beside = get_close_matches(path.name, [file.name for file in path.parent.iterdir()], 1)
        hint = f"; did you mean {beside[0]!r}?" if beside else ""
        raise FileNotFoundError(errno.ENOENT, f"no such file or folder{hint}", str(path))
    return read(path, scalars, nan)


def _from_array(
    data: Any, spacing: ArrayLike | None, origin: ArrayLike | None, given_axes: Axes | None, nan: NanPolicy | None
) -> Volume:
    axes: Axes = given_axes or "zyx"
    if isinstance(data, list | tuple):
        data = computed(data)
    meaning, given = _meaning(data), _samples(data)
    given = given if meaning == PLAIN else meaning.all_values(given)
    array = _three_axes(given)
    if isinstance(array, np.ndarray) and array.ndim == 3 and given_axes is None:
        _doubt(array)
    place = {"spacing": (1.0, 1.0, 1.0) if spacing is None else spacing}
    place["origin"] = (0.0, 0.0, 0.0) if origin is None else origin
    # Dask says of its arrays alone whether they may be.
    masked = np.ma.is_masked(data) or isinstance(getattr(data, "_meta", None), np.ma.MaskedArray)
    policy: NanPolicy = nan or ("transparent" if masked else "error")
    volume = Volume(array, **place, nan=policy, axes=axes)
    shared = data if isinstance(data, np.ndarray) else given
    if not isinstance(given, np.ndarray) or (has_memory(data) and np.may_share_memory(volume.host(), shared)):
        return volume
    return volume.copied(Copied.of(data, _samples, lambda now: _kept(_three_axes(_samples(now)), axes)))


def _meaning(data: Any) -> Meaning:
    """Of arrays with attributes, as those of Zarr and HDF5 are."""
    module = type(data).__module__.partition(".")[0]
    if module == "zarr" and hasattr(data, "fill_value"):
        return meaning_of_zarr(data)
    if module == "h5py" and hasattr(data, "fillvalue"):
        return meaning_of(data.attrs, data.dtype, data.fillvalue)
    return PLAIN


def _kept(array: NDArray, axes: Axes) -> NDArray:
    """As a volume keeps it."""
    return np.ascontiguousarray(array.T if axes == "xyz" else array, array.dtype.newbyteorder("="))


def _three_axes(array: Any) -> Any:
    """Without axes of one sample in front; NumPy's in a dtype that volumes keep."""
    leading = getattr(array, "ndim", 3) - 3
    if leading > 0 and all(n == 1 for n in array.shape[:leading]):
        array = array.reshape(array.shape[leading:])
    return narrowed(array) if isinstance(array, np.ndarray) else array


def _samples(data: Any) -> Any:
    """A NumPy array, or a Warp array on its own device."""
    data = computed(data)
    if isinstance(data, np.ma.MaskedArray):
        if not np.ma.is_masked(data):
            return data.data
        real = data.dtype if data.dtype.kind == "f" else np.result_type(narrowed(data.data).dtype, np.float32)
        return np.ma.filled(data.astype(real), np.nan)
    if isinstance(data, np.ndarray) or type(data).__module__.startswith("warp"):
        return data
    if getattr(data, "requires_grad", False):
        data = data.detach()
    if hasattr(data, "__dlpack__") and not hasattr(data, "__cuda_array_interface__"):
        # Before anything of Warp is used, and for dtypes that it has not.
        get_device()
        try:
            return np.from_dlpack(data)
        except (TypeError, ValueError, RuntimeError, BufferError):
            pass
        if "bfloat16" in str(getattr(data, "dtype", "")):
            raise TypeError("array has dtype bfloat16, which no volume keeps; cast it to float32")
    if hasattr(data, "__cuda_array_interface__"):
        get_device()
        kind = np.dtype(data.__cuda_array_interface__["typestr"])
        if kind.kind in "biu":
            return data.cpu().numpy() if hasattr(data, "cpu") else data.get()
        return data
    if isinstance(data, list | tuple) and any(isinstance(one, Field | str) or hasattr(one, "wvr") for one in data):
        raise TypeError(
            f"data must be one volume, got a {type(data).__name__} of {len(data)}: wvr.time_series renders one after "
            f"the other; in one scene there are not several yet"
        )
    array = any_array(data, "data", masks=True)
    if array.dtype.kind not in "biufc":
        raise TypeError(
            f"data must be a Volume, a path, an array of numbers, an xarray or a PyVista dataset, got "
            f"{type(data).__name__}"
        )
    return array


def _doubt(array: NDArray) -> None:
    """Warn where an array looks like [x, y, z]: by its memory, or by a stack of equal slices along the last axis."""
    nz, ny, nx = array.shape
    fortran = array.flags.f_contiguous and not array.flags.c_contiguous
    if fortran or (nz == ny and nx < nz):
        why = "its first axis is the fastest in memory" if fortran else "its first two axes are equally long"
        warnings.warn(
            f"an array of shape {array.shape} is taken as [z, y, x]: {nx} samples along x, {ny} along y, {nz} along z; "
            f'{why}, as of arrays [x, y, z]: if it is one, say axes="xyz"',
            stacklevel=outside(),
        )


def _from_xarray(data: xr.DataArray | xr.Dataset, name: str | None, nan: NanPolicy) -> Volume:
    if hasattr(data, "data_vars"):
        names = [str(key) for key, value in data.data_vars.items() if value.squeeze().ndim == 3]
        if name is None and len(names) != 1:
            raise ValueError(f"scalars must name one of the dataset's variables of three dimensions, {names}; got None")
        if name is not None and name not in names:
            raise ValueError(f"scalars must be one of {names}, got {name!r}")
        data = data[names[0] if name is None else name]
    elif name is not None:
        raise ValueError(f"scalars is for datasets with several variables, got {name!r} for a DataArray")
    extra = [dim for dim in data.dims if data.sizes[dim] == 1 and AXIS_OF.get(str(dim).lower()) is None]
    array = decoded(data).squeeze(extra[: max(data.ndim - 3, 0)])
    if array.ndim != 3:
        raise ValueError(
            f"data must have three dimensions, got {dict(array.sizes)}; pick one of the others, "
            f"e.g. da.isel({array.dims[0]}=0)"
        )
    known = {AXIS_OF.get(str(dim).lower()): dim for dim in array.dims}
    order = [known[axis] for axis in "zyx"] if set(known) == {"x", "y", "z"} else list(array.dims)
    array = array.transpose(*order)
    steps, starts = places([axis_of(array, dim) for dim in reversed(order)], ADVICE)
    # Once: Dask computes them, with what is masked, and what is packed is decoded, each time.
    held = aside(lambda: computed(array.data))
    held = held if isinstance(held, np.ndarray) else np.asarray(array.values)
    volume = Volume(narrowed(_samples(held)), np.abs(steps), starts, np.diag(np.sign(steps)), nan)
    if np.may_share_memory(volume.host(), held):
        return volume
    return volume.copied(Copied.of(held, np.asarray, lambda now: _kept(narrowed(now), "zyx")))


def decoded(data: xr.DataArray) -> xr.DataArray:
    """With what stored numbers mean, by xarray itself, where it left that in the attributes."""
    if not any(PACKED & one.attrs.keys() for one in (data, *data.coords.values())):
        return data
    import xarray

    # Of a name that none of its coordinates has.
    name = "_".join(["samples", *map(str, data.coords), *map(str, data.dims)])
    held = data.to_dataset(name=name, promote_attrs=False)
    return xarray.decode_cf(held, decode_times=False, decode_coords=False)[name].rename(data.name)


def axis_of(array: xr.DataArray, dim: Any) -> Axis:
    """What coordinates say of a dimension."""
    if dim not in array.coords:
        return Axis(str(dim))
    return Axis(str(dim), array.coords[dim].values, str(array.coords[dim].attrs.get("units", "")))


def _from_dataset(data: Any, scalars: str | None, nan: NanPolicy | None) -> Volume:
    import pyvista as pv

    from .interop import from_pyvista

    if isinstance(data, pv.BasePlotter):
        raise TypeError("data is a plotter: plotter.wvr.screenshot() renders the volume that it shows")
    try:
        grid = pv.wrap(data)
    except NotImplementedError:
        raise TypeError(f"data must be a PyVista grid with an inside, got {type(data).__name__}") from None
    if isinstance(grid, pv.MultiBlock):
        raise TypeError(f"data is a MultiBlock of {len(grid)}: pass one of them, such as data[0], or data.combine()")
    if isinstance(grid, pv.ImageData):
        return from_pyvista(grid, scalars, nan or "error")
    if isinstance(grid, pv.RectilinearGrid):
        image = _equally_spaced(grid)
        if image is not None:
            return from_pyvista(image, scalars, nan or "error")
    if not isinstance(grid, pv.DataSet) or isinstance(grid, pv.PolyData | pv.PointSet):
        raise TypeError(f"data must be a PyVista grid with an inside, got {type(data).__name__}; a surface has none")
    return _resampled(grid, scalars, nan or "transparent")


def _equally_spaced(grid: pv.RectilinearGrid) -> pv.ImageData | None:
    """The same as ``ImageData``, if coordinates are equally spaced along each axis."""
    import pyvista as pv

    axes = [np.asarray(axis, np.float64) for axis in (grid.x, grid.y, grid.z)]
    steps = [float(axis[-1] - axis[0]) / max(len(axis) - 1, 1) or 1.0 for axis in axes]
    if any(np.abs(np.diff(axis) - step).max(initial=0) > UNEVEN * abs(step) for axis, step in zip(axes, steps)):  # noqa: B905
        return None
    image = pv.ImageData(
        dimensions=grid.dimensions, spacing=tuple(steps), origin=tuple(float(axis[0]) for axis in axes)
    )
    image.point_data.update(grid.point_data)
    image.cell_data.update(grid.cell_data)
    return image


def _resampled(grid: pv.DataSet, scalars: str | None, nan: NanPolicy) -> Volume:
    """On a regular grid with about as many samples in its box as there are points; outside of the cells there are none.

    Cells of curvilinear grids differ in size: twice as many along each axis keep most of the small ones.
    """
    import pyvista as pv

    from .interop import array_to_render, from_pyvista

    bounds = np.reshape(grid.bounds, (3, 2))
    lengths = bounds[:, 1] - bounds[:, 0]
    if not np.all(lengths > 0):
        raise ValueError(f"data must have an extent along x, y and z, got bounds {tuple(grid.bounds)}")
    step = (np.prod(lengths) / min(max(8 * grid.n_points, 32**3), RESAMPLED)) ** (1 / 3)
    dimensions = np.clip(np.ceil(lengths / step).astype(int) + 1, 2, 1024)
    spacing = lengths / (dimensions - 1)
    image = pv.ImageData(dimensions=tuple(dimensions), spacing=tuple(spacing), origin=tuple(bounds[:, 0]))
    # Before VTK adds an array of its own, which says what is inside.
    points, cells = list(grid.point_data), list(grid.cell_data)
    name, _ = array_to_render(points, cells, (grid.active_scalars_name, None), scalars)
    sampled = image.sample(grid)
    values = np.asarray(sampled.point_data[name], np.float32).copy()
    inside = np.asarray(sampled.point_data["vtkValidPointMask"]) > 0
    values[~inside] = np.nan
    image.point_data[name] = values
    warnings.warn(
        f"the {type(grid).__name__} is resampled on {' x '.join(map(str, dimensions))} samples, linearly: "
        f"error bounds are of what is made of it",
        stacklevel=outside(),
    )
    return from_pyvista(image, name, nan).copied(Copied.of(None, np.asarray, np.asarray))
