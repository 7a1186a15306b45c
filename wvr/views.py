"""Where to look at a volume from: views by name, and one that suits what there is to see."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .camera import not_along
from .field.base import Field
from .framing import FAINT, visible_depths
from .suggest import suggestion

Floats = NDArray[np.float64]
ViewName = Literal[
    "iso", "xy", "yx", "xz", "zx", "yz", "zy", "anterior", "posterior", "left", "right", "superior", "inferior"
]


class View(NamedTuple):
    """Directions in the world: from the volume towards the camera, and upwards."""

    direction: Floats
    up: Floats


# Those of PyVista, whose iso looks down all three axes.
WORLD = {
    "iso": ((1, 1, 1), (0, 0, 1)),
    "xy": ((0, 0, 1), (0, 1, 0)),
    "yx": ((0, 0, -1), (1, 0, 0)),
    "xz": ((0, -1, 0), (0, 0, 1)),
    "zx": ((0, 1, 0), (1, 0, 0)),
    "yz": ((1, 0, 0), (0, 0, 1)),
    "zy": ((-1, 0, 0), (0, 1, 0)),
}
# A patient's, by directions: left, posterior, superior.
PATIENT = {
    "anterior": ((0, -1, 0), (0, 0, 1)),
    "posterior": ((0, 1, 0), (0, 0, 1)),
    "left": ((1, 0, 0), (0, 0, 1)),
    "right": ((-1, 0, 0), (0, 0, 1)),
    "superior": ((0, 0, 1), (0, -1, 0)),
    "inferior": ((0, 0, -1), (0, -1, 0)),
}
NAMES = (*WORLD, *PATIENT)
# Of what is visible at a face of the box, so much, and so many times what there is at the face across, is what things
# stand on, or where they go on: it is below.
TOUCHED, TIMES = 0.12, 1.8
# Where so much of all faces is visible, it is a part of something.
EVERYWHERE = 0.4
# So many times as long as broad, things stand upright; so many times as broad as thick, they are seen from their face.
TALL, FLAT = 1.4, 2.2


def named_view(name: str, volume: Field) -> View:
    """That of one of ``NAMES``.

    Raises
    ------
    ValueError
        For one of a patient where the volume does not say how it lies.
    """
    if name in WORLD:
        return View(*(np.array(vector, np.float64) for vector in WORLD[name]))
    axes = getattr(volume, "anatomical", "")
    if not axes:
        raise ValueError(
            f"camera={name!r} needs a volume whose file says how the patient lies (DICOM, NIfTI, some NRRD), or one "
            f'with volume.anatomical set, such as "LPS"'
        )
    return View(*(of_patient(vector, axes) for vector in PATIENT[name]))


def of_patient(vector: tuple[float, ...], axes: str) -> Floats:
    """A direction towards left, posterior, superior in a world whose axes run to ``axes``, such as ``"RAS"``."""
    towards = dict(zip("LPSRAI", (*vector, *(-component for component in vector)), strict=True))
    return np.array([towards[letter] for letter in axes], np.float64)


def seen_from(direction: Any) -> View:
    """From a direction: z is upwards, or y where that is along it (as of ``not_along``)."""
    up = np.array([0.0, 0.0, 1.0])
    along = not_along(up, direction)[2] != 1.0
    return View(np.asarray(direction, np.float64), np.array([0.0, 1.0, 0.0]) if along else up)


def front_and_up(volume: Field) -> tuple[Floats, Floats]:
    """Unit vectors in the world: the front of the volume, and upwards."""
    axes = getattr(volume, "anatomical", "")
    if axes:
        return of_patient((0, -1, 0), axes), of_patient((0, 0, 1), axes)
    return np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def seen_around(front: Floats, up: Floats, azimuth: float, elevation: float) -> View:
    """From an orbit, so many degrees counter-clockwise from the front, as seen from above, and above the horizon.

    ``front`` and ``up`` are orthonormal. Upwards in the image is the same everywhere, but given across the direction:
    next to the poles nothing would be left of what is along it.
    """
    around, above = np.radians(azimuth), np.radians(elevation)
    level = np.cos(around) * front + np.sin(around) * np.cross(up, front)
    return View(np.cos(above) * level + np.sin(above) * up, np.cos(above) * up - np.sin(above) * level)


def suggested_view(volume: Field) -> View:
    """A view that suits what is in a volume, whatever transfer function it is seen with.

    A patient is seen from the front, the head above; a single slice along its normal. Of other data no file says where
    up is. Things stand on something, or go on, at one face of the box much more than at the one across: that is
    below. Otherwise what is tall stands upright, and else z is up. The front is the side with the most relief, of a
    simulation that from which most of what is dense is seen, and it is seen a little from the side and from above.
    """
    axes = volume.index_to_world[:3, :3] / np.linalg.norm(volume.index_to_world[:3, :3], axis=0)
    thin = np.flatnonzero(volume.dimensions == 1)
    anatomical = getattr(volume, "anatomical", "")
    if len(thin) == 1:
        return _of_slice(axes, int(thin[0]), anatomical)
    if anatomical:
        tall, *rest = (
            abs(np.array(of_patient(axis, anatomical)) @ np.ptp(volume.corners, axis=0)) for axis in np.eye(3)[::-1]
        )
        # Of a few slices from head to foot there is most to see from above.
        towards = (0.2, -1.0, 2.5) if tall * FLAT < min(rest) else (0.4, -1.0, 0.2)
        return View(of_patient(towards, anatomical), of_patient((0, 0, 1), anatomical))
    if not hasattr(volume, "host") or len(thin):
        return View(np.array([1.0, 0.6, 0.4]), np.array([0.0, 0.0, 1.0]))
    depths, width = _usual_depths(volume)
    seen = depths > FAINT
    steps = width * np.linalg.norm(volume.index_to_world[:3, :3], axis=0)
    extent = np.array([np.ptp(np.nonzero(seen)[axis]) + 1 for axis in range(3)]) * steps
    # Scans are of whole numbers; what floats are simulated of, seldom stands.
    scanned = getattr(volume, "whole", False)
    up, sign = _upwards(seen, extent) if scanned else (2, 1)
    relief = {
        (axis, side): _relief(seen, axis, side) if scanned else _prominence(depths, axis, side)
        for axis in range(3)
        for side in (-1, 1)
        if axis != up
    }
    front, side = max(relief, key=lambda key: relief[key])
    other = 3 - up - front
    if extent[front] > TALL * extent[other]:
        # What is long is seen from its long side.
        front, other = other, front
        side = max((-1, 1), key=lambda side: relief[front, side])
    across = max((-1, 1), key=lambda side: relief[other, side])
    weights = np.zeros(3)
    weights[front], weights[other], weights[up] = side, 0.6 * across, 0.4 * sign
    if extent[up] * FLAT < np.sort(extent)[1]:
        weights[up], weights[front], weights[other] = sign, 0.5 * side, 0.25 * across
    return View(axes @ weights, axes[:, up] * sign)


def _usual_depths(volume: Any) -> tuple[NDArray[np.floating], int]:
    """Optical depths of blocks [x, y, z] as suggested, some of them more than ``FAINT``, and samples along one."""
    try:
        function = next(iter(suggestion(volume).functions.values()))
    except ValueError:  # samples that are all the same
        return np.ones((1, 1, 1)), max(volume.shape)
    depths, width = visible_depths(volume, function)
    depths = depths.transpose()
    return depths if (depths > FAINT).any() else np.ones_like(depths), width


def _of_slice(axes: Floats, normal: int, anatomical: str) -> View:
    """As radiologists look at slices: from the feet, the front or the left; others with the last axis upwards."""
    if anatomical:
        views = [View(*(of_patient(v, anatomical) for v in PATIENT[name])) for name in ("inferior", "anterior", "left")]
        return max(views, key=lambda view: abs(float(view.direction @ axes[:, normal])))
    up = 1 if normal == 2 else 2
    right = 3 - normal - up
    return View(np.cross(axes[:, right], axes[:, up]), axes[:, up])


def _upwards(seen: NDArray[np.bool_], extent: Floats) -> tuple[int, int]:
    """Axis and sign that point up."""
    touched = {(axis, side): float(np.take(seen, side, axis).mean()) for axis in range(3) for side in (0, -1)}
    order = np.argsort(extent)
    tall = int(order[-1])
    if extent[tall] > TALL * extent[order[-2]]:
        low, high = touched[tall, 0], touched[tall, -1]
        return tall, -1 if high > TOUCHED and high > TIMES * low else 1
    if np.mean(list(touched.values())) > EVERYWHERE:
        return 2, 1
    (axis, side), most = max(touched.items(), key=lambda item: item[1])
    if most > TOUCHED and most > TIMES * touched[axis, -1 - side]:
        return axis, 1 if side == 0 else -1
    return 2, 1


def _relief(seen: NDArray[np.bool_], axis: int, side: int) -> float:
    """How rough the surface of what is seen is from the side of an axis, times how much of it there is."""
    facing = np.flip(seen, axis) if side > 0 else seen
    depth = facing.argmax(axis).astype(np.float64)
    hit = facing.any(axis)
    rough = np.zeros_like(depth)
    for a in range(2):
        change = np.abs(np.diff(depth, axis=a)) * (np.diff(hit.astype(int), axis=a) == 0)
        rough += np.pad(np.minimum(change, 6), [(0, 1) if b == a else (0, 0) for b in range(2)])
    return float(np.sum((1 + rough) * hit))


def _prominence(depths: NDArray[np.floating], axis: int, side: int) -> float:
    """How much of what is dense is seen from the side of an axis: its depths, by the opacity that is not occluded.

    After the noteworthiness of Bordoloi and Shen, View Selection for Volume Rendering, IEEE Visualization 2005.
    """
    facing = np.flip(depths, axis) if side > 0 else depths
    before = np.cumsum(facing, axis) - facing
    return float(np.sum(facing * -np.expm1(-facing) * np.exp(-before)))
