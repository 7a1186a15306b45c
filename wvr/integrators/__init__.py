"""The integrators: how a ray's integral is approximated. Lengths are in units of the smallest voxel spacing."""

from typing import TypeAlias

from .adaptive_preintegrated import AdaptivePreintegrated
from .adaptive_simpson import AdaptiveSimpson
from .base import Integrator
from .certified import Certified
from .exact import Exact
from .isosurface import Isosurface
from .projection import Projection
from .uniform import Preintegrated, Riemann, Simpson

KINDS = (
    Riemann,
    Simpson,
    Preintegrated,
    AdaptivePreintegrated,
    AdaptiveSimpson,
    Exact,
    Certified,
    Projection,
    Isosurface,
)


# Those whose images have a bound, for type checkers.
Bounding: TypeAlias = Certified | Projection | Isosurface


def of_tolerance(tolerance: float) -> Integrator:
    """The integrator whose image is within a tolerance."""
    return Certified(tolerance)


__all__ = [
    "KINDS",
    "AdaptivePreintegrated",
    "AdaptiveSimpson",
    "Bounding",
    "Certified",
    "Exact",
    "Integrator",
    "Isosurface",
    "Preintegrated",
    "Projection",
    "Riemann",
    "Simpson",
    "of_tolerance",
]
