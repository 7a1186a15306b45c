"""Images that stay on their device, tried on the CPU as if its memory were another's: what is waited for, what is
copied when, and that it is the same image.
"""

import pickle
from copy import copy
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

import wvr
import wvr.frame
import wvr.resident
from studies.base.ptx import arrays_of
from wvr.checksum import checksum
from wvr.clock import Clock
from wvr.field.samples import extremes
from wvr.keep import Keeper
from wvr.kernels.scene import Halves
from wvr.launch import get_device
from wvr.resident import Rays, settled

SIZE = (24, 20)
TF = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.4)])


@pytest.fixture
def elsewhere(monkeypatch):
    """The CPU as a device whose memory the host cannot read, on one thread; counts waits, copies and arrays made."""
    monkeypatch.setattr(wvr.resident, "stays", lambda device: True)
    monkeypatch.setattr(wvr.frame, "stays", lambda device: True)
    counts = SimpleNamespace(waits=0, copies=[], made=[])
    wait, copy, empty = wp.synchronize_device, wp.array.numpy, wp.empty

    def waited(*args):
        counts.waits += 1
        wait(*args)

    def copied(self):
        counts.copies.append((self.dtype, self.size))
        return copy(self)

    def made(shape, *args, **options):
        counts.made.append(shape)
        return empty(shape, *args, **options)

    monkeypatch.setattr(wp, "synchronize_device", waited)
    monkeypatch.setattr(wp.array, "numpy", copied)
    monkeypatch.setattr(wp, "empty", made)
    before = wvr.get_num_threads()
    wvr.set_num_threads(1)
    yield counts
    wvr.set_num_threads(before)


SCENES = {
    "certified": {},
    "riemann": {"integrator": wvr.Riemann(0.5)},
    "shadows": {"integrator": wvr.Riemann(0.5), "shadows": wvr.ConvolutionShadows()},
    "maximum": {"integrator": wvr.Projection("max")},
}


def brought(elsewhere):
    """Of what arrays of all pixels are copied to the host."""
    return {dtype for dtype, size in elsewhere.copies if size >= SIZE[0] * SIZE[1]}


@pytest.mark.parametrize("name", SCENES)
def test_a_frame_is_waited_for_once_and_stays(elsewhere, monkeypatch, blobs, name):
    renderer = wvr.Renderer(blobs, TF, device="cpu", **SCENES[name])
    camera = wvr.Camera.fit(blobs)
    renderer.render(wvr.Camera.fit(blobs, (0, 1, 0.2)), SIZE)
    elsewhere.waits, elsewhere.copies[:], elsewhere.made[:] = 0, [], []
    image = renderer.render(camera, SIZE)
    assert elsewhere.waits == 1
    assert not {wp.vec4f, wp.vec4d} & brought(elsewhere)
    # Of all pixels only what the image itself has is made, and nothing is brought.
    if name in ("certified", "riemann"):
        assert elsewhere.made.count(SIZE[::-1]) == (3 if name == "certified" else 2)
        assert not brought(elsewhere)
    pixels = image.device_rgba
    assert image.device_rgba is pixels and pixels.shape == SIZE[::-1] and pixels.dtype is wp.vec4f
    assert image.size == SIZE and image.most_opaque > 0.1
    assert not {wp.vec4f, wp.vec4d} & brought(elsewhere)
    monkeypatch.undo()
    usual = wvr.Renderer(blobs, TF, device="cpu", **SCENES[name]).render(camera, SIZE)
    np.testing.assert_array_equal(image.rgba, usual.rgba)
    np.testing.assert_array_equal(image.samples, usual.samples)
    np.testing.assert_array_equal(np.from_dlpack(pixels), usual.rgba)
    if usual.error_bound is not None:
        np.testing.assert_array_equal(image.error_bound, usual.error_bound)
    assert image.most_opaque == usual.most_opaque
    seconds = {key for key in usual.stats if key.startswith("seconds")}
    for stats in (image.stats, usual.stats):
        assert seconds <= stats.keys()
        for key in seconds | {"bytes"}:
            stats.pop(key)
    assert image.stats == usual.stats


def test_images_do_not_share_what_frames_leave_to_one_another(elsewhere, blobs):
    renderer = wvr.Renderer(blobs, TF, device="cpu")
    one = renderer.render(wvr.Camera.fit(blobs), SIZE)
    kept = [array.copy() for array in (one.rgba, one.samples, one.error_bound)]
    renderer.render(wvr.Camera.fit(blobs, (0, 1, 0)), SIZE)
    for array, before in zip((np.from_dlpack(one.device_rgba), one.samples, one.error_bound), kept, strict=True):
        np.testing.assert_array_equal(array, before)


@pytest.mark.parametrize("name", ["certified", "riemann"])
def test_an_image_that_stays_is_pickled_whole(elsewhere, blobs, name):
    image = wvr.render(blobs, TF, size=SIZE, device="cpu", **SCENES[name])
    copied = pickle.loads(pickle.dumps(image))
    assert type(copied) is type(image) and copied.size == image.size == SIZE
    for given, array in zip((image.rgba, image.samples), (copied.rgba, copied.samples), strict=True):
        np.testing.assert_array_equal(array, given)
    np.testing.assert_array_equal(copied.error_bound, image.error_bound)
    assert copied.max_error == image.max_error and (name == "certified") == (image.max_error <= 1 / 512)


@pytest.mark.parametrize("shown", [wp.vec4f, wp.vec4d])
def test_what_is_known_of_rays_without_bringing_them(elsewhere, shown):
    """More pixels than one work item has, bounds that are infinite, and sums beyond 32 bits."""
    rng = np.random.default_rng(1)
    shape = (37, 53)
    rgba = rng.random((*shape, 4))
    samples = rng.integers(0, 2**31 - 1, shape, dtype=np.int32)
    bounds = np.where(rng.random(shape) < 0.1, np.inf, rng.random(shape)).astype(np.float32)
    given = [wp.array(array, dtype=dtype, device="cpu") for array, dtype in ((rgba, wp.vec4d), (samples, int))]
    on_device = wp.array(bounds, device="cpu")
    for limits, tolerance in ((on_device, 0.25), (on_device, np.inf), (None, 0.25)):
        keep = Keeper(get_device("cpu"))
        pixels, rays, others = settled(keep, given[0], shown, given[1], limits, tolerance, on_device)
        here = None if limits is None else bounds
        assert rays == Rays.of(samples, here, tolerance)
        assert rays.samples == samples.sum(dtype=np.int64) and rays.over == (
            here is not None and np.sum(bounds > tolerance)
        )
        np.testing.assert_array_equal(others, [bounds])
        np.testing.assert_allclose(pixels.array.numpy(), rgba, rtol=1e-7)
        assert pixels.array.dtype is shown and pixels.most == np.float32(rgba[..., 3].max())


def test_an_image_of_the_cpu_is_shared(blobs):
    image = wvr.render(blobs, TF, size=SIZE, device="cpu", integrator=wvr.Riemann(0.5))
    shared = np.from_dlpack(image.device_rgba)
    assert shared.shape == image.rgba.shape and np.shares_memory(shared, image.rgba)


class Fake:
    """A CUDA device and an array on it, for whoever only asks where things are."""

    is_cpu, is_cuda, alias = False, True, "cuda:7"

    def __init__(self):
        self.events = []
        self.stream = SimpleNamespace(record_event=lambda event: self.events.append(event) or event)


def test_stages_are_timed_by_events_that_nobody_waits_for(monkeypatch):
    times = iter([10.0, 12.5, 20.0])
    monkeypatch.setattr(wp, "Event", lambda device, enable_timing: next(times) if enable_timing else None)

    def elapsed(start, end, synchronize):
        assert not synchronize
        return end - start

    monkeypatch.setattr(wp, "get_event_elapsed_time", elapsed)
    clock = Clock(Fake())
    clock.mark()
    clock.mark()
    np.testing.assert_allclose(clock.seconds(), [0.0025, 0.0075])
    assert clock.device.events == [10.0, 12.5, 20.0]
    usual = Clock(get_device("cpu"))
    usual.mark()
    assert len(usual.seconds()) == 1 and usual.seconds()[0] >= 0


def test_samples_that_are_on_a_device_are_counted_once():
    """Of those given there nothing is missing; of others all until they were brought, and of one axis a copy."""
    device = Fake()
    volume = wvr.Volume(np.zeros((4, 5, 6), np.float32))
    assert volume.missing_on(device) == 480
    volume._device_arrays[device.alias] = object()
    assert volume.missing_on(device) == 0
    for shape, missing in (((4, 5, 6), 0), ((1, 5, 6), 120)):
        given = wvr.Volume(np.zeros(shape, np.float32))
        given._data = SimpleNamespace(device=device, shape=shape, dtype=wp.float32)
        assert given.missing_on(device) == missing
        assert given.missing_on(Fake()) == given.nbytes


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_what_is_known_of_samples_on_a_device_is_found_there(monkeypatch, dtype):
    """Range, dtype and whether all are finite, without bringing them; also after somebody wrote into them."""
    values = np.arange(3, 3 + 7 * 6 * 5).reshape(7, 6, 5).astype(dtype)
    volume = wvr.Volume(values.copy(), nan="transparent")
    volume._data = data = wp.array(values, dtype=wp.dtype_from_numpy(values.dtype), device="cpu")
    volume._forget()
    monkeypatch.setattr(wvr.Volume, "host", lambda self: pytest.fail("samples were brought"))
    assert volume.range == (3.0, 212.0) and not volume.has_nonfinite and volume.dtype == dtype
    before = checksum(data)
    written = values.copy()
    written[6, 5, 4] = 1  # the very last
    if dtype == "float32":
        written[0, 0, 0], written[0, 0, 1] = np.nan, -np.inf
    data.assign(written)
    assert checksum(data) != before
    volume.look()
    assert volume.range == (1.0, 211.0) and volume.has_nonfinite == (dtype == "float32")
    assert extremes(data)[2] == (2 if dtype == "float32" else 0)
    if dtype == "float32":
        volume.nan = "error"
        with pytest.raises(ValueError, match="array has 2 NaN or infinite samples of 210"):
            volume.changed()


def test_words_of_samples_begin_where_a_gpu_reads_them(monkeypatch):
    """A part of somebody's array of bytes begins anywhere: what is written into it is noticed, wherever, and what other
    streams still write is waited for.
    """
    bytes_ = np.zeros(8 + 3 * 5 * 7, np.uint8)
    start = -bytes_.ctypes.data % 8
    addresses, waits = [], []
    launch = wp.launch
    monkeypatch.setattr(
        wp, "launch", lambda kernel, n, given, **at: addresses.append(given[0].ptr) or launch(kernel, n, given, **at)
    )
    monkeypatch.setattr(wp, "synchronize_device", lambda device: waits.append(len(addresses)))
    for at in (start, start + 3):
        samples = bytes_[at : at + 105].reshape(3, 5, 7)
        data = wp.array(ptr=samples.ctypes.data, dtype=wp.uint8, shape=samples.shape, device="cpu")
        before = checksum(data)
        for n in (0, 4, 5, 60, 100, 104):
            samples.flat[n] = 1
            assert checksum(data) != before
            samples.flat[n] = 0
        assert checksum(data) == before
    assert addresses and not any(address % 8 for address in addresses)
    assert waits == list(range(len(addresses)))


def test_memory_whose_stream_is_not_known_is_waited_for(elsewhere):
    class Given:
        values = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
        __cuda_array_interface__ = None
        __array_interface__ = values.__array_interface__

        def __len__(self):
            return 2

    volume = wvr.Volume(Given())
    assert elsewhere.waits == 1 and volume.range == (0.0, 23.0)


@pytest.mark.parametrize("options", [{}, {"memory_limit": "1 GiB"}])
def test_what_walk_an_image_is_said_to_be_of_is_that_of_its_kernels(monkeypatch, blobs, options):
    """On a GPU single precision is that of one ray at a time, of bricks, too."""
    frames, report = [], wvr.Certified.report
    monkeypatch.setattr(wvr.Certified, "report", lambda self, frame: frames.append(frame) or report(self, frame))
    image = wvr.render(blobs, TF, size=SIZE, device="cpu", lighting=False, **options)
    (frame,) = frames
    scene, bricked = frame.scene, bool(options)
    assert image.stats["walk"] == "float32"
    halves = Halves(wp.float64, scene.volume.half, scene.integrator.half(scene), vectors=False, brick=bricked)
    frame.keep = SimpleNamespace(device=Fake())
    assert report(scene.integrator, frame)["walk"] == "float32" and halves.leaves


@pytest.fixture
def second(monkeypatch):
    """The CPU once more, as a device of its own."""
    get_device()
    device = copy(wp.get_device("cpu"))
    device.alias = "cpu:1"

    def equal(one, other):
        return one is other if isinstance(other, wp.Device) else one.alias == other

    monkeypatch.setattr(wp.Device, "__eq__", equal)
    monkeypatch.setitem(device.runtime.device_map, device.alias, device)
    return device


@pytest.mark.parametrize("name", SCENES)
def test_two_devices_share_nothing(second, monkeypatch, blobs, name):
    """Whatever a kernel reads or writes is on its device, and nothing that a renderer of the other keeps; by turns."""
    used, launch = {"cpu": {}, "cpu:1": {}}, wp.launch

    def launched(kernel, items, inputs, *rest, device, **options):
        for array in arrays_of(inputs):
            assert array.ptr is None or array.device is device, kernel.key
            used[device.alias][array.ptr] = array  # not freed, so that no other has its place
        return launch(kernel, items, inputs, *rest, device=device, **options)

    renderers = [wvr.Renderer(blobs, TF, device=at, **SCENES[name]) for at in ("cpu", second)]
    monkeypatch.setattr(wp, "launch", launched)
    images = []
    for way in ((1, 0.3, 0.2), (0, 1, 0.2)):
        for renderer in renderers:
            images.append(renderer.render(wvr.Camera.fit(blobs, way), SIZE).rgba)
    assert not (set(used["cpu"]) & set(used["cpu:1"])) - {None}
    assert min(map(len, used.values())) > 3
    np.testing.assert_array_equal(images[0], images[1])
    np.testing.assert_array_equal(images[2], images[3])
    # The second frame of each found its parts as if there were no other.
    one, other = (renderer.builds for renderer in renderers)
    assert one == other and one["volume"] == 1
