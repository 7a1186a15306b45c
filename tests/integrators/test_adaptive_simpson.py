"""Adaptive Simpson integration: within its tolerance, its steps by the rules of the paper, and a recursive oracle."""

import copy

import numpy as np
import pytest

import wvr

from ..helpers import along, centered

COUPLINGS = ("coupled", "decoupled")
every_coupling = pytest.mark.parametrize("coupling", COUPLINGS)


def recursive(
    f, t: float, h: float, tolerance: float, correction=lambda error: error
) -> tuple[float, list[tuple[float, float]]]:
    """Algorithm 1 of Campagnolo et al. 2015, with the signed correction: the integral, and the steps it accepts."""
    y = f(t + h * np.arange(5) / 4)
    S = h / 6 * (y[0] + 4 * y[2] + y[4])
    D = h / 12 * (y[0] + 4 * y[1] + 2 * y[2] + 4 * y[3] + y[4])
    if abs(D - S) / 15 <= tolerance or h < 1e-4:
        return D + correction((D - S) / 15), [(t, h)]
    left, steps = recursive(f, t, h / 2, tolerance / 2, correction)
    right, more = recursive(f, t + h / 2, h / 2, tolerance / 2, correction)
    return left + right, steps + more


def test_why_the_correction_is_signed():
    """The absolute value, as printed in the paper, undoes the correction wherever D is too large."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(300):
        a, w, p = rng.normal(size=5), rng.uniform(0, 4, 5), rng.uniform(0, 6.28, 5)
        exact = np.sum(a * (np.cos(p) - np.cos(4 * w + p)) / w)

        def sines(t, a=a, w=w, p=p):
            return np.sin(np.multiply.outer(t, w) + p) @ a

        errors.append([abs(recursive(sines, 0.0, 4.0, 1e-4, way)[0] - exact) for way in (lambda error: error, abs)])
    signed, absolute = np.median(errors, axis=0)
    assert signed < 1e-6 and absolute > 20 * signed


@pytest.fixture(scope="module")
def smooth():
    """Smooth along rays: a fine sampling of a slowly varying field, and a transfer function without kinks."""
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 48)] * 3, indexing="ij")
    volume = wvr.Volume(0.5 + 0.4 * np.sin(3 * x + 1) * np.cos(2 * y) * np.cos(2.5 * z))
    tf = wvr.TransferFunction.from_arrays([0, 1], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]], [0.0, 0.2])
    return volume, tf, wvr.Camera.fit(volume)


@every_coupling
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_within_tolerance(device, smooth, coupling, precision):
    """A ray of length l may err by tolerance * l / h0; fewer samples than a fixed step needs for the same error."""
    size = (24, 24)
    exact = wvr.render(*smooth, size, integrator=wvr.Exact(), device=device)
    samples, errors = [], []
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
        integrator = wvr.AdaptiveSimpson(tolerance, coupling=coupling, hmin=0.01)
        image = wvr.render(*smooth, size, integrator=integrator, device=device, precision=precision, termination=0)
        errors.append(wvr.compare(image, exact).max)
        samples.append(image.samples.sum())
        assert errors[-1] <= tolerance * 80 / 0.5
    assert errors[-1] < 2e-5 and errors == sorted(errors, reverse=True) and samples == sorted(samples)


@every_coupling
def test_homogeneous_slab(device, coupling):
    """Steps grow to hmax where nothing changes; opacity is exact."""
    volume = centered(np.full((33, 3, 3), 5.0))
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.1), (9, (1, 1, 1), 0.1)])
    integrator = wvr.AdaptiveSimpson(1e-4, h0=0.5, hmin=0.1, hmax=2.0, coupling=coupling)
    image = wvr.render(
        volume, tf, along(2), (1, 1), integrator=integrator, device=device, precision="float64", termination=0
    )
    assert image.rgba[0, 0, 3] == pytest.approx(1 - 0.9**32, abs=1e-12)
    steps = image.trace(0, 0)
    assert steps["length"][0] == 0.5 and steps["length"].max() == 2.0 and not steps["forced"].any()


@every_coupling
def test_trace_is_the_ray(device, smooth, coupling):
    """Steps join, lie within [hmin, hmax], keep the tolerance unless forced, and end with the pixel's value."""
    volume, _, camera = smooth
    tf = wvr.TransferFunction.isosurfaces([0.4, 0.7], opacity=0.8, width=0.05)
    integrator = wvr.AdaptiveSimpson(1e-3, coupling=coupling)
    image = wvr.render(
        volume, tf, camera, (16, 12), integrator=integrator, device=device, precision="float64", skip_empty=False
    )
    ends = 0
    for x, y in ((8, 6), (5, 4), (11, 8)):
        steps = image.trace(x, y)
        np.testing.assert_allclose(steps["t"][1:], (steps["t"] + steps["length"])[:-1], atol=1e-9)
        np.testing.assert_allclose(steps["rgba"][-1], image.rgba[y, x], atol=1e-12)
        assert steps["t"][0] == 0 and steps["length"].max() <= 2.0 and len(steps) <= image.samples[y, x]
        np.testing.assert_allclose(steps["tolerance"], 1e-3 / 0.5 * steps["length"])
        free = steps[~steps["forced"]]
        assert np.all(free["error"] <= free["tolerance"] * (1 + 1e-9))
        assert np.all(steps[steps["forced"]]["length"] <= 0.1 * 1.0001)
        ends += np.count_nonzero(steps["length"] < 0.1 - 1e-9)
    assert ends < 20  # only the ends of intervals and of rays cut a step shorter than hmin
    assert len(image.trace(0, 0)) == 0


@every_coupling
def test_nothing_that_absorbs_needs_no_outer_integral(device, coupling):
    volume = centered(np.zeros((65, 3, 3)))
    tf = wvr.TransferFunction([(0, "red", 0.0), (9, "red", 0.5)])
    image = wvr.render(
        volume, tf, along(2), (1, 1), integrator=wvr.AdaptiveSimpson(1e-3, coupling=coupling), device=device
    )
    assert image.rgba.max() == 0
    # 0.5, 1, then steps of 2: four new samples each.
    assert image.samples[0, 0] <= 4 * (64 / 2 + 3) + 1


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_recursive_and_iterative_agree_within_tolerance(device, tolerance):
    """Doubling leaves the recursive grid, so the steps differ; the integrals are within tolerance of each other."""
    z = np.linspace(0, 8, 257)
    data = (0.5 + 0.5 * np.sin(z) ** 3 * np.exp(-0.1 * z))[:, None, None] * np.ones((1, 2, 2))
    volume = centered(data, (1, 1, 8 / 256))
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (1, (1, 1, 1), 0.6)], unit_distance=1.0)
    # Lengths of integrators are in voxels, of which the ray has 256; tolerances per ray are equal.
    integrator = wvr.AdaptiveSimpson(tolerance / 4, h0=64, hmin=0.25, hmax=128)
    image = wvr.render(
        volume, tf, along(2), (1, 1), integrator=integrator, device=device, precision="float64", termination=0
    )
    tau = -np.log1p(-0.6)
    depth, steps = recursive(lambda t: tau * np.interp(t, z, data[:, 0, 0]), 0.0, 8.0, tolerance)
    exact = tau * np.trapezoid(data[:, 0, 0], z)
    assert len(steps) > 3
    assert abs(depth - exact) < tolerance
    assert abs(image.rgba[0, 0, 3] + np.expm1(-exact)) < tolerance


@every_coupling
def test_steps_of_figure_1(device, coupling):
    """Where what varies comes first, doubling keeps to the recursive grid: both algorithms take the same steps."""
    n, top = 1025, 1e-3
    z = np.linspace(0, 1, n)
    volume = centered(np.exp(-8 * z)[:, None, None] * np.ones((1, 2, 2)), (1, 1, 1 / (n - 1)))
    # So thin that the outer integrand is the inner one.
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (1, (1, 1, 1), top)], unit_distance=1.0)
    for tolerance, count in ((1e-5, 1), (1e-6, 2), (1e-7, 4)):
        _, steps = recursive(lambda t: -np.log1p(-top) * np.interp(t, z, np.exp(-8 * z)), 0.0, 1.0, tolerance)
        integrator = wvr.AdaptiveSimpson(tolerance, h0=n - 1, hmin=1, hmax=n - 1, coupling=coupling)
        image = wvr.render(
            volume, tf, along(2), (1, 1), integrator=integrator, device=device, precision="float64", termination=0
        )
        taken = image.trace(0, 0)
        assert len(steps) == count
        np.testing.assert_allclose(np.stack([taken["t"], taken["length"]], 1), (n - 1) * np.array(steps), rtol=1e-9)


@every_coupling
def test_tolerance_of_a_ray(device, smooth, coupling):
    """Steps share it out by length, and the ray keeps it."""
    exact = wvr.render(*smooth, (24, 24), integrator=wvr.Exact(), device=device)
    for tolerance in (1e-3, 1e-4, 1e-5):
        integrator = wvr.AdaptiveSimpson(tolerance, coupling=coupling, hmin=0.01, scope="ray")
        image = wvr.render(*smooth, (24, 24), integrator=integrator, device=device, precision="float64", termination=0)
        assert wvr.compare(image, exact).max < tolerance
        assert image.trace(12, 12)["tolerance"].sum() == pytest.approx(tolerance)
    assert "a ray" in image.stats["tolerance_covers"]


@every_coupling
def test_samples_are_used_again(device, coupling):
    """A halved step keeps three of its five samples, and the half beyond it two: two new ones a half."""
    n = 1025
    volume = centered(np.exp(-8 * np.linspace(0, 1, n))[:, None, None] * np.ones((1, 2, 2)), (1, 1, 1 / (n - 1)))
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (1, (1, 1, 1), 1e-3)], unit_distance=1.0)
    integrator = wvr.AdaptiveSimpson(1e-7, h0=n - 1, hmin=1, hmax=n - 1, coupling=coupling)
    image = wvr.render(
        volume, tf, along(2), (1, 1), integrator=integrator, device=device, precision="float64", termination=0
    )
    # 5 over the ray, halved three times, the second eighth; then a quarter and a half, four each.
    assert image.samples[0, 0] == 5 + 3 * 2 + 2 + 4 + 4


@every_coupling
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-9])
def test_forced_steps_stay_in_range(device, coupling, precision, unit):
    """Opaque within a fraction of the shortest step: no value exceeds what can be seen, none is NaN."""
    volume = centered(np.random.default_rng(5).random((12, 12, 12)))
    tf = wvr.TransferFunction([(0, "red", 0.0), (0.5, "lime", 0.0), (0.5, "lime", 1.0), (1, "blue", 1.0)], unit)
    image = wvr.render(
        volume,
        tf,
        wvr.Camera.fit(volume),
        (24, 24),
        integrator=wvr.AdaptiveSimpson(1e-4, coupling=coupling),
        device=device,
        precision=precision,
        termination=0,
    )
    assert np.all(np.isfinite(image.rgba)) and image.rgba.min() >= 0 and image.rgba[..., 3].max() <= 1
    assert np.all(image.rgba[..., :3].sum(axis=2) <= image.rgba[..., 3] * (1 + 1e-5))
    assert image.rgba[12, 12, 3] == pytest.approx(1)


@every_coupling
def test_absent_data(device, coupling):
    data = np.full((12, 12, 12), 5.0, np.float32)
    data[6, 6, 6] = np.nan
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.1), (9, (1, 1, 1), 0.1)])
    integrator = wvr.AdaptiveSimpson(1e-4, coupling=coupling)
    alpha = wvr.render(
        centered(data, nan="transparent"), tf, along(2, scale=6), (48, 48), integrator=integrator, device=device
    ).rgba[..., 3]
    inside = alpha[alpha > 0]
    assert np.all(np.isfinite(alpha)) and inside.max() == pytest.approx(1 - 0.9**11, abs=1e-5)
    assert inside.min() == pytest.approx(1 - 0.9**9, abs=0.03)


@every_coupling
def test_threads_do_not_change_a_bit(smooth, coupling, threads):
    images = []
    for n in (1, 3):
        threads(n)
        images.append(
            wvr.render(*smooth, (40, 30), integrator=wvr.AdaptiveSimpson(1e-3, coupling=coupling), device="cpu")
        )
    assert np.array_equal(images[0].rgba, images[1].rgba)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"tolerance": 0}, "tolerance must be finite and > 0, got 0"),
        ({"tolerance": 1.0}, "tolerance must be below 1, got 1.0"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"hmin": 3.0}, "hmin must be at most hmax = 2.0, got 3.0"),
        ({"hmin": 0.0}, "hmin must be finite and > 0"),
        ({"h0": 5.0}, "h0 must be from hmin = 0.1 to hmax = 2.0, got 5.0"),
        ({"scope": "image"}, "scope must be one of 'step', 'ray', got 'image'"),
        ({"coupling": "loose"}, "coupling must be one of 'coupled', 'decoupled', got 'loose'"),
    ],
)
def test_errors(kwargs, message):
    with pytest.raises(ValueError, match=message):
        wvr.AdaptiveSimpson(**({"tolerance": 1e-3} | kwargs))


def test_trace_errors(smooth):
    image = wvr.render(*smooth, (4, 4), integrator=wvr.Riemann(1.0))
    with pytest.raises(ValueError, match=r"with an adaptive integrator, .* got one of Riemann\(step=1.0"):
        image.trace(0, 0)
    image = wvr.render(*smooth, (4, 4), integrator=wvr.AdaptiveSimpson(1e-2))
    with pytest.raises(IndexError, match="x, y must be a pixel of the 4 x 4 image, got 4, 0"):
        image.trace(4, 0)
    with pytest.raises(ValueError, match="in the process that made it, got one of AdaptiveSimpson"):
        copy.copy(image).trace(0, 0)


@every_coupling
def test_leaps_over_empty_blocks(device, coupling):
    """Fewer samples, the same picture within tolerance, and the trace is that of the ray that leapt."""
    data = np.zeros((64, 64, 64))
    data[24:36, 20:44, 28:40] = np.random.default_rng(3).integers(50, 255, (12, 24, 12))
    volume = centered(data)
    tf = wvr.TransferFunction([(20, "navy", 0.0), (255, "gold", 0.3)])
    camera = wvr.Camera.fit(volume)
    integrator = wvr.AdaptiveSimpson(1e-4, coupling=coupling, scope="ray")
    options = {"integrator": integrator, "device": device, "precision": "float64", "termination": 0}
    leapt, whole = (wvr.render(volume, tf, camera, (48, 48), **options, skip_empty=skip) for skip in (True, False))
    exact = wvr.render(volume, tf, camera, (48, 48), integrator=wvr.Exact(), device=device)
    assert leapt.samples.sum() < 0.7 * whole.samples.sum()
    assert np.array_equal(leapt.rgba[..., 3] > 0, exact.rgba[..., 3] > 0)
    assert wvr.compare(leapt, exact).max < 2 * wvr.compare(whole, exact).max + 1e-4
    steps = leapt.trace(24, 24)
    assert steps["t"][0] > 10 and steps["rgba"][-1] == pytest.approx(leapt.rgba[24, 24], abs=1e-12)
