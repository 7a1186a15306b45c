"""What was freed is given back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import numpy as np
import pytest

import wvr
from wvr import memory
from wvr.bricks import blocks

# In a process of its own: in one that has long been at work arrays lie in what others have freed.
GIVEN_BACK = """
import numpy as np
from pathlib import Path
from wvr.memory import give_back

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

arrays = [np.ones(size, np.uint8) for _ in range(1000) for size in (100_000, 2_000)]
small = arrays[1::2]
del arrays
before = resident()
give_back()
print(before - resident())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other systems give back by themselves")
def test_what_is_free_among_arrays_that_stay_is_given_back():
    run = subprocess.run([sys.executable, "-c", GIVEN_BACK], capture_output=True, text=True, check=True)
    assert float(run.stdout) > 60  # MiB


def test_blocks_that_stream_by_are_given_back(monkeypatch):
    """Every so many bytes."""
    called = []
    monkeypatch.setattr(blocks, "FREED", 100_000)
    monkeypatch.setattr(blocks, "give_back", lambda: called.append(None))
    volume = wvr.build_ranges(wvr.open(np.random.default_rng(0).integers(1, 255, (70, 70, 140), dtype=np.uint8)))
    image = wvr.render(volume, [(0, "red", 0.0), (255, "white", 0.01)], "iso", (20, 20))
    assert 0 < len(called) <= image.stats["blocks_read"]


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (lambda scene, size: wvr.render(wvr.Volume(scene[0]), *scene[1:], size), "data and image"),
        (lambda scene, size: wvr.render(wvr.Volume(scene[0]), *scene[1:], size, memory_limit="1 GiB"), "images of br"),
        (lambda scene, size: wvr.render(wvr.open(scene[0]), *scene[1:], size, client=False), "images of bricks"),
        (lambda scene, size: wvr.single_scattering(wvr.Volume(scene[0]), *scene[1:], size), "data and image"),
        (lambda scene, size: scene[2].rays(size), "rays of 40000 x 40000 pixels"),
    ],
)
def test_images_that_do_not_fit_are_refused_before_any_memory_is_taken(call, what, monkeypatch):
    samples = np.zeros((4, 4, 4), np.uint8)
    tf = wvr.TransferFunction([(0, "red", 0.0), (255, "white", 0.01)])
    scene = samples, tf, wvr.Camera.fit(wvr.Volume(samples))
    monkeypatch.setattr(memory, "free_host_memory", lambda: 2.0**30)
    with pytest.raises(MemoryError, match=rf"^{what}.* need .* GiB on cpu, which has 1\.0 GiB free: take a smaller"):
        call(scene, (40000, 40000))
