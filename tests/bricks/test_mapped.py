"""Files that are read where they lie, when they are written anew: shown as they are now, or an error."""

from __future__ import annotations

import os
import pickle
import shutil

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
        marks.append(str(FileMark(str(tmp_path / "a"))()([[range(1)]] * 3)[0, 0, 0]))
    assert len(set(marks)) == 2 and all(len(mark) <= 16 for mark in marks)


@pytest.mark.parametrize("version", [2, 3])
def test_a_zarr_store_that_became_another_is_an_error(tmp_path, version):
    """Chunks of another array are not taken for those that were; one that grows goes on."""
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "a.zarr"

    def create(shape, dtype="u1"):
        options = {"zarr_format": version, "overwrite": True}
        array = zarr.create_array(path, shape=shape, chunks=(1, 10, 10, 10), dtype=dtype, **options)
        array[:] = 120
        return array

    for shape, dtype in (((2, 10, 20, 20), "u1"), ((1, 20, 20, 20), "u1"), ((2, 20, 20, 20), "i1"), (None, None)):
        array = create((2, 20, 20, 20))
        renderer = wvr.Renderer(wvr.open(path, c=1), TF)
        camera = wvr.Camera.fit(renderer.volume, (1, 1, 1))
        before = renderer.render(camera, SIZE)
        array.resize((3, 20, 20, 20))
        array.attrs["more"] = 1
        assert np.array_equal(renderer.render(camera, SIZE).rgba, before.rgba)
        if shape is None:
            shutil.rmtree(path)
        else:
            create(shape, dtype)
        with pytest.raises(OSError, match=r"was replaced by another array, or is gone: open it anew"):
            renderer.render(camera, SIZE)
