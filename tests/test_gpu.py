"""The command for a GPU, on the CPU: what fails is said and ends it with 1, what there is no time for is said, and the
record is whole whenever it ends.
"""

import json
import os
import time
from functools import partial

import numpy as np
import pytest

import wvr
from benchmarks import __main__ as benchmarks
from benchmarks.gpu import command, frames, parity
from benchmarks.gpu.day import FAILED, SKIPPED, Day, Part
from studies.base import cuda
from studies.base.scenes import Scene
from wvr.launch import get_device


def day(folder, seconds=60.0):
    return Day(get_device("cpu"), seconds, folder, quick=True)


def test_what_fails_is_said_and_the_rest_is_done(tmp_path):
    def work(_):
        yield "one", lambda: {"fine": 1.5}
        yield "two", lambda: 1 // 0
        yield "three", lambda: {FAILED: "off by 1"}
        yield "four", lambda: {"fine": 2}

    def none(_):
        raise OSError("no such thing")
        yield

    made = day(tmp_path)
    assert made.run([Part("Some", 0.5, work), Part("None", 0.5, none)]) == 3
    record = json.loads((tmp_path / "gpu-cpu.json").read_text())
    rows = {row["name"]: row for row in record["parts"]["Some"]}
    assert rows["one"] == {"name": "one", "fine": 1.5} and rows["four"] == {"name": "four", "fine": 2}
    assert "ZeroDivisionError" in rows["two"][FAILED] and record["parts"]["None"][0]["name"] == "all"
    page = (tmp_path / "gpu-cpu.md").read_text()
    assert "3 failed:" in page and "- Some, three: off by 1" in page and "| one | 1.5 |" in page


def test_what_there_is_no_time_for_is_said_and_no_failure(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("benchmarks.gpu.day.perf_counter", lambda: now[0])

    def work():
        now[0] += 150
        return {}

    def slow(_):
        for name in "abc":
            yield name, work

    made = Day(get_device("cpu"), 1000.0, tmp_path, quick=True, start=0.0)
    assert made.run([Part("Short", 0.1, slow), Part("Long", 0.9, slow)]) == 0
    assert [SKIPPED in row for row in made.rows["Short"]] == [False, True, True]
    assert not any(SKIPPED in row for row in made.rows["Long"])


def test_it_ends_in_time_with_what_there_is(tmp_path, monkeypatch):
    ended = []
    monkeypatch.setattr(os, "_exit", ended.append)

    def hangs(_):
        yield "fine", lambda: {"n": 1}
        yield "hangs", lambda: time.sleep(0.5) or {}

    Day(get_device("cpu"), 0.3, tmp_path).run([Part("A part", 1.0, hangs)])
    assert ended == [1]


def test_the_record_is_whole_while_something_is_done(tmp_path):
    made, seen = day(tmp_path), []

    def work(_):
        yield "one", lambda: {"n": 1}
        yield "two", lambda: seen.append(json.loads((tmp_path / "gpu-cpu.json").read_text())) or {}

    made.run([Part("A part", 1.0, work)])
    assert seen[0]["parts"]["A part"] == [{"name": "one", "n": 1}, {"name": "two", FAILED: "did not end"}]


def image(device, integrator, off=0.0, bound=None, **_):
    """As if of a device that is ``off``; that of the CPU, which is asked for by its name, is of zeros."""
    rgba = np.full((2, 2, 4), 0.0 if isinstance(device, str) else off, np.float32)
    bounds = None if bound is None else np.full((2, 2), bound, np.float32)
    values = rgba[..., 0].astype(np.float64) if isinstance(integrator, wvr.Projection) else None
    return wvr.Image(rgba, np.zeros((2, 2), np.int32), bounds, {}, values=values)


@pytest.mark.parametrize(
    ("integrator", "off", "bound", "said"),
    [
        (wvr.Riemann(0.5), 9e-6, None, None),
        (wvr.Riemann(0.5), 2e-5, None, "off the CPU"),
        (wvr.AdaptiveSimpson(1e-3), 1e-3, None, None),
        (wvr.AdaptiveSimpson(1e-3), 5e-3, None, "off the CPU"),
        (wvr.Certified(1e-3), 9e-4, 1e-3, None),
        (wvr.Certified(1e-3), 9e-4, 5e-4, "4 bounds broken"),
        (wvr.Certified(1e-3), 1.1e-3, 5e-4, "off the CPU by 0.0011, 0.001 allowed"),
        (wvr.Isosurface(1.0), 3e-6, 1e-6, "off the CPU by 3e-06, 2e-06 allowed"),
        (wvr.Projection("max"), 9e-6, 5e-6, None),
        (wvr.Projection("max"), 9e-6, 4e-6, "4 values differ by more than both bounds"),
    ],
)
def test_images_that_are_off_are_found(monkeypatch, integrator, off, bound, said):
    scene = partial(image, integrator=integrator, off=off, bound=bound, lighting=False)
    monkeypatch.setattr(cuda, "scenes", lambda *_: {"a scene": scene})
    row = parity.compared("a scene", get_device("cpu"))
    assert (said in row[FAILED]) if said else FAILED not in row


def test_a_scene_as_on_a_gpu_and_frames_of_it(tmp_path, blobs, smooth_tf):
    """The real thing, as small as can be: an image that is within its bound, and frames from several places."""
    row = parity.compared("certified smooth", "cpu", side=8, pixels=12)
    assert FAILED not in row and row["bounds broken"] == 0 and row["off exact"] < row["largest bound"]
    scene = Scene("one", blobs, smooth_tf, wvr.Camera.fit(blobs), (8, 8))
    row = frames.of_wvr(day(tmp_path), scene, {"frame [ms]": 1.0}, integrator=wvr.Riemann(0.5))
    assert row["frames"] >= frames.LEAST and row["frame [ms]"] == row["× VTK"] >= row["rays [ms]"]
    places = np.array([camera.position for camera in frames.around(scene)])
    assert len(np.unique(places.round(6), axis=0)) == frames.STEPS
    np.testing.assert_allclose(places[0], scene.camera.position)
    np.testing.assert_allclose(
        np.linalg.norm(places - scene.camera.target, axis=1), np.linalg.norm(places[0] - scene.camera.target)
    )


@pytest.mark.parametrize("row", [{}, {FAILED: "wrong"}])
def test_the_exit_code_says_whether_anything_failed(tmp_path, monkeypatch, row):
    monkeypatch.setattr(command, "PARTS", (Part("A part", 1.0, lambda _: iter([("one", lambda: row)])),))
    with pytest.raises(SystemExit) as ended:
        benchmarks.app(["gpu", "--device", "cpu", "--out", str(tmp_path)])
    assert ended.value.code == len(row)
