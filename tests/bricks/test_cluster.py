"""Bricks that workers of a Dask cluster render: real processes, of which one is killed in the middle of an image."""

from __future__ import annotations

import os
import signal
from threading import Timer

import numpy as np
import pytest

import wvr
from wvr.bricks import stored

distributed = pytest.importorskip("distributed")
zarr = pytest.importorskip("zarr")

RNG = np.random.default_rng(3)
DATA = np.clip(wvr.datasets.load("blobs", 40).numpy() + RNG.normal(0, 6, (40, 40, 40)), 0, 255).astype(np.uint8)
WHOLE = wvr.Volume(DATA)
TF = wvr.TransferFunction([(0, "navy", 0.0), (100, "green", 0.0), (140, "gold", 0.1), (255, "white", 0.6)])
CAMERA = wvr.Camera.fit(WHOLE, (1, 0.6, 0.4))
SIZE = (20, 18)


@pytest.fixture(scope="module")
def volume(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "a.zarr"
    array = zarr.create_array(path, shape=DATA.shape, chunks=(8, 8, 8), dtype="u1")
    array[:] = DATA
    before, stored.ALONG = stored.ALONG, 8
    yield wvr.open(path)
    stored.ALONG = before


@pytest.fixture(scope="module")
def client():
    local = distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)
    with local as cluster, distributed.Client(cluster) as client:
        yield client


def test_workers_make_the_same_image(volume, client):
    exact = wvr.render(WHOLE, TF, CAMERA, SIZE, integrator=wvr.Exact())
    image = wvr.render(volume, TF, CAMERA, SIZE, tolerance=1 / 256, client=client)
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)
    assert image.error_bound.max() <= 1 / 256
    assert image.stats["workers"] == 2 and image.stats["tasks"] > 4 and image.stats["blocks_read"] > 0
    parts = wvr.render(volume, TF, CAMERA, SIZE, integrator=wvr.Exact(), client=client)
    np.testing.assert_allclose(parts.rgba, exact.rgba, atol=1e-11)


@pytest.mark.parametrize(
    "method", [wvr.Projection("max"), wvr.Projection("mean"), wvr.Isosurface([90.0, 140.0])], ids=repr
)
def test_what_rays_find_goes_on_from_worker_to_worker(volume, client, method):
    """To the last bit what one process finds, from outside and inside."""
    for camera in (CAMERA, wvr.Camera((18, 21, 12), (30, 28, 30), view_angle=80)):
        options = {"integrator": method, "lighting": False}
        alone = wvr.render(volume, TF, camera, SIZE, client=False, **options)
        image = wvr.render(volume, TF, camera, SIZE, client=client, **options)
        assert image.stats["workers"] == 2 and image.stats["tasks"] > 4
        np.testing.assert_array_equal(image.rgba, alone.rgba)
        if alone.values is not None:
            np.testing.assert_array_equal(image.values, alone.values)
        assert np.all(np.abs(image.error_bound - alone.error_bound) <= 1e-9)


def test_bounds_of_workers_hold_where_rays_ended(client, monkeypatch):
    """What is behind the end of a ray counts, also of bricks that no other ray meets: at the edge of a wall."""
    monkeypatch.setattr(stored, "ALONG", 8)
    data = np.full((16, 16, 64), 200, np.uint8)
    data[..., :8], data[..., 8:16] = 100, 0
    whole, volume = wvr.Volume(data), wvr.build_ranges(wvr.open(data))
    camera, options = wvr.Camera((-20, 7.5, 7.5), (0, 7.5, 7.5), (0, 1, 0), parallel_scale=9.3), {"size": (24, 24)}
    for opacity in (0.65, 0.7, 0.75):
        tf = wvr.TransferFunction([(0, "red", 0.0), (100, "red", opacity), (200, "white", 0.9)])
        exact = wvr.render(whole, tf, camera, integrator=wvr.Exact(), termination=0.0, **options)
        image = wvr.render(volume, tf, camera, tolerance=0.01, client=client, **options)
        assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound + 1e-12)


def test_an_active_client_is_found_as_dask_finds_it(volume, client):
    """Unless it is told not to, or cannot do what is asked for."""
    image = wvr.render(volume, TF, CAMERA, SIZE)
    assert image.stats["workers"] == 2
    for options in ({"client": False}, {"budget": 0}):
        assert "workers" not in wvr.render(volume, TF, CAMERA, SIZE, **options).stats
    assert "bricks" not in wvr.render(WHOLE, TF, CAMERA, SIZE, client=False).stats
    depth = np.full(SIZE[::-1], np.linalg.norm(CAMERA.position - WHOLE.corners.mean(axis=0)))
    exact = wvr.render(WHOLE, TF, CAMERA, SIZE, integrator=wvr.Exact(), depth=depth)
    image = wvr.render(volume, TF, CAMERA, SIZE, tolerance=1 / 256, depth=depth)
    assert image.stats["workers"] == 2
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)


def test_ranges_by_workers_are_the_same(volume, client, tmp_path):
    theirs = wvr.build_ranges(volume, tmp_path / "theirs.npz", client=client).ranges
    volume.ranges = None
    own = wvr.build_ranges(volume, tmp_path / "own.npz", client=False).ranges
    volume.ranges = None
    np.testing.assert_array_equal(theirs.values, own.values)


def test_a_worker_that_is_killed_changes_nothing(volume, client):
    """Not a bit of the image; kill -9 comes while tasks run."""
    image = wvr.render(volume, TF, CAMERA, (120, 100), tolerance=1 / 256, client=client)
    pids = list(client.run(os.getpid).values())
    timer = Timer(image.stats["seconds"] / 3, os.kill, (pids[0], signal.SIGKILL))
    timer.start()
    again = wvr.render(volume, TF, CAMERA, (120, 100), tolerance=1 / 256, client=client)
    timer.join()
    np.testing.assert_array_equal(again.rgba, image.rgba)
    np.testing.assert_array_equal(again.error_bound, image.error_bound)
    client.wait_for_workers(2)
    assert pids[0] not in client.run(os.getpid).values()


def test_errors_of_workers_are_told(volume, client, tmp_path):
    array = zarr.create_array(tmp_path / "b.zarr", shape=DATA.shape, chunks=(8, 8, 8), dtype="u1")
    array[:] = DATA
    damaged = wvr.open(tmp_path / "b.zarr")
    (tmp_path / "b.zarr" / array.metadata.encode_chunk_key((2, 2, 2))).write_bytes(b"damaged")
    with pytest.raises(OSError, match=r"x 16 to 23, y 16 to 23, z 16 to 23"):
        wvr.render(damaged, TF, CAMERA, SIZE, tolerance=1 / 256, client=client)
    image = wvr.render(damaged, TF, CAMERA, SIZE, tolerance=1 / 256, client=client, missing="bound")
    exact = wvr.render(WHOLE, TF, CAMERA, SIZE, integrator=wvr.Exact())
    assert image.stats["bricks_missing"] > 0
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)


@pytest.mark.parametrize(
    "options",
    [{"budget": 1.0}, {}, {"integrator": wvr.Projection("max"), "missing": "bound"}],
    ids=["budget", "in memory", "missing"],
)
def test_what_a_client_cannot_do_is_said(volume, client, options):
    with pytest.raises(ValueError, match="client"):
        wvr.render(volume if options else WHOLE, TF, CAMERA, SIZE, client=client, **options)
