"""The ray caster against closed forms, an independent float64 reference, its order of convergence, and invariances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erf

import wvr
from studies.base import reference
from studies.base.reference import quadrature
from wvr.transfer.lookup import on_jumps

from ..helpers import (
    INTEGRATORS,
    ROUNDING,
    UNIFORM,
    along,
    centered,
    every_integrator,
    every_uniform,
    max_error,
)

# Closed forms


@every_integrator
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_homogeneous_slab(device, integrator, precision, axis):
    """Opacity 1 - (1 - opacity)^(L / unit), whatever the step, the spacing and the axis."""
    spacing = np.array([0.7, 1.3, 2.9])
    volume = centered(np.full((5, 6, 7), 3.0), spacing)
    tf = wvr.TransferFunction([(0, (0.2, 0.5, 1.0), 0.11), (9, (0.2, 0.5, 1.0), 0.11)], unit_distance=2.0)
    for sign in (1, -1):
        image = wvr.render(
            volume,
            tf,
            along(axis, sign),
            (3, 3),
            integrator=integrator,
            precision=precision,
            device=device,
            termination=0,
        )
        length = (volume.dimensions[axis] - 1) * spacing[axis]
        A = 1 - (1 - 0.11) ** (length / 2.0)
        expected = np.array([0.2 * A, 0.5 * A, A, A])
        np.testing.assert_allclose(image.rgba, np.broadcast_to(expected, (3, 3, 4)), rtol=0, atol=ROUNDING[precision])


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 2e-6), ("float64", 1e-11)])
def test_linear_ramp(device, precision, tolerance):
    """A scalar linear along the ray: pre-integration is exact for any step, also where colour varies."""
    volume = centered(np.linspace(0, 1, 9, dtype=np.float64)[:, None, None] * np.ones((1, 3, 3)))
    tf = wvr.TransferFunction(
        [(0, (1, 0, 0.2), 0.0), (0.3, (0, 1, 0.2), 0.9), (0.31, (0, 0, 1), 0.05), (1, (1, 1, 1), 0.6)]
    )
    integrator = wvr.Preintegrated(0.8, table_size=1001)  # the segments' ends are table entries, but for the last
    for sign, ends in ((1, (0, 1)), (-1, (1, 0))):
        image = wvr.render(
            volume, tf, along(2, sign), (1, 1), integrator=integrator, precision=precision, device=device, termination=0
        )
        np.testing.assert_allclose(image.rgba[0, 0], quadrature(tf, *ends, 8.0), rtol=0, atol=tolerance)


def test_gaussian_and_grid_refinement(device):
    """Depth of a Gaussian is an error function; trilinear reconstruction approaches it with order 2."""
    sigma, half = 1.0, 3.0
    errors, sizes = [], [17, 33, 65, 129, 257]
    for n in sizes:
        z = np.linspace(-half, half, n)
        data = np.exp(-0.5 * (z / sigma) ** 2)[:, None, None] * np.ones((1, 2, 2))
        volume = centered(data, (1, 1, 2 * half / (n - 1)))
        tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (1, (1, 1, 1), 0.5)], unit_distance=1.0)
        image = wvr.render(
            volume, tf, along(2), (1, 1), integrator=wvr.Riemann(1.0), precision="float64", device=device, termination=0
        )
        depth = np.log(2) * sigma * np.sqrt(2 * np.pi) * erf(half / sigma / np.sqrt(2))
        errors.append(abs(image.rgba[0, 0, 3] - -np.expm1(-depth)))
    assert errors[-1] < 1e-5
    slope = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 1.9 < slope < 2.1


@pytest.mark.parametrize(
    "integrator", [wvr.Riemann(0.25), wvr.Simpson(0.25), wvr.Preintegrated(0.25), wvr.Exact()], ids=repr
)
def test_pixel_refinement(device, integrator):
    """A pixel approaches the mean of those it is refined to with order 2: its ray goes through its centre.

    In one cell, seen along an axis, extinction is linear along a ray and depth that of the field halfway.
    """
    cell = np.random.default_rng(3).random((2, 2, 2))
    volume = centered(cell)
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (1, (1, 1, 1), 0.9)])
    camera = along(2, scale=0.45)  # no pixel sees past the cell
    sizes = 2 ** np.arange(2, 8)
    images = {}
    for n in sizes:
        image = wvr.render(
            volume, tf, camera, (n, n), integrator=integrator, precision="float64", device=device, termination=0
        )
        images[n] = image.rgba[..., 3]
        x, y, _ = np.moveaxis(camera.rays((n, n))[0] + 0.5, -1, 0)
        (a, b), (c, d) = cell.mean(axis=0)  # [y, x]
        depth = np.log(10) * ((1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d))
        np.testing.assert_allclose(images[n], -np.expm1(-depth), atol=3e-6)

    def order(coarsened) -> float:
        errors = [np.sqrt(np.mean((images[n] - coarsened(images[2 * n])) ** 2)) for n in sizes[:-1]]
        return -np.polyfit(np.log(sizes[:-1]), np.log(errors), 1)[0]

    assert 1.8 < order(lambda fine: fine.reshape(len(fine) // 2, 2, -1, 2).mean(axis=(1, 3))) < 2.2
    # A pixel whose ray went through a corner would be as far off as one of the four alone.
    assert 0.8 < order(lambda fine: fine[::2, ::2]) < 1.2


# Order of convergence, inside one cell, where the field along a ray is a smooth cubic


@pytest.mark.parametrize(
    "make",
    [
        lambda h: wvr.Riemann(h, "left"),
        lambda h: wvr.Riemann(h, "midpoint"),
        lambda h: wvr.Riemann(h, "trapezoid"),
        wvr.Simpson,
        lambda h: wvr.Preintegrated(h, table_size=2049),
    ],
    ids=["left", "midpoint", "trapezoid", "simpson", "preintegrated"],
)
def test_order(device, make, smooth_tf):
    cell = np.random.default_rng(11).random((2, 2, 2))
    volume = centered(cell)
    camera = wvr.Camera((3, 2, 1.5), (0, 0, 0), view_angle=20)
    tf = wvr.TransferFunction.from_arrays(smooth_tf.knots, smooth_tf.colors, smooth_tf.opacities, unit_distance=0.3)
    exact = reference.render(volume, tf, camera, (9, 9), parts=256)
    # Steps that divide no ray: the last partial step is part of the order.
    steps = 0.19 / 2.0 ** np.arange(6)
    errors = []
    for h in steps:
        image = wvr.render(
            volume, tf, camera, (9, 9), integrator=make(h), precision="float64", device=device, termination=0
        )
        errors.append(np.sqrt(np.mean((image.rgba - exact) ** 2)))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    order = make(1.0).order
    assert order - 0.15 < slope < order + 0.3, (slope, errors)


# The independent reference


@every_integrator
@pytest.mark.parametrize("parallel", [False, True])
def test_against_reference(device, integrator, parallel, blobs):
    tf = wvr.TransferFunction([(0, "navy", 0.0), (50, "green", 0.02), (255, "gold", 0.4)])
    camera = wvr.Camera.fit(blobs, parallel=parallel)
    exact = reference.render(blobs, tf, camera, (24, 18), parts=8)
    image = wvr.render(blobs, tf, camera, (24, 18), integrator=integrator, device=device, termination=0)
    assert max_error(image, exact) < (0.02 if integrator.order == 1 else 1e-3)
    assert exact[..., 3].max() > 0.5


def test_rays_end_in_the_outermost_layer(device):
    """Samples there are its samples, also where a jump of the transfer function has all that is less on its other
    side: rounding put rays beside it.
    """
    samples = np.zeros((9, 30, 30), np.uint8)
    samples[-1] = 200
    tf = wvr.TransferFunction([(0, "red", 0.0), (200, "red", 0.0), (200, "white", 0.4)], unit_distance=1.0)
    camera = wvr.Camera((12, 13, -50), (15.1, 14.2, 8), up=(0, 1, 0), view_angle=7)
    image = wvr.render(wvr.Volume(samples), tf, camera, (24, 18), integrator=wvr.Simpson(0.75), device=device)
    way = camera.unproject(*np.meshgrid(np.arange(24), np.arange(18)), 1.0, (24, 18)) - camera.position
    left = 8 * np.linalg.norm(way, axis=-1) / way[..., 2] % 0.75  # of rays, for their last segments
    assert np.abs(image.rgba[..., 3] - (1 - 0.6 ** (left / 6))).max() < 1e-5


@pytest.mark.parametrize("position", [(0.2, -0.3, 0.1), (3.4, 0.0, 0.0), (-2.0, 2.9, 3.1)])
def test_camera_inside(device, position, smooth_tf):
    volume = centered(np.random.default_rng(2).random((8, 8, 8)))
    camera = wvr.Camera(position, (-0.5, 0.4, -0.2), view_angle=120)
    exact = reference.render(volume, smooth_tf, camera, (16, 12), parts=8)
    image = wvr.render(volume, smooth_tf, camera, (16, 12), integrator=wvr.Riemann(0.01), device=device, termination=0)
    assert max_error(image, exact) < 2e-5


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_axis_parallel_rays(device, axis, sign, smooth_tf):
    """Two of the direction's components are exactly zero; rays also run along faces and edges of cells."""
    volume = centered(np.random.default_rng(4).random((5, 6, 7)))
    camera = along(axis, sign, scale=4.0)
    exact = reference.render(volume, smooth_tf, camera, (16, 16), parts=8)
    image = wvr.render(volume, smooth_tf, camera, (16, 16), integrator=wvr.Riemann(0.01), device=device, termination=0)
    assert np.all(np.isfinite(image.rgba)) and max_error(image, exact) < 1e-5
    assert np.count_nonzero(image.rgba[..., 3]) == np.count_nonzero(exact[..., 3])


@every_integrator
@pytest.mark.parametrize("shape", [(1, 4, 5), (4, 1, 5), (4, 5, 1), (1, 1, 4), (1, 1, 1), (2, 2, 2)])
def test_thin_volumes(device, integrator, shape):
    """An axis with one sample is one spacing thick, centred on the sample."""
    spacing = np.array([1.5, 0.8, 2.0])
    volume = centered(np.full(shape, 7, np.uint8), spacing)
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.3), (9, (1, 1, 1), 0.3)], unit_distance=1.0)
    for axis in range(3):
        length = max(volume.dimensions[axis] - 1, 1) * spacing[axis]
        image = wvr.render(
            volume, tf, along(axis, scale=0.1), (2, 2), integrator=integrator, device=device, termination=0
        )
        np.testing.assert_allclose(image.rgba, 1 - 0.7**length, rtol=0, atol=2e-6)


@pytest.mark.parametrize("shape", [(1, 4, 5), (4, 1, 5), (4, 5, 1), (1, 1, 6)])
def test_thin_volumes_are_constant_across(device, shape, smooth_tf):
    volume = centered(np.random.default_rng(1).random(shape))
    camera = wvr.Camera.fit(volume, (1.0, 0.8, 0.6))
    exact = reference.render(volume, smooth_tf, camera, (16, 16), parts=16)
    image = wvr.render(volume, smooth_tf, camera, (16, 16), integrator=wvr.Riemann(0.01), device=device, termination=0)
    assert max_error(image, exact) < 2e-5


def test_lone_voxel_footprint(device):
    """One bright sample lights the cells around it and nothing else, centred where the sample is."""
    data = np.zeros((9, 9, 9), np.uint8)
    data[2, 3, 5] = 255  # z, y, x
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (255, (1, 1, 1), 0.5)])
    camera = wvr.Camera((5, 3, 50), (5, 3, 2), up=(0, 1, 0), parallel_scale=2.0)
    alpha = wvr.render(volume, tf, camera, (40, 40), integrator=wvr.Riemann(0.1), device=device).rgba[..., 3]
    y, x = np.nonzero(alpha)
    assert (x.min(), x.max(), y.min(), y.max()) == (10, 29, 10, 29)
    np.testing.assert_allclose(alpha, alpha[::-1, ::-1], atol=1e-6)


# What early termination and absent data do


@every_integrator
def test_termination_bounds_the_error(device, integrator, blobs):
    tf = wvr.TransferFunction([(0, "navy", 0.0), (50, "green", 0.2), (255, "gold", 0.9)])
    camera = wvr.Camera.fit(blobs)
    whole = wvr.render(blobs, tf, camera, (32, 32), integrator=integrator, device=device, termination=0)
    early = wvr.render(blobs, tf, camera, (32, 32), integrator=integrator, device=device, termination=0.05)
    assert early.samples.sum() < 0.95 * whole.samples.sum()
    assert 0 < np.abs(early.rgba - whole.rgba).max() <= 0.05


@every_uniform
def test_samples_counts_segments(device, integrator):
    volume = centered(np.zeros((11, 3, 3), np.uint8))
    tf = wvr.TransferFunction([(0, "red", 0.1), (1, "red", 0.1)])
    image = wvr.render(volume, tf, along(2, scale=5), (8, 8), integrator=integrator, device=device, termination=0)
    assert image.samples.max() == np.ceil(10 / 0.37) and image.samples.min() == 0
    assert image.stats["samples"] == image.samples.sum()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@every_integrator
def test_absent_data_render_as_nothing(device, integrator, bad):
    data = np.full((12, 12, 12), 5.0, np.float32)
    data[6, 6, 6] = bad
    volume = centered(data, nan="transparent")
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.1), (9, (1, 1, 1), 0.1)])
    alpha = wvr.render(
        volume, tf, along(2, scale=6), (48, 48), integrator=integrator, device=device, termination=0
    ).rgba[..., 3]
    assert np.all(np.isfinite(alpha))
    full, hole = alpha.max(), alpha.min(initial=1, where=alpha > 0)
    assert full == pytest.approx(1 - 0.9**11, abs=1e-6)
    # Two of eleven cells are gone, and at most the segments that touch them.
    assert 1 - 0.9 ** (9 - 2 * 0.37) - 1e-6 <= hole <= 1 - 0.9 ** (9 + 2 * 0.37) + 1e-6
    inside = alpha[alpha > 0]
    assert np.mean(inside < full - 1e-4) == pytest.approx(4 / 121, abs=0.02)


@every_integrator
def test_a_step_that_ends_in_the_face_of_an_absent_cell_counts(integrator):
    """On whichever side that cell's samples are stored."""
    data = np.full((9, 9, 9), 5.0, np.float32)
    data[5:] = np.nan
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.1), (9, (1, 1, 1), 0.1)])
    if hasattr(integrator, "step"):
        integrator = replace(integrator, step=2.0 if integrator == INTEGRATORS["oversampled"] else 0.5)
    alpha = []
    for samples, way in ((data, 1.0), (data[::-1].copy(), -1.0)):
        volume = wvr.Volume(samples, (1, 1, 1), (-4, -4, -4 * way), np.diag([1, 1, way]), nan="transparent")
        image = wvr.render(volume, tf, along(2, -1, 3.1), (8, 8), integrator=integrator, termination=0)
        alpha.append(image.rgba[..., 3])
    assert np.abs(alpha[0] - alpha[1]).max() < 1e-6
    # But for whole steps of different orders across the face.
    off = 0.03 if integrator == INTEGRATORS["AdaptiveSimpson"] else 1e-6
    assert np.abs(alpha[0] - (1 - 0.9**4)).max() < off


# Invariances


@every_integrator
def test_threads_do_not_change_a_bit(integrator, blobs, threads):
    tf = wvr.TransferFunction([(0, "navy", 0.0), (50, "green", 0.02), (255, "gold", 0.4)])
    camera = wvr.Camera.fit(blobs)
    images = []
    for n in (1, 2, 3, 8):
        threads(n)
        images.append(wvr.render(blobs, tf, camera, (70, 50), integrator=integrator, device="cpu"))
    for image in images[1:]:
        assert np.array_equal(image.rgba, images[0].rgba) and np.array_equal(image.samples, images[0].samples)


@every_integrator
@pytest.mark.parametrize("scale", [1e-6, 0.3, 4e5])
def test_units_scale(device, integrator, scale, blobs):
    """Everything in metres or everything in millimetres: the same picture."""
    tf = wvr.TransferFunction([(0, "navy", 0.0), (50, "green", 0.02), (255, "gold", 0.4)], unit_distance=1.0)
    camera = wvr.Camera.fit(blobs)
    image = wvr.render(blobs, tf, camera, (32, 32), integrator=integrator, device=device)
    scaled = wvr.render(
        wvr.Volume(blobs.data, spacing=scale * blobs.spacing),
        wvr.TransferFunction.from_arrays(tf.knots, tf.colors, tf.opacities, unit_distance=scale),
        wvr.Camera(scale * camera.position, scale * camera.target),
        (32, 32),
        integrator=integrator,
        device=device,
    )
    assert max_error(scaled, image.rgba) < 1e-6


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), far=st.sampled_from([0.0, 1e3, 1e6]))
def test_rotating_everything(seed, far):
    """Direction matrix, origin and camera moved by the same rigid motion: the same picture."""
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    shift = far * rng.normal(size=3)
    data = rng.random((6, 5, 7)).astype(np.float32)
    spacing, origin = rng.uniform(0.5, 2, 3), rng.normal(size=3)
    tf = wvr.TransferFunction([(0, "red", 0.1), (1, "blue", 0.5)])
    volume = wvr.Volume(data, spacing, origin)
    moved = wvr.Volume(data, spacing, rotation @ origin + shift, rotation)
    camera = wvr.Camera.fit(volume, direction=rng.normal(size=3), up=rng.normal(size=3))
    turned = wvr.Camera(rotation @ camera.position + shift, rotation @ camera.target + shift, rotation @ camera.up)
    a, b = (
        wvr.render(*scene, (24, 24), integrator=wvr.Riemann(0.2))
        for scene in ((volume, tf, camera), (moved, tf, turned))
    )
    # Rays that graze the box's edge may enter or miss it; elsewhere rounding of a world at 1e6 is 1e-10.
    assert max_error(a, b.rgba) < 1e-5


@pytest.mark.parametrize(
    ("integrator", "dtype"),
    [
        *((wvr.Riemann(0.37), dtype) for dtype in ("uint8", "int8", "int16", "float16", "float32", "float64")),
        *((wvr.Preintegrated(0.37, table_size=101), dtype) for dtype in ("uint8", "uint16", "float32")),
    ],
)
def test_dtypes(device, dtype, integrator):
    values = np.random.default_rng(6).integers(0, 101, (10, 11, 12))
    tf = wvr.TransferFunction([(0, "navy", 0.0), (40, "green", 0.05), (100, "gold", 0.4)])
    plain = centered(values.astype(np.float64))
    camera = wvr.Camera.fit(plain)
    expected = wvr.render(plain, tf, camera, (24, 24), integrator=integrator, precision="float64", device=device)
    volume = centered(values.astype(dtype))
    if dtype in ("uint8", "float32", "float64"):
        image = wvr.render(volume, tf, camera, (24, 24), integrator=integrator, device=device)
        assert image.rgba.dtype == np.float32 and max_error(image, expected.rgba) < 1e-5
    exact = wvr.render(volume, tf, camera, (24, 24), integrator=integrator, device=device, precision="float64")
    assert exact.rgba.dtype == np.float64 and max_error(exact, expected.rgba) < 1e-12


@pytest.mark.parametrize(
    ("offset", "dtype"), [(1e6, "float64"), (1e6, "float32"), (-3e9, "float64"), (2000, "float16")]
)
def test_data_far_from_zero_keep_their_range(device, offset, dtype):
    """Scalars such as 1e6 +- 1, rendered in float32 without losing them."""
    values = np.random.default_rng(8).integers(0, 33, (8, 8, 8)) / 16.0
    if dtype == "float16":
        values = np.round(values * 8)
    data = (values + offset).astype(dtype)
    assert len(np.unique(data)) == len(np.unique(values))
    stored = data.astype(np.float64) - offset
    top = stored.max()
    camera = wvr.Camera.fit(wvr.Volume(stored))
    points = [(0, "navy", 0.0), (top / 3, "green", 0.05), (top, "gold", 0.4)]
    integrator = wvr.Riemann(0.1)
    near = wvr.render(wvr.Volume(stored), wvr.TransferFunction(points), camera, (24, 24), integrator=integrator)
    tf = wvr.TransferFunction([(s + offset, c, o) for s, c, o in points])
    far = wvr.render(wvr.Volume(data), tf, camera, (24, 24), integrator=integrator, device=device)
    assert max_error(far, near.rgba) < 5e-6


def test_distant_camera(device):
    """A camera 1e6 voxels away with a narrow view sees thin spikes as well as a near parallel one."""
    data = np.random.default_rng(9).random((8, 8, 8)).astype(np.float32)
    volume = centered(data)
    tf = wvr.TransferFunction.isosurfaces([0.4, 0.6], opacity=0.9, width=0.01)
    integrator = wvr.Preintegrated(0.05, table_size=801)
    near = wvr.Camera((100, 60, 40), (0, 0, 0), parallel_scale=8.0)
    distant = wvr.Camera(near.position * 1e4, (0, 0, 0), parallel_scale=8.0)
    a, b = (wvr.render(volume, tf, c, (24, 24), integrator=integrator, device=device) for c in (near, distant))
    assert max_error(a, b.rgba) < 1e-4
    one, other = (
        wvr.render(volume, tf, c, (24, 24), integrator=integrator, device=device, precision="float64")
        for c in (near, distant)
    )
    assert max_error(one, other.rgba) < 1e-6


def test_trapezoid_takes_the_mean_emission(device):
    """One segment from a dense red end to a thin blue one: colours count by their extinction."""
    volume = centered(np.array([0.0, 1.0])[:, None, None] * np.ones((1, 2, 2)))
    tf = wvr.TransferFunction([(0, (1, 0, 0), 0.6), (1, (0, 0, 1), 0.1)])
    image = wvr.render(volume, tf, along(2), (1, 1), integrator=wvr.Riemann(1.0, "trapezoid"), device=device)
    tau = -np.log1p([-0.6, -0.1])
    A = -np.expm1(-tau.mean())
    np.testing.assert_allclose(image.rgba[0, 0], A * np.array([tau[0], 0, tau[1], tau.sum()]) / tau.sum(), atol=1e-6)


# Skipping

# All but AdaptiveSimpson, whose steps are as long as the one before allows, whatever lies between.
STEADY = [integrator for name, integrator in INTEGRATORS.items() if name != "AdaptiveSimpson"]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    integrator=st.sampled_from([*STEADY, wvr.Riemann(3.3)]),
    parallel=st.booleans(),
    holes=st.booleans(),
)
def test_leaping_over_empty_blocks_changes_nothing(seed, integrator, parallel, holes):
    """A few bright samples anywhere, many on the blocks' faces: the same picture with fewer samples."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 40, 3)
    data = np.zeros(shape, np.float32 if holes else np.float64)
    for _ in range(rng.integers(0, 6)):
        data[tuple(np.minimum(4 * rng.integers(0, 10, 3) + rng.integers(-1, 2, 3), shape - 1))] = rng.random()
    if holes:
        data[tuple(rng.integers(0, shape))] = np.nan
    volume = wvr.Volume(data, spacing=rng.uniform(0.5, 2, 3), nan="transparent")
    tf = wvr.TransferFunction([(0, "red", 0.0), (0.05, "red", 0.0), (1, "white", 0.9)])
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=parallel)
    scene = volume, tf, camera, (24, 24)
    leapt = wvr.render(*scene, integrator=integrator, termination=0)
    whole = wvr.render(*scene, integrator=integrator, termination=0, skip_empty=False)
    assert max_error(leapt, whole.rgba) < 1e-6
    assert np.all(leapt.samples <= whole.samples)


def test_leaping_spares_samples(device):
    data = np.zeros((64, 64, 64), np.uint8)
    data[30:34, 30:34, 30:34] = 200
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction([(0, "red", 0.0), (10, "red", 0.0), (255, "white", 0.5)])
    scene = volume, tf, wvr.Camera.fit(volume), (64, 64)
    for integrator in map(INTEGRATORS.get, UNIFORM):
        leapt = wvr.render(*scene, integrator=integrator, device=device)
        whole = wvr.render(*scene, integrator=integrator, device=device, skip_empty=False)
        assert leapt.samples.sum() < 0.1 * whole.samples.sum() and leapt.samples.any()


@pytest.mark.parametrize(
    ("scale", "dtype"),
    [(1.0, "f4"), (0.937, "f4"), (311.3, "f4"), (8, "u1"), (100, "u1"), (300, "u2"), (3000, "u2")],
)
def test_pre_integration_converges_where_a_field_stays_at_a_jump(scale, dtype):
    """Which is a table's entry, of few and of many grey levels: beside one, all that lies at the jump is of a mixture
    of both sides, 0.05 to 0.6 off.
    """
    z, y, x = np.indices((16, 16, 16)) - 7.5
    shells = np.clip(np.round(np.sqrt(x * x + y * y + z * z) / 2) * 2, 0, 8) / 8
    volume = wvr.Volume((scale * shells).astype(dtype))
    jump = float((np.full(1, scale * 0.5)).astype(dtype)[0])
    tf = wvr.TransferFunction([(0, "white", 0.02), (jump, "white", 0.02), (jump, "red", 0.3), (scale, "blue", 0.1)])
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    errors = []
    for method in (wvr.Exact(), wvr.Preintegrated(1), wvr.Preintegrated(0.25)):
        image = wvr.render(volume, tf, camera, (24, 24), integrator=method, lighting=False, precision="float64")
        errors.append(image.rgba)
    coarse, fine = (np.abs(rgba - errors[0]).max() for rgba in errors[1:])
    assert fine < 0.02 and coarse > 2.5 * fine
    adaptive = wvr.render(volume, tf, camera, (24, 24), integrator=wvr.AdaptivePreintegrated(1e-3), lighting=False)
    assert np.abs(adaptive.rgba - errors[0]).max() < 0.02


@pytest.mark.parametrize("jump", [np.nextafter(1.0, 2.0), 1 + 1e-14])
def test_a_jump_right_beyond_all_samples_is_not_seen(jump):
    """It is no entry of tables, whose last is the largest sample: that would have the colours behind the jump."""
    samples = np.ones((6, 6, 6))
    samples[0] = 0
    volume = wvr.Volume(samples)
    tf = wvr.TransferFunction([(0, "red", 0.1), (jump, "red", 0.1), (jump, "lime", 0.6), (2, "lime", 0.6)])
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    for method in (wvr.Preintegrated(1), wvr.AdaptivePreintegrated(1e-3)):
        image = wvr.render(volume, tf, camera, (8, 8), integrator=method, lighting=False, precision="float64")
        assert image.rgba[..., 0].max() > 0.3 and not image.rgba[..., 1].any()


def test_tables_have_jumps_at_entries():
    def places(*jumps):
        points = [(-1, "red", 0.1), *((s, "red", a) for s in jumps for a in (0.1, 0.5)), (2, "red", 0.1)]
        n, (low, high) = on_jumps(wvr.TransferFunction(points), 512, (0.0, 1.0))
        assert 512 <= n <= 1024 and low <= 0 and high >= 1
        return (np.array(jumps) - low) / (high - low) * (n - 1)

    assert on_jumps(wvr.TransferFunction([(0, "red", 0.1), (1, "red", 0.5)]), 512, (0.0, 1.0)) == (512, (0.0, 1.0))
    for jumps in ((0.3,), (0.0,), (1.0,), (0.3, 0.7123), (0.3, 0.3 + 1e-9), (6 / 401, 1.0), (0.1, 0.3, 0.7)):
        exact = places(*jumps)
        assert np.abs(exact - np.rint(exact)).max() < 1e-5, jumps
    # Closer than parts of an entry are numbers.
    tiny = wvr.TransferFunction([(0, "red", 0.1), (0, "red", 0.5), (5e-324, "red", 0.5), (5e-324, "red", 0.1)])
    assert on_jumps(tiny, 512, (0.0, 1e6)) == (512, (0.0, 1e6))
    # Nor can more than there are entries be at some: what is tried would take gigabytes.
    steps = np.repeat(np.arange(50_000) / 50_000, 2)
    many = wvr.TransferFunction.from_arrays(steps, np.ones((len(steps), 3)), np.arange(len(steps)) % 7 / 8)
    assert on_jumps(many, 512, (0.0, 1.0)) == (512, (0.0, 1.0))
    several = places(0.1, 0.2718, 0.57721, 0.9)
    assert np.abs(several - np.rint(several)).max() < 0.05


@pytest.mark.parametrize("integrator", [wvr.Preintegrated(0.5), wvr.AdaptivePreintegrated(1e-4)], ids=repr)
@pytest.mark.parametrize("points", [[(280, "navy", 0.1), (320, "gold", 0.4)], [(280, "navy", 0.1), (300, "gold", 0.4)]])
def test_a_state_that_is_the_same_but_for_rounding(integrator, points):
    """As a simulation begins with: a transfer function is as good as linear there, whatever entries a table has."""
    samples = 300 + np.spacing(300.0) * np.random.default_rng(1).integers(-20, 20, (6, 6, 6))
    volume, tf = wvr.Volume(samples), wvr.TransferFunction(points)
    exact, image = (
        wvr.render(volume, tf, wvr.Camera.fit(volume), (6, 6), integrator=one, lighting=False, termination=0)
        for one in (wvr.Exact(), integrator)
    )
    assert exact.rgba[3, 3, 3] > 0.5 and max_error(image, exact.rgba) < 1e-5
