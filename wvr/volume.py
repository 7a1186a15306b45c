"""A scalar volume on a regular grid: the samples in their own dtype and where they sit in the world.

Samples are nodes; the volume is the box from the first to the last sample and nothing outside it. An axis with a
single sample is one spacing thick, constant, and centred on that sample.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .launch import get_device
from .samples import DTYPES
from .validation import choice, finite_vector

if TYPE_CHECKING:
    import pyvista as pv


class Volume:
    """Scalar samples ``array[z, y, x]`` and their place in the world.

    The world position of sample ``(i, j, k)`` along x, y, z is ``origin + direction @ (spacing * (i, j, k))``.

    Parameters
    ----------
    array
        Shape ``(nz, ny, nx)``, dtype one of uint8, int8, uint16, int16, float16, float32, float64. A NumPy array, a
        Warp array, or anything with DLPack or ``__cuda_array_interface__`` (PyTorch, JAX, CuPy). Kept in its own dtype
        and, where it is C-contiguous in native byte order, without a copy.
    spacing
        Distance between samples along x, y, z [world length], each > 0.
    origin
        World position of sample (0, 0, 0), x, y, z.
    direction
        3 x 3 matrix whose columns are the world directions of the x, y and z axes; identity by default.
    nan
        ``"error"`` refuses NaN and infinite samples; ``"transparent"`` renders the cells that touch one as nothing.

    Raises
    ------
    TypeError
        For a dtype that is not listed.
    ValueError
        For a wrong rank, an empty array, non-finite samples (with ``nan="error"``), spacing <= 0, or a singular
        direction.

    Examples
    --------
    >>> import numpy as np, wvr
    >>> wvr.Volume(np.zeros((2, 3, 4), np.uint8), spacing=(1, 1, 2.5))
    Volume(4 x 3 x 2 uint8, spacing=(1.0, 1.0, 2.5))
    """

    #: Whether world x, y, z are a patient's axes (z towards the head), as DICOM, NIfTI and some NRRD files say.
    anatomical: bool = False

    def __init__(
        self,
        array: Any,
        spacing: ArrayLike = (1.0, 1.0, 1.0),
        origin: ArrayLike = (0.0, 0.0, 0.0),
        direction: ArrayLike | None = None,
        nan: Literal["error", "transparent"] = "error",
    ):
        self.data = _as_data(array)
        self.spacing = finite_vector(spacing, "spacing", "lengths > 0 along x, y, z")
        if np.any(self.spacing <= 0):
            raise ValueError(f"spacing must be > 0 along x, y and z, got {tuple(self.spacing.tolist())}")
        self.origin = finite_vector(origin, "origin", "the position of sample (0, 0, 0)")
        self.direction = _direction(np.eye(3) if direction is None else direction)
        self.nan = choice(nan, "nan", ("error", "transparent"))
        self._device_arrays: dict[str, wp.array] = {}
        if nan == "error" and self.has_nonfinite:
            count = int(np.size(self.numpy()) - np.count_nonzero(np.isfinite(self.numpy())))
            raise ValueError(
                f"array has {count} NaN or infinite samples of {self.numpy().size}; clean it, or pass "
                f'nan="transparent" to render the cells that touch one as nothing'
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        """``(nz, ny, nx)``."""
        return tuple(int(n) for n in self.data.shape)  # type: ignore[return-value]

    @property
    def dtype(self) -> np.dtype:
        """The samples' own dtype."""
        return self.numpy().dtype

    @property
    def dimensions(self) -> NDArray[np.int64]:
        """Samples along x, y, z."""
        return np.array(self.shape[::-1])

    @property
    def smallest_spacing(self) -> float:
        """The smallest distance between neighbouring samples along an axis [world length]."""
        return float(np.min(np.linalg.norm(self.index_to_world[:3, :3], axis=0)))

    @cached_property
    def index_to_world(self) -> NDArray[np.float64]:
        """4 x 4 affine map from sample indices (i, j, k) along x, y, z to world coordinates."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.direction * self.spacing
        matrix[:3, 3] = self.origin
        return matrix

    @property
    def index_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner of the box in index coordinates; an axis with one sample is one spacing thick."""
        thin = self.dimensions == 1
        return np.where(thin, -0.5, 0.0), np.where(thin, 0.5, self.dimensions - 1.0)

    @cached_property
    def corners(self) -> NDArray[np.float64]:
        """The box's eight corners in world coordinates, shape (8, 3), x fastest."""
        lo, hi = self.index_box
        pick = np.array([[(c >> a) & 1 for a in range(3)] for c in range(8)])
        return np.where(pick, hi, lo) @ self.index_to_world[:3, :3].T + self.origin

    @cached_property
    def has_nonfinite(self) -> bool:
        """Whether any sample is NaN or infinite."""
        # A sum is finite exactly if all terms are, but for overflow; then look at each.
        values = self.numpy()
        if values.dtype.kind != "f":
            return False
        with np.errstate(over="ignore", invalid="ignore"):
            return not np.isfinite(values.sum(dtype=np.float64)) and not bool(np.all(np.isfinite(values)))

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest finite sample; (0, 0) if there is none."""
        values = self.numpy()
        if self.has_nonfinite:
            values = values[np.isfinite(values)]
            if values.size == 0:
                return 0.0, 0.0
        return float(values.min()), float(values.max())

    def numpy(self) -> NDArray:
        """The samples as a NumPy array (z, y, x): the array itself on the CPU, a copy from another device."""
        if isinstance(self.data, np.ndarray):
            return self.data
        return self._host_copy

    @cached_property
    def _host_copy(self) -> NDArray:
        return self.data.numpy()

    def on(self, device: Any) -> wp.array:
        """The samples as a Warp array (z, y, x) on ``device``; uploaded once and kept.

        An axis with one sample has it twice, so that every cell has eight corners.
        """
        device = get_device(device)
        if device.alias not in self._device_arrays:
            source = self.data
            if 1 in self.shape:
                source = self.numpy()
                for axis in range(3):
                    source = np.repeat(source, 2, axis) if source.shape[axis] == 1 else source
            if isinstance(source, np.ndarray):
                source = _borrow(source)
            self._device_arrays[device.alias] = source if source.device == device else wp.clone(source, device=device)
        return self._device_arrays[device.alias]

    @classmethod
    def from_pyvista(
        cls, image_data: pv.ImageData, scalars: str | None = None, nan: Literal["error", "transparent"] = "error"
    ) -> Volume:
        """The volume of a PyVista ``ImageData``; see :func:`wvr.io.from_pyvista`."""
        from .interop import from_pyvista

        return from_pyvista(image_data, scalars, nan)

    def to_pyvista(self) -> pv.ImageData:
        """A PyVista ``ImageData`` with the samples as point data ``"values"``, the same box and orientation."""
        from .interop import to_pyvista

        return to_pyvista(self)

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: the samples as NumPy holds them, nothing of any device."""
        state = {name: value for name, value in vars(self).items() if name != "_host_copy"}
        return state | {"data": self.numpy(), "_device_arrays": {}}

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        return f"Volume({nx} x {ny} x {nz} {self.dtype}, spacing={tuple(self.spacing.tolist())})"


def _direction(matrix: ArrayLike) -> NDArray[np.float64]:
    try:
        direction = np.array(matrix, np.float64)
    except (TypeError, ValueError):
        direction = np.empty(0)
    if direction.shape != (3, 3) or not np.all(np.isfinite(direction)):
        raise ValueError(f"direction must be a finite 3 x 3 matrix, got {matrix!r}")
    if abs(np.linalg.det(direction)) <= 1e-9 * np.prod(np.linalg.norm(direction, axis=0)):
        raise ValueError(f"direction must not be singular, got {direction.tolist()}")
    return direction


def _as_data(array: Any) -> Any:
    """A C-contiguous NumPy array in native byte order, or a contiguous Warp array on its own device."""
    if isinstance(array, Volume):
        raise TypeError("array is a Volume already; pass its samples (volume.numpy())")
    if not isinstance(array, np.ndarray):
        array = _from_device(array)
    if isinstance(array, np.ndarray):
        _check(array.dtype, array.shape)
        return np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))
    # A Warp array of vectors has no such dtype in NumPy, but one with more axes.
    scalar = getattr(array.dtype, "_wp_scalar_type_", array.dtype)
    _check(np.dtype(wp.dtype_to_numpy(scalar)), (*array.shape, *getattr(array.dtype, "_shape_", ())))
    return array if array.is_contiguous else array.contiguous()


def _from_device(array: Any) -> Any:
    """NumPy or Warp array of anything else: Warp's own, CUDA array interface, DLPack, then whatever NumPy takes."""
    if type(array).__module__.startswith("warp"):
        return _host_view(array)
    if hasattr(array, "__cuda_array_interface__") or hasattr(array, "__dlpack__"):
        if getattr(array, "requires_grad", False):
            array = array.detach()
        try:
            if hasattr(array, "__cuda_array_interface__"):
                return wp.array(array, copy=False)
            return _host_view(wp.from_dlpack(array))
        except Exception as error:
            raise TypeError(f"array of type {type(array).__name__} could not be shared with Warp: {error}") from error
    return np.asarray(array)


def _host_view(array: Any) -> Any:
    """A CPU Warp array as NumPy without a copy; others unchanged."""
    return array.numpy() if array.device.is_cpu else array


def _check(dtype: np.dtype, shape: tuple[int, ...]) -> None:
    if dtype.names is not None or (len(shape) == 4 and shape[-1] in (2, 3, 4, 6, 9)):
        raise ValueError(
            f"array must have one component a sample, got shape {shape} of {dtype}; pick one, e.g. array[..., 0]"
        )
    if dtype.newbyteorder("=").name not in DTYPES:
        hint = {"b": "uint8", "c": "float32 (e.g. np.abs(array).astype(np.float32))"}.get(
            dtype.kind, "int16, uint16 or float64, whichever holds its values"
        )
        raise TypeError(f"array has dtype {dtype}; accepted are {', '.join(DTYPES)}; cast it to {hint}")
    if len(shape) != 3:
        raise ValueError(f"array must have three axes (z, y, x), got {len(shape)}: shape {shape}")
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
