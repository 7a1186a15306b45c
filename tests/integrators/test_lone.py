"""The walk that GPUs run, on the CPU: ticks and places against the walk in double, cells that are cut, whole images."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import wvr
import wvr.frame
from wvr.bricks.frame import BrickedFrame
from wvr.bricks.grid import Bricks
from wvr.field.blocks import spread
from wvr.keep import Keeper
from wvr.kernels.field.blocks import Blocks
from wvr.kernels.field.ticks import make_ticks
from wvr.kernels.integrators.parts import Cut, make_parts
from wvr.kernels.light.glow import Surface
from wvr.kernels.transfer.function import make_transfer
from wvr.kernels.transfer.rows import Rows
from wvr.launch import get_device
from wvr.transfer.function import Transfer, struct_of, transfer_values
from wvr.transfer.rows import jumps, rows

from .test_single import sampled, scene, short_ends

U = 2.0**-24
MOST = 128


@pytest.fixture
def lone(monkeypatch):
    """Kernels of rays that may be left to a second launch, as GPUs have them, and how many are."""
    halves, launch = wvr.frame.Frame.halves, wvr.frame.launch_pixels
    left = []

    def counted(kernel, inputs, *rest):
        left.append(int(np.isinf(inputs[3].numpy()).sum()))
        launch(kernel, inputs, *rest)

    def without_vectors(self, *args):
        given = halves(self, *args)
        alone = replace(given, vectors=False)
        return alone if alone.leaves else given

    monkeypatch.setattr(wvr.frame.Frame, "halves", without_vectors)
    monkeypatch.setattr(wvr.frame, "launch_pixels", counted)
    return left


@wp.kernel(enable_backward=False, module="unique")
def passed(
    last: wp.vec3i,
    blocks: Blocks,
    lines: wp.array2d(dtype=wp.float64),
    cells: wp.array2d(dtype=wp.vec3i),
    middles: wp.array2d(dtype=wp.vec3),
    halves: wp.array2d(dtype=wp.float32),
    times: wp.array2d(dtype=wp.vec2d),
    counts: wp.array(dtype=int),
):
    ray = wp.tid()
    origin = wp.vec3d(lines[ray, 0], lines[ray, 1], lines[ray, 2])
    d = wp.vec3d(lines[ray, 3], lines[ray, 4], lines[ray, 5])
    w = enter(last, origin, d, lines[ray, 6], lines[ray, 7])
    n = wp.int32(0)
    while w.t < w.end:
        w, here = pass_one(blocks, w)
        if here.found != 0:
            cells[ray, n] = here.cell
            middles[ray, n] = here.middle
            halves[ray, n] = here.h
            tick = wp.float64(w.tick)
            times[ray, n] = wp.vec2d(wp.float64(here.start) * tick, wp.float64(here.stop) * tick)
            n += 1
    counts[ray] = n


enter, pass_one = make_ticks()


def walked(masks, shape, lines):
    """What rays pass: cells, middles, halves of lengths, times, and how many."""
    blocks = Blocks()
    blocks.masks = wp.array(masks, dtype=wp.uint64, device="cpu")
    blocks.kinds = wp.array(spread(np.where(masks == 0, -2, -1).astype(np.int16)), dtype=wp.int16, device="cpu")
    n, most = len(lines), 3 * sum(shape)
    outputs = [wp.zeros((n, most), dtype=t, device="cpu") for t in (wp.vec3i, wp.vec3, wp.float32, wp.vec2d)]
    outputs.append(wp.zeros(n, dtype=int, device="cpu"))
    last = wp.vec3i(*(m - 2 for m in reversed(shape)))
    wp.launch(passed, n, [last, blocks, wp.array(lines, device="cpu"), *outputs], device="cpu")
    return [output.numpy() for output in outputs]


@pytest.mark.parametrize("shape", [(70, 63, 82), (2, 2, 2), (3, 2, 300)])
def test_places_in_cells_are_as_exact_as_said(shape):
    """S16: also of rays along axes, faces and edges, from faces on; all that is seen, in order."""
    rng = np.random.default_rng(3)
    n = 400
    size = np.array(shape[::-1]) - 1.0
    d = rng.normal(size=(n, 3))
    d[rng.random((n, 3)) < 0.2] = 0.0
    d[rng.random((n, 3)) < 0.1] *= 10.0 ** -rng.uniform(1, 14)
    d[rng.random((n, 3)) < 0.1] = 1.0
    d[~d.any(axis=1)] = [0, 0, 1]
    d /= np.linalg.norm(d, axis=1)[:, None]
    origin = rng.uniform(0, size, (n, 3))
    on = rng.random((n, 3)) < 0.3
    origin[on] = np.round(origin[on])
    # Through corners of cells, where quotients are whole numbers.
    d[:100], origin[:100] = rng.choice([-1.0, 1.0], (100, 3)) * 3**-0.5, np.round(origin[:100])
    with np.errstate(divide="ignore", invalid="ignore"):
        out = np.where(d > 0, (size - origin) / d, np.where(d < 0, -origin / d, np.inf)).min(axis=1)
    start = rng.choice([0.0, 0.3], n) * out
    lines = np.column_stack([origin, d, start, out])
    masks = rng.integers(0, 2**64, tuple(-(-(m - 1) // 4) for m in shape), np.uint64, endpoint=False)
    masks[rng.random(masks.shape) < 0.99] = 0
    masks[-1, -1, -1] = 2**64 - 1
    cells, middles, h, times, counts = walked(masks, shape, lines)
    checked = 0
    for ray, count in enumerate(counts):
        at, t = cells[ray, :count], times[ray, :count]
        assert np.all((at >= 0) & (at <= np.maximum(size - 1, 0)))
        assert np.all(t[1:, 0] >= t[:-1, 1]) and np.all(t[:, 1] >= t[:, 0])
        bits = (at[:, 2] & 3) << 4 | (at[:, 1] & 3) << 2 | at[:, 0] & 3
        seen = masks[tuple(at[:, ::-1].T >> 2)]
        assert np.all(seen >> bits.astype(np.uint64) & np.uint64(1))
        middle = origin[ray] + (start[ray] + t.mean(axis=1)[:, None]) * d[ray] - at
        slack = 8.7 * U + 2 * sum(shape) * out[ray] * 2.0**-51 + 1e-12
        assert np.all(np.abs(middles[ray, :count] - middle) <= slack)
        assert np.all((middle > -1e-9) & (middle < 1 + 1e-9))
        assert np.allclose(h[ray, :count], np.diff(t)[:, 0] / 2, rtol=3 * U, atol=1e-12)
        # All of the ray that is in cells of the masks, but for what is only touched.
        s = start[ray] + (np.arange(400) + 0.5) / 400 * (out[ray] - start[ray])
        p = np.clip((origin[ray] + s[:, None] * d[ray]).astype(int), 0, np.maximum(size - 1, 0)).astype(int)
        bit = ((p[:, 2] & 3) << 4 | (p[:, 1] & 3) << 2 | p[:, 0] & 3).astype(np.uint64)
        visible = (masks[tuple(p[:, ::-1].T >> 2)] >> bit & np.uint64(1)).astype(bool)
        inside = np.zeros(400, bool)
        for a, b in t:
            inside |= (s - start[ray] >= a) & (s - start[ray] <= b)
        off = np.abs(origin[ray] + s[:, None] * d[ray] - np.round(origin[ray] + s[:, None] * d[ray])).min(axis=1)
        clear = off > 1e-9
        assert np.array_equal(visible[clear], inside[clear])
        checked += int(clear.sum())
    assert checked > 1e4


def test_short_ends_of_long_rays_stay_in_the_grid():
    shape = (9, 9, 9)
    origins, directions, ends = short_ends(2000, shape)
    masks = np.full((2, 2, 2), 2**64 - 1, np.uint64)
    cells, _, h, _, counts = walked(masks, shape, np.column_stack([origins, directions, ends]))
    found = np.arange(cells.shape[1]) < counts[:, None]
    assert np.all(counts > 0) and np.all((cells[found] >= 0) & (cells[found] <= 7))
    np.testing.assert_allclose(2 * h.sum(axis=1, where=found), ends[:, 1] - ends[:, 0], atol=1e-7)


def make_cutting(sharp):
    cut = make_parts(sharp)

    @wp.kernel(enable_backward=False, module="unique")
    def cutting(
        rows: Rows,
        transfer: make_transfer(wp.float64)[0],
        spend: wp.vec3,
        cubic: wp.array(dtype=wp.vec4d),
        h: wp.array(dtype=wp.float32),
        blur: wp.float32,
        result: wp.array(dtype=Cut),
    ):
        c = cubic[wp.tid()]
        m = wp.vec3(wp.float32(c[1]), wp.float32(c[2]), wp.float32(c[3]))
        result[wp.tid()] = cut(rows, transfer, spend, c[0], m, h[wp.tid()], blur, Surface())

    return cutting


@pytest.mark.parametrize("sharp", [False, True])
def test_cut_cells_are_within_their_bounds(sharp):
    """Whatever is behind them: monotone or not, thin and thick, spikes, intervals with nothing to see, and jumps; and
    whichever scalar there is within rounding.
    """
    rng = np.random.default_rng(7)
    spend, left_over, cutting = (1e-3, 1e-6, 1.0), [0.0, 0.0], make_cutting(sharp)
    for trial in range(16):
        # So large that it is more than samples are off by; without jumps also none, as of cubics in double precision.
        blur = 2e-4 * (sharp or trial % 2)
        n = int(rng.choice([3, 5, 12]))
        x = np.sort(rng.random(n))
        x = x[np.diff(x, prepend=-1) > 3e-3]
        if sharp:
            x = np.sort(np.concatenate([x, x[rng.random(len(x)) < 0.6]]))
        opacity = np.minimum(rng.random(len(x)) ** 3 * 10.0 ** rng.uniform(-2, 0.3), 0.999) * (rng.random(len(x)) < 0.7)
        tf = wvr.TransferFunction.from_arrays(x, rng.random((len(x), 3)), opacity)
        cubic = rng.normal(size=(5, MOST)) * 10.0 ** rng.uniform(-3, -0.7, (1, MOST))
        cubic[0] = rng.random(MOST)
        cubic[2:4] *= rng.choice([0, 0.05, 1], (2, MOST))
        cubic[4] = rng.uniform(0.01, 0.9, MOST)
        # Some that touch a control point where they turn, or have none of it.
        cubic[0, ::9], cubic[1, ::9], cubic[3, ::9] = rng.choice(x, len(cubic[0, ::9])), 0, 0
        cubic[1:4, ::13] = 0
        transfer = struct_of(Keeper(get_device("cpu"))(Transfer(tf, 1.0, 0.0, "float64", False)))
        table, bins, numbers = rows(tf.knots, transfer_values(tf, 1.0), 0.0, 1.0)
        numbers["narrow"] = 1e-3
        struct = Rows()
        struct.row, struct.bins = wp.array(table, device="cpu"), wp.array(bins, device="cpu")
        leaps = jumps(tf.knots, transfer_values(tf, 1.0), numbers["narrow"])
        struct.jumps = wp.array(leaps, dtype=wp.float32, device="cpu")
        struct.knots = transfer.knot
        for name, value in numbers.items():
            setattr(struct, name, value)
        result = wp.zeros(MOST, dtype=Cut, device="cpu")
        inputs = [struct, transfer, wp.vec3(*spend), wp.array(cubic[:4].T.copy(), dtype=wp.vec4d, device="cpu")]
        inputs += [wp.array(cubic[4].astype(np.float32), device="cpu"), blur, result]
        wp.launch(cutting, MOST, inputs, device="cpu")
        found = result.numpy()
        cubic[0] += blur * rng.uniform(-1, 1, MOST)
        _, A, color = sampled(tf, cubic)
        whole = found["whole"] == 1
        e = found["e"][whole].astype(float) + 2e-7
        assert np.all(np.isfinite(e))
        assert np.all(np.abs(found["A"] - A)[whole] <= e)
        for c in range(3):
            for behind in (0.0, 1.0):
                off = found["color"][:, c] - color[c] + (A - found["A"]) * behind
                assert np.all(np.abs(off[whole]) <= e)
        assert np.allclose(1 - np.exp(-found["x"][whole].astype(float)), found["A"][whole], rtol=1e-5, atol=1e-7)
        good = whole & (found["e"] <= 2 * spend[0] * found["A"] + 1e-5)
        left_over[blur > 0] += float((~good).mean()) / (16 if sharp else 8)
    # Of so large a blur most is more than is allowed.
    assert left_over[1] < 0.9 and left_over[0] < 0.1


@pytest.mark.filterwarnings("ignore:.*visible", "ignore:.*bounded by more")
@pytest.mark.parametrize("tolerance", [1e-2, 1 / 512, 1e-4])
def test_random_scenes_are_within_their_bounds(lone, tolerance):
    for seed in range(0, 60, 2):
        volume, tf, camera = scene(seed)
        exact = wvr.render(volume, tf, camera, (12, 12), integrator=wvr.Exact())
        image = wvr.render(volume, tf, camera, (12, 12), tolerance=tolerance)
        error = np.abs(image.rgba.astype(float) - exact.rgba).max(axis=2)
        assert np.all(np.isfinite(image.rgba)) and np.all(np.isfinite(image.error_bound))
        assert np.all(error <= image.error_bound), seed
    assert len(lone) == 3 * 30 and (sum(lone) > 0 or tolerance > 1e-3)


def test_absent_cells_and_clips(lone):
    """Samples that are missing are nothing; a bound holds behind what is cut away, and of rays left to others, also
    where that is found out behind a cut.
    """
    rng = np.random.default_rng(0)
    data = (100 * rng.random((9, 9, 9))).astype(np.float32)
    data[3:5, 2:6, 4] = np.nan
    volume = wvr.Volume(data, nan="transparent")
    tf = wvr.TransferFunction([(0, "blue", 0.0), (40, "red", 0.1), (48, "gold", 0.0), (100, "white", 0.5)])
    slab = wvr.ClipBox((-1, -1, 3), (9, 9, 4), invert=True)
    for clip, tolerance in ((wvr.ClipSphere((4, 4, 4), 2.5, invert=True), 1e-3), (slab, 1e-4)):
        lone.clear()
        exact, image = (
            wvr.render(volume, tf, "iso", (24, 24), clip=clip, lighting=False, **options)
            for options in ({"integrator": wvr.Exact()}, {"tolerance": tolerance})
        )
        error = np.abs(image.rgba.astype(float) - exact.rgba).max(axis=2)
        assert np.all(error <= image.error_bound) and image.error_bound.max() <= tolerance
        assert exact.rgba[..., 3].max() > 0.5 and len(lone) == 3


@pytest.mark.filterwarnings("ignore:.*bounded by more")
def test_bricks_are_composed_of_rays_of_either_launch(lone, monkeypatch):
    """A ray that is left to the second launch in one brick is not in another, and counted once; one that ends with a
    brick says what is behind it.
    """
    launch, marked = wvr.frame.launch_pixels, []

    def counted(kernel, inputs, *rest):
        marked.append(int((inputs[2].numpy() < 0).sum()))
        launch(kernel, inputs, *rest)

    scenes = [(scene(4), 1e-4), (scene(606), 1e-2)]
    exact = [wvr.render(*given, (24, 24), integrator=wvr.Exact()).rgba for given, _ in scenes]
    monkeypatch.setattr(wvr.frame, "launch_pixels", counted)
    monkeypatch.setattr(BrickedFrame, "bricks", lambda self: Bricks.regular(self.scene.volume.dimensions, (4, 4, 4)))
    for (given, tolerance), truth in zip(scenes, exact, strict=True):
        image = wvr.render(*given, (24, 24), tolerance=tolerance, memory_limit="1 GiB")
        error = np.abs(image.rgba.astype(float) - truth).max(axis=2)
        assert np.all(error <= image.error_bound) and truth[..., 3].max() > 0.3
        assert image.samples.min() == 0 < image.samples.max()
    assert len(marked) >= 8 and not any(marked[::2]) and sum(marked[1::2]) > 20


@pytest.mark.filterwarnings("ignore:.*visible")
def test_a_flat_cubic_at_control_points_is_left_to_others(lone):
    """Where it rises as its third power, steps of Newton's method end beyond a spike that is narrower than that."""
    z, y, x = np.indices((2, 2, 3))
    data = 3.0 * (x - 0.5) * (y - 0.5) * (z - 0.5)
    data[:, :, 2] = 0
    data[0, 0, 2], data[1, 1, 2] = 0.5, -0.5
    wide, at = 3.11e-6, 1.7e-7
    knots = 8 * np.array([-0.5, *(at + np.arange(5) * wide), 0.5]) + 4
    colors = [(0, 0, 1), (1, 0, 1), (0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 1, 0), (1, 0, 0)]
    opacities = [1e-6, 1e-6, 1e-6, 0.8, 1e-6, 1e-6, 1e-6]
    tf = wvr.TransferFunction.from_arrays(knots, colors, opacities, 1 / 2.7)
    middle = np.full(3, 0.5)
    camera = wvr.Camera(middle - 8, middle, (0, 0, 1), parallel_scale=1e-3)
    volume = wvr.Volume((8 * data + 4).astype("uint8"))
    exact = wvr.render(volume, tf, camera, (3, 3), integrator=wvr.Exact())
    image = wvr.render(volume, tf, camera, (3, 3), tolerance=0.16)
    error = np.abs(image.rgba.astype(float) - exact.rgba).max(axis=2)
    assert np.all(error <= image.error_bound) and exact.rgba[1, 1, 3] > 0.01
    assert sum(lone) > 0
