"""A float64 reference in NumPy, independent of the kernels: short enough to be read against the model.

The volume-rendering integral of a ray is cut at every cell face that the ray crosses, so that inside a piece the
scalar is a smooth (cubic) function, and each piece into equal parts. In a part, extinction and emission are taken at
three Gauss nodes; the optical depth up to each node comes from the parabola through the three extinctions.
Transfer functions have kinks inside the parts: the error falls with the square of ``parts`` there, and jumps of the
transfer function make it first order.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wvr import Camera, TransferFunction, Volume

Floats = NDArray[np.float64]

NODES = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
# Integral from 0 to node i of the Lagrange polynomial of node j.
_MONOMIALS = np.linalg.inv(np.vander(NODES, increasing=True))
PARTIAL = (NODES[:, None] ** np.arange(1, 4) / np.arange(1, 4)) @ _MONOMIALS


def trilinear(data: NDArray, points: Floats) -> Floats:
    """Trilinear interpolation of ``data[z, y, x]`` at index coordinates ``points`` (..., 3), x first."""
    lower, weight = [], []
    for axis, n in enumerate(data.shape[::-1]):
        p = points[..., axis]
        i = np.clip(np.floor(p).astype(int), 0, max(n - 2, 0))
        lower.append((i, np.minimum(i + 1, n - 1)))
        weight.append((1 - (p - i), p - i))
    total = np.zeros(points.shape[:-1])
    for a in (0, 1):
        for b in (0, 1):
            for c in (0, 1):
                w = weight[0][a] * weight[1][b] * weight[2][c]
                total += w * data[lower[2][c], lower[1][b], lower[0][a]].astype(np.float64)
    return total


def integrate(
    volume: Volume, tf: TransferFunction, origins: Floats, directions: Floats, parts: int = 4, from_origin: bool = True
) -> Floats:
    """Premultiplied colour and opacity of rays: float64, shape (n, 4).

    Parameters
    ----------
    volume, tf
        The scene.
    origins, directions
        (n, 3) world coordinates; directions of unit length.
    parts
        Equal parts that the piece of a ray inside a cell is cut into.
    from_origin
        Rays start at their origin; else (parallel cameras) behind everything.
    """
    result = np.empty((len(origins), 4))
    chunk = max(1, 400_000 // (sum(volume.shape) * parts))
    for start in range(0, len(origins), chunk):
        rows = slice(start, start + chunk)
        result[rows] = _integrate(volume, tf, origins[rows], directions[rows], parts, from_origin)
    return result


def render(volume: Volume, tf: TransferFunction, camera: Camera, size: tuple[int, int], parts: int = 4) -> Floats:
    """The whole image of a camera, shape (height, width, 4)."""
    origins, directions = camera.rays(size)
    rgba = integrate(volume, tf, origins.reshape(-1, 3), directions.reshape(-1, 3), parts, not camera.parallel)
    return rgba.reshape(*origins.shape[:2], 4)


def _integrate(
    volume: Volume, tf: TransferFunction, origins: Floats, directions: Floats, parts: int, from_origin: bool
) -> Floats:
    to_index = np.linalg.inv(volume.index_to_world)
    o = origins @ to_index[:3, :3].T + to_index[:3, 3]
    d = directions @ to_index[:3, :3].T
    t = _crossings(volume, o, d, from_origin)
    edges = np.linspace(0, 1, parts + 1)
    a = t[:, :-1, None] + (t[:, 1:, None] - t[:, :-1, None]) * edges[:-1]
    h = np.diff(t, axis=1)[..., None] / parts
    a, h = a.reshape(len(o), -1), np.repeat(h, parts, axis=-1).reshape(len(o), -1)
    x = a[..., None] + h[..., None] * NODES
    s = trilinear(volume.numpy(), o[:, None, None] + x[..., None] * d[:, None, None])
    tau = np.where(np.isfinite(s), tf.extinction(s, volume.smallest_spacing), 0.0)
    # Depth up to the part, then up to the node.
    inside = h * (tau @ WEIGHTS)
    before = np.cumsum(inside, axis=1) - inside
    reached = before[..., None] + h[..., None] * (tau @ PARTIAL.T)
    weight = h[..., None] * WEIGHTS * tau * np.exp(-reached)
    color = np.einsum("rpn,rpnc->rc", weight, tf.color(np.nan_to_num(s)))
    depth = inside.sum(axis=1)
    return np.concatenate([color, -np.expm1(-depth)[:, None]], axis=1)


def _crossings(volume: Volume, o: Floats, d: Floats, from_origin: bool) -> Floats:
    """Sorted parameters (n, k) at which rays cross cell faces, clipped to the box: pieces outside have no length."""
    low, high = volume.index_box
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (low - o) / d, (high - o) / d
    inside = (o >= low) & (o <= high)
    parallel = d == 0
    near = np.where(parallel, np.where(inside, -np.inf, np.inf), near)
    far = np.where(parallel, np.inf, far)
    start = np.minimum(near, far).max(axis=1)
    end = np.maximum(near, far).min(axis=1)
    if from_origin:
        start = np.maximum(start, 0.0)
    missed = end <= start
    start, end = np.where(missed, 0.0, start), np.where(missed, 0.0, end)
    faces = [start[:, None], end[:, None]]
    for axis, n in enumerate(volume.dimensions):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (np.arange(1, n - 1) - o[:, axis, None]) / d[:, axis, None]
        faces.append(np.where(np.isfinite(t), t, start[:, None]))
    return np.sort(np.clip(np.concatenate(faces, axis=1), start[:, None], end[:, None]), axis=1)


def quadrature(
    tf: TransferFunction,
    front: float,
    back: float,
    length: float,
    factor: Floats | None = None,
    ramp: Callable[[float], float] = lambda t: 1.0,
) -> Floats:
    """The segment's integral by adaptive quadrature of float64 pieces between knots; optical depth in closed form.

    ``factor`` at the knots multiplies colours, ``ramp`` weights by the share of the length behind; opacity is weighted
    too, but not multiplied.
    """
    from scipy.integrate import quad_vec  # which the demonstration does without

    lo, hi = min(front, back), max(front, back)
    cuts = np.unique(np.concatenate([[lo, hi], tf.knots[(tf.knots > lo) & (tf.knots < hi)]]))
    factor = np.ones(len(tf.knots)) if factor is None else factor
    materials = TransferFunction.from_arrays(tf.knots, np.stack([factor] * 3, axis=1), tf.opacities)
    pieces = list(pairwise(cuts)) or [(lo, hi)]
    if front > back:
        pieces = [(b, a) for a, b in reversed(pieces)]
    result, depth, before = np.zeros(4), 0.0, 0.0
    for a, b in pieces:
        share = (b - a) / (back - front) if back != front else 1.0
        # The limits from inside the piece: at a jump the ends belong to their own side.
        inner = a + (b - a) * np.array([0.25, 0.75])
        (ta, tb), (ca, cb) = tf.extinction(inner), tf.color(inner)
        ka, kb = materials.color(inner)[:, 0]
        t0, t1 = max(ta - (tb - ta) / 2, 0.0), max(tb + (tb - ta) / 2, 0.0)
        c0, c1 = ca - (cb - ca) / 2, cb + (cb - ca) / 2
        k0, k1 = ka - (kb - ka) / 2, kb + (kb - ka) / 2
        h = length * share
        x = h * (t0 + t1) / 2

        ends = np.append(c0, 1.0), np.append(c1, 1.0)

        def emitted(u, t0=t0, t1=t1, ends=ends, k0=k0, k1=k1, h=h, at=before, s=share):
            tau = t0 + (t1 - t0) * u
            color = ends[0] + (ends[1] - ends[0]) * u
            color[:3] *= k0 + (k1 - k0) * u
            return color * tau * h * np.exp(-h * u * (t0 + (t1 - t0) * u / 2)) * ramp(at + s * u)

        # Where a deep piece is opaque after a fraction of it, quadrature needs to be told where to look.
        points = 10.0 ** np.arange(-8, 0) if x > 1 else None
        value, _ = quad_vec(emitted, 0, 1, epsabs=1e-15, epsrel=1e-12, limit=4000, points=points)
        result += np.exp(-depth) * value
        depth += x
        before += share
    return result
