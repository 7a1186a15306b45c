"""Depths: where rays have an opacity, where they end, and what is under a pixel."""

import gc
import weakref

import numpy as np
import pytest

import wvr

from .extending.marschner_lobb import MarschnerLobb
from .helpers import INTEGRATORS, KINDS, centered, constant, middle
from .scenes import transfer_functions, volumes

VOLUMES = volumes()
FOG = constant(0.2, (0.9, 0.5, 0.1))
CAMERAS = {
    "perspective": lambda v: wvr.Camera.fit(v, (1, 0.6, 0.4)),
    "parallel": lambda v: wvr.Camera.fit(v, (1, 0.6, 0.4), parallel=True),
    "inside": lambda v: wvr.Camera(middle(v), v.corners[0], view_angle=70),
    "far": lambda v: wvr.Camera(middle(v) + 1e7 * np.array([0.6, 0.0, 0.8]), middle(v), parallel_scale=12),
}


def obliquity(camera, size):
    """Length along each ray for a unit of depth."""
    y, x = np.indices(size[::-1])
    step = camera.unproject(x, y, np.full(x.shape, 2.0), size) - camera.unproject(x, y, np.full(x.shape, 1.0), size)
    return np.linalg.norm(step, axis=-1)


@pytest.mark.parametrize("name", CAMERAS)
def test_fog_is_as_deep_as_it_says(name):
    """In a homogeneous block a ray has an opacity after a length that is known."""
    volume = centered(np.full((16, 16, 16), 100, np.uint8))
    camera = CAMERAS[name](volume)
    size = (12, 10)
    image = wvr.render(volume, FOG, camera, size)
    tau = float(FOG.extinction(100))
    first = image.depth(1e-12)
    for opacity in (0.1, 0.5):
        depth = image.depth(opacity)
        reached = image.rgba[..., 3] > opacity + 1e-2
        assert reached.any() and np.all(np.isnan(depth[image.rgba[..., 3] < opacity - 1e-2]))
        length = ((depth - first) * obliquity(camera, size))[reached]
        assert np.abs(length + np.log(1 - opacity) / tau).max() < 2e-7


@pytest.mark.parametrize("scene", ["smooth", "jumps", "spikes"])
def test_what_ends_where_it_has_an_opacity_has_it(scene):
    volume = VOLUMES["anisotropic"]
    tf = transfer_functions(*volume.range)[scene]
    camera = CAMERAS["perspective"](volume)
    image = wvr.render(volume, tf, camera, (24, 20), integrator=wvr.Exact())
    depth = image.depth(0.3)
    ended = wvr.render(volume, tf, camera, (24, 20), integrator=wvr.Exact(), depth=depth)
    reached = np.isfinite(depth)
    assert reached.any() and np.abs(ended.rgba[reached][:, 3] - 0.3).max() < 1e-9
    assert np.array_equal(ended.rgba[~reached], image.rgba[~reached])
    assert np.all(reached == (image.rgba[..., 3] >= 0.3))


@pytest.mark.parametrize("name", KINDS)
def test_rays_end_as_at_a_clip(name):
    """Where all depths are the same that is a plane across the view."""
    volume = VOLUMES["noisy"]
    tf = transfer_functions(*volume.range)["smooth"]
    camera = CAMERAS["parallel"](volume)
    depth = float(np.linalg.norm(middle(volume) - camera.position)) - 3.3
    forward = camera.basis()[2]
    clip = wvr.ClipPlane(camera.position + depth * forward, -forward)
    options = {"integrator": INTEGRATORS[name]}
    ended = wvr.render(volume, tf, camera, (20, 16), depth=np.full((16, 20), depth), **options)
    clipped = wvr.render(volume, tf, camera, (20, 16), clip=clip, **options)
    assert np.abs(ended.rgba - clipped.rgba).max() < 5e-6 and ended.rgba.any()


@pytest.mark.parametrize("name", CAMERAS)
def test_certified_images_are_within_their_bounds(name):
    """Of rays that all end elsewhere, in front of the volume and behind it, or nowhere."""
    volume = VOLUMES["noisy"]
    tf = transfer_functions(*volume.range)["jumps"]
    camera = CAMERAS[name](volume)
    distance = float((middle(volume) - camera.position) @ camera.basis()[2])
    rng = np.random.default_rng(0)
    depth = distance + rng.uniform(-25, 25, (20, 24))
    depth[::5, ::3] = np.nan
    depth[1::5, ::3] = np.inf
    exact = wvr.render(volume, tf, camera, (24, 20), integrator=wvr.Exact(), depth=depth)
    for tolerance, precision in ((1e-3, "auto"), (1e-6, "float64")):
        image = wvr.render(volume, tf, camera, (24, 20), tolerance=tolerance, precision=precision, depth=depth)
        error = np.abs(image.rgba - exact.rgba).max(axis=2)
        assert np.all(error <= image.error_bound) and image.error_bound.max() <= tolerance
    whole = wvr.render(volume, tf, camera, (24, 20), integrator=wvr.Exact())
    unended = ~np.isfinite(depth)
    assert np.array_equal(exact.rgba[unended], whole.rgba[unended])
    assert not np.array_equal(exact.rgba, whole.rgba)


def test_an_end_that_rounding_moves_is_in_the_bound():
    """Of a camera so far away that depths are known to micrometres, in a medium that is opaque in as much."""
    volume = centered(np.full((8, 8, 8), 100, np.uint8))
    dense = wvr.TransferFunction([(0, "white", 1 - 1e-6), (255, "white", 1 - 1e-6)], unit_distance=1e-4)
    camera = wvr.Camera((0, 0, 1e10), (0, 0, 0), up=(0, 1, 0), parallel_scale=3)
    near = np.full((3, 3), 1e10 - 3.5)
    image = wvr.render(volume, dense, camera, (3, 3), depth=near + 1e-6, tolerance=1e-3)
    assert np.all(image.error_bound > 0.1)


def test_with_light_shadows_labels_and_clips():
    """Opacity is that without light; what ends in front of all is nothing."""
    volume = wvr.datasets.load("blobs", 24)
    tf = wvr.TransferFunction([(60, "white", 0.0), (200, "orange", 0.4)])
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4), parallel=True)
    middle_depth = float((middle(volume) - camera.position) @ camera.basis()[2])
    ends = np.full((16, 16), middle_depth)
    light = wvr.Lighting(light=wvr.DirectionalLight((0.5, 0.3, 1)))
    shadows = wvr.ConvolutionShadows(light=wvr.DirectionalLight((0.5, 0.3, 1)))
    options = {"integrator": wvr.Preintegrated(0.5)}
    plain = wvr.render(volume, tf, camera, (16, 16), depth=ends, **options)
    lit = wvr.render(volume, tf, camera, (16, 16), depth=ends, lighting=light, shadows=shadows, **options)
    assert np.abs(lit.rgba[..., 3] - plain.rgba[..., 3]).max() < 1e-6 and plain.rgba.any()
    assert np.all(lit.rgba[..., :3] <= 1.3 * plain.rgba[..., :3] + 1e-6)
    with pytest.warns(UserWarning, match=r"depth is behind the camera .* -plotter\.get_image_depth"):
        front = wvr.render(volume, tf, camera, (16, 16), depth=ends - 100, lighting=light, shadows=shadows)
    assert not front.rgba.any() and np.all(front.error_bound < 1e-3)


def test_projections_end_too():
    samples = np.random.default_rng(1).integers(0, 200, (9, 8, 7)).astype(np.uint8)
    camera = wvr.Camera((3, 3.5, 50), (3, 3.5, 4), up=(0, 1, 0), parallel_scale=4)
    for what, expected in (("max", samples[5:].max(axis=0)), ("sum", np.trapezoid(samples[5:].astype(float), axis=0))):
        image = wvr.render(
            wvr.Volume(samples), FOG, camera, (7, 8), depth=np.full((8, 7), 45.0), integrator=wvr.Projection(what)
        )
        off = np.abs(image.values[::-1] - expected)[1:-1, 1:-1]
        assert off.max() < 1e-11 and np.all(off <= image.error_bound[::-1][1:-1, 1:-1])
    with pytest.raises(
        ValueError, match=r"depth needs an image of what is somewhere on a ray, got Projection\(what='sum'"
    ):
        image.depth()


def test_naive_clips_are_cut_exactly():
    volume = centered(np.full((12, 12, 12), 100, np.uint8))
    camera = wvr.Camera((0, 0, 40), (0, 0, 0), up=(0, 1, 0), parallel_scale=4)
    clip = wvr.ClipPlane((0, 0, 1.234), (0, 0, -1), naive=True)
    image = wvr.render(volume, FOG, camera, (3, 3), integrator=wvr.Riemann(0.5), clip=clip)
    assert np.abs(image.depth(1e-9) - (40 - 1.234)).max() < 1e-7


def test_an_image_that_ended_early_says_what_is_behind():
    """Three surfaces, two of which its rays pass: depths ended where the image had."""
    k = np.indices((12, 12, 12))[0]
    volume = centered(k.astype(np.float64))
    camera = wvr.Camera((0, 0, 40), (0, 0, 0), up=(0, 1, 0), parallel_scale=4)
    tf = wvr.TransferFunction([(0, "white", 0.3), (11, "white", 0.3)])
    options = {"integrator": wvr.Isosurface([2.5, 5.5, 8.5]), "lighting": None}
    image = wvr.render(volume, tf, camera, (3, 3), termination=0.5, **options)
    assert np.abs(image.rgba[..., 3] - (1 - 0.7**2)).max() < 1e-6
    assert np.abs(image.depth(0.6) - (40 + 3)).max() < 1e-7 and image.pick(1, 1, 0.6).value == 2.5


def test_pick():
    """Where it is and what is there: of a ramp, whose value says where."""
    k, j, i = np.indices((10, 11, 12))
    volume = wvr.Volume((i + 20.0 * j + 400.0 * k), (1, 2, 0.5), (5, 6, 7))
    tf = wvr.TransferFunction([(0, "white", 0.3), (5000, "white", 0.3)])
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    image = wvr.render(volume, tf, camera, (20, 16))
    picked = image.pick(10, 8)
    x, y, z = (picked.position - (5, 6, 7)) / (1, 2, 0.5)
    assert abs(picked.value - (x + 20 * y + 400 * z)) < 1e-6
    assert picked.opacity == image.rgba[8, 10, 3] and picked.opacity > 0
    assert np.abs(camera.project(picked.position, (20, 16)) - (10, 8)).max() < 1e-9
    nearer, farther = image.pick(10, 8, 0.1), image.pick(10, 8, 0.9)
    distances = [np.linalg.norm(one.position - camera.position) for one in (nearer, picked, farther)]
    assert distances == sorted(distances)
    # What is found of one image is kept for the next.
    renderer = wvr.Renderer(volume, tf, device="cpu")
    again = [renderer.render(camera, (20, 16)).pick(10, 8).value for _ in range(2)]
    assert again == [picked.value] * 2 and set(renderer._keepers["cpu"].beside().builds.values()) == {1}
    nothing = image.pick(0, 0)
    assert nothing.opacity == 0 and np.isnan(nothing.value) and np.all(np.isnan(nothing.position))


def test_an_image_holds_nothing_of_its_frame():
    """What it has for depths is its own: parts that frames keep are gone with their renderer."""
    volume = wvr.datasets.load("blobs", 16)
    for options in ({}, {"memory_limit": "1 GiB"}, {"integrator": wvr.Projection("max")}):
        renderer = wvr.Renderer(volume, FOG, **options)
        image = renderer.render(wvr.Camera.fit(volume), (8, 6))
        kept = [weakref.ref(keep) for keep in renderer._keepers.values()]
        del renderer
        gc.collect(1)
        assert len(kept) == 1 and kept[0]() is None
        assert np.isfinite(image.pick(4, 3).value)


def test_unproject_is_the_inverse_of_project():
    rng = np.random.default_rng(2)
    volume = VOLUMES["anisotropic"]
    for name, make in CAMERAS.items():
        if name == "far":
            continue
        camera = make(volume)
        x, y, depth = rng.uniform(0, 30, 9), rng.uniform(0, 20, 9), rng.uniform(5, 50, 9)
        points = camera.unproject(x, y, depth, (30, 20))
        assert np.abs(camera.project(points, (30, 20)) - np.stack([x, y], axis=-1)).max() < 1e-9
        assert np.abs((points - camera.position) @ camera.basis()[2] - depth).max() < 1e-9


def test_bad_input():
    volume = wvr.datasets.load("blobs", 16)
    image = wvr.render(volume, FOG, "iso", (8, 6))
    for opacity in (0, -0.1, 1.5, np.nan):
        with pytest.raises(ValueError, match=r"opacity must be in \(0, 1\]"):
            image.depth(opacity)
        with pytest.raises(ValueError, match=r"opacity must be in \(0, 1\]"):
            image.pick(0, 0, opacity)
    with pytest.raises(IndexError, match="8 x 6"):
        image.pick(8, 0)
    with pytest.raises(ValueError, match=r"\(height, width\) = \(6, 8\)"):
        wvr.render(volume, FOG, "iso", (8, 6), depth=np.ones((8, 6)))
    with pytest.raises(TypeError, match="depth must be numbers"):
        wvr.render(volume, FOG, "iso", (8, 6), depth="far")
    with pytest.raises(ValueError, match="depth needs a volume that says what it is inside a cell, which a Marsch"):
        field = MarschnerLobb()
        wvr.render(field, FOG, wvr.Camera.fit(field), (4, 4), integrator=wvr.Simpson(0.5)).depth()
    with pytest.raises(ValueError, match=r"wvr\.render made"):
        wvr.Image(image.rgba, image.samples).depth()
    array = np.full((6, 6, 6), 100.0)
    changing = wvr.Volume(array)
    image = wvr.render(changing, FOG, "iso", (4, 4))
    array[:] = 5
    changing.changed()
    with pytest.raises(ValueError, match="wrote into since"):
        image.depth()


def test_masked_depths_end_nothing():
    volume = centered(np.full((8, 8, 8), 200, np.uint8))
    camera = CAMERAS["parallel"](volume)
    mask = np.arange(63).reshape(7, 9) % 2 == 0
    depth = np.ma.masked_array(np.zeros((7, 9)), mask)
    # Of certified images the cells that are computed side by side, and so the rounding of sums, go with the other rays.
    for integrator, off in ((wvr.Exact(), 0.0), (wvr.Riemann(0.5), 0.0), (wvr.Certified(1 / 512), 1.2e-7)):
        free = wvr.render(volume, FOG, camera, (9, 7), integrator=integrator)
        ended = wvr.render(volume, FOG, camera, (9, 7), integrator=integrator, depth=depth)
        assert np.abs(ended.rgba - free.rgba)[mask].max() <= off and not ended.rgba[~mask].any()
