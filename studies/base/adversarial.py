"""Scenes in which bounds are easily false, by kind, of any seed: each kind is drawn to where numbers are hard.

What a kind does not make hard it leaves small and random, so that many rays of many scenes can be enclosed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wvr

Rng = np.random.Generator
SIZE = (6, 6)


@dataclass(frozen=True, eq=False)
class Adversary:
    """A scene, its camera, and what else ``wvr.render`` and ``wvr.enclose`` are told of it."""

    volume: wvr.Volume
    tf: wvr.TransferFunction | None
    camera: wvr.Camera
    size: tuple[int, int] = SIZE
    options: dict[str, Any] = field(default_factory=dict)

    def render(self, integrator: wvr.integrators.Integrator, **options: Any) -> wvr.Image:
        return wvr.render(
            self.volume, self.tf, self.camera, self.size, integrator=integrator, **self.options, **options
        )

    def enclose(self, x: int, y: int, width: float = 1e-12) -> wvr.Enclosure:
        return wvr.enclose(self.volume, self.tf, self.camera, x, y, self.size, width=width, **self.options)


KINDS: dict[str, Callable[[Rng], Adversary]] = {}


def kind(make: Callable[[Rng], Adversary]) -> Callable[[Rng], Adversary]:
    KINDS[make.__name__.replace("_", " ")] = make
    return make


def adversary(name: str, seed: int) -> Adversary:
    """A scene of a kind."""
    return KINDS[name](np.random.default_rng([seed, *name.encode()]))


# --- What kinds are made of -----------------------------------------------------------------------------------------


def shape_of(rng: Rng, low: int = 2, high: int = 8) -> tuple[int, ...]:
    return tuple(int(n) for n in rng.integers(low, high, 3))


def view(rng: Rng, volume: wvr.Volume) -> wvr.Camera:
    """From anywhere, perspective or parallel."""
    up = rng.normal(size=3)
    return wvr.Camera.fit(volume, rng.normal(size=3), up, parallel=bool(rng.random() < 0.5))


def function(rng: Rng, low: float, high: float, jumps: bool = True, unit: float | None = None) -> wvr.TransferFunction:
    """A few control points around [low, high], some of them jumps, some stretches without extinction."""
    n = int(rng.integers(2, 8))
    s = np.sort(rng.uniform(low - 0.1 * (high - low), high + 0.1 * (high - low), n))
    if jumps:
        s = np.sort(np.append(s, rng.choice(np.unique(s), 1 if n < 4 else 2, replace=False)))
    opacity = rng.random(len(s)) ** rng.integers(1, 6) * (rng.random(len(s)) > 0.3)
    return wvr.TransferFunction.from_arrays(s, rng.random((len(s), 3)), opacity, unit)


def stairs(rng: Rng, levels: NDArray) -> wvr.TransferFunction:
    """Jumps at levels that samples have."""
    at = np.repeat(np.sort(rng.choice(levels, min(len(levels), int(rng.integers(1, 5))), replace=False)), 2)
    s = np.concatenate([[levels[0] - 1.0], at, [levels[-1] + 1.0]])
    opacity = rng.random(len(s)) * (rng.random(len(s)) > 0.4)
    return wvr.TransferFunction.from_arrays(s, rng.random((len(s), 3)), opacity)


def mask_of(rng: Rng, shape: tuple[int, ...]) -> NDArray:
    samples = (rng.random(shape) < 0.25).astype(float)
    lo = [int(rng.integers(0, n)) for n in shape]
    samples[lo[0] :, lo[1] :, lo[2] :] = 1
    return samples


def samples_of(rng: Rng) -> NDArray:
    """From 0 to 1: noise, or a mask."""
    shape = shape_of(rng)
    return rng.random(shape) if rng.random() < 0.6 else mask_of(rng, shape)


# --- Kinds ----------------------------------------------------------------------------------------------------------


@kind
def masks(rng: Rng) -> Adversary:
    """Of any dtype, jumps at their samples."""
    dtype = str(rng.choice(["uint8", "float64"]))
    volume = wvr.Volume(mask_of(rng, shape_of(rng)).astype(dtype))
    return Adversary(volume, stairs(rng, np.array([0.0, 1.0])), view(rng, volume))


@kind
def levels(rng: Rng) -> Adversary:
    """Few values, jumps at some of them."""
    samples = rng.integers(0, 5, shape_of(rng)).astype("uint8")
    volume = wvr.Volume(samples)
    return Adversary(volume, stairs(rng, np.arange(5.0)), view(rng, volume))


@kind
def offsets(rng: Rng) -> Adversary:
    """Samples far from zero for how far apart they are."""
    offset = float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(3, 13))
    samples = samples_of(rng) + offset
    volume = wvr.Volume(samples)
    low, high = samples.min(), samples.max()
    tf = function(rng, low, max(high, low + 1e-3 * abs(low)))
    return Adversary(volume, tf, view(rng, volume))


@kind
def scales(rng: Rng) -> Adversary:
    """Samples of any magnitude that float64 has."""
    scale = 10.0 ** rng.uniform(-300, 300)
    samples = samples_of(rng) * scale
    volume = wvr.Volume(samples)
    return Adversary(volume, function(rng, 0.0, scale), view(rng, volume))


@kind
def sheared(rng: Rng) -> Adversary:
    """Any direction that is far from singular, and spacings."""
    while True:
        direction = rng.normal(size=(3, 3))
        if abs(np.linalg.det(direction)) > 0.05:
            break
    spacing = 10.0 ** rng.uniform(-2, 2, 3)
    volume = wvr.Volume(samples_of(rng), spacing, rng.normal(0, 10, 3), direction)
    return Adversary(volume, function(rng, 0, 1), view(rng, volume))


@kind
def thin(rng: Rng) -> Adversary:
    """One or two samples along axes, or very many along one."""
    shape = [int(n) for n in rng.integers(1, 3, 3)]
    shape[int(rng.integers(3))] = int(rng.choice([1, 3, 9, 300]))
    volume = wvr.Volume(rng.random(shape), 10.0 ** rng.uniform(-1, 1, 3))
    return Adversary(volume, function(rng, 0, 1), view(rng, volume), (4, 4))


@kind
def distant(rng: Rng) -> Adversary:
    """A camera at a distance of up to 1e12."""
    volume = wvr.Volume(samples_of(rng))
    distance = 10.0 ** rng.uniform(1, 12)
    middle = volume.corners.mean(axis=0)
    way = rng.normal(size=3)
    position = middle + distance * way / np.linalg.norm(way)
    if rng.random() < 0.5:
        camera = wvr.Camera(position, middle, rng.normal(size=3), parallel_scale=4.0)
    else:
        camera = wvr.Camera(position, middle, rng.normal(size=3), view_angle=np.degrees(2 * np.arctan(4 / distance)))
    return Adversary(volume, function(rng, 0, 1), camera)


@kind
def spikes(rng: Rng) -> Adversary:
    """As narrow as rounding, or not quite, and as deep as they are narrow."""
    volume = wvr.Volume(rng.random(shape_of(rng)) * 64)
    at, width = rng.uniform(10, 54), 10.0 ** rng.uniform(-14, -1)
    shapes = {
        "up": [(at - width, 0), (at, 0.5), (at, 0)],
        "down": [(at - width, 0), (at - width, 0.5), (at, 0)],
        "both": [(at - width, 0), (at, 0.5), (at + width, 0)],
        "box": [(at - width, 0), (at - width, 0.5), (at, 0.5), (at, 0)],
    }
    points = [(s, rng.random(3), a) for s, a in shapes[str(rng.choice(list(shapes)))]]
    tf = wvr.TransferFunction(points, unit_distance=float(width / rng.choice([1, 8, 64])))
    return Adversary(volume, tf, view(rng, volume))


@kind
def ulps(rng: Rng) -> Adversary:
    """Control points a few units in the last place apart, at samples."""
    samples = rng.integers(0, 4, shape_of(rng)) / 3
    at = np.unique(samples)[-1] if rng.random() < 0.5 else 1 / 3
    near = [at]
    for _ in range(int(rng.integers(1, 5))):
        near.append(near[-1] + int(rng.integers(0, 3)) * np.spacing(near[-1]))
    s = np.array([near[0] - 1.0, *near, near[-1] + 1.0])
    s = np.delete(s, np.flatnonzero(s[2:] == s[:-2]))
    opacity = rng.random(len(s)) * (rng.random(len(s)) > 0.4)
    tf = wvr.TransferFunction.from_arrays(s, rng.random((len(s), 3)), opacity)
    volume = wvr.Volume(samples)
    return Adversary(volume, tf, view(rng, volume))


@kind
def clips(rng: Rng) -> Adversary:
    """Of every shape, faces of cells included."""
    volume = wvr.Volume(samples_of(rng))
    lo, hi = volume.corners.min(0), volume.corners.max(0)
    middle = rng.uniform(lo, hi)
    field = wvr.Volume(rng.random(shape_of(rng)), (hi - lo + 1e-3) * rng.uniform(0.2, 0.5, 3), lo)
    corner = np.minimum(np.floor(middle), hi - 0.5)
    every = [
        wvr.ClipPlane(middle, rng.normal(size=3), invert=bool(rng.random() < 0.5)),
        wvr.ClipPlane(corner, np.eye(3)[rng.integers(3)]),
        wvr.ClipBox(corner, corner + rng.integers(1, 4, 3), invert=bool(rng.random() < 0.5)),
        wvr.ClipSphere(middle, rng.uniform(0.5, 4), invert=bool(rng.random() < 0.5)),
        wvr.ClipVolume(field, float(rng.uniform(0.2, 0.8)), invert=bool(rng.random() < 0.5)),
    ]
    chosen = rng.choice(len(every), int(rng.integers(1, 4)), replace=False)
    return Adversary(volume, function(rng, 0, 1), view(rng, volume), options={"clip": [every[n] for n in chosen]})


@kind
def labels(rng: Rng) -> Adversary:
    """Two to four of them, at random or in layers, with jumps."""
    samples = samples_of(rng)
    count = int(rng.integers(2, 5))
    if rng.random() < 0.5:
        given = rng.integers(0, count, samples.shape)
    else:
        given = np.indices(samples.shape)[rng.integers(3)] % count
    functions = {n: function(rng, 0, 1) for n in range(count - 1)}
    other = function(rng, 0, 1) if rng.random() < 0.5 else None
    volume = wvr.Volume(samples)
    segmentation = wvr.Segmentation(given.astype("uint8"), functions, other)
    return Adversary(volume, None, view(rng, volume), options={"segmentation": segmentation})


@kind
def holes(rng: Rng) -> Adversary:
    """Samples that are NaN or infinite."""
    samples = rng.random(shape_of(rng, 3, 10)).astype(np.float32)
    samples[rng.random(samples.shape) < 0.05] = rng.choice([np.nan, np.inf, -np.inf])
    volume = wvr.Volume(samples, nan="transparent")
    return Adversary(volume, function(rng, 0, 1), view(rng, volume))


@kind
def inside(rng: Rng) -> Adversary:
    """The camera among the samples, often on a face, with an angle of view of nearly 0 to nearly 180 degrees."""
    volume = wvr.Volume(samples_of(rng))
    position = rng.uniform(0, volume.corners.max(0))
    snapped = rng.random(3) < 0.3
    position[snapped] = np.round(position[snapped])
    angle = float(rng.choice([rng.uniform(1, 179), 10.0 ** rng.uniform(-8, 0), 180 - 10.0 ** rng.uniform(-8, 0)]))
    camera = wvr.Camera(position, position + rng.normal(size=3), rng.normal(size=3), angle)
    return Adversary(volume, function(rng, 0, 1), camera)


@kind
def rolled(rng: Rng) -> Adversary:
    """``up`` nearly along the direction of view."""
    volume = wvr.Volume(samples_of(rng))
    middle = volume.corners.mean(axis=0)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    up = way
    while np.linalg.norm(np.cross(up / np.linalg.norm(up), way)) < 2e-9:  # nearer than that is refused
        up = way + 10.0 ** rng.uniform(-8.5, -1) * np.cross(way, rng.normal(size=3))
    return Adversary(volume, function(rng, 0, 1), wvr.Camera(middle + 16 * way, middle, up))


@kind
def origins(rng: Rng) -> Adversary:
    """All of the world far from its origin, a clip volume too."""
    home = rng.normal(size=3) * 10.0 ** rng.uniform(0, 10)
    volume = wvr.Volume(samples_of(rng), origin=home)
    size = np.ptp(volume.corners, axis=0)
    field = wvr.Volume(rng.random((3, 3, 3)), size / 2, home - rng.choice([0, 0.25]))
    clip = wvr.ClipVolume(field, float(rng.uniform(0.2, 0.6)))
    return Adversary(volume, function(rng, 0, 1), view(rng, volume), options={"clip": clip})


@kind
def aligned(rng: Rng) -> Adversary:
    """Rays along axes, some of them in faces of cells, samples that vary along the others."""
    samples = rng.random(shape_of(rng)) if rng.random() < 0.5 else rng.integers(0, 9, shape_of(rng)) / 8
    volume = wvr.Volume(samples)
    axis = int(rng.integers(3))
    middle = np.round(2 * volume.corners.mean(axis=0)) / 2
    way = np.eye(3)[axis] * rng.choice([-1, 1])
    scale = float(rng.choice([1.5, 3.0, rng.uniform(1, 4)]))
    up = np.eye(3)[(axis + 1) % 3]
    if rng.random() < 0.7:
        camera = wvr.Camera(middle - 9 * way, middle, up, parallel_scale=scale)
    else:
        camera = wvr.Camera(middle - 9 * way, middle, up)
    return Adversary(volume, function(rng, 0, 1), camera)


@kind
def deep(rng: Rng) -> Adversary:
    """Optical depths of a cell from next to nothing to 1e8, opacity 1 among them."""
    volume = wvr.Volume(samples_of(rng))
    unit = 10.0 ** rng.uniform(-8, 6)
    n = int(rng.integers(2, 6))
    s = np.linspace(-0.1, 1.1, n)
    opacity = np.where(rng.random(n) < 0.3, 1.0, rng.random(n))
    return Adversary(volume, wvr.TransferFunction.from_arrays(s, rng.random((n, 3)), opacity, unit), view(rng, volume))


@kind
def bright(rng: Rng) -> Adversary:
    """Colours beyond one."""
    volume = wvr.Volume(samples_of(rng))
    tf = function(rng, 0, 1)
    rgb = tf.colors * 10.0 ** rng.uniform(-2, 3, (len(tf.knots), 1))
    return Adversary(volume, wvr.TransferFunction.from_arrays(tf.knots, rgb, tf.opacities), view(rng, volume))


@kind
def tables(rng: Rng) -> Adversary:
    """A colour map of 256 entries."""
    volume = wvr.Volume(rng.integers(0, 256, shape_of(rng), np.uint8))
    tf = wvr.TransferFunction.from_colormap("viridis", (0, 255), rng.random(5) ** 3)
    return Adversary(volume, tf, view(rng, volume))


# --- What is said of them -------------------------------------------------------------------------------------------


def errors(pixel: NDArray, truth: wvr.Enclosure) -> tuple[float, float]:
    """What a pixel is off by in its worst channel: at least, and at most."""
    value = np.asarray(pixel, np.float64)
    below, above = truth.lower - value, value - truth.upper
    least = max(0.0, float(np.maximum(below, above).max()))
    most = float(np.maximum(truth.upper - value, value - truth.lower).max())
    return least, most
