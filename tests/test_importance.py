"""Block ranges and flags against NumPy."""

import numpy as np
import pytest
import warp as wp

import wvr
from wvr.kernels.importance import blocks, make_empty, make_ranges
from wvr.kernels.precision import REALS
from wvr.launch import get_device, launch
from wvr.tables import transfer_arrays, transfer_values


def block_ranges(data, device):
    result = wp.empty(blocks(data.shape), dtype=wp.vec2d, device=device)
    array = wp.array(data, device=device)
    launch(make_ranges(array.dtype), result.size, [array, result], get_device(device))
    return result


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
        samples = data[tuple(slice(8 * b, 8 * b + 9) for b in block)]
        samples = samples[np.isfinite(samples)]
        assert tuple(ranges[block]) == (samples.min(), samples.max())
    assert ranges.shape[:3] == tuple(-(-(n - 1) // 8) for n in shape)


def test_a_block_of_absent_samples_is_empty(device):
    data = np.full((9, 9, 17), np.nan, np.float32)
    data[:, :, 16] = 1.0
    ranges = block_ranges(data, device)
    tf = wvr.TransferFunction([(0, "red", 0.5), (2, "red", 0.5)])
    assert flags(ranges, tf, 0.0, "float64", device).tolist() == [[[1, 0]]]


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("shift", [0.0, 4.0])
def test_flags_are_exactly_where_nothing_absorbs(device, precision, shift):
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
        for (a, b), empty in zip(spans, flags(ranges, tf, shift, precision, device)[0, 0], strict=True):
            dense = np.r_[np.linspace(a, b, 61), knots[(knots >= a) & (knots <= b)]]
            # A jump between the ends is approached from both sides.
            below = np.nextafter(dense[dense > a], -np.inf)
            assert bool(empty) == (tf.extinction(np.r_[dense, below]).max() == 0), (a, b, tf.knots, opacity)


def flags(ranges, tf, shift, precision, device):
    result = wp.empty(ranges.shape, dtype=wp.uint8, device=device)
    transfer = transfer_arrays(tf.knots, transfer_values(tf, 1.0), shift, precision, get_device(device))
    launch(make_empty(REALS[precision]), result.size, [ranges, wp.float64(shift), transfer, result], get_device(device))
    return result.numpy()
