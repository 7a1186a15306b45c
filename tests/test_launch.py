"""Threads and devices: settings, what is refused, and that strips cover all items once."""

import itertools
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import wvr
from wvr.launch import get_device, launch, launch_in_turn

CPU = get_device("cpu")
ROOT = Path(__file__).parents[1]


@wp.kernel(enable_backward=False)
def count(base: int, out: wp.array(dtype=int)):
    i = wp.tid() + base
    out[i] = out[i] + i + 1


@pytest.mark.parametrize("items", [0, 1, 2, 31, 1000, 4097])
@pytest.mark.parametrize("grain", [1, 7, 256])
def test_every_item_once(device, items, grain, threads):
    for n in (1, 2, 5):
        threads(n)
        out = wp.zeros(items, dtype=int, device=device)
        launch(count, items, [out], get_device(device), grain)
        np.testing.assert_array_equal(out.numpy(), np.arange(items) + 1)


def test_errors_in_strips_surface(threads):
    threads(2)
    with pytest.raises(Exception, match="count"):
        launch(count, 1000, [wp.zeros(1000, dtype=float, device="cpu")], get_device("cpu"))


@wp.kernel(enable_backward=False)
def neighbours(base: int, factor: float, source: int, state: wp.array2d(dtype=float)):
    i = wp.tid() + base
    last = state.shape[1] - 1
    near = state[source, wp.max(i - 1, 0)] + state[source, wp.min(i + 1, last)]
    state[1 - source, i] = factor * (state[source, i] + near)


@pytest.mark.parametrize("near", [None, 1])
@pytest.mark.parametrize("items", [1, 2, 5, 1000])
def test_in_turn_waits_for_the_step_before(device, items, near, threads, monkeypatch):
    """Where it is of others, whichever thread is late: those next to an item are all that it asks for."""
    start = np.random.default_rng(5).random((2, items)).astype(np.float32)
    steps = [(0.3 + 0.01 * k, k % 2) for k in range(50)]
    expected = start[0].astype(float)
    for factor, _ in steps:
        padded = np.pad(expected, 1, mode="edge")
        expected = factor * (padded[:-2] + padded[1:-1] + padded[2:])
    launch_once, late = wp.Launch.launch, np.random.default_rng(6)

    def launch_late(command, *args):
        time.sleep(late.choice([0.0, 0.0, 0.0, 0.001]))
        launch_once(command, *args)

    monkeypatch.setattr(wp.Launch, "launch", launch_late)
    for n in (1, 2, 5):
        threads(n)
        state = wp.array(start, device=device)
        launch_in_turn(neighbours, items, steps, [state], get_device(device), near)
        np.testing.assert_allclose(state.numpy()[0], expected, rtol=1e-4)


def test_errors_of_a_step_surface(threads):
    """And leave no thread waiting for others."""
    threads(2)
    state = wp.zeros((2, 100), dtype=float, device="cpu")
    with pytest.raises(TypeError, match="real number"):
        launch_in_turn(neighbours, 100, [(1.0, 0), ("wide", 1), (1.0, 0)], [state], get_device("cpu"))


def test_an_error_in_one_thread_is_that_of_all(threads, monkeypatch):
    """Whichever it is in, and not that others waited for it in vain."""
    threads(3)
    launch_once = wp.Launch.launch
    calls = itertools.count()

    def fails(command, *args):
        if next(calls) == 7:
            raise OSError("no more")
        launch_once(command, *args)

    monkeypatch.setattr(wp.Launch, "launch", fails)
    for _ in range(20):
        calls = itertools.count()
        with pytest.raises(OSError, match="no more"):
            launch_in_turn(neighbours, 100, [(1.0, k % 2) for k in range(9)], [wp.zeros((2, 100), device="cpu")], CPU)


@pytest.mark.parametrize("n", [0, -1, 1.5, "many", None, True, float("nan")])
def test_refused_thread_counts(n):
    with pytest.raises(ValueError, match="n must be an integer >= 1, got"):
        wvr.set_num_threads(n)


def test_environment(monkeypatch):
    monkeypatch.setattr("wvr.launch._threads", None)
    monkeypatch.setenv("WVR_NUM_THREADS", "3")
    assert wvr.get_num_threads() == 3
    monkeypatch.setenv("WVR_NUM_THREADS", "x")
    with pytest.raises(ValueError, match="WVR_NUM_THREADS must be an integer >= 1, got 'x'"):
        wvr.get_num_threads()
    monkeypatch.delenv("WVR_NUM_THREADS")
    assert wvr.get_num_threads() >= 1


def test_devices():
    assert get_device("cpu").is_cpu and get_device(get_device("cpu")).is_cpu
    for wrong in ("cuda:99", "gpu", 3.5):
        with pytest.raises(ValueError, match=r"device must be one of .*'cpu'.*, got"):
            get_device(wrong)


def test_import_starts_and_prints_nothing():
    code = (
        "import wvr, warp, sys; assert warp._src.context.runtime is None;"
        "assert not {'vtk', 'pyvista', 'matplotlib'} & set(sys.modules)"
    )
    # In a checkout, which need not be installed.
    there = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [ROOT, *sys.path]))}
    run = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, text=True, env=there, cwd=ROOT)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


def test_kernels_compile_once_and_say_so(tmp_path):
    """A second process finds all of them, though it uses them in another order."""
    code = (
        "import logging, sys, numpy as np, wvr; logging.basicConfig(level='INFO', format='%(name)s: %(message)s');"
        "tf = wvr.TransferFunction([(0, 'red', 0), (1, 'red', 1)]); v = wvr.Volume(np.zeros((2, 2, 2)));"
        "methods = [wvr.Riemann(1.0), wvr.Preintegrated(1.0)];"
        "[wvr.render(v, tf, wvr.Camera.fit(v), (4, 4), integrator=m, device='cpu') for m in eval(sys.argv[1])]"
    )
    counts = []
    for order in ("methods", "methods[::-1]"):
        environment = {"WARP_CACHE_PATH": str(tmp_path), "PATH": ""}
        run = subprocess.run([sys.executable, "-c", code, order], capture_output=True, text=True, env=environment)
        assert run.returncode == 0 and run.stdout == "", run.stderr
        counts.append(run.stderr.count("wvr: compiling the kernel"))
    # Two of rays, two of tables, two of blocks: masks are for those that go cell by cell.
    assert counts == [6, 0]
