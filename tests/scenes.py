"""Scenes that all integrators are tested against: volumes, masks and labels, and transfer functions with all they may
have.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import wvr

from .helpers import centered


def transfer_functions(lo: float, hi: float) -> dict[str, wvr.TransferFunction]:
    """By name, over the scalars lo to hi; colours vary, within a cell too."""
    d = hi - lo
    rng = np.random.default_rng(1)
    s = np.linspace(lo, hi, 64)
    points = {
        "smooth": [(0.1, "navy", 0.0), (0.5, "orange", 0.05), (1, "white", 0.3)],
        "opaque": [(0.2, "black", 0.0), (0.3, "red", 0.9), (0.6, "yellow", 0.99), (1, "white", 1.0)],
        "jumps": [(0.3, "blue", 0.0), (0.3, "red", 0.4), (0.7, "green", 0.4), (0.7, "white", 0.0)],
        "jumps at ends": [(0, "red", 0.9), (0, "navy", 0.0), (0.5, "navy", 0.1), (1, "gold", 0.3), (1, "white", 0.1)],
    }
    named = {name: wvr.TransferFunction([(lo + t * d, c, a) for t, c, a in p]) for name, p in points.items()}
    named["spikes"] = wvr.TransferFunction.isosurfaces(
        [lo + 0.35 * d, lo + 0.55 * d, lo + 0.8 * d], opacity=0.6, width=2 * d / 255
    )
    named["color map"] = wvr.TransferFunction.from_colormap("viridis", (lo, hi), [0, 0, 0.1, 0.3])
    named["random"] = wvr.TransferFunction.from_arrays(s, rng.random((64, 3)), 0.6 * rng.random(64) ** 3)
    bright = wvr.TransferFunction.from_arrays([lo, hi], [[5, 0, 1], [0, 9, 2]], [0.0, 0.3])
    return named | {"bright": bright}


def volumes() -> dict[str, wvr.Volume]:
    """By name: smooth and noisy, of any spacing and pose, with absent samples, thin and far from zero."""
    rng = np.random.default_rng(0)
    smooth = wvr.datasets.load("blobs", 32).numpy()
    noisy = np.clip(smooth.astype(float) + rng.normal(0, 4, smooth.shape), 0, 255).astype(np.uint8)
    holes = rng.random((13, 9, 21)).astype(np.float32)
    holes[rng.random(holes.shape) < 0.02] = np.nan
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return {
        "noisy": centered(noisy),
        "anisotropic": wvr.Volume(noisy[::2, :, ::4].copy(), (4, 1, 2), (1e3, -50, 7), turn),
        "offset": centered((1e6 + rng.random((9, 17, 12))).astype(np.float64)),
        "far": centered((1e12 + rng.random((9, 17, 12))).astype(np.float64)),
        "holes": wvr.Volume(holes, nan="transparent"),
        "thin": centered(rng.integers(0, 256, (1, 24, 30), np.uint8)),
        "one cell": centered(rng.random((2, 2, 2))),
        "mask": centered((rng.random((12, 11, 13)) < 0.3).astype(np.uint8)),
    }


@dataclass(frozen=True, eq=False)
class Scene:
    """A field and what it looks like, so that both can be had in other numbers."""

    data: np.ndarray  # multiples of 1/8 from 0 to 1, or so many eighths
    points: tuple  # control points
    labels: np.ndarray | None = None
    others: tuple = ()  # control points of label 1

    def of(self, dtype: str = "float64", scale: float = 1.0, offset: float = 0.0) -> Scene:
        """The same in other numbers: samples as they are in a ``dtype``, and control points where samples may be."""

        def number(s):
            return (np.asarray(s) * scale + offset).astype(dtype if np.dtype(dtype).kind == "f" else float)

        def points(given):
            return tuple((float(number(s)), color, opacity) for s, color, opacity in given)

        data = number(self.data).astype(dtype)
        return replace(self, data=data, points=points(self.points), others=points(self.others))

    @property
    def volume(self) -> wvr.Volume:
        return centered(self.data, (1.0, 1.2, 0.9))

    def render(self, integrator, camera=None, size=(20, 16), **options) -> wvr.Image:
        volume, tf = self.volume, wvr.TransferFunction(list(self.points))
        if self.labels is not None:
            other = wvr.TransferFunction(list(self.others))
            options["segmentation"], tf = wvr.Segmentation(self.labels, {0: tf, 1: other}), None
        camera = camera or wvr.Camera.fit(volume, (0.6, -1, 0.4))
        options.setdefault("termination", 0)
        return wvr.render(volume, tf, camera, size, integrator=integrator, **options)


def _scenes() -> dict[str, Scene]:
    rng = np.random.default_rng(4)
    shape = (10, 12, 11)
    mask = (rng.random(shape) < 0.1).astype(float)
    mask[2:7, 3:9, 2:8] = 1.0
    k, j, i = np.indices(shape)
    levels = np.round(8 * (0.5 + 0.25 * np.sin(0.6 * i + 0.3 * k) + 0.25 * np.cos(0.5 * j))) / 8
    # Left of the jump at 0, and right of that at 1 but for 1 itself, is nothing.
    ramp = ((0.25, "navy", 0.0), (0.75, "gold", 0.3), (1, "white", 0.1))
    jumps = (
        *((0, "red", 0.9), (0, "navy", 0.0), (0.5, "navy", 0.05), (0.5, "gold", 0.3)),
        *((1, "gold", 0.3), (1, "white", 0.1)),
    )
    steps = (
        *((0, "black", 0.0), (0.25, "black", 0.0), (0.25, "red", 0.1), (0.5, "red", 0.1), (0.5, "green", 0.0)),
        *((0.75, "green", 0.0), (0.75, "blue", 0.3), (1, "white", 0.3)),
    )
    return {
        "mask": Scene(mask, ramp),
        "mask with jumps": Scene(mask, jumps),
        "levels": Scene(levels, ramp),
        "levels with jumps": Scene(levels, steps),
        # Where labels meet does not depend on scalars: these are of the type that most volumes here have.
        "labels": Scene(levels, ramp, (rng.random(shape) < 0.5).astype(np.uint8), steps).of("uint8", 8.0),
        "labels in layers": Scene(mask, jumps, (k + j > 9).astype(np.uint8), ramp).of("uint8"),
    }


SCENES = _scenes()
