"""What is written when a process is killed, a disk is full or a folder is read-only: whole, or as it was before."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import tifffile
from PIL import Image as PillowImage

import wvr

from .helpers import mounted

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and signals")
resource = pytest.importorskip("resource")

RNG = np.random.default_rng(0)
IMAGES = [wvr.Image(RNG.random((n, n, 4)).astype(np.float32), np.zeros((n, n), np.int32)) for n in (8, 300)]
FRAMES = [RNG.integers(0, 255, (120, 120, 3), np.uint8) for _ in range(12)]
POINTS = [(k, (0.1, 0.2, k / 3), 0.5) for k in range(3000)]


def save_movie(path: Path, large: bool) -> None:
    wvr.save_movie(FRAMES if large else FRAMES[:1], path)


def save_image(path: Path, large: bool) -> None:
    IMAGES[large].save(path)


def save_comparison(path: Path, large: bool) -> None:
    image = IMAGES[large]
    wvr.compare(image, image.rgba * 0.5).save(path)


def save_function(path: Path, large: bool) -> None:
    wvr.TransferFunction(POINTS if large else POINTS[:2]).save(path)


SAVED = {
    "a.png": save_image,
    "a.jpg": save_image,
    "a.exr": save_image,
    "a.tif": save_image,
    "a.npy": save_image,
    "c.png": save_comparison,
    "f.json": save_function,
    "m.gif": save_movie,
    "folder": save_movie,
}
# Some, for what is the same for all.
FEW = ("a.png", "a.exr", "a.npy", "m.gif")


@pytest.fixture(params=SAVED)
def saving(request):
    """A name, and what writes a small or a large file of it."""
    return request.param, SAVED[request.param]


def whole(path: Path) -> bool:
    """Whether a file can be read to its end."""
    if path.is_dir():
        return len(list(path.iterdir())) in (1, len(FRAMES)) and all(map(whole, path.iterdir()))
    if path.suffix == ".npy":
        return np.load(path).ndim == 3
    if path.suffix == ".tif":
        return tifffile.imread(path).ndim == 3
    if path.suffix == ".json":
        return len(wvr.TransferFunction.load(path).knots) in (2, len(POINTS))
    if path.suffix == ".exr":
        import OpenEXR

        return OpenEXR.File(str(path)).channels()["RGBA"].pixels.ndim == 3
    with PillowImage.open(path) as image:
        image.load()
        return getattr(image, "n_frames", 1) in (1, len(FRAMES))


def in_child(work) -> int:
    """The process id of a child that does the work and exits; its code is 0 where that raises an OSError."""
    child = os.fork()
    if child:
        return child
    code = 3
    with contextlib.suppress(OSError):
        work()
        code = 1
    os._exit(0 if code == 3 else code)


def test_killed_while_it_writes(tmp_path, tmp_path_factory, saving):
    """At any time; the next that writes takes away what was left."""
    name, save = saving
    path = tmp_path / name
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    save(path, False)
    for pause in (0.0, 0.003, 0.01, 0.02, 0.04):

        def work():
            while True:
                if path.is_dir():
                    path.rename(mkdtemp(dir=elsewhere))  # folders are not written over
                save(path, True)

        child = in_child(work)
        time.sleep(pause)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert whole(path) if path.exists() else name == "folder"
        assert all(one.name == name or one.name.startswith(".wvr-") for one in tmp_path.iterdir())
    if path.is_dir():
        shutil.rmtree(path)
    save(path, False)
    assert os.listdir(tmp_path) == [name] and whole(path)


def check_nothing_new(folder: Path, name: str, save) -> None:
    """An error that names the file, and what was there before is as it was."""
    path = folder / name
    before = path.read_bytes() if path.is_file() else None
    if path.is_dir():
        path = folder / "other"
    with pytest.raises(OSError) as caught:
        save(path, True)
    assert str(path) in str(caught.value)
    assert path.name == "other" or (path.read_bytes() == before and whole(path))
    assert os.listdir(folder) == [name]


def test_full_disk(tmp_path, saving):
    name, save = saving
    with mounted(tmp_path / "disk", "size=80k") as disk:
        save(disk / name, False)
        check_nothing_new(disk, name, save)


@pytest.mark.parametrize("saving", FEW, indirect=True)
def test_a_limit_of_file_size(tmp_path, saving):
    """As a full disk, where no file system can be mounted."""
    name, save = saving
    save(tmp_path / name, False)

    def work():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        try:
            check_nothing_new(tmp_path, name, save)
        except BaseException:
            os._exit(1)
        os._exit(0)

    assert os.waitpid(in_child(work), 0)[1] == 0


@pytest.mark.parametrize("saving", FEW, indirect=True)
def test_read_only_folder(tmp_path, saving):
    name, save = saving
    with mounted(tmp_path / "disk", "size=80k") as disk:
        save(disk / name, False)
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        check_nothing_new(disk, name, save)


def test_a_full_disk_is_no_movie(tmp_path):
    """Of ffmpeg, which leaves what it has."""
    pytest.importorskip("imageio_ffmpeg")
    with mounted(tmp_path / "disk", "size=80k") as disk:
        save_movie(disk / "a.mp4", False)
        before = (disk / "a.mp4").read_bytes()
        with pytest.raises(OSError, match="ffmpeg wrote 0 of 12 frames"):
            save_movie(disk / "a.mp4", True)
        assert (disk / "a.mp4").read_bytes() == before and os.listdir(disk) == ["a.mp4"]
