"""What a renderer asks of a field: a scalar on a box of cells, and where it is in the world."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..cached import cached_property
from ..keep import Keeper, Part


class Field(ABC):
    """A scalar field over a box of unit cells in index coordinates.

    A field brings its device half (as of ``kernels.field.grid``) and fills its struct. One without ``blocks`` is
    rendered whole, without leaping over what is empty, by integrators that sample it; those that go cell by cell also
    need its half's ``cubic``, ``centered`` or ``extent``, and say so (:attr:`wvr.integrators.Integrator.asks`).
    """

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int, int]:
        """Nodes along z, y, x; there is a cell between two."""

    @property
    @abstractmethod
    def index_to_world(self) -> NDArray[np.float64]:
        """4 x 4 affine map from index coordinates (i, j, k) along x, y, z to world coordinates."""

    @property
    @abstractmethod
    def range(self) -> tuple[float, float]:
        """Smallest and largest scalar."""

    @property
    @abstractmethod
    def half(self) -> Any:
        """The device half."""

    @abstractmethod
    def struct(self, keep: Keeper, shift: float) -> Any:
        """The half's struct, filled, for scalars minus ``shift``."""

    #: Whether scalars may be reduced by a shift.
    shifts: bool = False
    #: Whether scalars at nodes are whole numbers.
    whole: bool = False
    #: Whether its samples are in a store and read as they are seen, in bricks.
    stored: bool = False
    #: Bytes of its samples.
    nbytes: int = 0
    #: How often its samples changed.
    version: int = 0

    def look(self) -> None:  # noqa: B027 - most have nothing to notice
        """Notice samples that changed since this was called last; for fields that have some."""

    def missing_on(self, device: wp.Device) -> int:
        """Bytes of its samples that are not on a device yet, and will be."""
        return 0 if device.is_cpu else self.nbytes

    def scaled(self, exponent: int) -> Field:
        """The same with scalars times ``2**exponent``; asked for where ``shifts``."""
        raise NotImplementedError

    def blocks(self) -> Part | None:
        """Ranges of its blocks of cells, as of :class:`wvr.field.blocks.Ranges`; None where they are not known."""
        return None

    @property
    def dimensions(self) -> NDArray[np.int64]:
        """Nodes along x, y, z."""
        return np.array(self.shape[::-1])

    @cached_property
    def smallest_spacing(self) -> float:
        """The smallest distance between neighbouring nodes along an axis [world length]."""
        return float(np.min(np.linalg.norm(self.index_to_world[:3, :3], axis=0)))

    @property
    def entire(self) -> Field:
        """The field of whose rays images are: this one, or that which a brick is a part of."""
        return self

    @property
    def index_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner of the box in index coordinates; an axis with one node is one spacing thick."""
        thin = self.dimensions == 1
        return np.where(thin, -0.5, 0.0), np.where(thin, 0.5, self.dimensions - 1.0)

    @cached_property
    def corners(self) -> NDArray[np.float64]:
        """The box's eight corners in world coordinates, shape (8, 3), x fastest."""
        lo, hi = self.index_box
        pick = np.array([[(c >> a) & 1 for a in range(3)] for c in range(8)])
        corners = np.where(pick, hi, lo) @ self.index_to_world[:3, :3].T + self.index_to_world[:3, 3]
        corners.flags.writeable = False
        return corners

    @cached_property
    def longest(self) -> float:
        """Length of the longest ray through the box [smallest voxel spacing]."""
        diagonals = (self.corners - self.corners[::-1])[:4]
        return float(np.linalg.norm(diagonals, axis=1).max()) / self.smallest_spacing
