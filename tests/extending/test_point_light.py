"""The light of the recipe against Blinn and Phong in NumPy, and against a light from one direction."""

import numpy as np
import pytest

import wvr

from ..helpers import max_error
from .point_light import PointLight

RADIUS = 60.0
CAMERA = wvr.Camera((300, 0, 0), (0, 0, 0), parallel_scale=70.0)
SIZE = 71
# A light that adds nothing but that it has a place, far away, so that all is in double precision.
UNLIT = PointLight((0.0, 0.0, 1e9), "black")


@pytest.fixture(scope="module")
def sphere():
    """Distance from the centre, and a transfer function that sees a sphere."""
    x = np.linspace(-100, 100, 48)
    z, y, x = np.meshgrid(x, x, x, indexing="ij")
    volume = wvr.Volume(np.sqrt(x * x + y * y + z * z).astype(np.float32), (200 / 47,) * 3, (-100,) * 3)
    ends = [(RADIUS - 2, "white", 0.0), (RADIUS, "white", 1.0), (RADIUS + 2, "white", 0.0)]
    return volume, wvr.TransferFunction(ends)


def image_of(sphere, light, integrator=None, **kwargs):
    lighting = wvr.Lighting(light=light, shininess=10.0, **kwargs)
    return wvr.render(*sphere, CAMERA, (SIZE, SIZE), integrator=integrator, lighting=lighting)


def shade(place):
    """What a white sphere is seen as, and where it is not seen at a grazing angle."""
    offset = np.arange(-(SIZE // 2), SIZE // 2 + 1) * (2 * 70.0 / SIZE)
    right, up, _ = CAMERA.basis()
    across = offset[None, :, None] * right - offset[:, None, None] * up
    height = np.sqrt(np.clip(RADIUS**2 - (across**2).sum(axis=-1), 0, None))
    eye = np.array([1.0, 0.0, 0.0])
    point = across + height[..., None] * eye
    normal = point / RADIUS
    toward = np.asarray(place) - point
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    half = toward + eye
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    diffuse, specular = (np.abs((normal * way).sum(axis=-1)) for way in (toward, half))
    return 0.2 + 0.7 * diffuse + 0.3 * specular**10, height > RADIUS * np.cos(np.radians(50))


@pytest.mark.parametrize("integrator", [wvr.Certified(1e-3), wvr.Preintegrated(0.5)], ids=lambda i: type(i).__name__)
@pytest.mark.parametrize("place", [(150.0, 40.0, 30.0), (75.0, 0.0, 0.0), (80.0, -120.0, 60.0)])
def test_sphere_is_lit_from_a_place(sphere, place, integrator):
    image = image_of(sphere, PointLight(place), integrator)
    expected, seen = shade(place)
    error = np.abs(image.rgba[..., 0] - expected)[seen]
    assert error.max() < 0.04 and error.mean() < 0.012
    assert np.ptp(expected[seen]) > 0.4


@pytest.mark.parametrize("integrator", [wvr.Exact(), wvr.Certified(1e-5)], ids=lambda i: type(i).__name__)
@pytest.mark.parametrize("place", [(3.6, 3.4, 3.5), (5.0, 2.8, 5.0)])
def test_in_a_volume_its_direction_turns_along_rays(place, integrator):
    """Though the gradient does not: fog of one extinction against the integral along each ray, in NumPy."""
    volume = wvr.Volume(np.indices((8, 8, 8))[0].astype(np.float32))
    tf = wvr.TransferFunction([(0, "white", 0.1), (7, "white", 0.1)])
    camera = wvr.Camera((30, 3.5, 3.5), (3.5, 3.5, 3.5), parallel_scale=3.0)
    lighting = wvr.Lighting(light=PointLight(place), ambient=0.1, diffuse=0.8, specular=0.3, shininess=4.0)
    image = wvr.render(volume, tf, camera, (5, 5), integrator=integrator, lighting=lighting)
    starts, _ = camera.rays((5, 5))
    u = (np.arange(200_000) + 0.5) * (7 / 200_000)
    points = np.stack(np.broadcast_arrays(7 - u, *starts.reshape(-1, 3).T[1:, :, None]), -1)
    toward = np.asarray(place) - points
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    half = toward + np.array([1, 0, 0])
    glance = np.abs(half[..., 2]) / np.linalg.norm(half, axis=-1)
    tau = -np.log(0.9)
    seen = tau * np.exp(-tau * u) * (7 / 200_000)
    expected = (0.1 + 0.8 * np.abs(toward[..., 2]) + 0.3 * glance**4) @ seen
    assert np.abs(image.rgba[..., 0].ravel() - expected).max() < 1e-5


def test_far_away_it_is_a_direction(sphere):
    """By the walk in double precision, which lights with a place ask for, and within the tolerance by that in lanes."""
    direction = np.array([1.0, 2.0, -0.5])
    near, far = (image_of(sphere, PointLight(distance * direction)) for distance in (100.0, 1e9))
    lanes = image_of(sphere, wvr.DirectionalLight(direction))
    truth = image_of(sphere, [wvr.DirectionalLight(direction), UNLIT])
    assert max_error(far, truth.rgba) < 1e-6 < 1e-2 < max_error(near, truth.rgba)
    assert max_error(far, lanes.rgba) < 1 / 512


def test_far_away_it_scatters_as_a_direction(blobs, smooth_tf):
    tf, camera, direction = smooth_tf.scaled(8), wvr.Camera.fit(blobs), np.array([1.0, 2.0, 3.0])
    near, far, truth = (
        wvr.single_scattering(blobs, tf, camera, (12, 12), light=light, directions=2)
        for light in (PointLight(60 * direction), PointLight(1e9 * direction), wvr.DirectionalLight(direction))
    )
    assert max_error(far, truth.rgba) < 1e-6 < 1e-3 < max_error(near, truth.rgba)


def test_lights_of_all_kinds_add_up(sphere):
    lights = [PointLight((150, 40, 30), "red"), wvr.Headlight("lime"), wvr.DirectionalLight((1, 1, 1), "blue")]
    together = image_of(sphere, lights, ambient=0.0)
    unlit = PointLight((150, 40, 30), "black")  # for the same points along rays
    alone = [image_of(sphere, [light, unlit], ambient=0.0).rgba[..., :3] for light in lights]
    assert np.abs(together.rgba[..., :3] - sum(alone)).max() < 1e-5
    assert all(one.max() > 0.2 for one in alone)


def test_renderer_rebuilds_nothing_where_it_moves(sphere):
    renderer = wvr.Renderer(*sphere, lighting=wvr.Lighting(light=PointLight((150, 0, 0))))
    first = renderer.render(CAMERA, (8, 8))
    before = dict(renderer.builds)
    renderer.lighting = wvr.Lighting(light=PointLight((0, 150, 0)))
    assert max_error(renderer.render(CAMERA, (8, 8)), first.rgba) > 0.01 and dict(renderer.builds) == before


def test_what_it_cannot_do_is_refused():
    with pytest.raises(ValueError, match="place must be three finite numbers"):
        PointLight((0, 0, np.inf))
    with pytest.raises(TypeError, match="light must go one way"):
        wvr.ConvolutionShadows(light=PointLight((1, 2, 3)))
    with pytest.raises(TypeError, match="another Light, or a sequence of them, got 'sun'"):
        wvr.Lighting(light="sun")
