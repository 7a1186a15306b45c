"""The clip shape of the recipe: chords of a cylinder in closed form."""

import numpy as np
import pytest

import wvr

from .cylinder import ClipCylinder

START, END, RADIUS = np.array([3.0, 4.0, 5.0]), np.array([9.0, 7.0, 8.0]), 2.0
TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
# Homogeneous, on a grid that is turned and as high as it is wide in no unit.
VOLUME = wvr.Volume(np.ones((9, 13, 17), np.uint8), (1.0, 1.5, 2.0), (2.0, -8.0, -2.0), TURN)
TF = wvr.TransferFunction([(0, "white", 0.1), (2, "white", 0.1)])
TAU = -np.log(0.9)
SIZE = 33
CAMERAS = {
    "across": wvr.Camera((6, 5.5, 60), (6, 5.5, 6.5), up=(0, 1, 0), parallel_scale=5.0),
    "along": wvr.Camera((START + END) / 2 + 10 * (END - START), (START + END) / 2, parallel_scale=3.1),
    "near": wvr.Camera((25, -10, 20), (6, 5.5, 6.5), view_angle=20.0),
}


def rays(camera):
    """Places and unit vectors, (SIZE, SIZE, 3)."""
    right, up, forward = camera.basis()
    half = np.tan(np.radians(camera.view_angle) / 2) if camera.parallel_scale is None else camera.parallel_scale
    offset = (np.arange(SIZE) + 0.5 - SIZE / 2) * (2 * half / SIZE)
    across = offset[None, :, None] * right - offset[:, None, None] * up
    if camera.parallel_scale is not None:
        return camera.position + across, np.broadcast_to(forward, across.shape)
    way = forward + across
    return np.broadcast_to(camera.position, way.shape), way / np.linalg.norm(way, axis=-1, keepdims=True)


def chords(camera):
    """Lengths inside the cylinder: where the distance from the axis is the radius, between two planes."""
    place, way = rays(camera)
    axis = (END - START) / np.linalg.norm(END - START)
    o, d = np.cross(place - START, axis), np.cross(way, axis)
    a, b, c = (d * d).sum(-1), (o * d).sum(-1), (o * o).sum(-1) - RADIUS**2
    planes = [(point - place) @ axis / (way @ axis) for point in (START, END)]
    inside, parallel = np.where(c < 0, np.inf, -np.inf), a < 1e-20
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - a * c)
        near = np.where(parallel, -inside, np.where(b * b > a * c, (-b - root) / a, np.inf))
        far = np.where(parallel, inside, np.where(b * b > a * c, (-b + root) / a, -np.inf))
    return np.clip(np.minimum(far, np.maximum(*planes)) - np.maximum(near, np.minimum(*planes)), 0, None)


def opacity(camera, clip=None, **kwargs):
    kwargs.setdefault("integrator", wvr.Exact())
    image = wvr.render(VOLUME, TF, camera, (SIZE, SIZE), clip=clip, **kwargs)
    return image.rgba[..., 3].astype(np.float64), image.error_bound


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_chords(camera):
    clip = ClipCylinder(START, END, RADIUS)
    expected = -np.expm1(-TAU * chords(camera))
    assert np.count_nonzero(expected) > 150 and np.count_nonzero(expected == 0) > 150
    found, _ = opacity(camera, clip)
    assert np.abs(found - expected).max() < 1e-10
    found, bound = opacity(camera, clip, integrator=wvr.Certified(1e-6))
    assert np.all(np.abs(found - expected) <= bound) and bound.max() <= 1e-6
    # Inverted, it leaves the rest: transparencies multiply.
    rest, _ = opacity(camera, ClipCylinder(START, END, RADIUS, invert=True))
    whole, _ = opacity(camera)
    assert np.abs((1 - rest) * (1 - expected) - (1 - whole)).max() < 1e-10


def test_naive_leaves_slices():
    """Samples are there or not: each end of a chord is off by up to half a step."""
    camera, step = CAMERAS["near"], 0.1
    expected = chords(camera)
    naive = ClipCylinder(START, END, RADIUS, naive=True)
    found, _ = opacity(camera, naive, integrator=wvr.Riemann(step), precision="float64", termination=0)
    error = np.abs(-np.log1p(-found) / TAU - expected)
    assert 0.01 * step < error.max() < 1.001 * step


def test_with_other_clips():
    """A half of the cylinder that a plane through its axis leaves, and the other."""
    camera = CAMERAS["across"]
    axis = END - START
    normal = np.cross(axis, (0, 1.0, 1.0))
    cylinder = ClipCylinder(START, END, RADIUS)
    halves = [opacity(camera, [cylinder, wvr.ClipPlane(START, side * normal)])[0] for side in (1, -1)]
    whole, _ = opacity(camera, cylinder)
    assert np.abs((1 - halves[0]) * (1 - halves[1]) - (1 - whole)).max() < 1e-10
    assert min(half.max() for half in halves) > 0.1


@pytest.mark.parametrize("face", ["side", "end"])
def test_cut_faces_are_lit_by_their_normal(face):
    tf = wvr.TransferFunction([(0, "white", 0.9999), (2, "white", 0.9999)])
    axis = (END - START) / np.linalg.norm(END - START)
    normal = axis if face == "end" else np.cross(axis, (0, 0, 1.0)) / np.linalg.norm(np.cross(axis, (0, 0, 1.0)))
    middle = (START + END) / 2
    camera = wvr.Camera(middle + 50 * normal, middle, parallel_scale=0.01)
    light = np.array([0.36, 0.48, 0.8])
    lighting = wvr.Lighting(light=wvr.DirectionalLight(light), specular=0.0)
    clip = ClipCylinder(START, END, RADIUS)
    image = wvr.render(VOLUME, tf, camera, (3, 3), clip=clip, lighting=lighting)
    assert image.rgba[1, 1, 0] == pytest.approx(0.2 + 0.7 * abs(normal @ light), rel=5e-3)


def test_renderer_rebuilds_nothing_where_it_moves():
    renderer = wvr.Renderer(VOLUME, TF, integrator=wvr.Exact(), clip=ClipCylinder(START, END, RADIUS))
    renderer.render(CAMERAS["near"], (8, 8))
    before = dict(renderer.builds)
    renderer.clip = ClipCylinder(START, END, 1.0)
    renderer.render(CAMERAS["near"], (8, 8))
    assert dict(renderer.builds) == before


def test_bad_input():
    with pytest.raises(ValueError, match="start and end must not be the same"):
        ClipCylinder(START, START, 1.0)
    with pytest.raises(ValueError, match="radius must be finite and > 0"):
        ClipCylinder(START, END, 0.0)
    with pytest.raises(TypeError, match=r"clip must be None, one of ClipPlane, .* or another Clip, .* got 'tube'"):
        wvr.render(VOLUME, TF, CAMERAS["near"], clip="tube")
    assert ClipCylinder(START, END, 1.0) == ClipCylinder(tuple(START), tuple(END), 1.0)
