"""The device half of a field: what kernels ask of it, and the only place that knows how samples lie in memory."""

from dataclasses import dataclass
from typing import Any

from .cell import make_centered, make_cubic, make_extent
from .climb import make_climb
from .cubics import make_centered as make_centered_of
from .cubics import make_cubics, make_cubics_one_by_one
from .gradients import make_gradients
from .incline import make_incline
from .narrow import make_narrow
from .peaks import make_seek
from .samples import make_differences, make_samples, make_value


@dataclass(frozen=True)
class Grid:
    """The device half of samples on a regular grid. Halves of other fields have the same attributes and methods.

    ``Struct`` has at least ``last``, the last cell along x, y, z.
    """

    dtype: type  # of the stored samples
    finite: bool  # no sample is NaN or infinite

    @property
    def Struct(self) -> Any:
        return make_samples(self.dtype)

    def value(self, real: type) -> Any:
        """``value(field, p)`` -> ``real``, the field at index coordinates p."""
        return make_value(self.dtype, real, self.finite)

    def differences(self, real: type, kind: str) -> Any:
        """``differences(field, p)`` -> its gradient there, per index; ``kind`` is "central" or "cell"."""
        return make_differences(self.dtype, real, kind, self.finite)

    def cubic(self) -> Any:
        """``cubic(field, i, j, k, p, d)`` -> vec4d, it in a cell along p + t d, p from the cell's first corner."""
        return make_cubic(self.dtype)

    def centered(self) -> Any:
        """``centered(field, i, j, k, p, d, h)`` -> vec4d, the same about p over v = t / h in [-1, 1]."""
        return make_centered(self.dtype)

    def extent(self) -> Any:
        """``extent(field, i, j, k)`` -> lowest, highest corner of a cell."""
        return make_extent(self.dtype)

    def seek(self, sign: int) -> Any:
        """``seek`` of ``field.peaks``, from cell to cell in which there may be more or, with a sign of -1, less."""
        return make_seek(self.dtype, sign)

    def climb(self, sign: int) -> Any:
        """``climb`` of ``field.climb``, to the most along a ray or, with a sign of -1, the least, in vectors."""
        return make_climb(self.dtype, sign)

    def cubics(self, vectors: bool, count: int) -> Any:
        """``cubics`` of ``field.cubics``, of up to ``count`` cells: in vectors, or one by one."""
        return make_cubics(self.dtype, count) if vectors else make_cubics_one_by_one(self.dtype)

    def centered_of(self) -> Any:
        """``centered`` of ``field.cubics``, of many cells, in vectors."""
        return make_centered_of(self.dtype)

    def narrow(self) -> Any:
        """``narrow`` of ``field.narrow``, of a cell in single precision."""
        return make_narrow(self.dtype)

    def gradients(self, kind: str) -> Any:
        """``gradients`` of ``field.gradients``, of many cells; ``kind`` is as of ``differences``."""
        return make_gradients(self.dtype, kind == "central")

    def incline(self, kind: str) -> Any:
        """``incline`` of ``field.incline``, of a cell in single precision."""
        return make_incline(self.dtype, kind == "central")
