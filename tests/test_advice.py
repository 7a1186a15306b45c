"""Warnings where an image shows nothing: with the ranges of both, and what would help."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import wvr

ARRAY = np.zeros((8, 8, 8), np.uint8)
ARRAY[2:6, 2:6, 2:6] = 200
VOLUME = wvr.Volume(ARRAY)


def rendered(points, camera=None):
    tf = wvr.TransferFunction(points)
    camera = wvr.Camera.fit(VOLUME) if camera is None else camera
    return wvr.render(VOLUME, tf, camera, (8, 8), integrator=wvr.Riemann(0.5), device="cpu")


@pytest.mark.parametrize(
    "points, message",
    [
        ([(300, "red", 0), (400, "red", 1)], "from 0 to 200, .* from 300 to inf; give it .* opacity among them"),
        ([(-9, "red", 1), (-5, "red", 0)], "from 0 to 200, .* from -inf to -5; give it .* opacity among them"),
        ([(0, "red", 0), (255, "red", 0)], "the transfer function has no opacity at all; give it"),
        ([(0, "red", 0), (255, "red", 1e-5)], "^nothing is .* raise opacities, or make unit_distance smaller"),
        ([(0, "red", 0), (255, "red", 3e-3)], "^nearly nothing is .* raise opacities, or make unit_distance smaller"),
        ([(-1024, "red", 0), (3000, "red", 1)], "from 0 to 200, a small part .* from -1024 to 3000.*domain"),
    ],
)
def test_nothing_to_see(points, message):
    with pytest.warns(UserWarning, match=message) as caught:
        rendered(points)
    assert [one.filename for one in caught] == [__file__]


def test_what_may_have_cut_it_away():
    """Whatever it was: a depth, labels, samples that are NaN."""
    tf = wvr.TransferFunction([(0, "red", 0.5), (255, "red", 0.5)])
    array = np.where(np.indices((4, 4, 4)).sum(axis=0) % 2, np.nan, 1.0)
    with pytest.warns(UserWarning, match=r"clips, labels and depth leave"):
        wvr.render(VOLUME, tf, "iso", (8, 8), integrator=wvr.Riemann(0.5), depth=np.zeros((8, 8)))
    with pytest.warns(UserWarning, match=r"clips, labels, samples that are NaN and depth leave"):
        wvr.render(wvr.Volume(array, nan="transparent"), tf, "iso", (8, 8), integrator=wvr.Projection("max"))


def test_what_is_opaque_but_small_or_out_of_view_is_not_called_faint():
    """Among samples that are nothing, with or without skipping them."""
    array = np.zeros((64, 64, 64), np.uint8)
    array[:4] = 1
    array[2, 2, 2] = 200
    volume = wvr.Volume(array)
    tf = wvr.TransferFunction([(0, "red", 0), (2, "red", 1e-6), (150, "red", 0), (200, "red", 0.9)])
    with pytest.warns(UserWarning, match=r"^nothing is visible .*; what is opaque is small or out of view"):
        wvr.render(
            volume, tf, wvr.Camera((40, 40, 200), (40, 40, 0), (0, 1, 0), 1.0), (8, 8), integrator=wvr.Riemann(0.5)
        )


def test_nothing_in_view():
    with pytest.warns(UserWarning, match="no ray meets any of it"):
        rendered([(0, "red", 0), (255, "red", 0.5)], wvr.Camera((100, 0, 0), (200, 0, 0)))


def test_a_box_that_rounding_does_not_tell_from_nothing():
    volume = wvr.Volume(ARRAY, spacing=(1e-30, 1, 1))
    with pytest.warns(UserWarning, match=r"the box is 1e-30 times as thick as long, .* see spacing"):
        wvr.render(volume, [(0, "red", 0), (255, "red", 0.5)], size=(8, 8), integrator=wvr.Exact())


def test_something_to_see():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rendered([(0, "red", 0), (255, "red", 0.5)])
        rendered([(150, "red", 0), (199, "red", 0.5), (201, "blue", 0)])


def test_isosurfaces_beyond_the_scalars():
    with pytest.warns(UserWarning, match="from 0 to 200, the isosurfaces are at 201, 1000; give values between those"):
        wvr.render(VOLUME, size=(8, 8), integrator=wvr.Isosurface([201, 1000]), device="cpu")
