"""Volumes that stay in a store: what is read, and that the image is that of the whole whatever was not."""

from __future__ import annotations

import dataclasses
import pickle
import shutil
import threading
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import wvr
from wvr.bricks import ranges, stored
from wvr.bricks.grid import Bricks
from wvr.bricks.pieces import Pieces
from wvr.bricks.sampled import blocks_that_fit
from wvr.defaults import Call
from wvr.framing import visible_points

zarr = pytest.importorskip("zarr")

RNG = np.random.default_rng(3)
DATA = np.clip(wvr.datasets.load("blobs", 40).numpy() + RNG.normal(0, 6, (40, 40, 40)), 0, 255).astype(np.uint8)
DATA[DATA < 60] = 0
WHOLE = wvr.Volume(DATA, (1.0, 1.1, 0.9))
TF = wvr.TransferFunction([(0, "navy", 0.0), (100, "green", 0.0), (140, "gold", 0.1), (255, "white", 0.6)])
CAMERAS = {
    "outside": wvr.Camera.fit(WHOLE, (1, 0.6, 0.4)),
    "inside": wvr.Camera((18, 21, 12), (30, 28, 30), view_angle=80),
}
SIZE = (20, 18)
TOLERANCE = 1 / 256


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Blocks of one chunk."""
    monkeypatch.setattr(stored, "ALONG", 8)


@pytest.fixture
def store(tmp_path, request):
    return written(tmp_path, getattr(request, "param", 3))


def written(folder, version):
    path = folder / "a.zarr"
    array = zarr.create_array(path, shape=DATA.shape, chunks=(8, 8, 8), dtype="u1", zarr_format=version)
    array[:] = DATA
    return path


def opened(store, **options):
    return wvr.open(store, spacing=WHOLE.spacing, **options)


def assert_within(image: wvr.Image, camera: wvr.Camera, tolerance: float | None = TOLERANCE) -> None:
    exact = wvr.render(WHOLE, TF, camera, SIZE, integrator=wvr.Exact())
    error = np.abs(image.rgba - exact.rgba).max(axis=2)
    assert np.all(error <= image.error_bound), float((error - image.error_bound).max())
    if tolerance is not None:
        assert image.error_bound.max() <= tolerance


@pytest.mark.parametrize(("store", "known"), [(2, False), (3, True)], ids=["no ranges", "ranges"], indirect=["store"])
def test_it_is_the_whole(store, known):
    if known:
        wvr.build_ranges(store)
    volume = opened(store)
    assert (volume.ranges is not None) == known and volume.shape == DATA.shape
    for camera in CAMERAS.values():
        image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE)
        assert_within(image, camera)
        assert image.stats["blocks_read_again"] == 0 and image.stats["blocks_read"] <= 125
        exact = wvr.render(volume, TF, camera, SIZE, integrator=wvr.Exact())
        whole = wvr.render(WHOLE, TF, camera, SIZE, integrator=wvr.Exact())
        np.testing.assert_allclose(exact.rgba, whole.rgba, atol=1e-11)
        assert exact.stats["blocks_read_again"] == 0


def test_light_and_segments_reach_into_neighbours(store):
    lit = {"integrator": wvr.Riemann(0.77), "lighting": wvr.Lighting(), "termination": 0.0, "precision": "float64"}
    whole = wvr.render(WHOLE, TF, CAMERAS["outside"], SIZE, **lit)
    image = wvr.render(opened(store), TF, CAMERAS["outside"], SIZE, **lit)
    np.testing.assert_allclose(image.rgba, whole.rgba, atol=1e-11)


def test_a_little_memory_is_enough(store):
    """For less than all blocks at a time."""
    image = wvr.render(opened(store), TF, CAMERAS["outside"], SIZE, tolerance=TOLERANCE, memory_limit="1 MiB")
    assert image.stats["blocks_read_again"] == 0
    assert_within(image, CAMERAS["outside"])
    whole = stored.StoredVolume(stored.Samples(np.zeros((300, 300, 300)), "zeros", chunks=((300,),) * 3))
    with pytest.raises(MemoryError, match="memory_limit"):
        wvr.render(whole, TF, "iso", SIZE, memory_limit="1 MiB")


def test_what_cannot_be_seen_is_never_read(store, monkeypatch):
    volume = wvr.build_ranges(opened(store))
    read = []
    region = stored.StoredVolume.region
    monkeypatch.setattr(
        stored.StoredVolume, "region", lambda self, low, high: (read.append(low // 8), region(self, low, high))[1]
    )
    clear = wvr.TransferFunction([(0, "red", 0.0), (190, "red", 0.0), (200, "red", 0.9)])
    wvr.render(volume, clear, CAMERAS["outside"], SIZE, tolerance=TOLERANCE)
    # Only blocks that have something to see, or are next to one that has.
    most = DATA.reshape(5, 8, 5, 8, 5, 8).max(axis=(1, 3, 5)) > 190
    padded = np.pad(most, 1)
    near = np.lib.stride_tricks.sliding_window_view(padded, (3, 3, 3)).any(axis=(3, 4, 5))
    assert 0 < len(read) < 100 and all(near[tuple(at[::-1])] for at in read)
    assert len({tuple(at) for at in read}) == len(read)


def test_what_is_written_between_frames_is_seen(store):
    """Ranges of blocks that changed are not believed."""
    volume = wvr.build_ranges(opened(store))
    camera = CAMERAS["outside"]
    renderer = wvr.Renderer(volume, TF, tolerance=TOLERANCE)
    before = renderer.render(camera, SIZE)
    zarr.open_array(store, mode="r+")[16:24, 16:24, 32:40] = 255
    after = renderer.render(camera, SIZE)
    data = DATA.copy()
    data[16:24, 16:24, 32:40] = 255
    exact = wvr.render(wvr.Volume(data, WHOLE.spacing), TF, camera, SIZE, integrator=wvr.Exact())
    assert np.abs(after.rgba - before.rgba).max() > 0.05
    assert np.all(np.abs(after.rgba - exact.rgba).max(axis=2) <= after.error_bound)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("budget", [0, "4 kB", "20 kB", 1000.0])
def test_what_was_not_read_is_in_the_bound(store, camera, budget):
    volume = wvr.build_ranges(opened(store))
    image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, budget=budget)
    assert_within(image, camera, None)
    assert image.error_bound.max() <= 0.5 + 1e-6
    if budget == 0:
        assert image.stats["bytes_read"] == 0 and image.error_bound.max() > 0.1
    elif budget == 1000.0:
        assert image.error_bound.max() <= TOLERANCE
    else:
        assert image.stats["bytes_read"] < int(budget.split()[0]) * 1000 + 8 * 512


def test_what_was_not_read_may_be_seen_however_little_it_is():
    """Beside a control point without any extinction, of slopes so steep that it counts."""
    tf = wvr.TransferFunction([(-1.0, "white", 1.0), (0.0, "white", 0.0)], unit_distance=1e-20)
    volume = wvr.build_ranges(opened(np.full((9, 9, 9), -1e-25)))
    camera = wvr.Camera((4, 4.4, 30), (4, 4.4, 0), up=(0, 1, 0), parallel_scale=3)
    image = wvr.render(volume, tf, camera, (4, 4), tolerance=TOLERANCE, budget=0)
    opacity = -np.expm1(-tf.knot_extinctions(1.0)[0] * 1e-25 * 8 * WHOLE.spacing[2])
    assert opacity > 1e-3 and np.all(np.abs(image.rgba - opacity).max(axis=2) <= image.error_bound)


def test_what_is_read_under_a_budget_has_pixels_that_can_be_counted(monkeypatch):
    monkeypatch.setattr("wvr.bricks.limited.MOST", 3 * SIZE[0] * SIZE[1])
    volume = wvr.build_ranges(opened(DATA))
    image = wvr.render(volume, TF, CAMERAS["outside"], SIZE, tolerance=TOLERANCE, budget=1000.0)
    assert_within(image, CAMERAS["outside"], None)
    assert 2 < image.stats["bricks_rendered"] < image.stats["bricks_visible"]


def test_what_was_not_read_has_the_colours_of_all_labels():
    """Those of a label that shows nothing are none, and take none of the others."""
    labels = np.ones(DATA.shape, np.uint8)
    labels[:, :, 20:] = 2
    clear = wvr.TransferFunction([(0, "red", 0.0), (255, "red", 0.0)])
    options = {"segmentation": wvr.Segmentation(labels, {1: TF, 2: clear})}
    volume = wvr.build_ranges(opened(DATA))
    image = wvr.render(volume, None, CAMERAS["outside"], SIZE, tolerance=TOLERANCE, budget=0, **options)
    exact = wvr.render(WHOLE, None, CAMERAS["outside"], SIZE, integrator=wvr.Exact(), **options)
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)
    assert exact.rgba[..., :3].max() > 0.5


def test_under_a_budget_what_adds_most_to_the_bound_is_read_first(monkeypatch):
    """Structures behind fog, which may add little, and not the fog; all that is left is then within a tolerance."""
    data = RNG.integers(10, 20, (16, 16, 40)).astype(np.uint8)
    data[:, :, 34:] = RNG.integers(10, 200, (16, 16, 6))
    volume = wvr.build_ranges(wvr.open(data))
    tf = wvr.TransferFunction([(0, "teal", 0.0), (30, "teal", 0.001), (200, "gold", 0.3)])
    read = []
    region = stored.StoredVolume.region
    record = lambda self, low, high: (read.append(int(low[0])), region(self, low, high))[1]  # noqa: E731
    monkeypatch.setattr(stored.StoredVolume, "region", record)
    camera = wvr.Camera.fit(volume, (-1, 0.1, 0.1))
    images = [wvr.render(volume, tf, camera, SIZE, tolerance=0.05, budget=budget) for budget in (0, "2 kB", 1000.0)]
    assert min(read) >= 24 and images[-1].error_bound.max() <= 0.05
    exact = wvr.render(wvr.Volume(data), tf, camera, SIZE, integrator=wvr.Exact())
    for image in images:
        assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)
    assert images[0].error_bound.mean() > images[1].error_bound.mean() > images[2].error_bound.mean()


@pytest.mark.parametrize("options", [{}, {"budget": 0}, {"budget": "20 kB"}], ids=["all", "nothing", "some"])
def test_what_is_behind_a_depth_is_never_read(options):
    """In the bound of what was not read as well."""
    volume = wvr.build_ranges(opened(DATA))
    for camera in CAMERAS.values():
        far = (WHOLE.corners - camera.position) @ camera.basis()[2]
        depth = np.full(SIZE[::-1], far.min() + 0.4 * (far.max() - far.min()))
        depth[3] += 5.0
        exact = wvr.render(WHOLE, TF, camera, SIZE, integrator=wvr.Exact(), depth=depth)
        every = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, **options)
        image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, depth=depth, **options)
        assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)
        if not options:
            assert image.stats["blocks_read"] < every.stats["blocks_read"] and image.max_error <= TOLERANCE


@pytest.mark.parametrize("budget", [0, "5 kB"])
def test_a_coarse_level_stands_in_within_the_bound(budget):
    """It is nearer to the image than the middle is, and its bound is that of the fine samples."""
    volume = wvr.build_ranges(opened(DATA))
    camera = CAMERAS["outside"]
    exact = wvr.render(WHOLE, TF, camera, SIZE, integrator=wvr.Exact())
    middle = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, budget=budget)
    pyramid = wvr.build_ranges(opened(DATA))
    pyramid.coarse = wvr.open(DATA[::2, ::2, ::2], spacing=2 * np.array(WHOLE.spacing))
    # Where transfer function and camera are given nobody asks for it but a budget above 0.
    wvr.render(pyramid, TF, camera, SIZE, tolerance=TOLERANCE, budget=0)
    assert "preview" not in vars(pyramid)
    assert pyramid.preview is not None
    image = wvr.render(pyramid, TF, camera, SIZE, tolerance=TOLERANCE, budget=budget)
    assert_within(image, camera, None)
    off, before = (np.abs(one.rgba - exact.rgba).mean() for one in (image, middle))
    assert off < before / 2
    if budget == 0:
        # It ends where rays do.
        depth = np.full(SIZE[::-1], np.linalg.norm(WHOLE.corners.mean(axis=0) - camera.position) - 8)
        exact = wvr.render(WHOLE, TF, camera, SIZE, integrator=wvr.Exact(), depth=depth)
        image, middle = (
            wvr.render(one, TF, camera, SIZE, tolerance=TOLERANCE, budget=0, depth=depth) for one in (pyramid, volume)
        )
        off, before = (np.abs(one.rgba - exact.rgba).mean() for one in (image, middle))
        assert off < before / 5


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_blocks_whose_edges_no_ray_meets_are_not_read(camera, monkeypatch):
    """With few rays fewer than are visible; the same image as with all of them."""
    volume = wvr.build_ranges(opened(DATA))
    image = wvr.render(volume, TF, camera, (3, 2), tolerance=TOLERANCE)
    monkeypatch.setattr(Pieces, "needed", lambda *_: None)
    every = wvr.render(volume, TF, camera, (3, 2), tolerance=TOLERANCE)
    assert image.stats["blocks_read"] < every.stats["blocks_read"]
    np.testing.assert_allclose(image.rgba, every.rgba, atol=1e-12)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_blocks_of_one_value_are_known_without_reading(camera):
    """Ranges say all of them: the image is exact, and its bound but for the image's rounding nothing."""
    values = np.full((40, 40, 40), 180, np.uint8)
    volume = wvr.build_ranges(wvr.open(values, spacing=WHOLE.spacing))
    image = wvr.render(volume, TF, camera, SIZE, budget=0, precision="float64")
    exact = wvr.render(wvr.Volume(values, WHOLE.spacing), TF, camera, SIZE, integrator=wvr.Exact())
    error = np.abs(image.rgba - exact.rgba).max(axis=2)
    assert image.stats["blocks_read"] == 0 and np.all(error <= image.error_bound)
    assert image.error_bound.max() < 1e-6


@pytest.mark.parametrize("known", [False, True], ids=["no ranges", "ranges"])
def test_a_chunk_that_is_damaged_is_named_or_in_the_bound(store, known, caplog):
    caplog.set_level("INFO", "wvr")
    volume = wvr.build_ranges(opened(store)) if known else opened(store)
    key = volume.samples.array.metadata.encode_chunk_key((2, 2, 3))
    (store / key).write_bytes(b"damaged")
    camera = CAMERAS["outside"]
    with pytest.raises(OSError, match=r"x 24 to 31, y 16 to 23, z 16 to 23"):
        wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE)
    image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, missing="bound")
    assert image.stats["bricks_missing"] > 0
    # Once, though it is in several bricks, and without the advice that was followed.
    assert caplog.text.count("could not be read") == 1 and "missing=" not in caplog.text
    assert_within(image, camera, None)
    assert image.error_bound.max() > TOLERANCE


def test_floats_that_cannot_be_read_have_a_bound_by_their_ranges_alone():
    """What they may be nobody knows else, and the error says so."""
    data = (DATA[:24, :24, :24] / 255).astype("f4")

    class Broken:
        shape, dtype = data.shape, data.dtype

        def __getitem__(self, key):
            if all(part.stop > 16 for part in key):
                raise OSError("gone")
            return data[key]

    tf = [(0, "white", 0.9), (0.5, "white", 0.5), (0.5, "white", 0.0), (1, "white", 0.0)]
    known = wvr.build_ranges(wvr.open(data))
    broken = known.at(array=Broken())
    options = {"tolerance": 1e-3, "lighting": False}
    with pytest.raises(
        OSError, match=r"x 16 to 23, y 16 to 23, z 16 to 23 .* by ranges \(wvr.build_ranges\) of a time"
    ):
        wvr.render(broken, tf, CAMERAS["outside"], SIZE, missing="bound", **options)
    broken.ranges = known.ranges
    image = wvr.render(broken, tf, CAMERAS["outside"], SIZE, missing="bound", **options)
    whole = wvr.render(wvr.Volume(data), tf, CAMERAS["outside"], SIZE, **options)
    assert image.stats["bricks_missing"] > 0
    apart = np.abs(image.rgba.astype(float) - whole.rgba).max(axis=2)
    assert np.all(apart <= image.error_bound.astype(float) + whole.error_bound)


def test_ranges_are_those_of_the_samples(store):
    volume = wvr.build_ranges(store)
    known = volume.ranges
    first, last, whole = slice(0, 1), slice(-1, None), slice(None)
    for at in ((0, 0, 0), (2, 3, 1), (4, 4, 4)):
        block = DATA[tuple(slice(8 * n, 8 * n + 8) for n in at)]
        for layer, part in (((0, 0, 0), (whole,) * 3), ((1, 0, 2), (first, whole, last)), ((2, 2, 2), (last,) * 3)):
            samples = block[part]
            assert known.values[(*at, *layer)].tolist() == [samples.min(), samples.max()]
    assert known.limits() == (DATA.min(), DATA.max())
    for towards in ((0, 0, 0), (2, 4, 1)):
        found, there = known.of_pieces(towards)
        assert there.all()
        bricks = Bricks.of_chunks(volume.starts, towards)
        for index in bricks:
            low, high = bricks.box(index)
            own = WHOLE.region(low, high)
            ranges = found[(slice(None),) * 3 + index[::-1]].reshape(-1, 2)
            # That of its pieces together.
            assert ranges[:, 0].min() == own.min() and ranges[:, 1].max() == own.max()


def test_ranges_go_on_where_they_stopped_and_notice_changes(store, monkeypatch):
    seen = []
    limits = ranges.limits_of
    monkeypatch.setattr(ranges, "limits_of", lambda samples: (seen.append(1), limits(samples))[1])

    class StopError(Exception):
        pass

    def stop(done, total):
        if done == 40:
            raise StopError

    monkeypatch.setattr(ranges, "EVERY", 0.0)
    with pytest.raises(StopError):
        wvr.build_ranges(store, report=stop)
    before = len(seen)
    wvr.build_ranges(store)
    assert before < 60 and len(seen) - before < 125 - 35
    array = zarr.open_array(store, mode="r+")
    array[0:8, 0:8, 0:8] = 255
    seen.clear()
    volume = wvr.build_ranges(store)
    assert len(seen) == 1 and volume.ranges.values[0, 0, 0, 0, 0, 0].tolist() == [255, 255]


class Slow:
    """Samples that come once they are let."""

    def __init__(self, samples):
        self.samples, self.shape, self.dtype = samples, samples.shape, samples.dtype
        self.asked, self.let, self.given_up = threading.Event(), threading.Event(), threading.Event()

    def __getitem__(self, key):
        self.asked.set()
        if not self.let.wait(10):
            self.given_up.set()
        return self.samples[key]


def test_a_cancelled_frame_does_not_wait_for_a_block():
    slow, cancel = Slow(DATA), threading.Event()
    canceller = threading.Thread(target=lambda: (slow.asked.wait(), cancel.set()))
    canceller.start()
    volume = wvr.open(slow, spacing=WHOLE.spacing)
    try:
        with pytest.raises(wvr.Cancelled):
            wvr.render(volume, TF, CAMERAS["outside"], SIZE, cancel=cancel)
        assert not slow.given_up.is_set()
        slow.let.set()
        assert_within(wvr.render(volume, TF, CAMERAS["outside"], SIZE), CAMERAS["outside"])
    finally:
        slow.let.set()


def test_missing_values_and_floats(tmp_path):
    data = DATA.astype(np.float32)
    data[20:24, 18:22, 19:23] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        wvr.render(wvr.open(data), TF, "iso", SIZE)
    whole = wvr.Volume(data, nan="transparent")
    camera = CAMERAS["outside"]
    exact = wvr.render(whole, TF, camera, SIZE, integrator=wvr.Exact())
    volume = wvr.build_ranges(wvr.open(data, nan="transparent"))
    for options in ({}, {"budget": 0}):
        image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, **options)
        assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)


# What stores say of themselves.


def read_all(volume) -> np.ndarray:
    return volume.region(np.zeros(3, np.int64), np.array(volume.shape[::-1]) - 1)


def test_a_pyramid_has_its_place_and_a_preview(tmp_path):
    ngff = pytest.importorskip("ngff_zarr")
    for version in ("0.4", "0.5"):
        path = tmp_path / f"{version}.ome.zarr"
        image = ngff.to_ngff_image(
            DATA,
            dims=["z", "y", "x"],
            scale={"z": 2.0, "y": 1.0, "x": 0.5},
            translation={"z": 5.0, "y": -1.0, "x": 3.0},
        )
        ngff.to_ngff_zarr(str(path), ngff.to_multiscales(image, scale_factors=[2, 4], chunks=16), version=version)
        volume = wvr.open(path)
        assert volume.spacing.tolist() == [0.5, 1.0, 2.0] and volume.origin.tolist() == [3.0, -1.0, 5.0]
        np.testing.assert_array_equal(read_all(volume), DATA)
        coarse = wvr.open(path, level=1)
        known = ngff.from_ngff_zarr(str(path)).images[1]
        assert coarse.shape == known.data.shape
        np.testing.assert_allclose(coarse.spacing, [known.scale[axis] for axis in "xyz"])
        np.testing.assert_allclose(coarse.origin, [known.translation[axis] for axis in "xyz"])
        assert volume.preview.shape == (10, 10, 10)
        with pytest.raises(ValueError, match="level"):
            wvr.open(path, level=7)
    # Suggested of the preview, seen in all samples.
    image = wvr.render(path, size=SIZE)
    assert image.rgba[..., 3].max() > 0.1 and image.stats["blocks_read"] > 0


@pytest.mark.parametrize("said", [True, False], ids=["scales", "no scales"])
def test_coarser_levels_are_where_the_volume_is(tmp_path, said):
    """Wherever it is put, and of levels that do not say how large they are; absent where it is. Elsewhere cameras that
    are not given saw nothing, and levels with NaN were refused.
    """
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    levels = []
    for n, data in enumerate((DATA.astype(np.float32), DATA[::2, ::2, ::2].astype(np.float32))):
        data[0] = np.nan
        group.create_array(str(n), shape=data.shape, chunks=(8, 8, 8), dtype="f4")[:] = data
        scales = [
            {"type": "scale", "scale": [2.0**n] * 3},
            {"type": "translation", "translation": [(2**n - 1) / 2] * 3},
        ]
        levels.append({"path": str(n)} | ({"coordinateTransformations": scales} if said else {}))
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    for place in ({}, {"spacing": (3.0, 1.0, 2.0), "origin": (1000.0, 0.0, -5.0)}):
        volume = wvr.open(tmp_path / "a.zarr", nan="transparent", **place)
        edges = [
            one.index_to_world[:3, :3] @ (np.array(one.shape) - 0.5) + one.origin for one in (volume, volume.preview)
        ]
        np.testing.assert_allclose(*edges)
        np.testing.assert_allclose(volume.preview.spacing, 2 * volume.spacing)
        assert volume.preview.nan == "transparent"


def test_chunks_may_have_no_samples_but_known_lengths():
    da = pytest.importorskip("dask.array")
    lazy = da.from_array(DATA, chunks=((0, 8, 0, 32), (40, 0), (24, 16)))
    volume = wvr.build_ranges(wvr.open(lazy, spacing=WHOLE.spacing))
    assert volume.starts == ((0, 24, 40), (0, 40), (0, 8, 40))
    assert_within(wvr.render(volume, TF, CAMERAS["outside"], SIZE, tolerance=TOLERANCE), CAMERAS["outside"])
    with pytest.raises(ValueError, match="compute_chunk_sizes"):
        wvr.open(lazy[lazy[:, 0, 0] > 255])


def test_masked_samples_are_absent():
    """Of an array that is masked and of one that Dask computes, in a store and in memory; integers hold no such."""
    da = pytest.importorskip("dask.array")
    masked = np.ma.masked_greater(DATA.astype(np.float32), 150)
    lazy = da.from_array(masked, chunks=8)
    for array in (masked, lazy):
        samples = read_all(wvr.open(array, nan="transparent"))
        np.testing.assert_array_equal(samples, masked.filled(np.nan))
        with pytest.raises(ValueError, match="NaN"):
            read_all(wvr.open(array))
    np.testing.assert_array_equal(wvr.as_volume(lazy).numpy(), masked.filled(np.nan))
    for refused in (wvr.Volume, lambda array: wvr.Segmentation(array > 0, {1: TF})):
        with pytest.raises(TypeError, match="masked"):
            refused(lazy)
    with pytest.raises(OSError, match="masked samples, which bool does not hold"):
        read_all(wvr.open(lazy > 0))


def test_axes_have_units_of_their_own(tmp_path):
    """Lengths are in that of x."""
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    group.create_array("0", shape=DATA.shape, chunks=(8, 8, 8), dtype="u1")[:] = DATA
    scales = [{"type": "scale", "scale": [0.3, 500.0, 0.5]}, {"type": "translation", "translation": [1.0, 2.0, 3.0]}]
    axes = [
        {"name": "z", "unit": "micrometer"},
        {"name": "y", "unit": "nanometer"},
        {"name": "x", "unit": "micrometer"},
    ]
    levels = [{"path": "0", "coordinateTransformations": scales}]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    volume = wvr.open(tmp_path / "a.zarr")
    np.testing.assert_allclose([volume.spacing, volume.origin], [[0.5, 0.5, 0.3], [3.0, 0.002, 1.0]])
    del axes[0]["unit"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    assert wvr.open(tmp_path / "a.zarr").spacing.tolist() == [0.5, 500.0, 0.3]


def test_a_store_of_one_level_is_suggested_for(monkeypatch):
    """As the volume is, where its samples are few; else by blocks that are evenly apart, in the same box."""
    volume, expected = opened(DATA), wvr.render(WHOLE, size=SIZE, lighting=False)
    image = wvr.render(volume, size=SIZE, lighting=False)
    assert volume.some.shape == WHOLE.shape and np.array_equal(volume.some.numpy(), DATA)
    assert np.abs(image.rgba - expected.rgba).max() <= 2 * TOLERANCE
    monkeypatch.setattr("wvr.bricks.stored.PREVIEW", DATA.nbytes // 2)
    volume = opened(DATA)
    some = volume.some
    assert some.numpy().size <= DATA.size // 2 and np.allclose(some.corners, WHOLE.corners)
    assert np.isin(some.numpy()[:8, :8, :8], DATA[:8, :8, :8]).all()
    assert wvr.render(volume, size=SIZE).rgba[..., 3].max() > 0.1


def test_presets_on_a_relative_scale_span_the_samples_not_what_their_type_holds():
    data = (np.indices((12, 12, 12)).sum(0) * 90).astype(np.uint16)
    known = wvr.build_ranges(wvr.open(data))
    for volume in (wvr.open(data), known, wvr.open(data.astype(np.float32))):
        tf = Call("mri").look(volume, SIZE).transfer_function
        assert tf == wvr.TransferFunction.preset("mri", (0, 2970))
    assert "some" not in vars(known) and not Call("mri", clim=(0, 1)).asks(wvr.open(data))


@pytest.mark.parametrize("counts", [(5000, 1, 1), (40, 30, 20), (3, 3, 3), (1, 1, 1)])
@pytest.mark.parametrize("share", [2.0, 0.3, 0.001])
def test_blocks_that_stand_in_are_as_many_as_fit(counts, share):
    """And along each axis as large a part of them."""
    starts = tuple(tuple(range(0, 2 * n + 1, 2)) for n in counts)
    volume = SimpleNamespace(blocks_along=counts, starts=starts, dtype=np.dtype("u1"))
    along = blocks_that_fit(volume, int(share * np.prod(counts) * 8))
    most = share * np.prod(counts)
    assert np.prod(along) <= max(most, 1) and all(1 <= n <= count for n, count in zip(along, counts, strict=True))
    longest = max(counts)
    if along != list(counts):
        more = [-(-(max(along) + 1) * count // longest) for count in counts]
        assert np.prod(more) > most


@pytest.mark.parametrize("colors", [None, "viridis", ["black", "white"]])
def test_colours_of_projections_are_over_all_samples_not_over_some(monkeypatch, colors):
    monkeypatch.setattr("wvr.bricks.stored.PREVIEW", 1000)
    data = np.zeros((24, 24, 24), np.float32)
    data[0, 0, 0] = 7
    volume = wvr.open(data)
    look = Call(colors, integrator=wvr.Projection("max")).look(volume, SIZE)
    assert look.transfer_function.knots[[0, -1]].tolist() == [0, 7] and "some" not in vars(volume)


def test_what_is_not_read_is_not_said_to_be_nothing():
    """No surface is found where nothing is read, which its bound says."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        image = wvr.render(opened(DATA), TF, size=SIZE, integrator=wvr.Isosurface([130]), budget=0)
    assert not image.samples.any() and image.max_error >= 1


def test_ranges_say_what_is_framed():
    data = np.zeros((64, 64, 64), np.uint8)
    data[40:46, 8:14, 20:26] = 200
    tf = wvr.TransferFunction([(100, "white", 0.0), (150, "white", 0.5)])
    volume = wvr.open(data)
    points = visible_points(volume, tf)
    assert np.array_equal(points, volume.corners)
    # Blocks of 8 samples, and the cells on both sides of them.
    points = visible_points(wvr.build_ranges(volume), tf)
    assert points.min(axis=0).tolist() == [15, 7, 39] and points.max(axis=0).tolist() == [32, 16, 48]
    nothing = wvr.TransferFunction([(210, "white", 0.0), (250, "white", 0.5)])
    assert np.array_equal(visible_points(volume, nothing), volume.corners)


def test_axes_are_selected_by_name(tmp_path):
    data = np.stack([[DATA[:9], DATA[9:18]], [DATA[18:27], DATA[27:36]]])  # t, c, z, y, x
    array = zarr.create_array(tmp_path / "b.zarr", shape=data.shape, chunks=(1, 1, 4, 8, 8), dtype="u1")
    array[:] = data
    np.testing.assert_array_equal(read_all(wvr.open(array, t=1, c=0)), data[1, 0])
    # Ranges of one are not those of another.
    wvr.build_ranges(wvr.open(tmp_path / "b.zarr", t=1, c=0))
    assert wvr.open(tmp_path / "b.zarr", t=1, c=0).ranges is not None
    assert wvr.open(tmp_path / "b.zarr", t=0, c=0).ranges is None
    (tmp_path / "b.zarr.c0.t1.ranges.npz").rename(tmp_path / "b.zarr.c0.t0.ranges.npz")
    assert wvr.open(tmp_path / "b.zarr", t=0, c=0).ranges is None
    with pytest.raises(ValueError, match=r"2 along c"):
        wvr.open(array, t=1)
    with pytest.raises(ValueError, match="u is no axis"):
        wvr.open(array, t=1, c=0, u=1)
    with pytest.raises(ValueError, match="t must be an index"):
        wvr.open(array, t=5, c=0)


def test_other_stores(tmp_path):
    da = pytest.importorskip("dask.array")
    xr = pytest.importorskip("xarray")
    h5py = pytest.importorskip("h5py")
    stores = {"dask": da.from_array(DATA, chunks=(8, 16, (10, 30))), "numpy": DATA}
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("images/volume", data=DATA, chunks=(8, 8, 8))
        file["images/volume"].attrs["element_size_um"] = (3.0, 2.0, 1.0)
    stores["hdf5"] = tmp_path / "a.h5"
    np.save(tmp_path / "a.npy", DATA)
    np.save(tmp_path / "f.npy", np.asfortranarray(DATA))
    stores |= {"npy": tmp_path / "a.npy", "fortran": tmp_path / "f.npy"}
    (tmp_path / "a.raw").write_bytes(b"head" + DATA.astype(">i2").tobytes())
    coords = {"z": np.arange(40) * 2.0, "y": 5 - np.arange(40) * 1.0, "x": np.arange(40) * 0.5 + 1}
    stores["xarray"] = xr.DataArray(DATA, coords, ("z", "y", "x")).transpose("x", "z", "y")
    for name, given in stores.items():
        volume = wvr.open(given)
        volume = pickle.loads(pickle.dumps(volume))
        np.testing.assert_array_equal(read_all(volume), DATA, err_msg=name)
    volume = wvr.open(tmp_path / "a.raw", shape=DATA.shape, dtype=">i2", offset=4)
    np.testing.assert_array_equal(read_all(volume), DATA)
    assert volume.dtype == np.int16
    assert wvr.open(tmp_path / "a.h5").spacing.tolist() == [1.0, 2.0, 3.0]
    placed, loaded = wvr.open(stores["xarray"]), wvr.as_volume(stores["xarray"])
    np.testing.assert_allclose(placed.index_to_world, loaded.index_to_world)


def test_nifti_is_mapped_where_it_lies(tmp_path):
    import nibabel

    affine = np.array([[0, -1.5, 0, 3], [2, 0, 0, -4], [0, 0, 1, 7], [0, 0, 0, 1.0]])
    image = nibabel.Nifti1Image(DATA.T.astype(np.int16), affine)
    nibabel.save(image, tmp_path / "a.nii")
    volume, read = wvr.open(tmp_path / "a.nii"), wvr.read(tmp_path / "a.nii")
    np.testing.assert_allclose(volume.index_to_world, read.index_to_world)
    np.testing.assert_array_equal(read_all(volume), read.numpy())
    assert volume.anatomical == read.anatomical
    image.header.set_slope_inter(0.5, 10)
    nibabel.save(image, tmp_path / "b.nii")
    np.testing.assert_allclose(read_all(wvr.open(tmp_path / "b.nii")), wvr.read(tmp_path / "b.nii").numpy(), atol=1e-4)


@pytest.mark.parametrize(
    ("store", "options", "named"),
    [
        ("nowhere.zarr", {}, "nowhere.zarr"),
        (3, {}, "store"),
        (np.zeros((4, 4)), {}, "axes"),
        (np.zeros((4, 4, 4), complex), {}, "complex"),
        (np.zeros((4, 4, 4)), {"level": 1}, "level"),
        (np.zeros((4, 4, 4)), {"scalars": "a"}, "scalars"),
        (np.zeros((4, 4, 4)), {"spacing": (1, 0, 1)}, "spacing"),
        (np.zeros((4, 4, 4)), {"ranges": "nowhere.npz"}, "ranges"),
        (np.zeros((4, 4, 4)), {"offset": 4}, "offset is for raw files"),
    ],
)
def test_what_is_no_store_is_said(store, options, named):
    with pytest.raises((ValueError, TypeError, OSError), match=named):
        wvr.open(store, **options)


def test_what_a_store_has_no_use_for_is_refused(store, tmp_path):
    """It was without effect, and nobody told."""
    import h5py

    np.save(tmp_path / "a.npy", DATA)
    DATA.tofile(tmp_path / "a.raw")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = DATA
    raw = {"shape": DATA.shape, "dtype": DATA.dtype}
    for name, options in (
        ("a.npy", {"level": 1}),
        ("a.npy", {"scalars": "a"}),
        ("a.raw", raw | {"level": 1}),
        ("a.raw", raw | {"scalars": "a"}),
        ("a.h5", {"level": 1}),
        ("a.h5", raw),
        ("a.h5", {"offset": 3}),
        (store, {"scalars": "a"}),
        (store, raw),
        (store, {"offset": 3}),
    ):
        with pytest.raises(ValueError, match=r"(level|scalars|shape|offset) is for (pyramids|stores|raw)"):
            wvr.open(tmp_path / name, **options)
    with pytest.raises(TypeError, match=r"outptu: keywords of wvr\.open are for what it opens"):
        wvr.build_ranges(wvr.open(DATA), outptu="a.npz")
    with pytest.raises(ValueError, match="nan is for what becomes a volume, got 'transparent' for a Volume"):
        wvr.as_volume(WHOLE, nan="transparent")


def test_ranges_of_what_changed_are_not_those_of_a_file(tmp_path):
    """Of an array, which does not tell: what was said to have changed is read."""
    array = np.zeros((40, 40, 40), np.uint8)
    volume = wvr.build_ranges(wvr.open(array), tmp_path / "ranges.npz")
    assert volume.range == (0, 0)
    array[...] = 200
    volume.changed()
    assert wvr.build_ranges(volume, tmp_path / "ranges.npz").range == (200, 200)


def test_a_store_over_http(store):
    """By fsspec, from this machine; there is no file of ranges beside it, but one of ours."""
    pytest.importorskip("aiohttp")
    from functools import partial
    from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
    from threading import Thread

    wvr.build_ranges(store, store.parent / "own.npz")
    handler = partial(SimpleHTTPRequestHandler, directory=str(store.parent))
    handler.func.log_message = lambda *_: None
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        url = f"http://127.0.0.1:{server.server_port}/a.zarr"
        volume = opened(url, ranges=store.parent / "own.npz")
        assert volume.ranges.known.all()
        assert_within(wvr.render(volume, TF, CAMERAS["inside"], SIZE, tolerance=TOLERANCE), CAMERAS["inside"])
        shutil.rmtree(store)
    finally:
        server.shutdown()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"spacing": (1e-150, 1, 1e-45)}, "spacing must be from"),
        ({"spacing": (1, 0, 1)}, "spacing must be > 0"),
        ({"origin": (-1e300, 0, 0)}, "origin must be within"),
    ],
)
def test_what_is_refused_of_volumes_is_of_stores(given, message):
    array = np.zeros((4, 4, 4), np.uint8)
    for make in (wvr.Volume, wvr.open):
        with pytest.raises(ValueError, match=message):
            make(array, **given)


@pytest.mark.parametrize("gone", [False, True], ids=["left out", "missing"])
def test_doubts_at_outer_faces_are_those_of_the_whole(gone, monkeypatch):
    """Rays in a face of the volume, of which rounding decides whether they are in it: bricks that are not read know no
    better than those that are.
    """
    monkeypatch.setattr(stored, "ALONG", 4)
    field = np.random.default_rng(0).integers(170, 200 if gone else 171, (9, 9, 9)).astype(np.uint8)
    tf = wvr.TransferFunction([(0, "white", 0.0), (255, "white", 0.9)])
    doubtful = lost = 0
    for seed in range(8):
        rng = np.random.default_rng([seed, 5])
        direction, origin = np.linalg.qr(rng.normal(size=(3, 3)))[0], 10 * rng.normal(size=3)
        whole = wvr.Volume(field, (1, 1, 1), origin, direction)
        position = whole.index_to_world[:3, :3] @ [4, 0, 4] + whole.index_to_world[:3, 3]
        camera = wvr.Camera(position - 30 * direction[:, 0], position, direction[:, 2], parallel_scale=4)
        volume = wvr.build_ranges(stored.StoredVolume(wvr.open(field).samples, (1, 1, 1), origin, direction))
        if gone:
            volume.samples = dataclasses.replace(volume.samples, array=Gone(field))
        options = {"tolerance": 1e-4 if gone else 1e-2}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = wvr.render(whole, tf, camera, (5, 5), **options)
            image = wvr.render(volume, tf, camera, (5, 5), missing="bound", client=False, **options)
        lost += image.stats["bricks_missing"]
        unsure = expected.error_bound > 0.5
        doubtful += unsure.sum()
        assert np.all(image.error_bound[unsure] > 0.5)
    assert doubtful > 0 and (lost > 0) == gone


class Gone:
    """Samples that cannot be read any more."""

    def __init__(self, array):
        self.shape, self.dtype = array.shape, array.dtype

    def __getitem__(self, key):
        raise OSError("gone")


@pytest.mark.parametrize("given", [lambda block: block + 300.5, lambda block: block[:1]])
def test_arrays_that_are_not_what_they_say_are_refused(given):
    """Samples would be cut to the dtype that was said, or be of other places."""
    array = pytest.importorskip("dask.array")
    blocks = array.from_array(np.ones((6, 5, 4), np.uint8), chunks=(3, 5, 4))
    lying = blocks.map_blocks(given, dtype=np.uint8, meta=np.empty((0, 0, 0), np.uint8))
    with pytest.raises(OSError, match=r"says samples \(6, 5, 4\) of uint8, and has \("):
        wvr.open(lying).region(np.zeros(3, int), np.array([3, 4, 5]))
