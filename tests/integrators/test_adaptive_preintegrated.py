"""Adaptive pre-integration: within its tolerance, in as few segments as the field along a ray allows."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base.reference import quadrature
from wvr.integrators.adaptive_preintegrated import bins, changes
from wvr.kernels.integrators.adaptive_preintegrated import STRAIGHT, TWISTED

from ..helpers import ROUNDING, along, centered

GREY = wvr.TransferFunction([(0, (1, 1, 1), 0.1), (9, (1, 1, 1), 0.1)])
every_precision = pytest.mark.parametrize("precision", ["float32", "float64"])


def render(volume, tf, camera=None, size=(24, 24), tolerance=1e-3, **options):
    integrator = wvr.AdaptivePreintegrated(tolerance, **{k: options.pop(k) for k in ("hmin",) if k in options})
    return wvr.render(
        volume,
        tf,
        wvr.Camera.fit(volume) if camera is None else camera,
        size,
        integrator=integrator,
        **{"termination": 0} | options,
    )


@pytest.fixture(scope="module")
def noise():
    """A field that bends everywhere, and colours and extinction that follow it."""
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 33)] * 3, indexing="ij")
    data = 0.5 + 0.3 * np.sin(3 * x + 1) * np.cos(2 * y) * np.cos(2.5 * z)
    data += 0.03 * np.random.default_rng(4).normal(size=data.shape)
    tf = wvr.TransferFunction.from_arrays([0, 0.4, 1], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0], [1, 1, 0]], [0.0, 0.05, 0.2])
    return centered(data), tf


# Closed forms


@every_precision
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_homogeneous_slab_takes_a_segment_a_cell(device, precision, axis):
    spacing = np.array([0.7, 1.3, 2.9])
    volume = centered(np.full((20, 20, 20), 3.0), spacing)
    tf = wvr.TransferFunction([(0, (0.2, 0.5, 1.0), 0.11), (9, (0.2, 0.5, 1.0), 0.11)], unit_distance=2.0)
    for sign in (1, -1):
        image = render(volume, tf, along(axis, sign), (3, 3), precision=precision, device=device)
        A = 1 - (1 - 0.11) ** (19 * spacing[axis] / 2.0)
        expected = np.broadcast_to([0.2 * A, 0.5 * A, A, A], (3, 3, 4))
        np.testing.assert_allclose(image.rgba, expected, rtol=0, atol=ROUNDING[precision])
        assert np.all(image.samples == 19)


@every_precision
def test_linear_field(device, precision):
    """The scalar is linear, so a segment is a cell and right, whatever the tolerance."""
    volume = centered(np.linspace(0, 1, 25)[:, None, None] * np.ones((1, 3, 3)))
    points = [(0, "red", 0.0), (0.25, "lime", 0.3), (0.27, "lime", 0.05), (1, "blue", 0.2)]
    tf = wvr.TransferFunction(points)
    for sign, ends in ((1, (0, 1)), (-1, (1, 0))):
        image = render(volume, tf, along(2, sign), (1, 1), 0.5, precision=precision, device=device)
        assert image.samples[0, 0] == 24
        # What remains is the look-up between table entries.
        np.testing.assert_allclose(image.rgba[0, 0], quadrature(tf, *ends, 24.0), rtol=0, atol=5e-4)


@pytest.mark.parametrize("opacity", [0.3, 0.9, 0.999999])
def test_colour_of_any_length(device, opacity):
    """Cells that a ray enters and leaves anywhere, thin or dense: colour is that of the segment's own length."""
    x = np.linspace(0, 1, 9)
    volume = centered(x[:, None, None] + x[None, :, None] + 0 * x)
    tf = wvr.TransferFunction(
        [(0, "red", opacity), (0.7, "blue", opacity), (1.4, "lime", opacity), (2, "red", opacity)]
    )
    camera = wvr.Camera.fit(volume, direction=(0.2, 1, 0.7))
    exact = wvr.render(volume, tf, camera, (16, 16), integrator=wvr.Exact(), device=device)
    image = render(volume, tf, camera, (16, 16), 0.5, device=device)
    assert wvr.compare(image, exact).max < 4e-3


@pytest.mark.parametrize("shape", [(1, 0), (0, 1), (1, 1), (1, -2)])
def test_the_line_of_a_cubic(shape):
    """The line of least squares has the cubic's integral, and deviates by no more than is said."""
    v = np.linspace(-1, 1, 20001)
    m2, m3 = shape
    off = m2 * (v * v - 1 / 3) + m3 * (v**3 - 0.6 * v)
    assert abs(np.trapezoid(off, v)) < 1e-7 and abs(np.trapezoid(off * v, v)) < 1e-7
    integral = np.trapezoid(np.abs(off), v)
    assert integral <= STRAIGHT * abs(m2) + TWISTED * abs(m3)
    if 0 in shape:
        assert integral > 0.999 * (STRAIGHT * abs(m2) + TWISTED * abs(m3))


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_changes_bound_what_an_error_of_the_scalar_does(seed, knots):
    rng = np.random.default_rng(seed)
    scalars = np.unique(rng.choice([rng.uniform(0, 1, knots + 1), np.round(rng.uniform(0, 1, knots + 1), 1)]))
    scalars = np.sort(np.append(scalars, rng.choice(scalars)))  # a jump
    tf = wvr.TransferFunction.from_arrays(scalars, rng.random((len(scalars), 3)), rng.random(len(scalars)) ** 3)
    edges = bins((0.0, 1.0))
    bound = changes(tf, 1.0, edges)
    s = edges[:-1, None] + np.diff(edges)[:, None] * np.sort(rng.random((len(edges) - 1, 2)))
    tau = tf.extinction(s, 1.0)
    emission = tau[..., None] * tf.color(s)
    difference = np.maximum(np.abs(np.diff(tau)), np.abs(np.diff(emission, axis=1)).max(axis=2))[:, 0]
    assert np.all(difference <= np.nan_to_num(bound * np.diff(s)[:, 0], nan=np.inf) + 1e-12)


# Error and steps


@every_precision
def test_error_falls_with_tolerance(device, noise, precision):
    """A ray's error is about that of one of its steps, not of their sum; and fewer segments than uniform ones need."""
    exact = wvr.render(*noise, wvr.Camera.fit(noise[0]), (24, 24), integrator=wvr.Exact(), device=device)
    errors, samples = [], []
    for tolerance in (1e-1, 1e-2, 1e-3, 1e-4):
        image = render(*noise, tolerance=tolerance, hmin=0.01, precision=precision, device=device)
        errors.append(wvr.compare(image, exact).max)
        samples.append(image.samples.sum())
        assert errors[-1] < 2 * tolerance
    assert errors == sorted(errors, reverse=True) and errors[-1] < 2e-4
    # Of order 2: ten times the accuracy for less than four times the samples.
    assert all(a <= b < 4 * a for a, b in pairwise(samples)) and samples[-1] > 1.3 * samples[0]


def test_fewer_samples_than_uniform_steps(device):
    """A smooth volume with one rough corner: adaptive steps are fine only there."""
    rng = np.random.default_rng(8)
    data = np.ones((65, 65, 65)) * np.linspace(0.2, 0.8, 65)
    data[-16:, -16:, -16:] += 0.2 * rng.normal(size=(16, 16, 16))
    volume = centered(data)
    camera = wvr.Camera.fit(volume)
    tf = wvr.TransferFunction.from_arrays([0, 1], [[1, 1, 1]] * 2, [0.0, 0.02])
    exact = wvr.render(volume, tf, camera, (32, 32), integrator=wvr.Exact(), device=device)
    adaptive = render(volume, tf, camera, (32, 32), tolerance=2e-4, device=device)
    uniform = wvr.render(volume, tf, camera, (32, 32), integrator=wvr.Preintegrated(0.25), device=device, termination=0)
    assert wvr.compare(adaptive, exact).max < wvr.compare(uniform, exact).max < 1e-3
    assert adaptive.samples.sum() < uniform.samples.sum() / 2


def segments(strength, opacity, device, tolerance=1e-6, **options):
    """Of the ray along the diagonal of a cell, where the scalar is a parabola, in a transfer function of one slope."""
    y, x = np.indices((2, 2))
    volume = centered(strength * (x * y)[None] * np.ones((2, 1, 1)))
    tf = wvr.TransferFunction([(0, "white", 0.0), (10, "white", opacity)])
    camera = wvr.Camera((5, 5, 0), (0, 0, 0), up=(0, 0, 1), parallel_scale=1e-3)
    options = {"hmin": 1e-3} | options
    return render(volume, tf, camera, (1, 1), tolerance, device=device, **options).trace(0, 0)


def test_steps_shrink_with_curvature_and_visibility(device):
    """With the square root of either, all alike within a cell."""
    few, bent, seen = (segments(*how, device) for how in ((1.0, 0.1), (4.0, 0.1), (1.0, 1 - 0.9**4)))
    assert len(few) > 10 and np.ptp(few["length"]) < 1e-5 and few["length"].sum() == pytest.approx(np.sqrt(2), rel=1e-5)
    assert len(bent) == pytest.approx(2 * len(few), abs=1.5) and len(seen) == pytest.approx(2 * len(few), abs=1.5)
    # A hundred times the tolerance, a tenth as many.
    assert len(segments(1.0, 0.1, device, 1e-4)) == pytest.approx(len(few) / 10, abs=1)


def test_steps_grow_as_the_ray_becomes_opaque(device):
    rng = np.random.default_rng(2)
    data = rng.random((5, 5, 1)) * np.ones((1, 1, 5))
    volume = centered(np.concatenate([data] * 8))
    tf = wvr.TransferFunction([(0, "white", 0.15), (1, "white", 0.25)])
    camera = wvr.Camera((0, 40, 40), (0, 0, 0), up=(1, 0, 0), parallel_scale=1e-3)
    steps = render(volume, tf, camera, (1, 1), 1e-5, hmin=1e-3, device=device).trace(0, 0)
    assert steps["rgba"][-1, 3] > 0.7
    # Of what is alike but for the transparency in front.
    bound = steps["error"] / steps["length"] ** 3
    assert bound[-5:].mean() < 0.8 * bound[:5].mean()


@every_precision
def test_trace_is_the_ray(device, noise, precision):
    """Steps join from entry to exit, are as many as the samples, keep the tolerance unless forced."""
    image = render(*noise, tolerance=1e-3, skip_empty=False, precision=precision, device=device)
    for x, y in ((12, 12), (7, 9), (16, 11)):
        steps = image.trace(x, y)
        assert len(steps) == image.samples[y, x] > 10 and steps["t"][0] == 0
        np.testing.assert_allclose(steps["t"][1:], (steps["t"] + steps["length"])[:-1], atol=1e-5)
        np.testing.assert_allclose(steps["rgba"][-1], image.rgba[y, x], atol=1e-6)
        free = steps[~steps["forced"]]
        assert len(free) > 10 and np.all(free["error"] <= 1e-3 * (1 + 1e-5))
        assert np.all(steps["length"][steps["forced"]] <= 0.125 * (1 + 1e-5))
        # Nothing is left at the ray's end.
        end = steps["t"][-1] + steps["length"][-1]
        origin, direction = (rays[y, x] for rays in wvr.Camera.fit(noise[0]).rays((24, 24)))
        faces = (np.array([[-16.0], [16.0]]) - origin) / direction
        assert end == pytest.approx(faces.max(axis=0).min() - faces.min(axis=0).max(), rel=1e-5)


def test_traces_of_several_threads_are_those_of_one(noise):
    image = render(*noise, tolerance=1e-3)
    places = [(x, y) for x in range(9, 15) for y in range(9, 15)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda place: image.trace(*place), places))
    assert all(np.array_equal(one, image.trace(*place)) for one, place in zip(found, places, strict=True))


def test_forced_steps(device):
    """A jump that the ray meets on a curve cannot be met by any step: the shortest are taken, and no shorter."""
    y, x = np.indices((2, 2))
    volume = centered((x * y)[None] * np.ones((2, 1, 1)))
    tf = wvr.TransferFunction([(0, "black", 0.0), (0.5, "black", 0.0), (0.5, "white", 0.05), (1, "white", 0.05)])
    camera = wvr.Camera((5, 5, 0), (0, 0, 0), up=(0, 0, 1), parallel_scale=1e-3)
    for hmin, count in ((0.125, 11), (0.5, 2)):
        image = render(volume, tf, camera, (1, 1), hmin=hmin, device=device)
        steps = image.trace(0, 0)
        assert steps["forced"].all() and np.all(steps["length"] >= hmin) and len(steps) == count
    assert "forced" in image.stats["tolerance_covers"]


# Skipping, termination, extremes


@every_precision
def test_leaps_over_empty_blocks(device, precision):
    """Nothing but rounding changes, and what is empty is not sampled."""
    data = np.zeros((64, 64, 64))
    data[24:36, 20:44, 28:40] = np.random.default_rng(3).integers(50, 255, (12, 24, 12))
    tf = wvr.TransferFunction([(20, "navy", 0.0), (255, "gold", 0.3)])
    leapt, whole = (
        render(centered(data), tf, size=(48, 48), skip_empty=skip, precision=precision, device=device)
        for skip in (True, False)
    )
    np.testing.assert_allclose(leapt.rgba, whole.rgba, rtol=0, atol=ROUNDING[precision])
    assert leapt.rgba[..., 3].max() > 0.9
    saved = whole.samples - leapt.samples
    assert saved.min() >= 0 and saved.max() > 5
    assert np.count_nonzero(leapt.samples) < 0.5 * np.count_nonzero(whole.samples)


def test_transparent_volume(device):
    volume = centered(np.random.default_rng(0).random((20, 20, 20)))
    tf = wvr.TransferFunction([(0, "red", 0.0), (1, "blue", 0.0)])
    image = render(volume, tf, device=device)
    assert not image.rgba.any() and not image.samples.any()
    whole = render(volume, tf, skip_empty=False, device=device)
    assert not whole.rgba.any() and whole.samples.max() <= 3 * 19 - 2  # cells that a ray passes


def test_termination(device):
    """By default at a transparency of 1/256, or of a finer tolerance."""
    volume = centered(np.random.default_rng(1).random((129, 1, 1)) * np.ones((1, 3, 3)))
    tf = wvr.TransferFunction([(0, "white", 0.2), (1, "white", 0.3)])
    for tolerance, left in ((0.01, 1 / 256), (1e-3, 1e-3)):
        alpha = render(volume, tf, along(2), (1, 1), tolerance, device=device, termination=None).rgba[0, 0, 3]
        assert 1 - left < alpha < 1 - left / 10
    for other, left in ((wvr.Preintegrated(), 1 / 1024), (wvr.Exact(), 0.0)):
        alpha = wvr.render(volume, tf, along(2), (1, 1), integrator=other, device=device).rgba[0, 0, 3]
        assert 1 - left - 1e-15 <= alpha < 1 - left / 10 + 1e-15


@settings(max_examples=30, deadline=None)
@given(
    st.tuples(*[st.sampled_from([1, 2, 3, 9, 10])] * 3),
    st.tuples(*[st.floats(0.5, 4)] * 3),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["float32", "float64"]),
)
def test_volumes_of_any_shape(shape, spacing, seed, precision):
    """One and two voxels thin, anisotropic, from any side: near the exact image."""
    rng = np.random.default_rng(seed)
    volume = centered(rng.random(shape), spacing)
    tf = wvr.TransferFunction.from_arrays([0, 0.5, 1], rng.random((3, 3)), 0.3 * rng.random(3))
    camera = wvr.Camera.fit(volume, direction=rng.normal(size=3) + 1e-3)
    exact = wvr.render(volume, tf, camera, (12, 12), integrator=wvr.Exact())
    image = render(volume, tf, camera, (12, 12), tolerance=1e-3, hmin=0.02, precision=precision)
    assert wvr.compare(image, exact).max < 4e-3


def test_absent_data(device):
    """The hole that NaN leaves is found, though the field around it is constant."""
    data = np.full((12, 12, 12), 5.0, np.float32)
    data[6, 6, 6] = np.nan
    alpha = render(centered(data, nan="transparent"), GREY, along(2, scale=6), (48, 48), hmin=0.05, device=device).rgba[
        ..., 3
    ]
    inside = alpha[alpha > 0]
    assert np.all(np.isfinite(alpha)) and inside.max() == pytest.approx(1 - 0.9**11, abs=1e-5)
    assert inside.min() == pytest.approx(1 - 0.9**9, abs=0.005)


@every_precision
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-9])
def test_extreme_extinction_stays_in_range(device, precision, unit):
    volume = centered(np.random.default_rng(5).random((12, 12, 12)))
    tf = wvr.TransferFunction([(0, "red", 0.0), (0.5, "lime", 0.0), (0.5, "lime", 1.0), (1, "blue", 1.0)], unit)
    image = render(volume, tf, precision=precision, device=device)
    assert np.all(np.isfinite(image.rgba)) and image.rgba.min() >= 0 and image.rgba[..., 3].max() <= 1
    assert np.all(image.rgba[..., :3].sum(axis=2) <= image.rgba[..., 3] * (1 + 1e-5))
    assert image.rgba[12, 12, 3] == pytest.approx(1)


def test_threads_do_not_change_a_bit(noise, threads):
    images = []
    for n in (1, 3):
        threads(n)
        images.append(render(*noise, size=(40, 30), device="cpu"))
    assert np.array_equal(images[0].rgba, images[1].rgba)


def test_what_is_rebuilt(device, noise):
    """Ranges with the volume alone, changes and table with the transfer function, nothing with tolerance or camera."""
    volume, tf = noise
    renderer = wvr.Renderer(volume, tf, integrator=wvr.AdaptivePreintegrated(1e-2), device=device)
    camera = wvr.Camera.fit(volume)

    def built():
        before = renderer.builds.copy()
        renderer.render(camera, (4, 4))
        return renderer.builds - before

    assert {"ranges", "changes", "table", "kinds"} < set(built())
    camera = wvr.Camera.fit(volume, direction=(1, 2, 3))
    assert not built()
    renderer.integrator = wvr.AdaptivePreintegrated(1e-3)
    assert not built()
    renderer.transfer_function = GREY
    assert set(built()) - {"octants"} == {"transfer", "kinds", "changes", "table"}


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"tolerance": 0}, "tolerance must be finite and > 0, got 0"),
        ({"tolerance": -1e-3}, "tolerance must be finite and > 0"),
        ({"tolerance": 1}, "tolerance must be below 1, got 1"),
        ({"tolerance": float("nan")}, "tolerance must be finite and > 0, got nan"),
        ({"hmin": 0.0}, "hmin must be finite and > 0"),
    ],
)
def test_errors(kwargs, message):
    with pytest.raises(ValueError, match=message):
        wvr.AdaptivePreintegrated(**({"tolerance": 1e-3} | kwargs))
