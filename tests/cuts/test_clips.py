"""All that clips have in common: composition, certificates, where rays end, what is rebuilt, and normals of cuts."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from wvr.cuts.volumes import clipping_struct
from wvr.keep import Keeper
from wvr.kernels.cuts.shapes import KINDS as KINDS_OF_SHAPES
from wvr.kernels.cuts.volumes import make_clipping, make_cut_normal
from wvr.launch import get_device

from ..helpers import (
    DATA,
    INTEGRATORS,
    KINDS,
    SMOOTH,
    along,
    assert_certified,
    block,
    centered,
    constant,
    every_kind,
    max_error,
    middle,
    ramp,
)

# What is composed, and certified


@pytest.mark.parametrize("integrator", [wvr.Exact(), wvr.Certified(3e-7)], ids=repr)
def test_two_half_spaces_are_the_whole(device, integrator, blobs):
    camera = wvr.Camera.fit(blobs)
    normal = camera.target - camera.position
    whole, front, back = (
        wvr.render(
            blobs,
            SMOOTH,
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


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), tolerance=st.floats(1e-6, 0.3), unit=st.sampled_from([0.05, 1.0]))
def test_certified_with_any_clips(seed, tolerance, unit):
    """Every pixel within its bound, nearly opaque scenes too, whose rays end in one stretch or between two."""
    rng = np.random.default_rng(seed)
    volume = wvr.datasets.load("blobs", 24)
    size = np.ptp(volume.corners, axis=0)
    tf = wvr.TransferFunction.from_arrays(SMOOTH.knots, SMOOTH.colors, SMOOTH.opacities, unit * volume.smallest_spacing)
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3))
    assert_certified(volume, tf, camera, tolerance, clip=random_clips(rng, middle(volume), size))


@pytest.mark.parametrize("file", ["bonsai.nrrd", "cthead.nrrd"])
def test_certified_real_volumes(file):
    if not (DATA / file).exists():
        pytest.skip(f"{DATA / file} is not there")
    volume = wvr.read(DATA / file)
    lo, hi = volume.range
    tf = wvr.TransferFunction([(lo + t * (hi - lo), c, a) for t, c, a in ((0.1, "navy", 0.0), (1, "white", 0.3))])
    size = np.ptp(volume.corners, axis=0)
    clips = random_clips(np.random.default_rng(3), middle(volume), size)
    image = assert_certified(volume, tf, wvr.Camera.fit(volume), 1e-3, (40, 40), clip=clips)
    assert image.rgba[..., 3].max() > 0.1


@every_kind
def test_termination(integrator, blobs):
    """Rays end behind several stretches as they do in one: off by no more than the transparency that is left."""
    camera = wvr.Camera.fit(blobs)
    tf = wvr.TransferFunction([(0, "navy", 0.0), (50, "green", 0.2), (255, "gold", 0.9)])
    clip = [wvr.ClipSphere(middle(blobs), 6, invert=True), wvr.ClipPlane(middle(blobs), (1, 1, 1))]
    scene = blobs, tf, camera, (24, 24)
    whole = wvr.render(*scene, integrator=integrator, clip=clip, termination=0)
    early = wvr.render(*scene, integrator=integrator, clip=clip, termination=0.05)
    assert early.samples.sum() < whole.samples.sum() and 0 < np.abs(early.rgba - whole.rgba).max() <= 0.05


def test_a_ray_that_ends_to_rounding_where_a_stretch_does():
    """Whoever ends it, the march of the stretch or the sum of all, what is behind is in its bound."""
    volume = wvr.Volume(np.ones((5, 5, 41), np.uint8))
    gaps = [wvr.ClipBox((x, -1, -1), (x + 1, 5, 5), invert=True) for x in (9, 19)]
    camera = along(0, center=(20, 2, 2))
    renderer = wvr.Renderer(volume, tolerance=1e-3, precision="float64", clip=gaps)
    for opacity in map(float.fromhex, ("0x1.464339f321f6cp-6", "0x1.e02831131b2d2p-7", "0x1.116fb5cbb390fp-6")):
        depth = -np.log1p(-opacity)
        renderer.transfer_function = constant(opacity)
        for ulps in range(-8, 9):
            renderer.termination = np.exp(-18 * depth) + ulps * 2.0**-53
            image = renderer.render(camera, (1, 1))
            error = np.abs(image.rgba[0, 0] + np.expm1(-38 * depth)).max()
            assert error <= image.error_bound[0, 0], (opacity, ulps)


@every_kind
def test_same_bits_on_any_number_of_threads(integrator, blobs, threads):
    images = []
    for n in (1, 3):
        threads(n)
        clip = wvr.ClipSphere(middle(blobs), 9)
        images.append(wvr.render(blobs, SMOOTH, wvr.Camera.fit(blobs), (40, 40), integrator=integrator, clip=clip))
    assert np.array_equal(images[0].rgba, images[1].rgba)


def test_what_is_cut_away_is_not_marched(blobs):
    camera = wvr.Camera.fit(blobs)
    for integrator in map(INTEGRATORS.get, KINDS):
        scene = {"integrator": integrator, "termination": 0}
        whole = wvr.render(blobs, SMOOTH, camera, (24, 24), **scene)
        ball = wvr.render(blobs, SMOOTH, camera, (24, 24), **scene, clip=wvr.ClipSphere(middle(blobs), 4))
        assert ball.samples.sum() < 0.2 * whole.samples.sum()
        away = wvr.ClipBox((1e3, 0, 0), (2e3, 1, 1))
        none = wvr.render(blobs, SMOOTH, camera, (24, 24), **scene, clip=away)
        assert not none.rgba.any() and not none.samples.any()


# The renderer


@pytest.mark.parametrize("integrator", [wvr.AdaptivePreintegrated(1e-2), wvr.AdaptiveSimpson(1e-3)], ids=repr)
def test_trace_of_a_cut_ray(integrator, blobs):
    """Steps of all stretches, each where it is on the ray, none in what is cut away."""
    volume = centered(blobs.numpy())
    camera = along(2, scale=1.0)
    slab = wvr.ClipBox((-99, -99, -4), (99, 99, 3), invert=True)
    image = wvr.render(volume, SMOOTH, camera, (3, 3), integrator=integrator, clip=slab, termination=0)
    steps = image.trace(1, 1)
    start, end = steps["t"], steps["t"] + steps["length"]
    assert np.all(start[1:] >= end[:-1] - 1e-5) and end[-1] <= 31 + 1e-5
    front, back = 15.5 - 4, 15.5 + 3
    assert np.all((end <= front + 1e-5) | (start >= back - 1e-5))
    assert np.any(end <= front + 1e-5) and np.any(start >= back - 1e-5)
    np.testing.assert_allclose(steps["rgba"][-1], image.rgba[1, 1], atol=1e-6)


def test_a_new_plane_rebuilds_nothing(blobs, device):
    renderer = wvr.Renderer(blobs, SMOOTH, device=device)
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
        (lambda: wvr.ClipSphere((0, 0, 1e101), 1), ValueError, r"center must be within 1e\+100, got \(0, 0, 1e\+101\)"),
        (lambda: wvr.ClipSphere((0, 0, 0), 1e101), ValueError, r"radius must be within 1e\+100, got 1e\+101"),
        (lambda: wvr.ClipPlane((0, 1e308, 0), (0, 1, 1)), ValueError, r"point must be within 1e\+100, got \(0, 1e"),
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
        (
            lambda: wvr.ClipVolume(wvr.Volume(np.array([[[-1.7e308, 1.7e308]]]))),
            ValueError,
            r"volume of a ClipVolume must have samples of sizes up to 1e\+200, got -1.7e\+308 to 1.7e\+308",
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
        ([wvr.ClipSphere((0, 0, 0), 1), None], None, TypeError, "clip must be None, one of ClipPlane, .* got None"),
        (
            wvr.ClipSphere((0, 0, 0), 1, naive=True),
            None,
            ValueError,
            "clip with naive needs an integrator that has such steps, got Certified",
        ),
        (wvr.ClipSphere((0, 0, 0), 1, naive=True), wvr.Exact(), ValueError, r"naive needs an .*, got Exact\(\)"),
        (
            wvr.ClipVolume(wvr.Volume(np.zeros((2, 2, 2))), parts="power"),
            wvr.Riemann(1),
            ValueError,
            "clip with parts needs an integrator that has such steps, got Riemann",
        ),
    ],
)
def test_errors_of_rendering(clip, integrator, error, message, blobs):
    with pytest.raises(error, match=message):
        wvr.render(blobs, SMOOTH, wvr.Camera.fit(blobs), (4, 4), integrator=integrator, clip=clip)


def test_clips_are_values():
    assert wvr.ClipPlane([0, 0, 0], np.array([0, 0, 1])) == wvr.ClipPlane((0.0, 0, 0), (0, 0, 1.0))
    assert len({wvr.ClipBox((0, 0, 0), (1, 1, 1)), wvr.ClipBox([0, 0, 0], [1, 1, 1])}) == 1
    assert "ClipSphere(center=(0.0, 0.0, 0.0), radius=2" in repr(wvr.ClipSphere((0, 0, 0), 2))


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
        dtype = wp.float64 if isinstance(clip, wvr.ClipVolume) else wp.uint8
        clipping = clipping_struct((clip,), volume, Keeper(get_device("cpu")))
        result = wp.zeros(1, dtype=wp.vec3d, device="cpu")
        place = wp.vec3d(*(to_index[:3, :3] @ point + to_index[:3, 3]))
        wp.launch(make_normals(dtype), 1, [clipping, wp.mat33d(*to_index[:3, :3].ravel()), place, result], device="cpu")
        np.testing.assert_allclose(result.numpy()[0], expected, atol=1e-9)


def make_normals(dtype):
    _, Clipping = make_clipping(dtype)
    cut_normal = make_cut_normal(KINDS_OF_SHAPES, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def normals(clipping: Clipping, to_index: wp.mat33d, p: wp.vec3d, result: wp.array(dtype=wp.vec3d)):
        result[0] = cut_normal(clipping, to_index, p, wp.float64(1.0))

    return normals
