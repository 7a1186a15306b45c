"""Volumes: what arrays they take without a copy, where they sit in the world, and what they refuse."""

import copy
import pickle

import numpy as np
import pytest
import warp as wp

import wvr
from wvr.field import samples
from wvr.launch import get_device

get_device()
PLAIN = np.arange(24, dtype=np.float32).reshape(2, 3, 4)


def test_numpy_is_not_copied():
    for dtype in ("uint8", "int8", "uint16", "int16", "float16", "float32", "float64"):
        array = PLAIN.astype(dtype)
        volume = wvr.Volume(array)
        assert np.shares_memory(volume.numpy(), array) and volume.dtype == dtype
        assert np.shares_memory(np.asarray(volume), array)
        on_device = volume.on("cpu")
        assert on_device.ptr == array.ctypes.data and volume.on("cpu") is on_device
        np.testing.assert_array_equal(on_device.numpy(), array)


def test_unusual_layouts_simply_work():
    frozen = PLAIN.copy()
    frozen.flags.writeable = False
    for array in (PLAIN.astype(">f4"), np.asfortranarray(PLAIN), PLAIN[::-1][::-1], frozen, PLAIN.tolist()):
        volume = wvr.Volume(array if not isinstance(array, list) else np.float32(array))
        np.testing.assert_array_equal(volume.on("cpu").numpy(), PLAIN)
    np.testing.assert_array_equal(wvr.Volume(PLAIN[:, ::2, ::-1]).on("cpu").numpy(), PLAIN[:, ::2, ::-1])


def test_warp_arrays(device):
    array = wp.array(PLAIN, device=device)
    volume = wvr.Volume(array)
    assert volume.on(device).ptr == array.ptr
    np.testing.assert_array_equal(volume.numpy(), PLAIN)
    strided = wvr.Volume(wp.array(PLAIN, device=device)[:, ::2])
    np.testing.assert_array_equal(strided.numpy(), PLAIN[:, ::2])
    with pytest.raises(ValueError, match="one component a sample"):
        wvr.Volume(wp.zeros((2, 2, 2), dtype=wp.vec3, device=device))


class Exported:
    """An array that offers nothing but DLPack, as those of PyTorch and JAX do."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **kwargs):
        return self.array.__dlpack__(**kwargs)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_dlpack():
    array = PLAIN.copy()
    volume = wvr.Volume(Exported(array))
    assert volume.on("cpu").ptr == array.ctypes.data
    np.testing.assert_array_equal(volume.numpy(), PLAIN)


def test_arrays_on_gpus_are_asked_on_which():
    """By DLPack: the other protocol, which most have as well, does not say."""

    class Two(Exported):
        @property
        def __cuda_array_interface__(self):
            return {"shape": (1,), "typestr": "<f4", "data": (0, True), "version": 3}

    np.testing.assert_array_equal(wvr.Volume(Two(PLAIN.copy())).numpy(), PLAIN)


def test_world():
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    volume = wvr.Volume(np.zeros((4, 3, 2), np.uint8), (0.5, 2, 3), (10, 20, 30), turn)
    assert volume.shape == (4, 3, 2) and volume.dimensions.tolist() == [2, 3, 4] and volume.smallest_spacing == 0.5
    np.testing.assert_allclose(volume.corners[0], (10, 20, 30))
    np.testing.assert_allclose(volume.corners[-1], [10, 20, 30] + turn @ [0.5, 4, 9])
    np.testing.assert_allclose(volume.corners[1] - volume.corners[0], turn @ [0.5, 0, 0])


def test_range_and_nonfinite():
    assert wvr.Volume(np.uint8([[[3, 9], [5, 4]]])).range == (3, 9)
    data = PLAIN.copy()
    data[0, 0, :3] = np.nan, np.inf, -np.inf
    volume = wvr.Volume(data, nan="transparent")
    assert volume.has_nonfinite and volume.range == (3, 23)
    assert wvr.Volume(np.full((2, 2, 2), np.nan), nan="transparent").range == (0, 0)
    # A sum that overflows is no reason to refuse.
    assert not wvr.Volume(np.full((2, 2, 2), 1e308)).has_nonfinite
    assert not wvr.Volume(np.full((2, 2, 2), 60000, np.float16)).has_nonfinite


@pytest.mark.parametrize(
    ("array", "error", "message"),
    [
        (np.zeros((3, 3)), ValueError, r"three axes \(z, y, x\), got 2: shape \(3, 3\)"),
        (np.zeros((2, 3, 4, 5)), ValueError, "three axes"),
        (np.zeros((2, 3, 4, 3)), ValueError, r"one component a sample, got shape \(2, 3, 4, 3\).*array\[\.\.\., 0\]"),
        (np.zeros((2, 3, 4), [("a", "f4")]), ValueError, "one component"),
        (np.zeros((2, 0, 4)), ValueError, r"not be empty, got shape \(2, 0, 4\)"),
        (np.zeros((2, 3, 4), complex), TypeError, "complex128.*uint8, int8.*np.abs"),
        (np.zeros((2, 3, 4), bool), TypeError, "bool.*cast it to uint8"),
        (np.zeros((2, 3, 4), np.int64), TypeError, "int64.*cast it to int16, uint16 or float64"),
        (np.zeros((2, 3, 4), np.int32), TypeError, "int32"),
        (np.zeros((2, 3, 4), object), TypeError, "object"),
        (np.full((2, 3, 4), np.nan), ValueError, '24 NaN or infinite samples of 24.*nan="transparent"'),
        (np.float32([[[1, np.inf]]]), ValueError, "1 NaN or infinite samples of 2"),
    ],
    ids=str,
)
def test_refused_arrays(array, error, message):
    with pytest.raises(error, match=message):
        wvr.Volume(array)


def test_refused_volume():
    with pytest.raises(TypeError, match="is a Volume already"):
        wvr.Volume(wvr.Volume(PLAIN))


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"spacing": (1, 0, 1)}, r"spacing must be > 0 along x, y and z, got \(1.0, 0.0, 1.0\)"),
        ({"spacing": (1, -1, 1)}, "spacing"),
        ({"spacing": (1, np.nan, 1)}, "spacing must be three finite numbers"),
        ({"spacing": 1.0}, "spacing must be three finite numbers"),
        ({"spacing": "abc"}, "spacing must be three numbers"),
        ({"origin": (0, np.inf, 0)}, "origin must be three finite numbers"),
        ({"direction": np.ones((3, 3))}, "direction must not be singular"),
        ({"direction": np.zeros((3, 3))}, "direction must not be singular"),
        ({"direction": np.eye(4)}, "direction must be a finite 3 x 3 matrix"),
        ({"direction": [[1, 0], [0]]}, "direction must be a finite 3 x 3 matrix"),
        ({"nan": "ignore"}, "nan must be one of 'error', 'transparent', got 'ignore'"),
    ],
    ids=str,
)
def test_refused_places(kwargs, message):
    with pytest.raises(ValueError, match=message):
        wvr.Volume(PLAIN, **kwargs)


def test_a_pickled_volume_is_the_same_without_what_is_on_devices():
    for array in (PLAIN, wp.array(PLAIN, dtype=float, device="cpu"), PLAIN[:, :1]):
        volume = wvr.Volume(array, spacing=(1, 2, 3), origin=(4, 5, 6))
        volume.on("cpu")
        copy = pickle.loads(pickle.dumps(volume))
        np.testing.assert_array_equal(copy.numpy(), volume.numpy())
        np.testing.assert_array_equal(copy.index_to_world, volume.index_to_world)
        np.testing.assert_array_equal(copy.on("cpu").numpy(), volume.on("cpu").numpy())


def test_dtype_and_size_are_known_without_a_copy(monkeypatch):
    """Of samples on another device, for which one of Warp's own stands here."""
    volume = wvr.Volume(np.zeros((2, 3, 4), np.int16))
    expected = volume.dtype, volume.nbytes
    volume._data = wp.array(volume.numpy(), dtype=wp.int16, device="cpu")
    monkeypatch.setattr(wvr.Volume, "host", None)
    assert (volume.dtype, volume.nbytes) == expected == (np.int16, 48)


def test_where_it_is_stays():
    """What was made of it is kept: an assignment would be without effect, and nobody told."""
    tf = wvr.TransferFunction([(0, "red", 0), (1, "white", 0.5)])
    volume, stored = wvr.Volume(np.zeros((3, 3, 3))), wvr.open(np.zeros((3, 3, 3)))
    labels = wvr.Segmentation(np.zeros((3, 3, 3), np.uint8), {0: tf})
    names = {volume: "spacing", stored: "origin", tf: "opacities", labels: "other"}
    for one, name in names.items():
        with pytest.raises(AttributeError, match=f"{name} of a {type(one).__name__} stays as it is"):
            setattr(one, name, getattr(one, name))
    with pytest.raises(TypeError):
        labels.transfer_functions[0] = tf
    for array in (volume.spacing, volume.index_to_world, volume.corners, stored.direction, tf.knots):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 2
    for one in (volume, tf, labels):
        pickle.loads(pickle.dumps(one))
    for copied in (lambda one: pickle.loads(pickle.dumps(one)), copy.copy, copy.deepcopy):
        for array in (copied(volume).spacing, copied(volume).index_to_world, copied(volume).corners, copied(tf).knots):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 2


def test_slices_that_are_too_large_are_rendered_in_bricks(monkeypatch):
    """Of 2^31 bytes and more: arrays of Warp count bytes of a slice in 32 bits, and images were wrong (0.4 off)."""
    monkeypatch.setattr(samples, "SLICE", 48)
    scene = {"camera": "iso", "size": (4, 3), "lighting": False}
    with pytest.raises(ValueError, match=r"slices array\[z\] of less than .* shape \(2, 3, 4\): give memory_limit"):
        wvr.render(PLAIN, "gray", **scene)
    monkeypatch.setattr(samples, "SLICE", 49)
    assert wvr.render(PLAIN, "gray", **scene).rgba.any()
