"""Files to volumes: how each is parsed, by whom, and why is on the page on files of the documentation.

World coordinates are those of the file, or, where those are left-handed, the right-handed ones of the same x: what it
says of spacing, origin and orientation ends up in ``Volume.spacing``, ``.origin`` and ``.direction``. Where a file
states a slope and an intercept, they are applied. A volume keeps the file's dtype. Types it does not accept (bool, 32-
and 64-bit integers) become the smallest of uint8, int8, uint16, int16, float64 that holds every value exactly, or are
refused if none does.
"""

from ..interop import from_pyvista, to_pyvista
from ..samples import NanPolicy
from .readers import read, read_raw

__all__ = ["NanPolicy", "from_pyvista", "read", "read_raw", "to_pyvista"]
