"""Kinds of data are told apart by what they are made of, and what each is for is visible."""

from itertools import pairwise

import numpy as np
import pytest

import wvr
from wvr.statistics import Statistics
from wvr.suggest import suggestion

from .helpers import DATA

Z, Y, X = np.meshgrid(*[np.linspace(-1, 1, 48)] * 3, indexing="ij")
BALL = X**2 + Y**2 + Z**2 < 0.4


def noise(sigma, seed=0):
    return np.random.default_rng(seed).normal(0, sigma, X.shape)


def first(values, **options):
    """Kind, and the first transfer function, of a volume of these samples."""
    found = suggestion(wvr.Volume(values, **options))
    return found.kind, next(iter(found.functions.values()))


def ct(padding=None):
    """A patient in Hounsfield units: fat around muscle around bone, in air, with noise."""
    values = np.full(X.shape, -1000.0)
    for radius, tissue in ((0.8, -90), (0.7, 50), (0.2, 900)):
        values[radius**2 > X**2 + Y**2] = tissue
    values += noise(12)
    if padding is not None:
        values[X**2 + Y**2 > 1] = padding
    return values.astype(np.int16)


# Labels and masks


def test_the_largest_label_is_no_background():
    labels = np.zeros(X.shape, np.uint8)
    labels[X**2 + Y**2 + Z**2 < 0.9] = 3
    labels[(X - 0.3) ** 2 + Y**2 + Z**2 < 0.1] = 7
    labels[(X + 0.3) ** 2 + Y**2 + Z**2 < 0.1] = 8
    assert np.mean(labels == 3) > np.mean(labels == 0) * 0.5
    kind, tf = first(labels)
    assert kind == "labels" and tf.extinction(0) == 0
    assert np.all(tf.extinction([3, 7, 8]) > 0)
    # What encloses others is a veil, and each has its own colour.
    assert tf.extinction(3) * 4 < tf.extinction(7)
    assert len({tuple(color) for color in tf.color([3, 7, 8])}) == 3


@pytest.mark.parametrize("full", [0.1, 0.6, 0.95])
def test_a_mask_is_never_inverted(full):
    mask = np.maximum(np.abs(X), np.maximum(np.abs(Y), np.abs(Z))) <= 0.95 * full ** (1 / 3)
    for values in (mask.astype(np.uint8), mask.astype(np.int16) * 1000):
        kind, tf = first(values)
        inside = values.max()
        assert kind == "labels" and tf.extinction(0) == 0 and tf.extinction(inside) > 0


def test_a_mask_that_touches_every_face_shows_its_inside():
    mask = np.ones(X.shape, np.uint8)
    mask[BALL] = 0
    # Most of the rim is 1: what is there is the background, whatever its number.
    _, tf = first(mask)
    assert tf.extinction(1) == 0 and tf.extinction(0) > 0


def test_labels_up_to_hundreds_and_few_values_that_are_none():
    z, y, x = np.indices((40, 40, 40)) // 8
    kind, tf = first((1 + x + 5 * y + 25 * z).astype(np.uint8))
    assert kind == "labels" and np.count_nonzero(tf.extinction(np.arange(1, 126))) >= 124
    # A scan of few levels has slopes and noise.
    levels = np.round((100 * np.exp(-3 * (X**2 + Y**2 + Z**2)) + noise(3)) / 8).clip(0) * 8
    assert first(levels.astype(np.int16))[0] == "object"


# Scans


def test_padding_is_not_air():
    """Nor a shell between the two: what is seen of a padded scan is what is seen of one that is not."""
    values, plain = ct(-3024), ct()
    assert Statistics.of(wvr.Volume(values)).padding == -3024
    s = np.linspace(-3024, -965, 500)
    for name, tf in suggestion(wvr.Volume(values)).functions.items():
        np.testing.assert_array_equal(tf.extinction(s), 0, err_msg=name)
    np.testing.assert_allclose(first(values)[1].knots, first(plain)[1].knots)


def test_zeros_around_an_object_are_its_background_and_no_padding():
    values = np.where(BALL, 200 + noise(5), 0)
    found = Statistics.of(wvr.Volume(values.astype(np.uint8)))
    assert found.padding is None and found.background == 0 and found.kind == "object"


def test_hounsfield_units_are_known_by_air_and_tissue():
    kind, tf = first(ct())
    assert kind == "ct" and tf.extinction(-1000) == 0
    # Bone is solid, what is around it a veil.
    assert tf.extinction(900) > 5 * tf.extinction(50) > 0
    # The same in grey levels is an object, and bone stands out of it, too.
    kind, tf = first(np.clip((ct() + 1000) / 8, 0, 255).astype(np.uint8))
    assert kind == "object" and tf.extinction(0) == 0 and tf.extinction(237) > 2 * tf.extinction(131) > 0


def test_a_cropped_scan_without_air_does_not_vanish():
    """Its commonest value is no background, but what is rare and bright is still to be seen."""
    smooth = 100 + 40 * np.sin(3 * X) * np.cos(2 * Y) + 20 * Z + noise(3)
    smooth[(X**2 + Y**2) < 0.05] = 230
    found = suggestion(wvr.Volume(smooth.clip(0, 255).astype(np.uint8)))
    tf = next(iter(found.functions.values()))
    assert tf.extinction(230) > 0
    seen = np.mean(tf.extinction(smooth) > 0)
    assert 0.05 < seen < 0.8


def test_the_rim_says_what_is_background_and_not_how_common_it_is():
    values = np.where(np.maximum(np.abs(X), np.maximum(np.abs(Y), np.abs(Z))) < 0.9, 120, 20) + noise(4)
    assert np.mean(values > 70) > 0.6
    kind, tf = first(values.astype(np.uint8))
    assert kind == "object" and tf.extinction(20) == 0 and tf.extinction(120) > 0


def test_what_lies_apart_from_the_background_is_all_seen():
    """A gap in the histogram ends the background, whatever part of the samples lies beyond."""
    values = np.where(X**2 + Y**2 < 0.5, 200, 4) + noise(1.5)
    _, tf = first(values.astype(np.uint8))
    assert np.all(tf.extinction([190, 200, 210]) > 0) and tf.extinction(8) < 1e-2


def test_of_murk_what_is_bright_is_solid():
    """Tissue of which most is dim and none ends: with noise veils have no surfaces, without they have."""
    r = np.sqrt(X**2 + Y**2 + Z**2)
    dim = 100 * np.clip(1.2 - r, 0, 1) ** 2
    dim[BALL & (X > 0.2)] += 60
    rician, clear = (np.abs(values + noise(1.5) + 1j * noise(1.5, 1)) for values in (dim, 100.0 * BALL))
    found = suggestion(wvr.Volume(np.round(rician).astype(np.uint16)))
    assert next(iter(found.functions)) == "solid" and found.surfaces
    solid, bands = found.functions["solid"], found.functions["bands"]
    bright = np.quantile(rician[rician > bands.knots[0]], 0.5)
    assert solid.extinction(bands.knots[0]) == 0 and solid.extinction(bright) > 3 * bands.extinction(bright)
    assert np.all(np.diff(solid.opacities) >= 0)
    # Not without noise, or without what is dim.
    for other in (dim, clear):
        assert "solid" not in suggestion(wvr.Volume(np.round(other).astype(np.uint16))).functions


# Simulations


def test_a_field_is_seen_in_four_thin_shells():
    values = (1 + np.exp(-4 * (X**2 + Y**2 + Z**2))).astype(np.float32)
    values[np.hypot(X, Y) > 1] = 0
    kind, tf = first(values)
    assert kind == "field"
    s = np.linspace(tf.knots[0], tf.knots[-1], 2001)
    opaque = tf.extinction(s)
    peaks = np.flatnonzero((opaque[1:-1] > opaque[:-2]) & (opaque[1:-1] >= opaque[2:])) + 1
    # The innermost is solid.
    assert len(peaks) == 4 and np.all(np.diff(opaque[peaks]) > 0) and opaque[-1] == opaque[peaks[-1]]
    assert np.mean(opaque > 0.2 * opaque[peaks[0]]) < 0.6
    for a, b in pairwise(peaks):
        assert opaque[a:b].min() < 0.2 * opaque[a]


@pytest.mark.parametrize("sign", [1, -1])
def test_both_sides_of_a_symmetric_field_are_shown(sign):
    values = sign * (np.sin(5 * X) + np.sin(4 * Y) + np.cos(6 * Z)).astype(np.float32)
    kind, tf = first(values)
    assert kind == "field" and tf.knots[0] < 0 < tf.knots[-1]
    low, high = np.quantile(values, [0.001, 0.999])
    assert tf.extinction(low) > 0 and tf.extinction(high) > 0 and 0.02 < np.mean(tf.extinction(values) > 0) < 0.8


def test_a_field_with_an_outside_has_no_shell_around_it():
    """Between 0, outside, and 1, the usual value, trilinear samples pass through all that is between."""
    values = (1 + np.exp(-8 * (X**2 + Y**2 + Z**2))).astype(np.float32)
    values[np.hypot(X, Y) > 1] = 0
    found = suggestion(wvr.Volume(values))
    tf = next(iter(found.functions.values()))
    np.testing.assert_array_equal(tf.extinction(np.linspace(0, 1, 100)), 0)
    assert found.kind == "field" and tf.extinction(1.9) > 0


def test_noise_has_no_surfaces_and_a_ball_has():
    assert not suggestion(wvr.Volume(noise(1).astype(np.float32))).surfaces
    assert suggestion(wvr.Volume((200 * BALL + noise(4) + 20).astype(np.uint8))).surfaces


@pytest.mark.parametrize("shape", [(1, 8, 9), (1, 1, 9), (2, 2, 2), (40, 3, 3)])
@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_any_shape_and_dtype(shape, dtype):
    rng = np.random.default_rng(3)
    for values in (rng.integers(0, 100, shape), rng.integers(0, 2, shape), rng.integers(0, 3, shape) * 40):
        values.flat[:2] = 0, 1
        image = wvr.render(wvr.Volume(values.astype(dtype)), size=(9, 7), integrator=wvr.Riemann(1.0))
        assert np.all(np.isfinite(image.rgba))


def test_nan_is_neither_background_nor_seen():
    values = np.where(BALL, 200, np.nan).astype(np.float32) + noise(5).astype(np.float32)
    _, tf = first(values, nan="transparent")
    assert np.mean(tf.extinction(values[BALL]) > 0) > 0.02


@pytest.mark.filterwarnings("error")
def test_infinite_samples_and_ranges_of_few_numbers():
    """Infinite samples next to each other have no difference; there are not always 256 numbers in a range."""
    values = np.random.default_rng(6).random((8, 8, 8))
    first(np.where(values < 0.2, np.inf, values), nan="transparent")
    with pytest.raises(ValueError, match="at least two different finite samples"):
        first(np.where(values < 0.5, 0.0, 5e-324))


FILES = sorted(path.stem for path in DATA.glob("*.nrrd") if "curvilinear" not in path.stem)


@pytest.mark.skipif(not FILES, reason="real volumes are not beside the checkout")
@pytest.mark.parametrize("name", FILES)
def test_real_volumes_fill_the_frame_and_are_neither_empty_nor_solid(name):
    image = wvr.render(DATA / f"{name}.nrrd", size=(48, 48), integrator=wvr.Riemann(1.0), lighting=False)
    alpha = image.rgba[..., 3]
    rows, columns = np.nonzero(alpha > 0.05)
    assert max(np.ptp(rows), np.ptp(columns)) > 0.7 * 48
    assert 0.04 < alpha.mean() < 0.8 and alpha.max() > 0.5
    # A little sticks out where a thing is cropped, at most.
    assert np.mean(alpha[[0, -1]]) < 0.2 and np.mean(alpha[:, [0, -1]]) < 0.2


UPWARDS = {"bonsai": (0, 1, 0), "mri_head": (0, -1, 0), "cthead": (0, 0, -1), "tooth": (0, 0, 1), "teapot": (0, -1, 0)}


@pytest.mark.skipif(not FILES, reason="real volumes are not beside the checkout")
@pytest.mark.parametrize("name", UPWARDS)
def test_real_things_stand_upright(name):
    from wvr.defaults import Call

    camera = Call().look(wvr.read(DATA / f"{name}.nrrd"), (64, 64)).camera
    assert camera.basis()[1] @ UPWARDS[name] > 0.9


@pytest.mark.skipif(not FILES, reason="real volumes are not beside the checkout")
@pytest.mark.parametrize(("name", "face"), [("mri_head", (1, 0, 0)), ("cthead", (0, -1, 0))])
def test_real_heads_are_seen_from_the_face(name, face):
    from wvr.defaults import Call

    camera = Call().look(wvr.read(DATA / f"{name}.nrrd"), (64, 64)).camera
    assert -camera.basis()[2] @ face > 0.5
