"""Cells in single precision: rows, the vectors against what they say in Warp, and ticks against the walk."""

import platform
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
import warp as wp
from hypothesis import example, given, settings
from hypothesis import strategies as st

import wvr
from wvr.keep import Keeper
from wvr.kernels.field.abreast import LANES as ABREAST
from wvr.kernels.field.abreast import make_abreast
from wvr.kernels.field.blocks import Blocks
from wvr.kernels.field.cubics import make_placed
from wvr.kernels.field.grid import Grid
from wvr.kernels.field.samples import make_samples
from wvr.kernels.field.strides import FULL, STATE, Rays, make_each, make_octants
from wvr.kernels.integrators.crossings import FALLEN, JOBS, make_crossings
from wvr.kernels.integrators.packet import make_packet
from wvr.kernels.integrators.single import CELLS, LANES, make_single
from wvr.kernels.transfer.function import make_transfer
from wvr.kernels.transfer.rows import Rows
from wvr.launch import get_device
from wvr.transfer.function import Transfer, struct_of, transfer_values
from wvr.transfer.rows import rows

from ..scenes import transfer_functions

SHARE = (1e-3, 1e-5, 1.0)
# The second of two rays, behind the cells of the first.
RAY, FIRST = 1, 5
ROOM = FIRST + CELLS + LANES


def evaluated(table, s):
    """Extinction and colour of rows (n, 16) at scalars (n, m)."""
    row = table.astype(float)
    w = s - row[:, :1]
    tau = row[:, 2:3] + w * (row[:, 3:4] + w * row[:, 4:5])
    return tau, row[:, None, 8:11] + w[..., None] * row[:, None, 12:15]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
@example(910859)  # so steep that the rounding of scalars counts
def test_rows_deviate_by_no_more_than_they_say(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.choice([2, 3, 5, 20, 256]))
    scale, offset = 10.0 ** rng.uniform(-6, 6), rng.choice([0, 1, 1e3])
    knots = np.sort(rng.random(n))
    if n > 3:
        knots[1 : n // 3 + 1] = knots[1] + 10.0 ** -rng.uniform(1, 9) * np.sort(rng.random(n // 3))
        knots = np.sort(knots)
        knots[n // 2] = knots[n // 2 - 1]  # a jump
    knots = (knots + offset) * scale
    values = np.column_stack([rng.random((n, 3)), rng.random(n) ** 5 * 10.0 ** rng.uniform(-3, 3)])
    values[rng.random(n) < 0.3, 3] = 0
    low, high = np.sort(knots[0] + np.ptp(knots) * rng.uniform(-0.5, 1.5, 2))
    table, bins, numbers = rows(knots, values, low, high)
    of_bin = bins[:, 0].astype(int)
    assert table.dtype == bins.dtype == np.float32 and np.all((of_bin >= 0) & (of_bin < numbers["fitted"]))
    assert np.array_equal(bins[:, 1:3], table[of_bin, :2])
    assert len(table) == numbers["fitted"] + 2 * 2 ** numbers["levels"] - 1 and numbers["fitted"] == n + 1
    some = table[table[:, 1] > 0]
    # In the window and at its ends; there a jump's value is that inside.
    t = np.concatenate([[-1, 1], rng.uniform(-1, 1, 40)])
    s = some[:, :1].astype(float) + some[:, 1:2].astype(float) * t
    at = np.concatenate([values[:1], values, values[-1:]])
    ends = np.concatenate([[-np.inf], knots, [np.inf]])
    k = np.searchsorted(knots, s, "right")
    width = np.where(np.isfinite(ends[k + 1] - ends[k]), ends[k + 1] - ends[k], 1.0)
    f = np.where(np.isfinite(ends[k]) & np.isfinite(ends[k + 1]), (s - np.where(k > 0, ends[k], s)) / width, 0.0)
    true = at[k] + f[..., None] * (at[k + 1] - at[k])
    tau, color = evaluated(some, s)
    slack = 1e-12 * (np.abs(some[:, 2:3]) + np.abs(some[:, 3:4]) * some[:, 1:2] + 1e-300)
    assert np.all(np.abs(tau - true[..., 3]) <= some[:, 5:6] * (1 + 1e-6) + slack)
    assert np.all(np.abs(color - true[..., :3]).max(-1) <= some[:, 6:7] * (1 + 1e-6) + 1e-12)
    assert np.all(np.abs(some[:, 12:15]).max(axis=1) <= some[:, 7])


def test_a_control_point_within_rounding_of_the_end_of_a_window():
    # Windows end between numbers of double precision, at some 4.4 of the last place.
    knots = 65535 + np.spacing(65535.0) * np.array([0, 4, 5, 901])
    values = np.column_stack([np.ones((4, 3)), [0.0, 0, 1, 1]])
    table, _, numbers = rows(knots, values, knots[0], knots[-1])
    some = table[numbers["fitted"] :].astype(float)
    some = some[some[:, 1] > 0]
    asked = 0
    for row in some[some[:, 0] == 65535]:
        end = Fraction(row[0]) + Fraction(row[1])
        if Fraction(knots[1]) < end < Fraction(knots[2]):
            true = float((end - Fraction(knots[1])) / (Fraction(knots[2]) - Fraction(knots[1])))
            assert abs(row[2] + row[1] * (row[3] + row[1] * row[4]) - true) <= row[5] * (1 + 1e-6)
            asked += 1
    assert asked


def test_a_smooth_map_needs_few_rows():
    """Half a window of the narrowest about each grey level deviates by little from 256 control points."""
    x = np.arange(256.0)
    t = np.clip((x - 90) / 165, 0, 1)
    values = np.column_stack([x / 255, x / 255, x / 255, 0.05 * t * t * (3 - 2 * t)])
    table, _, numbers = rows(x, values, 0.0, 255.0)
    level = table[numbers["fitted"] + 2 ** (numbers["levels"] + 1) - 2 ** (numbers["levels"] - 3) :][:16]
    assert np.all(level[:, 1] > 15)
    assert level[2:-2, 5].max() < 5e-4 and level[2:-2, 6].max() < 1e-6


@cache
def kernel(vectors, dtype, flags=None):
    """Measures the cells, then composes those that it may."""
    placed, cubics = make_placed(vectors), Grid(dtype, False).cubics(vectors, CELLS)
    measure, compose = make_packet() if vectors else make_single()
    Field = make_samples(dtype)

    @wp.kernel(enable_backward=False, module="unique", module_options={"cpu_compiler_flags": flags})
    def measured(
        field: Field,
        blocks: Blocks,
        rows: Rows,
        spend: wp.vec3,
        origin: wp.vec3d,
        d: wp.vec3d,
        cells: wp.array(dtype=wp.uint64),
        times: wp.array2d(dtype=wp.float64),
        n: int,
        where: wp.array2d(dtype=wp.float32),
        cubic: wp.array2d(dtype=wp.float32),
        found: wp.array2d(dtype=wp.float32),
        row: wp.array(dtype=int),
        bad: wp.array(dtype=int),
        rays: Rays,
    ):
        placed(origin, d, cells, times, FIRST, n, where)
        cubics(field, cells, where, FIRST, n, cubic)
        measure(rows, blocks, spend, cells, wp.vec2i(FIRST, n), cubic, found, row)
        which = wp.zeros(shape=(2, wp.static(1 + 2 * LANES)), dtype=int)
        rays.first[RAY] = FIRST
        rays.last[RAY] = FIRST + n
        m = compose(rows, rays, times, found, row, spend, False, which)
        while m > 0:
            for i in range(m):
                # As somebody else would.
                l = which[0, 1 + i]
                bad[l - FIRST] = which[1, 1 + i]
                row[l] = -1
                found[0, l] = wp.float32(0.5)
                found[1, l] = wp.float32(0.39346934)
                found[2, l] = wp.float32(0.1)
                found[3, l] = wp.float32(0.2)
                found[4, l] = wp.float32(1e-5)
                found[5, l] = wp.float32(0.3)
            m = compose(rows, rays, times, found, row, spend, False, which)

    return measured


def measured(vectors, data, tf, seed, flags=None):
    """(cubics, found, rows, which are left to others, sums) of random pieces in random cells of a volume."""
    rng = np.random.default_rng(seed)
    dtype = wp.dtype_from_numpy(data.dtype)
    field = make_samples(dtype)()
    field.data, field.last = wp.array(data, dtype=dtype, device="cpu"), wp.vec3i(*(n - 2 for n in reversed(data.shape)))
    keep = Keeper(get_device("cpu"))
    transfer = struct_of(keep(Transfer(tf, 1.0, 0.0, "float64", False)))
    finite = data[np.isfinite(data)]
    table, bins, numbers = rows(tf.knots, transfer_values(tf, 1.0), float(finite.min()), float(finite.max()))
    struct = Rows()
    struct.knots = transfer.knot
    struct.row, struct.bins = wp.array(table, device="cpu"), wp.array(bins, device="cpu")
    for name, value in numbers.items():
        setattr(struct, name, value)
    d = rng.normal(size=3)
    d /= np.abs(d).max()
    # A ray that passes the middle of some cells, as cells that it really sees need not be neighbours.
    n = int(rng.integers(1, CELLS + 1))
    places, times = np.zeros(ROOM, np.uint64), np.zeros((2, ROOM))
    origin = rng.uniform(1, np.array(data.shape[::-1]) - 2)
    t = np.sort(rng.uniform(0, 4, n + 1))
    for l in range(n):
        middle = origin + (t[l] + t[l + 1]) / 2 * d
        cell = np.clip(np.floor(middle), 0, np.array(data.shape[::-1]) - 2).astype(int)
        places[FIRST + l] = cell[0] | cell[1] << 21 | cell[2] << 42
        long = min(t[l + 1] - t[l], 0.5)
        times[:, FIRST + l] = (t[l] + t[l + 1]) / 2 + np.array([-0.5, 0.5]) * long
    where, found = (wp.zeros((m, ROOM), dtype=wp.float32, device="cpu") for m in (7, 6))
    cubic = wp.zeros((7, CELLS), dtype=wp.float32, device="cpu")
    row, bad = (wp.zeros(m, dtype=int, device="cpu") for m in (ROOM, CELLS))
    blocks, rays = Blocks(), Rays()
    for name in ("going", "first", "last", "count"):
        setattr(rays, name, wp.zeros(2, dtype=int, device="cpu"))
    rays.lines, rays.sums = (wp.zeros((2, m), dtype=wp.float64, device="cpu") for m in (10, 5))
    blocks.kinds = wp.full(tuple(-(-(n - 1) // 4) for n in data.shape), -1, wp.int16, device="cpu")
    inputs = [field, blocks, struct, wp.vec3(*SHARE), wp.vec3d(*origin), wp.vec3d(*d), wp.array(places, device="cpu")]
    inputs += [wp.array(times, dtype=wp.float64, device="cpu"), n, where, cubic, found, row, bad, rays]
    wp.launch(kernel(vectors, dtype, flags), 1, inputs, device="cpu")
    these = slice(FIRST, FIRST + n)
    bad = bad.numpy()[:n].astype(bool)
    assert rays.count.numpy()[RAY] == n and rays.going.numpy()[RAY] == 0
    return cubic.numpy()[:, :n], found.numpy()[:, these], row.numpy()[these], bad, rays.sums.numpy()[RAY]


def volume_of(dtype, seed):
    rng = np.random.default_rng(seed)
    smooth = sum(np.sin(0.3 * rng.random() * x + rng.random()) for x in np.indices((12, 13, 14)))
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    if np.dtype(dtype).kind == "f":
        data = smooth.astype(dtype)
        data[rng.random(data.shape) < 0.003] = np.nan
        return data
    return (np.iinfo(dtype).min // 2 + smooth * 250).astype(dtype)


# For vectors as wide as this machine's, and for the narrowest.
FLAGS = {"native": None}
if platform.machine() == "x86_64":
    FLAGS |= {"SSE": "-target-cpu x86-64"}


@pytest.mark.parametrize("dtype, flags", [("float32", "native"), *(("uint8", flags) for flags in FLAGS)])
def test_vectors_say_what_warp_says(dtype, flags):
    for seed, name in enumerate(("smooth", "color map", "jumps", "random", "spikes")):
        data = volume_of(dtype, seed)
        finite = data[np.isfinite(data)]
        tf = transfer_functions(float(finite.min()), float(finite.max()))[name]
        for trial in range(10):
            one, other = measured(False, data, tf, trial), measured(True, data, tf, trial, FLAGS[flags])
            size = np.ptp(finite.astype(float))
            assert np.allclose(one[0], other[0], rtol=1e-5, atol=1e-5 * size, equal_nan=True)
            # Rounding may take a neighbouring row, or find another side of a share.
            same = (one[2] == other[2]) & (one[3] == other[3])
            assert same.mean() > 0.9
            a, b = one[1][:, same], other[1][:, same]
            assert np.allclose(a[:2], b[:2], rtol=2e-5, atol=1e-7)
            assert np.allclose(a[2:4], b[2:4], rtol=1e-4, atol=1e-5 * size)
            assert np.allclose(a[4], b[4], rtol=1e-3, atol=1e-9)
            if same.all():
                assert np.allclose(one[4], other[4], rtol=1e-5, atol=1e-6)


@cache
def cutter(flags):
    cut = make_crossings()

    @wp.kernel(enable_backward=False, module="unique", module_options={"cpu_compiler_flags": flags})
    def cutting(
        rows: Rows,
        transfer: make_transfer(wp.float64)[0],
        spend: wp.vec3,
        cubic: wp.array2d(dtype=wp.float64),
        which: wp.array2d(dtype=int),
        found: wp.array2d(dtype=wp.float32),
        row: wp.array(dtype=int),
        pieces: wp.array(dtype=int),
    ):
        cut(rows, transfer, spend, cubic, which, found, row, pieces)

    return cutting


def cut_cells(tf, cubic, spend, flags):
    """What ``cut`` makes of cubics (5 or 6, n), and which of them it leaves to others."""
    n = cubic.shape[1]
    transfer = struct_of(Keeper(get_device("cpu"))(Transfer(tf, 1.0, 0.0, "float64", False)))
    table, bins, numbers = rows(tf.knots, transfer_values(tf, 1.0), 0.0, 1.0)
    struct = Rows()
    struct.row, struct.bins = wp.array(table, device="cpu"), wp.array(bins, device="cpu")
    struct.knots = transfer.knot
    for name, value in numbers.items():
        setattr(struct, name, value)
    given = np.zeros((6, JOBS))
    given[: len(cubic), :n] = cubic
    # Behind each other in rays of their own.
    which = np.zeros((2, n + 1))
    which[:, 1:] = np.arange(n)[::-1], np.arange(n)[::-1] // CELLS
    which[0, 0] = n
    which = wp.array(which, dtype=int, device="cpu")
    found, row = wp.zeros((6, n), dtype=wp.float32, device="cpu"), wp.zeros(n, dtype=int, device="cpu")
    pieces = wp.zeros(-(-n // CELLS), dtype=int, device="cpu")
    inputs = [struct, transfer, wp.vec3(*spend), wp.array(given, device="cpu"), which, found, row, pieces]
    wp.launch(cutter(flags), 1, inputs, device="cpu")
    assert np.all(row.numpy() == -1)
    left = which.numpy()[:, 1 : 1 + which.numpy()[0, 0]]
    assert np.all(left[1] == left[0] // CELLS)
    return found.numpy()[:, ::-1].astype(float), n - 1 - left[0]


def sampled(tf, cubic, n=20000):
    """Depth, opacity and colours of cubics (5 or 6, m), sample by sample."""
    v = (np.arange(n) + 0.5) * (2 / n) - 1
    m = cubic[:4, :, None]
    s = m[0] + v * (m[1] + v * (m[2] + v * m[3]))
    values = transfer_values(tf, 1.0)
    x = np.interp(s, tf.knots, values[:, 3]) * (2 * cubic[4] / n)[:, None]
    depth = np.cumsum(x, axis=1)
    weight = np.exp(-(depth - x)) * -np.expm1(-x)
    color = [(weight * np.interp(s, tf.knots, values[:, c])).sum(axis=1) for c in range(3)]
    return depth[:, -1], -np.expm1(-depth[:, -1]), np.array(color)


def test_a_spike_is_all_there_up_and_down_and_from_wherever_a_cell_begins():
    """Depth is the area of what is passed over the slope: of two spikes, dark in front, between and behind."""
    opacity = [0, 0, 0.5, 0, 0, 0.3, 0, 0]
    tf = wvr.TransferFunction.from_arrays([0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9], np.full((8, 3), 0.7), opacity)
    areas = 0.1 * transfer_values(tf, 1.0)[[2, 5], 3]
    begin = np.array([0.05, 0.15, 0.3, 0.45, 0.05, 0.15, 0.42])
    end = np.array([0.95, 0.85, 0.55, 0.95, 0.5, 0.3, 0.58])
    passed = np.array([areas.sum(), areas.sum(), areas[0] / 2, areas[1], areas[0], areas[0] / 2, 0.0])
    cubic = np.zeros((6, 14))
    cubic[0], cubic[1] = np.tile((begin + end) / 2, 2), np.concatenate([end - begin, begin - end]) / 2
    cubic[4] = 0.3
    found, left = cut_cells(tf, cubic, (1e-3, 1e-6, 1.0), FLAGS["native"])
    assert len(left) == 0
    depth = np.tile(2 * 0.3 * passed / (end - begin), 2)
    assert np.all(np.abs(found[0] - depth) <= found[4] + 1e-7)
    assert np.all(found[4] <= 1e-3 * found[1] + 1e-6)
    assert np.all(found[:, depth == 0] == 0)


@pytest.mark.parametrize("flags", FLAGS)
def test_cut_cells_are_within_their_bounds(flags):
    """Whatever is behind them: monotone or not, thin and thick, spikes, intervals with nothing to see; and whichever
    scalar there is within rounding. Nor would a quarter of the bounds do.
    """
    rng = np.random.default_rng(7)
    left_over, many, worst = 0, 0, 0.0
    for trial in range(12):
        # The larger one is far above the rounding of sums.
        spend = ((1e-3, 1e-6, 1.0), (1e-2, 1e-5, 1.0))[trial % 2]
        n = int(rng.choice([3, 5, 12, 40]))
        x = np.sort(rng.random(n))
        x = x[np.diff(x, prepend=-1) > 1e-3]
        if trial % 3 == 0:
            x = np.sort(np.concatenate([x, x + 4e-4 * (1 + rng.random(len(x)))]))
        opacity = np.minimum(rng.random(len(x)) ** 3 * 10.0 ** rng.uniform(-2, 0.3), 0.999) * (rng.random(len(x)) < 0.7)
        tf = wvr.TransferFunction.from_arrays(x, rng.random((len(x), 3)), opacity)
        m = int(rng.integers(1, 70))
        cubic = rng.normal(size=(6, m)) * 10.0 ** rng.uniform(-3, -0.5, (1, m))
        cubic[0] = rng.random(m)
        cubic[5] = 1e-7 * (trial % 3 == 0)
        cubic[2:4] *= rng.choice([0, 0.05, 1], (2, m))
        cubic[4] = rng.uniform(0.01, 0.9, m)
        # Some that touch a control point where they turn, or have none of it.
        cubic[0, ::9], cubic[1, ::9], cubic[3, ::9] = rng.choice(x, len(cubic[0, ::9])), 0, 0
        cubic[1:4, ::13] = 0
        found, left = cut_cells(tf, cubic, spend, FLAGS[flags])
        here = np.setdiff1d(np.arange(m), left)
        assert np.all(np.isfinite(found[:, here]))
        for side in (-1, 1):
            shifted = cubic.copy()
            shifted[0] += side * cubic[5]
            _, A, color = sampled(tf, shifted[:, here])
            # Of colours before what is dark or bright, and of opacity.
            error = np.abs(found[1, here] - A)
            for c, mine in zip(color, found[[2, 3, 5]][:, here], strict=True):
                for behind in (0.0, 1.0):
                    error = np.maximum(error, np.abs(mine - c + (A - found[1, here]) * behind))
            assert np.all(error <= found[4, here] + 2e-7)
            worst = max(worst, *((error - 2e-7) / (found[4, here] + 1e-30)))
        assert np.allclose(1 - np.exp(-found[0, here]), found[1, here], rtol=1e-5, atol=1e-7)
        if not cubic[5].any():
            # Rounding has no share.
            assert np.all(found[4, here] <= spend[0] * found[1, here] + 2 * spend[1] * cubic[4, here] + 1e-8)
            left_over, many = left_over + len(left), many + m
    assert left_over < 0.1 * many and worst > 0.25


def test_cells_beside_a_jump_are_left_to_others():
    tf = wvr.TransferFunction.from_arrays([0.2, 0.5, 0.5, 0.8], np.ones((4, 3)), [0.1, 0.2, 0.6, 0.3])
    cubic = np.zeros((5, 3))
    # Across the jump, next to it, and elsewhere.
    cubic[0], cubic[1], cubic[4] = [0.5, 0.45, 0.85], [0.1, 0.02, 0.02], 0.5
    assert sorted(cut_cells(tf, cubic, SHARE, None)[1]) == [0, 1]


def test_a_line_drawn_too_far_may_fall_below_zero():
    """S13: the series of a piece whose extinction is negative somewhere, by little, against quadrature."""
    rng = np.random.default_rng(3)
    v, weight = np.polynomial.legendre.leggauss(80)
    # Of a piece that is taken: tolerances are below 1.
    farthest = 3 / 8
    assert 4 * np.exp(2 * farthest) <= 2 * FALLEN
    for _ in range(2000):
        m1, m2, m3 = rng.normal(size=3) * 10.0 ** rng.uniform(-2, 0)
        R = abs(m1) + 2 / 3 * abs(m2) + abs(m3)
        w = m1 * v + m2 * (v * v - 1 / 3) + m3 * v**3
        W = m1 / 2 * (v * v - 1) + m2 / 3 * (v**3 - v) + m3 / 4 * (v**4 - 1)
        a = 10.0 ** rng.uniform(-3, 0.7)
        g = rng.choice([-1, 1]) * rng.uniform(0.5, 1.3) * a / max(-w.min(), w.max())
        fall = max(0.0, -(a + g * w).min()) * 1.001
        if fall > farthest:
            continue
        true = np.exp(-a) * (weight * w * (a + g * w) * np.exp(-a * v - g * W)).sum()
        series = np.exp(-a) * (weight * w * (a + g * w) * (1 - a * v - g * W)).sum()
        x = 2 * a
        assert abs(true - series) <= R * (-np.expm1(-x) - x * np.exp(-a)) + 2 * FALLEN * R * fall + 1e-13


def test_octants_against_brute_force():
    rng = np.random.default_rng(0)
    masks = (rng.random((5, 7, 6)) < 0.06).astype(np.uint64)
    octants = wp.zeros((8, *masks.shape), dtype=wp.uint8, device="cpu")
    wp.launch(make_octants, 8, [0, wp.array(masks, device="cpu"), octants], device="cpu")
    for way, free in enumerate(octants.numpy()):
        for at in np.ndindex(masks.shape):
            ahead = masks[tuple(slice(i, None) if way >> (2 - a) & 1 else slice(i, None, -1) for a, i in enumerate(at))]
            assert (free[at] == FULL) == (masks[at] == 2**64 - 1)
            size = 0 if free[at] == FULL else int(free[at])
            assert not ahead[:size, :size, :size].any()
            assert size >= 100 or ahead[: size + 1, : size + 1, : size + 1].any() or size > max(masks.shape)


@cache
def walker(how):
    begin, stride = make_abreast(CELLS) if how == "abreast" else make_each(CELLS, how == "ticks")
    rays_at_a_time = ABREAST
    room = ABREAST * CELLS + LANES

    @wp.func
    def several(
        lines: wp.array2d(dtype=wp.float64),
        state: wp.array2d(dtype=wp.float64),
        going: wp.array(dtype=int),
        first: wp.array(dtype=int),
        last: wp.array(dtype=int),
    ):
        rays = Rays()
        rays.lines = lines
        rays.state = state
        rays.going = going
        rays.first = first
        rays.last = last
        return rays

    @wp.kernel(enable_backward=False, module="unique")
    def walked(
        last: wp.vec3i,
        blocks: Blocks,
        octants: wp.array4d(dtype=wp.uint8),
        origins: wp.array(dtype=wp.vec3d),
        directions: wp.array(dtype=wp.vec3d),
        ends: wp.array(dtype=wp.vec2d),
        places: wp.array2d(dtype=wp.uint64),
        starts: wp.array2d(dtype=wp.float64),
        stops: wp.array2d(dtype=wp.float64),
        counts: wp.array(dtype=int),
    ):
        # Of several rays, as long as any goes on.
        base = rays_at_a_time * wp.tid()
        rays = several(
            wp.zeros(shape=(rays_at_a_time, 9), dtype=wp.float64),
            wp.zeros(shape=(rays_at_a_time, STATE), dtype=wp.float64),
            wp.zeros(shape=(rays_at_a_time,), dtype=int),
            wp.zeros(shape=(rays_at_a_time,), dtype=int),
            wp.zeros(shape=(rays_at_a_time,), dtype=int),
        )
        cells = wp.zeros(shape=(room,), dtype=wp.uint64)
        times = wp.zeros(shape=(2, room), dtype=wp.float64)
        for r in range(rays_at_a_time):
            for a in range(3):
                rays.lines[r, a] = origins[base + r][a]
                rays.lines[r, 3 + a] = directions[base + r][a]
            rays.lines[r, 6] = ends[base + r][0]
            rays.lines[r, 7] = ends[base + r][1]
        begin(last, rays)
        total = stride(blocks, octants, rays, cells, times)
        while total > 0:
            for r in range(rays_at_a_time):
                ray = base + r
                for l in range(rays.first[r], rays.last[r]):
                    places[ray, counts[ray]] = cells[l]
                    starts[ray, counts[ray]] = times[0, l]
                    stops[ray, counts[ray]] = times[1, l]
                    counts[ray] = counts[ray] + 1
            total = stride(blocks, octants, rays, cells, times)

    return walked


def walked(how, masks, kinds, shape, origins, directions, ends):
    octants = wp.zeros((8, *masks.shape), dtype=wp.uint8, device="cpu")
    masks = wp.array(masks, dtype=wp.uint64, device="cpu")
    wp.launch(make_octants, 8, [0, masks, octants], device="cpu")
    blocks = Blocks()
    blocks.masks, blocks.kinds = masks, wp.array(kinds, dtype=wp.int16, device="cpu")
    n = len(origins)
    most = 3 * sum(shape) + CELLS
    places = wp.zeros((n, most), dtype=wp.uint64, device="cpu")
    starts, stops = (wp.zeros((n, most), dtype=wp.float64, device="cpu") for _ in range(2))
    counts = wp.zeros(n, dtype=int, device="cpu")
    inputs = [wp.vec3i(*(m - 2 for m in reversed(shape))), blocks, octants]
    inputs += [wp.array(a, dtype=wp.vec3d, device="cpu") for a in (origins, directions)]
    inputs += [wp.array(ends, dtype=wp.vec2d, device="cpu"), places, starts, stops, counts]
    wp.launch(walker(how), n // ABREAST, inputs, device="cpu")
    return [a.numpy() for a in (places, starts, stops, counts)]


@pytest.mark.parametrize("shape", [(20, 33, 12), (2, 2, 2), (3, 2, 300)])
def test_ticks_are_the_walk_to_rounding(shape):
    """Also of rays along axes, faces and edges, from faces on, and of any length."""
    rng = np.random.default_rng(1)
    n = 3008
    size = np.array(shape[::-1]) - 1.0
    directions = rng.normal(size=(n, 3))
    directions[rng.random((n, 3)) < 0.2] = 0.0
    directions[rng.random((n, 3)) < 0.05] *= 1e-14
    directions[rng.random((n, 3)) < 0.1] = 1.0
    directions[~directions.any(axis=1)] = [0, 0, 1]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = rng.uniform(0, size, (n, 3))
    on = rng.random((n, 3)) < 0.3
    origins[on] = np.round(origins[on])
    ends = np.sort(rng.uniform(0, 1, (n, 2)) * 10.0 ** rng.uniform(-9, 3, (n, 1)), axis=1)
    ends[rng.random(n) < 0.5, 0] = 0.0
    masks = rng.integers(0, 2**64, tuple(-(-(m - 1) // 4) for m in shape), np.uint64, endpoint=False)
    masks[rng.random(masks.shape) < 0.4] = 0
    masks[rng.random(masks.shape) < 0.2] = 2**64 - 1
    masks[0, 0, 0] = 2**64 - 1
    kinds = np.where(masks == 0, -2, -1).astype(np.int16)
    one, other, ticked = (
        walked(how, masks, kinds, shape, origins, directions, ends) for how in ("gathered", "abreast", "ticks")
    )
    # The same ticks, but for what rounds the first.
    assert np.mean(other[3] == ticked[3]) > 0.99
    ticks = 8 * sum(shape) * 2.0**-52
    checked = 0
    for ray in range(n):
        a, b = (
            {int(p): (s, e) for p, s, e in zip(*(x[ray, : r[3][ray]] for x in r[:3]), strict=True)}
            for r in (one, other)
        )
        slack = ticks * np.ptp(ends[ray]) + 1e-12 * (1 + ends[ray, 1])
        for place in a.keys() | b.keys():
            (s, e), (p, q) = a.get(place, (0, 0)), b.get(place, (0, 0))
            if place in a and place in b:
                assert max(abs(s - p), abs(e - q)) <= slack
                checked += 1
            else:
                # One that is only touched.
                assert e - s <= slack and q - p <= slack
            index = np.array([place & 0x1FFFFF, place >> 21 & 0x1FFFFF, place >> 42])
            assert np.all(index <= size - 1)
    assert checked > 1000


def short_ends(n, shape):
    """Origins, directions, and the last bit of rays that come from afar, as times."""
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = rng.uniform(1, 7, (n, 3)) - 10.0 ** rng.uniform(2, 4, (n, 1)) * directions
    leave = np.where(directions > 0, np.subtract(shape, 1.0), 0.0)
    stops = ((leave - origins) / directions).min(axis=1)
    return origins, directions, np.stack([stops - 10.0 ** rng.uniform(-6, 0.3, n), stops], axis=1)


@pytest.mark.parametrize("how", ["ticks", "abreast"])
def test_short_ends_of_long_rays_stay_in_the_grid(how):
    """Of a stretch whose time is rounded by more than many ticks, as the last cells of a brick far from the camera."""
    shape = (9, 9, 9)
    origins, directions, ends = short_ends(2000, shape)
    masks = np.full((2, 2, 2), 2**64 - 1, np.uint64)
    places, starts, leaves, counts = walked(
        how, masks, np.full(masks.shape, -1, np.int16), shape, origins, directions, ends
    )
    found = np.arange(places.shape[1]) < counts[:, None]
    indices = np.stack(
        [places & np.uint64(0x1FFFFF), places >> np.uint64(21) & np.uint64(0x1FFFFF), places >> np.uint64(42)]
    )
    assert np.all(counts > 0) and np.all(indices[:, found] <= 7)
    # All of each stretch, in order.
    np.testing.assert_allclose((leaves - starts).sum(axis=1, where=found), ends[:, 1] - ends[:, 0], atol=1e-9)


def scene(seed):
    """A random volume, transfer function and camera, of any kind that there is."""
    rng = np.random.default_rng(seed)
    shape = [(9, 8, 7), (6, 12, 9), (1, 9, 9), (2, 2, 2)][rng.integers(4)]
    data = rng.random(shape)
    how = rng.integers(5)
    if how == 1:
        data = np.round(4 * data) / 4
    elif how == 2:
        data = (data < 0.4).astype(float)
    elif how >= 3:
        data = 0.5 + 0.5 * np.sin(sum(rng.uniform(0.1, 0.9) * x for x in np.indices(shape)))
    dtype = ("uint8", "float32")[seed % 2]
    low, wide = (0.0, 255.0) if dtype == "uint8" else (rng.choice([0.0, 100.0]), 10.0 ** rng.uniform(-2, 2))
    data = low + wide * data
    if dtype == "float32":
        data[rng.random(shape) < 0.02] = np.nan
    n = int(rng.choice([2, 3, 8, 64]))
    x = np.sort(low + wide * rng.uniform(-0.1, 1.1, n))
    if rng.random() < 0.4:
        x = np.sort(np.concatenate([x, x[::3] + wide * 10.0 ** -rng.uniform(1, 8)]))
    if rng.random() < 0.4:
        x = np.sort(np.concatenate([x, x[1::4]]))
    opacity = np.minimum(rng.random(len(x)) ** 2 * 10.0 ** rng.uniform(-2, 0.2), 0.999) * (rng.random(len(x)) < 0.8)
    way = rng.normal(size=3) if rng.random() < 0.7 else np.eye(3)[rng.integers(3)] + rng.normal(size=3) * 1e-9
    volume = wvr.Volume(data.astype(dtype), **({"nan": "transparent"} if dtype == "float32" else {}))
    tf = wvr.TransferFunction.from_arrays(x, rng.random((len(x), 3)), opacity)
    return volume, tf, wvr.Camera.fit(volume, way, parallel=bool(rng.random() < 0.5))


@pytest.mark.parametrize("tolerance", [1e-2, 1 / 512, 1e-4])
def test_random_scenes_are_within_their_bounds(tolerance):
    for seed in range(60):
        volume, tf, camera = scene(seed)
        exact = wvr.render(volume, tf, camera, (12, 12), integrator=wvr.Exact())
        image = wvr.render(volume, tf, camera, (12, 12), tolerance=tolerance)
        error = np.abs(image.rgba.astype(float) - exact.rgba).max(axis=2)
        assert np.all(np.isfinite(image.rgba)) and np.all(error <= image.error_bound), seed
        assert image.rgba.min() >= 0 and image.rgba[..., 3].max() <= 1, seed


def test_double_precision_where_single_is_not_good_enough():
    """By the tolerance, or asked for: a slab with nothing to approximate, to rounding of either precision."""
    volume = wvr.Volume(np.full((9, 9, 9), 100, np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.1), (255, "white", 0.1)])
    middle = volume.corners.mean(0)
    camera = wvr.Camera(middle + np.array([0, 0, 20]), middle, up=(0, 1, 0), parallel_scale=4)
    truth = 1 - 0.9**8
    for precision, rounding in (("auto", 1e-6), ("float64", 1e-13)):
        image = wvr.render(volume, tf, camera, (5, 5), tolerance=1e-3, precision=precision)
        assert np.abs(image.rgba[2, 2] - truth).max() < rounding
        assert image.stats["walk"] == ("float32" if precision == "auto" else "float64")
    image = wvr.render(volume, tf, camera, (5, 5), tolerance=1e-6)
    assert image.error_bound.max() < 1e-6 and image.stats["walk"] == "float64"
