"""Rays that clips cut, sixteen abreast: neighbours with other numbers of stretches, and what ends them."""

import numpy as np
import pytest

import wvr

from ..helpers import SMOOTH, assert_certified, centered, constant, middle

TOLERANCE = 1 / 512


@pytest.mark.parametrize("depth", [False, True], ids=["", "depth"])
def test_hollows_of_a_block(depth):
    """What is left of a ray is its length less the chords of the balls, which are in its way or not."""
    volume = centered(np.full((16, 16, 40), 100, np.uint8))
    balls = [((-14, 0, 0), 5.0), ((-2, 3, -2), 4.0), ((7, -3, 1), 3.0), ((15, 2, 3), 2.5)]
    clips = [wvr.ClipSphere(center, radius, invert=True) for center, radius in balls]
    camera = wvr.Camera((-50, 0.1, 0.2), (0, 0.1, 0.2), (0, 0, 1), parallel_scale=7.0)
    origins, _ = camera.rays((40, 40))
    length = np.full((40, 40), 39.0)
    stretches = np.ones((40, 40), int)
    options = {"depth": np.full((40, 40), 50 - 2.5)} if depth else {}
    if depth:
        length -= 19.5 + 2.5
    for (x, *center), radius in balls:
        d2 = ((origins[..., 1:] - center) ** 2).sum(axis=-1)
        half = np.sqrt(np.maximum(radius**2 - d2, 0))
        behind = np.clip(-2.5 - x, -half, half) if depth else half
        length -= half + behind
        stretches += (half > 0) & (behind > -half)
    assert set(np.unique(stretches)) >= {1, 2, 3}
    image = wvr.render(volume, constant(0.02, "white"), camera, (40, 40), tolerance=TOLERANCE, clip=clips, **options)
    assert image.stats["walk"] == "float32"
    opacity = 1 - 0.98**length
    assert np.all(np.abs(image.rgba - opacity[..., None]).max(axis=-1) <= image.error_bound)
    assert image.error_bound.max() <= TOLERANCE


def all_clips(volume):
    """Of every kind, and several of them."""
    center = middle(volume)
    k, j, i = np.indices((9, 9, 9)) - 4.0
    waves = wvr.Volume(np.sin(i) + np.cos(1.3 * j) * np.sin(k), volume.spacing * 2.5, volume.origin)
    plane = wvr.ClipPlane(center, (1, 0.3, 0.2))
    hollow = wvr.ClipSphere(center, 7.0, invert=True)
    box = wvr.ClipBox(center - 8.0, center + np.array((9.0, 5.0, 7.5)))
    hole = wvr.ClipBox(center - np.array((20.0, 2.0, 3.0)), center + np.array((20.0, 3.0, 2.0)), invert=True)
    return {
        "all kept": wvr.ClipPlane(center - 100.0, (1, 1, 1)),
        "plane": plane,
        "box": box,
        "sphere": wvr.ClipSphere(center, 9.0),
        "hollow": [hollow, plane],
        "several": [hole, hollow, box],
        "volume": wvr.ClipVolume(waves, 0.1),
        "volumes": [wvr.ClipVolume(waves, -0.7), wvr.ClipVolume(waves, 0.7, invert=True), hole],
        "nothing left": [wvr.ClipBox(center - 1.0, center + 1.0), hollow],
    }


@pytest.mark.filterwarnings("ignore:nothing is visible")
def test_every_kind_within_its_bound(blobs):
    """As one by one in double precision, from outside and inside."""
    center = middle(blobs)
    inside = wvr.Camera(center + np.array((2.0, 1.0, 7.5)), center, (0, 0, 1), 100.0)
    for name, clip in all_clips(blobs).items():
        for camera in (wvr.Camera.fit(blobs, direction=(1, 0.4, 0.3)), inside):
            image = assert_certified(blobs, SMOOTH, camera, TOLERANCE, (35, 21), clip=clip)
            assert image.stats["walk"] == "float32"
            assert image.rgba.any() == (name != "nothing left")
            for termination in (0.3, 0.02):
                exact = wvr.render(blobs, SMOOTH, camera, (35, 21), integrator=wvr.Exact(), termination=0, clip=clip)
                ended = wvr.render(
                    blobs, SMOOTH, camera, (35, 21), tolerance=TOLERANCE, termination=termination, clip=clip
                )
                assert np.all(np.abs(ended.rgba - exact.rgba).max(axis=-1) <= ended.error_bound)


def test_what_keeps_all_changes_nothing(blobs):
    """Not a bit; the bounds of rays that end have more to be behind."""
    camera = wvr.Camera.fit(blobs)
    whole = wvr.render(blobs, SMOOTH, camera, (40, 40), tolerance=TOLERANCE)
    kept = wvr.render(blobs, SMOOTH, camera, (40, 40), tolerance=TOLERANCE, clip=all_clips(blobs)["all kept"])
    np.testing.assert_array_equal(kept.rgba, whole.rgba)
    np.testing.assert_array_equal(kept.samples, whole.samples)
    assert np.all(kept.error_bound >= whole.error_bound) and kept.error_bound.max() <= TOLERANCE
