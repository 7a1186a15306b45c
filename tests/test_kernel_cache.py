"""Compiled kernels that are damaged or cannot be kept: right images, or an error that says so; the process lives on."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import warp as wp

import wvr
from wvr import kernel_cache, launch

from .helpers import mounted

# A process that squares 3, by a kernel as small as can be; with more arguments, has powers of it, by a kernel each.
SQUARE = """
import os, sys
import numpy as np, warp as wp
from wvr.launch import get_device, launch

@wp.kernel(module="unique")
def square(base: int, values: wp.array(dtype=float)):
    i = base + wp.tid()
    values[i] = values[i] * values[i]

@wp.kernel(module="unique")
def cube(base: int, values: wp.array(dtype=float)):
    i = base + wp.tid()
    values[i] = values[i] * values[i] * values[i]

@wp.kernel(module="unique")
def fourth(base: int, values: wp.array(dtype=float)):
    i = base + wp.tid()
    values[i] = values[i] * values[i] * values[i] * values[i]

if "full" in sys.argv:
    def full(*_):
        raise OSError(28, "No space left on device")
    os.posix_fallocate = full
device = get_device("cpu")
for kernel in (square, cube, fourth) if "more" in sys.argv else (square,):
    values = wp.array(np.array([3.0], np.float32), device=device)
    launch(kernel, 1, [values], device)
    print(values.numpy()[0])
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("script") / "square.py"
    path.write_text(SQUARE)
    return path


def run(script: Path, cache: Path, *arguments: str) -> subprocess.CompletedProcess:
    environment = os.environ | {"WARP_CACHE_PATH": str(cache), "PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.run(
        [sys.executable, script, *arguments], env=environment, capture_output=True, text=True, timeout=120
    )


def compiled(cache: Path, kernel: str, ending: str) -> Path:
    (found,) = (cache / wp.config.version).glob(f"wp_{kernel}_*/*{ending}")
    return found


def test_damaged_kernels_are_compiled_anew(script, tmp_path):
    """Of zeros, without records, and with a file in the folder's place: a kernel each."""
    powers = "9.0\n27.0\n81.0\n"
    assert run(script, tmp_path, "more").stdout == powers
    binaries = [compiled(tmp_path, kernel, ".o") for kernel in ("square", "cube", "fourth")]
    made = [binary.stat().st_mtime_ns for binary in binaries]
    assert run(script, tmp_path, "more").stdout == powers
    assert [binary.stat().st_mtime_ns for binary in binaries] == made  # not compiled again
    whole = [binary.read_bytes() for binary in binaries]
    square, cube, fourth = binaries
    square.write_bytes(whole[0][:100] + bytes(len(whole[0]) - 100))
    compiled(tmp_path, "cube", ".meta").write_bytes(b"\xff{")
    compiled(tmp_path, "cube", "seal.json").write_bytes(b"[\xfe")
    cube.write_bytes(whole[1][: len(whole[1]) // 2])
    shutil.rmtree(fourth.parent)
    fourth.parent.write_text("")
    result = run(script, tmp_path, "more")
    assert result.stdout == powers and result.returncode == 0, result.stderr
    assert [len(binary.read_bytes()) for binary in binaries] == [len(bytes_) for bytes_ in whole]


def test_kernels_that_cannot_be_kept_are_compiled_elsewhere(script, tmp_path):
    (tmp_path / "file").write_text("")
    result = run(script, tmp_path / "file" / "below")
    assert result.stdout == "9.0\n"
    assert "kernels cannot be kept in" in result.stderr and "WARP_CACHE_PATH" in result.stderr


def test_a_process_that_is_killed_while_it_compiles(script, tmp_path):
    """What it leaves is not taken for a kernel."""
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[1])}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([sys.executable, script], env=environment, **quiet)
    end = time.monotonic() + 60
    while not list(tmp_path.glob("*/*wp_*")) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert run(script, tmp_path).stdout == "9.0\n"


def test_a_full_disk(script, tmp_path, monkeypatch):
    """Kernels go elsewhere; where there is no room either, that is an error."""
    with mounted(tmp_path / "disk", "size=200k") as disk:
        result = run(script, disk)
        assert result.stdout == "9.0\n" and "kernels cannot be kept in" in result.stderr
        monkeypatch.setenv("TMPDIR", str(disk))
        result = run(script, disk)
    assert result.returncode == 1 and result.stdout == ""
    assert "OSError: kernels can be compiled neither into" in result.stderr and "No space left" in result.stderr


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="the system has no way to ask for space")
def test_no_space_for_kernels_is_an_error(script, tmp_path):
    result = run(script, tmp_path, "full")
    assert result.returncode == 1 and result.stdout == ""
    assert "OSError: kernels can be compiled neither into" in result.stderr and "No space left" in result.stderr


def test_only_rays_one_by_one_are_compiled_with_all_inlined(monkeypatch):
    """What is inlined more than LLVM itself would takes half as long again."""
    flags = {}

    def load(kernel, *arguments):
        whole(kernel, *arguments)
        flags[kernel.key.rpartition("__")[2]] = kernel.module.options["cpu_compiler_flags"]

    whole = kernel_cache.load
    monkeypatch.setattr(kernel_cache, "load", load)
    launch.load.cache_clear()
    volume = wvr.datasets.load("blobs", 16)
    for integrator in (wvr.Certified(0.01), wvr.Riemann(1.0)):
        wvr.render(volume, "viridis", size=(16, 16), integrator=integrator, lighting=False, device="cpu")
    inlined = {name for name, text in flags.items() if "-inline-threshold" in text}
    assert inlined == {"raycast"} and {"ranges", "kinds", "raycasts"} < set(flags)
