"""Cameras move as VTK's own do."""

from __future__ import annotations

import numpy as np
import pytest
from vtkmodules.vtkRenderingCore import vtkCamera

import wvr
from wvr.viewer import trackball
from wvr.viewer.cameras import projected
from wvr.viewer.pointer import Pointer, arrow, wheel

SIZE = (400, 300)
SCALES = [None, 3.0]


def camera(seed, scale=None):
    rng = np.random.default_rng(seed)
    return wvr.Camera(5 * rng.normal(size=3), rng.normal(size=3), rng.normal(size=3), 40.0, scale)


def vtk(of):
    result = vtkCamera()
    result.SetPosition(of.position)
    result.SetFocalPoint(of.target)
    result.SetViewUp(of.up)
    result.SetViewAngle(of.view_angle)
    if of.parallel:
        result.ParallelProjectionOn()
        result.SetParallelScale(of.parallel_scale)
    return result


def assert_same(ours, theirs):
    assert np.allclose(ours.position, theirs.GetPosition(), atol=1e-9)
    assert np.allclose(ours.target, theirs.GetFocalPoint(), atol=1e-9)
    _, up, _ = ours.basis()
    _, theirs_up, _ = wvr.Camera(theirs.GetPosition(), theirs.GetFocalPoint(), theirs.GetViewUp()).basis()
    assert np.allclose(up, theirs_up, atol=1e-9)
    if ours.parallel:
        assert np.isclose(ours.parallel_scale, theirs.GetParallelScale())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", SCALES)
def test_moves_are_those_of_vtk(seed, scale):
    """As vtkInteractorStyleTrackballCamera makes them of Azimuth, Elevation, Roll, Zoom and Dolly."""
    given = camera(seed, scale)
    dx, dy = np.random.default_rng(seed + 100).uniform(-60, 60, 2)
    theirs = vtk(given)
    # VTK's pixels count upwards; a motion factor of 10 and 20 degrees across the picture.
    theirs.Azimuth(dx * -20 / SIZE[0] * 10)
    theirs.Elevation(-dy * -20 / SIZE[1] * 10)
    theirs.OrthogonalizeViewUp()
    assert_same(trackball.rotate(given, dx, dy, SIZE), theirs)

    theirs = vtk(given)
    start, end = (250.0, 100.0), (180.0, 60.0)
    angles = [np.degrees(np.arctan2(SIZE[1] / 2 - y, x - SIZE[0] / 2)) for x, y in (start, end)]
    theirs.Roll(angles[1] - angles[0])
    theirs.OrthogonalizeViewUp()
    assert_same(trackball.spin(given, start, end, SIZE), theirs)

    theirs = vtk(given)
    factor = 1.1 ** (10 * -dy / (SIZE[1] / 2))
    if scale is None:
        theirs.Dolly(factor)
    else:
        theirs.SetParallelScale(scale / factor)
    assert_same(trackball.drag(given, dy, SIZE), theirs)


@pytest.mark.parametrize("scale", SCALES)
def test_a_pan_keeps_the_target_plane_under_the_mouse(scale):
    given = camera(3, scale)
    moved = trackball.pan(given, 30, -20, SIZE)
    before, after = given.project(given.target, SIZE), moved.project(given.target, SIZE)
    assert np.allclose(after - before, (30, -20))


def test_moves_go_back():
    """What is done to and fro is undone; a spin all around, too."""
    given = camera(1)
    assert_same(trackball.zoom(trackball.zoom(given, 3), -3), vtk(given))
    assert_same(trackball.pan(trackball.pan(given, 9, 5, SIZE), -9, -5, SIZE), vtk(given))
    turned = given
    for start, end in (
        ((300, 150), (200, 50)),
        ((200, 50), (100, 150)),
        ((100, 150), (200, 250)),
        ((200, 250), (300, 150)),
    ):
        turned = trackball.spin(turned, start, end, SIZE)
    assert_same(turned, vtk(given))


def test_there_is_always_a_camera():
    """However far it is dragged, and over the poles."""
    moving = camera(2)
    for dx, dy in np.random.default_rng(0).uniform(-2000, 2000, (200, 2)):
        moving = trackball.drag(trackball.rotate(moving, dx, dy, SIZE), dy, SIZE)
        assert np.all(np.isfinite(moving.position))


def event(x, y, button=1, *modifiers):
    return {"x": x, "y": y, "button": button, "modifiers": modifiers}


@pytest.mark.parametrize(
    ("button", "modifiers", "move"),
    [
        (1, (), lambda c: trackball.rotate(c, 7, 4, SIZE)),
        (1, ("Shift",), lambda c: trackball.pan(c, 7, 4, SIZE)),
        (3, (), lambda c: trackball.pan(c, 7, 4, SIZE)),
        (2, (), lambda c: trackball.drag(c, 4, SIZE)),
        (1, ("Shift", "Control"), lambda c: trackball.drag(c, 4, SIZE)),
        (1, ("Control",), lambda c: trackball.spin(c, (10, 20), (17, 24), SIZE)),
        (5, (), lambda c: c),
    ],
)
def test_buttons_are_those_of_vtk(button, modifiers, move):
    given = camera(0)
    pointer = Pointer()
    assert pointer.move(given, event(0, 0), SIZE) is given, "nothing is held"
    pointer.press(event(10, 20, button))
    assert_same(pointer.move(given, event(17, 24, 0, *modifiers), SIZE), vtk(move(given)))
    pointer.release()
    assert pointer.move(given, event(50, 50), SIZE) is given


def test_wheel_and_arrows():
    given = camera(0)
    distance = np.linalg.norm(given.position - given.target)
    near = wheel(given, {"dy": -100})
    assert np.isclose(np.linalg.norm(near.position - near.target), distance / 1.1**2)
    assert_same(arrow(given, "ArrowLeft", False, SIZE), vtk(trackball.rotate(given, -20, 0, SIZE)))
    assert_same(arrow(given, "ArrowUp", True, SIZE), vtk(trackball.pan(given, 0, -15, SIZE)))


def test_projections_keep_the_size_of_what_is_at_the_target():
    given = camera(4)
    _, up, _ = given.basis()
    place = given.target + 0.1 * up
    flat = projected(given, True)
    assert flat.parallel and np.allclose(flat.project(place, SIZE), given.project(place, SIZE))
    assert_same(projected(flat, False), vtk(given))
    assert projected(flat, True) is flat
