"""Files that are read where they lie, when they are written anew: shown as they are now, or an error."""

from __future__ import annotations

import os
import pickle

import numpy as np
import pytest

import wvr
from wvr.bricks.mapped import FileMark

h5py = pytest.importorskip("h5py")
nibabel = pytest.importorskip("nibabel")

DATA = wvr.datasets.load("blobs", 20).numpy().copy()
TF = wvr.TransferFunction([(0, "navy", 0.0), (100, "green", 0.0), (255, "white", 0.6)])
SIZE = (12, 12)


def read_all(volume):
    return volume.samples.read(np.zeros(3, int), np.array(volume.dimensions) - 1)


def written(path, data):
    if path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["a"] = data
    elif path.suffix == ".nii":
        nibabel.save(nibabel.Nifti1Image(data.T, np.eye(4)), path)
    elif path.suffix == ".npy":
        np.save(path, data)
    else:
        data.tofile(path)


# HDF5 does not write over a file that the process has open.
@pytest.mark.parametrize(
    ("kind", "how"),
    [("h5", "replaced"), *((kind, how) for kind in ("nii", "npy", "raw") for how in ("in place", "replaced"))],
)
def test_a_file_that_is_written_anew_is_seen_anew(tmp_path, kind, how):
    path, other = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    options = {"shape": DATA.shape, "dtype": DATA.dtype} if kind == "raw" else {}
    written(path, DATA)
    volume = pickle.loads(pickle.dumps(wvr.open(path, **options)))
    renderer = wvr.Renderer(volume, TF)
    camera = wvr.Camera.fit(volume, (1, 1, 1))
    before = renderer.render(camera, SIZE)
    written(path if how == "in place" else other, 200 - DATA)
    if how == "replaced":
        other.replace(path)
    after, fresh = renderer.render(camera, SIZE), wvr.Renderer(wvr.open(path, **options), TF).render(camera, SIZE)
    assert np.array_equal(after.rgba, fresh.rgba) and not np.array_equal(before.rgba, fresh.rgba)


@pytest.mark.parametrize(
    ("kind", "said"), [("h5", "replaced"), ("nii", "cut short"), ("npy", "cut short"), ("raw", "cut short")]
)
def test_a_file_that_became_shorter_is_an_error(tmp_path, kind, said):
    path = tmp_path / f"a.{kind}"
    written(path, DATA)
    volume = wvr.open(path, **({"shape": DATA.shape, "dtype": DATA.dtype} if kind == "raw" else {}))
    assert np.array_equal(read_all(volume), DATA)
    written(tmp_path / f"b.{kind}", DATA[:8])
    (tmp_path / f"b.{kind}").replace(path)
    with pytest.raises(OSError, match=said):
        read_all(volume)


def test_a_file_with_another_header_is_an_error(tmp_path):
    for kind in ("nii", "npy"):
        path = tmp_path / f"a.{kind}"
        written(path, DATA)
        volume = wvr.open(path)
        written(path, DATA.view(np.int8))
        with pytest.raises(OSError, match="another header"):
            read_all(volume)


def test_marks_tell_sizes_apart(tmp_path):
    """Of files with one time, as copies are that keep it."""
    marks = []
    for size in (100, 200):
        (tmp_path / "a").write_bytes(bytes(size))
        os.utime(tmp_path / "a", ns=(10**18, 10**18))
        marks.append(FileMark(str(tmp_path / "a"))()(()))
    assert len(set(marks)) == 2 and all(len(mark) <= 16 for mark in marks)
