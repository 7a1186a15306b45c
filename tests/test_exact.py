"""The exact integrator against adaptive quadrature of its own making, closed forms, and invariances."""

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp

import wvr
from studies import reference
from studies.reference import quadrature

from .conftest import max_error
from .test_raycast import along, centered

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
    scale = np.abs(p).max(axis=1, keepdims=True) + 1e-300
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
    s = fit(scalars(volume, o, d, ray, start, length))
    ray, start, length, s = (a[np.isfinite(s).all(axis=1)] for a in (ray, start, length, s))
    first = s * [1, 0, 0, 0]
    splits = [np.zeros((len(s), 1))] + [companion_roots(s - first + first - [k, 0, 0, 0]) for k in tf.knots]
    splits = np.sort(np.concatenate([*splits, np.ones((len(s), 1))], axis=1), axis=1)
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
    assert image.rgba.dtype == np.float64 and expected[..., 3].max() > 0.3
    assert max_error(image, expected) < 1e-9
