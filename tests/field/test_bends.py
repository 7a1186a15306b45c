"""How far cubes of cells are from linear, and how long steps in them may be, against NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base import reference
from wvr.integrators.adaptive_preintegrated import Bends, Distances, range_maxima
from wvr.keep import Keeper
from wvr.launch import get_device
from wvr.transfer.function import Transfer

# How far the field is from linear


@st.composite
def volumes(draw):
    """Small random volumes: noise, or a few samples different from the rest, of any spacing."""
    shape = draw(st.tuples(*[st.integers(2, 18)] * 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    data = rng.normal(size=shape) * (rng.random(shape) < draw(st.sampled_from([0.02, 0.3, 1.0])))
    return data + 0.1 * np.arange(shape[2]), rng.uniform(0.5, 3.0, 3), rng


@settings(max_examples=60, deadline=None)
@given(volumes())
def test_bounds_hold_along_any_ray(case):
    """Bends contain what a straight chord is off by, in every cube a ray crosses."""
    data, spacing, rng = case
    shape = np.array(data.shape)
    bends = cube_bends(data, spacing, "cpu")
    unit = spacing.min()
    for _ in range(10):
        # Two points of one cube, as [x, y, z] indices.
        cube = np.array([rng.integers(n) for n in bends.shape[:3]])[::-1]
        low, high = 8 * cube, np.minimum(8 * cube + 8, shape[::-1] - 1)
        ends = low + rng.random((2, 3)) * (high - low)
        h = np.linalg.norm((ends[1] - ends[0]) * spacing) / unit
        u = np.linspace(0, 1, 2001)
        s = reference.trilinear(data, ends[0] + u[:, None] * (ends[1] - ends[0]))
        bend = bends[tuple(cube[::-1])]
        deviation = np.trapezoid(np.abs(s - (s[0] + u * (s[-1] - s[0]))), u * h)
        assert deviation <= (bend[0] * h**2 / 8 + bend[1] * h**3 / 12) * (1 + 1e-5) + 1e-9


def test_bends_are_no_larger_than_they_need_be(device):
    """One kink in the middle of a step, and one twisted cell along its diagonal, are what the bounds say."""
    tent = np.abs(np.arange(9.0) - 4)[None, None, :] * np.ones((9, 9, 1))
    np.testing.assert_allclose(cube_bends(tent, (1, 1, 1), device)[0, 0, 0], (2, 2))
    # The area between tent and chord is all of the first term; the second is for more kinks of the same size.
    assert np.trapezoid(4 - np.abs(np.linspace(-4, 4, 2001)), dx=8 / 2000) == pytest.approx(2 * 8**2 / 8)
    y, x = np.mgrid[:9.0, :9.0]
    saddle = np.broadcast_to(x * y, (9, 9, 9))
    # s'' = 2 dx dy = 1 along the diagonal; one mixed difference of three costs sqrt(4/3).
    np.testing.assert_allclose(cube_bends(saddle, (1, 1, 1), device)[0, 0, 0], (0, np.sqrt(4 / 3)), atol=1e-9)
    z = np.arange(9.0)[:, None, None]
    # All three: s'' = 2 along (1, 1, 1) / sqrt(3), and that is the bound.
    form = x * y + x * z + y * z
    np.testing.assert_allclose(cube_bends(form, (1, 1, 1), device)[0, 0, 0], (0, 2), atol=1e-9)
    # Lengths are in units of the smallest spacing: an axis twice as long halves its kinks and quarters their density.
    np.testing.assert_allclose(cube_bends(tent, (2, 1, 1), device)[0, 0, 0], (1, 0.5))


def test_a_field_that_is_linear_does_not_bend(device):
    z, y, x = np.meshgrid(*[np.arange(19.0)] * 3, indexing="ij")
    assert cube_bends(2 * x - 3 * y + z, (1, 2, 3), device).max() < 1e-12


@pytest.mark.parametrize("absent", [np.nan, np.inf, -np.inf])
def test_cubes_with_absent_cells_bend_without_limit(device, absent):
    data = np.zeros((17, 17, 49), np.float32)
    data[8, 8, 40] = absent
    bends = cube_bends(data, (1, 1, 1), device)
    # A sample at 40 is one of the cells 32 .. 40 and of those behind.
    assert bends[:, :, :4].max() == 0 and np.all(np.isinf(bends[:, :, 4:]))


# How long a step may be


def transfer_functions():
    """Random control points over 0..8, some of them transparent, some of them jumps."""

    def make(seed):
        rng = np.random.default_rng(seed)
        knots = np.sort(rng.choice(np.repeat(np.arange(0, 8.25, 0.25), 2), rng.integers(2, 12), replace=False))
        opacity = rng.random(len(knots)) * (rng.random(len(knots)) > 0.4)
        return wvr.TransferFunction.from_arrays(knots, rng.random((len(knots), 3)), opacity)

    return st.integers(0, 2**32 - 1).map(make)


@settings(max_examples=100, deadline=None)
@given(transfer_functions(), st.floats(-1, 9), st.floats(0, 4), st.floats(0.5, 3))
def test_range_maxima(tf, low, width, unit):
    """Two rows cover what a dense sampling sees: slopes, extinction, colours of what is visible."""
    maxima = range_maxima(tf, unit, get_device("cpu")).numpy()
    first, last = (np.searchsorted(tf.knots, s, "right") for s in (low, low + width))
    level = int(np.log2(last - first + 1))
    most = np.maximum(maxima[level, first], maxima[level, last + 1 - 2**level])
    np.testing.assert_array_equal(most, maxima[0, first : last + 1].max(axis=0))
    s = np.linspace(low, low + width, 401)
    tau, color = tf.extinction(s, unit) * unit, tf.color(s)
    assert tau.max() <= most[1] * (1 + 1e-9) + 1e-12
    seen = color[tau > 0]
    if len(seen):
        assert np.all(seen.max(axis=0) <= most[2:5] + 1e-12) and np.all(-seen.min(axis=0) <= most[5:] + 1e-12)
    change = np.abs(np.diff(tau[:, None] * color, axis=0)).max() if width > 0 else 0
    assert max(change, np.abs(np.diff(tau)).max()) <= most[0] * width / 400 * (1 + 1e-6) + 1e-9


def test_distances_keep_the_error_of_a_step(device):
    """Steps as long as a cube's distance, anywhere in it: depth by a fine sum against depth of the chord."""
    rng = np.random.default_rng(7)
    data = 4 + np.cumsum(rng.normal(size=(33, 33, 33)), axis=0) * 0.2
    tf = wvr.TransferFunction.from_arrays([1, 3, 5, 7], rng.random((4, 3)), [0.0, 0.4, 0.1, 0.3])
    tolerance, worst = 0.01, 0.0
    distances = cube_distances(data, tf, tolerance, device)
    assert distances.min() > 0.05 and distances.max() < 4
    for _ in range(400):
        cube = rng.integers(0, 4, 3)
        h = distances[tuple(cube[::-1])]
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        start = 8 * cube + rng.random(3) * 8
        if np.any((start + h * direction < 8 * cube) | (start + h * direction > 8 * cube + 8)):
            continue
        u = np.linspace(0, 1, 1001)
        s = reference.trilinear(data, start + (u * h)[:, None] * direction)
        chord = s[0] + u * (s[-1] - s[0])
        error = np.trapezoid(np.abs(tf.extinction(s) - tf.extinction(chord)), u * h)
        assert error <= tolerance
        worst = max(worst, error)
    assert worst > tolerance / 20  # a bound that is of use


def test_distances_follow_curvature_and_visibility(device):
    """A straighter field, a flatter transfer function and a larger tolerance allow longer steps, by a square root."""
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(5, 5, 5))

    def distance(data, opacity, tolerance=1e-3):
        tf = wvr.TransferFunction([(-50, "white", 0.0), (50, "white", opacity)])
        return cube_distances(data, tf, tolerance, device)[0, 0, 0]

    base = distance(noise, 0.5)
    for straighter in (
        distance(noise / 4, 0.5),
        distance(noise, -np.expm1(np.log(0.5) / 4)),
        distance(noise, 0.5, 4e-3),
    ):
        assert 4 ** (1 / 3) * base <= straighter * (1 + 1e-6) and straighter <= 2 * base * (1 + 1e-6)
    ramp = np.arange(5.0)[None, None, :] * np.ones((5, 5, 1))
    flat = wvr.TransferFunction([(-50, "white", 0.3), (50, "white", 0.3)])
    jump = wvr.TransferFunction([(0, "white", 0.0), (0, "white", 0.5)])
    assert distance(ramp, 0.5) == np.inf  # nothing bends
    assert cube_distances(noise, flat, 1e-3, device)[0, 0, 0] == np.inf  # nothing depends on s
    assert cube_distances(noise, jump, 1e-3, device)[0, 0, 0] == 0
    assert cube_distances(noise + 9, jump, 1e-3, device)[0, 0, 0] == np.inf  # a jump elsewhere costs nothing
    # Colours that differ: attenuation inside the step is even only to second order, depth^2 / 8.
    colors = wvr.TransferFunction([(0, "black", 0.3), (8, "white", 0.3)])
    expected = np.sqrt(8 * 1e-3) / -np.log(0.7)
    assert cube_distances(np.full((5, 5, 5), 4.0), colors, 1e-3, device)[0, 0, 0] == pytest.approx(expected)


def test_distances_where_data_are_absent(device):
    data = np.full((17, 17, 49), 5.0, np.float32)
    data[:, :, 40] = np.nan
    data[:, :, :33] = np.nan
    flat = wvr.TransferFunction([(0, "red", 0.5), (9, "red", 0.5)])
    assert cube_distances(data, flat, 1e-3, device).tolist() == [[[*[np.inf] * 4, 0, 0]] * 2] * 2


def cube_bends(data, spacing, device):
    scale = tuple((np.min(spacing) / np.asarray(spacing, float)).tolist())
    return Keeper(get_device(device))(Bends(wvr.Volume(data, nan="transparent").blocks(), scale)).numpy()


def cube_distances(data, tf, tolerance, device):
    bends = Bends(wvr.Volume(data, nan="transparent").blocks(), (1.0, 1.0, 1.0))
    functions = (Transfer(tf, 1.0, 0.0, "float64", False),)
    return Keeper(get_device(device))(Distances(bends, functions, tolerance, None)).numpy()
