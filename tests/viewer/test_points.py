"""Edits of control points: what is edited, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wvr
from wvr.viewer import points
from wvr.viewer.history import History

scalars = st.floats(-10, 210)
unit = st.floats(0, 1)


def function(unit_distance=None):
    return wvr.TransferFunction.from_arrays(
        [0, 50, 50, 120, 200],
        np.random.default_rng(0).random((5, 3)),
        [0.0, 0.1, 0.4, 0.3, 0.9],
        unit_distance,
        ambient=[0.1, 0.2, 0.3, 0.4, 0.5],
    )


@given(st.integers(0, 4), st.floats(-500, 500), st.floats(-1, 2))
def test_a_point_moves_within_its_neighbours(index, scalar, opacity):
    tf = function()
    moved = points.moved(tf, index, scalar, opacity)
    others = np.arange(5) != index
    assert np.array_equal(moved.knots[others], tf.knots[others])
    assert np.array_equal(moved.opacities[others], tf.opacities[others])
    assert np.array_equal(moved.colors, tf.colors) and np.array_equal(moved.ambient, tf.ambient)
    assert moved.opacities[index] == np.clip(opacity, 0, 1)
    if index == 3 and 50 < scalar < 200:
        assert moved.knots[index] == scalar


@given(scalars.filter(lambda s: s not in (0, 50, 120, 200)))
@pytest.mark.parametrize("unit_distance", [None, 2.5, "pyvista"])
def test_a_point_more_changes_nothing_and_can_be_removed(unit_distance, scalar):
    tf = function(unit_distance)
    more = points.added(tf, scalar)
    index = int(np.flatnonzero(more.knots == scalar)[0])
    if unit_distance != "pyvista":
        s = np.linspace(-20, 220, 481)
        assert np.allclose(more.extinction(s), tf.extinction(s), rtol=1e-9, atol=1e-12)
        assert np.allclose(more.color(s), tf.color(s))
    assert points.removed(more, index) == tf


def test_density_multiplies_extinction():
    tf = function(2.0)
    thick = points.rescaled(tf, 3.0)
    s = np.linspace(0, 200, 101)
    assert np.allclose(thick.extinction(s), 3 * tf.extinction(s), rtol=1e-6)


def test_colors_are_those_of_the_screen():
    tf = points.colored(function(), 2, "#ff8000")
    assert points.described(tf)[2] == [50.0, "#ff8000", 0.4]
    assert np.array_equal(tf.colors[2], wvr.TransferFunction([(0, "#ff8000", 0), (1, "red", 1)]).colors[0])


@pytest.mark.parametrize(
    "edit",
    [
        lambda tf: points.moved(tf, 5, 0, 0),
        lambda tf: points.moved(tf, -1, 0, 0),
        lambda tf: points.moved(tf, True, 0, 0),
        lambda tf: points.moved(tf, 1, float("nan"), 0.5),
        lambda tf: points.colored(tf, 0, "no colour"),
        lambda tf: points.added(tf, 50.0),
        lambda tf: points.added(tf, float("inf")),
        lambda tf: points.rescaled(tf, 0.0),
        lambda tf: points.removed(wvr.TransferFunction([(0, "red", 0), (1, "red", 1)]), 0),
    ],
)
def test_what_is_no_edit_is_an_error(edit):
    with pytest.raises(ValueError, match=r"must|unknown|colour"):
        edit(function())


def test_undo_and_redo():
    history = History()
    states = [function()]
    for scalar in (60.0, 70.0, 80.0):
        history.note(states[-1])
        states.append(points.moved(states[-1], 3, scalar, 0.5))
    now = states[-1]
    for before in reversed(states[:-1]):
        now = history.undo(now)
        assert now == before
    assert history.undo(now) == now and history.depth == (0, 3)
    for after in states[1:]:
        now = history.redo(now)
        assert now == after
    now = history.undo(now)
    history.note(now)
    assert history.depth == (3, 0), "an edit ends what could be done again"


def test_a_drag_is_one_edit():
    history = History()
    start = now = function()
    for opacity in (0.2, 0.3, 0.4):
        history.note(now, drag=1)
        now = points.moved(now, 3, 100.0, opacity)
    history.note(now, drag=2)
    assert history.depth == (2, 0)
    assert history.undo(history.undo(now)) == start
