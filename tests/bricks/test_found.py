"""Projections, isosurfaces and places along rays, in bricks and of what was not read: those of the whole."""

from __future__ import annotations

from threading import Event
from time import sleep

import numpy as np
import pytest

import wvr
from wvr.bricks import reading, rest, stored, streamed
from wvr.bricks.allowance import Allowance
from wvr.bricks.frame import BrickedFrame
from wvr.bricks.grid import Bricks
from wvr.frame import view

from .test_bricks import CAMERAS, RNG, SIZE, TF, VOLUME

SPAN = wvr.TransferFunction([(-1e9, "black", 1.0), (1e9, "white", 1.0)])
# Whole numbers, of which one is the level, so that surfaces are in faces of bricks as well.
SURFACES = wvr.Isosurface([90.0, 140.0])


def assert_same(image: wvr.Image, whole: wvr.Image) -> None:
    """As near to each other as their bounds say."""
    one, other = (image.rgba, whole.rgba) if whole.values is None else (image.values, whole.values)
    assert np.array_equal(np.isnan(one), np.isnan(other))
    apart = np.abs(one - other).reshape(*SIZE[::-1], -1).max(axis=2)
    assert np.all((apart <= image.error_bound + whole.error_bound) | np.isnan(apart)), np.nanmax(apart)


@pytest.fixture
def split(monkeypatch):
    """Renders in bricks of so many cells along x, y, z."""

    def render(cells, *scene, **options):
        cut = Bricks.regular(VOLUME.dimensions, cells)
        monkeypatch.setattr(BrickedFrame, "bricks", lambda self: cut)
        return wvr.render(VOLUME, *scene, SIZE, memory_limit="1 GiB", **options)

    return render


@pytest.mark.parametrize("what", ["max", "mean"])
def test_projections_in_bricks_are_the_whole(split, what):
    """From outside, inside and along faces of bricks; with a bound as small."""
    method = wvr.Projection(what)
    for camera in CAMERAS.values():
        whole = wvr.render(VOLUME, SPAN, camera, SIZE, integrator=method)
        image = split((6, 6, 6), SPAN, camera, integrator=method)
        assert_same(image, whole)
        assert image.error_bound.max() < 1e-6
        if camera is CAMERAS["outside"] and method.seeks:
            np.testing.assert_allclose(image.depth(), whole.depth(), atol=1e-9)


def test_rays_that_are_across_an_axis_but_for_next_to_nothing(split):
    """One over a direction of 1e-312 is infinite, and rays in a face went on without end."""
    x, _, z = VOLUME.corners.mean(axis=0)
    position, target = np.array([x, 0.0, z + 100.0]), np.array([x, 0.0, z - 100.0])
    across = wvr.Camera(position, target, (1, 0, 0), parallel_scale=10.0)
    nearly = wvr.Camera(position, target - [0, 1e-311, 0], (1, 0, 0), parallel_scale=10.0)
    ways = [np.array(view(VOLUME, camera, *SIZE).way) for camera in (across, nearly)]
    assert np.array_equal(*ways)
    for method in (wvr.Projection("max"), wvr.Projection("sum"), SURFACES, wvr.Exact()):
        options = {"integrator": method, "lighting": None}
        image, same = (split((6, 6, 6), TF, camera, **options) for camera in (nearly, across))
        np.testing.assert_array_equal(image.rgba, same.rgba)
        assert image.rgba.any()


def test_surfaces_go_on_from_brick_to_brick(split):
    """One that a ray crosses in a face is seen once, and surely."""
    for name, camera in CAMERAS.items():
        whole = wvr.render(VOLUME, TF, camera, SIZE, integrator=SURFACES, lighting=False)
        image = split((6, 6, 6), TF, camera, integrator=SURFACES, lighting=False)
        assert_same(image, whole)
        if not name.startswith("from a face"):
            assert np.array_equal(image.rgba, whole.rgba) and image.error_bound.max() < 1e-6
    # Along the axes rays meet samples, some of which are at a level, in faces of bricks too.
    flat = wvr.Volume(np.repeat(np.arange(12, dtype=np.uint8), 81).reshape(12, 9, 9))
    camera = wvr.Camera((4, 4, 50), (4, 4, 0), up=(0, 1, 0), parallel_scale=3.1)
    tf = wvr.TransferFunction([(0, "red", 0.5), (12, "blue", 0.5)])
    levels = wvr.Isosurface([3, 4, 6, 8])
    whole = wvr.render(flat, tf, camera, (7, 7), integrator=levels, lighting=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BrickedFrame, "bricks", lambda self: Bricks.regular(flat.dimensions, (4, 4, 4)))
        image = wvr.render(flat, tf, camera, (7, 7), integrator=levels, lighting=False, memory_limit="1 GiB")
    assert np.array_equal(image.rgba, whole.rgba) and image.rgba[3, 3, 3] == pytest.approx(1 - 0.5**4, abs=1e-6)
    assert image.error_bound.max() < 1e-6


def test_where_rays_have_an_opacity(split):
    """And what is picked, of a pixel alone."""
    for name in ("outside", "inside"):
        whole = wvr.render(VOLUME, TF, CAMERAS[name], SIZE)
        image = split((6, 6, 6), TF, CAMERAS[name])
        np.testing.assert_allclose(image.depth(0.3), whole.depth(0.3), atol=1e-9)
        one, other = image.pick(6, 5), whole.pick(6, 5)
        # Of images that are within their tolerance.
        np.testing.assert_allclose(one.position, other.position, atol=0.05)
        assert one.value == pytest.approx(other.value, rel=0.05)


DATA = np.clip(wvr.datasets.load("blobs", 40).numpy() + RNG.normal(0, 6, (40, 40, 40)), 0, 255).astype(np.uint8)
WHOLE = wvr.Volume(DATA, (1.0, 1.1, 0.9))
VIEWS = (wvr.Camera.fit(WHOLE, (1, 0.6, 0.4)), wvr.Camera((18, 21, 12), (30, 28, 30), view_angle=80))


@pytest.fixture
def known(monkeypatch):
    """Blocks of eight samples along an axis, and their ranges."""
    monkeypatch.setattr(stored, "ALONG", 8)
    return wvr.build_ranges(wvr.open(DATA, spacing=WHOLE.spacing))


def test_something_is_found_wherever_there_is_anything(known):
    """However far off the opacity of a pixel is of which nothing was read."""
    first, whole = (wvr.render(volume, TF, VIEWS[0], SIZE, **o) for volume, o in ((known, {"budget": 0}), (WHOLE, {})))
    own, true = first.rgba[..., 3], whole.rgba[..., 3]
    y, x = np.argwhere((true > 0.01) & (true < 0.49 * own))[0]
    found, sure = first.pick(x, y), whole.pick(x, y)
    np.testing.assert_allclose(found.position, sure.position, atol=0.1)
    assert found.opacity == own[y, x]


METHODS = [*map(wvr.Projection, ("max", "min", "mean", "sum")), SURFACES]


@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("budget", [None, 0, "3 kB"])
def test_what_is_not_read_is_in_the_bound(known, method, budget):
    options = {} if budget is None else {"budget": budget}
    tf = TF if method is SURFACES else SPAN
    for camera in VIEWS:
        whole = wvr.render(WHOLE, tf, camera, SIZE, integrator=method, lighting=False)
        image = wvr.render(known, tf, camera, SIZE, integrator=method, lighting=False, **options)
        assert_same(image, whole)
        if method is SURFACES and budget is not None:
            assert image.error_bound.max() == pytest.approx(1) and image.stats["bricks_unread"] > 0
        elif budget == 0:
            longest = 80 if method.what == "sum" else 1
            assert image.stats["bytes_read"] == 0 and 1 < image.error_bound.max() < 128 * longest
        elif budget == "3 kB":
            assert image.stats["bytes_read"] < 3000 + 8 * 512 and image.stats["bricks_unread"] > 0
        else:
            assert image.error_bound.max() < 1e-6 and image.stats["bricks_unread"] == 0


@pytest.mark.parametrize("method", METHODS[1:], ids=repr)
def test_what_is_read_for_so_many_bytes_is_of_no_timing(known, monkeypatch, method):
    """Whether reading takes longer than rendering, or the other way round."""
    images = []
    for slow, name in ((stored.StoredVolume, "region"), (streamed.Streamed, "cast")):
        with monkeypatch.context() as patch:
            patch.setattr(slow, name, later(getattr(slow, name)))
            tf = TF if method is SURFACES else SPAN
            images.append(wvr.render(known, tf, VIEWS[0], SIZE, integrator=method, lighting=False, budget="3 kB"))
    one, other = images
    assert np.array_equal(one.rgba, other.rgba) and np.array_equal(one.error_bound, other.error_bound)
    for name in ("bricks_rendered", "bricks_unread", "blocks_read", "blocks_read_again", "bytes_read"):
        assert one.stats[name] == other.stats[name]
    assert one.stats["bricks_rendered"] >= 2


def later(function):
    """It, after a while."""

    def slow(*arguments, **options):
        sleep(3e-3)
        return function(*arguments, **options)

    return slow


@pytest.mark.parametrize(("seed", "method"), [(3, wvr.Projection("min")), (50, wvr.Certified(1e-3))], ids=repr)
def test_what_stands_for_blocks_that_are_not_read_is_not_seen_in_edges(monkeypatch, seed, method):
    """Of a layer that no ray meets samples are others than those of its edges, which rays meet and see nothing in."""
    monkeypatch.setattr(stored, "ALONG", 2)
    rng = np.random.default_rng(seed)
    z, y, x = np.indices((13, 12, 12))
    a, b, c = rng.uniform(0.2, 1.2, 3)
    data = np.rint(255 * (np.sin(x * a + 1) + np.cos(y * b) * np.sin(z * c) + 2) / 4).astype(np.uint8)
    spacing = 10 ** rng.uniform(-1, 1, 3)
    camera = wvr.Camera(*(rng.uniform(0, 11, 3) * spacing for _ in range(2)), view_angle=90)
    volumes = wvr.Volume(data, spacing), wvr.build_ranges(wvr.open(data.copy(), spacing=spacing))
    tf = [(0, "white", 0.9), (64, "white", 0.5), (64, "white", 0.0), (255, "white", 0.0)]
    whole, image = (wvr.render(v, tf, camera, (24, 24), integrator=method, lighting=False) for v in volumes)
    one, other = (i.rgba if i.values is None else i.values[..., None] for i in (image, whole))
    apart = np.abs(one.astype(float) - other).max(axis=2)
    assert np.all(apart <= image.error_bound.astype(float) + whole.error_bound)


def test_only_bricks_that_may_have_more_are_read(known, monkeypatch):
    """No block is read whose samples, and those beside it, are all below what each ray finds."""
    camera = wvr.Camera((19.5, 21.45, -60), (19.5, 21.45, 0), up=(0, 1, 0), parallel_scale=21.0)
    image = wvr.render(known, SPAN, camera, (40, 40), integrator=wvr.Projection("max"))
    # Rays along z: columns of blocks, and the least that any of their rays finds.
    found = wvr.render(WHOLE, SPAN, camera, (40, 40), integrator=wvr.Projection("max")).values
    least = np.nanmin(found)
    tops = DATA.reshape(5, 8, 5, 8, 5, 8).max(axis=(1, 3, 5))
    assert image.stats["blocks_read"] < 125 and image.stats["blocks_read"] <= (tops > least).sum()
    # Of blocks that there is no room for the layers are left.
    monkeypatch.setattr(reading, "LEAST", 1)
    method = wvr.Projection("max")
    little = wvr.render(known, SPAN, camera, (40, 40), integrator=method, memory_limit="12 kB")
    np.testing.assert_array_equal(little.values, image.values)
    assert little.stats["blocks_read_again"] > 0


@pytest.mark.parametrize("method", [wvr.Projection("mean"), SURFACES], ids=repr)
def test_others_of_a_store(known, method):
    """What no ray asks for is not read; light looks at neighbours."""
    for camera in VIEWS:
        whole = wvr.render(WHOLE, TF, camera, SIZE, integrator=method)
        image = wvr.render(known, TF, camera, SIZE, integrator=method)
        assert_same(image, whole)
        if whole.values is None:
            np.testing.assert_allclose(image.rgba, whole.rgba, atol=1e-6)
    assert image.stats["blocks_read"] < 125


def test_a_block_that_cannot_be_read_is_in_the_bound(known):
    class Broken:
        shape, dtype = DATA.shape, DATA.dtype

        def __getitem__(self, key):
            if all(part.start < 24 and part.stop > 16 for part in key):
                raise OSError("gone")
            return DATA[key]

    volume = known.at(array=Broken())
    volume.ranges = known.ranges
    with pytest.raises(OSError, match="gone"):
        wvr.render(volume, SPAN, VIEWS[0], SIZE, integrator=wvr.Projection("max"))
    for method in (wvr.Projection("max"), wvr.Projection("mean"), SURFACES):
        options = {"integrator": method, "lighting": False}
        image = wvr.render(volume, TF, VIEWS[0], SIZE, missing="bound", **options)
        assert image.stats["bricks_missing"] > 0 and image.error_bound.max() > 0.5
        assert_same(image, wvr.render(WHOLE, TF, VIEWS[0], SIZE, **options))


@pytest.mark.parametrize("what", ["mean", "sum"])
def test_of_what_may_be_cut_away_nobody_knows_how_much_was_not_read(known, monkeypatch, what):
    """It may be all or none."""
    states, settle = [], rest.Rest.settle

    def settled(self, numbers, found):
        states.append(found.numpy().copy())
        settle(self, numbers, found)

    monkeypatch.setattr(rest.Rest, "settle", settled)
    monkeypatch.setattr(rest.Rest, "partly", True)
    options = {"integrator": wvr.Projection(what)}
    whole = wvr.render(WHOLE, SPAN, VIEWS[0], SIZE, **options)
    image = wvr.render(known, SPAN, VIEWS[0], SIZE, budget="20 kB", **options)
    (read,) = states
    there = (read["length"] > 0) & (image.error_bound > 1e-3)
    none = read["value"] * (0.9 if what == "sum" else 1 / np.where(there, read["length"], 1.0))
    assert there.sum() > 20 and np.all(np.isfinite(image.error_bound[there]))
    for value in (whole.values, none):
        assert np.all(np.abs(image.values - value)[there] <= image.error_bound[there] + 1e-6)


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": wvr.Exact(), "budget": 1.0},
        {"integrator": wvr.Riemann(1.0), "missing": "bound"},
    ],
    ids=["a budget", "missing"],
)
def test_what_has_no_bound_for_what_is_not_read_says_so(known, options):
    with pytest.raises(ValueError, match="needs an integrator with a bound on what is not read"):
        wvr.render(known, SPAN, VIEWS[0], SIZE, **options)


class Clock:
    """Seconds that go by with what is done alone."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("method", [wvr.Certified(1 / 256), wvr.Projection("max"), wvr.Projection("mean")], ids=repr)
@pytest.mark.parametrize("slower", [1.0, 5.0])
def test_a_budget_of_seconds_is_kept(known, monkeypatch, method, slower):
    """By what reads took so far, also on a machine that others slow down meanwhile: by no more than that costs one."""
    clock, took = Clock(), 0.1
    region = stored.StoredVolume.region
    reads = []

    def read(self, low, high):
        reads.append(took * (slower if len(reads) >= 3 else 1.0))
        clock.now += reads[-1]
        return region(self, low, high)

    monkeypatch.setattr(stored.StoredVolume, "region", read)
    monkeypatch.setattr(streamed, "Allowance", lambda reading: Allowance(reading, clock))
    image = wvr.render(known, TF, VIEWS[0], SIZE, integrator=method, budget=3.0)
    assert 3 < len(reads) < 40 and image.error_bound.max() > 1 / 256
    # A brick is of up to eight blocks, one that is read ahead besides.
    assert clock.now <= 3.0 + 9 * max(reads)


def test_what_is_not_read_in_time_is_not_waited_for(known, monkeypatch):
    there = Event()
    monkeypatch.setattr(stored.StoredVolume, "region", lambda *_: there.wait(60) and None)
    try:
        for method in (wvr.Certified(1 / 256), wvr.Projection("max"), SURFACES):
            image = wvr.render(known, TF, VIEWS[0], SIZE, integrator=method, budget=0.2)
            assert image.stats["blocks_read"] == 0 and image.stats["bricks_unread"] > 0
    finally:
        there.set()
