"""Handles of clips: under the pointer, where the clip is, and what a drag sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import wvr
from tests.viewer.helpers import Client, source
from wvr.viewer.clips import DEFAULTS, box_of, clips_of, plane_of, sphere_of, updated
from wvr.viewer.handles import View, anchor_of, handles, lines, overlay
from wvr.viewer.state import Presentation, State

SIZE = (320, 240)
# Of a box that is not a cube and lies askew.
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
CORNERS = np.array([[(c >> a) & 1 for a in range(3)] for c in range(8)]) * (4.0, 6.0, 9.0) @ TURN.T + (1, 2, 3)
part = st.floats(0.1, 0.9)
parts = st.tuples(part, part, part)
angles = st.tuples(st.floats(0, 360), st.floats(-75, 75), st.booleans())


def unit(vector):
    return np.array(vector) / np.linalg.norm(vector)


def camera(azimuth, elevation, parallel):
    around, above = np.radians([azimuth, elevation])
    direction = np.array([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above)])
    middle = CORNERS.mean(axis=0)
    return wvr.Camera(middle + 40 * direction, middle, parallel_scale=7.0 if parallel else None)


def state(view, **cuts):
    now = DEFAULTS
    for kind, changes in cuts.items():
        now = updated(now, kind, {"on": True, **changes})
    return State(Presentation(view, None, SIZE), cuts=now)


def handle(state, name):
    return next(one for one in handles(state, CORNERS) if one.name == name)


def pulled(before, name, place):
    """The state after a handle is dragged to a place."""
    held = handle(before, name)
    anchor = tuple(anchor_of(before, CORNERS).tolist()) if held.kind == "plane" else None
    changes = held.pull(View(before.presentation.camera, SIZE), place)
    return replace(before, cuts=updated(before.cuts, held.kind, changes), anchor=anchor)


def place(state, name):
    return View(state.presentation.camera, SIZE).place(handle(state, name).position)


@settings(max_examples=60, deadline=None)
@given(angles, parts, st.sampled_from([f"box {end} {axis}" for end in ("lo", "hi") for axis in "xyz"]), part)
def test_a_face_of_a_box_goes_where_it_is_dragged(view, lo, name, to):
    """To where the face that is wanted is in the picture; no other face moves."""
    _, end, axis = name.split()
    axis = "xyz".index(axis)
    before = state(camera(*view), box={"lo": [0.45 * x for x in lo], "hi": [0.55 + 0.45 * x for x in lo]})
    wanted = list(before.cuts["box"][end])
    wanted[axis] = 0.45 * to + (0.55 if end == "hi" else 0)
    target = replace(before, cuts=updated(before.cuts, "box", {end: wanted}))
    sight = unit(handle(before, name).position - before.presentation.camera.position)
    if abs(sight[axis]) > 0.98:  # seen from its end it goes by the mouse's height
        return
    after = pulled(before, name, place(target, name))
    assert np.allclose(box_of(after.cuts["box"], CORNERS), box_of(target.cuts["box"], CORNERS), atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(angles, parts, parts, part, part)
def test_a_ball_goes_where_it_is_dragged(view, center, step, radius, other):
    """Its outline to the pointer; its centre across the view, to under the pointer, unless it would leave the box."""
    before = state(camera(*view), sphere={"center": list(center), "radius": radius})
    target = replace(before, cuts=updated(before.cuts, "sphere", {"radius": other}))
    after = pulled(before, "sphere radius", place(target, "sphere radius"))
    assert after.cuts["sphere"]["radius"] == pytest.approx(other, abs=1e-6)
    pointer = place(before, "sphere center") + 4 * np.array(step[:2])
    moved = pulled(before, "sphere center", pointer)
    if np.all(np.abs(np.array(moved.cuts["sphere"]["center"]) - 0.5) < 0.49):
        assert np.allclose(place(moved, "sphere center"), pointer, atol=1e-6)
        forward = before.presentation.camera.basis()[2]
        way = handle(moved, "sphere center").position - handle(before, "sphere center").position
        assert abs(way @ forward) < 1e-9


@settings(max_examples=60, deadline=None)
@given(angles, st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1), part, st.floats(-1, 1))
def test_a_plane_is_moved_along_its_normal_and_tilted(view, normal, at, turn):
    before = state(camera(*view), plane={"normal": list(normal), "at": at})
    right, up, forward = before.presentation.camera.basis()
    anchor = anchor_of(before, CORNERS)
    # Tilted: the tip is under the pointer, the plane goes through the same point.
    side = (
        1.0 if unit(normal) @ View(before.presentation.camera, SIZE).ray(place(before, "plane normal"))[1] > 0 else -1.0
    )
    wanted = unit(np.cos(turn) * right + np.sin(turn) * up + side * (1 + abs(turn)) * forward)
    target = replace(before, cuts=updated(before.cuts, "plane", {"normal": wanted.tolist()}))
    tip = anchor + np.linalg.norm(handle(before, "plane normal").position - anchor) * wanted
    after = pulled(before, "plane normal", View(before.presentation.camera, SIZE).place(tip))
    point, found = plane_of(after.cuts["plane"], CORNERS)
    assert np.allclose(found, wanted, atol=1e-6) and abs((anchor - point) @ found) < 1e-6
    assert np.allclose(handle(after, "plane normal").position, tip, atol=1e-6)
    # Moved: along the normal, to where the pointer is.
    if np.linalg.norm(np.cross(unit(normal), unit(anchor - before.presentation.camera.position))) < 0.2:
        return
    target = replace(before, cuts=updated(before.cuts, "plane", {"at": at / 2}), anchor=tuple(anchor))
    after = pulled(before, "plane at", place(target, "plane at"))
    assert after.cuts["plane"]["at"] == pytest.approx(at / 2, abs=1e-6)
    assert np.allclose(after.cuts["plane"]["normal"], normal)


def test_a_tip_goes_around_its_point():
    """Outside of what its ball is in the picture it goes on to the far side."""
    before = state(camera(0, 0, True), plane={"normal": [1.0, 0.0, 0.0]})  # towards the camera
    middle, rim = place(before, "plane at"), 0.15 * SIZE[1]
    seen = [
        pulled(before, "plane normal", middle + np.array((x * rim, 0))).cuts["plane"]["normal"]
        for x in (0, 0.6, 1, 1.5, 9)
    ]
    expected = [(1, 0, 0), (0.8, 0.6, 0), (0, 1, 0), (-np.sin(0.5), np.cos(0.5), 0), (-1, 0, 0)]
    assert np.allclose(seen, expected, atol=1e-6)


def test_what_is_seen_from_its_end_goes_by_the_height_of_the_pointer():
    before = state(camera(0, 0, True), plane={"normal": [-1.0, 0.0, 0.0]})  # away from the camera
    here = place(before, "plane at")
    world = 12.0 * 2 * 7.0 / SIZE[1]
    after = pulled(before, "plane at", here - (0, 12))
    assert after.cuts["plane"]["at"] == pytest.approx(0.5 + world / np.ptp(CORNERS[:, 0]))


@settings(max_examples=40, deadline=None)
@given(angles, st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1), st.floats(0, 1), parts)
@example((0.0, 0.0, False), (0.0, 5.9e-253, 1.0), 0.0, (0.5, 0.5, 0.5))
def test_lines_are_where_clips_cut(view, normal, at, center):
    """The plane's on its cut of the box, the ball's where rays touch it."""
    now = state(camera(*view), plane={"normal": list(normal), "at": at}, sphere={"center": list(center)}, box={})
    drawn = lines(now, CORNERS)
    (section, arrow), (outline,) = ([points for of, points in drawn if of == kind] for kind in ("plane", "sphere"))
    point, unit_normal = plane_of(now.cuts["plane"], CORNERS)
    assert np.abs((section - point) @ unit_normal).max() < 1e-6
    inside = (section - CORNERS[0]) @ TURN
    assert np.all(inside > -1e-6) and np.all(inside < np.array((4, 6, 9)) + 1e-6)
    assert np.allclose(arrow[0], anchor_of(now, CORNERS))
    middle, radius = sphere_of(now.cuts["sphere"], CORNERS)
    for row in View(now.presentation.camera, SIZE).place(outline):
        origin, ray = View(now.presentation.camera, SIZE).ray(row)
        assert np.linalg.norm(np.cross(middle - origin, ray)) == pytest.approx(radius, rel=1e-6)
    assert sum(kind == "box" for kind, _ in drawn) == 12
    assert len(overlay(now, CORNERS)["handles"]) == 10


def test_what_is_behind_the_camera_has_no_handles():
    middle = CORNERS.mean(axis=0)
    inside = wvr.Camera(middle, middle + np.array((0, 0, 1)), up=(0, 1, 0))
    shown = overlay(state(inside, plane={"normal": [0, 0, 1], "at": 0.2}, sphere={}, box={"hi": [1, 1, 1]}), CORNERS)
    names = [one["name"] for one in shown["handles"]]
    assert "plane at" not in names and "plane normal" not in names and "sphere radius" not in names
    assert "box hi z" in names and all(np.all(np.isfinite(at)) for _, at in shown["lines"])


def test_a_drag_of_a_handle_cuts_and_is_undone_as_a_whole():
    """And so are keys on one; the picture is the still's all the time."""
    with Client(source()) as client:
        client.say("clip", kind="plane", set={"on": True, "normal": [0, 0, 1]})
        first = client.final()
        shown = {one["name"]: one for one in client.last("picture")["overlay"]["handles"]}
        (x, y), depth = shown["plane at"]["at"], client.last("state")["history"][0]
        client.say("grab", handle="plane at", at=[x, y])
        for step in (0.05, 0.1, 0.15):
            client.say("pull", at=[x, y - step])
        client.say("drop")
        client.say("pull", at=[0, 0])
        cut = client.final()
        assert client.last("state")["history"] == (depth + 1, 0) and not client.errors
        assert client.session.state.cuts["plane"]["at"] > 0.55 and client.session.state.anchor is None
        image = wvr.render(
            client.session.source.first_volume,
            cut.state.presentation.transfer_function,
            cut.state.presentation.camera,
            cut.state.presentation.size,
            clip=clips_of(client.session.state.cuts, client.session.source.first_volume.corners),
            background="black",
        )
        assert np.array_equal(cut.image.rgba, image.rgba) and not np.array_equal(cut.image.rgba, first.image.rgba)
        after = {one["name"]: one for one in client.last("picture")["overlay"]["handles"]}["plane at"]
        assert after["at"][1] == pytest.approx(y - 0.15, abs=0.02)
        client.say("script")
        assert "ClipPlane" in client.last("text")["text"]
        for _ in range(3):
            client.say("nudge", handle="plane normal", key="ArrowLeft")
        tilted = client.session.state.cuts
        client.say("nudge", handle="plane at", key="PageUp", fine=True)
        assert client.session.state.cuts["plane"]["at"] == pytest.approx(tilted["plane"]["at"] + 0.01)
        assert client.last("state")["history"] == (depth + 3, 0)
        client.say("undo")
        assert client.session.state.cuts == tilted
        client.say("undo")
        client.say("undo")
        assert np.array_equal(client.final().image.rgba, first.image.rgba)
        client.say("redo")
        assert np.array_equal(client.final().image.rgba, cut.image.rgba)
        # Edits of the transfer function are in the same line.
        client.say("edit", op="move", index=1, scalar=0.5, opacity=0.9)
        client.say("clip", kind="plane", set={"on": False})
        client.say("undo")
        assert client.session.state.cuts["plane"]["on"] and client.last("state")["history"][0] == depth + 2
