"""Stores that are damaged: what is wrong names them, and nothing is made up."""

from __future__ import annotations

import json

import numpy as np
import pytest

import wvr

zarr, numcodecs = pytest.importorskip("zarr"), pytest.importorskip("numcodecs")
FIELD = np.arange(60, dtype=np.int16).reshape(4, 3, 5)


def whole(path) -> np.ndarray:
    volume = wvr.open(path)
    return volume.region(np.zeros(3, np.int64), np.array(volume.shape[::-1], np.int64) - 1)


def made(path, version: int, sharded: bool = False):
    from zarr.codecs import BloscCodec

    packed = {"compressors": BloscCodec(cname="lz4") if version == 3 else numcodecs.Blosc()}
    shards = {"shards": (4, 4, 6)} if sharded else {}
    array = zarr.create_array(
        path, shape=FIELD.shape, chunks=(2, 2, 2), dtype="i2", zarr_format=version, **packed, **shards
    )
    array[:] = FIELD


@pytest.mark.parametrize("version, chunk", [(2, "0.0.0"), (3, "c/0/0/0")])
@pytest.mark.parametrize("cut", [1, 8, 20])
def test_a_chunk_of_blosc_that_was_cut_off(tmp_path, version, chunk, cut):
    """Blosc itself returns what follows in memory."""
    made(path := tmp_path / "a.zarr", version)
    assert np.array_equal(whole(path), FIELD)
    content = (path / chunk).read_bytes()
    (path / chunk).write_bytes(content[:-cut])
    with pytest.raises(OSError, match=r"a\.zarr: the samples at x 0 to 4.*says that it has"):
        whole(path)


def test_a_chunk_of_blosc_in_a_shard(tmp_path):
    made(path := tmp_path / "a.zarr", 3, sharded=True)
    assert np.array_equal(whole(path), FIELD)
    content = bytearray((path / "c/0/0/0").read_bytes())
    content[12] += 4  # of the length that the first chunk's header says
    (path / "c/0/0/0").write_bytes(content)
    with pytest.raises(OSError, match=r"a\.zarr: the samples at x 0 to 4.*says that it has"):
        whole(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text[:-20],
        lambda text: "\udcff" + text,
        lambda text: text.replace('"<i2"', '"<i-2147483648"'),
        lambda text: text.replace('"chunks"', '"level"'),
    ],
    ids=["cut off", "no text", "dtype", "field"],
)
def test_metadata_that_are_none(tmp_path, change):
    made(path := tmp_path / "a.zarr", 2)
    file = path / ".zarray"
    file.write_text(change(file.read_text()), errors="surrogateescape")
    with pytest.raises(OSError, match=r"a\.zarr' is no sound zarr store"):
        wvr.open(path)


def test_more_chunks_than_can_be(tmp_path):
    made(path := tmp_path / "a.zarr", 2)
    file = path / ".zarray"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"shape": [2**40, 3, 5]}))
    with pytest.raises(ValueError, match=r"a\.zarr has 549,755,813,888 chunks along axis 0"):
        wvr.open(path)
