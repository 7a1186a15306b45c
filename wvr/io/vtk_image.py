"""What both kinds of VTK's files with regular grids have: arrays by name on points or cells, and where they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interop import array_to_render, vtk_place
from ..samples import Grid, Unsupported, components_error
from .bytes import Flaw


class Array(NamedTuple):
    """One that can be read: components a sample, and how its samples are got as ``[z, y, x]``."""

    components: int
    load: Callable[[], NDArray]


class Image(NamedTuple):
    """A regular grid in a file; ``active`` are the names that it calls its scalars, or None, on points and cells."""

    extent: NDArray[np.int64]
    spacing: NDArray[np.float64]
    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    on_points: dict[str, Array]
    on_cells: dict[str, Array]
    active: tuple[str | None, str | None]

    @property
    def points(self) -> tuple[int, int, int]:
        """How many along x, y, z."""
        nx, ny, nz = (self.extent[1::2] - self.extent[::2] + 1).tolist()
        return nx, ny, nz

    def grid(self, path: Path, scalars: str | None) -> Grid:
        """The samples of an array and their place."""
        if not self.on_points and not self.on_cells:
            raise Flaw("it has no array on points or cells")
        try:
            name, on_cells = array_to_render(list(self.on_points), list(self.on_cells), self.active, scalars)
        except ValueError as error:
            raise Unsupported(f"{path}: {error}") from None
        array = (self.on_cells if on_cells else self.on_points)[name]
        if array.components != 1:
            raise components_error(f"{path}, array {name!r},", array.components)
        origin, steps = vtk_place(self.extent, self.spacing, self.origin, self.direction, on_cells)
        return Grid(array.load(), steps, origin, "", (path,))


def cells(points: tuple[int, ...]) -> tuple[int, ...]:
    """How many cells there are between points; a flat axis has one."""
    return tuple(max(n - 1, 1) for n in points)
