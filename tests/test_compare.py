"""Comparisons of images, against numbers worked out by hand."""

import numpy as np
import pytest

import wvr


@pytest.fixture
def pair():
    reference = np.full((10, 20, 4), 0.5)
    image = reference.copy()
    image[0, 0, 0] += 0.02
    image[1, :, 3] -= 0.002
    return image, reference


def test_numbers(pair):
    result = wvr.compare(*pair)
    assert result.max == pytest.approx(0.02)
    np.testing.assert_allclose(result.channel_max, [0.02, 0, 0, 0.002])
    np.testing.assert_allclose(result.channel_mean, [0.02 / 200, 0, 0, 0.0002])
    assert result.mean == pytest.approx((0.02 + 20 * 0.002) / 800)
    assert result.rms == pytest.approx(np.sqrt((0.02**2 + 20 * 0.002**2) / 800))
    assert result.psnr == pytest.approx(-20 * np.log10(result.rms))
    assert result.shares == {1e-2: 1 / 200, 5e-3: 1 / 200, 1e-3: 21 / 200, 1e-4: 21 / 200}
    np.testing.assert_allclose(result.channel_shares[1e-3], [1 / 200, 0, 0, 0.1])
    assert result.map.shape == (10, 20) and result.difference().shape == (10, 20, 4)
    counts, edges = result.histogram()
    assert counts.sum() == 200 and counts[0] == 179 and len(edges) == len(counts) + 1
    assert "10.500%" in str(result) and "max=2.00e-02" in repr(result)


def test_equal_images(pair):
    result = wvr.compare(pair[0], pair[0])
    assert result.max == 0 and result.psnr == np.inf and not any(result.shares.values())


def test_images_and_arrays(pair):
    image = wvr.Image(pair[0].astype(np.float32), np.zeros((10, 20), np.int32))
    assert wvr.compare(image, pair[1]).max == pytest.approx(0.02, rel=1e-4)
    assert wvr.compare(image, image).max == 0


def test_limits(pair):
    assert wvr.compare(*pair, limits=[0.5]).shares == {0.5: 0.0}
    assert repr(wvr.compare(pair[0], pair[0], [])) == "Comparison(max=0.00e+00, mean=0.00e+00, rms=0.00e+00)"


def test_picture(pair, tmp_path):
    wvr.compare(*pair).save(tmp_path / "difference.png")
    wvr.compare(pair[0], pair[0]).save(tmp_path / "equal.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["difference.png", "equal.png"]


@pytest.mark.parametrize(
    ("image", "reference", "kwargs", "message"),
    [
        (np.zeros((2, 2, 3)), np.zeros((2, 2, 4)), {}, r"image must be an Image or an array .*got shape \(2, 2, 3\)"),
        (np.zeros((2, 2, 4)), np.zeros((2, 3, 4)), {}, r"of one size, got \(2, 2, 4\) and \(2, 3, 4\)"),
        (np.zeros((2, 2, 4)), np.full((2, 2, 4), np.nan), {}, "reference must be finite, got 16 values"),
        (np.zeros((2, 2, 4)), np.zeros((2, 2, 4), np.uint8), {}, "reference must be linear RGBA, got uint8"),
        (np.zeros((0, 2, 4)), np.zeros((0, 2, 4)), {}, "image must be"),
        (np.zeros((2, 2, 4)), np.zeros((2, 2, 4)), {"limits": [0.0]}, "limits must be finite and > 0"),
    ],
)
def test_errors(image, reference, kwargs, message):
    with pytest.raises(ValueError, match=message):
        wvr.compare(image, reference, **kwargs)
