"""Fewer control points, and deviations that are what they are said to be."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

import wvr
from wvr.transfer.function import transfer_values
from wvr.transfer.simplify import simplify


def interpolated(knots, values, s):
    return np.stack([np.interp(s, knots, v) for v in values.T], axis=-1)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 0.1))
@example(5130, 0.03515625)
def test_deviations(seed, share):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 200))
    knots = np.cumsum(rng.random(n) * (rng.random(n) > 0.02))
    knots = np.delete(knots, np.flatnonzero(knots[2:] == knots[:-2]))
    n = len(knots)
    if n < 2:
        return
    t = np.linspace(0, 3, n)[:, None]
    values = 0.5 + 0.5 * np.sin(t + rng.random(4) * 6) + rng.choice([0, share, 1.0]) * rng.random((n, 4))
    values[:, 3] *= rng.random(n) > rng.choice([0, 0.3])
    result = simplify(knots, values, share, share, share / 100)
    assert result.knots[0] == knots[0] and result.knots[-1] == knots[-1] and set(result.knots) <= set(knots)
    assert result.color <= share and result.relative <= share and result.absolute <= share / 100
    # Between jumps both are continuous: compare where neither has one.
    smooth = np.setdiff1d(knots, knots[1:][np.diff(knots) == 0])
    if np.any(np.diff(knots) == 0):
        assert set(knots[1:][np.diff(knots) == 0]) <= set(result.knots[1:][np.diff(result.knots) == 0])
        return
    s = np.r_[smooth, np.linspace(knots[0], knots[-1], 500)]
    before, after = interpolated(knots, values, s), interpolated(result.knots, result.values, s)
    off = np.abs(before - after)
    visible = np.maximum(before[:, 3], after[:, 3]) > 0
    assert np.array_equal(before[:, 3] > 0, after[:, 3] > 0)
    assert off[visible, :3].max(initial=0) <= result.color + 1e-12
    # At a control point it is the one or the other, between two of which one is off by each it is some of both.
    relative, absolute = result.relative * np.minimum(before[:, 3], after[:, 3]), result.absolute
    most = np.where(np.arange(len(s)) < len(smooth), np.maximum(relative, absolute), relative + absolute)
    assert np.all(off[:, 3] <= most + 1e-12)


def test_a_color_map_loses_most_of_its_control_points():
    tf = wvr.TransferFunction.from_colormap("viridis", (0, 255), [0, 0, 0.1, 0.3])
    result = simplify(tf.knots, transfer_values(tf, 1.0), 1e-3, 1e-3, 0.0)
    assert len(result.knots) < len(tf.knots) / 6
    straight = np.linspace(0, 1, 100)
    assert len(simplify(straight, np.stack([straight] * 4, axis=1) + 1, 1e-9, 1e-9, 0.0).knots) == 2


def test_transparent_parts_need_no_colors():
    rng = np.random.default_rng(0)
    values = rng.random((50, 4))
    values[10:40, 3] = 0
    kept = simplify(np.arange(50.0), values, 1e-6, 1e-6, 0.0).knots
    assert not np.any((kept > 10) & (kept < 39)) and {9, 10, 39, 40} <= set(kept)


def test_what_a_simpler_transfer_function_leaves_out_is_in_the_bound():
    """In a uniform field nothing else is: the colour where a control point is left out, and its whole height."""
    height = 5e-4
    volume = wvr.Volume(np.full((5, 5, 5), 11, np.uint8))
    tf = wvr.TransferFunction([(i, [0.5 + height * (i % 3 == 2)] * 3, 0.9) for i in range(256)])
    camera = wvr.Camera.fit(volume, direction=(1, 0.5, 0.3))
    image, exact = (
        wvr.render(volume, tf, camera, (8, 8), integrator=one) for one in (wvr.Certified(0.01), wvr.Exact())
    )
    off = np.abs(image.rgba - exact.rgba).max(axis=-1)
    assert np.all(off <= image.error_bound) and off.max() > 0.9 * height
