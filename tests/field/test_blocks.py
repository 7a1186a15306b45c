"""Blocks of cells, what they hold and which of them are empty, against NumPy and SciPy."""

import itertools

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_cdt

import wvr
from wvr.field.blocks import Kinds, rows_of
from wvr.keep import Keeper
from wvr.kernels.field.blocks import EMPTY, FAR, SEVERAL, Blocks, blocks, make_kinds
from wvr.kernels.field.samples import make_samples
from wvr.launch import get_device, launch
from wvr.transfer.function import Transfer

SHAPES = [(2, 2, 2), (9, 5, 6), (1, 30, 17), (26, 41, 33)]


def built(data, tf, device="cpu", nan="error", shift=0.0):
    """Kinds, masks and ranges of blocks, by the transfer function as it is."""
    volume = wvr.Volume(data, nan=nan)
    keep = Keeper(get_device(device))
    seen = keep(Kinds(volume, volume.blocks(), Transfer(tf, 1.0, shift, "float64", False), shift, True))
    kinds = seen.kinds.numpy()
    assert seen.skipped == pytest.approx((kinds <= int(EMPTY)).mean())
    assert_box(kinds, seen.low, seen.high)
    return kinds, seen.masks.numpy(), keep(volume.blocks()).numpy()


def assert_box(kinds, low, high):
    """The box of index coordinates (x, y, z) has all blocks that are not empty, and a face of one on each side."""
    seen = np.argwhere(kinds > int(EMPTY))[:, ::-1]
    if not len(seen):
        assert np.array_equal(low, high)
        return
    thick = high - low > 1
    assert np.array_equal(low[thick], 4 * seen.min(axis=0)[thick])
    assert np.all((high <= 4 * seen.max(axis=0) + 4)[thick]) and np.all((high > 4 * seen.max(axis=0))[thick])


def cells(data):
    """Smallest and largest corner of each cell, NaN where one is; axes with one sample have it twice."""
    data = np.concatenate([data] * 2, 0) if data.shape[0] == 1 else data
    c = [
        data[z : data.shape[0] - 1 + z, y : data.shape[1] - 1 + y, x : data.shape[2] - 1 + x]
        for z, y, x in np.ndindex(2, 2, 2)
    ]
    return np.min(c, axis=0), np.max(c, axis=0)


def seen(low, high, tf):
    """Whether there is extinction anywhere in [low, high]."""
    knots, tau = tf.knots, tf.knot_extinctions()
    inner = (knots[:, None] >= low.ravel()) & (knots[:, None] <= high.ravel())
    most = np.maximum(tf.extinction(low), tf.extinction(high)).ravel()
    most = np.maximum(most, np.where(inner, tau[:, None], 0).max(axis=0))
    return (most > 0).reshape(low.shape)


TF = wvr.TransferFunction(
    [(60, "red", 0.0), (120, "blue", 0.3), (121, "green", 0.0), (200, "red", 0.0), (210, "red", 1)]
)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("dtype", "shift"), [("uint8", 0.0), ("int16", 0.0), ("float32", 0.0), ("float32", 97.3)])
def test_masks_have_every_cell_that_is_seen(device, shape, dtype, shift):
    rng = np.random.default_rng(3)
    data = (rng.random(shape) * 255 * rng.random(shape) ** 3).astype(dtype)
    kinds, masks, ranges = built(data, TF, device, shift=shift)
    low, high = cells(data)
    visible = seen(low.astype(float), high.astype(float), TF)
    for k, j, i in np.ndindex(visible.shape):
        mask = int(masks[k >> 2, j >> 2, i >> 2])
        bit = mask >> (16 * (k & 3) + 4 * (j & 3) + (i & 3)) & 1
        assert bit or not visible[k, j, i]
        kind = kinds[k >> 2, j >> 2, i >> 2]
        assert (kind <= EMPTY) <= (not visible[k, j, i]) and (mask == 0) == (kind <= EMPTY)
        first, last = ranges[k >> 2, j >> 2, i >> 2]
        assert first <= low[k, j, i] and last >= high[k, j, i]


def test_masks_are_exact_for_a_threshold():
    data = np.random.default_rng(5).integers(0, 256, (18, 18, 18), np.uint8)
    tf = wvr.TransferFunction([(240, "red", 0.0), (255, "blue", 0.3)])
    _, masks, _ = built(data, tf)
    _, high = cells(data)
    bits = sum(bin(int(m)).count("1") for m in masks.ravel())
    inside = np.pad(high > 240, [(0, -n % 4) for n in high.shape], mode="edge")
    assert np.count_nonzero(high > 240) <= bits <= np.count_nonzero(inside)


def test_kinds_say_which_interval():
    data = np.add.outer(np.add.outer(np.arange(21.0), np.arange(17)), np.arange(30)).astype(np.float32) * 4
    kinds, _, ranges = built(data, TF)
    single = kinds >= 0
    assert single.any() and (kinds == int(SEVERAL)).any() and (kinds <= int(EMPTY)).any()
    edges = np.r_[-np.inf, TF.knots, np.inf]
    assert np.all(ranges[single, 0] >= edges[kinds[single]]) and np.all(ranges[single, 1] <= edges[kinds[single] + 1])


@pytest.mark.parametrize("shape", [(60, 70, 30), (200, 9, 9)])
def test_empty_cubes(device, shape):
    """Distances are the Chebyshev distances of SciPy."""
    rng = np.random.default_rng(7)
    data = np.zeros(shape, np.uint8)
    data[tuple(rng.integers(0, n, 6) for n in shape)] = 255
    kinds, _, _ = built(data, TF, device)
    empty = kinds <= int(EMPTY)
    distance = distance_transform_cdt(empty, metric="chessboard")
    expected = np.minimum(distance[empty] - 1, int(FAR))
    assert np.array_equal(int(EMPTY) - kinds[empty], expected)


def test_absent_samples(device):
    data = np.full((9, 9, 18), np.nan, np.float32)
    data[:, :, 13:] = 205.0
    kinds, _, ranges = built(data, TF, device, nan="transparent")
    assert np.all(kinds[:, :, :3] <= int(EMPTY)) and np.all(kinds[:, :, 3:] > int(EMPTY))
    assert np.all(ranges[:, :, :3, 0] > ranges[:, :, :3, 1])


def test_number_of_blocks():
    assert blocks((2, 5, 6)) == (1, 1, 2)


# Ranges


def block_ranges(data, device):
    return Keeper(get_device(device))(wvr.Volume(data, nan="transparent").blocks())


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32", "float64"])
@pytest.mark.parametrize("shape", [(2, 2, 2), (9, 9, 9), (10, 17, 26), (8, 33, 2)])
def test_ranges(device, dtype, shape):
    rng = np.random.default_rng(1)
    data = rng.uniform(-100, 100, shape).astype(dtype) if dtype != "uint8" else rng.integers(0, 256, shape, dtype)
    if data.dtype.kind == "f":
        data.ravel()[:: max(data.size // 40, 2)] = np.inf
        data[:1, :1, :1] = np.nan
    ranges = block_ranges(data, device).numpy()
    for block in np.ndindex(ranges.shape[:3]):
        samples = data[tuple(slice(4 * b, 4 * b + 5) for b in block)]
        samples = samples[np.isfinite(samples)]
        assert tuple(ranges[block]) == (samples.min(), samples.max())
    assert ranges.shape[:3] == tuple(-(-(n - 1) // 4) for n in shape)


@pytest.mark.parametrize("shift", [0.0, 4.0])
def test_flags_are_exactly_where_nothing_absorbs(device, shift):
    """Ramps and jumps into and out of transparency, and ranges that end in and next to their control points."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        knots = np.sort(rng.integers(0, 9, 6)).astype(float)
        knots = np.delete(knots, np.flatnonzero(knots[2:] == knots[:-2]))
        if len(knots) < 2:
            continue
        opacity = rng.random(len(knots)) * (rng.random(len(knots)) > 0.6)
        tf = wvr.TransferFunction.from_arrays(knots, rng.random((len(knots), 3)), opacity)
        spans = np.array([(a, b) for a in np.arange(-1, 10, 0.5) for b in np.arange(a, 10, 0.5)])
        ranges = wp.array(spans.reshape(1, 1, -1, 2), dtype=wp.vec2d, device=device)
        for (a, b), empty in zip(spans, flags(ranges, tf, shift, device)[0, 0], strict=True):
            dense = np.r_[np.linspace(a, b, 61), knots[(knots >= a) & (knots <= b)]]
            # A jump between the ends is approached from both sides.
            below = np.nextafter(dense[dense > a], -np.inf)
            assert bool(empty) == (tf.extinction(np.r_[dense, below]).max() == 0), (a, b, tf.knots, opacity)


def flags(ranges, tf, shift, device):
    """Whether blocks of such ranges are empty."""
    keep = Keeper(get_device(device))
    field = make_samples(wp.float64)()
    field.shift = shift
    found = Blocks()
    found.kinds = wp.empty(ranges.shape, dtype=wp.int16, device=device)
    found.masks = wp.empty((1, 1, 1), dtype=wp.uint64, device=device)
    transfer = keep(Transfer(tf, 1.0, shift, "float64", False))
    launch(make_kinds(wp.float64), rows_of(ranges), [field, ranges, transfer, False, found], keep.device)
    return found.kinds.numpy() == int(EMPTY)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(1, 40), min_size=3, max_size=3))
def test_blocks_are_cells_without_gap_or_overlap(cells):
    """Every cell is in one block; a sample changed is seen by the blocks that hold it, and by no other."""
    shape = [n + 1 for n in cells]
    data = np.zeros(shape, np.float32)
    at = [n // 2 for n in shape]
    data[tuple(at)] = 1
    seen = np.argwhere(block_ranges(data, "cpu").numpy()[..., 1] == 1)
    # A sample on a face belongs to the blocks on both sides, if there are two.
    held = [{min(i // 4, (n - 1) // 4) for i in (s - 1, s) if 0 <= i < n} for s, n in zip(at, cells, strict=True)]
    assert {tuple(b) for b in seen} == set(itertools.product(*held))
    assert np.all(np.array(blocks(shape)) * 4 >= cells) and np.all((np.array(blocks(shape)) - 1) * 4 < cells)
