"""Where a grid is in the world, which stays as it is."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cached import cached_property
from .validation import finite_vector, float_array

# Lengths in the world, and one over them, whose squares and products are numbers.
FARTHEST = 1e100
# How many times as long as others edges of a cell may be: fourth powers of a ray's length in it are numbers.
LONGEST = 1e60


class Fixed:
    """Something of which some attributes stay as they are: what is kept was made of them."""

    #: Names of those.
    fixed: ClassVar[tuple[str, ...]] = ()

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.fixed and name in vars(self):
            kind = type(self).__name__
            raise AttributeError(f"{name} of a {kind} stays as it is, what is kept was made of it: make another {kind}")
        super().__setattr__(name, value)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        # Copies of arrays can be written into: those, and what was made of them.
        for name, value in state.items():
            derived = isinstance(getattr(type(self), name, None), cached_property)
            if isinstance(value, np.ndarray) and (derived or name in self.fixed):
                value.flags.writeable = False


class Posed(Fixed):
    """A grid in the world."""

    fixed = ("spacing", "origin", "direction")
    spacing: NDArray[np.float64]
    origin: NDArray[np.float64]
    direction: NDArray[np.float64]

    @cached_property
    def index_to_world(self) -> NDArray[np.float64]:
        """4 x 4 affine map from sample indices (i, j, k) along x, y, z to world coordinates."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.direction * self.spacing
        matrix[:3, 3] = self.origin
        matrix.flags.writeable = False
        return matrix


def pose_of(
    spacing: ArrayLike, origin: ArrayLike, direction: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Spacing, origin and direction of a grid, read-only, as numbers that images can be made with."""
    steps = finite_vector(spacing, "spacing", "lengths > 0 along x, y, z")
    if np.any(steps <= 0):
        raise ValueError(f"spacing must be > 0 along x, y and z, got {tuple(steps.tolist())}")
    if steps.min() < 1 / FARTHEST or steps.max() > FARTHEST:
        raise ValueError(f"spacing must be from {1 / FARTHEST:g} to {FARTHEST:g}, got {tuple(steps.tolist())}")
    first = finite_vector(origin, "origin", "the position of sample (0, 0, 0)")
    if np.abs(first).max() > FARTHEST:
        raise ValueError(f"origin must be within {FARTHEST:g}, got {tuple(first.tolist())}")
    axes = direction_of(np.eye(3) if direction is None else direction)
    edges = np.linalg.norm(axes / np.abs(axes).max(axis=0), axis=0) * np.abs(axes).max(axis=0) * steps
    if edges.max() > 1.000001 * LONGEST * edges.min() or edges.min() < 1 / FARTHEST or edges.max() > FARTHEST:
        raise ValueError(
            f"spacing must have cells with edges from {1 / FARTHEST:g} to {FARTHEST:g}, none more than {LONGEST:g} "
            f"times as long as another, got {tuple(steps.tolist())}: with the direction {tuple(edges.tolist())}"
        )
    for array in (steps, first, axes):
        array.flags.writeable = False
    return steps, first, axes


def direction_of(matrix: ArrayLike) -> NDArray[np.float64]:
    try:
        direction = float_array(matrix, "direction")
    except TypeError:
        direction = np.empty(0)
    if direction.shape != (3, 3) or not np.all(np.isfinite(direction)):
        raise ValueError(f"direction must be a finite 3 x 3 matrix, got {matrix!r}")
    if abs(np.linalg.det(direction)) <= 1e-9 * np.prod(np.linalg.norm(direction, axis=0)):
        raise ValueError(f"direction must not be singular, got {direction.tolist()}")
    return direction
