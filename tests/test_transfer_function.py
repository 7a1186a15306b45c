"""Transfer functions against closed forms, an independent evaluation, and every error they promise."""

import json
import math
import os
import re

import matplotlib
import numpy as np
import pytest
import pyvista
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import ListedColormap

import wvr
from wvr.transfer_function import MAX_OPACITY, TransferFunction

GREY = (0.5, 0.5, 0.5)


def ramp(**options):
    return TransferFunction([(0, (0, 0, 0), 0.0), (10, (1, 2, 3), 0.5)], **options)


@st.composite
def control_points(draw):
    """Arrays of sorted control points with jumps among them."""
    scalars = draw(st.lists(st.floats(-1e6, 1e6, width=32), min_size=2, max_size=8, unique=True))
    scalars = sorted([*scalars, *draw(st.lists(st.sampled_from(scalars), max_size=3, unique=True))])
    n = len(scalars)
    unit = st.floats(0, 1)
    opacity = draw(st.lists(unit, min_size=n, max_size=n))
    rgb = draw(st.lists(st.tuples(unit, unit, st.floats(0, 100)), min_size=n, max_size=n))
    return scalars, rgb, opacity


def piecewise_linear(s, knots, values):
    """The definition, a loop over the segments: constant outside, the right value at a jump."""
    if s < knots[0]:
        return values[0]
    result = values[-1]
    for a, b, u, v in zip(knots, knots[1:], values, values[1:], strict=False):
        if a <= s < b:
            result = u * ((b - s) / (b - a)) + v * ((s - a) / (b - a))
    return result


# Evaluation


@settings(max_examples=200, deadline=None)
@given(control_points(), st.floats(0.01, 100), st.floats(-2e6, 2e6))
def test_evaluation_is_that_of_the_definition(points, unit, s):
    scalars, rgb, opacity = points
    tf = TransferFunction.from_arrays(scalars, rgb, opacity, unit_distance=unit)
    tau = [-math.log1p(-min(o, 1 - 2.0**-24)) / unit for o in opacity]
    probes = [s, *scalars, *np.nextafter(scalars, -np.inf)]
    np.testing.assert_allclose(
        tf.extinction(probes), [piecewise_linear(p, scalars, tau) for p in probes], rtol=1e-12, atol=1e-12 / unit
    )
    for channel in range(3):
        values = [color[channel] for color in rgb]
        expected = [piecewise_linear(p, scalars, values) for p in probes]
        np.testing.assert_allclose(tf.color(probes)[:, channel], expected, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("opacity", [1e-12, 0.05, 0.5, 0.999])
def test_opacity_is_that_of_a_slab_of_unit_distance(opacity):
    tf = TransferFunction([(0, GREY, opacity), (1, GREY, opacity)], unit_distance=2.5)
    assert -math.expm1(-tf.extinction(0.3) * 2.5) == pytest.approx(opacity, rel=1e-14)
    tf = TransferFunction([(0, GREY, opacity), (1, GREY, opacity)])
    assert -math.expm1(-tf.extinction(0.3, smallest_spacing=0.1) * 0.1) == pytest.approx(opacity, rel=1e-14)


def test_unit_distance_overrides_the_spacing():
    assert ramp(unit_distance=4).extinction(10, smallest_spacing=0.5) == math.log(2) / 4
    assert ramp().extinction(10, smallest_spacing=0.5) == math.log(2) / 0.5
    assert ramp().extinction(10) == math.log(2)


def test_extinction_not_opacity_is_linear_between_control_points():
    tf = TransferFunction([(0, GREY, 0.0), (1, GREY, 0.9)])
    assert tf.extinction(0.5) == pytest.approx(math.log(10) / 2, rel=1e-14)
    np.testing.assert_array_equal(ramp().color([-1, 0, 5, 10, 11]), np.outer([0, 0, 0.5, 1, 1], [1, 2, 3]))


def test_opacity_one_is_clamped_to_the_float_below():
    tf = TransferFunction([(0, GREY, 1.0), (1, GREY, 1.0)])
    assert tf.extinction(0) == pytest.approx(24 * math.log(2), rel=1e-14)
    assert np.nextafter(np.float32(1), np.float32(0)) == MAX_OPACITY


def test_a_jump_takes_the_left_value_below_and_the_right_one_at_and_above():
    tf = TransferFunction([(0, "red", 0.2), (5, "red", 0.2), (5, "blue", 0.6), (9, "blue", 0.6)])
    below = np.nextafter(5, 0)
    np.testing.assert_allclose(tf.extinction([below, 5.0]), [-math.log1p(-0.2), -math.log1p(-0.6)], rtol=1e-15)
    np.testing.assert_array_equal(tf.color([below, 5.0]), [[1, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(tf.knots, [0, 5, 5, 9])


def test_a_jump_at_either_end():
    tf = TransferFunction([(0, "red", 0.1), (0, "lime", 0.2), (1, "lime", 0.2), (1, "blue", 0.3)])
    s = [-1, np.nextafter(0, -1), 0, 0.5, np.nextafter(1, 0), 1, 2]
    np.testing.assert_allclose(-np.expm1(-tf.extinction(s)), [0.1, 0.1, 0.2, 0.2, 0.2, 0.3, 0.3], rtol=1e-14)
    np.testing.assert_array_equal(np.argmax(tf.color(s), axis=1), [0, 0, 1, 1, 1, 2, 2])


def test_shapes_nan_and_infinity():
    tf = ramp()
    assert tf.extinction(3).shape == () and tf.color(3).shape == (3,)
    assert tf.extinction(np.zeros((2, 3), np.uint8)).shape == (2, 3)
    assert tf.color(np.zeros((2, 3))).shape == (2, 3, 3)
    np.testing.assert_array_equal(tf.extinction([np.nan, -np.inf, np.inf]), [0, 0, math.log(2)])
    np.testing.assert_array_equal(tf.color([np.nan, np.inf]), [[0, 0, 0], [1, 2, 3]])


def test_knot_extinctions_are_those_at_the_knots():
    tf = TransferFunction([(-1000, GREY, 0.0), (0, GREY, 0.3), (0, GREY, 0.1), (50, GREY, 1.0)])
    expected = [0, -math.log(0.7) / 2, -math.log(0.9) / 2, 12 * math.log(2)]
    np.testing.assert_allclose(tf.knot_extinctions(2.0), expected, rtol=1e-14)


def test_points_closer_than_their_reciprocal_can_be_told_apart():
    tiny = 5e-324
    tf = TransferFunction([(0, GREY, 0.0), (tiny, GREY, 0.5)])
    np.testing.assert_array_equal(tf.extinction([0, tiny]), [0, math.log(2)])


# Colours


def test_names_and_hex_are_decoded_from_srgb():
    tf = TransferFunction([(0, "#0a80ff", 0), (1, "orange", 0)])
    # IEC 61966-2-1: 10/255 is below 0.04045 and thus linear.
    assert tf.colors[0] == pytest.approx([10 / 255 / 12.92, ((128 / 255 + 0.055) / 1.055) ** 2.4, 1.0], rel=1e-14)
    assert tf.colors[1] == pytest.approx([1.0, ((165 / 255 + 0.055) / 1.055) ** 2.4, 0.0], rel=1e-14)


def test_numbers_are_linear_and_may_exceed_one():
    np.testing.assert_array_equal(TransferFunction([(0, (0.2, 0.5, 7), 0), (1, GREY, 0)]).colors[0], [0.2, 0.5, 7])


# Identity


def test_equal_content_is_equal_and_has_one_key():
    assert ramp() == ramp() and hash(ramp()) == hash(ramp()) and ramp().key == ramp().key
    assert TransferFunction([(-0.0, (0, 0, 0), -0.0), (10, (1, 2, 3), 0.5)]).key == ramp().key
    assert ramp() != "ramp"


def test_everything_that_defines_it_changes_the_key():
    arrays = ([0, 1], [GREY, GREY], [0, 0.5])
    variants = [
        TransferFunction.from_arrays(*arrays),
        TransferFunction.from_arrays([0, 2], *arrays[1:]),
        TransferFunction.from_arrays([0, 1], [GREY, (0.5, 0.5, 0.6)], arrays[2]),
        TransferFunction.from_arrays(*arrays[:2], [0, 0.6]),
        TransferFunction.from_arrays(*arrays, unit_distance=1),
        TransferFunction.from_arrays(*arrays, ambient=[0, 1]),
        TransferFunction.from_arrays(*arrays, diffuse=[0, 1]),
        TransferFunction.from_arrays(*arrays, specular=[0, 1]),
    ]
    assert len({tf.key for tf in variants}) == len(variants)
    assert isinstance(variants[0].key, bytes)


def test_arrays_are_copied_and_read_only():
    scalars = np.array([0.0, 1.0])
    tf = TransferFunction.from_arrays(scalars, [GREY, GREY], [0, 0.5], ambient=[0.1, 0.2])
    scalars[0] = -5
    assert tf.knots[0] == 0
    for array in (tf.knots, tf.colors, tf.opacities, tf.ambient):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    assert tf.diffuse is None


def test_repr_says_what_it_is():
    assert repr(ramp(unit_distance=2)) == (
        "TransferFunction(2 control points on [0, 10], opacity up to 0.5, unit_distance=2.0)"
    )


# Colour maps


@pytest.mark.parametrize("m", [2, 4, 7, 52, 256, 300])
def test_from_colormap_keeps_colours_and_opacity(m):
    opacity = np.random.default_rng(m).uniform(0, 1, m)
    tf = TransferFunction.from_colormap("viridis", domain=(-3, 7), opacity=opacity)
    at_opacity, at_color = np.linspace(-3, 7, m), np.linspace(-3, 7, 256)
    s = np.linspace(-4, 8, 5001)
    np.testing.assert_allclose(-np.expm1(-tf.extinction(s)), np.interp(s, at_opacity, opacity), atol=1 / 512)
    srgb = np.array([matplotlib.colormaps["viridis"](i)[:3] for i in range(256)])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    for channel in range(3):
        np.testing.assert_allclose(tf.color(s)[:, channel], np.interp(s, at_color, linear[:, channel]), atol=1e-12)
    assert tf.knots[0] == -3 and tf.knots[-1] == 7 and np.all(np.diff(tf.knots) > 0)
    # Coinciding control points are one: with gcd(m - 1, 255) + 1 of them in common. Some are added between.
    assert m + 256 - math.gcd(m - 1, 255) - 1 <= len(tf.knots) <= 25 * m + 256
    assert np.diff(tf.knots).min() > 1e-9
    assert set(opacity) <= set(tf.opacities)


NAMED = ["linear", "linear_r", "geom", "geom_r", "sigmoid", "sigmoid_r", "sigmoid_1", "sigmoid_5", "sigmoid_20"]


@pytest.mark.parametrize("name", [*NAMED, "sigmoid_3_r", "foreground"])
def test_named_opacities_are_those_of_pyvista(name):
    """But for its rounding down to 8 bits."""
    expected = pyvista.opacity_transfer_function(name, 256) / 255
    tf = TransferFunction.from_colormap("gray", (0, 255), name)
    opacity = -np.expm1(-tf.extinction(np.arange(256)))
    assert np.all(opacity - expected > -1e-6) and np.all(opacity - expected < 1 / 255 + 1e-6)


def test_opacity_is_linear_between_few_colours_too():
    tf = TransferFunction.from_colormap(["black", "red"], (0, 1), [0, 1, 0])
    s = np.linspace(0, 1, 3001)
    np.testing.assert_allclose(-np.expm1(-tf.extinction(s)), 1 - np.abs(2 * s - 1), atol=1 / 512)
    np.testing.assert_allclose(tf.color(s)[:, 0], s, atol=1e-12)


def test_colours_of_a_logarithmic_scale():
    tf = TransferFunction.from_colormap("viridis", (0.01, 100), "linear", log_scale=True)
    plain = TransferFunction.from_colormap("viridis", (-2, 2), "linear")
    assert (tf.knots[0], tf.knots[-1]) == (0.01, 100)
    for exponent in np.linspace(-2, 2, 256):
        np.testing.assert_allclose(tf.color(10**exponent), plain.color(exponent), atol=1e-9)
        np.testing.assert_allclose(tf.extinction(10**exponent), plain.extinction(exponent), rtol=1e-6)
    with pytest.raises(ValueError, match="domain must be above 0 with log_scale"):
        TransferFunction.from_colormap("viridis", (0, 1), log_scale=True)


def test_fewer_colours_and_symmetric_limits():
    tf = TransferFunction.from_colormap("viridis", 2.5, 0.5, n_colors=3)
    assert (tf.knots.tolist(), tf.opacities.tolist()) == ([-2.5, 0, 2.5], [0.5] * 3)
    full = TransferFunction.from_colormap("viridis", (-2.5, 2.5), 0.5)
    np.testing.assert_allclose(tf.colors, full.color(tf.knots), atol=1e-12)
    with pytest.raises(ValueError, match="n_colors must be an integer from 2 to 65536, got 1"):
        TransferFunction.from_colormap("viridis", (0, 1), n_colors=1)


def test_the_unit_distance_of_pyvista():
    tf = TransferFunction.from_colormap("viridis", (0, 1), "linear", "pyvista")
    volume = wvr.Volume(np.zeros((5, 9, 21), np.uint8), spacing=(1, 2, 0.5))
    grid = volume.to_pyvista()
    unit = grid.length / (np.mean(grid.dimensions) - 1)
    assert tf.for_volume(volume).unit_distance == pytest.approx(unit, rel=1e-12)
    assert tf.for_volume(volume) == TransferFunction.from_colormap("viridis", (0, 1), "linear", unit)
    assert tf != TransferFunction.from_colormap("viridis", (0, 1), "linear") and hash(tf) != hash(tf.for_volume(volume))
    with pytest.raises(ValueError, match="unit_distance must be a length"):
        tf.extinction(0.5)


def test_from_colormap_takes_a_constant_and_a_colormap_object():
    tf = TransferFunction.from_colormap(ListedColormap(["black", "red"]), (0, 1), 0.25, unit_distance=3)
    np.testing.assert_array_equal(tf.colors, [[0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(tf.opacities, [0.25, 0.25])
    assert tf.unit_distance == 3
    np.testing.assert_array_equal(
        TransferFunction.from_colormap(ListedColormap(["red"]), (0, 1), 0.25).colors, [[1, 0, 0], [1, 0, 0]]
    )


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("no such map", (0, 1), 0.5), ValueError, "colormap must be .* got 'no such map'"),
        ((42, (0, 1), 0.5), TypeError, "colormap must be .* got 42"),
        (("viridis", (1, 1), 0.5), ValueError, r"domain must be \(lo, hi\) with lo < hi, got \(1.0, 1.0\)"),
        (("viridis", (2, 1), 0.5), ValueError, "domain must be"),
        (("viridis", (0, math.nan), 0.5), ValueError, "domain must be finite"),
        (("viridis", (0, 1, 2), 0.5), ValueError, "domain must have shape"),
        (("viridis", (-1.7e308, 1.7e308), 0.5), ValueError, "domain must be"),
        (("viridis", (0, 1), [0.5]), ValueError, "opacity must be one number, or two or more"),
        (("viridis", (0, 1), [0, 1.5]), ValueError, "opacity must be in .0, 1., got 1.5"),
        (("viridis", (0, 1), [0, math.nan]), ValueError, "opacity must be finite"),
        (("viridis", (0, 1), [[0, 1]]), ValueError, "opacity must have shape"),
        (("viridis", (0, 1), 0.5, 0), ValueError, "unit_distance must be"),
        (("virdis", (0, 1), 0.5), ValueError, "got 'virdis'; did you mean 'viridis'"),
        ((["red"], (0, 1), 0.5), ValueError, "colormap must be a list of two or more colours"),
        ((["red", "bluu"], (0, 1), 0.5), ValueError, r"colormap\[1\] must be"),
        (("viridis", (0, 1), "sigmod_5"), ValueError, "opacity must be numbers .*got 'sigmod_5'"),
        (("viridis", (0, 1), "foreground_r"), ValueError, "opacity must be numbers"),
        (("viridis", (0, 1), [0, 128, 255]), ValueError, "got 128.0; divide 8-bit ones by 255"),
    ],
)
def test_from_colormap_errors(arguments, error, message):
    with pytest.raises(error, match=message):
        TransferFunction.from_colormap(*arguments)


# Isosurfaces


def test_isosurfaces_are_triangles_with_nothing_between():
    tf = TransferFunction.isosurfaces([140, 90], colors=["red", (0, 0, 3)], opacity=[0.3, 0.8], width=4)
    np.testing.assert_array_equal(tf.knots, [88, 90, 92, 138, 140, 142])
    np.testing.assert_array_equal(tf.opacities, [0, 0.8, 0, 0, 0.3, 0])
    np.testing.assert_array_equal(tf.extinction([0, 88, 92, 115, 138, 142, 255]), 0)
    assert tf.extinction(91) == pytest.approx(-math.log(0.2) / 2, rel=1e-14)
    np.testing.assert_array_equal(tf.color([88, 91.9, 138, 141]), [[0, 0, 3], [0, 0, 3], [1, 0, 0], [1, 0, 0]])


def test_isosurface_defaults():
    tf = TransferFunction.isosurfaces([1, 5, 9])
    assert tf.extinction(5) == pytest.approx(-math.log(0.4)) and tf.knots[0] == 0 and tf.unit_distance is None
    assert len({tuple(color) for color in tf.color([1, 5, 9])}) == 3
    assert len(TransferFunction.isosurfaces(7).knots) == 3


def test_spikes_that_touch_are_a_jump_of_colour():
    tf = TransferFunction.isosurfaces([1, 2], colors=["red", "blue"], width=1)
    np.testing.assert_array_equal(tf.knots, [0.5, 1, 1.5, 1.5, 2, 2.5])
    np.testing.assert_array_equal(tf.color([np.nextafter(1.5, 0), 1.5]), [[1, 0, 0], [0, 0, 1]])
    assert tf.extinction(1.5) == 0
    # 0.3 - 0.2 is less than 0.1 by rounding only.
    assert len(TransferFunction.isosurfaces([0.1, 0.2, 0.3], width=0.1).knots) == 9


def test_the_largest_width_that_the_error_names_is_accepted():
    values = [90, 140.3, 145.7]
    with pytest.raises(ValueError, match="width must be at most") as caught:
        TransferFunction.isosurfaces(values, width=6)
    largest = float(re.search(r"at most ([\d.]+)", str(caught.value))[1])
    assert largest == pytest.approx(5.4)
    TransferFunction.isosurfaces(values, width=largest)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(values=[]), "values must be one or more"),
        (dict(values=[1, math.inf]), "values must be finite"),
        (dict(values=[1, 1]), "width must be at most 0.0"),
        (dict(values=[1], width=0), "width must be finite and > 0"),
        (dict(values=[1], width=math.nan), "width must be"),
        (dict(values=[1, 9], colors=["red"]), r"colors must be a list of one colour a value \(2\)"),
        (dict(values=[1, 9, 20], colors="red"), "colors must be a list"),
        (dict(values=[1], colors=["no such colour"]), r"colors\[0\] must be .* got 'no such colour'"),
        (dict(values=[1, 9], opacity=[0.5]), r"opacity must have shape \(2,\), got \(1,\)"),
        (dict(values=[1], opacity=1.2), "opacity must be in"),
        (dict(values=[1], unit_distance=-1), "unit_distance must be"),
    ],
)
def test_isosurface_errors(arguments, message):
    with pytest.raises(ValueError, match=message):
        TransferFunction.isosurfaces(**arguments)


# Errors of the constructors


@pytest.mark.parametrize(
    ("points", "error", "message"),
    [
        ([], ValueError, "at least two control points, got 0"),
        ([(0, GREY, 0)], ValueError, "at least two control points, got 1"),
        ([(0, GREY, 0), (1, GREY)], ValueError, r"points\[1\] must be \(scalar, colour, opacity\)"),
        (["abc", (1, GREY, 0)], ValueError, r"points\[0\] must be"),
        ([5, (1, GREY, 0)], ValueError, r"points\[0\] must be"),
        ([(1, GREY, 0), (0, GREY, 0)], ValueError, "scalars must be sorted, got 1 before 0 at index 0"),
        ([(0, GREY, 0), (1, GREY, 0), (1, GREY, 1), (1, GREY, 0)], ValueError, "at one scalar, got three at 1"),
        ([(math.nan, GREY, 0), (1, GREY, 0)], ValueError, "scalars must be finite, got nan"),
        ([(0, GREY, 0), (math.inf, GREY, 0)], ValueError, "scalars must be finite, got inf"),
        ([(-1.7e308, GREY, 0), (1.7e308, GREY, 0)], ValueError, "scalars must span a finite range"),
        ([("zero", GREY, 0), (1, GREY, 0)], TypeError, r"scalar of points\[0\] must be a number, got 'zero'"),
        ([(0, "no such colour", 0), (1, GREY, 0)], ValueError, r"colour of points\[0\] .* got 'no such colour'"),
        ([(0, "#12345678", 0), (1, GREY, 0)], ValueError, r"colour of points\[0\] must be opaque"),
        ([(0, (0, 0), 0), (1, GREY, 0)], ValueError, r"colour of points\[0\]"),
        ([(0, (0, -0.1, 0), 0), (1, GREY, 0)], ValueError, r"colour of points\[0\] .* -0.1"),
        ([(0, (0, math.nan, 0), 0), (1, GREY, 0)], ValueError, r"colour of points\[0\] .* nan"),
        ([(0, GREY, -0.1), (1, GREY, 0)], ValueError, r"opacity must be in \[0, 1\], got -0.1"),
        ([(0, GREY, 0), (1, GREY, 1.0001)], ValueError, r"opacity must be in \[0, 1\], got 1.0001"),
        ([(0, GREY, math.nan), (1, GREY, 0)], ValueError, "opacity must be finite"),
        ([(0, GREY, None), (1, GREY, 0)], TypeError, r"opacity of points\[0\] must be a number"),
    ],
)
def test_wrong_points(points, error, message):
    with pytest.raises(error, match=message):
        TransferFunction(points)


@pytest.mark.parametrize("unit", [0, -1, math.nan, math.inf])
def test_wrong_unit_distance(unit):
    with pytest.raises(ValueError, match="unit_distance must be finite and > 0"):
        ramp(unit_distance=unit)
    with pytest.raises(ValueError, match="smallest_spacing must be finite and > 0"):
        ramp().extinction(1, smallest_spacing=unit)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (dict(rgb=[GREY]), ValueError, r"rgb must have shape \(2, 3\), got \(1, 3\)"),
        (dict(rgb=[0.1, 0.2]), ValueError, r"rgb must have shape \(2, 3\)"),
        (dict(rgb=[GREY, (0, 0, -1)]), ValueError, "rgb must be >= 0, got -1"),
        (dict(rgb=[GREY, (0, 0, math.inf)]), ValueError, "rgb must be finite"),
        (dict(opacity=[0, 0, 0]), ValueError, r"opacity must have shape \(2,\), got \(3,\)"),
        (dict(scalars=[[0, 1]]), ValueError, r"scalars must have shape \(n,\), got \(1, 2\)"),
        (dict(scalars=["a", "b"]), TypeError, "scalars must be numbers"),
        (dict(ambient=[0.5]), ValueError, "ambient must have shape"),
        (dict(diffuse=[0.5, -1]), ValueError, "diffuse must be >= 0, got -1"),
        (dict(specular=[0.5, math.nan]), ValueError, "specular must be finite"),
    ],
)
def test_wrong_arrays(change, error, message):
    arguments = dict(scalars=[0, 1], rgb=[GREY, GREY], opacity=[0, 1]) | change
    with pytest.raises(error, match=message):
        TransferFunction.from_arrays(**arguments)


def test_unknown_preset_lists_the_known():
    with pytest.raises(ValueError, match=r"'ct-bone'.*got 'bone'"):
        TransferFunction.preset("bone")
    with pytest.raises(ValueError, match="domain must be"):
        TransferFunction.preset("mri", domain=(5, 5))


# Files


@settings(max_examples=50, deadline=None)
@given(control_points(), st.none() | st.floats(1e-300, 1e300))
def test_save_and_load_are_exact(tmp_path_factory, points, unit):
    path = tmp_path_factory.getbasetemp() / "tf.json"
    tf = TransferFunction.from_arrays(*points, unit_distance=unit, diffuse=points[2])
    tf.save(path)
    loaded = TransferFunction.load(path)
    assert loaded == tf and loaded.unit_distance == tf.unit_distance
    for name in ("knots", "colors", "opacities", "diffuse"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(tf, name))
    assert loaded.ambient is None and loaded.specular is None


def test_the_file_is_readable_json_one_control_point_a_line(tmp_path):
    ramp(unit_distance=2).save(str(tmp_path / "tf.json"))
    text = (tmp_path / "tf.json").read_text()
    assert '    {"scalar": 10.0, "color": [1.0, 2.0, 3.0], "opacity": 0.5}\n' in text
    assert json.loads(text)["version"] == 1
    assert os.listdir(tmp_path) == ["tf.json"]


def test_save_replaces_and_leaves_nothing_where_it_fails(tmp_path, monkeypatch):
    path = tmp_path / "tf.json"
    path.write_text("before")
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
        with pytest.raises(OSError, match="disk full"):
            ramp().save(path)
    assert os.listdir(tmp_path) == ["tf.json"] and path.read_text() == "before"
    ramp().save(path)
    assert TransferFunction.load(path) == ramp()
    with pytest.raises(FileNotFoundError):
        ramp().save(tmp_path / "missing" / "tf.json")
    # Whoever may write everywhere still cannot write below a file.
    with pytest.raises(OSError):
        ramp().save(path / "tf.json")
    assert os.listdir(tmp_path) == ["tf.json"]


GOOD = {
    "format": "wvr transfer function",
    "version": 1,
    "unit_distance": None,
    "points": [{"scalar": s, "color": [0, 0, 0], "opacity": 0} for s in (0, 1)],
}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is not a JSON file"),
        (json.dumps(GOOD)[:-20], "is not a JSON file"),
        (b"\xff\xfe\x00", "is not a JSON file"),
        ("[" * 100_000, "is not a JSON file"),
        ("[1, 2]", "is not a transfer function"),
        ('{"format": "png"}', "is not a transfer function"),
        (json.dumps(GOOD | {"version": 2}), "has version 2 of the format; this wvr reads 1"),
        (json.dumps({k: v for k, v in GOOD.items() if k != "points"}), "lacks 'points'"),
        (json.dumps({k: v for k, v in GOOD.items() if k != "unit_distance"}), "lacks 'unit_distance'"),
        (json.dumps(GOOD | {"points": [{"scalar": 0, "opacity": 0}] * 2}), "lacks 'color'"),
        (json.dumps(GOOD | {"points": 5}), "holds no valid transfer function"),
        (json.dumps(GOOD | {"points": []}), "at least two control points, got 0"),
        (json.dumps(GOOD | {"points": [1, 2]}), "holds no valid transfer function"),
        (json.dumps(GOOD | {"unit_distance": "far"}), "unit_distance must be a number"),
        (json.dumps(GOOD).replace('"scalar": 1', '"scalar": NaN'), "scalars must be finite"),
        (json.dumps(GOOD).replace("[0, 0, 0]", "[0, 0]"), r"rgb must have shape"),
        (json.dumps(GOOD).replace('"opacity": 0', '"opacity": 2'), r"opacity must be in \[0, 1\], got 2"),
    ],
)
def test_wrong_files_say_what_is_wrong(tmp_path, content, message):
    path = tmp_path / "tf.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match=message) as caught:
        TransferFunction.load(path)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError):
        TransferFunction.load(tmp_path / "missing.json")
