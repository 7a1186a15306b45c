"""Handles in a picture that drag clips: where they are, and what a drag or a key makes of the settings.

A handle follows the pointer: it is moved to where, of all places that it may have, it is under the pointer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..display import EDGES
from .clips import THIN, box_of, plane_of, reach, sphere_of
from .state import State

Floats = NDArray[np.float64]
Changes = dict[str, Any]
# The arrow that tilts a plane, in heights of the picture.
ARROW = 0.15
# What an arrow key is worth, of the whole range or in radians, and that of page up and down in arrow keys.
STEP, PAGE = 0.01, 10.0
# A line that is seen at a smaller sine than this is seen from its end: there is no place on it under a pointer.
STEEP = 0.15
# Points of a circle.
ROUND = np.linspace(0, 2 * np.pi, 65)


class View(NamedTuple):
    """A camera and the size of its picture; places are column and row, as of :meth:`wvr.Camera.project`."""

    camera: Camera
    size: tuple[int, int]

    def place(self, points: Floats) -> Floats:
        return self.camera.project(points, self.size)

    def ray(self, place: Floats) -> tuple[Floats, Floats]:
        """Origin and unit direction of the ray through a place."""
        x, y = place
        origin, ahead = self.camera.unproject([x, x], [y, y], [0.0, 1.0], self.size)
        return origin, _unit(ahead - origin)

    def pixel(self, point: Floats) -> float:
        """How wide a pixel is where a point is [world length]; NaN behind the camera."""
        depth = 1.0 if self.camera.parallel else float((point - self.camera.position) @ self.camera.basis()[2])
        return 2 * self.camera.half_height * depth / self.size[1] if depth > 0 else np.nan


@dataclass(frozen=True)
class Handle(ABC):
    """A place that changes a clip of a kind as it is moved.

    Attributes
    ----------
    name, label
        For programs and for people; ``text`` says what it is set to, and ``value`` does as a number in ``span``.
    position
        In the world.
    """

    kind: str
    name: str
    label: str
    position: Floats
    value: float
    text: str
    span = (0.0, 1.0)

    @abstractmethod
    def pull(self, view: View, place: Floats) -> Changes:
        """What is set by moving it to a place of the picture."""

    @abstractmethod
    def nudge(self, view: View, steps: Floats) -> Changes:
        """What is set by steps to the right, upwards and away."""


@dataclass(frozen=True)
class Rail(Handle):
    """Moves along a direction, on which the value grows by 1 in a length."""

    direction: Floats
    length: float
    change: Callable[[float], Changes]

    def pull(self, view: View, place: Floats) -> Changes:
        here = view.place(self.position)
        sight = view.ray(here)[1]
        if np.linalg.norm(np.cross(self.direction, sight)) < STEEP:  # upwards is onwards
            way = (here[1] - place[1]) * view.pixel(self.position)
        else:
            # Where the line is nearest to the ray.
            origin, ray = view.ray(place)
            offset, cosine = self.position - origin, float(self.direction @ ray)
            way = (cosine * (ray @ offset) - self.direction @ offset) / max(1 - cosine**2, 1e-9)
        return self.change(self.value + float(way) / self.length)

    def nudge(self, view: View, steps: Floats) -> Changes:
        return self.change(self.value + STEP * float(steps @ (1, 1, PAGE)))


@dataclass(frozen=True)
class Rim(Handle):
    """On the outline of a ball: its radius is how far the ray under the pointer passes its centre."""

    center: Floats
    unit: float

    def pull(self, view: View, place: Floats) -> Changes:
        origin, ray = view.ray(place)
        return {"radius": float(np.linalg.norm(np.cross(self.center - origin, ray))) / self.unit}

    def nudge(self, view: View, steps: Floats) -> Changes:
        return {"radius": self.value + STEP * float(steps @ (1, 1, PAGE))}


@dataclass(frozen=True)
class Hub(Handle):
    """The centre of a ball, which moves across the view, and within the volume's box."""

    low: Floats
    extent: Floats

    def pull(self, view: View, place: Floats) -> Changes:
        origin, ray = view.ray(place)
        forward = view.camera.basis()[2]
        return self._to(origin + (self.position - origin) @ forward / (ray @ forward) * ray)

    def nudge(self, view: View, steps: Floats) -> Changes:
        return self._to(
            self.position + STEP * float(np.linalg.norm(self.extent)) * steps @ np.array(view.camera.basis())
        )

    def _to(self, point: Floats) -> Changes:
        return {"center": np.clip((point - self.low) / self.extent, 0, 1).tolist()}


@dataclass(frozen=True)
class Tip(Handle):
    """The tip of a plane's normal, moved on a ball around a point of the plane; outside of it, to its far side."""

    anchor: Floats
    normal: Floats
    corners: Floats
    span = (-1.0, 1.0)

    def pull(self, view: View, place: Floats) -> Changes:
        origin, ray = view.ray(place)
        length = float(np.linalg.norm(self.position - self.anchor))
        across = origin + (self.anchor - origin) @ ray * ray - self.anchor
        passes = float(np.linalg.norm(across)) / length
        side = -1.0 if self.normal @ view.ray(view.place(self.position))[1] <= 0 else 1.0
        if passes <= 1:
            return self._to(across / length + side * np.sqrt(1 - passes**2) * ray)
        beyond = min(passes - 1, np.pi / 2)
        return self._to(np.cos(beyond) * _unit(across) - side * np.sin(beyond) * ray)

    def nudge(self, view: View, steps: Floats) -> Changes:
        return self._to(_unit(self.normal + 2 * STEP * steps @ np.array(view.camera.basis())))

    def _to(self, normal: Floats) -> Changes:
        along = self.corners @ normal
        at = (self.anchor @ normal - along.min()) / np.ptp(along)
        return {"normal": normal.tolist(), "at": float(at)}


def handles(state: State, corners: Floats) -> list[Handle]:
    """Those of the clips that are on, of a volume with these corners; where two are at one place the last is above."""
    cuts, view = state.cuts, View(state.presentation.camera, state.presentation.size)
    found: list[Handle] = []
    if cuts["plane"]["on"]:
        found += _of_plane(state, corners, view)
    if cuts["box"]["on"]:
        found += _of_box(cuts["box"], corners)
    if cuts["sphere"]["on"]:
        found += _of_sphere(cuts["sphere"], corners, view)
    return found


def anchor_of(state: State, corners: Floats) -> Floats:
    """Where a plane's handles are: in the middle of its cut through the volume's box, unless they are held."""
    point, normal = plane_of(state.cuts["plane"], corners)
    middle = _section(point, normal, corners).mean(axis=0) if state.anchor is None else np.array(state.anchor)
    return middle + (point - middle) @ normal * normal


def lines(state: State, corners: Floats) -> list[tuple[str, Floats]]:
    """Kinds and points of the lines that show the clips that are on."""
    cuts, view = state.cuts, View(state.presentation.camera, state.presentation.size)
    found = []
    if cuts["plane"]["on"]:
        point, normal = plane_of(cuts["plane"], corners)
        section = _section(point, normal, corners)
        found.append(("plane", np.concatenate([section, section[:1]])))
        tip, move = _of_plane(state, corners, view)
        found.append(("plane", np.array([move.position, tip.position])))
    if cuts["box"]["on"]:
        ends = np.array(box_of(cuts["box"], corners))
        of_box = np.array([[ends[(c >> axis) & 1, axis] for axis in range(3)] for c in range(8)])
        found += [("box", of_box[[a, b]]) for a, b in EDGES]
    if cuts["sphere"]["on"]:
        middle, radius, (right, up) = _outline(*sphere_of(cuts["sphere"], corners), view)
        found.append(("sphere", middle + radius * (np.cos(ROUND)[:, None] * right + np.sin(ROUND)[:, None] * up)))
    return found


def overlay(state: State, corners: Floats) -> Changes:
    """Handles and lines for a page to draw: places are parts of the picture's width and height."""
    view = View(state.presentation.camera, state.presentation.size)

    def parts(points: Floats) -> Any:
        return np.round((view.place(points) + 0.5) / view.size, 5)

    shown = [(handle, parts(handle.position)) for handle in handles(state, corners)]
    drawn = [(kind, parts(points)) for kind, points in lines(state, corners)]
    return {
        "handles": [
            {
                "name": handle.name,
                "kind": handle.kind,
                "sort": type(handle).__name__.lower(),
                "label": handle.label,
                "value": handle.value,
                "span": handle.span,
                "text": handle.text,
                "at": at.tolist(),
            }
            for handle, at in shown
            if np.all(np.isfinite(at))
        ],
        "lines": [(kind, at.tolist()) for kind, at in drawn if np.all(np.isfinite(at))],
    }


def _of_plane(state: State, corners: Floats, view: View) -> tuple[Handle, Handle]:
    plane = state.cuts["plane"]
    normal = plane_of(plane, corners)[1]
    anchor = anchor_of(state, corners)
    tip = anchor + ARROW * view.size[1] * view.pixel(anchor) * normal
    said = ", ".join(f"{part:.2f}" for part in normal)
    tilt = Tip(
        "plane", "plane normal", "Tilt the plane", tip, float(normal[2]), f"normal {said}", anchor, normal, corners
    )  # fmt: skip
    length, at = float(np.ptp(corners @ normal)), plane["at"]
    move = Rail(
        "plane", "plane at", "Move the plane", anchor, at, f"{at:.3f} of the way", normal, length, lambda at: {"at": at}
    )
    return tilt, move


def _of_box(box: dict[str, Any], corners: Floats) -> list[Handle]:
    faces, low, extent = box_of(box, corners), corners.min(axis=0), np.ptp(corners, axis=0)
    parts, middle = (np.array(faces) - low) / extent, np.mean(faces, axis=0)
    found: list[Handle] = []
    for axis, letter in enumerate("xyz"):
        for end, (name, word) in enumerate((("lo", "lower"), ("hi", "upper"))):
            least, most = (parts[0, axis] + THIN, 1.0) if end else (0.0, parts[1, axis] - THIN)

            def change(
                value: float, name: str = name, axis: int = axis, least: float = least, most: float = most
            ) -> Changes:
                return {name: [*box[name][:axis], float(np.clip(value, least, most)), *box[name][axis + 1 :]]}

            position = middle.copy()
            position[axis] = faces[end][axis]
            label, text = f"Move the {word} {letter} face of the box", f"{letter} at {position[axis]:.4g}"
            found.append(
                Rail(
                    "box",
                    f"box {name} {letter}",
                    label,
                    position,
                    float(parts[end, axis]),
                    text,
                    np.eye(3)[axis],
                    float(extent[axis]),
                    change,
                )
            )
    return found


def _of_sphere(sphere: dict[str, Any], corners: Floats, view: View) -> list[Handle]:
    center, radius = sphere_of(sphere, corners)
    middle, outline, (right, _) = _outline(center, radius, view)
    said = ", ".join(f"{part:.4g}" for part in center)
    return [
        Rim(
            "sphere", "sphere radius", "Radius of the sphere", middle + outline * right, sphere["radius"],
            f"radius {radius:.4g}", center, reach(corners),
        ),
        Hub(
            "sphere", "sphere center", "Move the sphere", center, float(sphere["center"][0]), f"centre {said}",
            corners.min(axis=0), np.ptp(corners, axis=0),
        ),
    ]  # fmt: skip


def _section(point: Floats, normal: Floats, corners: Floats) -> Floats:
    """The corners of a plane's cut through the volume's box, in order around it; if none, the nearest corner."""
    side = (corners - point) @ normal
    cut = [
        corners[a] + side[a] / (side[a] - side[b]) * (corners[b] - corners[a])
        for a, b in EDGES
        if np.sign(side[a]) != np.sign(side[b])  # their product may be too small for a number
    ]
    if not cut:
        return corners[[np.argmin(np.abs(side))]]
    found = np.array(cut)
    offset = found - found.mean(axis=0)
    across = _unit(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))]))
    return found[np.argsort(np.arctan2(offset @ np.cross(normal, across), offset @ across))]


def _outline(center: Floats, radius: float, view: View) -> tuple[Floats, float, tuple[Floats, Floats]]:
    """Centre, radius and axes of the circle that is the outline of a ball; not a number from within it."""
    right, up, _ = view.camera.basis()
    if view.camera.parallel:
        return center, radius, (right, up)
    towards = view.camera.position - center
    distance = float(np.linalg.norm(towards))
    if distance <= radius:
        return np.full(3, np.nan), radius, (right, up)
    towards /= distance
    level = _unit(np.cross(up, towards))
    middle = center + radius**2 / distance * towards
    return middle, radius * float(np.sqrt(1 - (radius / distance) ** 2)), (level, np.cross(towards, level))


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)
