"""Rays that rounding puts on either side of a cut: their bounds cover both, and those of other rays nothing of it.

Rays run in the surface of a clip or in a boundary of labels, as far as float64 can say; enclosures say on which side
they are.
"""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base.adversarial import errors
from wvr.kernels.field.cell import length_within

from ..extending.cylinder import ClipCylinder
from ..helpers import along, centered, constant, middle

TOLERANCE = 1e-6
THIN = constant(0.1, (0.2, 0.4, 0.8))
THICK = constant(0.3, (1.0, 0.5, 0.0))


def turned(seed):
    """A rotation; none for the first seed."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return np.eye(3) if seed == 0 else turn * np.linalg.det(turn)


def framed(samples, turn, at):
    """A volume whose axes are those of a rotation, its middle ``at`` a place."""
    half = (np.array(samples.shape)[::-1] - 1) / 2
    return wvr.Volume(samples, (1.0, 1.0, 1.0), tuple(at - turn @ half), turn)


def halves(n):
    """1 from the middle between two samples along x on."""
    return (np.indices((n, n, n))[2] >= n // 2).astype(np.uint8)


# What cuts along the plane x = 0 of a frame that is turned: options of a scene.
CUTS = {
    "plane": lambda turn, at: {"clip": wvr.ClipPlane(at, turn[:, 0])},
    "inverted plane": lambda turn, at: {"clip": wvr.ClipPlane(at, turn[:, 0], invert=True)},
    "iso": lambda turn, at: {"clip": wvr.ClipVolume(framed(np.indices((9, 9, 9), np.uint8)[2], turn, at), 4.0)},
    "steps": lambda turn, at: {"clip": wvr.ClipVolume(framed(halves(10), turn, at), 0.5)},
    "mask": lambda turn, at: {"clip": wvr.ClipVolume(framed(halves(10), turn, at - turn[:, 0] / 2), 1.0)},
    "bottom": lambda turn, at: {"clip": wvr.ClipVolume(framed(1 - halves(10), turn, at + turn[:, 0] / 2), 1.0)},
    "face": lambda turn, at: {
        "clip": wvr.ClipVolume(framed(np.ones((9, 9, 9), np.uint8), turn, at + 4 * turn[:, 0]), 0.5)
    },
    "labels": lambda turn, at: {"segmentation": wvr.Segmentation(halves(8), {1: THICK}, other=THIN)},
    "transparent labels": lambda turn, at: {"segmentation": wvr.Segmentation(halves(8), {1: THICK})},
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", CUTS)
def test_rays_in_a_plane_that_cuts(name):
    """Along its edges and diagonals, whatever the axes and however far they are from the world's origin."""
    beyond = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        turn, at = turned(seed), rng.normal(size=3) * 10.0 ** rng.integers(0, 4) * (seed > 0)
        volume = framed(np.full((8, 8, 8), 100, np.uint8), turn, at)
        cut = CUTS[name](turn, at)
        tf = None if "segmentation" in cut else THIN
        way = turn @ (0.0, *((0.0, 1.0) if seed % 2 == 0 else rng.normal(size=2)))
        center = at + turn @ (0.0, *rng.uniform(-1, 1, 2))
        camera = wvr.Camera(center - 20 * way, center, turn[:, 0], parallel_scale=1.0 if seed % 3 else None)
        image = wvr.render(volume, tf, camera, (1, 3), tolerance=TOLERANCE, **cut)
        for y in range(3):
            truth = wvr.enclose(volume, tf, camera, 0, y, (1, 3), **cut)
            least, most = errors(image.rgba[y, 0], truth)
            off = most if truth.width < 1e-9 else least
            assert off <= image.error_bound[y, 0], (seed, y)
            if y == 1:
                assert image.error_bound[y, 0] > 0.05
                beyond += image.error_bound[y, 0] > 10 * TOLERANCE
            else:
                assert image.error_bound[y, 0] <= TOLERANCE
    assert beyond == 6


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("tolerance", [TOLERANCE, 1 / 512])  # one by one, and abreast
@pytest.mark.parametrize("axis", range(3))
def test_axis_parallel_rays_in_the_faces_of_a_box(axis, tolerance):
    """The image is that of one side, the bound reaches to the other, in rows and columns of such rays alone."""
    volume, camera = centered(np.full((11, 11, 11), 100, np.uint8)), along(axis, scale=4.5)
    box = wvr.ClipBox((-2, -2, -2), (2, 2, 2))
    image, smaller, larger = (
        wvr.render(volume, THIN, camera, (9, 9), tolerance=tolerance, clip=clip)
        for clip in (box, wvr.ClipBox((-1.9,) * 3, (1.9,) * 3), wvr.ClipBox((-2.1,) * 3, (2.1,) * 3))
    )
    faces = np.zeros((9, 9), bool)
    faces[2:7, [2, 6]] = faces[[2, 6], 2:7] = True
    assert np.array_equal(image.error_bound > tolerance, faces)
    assert image.stats["rays_over_tolerance"] == np.count_nonzero(faces)
    for side in (smaller, larger):
        assert np.all(np.abs(image.rgba - side.rgba)[faces] <= image.error_bound[faces][:, None] + 0.02)
    assert np.abs(smaller.rgba - larger.rgba)[faces].max(axis=-1).min() > 0.3


@pytest.mark.parametrize("make", [wvr.ClipSphere, "cylinder"])
@pytest.mark.parametrize("invert", [False, True])
def test_tangents_of_what_is_round(make, invert):
    """What is cut, or not, is a chord as long as the root of what a ray is off by."""
    volume, camera = centered(np.full((11, 11, 11), 100, np.uint8)), along(2, scale=4.5)
    clip = (
        wvr.ClipSphere((0, 0, 0), 3.0, invert)
        if make != "cylinder"
        else ClipCylinder((0, -9, 0), (0, 9, 0), 3.0, invert)
    )
    image = wvr.render(volume, THIN, camera, (9, 9), tolerance=TOLERANCE, clip=clip)
    whole = wvr.render(volume, THIN, camera, (9, 9), tolerance=TOLERANCE, clip=wvr.ClipSphere((0, 0, 0), 50.0))
    added = image.error_bound - whole.error_bound * (image.rgba[..., 3] > 0)
    touching = added[[1, 7], 4]
    assert np.all(touching > 0.1 * np.sqrt(8 * 3 * 1e-15)) and np.all(touching < 1e-5)
    assert np.all(np.delete(added[:, 4], [1, 7]) < 1e-10)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_rays_that_cross_pay_nothing(seed):
    """In a homogeneous block bounds with random clips or labels are those without, to 1e-9 in the median."""
    rng = np.random.default_rng(seed)
    volume = centered(np.full((9, 9, 9), 100, np.uint8), 1 + rng.random(3))
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=bool(rng.random() < 0.5))
    center = middle(volume)
    field = centered(rng.integers(0, 256, (7, 8, 9), np.uint8), 1.5 + rng.random(3))
    labels = rng.integers(0, 3, (9, 9, 9), np.uint8)
    plain = wvr.render(volume, THIN, camera, (16, 16), tolerance=TOLERANCE, precision="float64")
    for options in (
        {"clip": [wvr.ClipPlane(center + rng.normal(size=3), rng.normal(size=3)), wvr.ClipSphere(center, 5.0)]},
        {"clip": wvr.ClipBox(center - rng.uniform(1, 5, 3), center + rng.uniform(1, 5, 3), invert=True)},
        {"clip": wvr.ClipVolume(field, 127.5)},
        {"segmentation": wvr.Segmentation(labels, {1: THIN, 2: THIN.scaled(1)}, other=THIN)},
    ):
        tf = None if "segmentation" in options else THIN
        image = wvr.render(volume, tf, camera, (16, 16), tolerance=TOLERANCE, precision="float64", **options)
        assert np.median(image.error_bound - plain.error_bound) < 1e-9
        assert image.error_bound.max() <= TOLERANCE


@pytest.fixture(scope="module")
def lengths():
    @wp.kernel(enable_backward=False, module="unique")
    def kernel(c: wp.array(dtype=wp.vec4d), e: wp.array(dtype=wp.float64), length: wp.array(dtype=wp.float64)):
        i = wp.tid()
        length[i] = length_within(c[i], wp.float64(1.5), e[i])

    def lengths(cubics, e):
        result = wp.zeros(len(e), dtype=wp.float64, device="cpu")
        wp.launch(
            kernel, len(e), [wp.array(cubics, wp.vec4d, device="cpu"), wp.array(e, wp.float64, device="cpu"), result]
        )
        return result.numpy()

    return lengths


def test_lengths_near_zero_of_a_cubic(lengths):
    """Against signs at many places, in cubics that touch zero once, twice or thrice, and any."""
    rng = np.random.default_rng(3)
    n, places = 400, np.linspace(0, 1.5, 60001)
    cubics = rng.normal(size=(n, 4))
    for i in range(0, n, 2):
        roots = rng.uniform(-0.2, 1.7, 3)
        roots[1 : 1 + i % 3] = roots[0]
        cubics[i] = np.polynomial.polynomial.polyfromroots(roots) * rng.normal()
    e = 10.0 ** rng.uniform(-4, 0, n)
    counted = [
        np.mean(np.abs(np.polynomial.polynomial.polyval(places, c)) <= tol) * 1.5
        for c, tol in zip(cubics, e, strict=True)
    ]
    np.testing.assert_allclose(lengths(cubics, e), counted, rtol=0, atol=5e-4)
    # As thin as rounding: a line is exact, a double root the square root, a triple one the cube root.
    thin = np.array([[-0.5, 1, 0, 0], [0.25, -1, 1, 0], [-0.125, 0.75, -1.5, 1], [1.0, 0, 0, 0], [0.0, 0, 0, 0]])
    expected = [2e-12, 2e-6, 2e-4, 0.0, 1.5]
    np.testing.assert_allclose(lengths(thin, np.full(5, 1e-12)), expected, rtol=1e-2, atol=1e-15)
