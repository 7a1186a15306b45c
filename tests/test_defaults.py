"""What is left out suits the data, and shorthands mean what they say."""

import numpy as np
import pytest
import pyvista as pv

import wvr
from wvr.defaults import Call, camera_of, function_of, lighting_of, recolored, studio
from wvr.presets import preset, suggest

from .extending.point_light import PointLight

FAST = {"size": (16, 12), "integrator": wvr.Riemann(1.0)}


@pytest.fixture(scope="module")
def volume():
    return wvr.datasets.load("spheres", 16)


def test_one_line_is_the_whole_of_it(volume):
    """What is suggested, seen from a view that suits, lit, in front of black: the same as in full."""
    image = wvr.render(volume, size=(20, 16))
    tf = next(iter(suggest(volume).values()))
    camera = camera_of(None, volume, tf, 20 / 16)
    full = wvr.render(volume, tf, camera, (20, 16), lighting=studio(camera), background="black")
    np.testing.assert_array_equal(image.rgba, full.rgba)
    assert image.background == "black" and image.error_bound is not None
    again = wvr.render(volume.numpy(), size=(20, 16))
    np.testing.assert_array_equal(image.rgba, again.rgba)


def test_what_is_given_in_full_is_left_alone(volume):
    tf, camera = wvr.TransferFunction([(0, "red", 0.0), (200, "white", 0.5)]), wvr.Camera.fit(volume)
    look = Call(tf, camera).look(volume, (8, 8))
    assert look == (tf, camera, None, None, None, None, tf)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([(0, "red", 0.0), (200, "white", 0.5)], lambda v: wvr.TransferFunction([(0, "red", 0), (200, "white", 0.5)])),
        ("warm", lambda v: suggest(v)["warm"]),
        ("mri", lambda v: preset("mri", v.range)),
        ("ct-bone", lambda v: preset("ct-bone")),
        ("viridis", lambda v: recolored(suggest(v)["bands"], "viridis", v.range)),
        (["black", "red"], lambda v: recolored(suggest(v)["bands"], ["black", "red"], v.range)),
        ([(0, 0, 0), (1, 0, 0)], lambda v: recolored(suggest(v)["bands"], [(0, 0, 0), (1, 0, 0)], v.range)),
    ],
)
def test_transfer_functions_in_other_words(volume, given, expected):
    assert function_of(given, volume)[0] == expected(volume)


def test_a_file_of_a_transfer_function(volume, tmp_path):
    tf = wvr.TransferFunction([(0, "red", 0.0), (200, "white", 0.5)])
    tf.save(tmp_path / "a.json")
    assert function_of(str(tmp_path / "a.json"), volume) == (tf, None)


def test_colour_maps_with_opacity_are_as_in_pyvista(volume):
    image = wvr.render(volume, "viridis", opacity="sigmoid_5", clim=(20, 200), **FAST)
    tf = wvr.TransferFunction.from_colormap("viridis", (20, 200), "sigmoid_5", "pyvista")
    same = wvr.render(volume, tf, image.shown.camera, **FAST)
    np.testing.assert_array_equal(image.rgba, same.rgba)
    assert image.background is None
    # Without limits it spans all, and without a map it is viridis.
    tf, _ = function_of(None, volume, "linear")
    assert (tf.knots[0], tf.knots[-1]) == volume.range and tf.unit_distance == "pyvista"


def test_recolored_has_the_extinction_of_before():
    tf = wvr.TransferFunction([(10, "red", 0.0), (20, "red", 0.3), (20, "blue", 0.8), (90, "blue", 0.1)])
    new = recolored(tf, "viridis", (0, 100))
    s = np.linspace(0, 100, 777)
    np.testing.assert_allclose(new.extinction(s), tf.extinction(s), rtol=1e-9, atol=1e-12)
    plain = wvr.TransferFunction.from_colormap("viridis", (0, 100), 0.5)
    inside = (s >= 10) & (s <= 90)
    np.testing.assert_allclose(new.color(s[inside]), plain.color(s[inside]), atol=2e-3)


def test_recolored_keeps_unit_and_coefficients():
    given = {"ambient": [0.1, 0.5], "specular": [0.0, 1.0]}
    tf = wvr.TransferFunction.from_arrays([0, 100], [[1, 0, 0]] * 2, [0.75, 0.75], 2.0, **given)
    new = recolored(tf, "viridis", (0, 100))
    np.testing.assert_allclose(new.opacities, 0.75)
    np.testing.assert_allclose(new.ambient, 0.1 + 0.4 * new.knots / 100, atol=1e-12)
    np.testing.assert_allclose(new.specular, new.knots / 100, atol=1e-12)
    assert new.diffuse is None and new.unit_distance == 2.0


def test_limits_of_one_number(volume):
    assert function_of("viridis", volume, "linear", np.float32(5))[0].knots[[0, -1]].tolist() == [-5, 5]
    for wrong in (0, -5, True, np.nan):
        with pytest.raises((ValueError, TypeError), match="clim must be"):
            function_of("viridis", volume, "linear", wrong)


def test_names_of_colours_are_no_points(volume):
    tf, _ = function_of(["red", "tan"], volume, "linear")
    np.testing.assert_allclose(tf.colors[0], (1, 0, 0), atol=1e-6)


def test_labels_with_functions_have_no_limits(volume):
    tf = wvr.TransferFunction([(0, "red", 0.3), (255, "red", 0.3)])
    segmentation = wvr.Segmentation(np.ones(volume.shape, np.uint8), {1: tf})
    for name, value in (("clim", (0, 5)), ("opacity", "linear")):
        with pytest.raises(
            ValueError, match=f"{name} is for colour maps.*, labels have transfer functions of their own"
        ):
            wvr.render(volume, segmentation=segmentation, **FAST, **{name: value})


def test_lighting_in_other_words(volume):
    camera = wvr.Camera.fit(volume)
    light = wvr.Lighting("center")
    assert lighting_of(light, False, camera) is light
    assert lighting_of("center", False, camera) == light
    assert lighting_of(True, False, camera) == lighting_of(None, True, camera) == studio(camera)
    assert lighting_of(False, True, camera) is lighting_of(None, False, camera) is None
    # From the upper left, towards the scene.
    right, up, forward = camera.basis()
    towards = np.array(studio(camera).lights[0].vector)
    assert towards @ up > 0.3 and towards @ right < -0.2 and towards @ forward < -0.5


def test_shadows_in_other_words(volume):
    camera = wvr.Camera.fit(volume)
    look = Call(camera=camera, shadows=True).look(volume, (8, 8))
    assert look.shadows == wvr.ConvolutionShadows(light=studio(camera).lights[0]) and look.lighting == studio(camera)
    sun = wvr.DirectionalLight((0, 0, 1))
    look = Call(camera=camera, lighting=wvr.Lighting(light=sun), shadows=True).look(volume, (8, 8))
    assert look.shadows == wvr.ConvolutionShadows(light=sun)
    assert Call(camera=camera, shadows=False).look(volume, (8, 8)).shadows is None
    # Light of a place does not go from slice to slice, and there may be none.
    for lights in ((PointLight((0, 0, 9)), sun), ()):
        look = Call(camera=camera, lighting=wvr.Lighting(light=lights), shadows=np.True_).look(volume, (8, 8))
        assert look.shadows.lights == ((sun,) if lights else studio(camera).lights[:1])


def test_a_picture_of_nothing_is_warned_of():
    faint = wvr.Volume(np.linspace(0, 1, 8**3).reshape(8, 8, 8))
    message = r"^nothing is visible.* from 0 to 1, .* opacity from 150 to inf; give it"
    with pytest.warns(UserWarning, match=message) as caught:
        wvr.render(faint, "ct-bone", **FAST)
    assert [one.filename for one in caught] == [__file__]  # once: not of Hounsfield units, too
    wvr.render(faint, "mri", **FAST)  # a relative scale spans the data


def test_presets_in_hounsfield_units_doubt_other_data(volume, recwarn):
    """Once, whether hardly anything is left of the preset, of which the image is warned, or more."""
    many = wvr.Volume(np.linspace(0, 900, 27).reshape(3, 3, 3))
    with pytest.warns(UserWarning, match=r"'ct-bone' is in Hounsfield units.*samples are from 0 to 900"):
        function_of("ct-bone", many)
    with pytest.warns(UserWarning, match=r"a small part of the transfer function's.*Hounsfield units") as caught:
        wvr.render(volume, "ct-bone", **FAST)
    assert len(caught) == 1
    recwarn.clear()
    function_of("ct-bone", volume, clim=(0, 255))
    function_of("ct-bone", wvr.Volume(np.linspace(-1000, 1000, 27).reshape(3, 3, 3)))
    assert not recwarn


@pytest.mark.parametrize("scale", [1e-315, 1e300])
@pytest.mark.filterwarnings("error")
def test_magnitudes_change_neither_colours_nor_light(scale):
    samples = wvr.datasets.load("blobs", 24).numpy().astype(np.float64)
    volumes = wvr.Volume(samples), wvr.Volume(samples * scale)
    ours, theirs = (function_of("viridis", volume)[0] for volume in volumes)
    assert np.allclose(theirs.colors, ours.colors, atol=1e-6) and np.allclose(theirs.knots / scale, ours.knots, 1e-6)
    plain, scaled = (wvr.render(volume, "viridis", size=(16, 16)).rgba for volume in volumes)
    assert np.abs(scaled - plain).max() < 4e-3


def test_samples_whose_differences_overflow_are_refused():
    samples = 1.7e308 * np.linspace(-1, 1, 27).reshape(3, 3, 3)
    for given in (None, "viridis"):
        with pytest.raises(ValueError, match="volume must have samples of sizes up to 1e\\+304"):
            wvr.render(samples, given, size=(8, 8))


def test_fields_without_samples_need_a_transfer_function(monkeypatch):
    from .extending.marschner_lobb import MarschnerLobb

    with pytest.raises(TypeError, match="transfer_function must be given: a MarschnerLobb has no samples"):
        wvr.render(MarschnerLobb())


def test_labels_need_neither_a_transfer_function_nor_a_camera(volume):
    labels = (volume.numpy() > 100).astype(np.uint8)
    tf = wvr.TransferFunction([(0, "red", 0.3), (255, "red", 0.3)])
    image = wvr.render(volume, segmentation=wvr.Segmentation(labels, {1: tf}), **FAST)
    assert image.rgba[..., 3].max() > 0.1
    unit = wvr.TransferFunction([(0, "red", 0.3), (255, "red", 0.3)], unit_distance="pyvista")
    other = wvr.render(volume, segmentation=wvr.Segmentation(labels, {1: unit}), **FAST)
    assert 0.1 < other.rgba[..., 3].max() < image.rgba[..., 3].max()


def test_opacity_is_that_of_vtk(volume):
    """To the error of its own mapper: in white on black, what is seen is opacity."""
    plotter = pv.Plotter(off_screen=True, window_size=(64, 64))
    plotter.background_color = "black"
    white = pv.LookupTable(values=np.tile([255, 255, 255, 255], (256, 1)))
    white.apply_opacity("linear")
    white.scalar_range = volume.range
    plotter.add_volume(volume.to_pyvista(), cmap=white, show_scalar_bar=False, shade=False, mapper="fixed_point")
    plotter.camera_position = "iso"
    theirs = plotter.screenshot(return_img=True)[..., 0] / 255
    error = {}
    for unit in ("pyvista", None):
        tf = wvr.TransferFunction.from_colormap(["white", "white"], volume.range, "linear", unit)
        error[unit] = np.abs(wvr.render(volume, tf, plotter, (64, 64)).rgba[..., 3] - theirs).mean()
    plotter.close()
    assert theirs.max() > 0.5 and error["pyvista"] < min(0.02, 0.5 * error[None]), error
