"""Clips against closed forms: what is cut away is gone to rounding, in every integrator; naive clips leave slices."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base.reference import trilinear
from wvr.kernels.clip import make_clipping, make_cut_normal
from wvr.kernels.partial import PARTS
from wvr.kernels.scene import Variant
from wvr.launch import get_device

from .conftest import max_error
from .test_raycast import along, centered

DATA = Path(__file__).parents[1] / "../shared/data"
UNIFORM = [wvr.Riemann(0.37), wvr.Simpson(0.37), wvr.Preintegrated(0.37)]
INTEGRATORS = [
    *UNIFORM,
    wvr.AdaptivePreintegrated(1e-3),
    wvr.AdaptiveSimpson(1e-3),
    wvr.Exact(),
    wvr.Certified(1e-4),
]
every_integrator = pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: type(i).__name__)
HOMOGENEOUS = wvr.TransferFunction([(0, (0.2, 0.4, 0.8), 0.1), (255, (0.2, 0.4, 0.8), 0.1)], unit_distance=1.0)
SCENE = wvr.TransferFunction([(0, "navy", 0.0), (60, "green", 0.02), (140, "gold", 0.3), (255, "white", 0.5)])


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


def block():
    """A homogeneous block, its axes and spacings anything."""
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    return wvr.Volume(np.full((9, 12, 7), 100, np.uint8), (0.7, 1.3, 0.9), (2.0, -3.0, 1.0), turn)


def middle(volume):
    return volume.corners.mean(axis=0)


def assert_depth(volume, clips, camera, size=(9, 7), integrator=None, atol=1e-9, **options):
    """Opacity is that of the visible length, and colour in proportion."""
    image = wvr.render(
        volume, HOMOGENEOUS, camera, size, integrator=integrator or wvr.Exact(), clip=clips, termination=0, **options
    )
    expected = 1 - 0.9 ** visible_length(volume, clips, camera, size)
    np.testing.assert_allclose(image.rgba, expected[..., None] * [0.2, 0.4, 0.8, 1.0], rtol=0, atol=atol)
    return expected


# Planes


@every_integrator
@pytest.mark.parametrize("seed", range(4))
def test_plane_through_a_homogeneous_block(device, integrator, seed):
    """At any angle and position; the steps divide nothing."""
    volume, rng = block(), np.random.default_rng(seed)
    plane = wvr.ClipPlane(middle(volume) + rng.normal(size=3), rng.normal(size=3))
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=seed % 2 == 0)
    options = {"integrator": integrator, "precision": "float64", "device": device}
    expected = assert_depth(volume, [plane], camera, **options)
    assert np.count_nonzero(expected) > 0 and expected.max() > 0.2
    # The default precision has samples, not sums, in float32.
    assert_depth(volume, [plane], camera, integrator=integrator, atol=1e-6, device=device)


@pytest.mark.parametrize("step", [0.013, 0.5, 1.0, 3.7, 100.0])
@pytest.mark.parametrize("make", [wvr.Riemann, wvr.Simpson, wvr.Preintegrated], ids=lambda make: make.__name__)
def test_any_step(make, step):
    volume = block()
    plane = wvr.ClipPlane(middle(volume), (0.3, -0.5, 0.8))
    assert_depth(volume, [plane], wvr.Camera.fit(volume), integrator=make(step), atol=1e-6)


@pytest.mark.parametrize("integrator", UNIFORM, ids=lambda i: type(i).__name__)
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


# Clip volumes


def ramp(normal, offset, shape=(14, 13, 12), spacing=(1.0, 1.0, 1.0)):
    """A clip volume around the world's origin whose field is the distance from a plane, times 8 and at least 100."""
    volume = centered(np.zeros(shape, np.uint8), np.array(spacing))
    k, j, i = np.indices(shape)
    points = np.stack([i, j, k], axis=-1) * spacing + volume.origin
    return wvr.Volume(points @ normal - offset, spacing, volume.origin)


@every_integrator
def test_a_plane_and_the_volume_of_that_plane(device, integrator, blobs):
    volume = centered(blobs.numpy())
    normal, offset = np.array([0.6, -0.64, 0.48]), 1.234
    plane = wvr.ClipPlane(offset * normal, normal)
    field = ramp(normal, offset, spacing=(3.1, 2.7, 2.9))
    camera = wvr.Camera.fit(volume, (0.5, 1, 0.7))
    images = [
        wvr.render(volume, SCENE, camera, (32, 24), integrator=integrator, clip=clip, device=device)
        for clip in (plane, wvr.ClipVolume(field, 0.0))
    ]
    assert max_error(images[0], images[1].rgba) < 1e-5 and images[0].rgba[..., 3].max() > 0.5
    inverted = wvr.render(
        volume, SCENE, camera, (32, 24), integrator=integrator, clip=wvr.ClipVolume(field, 0.0, invert=True)
    )
    other = wvr.ClipPlane(plane.point, plane.normal, invert=True)
    expected = wvr.render(volume, SCENE, camera, (32, 24), integrator=integrator, clip=other)
    assert max_error(inverted, expected.rgba) < 1e-5


def field_length(volume, clip, camera, size, n=4000):
    """Visible length by dense sampling of the clip field and bisection between samples."""
    origins, directions = camera.rays(size)
    to_index = np.linalg.inv(clip.volume.index_to_world)
    result = np.zeros(origins.shape[:2])

    def inside(t, o, d):
        points = (o + t[:, None] * d) @ to_index[:3, :3].T + to_index[:3, 3]
        low, high = clip.volume.index_box
        within = np.all((points >= low) & (points <= high), axis=-1)
        above = trilinear(clip.volume.numpy(), np.clip(points, low, high)) >= clip.iso
        return (within & above) != clip.invert

    to_volume = np.linalg.inv(volume.index_to_world)
    for pixel in np.ndindex(*result.shape):
        o, d = origins[pixel], directions[pixel]
        i, v = to_volume[:3, :3] @ o + to_volume[:3, 3], to_volume[:3, :3] @ d
        near, far = (np.sort([(bound - i) / v for bound in volume.index_box], axis=0)[k] for k in (0, 1))
        near, far = max(near.max(), 0 if not camera.parallel else -np.inf), far.min()
        if far <= near:
            continue
        t = np.linspace(near, far, n)
        seen = inside(t, o, d)
        change = np.flatnonzero(seen[1:] != seen[:-1])
        a, b, first = t[change], t[change + 1], seen[change]
        for _ in range(50):
            c = (a + b) / 2
            same = inside(c, o, d) == first
            a, b = np.where(same, c, a), np.where(same, b, c)
        cuts = np.concatenate([[near], (a + b) / 2, [far]])
        result[pixel] = np.diff(cuts)[0 if seen[0] else 1 :: 2].sum()
    return result


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_clip_volume(seed):
    """Random samples, resolution and pose, reaching beyond the volume or not, thin ones too."""
    rng = np.random.default_rng(seed)
    volume = block()
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    spacing, shape = rng.uniform(0.8, 4, 3), rng.integers(1, 12, 3)
    origin = middle(volume) - turn @ (spacing * (shape[::-1] - 1) / 2) + rng.normal(0, 2, 3)
    field = wvr.Volume(rng.integers(0, 256, shape, np.uint8), spacing, origin, turn)
    clip = wvr.ClipVolume(field, rng.uniform(60, 200), invert=bool(rng.random() < 0.5))
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=bool(rng.random() < 0.5))
    image = wvr.render(volume, HOMOGENEOUS, camera, (6, 5), integrator=wvr.Exact(), clip=clip)
    expected = 1 - 0.9 ** field_length(volume, clip, camera, (6, 5))
    # Where the reference's samples miss a stretch, it is off by no more than a few of their distances.
    off = np.abs(image.rgba[..., 3] - expected)
    assert np.median(off) < 1e-9 and off.max() < 2e-3


def test_clip_volumes_of_any_dtype(device, blobs):
    """Of one dtype and of several, in an intersection."""
    camera = wvr.Camera.fit(blobs)
    fields = [ramp(np.array([0.6, 0.0, 0.8]), 0.5), ramp(np.array([0.0, 1.0, 0.0]), -0.5)]
    fields = [wvr.Volume(f.numpy(), (4, 4, 4), (-10, -10, -10)) for f in fields]

    def rendered(dtypes):
        typed = [wvr.Volume(f.numpy().astype(t), f.spacing, f.origin) for f, t in zip(fields, dtypes, strict=True)]
        clips = [wvr.ClipVolume(f, 0.25) for f in typed]
        return wvr.render(blobs, SCENE, camera, (16, 16), integrator=wvr.Exact(), clip=clips, device=device)

    both = rendered(("float64", "float64"))
    assert max_error(rendered(("float32", "float64")), both.rgba) < 1e-5
    assert both.rgba.any()


# What is composed, and certified


@pytest.mark.parametrize("integrator", [wvr.Exact(), wvr.Certified(3e-7)], ids=repr)
def test_two_half_spaces_are_the_whole(device, integrator, blobs):
    camera = wvr.Camera.fit(blobs)
    normal = camera.target - camera.position
    whole, front, back = (
        wvr.render(
            blobs,
            SCENE,
            camera,
            (32, 32),
            integrator=integrator,
            clip=clip,
            device=device,
            termination=0,
            precision="float64",
        )
        for clip in (
            None,
            wvr.ClipPlane(camera.target, -normal),
            wvr.ClipPlane(camera.target, normal),
        )
    )
    composed = front.rgba + (1 - front.rgba[..., 3:]) * back.rgba
    assert max_error(whole, composed) < (1e-12 if isinstance(integrator, wvr.Exact) else 1e-6)
    assert front.rgba.any() and back.rgba.any()


def random_clips(rng, center, size):
    clips = []
    for _ in range(rng.integers(1, 4)):
        at, invert = center + size * rng.normal(0, 0.25, 3), bool(rng.random() < 0.5)
        half = size * rng.uniform(0.1, 0.5, 3)
        grid = wvr.Volume(rng.integers(0, 256, (5, 6, 4), np.uint8), size / rng.uniform(3, 9, 3), at - size / 2)
        clips.append(
            (
                wvr.ClipPlane(at, rng.normal(size=3), invert),
                wvr.ClipBox(at - half, at + half, invert),
                wvr.ClipSphere(at, half[0], invert),
                wvr.ClipVolume(grid, 128.0, invert),
            )[rng.integers(4)]
        )
    return clips


def assert_certified(volume, tf, camera, tolerance, clips, size=(16, 16)):
    exact = wvr.render(volume, tf, camera, size, integrator=wvr.Exact(), clip=clips)
    image = wvr.render(volume, tf, camera, size, tolerance=tolerance, clip=clips)
    error = np.abs(image.rgba - exact.rgba).max(axis=2)
    assert np.all(error <= image.error_bound), f"{error.max()}, bound {image.error_bound.max()}"
    assert image.error_bound.max() <= tolerance
    return exact


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), tolerance=st.floats(1e-6, 0.3), unit=st.sampled_from([0.05, 1.0]))
def test_certified_with_any_clips(seed, tolerance, unit):
    """Every pixel within its bound, nearly opaque scenes too, whose rays end in one stretch or between two."""
    rng = np.random.default_rng(seed)
    volume = wvr.datasets.load("blobs", 24)
    size = np.ptp(volume.corners, axis=0)
    tf = wvr.TransferFunction.from_arrays(SCENE.knots, SCENE.colors, SCENE.opacities, unit * volume.smallest_spacing)
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3))
    assert_certified(volume, tf, camera, tolerance, random_clips(rng, middle(volume), size))


@pytest.mark.parametrize("file", ["bonsai.nrrd", "cthead.nrrd"])
def test_certified_real_volumes(file):
    if not (DATA / file).exists():
        pytest.skip(f"{DATA / file} is not there")
    volume = wvr.read(DATA / file)
    lo, hi = volume.range
    tf = wvr.TransferFunction([(lo + t * (hi - lo), c, a) for t, c, a in ((0.1, "navy", 0.0), (1, "white", 0.3))])
    size = np.ptp(volume.corners, axis=0)
    clips = random_clips(np.random.default_rng(3), middle(volume), size)
    exact = assert_certified(volume, tf, wvr.Camera.fit(volume), 1e-3, clips, (40, 40))
    assert exact.rgba[..., 3].max() > 0.1


@every_integrator
def test_termination(integrator, blobs):
    """Rays end behind several stretches as they do in one: off by no more than the transparency that is left."""
    camera = wvr.Camera.fit(blobs)
    tf = wvr.TransferFunction([(0, "navy", 0.0), (50, "green", 0.2), (255, "gold", 0.9)])
    clip = [wvr.ClipSphere(middle(blobs), 6, invert=True), wvr.ClipPlane(middle(blobs), (1, 1, 1))]
    scene = blobs, tf, camera, (24, 24)
    whole = wvr.render(*scene, integrator=integrator, clip=clip, termination=0)
    early = wvr.render(*scene, integrator=integrator, clip=clip, termination=0.05)
    assert early.samples.sum() < whole.samples.sum() and 0 < np.abs(early.rgba - whole.rgba).max() <= 0.05


@every_integrator
def test_same_bits_on_any_number_of_threads(integrator, blobs, threads):
    images = []
    for n in (1, 3):
        threads(n)
        clip = wvr.ClipSphere(middle(blobs), 9)
        images.append(wvr.render(blobs, SCENE, wvr.Camera.fit(blobs), (40, 40), integrator=integrator, clip=clip))
    assert np.array_equal(images[0].rgba, images[1].rgba)


def test_what_is_cut_away_is_not_marched(blobs):
    camera = wvr.Camera.fit(blobs)
    for integrator in INTEGRATORS:
        scene = {"integrator": integrator, "termination": 0}
        whole = wvr.render(blobs, SCENE, camera, (24, 24), **scene)
        ball = wvr.render(blobs, SCENE, camera, (24, 24), **scene, clip=wvr.ClipSphere(middle(blobs), 4))
        assert ball.samples.sum() < 0.2 * whole.samples.sum()
        away = wvr.ClipBox((1e3, 0, 0), (2e3, 1, 1))
        none = wvr.render(blobs, SCENE, camera, (24, 24), **scene, clip=away)
        assert not none.rgba.any() and not none.samples.any()


# The renderer


@pytest.mark.parametrize("integrator", [wvr.AdaptivePreintegrated(1e-2), wvr.AdaptiveSimpson(1e-3)], ids=repr)
def test_trace_of_a_cut_ray(integrator, blobs):
    """Steps of all stretches, each where it is on the ray, none in what is cut away."""
    volume = centered(blobs.numpy())
    camera = along(2, scale=1.0)
    slab = wvr.ClipBox((-99, -99, -4), (99, 99, 3), invert=True)
    image = wvr.render(volume, SCENE, camera, (3, 3), integrator=integrator, clip=slab, termination=0)
    steps = image.trace(1, 1)
    start, end = steps["t"], steps["t"] + steps["length"]
    assert np.all(start[1:] >= end[:-1] - 1e-5) and end[-1] <= 31 + 1e-5
    front, back = 15.5 - 4, 15.5 + 3
    assert np.all((end <= front + 1e-5) | (start >= back - 1e-5))
    assert np.any(end <= front + 1e-5) and np.any(start >= back - 1e-5)
    np.testing.assert_allclose(steps["rgba"][-1], image.rgba[1, 1], atol=1e-6)


def test_a_new_plane_rebuilds_nothing(blobs, device):
    renderer = wvr.Renderer(blobs, SCENE, device=device)
    camera = wvr.Camera.fit(blobs)
    renderer.render(camera, (16, 16))
    built = dict(renderer.builds)
    renderer.clip = wvr.ClipPlane(middle(blobs), (1, 0, 0))
    one = renderer.render(camera, (16, 16))
    renderer.clip = [wvr.ClipPlane(middle(blobs), (0, 1, 0)), wvr.ClipSphere(middle(blobs), 9)]
    two = renderer.render(camera, (16, 16))
    assert renderer.builds == built and not np.array_equal(one.rgba, two.rgba)
    field = wvr.ClipVolume(blobs, 100.0)
    renderer.clip = field
    renderer.render(camera, (16, 16))
    assert renderer.builds == built | {"clips": 1}
    renderer.clip = [field, wvr.ClipVolume(blobs, 120.0, invert=True)]
    renderer.render(camera, (16, 16))
    assert renderer.builds == built | {"clips": 1}


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: wvr.ClipPlane((0, 0, 0), (0, 0, 0)), ValueError, r"normal must not be zero, got \(0, 0, 0\)"),
        (lambda: wvr.ClipPlane((0, np.nan, 0), (0, 0, 1)), ValueError, "point must be three finite numbers"),
        (lambda: wvr.ClipPlane((0, 0), (0, 0, 1)), ValueError, "point must be three finite numbers"),
        (lambda: wvr.ClipPlane((0, 0, 0), (0, np.inf, 1)), ValueError, "normal must be three finite numbers"),
        (lambda: wvr.ClipBox((0, 0, 0), (1, -1, 1)), ValueError, r"lo must be below hi .*got lo = \(0, 0, 0\)"),
        (lambda: wvr.ClipBox((0, 0, 0), (1, np.nan, 1)), ValueError, "hi must be three finite numbers"),
        (lambda: wvr.ClipSphere((0, 0, 0), 0), ValueError, "radius must be finite and > 0, got 0"),
        (lambda: wvr.ClipSphere((0, 0, 0), float("nan")), ValueError, "radius must be finite and > 0, got nan"),
        (lambda: wvr.ClipSphere("here", 1), ValueError, "center must be three numbers"),
        (
            lambda: wvr.ClipVolume(np.zeros((2, 2, 2))),
            TypeError,
            "volume of a ClipVolume must be a Volume, got ndarray",
        ),
        (lambda: wvr.ClipVolume(ramp(np.ones(3), 0), np.nan), ValueError, "iso must be a finite number, got nan"),
        (lambda: wvr.ClipVolume(ramp(np.ones(3), 0), parts="half"), ValueError, "parts must be one of None, 'first-o"),
        (
            lambda: wvr.ClipVolume(wvr.Volume(np.full((2, 2, 2), np.nan), nan="transparent")),
            ValueError,
            "volume of a ClipVolume must have finite samples",
        ),
    ],
)
def test_errors_of_clips(make, error, message):
    with pytest.raises(error, match=message):
        make()


@pytest.mark.parametrize(
    ("clip", "integrator", "error", "message"),
    [
        ("plane", None, TypeError, "clip must be None, one of ClipPlane, ClipBox, .* got 'plane'"),
        ([wvr.ClipSphere((0, 0, 0), 1), None], None, TypeError, "clip must be None, one of .* got None"),
        (wvr.ClipSphere((0, 0, 0), 1, naive=True), None, ValueError, "clip with naive needs one of Riemann, Simpson"),
        (wvr.ClipSphere((0, 0, 0), 1, naive=True), wvr.Exact(), ValueError, "clip with naive needs"),
        (
            wvr.ClipVolume(wvr.Volume(np.zeros((2, 2, 2))), parts="power"),
            wvr.Riemann(1),
            ValueError,
            "clip with parts needs one of Preintegrated",
        ),
    ],
)
def test_errors_of_rendering(clip, integrator, error, message, blobs):
    with pytest.raises(error, match=message):
        wvr.render(blobs, SCENE, wvr.Camera.fit(blobs), (4, 4), integrator=integrator, clip=clip)


def test_clips_are_values():
    assert wvr.ClipPlane([0, 0, 0], np.array([0, 0, 1])) == wvr.ClipPlane((0.0, 0, 0), (0, 0, 1.0))
    assert len({wvr.ClipBox((0, 0, 0), (1, 1, 1)), wvr.ClipBox([0, 0, 0], [1, 1, 1])}) == 1
    assert "ClipSphere(center=(0.0, 0.0, 0.0), radius=2" in repr(wvr.ClipSphere((0, 0, 0), 2))


# Segments cut one by one, after the paper


def parts_error(parts, volume, tf, step, clip_volume, iso):
    camera = wvr.Camera.fit(volume, (0.4, 1, 0.6), parallel=True)
    scene = volume, tf, camera, (24, 24)
    exact = wvr.render(*scene, integrator=wvr.Exact(), clip=wvr.ClipVolume(clip_volume, iso))
    clip = wvr.ClipVolume(clip_volume, iso, parts=parts)
    image = wvr.render(*scene, integrator=wvr.Preintegrated(step), clip=clip, termination=0, precision="float64")
    return np.abs(image.rgba - exact.rgba).max(axis=(0, 1)), exact


@pytest.mark.parametrize("step", [0.37, 2.0])
def test_opacity_of_cut_segments(step):
    """T^b is exact for a clip field linear along a ray, colour by b is not; what ignores the length is far off."""
    volume = centered(np.full((9, 9, 9), 100, np.uint8))
    tf = wvr.TransferFunction([(0, (1, 0.5, 0.2), 0.9), (255, (1, 0.5, 0.2), 0.9)], unit_distance=1.0)
    field = ramp(np.array([0.0, 0.6, 0.8]), 0.7)
    off = {parts: parts_error(parts, volume, tf, step, field, 0.0)[0] for parts in PARTS}
    assert off["length"].max() < 1e-9 and off["ratio"].max() < 1e-6
    assert off["power"][3] < 1e-6 < 0.02 < off["power"][0]
    assert off["first-order"][3] > 0.02 and off["isosurface"][3] > 0.2


def test_parts_approach_exact_with_the_step(blobs):
    """With thin segments all but "isosurface" do: "length" with order 2, colour by b with the segments' depth."""
    volume = centered(blobs.numpy())
    field = ramp(np.array([0.6, 0.0, 0.8]), 0.7, (30, 30, 30), (1.2, 1.2, 1.2))
    for parts, order in (("length", 1.8), ("ratio", 1.8), ("power", 1.8), ("first-order", 1.8)):
        coarse, fine = (parts_error(parts, volume, SCENE, step, field, 0.0)[0].max() for step in (0.5, 0.125))
        assert np.log(coarse / fine) / np.log(4) > order, parts


# Normals of cuts


def test_cut_normals():
    """At points of each surface, in the world, whatever the volume's axes, towards what is cut away."""
    volume = block()
    center, rng = middle(volume), np.random.default_rng(1)
    normal = np.array([0.48, -0.64, 0.6])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    k, _, i = np.indices((9, 9, 9)) - 4.0
    ramp = wvr.Volume(3 * i + 4 * k, (1.0, 1.2, 1.0), center - turn @ (4.0, 4.8, 4.0), turn)
    outwards = rng.normal(size=3)
    outwards /= np.linalg.norm(outwards)
    cases = [
        (wvr.ClipPlane(center, 3 * normal), center, -normal),
        (wvr.ClipPlane(center, normal, invert=True), center, normal),
        (wvr.ClipSphere(center, 2.0), center + 2 * outwards, outwards),
        (wvr.ClipBox(center - (1, 2, 3), np.add(center, (3, 2, 1))), np.add(center, (0.5, -2, 0.3)), (0, -1, 0)),
        (wvr.ClipBox(center - 1, center + 1, invert=True), np.add(center, (0.1, 0.2, 1)), (0, 0, -1)),
        (wvr.ClipVolume(ramp, 0.0), center + turn @ (0.4, 0.2, -0.3), turn @ (-0.6, 0, -0.8)),
        (wvr.ClipVolume(ramp, -99.0, invert=True), center + turn @ (0.3, -4.8, 0.2), turn @ (0, 1, 0)),
    ]
    to_index = np.linalg.inv(volume.index_to_world)
    for clip, point, expected in cases:
        renderer = wvr.Renderer(volume, HOMOGENEOUS, clip=clip)
        dtype = wp.float64 if isinstance(clip, wvr.ClipVolume) else wp.uint8
        variant = Variant(wp.uint8, "float64", "exact", True, clips=dtype, clipped=True)
        clipping = renderer._clipping([clip], variant, get_device("cpu"))
        result = wp.zeros(1, dtype=wp.vec3d, device="cpu")
        place = wp.vec3d(*(to_index[:3, :3] @ point + to_index[:3, 3]))
        wp.launch(make_normals(dtype), 1, [clipping, wp.mat33d(*to_index[:3, :3].ravel()), place, result], device="cpu")
        np.testing.assert_allclose(result.numpy()[0], expected, atol=1e-9)


def make_normals(dtype):
    _, Clipping = make_clipping(dtype)
    cut_normal = make_cut_normal(dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def normals(clipping: Clipping, to_index: wp.mat33d, p: wp.vec3d, result: wp.array(dtype=wp.vec3d)):
        result[0] = cut_normal(clipping, to_index, p, wp.float64(1.0))

    return normals
