"""What is under a mouse: where along the ray of a pixel most of its opacity comes from, and the scalar there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from .state import Presentation

Floats = NDArray[np.float64]
# Samples of the ray, so many a smallest voxel spacing, and at most.
RATE, MOST = 2.0, 4096
# Rays less opaque than this have hit nothing.
FAINT = 0.01


class Picked(NamedTuple):
    """A point of the world, the scalar there, and the opacity of the whole ray."""

    position: tuple[float, float, float]
    value: float
    opacity: float


def pick(volume: Any, presentation: Presentation, x: float, y: float) -> Picked | None:
    """The point of a ray where its opacity reaches half of what it comes to.

    Sampled twice a voxel: to know where one points, not to measure. ``image.pick`` is exact, but is of an
    image that was finished, has a kernel to compile when it is first asked, and builds parts of its own for each
    transfer function: a pointer waits for none of that.

    Parameters
    ----------
    x, y
        Column and row of the pixel, from the top left; (0, 0) is the centre of the first.

    Returns
    -------
    Picked or None
        None where the ray meets nothing, or nothing is known: of labels, and of fields without samples.
    """
    tf = presentation.transfer_function
    if tf is None or not hasattr(volume, "host"):
        return None
    origin, direction = ray(presentation.camera, presentation.size, x, y)
    to_index = np.linalg.inv(volume.index_to_world)
    start, way = to_index[:3, :3] @ origin + to_index[:3, 3], to_index[:3, :3] @ direction
    low, high = volume.index_box
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = np.array([(low - start) / way, (high - start) / way])
    enter, leave = float(np.nanmax(faces.min(axis=0))), float(np.nanmin(faces.max(axis=0)))
    if not presentation.camera.parallel:
        enter = max(enter, 0.0)
    if not enter < leave:
        return None
    count = int(min(RATE * (leave - enter) / volume.smallest_spacing, MOST)) + 1
    length = (leave - enter) / count
    t = enter + length * (np.arange(count) + 0.5)
    points = origin + t[:, None] * direction
    values = trilinear(volume.host(), start + t[:, None] * way)
    depth = tf.for_volume(volume).extinction(values, volume.smallest_spacing) * length
    # Of nan="transparent": beside an infinite sample there is nothing to see, as beside NaN.
    depth = np.where(np.isfinite(values), depth, 0.0)
    for clip in presentation.clips:
        depth = np.where(clip.keeps(points), depth, 0.0)
    opacity = -np.expm1(-np.cumsum(depth))
    if not opacity[-1] > FAINT:
        return None
    at = int(np.searchsorted(opacity, opacity[-1] / 2))
    x_, y_, z_ = points[at].tolist()
    return Picked((x_, y_, z_), float(values[at]), float(opacity[-1]))


def ray(camera: Camera, size: tuple[int, int], x: float, y: float) -> tuple[Floats, Floats]:
    """Origin and unit direction of the ray through a place in a picture, as those of :meth:`wvr.Camera.rays`."""
    origin, ahead = camera.unproject([x, x], [y, y], [0.0, 1.0], size)
    direction = ahead - origin
    return origin, direction / np.linalg.norm(direction)


def trilinear(samples: NDArray, points: Floats) -> Floats:
    """Samples [z, y, x] at index coordinates (x, y, z), shape (n, 3)."""
    last = np.array(samples.shape[::-1]) - 1
    points = np.clip(points, 0, last)
    cell = np.minimum(points.astype(int), np.maximum(last - 1, 0))
    part = points - cell
    result = np.zeros(len(points))
    for corner in range(8):
        offset = np.array([(corner >> axis) & 1 for axis in range(3)])
        i, j, k = np.minimum(cell + offset, last).T
        result += np.prod(np.where(offset, part, 1 - part), axis=1) * samples[k, j, i]
    return result
