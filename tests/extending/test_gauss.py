"""The integrator of the recipe: its order against the exact integral, and what it has for nothing."""

from threading import Event

import numpy as np
import pytest

import wvr

from ..helpers import max_error
from .gauss import Gauss

SIZE = (24, 24)


def ramp():
    """Linear in space, so that the integrand along a ray is smooth: the transfer function below has no kink in it."""
    k, j, i = np.indices((9, 9, 9))
    return wvr.Volume((0.05 * i + 0.03 * j + 0.02 * k).astype(np.float64), spacing=(1.0, 1.5, 2.0))


RED = wvr.TransferFunction.from_arrays([0, 1], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]], [0.05, 0.6])
BLUE = wvr.TransferFunction.from_arrays([0, 1], [[0.1, 0.2, 0.9], [0.8, 0.9, 0.1]], [0.3, 0.1])
# Labels of boxes, so that their boundaries are planes.
LABELS = wvr.Segmentation((np.indices((9, 9, 9))[2] > 3).astype(np.uint8), {0: RED, 1: BLUE})
CUTS = {
    "whole": {},
    "clips": {"clip": [wvr.ClipPlane((3.1, 5.2, 7.3), (1, 0.5, -0.3)), wvr.ClipSphere((4, 6, 8), 2.5, invert=True)]},
    "labels": {"segmentation": LABELS},
}


@pytest.mark.parametrize("cuts", CUTS.values(), ids=CUTS)
def test_order(cuts):
    """4, with and without clips and labels, since rays are cut where they end."""
    volume = ramp()
    tf = None if "segmentation" in cuts else RED
    renderer = wvr.Renderer(volume, tf, precision="float64", termination=0, **cuts)
    camera = wvr.Camera.fit(volume)
    renderer.integrator = wvr.Exact()
    truth = renderer.render(camera, SIZE).rgba
    steps, errors = np.array([2.0, 1.0, 0.5, 0.25]), []
    for step in steps:
        renderer.integrator = Gauss(step)
        errors.append(np.abs(renderer.render(camera, SIZE).rgba - truth).mean())
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(Gauss(1.0).order, abs=0.3)
    assert 0 < errors[-1] < 1e-7


def test_opacity_of_a_homogeneous_stretch_is_exact():
    volume = wvr.Volume(np.ones((5, 5, 5)))
    tf = wvr.TransferFunction([(0, "red", 0.5), (2, "red", 0.5)], unit_distance=2.0)
    camera = wvr.Camera((2, 2, 20), (2, 2, 2), up=(0, 1, 0), parallel_scale=1.0)
    image = wvr.render(volume, tf, camera, (4, 4), integrator=Gauss(0.7), precision="float64", termination=0)
    assert np.allclose(image.rgba, [0.75, 0, 0, 0.75], rtol=0, atol=1e-12)


def test_light_shadows_and_absent_data(blobs):
    data = blobs.numpy().astype(np.float32)
    data[8:12, 8:12, 8:12] = np.nan
    volume = wvr.Volume(data, nan="transparent")
    tf = wvr.TransferFunction.from_arrays([0, 255], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]], [0.0, 0.3])
    camera, lighting = wvr.Camera.fit(volume), wvr.Lighting(light=wvr.DirectionalLight((1, 1, 0)))
    renderer = wvr.Renderer(volume, tf, lighting=lighting, termination=0)
    renderer.integrator = wvr.Exact()
    truth = renderer.render(camera, SIZE).rgba
    renderer.integrator = Gauss(0.05)
    image = renderer.render(camera, SIZE)
    # Next to absent cells a segment counts as a whole.
    assert np.abs(image.rgba - truth).mean() < 1e-3
    renderer.shadows = wvr.ConvolutionShadows()
    shaded = renderer.render(camera, SIZE).rgba
    assert np.allclose(shaded[..., 3], image.rgba[..., 3]) and shaded[..., 0].sum() < image.rgba[..., 0].sum()


def test_nothing_is_skipped_that_is_seen(blobs):
    blobs = wvr.Volume(blobs.numpy().astype(np.float64))
    tf = wvr.TransferFunction([(100, "red", 0.0), (160, "white", 0.4)])
    camera = wvr.Camera.fit(blobs)
    images = [
        wvr.render(blobs, tf, camera, SIZE, integrator=Gauss(0.5), precision="float64", termination=0, skip_empty=skip)
        for skip in (True, False)
    ]
    assert max_error(images[0], images[1].rgba) < 1e-12
    assert images[0].samples.sum() < 0.8 * images[1].samples.sum()


def test_renderer_keeps_all_for_another_step(smooth_tf):
    volume = ramp()
    renderer = wvr.Renderer(volume, smooth_tf, integrator=Gauss(1.0), precision="float64")
    camera = wvr.Camera.fit(volume)
    renderer.render(camera, (8, 8))
    before = dict(renderer.builds)
    renderer.integrator = Gauss(0.5)
    renderer.render(camera, (8, 8))
    assert dict(renderer.builds) == before and before["volume"] == before["kinds"] == 1


def test_what_it_cannot_do_is_refused(blobs, smooth_tf):
    camera, stop = wvr.Camera.fit(blobs), Event()
    stop.set()
    with pytest.raises(wvr.Cancelled):
        wvr.render(blobs, smooth_tf, camera, integrator=Gauss(1.0), cancel=stop)
    with pytest.raises(ValueError, match="step must be finite and > 0"):
        Gauss(0)
    with pytest.raises(ValueError, match=r"integrator must take at most .* got Gauss\(step=1e-09\)"):
        wvr.render(blobs, smooth_tf, camera, integrator=Gauss(1e-9))
    with pytest.raises(ValueError, match=r"clip with naive needs an integrator .* got Gauss\(step=1.0\)"):
        clip = wvr.ClipSphere((9, 9, 9), 5, naive=True)
        wvr.render(blobs, smooth_tf, camera, integrator=Gauss(1.0), clip=clip)
