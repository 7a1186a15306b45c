"""A scalar volume on a regular grid: the samples in their own dtype and where they sit in the world.

Samples are nodes; the volume is the box from the first to the last sample and nothing outside it. An axis with a
single sample is one spacing thick, constant, and centred on that sample.
"""

from __future__ import annotations

import os
import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .cached import cached_property
from .checksum import checksum
from .copied import Copied, has_memory
from .field.base import Field
from .field.blocks import Ranges
from .field.samples import Data, extremes, samples_struct
from .keep import Keeper
from .kernels.field.grid import Grid
from .launch import get_device
from .memory import free_host_memory, gib
from .pose import Posed, pose_of
from .samples import DTYPES, NanPolicy, times_power
from .validation import any_array, choice, outside

if TYPE_CHECKING:
    import pyvista as pv

Axes = Literal["zyx", "xyz"]


class Volume(Posed, Field):
    """Scalar samples ``array[z, y, x]`` and their place in the world.

    The world position of sample ``(i, j, k)`` along x, y, z is ``origin + direction @ (spacing * (i, j, k))``.

    Parameters
    ----------
    array
        Shape ``(nz, ny, nx)``, dtype one of uint8, int8, uint16, int16, float16, float32, float64. A NumPy array, a
        Warp array, or anything with DLPack or ``__cuda_array_interface__`` (PyTorch, JAX, CuPy). Kept in its own dtype
        and, where it is C-contiguous in native byte order, without a copy; of others what is written into them is
        copied anew: see :meth:`changed`.
    spacing
        Distance between samples along x, y, z [world length], each > 0.
    origin
        World position of sample (0, 0, 0), x, y, z.
    direction
        3 x 3 matrix whose columns are the world directions of the x, y and z axes; identity by default.
    nan
        ``"error"`` refuses NaN and infinite samples; ``"transparent"`` renders the cells that touch one as nothing.
    axes
        Order of the array's axes: ``"zyx"``, the default, or ``"xyz"`` for ``array[x, y, z]``, as of ``pyvista.wrap``,
        which is copied unless x is the fastest in memory. Spacing, origin and direction are x, y, z in any case.

    Raises
    ------
    TypeError
        For a dtype that is not listed, and for what is no array (:func:`wvr.as_volume` takes paths, PyVista and xarray
        datasets, bool and wide integers).
    ValueError
        For a wrong rank, an empty array, non-finite samples (with ``nan="error"``), spacing <= 0, lengths beyond
        1e100, cells whose edges differ by more than 1e60 times, or a singular direction.

    Examples
    --------
    >>> import numpy as np, wvr
    >>> wvr.Volume(np.zeros((2, 3, 4), np.uint8), spacing=(1, 1, 2.5))
    Volume(x=4, y=3, z=2, uint8, spacing=(1.0, 1.0, 2.5))
    """

    #: How often samples changed.
    version: int
    #: Where world x, y, z run in a patient, as the file says: ``"LPS"`` (towards left, back, head: DICOM, some NRRD),
    #: ``"RAS"`` (towards right, front, head: NIfTI, some NRRD), or empty where it does not say. Other such letters may
    #: be assigned.
    anatomical: str = ""
    #: Files that the samples were read from.
    files: tuple[Path, ...] = ()

    def __init__(
        self,
        array: Any,
        spacing: ArrayLike = (1.0, 1.0, 1.0),
        origin: ArrayLike = (0.0, 0.0, 0.0),
        direction: ArrayLike | None = None,
        nan: NanPolicy = "error",
        axes: Axes = "zyx",
    ):
        choice(axes, "axes", get_args(Axes))
        self._data, shared = _as_data(array, axes)
        self._copied = None if shared else Copied.of(array, _from_device, lambda now: _as_data(now, axes)[0])
        self.spacing, self.origin, self.direction = pose_of(spacing, origin, direction)
        self.nan = choice(nan, "nan", ("error", "transparent"))
        self._device_arrays: dict[str, wp.array] = {}
        self._scaled: dict[int, Volume] = {}
        self.version = 0
        self._checksum: bytes | None = None
        self._lent = False  # the samples were handed out
        self._shared = True  # somebody else could write to them when they were looked at last
        self._check_finite()

    def _check_finite(self) -> None:
        if self.nan == "error" and self.has_nonfinite:
            if isinstance(self._data, np.ndarray):
                count = int(self._data.size - np.count_nonzero(np.isfinite(self._data)))
            else:
                count = self._extremes[2]
            raise ValueError(
                f"array has {count} NaN or infinite samples of {self._data.size}; clean it, or pass "
                f'nan="transparent" to render the cells that touch one as nothing'
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """``(nz, ny, nx)``."""
        return tuple(int(n) for n in self._data.shape)  # type: ignore[return-value]

    @property
    def dtype(self) -> np.dtype:
        """The samples' own dtype."""
        # Of samples on another device, without a copy of them.
        return self._data.dtype if isinstance(self._data, np.ndarray) else np.dtype(wp.dtype_to_numpy(self._data.dtype))

    @cached_property
    def has_nonfinite(self) -> bool:
        """Whether any sample is NaN or infinite."""
        if self.dtype.kind != "f":
            return False
        if not isinstance(self._data, np.ndarray):
            return self._extremes[2] > 0
        # A sum is finite exactly if all terms are, but for overflow; then look at each.
        with np.errstate(over="ignore", invalid="ignore"):
            return not np.isfinite(self._data.sum(dtype=np.float64)) and not bool(np.all(np.isfinite(self._data)))

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest finite sample; (0, 0) if there is none."""
        if not isinstance(self._data, np.ndarray):
            low, high, _ = self._extremes
            return (low, high) if low <= high else (0.0, 0.0)
        values = self._data
        if self.has_nonfinite:
            values = values[np.isfinite(values)]
            if values.size == 0:
                return 0.0, 0.0
        return float(values.min()), float(values.max())

    @cached_property
    def _extremes(self) -> tuple[float, float, int]:
        """Of samples on another device, without bringing them."""
        return extremes(self._data)

    def numpy(self) -> NDArray:
        """The samples as a NumPy array (z, y, x): the array itself on the CPU, a copy from another device."""
        self._lent = True
        return self.host()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray:
        # NumPy 1 knows no None.
        return np.asarray(self.numpy(), dtype) if copy is None else np.array(self.numpy(), dtype, copy=copy)

    @property
    def data(self) -> Any:
        """The samples as they are kept: a NumPy array, or a Warp array on its own device."""
        self._lent = True
        return self._data

    def host(self) -> NDArray:
        """The samples for readers, who do not write."""
        return self._data if isinstance(self._data, np.ndarray) else self._host_copy

    @cached_property
    def _host_copy(self) -> NDArray:
        return self._data.numpy()

    def on(self, device: Any) -> wp.array:
        """The samples as a Warp array (z, y, x) on ``device``; uploaded once and kept.

        An axis with one sample has it twice, so that every cell has eight corners.
        """
        self._lent = True
        return self.uploaded(device)

    def uploaded(self, device: Any) -> wp.array:
        """As :meth:`on`, for readers, who do not write."""
        device = get_device(device)
        if device.alias not in self._device_arrays:
            source = self._data
            if 1 in self.shape:
                source = self.host()
                for axis in range(3):
                    source = np.repeat(source, 2, axis) if source.shape[axis] == 1 else source
            if isinstance(source, np.ndarray):
                source = _borrow(source)
            self._device_arrays[device.alias] = source if source.device == device else wp.clone(source, device=device)
        return self._device_arrays[device.alias]

    def changed(self) -> None:
        """Say that somebody wrote into the samples: ranges and whatever else depends on them are made anew.

        Of an array that had to be copied (another dtype or byte order, not C-contiguous, masked) they are copied anew,
        if it changed since, as long as somebody else has it. A renderer looks for changes itself, before each frame, by
        a checksum (0.1 ms a megabyte); what it notices counts as a call of this. Arrays that are read-only, or that
        only the volume refers to, are not looked at. Until either, ``range`` and ``has_nonfinite`` are those of the
        samples before.

        Raises
        ------
        ValueError
            Where NaN or infinite samples were written into a volume with ``nan="error"``.

        Warns
        -----
        UserWarning
            Where nothing can have changed: the samples are a copy of what is gone, or a list, and nobody has them.
        """
        if not self._renew() and self._copied is not None and self._copied.gone and not self._lent:
            warnings.warn(
                "changed() finds nothing new: the samples were copied from what is no longer there, or cannot be asked "
                "(a list); write into volume.numpy()",
                stacklevel=outside(),
            )
        self._forget()

    def copied(self, source: Copied) -> Volume:
        """The volume itself, whose samples are a copy of others."""
        self._copied = source
        return self

    def _renew(self) -> bool:
        """Copy the samples anew where what they are a copy of changed."""
        fresh = None if self._copied is None else self._copied.renewed()
        if fresh is None:
            return False
        if isinstance(fresh, np.ndarray) and fresh.dtype == self.dtype and self._data.flags.writeable:
            np.copyto(self._data, fresh)  # others may have it
        else:
            self._data = fresh
        return True

    def _forget(self) -> None:
        """Whatever is known of other samples."""
        self.version += 1
        self._checksum = None
        self._device_arrays.clear()
        self._scaled.clear()
        for derived in ("has_nonfinite", "range", "_extremes", "_host_copy"):
            vars(self).pop(derived, None)
        self._check_finite()
        if self._copied is not None:
            self._copied.taken()

    def look(self) -> None:
        """Notice what was written into the samples since this was called last, or since the volume was made."""
        if self._renew():
            self._forget()
        shared = not self._alone()
        if self._shared or shared:
            now = checksum(self._data)
            if now != self._checksum:
                # At first too: what was found out when the volume was made may be out of date.
                self._forget()
            self._checksum = now
        self._shared = shared

    def _alone(self) -> bool:
        """Whether nobody else can write to the samples: read-only memory, or an array that only this volume has."""
        if not isinstance(self._data, np.ndarray):
            return False
        if not _writable(self._data):
            return True
        borrowed = sum(getattr(array, "_owner", None) is self._data for array in self._device_arrays.values())
        return not self._lent and self._data.base is None and _references(vars(self)) <= ALONE + borrowed

    @property
    def half(self) -> Grid:
        return Grid(wp.dtype_from_numpy(self.dtype), not self.has_nonfinite)

    @property
    def shifts(self) -> bool:  # type: ignore[override]
        return self.dtype.kind == "f"

    @property
    def whole(self) -> bool:  # type: ignore[override]
        return not self.shifts

    @property
    def nbytes(self) -> int:  # type: ignore[override]
        return int(np.prod(self.shape)) * self.dtype.itemsize

    def missing_on(self, device: wp.Device) -> int:
        there = device.is_cpu or device.alias in self._device_arrays
        # Samples that were given on a device are taken as they are, but where an axis has one.
        there = there or (
            not isinstance(self._data, np.ndarray) and self._data.device == device and 1 not in self.shape
        )
        return 0 if there else self.nbytes

    def region(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray:
        """A copy of the samples from ``low`` to ``high``, both included, along x, y, z."""
        return self.host()[tuple(slice(a, b + 1) for a, b in zip(low[::-1], high[::-1], strict=True))].copy()

    def part(self) -> Data:
        """The samples as a part that renderers keep."""
        return Data(self, self.version)

    def struct(self, keep: Keeper, shift: float) -> Any:
        return samples_struct(keep(self.part()), shift)

    def blocks(self) -> Ranges:
        return Ranges(self.part())

    def scaled(self, exponent: int) -> Volume:
        """The same with samples times ``2**exponent``, in float64; kept until the samples change."""
        scaled = self._scaled.get(exponent)
        if scaled is None:
            samples = times_power(self.host(), exponent)
            scaled = Volume(samples, self.spacing, self.origin, self.direction, self.nan)
            self._scaled = {exponent: scaled}  # which a renderer of another thread may do at any time
        return scaled

    @classmethod
    def from_pyvista(cls, image_data: pv.ImageData, scalars: str | None = None, nan: NanPolicy = "error") -> Volume:
        """The volume of a PyVista ``ImageData``; see :func:`wvr.io.from_pyvista`."""
        from .interop import from_pyvista

        return from_pyvista(image_data, scalars, nan)

    def to_pyvista(self) -> pv.ImageData:
        """A PyVista ``ImageData`` with the samples as point data ``"values"``, the same box and orientation."""
        from .interop import to_pyvista

        return to_pyvista(self)

    def view(self, transfer_function: Any = None, **options: Any) -> Any:
        """A viewer of it; see :func:`wvr.view`."""
        # By its name: a volume is known to all that a viewer shows, and must not ask for it.
        return import_module("wvr.viewer").view(self, transfer_function, **options)

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the samples as NumPy holds them, nothing of any device."""
        state = {name: value for name, value in vars(self).items() if name != "_host_copy"}
        return state | {"_data": self.host(), "_device_arrays": {}, "_scaled": {}, "_checksum": None, "_copied": None}

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        return f"Volume(x={nx}, y={ny}, z={nz}, {self.dtype}, spacing={tuple(self.spacing.tolist())})"


def _references(attributes: dict[str, Any]) -> int:
    """How many references there are to an object's samples, as Python counts them."""
    data = attributes["_data"]
    return sys.getrefcount(data)


# Of samples that nobody else refers to.
ALONE = _references({"_data": np.empty(0)})


def _writable(array: NDArray) -> bool:
    """Whether an array, or one that it is a view of, can be written to."""
    while isinstance(array, np.ndarray):
        if array.flags.writeable:
            return True
        if array.base is None:
            return False
        array = array.base
    return True


def _as_data(array: Any, axes: Axes) -> tuple[Any, bool]:
    """A C-contiguous NumPy array in native byte order, or a contiguous Warp array on its own device; and whether its
    memory is that of the one given.
    """
    shares = isinstance(array, np.ndarray) or has_memory(array)
    if isinstance(array, Volume):
        raise TypeError("array is a Volume already; pass its samples (volume.numpy())")
    if isinstance(array, str | os.PathLike):
        raise TypeError(f"array must be an array, got the path {str(array)!r}; wvr.read reads files")
    if type(array).__module__.partition(".")[0] in ("pyvista", "vtkmodules", "xarray"):
        raise TypeError(
            f"array must be an array, got {type(array).__name__}: wvr.as_volume takes it, with spacing and origin"
        )
    if not isinstance(array, np.ndarray):
        array = _from_device(array)
    if np.ma.is_masked(array):
        raise TypeError(
            f"array has {np.ma.count_masked(array)} masked samples: wvr.as_volume(array) renders them as nothing, "
            f"array.filled(value) gives them a value"
        )
    if isinstance(array, np.ndarray):
        _check(array.dtype, array.shape)
        array = array.T if axes == "xyz" else array
        if type(array) is np.ndarray and array.flags.c_contiguous and array.dtype.isnative:
            return array, shares
        copied = not (array.flags.c_contiguous and array.dtype.isnative)
        if copied and array.nbytes > (free := free_host_memory()):
            raise MemoryError(
                f"array is copied, as it is not C-contiguous in native byte order, which takes "
                f"{gib(array.nbytes)}, of which {gib(free)} are free"
            )
        data = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))
        return data, shares and np.may_share_memory(data, array)  # of a subclass of NumPy's arrays
    # A Warp array of vectors has no such dtype in NumPy, but one with more axes.
    scalar = getattr(array.dtype, "_wp_scalar_type_", array.dtype)
    _check(np.dtype(wp.dtype_to_numpy(scalar)), (*array.shape, *getattr(array.dtype, "_shape_", ())))
    array = array.transpose() if axes == "xyz" else array
    return (array, shares) if array.is_contiguous else (array.contiguous(), False)


def _from_device(array: Any) -> Any:
    """NumPy or Warp array of anything else: Warp's own, DLPack, CUDA array interface, then whatever NumPy takes."""
    if type(array).__module__.startswith("warp"):
        return _host_view(array)
    if hasattr(array, "__cuda_array_interface__") or hasattr(array, "__dlpack__"):
        if getattr(array, "requires_grad", False):
            array = array.detach()
        get_device()  # nothing is shared with a Warp that is not initialised
        try:
            if hasattr(array, "__dlpack__"):
                return _host_view(wp.from_dlpack(array))
            # This does not say on which of several GPUs it is: on Warp's default. Nor does Warp ask on which stream.
            wp.synchronize_device()
            return wp.array(array, copy=False)
        except Exception as error:
            raise TypeError(f"array of type {type(array).__name__} could not be shared with Warp: {error}") from error
    return any_array(array, "array", masks=True)


def _host_view(array: Any) -> Any:
    """A CPU Warp array as NumPy without a copy; others unchanged."""
    return array.numpy() if array.device.is_cpu else array


def _check(dtype: np.dtype, shape: tuple[int, ...]) -> None:
    if dtype.names is not None or (len(shape) == 4 and shape[-1] in (2, 3, 4, 6, 9)):
        one = "array[..., 0]" if dtype.names is None else f"array[{dtype.names[0]!r}]"
        raise ValueError(f"array must have one component a sample, got shape {shape} of {dtype}; pick one, e.g. {one}")
    if dtype.newbyteorder("=").name not in DTYPES:
        hint = {"b": "uint8", "c": "float32 (e.g. np.abs(array).astype(np.float32))"}.get(
            dtype.kind, "int16, uint16 or float64, whichever holds its values"
        )
        raise TypeError(f"array has dtype {dtype}; accepted are {', '.join(DTYPES)}; cast it to {hint}")
    if len(shape) != 3:
        hint = {2: "; a single slice is array[None]", 4: "; wvr.time_series renders arrays [t, z, y, x]"}.get(
            len(shape), ""
        )
        raise ValueError(f"array must have three axes (z, y, x), got {len(shape)}: shape {shape}{hint}")
    if 0 in shape:
        raise ValueError(f"array must not be empty, got shape {shape}")


def _borrow(data: NDArray) -> wp.array:
    """A Warp CPU array on the memory of ``data``, read-only arrays included (kernels only read it)."""
    array = wp.array(
        ptr=data.ctypes.data,
        dtype=wp.dtype_from_numpy(data.dtype),
        shape=data.shape,
        capacity=data.nbytes,
        device="cpu",
    )
    array._owner = data  # keeps the memory alive as long as the array
    return array
