"""Faces of absent cells that rays cross nearly along them: what rounding decides on is in the bound (lemma 15)."""

from __future__ import annotations

import numpy as np
import pytest

import wvr
from wvr.bricks import stored
from wvr.bricks.frame import BrickedFrame
from wvr.bricks.grid import Bricks
from wvr.faces import proven

TF = wvr.TransferFunction([(0, (1, 1, 1), 0.1), (1, (1, 1, 1), 0.3)])
TOLERANCE = 1e-5
SIZE = (13, 13)


def half_absent(axis, end=5, spacing=1.0):
    """Below 5 along an axis, or in another slice, from 6 on along the one before."""
    data = np.random.default_rng(1).uniform(0.2, 0.9, (12, 12, 12)).astype(np.float32)
    np.moveaxis(data, (2 - axis, (3 - axis) % 3), (2, 0))[6:, :, end if isinstance(end, slice) else slice(end)] = np.nan
    return wvr.Volume(data, (spacing,) * 3, nan="transparent")


def along_the_face(axis, slope):
    """Parallel rays nearly along y that cross the face x = 5 at y = 5.5; axes in turn."""
    turn = [(axis + n) % 3 for n in range(3)]
    position, way, up = np.zeros(3), np.zeros(3), np.zeros(3)
    position[turn], way[turn], up[turn] = (5 - 25.5 * slope, -20, 5.5), (slope, 1, 0), (0, 0, 1)
    return wvr.Camera(position, position + 25 * way, up=up, parallel_scale=6)


@pytest.mark.parametrize("limit", [None, "1 MiB"], ids=["whole", "bricks"])
@pytest.mark.parametrize("axis", range(3))
def test_bounds_hold_nearly_along_a_face(axis, limit, monkeypatch):
    monkeypatch.setattr(BrickedFrame, "bricks", lambda self: Bricks.regular(self.scene.volume.dimensions, (3, 3, 3)))
    volume = half_absent(axis)
    for slope in (1e-6, 1e-9, 1e-11, 1e-12):
        camera = along_the_face(axis, slope)
        image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, lighting=False, memory_limit=limit)
        column = [(6, y) for y in (2, 5, 9)] if axis == 0 else [(x, 6) for x in (2, 5, 9)]
        for x, y in (*column, (6, 6)):
            truth = wvr.enclose(volume, TF, camera, x, y, size=SIZE)
            off = np.maximum(truth.lower - image.rgba[y, x], image.rgba[y, x] - truth.upper).max()
            assert off <= image.error_bound[y, x], (slope, x, y, off, image.error_bound[y, x])
        assert (image.error_bound.max() > TOLERANCE) == (slope < 1e-8)
        # Others are none the worse.
        assert np.median(image.error_bound) <= TOLERANCE


def test_rays_along_axes_are_within_the_tolerance():
    """In faces, which are one side's by definition, and in cells."""
    volume = half_absent(0)
    for up in ((0, 0, 1), (0, 1e-17, 1)):
        camera = wvr.Camera((5, -20, 5), (5, 0, 5), up=up, parallel_scale=6)
        image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, lighting=False)
        assert image.error_bound.max() <= TOLERANCE and image.rgba.any()


def test_rays_in_a_face_but_for_rounding_may_see_either_side():
    volume, x = half_absent(0), 5 + 2e-15
    camera = wvr.Camera((x, -20, 5.5), (x, 0, 5.5), up=(0, 0, 1), parallel_scale=6)
    image = wvr.render(volume, TF, camera, SIZE, tolerance=TOLERANCE, lighting=False)
    wide = image.error_bound > TOLERANCE
    # Where the other side is absent, which it is in the upper half.
    assert wide[2:6, 6].all() and image.error_bound[2:6, 6].min() > 0.1 and not np.delete(wide, 6, axis=1).any()
    assert not wide[8:, 6].any()


def in_a_face(x, spacing=1.0, z=5.5):
    """Parallel rays along y, those of the middle column at x."""
    return wvr.Camera((x, -20, z * spacing), (x, 0, z * spacing), up=(0, 0, 1), parallel_scale=6 * spacing)


@pytest.mark.parametrize("limit", [None, "1 MiB"], ids=["whole", "bricks"])
def test_rays_that_rounding_puts_into_a_face_may_see_either_side(limit):
    """0.3 / 0.1 is 3 but for rounding, and less: the ray is in the cells below."""
    volume, camera = half_absent(0, 3, 0.1), in_a_face(0.3, 0.1)
    image = wvr.render(volume, TF, camera, (1, 13), tolerance=TOLERANCE, lighting=False, memory_limit=limit)
    above, below = (wvr.enclose(volume, TF, camera, 0, y, size=(1, 13)).upper for y in (2, 9))
    assert above.max() == 0 and image.rgba[2, 0].max() > 0.02
    assert np.abs(image.rgba[2, 0] - above).max() <= image.error_bound[2, 0]
    assert np.abs(image.rgba[9, 0] - below).max() <= image.error_bound[9, 0] <= TOLERANCE


@pytest.mark.parametrize(
    ("what", "limit"),
    [
        (wvr.Projection("max"), None),
        (wvr.Projection("max"), "1 MiB"),
        (wvr.Projection("sum"), "1 MiB"),
        (wvr.Isosurface(0.6), "1 MiB"),
    ],
    ids=str,
)
def test_projections_of_such_rays_are_anything(what, limit, monkeypatch):
    """A column is computed to have the values of the cells above, which it has not, or none, where it has values; in
    bricks those are of one cell.
    """
    edges = ((0, 3, 4, 11), (0, 6, 11), (0, 6, 11))
    monkeypatch.setattr(BrickedFrame, "bricks", lambda self: Bricks(edges))
    for volume in (half_absent(0, 3, 0.1), half_absent(0, slice(4, None), 0.1)):
        for x in (0.3, 0.35):
            camera = in_a_face(x, 0.1)
            image = wvr.render(volume, None, camera, (1, 13), integrator=what, lighting=False, memory_limit=limit)
            assert (image.error_bound[2:6] >= 1).all() == (x == 0.3)
            assert (image.error_bound[8:11] < 1e-6).all() or (limit is not None and x == 0.3)


def test_a_kept_renderer_of_bricks_proves_it_of_each_camera(monkeypatch):
    """What is kept of bricks is of no camera: rays of the frame before are in no face, for sure."""
    monkeypatch.setattr(BrickedFrame, "bricks", lambda self: Bricks.regular(self.scene.volume.dimensions, (6, 6, 6)))
    volume = half_absent(0, 3, 0.1)
    kept = wvr.Renderer(volume, TF, tolerance=TOLERANCE, memory_limit="1 GiB")
    for x, most in ((0.35, TOLERANCE), (0.3, 1.1), (0.35, TOLERANCE)):
        image = kept.render(in_a_face(x, 0.1), (1, 13))
        truth = wvr.enclose(volume, TF, in_a_face(x, 0.1), 0, 2, size=(1, 13))
        assert np.abs(image.rgba[2, 0] - truth.upper).max() <= image.error_bound[2, 0] <= most


def test_under_a_budget_no_doubt_is_brighter_than_there_is(monkeypatch):
    """Each of four bricks along such a ray may be anything, and all of them together no more."""
    monkeypatch.setattr(stored, "ALONG", 3)
    data = half_absent(0, 3, 0.1).numpy()
    known = wvr.build_ranges(wvr.open(data, spacing=(0.1,) * 3, nan="transparent"))
    camera, options = in_a_face(0.3, 0.1), {"tolerance": TOLERANCE, "lighting": False, "budget": "1 MB"}
    image = wvr.render(known, TF, camera, (1, 13), **options)
    assert image.error_bound[2, 0] >= image.rgba[2, 0].max() and image.rgba.max() <= 1 and image.error_bound.max() <= 1
    # Of such rays some bricks were read: whether there is anything in them nobody knows either.
    options = {"integrator": wvr.Projection("sum"), "lighting": False, "budget": "3 kB"}
    image = wvr.render(known, TF, camera, (1, 13), **options)
    assert image.stats["bricks_rendered"] == 5 and np.isinf(image.error_bound[2:6]).all()


def test_which_rays_are_in_faces_is_proven():
    volume, thin = half_absent(0), half_absent(0, 3, 0.1)
    assert proven(volume, in_a_face(5.0), SIZE, 1e-12) == (1, 0, 1)
    assert proven(volume, in_a_face(5.0), (13, 12), 1e-12) == (1, 0, 1)
    assert proven(volume, in_a_face(5.0 + 2e-15), SIZE, 1e-12) == (0, 0, 1)
    assert proven(thin, in_a_face(0.3, 0.1), SIZE, 1e-12)[0] == 0
    assert proven(thin, in_a_face(0.35, 0.1), (12, 12), 1e-12)[0] == 0
    # In half a right angle to the grid; nearly along an axis; rays that have a slope.
    across = wvr.Camera((-20, -20, 5), (0, 0, 5), parallel_scale=6)
    assert proven(volume, across, (13, 12), 1e-12) == (0, 0, 1)
    nearly = wvr.Camera((0, -20, 5), (1e-300, 0, 5), parallel_scale=6)
    assert proven(volume, nearly, SIZE, 1e-12)[0] == 0
    assert proven(volume, wvr.Camera((5, -20, 5), (5, 0, 5), parallel_scale=1e150), SIZE, 1e-12) == (0, 0, 0)
    wide = wvr.Camera((5, -20, 4), (5, 0, 4))
    assert proven(volume, wide, (13, 13), 1e-12) == (1, 0, 1)
    assert proven(volume, wvr.Camera((5, -20, 4.5), (5, 0, 4.5)), SIZE, 1e-12) == (1, 0, 0)


def test_holes_everywhere_cost_no_more_than_rounding():
    data = np.random.default_rng(2).uniform(0.2, 0.9, (20, 20, 20)).astype(np.float32)
    data[np.random.default_rng(3).random(data.shape) < 0.1] = np.nan
    volume = wvr.Volume(data, (1, 1.5, 0.7), nan="transparent")
    image = wvr.render(volume, TF, wvr.Camera.fit(volume, (1, 0.7, 0.4)), SIZE, tolerance=1e-6, lighting=False)
    assert image.error_bound.max() <= 1e-6
