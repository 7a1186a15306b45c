"""The exact integrator against adaptive quadrature of its own making, closed forms, and invariances."""

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp

import wvr
from studies.base import reference
from studies.base.reference import quadrature

from ..helpers import along, centered, max_error

CHEBYSHEV = 0.5 - 0.5 * np.cos((np.arange(4) + 0.5) * np.pi / 4)
MONOMIALS = np.linalg.inv(np.vander(CHEBYSHEV, increasing=True))


def exact(volume, tf, camera, size=(16, 16), **kwargs):
    return wvr.render(volume, tf, camera, size, integrator=wvr.Exact(), termination=0, **kwargs)


# The oracle: cubics fitted to samples, roots as eigenvalues of companion matrices, adaptive Gauss-Kronrod quadrature.


def rays(volume, camera, size):
    """Origins and directions in index coordinates, and where each ray crosses cell faces."""
    to_index = np.linalg.inv(volume.index_to_world)
    origins, directions = camera.rays(size)
    o = origins.reshape(-1, 3) @ to_index[:3, :3].T + to_index[:3, 3]
    d = directions.reshape(-1, 3) @ to_index[:3, :3].T
    return o, d, reference._crossings(volume, o, d, not camera.parallel)


def fit(values):
    """Coefficients, constant first, of the cubic through values (..., 4) at the Chebyshev nodes of [0, 1]."""
    return values @ MONOMIALS.T


def evaluate(coefficients, u):
    return coefficients @ u ** np.arange(coefficients.shape[-1])


def companion_roots(p):
    """Real parts of all roots of cubics (n, 4), constant first, clipped to [0, 1] and polished; others are harmless."""
    scale = np.abs(p).max(axis=1, keepdims=True) + 1e-200
    found = []
    for q, inverse in ((p, False), (p[:, ::-1], True)):
        matrix = np.zeros((len(p), 3, 3))
        matrix[:, [1, 2], [0, 1]] = 1
        lead = np.where(np.abs(q[:, 3:]) < 1e-30 * scale, 1e-30 * scale, q[:, 3:])
        matrix[:, :, 2] = -q[:, :3] / lead
        roots = np.linalg.eigvals(matrix)
        with np.errstate(divide="ignore", invalid="ignore"):
            found.append(np.nan_to_num((1 / roots if inverse else roots).real, nan=0.0))
    t = np.clip(np.concatenate(found, axis=1), 0, 1)
    c = p.T[..., None]
    for _ in range(4):
        slope = c[1] + t * (2 * c[2] + t * 3 * c[3])
        step = (c[0] + t * (c[1] + t * (c[2] + t * c[3]))) / np.where(slope == 0, np.inf, slope)
        t = np.clip(t - np.where(np.abs(step) < 1e-3, step, 0), 0, 1)
    return t


def pieces(volume, tf, camera, size):
    """Smooth pieces of all rays, in order: ray, start, length, cubic coefficients of the scalar."""
    o, d, t = rays(volume, camera, size)
    ray, cell = np.nonzero(np.diff(t, axis=1) > 1e-13)
    start, length = t[ray, cell], np.diff(t, axis=1)[ray, cell]
    s = scalars(volume, o, d, ray, start, length)
    present = np.isfinite(s).all(axis=1)
    ray, start, length, s = ray[present], start[present], length[present], fit(s[present])
    ends = np.zeros((len(s), 1)), np.ones((len(s), 1))
    crossings = [companion_roots(s - [knot, 0, 0, 0]) for knot in np.unique(tf.knots)]
    splits = np.sort(np.concatenate([*ends, *crossings], axis=1), axis=1)
    n, m = np.nonzero(np.diff(splits, axis=1) > 1e-12)
    begin = splits[n, m]
    # What is left out in between is at most 1e-12 a root.
    return o, d, ray[n], start[n] + begin * length[n], (splits[n, m + 1] - begin) * length[n]


def scalars(volume, o, d, ray, start, length):
    """The field at the Chebyshev nodes of stretches of rays, away from their ends."""
    x = start[:, None] + length[:, None] * CHEBYSHEV
    return reference.trilinear(volume.numpy(), o[ray, None] + x[..., None] * d[ray, None])


def oracle(volume, tf, camera, size):
    o, d, ray, start, length = pieces(volume, tf, camera, size)
    s = scalars(volume, o, d, ray, start, length)
    tau = fit(tf.extinction(s, volume.smallest_spacing)) * length[:, None]
    color = np.stack([fit(channel) for channel in np.moveaxis(tf.color(s), -1, 0)])
    depth = np.concatenate([np.zeros((len(tau), 1)), tau / np.arange(1, 5)], axis=1)

    def emission(u):
        return evaluate(color, u) * (evaluate(tau, u) * np.exp(-evaluate(depth, u)))

    inside, _ = quad_vec(emission, 0, 1, epsabs=1e-12, epsrel=1e-12, norm="max", limit=400)
    total = depth.sum(axis=1)
    result = np.zeros((size[1] * size[0], 4))
    reached = np.zeros(size[1] * size[0])
    # Pieces are in order, so a ray's depth before a piece is a running sum less that of the rays before.
    before = np.cumsum(total) - total
    opens = np.r_[True, ray[1:] != ray[:-1]]
    before -= before[opens][np.cumsum(opens) - 1]
    for channel in range(3):
        np.add.at(result[:, channel], ray, np.exp(-before) * inside[channel])
    np.add.at(reached, ray, total)
    result[:, 3] = -np.expm1(-reached)
    return result.reshape(size[1], size[0], 4)


def random_tf(rng, lo, hi):
    """Ramps, a jump, a thin spike, and stretches without extinction."""
    n = int(rng.integers(3, 8))
    s = np.sort(rng.uniform(lo, hi, n))
    opacity = rng.random(n) ** 3 * (rng.random(n) > 0.3)
    rgb = rng.random((n, 3))
    jump, spike = rng.uniform(lo, hi, 2)
    width = (hi - lo) * 10 ** rng.uniform(-5, -1)
    keep = (np.abs(s - spike) > width) & (s != jump)
    points = np.r_[s[keep], jump, jump, spike - width, spike, spike + width]
    opacity = np.r_[opacity[keep], rng.random(2), 0.0, 0.9, 0.0]
    rgb = np.concatenate([rgb[keep], rng.random((5, 3))])
    order = np.argsort(points, kind="stable")
    return wvr.TransferFunction.from_arrays(points[order], rgb[order], opacity[order])


@pytest.mark.parametrize("seed", range(10))
def test_against_adaptive_quadrature(device, seed):
    rng = np.random.default_rng(seed)
    dtype = ["float64", "uint8", "float32", "int16", "float16"][seed % 5]
    lo, hi = {"uint8": (0, 255), "int16": (-1000, 3000)}.get(dtype, (-1, 2))
    shape = rng.integers(2, 9, 3)
    data = (rng.uniform(lo, hi, shape) if seed != 1 else rng.choice([lo, hi / 2, hi], shape)).astype(dtype)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    volume = wvr.Volume(data, rng.uniform(0.5, 2, 3), rng.normal(size=3), rotation)
    tf = random_tf(rng, lo, hi)
    if seed % 3 == 2:
        middle = volume.corners.mean(axis=0)
        camera = wvr.Camera(middle + 0.3 * rng.normal(size=3), middle, rng.normal(size=3), view_angle=110)
    else:
        camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=seed % 3 == 1)
    image = exact(volume, tf, camera, (20, 20), device=device)
    expected = oracle(volume, tf, camera, (20, 20))
    assert image.rgba.dtype == np.float64 and expected[..., 3].max() > 0.2
    assert max_error(image, expected) < 1e-11


@pytest.mark.parametrize("unit", [1e-3, 0.03, 0.12, 0.4, 2.0, 30.0, 1e3])
def test_depths_of_curved_pieces(device, unit):
    """Corners of 0 and 1: as curved as a cell can be, in pieces of depth 1e-3 to 1e3; the nodes must suffice."""
    tf = wvr.TransferFunction([(0, "red", 0.0), (1, "blue", 0.9)], unit_distance=unit)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        volume = centered(rng.choice([0, 1, 0.02], (2, 2, 2)))
        camera = wvr.Camera.fit(volume, rng.normal(size=3))
        image = exact(volume, tf, camera, device=device)
        # An extinction of 2.3 / unit times the rounding of a position.
        assert max_error(image, oracle(volume, tf, camera, (16, 16))) < 1e-12 + 1e-14 / unit


def test_against_a_differential_equation(device):
    """dD/dt = tau, dC/dt = c tau exp(-D), with SciPy's stepper between the faces and crossings, and nothing else."""
    rng = np.random.default_rng(5)
    volume = centered(rng.random((5, 4, 6)), np.array([1.0, 1.7, 0.8]))
    tf = wvr.TransferFunction([(0.2, "red", 0.0), (0.4, "lime", 0.8), (0.4, "blue", 0.1), (0.7, "white", 0.6)])
    camera = wvr.Camera.fit(volume)
    image = exact(volume, tf, camera, (3, 3), device=device)
    o, d, ray, start, length = pieces(volume, tf, camera, (3, 3))

    def rate(t, state, r):
        s = reference.trilinear(volume.numpy(), o[r] + t * d[r])
        tau = tf.extinction(s, volume.smallest_spacing)
        return np.r_[tf.color(s) * tau * np.exp(-state[3]), tau]

    for r in range(9):
        state = np.zeros(4)
        for a, h in zip(start[ray == r], length[ray == r], strict=True):
            inside = (a + 1e-13, a + h - 1e-13)
            state = solve_ivp(rate, inside, state, "DOP853", args=(r,), rtol=1e-12, atol=1e-12).y[:, -1]
        expected = np.r_[state[:3], -np.expm1(-state[3])]
        np.testing.assert_allclose(image.rgba.reshape(-1, 4)[r], expected, rtol=0, atol=1e-10)
    assert np.count_nonzero(image.rgba[..., 3]) >= 3


# Closed forms


JAGGED = wvr.TransferFunction(
    [(0, (1, 0, 0.2), 0.0), (0.3, (0, 1, 0.2), 0.9), (0.31, (0, 0, 1), 0.05), (0.6, "white", 0.3), (0.6, "red", 0.99)]
)


@pytest.mark.parametrize("length", [1e-6, 0.1, 8.0, 1e3, 1e6])
@pytest.mark.parametrize("tf", [JAGGED, wvr.TransferFunction([(0, "red", 0), (1, "blue", 1)])], ids=["jagged", "ramp"])
def test_linear_ramp(device, tf, length):
    """A scalar linear along the ray, from faint to opaque within a thousandth of a piece."""
    volume = centered(np.linspace(0, 1, 5)[:, None, None] * np.ones((1, 3, 3)), (1, 1, length / 4))
    tf = wvr.TransferFunction.from_arrays(tf.knots, tf.colors, tf.opacities, unit_distance=1.0)
    for sign, ends in ((1, (0, 1)), (-1, (1, 0))):
        camera = wvr.Camera((0, 0, -sign * length), (0, 0, 0), (0, 1, 0), parallel_scale=0.7)
        image = exact(volume, tf, camera, (2, 2), device=device)
        expected = quadrature(tf, *ends, length)
        np.testing.assert_allclose(image.rgba, np.broadcast_to(expected, (2, 2, 4)), rtol=0, atol=1e-12)


def test_field_that_stays_at_a_jump(device):
    """A homogeneous field exactly at a jump has the value above it; next to it, that of its side."""
    tf = wvr.TransferFunction([(0, "red", 0.1), (1, "red", 0.1), (1, "lime", 0.4), (1.5, "lime", 0.4)])
    for value, opacity in ((np.nextafter(1.0, 0), 0.1), (1.0, 0.4), (np.nextafter(1.0, 2), 0.4)):
        volume = centered(np.full((3, 3, 3), value))
        image = exact(volume, tf, wvr.Camera.fit(volume, (0, 0, 1), (0, 1, 0), parallel=True), (9, 9), device=device)
        assert image.rgba[4, 4, 3] == pytest.approx(1 - (1 - opacity) ** 2, abs=1e-12)


# Where walks go wrong


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_rays_along_faces_and_edges(device, axis, sign):
    """Pixels half a voxel apart: rays in the middle of cells, in their faces and along their edges; and beside."""
    rng = np.random.default_rng(4)
    volume = centered(rng.random((5, 6, 7)))
    tf = random_tf(rng, 0, 1)
    for offset in (0.0, 0.25, 1e-13, -1e-13, 1e-300):
        camera = along(axis, sign, scale=4.0, center=offset * np.roll([0, 1, 1], axis))
        image = exact(volume, tf, camera, (17, 17), device=device)
        assert max_error(image, oracle(volume, tf, camera, (17, 17))) < 1e-11


def test_grazing_rays(device):
    """Directions nearly in the faces, and through the corners of all cells."""
    rng = np.random.default_rng(7)
    volume = centered(rng.random((7, 7, 7)))
    tf = random_tf(rng, 0, 1)
    for slope in (0.0, 1e-16, 1e-12, 1e-7, 1e-3):
        for direction in ((1, slope, -slope), (slope, -1, 0), (1, 1, 1 + slope), (-1, 1, slope), (2, -1, 1)):
            camera = wvr.Camera.fit(volume, direction, (0.3, 0.2, 1), parallel=True)
            image = exact(volume, tf, camera, (13, 13), device=device)
            # A ray that runs in the box's own face, to rounding, may see it or not.
            whole = np.abs(image.rgba - oracle(volume, tf, camera, (13, 13))).max(axis=-1)
            assert np.count_nonzero(whole > 1e-11) == 0


@pytest.mark.parametrize("shape", [(1, 4, 5), (4, 1, 5), (4, 5, 1), (1, 1, 6), (1, 6, 1), (6, 1, 1), (1, 1, 1)])
def test_thin_volumes(device, shape):
    """An axis with one sample is one spacing thick, centred on the sample, and constant across."""
    rng = np.random.default_rng(1)
    volume = centered(rng.random(shape), np.array([1.5, 0.8, 2.0]))
    tf = random_tf(rng, 0, 1)
    for direction in (1.0, 0.8, 0.6), (0, 0, 1), (0, -1, 0), (1, 0, 0):
        camera = wvr.Camera.fit(volume, direction, (0.1, 0.2, 0.3))
        image = exact(volume, tf, camera, (12, 12), device=device)
        assert max_error(image, oracle(volume, tf, camera, (12, 12))) < 1e-11


def test_hundreds_of_control_points_in_a_cell(device):
    rng = np.random.default_rng(3)
    n = 400
    tf = wvr.TransferFunction.from_arrays(np.sort(rng.random(n)), rng.random((n, 3)), rng.random(n) ** 8)
    volume = centered(rng.choice([-0.2, 1.2], (3, 3, 3)))
    camera = wvr.Camera.fit(volume)
    image = exact(volume, tf, camera, (8, 8), device=device)
    assert max_error(image, oracle(volume, tf, camera, (8, 8))) < 1e-11
    assert image.samples.max() > 600


def test_infinitely_thin_spike(device):
    """A spike 1e-9 wide is a surface: its depth is its area over the field's slope."""
    volume = centered(np.linspace(0, 1, 9)[:, None, None] * np.ones((1, 3, 3)))
    tf = wvr.TransferFunction.isosurfaces([0.4], opacity=1.0, width=1e-9)
    depth = 24 * np.log(2) * 0.5e-9 * 8
    image = exact(volume, tf, along(2), (1, 1), device=device)
    assert image.rgba[0, 0, 3] == pytest.approx(depth, rel=1e-6)


# Absent data, termination, precision, counts


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_absent_cells_are_exactly_absent(device, dtype):
    rng = np.random.default_rng(12)
    data = rng.random((9, 8, 7)).astype(dtype)
    data.ravel()[rng.choice(data.size, 9, replace=False)] = [np.nan, np.inf, -np.inf] * 3
    volume = centered(data, nan="transparent")
    tf = random_tf(rng, 0, 1)
    camera = wvr.Camera.fit(volume)
    image = exact(volume, tf, camera, (24, 24), device=device)
    assert max_error(image, oracle(volume, tf, camera, (24, 24))) < 1e-11


@pytest.mark.parametrize(("offset", "dtype"), [(1e6, "float64"), (-3e9, "float64"), (1e6, "float32")])
def test_data_far_from_zero(device, offset, dtype):
    values = np.random.default_rng(8).integers(0, 33, (6, 6, 6)) / 16.0
    points = [(0, "navy", 0.0), (0.5, "green", 0.05), (2, "gold", 0.4)]
    near, far = centered(values), centered((values + offset).astype(dtype))
    camera = wvr.Camera.fit(near)
    image = exact(far, wvr.TransferFunction([(s + offset, c, o) for s, c, o in points]), camera, device=device)
    assert max_error(image, exact(near, wvr.TransferFunction(points), camera).rgba) < 1e-12


def test_always_float64(device, blobs, smooth_tf):
    camera = wvr.Camera.fit(blobs)
    images = [exact(blobs, smooth_tf, camera, precision=p, device=device) for p in ("auto", "float32", "float64")]
    for image in images:
        assert image.rgba.dtype == np.float64 and image.stats["precision"] == "float64" and image.error_bound is None
        assert np.array_equal(image.rgba, images[0].rgba)


def test_samples_count_pieces(device):
    """One a cell, one more for each control point crossed, none where nothing absorbs."""
    volume = centered(np.arange(5.0)[:, None, None] * np.ones((1, 3, 3)))
    count = {
        4: [(0, "red", 0.1), (4, "red", 0.2)],
        5: [(0, "red", 0.1), (2.5, "red", 0.2), (4, "red", 0.2)],
        1: [(0, "red", 0.0), (3.5, "red", 0.0), (4, "red", 0.2)],
        0: [(0, "red", 0.0), (4, "red", 0.0), (5, "red", 0.2)],
    }
    for expected, points in count.items():
        image = exact(volume, wvr.TransferFunction(points), along(2), (1, 1), device=device)
        assert image.samples[0, 0] == image.stats["samples"] == expected


# Invariances


def test_axes_permuted_and_mirrored(device):
    rng = np.random.default_rng(21)
    data, spacing, tf = rng.random((5, 6, 7)), np.array([1.0, 1.4, 0.7]), random_tf(rng, 0, 1)
    camera = wvr.Camera((14, 9, 6), (0, 0, 0), (0, 0, 1))
    plain = exact(centered(data, spacing), tf, camera, device=device)
    # World x, y, z become y, z, x; arrays are indexed z, y, x.
    turned = wvr.Camera(*(np.roll(v, 1) for v in (camera.position, camera.target, camera.up)))
    image = exact(centered(data.transpose(1, 2, 0), np.roll(spacing, 1)), tf, turned, device=device)
    assert max_error(image, plain.rgba) < 1e-12
    for axis in range(3):
        sign = np.where(np.arange(3) == axis, -1, 1)
        mirror = wvr.Camera(sign * camera.position, camera.target, camera.up * sign)
        image = exact(centered(np.flip(data, 2 - axis), spacing), tf, mirror, device=device)
        assert max_error(image, plain.rgba[:, ::-1]) < 1e-12


def test_halves_compose_to_the_whole(device):
    rng = np.random.default_rng(22)
    data, tf = rng.random((8, 7, 9)), random_tf(rng, 0, 1)
    camera = wvr.Camera((30, 12, 9), (4, 3, 3), view_angle=25)
    whole = exact(wvr.Volume(data), tf, camera, (24, 24), device=device).rgba
    back = exact(wvr.Volume(data[:, :, :5]), tf, camera, (24, 24), device=device).rgba
    front = exact(wvr.Volume(data[:, :, 4:], origin=(4, 0, 0)), tf, camera, (24, 24), device=device).rgba
    np.testing.assert_allclose(front + (1 - front[..., 3:]) * back, whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize("axis", [None, 0, 1, 2])
def test_leaping_over_empty_blocks(device, axis):
    """Sparse data over many blocks, the last of them cut short; absent samples among them."""
    rng = np.random.default_rng(23)
    data = np.where(rng.random((27, 18, 35)) > 0.997, rng.random((27, 18, 35)), 0)
    data[3, 4, 5] = np.nan
    volume = centered(data, np.array([1.0, 1.2, 0.8]), nan="transparent")
    tf = wvr.TransferFunction([(0, "red", 0.0), (0.2, "red", 0.0), (0.5, "lime", 0.5), (1, "blue", 0.2)])
    for sign in (1, -1):
        camera = wvr.Camera.fit(volume, sign * np.array([1, 0.7, 0.4])) if axis is None else along(axis, sign, 14)
        image = exact(volume, tf, camera, (36, 36), device=device)
        expected = oracle(volume, tf, camera, (36, 36))
        assert max_error(image, expected) < 1e-11 and np.count_nonzero(expected[..., 3]) > 10
