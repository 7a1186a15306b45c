"""Whatever holds a volume becomes that volume: every sample where it belongs, nothing guessed in silence."""

import numpy as np
import pytest
import pyvista as pv

import wvr
from wvr.sources import as_volume

xarray = pytest.importorskip("xarray")
SAMPLES = np.arange(2 * 3 * 4, dtype=np.int16).reshape(2, 3, 4)


def at(volume, point):
    """The sample at a world position."""
    index = np.linalg.inv(volume.index_to_world) @ [*point, 1]
    i, j, k = np.rint(index[:3]).astype(int)
    np.testing.assert_allclose(index[:3], [i, j, k], atol=1e-6)
    return volume.numpy()[k, j, i]


# Arrays


@pytest.mark.parametrize("dtype", ["bool", "int64", "uint32", "int32", "uint64", ">i4"])
def test_bool_and_wide_integers_become_the_smallest_dtype_that_holds_all(dtype):
    volume = as_volume(SAMPLES.astype(dtype) if dtype != "bool" else SAMPLES > 5)
    assert volume.dtype == np.uint8
    np.testing.assert_array_equal(volume.numpy(), SAMPLES > 5 if dtype == "bool" else SAMPLES)


def test_integers_that_no_dtype_holds_are_refused():
    with pytest.raises(ValueError, match="fit no accepted dtype exactly"):
        as_volume(np.array([[[0, 2**53 + 1]]]))
    assert as_volume(np.array([[[-1, 2**40]]])).dtype == np.float64


def test_a_volume_is_itself_and_lists_are_arrays():
    volume = wvr.Volume(SAMPLES)
    assert as_volume(volume) is volume
    np.testing.assert_array_equal(as_volume(SAMPLES.tolist()).numpy(), SAMPLES)


def test_leading_axes_of_one_sample_are_left_out():
    assert as_volume(SAMPLES[None, None]).shape == (2, 3, 4)
    with pytest.raises(ValueError, match="array must have three axes"):
        as_volume(np.zeros((2, 3, 4, 5)))


def test_an_array_of_axes_x_y_z():
    """As PyVista wraps it."""
    ours = as_volume(SAMPLES, spacing=(1, 2, 3), axes="xyz")
    theirs = pv.wrap(SAMPLES)
    assert ours.shape[::-1] == theirs.dimensions == SAMPLES.shape
    np.testing.assert_array_equal(ours.numpy().ravel(), theirs.point_data.active_scalars)
    assert at(ours, (1, 2 * 2, 3 * 3)) == SAMPLES[1, 2, 3]
    fast = np.asfortranarray(SAMPLES)
    assert np.shares_memory(wvr.Volume(fast, axes="xyz").numpy(), fast)
    with pytest.raises(ValueError, match="axes must be one of 'zyx', 'xyz', got 'yx'"):
        wvr.Volume(SAMPLES, axes="yx")


@pytest.mark.parametrize("array", [np.zeros((9, 9, 4)), np.asfortranarray(np.zeros((4, 9, 8)))])
def test_what_looks_like_x_y_z_is_said(array):
    with pytest.warns(UserWarning, match=r"taken as \[z, y, x\].*axes=\"xyz\"") as caught:
        as_volume(array)
    assert caught[0].filename == __file__


def test_nothing_is_said_of_ordinary_arrays(recwarn):
    for shape in ((4, 9, 9), (9, 9, 9), (3, 4, 5), (9, 8, 3)):
        as_volume(np.zeros(shape))
    as_volume(np.zeros((9, 9, 4)), axes="xyz")
    assert not recwarn


def test_nothing_is_said_where_axes_are_given(recwarn):
    wvr.as_volume(np.asfortranarray(np.zeros((4, 4, 3))), axes="zyx")
    assert not recwarn


def test_masked_samples_are_transparent():
    masked = np.ma.masked_equal(SAMPLES, 5)
    volume = as_volume(masked)
    assert volume.nan == "transparent" and np.isnan(volume.numpy()[0, 1, 1])
    np.testing.assert_array_equal(volume.numpy()[~masked.mask], SAMPLES[~masked.mask])
    assert as_volume(np.ma.array(SAMPLES)).dtype == np.int16
    with pytest.raises(TypeError, match=r"1 masked samples: wvr.as_volume"):
        wvr.Volume(masked)
    # Of a list of slices, and of what xarray computes, NumPy knows no mask.
    xr, da = pytest.importorskip("xarray"), pytest.importorskip("dask.array")
    lazy = xr.DataArray(da.from_array(masked.astype(float), chunks=2), dims=("z", "y", "x"))
    for same in (list(masked), lazy):
        np.testing.assert_array_equal(as_volume(same).numpy(), volume.numpy())
    with pytest.raises(TypeError, match=r"masked samples: wvr.as_volume"):
        wvr.Volume(list(masked))


def test_tensors_of_other_libraries():
    for name in ("jax.numpy", "torch"):
        library = pytest.importorskip(name) if name == "jax.numpy" else _module(name)
        if library is None:
            continue
        for values in (SAMPLES, SAMPLES > 5, SAMPLES.astype(np.float32)):
            tensor = library.asarray(values)
            np.testing.assert_array_equal(as_volume(tensor).numpy(), values)
        with pytest.raises(TypeError, match=r"bfloat16.*cast it to float32"):
            as_volume(library.asarray(SAMPLES.astype(np.float32)).astype(library.bfloat16))


def _module(name):
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def test_a_volume_takes_a_tensor_as_the_very_first_call():
    """Of a process: Warp is not initialised yet."""
    import subprocess
    import sys

    pytest.importorskip("jax")
    code = "import jax.numpy as jnp, wvr; print(wvr.Volume(jnp.ones((2, 3, 4))).shape)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "(2, 3, 4)\n", done.stderr


# xarray


def test_coordinates_become_spacing_and_origin_whatever_the_order():
    coords = {"z": [5.0, 7.0], "y": [3.0, 2.0, 1.0], "x": [0.0, 0.5, 1.0, 1.5]}
    array = xarray.DataArray(SAMPLES, dims=("z", "y", "x"), coords=coords)
    for dims in (("z", "y", "x"), ("x", "y", "z"), ("y", "z", "x")):
        volume = as_volume(array.transpose(*dims))
        assert volume.spacing.tolist() == [0.5, 1, 2]
        for point in ((0, 3, 5), (1.5, 1, 7), (0.5, 2, 7)):
            assert at(volume, point) == array.sel(x=point[0], y=point[1], z=point[2])


def test_names_of_geography_are_axes():
    array = xarray.DataArray(SAMPLES, dims=("depth", "lat", "lon")).transpose("lon", "depth", "lat")
    np.testing.assert_array_equal(as_volume(array).numpy(), SAMPLES)
    # Others are taken in their order.
    assert as_volume(xarray.DataArray(SAMPLES, dims=("a", "b", "c"))).shape == SAMPLES.shape


def test_missing_values_are_transparent():
    values = SAMPLES.astype(np.float32)
    values[1, 1, 1] = np.nan
    volume = as_volume(xarray.DataArray(values, dims=("z", "y", "x")))
    assert volume.nan == "transparent" and volume.has_nonfinite


def test_what_xarray_holds_too_much_of():
    array = xarray.DataArray(np.zeros((2, 2, 3, 4)), dims=("time", "z", "y", "x"))
    with pytest.raises(ValueError, match=r"three dimensions.*da.isel\(time=0\)"):
        as_volume(array)
    assert as_volume(array.isel(time=[0])).shape == (2, 3, 4)
    data = xarray.Dataset({"a": array[0], "b": array[1], "c": array[0, 0]})
    with pytest.raises(ValueError, match=r"scalars must name one of .*\['a', 'b'\]"):
        as_volume(data)
    assert as_volume(data, scalars="b").shape == as_volume(data[["a"]]).shape
    uneven = array[0].assign_coords(x=[0, 1, 2, 4])
    with pytest.raises(ValueError, match=r"coordinates 'x' must be equally spaced, got steps from 1 to 2.*interp"):
        as_volume(uneven)


# PyVista


def test_image_data_and_equally_spaced_grids_are_themselves():
    volume = wvr.Volume(SAMPLES, (1, 2, 3), (4, 5, 6))
    grid = volume.to_pyvista()
    for data in (grid, grid.cast_to_rectilinear_grid()):
        made = as_volume(data)
        np.testing.assert_array_equal(made.numpy(), SAMPLES)
        np.testing.assert_allclose(made.index_to_world, volume.index_to_world)


@pytest.mark.parametrize("kind", ["unstructured", "structured", "rectilinear"])
def test_other_grids_are_resampled_and_say_so(kind):
    """A linear field is itself on any grid, and nothing is outside of a grid's cells."""
    x = np.array([0, 1, 3, 4, 6.0])
    grid = pv.RectilinearGrid(x, x, x)
    if kind == "structured":
        grid = grid.cast_to_structured_grid()
        grid.points += 0.1 * grid.points[:, [1, 2, 0]]
    elif kind == "unstructured":
        grid = grid.cast_to_unstructured_grid().extract_cells(np.arange(0, 64, 2))
    grid["s"] = grid.points @ [1.0, 2.0, -1.0]
    grid["other"] = np.zeros(grid.n_points)
    grid.set_active_scalars("other")
    with pytest.warns(UserWarning, match=r"is resampled on \d+ x \d+ x \d+ samples"):
        volume = as_volume(grid, scalars="s")
    # What is its user's stays as it was.
    assert grid.active_scalars_name == "other"
    with pytest.raises(ValueError, match=r"scalars='nothing' is unknown; there are .*'s'"):
        as_volume(grid, scalars="nothing")
    k, j, i = np.indices(volume.shape)
    points = np.stack([i, j, k], -1) @ volume.index_to_world[:3, :3].T + volume.origin
    inside = np.isfinite(volume.numpy())
    np.testing.assert_allclose(volume.numpy()[inside], (points @ [1, 2, -1])[inside], atol=1e-4)
    assert volume.nan == "transparent" and (kind == "rectilinear") == bool(inside.all())


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        (pv.Sphere(), TypeError, "a surface has none"),
        (pv.MultiBlock([pv.Sphere()]), TypeError, "MultiBlock of 1: pass one of them"),
        (object(), TypeError, "data must be a Volume, a path, an array of numbers"),
        ([["a"]], TypeError, "data must be a Volume"),
        ("nowhere.nrrd", FileNotFoundError, "nowhere.nrrd"),
        ("spheers", FileNotFoundError, "did you mean the dataset 'spheres'"),
    ],
)
def test_what_holds_no_volume(data, error, message):
    with pytest.raises(error, match=message):
        as_volume(data)


@pytest.mark.parametrize("option", [{"spacing": (1, 1, 2)}, {"origin": (0, 0, 1)}, {"axes": "xyz"}])
def test_what_says_itself_where_it_is_is_not_told(option):
    with pytest.raises(ValueError, match="is for arrays"):
        as_volume(wvr.Volume(SAMPLES), **option)
    with pytest.raises(ValueError, match="scalars is for datasets"):
        as_volume(SAMPLES, scalars="a")


@pytest.mark.parametrize(
    ("given", "message"),
    [("a.nrrd", "wvr.read reads files"), (pv.ImageData(dimensions=(2, 2, 2)), "wvr.as_volume takes it")],
)
def test_a_volume_says_what_to_call(given, message):
    with pytest.raises(TypeError, match=message):
        wvr.Volume(given)


def test_files_and_datasets_by_name(tmp_path):
    np.save(tmp_path / "a.npy", SAMPLES)
    np.testing.assert_array_equal(as_volume(tmp_path / "a.npy").numpy(), SAMPLES)
    assert as_volume("spheres").shape == (128, 128, 128)


def test_a_file_beside_is_what_was_meant(tmp_path):
    np.save(tmp_path / "bonsai.npy", np.zeros((2, 2, 2)))
    with pytest.raises(FileNotFoundError, match=r"did you mean 'bonsai\.npy'"):
        wvr.as_volume(tmp_path / "bonsia.npy")
