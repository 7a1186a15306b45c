"""The certificate: no channel of any pixel is off by more than its bound, nor the bound more than the tolerance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr

from ..helpers import DATA, along, assert_certified, centered
from ..scenes import transfer_functions, volumes

TRANSFER_FUNCTIONS = list(transfer_functions(0.0, 1.0))


VOLUMES = list(volumes())


@pytest.mark.parametrize("name", VOLUMES)
@pytest.mark.parametrize("kind", TRANSFER_FUNCTIONS)
def test_every_pixel_is_within_its_bound(device, name, kind):
    volume = volumes()[name]
    tf = transfer_functions(*volume.range)[kind]
    tolerances = iter((1e-2, 1e-3, 1e-4))
    for direction, parallel in (((1, 0.6, 0.4), False), ((-0.3, 1, 0.2), True), ((0, 1, 0), True)):
        camera = wvr.Camera.fit(volume, direction=direction, up=(0, 0, 1), parallel=parallel)
        assert_certified(volume, tf, camera, next(tolerances), (32, 24), device=device)


@pytest.mark.parametrize("file", ["bonsai.nrrd", "bluntfin.nrrd", "aneurism.nrrd", "engine.nrrd", "cthead.nrrd"])
def test_real_volumes(file):
    if not (DATA / file).exists():
        pytest.skip(f"{DATA / file} is not there")
    volume = wvr.read(DATA / file)
    for kind in ("smooth", "spikes", "opaque"):
        tf = transfer_functions(*volume.range)[kind]
        camera = wvr.Camera.fit(volume, direction=(0.8, 1, 0.3))
        assert_certified(volume, tf, camera, 1e-3, (48, 48))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), tolerance=st.floats(1e-6, 0.5))
def test_random_scenes(seed, tolerance):
    """Random samples and control points, grazing views, the camera inside; opacities from faint to 1."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 12, 3)
    data = rng.random(shape) if rng.random() < 0.5 else rng.integers(0, 256, shape, np.uint8)
    volume = centered(data.astype(rng.choice(["float32", "float64"])) if data.dtype == float else data)
    lo, hi = volume.range
    n = int(rng.integers(2, 30))
    s = np.sort(rng.uniform(lo, hi + 1e-3, n)).round(int(rng.integers(1, 8)))
    s = np.delete(s, np.flatnonzero(s[2:] == s[:-2]))
    if len(s) < 2:
        return
    opacity = rng.random(len(s)) ** rng.integers(1, 8) * (rng.random(len(s)) > 0.3)
    tf = wvr.TransferFunction.from_arrays(s, rng.random((len(s), 3)), opacity)
    target = rng.normal(0, 3, 3)
    camera = wvr.Camera(target + rng.normal(0, 6, 3), target, up=(0.1, 0.2, 1), view_angle=60)
    assert_certified(volume, tf, camera, tolerance, (12, 12))


@settings(max_examples=300, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.floats(-6, 0.3))
def test_series_is_within_its_bound(numbers, magnitude):
    """V of the kernel's formula against Gauss-Legendre quadrature; the extinction is nowhere negative."""
    m1, m2, m3, slope = numbers
    R = abs(m1) + 2 / 3 * abs(m2) + abs(m3)
    a = 0.5 * 10**magnitude
    v, weight = np.polynomial.legendre.leggauss(60)

    def w(v):
        return m1 * v + m2 * (v * v - 1 / 3) + m3 * v**3

    dense = w(np.linspace(-1, 1, 401))
    g = slope * a / max((np.sign(slope) * -dense).max(), 1e-9)
    W = m1 * (v * v - 1) / 2 + m2 * (v**3 - v) / 3 + m3 * (v**4 - 1) / 4
    exact = np.sum(weight * w(v) * (a + g * w(v)) * np.exp(-a * (v + 1) - g * W))
    moments = [np.sum(weight * f) for f in (w(v) ** 2, v * w(v), v * w(v) ** 2, w(v) ** 2 * W)]
    series = np.exp(-a) * (g * moments[0] - a * a * moments[1] - a * g * moments[2] - g * g * moments[3])
    proven = R * (-np.expm1(-2 * a) - 2 * a * np.exp(-a))
    assert abs(series - exact) <= proven + 1e-15
    assert proven <= R * (2 * a) ** 3 / 24 + 1e-15
    G = abs(g) * R
    closer = R * G * (a**2 + a * G + G**2) / 3 + a**3 * (4 / 45 * abs(m2) + R * a / 12)
    assert abs(series - exact) <= closer + 1e-15


def test_homogeneous_slab():
    """Nothing to approximate: exact to rounding."""
    volume = centered(np.full((9, 9, 9), 100, np.uint8))
    tf = wvr.TransferFunction([(0, (0.2, 0.4, 0.8), 0.1), (255, (0.2, 0.4, 0.8), 0.1)])
    image = wvr.render(volume, tf, along(2, scale=4.0), (5, 5), tolerance=1e-4, precision="float64")
    A = 1 - 0.9**8
    assert image.rgba[2, 2] == pytest.approx([0.2 * A, 0.4 * A, 0.8 * A, A], abs=1e-9)


def test_skipping_changes_nothing(device):
    volume = volumes()["noisy"]
    tf = transfer_functions(0, 255)["smooth"]
    camera = wvr.Camera.fit(volume)
    skipped, whole = (
        wvr.render(volume, tf, camera, (32, 32), tolerance=1e-4, device=device, skip_empty=skip, precision="float64")
        for skip in (True, False)
    )
    assert np.abs(skipped.rgba - whole.rgba).max() < 1e-12
    assert skipped.samples.sum() <= whole.samples.sum()


def test_nothing_to_see_costs_nothing():
    volume = volumes()["noisy"]
    tf = wvr.TransferFunction([(0, "red", 0.0), (255, "white", 0.0)])
    for camera in (wvr.Camera.fit(volume), wvr.Camera.fit(volume, direction=(0, 1, 0), parallel=True), along(2)):
        image = wvr.render(volume, tf, camera, (33, 33))
        assert not image.rgba.any() and not image.samples.any() and not image.error_bound.any()


def test_a_coarser_tolerance_costs_less():
    volume = volumes()["noisy"]
    tf = transfer_functions(0, 255)["color map"]
    counts = [
        wvr.render(volume, tf, wvr.Camera.fit(volume), (32, 32), tolerance=t).stats["samples"]
        for t in (1e-5, 1e-3, 1e-1)
    ]
    assert counts[0] > 1.1 * counts[1] > 1.2 * counts[2]


def test_termination_is_in_the_bound():
    volume = volumes()["noisy"]
    tf = transfer_functions(0, 255)["opaque"]
    camera = wvr.Camera.fit(volume)
    exact = wvr.render(volume, tf, camera, (24, 24), integrator=wvr.Exact())
    image = wvr.render(volume, tf, camera, (24, 24), tolerance=1e-4, termination=0.05)
    error = np.abs(image.rgba - exact.rgba).max(axis=2)
    assert np.all(error <= image.error_bound) and 1e-3 < image.error_bound.max() < 0.051
    assert image.stats["rays_over_tolerance"] == np.count_nonzero(image.error_bound > 1e-4) > 0
    unending = wvr.render(volume, tf, camera, (24, 24), tolerance=1e-4, termination=0)
    assert unending.stats["samples"] > image.stats["samples"]


def test_behind_nothing_that_is_left_bounds_hold_nothing():
    """Where rays never end: transparency is 0 behind the slab, and rows hold little of the noise there."""
    data = np.random.default_rng(0).random((20, 20, 20)).astype(np.float32)
    data[:, :, :6] = 1
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction.from_arrays(
        [0, 0.3, 0.3001, 0.7, 1], np.eye(5, 3), [0, 0.2, 0.9, 0.1, 0.99999], unit_distance=1e-4
    )
    image = wvr.render(volume, tf, (-1, 0.1, 0.2), (16, 16), tolerance=1e-2, termination=0, lighting=False)
    assert image.rgba[..., 3].max() == 1 and image.error_bound.max() <= 1e-2


@pytest.mark.filterwarnings("ignore:nothing is visible")
@pytest.mark.parametrize("depth", [None, np.full((12, 12), np.inf)], ids=["rays abreast", "one by one"])
def test_bounds_are_not_negative_from_a_corner_where_there_is_nothing_to_see(depth):
    volume = wvr.Volume(np.zeros((3, 3, 3), np.uint8), spacing=(3.0, 17.0, 0.2))
    camera = wvr.Camera((0, 0, 0), (1, 0.4, 0.05))
    tf = wvr.TransferFunction([(0, "red", 0.0), (9, "red", 0.0), (20, "red", 0.5)])
    image = wvr.render(volume, tf, camera, (12, 12), tolerance=1e-2, depth=depth, lighting=False)
    assert image.error_bound.min() >= 0 and image.rgba.max() == 0


def test_same_bits_on_any_number_of_threads(threads):
    volume = volumes()["noisy"]
    tf = transfer_functions(0, 255)["color map"]
    images = []
    for n in (1, 2, 5):
        threads(n)
        images.append(wvr.render(volume, tf, wvr.Camera.fit(volume), (40, 40)))
    assert all(np.array_equal(image.rgba, images[0].rgba) for image in images)
    assert all(np.array_equal(image.error_bound, images[0].error_bound) for image in images)


@pytest.mark.parametrize("tolerance", [0, -1e-3, 1, 2, float("nan"), float("inf"), "fine"])
def test_tolerance_errors(tolerance):
    volume = volumes()["one cell"]
    with pytest.raises((ValueError, TypeError), match="tolerance"):
        wvr.render(volume, transfer_functions(0, 1)["smooth"], wvr.Camera.fit(volume), (4, 4), tolerance=tolerance)


def test_tolerance_or_integrator():
    volume = volumes()["one cell"]
    with pytest.raises(ValueError, match=r"tolerance = 0.01 and integrator = Exact\(\): give one of the two"):
        wvr.Renderer(volume, transfer_functions(0, 1)["smooth"], tolerance=1e-2, integrator=wvr.Exact())
