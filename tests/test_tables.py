"""Pre-integration tables against adaptive quadrature, a mirror image, brute force, and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

import wvr


def quadrature(tf: wvr.TransferFunction, front: float, back: float, length: float) -> np.ndarray:
    """The segment's integral by adaptive quadrature of float64 pieces between knots; optical depth in closed form."""
    lo, hi = min(front, back), max(front, back)
    cuts = np.unique(np.concatenate([[lo, hi], tf.knots[(tf.knots > lo) & (tf.knots < hi)]]))
    if len(cuts) == 1:
        A = -np.expm1(-float(tf.extinction(front)) * length)
        return np.append(A * tf.color(front), A)
    pieces = list(pairwise(cuts))
    if front > back:
        pieces = [(b, a) for a, b in reversed(pieces)]
    color, depth = np.zeros(3), 0.0
    for a, b in pieces:
        h = length * (b - a) / (back - front)
        # The limits from inside the piece: at a jump the ends belong to their own side.
        inner = a + (b - a) * np.array([0.25, 0.75])
        (ta, tb), (ca, cb) = tf.extinction(inner), tf.color(inner)
        t0, t1 = max(ta - (tb - ta) / 2, 0.0), max(tb + (tb - ta) / 2, 0.0)
        c0, c1 = ca - (cb - ca) / 2, cb + (cb - ca) / 2
        for k in range(3):

            def emission(u, t0=t0, t1=t1, c0=c0[k], c1=c1[k], h=h):
                tau = t0 + (t1 - t0) * u
                return (c0 + (c1 - c0) * u) * tau * h * np.exp(-h * u * (t0 + (t1 - t0) * u / 2))

            x = h * (t0 + t1) / 2
            # Where a deep piece is opaque after a fraction of it, quadrature needs to be told where to look.
            points = [p for p in 10.0 ** np.arange(-8, 0) if x > 1] or None
            color[k] += np.exp(-depth) * quad(emission, 0, 1, epsabs=1e-14, epsrel=1e-12, limit=400, points=points)[0]
        depth += h * (t0 + t1) / 2
    return np.append(color, -np.expm1(-depth))


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
        ({"domain": (3, 3)}, "domain must be .* lo < hi"),
        ({"domain": (0, float("inf"))}, "domain"),
        ({"generator": "magic"}, "generator must be one of 'incremental', 'brute', got 'magic'"),
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
