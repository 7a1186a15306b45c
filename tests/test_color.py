import numpy as np
import pytest

from wvr import TransferFunction
from wvr.color import linear_rgb, linear_to_srgb, srgb_to_linear


def test_curve_has_published_values():
    # 18% grey and the encoded middle, from the standard's formula worked by hand.
    assert srgb_to_linear(0.5) == pytest.approx(0.21404114048223255, abs=1e-15)
    assert linear_to_srgb(0.18) == pytest.approx(0.46135612950044164, abs=1e-15)
    np.testing.assert_array_equal(srgb_to_linear([0.0, 1.0]), [0.0, 1.0])
    np.testing.assert_allclose(linear_to_srgb([0.0, 1.0]), [0.0, 1.0], atol=1e-15)


def test_linear_part_near_black():
    assert srgb_to_linear(0.04) == 0.04 / 12.92
    assert linear_to_srgb(0.003) == 0.003 * 12.92


def test_both_ways_are_inverse():
    values = np.linspace(0, 1, 10001)
    np.testing.assert_allclose(srgb_to_linear(linear_to_srgb(values)), values, atol=1e-7)
    codes = np.arange(256)
    np.testing.assert_array_equal(np.rint(255 * linear_to_srgb(srgb_to_linear(codes / 255))), codes)


@pytest.mark.filterwarnings("error")
def test_values_outside_the_unit_interval():
    assert linear_to_srgb(-0.5) == -0.5 * 12.92
    assert srgb_to_linear(-0.5) == -0.5 / 12.92
    assert linear_to_srgb(4.0) > 1


def test_shape_and_precision():
    result = linear_to_srgb(np.zeros((2, 3, 4), np.float32))
    assert result.shape == (2, 3, 4)
    assert result.dtype == np.float64


@pytest.mark.parametrize(
    "color, encoded",
    [
        ("black", (0, 0, 0)),
        ("white", (255, 255, 255)),
        ("orange", (255, 165, 0)),
        ("#336699", (51, 102, 153)),
        ("#369", (51, 102, 153)),
        ("tab:blue", (31, 119, 180)),
    ],
)
def test_names_are_decoded(color, encoded):
    result = linear_rgb(color)
    assert result.dtype == np.float64
    np.testing.assert_allclose(result, srgb_to_linear(np.array(encoded) / 255), atol=1e-15)


@pytest.mark.parametrize("color", [(0.5, 0.25, 4.0), [0.5, 0.25, 4], np.array([0.5, 0.25, 4], np.float32)])
def test_numbers_are_linear(color):
    result = linear_rgb(color)
    assert result.dtype == np.float64
    np.testing.assert_array_equal(result, [0.5, 0.25, 4.0])


def test_eight_bits_are_doubted():
    with pytest.warns(UserWarning, match="background is in linear numbers, of which 1 is white, and has 255"):
        linear_rgb((255, 0, 0), "background")
    with pytest.warns(UserWarning, match="rgb is in linear numbers"):
        TransferFunction.from_arrays([0, 1], np.array([[0, 0, 0], [0, 128, 0]]), [0, 1])


def test_colours_of_pyvista():
    Color = pytest.importorskip("pyvista").Color
    np.testing.assert_array_equal(linear_rgb(Color("tomato")), linear_rgb("tomato"))


def test_result_is_a_copy():
    color = np.array([0.1, 0.2, 0.3])
    linear_rgb(color)[0] = 9
    assert color[0] == 0.1


@pytest.mark.parametrize(
    "color",
    [
        "oranj",
        "#12345",
        (1, 2),
        (1, 2, 3, 4),
        (1, -1, 0),
        (1, np.nan, 0),
        (np.inf, 0, 0),
        None,
        3.0,
        [[1, 2, 3]],
    ],
)
def test_refused(color):
    with pytest.raises(ValueError, match=r"background must be .*name.*linear numbers >= 0, got"):
        linear_rgb(color, "background")


@pytest.mark.parametrize("color", ["#ff000080", "none"])
def test_transparency_refused(color):
    with pytest.raises(ValueError, match=r"color must be opaque, got"):
        linear_rgb(color)
