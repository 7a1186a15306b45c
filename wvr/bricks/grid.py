"""How a grid is cut into bricks, which of them are in front of which, and which pixels see one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..field.base import Field

Index = tuple[int, int, int]
Rect = tuple[slice, slice]
# Beyond any grid, as ``kernels.ray.FAR``.
FAR = 1.0e300
# Of which axes the corners of a box are at the upper end.
UPPER = np.array(list(product((False, True), repeat=3)))


@dataclass(frozen=True)
class Bricks:
    """Bricks of the box of a field, along x, y, z: from the samples ``edges[axis][i]`` to ``edges[axis][i + 1]``.

    Bricks share the layer of samples between them, so that each cell is of one brick. Any split is the whole, since a
    ray is the composition of its parts.
    """

    edges: tuple[tuple[int, ...], ...]

    @classmethod
    def regular(cls, dimensions: NDArray[np.int64], size: Index) -> Bricks:
        """Bricks of so many cells along x, y, z, the last ones of as many as are left."""
        return cls(
            tuple((*range(0, max(n - 1, 1), step), n - 1) for n, step in zip(dimensions.tolist(), size, strict=True))
        )

    @classmethod
    def of_chunks(cls, starts: tuple[tuple[int, ...], ...], towards: Index) -> Bricks:
        """A brick for each chunk of samples, with the layer of its neighbours in front that it needs.

        Parameters
        ----------
        starts
            The first sample of each chunk along x, y, z, and one past the last.
        towards
            The chunk that the camera is in, or nearest to: cells between two chunks are of the one farther from it.
            Whoever goes from there outwards needs each chunk once, and of those before their last layers.
        """
        edges = []
        for along, at in zip(starts, towards, strict=True):
            inner = [start - 1 if k > at else start for k, start in enumerate(along[1:-1], 1)]
            edges.append((0, *inner, along[-1] - 1))
        return cls(tuple(edges))

    @property
    def counts(self) -> Index:
        """Bricks along x, y, z."""
        return tuple(len(along) - 1 for along in self.edges)  # type: ignore[return-value]

    def __iter__(self) -> Iterator[Index]:
        return product(*map(range, self.counts))  # type: ignore[return-value]

    def box(self, index: Index) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and last sample along x, y, z that are a brick's own."""
        pairs = [along[i : i + 2] for along, i in zip(self.edges, index, strict=True)]
        return np.array([a for a, _ in pairs]), np.array([b for _, b in pairs])

    def own(self, index: Index) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same, far beyond the box where the brick is at its end: what of a ray is in the box is the ray's."""
        low, high = (corner.astype(np.float64) for corner in self.box(index))
        at = np.array(index)
        return np.where(at == 0, -FAR, low), np.where(at == np.array(self.counts) - 1, FAR, high)

    def near(self, place: NDArray[np.float64]) -> Index:
        """The brick that a place is in, or nearest to."""
        found = [int(np.searchsorted(along[1:-1], p, "right")) for along, p in zip(self.edges, place, strict=True)]
        return tuple(found)  # type: ignore[return-value]

    def first(self, field: Field, camera: Camera) -> Index:
        """The brick that all rays go away from."""
        to_index = np.linalg.inv(field.index_to_world[:3, :3])
        if not camera.parallel:
            return self.near(to_index @ (camera.position - field.index_to_world[:3, 3]))
        forward = to_index @ camera.basis()[2]
        return tuple(0 if d >= 0 else n - 1 for d, n in zip(forward, self.counts, strict=True))  # type: ignore[return-value]

    def waves(self, first: Index) -> list[list[Index]]:
        """All bricks by their distance from the first one, along the axes: a ray goes from brick to brick away from it,
        so that no two of a wave are on one ray, and those of a wave before are in front.
        """
        waves: list[list[Index]] = [[] for _ in range(sum(self.counts))]
        for index in self:
            waves[sum(abs(i - j) for i, j in zip(index, first, strict=True))].append(index)
        return [wave for wave in waves if wave]


def in_order(bricks: Bricks, field: Field, camera: Camera) -> list[Index]:
    """All bricks that have cells, from the camera outwards, wave by wave."""
    numbers = [np.flatnonzero(np.diff(along)) if len(along) > 2 else np.zeros(1, int) for along in bricks.edges]
    order = np.stack(np.meshgrid(*numbers, indexing="ij"), axis=-1).reshape(-1, 3)
    distances = np.abs(order - bricks.first(field, camera)).sum(axis=1)
    return list(map(tuple, order[np.argsort(distances, kind="stable")].tolist()))


def footprint(
    field: Field, box: tuple[NDArray, NDArray], camera: Camera, basis: tuple, size: tuple[int, int]
) -> Rect | None:
    """Rows and columns of the pixels that may see a box in index coordinates; None where there are none. ``basis`` is
    the camera's.

    A pixel more on each side, and the whole image where the box reaches to the camera's plane, or where pixels are so
    small that rounding counts.
    """
    width, height = size
    low, high = box
    corners = np.where(UPPER, high, low) @ field.index_to_world[:3, :3].T + field.index_to_world[:3, 3]
    right, up, depth = from_camera(corners, field, camera, basis)
    reach = float(np.abs(corners - camera.position).max())
    half: Any = camera.half_height
    if not camera.parallel:
        if (depth < -1e-9 * reach).all():
            return None
        if (depth <= 1e-6 * reach).any():
            return slice(0, height), slice(0, width)
        half = half * depth
    x, y = (across / half * height / 2 for across in (right, -up))
    if np.abs([x, y]).max() > 1e9:
        return slice(0, height), slice(0, width)
    columns = _span(x + (width - 1) / 2, width)
    rows = _span(y + (height - 1) / 2, height)
    return None if columns is None or rows is None else (rows, columns)


def from_camera(
    points: NDArray[np.float64], field: Field, camera: Camera, basis: tuple
) -> tuple[NDArray[np.float64], ...]:
    """How far world points (n, 3) are to the right of a view's axis, above it, and ahead of the camera. As of rays,
    from the nearer of the two points that define it, so that no digits are lost, however far away the other is.
    """
    middle = field.corners.mean(axis=0)
    near = min(camera.position, camera.target, key=lambda point: float(np.abs(point - middle).max()))
    right, up, ahead = ((points - near) @ axis for axis in basis)
    return right, up, ahead + (near is camera.target) * float(np.linalg.norm(camera.target - camera.position))


def common(a: Rect | None, b: Rect | None) -> Rect | None:
    """The pixels of both; None where there are none."""
    if a is None or b is None:
        return None
    rows, columns = (slice(max(i.start, j.start), min(i.stop, j.stop)) for i, j in zip(a, b, strict=True))
    return (rows, columns) if rows.stop > rows.start and columns.stop > columns.start else None


def _span(at: NDArray[np.float64], count: int) -> slice | None:
    first, end = max(int(np.floor(at.min())) - 1, 0), min(int(np.ceil(at.max())) + 2, count)
    return slice(first, end) if end > first else None
