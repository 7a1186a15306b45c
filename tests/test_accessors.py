"""Doors from other libraries lead to the same pictures."""

import subprocess
import sys
from importlib.metadata import entry_points

import numpy as np
import pytest
import pyvista as pv

import wvr
import wvr.accessors

FAST = {"size": (16, 12), "integrator": wvr.Riemann(1.0)}


@pytest.fixture(scope="module")
def volume():
    return wvr.datasets.load("spheres", 16)


def test_datasets_of_pyvista(volume):
    grid = volume.to_pyvista()
    grid["other"] = np.arange(grid.n_points, dtype=np.float32)
    np.testing.assert_array_equal(grid.wvr.render(scalars="values", **FAST).rgba, wvr.render(volume, **FAST).rgba)
    assert grid.wvr.volume("other").dtype == np.float32
    assert len(list(grid.wvr.orbit(frames=2, scalars="values", **FAST))) == 2


def test_arrays_of_xarray(volume):
    xarray = pytest.importorskip("xarray")
    wvr.accessors.register_xarray()
    array = xarray.DataArray(volume.numpy(), dims=("z", "y", "x"))
    expected = wvr.render(volume, **FAST).rgba
    np.testing.assert_array_equal(array.wvr.render(**FAST).rgba, expected)
    np.testing.assert_array_equal(array.to_dataset(name="a").wvr.render(**FAST).rgba, expected)


@pytest.mark.parametrize(
    "code",
    [
        "import xarray, wvr; array(); import pyvista; grid()",
        "import pyvista, wvr; grid(); plotter(); import xarray, wvr.accessors; array()",
        "import wvr.accessors, xarray, pyvista; array(); grid(); plotter()",
    ],
)
def test_any_order_of_imports_will_do(code):
    """PyVista finds its entry point once: it must not have been used up before PyVista was there."""
    pytest.importorskip("xarray")
    made = """
import sys, numpy
def array(): sys.modules["xarray"].DataArray(numpy.eye(3)[None], dims=("z", "y", "x")).wvr.volume()
def grid(): sys.modules["pyvista"].ImageData(dimensions=(2, 2, 2)).wvr
def plotter(): sys.modules["pyvista"].Plotter.wvr
"""
    done = subprocess.run([sys.executable, "-c", made + code], capture_output=True, text=True)
    assert done.returncode == 0 and "AccessorRegistrationWarning" not in done.stderr, done.stderr


def test_entry_points_lead_somewhere():
    """Those of this checkout, where it is what is installed."""
    accessors, readers = (entry_points(group=f"pyvista.{kind}") for kind in ("accessors", "readers"))
    if "wvr" not in accessors.names:
        pytest.skip("another wvr is installed")
    assert accessors["wvr"].load() is wvr.accessors
    assert readers[".npy"].load() is wvr.accessors.read_for_pyvista


def test_a_file_for_pyvista(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(24.0).reshape(2, 3, 4))
    assert wvr.accessors.read_for_pyvista(str(tmp_path / "a.npy")).dimensions == (4, 3, 2)


def test_what_a_plotter_shows(volume, tmp_path):
    """The same transfer function, camera and size; and a picture like VTK's."""
    plotter = pv.Plotter(off_screen=True, window_size=(60, 48))
    plotter.background_color = "black"
    with pytest.raises(ValueError, match=r"plotter must have one visible volume.*got 0"):
        plotter.wvr.screenshot()
    plotter.add_volume(volume.to_pyvista(), cmap="gray", opacity="sigmoid_5", show_scalar_bar=False)
    plotter.camera_position = "xz"
    theirs = plotter.screenshot(return_img=True)
    image = plotter.wvr.screenshot(tmp_path / "a.png")
    plotter.close()
    assert image.size == (60, 48) and (tmp_path / "a.png").exists()
    tf, unit = image.shown.transfer_function, image.shown.transfer_function.unit_distance
    expected = wvr.TransferFunction.from_colormap("gray", volume.range, "sigmoid_5", "pyvista").for_volume(volume)
    assert unit == pytest.approx(expected.unit_distance)
    s = np.linspace(*volume.range, 99)
    opacity, wanted = (-np.expm1(-function.extinction(s) * unit) for function in (tf, expected))
    np.testing.assert_allclose(opacity, wanted, atol=0.02)
    assert np.abs(image.to_uint8("black").astype(int) - theirs).mean() < 12


def test_a_volume_that_a_plotter_moved_is_where_it_is(volume):
    plotter = pv.Plotter(off_screen=True, window_size=(60, 48))
    actor = plotter.add_volume(volume.to_pyvista(), cmap="gray", show_scalar_bar=False)
    actor.RotateZ(30)
    actor.SetPosition(5, 0, -3)
    plotter.set_scale(zscale=0.5)
    plotter.camera_position = "iso"
    theirs, image = plotter.screenshot(return_img=True), plotter.wvr.screenshot()
    plotter.close()
    covered, ours = theirs[..., 0] != theirs[0, 0, 0], image.rgba[..., 3] > 0.02
    assert (covered != ours).mean() < 0.05 < covered.mean()


def test_what_is_not_in_the_picture_of_a_plotter_is_said(volume):
    plotter = pv.Plotter(off_screen=True, window_size=(16, 12))
    actor = plotter.add_volume(volume.to_pyvista(), blending="maximum", show_scalar_bar=False)
    actor.GetMapper().SetCropping(True)
    plotter.set_background("black", top="blue")
    plotter.add_mesh(pv.Sphere(radius=3), show_scalar_bar=False)
    with pytest.warns(UserWarning, match="the plotter has meshes, cropping, other blending, a gradient behind, which"):
        plotter.wvr.screenshot()
    actor.SetVisibility(False)
    with pytest.raises(ValueError, match="one visible volume"):
        plotter.wvr.screenshot()
    plotter.close()
