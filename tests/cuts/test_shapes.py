"""Clips by shapes against closed forms: what is cut away is gone to rounding, in every integrator; naive clips leave
slices.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr

from ..helpers import along, block, centered, constant, every_kind, integrators, middle

HOMOGENEOUS = constant(0.1, (0.2, 0.4, 0.8))


def kept(clip, points):
    """Whether points (..., 3) are kept: the definitions in world coordinates."""
    if isinstance(clip, wvr.ClipPlane):
        inside = (points - clip.point) @ clip.normal >= 0
    elif isinstance(clip, wvr.ClipBox):
        inside = np.all((points >= clip.lo) & (points <= clip.hi), axis=-1)
    else:
        inside = np.linalg.norm(points - clip.center, axis=-1) <= clip.radius
    return inside != clip.invert


def borders(clip, o, d):
    """Where a ray may cross the surface of a clip."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(clip, wvr.ClipPlane):
            t = [(np.subtract(clip.point, o) @ clip.normal) / (d @ clip.normal)]
        elif isinstance(clip, wvr.ClipBox):
            t = [*((np.array(clip.lo) - o) / d), *((np.array(clip.hi) - o) / d)]
        else:
            b, c = d @ (o - clip.center), np.sum((o - clip.center) ** 2) - clip.radius**2
            t = [-b - np.sqrt(b * b - c), -b + np.sqrt(b * b - c)]
    return [x for x in t if np.isfinite(x)]


def visible_length(volume, clips, camera, size):
    """Length of each ray in the volume and in all clips, (height, width) [world length]."""
    origins, directions = camera.rays(size)
    to_index = np.linalg.inv(volume.index_to_world)
    result = np.zeros(origins.shape[:2])
    for pixel in np.ndindex(*result.shape):
        o, d = origins[pixel], directions[pixel]
        i, v = to_index[:3, :3] @ o + to_index[:3, 3], to_index[:3, :3] @ d
        with np.errstate(divide="ignore", invalid="ignore"):
            faces = np.concatenate([(bound - i) / v for bound in volume.index_box])
        t = [x for x in faces if np.isfinite(x)] + [x for clip in clips for x in borders(clip, o, d)]
        if not camera.parallel:
            t = [max(x, 0.0) for x in t]
        for a, b in pairwise(sorted(t)):
            middle = o + (a + b) / 2 * d
            index = to_index[:3, :3] @ middle + to_index[:3, 3]
            inside = np.all((index >= volume.index_box[0]) & (index <= volume.index_box[1]))
            if inside and all(kept(clip, middle) for clip in clips):
                result[pixel] += b - a
    return result


def assert_depth(volume, clips, camera, size=(9, 7), integrator=None, atol=1e-9, **options):
    """Opacity is that of the visible length, and colour in proportion."""
    image = wvr.render(
        volume, HOMOGENEOUS, camera, size, integrator=integrator or wvr.Exact(), clip=clips, termination=0, **options
    )
    expected = 1 - 0.9 ** visible_length(volume, clips, camera, size)
    np.testing.assert_allclose(image.rgba, expected[..., None] * [0.2, 0.4, 0.8, 1.0], rtol=0, atol=atol)
    return expected


# Planes


@every_kind
@pytest.mark.parametrize("seed", range(4))
def test_plane_through_a_homogeneous_block(device, integrator, seed):
    """At any angle and position; the steps divide nothing."""
    volume, rng = block(), np.random.default_rng(seed)
    plane = wvr.ClipPlane(middle(volume) + rng.normal(size=3), rng.normal(size=3))
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=seed % 2 == 0)
    # The default precision has samples, not sums, in float32.
    expected = assert_depth(volume, [plane], camera, integrator=integrator, atol=1e-6, device=device)
    assert np.count_nonzero(expected) > 0 and expected.max() > 0.2
    if isinstance(integrator, wvr.Riemann | wvr.Certified | wvr.Exact):
        # Where it is cut is in float64 anyway: by one of each way to walk.
        assert_depth(volume, [plane], camera, integrator=integrator, precision="float64", device=device)


@pytest.mark.parametrize("step", [0.013, 0.5, 1.0, 3.7, 100.0])
@pytest.mark.parametrize("make", [wvr.Riemann, wvr.Simpson, wvr.Preintegrated], ids=lambda make: make.__name__)
def test_any_step(make, step):
    volume = block()
    plane = wvr.ClipPlane(middle(volume), (0.3, -0.5, 0.8))
    assert_depth(volume, [plane], wvr.Camera.fit(volume), integrator=make(step), atol=1e-6)


@integrators("Riemann", "Preintegrated")
def test_naive_planes_are_off_by_a_segment(integrator):
    """A segment is there or not: off by up to a step, and no less than a quarter of one somewhere."""
    volume = block()
    step = 0.37 * volume.smallest_spacing
    plane = wvr.ClipPlane(middle(volume), (0.3, -0.5, 0.8), naive=True)
    camera = wvr.Camera.fit(volume, parallel=True)
    image = wvr.render(volume, HOMOGENEOUS, camera, (32, 24), integrator=integrator, clip=plane, termination=0)
    length = np.log1p(-image.rgba[..., 3].astype(float)) / np.log(0.9)
    off = np.abs(length - visible_length(volume, [plane], camera, (32, 24)))
    assert 0.25 * step < off.max() < 1.001 * step


def test_the_plane_keeps_the_side_of_its_normal():
    volume = centered(np.full((9, 9, 9), 100, np.uint8))
    camera = along(2, scale=4)
    for sign in (1, -1):
        image = wvr.render(volume, HOMOGENEOUS, camera, (8, 8), clip=wvr.ClipPlane((0, 0, 0), (sign, 0, 0)))
        seen = camera.rays((8, 8))[0][..., 0] * sign > 0
        assert np.array_equal(image.rgba[..., 3] > 0, seen)
    inverted = wvr.render(volume, HOMOGENEOUS, camera, (8, 8), clip=wvr.ClipPlane((0, 0, 0), (1, 0, 0), invert=True))
    assert np.array_equal(inverted.rgba, image.rgba)


# Boxes, spheres, several


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_shapes(seed):
    """Several at once, inverted or not, the camera anywhere, inside too."""
    rng = np.random.default_rng(seed)
    volume = block()
    center = middle(volume)
    clips = []
    for _ in range(rng.integers(1, 5)):
        at, kind, invert = center + rng.normal(0, 3, 3), rng.integers(3), bool(rng.random() < 0.5)
        if kind == 0:
            clips.append(wvr.ClipPlane(at, rng.normal(size=3), invert))
        elif kind == 1:
            clips.append(wvr.ClipBox(at - rng.uniform(0.1, 6, 3), at + rng.uniform(0.1, 6, 3), invert))
        else:
            clips.append(wvr.ClipSphere(at, rng.uniform(0.5, 8), invert))
    camera = wvr.Camera(center + rng.normal(0, 6, 3), center + rng.normal(size=3), rng.normal(size=3), view_angle=70)
    assert_depth(volume, clips, camera, (6, 5))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rays_along_the_axes_of_a_box(axis):
    """Two of the direction's components are zero; the box's faces are those of cells."""
    volume = centered(np.full((9, 9, 9), 100, np.uint8))
    for invert in (False, True):
        box = wvr.ClipBox((-2, -2, -2), (2, 1, 3), invert)
        assert_depth(volume, [box], along(axis, scale=4), (6, 6))


def test_a_sphere_far_from_the_origin(device):
    """A world at 1e6: geometry is relative to the volume before it is float64 arithmetic along a ray."""
    far = np.array([1e6, -2e6, 3e6])
    volume = wvr.Volume(np.full((9, 9, 9), 100, np.uint8), origin=far - 4)
    camera = wvr.Camera(far + np.array([0.1, 0.2, 10]), far, up=(0, 1, 0), parallel_scale=4)
    assert_depth(volume, [wvr.ClipSphere(far, 2.5)], camera, atol=2e-7, device=device)


def test_rays_of_a_million_units():
    """Lengths are in units of the smallest spacing, which may be a millionth of the others."""
    volume = wvr.Volume(np.full((9, 9, 9), 100, np.uint8), (1.0, 1.0, 1e-6))
    tf = HOMOGENEOUS
    ball = wvr.ClipSphere((4, 4, 0), 2.5)
    field = wvr.Volume(np.indices((9, 9, 9), np.uint8)[2], (1.0, 1.0, 1e-6))
    labels = (np.indices((9, 9, 9))[2] > 4).astype(np.uint8)
    camera = wvr.Camera((-9, 4.1, 4e-6), (0, 4.1, 4e-6), parallel_scale=1e-6)
    for options, length in (
        ({"clip": ball}, 2 * np.sqrt(2.5**2 - 0.01)),
        ({"clip": [ball, wvr.ClipVolume(field, 3.25)]}, 0.75 + np.sqrt(2.5**2 - 0.01)),
        ({"segmentation": wvr.Segmentation(labels, {1: tf})}, 3.5),
    ):
        image = wvr.render(volume, tf, camera, (1, 1), integrator=wvr.Exact(), **options)
        assert image.rgba[0, 0, 3] == pytest.approx(1 - 0.9**length, abs=1e-6)


@pytest.mark.parametrize("far", [1e15, 1e30, 1.7e308])
def test_a_box_without_an_end_is_cut_where_it_begins(far):
    """Its middle and half its size have no digits of where the volume is."""
    volume, tf = wvr.Volume(np.full((5, 5, 5), 100, np.uint8)), HOMOGENEOUS
    camera, corner = wvr.Camera.fit(volume, (1, 2, 3)), volume.corners.mean(axis=0) + 0.25
    for box, planes in (
        (wvr.ClipBox(corner, (far, far, far)), np.eye(3)),
        (wvr.ClipBox((-far, -far, corner[2]), (far, far, far)), [(0, 0, 1)]),
        (wvr.ClipBox((-far, -far, -far), (far, corner[1], far)), [(0, -1, 0)]),
    ):
        ours = wvr.render(volume, tf, camera, (12, 12), clip=box)
        theirs = wvr.render(volume, tf, camera, (12, 12), clip=[wvr.ClipPlane(corner, one) for one in planes])
        assert np.abs(ours.rgba - theirs.rgba).max() < 1e-6 and theirs.rgba.max() > 0.1
        assert ours.max_error < 1 / 512


@pytest.mark.parametrize("unit", [1e-90, 1.0, 1e90])
def test_shapes_of_any_size_leave_all_or_nothing(unit):
    """As far away, as large and as thin as numbers are: what a volume of any unit is wholly in or out of."""
    volume = wvr.Volume(np.ones((5, 6, 7), np.uint8), (unit,) * 3, (-3.1 * unit, -2.6 * unit, -2.2 * unit))
    tf = wvr.TransferFunction([(0, "white", 0.1), (2, "white", 0.1)])
    camera, far = wvr.Camera((9 * unit, 7 * unit, 5 * unit), (0, 0, 0)), np.full(3, 1e100)
    whole = wvr.render(volume, tf, camera, (6, 5)).rgba
    for shape, inside in (
        (wvr.ClipPlane(-far, (1, 2, 3)), True),
        (wvr.ClipPlane(far, (0, 1e-300, 0)), False),
        (wvr.ClipSphere((0, 0, 0), 1e100), True),
        (wvr.ClipSphere(far / 2, 1e100), True),
        (wvr.ClipSphere(far, 1e100), False),
        (wvr.ClipSphere(far, 1e-100), False),
        (wvr.ClipSphere((0, 0, 0), 5e-324), False),
        (wvr.ClipBox((0, 0, 0), (5e-324, 1e-310, 1e-200)), False),
        (wvr.ClipBox((0, -1.7e308, -1.7e308), (5e-324, 1.7e308, 1.7e308)), False),
    ):
        for invert in (False, True):
            image = wvr.render(volume, tf, camera, (6, 5), clip=replace(shape, invert=invert))
            assert np.abs(image.rgba - whole * (inside != invert)).max() < 1e-6, (shape, invert)
            assert image.max_error < 1 / 512
