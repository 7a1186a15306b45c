"""What tests share: the integrators, small scenes, cameras along an axis, and how far images are apart."""

import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import wvr
from studies.base.scenes import DATA as DATA

# All integrators, and their variants, by name; steps divide nothing.
INTEGRATORS: dict[str, wvr.integrators.Integrator] = {
    "Riemann": wvr.Riemann(0.37),
    "left": wvr.Riemann(0.37, "left"),
    "trapezoid": wvr.Riemann(0.37, "trapezoid"),
    "Simpson": wvr.Simpson(0.37),
    "Preintegrated": wvr.Preintegrated(0.37),
    "oversampled": wvr.Preintegrated(1.48, oversampling=4),
    "AdaptivePreintegrated": wvr.AdaptivePreintegrated(1e-3),
    "AdaptiveSimpson": wvr.AdaptiveSimpson(1e-3),
    "Exact": wvr.Exact(),
    "Certified": wvr.Certified(1e-4),
}
# Those with steps of one length.
UNIFORM = ("Riemann", "left", "trapezoid", "Simpson", "Preintegrated", "oversampled")
# What sums in a precision are off by.
ROUNDING = {"float32": 2e-6, "float64": 1e-12}
# One of each kind.
KINDS = ("Riemann", "Simpson", "Preintegrated", "AdaptivePreintegrated", "AdaptiveSimpson", "Exact", "Certified")


def integrators(*names: str) -> pytest.MarkDecorator:
    """Parametrises a test by the integrators of these names."""
    return pytest.mark.parametrize("integrator", [INTEGRATORS[name] for name in names], ids=names)


every_integrator = integrators(*INTEGRATORS)
every_kind = integrators(*KINDS)
every_uniform = integrators(*UNIFORM)

# Colour and extinction of uint8 scalars, with something to see at most of them.
SMOOTH = wvr.TransferFunction([(0, "navy", 0.0), (60, "green", 0.02), (140, "gold", 0.3), (255, "white", 0.5)])
# And without: nothing below 130.
SPARSE = wvr.TransferFunction([(0, "red", 0.0), (130, "red", 0.0), (255, "white", 0.9)])


def constant(opacity: float, color=(1, 1, 1)) -> wvr.TransferFunction:
    """The same for every scalar from 0 to 255, per unit of world length."""
    return wvr.TransferFunction([(0, color, opacity), (255, color, opacity)], unit_distance=1.0)


def along(axis: int, sign: int = 1, scale: float = 1.0, center=(0.0, 0.0, 0.0)) -> wvr.Camera:
    """A parallel camera looking along an axis; ``sign=1`` looks towards +."""
    center = np.asarray(center, float)
    towards = np.eye(3)[axis] * -sign * 10.0
    return wvr.Camera(center + towards, center, up=np.eye(3)[(axis + 1) % 3], parallel_scale=scale)


def centered(array, spacing=(1.0, 1.0, 1.0), **kwargs) -> wvr.Volume:
    """A volume whose box is centred on the world's origin."""
    n = np.array(np.shape(array))[::-1]
    return wvr.Volume(array, spacing, tuple(-(n - 1) / 2 * spacing), **kwargs)


def block() -> wvr.Volume:
    """A homogeneous block, its axes and spacings anything."""
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    return wvr.Volume(np.full((9, 12, 7), 100, np.uint8), (0.7, 1.3, 0.9), (2.0, -3.0, 1.0), turn)


def ramp(normal, offset, shape=(14, 13, 12), spacing=(1.0, 1.0, 1.0)) -> wvr.Volume:
    """A volume around the world's origin whose field is the distance from a plane."""
    volume = centered(np.zeros(shape, np.uint8), np.array(spacing))
    k, j, i = np.indices(shape)
    points = np.stack([i, j, k], axis=-1) * spacing + volume.origin
    return wvr.Volume(points @ normal - offset, spacing, volume.origin)


def middle(volume: wvr.Volume) -> np.ndarray:
    return volume.corners.mean(axis=0)


def max_error(image: wvr.Image, reference: np.ndarray) -> float:
    return float(np.abs(image.rgba - reference).max())


def assert_certified(volume, tf, camera, tolerance, size=(16, 16), options=None, **scene) -> wvr.Image:
    """Every pixel is within its bound of the exact image of the ``scene``, and the bound within the tolerance.

    ``options`` are those of the certified image alone.
    """
    exact = wvr.render(volume, tf, camera, size, integrator=wvr.Exact(), **scene)
    image = wvr.render(volume, tf, camera, size, tolerance=tolerance, **scene, **(options or {}))
    error = np.abs(image.rgba - exact.rgba).max(axis=2)
    assert np.all(np.isfinite(image.rgba)) and image.rgba.min() >= 0 and image.rgba[..., 3].max() <= 1
    assert np.all(error <= image.error_bound), f"{error.max()}, bound {image.error_bound.max()}"
    assert image.error_bound.max() <= tolerance and image.stats["rays_over_tolerance"] == 0
    return image


@contextmanager
def mounted(folder: Path, options: str):
    """A file system of its own, where that may be."""
    folder.mkdir()
    if (
        shutil.which("mount") is None
        or subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True).returncode
    ):
        pytest.skip("no file system can be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", folder], check=True)
