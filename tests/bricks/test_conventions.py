"""What files and stores say that their numbers mean: what is missing, slopes, names of axes and coordinates."""

from __future__ import annotations

import json

import numpy as np
import pytest

import wvr
from wvr.io.conventions import PLAIN, meaning_of

h5py = pytest.importorskip("h5py")
nibabel = pytest.importorskip("nibabel")
xr = pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr")

RNG = np.random.default_rng(5)
SHAPE = (4, 5, 6)


def read_all(volume) -> np.ndarray:
    return volume.samples.read(np.zeros(3, int), np.array(volume.dimensions) - 1)


def netcdf(path, data, dims, coordinates, fillvalue=None, **attributes):
    """As netCDF-4 lays it out: each dimension is a scale, with coordinates or without."""
    with h5py.File(path, "w") as file:
        held = file.create_dataset("a", data=data, fillvalue=fillvalue)
        held.attrs.update(attributes)
        for axis, dim in enumerate(dims):
            there = dim in coordinates
            scale = file.create_dataset(dim, data=coordinates.get(dim, np.zeros(data.shape[axis])))
            scale.make_scale(dim if there else f"This is a netCDF dimension but not a netCDF variable. {axis:9}")
            held.dims[axis].attach_scale(scale)


CASES = [
    ("i2", {"_FillValue": -999, "scale_factor": 0.01, "add_offset": 273.15}),
    ("i4", {"_FillValue": 3, "missing_value": [5, 7]}),
    ("u1", {"_FillValue": 255, "scale_factor": 2.0}),
    ("f4", {"missing_value": -999.9}),
    ("i1", {"_Unsigned": "true", "_FillValue": -1, "scale_factor": 0.5}),
]


@pytest.mark.parametrize(("dtype", "attributes"), CASES)
def test_numbers_mean_what_netcdf_says(tmp_path, dtype, attributes):
    """As xarray has it, of files and of arrays that it did not decode: fills were shown as samples."""
    fills = [*np.ravel(attributes.get("_FillValue", [])), *np.ravel(attributes.get("missing_value", []))]
    data = np.where(RNG.random(SHAPE) < 0.5, RNG.integers(0, 9, SHAPE), RNG.choice(fills, SHAPE)).astype(dtype)
    given = {name: value if isinstance(value, str) else np.asarray(value) for name, value in attributes.items()}
    stored = {"_FillValue": "", "missing_value": ""}
    given = {name: value.astype(dtype) if name in stored else value for name, value in given.items()}
    given = {name: value if isinstance(value, str) else value[()] for name, value in given.items()}
    netcdf(tmp_path / "a.nc", data, "zyx", {}, **given)
    packed = xr.DataArray(data, dims=("z", "y", "x"), attrs=given)
    expected = xr.decode_cf(packed.to_dataset(name="a"))["a"].values
    assert np.isnan(expected).any()
    for volume in (
        wvr.open(tmp_path / "a.nc", nan="transparent", scalars="a"),
        wvr.open(packed, nan="transparent"),
    ):
        np.testing.assert_allclose(read_all(volume), expected, rtol=1e-7)
    np.testing.assert_allclose(wvr.as_volume(packed).numpy(), expected, rtol=1e-7)
    (tmp_path / "a.nc").rename(tmp_path / "a.h5")
    np.testing.assert_allclose(wvr.read(tmp_path / "a.h5", "a", nan="transparent").numpy(), expected, rtol=1e-7)
    with pytest.raises(ValueError, match="missing, NaN"):
        wvr.open(tmp_path / "a.h5", scalars="a").loaded()


def test_what_is_out_of_the_valid_range_or_was_never_written_is_missing():
    data = np.array([-32767, 0, 10, 20, 30], np.int16)
    for attributes, expected in (
        ({"valid_range": np.int16([10, 20])}, [np.nan, np.nan, 10, 20, np.nan]),
        ({"valid_min": np.int16(0), "valid_max": np.int16(20), "scale_factor": 0.5}, [np.nan, 0, 5, 10, np.nan]),
        ({"valid_max": 5.0, "valid_min": 0.0, "scale_factor": 0.5}, [np.nan, 0, 5, np.nan, np.nan]),
        ({}, [np.nan, 0, 10, 20, 30]),
    ):
        meaning = meaning_of(attributes, data.dtype, None if attributes else np.int16(-32767))
        values = meaning.values(data)
        np.testing.assert_array_equal(values, expected)
        assert values.dtype == meaning.dtype(data.dtype) == np.float32
    # Of other files chunks are filled with any number.
    assert meaning_of({}, data.dtype, np.int16(0)).dtype(data.dtype) == np.int16
    signs = meaning_of({"_Unsigned": "true", "valid_range": np.int8([0, -2])}, np.dtype("i1"))
    np.testing.assert_array_equal(signs.values(np.int8([-1, -2, 5])), [np.nan, 254, 5])
    # A fill that no double holds is none of the samples.
    wide = meaning_of({"_FillValue": np.int64(2 - 2**63)}, np.dtype("i8"))
    np.testing.assert_array_equal(wide.values(np.array([2 - 2**63, 7])), [np.nan, 7])


def test_signs_and_limits_are_those_of_the_samples_dtype():
    """What no sample is was wrapped to one that is: 25 of -999, 44 of 300."""
    bytes_ = np.arange(-128, 128).astype(np.int8)
    unsigned = bytes_.view(np.uint8).astype(float)
    for said in ("true", b"TRUE", np.array(["true"], object)):  # texts of netCDF have an array around them
        for more in ({"missing_value": [-999, 300]}, {"valid_range": [0, 300]}):
            np.testing.assert_array_equal(
                meaning_of({"_Unsigned": said, **more}, bytes_.dtype).values(bytes_), unsigned
            )
    # As the guide of netCDF has bytes without a sign.
    plain = meaning_of({"valid_range": np.int16([0, 255]), "_FillValue": np.int8(-1)}, bytes_.dtype)
    np.testing.assert_array_equal(plain.values(bytes_), np.where(unsigned == 255, np.nan, unsigned))
    for attributes in ({"valid_min": 0}, {"valid_range": [-5, 200]}):
        low = max(attributes.get("valid_min", -5), -5)
        expected = np.where(bytes_ < low, np.nan, bytes_)
        np.testing.assert_array_equal(meaning_of(attributes, bytes_.dtype).values(bytes_), expected)
    for name, end in (("valid_min", 1000), ("valid_max", -1)):
        assert np.isnan(meaning_of({name: end}, np.dtype("u1")).values(bytes_.view(np.uint8))).all()
    # Of single precision: 1000 * 0.1 is beyond 100.
    near = meaning_of({"scale_factor": np.float32(0.1), "valid_max": np.float32(100)}, np.dtype("i2"))
    np.testing.assert_allclose(near.values(np.int16([-5, 1000, 1001])), [-0.5, 100, np.nan])


def test_slopes_that_are_none_are_refused(tmp_path):
    """Of each band another was left out, and imaginary parts were by a slope."""
    with pytest.raises(ValueError, match=r"its scale_factor must be a finite number, got \[0.1, 0.2\]"):
        meaning_of({"scale_factor": [0.1, 0.2]}, np.dtype("i2"))
    assert meaning_of({"_FillValue": [[1], [2, 3]], "scale_factor": "none"}, np.dtype("i2")) == PLAIN
    array = zarr.create_array(tmp_path / "a.zarr", shape=SHAPE, chunks=SHAPE, dtype="i2")
    array.attrs["scale_factor"] = [0.1, 0.2]
    with pytest.raises(ValueError, match=r"a\.zarr: its scale_factor must be a finite number"):
        wvr.open(tmp_path / "a.zarr")
    image = nibabel.Nifti1Image(np.ones(SHAPE, np.complex64), np.eye(4))
    image.header.set_slope_inter(2, 0)
    nibabel.save(image, tmp_path / "a.nii")
    with pytest.raises(TypeError, match="has dtype complex64"):
        wvr.open(tmp_path / "a.nii")


def test_axes_of_files_are_those_of_their_names_and_coordinates(tmp_path):
    """They were taken in the order that they are stored in, a step of 1 apart."""
    data = RNG.random(SHAPE).astype(np.float32)  # lon, depth, lat
    coordinates = {"lon": 10 + 0.5 * np.arange(4), "lat": 40 - 0.25 * np.arange(6)}
    packed = xr.DataArray(data, coordinates, ("lon", "depth", "lat"))
    expected = wvr.as_volume(packed)
    netcdf(tmp_path / "a.nc", data, ("lon", "depth", "lat"), coordinates)
    netcdf(tmp_path / "a.h5", data, ("lon", "depth", "lat"), coordinates)
    packed.to_dataset(name="a").to_zarr(tmp_path / "2.zarr", zarr_format=2, consolidated=False)
    packed.to_dataset(name="a").to_zarr(tmp_path / "3.zarr", zarr_format=3, consolidated=False)
    stores = [tmp_path / name for name in ("a.nc", "2.zarr", "3.zarr", "2.zarr/a", "3.zarr/a")]
    volumes = [wvr.open(store, scalars="a" if store.name != "a" else None) for store in stores]
    for volume in [*volumes, wvr.open(zarr.open(tmp_path / "3.zarr", mode="r")["a"])]:
        np.testing.assert_allclose(volume.index_to_world, expected.index_to_world)
        np.testing.assert_array_equal(read_all(volume), expected.numpy())
    read = wvr.read(tmp_path / "a.h5", "a")
    np.testing.assert_allclose(read.index_to_world, expected.index_to_world)
    np.testing.assert_array_equal(read.numpy(), expected.numpy())
    netcdf(tmp_path / "b.nc", data, ("lon", "depth", "lat"), {"depth": np.array([0, 1, 2, 4, 8.0])})
    with pytest.raises(ValueError, match=r"'depth' must be equally spaced.* or give spacing"):
        wvr.open(tmp_path / "b.nc", scalars="a")
    assert wvr.open(tmp_path / "b.nc", scalars="a", spacing=(1, 2, 3)).spacing.tolist() == [1, 2, 3]


def test_coordinates_are_what_they_are_of(tmp_path):
    """Kilometres were metres, and what single precision rounds uneven."""
    data = RNG.random(SHAPE).astype(np.float32)
    lon = (179.9 + 1e-3 * np.arange(6)).astype(np.float32)
    assert np.ptp(np.diff(lon)) > 1e-5
    places = {"z": np.arange(4) / 4, "y": 40.0 - np.arange(5), "x": lon}
    netcdf(tmp_path / "a.nc", data, "zyx", places)
    with h5py.File(tmp_path / "a.nc", "a") as file:
        for name, unit in {"z": "km", "y": "m", "x": np.array(["metres"], object)}.items():
            file[name].attrs["units"] = unit
        del file["z"].attrs["NAME"]
        file["z"].attrs["NAME"] = "z"  # a text of any length, as of other libraries
    array = xr.DataArray(data, places, tuple("zyx"))
    for name, unit in {"z": "km", "y": "m", "x": "metres"}.items():
        array[name].attrs["units"] = unit
    array.to_dataset(name="a").to_zarr(tmp_path / "a.zarr", consolidated=False)
    (tmp_path / "b.h5").write_bytes((tmp_path / "a.nc").read_bytes())
    stores = [wvr.open(tmp_path / "a.nc", scalars="a"), wvr.open(tmp_path / "a.zarr"), wvr.open(array)]
    for volume in [*stores, wvr.read(tmp_path / "b.h5", "a"), wvr.as_volume(array)]:
        np.testing.assert_allclose(volume.spacing, [1e-3, 1, 250], rtol=1e-2)
        np.testing.assert_allclose(volume.origin, [lon[0], 40, 0])


def test_coordinates_of_another_length_are_none_or_missing(tmp_path):
    data = RNG.random(SHAPE).astype(np.float32)
    for count, there in ((6, True), (3, False), (0, False)):
        with h5py.File(tmp_path / f"{count}.h5", "w") as file:
            file["a"] = data
            if count:
                file["z"] = 7 - 2.0 * np.arange(count)  # longer, as of an axis without end
            else:
                file.create_dataset("z", (4,), "f4", chunks=(2,))  # and never written
            file["z"].make_scale("z")
            file["a"].dims[0].attach_scale(file["z"])
        if there:
            assert wvr.read(tmp_path / f"{count}.h5", "a").index_to_world[2].tolist() == [0, 0, -2, 7]
        else:
            with pytest.raises(
                ValueError, match=f"coordinates 'z' must be equally spaced, {4 - count} of 4 are missing"
            ):
                wvr.read(tmp_path / f"{count}.h5", "a")
            # Which way they go is known.
            volume = wvr.open(tmp_path / f"{count}.h5", scalars="a", spacing=(1, 1, 3))
            assert volume.index_to_world[2].tolist() == [0, 0, 3, 0]
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=3)
    group.create_array("a", shape=SHAPE, chunks=SHAPE, dtype="u1", dimension_names=["z", "y", "x"])[:] = 1
    for name, count in {"z": 7, "y": 5}.items():
        group.create_array(name, shape=(count,), chunks=(count,), dtype="f4")[:] = 10 - 2 * np.arange(count) ** 2
    with pytest.raises(ValueError, match="coordinates 'y' must be equally spaced, got steps from -14 to -2"):
        wvr.open(tmp_path / "a.zarr")
    group["y"][:] = 10 - 2 * np.arange(5)
    assert wvr.open(tmp_path / "a.zarr").index_to_world[:, [1, 2, 3]].tolist() == [
        [0, 0, 0],
        [-2, 0, 10],
        [0, 1, 0],
        [0, 0, 1],
    ]
    group["y"][:] = [10, 9, 7, 6, 0]
    volume = wvr.open(tmp_path / "a.zarr", spacing=(1, 2, 3))
    assert volume.index_to_world[:, [1, 2, 3]].tolist() == [[0, 0, 0], [-2, 0, 10], [0, 3, 0], [0, 0, 1]]


def test_axes_of_hdf5_are_those_that_ilastik_and_labels_say(tmp_path):
    """Spacing was of the axes as they are stored, wherever they went."""
    data = RNG.random((4, 5, 6)).astype(np.float32)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["labels"], file["tags"] = data, data[..., None]
        for n, name in enumerate("xzy"):
            file["labels"].dims[n].label = name
        file["tags"].attrs["axistags"] = json.dumps({"axes": [{"key": name} for name in "xzyc"]})
        file["labels"].attrs["element_size_um"] = file["tags"].attrs["element_size_um"] = [3.0, 2.0, 1.0]
    for name in ("labels", "tags"):
        for volume in (wvr.open(tmp_path / "a.h5", scalars=name), wvr.read(tmp_path / "a.h5", name)):
            assert volume.spacing.tolist() == [3, 1, 2]
            there = read_all(volume) if hasattr(volume, "samples") else volume.numpy()
            np.testing.assert_array_equal(there, data.transpose(1, 2, 0))


@pytest.mark.parametrize("version", [2, 3])
def test_zarr_of_xarray_means_what_xarray_says(tmp_path, version):
    data = RNG.integers(0, 9, SHAPE).astype(np.float64)
    data[RNG.random(SHAPE) < 0.3] = np.nan
    for name, encoding in {
        "packed": {"dtype": "i2", "scale_factor": 0.5, "_FillValue": -99},
        "floats": {"dtype": "f4", "_FillValue": -999.9},
    }.items():
        path = tmp_path / name
        array = xr.DataArray(data, dims=("z", "y", "x"))
        array.to_dataset(name="a").to_zarr(path, encoding={"a": encoding}, zarr_format=version, consolidated=False)
        np.testing.assert_allclose(read_all(wvr.open(path, nan="transparent")), data)
    # Elsewhere what chunks are filled with is a sample like any other.
    array = zarr.create_array(tmp_path / "b", shape=SHAPE, chunks=SHAPE, dtype="u1", fill_value=0, zarr_format=version)
    array[:] = 0
    assert wvr.open(tmp_path / "b").dtype == np.uint8


def test_images_have_no_samples_missing_but_as_they_say(tmp_path):
    """Those of 0 were, where 0 fills chunks and xarray's names of axes are written beside."""
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    group.create_array("0", shape=SHAPE, chunks=SHAPE, dtype="u1", fill_value=0)[:] = 1
    group["0"].attrs["_ARRAY_DIMENSIONS"] = list("zyx")
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    level = {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [3.0, 2.0, 1.0]}]}
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": [level]}]
    assert wvr.open(tmp_path / "a.zarr").dtype == np.uint8
    level["coordinateTransformations"][0]["scale"] = [3.0]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": [level]}]
    with pytest.raises(ValueError, match=r"has 3 axes and the scale \[3.0\]"):
        wvr.open(tmp_path / "a.zarr")


def test_arrays_of_libraries_mean_what_their_attributes_say(tmp_path):
    """Of arrays that are not opened but passed; of xarray signs and packed coordinates were left as they are."""
    data = RNG.integers(-9, 9, SHAPE).astype(np.int8)
    attributes = {"scale_factor": 0.5, "_FillValue": -9}
    expected = np.where(data == -9, np.nan, data * 0.5)
    array = zarr.create_array(tmp_path / "a.zarr", shape=SHAPE, chunks=SHAPE, dtype="i1")
    array[:] = data
    array.attrs.update(attributes)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = data
        file["a"].attrs.update(attributes)
        np.testing.assert_array_equal(wvr.as_volume(file["a"], nan="transparent").numpy(), expected)
    np.testing.assert_array_equal(wvr.as_volume(array, nan="transparent").numpy(), expected)
    with pytest.raises(ValueError, match="NaN or infinite samples"):
        wvr.as_volume(array)  # as of files
    places = xr.DataArray(np.int16([0, 1, 2, 3]), dims="samples", attrs={"scale_factor": 0.25})
    placed = xr.DataArray(data, {"samples": places}, ("samples", "y", "x"))
    signs = xr.DataArray(data, dims=("z", "y", "x"), attrs={"_Unsigned": "true"})
    for array, expected, step in ((placed, data, 0.25), (signs, data.view(np.uint8), 1.0)):
        for volume in (wvr.as_volume(array), wvr.open(array)):
            there = read_all(volume) if hasattr(volume, "samples") else volume.numpy()
            np.testing.assert_array_equal(there, expected)
            assert volume.spacing.tolist() == [1, 1, step]


def test_netcdf_3_is_said_to_be(tmp_path):
    (tmp_path / "a.nc").write_bytes(b"CDF\x01" + bytes(40))
    with pytest.raises(ValueError, match="it is netCDF 3"):
        wvr.open(tmp_path / "a.nc")


@pytest.mark.parametrize(
    ("slope", "intercept"),
    [(3.0, 2.0**24), (2.0**20 + 1, 0.0), (0.5, 1e8), (0.5, 10.0), (2.0, -1024.0), (2.0**60, 1.0)],
)
def test_slopes_leave_samples_apart(tmp_path, slope, intercept):
    """Beyond 2**24 single precision has none of the steps between samples."""
    data = np.arange(-60, 60, dtype=np.int16).reshape(SHAPE)
    image = nibabel.Nifti1Image(data.T, np.eye(4))
    image.header.set_slope_inter(slope, intercept)
    nibabel.save(image, tmp_path / "a.nii")
    exact = data * np.float64(slope) + np.float64(intercept)
    for values in (read_all(wvr.open(tmp_path / "a.nii")), wvr.read(tmp_path / "a.nii").numpy()):
        np.testing.assert_allclose(values, exact, rtol=0, atol=abs(slope) / 128 if slope == 0.5 else 0)
    if slope == 3.0:
        data = np.array([[[2**31 - 1]]], np.int32)
        image = nibabel.Nifti1Image(data, np.eye(4))
        image.header.set_slope_inter(3, 2.0**60)
        nibabel.save(image, tmp_path / "b.nii")
        with pytest.raises(OSError, match="beyond 2\\*\\*53, which float64 does not hold"):
            wvr.open(tmp_path / "b.nii").loaded()
        with pytest.raises(ValueError, match="beyond 2\\*\\*53, which float64 does not hold"):
            wvr.read(tmp_path / "b.nii")


@pytest.mark.parametrize("kind", ["affine", "path"])
def test_what_a_transformation_is_may_be_said_instead(tmp_path, kind):
    """The advice was to give what did not help."""
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    for n in range(2):
        group.create_array(str(n), shape=SHAPE, chunks=SHAPE, dtype="u1")[:] = n
    known = {"type": "scale", "scale": [2.0, 1.0, 1.0]}
    other = {"type": "affine", "affine": [[1, 0, 0, 0]]} if kind == "affine" else {"type": "scale", "path": "there"}
    levels = [{"path": str(n), "coordinateTransformations": [known, other][n:]} for n in range(2)]
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    with pytest.raises(ValueError, match=r"transformation of type .* give spacing"):
        wvr.open(tmp_path / "a.zarr")
    volume = wvr.open(tmp_path / "a.zarr", spacing=(1, 2, 3), origin=(4, 5, 6))
    assert volume.spacing.tolist() == [1, 2, 3] and volume.origin.tolist() == [4, 5, 6] and volume.preview is None
