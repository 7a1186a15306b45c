"""Volumes from PyVista and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .copied import Copied
from .samples import NanPolicy, components_error, narrowed
from .volume import Volume

if TYPE_CHECKING:
    import pyvista as pv


def from_pyvista(image_data: pv.ImageData, scalars: str | None = None, nan: NanPolicy = "error") -> Volume:
    """The volume of a PyVista ``ImageData``, sharing its memory where the dtype allows.

    Parameters
    ----------
    image_data
        ``pyvista.ImageData`` or ``vtkImageData`` with one component a sample.
    scalars
        Name of the point or cell array; by default the active one. Cell samples sit at the cells' centres: the volume
        is then half a cell smaller on every side than the grid's box.
    nan
        See :class:`Volume`.

    Raises
    ------
    TypeError
        For anything but a regular grid.
    ValueError
        For an unknown name, no array or several with none active, more than one component.
    """
    import pyvista as pv
    from vtkmodules.vtkCommonDataModel import vtkDataObject

    if not isinstance(scalars, str | None):
        raise TypeError(f"scalars must be the name of an array or None, got {scalars!r}")
    image = pv.wrap(image_data) if isinstance(image_data, vtkDataObject) else None
    if not isinstance(image, pv.ImageData):
        raise TypeError(f"image_data must be a pyvista.ImageData, got {type(image_data).__name__}; {RESAMPLE}")
    values, on_cells = _pick_array(image, scalars)
    if values.ndim > 1:
        raise components_error(f"array {scalars!r}" if scalars else "the active array", values.shape[1])
    points = np.array(image.dimensions)
    size = np.maximum(points - 1, 1) if on_cells else points
    matrix = image.GetDirectionMatrix()
    direction = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
    spacing = np.array(image.spacing)
    origin, _ = vtk_place(np.array(image.GetExtent()), spacing, np.array(image.origin), direction, on_cells)
    shape = tuple(size[::-1].tolist())
    # VTK allows a negative spacing, which is a reversed axis.
    place = np.abs(spacing), origin, direction * np.where(spacing < 0, -1, 1)
    volume = Volume(narrowed(np.asarray(values).reshape(shape)), *place, nan)
    if np.may_share_memory(volume.host(), values):
        return volume

    def read(there: pv.ImageData) -> NDArray | None:
        now = np.asarray(_pick_array(pv.wrap(there), scalars)[0])
        return now.reshape(shape) if now.size == np.prod(shape) else None

    return volume.copied(Copied(image_data, read, lambda now: np.ascontiguousarray(narrowed(now))))


def to_pyvista(volume: Volume) -> pv.ImageData:
    """A PyVista ``ImageData`` of the volume, with its box and orientation.

    Parameters
    ----------
    volume
        Any volume.

    Returns
    -------
    pyvista.ImageData
        With point data ``"values"`` in the volume's dtype, sharing its memory where both live on the CPU: change it and
        the volume changes. VTK has no float16: that becomes float32, which holds every such value.
    """
    import pyvista as pv

    nz, ny, nx = volume.shape
    image = pv.ImageData(dimensions=(nx, ny, nz), spacing=tuple(volume.spacing), origin=tuple(volume.origin))
    image.SetDirectionMatrix(*volume.direction.ravel())
    values = volume.numpy()
    image.point_data["values"] = (values.astype(np.float32) if values.dtype == np.float16 else values).reshape(-1)
    image.set_active_scalars("values")
    return image


RESAMPLE = (
    "wvr renders regular grids: resample it, e.g. pyvista.ImageData(dimensions=..., spacing=..., "
    "origin=...).sample(grid), and pass that to Volume.from_pyvista"
)


def vtk_place(
    extent: NDArray[np.int64],
    spacing: NDArray[np.float64],
    origin: NDArray[np.float64],
    direction: NDArray[np.float64],
    on_cells: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the first sample of VTK's grid is, and the steps along its axes as columns."""
    # VTK's origin is that of index (0, 0, 0), which need not be a point of the grid.
    first = extent[::2] + np.where(extent[1::2] > extent[::2], 0.5, 0.0) * on_cells
    return origin + direction @ (spacing * first), direction * spacing


def array_to_render(
    on_points: list[str], on_cells: list[str], active: tuple[str | None, str | None], scalars: str | None
) -> tuple[str, bool]:
    """The name of the array to render and whether it is on cells; ``active`` are those of points and cells."""
    names = on_points + on_cells
    if scalars is None:
        scalars = active[0] or active[1] or (names[0] if len(names) == 1 else None)
    if not names:
        raise ValueError("the dataset has no point or cell array to render")
    if scalars not in names:
        problem = (
            "scalars must name the array, none is active" if scalars is None else f"scalars={scalars!r} is unknown"
        )
        raise ValueError(f"{problem}; there are {', '.join(map(repr, names))}")
    return scalars, scalars not in on_points


def _pick_array(image: pv.ImageData, scalars: str | None) -> tuple[NDArray, bool]:
    """The array to render and whether it is on cells."""
    points, cells = image.point_data, image.cell_data
    active = points.active_scalars_name, cells.active_scalars_name
    name, on_cells = array_to_render(list(points.keys()), list(cells.keys()), active, scalars)
    return (cells if on_cells else points)[name], on_cells
