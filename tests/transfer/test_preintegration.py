"""Pre-integration tables against adaptive quadrature, a mirror image, brute force, and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base.reference import quadrature


def random_tf(seed: int, knots: int = 7, jump: bool = False) -> wvr.TransferFunction:
    rng = np.random.default_rng(seed)
    s = np.sort(rng.uniform(0, 255, knots))
    if jump:
        s[knots // 2] = s[knots // 2 - 1]
    return wvr.TransferFunction.from_arrays(s, rng.random((knots, 3)), rng.random(knots) ** 4)


SPIKE = wvr.TransferFunction.isosurfaces([40.3, 130.7], opacity=0.99, width=0.1)
RAMP = wvr.TransferFunction([(0, (1, 0, 0), 0.0), (255, (0, 1, 0.5), 0.9)])


@pytest.mark.parametrize("generator", ["incremental", "brute"])
@pytest.mark.parametrize(
    ("precision", "tolerance"), [("float32", 2e-6), ("float64", 1e-12)], ids=["float32", "float64"]
)
@pytest.mark.parametrize(
    "tf", [RAMP, SPIKE, random_tf(1), random_tf(2, jump=True)], ids=["ramp", "spike", "random", "jump"]
)
@pytest.mark.parametrize("length", [1e-3, 1.0, 300.0])
def test_against_quadrature(device, generator, precision, tolerance, tf, length):
    rng = np.random.default_rng(3)
    n = 97
    table = wvr.preintegrate(tf, n, length, (0, 255), generator, device=device, precision=precision)
    scalars = np.linspace(0, 255, n)
    for i, j in [(0, n - 1), (n - 1, 0), (5, 5), (12, 13), (13, 12), *rng.integers(0, n, (15, 2))]:
        expected = quadrature(tf, scalars[i], scalars[j], length)
        np.testing.assert_allclose(table.rgba[i, j], expected, rtol=0, atol=tolerance, err_msg=f"entry {i}, {j}")


@pytest.mark.parametrize("n", [2, 3, 16, 255, 256, 1024])
def test_sizes_against_quadrature(device, n):
    tf = random_tf(5, knots=40)
    table = wvr.preintegrate(tf, n, 2.0, (0, 255), device=device)
    scalars = np.linspace(0, 255, n)
    for i, j in np.random.default_rng(n).integers(0, n, (25, 2)):
        expected = quadrature(tf, scalars[i], scalars[j], 2.0)
        np.testing.assert_allclose(table.rgba[i, j], expected, rtol=0, atol=2e-6, err_msg=f"entry {i}, {j}")


@pytest.mark.parametrize("domain", [(-10, 60), (3, 5), (5, 7), (2, 4), (6, 9)])
def test_jumps_at_the_first_and_last_control_point(device, domain):
    """In front of a jump and behind it is what its two control points say, whatever of both is in the table."""
    threshold = [(5, "red", 0.3), (5, "white", 0.5)]
    for points in (threshold, [(3, "navy", 0.0), (3, "gold", 0.2), *threshold]):
        tf, n, length = wvr.TransferFunction(points), 6, 2.0
        table = wvr.preintegrate(tf, n, length, domain, device=device, precision="float64")
        line = wvr.preintegrate(tf, n, domain=domain, generator="running", device=device)
        scalars = np.linspace(*domain, n)
        for i, j in np.ndindex(n, n):
            expected = quadrature(tf, scalars[i], scalars[j], length)
            np.testing.assert_allclose(table.rgba[i, j], expected, rtol=0, atol=1e-12, err_msg=f"{points}, {i}, {j}")
            assert line.lookup(scalars[i], scalars[j], length)[3] == pytest.approx(expected[3], abs=1e-12)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_incremental_equals_brute_force_everywhere(device, precision):
    for n in (2, 3, 4, 7, 64, 100):
        args = (random_tf(7, jump=True), n, 3.0, (-10, 300))
        fast, slow = (
            wvr.preintegrate(*args, g, device=device, precision=precision).rgba for g in ("incremental", "brute")
        )
        np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-6 if precision == "float32" else 1e-14)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(2, 80),
    depth=st.floats(-12, 6),
)
def test_mirror_image(seed, n, depth):
    """Entry (i, j) is entry (n-1-i, n-1-j) of the mirrored transfer function; opacity is symmetric; all in range."""
    rng = np.random.default_rng(seed)
    s, rgb, opacity = np.sort(rng.random(9)), rng.random((9, 3)), rng.random(9)
    length = 10.0**depth
    a = wvr.preintegrate(wvr.TransferFunction.from_arrays(s, rgb, opacity), n, length, (0, 1), precision="float64").rgba
    mirrored = wvr.TransferFunction.from_arrays(1 - s[::-1], rgb[::-1], opacity[::-1])
    b = wvr.preintegrate(mirrored, n, length, (0, 1), precision="float64").rgba
    np.testing.assert_allclose(a, b[::-1, ::-1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(a[..., 3], a[..., 3].T, rtol=1e-9, atol=1e-13)
    assert np.all(np.isfinite(a)) and a.min() >= 0 and a.max() <= 1 + 1e-12
    assert np.all(a[..., :3] <= a[..., 3:] * (1 + 1e-9))


def test_self_attenuation_counts():
    """Colours inside a segment hide one another: red in front of blue is not blue in front of red."""
    tf = wvr.TransferFunction(
        [(0, (1, 0, 0), 0.99), (0.5, (1, 0, 0), 0.99), (0.5, (0, 0, 1), 0.99), (1, (0, 0, 1), 0.99)]
    )
    table = wvr.preintegrate(tf, 3, 4.0)
    red_first, blue_first = table.rgba[0, 2], table.rgba[2, 0]
    T = np.exp(2 * np.log(0.01))
    np.testing.assert_allclose(red_first, [1 - T, 0, T * (1 - T), 1 - T * T], atol=2e-6)
    np.testing.assert_allclose(blue_first, red_first[[2, 1, 0, 3]], atol=1e-6)


MATERIAL = wvr.TransferFunction.from_arrays(
    [0, 60, 60, 130, 200, 255],
    np.random.default_rng(0).random((6, 3)),
    [0.0, 0.2, 0.9, 0.05, 0.6, 0.99],
    ambient=[0.1, 0.3, 0.9, 0.2, 0.5, 0.4],
    diffuse=[0.9, 0.4, 0.1, 0.8, 0.3, 0.7],
    specular=[0.0, 1.0, 0.5, 0.1, 0.9, 0.2],
)


@pytest.mark.parametrize("generator", ["incremental", "brute"])
@pytest.mark.parametrize(
    ("precision", "tolerance"), [("float32", 2e-6), ("float64", 1e-12)], ids=["float32", "float64"]
)
@pytest.mark.parametrize("tf", [RAMP, SPIKE, random_tf(2, jump=True)], ids=["ramp", "spike", "jump"])
@pytest.mark.parametrize("length", [1e-6, 0.1, 1.0, 1e4])
def test_weighted_against_quadrature(device, generator, precision, tolerance, tf, length):
    n = 61
    table = wvr.preintegrate(tf, n, length, (0, 255), generator, weights="lighting", device=device, precision=precision)
    scalars = np.linspace(0, 255, n)
    for i, j in [(0, n - 1), (n - 1, 0), (5, 5), (12, 13), (13, 12), *np.random.default_rng(3).integers(0, n, (6, 2))]:
        for entries, ramp in ((table.back, lambda t: t), (table.front, lambda t: 1 - t), (table.rgba, lambda t: 1)):
            expected = quadrature(tf, scalars[i], scalars[j], length, ramp=ramp)
            np.testing.assert_allclose(entries[i, j], expected, rtol=0, atol=tolerance, err_msg=f"entry {i}, {j}")
    np.testing.assert_allclose(table.front + table.back, table.rgba, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 2e-6), ("float64", 1e-12)])
@pytest.mark.parametrize("length", [0.01, 3.0])
def test_material_coefficients_against_quadrature(device, precision, tolerance, length):
    """Ambient, diffuse and specular coefficients, linear between control points, times colours that are too."""
    tf, n = MATERIAL, 40
    table = wvr.preintegrate(tf, n, length, weights="lighting", device=device, precision=precision)
    scalars = np.linspace(0, 255, n)
    for i, j in [(0, 39), (39, 0), (7, 7), *np.random.default_rng(4).integers(0, n, (8, 2))]:
        ends = scalars[i], scalars[j], length
        unlit, ambient = quadrature(tf, *ends), quadrature(tf, *ends, tf.ambient)
        np.testing.assert_allclose(table.rgba[i, j], unlit, rtol=0, atol=tolerance)
        np.testing.assert_allclose(table.ambient[i, j], ambient, rtol=0, atol=tolerance)
        white = wvr.TransferFunction.from_arrays(tf.knots, np.ones((6, 3)), tf.opacities)
        for entries, ramp in ((table.back, lambda t: t), (table.front, lambda t: 1 - t)):
            diffuse = quadrature(tf, *ends, tf.diffuse, ramp)[:3]
            specular = quadrature(white, *ends, tf.specular, ramp)[0]
            np.testing.assert_allclose(entries[i, j], [*diffuse, specular], rtol=0, atol=tolerance)


def test_published_weighting_loses_digits_and_moments_do_not(device):
    """Section 4.3 of Lum et al. subtracts i times an entry from a globally weighted one; far from 0 that cancels."""
    n = 1024
    tf = wvr.TransferFunction.from_arrays(np.linspace(0, 1, 64), np.full((64, 3), 0.7), np.full(64, 0.5))
    exact = wvr.preintegrate(tf, n, weights="lighting", precision="float64", device=device)
    band = tuple(np.array([(i, i + r) for i in range(900, 1000) for r in (1, 2, 3, 4)]).T)
    errors = {}
    for weights in ("lighting", "lum"):
        table = wvr.preintegrate(tf, n, weights=weights, device=device)
        errors[weights] = np.abs(table.back[band] - exact.back[band]).max()
    assert errors["lighting"] < 1e-7 and errors["lum"] > 2e-5
    for domain in (None, (-1, 2), (0.305, 0.8)):
        same, right = (
            wvr.preintegrate(tf, 64, domain=domain, weights=weights, precision="float64", device=device)
            for weights in ("lum", "lighting")
        )
        np.testing.assert_allclose(same.back, right.back, rtol=0, atol=1e-12)
        np.testing.assert_allclose(same.front, right.front, rtol=0, atol=1e-12)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 60), depth=st.floats(-12, 6))
def test_mirror_image_of_weighted_tables(seed, n, depth):
    rng = np.random.default_rng(seed)
    s, rgb, opacity = np.sort(rng.random(6)), rng.random((6, 3)), rng.random(6)
    tf = wvr.TransferFunction.from_arrays(s, rgb, opacity)
    mirrored = wvr.TransferFunction.from_arrays(1 - s[::-1], rgb[::-1], opacity[::-1])
    a, b = (
        wvr.preintegrate(t, n, 10.0**depth, (0, 1), weights="lighting", precision="float64") for t in (tf, mirrored)
    )
    np.testing.assert_allclose(a.front, b.front[::-1, ::-1], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(a.back, b.back[::-1, ::-1], rtol=1e-8, atol=1e-12)
    for table in (a.front, a.back):
        assert np.all(np.isfinite(table)) and table.min() >= -1e-15 and table.max() <= 1 + 1e-12


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    x=st.floats(-12, 6),
    slope=st.sampled_from([-1.0, -1 + 1e-9, -0.5, 0.0, 0.5, 1 - 1e-9, 1.0]),
    weights=st.sampled_from([None, "lighting"]),
)
def test_one_interval_of_any_depth_and_slope(seed, x, slope, weights):
    """Depths from 1e-12 to 1e6, extinction rising or falling by up to all of itself, in both precisions."""
    rng = np.random.default_rng(seed)
    depth = 10.0**x
    # Opacity stops short of 1, so large depths come from the length.
    length = max(depth, 1e-3)
    opacity = -np.expm1(-depth / length * np.array([1 - slope, 1 + slope]))
    tf = wvr.TransferFunction.from_arrays([0, 1], rng.random((2, 3)), opacity)
    for precision, tolerance in (("float32", 2e-6), ("float64", 1e-12)):
        table = wvr.preintegrate(tf, 2, length, weights=weights, precision=precision)
        for i in (0, 1):
            np.testing.assert_allclose(table.rgba[i, 1 - i], quadrature(tf, i, 1 - i, length), rtol=0, atol=tolerance)
            if weights:
                back = quadrature(tf, i, 1 - i, length, ramp=lambda t: t)
                np.testing.assert_allclose(table.back[i, 1 - i], back, rtol=0, atol=tolerance)


def test_approximate_neglects_attenuation_inside(device):
    """Exact opacity; colour as if nothing hid anything: right when thin, order and brightness wrong when dense."""
    tf = wvr.TransferFunction.isosurfaces([64, 192], colors=[(1, 0, 0), (0, 0, 1)], opacity=0.99, width=20)
    for length, good in ((1e-4, True), (50.0, False)):
        exact, rough = (
            wvr.preintegrate(tf, 64, length, (0, 255), generator, device=device).rgba
            for generator in ("incremental", "approximate")
        )
        np.testing.assert_allclose(rough[..., 3], exact[..., 3], rtol=0, atol=2e-6)
        assert (np.abs(rough - exact).max() < 1e-6) == good
    # From below, red hides blue; from above, blue hides red. Without attenuation both are there, too bright.
    assert exact[0, 63, 0] > 0.9 and exact[0, 63, 2] < 0.1 and exact[63, 0, 2] > 0.9
    np.testing.assert_allclose(rough[0, 63], rough[63, 0], atol=1e-5)
    assert rough[0, 63, 0] > 1.5


def test_lengths_make_a_third_axis(device):
    lengths = [0.1, 0.5, 2.0]
    table = wvr.preintegrate(RAMP, 32, lengths, weights="lighting", device=device)
    assert table.rgba.shape == table.back.shape == (3, 32, 32, 4)
    for k, length in enumerate(lengths):
        flat = wvr.preintegrate(RAMP, 32, length, weights="lighting", device=device)
        assert np.array_equal(table.rgba[k], flat.rgba) and np.array_equal(table.front[k], flat.front)
        np.testing.assert_allclose(table.lookup(10, 200, length), flat.lookup(10, 200), atol=1e-7)
    between = (flat.lookup(10, 200) + table.lookup(10, 200, 0.5)) / 2
    np.testing.assert_allclose(table.lookup(10, 200, 1.25), between, atol=1e-7)
    np.testing.assert_allclose(table.lookup([10], [200], [0.05]), table.lookup([10], [200], 0.1) / 2, atol=1e-7)
    np.testing.assert_allclose(table.lookup(10, 200, 0.0), 0)
    for wrong in (None, 2.1, -1, np.nan):
        with pytest.raises(ValueError, match=r"length must be in \[0, 2.0\]"):
            table.lookup(10, 200, wrong)


@pytest.mark.parametrize(
    "tf", [RAMP, SPIKE, random_tf(2, jump=True), random_tf(9, 60)], ids=["ramp", "spike", "jump", "60"]
)
def test_running_integrals(tf):
    """Opacity exact for any ends and length; colour within the bound, and exact where it is constant."""
    line = wvr.preintegrate(tf, 64, domain=(0, 255), generator="running")
    gray = wvr.TransferFunction.from_arrays(tf.knots, np.full_like(tf.colors, 0.6), tf.opacities)
    gray_line = wvr.preintegrate(gray, 64, domain=(0, 255), generator="running")
    rng = np.random.default_rng(5)
    a, b, length = rng.uniform(0, 255, 60), rng.uniform(0, 255, 60), 10 ** rng.uniform(-3, 3, 60)
    # Ends close together, where a difference of large sums would lose the digits; and at the values themselves.
    b[:20] = np.clip(a[:20] + rng.uniform(-1e-6, 1e-6, 20), 0, 255)
    b[20:25] = a[20:25]
    b[25:28], a[25:27] = 255, 0
    values, grays = line.lookup(a, b, length), gray_line.lookup(a, b, length)
    assert values.shape == (60, 4)
    for k in range(60):
        expected = quadrature(tf, a[k], b[k], length[k])
        assert values[k, 3] == pytest.approx(expected[3], abs=1e-9)
        A, x = expected[3], -np.log1p(-min(expected[3], 1 - 1e-16))
        phi = 1 - A / x + A / x * np.log(A / x) if x > 1e-4 else x * x / 8
        assert np.all(np.abs(values[k, :3] - expected[:3]) <= np.ptp(tf.colors, axis=0) * phi + 1e-9)
        assert grays[k, 0] == pytest.approx(0.6 * A, abs=1e-9)
    # Opacities of such were negative, or NaN.
    for wrong in (-1, np.nan, [1, -1e-9], np.inf):
        with pytest.raises(ValueError, match="length must be finite and >= 0"):
            line.lookup(10, 200, wrong)
    with pytest.raises(ValueError, match="front and back must be scalars, got NaN"):
        line.lookup(np.nan, 200)


def test_lookup_is_bilinear_and_clamps():
    table = wvr.preintegrate(RAMP, 16, 1.0)
    step = 255 / 15
    np.testing.assert_allclose(table.lookup(3 * step, 9 * step), table.rgba[3, 9], atol=1e-7)
    middle = table.lookup(3.5 * step, 9.5 * step)
    np.testing.assert_allclose(middle, table.rgba[3:5, 9:11].astype(float).mean(axis=(0, 1)), atol=1e-7)
    np.testing.assert_allclose(table.lookup(-50, 1e9), table.rgba[0, 15], atol=1e-7)
    assert table.lookup(np.zeros((2, 3)), np.zeros(3)).shape == (2, 3, 4)
    with pytest.raises(ValueError, match="length"):
        table.lookup(0, 1, length=2.0)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"n": 1}, "n must be an integer >= 2, got 1"),
        ({"n": 2.5}, "n must be an integer >= 2, got 2.5"),
        ({"n": True}, "n must be"),
        ({"length": 0}, "length must be finite and > 0, got 0"),
        ({"length": -1.0}, "length"),
        ({"length": float("nan")}, "length"),
        ({"length": []}, "length must be one number > 0, or one or more ascending"),
        ({"length": [1.0, 1.0]}, "ascending"),
        ({"length": [1.0, -1.0]}, "length must be finite and > 0, got -1"),
        ({"weights": "heavy"}, "weights must be one of None, 'lighting', 'lum', got 'heavy'"),
        ({"weights": "lighting", "generator": "approximate"}, "weights must be None for generator='approximate'"),
        ({"weights": "lighting", "generator": "running"}, "weights must be None for generator='running'"),
        ({"weights": "lum", "generator": "brute"}, 'is a way of generator="incremental"'),
        ({"domain": (3, 3)}, "domain must be .* lo < hi"),
        ({"domain": (0, float("inf"))}, "domain"),
        (
            {"domain": (100, 100 + 1e-13)},
            "table of 256 entries .* a range of 9.9e-16 of their size",
        ),
        ({"length": [1, 1e31]}, "tf and length make optical depths of .*; float32 tables hold up to 1e\\+30"),
        (
            {"generator": "magic"},
            "generator must be one of 'incremental', 'brute', 'approximate', 'running', got 'magic'",
        ),
        ({"precision": "half"}, "precision"),
        ({"device": "cuda:99"}, "device must be one of .*'cpu'.*cuda:99"),
    ],
)
def test_errors(kwargs, message):
    with pytest.raises(ValueError, match=message):
        wvr.preintegrate(RAMP, **kwargs)


def test_error_single_scalar_without_domain():
    tf = wvr.TransferFunction([(5, "red", 0.5), (5, "blue", 0.5)])
    with pytest.raises(ValueError, match="control points are all at 5"):
        wvr.preintegrate(tf)
    assert wvr.preintegrate(tf, 4, domain=(0, 10)).rgba[3, 3, 2] == pytest.approx(0.5, abs=1e-6)


def test_error_not_a_transfer_function():
    with pytest.raises(TypeError, match="tf must be a TransferFunction, got str"):
        wvr.preintegrate("bone")
