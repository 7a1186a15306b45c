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


def test_ranges_of_other_chunks_are_not_used(tmp_path):
    """Nothing else tells arrays of Dask apart."""
    da = pytest.importorskip("dask.array")
    field = np.zeros((4, 4, 200), np.uint8)
    field[:, :, 130:] = 200
    wvr.build_ranges(da.from_array(field, chunks=(4, 4, 128)), tmp_path / "a.npz")
    same = wvr.open(da.from_array(field, chunks=(4, 4, 128)), ranges=tmp_path / "a.npz")
    assert same.ranges is not None and same.ranges.known.all()
    other = wvr.open(da.from_array(field, chunks=(4, 4, 150)), ranges=tmp_path / "a.npz")
    assert other.blocks_along == same.blocks_along and other.ranges is None


def test_damaged_ranges_are_refused_by_name(tmp_path):
    np.save(tmp_path / "a.npy", FIELD)
    file = wvr.build_ranges(tmp_path / "a.npy").place
    content = file.read_bytes()
    for at in range(0, len(content), 97):
        file.write_bytes(content[:at] + bytes([content[at] ^ 0xFF]) + content[at + 1 :])
        try:
            assert wvr.open(tmp_path / "a.npy").ranges.known.all()  # a byte that nobody reads
        except OSError as error:
            assert str(file) in str(error)
