"""``wvr ranges``, and ``wvr render`` of a store."""

from __future__ import annotations

import numpy as np
import pytest

import wvr
from wvr.cli.stores import Streaming, clients

zarr = pytest.importorskip("zarr")
DATA = wvr.datasets.load("blobs", 12).numpy()


@pytest.fixture
def store(run, tmp_path):
    array = zarr.create_array(tmp_path / "a.zarr", shape=(2, *DATA.shape), chunks=(1, 8, 8, 8), dtype="u1")
    array[1] = DATA
    return "a.zarr"


def test_ranges_are_written_beside_a_store(run, store, tmp_path):
    code, out, err = run("ranges", store, "--select", "c:1")
    assert (code, err) == (0, "")
    assert out == f"a.zarr.c1.ranges.npz: 1 blocks, samples from {DATA.min()} to {DATA.max()}\n"
    assert wvr.open(tmp_path / store, c=1).ranges is not None


def test_a_store_is_described_as_the_array_is(run, store):
    np.save("a.npy", DATA)
    (code, out, err), (_, expected, _) = run("info", store, "--select", "c:1"), run("info", "a.npy")
    assert (code, err) == (0, "") and out.splitlines()[1:] == expected.splitlines()[1:]


def test_a_store_is_rendered_with_what_is_given(run, store, rendered):
    run("ranges", store, "--select", "c:1")
    options = "--memory-limit", "1GiB", "--budget", "200MB", "--missing", "bound", "--select", "c:1"
    code, _, err = run("render", store, *options, "--tf", "0:black:0,255:white:0.5", "-o", "a.png")
    assert (code, err) == (0, "")
    assert rendered["volume"].stored and rendered["volume"].shape == DATA.shape
    passed = {name: rendered[name] for name in ("memory_limit", "budget", "missing")}
    assert passed == {"memory_limit": "1GiB", "budget": "200MB", "missing": "bound"}
    assert Streaming(budget="2.5").options(None) == {"budget": 2.5}


def test_a_store_becomes_an_image(run, store, tmp_path):
    run("ranges", store, "--select", "c:1")
    code, out, _ = run(
        "render", store, "--select", "c:1", "--tf", "0:black:0,255:white:0.5", "--size", "8x8", "-o", "a.npy"
    )
    assert code == 0 and "errors up to" in out
    whole = wvr.Volume(DATA)
    expected = np.load(tmp_path / "a.npy")
    assert expected[..., 3].max() > 0.5 and whole.shape == DATA.shape


@pytest.mark.parametrize(
    ("options", "keywords"),
    [
        ((), {}),
        (("--cmap", "viridis"), {"transfer_function": "viridis"}),
        (("--tf", "mri"), {"transfer_function": "mri"}),
        (("--cmap", "viridis", "--opacity", "linear"), {"transfer_function": "viridis", "opacity": "linear"}),
        (("--projection", "max"), {"integrator": wvr.Projection("max")}),
        (("--isosurface", "130"), {"integrator": wvr.Isosurface([130])}),
    ],
    ids=str,
)
def test_a_store_looks_as_from_python(run, store, tmp_path, options, keywords):
    """What is suggested by its samples, colours over those and not over what the dtype holds, light, the frame."""
    code, _, err = run("render", store, "--select", "c:1", "--size", "8x6", "-o", "a.npy", *options)
    assert (code, err) == (0, "")
    expected = wvr.render(wvr.open(tmp_path / store, c=1), size=(8, 6), **keywords)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected.rgba)
    assert expected.rgba[..., 3].max() > 0.1


def test_a_store_is_read_as_is_said(run, rendered, tmp_path):
    """Which of its arrays, and how far apart its samples are."""
    group = zarr.create_group(tmp_path / "two.zarr")
    for name, add in (("a", 0), ("b", 1)):
        group.create_array(name, data=DATA // 2 + np.uint8(add), chunks=(8, 8, 8))
    code, _, err = run("render", "two.zarr", "--scalars", "b", "--spacing", "1,1,2", "--tf", "0:black:0,255:white:0.5")
    assert (code, err) == (0, "")
    assert rendered["volume"].spacing.tolist() == [1, 1, 2]
    assert np.array_equal(rendered["volume"].loaded().numpy(), DATA // 2 + 1)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--frame", "1"), "--frame is for what is read as a whole, 'a.zarr'"),
        (("--dataset-size", "9"), "--dataset-size is for what is read as a whole"),
        (("--select", "c"), "--select"),
        (("--select", "c:7"), "c must be an index"),
        (("--level", "1"), "level"),
        ((), "select one, --select c:0"),
        (("--select", "c:0", "--cmap", "viridis"), "at least two different finite samples"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "--workers or --scheduler"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(run, store, options, named):
    code, out, err = run("render", store, *options)
    assert (code, out) == (2, "") and named in err and err.count("\n") == 1


def test_a_dataset_has_no_levels(run):
    code, _, err = run("render", "blobs", "--level", "1")
    assert code == 2 and "--level" in err


def test_without_workers_there_is_no_client():
    with clients(None, None) as client:
        assert client is None


def test_a_movie_of_a_store(run, store, tmp_path):
    options = "--select", "c:1", "--memory-limit", "1GiB", "--frames", "2", "--size", "8x8"
    code, out, err = run("orbit", store, *options, "--tf", "0:black:0,255:white:0.5", "-o", "a.gif")
    assert (code, err) == (0, "") and out.startswith("a.gif: 2 images") and (tmp_path / "a.gif").stat().st_size > 0


def test_a_store_is_viewed_from_memory(run, store, monkeypatch):
    seen = []

    def view(volumes, **_):
        seen.extend(volumes)
        raise ValueError("that is enough")

    monkeypatch.setattr("wvr.view", view)
    assert run("view", store, "--select", "c:1", "--no-open-browser")[0] == 2
    (volume,) = seen
    assert not volume.stored and np.array_equal(volume.numpy(), DATA)
    monkeypatch.setattr("wvr.bricks.stored.free_host_memory", lambda: 1.0)
    assert "take a coarser level" in run("view", store, "--select", "c:1", "--no-open-browser")[2]
