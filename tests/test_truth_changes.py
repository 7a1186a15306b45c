"""Arrays that are written into while a renderer keeps what it made of them: no image is stale, and no bound false."""

import pickle
import weakref

import numpy as np
import pytest
import pyvista as pv
import warp as wp
import xarray as xr

import wvr

SIZE = (12, 12)
TF = wvr.TransferFunction([(0, "red", 0.0), (0.2, "red", 0.0), (1, "white", 0.7)])


class Shared:
    """What PyTorch's tensors look like from outside: DLPack and nothing else."""

    requires_grad = False

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def zeros(dtype="float32", shape=(9, 8, 7)):
    return np.zeros(shape, dtype)


def read_only_view(array):
    view = array[:]
    view.flags.writeable = False
    return view


def through_memory():
    memory = bytearray(9 * 8 * 7 * 4)
    return np.frombuffer(memory, np.float32).reshape(9, 8, 7)


def through_warp():
    array = wp.zeros((9, 8, 7), dtype=float, device="cpu")
    return array, array.numpy()


# (what the volume is made of, what is written into), which share memory.
SOURCES = {
    "array": lambda: (a := zeros(), a),
    "uint8": lambda: (a := zeros("uint8"), a),
    "float64": lambda: (a := zeros("float64"), a),
    "one sample thick": lambda: (a := zeros(shape=(1, 8, 7)), a),
    "part of a larger one": lambda: ((a := zeros(shape=(20, 8, 7)))[5:14], a[5:14]),
    "view": lambda: ((a := zeros()).view(), a),
    "read-only view": lambda: (read_only_view(a := zeros()), a),
    "view of a read-only view": lambda: (read_only_view(a := zeros())[:], a),
    "bytes": lambda: (a := through_memory(), a),
    "read-only bytes": lambda: (read_only_view(a := through_memory()), a),
    "Warp": through_warp,
    "DLPack": lambda: (Shared(a := zeros()), a),
}


def assert_true(renderer, camera):
    """That the kept renderer shows the samples as they are, within its bound; returns the largest opacity."""
    volume = wvr.Volume(renderer.volume.numpy().copy(), nan=renderer.volume.nan)
    exact = wvr.render(
        volume,
        renderer.transfer_function,
        camera,
        SIZE,
        integrator=wvr.Exact(),
        clip=renderer.clip,
        segmentation=renderer.segmentation,
    )
    image = renderer.render(camera, SIZE)
    error = np.abs(image.rgba - exact.rgba).max(-1)
    if image.error_bound is None:
        assert error.max() < 1e-13
    else:
        assert np.all(error <= image.error_bound)
    return exact.rgba[..., 3].max()


@pytest.mark.parametrize("said", [False, True])
@pytest.mark.parametrize("name", SOURCES)
def test_samples_written_under_a_kept_renderer(name, said):
    source, target = SOURCES[name]()
    volume = wvr.Volume(source)
    camera = wvr.Camera.fit(volume)
    for integrator in (wvr.Certified(1e-3), wvr.Exact()):
        target[...] = 0
        renderer = wvr.Renderer(volume, TF, integrator=integrator)
        assert assert_true(renderer, camera) == 0
        for value in (1, 0, 1):
            target[:, 2:6, 2:6] = value
            if said:
                volume.changed()
            assert (assert_true(renderer, camera) > 0.9) == value


def test_samples_written_before_the_first_frame():
    samples = zeros()
    volume = wvr.Volume(samples)
    assert volume.range == (0, 0)
    samples[2:6, 2:6, 2:6] = 1
    assert assert_true(wvr.Renderer(volume, TF), wvr.Camera.fit(volume)) > 0.9
    assert volume.range == (0, 1)


def cells():
    """Of PyVista, with integers that no volume keeps."""
    grid = pv.ImageData(dimensions=(7, 8, 9))
    grid["values"] = np.zeros(grid.n_points, np.int64)
    return grid, grid["values"].reshape(9, 8, 7)


# (what makes a volume, that of which its samples are a copy, what is written into).
COPIES = {
    "Fortran order": lambda: (wvr.Volume, a := np.asfortranarray(zeros()), a),
    "big-endian": lambda: (wvr.Volume, a := zeros().astype(">f4"), a),
    "backwards": lambda: (wvr.Volume, (a := zeros())[::1, ::-1], a),
    "strided": lambda: (wvr.Volume, (a := zeros(shape=(18, 8, 14)))[::2, :, 1::2], a),
    "Warp": lambda: (wvr.Volume, (a := wp.zeros((9, 8, 14), dtype=float, device="cpu"))[:, :, ::2], a.numpy()),
    "x, y, z": lambda: (lambda a: wvr.Volume(a, axes="xyz"), a := zeros(), a),
    "int64": lambda: (wvr.as_volume, a := zeros("int64"), a),
    "bool": lambda: (wvr.as_volume, a := zeros("bool"), a),
    "uint32, strided, a time": lambda: (wvr.as_volume, (a := zeros("uint32", (2, 9, 8, 7)))[1:, ::1, :, ::-1], a),
    "masked": lambda: (wvr.as_volume, a := np.ma.masked_equal(zeros(), 5).copy(), a),
    "xarray": lambda: (wvr.as_volume, a := xr.DataArray(zeros("int64"), dims=("y", "x", "z")), a.values),
    "PyVista": lambda: (wvr.as_volume, *cells()),
}


@pytest.mark.parametrize("said", [False, True])
@pytest.mark.parametrize("name", COPIES)
def test_samples_written_into_what_was_copied(name, said):
    make, source, target = COPIES[name]()
    if name == "masked":
        source[0, 0, 0] = np.ma.masked
    volume = make(source)
    if name == "strided":
        del source  # a view of what is there
    renderer, camera = wvr.Renderer(volume, TF), wvr.Camera.fit(volume)
    assert assert_true(renderer, camera) == 0
    for value in (1, 0, 1):
        target[...] = value
        if said:
            volume.changed()
            assert volume.range == (value, value)
        assert (renderer.render(camera, SIZE).rgba[..., 3].max() > 0.9) == value
        np.testing.assert_array_equal(volume.numpy(), value)
        assert_true(renderer, camera)


def test_integers_that_need_another_dtype_now():
    samples = zeros("int64")
    volume = wvr.as_volume(samples)
    renderer, camera = wvr.Renderer(volume, TF, integrator=wvr.Exact()), wvr.Camera.fit(volume)
    assert assert_true(renderer, camera) == 0
    samples[...] = 1
    samples[0] = 1000
    renderer.render(camera, SIZE)
    assert assert_true(renderer, camera) > 0.9
    assert (volume.dtype, volume.range) == (np.uint16, (1, 1000))


def test_what_is_written_into_the_copy_stays():
    samples = np.asfortranarray(zeros())
    volume = wvr.Volume(samples)
    volume.numpy()[...] = 1
    volume.changed()
    assert volume.range == (1, 1)
    samples[...] = 2  # this is newer
    volume.changed()
    assert volume.range == (2, 2) and volume.numpy().flags.c_contiguous


@pytest.mark.parametrize("make", [lambda: zeros("int64"), lambda: zeros().tolist()])
def test_a_copy_of_what_is_gone_says_so(make):
    volume = wvr.as_volume(make())
    with pytest.warns(UserWarning, match="the samples were copied from what is no longer there"):
        volume.changed()
    volume.numpy()[...] = 1
    volume.changed()
    assert volume.range == (1, 1)


def test_an_array_that_was_copied_is_not_kept():
    samples = np.asfortranarray(zeros())
    volume, there = wvr.Volume(samples), weakref.ref(samples)
    del samples
    assert there() is None and pickle.loads(pickle.dumps(volume)).range == volume.range == (0, 0)


def test_read_only_samples_that_were_written_all_the_same():
    samples = zeros()
    samples.flags.writeable = False
    volume = wvr.Volume(samples)
    renderer, camera = wvr.Renderer(volume, TF), wvr.Camera.fit(volume)
    assert assert_true(renderer, camera) == 0
    samples.flags.writeable = True
    samples[2:6, 2:6, 2:6] = 1
    samples.flags.writeable = False
    volume.changed()
    assert assert_true(renderer, camera) > 0.9


@pytest.mark.parametrize("dtype, row", [("float64", 4093), ("uint8", 8 * 4093)])
def test_samples_that_change_places(dtype, row):
    samples = zeros(dtype, (2, 3, row))
    samples[0, 0, : row // 2] = 1
    volume = wvr.Volume(samples, spacing=(8 / row, 1, 1))
    camera = wvr.Camera.fit(volume)
    renderer = wvr.Renderer(volume, TF, integrator=wvr.Exact())
    image = renderer.render(camera, SIZE)
    samples[0] = samples[0, ::-1].copy()
    exact = wvr.render(volume, TF, camera, SIZE, integrator=wvr.Exact())
    assert np.abs(exact.rgba - image.rgba).max() > 0.01
    assert np.array_equal(renderer.render(camera, SIZE).rgba, exact.rgba)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_nan_written_in(number):
    samples = zeros() + 1
    volume = wvr.Volume(samples)
    renderer, camera = wvr.Renderer(volume, TF), wvr.Camera.fit(volume)
    assert assert_true(renderer, camera) > 0.9
    samples[4, 4, 4] = number
    for _ in range(2):
        with pytest.raises(ValueError, match="array has 1 NaN or infinite"):
            renderer.render(camera, SIZE)
    with pytest.raises(ValueError, match="array has 1 NaN or infinite"):
        volume.changed()
    samples[4, 4, 4] = 0
    assert assert_true(renderer, camera) > 0.9


def test_nan_written_in_where_it_is_transparent():
    samples = zeros() + 1
    volume = wvr.Volume(samples, nan="transparent")
    camera = wvr.Camera.fit(volume)
    for integrator in (wvr.Certified(1e-3), wvr.Exact()):
        samples[...] = 1
        renderer = wvr.Renderer(volume, TF, integrator=integrator)
        assert assert_true(renderer, camera) > 0.9
        samples[2:7] = np.nan
        assert 0 < assert_true(renderer, camera) < 0.999
        samples[...] = np.nan
        assert assert_true(renderer, camera) == 0
        samples[...] = 1
        assert assert_true(renderer, camera) > 0.9


@pytest.mark.parametrize("integrator", [wvr.Certified(1e-3), wvr.Exact()])
@pytest.mark.parametrize("said", [False, True])
def test_a_clip_volume_written_under_a_kept_renderer(integrator, said):
    volume = wvr.Volume(zeros("uint8") + 1)
    camera = wvr.Camera.fit(volume)
    samples = zeros("uint8")
    region = wvr.Volume(samples)
    renderer = wvr.Renderer(volume, TF, integrator=integrator, clip=wvr.ClipVolume(region, iso=0.5))
    for value in (0, 1, 0):
        samples[...] = value
        if said:
            region.changed()
        assert (assert_true(renderer, camera) > 0.9) == value


def test_nan_written_into_a_clip_volume():
    volume = wvr.Volume(zeros("uint8") + 1)
    camera = wvr.Camera.fit(volume)
    for nan in ("error", "transparent"):
        samples = zeros("float64") + 1
        clip = wvr.ClipVolume(wvr.Volume(samples, nan=nan), iso=0.5)
        renderer = wvr.Renderer(volume, TF, clip=clip)
        assert assert_true(renderer, camera) > 0.9
        samples[3] = np.nan
        with pytest.raises(ValueError, match=r"finite|NaN"):
            renderer.render(camera, SIZE)


@pytest.mark.parametrize("integrator", [wvr.Certified(1e-3), wvr.Exact()])
@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_labels_written_under_a_kept_renderer(integrator, wrapped, dtype):
    volume = wvr.Volume(zeros("uint8") + 1)
    camera = wvr.Camera.fit(volume)
    labels = zeros(dtype)
    given = wvr.Volume(labels) if wrapped else labels
    renderer = wvr.Renderer(volume, None, integrator=integrator, segmentation=wvr.Segmentation(given, {1: TF}))
    for value in (0, 1, 0):
        labels[...] = value
        opacity = renderer.render(camera, SIZE).rgba[..., 3].max()
        assert (opacity > 0.9) == value
        assert (assert_true(renderer, camera) > 0.9) == value


def test_scaled_samples_written_under_a_kept_renderer():
    samples = zeros("float64")
    volume = wvr.Volume(samples)
    tf = wvr.TransferFunction([(0, "red", 0.0), (1e-200, "white", 0.7)])
    renderer, camera = wvr.Renderer(volume, tf), wvr.Camera.fit(volume)
    for value in (0.0, 1.0, 0.0):
        samples[...] = value * 1e-200
        assert (assert_true(renderer, camera) > 0.9) == value
