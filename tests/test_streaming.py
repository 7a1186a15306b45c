"""A new volume each frame through one renderer: nothing is prepared but what the frame's own samples ask for."""

import numpy as np
import pytest

import wvr


@pytest.mark.parametrize("image", ["rays", "slices"])
def test_beating_heart_in_shadow(device, image):
    """The images are those of a renderer of their own; of the volume only ranges of blocks are made."""
    tf = wvr.TransferFunction([(62, "darkred", 0.0), (75, "salmon", 0.3), (160, "mistyrose", 0.5)])
    shadows = wvr.ConvolutionShadows(light=wvr.DirectionalLight((-0.5, -1, 1)), image=image)
    volumes = [wvr.datasets.load("heart", 32, phase=phase) for phase in (0.0, 0.2, 0.35)]
    camera = wvr.Camera.fit(volumes[0], (0.25, -1, 0.35))
    options = {"integrator": wvr.Riemann(0.5), "shadows": shadows, "device": device}
    renderer = wvr.Renderer(volumes[0], tf, **options)
    renderer.render(camera, (24, 24))
    before = renderer.builds.copy()
    frames = []
    for volume in volumes[1:]:
        renderer.volume = volume
        frames.append(renderer.render(camera, (24, 24)).rgba)
    built = dict(renderer.builds - before)
    assert built.pop("octants", 2) == 2  # where rays go several abreast
    assert built == {"volume": 2, "ranges": 2, "kinds": 2}
    for frame, volume in zip(frames, volumes[1:], strict=True):
        np.testing.assert_array_equal(frame, wvr.Renderer(volume, tf, **options).render(camera, (24, 24)).rgba)
    assert np.abs(frames[1] - frames[0]).max() > 0.05
