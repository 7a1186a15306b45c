"""Volumes by name, generated or downloaded."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..io import read_raw
from ..volume import Volume

URL = "https://klacansky.com/open-scivis-datasets"


class Download(NamedTuple):
    """A file of the Open SciVis Datasets: samples x fastest, little endian."""

    identifier: str
    dimensions: tuple[int, int, int]
    dtype: str
    spacing: tuple[float, float, float]
    sha512: str  # as the site publishes it
    verified: bool = False  # whether the sum was seen to be that of the real file; only then it is insisted on

    @property
    def file(self) -> str:
        """Path below the site's address, and below the cache."""
        nx, ny, nz = self.dimensions
        return f"{self.identifier}/{self.identifier}_{nx}x{ny}x{nz}_{self.dtype}.raw"

    @property
    def bytes(self) -> int:
        """Size of the file."""
        return int(np.prod(self.dimensions)) * np.dtype(self.dtype).itemsize


def names() -> list[str]:
    """What :func:`load` knows: the generated volumes (the keys of ``GENERATED``), then those of ``DOWNLOADS``."""
    return [*GENERATED, *DOWNLOADS]


def load(name: str, size: int = 128, **options: Any) -> Volume:
    """A volume by name.

    Parameters
    ----------
    name
        One of :func:`names`.
    size
        Samples along each axis of a generated volume, >= 2; a downloaded one has the size it has.
    **options
        Of the generated volume: ``seed`` of ``"blobs"``, ``"turbulence"``, ``"tree"`` and ``"heart"``, ``count`` of
        ``"blobs"``, ``periods`` of ``"gyroid"``, ``phase`` of ``"heart"`` (of a beat, 0 to 1 and on); of a downloaded
        one: ``cache``, see :func:`fetch`.

    Raises
    ------
    ValueError
        For an unknown name or a size that is no integer >= 2.
    OSError
        When a download fails.
    """
    if name in DOWNLOADS:
        return fetch(name, **options)
    if name not in GENERATED:
        raise ValueError(f"name must be one of {', '.join(map(repr, names()))}, got {name!r}")
    if size != int(size) or size < 2:
        raise ValueError(f"size must be an integer >= 2, got {size!r}")
    return Volume(GENERATED[name](int(size), **options))


def fetch(name: str, cache: str | os.PathLike[str] | None = None) -> Volume:
    """A downloaded volume: from the cache, or the network the first time.

    Parameters
    ----------
    name
        One of ``DOWNLOADS``.
    cache
        Folder to keep files in; by default ``WVR_CACHE`` or the user's cache folder.

    Returns
    -------
    Volume
        Memory-mapped. Only a file of the right size and, where that is verified, SHA-512 sum stays in the cache.

    Warns
    -----
    UserWarning
        Where the published checksum was never verified: whether the file has it.

    Raises
    ------
    ValueError
        For an unknown name.
    OSError
        When the download fails or brings something else; the message says where to put the file by hand.
    """
    import pooch

    if name not in DOWNLOADS:
        raise ValueError(f"name must be one of {', '.join(map(repr, DOWNLOADS))}, got {name!r}")
    entry = DOWNLOADS[name]
    folder = Path(cache or os.environ.get("WVR_CACHE") or pooch.os_cache("wvr"))
    url = f"{os.environ.get('WVR_DATASETS_URL', URL).rstrip('/')}/{entry.file}"

    def download(url: str, output: str, pooch_: Any) -> None:
        pooch.HTTPDownloader(progressbar=_Progress(name), chunk_size=2**16)(url, output, pooch_)
        size = Path(output).stat().st_size
        if size != entry.bytes:
            raise ValueError(f"{size} bytes came, {entry.bytes} are expected")

    try:
        # Pooch downloads beside the file and moves it there once size and sum are right.
        known = f"sha512:{entry.sha512}" if entry.verified else None
        path = pooch.retrieve(url, known, entry.file, folder, downloader=download)
    except (OSError, ValueError) as error:
        raise OSError(
            f"could not download {name!r} from {url}: {error}; if you have the file, put it at {folder / entry.file} "
            f"(SHA-512 {entry.sha512}), or read another version with wvr.read_raw"
        ) from error
    if not entry.verified:
        same = pooch.file_hash(path, "sha512") == entry.sha512
        warnings.warn(
            f"the checksum of {name!r} is unverified: the published one, {entry.sha512[:16]}..., was never compared "
            f"with a real download; this file's is {'the same' if same else 'another'}",
            stacklevel=2,
        )
    return read_raw(path, entry.dimensions[::-1], entry.dtype, entry.spacing)


class _Progress:
    """What Pooch expects of a progress bar: a Rich bar, if it takes more than two seconds and someone is watching."""

    def __init__(self, name: str):
        self.name = name
        self.total = 0
        self.done = 0
        self.start = time.monotonic()
        self.bar: Any = None

    def update(self, count: int) -> None:
        self.done += count
        if self.bar is None and time.monotonic() - self.start > 2 and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

            columns = (TextColumn(self.name), BarColumn(), DownloadColumn(), TransferSpeedColumn())
            self.bar = Progress(*columns, console=Console(stderr=True))
            self.task = self.bar.add_task(self.name, total=self.total or None)
            self.bar.start()
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done)

    def reset(self) -> None:
        self.done = 0

    def close(self) -> None:
        if self.bar is not None:
            self.bar.stop()


# --- Generated ------------------------------------------------------------------------------------------------------


def _axes(size: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Coordinates z, y, x in [-1, 1] at the samples, shaped to broadcast to (z, y, x)."""
    line = np.linspace(-1, 1, size, dtype=np.float32)
    return line[:, None, None], line[:, None], line


def _marschner_lobb(size: int) -> NDArray:
    """The test signal of Marschner & Lobb, "An Evaluation of Reconstruction Filters for Volume Rendering", 1994."""
    alpha, frequency = 0.25, 6.0
    z, y, x = (axis.astype(np.float64) for axis in _axes(size))
    ripple = np.cos(2 * np.pi * frequency * np.cos(np.pi / 2 * np.hypot(x, y)))
    return ((1 - np.sin(np.pi / 2 * z) + alpha * (1 + ripple)) / (2 * (1 + alpha))).astype(np.float32)


def _spheres(size: int) -> NDArray:
    """A ball (255) within two shells (170, 85), edges linear over two voxels."""
    z, y, x = _axes(size)
    radius = np.sqrt(x * x + y * y + z * z)
    voxel = 2 / (size - 1)
    field = np.zeros_like(radius)
    for inner, outer, level in ((-1.0, 0.25, 255), (0.45, 0.55, 170), (0.75, 0.85, 85)):
        depth = np.minimum(radius - inner, outer - radius) / voxel
        field += level * _coverage(depth)
    return _rounded(field)


def _coverage(depth: NDArray) -> NDArray:
    """Share of a voxel that is inside, from the depth below the surface in voxels: smooth over two."""
    return np.clip(0.5 + depth / 2, 0, 1)


def _rounded(field: NDArray) -> NDArray[np.uint8]:
    return np.clip(np.rint(field), 0, 255).astype(np.uint8)


# Ellipsoids of the three-dimensional Shepp-Logan head phantom as in M. Schabel's phantom3d (MATLAB Central 9416), with
# the higher contrast of P. Toft, "The Radon Transform", 1996: grey value in tenths, half axes, centre, rotation about z
# in degrees.
_SHEPP_LOGAN = (
    (10, (0.69, 0.92, 0.81), (0.0, 0.0, 0.0), 0),
    (-8, (0.6624, 0.874, 0.78), (0.0, -0.0184, 0.0), 0),
    (-2, (0.11, 0.31, 0.22), (0.22, 0.0, 0.0), -18),
    (-2, (0.16, 0.41, 0.28), (-0.22, 0.0, 0.0), 18),
    (1, (0.21, 0.25, 0.41), (0.0, 0.35, -0.15), 0),
    (1, (0.046, 0.046, 0.05), (0.0, 0.1, 0.25), 0),
    (1, (0.046, 0.046, 0.05), (0.0, -0.1, 0.25), 0),
    (1, (0.046, 0.023, 0.05), (-0.08, -0.605, 0.0), 0),
    (1, (0.023, 0.023, 0.02), (0.0, -0.606, 0.0), 0),
    (1, (0.023, 0.046, 0.02), (0.06, -0.605, 0.0), 0),
)


def _shepp_logan(size: int) -> NDArray:
    """The head phantom, each sample the sum of the ellipsoids it is in: no smoothing."""
    z, y, x = _axes(size)
    field = np.zeros((size, size, size), np.int8)
    for grey, (a, b, c), (cx, cy, cz), degrees in _SHEPP_LOGAN:
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        along, across = cos * (x - cx) + sin * (y - cy), cos * (y - cy) - sin * (x - cx)
        disc = (along / a) ** 2 + (across / b) ** 2
        field += np.int8(grey) * (disc + ((z - cz) / c) ** 2 <= 1)
    return field / np.float32(10)


def _blobs(size: int, seed: int = 1, count: int = 60) -> NDArray:
    """A sum of Gaussians, 8 to 16 % of the cube wide, scaled to 0 .. 255."""
    rng = np.random.default_rng(seed)
    centre, width = rng.uniform(0.1, 0.9, (count, 3, 1)), rng.uniform(0.08, 0.16, (count, 1, 1))
    height = rng.uniform(0.5, 1.0, count)
    line = np.linspace(0, 1, size)
    gx, gy, gz = np.exp(-(((line - centre) / width) ** 2) / 2).transpose(1, 0, 2)
    plane = (gy[:, :, None] * gx[:, None, :]).reshape(count, -1)
    field = ((gz.T * height).astype(np.float32) @ plane.astype(np.float32)).reshape(size, size, size)
    lo, hi = field.min(), field.max()
    return _rounded((field - lo) * (255 / (hi - lo)))


def _gyroid(size: int, periods: float = 3.0) -> NDArray:
    """Schoen's minimal surface, the zero of sin x cos y + sin y cos z + sin z cos x."""
    z, y, x = (np.float32(np.pi * periods) * axis for axis in _axes(size))
    return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)


def _turbulence(size: int, seed: int = 1) -> NDArray:
    """Vorticity magnitude of :func:`_vorticity`, scaled to a root mean square of 1."""
    squares = np.sum([component**2 for component in _vorticity(size, seed)], axis=0)
    mean = max(squares.mean(dtype=np.float64), np.finfo(np.float32).tiny)  # two samples resolve no wave at all
    return np.sqrt(squares / np.float32(mean))


def _vorticity(size: int, seed: int) -> list[NDArray[np.float32]]:
    """Components of the curl of a periodic velocity of random, divergence-free waves with Kolmogorov's spectrum.

    Wave numbers reach 24; neither they nor the energy ``E(k) ~ k**(-5/3)`` depend on ``size``, so other sizes sample
    the same flow, as far as they resolve it.
    """
    top = 24
    line = np.arange(-top, top + 1)
    k = np.stack(np.meshgrid(line, line, line, indexing="ij"))  # along z, y, x
    length = np.sqrt((k**2).sum(axis=0))
    kept = (length > 0) & (length <= top) & (length < size / 2)
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *k.shape))
    # Amplitude of a wave: E(k) is shared by the 4 pi k**2 waves of its shell.
    wave = (real + 1j * imaginary) * np.where(kept, length.clip(1) ** (-11 / 6), 0)
    curl = 1j * np.cross(k, wave, axis=0)  # blind to the divergence that the waves have
    curl += curl[:, ::-1, ::-1, ::-1].conj()  # a real field: opposite waves are conjugate
    spectra = np.zeros((3, size, size, size // 2 + 1), np.complex64)
    inside = np.abs(line) < size / 2
    right = inside & (line >= 0)
    for spectrum, waves in zip(spectra, curl, strict=True):
        spectrum[np.ix_(line[inside], line[inside], line[right])] = waves[np.ix_(inside, inside, right)]
    return [np.fft.irfftn(spectrum, (size, size, size), axes=(0, 1, 2)).astype(np.float32) for spectrum in spectra]


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


def _tree(size: int, seed: int = 1) -> NDArray:
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
    return _rounded(np.abs(field + rng.standard_normal(field.shape, np.float32)))


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
    np.maximum(part, level * _coverage(scale * depth(x, y[:, None], z[:, None, None])), out=part)


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


def _heart(size: int, phase: float = 0.0, seed: int = 1) -> NDArray:
    """Two ventricles that beat, as a 4D ultrasound probe at the top sees them: blood 20, muscle 120, outside 40.

    ``phase`` 0 is the end of filling, 0.35 that of contraction, and 1 is 0 again. The left ventricle ejects 58 % of its
    blood, the volume of its wall stays. Echoes have the statistics of speckle, which changes smoothly over a cycle.
    """
    if not np.isfinite(phase):
        raise ValueError(f"phase must be a finite number, got {phase!r}")
    cycle = phase % 1.0
    # How contracted: 0 to 1 and back, each a half wave.
    squeeze = np.sin(np.pi / 2 * (cycle / 0.35 if cycle < 0.35 else (1 - cycle) / 0.65)) ** 2
    z, y, x = _axes(size)
    voxel = np.float32(2 / (size - 1))

    def spheroid(center: tuple[float, float, float], across: float, along: float) -> NDArray[np.float32]:
        """Depth below the surface, exact in first order."""
        p, q, r = ((a - np.float32(c)) for a, c in zip((x, y, z), center, strict=True))
        radius = np.sqrt((p * p + q * q) / np.float32(across**2) + r * r / np.float32(along**2))
        steep = np.sqrt((p * p + q * q) / np.float32(across**4) + r * r / np.float32(along**4))
        return (1 - radius) * radius / np.maximum(steep, voxel)

    # Volumes over 4 pi / 3: the wall's is what lies between 0.31 x 0.62 and 0.45 x 0.74.
    wall = 0.45**2 * 0.74 - 0.31**2 * 0.62
    inner, length = 0.31 * (1 - 0.3 * squeeze), 0.62 * (1 - 0.15 * squeeze)
    around = 0.74 * (1 - 0.08 * squeeze)
    left = -0.18, 0.0, -0.1
    left_blood = spheroid(left, inner, length)
    left_wall = spheroid(left, np.sqrt((wall + inner**2 * length) / around), around)
    right = 0.28 - 0.06 * squeeze, 0.0, -0.15
    right_blood = spheroid(right, 0.34 * (1 - 0.15 * squeeze), 0.52 * (1 - 0.12 * squeeze))
    right_wall = spheroid(right, 0.34 * (1 - 0.15 * squeeze) + 0.08, 0.52 * (1 - 0.12 * squeeze) + 0.08)
    muscle = np.maximum(left_wall, np.minimum(right_wall, -left_wall))
    # Two papillary muscles rise from the wall of the left ventricle.
    for side in (-1, 1):
        foot = left[0] - 0.5 * inner, 0.75 * side * inner, left[2] + 0.05
        muscle_here = spheroid(foot, 0.3 * inner, 0.45 * length)
        left_blood = np.minimum(left_blood, -muscle_here)
    blood = np.maximum(left_blood, np.minimum(right_blood, -left_wall))
    level = 40 + 80 * _coverage(muscle / voxel)
    level += (20 - level) * _coverage(blood / voxel)
    # The pyramid in front of the probe.
    below = np.float32(1.15) - z
    seen = np.minimum(0.72 * below - np.maximum(np.abs(x), np.abs(y)), 2.1 - np.sqrt(x * x + y * y + below * below))
    return _rounded(level * (0.45 + 0.55 * _speckle(size, cycle, seed)) * _coverage(seen / voxel))


def _speckle(size: int, cycle: float, seed: int) -> NDArray[np.float32]:
    """Amplitude of the echo of many scatterers, Rayleigh-distributed with mean 1, blurred as a probe does.

    It turns from one field into another and back, so that neighbours in time look alike, and a cycle is closed.
    """
    rng = np.random.default_rng(seed)
    turn = np.cos(2 * np.pi * cycle), np.sin(2 * np.pi * cycle)
    squares = np.zeros((size, size, size), np.float32)
    for _ in ("in phase", "in quadrature"):
        echo = np.zeros_like(squares)
        for weight in turn:
            echo += np.float32(weight) * rng.standard_normal(squares.shape, np.float32)
        for axis in (0, 1, 2):
            # Finer along the beam.
            for _ in range(1 if axis == 0 else 2):
                echo = (np.roll(echo, 1, axis) + 2 * echo + np.roll(echo, -1, axis)) / np.float32(4)
        squares += echo**2
    return np.sqrt(squares * np.float32(4 / np.pi) / squares.mean())


GENERATED: dict[str, Callable[..., NDArray]] = {
    "marschner_lobb": _marschner_lobb,
    "spheres": _spheres,
    "shepp_logan": _shepp_logan,
    "blobs": _blobs,
    "gyroid": _gyroid,
    "turbulence": _turbulence,
    "tree": _tree,
    "heart": _heart,
}

DOWNLOADS: dict[str, Download] = {
    "aneurism": Download(
        "aneurism",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "31f1232cbf75b0182f172375e46cc57fe013c0edaae292f2358e2477052ca974"
        "faae92efd803a2d229172b851b5ddaa461129872b89bd6ce45d43bfe595eed43",
        verified=True,
    ),
    "backpack": Download(
        "backpack",
        (512, 512, 373),
        "uint16",
        (0.9766, 0.9766, 1.25),
        "f929fb231367792b260db6de2214fb64a27785870f472503930cf34c6cc7b1c2"
        "2603c1eb2164381ec1f799c8e1040a151edca4e094d2ed1cbfc70a85d4f1eba8",
    ),
    "blunt_fin": Download(
        "blunt_fin",
        (256, 128, 64),
        "uint8",
        (1, 0.75, 1),
        "d5da3701268d92dd84e9a18db3ad126d01408983ce4efde38ffa0c096029d9b1"
        "c80c9094c5d1dc9baeff4e076c97c195137d200c99b3eee862dcf1d22dfe9df7",
    ),
    "bonsai": Download(
        "bonsai",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "b34156a0ffc80ffaf84d069f3d05a40fdd999a35f05492829a2b0c13403a3147"
        "e73712b1d10c2cc34da66a59540a1632dae6adc96f3ebf3efa5d4d6c10598997",
        verified=True,
    ),
    "bunny": Download(
        "bunny",
        (512, 512, 361),
        "uint16",
        (0.337891, 0.337891, 0.5),
        "58c8de50e5e9638278a36c9ddb10d0948721b5821e62dff3dada7b783341b6e5"
        "d346014b8545f504eb33952ea5c91e3ca93d10a5ce6a78b32ecabd10bb9438f3",
    ),
    "carp": Download(
        "carp",
        (256, 256, 512),
        "uint16",
        (0.78125, 0.390625, 1),
        "0ec57ca05d700e25a87cc2ca976c066f52e254c0269aa5fb7decb08ba3607cbf"
        "996b5d72aac8671dfe6589a794935d3fd820aaa756e6f6d32b84def15455fea5",
    ),
    "engine": Download(
        "engine",
        (256, 256, 128),
        "uint8",
        (1, 1, 1),
        "f17228483b1b5edb90146eac90ba979531629a2880d9e7a0493a98290da8af6a"
        "c2cf80f2c567a3d08695dc7dd854916c861dad8856b2d5721501954e913de13f",
        verified=True,
    ),
    "foot": Download(
        "foot",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "56a73bd1f694a09809688f5b0bbf0dfff0ef3e853a34c60c4d51bef02dd96fbf"
        "e5191f47c7762bdf7caab6f9a22f1d0e830652779f87c70cc519f345221edd0e",
    ),
    "frog": Download(
        "frog",
        (256, 256, 44),
        "uint8",
        (0.5, 0.5, 1),
        "0421e05c1c3fdce41f96ac93d0ba59c0aed29bb9d53a5d395f859e737b67db19"
        "e6ab39806028bddc6e5b2acde1d97581f81745d380f141ae144cec923974b0d1",
    ),
    "fuel": Download(
        "fuel",
        (64, 64, 64),
        "uint8",
        (1, 1, 1),
        "77fdd7c657da1946bafc84e88c6b8a03ae104a79a5bdec3c7db9257480ef4bf7"
        "2551a08d22fd237c8e387dd2571b575f1a1a11f5f32b1fa4d4ef385d9fe1d613",
        verified=True,
    ),
    "hydrogen_atom": Download(
        "hydrogen_atom",
        (128, 128, 128),
        "uint8",
        (1, 1, 1),
        "bc80b55ffc983f41b3981433707b59f6c8b3f16cc9cd3ea18087cb9e734b702e"
        "b1ad0410f36f38881b2e2fa85617dc0858bb2d9fbd3188abb39af43ea84e3521",
        verified=True,
    ),
    "lobster": Download(
        "lobster",
        (301, 324, 56),
        "uint8",
        (1, 1, 1.4),
        "efb1c15bfda13b6899b923d2c51caea00d2eaffb95d89343e64298266d231a12"
        "902e376353d5c258a6ccffd54c363bc186aea19de631982f85158a4b70e0e671",
    ),
    "mri_ventricles": Download(
        "mri_ventricles",
        (256, 256, 124),
        "uint8",
        (0.9, 0.9, 0.9),
        "fd522a0c616d3367ec5c8f63efe918825f032882bf2e50c10d4e155c4db6a14d"
        "139a5b6a0e7cedd0cda69aaf1c89d3aad60a984a72b57fc6e2eca48f34ef54e0",
    ),
    "mri_woman": Download(
        "mri_woman",
        (256, 256, 109),
        "uint16",
        (1, 1, 1.5),
        "f14941ef8e9cabd751fe2c433b4cfaef7ad846c05eeea8026d541e3e32dcc5b0"
        "4cb04ea4f605188059d371d0967218bef9529429be53d9e88ff72f964f73938f",
    ),
    "mrt_angio": Download(
        "mrt_angio",
        (416, 512, 112),
        "uint16",
        (0.412, 0.412, 0.412),
        "81ee88eabd067b7929a5337d7c709b0b44408394a40318aae917df8b8a72735d"
        "3766105c1580938da6ab1670315f93cbc92bb940ae988e6c72b7157c9018d7c4",
    ),
    "neghip": Download(
        "neghip",
        (64, 64, 64),
        "uint8",
        (1, 1, 1),
        "d00f95d1f4cb1da2f3260a722059527ace73514cd57e1c31b6724d18468fd810"
        "02f5da704a0c3c7ccf06a329a975dede38cfacf13387dea9ffd8d7542cae62d0",
        verified=True,
    ),
    "nucleon": Download(
        "nucleon",
        (41, 41, 41),
        "uint8",
        (1, 1, 1),
        "5703198390210caac5a9aaa51cfffd822bbf1835cb40bb183cfd946dd1d4c0f0"
        "b72030431c5eed1eb9a30eaaaeb48b00cb97ba3a50b01367c90e00b9ecf00210",
    ),
    "shockwave": Download(
        "shockwave",
        (64, 64, 512),
        "uint8",
        (1, 1, 1),
        "b483bdee37e943e284e146ec2097ed6f263f19e5007916e3eff7e1ad5f8ecd99"
        "db4419cd5eedff236c22727bc2f920fb7dab28ff8e8de4c64866c3efb4e33e6d",
    ),
    "silicium": Download(
        "silicium",
        (98, 34, 34),
        "uint8",
        (1, 1, 1),
        "8ef2b9a84eb94693596b57f3f21f5ea75c1c25654011e3aed39a27f5e4259ebb"
        "bd2486ff39bb32b551bb44f3fa25123e7128cfd3fc053134f0806e23bb24a819",
    ),
    "skull": Download(
        "skull",
        (256, 256, 256),
        "uint8",
        (1, 1, 1),
        "6b31b8c3c056e4fca2c908c8feffe1ad4872e1201feafe136ed22178d2593f54"
        "9c4a8328b2f6ec7d7855271f28f7a4981ffae8ced9ff21df11652abe7c0766bc",
    ),
    "statue_leg": Download(
        "statue_leg",
        (341, 341, 93),
        "uint8",
        (1, 1, 4),
        "79f4f46fceb019c2d08a95c69e11735df52cfd933cda1d56624e10f38558ee09"
        "e87c754171be8c553e7b3df5eded2c8de92d837058b29394c577c925a96d41d0",
    ),
    "stent": Download(
        "stent",
        (512, 512, 174),
        "uint16",
        (0.8398, 0.8398, 3.2),
        "b6f3ddccbb2a5585664a3173b86a034f12540f8d306a050074619d7c52780d6b"
        "7252757d754682e8b38c4419ac3c3caaab38e12628cbbf18b3814b239429155e",
    ),
    "teapot": Download(
        "boston_teapot",
        (256, 256, 178),
        "uint8",
        (1, 1, 1),
        "b2bf7ba8ba7a7d5a8ea76ccd8fd2c0f5f043079a83cd6a3055e85f5e0a40c1c4"
        "d872b9bbc7aedf628989eb57bffd5729767c29fe8ae018c581406b196caa6359",
        verified=True,
    ),
    "tooth": Download(
        "tooth",
        (103, 94, 161),
        "uint8",
        (1, 1, 1),
        "5ee3d77ae951e129d29062a4fd4d8730fd8670bdaf4d01ddf907848072180cbf"
        "ea8ab897880147d2a79dc7f1d1806a34b32853074eca88f6758e01382469f9f6",
        verified=True,
    ),
    "vis_male": Download(
        "vis_male",
        (128, 256, 256),
        "uint8",
        (1.57774, 0.995861, 1.00797),
        "55a3ecfb1e40685b993d51e713c9752609d5eb09359e86365c53bfbd535e77ea"
        "ebfddf0eeacc73f42650726c82ed4b9ce4d0929a265ed84e1c59f39c6dd66e78",
    ),
}
