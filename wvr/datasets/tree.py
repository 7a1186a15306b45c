"""A little tree, grown limb by limb."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .fields import coverage, rounded


class _Limb(NamedTuple):
    """A piece of wood: a capsule from ``start`` to ``end`` whose radius changes linearly. In units of the cube."""

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    radii: tuple[float, float]
    level: float


class _Leaf(NamedTuple):
    """A flat ellipsoid."""

    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    radius: float
    level: float


def tree(size: int, seed: int = 1) -> NDArray:
    """A little tree in a pot, up along z, with the bonsai CT's grey levels: leaves 40-70, wood 100-150, pot 180-255.

    The air is 0 with noise of a few grey levels, and so is everything else; surfaces are smooth over two voxels.
    """
    rng = np.random.default_rng(seed)
    limbs: list[_Limb] = []
    leaves: list[_Leaf] = []
    _grow(rng, limbs, leaves, np.array([0.5, 0.5, 0.19]), np.array([0.1, 0.0, 1.0]), 0.31, 0.042, 4)
    field = np.zeros((size, size, size), np.float32)
    _stamp_pot(field)
    for leaf in leaves:
        _stamp_leaf(field, leaf)
    for limb in limbs:
        _stamp_limb(field, limb)
    return rounded(np.abs(field + rng.standard_normal(field.shape, np.float32)))


def _unit(vector: NDArray) -> NDArray:
    return vector / np.linalg.norm(vector)


def _grow(
    rng: np.random.Generator,
    limbs: list[_Limb],
    leaves: list[_Leaf],
    start: NDArray,
    heading: NDArray,
    length: float,
    radius: float,
    generations: int,
) -> None:
    """A wandering branch of four limbs; younger branches at all joints but the first, leaves on the youngest."""
    level = rng.uniform(105, 145)
    turn = rng.uniform(0, 2 * np.pi)
    for joint in range(4):
        heading = _unit(heading + rng.normal((0, 0, 0.1), 0.15, 3))
        end = start + heading * length / 4
        limbs.append(_Limb(start, end, (radius, 0.85 * radius), level))
        start, radius, turn = end, 0.85 * radius, turn + 2.4  # about the golden angle, as leaves and branches turn
        if generations and joint:
            side = np.array([np.cos(turn), np.sin(turn), 0.1])
            aim = _unit(0.5 * heading + side * rng.uniform(0.7, 1.1))
            _grow(rng, limbs, leaves, start, aim, length * rng.uniform(0.6, 0.75), 0.7 * radius, generations - 1)
        if generations < 2:
            for _ in range(4):
                centre = start + rng.normal(0, 0.018, 3)
                normal = _unit(rng.normal((0, 0, 1), 1, 3))
                leaves.append(_Leaf(centre, normal, rng.uniform(0.016, 0.026), rng.uniform(42, 68)))


def _stamp(field: NDArray, lo: NDArray, hi: NDArray, level: float, depth: Callable[..., NDArray]) -> None:
    """Raises ``field`` to ``level`` where ``depth(x, y, z)`` > 0, looking in the box lo, hi. In units of the cube."""
    scale = len(field) - 1
    first = np.maximum(np.floor(lo * scale - 1), 0).astype(int)
    last = np.minimum(np.ceil(hi * scale + 1), scale).astype(int) + 1
    if np.any(first >= last):
        return
    x, y, z = (np.arange(a, b, dtype=np.float32) / scale for a, b in zip(first, last, strict=True))
    part = field[first[2] : last[2], first[1] : last[1], first[0] : last[0]]
    np.maximum(part, level * coverage(scale * depth(x, y[:, None], z[:, None, None])), out=part)


def _stamp_limb(field: NDArray, limb: _Limb) -> None:
    along = limb.end - limb.start
    thick = max(limb.radii)

    def depth(*xyz: NDArray) -> NDArray:
        offset = [p - np.float32(s) for p, s in zip(xyz, limb.start, strict=True)]
        t = np.clip(sum(o * np.float32(a / (along @ along)) for o, a in zip(offset, along, strict=True)), 0, 1)
        distance = np.sqrt(sum((o - t * np.float32(a)) ** 2 for o, a in zip(offset, along, strict=True)))
        return limb.radii[0] + t * (limb.radii[1] - limb.radii[0]) - distance

    _stamp(field, np.minimum(limb.start, limb.end) - thick, np.maximum(limb.start, limb.end) + thick, limb.level, depth)


def _stamp_leaf(field: NDArray, leaf: _Leaf) -> None:
    flatness = 0.45

    def depth(*xyz: NDArray) -> NDArray:
        offset = [p - np.float32(c) for p, c in zip(xyz, leaf.centre, strict=True)]
        height = sum(o * np.float32(n) for o, n in zip(offset, leaf.normal, strict=True))
        squared = sum(o * o for o in offset) + height**2 * np.float32(flatness**-2 - 1)
        # Near the surface the ellipsoid's implicit function, made a distance along its thin side.
        return (leaf.radius - np.sqrt(squared)) * flatness

    _stamp(field, leaf.centre - leaf.radius, leaf.centre + leaf.radius, leaf.level, depth)


def _stamp_pot(field: NDArray) -> None:
    """A round pot (240) that widens upwards, with a rim, filled with soil (190)."""
    bottom, top, rim, wall = 0.03, 0.2, 0.025, 0.02

    def outside(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
        radius = 0.15 + 0.4 * (z - bottom) + np.where(z > top - rim, np.float32(0.015), np.float32(0))
        return np.minimum(radius - np.hypot(x - 0.5, y - 0.5), np.minimum(z - bottom, top - z))

    def inside(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
        radius = 0.15 + 0.4 * (z - bottom) - wall
        return np.minimum(radius - np.hypot(x - 0.5, y - 0.5), z - bottom - wall)

    lo, hi = np.array([0.2, 0.2, bottom]), np.array([0.8, 0.8, top])
    _stamp(field, lo, hi, 240, lambda x, y, z: np.minimum(outside(x, y, z), -inside(x, y, z)))
    _stamp(field, lo, hi, 190, lambda x, y, z: np.minimum(inside(x, y, z), top - rim / 2 - z))
