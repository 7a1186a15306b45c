"""Presets lie where the tissues are; suggestions show the object and not the background of phantoms."""

import math

import numpy as np
import pytest

from wvr.presets import PRESETS, names, preset, suggest
from wvr.transfer_function import TransferFunction
from wvr.volume import Volume

AIR, LUNG, FAT, WATER, MUSCLE, CONTRAST, CORTICAL = -1000, -750, -75, 0, 50, 350, 1200


def ball(size=48, radius=0.6):
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, size)] * 3, indexing="ij")
    return x * x + y * y + z * z < radius * radius


def noisy(inside, background, value, sigma=3.0):
    """A uint8 phantom: ``value`` in ``inside``, ``background`` elsewhere, both with noise."""
    noise = np.random.default_rng(0).normal(0, sigma, inside.shape)
    return np.clip(np.where(inside, value, background) + noise, 0, 255).round().astype(np.uint8)


# Presets


@pytest.mark.parametrize("name", names())
def test_every_preset_is_valid_and_leaves_its_lowest_scalar_transparent(name):
    tf = TransferFunction.preset(name)
    assert tf == preset(name) and tf.unit_distance is None
    assert tf.extinction(PRESETS[name].range[0]) == 0 and tf.opacities.max() >= 0.1


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("domain", [(0, 255), (-3.5, -1.25), (24, 3024)])
def test_a_domain_maps_the_presets_scalars_affinely(name, domain):
    own, mapped = preset(name), preset(name, domain)
    u = np.linspace(-0.2, 1.2, 1001)
    (a, b), (lo, hi) = PRESETS[name].range, domain
    np.testing.assert_allclose(mapped.extinction(lo + u * (hi - lo)), own.extinction(a + u * (b - a)), atol=1e-9)
    np.testing.assert_allclose(mapped.color(lo + u * (hi - lo)), own.color(a + u * (b - a)), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "seen", "transparent"),
    [
        ("ct-bone", [CORTICAL], [AIR, LUNG, FAT, WATER, MUSCLE]),
        ("ct-soft-tissue", [FAT, MUSCLE, CORTICAL], [AIR, LUNG]),
        ("ct-angiography", [CONTRAST, CORTICAL], [AIR, LUNG, FAT, WATER, MUSCLE]),
        ("ct-lung", [LUNG, -400], [AIR, FAT, WATER, MUSCLE]),
        ("mri", [0.4, 1.0], [0.0, 0.05]),
        ("simulation", [0.5, 1.0], [0.0]),
        ("isosurfaces", [0.2, 0.4, 0.6, 0.8], [0, 0.3, 0.5, 0.7, 1]),
    ],
)
def test_presets_show_what_they_are_named_for(name, seen, transparent):
    tf = preset(name)
    assert np.all(tf.extinction(seen) > 0.005)
    np.testing.assert_array_equal(tf.extinction(transparent), 0)


def test_contrast_medium_outshines_bone_in_angiography():
    tf = preset("ct-angiography")
    assert tf.extinction(CONTRAST) > 2 * tf.extinction(800)


def test_unknown_presets_and_domains():
    with pytest.raises(ValueError, match=r"name of a preset must be one of 'ct-bone', .*got 'ct'"):
        preset("ct")
    with pytest.raises(ValueError, match="domain must be"):
        preset("mri", (1, 0))


# Suggestions


@pytest.mark.parametrize("background", [0, 10, 75])
def test_noise_is_transparent_and_the_object_is_not(background):
    suggestions = suggest(Volume(noisy(ball(), background, 160)))
    for tf in suggestions.values():
        np.testing.assert_array_equal(tf.extinction(np.arange(background + 7)), 0)
    tf = suggestions["bands"]
    assert next(iter(suggestions)) == "bands"
    # Seen through, the ball (29 voxels across) neither vanishes nor hides what is behind its first voxels.
    assert 0.5 < tf.extinction(160) * 29 < 7
    assert np.all(np.diff(tf.extinction(np.arange(256))) >= 0)


def test_a_bright_background_is_mirrored():
    values = noisy(ball(), 20, 160)
    dark, bright = (suggest(Volume(v))["bands"] for v in (values, 255 - values))
    s = np.arange(256.0)
    np.testing.assert_allclose(bright.extinction(255 - s), dark.extinction(s), rtol=0.1, atol=2e-3)
    assert bright.extinction(235) == 0 and bright.extinction(95) > 0.02


def test_opacity_of_a_box_has_a_closed_form():
    # All that is not background is in the highest band, whose optical depth shall be 4 through 16 voxels.
    values = np.zeros((40, 40, 40), np.uint8)
    values[8:24, 8:24, 8:24] = 200
    assert suggest(Volume(values))["bands"].opacities[-1] == pytest.approx(-math.expm1(-4 / 16), rel=1e-12)
    # Voxels twice as long along z: 32, 16 and 16 of the smallest spacing, and half the rays along y and x.
    volume = Volume(values, spacing=(0.5, 0.5, 1.0))
    assert suggest(volume)["bands"].opacities[-1] == pytest.approx(-math.expm1(-4 / 3 * (1 / 32 + 2 / 16)), rel=1e-12)


def test_large_volumes_are_sampled_with_strides():
    values = np.zeros((40, 40, 320), np.uint8)
    values[8:24, 8:24, 60:90] = 200
    tf = suggest(Volume(values))["bands"]
    assert tf.opacities[-1] == pytest.approx(-math.expm1(-4 / 3 * (2 / 16 + 1 / 30)), rel=1e-12)


def test_sparse_data_get_more_opacity_than_solid_data():
    tube = np.zeros((64, 64, 64), bool)
    tube[:, 30:33, 30:33] = True
    sparse, solid = (suggest(Volume(np.where(m, 180, 0).astype(np.uint8)))["bands"] for m in (tube, ball(64, 0.9)))
    assert sparse.extinction(180) > 2 * solid.extinction(180)


def test_the_dense_stands_out_of_the_common():
    values = noisy(ball(), 0, 90)
    values[noisy(ball(radius=0.2), 0, 1, 0) == 1] = 230
    tf = suggest(Volume(values))["bands"]
    assert tf.extinction(230) > 1.5 * tf.extinction(90) > 0


def test_a_few_outliers_do_not_stretch_the_range():
    values = noisy(ball(), 20, 160).astype(np.float32)
    plain = suggest(Volume(values))["bands"]
    values[0, 0, :3] = [1e6, -1e6, 1e5]
    outliers = suggest(Volume(values))["bands"]
    np.testing.assert_allclose(outliers.knots, plain.knots, rtol=0.1)


def test_nan_is_left_out():
    values = noisy(ball(), 20, 160).astype(np.float32)
    holes = values.copy()
    holes[:, :2] = np.nan
    holes[0, 5, 5] = np.inf
    np.testing.assert_allclose(
        suggest(Volume(holes, nan="transparent"))["bands"].knots, suggest(Volume(values))["bands"].knots, rtol=0.05
    )


def test_a_single_voxel_between_the_strides_is_found():
    values = np.zeros((1, 4, 300), np.int16)
    values[0, 1, 1] = 500
    tf = suggest(Volume(values))["bands"]
    assert tf.extinction(0) == 0 and tf.extinction(500) > 1


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float16", "float32", "float64"])
def test_every_dtype_and_random_values(dtype):
    values = np.random.default_rng(1).integers(0, 100, (7, 5, 6)).astype(dtype)
    for tf in suggest(Volume(values)).values():
        assert np.all(tf.knot_extinctions() >= 0) and tf.opacities.max() > 0


@pytest.mark.parametrize("values", [np.zeros((4, 4, 4)), np.full((3, 3, 3), 1e8) + np.arange(3) * 1e-8])
def test_a_constant_volume_has_no_suggestion(values):
    with pytest.raises(ValueError, match=r"volume must have at least two different finite samples.*clim="):
        suggest(Volume(values))


def test_a_volume_without_finite_samples_has_no_suggestion():
    with pytest.raises(ValueError, match="volume must have at least two different finite samples"):
        suggest(Volume(np.full((3, 3, 3), np.nan), nan="transparent"))
