"""Lemmas of docs/proof.md about rounding and quadrature, against arithmetic of 300 bits."""

import numpy as np
import pytest
import warp as wp
from flint import arb, arb_mat, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from wvr.frame import view
from wvr.kernels.integrators.pieces import ACCURACY, NODES, deepest
from wvr.kernels.integrators.series import THIN, TRUNCATED, closer, make_series
from wvr.kernels.transfer.linear import gauss_nodes
from wvr.launch import get_device, launch


@pytest.fixture(autouse=True)
def precise():
    """All arithmetic of a test in 300 bits."""
    before, ctx.prec = ctx.prec, 300
    yield
    ctx.prec = before


def exactly(vector):
    return [arb(float(x)) for x in vector]


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def scaled(a, factor):
    return [x * factor for x in a]


def plus(a, b):
    return [x + y for x, y in zip(a, b, strict=True)]


def unit(a):
    return scaled(a, 1 / dot(a, a).sqrt())


# Lemma 3: where rays are


def true_ray(camera, size, x, y):
    """World point and direction of a pixel's ray, from the numbers that the camera was given."""
    width, height = size
    position, target = exactly(camera.position), exactly(camera.target)
    forward = unit(plus(target, scaled(position, -1)))
    right = unit(cross(forward, exactly(camera.up)))
    up = cross(right, forward)
    half = arb(float(camera.parallel_scale)) if camera.parallel else (arb.pi() * camera.view_angle / 360).tan()
    across = scaled(right, half * (2 * x + 1 - width) / height)
    across = plus(across, scaled(up, half * (height - 1 - 2 * y) / height))
    if camera.parallel:
        return plus(position, across), forward
    return position, plus(forward, across)


def index_of(volume, point, direction):
    """The same in index coordinates."""
    matrix = volume.index_to_world
    inverse = arb_mat([exactly(row) for row in matrix[:3, :3]]).inv()
    moved = arb_mat([[x] for x in plus(point, scaled(exactly(matrix[:3, 3]), -1))])
    places = (inverse * moved, inverse * arb_mat([[x] for x in direction]))
    return [[place[i, 0] for i in range(3)] for place in places]


def computed_ray(v, x, y):
    """Anchor and direction as ``kernels.ray.line`` has them."""
    anchor, right, down = (np.array(a) for a in (v.anchor, v.right, v.down))
    way = np.array(v.way) + float(x) * np.array(v.way_right) + float(y) * np.array(v.way_down)
    direction = (v.unit / np.sqrt(way @ way)) * (np.array(v.to_index).reshape(3, 3) @ way)
    return anchor + float(x) * right + float(y) * down, direction


def astray(volume, camera, v, x, y):
    """How far the ray of a pixel is from where it should be, in and about the box; 0 if it misses that."""
    low, high = volume.index_box
    anchor, along = computed_ray(v, x, y)
    point, way = index_of(volume, *true_ray(camera, (v.width, v.height), x, y))
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low - anchor) / along, (high - anchor) / along], axis=0)
    start, end = np.nanmax(ends[0]), np.nanmin(ends[1])
    farthest = 0.0
    for t in (start, 0.5 * (start + end), end) if start <= end else ():
        here = plus(exactly(anchor), scaled(exactly(along), arb(float(t))))
        apart = plus(here, scaled(point, -1))
        nearest = dot(apart, way) / dot(way, way)
        off = plus(apart, scaled(way, -nearest))
        farthest = max(farthest, *(float(abs(component).upper()) for component in off))
    return farthest


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_rays_are_no_farther_astray_than_said(seed):
    """Cameras near and far, views wide and narrow, sheared and anisotropic grids far from the origin."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 40, 3)
    direction = np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.choice([0, 0.3]) * rng.normal(size=(3, 3)) / 3
    volume = wvr.Volume(
        np.zeros(shape, np.uint8),
        spacing=10.0 ** rng.uniform(-2, 2, 3),
        origin=rng.normal(size=3) * 10.0 ** rng.integers(-1, 7),
        direction=direction,
    )
    middle, size = volume.corners.mean(axis=0), np.ptp(volume.corners, axis=0).max()
    far = 10.0 ** rng.uniform(-0.5, 9)
    target = middle + rng.normal(size=3) * size * rng.choice([0, 1, 1e3])
    position = target + size * far * rng.normal(size=3)
    up = rng.normal(size=3) if rng.random() < 0.8 else (target - position) + 1e-3 * size * far * rng.normal(size=3)
    parallel = size * 10.0 ** rng.uniform(-2, 3) if rng.random() < 0.5 else None
    camera = wvr.Camera(
        position, target, up, float(rng.choice([1e-3, 1, 60, 170, 179.99, 180 - 1e-6, 180 - 1e-9])), parallel
    )
    pixels = (int(rng.integers(1, 900)), int(rng.integers(1, 900)))
    v = view(volume, camera, *pixels)
    # The pixels in the middle, too, where what a wide view is made of cancels.
    for x, y in [*rng.integers(0, pixels, (4, 2)).tolist(), [n // 2 for n in pixels]]:
        assert astray(volume, camera, v, x, y) <= v.astray


@pytest.mark.parametrize("angle", [150, 179.99, 179.999999, 180 - 1e-9])
def test_the_middle_of_a_very_wide_view(angle):
    """What the direction is a sum of cancels there."""
    volume = wvr.Volume(np.zeros((8, 8, 8), np.uint8))
    inside, forward = np.array([3.3, 3.6, 3.1]), np.array([-0.62, 0.6, -0.49])
    camera = wvr.Camera(inside, inside + forward, (-1.6, -2.2, 1.4), angle)
    for pixels in ((5, 5), (15, 1), (4001, 1), (1, 33)):
        v = view(volume, camera, *pixels)
        assert astray(volume, camera, v, *(n // 2 for n in pixels)) <= v.astray


@pytest.mark.parametrize("precision", ["float32", "float64"])  # rays in lanes, and one by one
def test_a_ray_along_a_face_is_bounded_by_all_that_it_may_see(precision):
    """Pixel centres on the faces of the box: rounding decides, so the bound is all that there is."""
    volume = wvr.Volume(np.full((9, 9, 9), 9, np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.5), (9, "white", 0.5)])
    # Pixels a spacing apart, from -1 to 9.
    camera = wvr.Camera([4, 4, 40], [4, 4, 4], up=(0, 1, 0), parallel_scale=5.5)
    bound = wvr.render(volume, tf, camera, (11, 11), precision=precision).error_bound
    assert np.all(bound[1, 1:10] > 0.9) and np.all(bound[9, 1:10] > 0.9)
    assert np.all(bound[1:10, 1] > 0.9) and np.all(bound[1:10, 9] > 0.9)
    assert bound[2:9, 2:9].max() < 1 / 512
    assert not bound[0].any() and not bound[:, 10].any()


# Lemma 5: quadrature


@settings(max_examples=200, deadline=None)
@given(
    n=st.sampled_from(NODES),
    roots=st.lists(st.floats(-1, 2), min_size=2, max_size=2),
    lead=st.floats(-1, 1),
    color=st.lists(st.floats(-1, 1), min_size=3, max_size=3),
)
def test_quadrature_of_a_piece(n, roots, lead, color):
    """Of a cubic that is nowhere negative, at the deepest that a rule is used for, against a rule of 80 nodes."""
    depth, nodes = deepest(n), gauss_nodes([n])
    u = np.linspace(0, 1, 2001)
    tau = np.poly1d([lead, 1]) * np.poly1d(np.poly(roots))
    tau = tau - min(tau(u).min(), 0) * 1.0000001
    tau = tau * (depth / max(tau.integ()(1.0), 1e-30))
    D = tau.integ()
    c = np.poly1d([*color, 0])
    far = np.abs(c(u)).max()

    def integral(x, w):
        return np.sum(w * c(x) * tau(x) * np.exp(-D(x)))

    x, w = np.polynomial.legendre.leggauss(80)
    off = abs(integral(*nodes.T) - integral((x + 1) / 2, w / 2))
    assert off <= ACCURACY * far * -np.expm1(-depth) + 20 * 2.0**-53 * far * depth + 1e-300  # underflow


# Lemma 6: exponentials


@wp.kernel(enable_backward=False, module="unique")
def exponentials(base: int, x: wp.array(dtype=wp.float64), result: wp.array(dtype=wp.float64)):
    i = wp.tid() + base
    result[i] = wp.exp(x[i])


def test_exponentials_are_good_to_two_units(device):
    """Those that a kernel calls, whoever's library they are of."""
    rng = np.random.default_rng(1)
    x = -np.concatenate([rng.uniform(0, 1, 4000), 10.0 ** rng.uniform(-12, 2.8, 4000)])
    result = wp.zeros(len(x), dtype=wp.float64, device=device)
    launch(exponentials, len(x), [wp.array(x, dtype=wp.float64, device=device), result], get_device(device))
    for argument, value in zip(x, result.numpy(), strict=True):
        assert float(abs(arb(float(argument)).exp() - arb(float(value)))) <= 2 * np.spacing(float(value))


def test_opacity_as_a_polynomial_is_good_to_its_next_term():
    """Where it is least good, at THIN: of degree 9."""
    exact = 1 - (-arb(THIN)).exp()
    terms, power, factorial = arb(0), arb(1), arb(1)
    for n in range(1, 10):
        power, factorial = power * THIN, factorial * n
        terms += (-1) ** (n + 1) * power / factorial
    assert 0.9 * TRUNCATED < float(abs(terms - exact) / exact) < TRUNCATED


# Theorems 2 and 3: the series

_, opacity, tilt = make_series(None)


@wp.kernel(enable_backward=False, module="unique")
def pieces(base: int, m: wp.array(dtype=wp.vec3d), ag: wp.array(dtype=wp.vec2d), result: wp.array(dtype=wp.vec3d)):
    i = wp.tid() + base
    R = wp.abs(m[i][0]) + wp.float64(wp.static(2.0 / 3.0)) * wp.abs(m[i][1]) + wp.abs(m[i][2])
    A = opacity(wp.float64(2.0) * ag[i][0])
    V, error = tilt(m[i][0], m[i][1], m[i][2], R, ag[i][0], ag[i][1], A)
    result[i] = wp.vec3d(V, error, closer(m[i][1], R, ag[i][0], ag[i][1]))


def test_the_kernels_series_and_its_bounds(device):
    """As the kernel has them, for a hundred thousand cubics; the bounds are as small as they may be."""
    rng = np.random.default_rng(2)
    n = 100_000
    m = rng.uniform(-1, 1, (n, 3)) * 10.0 ** rng.uniform(-3, 0, (n, 3))
    # Many near the worst: the scalar runs to the ends of what there may be, extinction to 0.
    m[: n // 2, 1:] *= rng.choice([0, 1e-3], (n // 2, 2))
    a = 0.5 * 10 ** rng.uniform(-3, 0, n)
    v, weight = np.polynomial.legendre.leggauss(40)

    def w(v):
        return m[:, :1] * v + m[:, 1:2] * (v * v - 1 / 3) + m[:, 2:] * v**3

    least = w(np.linspace(-1, 1, 201)).min(axis=1)
    g = a / np.maximum(-least, 1e-9) * rng.choice([0.0, 0.01, 1.0], n)
    W = m[:, :1] * (v * v - 1) / 2 + m[:, 1:2] * (v**3 - v) / 3 + m[:, 2:] * (v**4 - 1) / 4
    tau = a[:, None] + g[:, None] * w(v)
    exact = np.sum(weight * w(v) * tau * np.exp(-a[:, None] * (v + 1) - g[:, None] * W), axis=1)
    result = wp.zeros(n, dtype=wp.vec3d, device=device)
    ag = np.stack([a, g], axis=1)
    launch(
        pieces,
        n,
        [*(wp.array(x, dtype=t, device=device) for x, t in ((m, wp.vec3d), (ag, wp.vec2d))), result],
        get_device(device),
    )
    V, error, second = result.numpy().T
    R = np.abs(m) @ [1, 2 / 3, 1]
    off, slack = np.abs(V - exact), 1e-9 * R * a
    assert np.all(off <= error + slack) and np.all(off <= second + slack)
    big = off > 1e3 * slack
    assert (off / error)[big].max() > 0.6
    assert (off / second)[big].max() > 0.6
