"""Cubics of cells that are cut, of several rays eight at a time, against interpolation of samples by NumPy."""

import numpy as np
import pytest
import warp as wp

from wvr.kernels.field.cubics import make_centered
from wvr.kernels.field.samples import make_samples

RAYS, CELLS = 3, 11


def centered(data, lines, cells, times, rays, shift):
    dtype = wp.dtype_from_numpy(data.dtype)
    found = make_centered(dtype)
    Field = make_samples(dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def one(
        field: Field,
        lines: wp.array2d(dtype=wp.float64),
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        which: wp.array2d(dtype=int),
        cubic: wp.array2d(dtype=wp.float64),
    ):
        found(field, lines, cells, times, which, wp.vec2d(wp.float64(0.125), wp.float64(0.5)), cubic)

    field = Field()
    field.data, field.shift = wp.array(data, dtype=dtype, device="cpu"), shift
    which = np.zeros((2, 1 + CELLS), np.int32)
    which[0, 0], which[0, 1:], which[1, 1:] = CELLS, np.arange(CELLS), rays
    cubic = wp.zeros((6, 16), dtype=wp.float64, device="cpu")
    wp.launch(one, 1, [field, *(wp.array(a, device="cpu") for a in (lines, cells, times, which)), cubic], device="cpu")
    return cubic.numpy()[:, :CELLS]


@pytest.mark.parametrize("dtype, shift", [("int8", 0.0), ("uint16", 0.0), ("float32", 0.25)])
def test_a_cubic_is_the_scalar_along_its_ray(dtype, shift):
    """Negative samples and those of the upper half of their dtype, cells of one ray and another, eight and three."""
    rng = np.random.default_rng(0)
    if dtype == "float32":
        data = rng.normal(size=(5, 6, 7)).astype(dtype)
    else:
        data = rng.integers(np.iinfo(dtype).min, np.iinfo(dtype).max, (5, 6, 7), dtype, endpoint=True)
    data[1:3, 1:3, 1:3] = 3  # a cell of equal corners
    rays = np.sort(rng.integers(0, RAYS, CELLS))
    lines = rng.normal(size=(RAYS, 9))
    places = rng.integers(0, [6, 5, 4], (CELLS, 3))
    places[4] = 1
    cells = places.astype(np.uint64) @ np.array([1, 1 << 21, 1 << 42], np.uint64)
    times = np.sort(rng.uniform(0, 0.7, (2, CELLS)), axis=0)
    cubic = centered(data, lines, cells, times, rays, shift)
    samples = data.astype(float) - shift
    for l, (x, y, z) in enumerate(places):
        corners = samples[z : z + 2, y : y + 2, x : x + 2]
        half = np.ptp(times[:, l]) / 2
        assert cubic[4, l] == pytest.approx(half)
        for v in (-1, -0.4, 0.3, 1):
            place = lines[rays[l], :3] + (times[:, l].mean() + v * half) * lines[rays[l], 3:6] - places[l]
            weights = [np.array([1 - p, p]) for p in place]
            true = np.einsum("zyx,x,y,z", corners, *weights)
            assert np.polynomial.polynomial.polyval(v, cubic[:4, l]) == pytest.approx(true, rel=1e-11, abs=1e-9)
        size = 0.125 * np.abs(corners).max() + 0.5 * np.ptp(corners)
        assert cubic[5, l] == pytest.approx(size if np.ptp(corners) else 0.0)
