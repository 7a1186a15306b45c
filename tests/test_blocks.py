"""Small blocks of cells against NumPy and SciPy."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_cdt

import wvr
from wvr.kernels.blocks import EMPTY, FAR, SEVERAL, blocks

SHAPES = [(2, 2, 2), (9, 5, 6), (1, 30, 17), (26, 41, 33)]


def built(data, tf, device="cpu", nan="error"):
    """Kinds and masks of the renderer, and its transfer function."""
    volume = wvr.Volume(data, nan=nan)
    renderer = wvr.Renderer(volume, tf, tolerance=1e-6, device=device)
    renderer.render(wvr.Camera.fit(volume), (1, 1))
    kept = {part: next(iter(renderer._kept[part].values())) for part in ("kinds", "simplified", "extents")}
    kinds, masks, skipped, *box = kept["kinds"]
    assert skipped == pytest.approx((kinds.numpy() <= int(EMPTY)).mean())
    assert_box(kinds.numpy(), *box)
    return kinds.numpy(), masks.numpy(), kept["simplified"][0], kept["extents"].numpy()


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
@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_masks_have_every_cell_that_is_seen(device, shape, dtype):
    rng = np.random.default_rng(3)
    data = (rng.random(shape) * 255 * rng.random(shape) ** 3).astype(dtype)
    kinds, masks, _, extents = built(data, TF, device)
    low, high = cells(data)
    visible = seen(low.astype(float), high.astype(float), TF)
    for k, j, i in np.ndindex(visible.shape):
        mask = int(masks[k >> 2, j >> 2, i >> 2])
        bit = mask >> (16 * (k & 3) + 4 * (j & 3) + (i & 3)) & 1
        assert bit or not visible[k, j, i]
        kind = kinds[k >> 2, j >> 2, i >> 2]
        assert (kind <= EMPTY) <= (not visible[k, j, i]) and (mask == 0) == (kind <= EMPTY)
        assert (
            extents[k >> 2, j >> 2, i >> 2, 0] <= low[k, j, i] and extents[k >> 2, j >> 2, i >> 2, 1] >= high[k, j, i]
        )


def test_masks_are_exact_for_a_threshold():
    data = np.random.default_rng(5).integers(0, 256, (18, 18, 18), np.uint8)
    tf = wvr.TransferFunction([(240, "red", 0.0), (255, "blue", 0.3)])
    _, masks, _, _ = built(data, tf)
    _, high = cells(data)
    bits = sum(bin(int(m)).count("1") for m in masks.ravel())
    inside = np.pad(high > 240, [(0, -n % 4) for n in high.shape], mode="edge")
    assert np.count_nonzero(high > 240) <= bits <= np.count_nonzero(inside)


def test_kinds_say_which_interval():
    data = np.add.outer(np.add.outer(np.arange(21.0), np.arange(17)), np.arange(30)).astype(np.float32) * 4
    kinds, _, points, extents = built(data, TF)
    single = kinds >= 0
    assert single.any() and (kinds == int(SEVERAL)).any() and (kinds <= int(EMPTY)).any()
    edges = np.r_[-np.inf, points.knots, np.inf]
    assert np.all(extents[single, 0] >= edges[kinds[single]]) and np.all(extents[single, 1] <= edges[kinds[single] + 1])


@pytest.mark.parametrize("shape", [(60, 70, 30), (200, 9, 9)])
def test_empty_cubes(device, shape):
    """Distances are the Chebyshev distances of SciPy."""
    rng = np.random.default_rng(7)
    data = np.zeros(shape, np.uint8)
    data[tuple(rng.integers(0, n, 6) for n in shape)] = 255
    kinds, _, _, _ = built(data, TF, device)
    empty = kinds <= int(EMPTY)
    distance = distance_transform_cdt(empty, metric="chessboard")
    expected = np.minimum(distance[empty] - 1, int(FAR))
    assert np.array_equal(int(EMPTY) - kinds[empty], expected)


def test_absent_samples(device):
    data = np.full((9, 9, 18), np.nan, np.float32)
    data[:, :, 13:] = 205.0
    kinds, _, _, extents = built(data, TF, device, nan="transparent")
    assert np.all(kinds[:, :, :3] <= int(EMPTY)) and np.all(kinds[:, :, 3:] > int(EMPTY))
    assert np.all(extents[:, :, :3, 0] > extents[:, :, :3, 1])


def test_number_of_blocks():
    assert blocks((2, 5, 6)) == (1, 1, 2)
