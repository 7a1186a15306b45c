"""A transfer function cut at its own knots, and its running integrals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from ..kernels.precision import name_of, vec4_of
from ..kernels.transfer.preintegration import make_pieces
from ..transfer_function import TransferFunction
from ..validation import float_array
from .nodes import nodes_array


class RunningIntegrals:
    """A transfer function's running integrals: the one-dimensional form of a pre-integration table.

    The mean extinction and emission of a segment are differences of running integrals, exact for any ends and length;
    so is the opacity. Colour is mean emission over mean extinction, times opacity: exact where the colour is constant
    over the segment, and else off by at most the colour's range times ``1 - A/x + (A/x) log(A/x) <= x^2 / 8``, x being
    the optical depth and A the opacity, because what attenuates is spread evenly.

    Attributes
    ----------
    scalars
        (k,) table values and control points, ascending.
    extinction, emission
        (k,) and (k, 3): integrals from the first scalar to each of them; float64.
    """

    def __init__(self, cut: Cut):
        rgb, tau = cut.colors(None), cut.extinctions
        # At the last scalar, which a transfer function may jump at: what is behind it.
        self._last = cut.grid_extinctions[-1], cut.grid_extinctions[-1] * rgb[3][-1]
        self.scalars = cut.scalars
        self._tau = tau
        self._emission = [tau[side][:, None] * rgb[side] for side in (0, 1)]
        middle = 0.25 * (tau[0] + tau[1])[:, None] * (rgb[0] + rgb[1])
        width = np.diff(cut.scalars)
        # Simpson's rule is exact: extinction is linear between the scalars, emission quadratic.
        simpson = (self._emission[0] + 4 * middle + self._emission[1]) / 6
        self.extinction = np.concatenate([[0.0], np.cumsum(width * (tau[0] + tau[1]) / 2)])
        self.emission = np.concatenate([np.zeros((1, 3)), np.cumsum(width[:, None] * simpson, axis=0)])
        self._middle = middle

    def lookup(self, front: ArrayLike, back: ArrayLike, length: ArrayLike = 1.0) -> NDArray[np.float64]:
        """Colour and opacity of segments that run from scalar ``front`` to ``back`` over a length [world length].

        Parameters
        ----------
        front, back, length
            Broadcast together; scalars outside the domain are clamped to it, lengths are finite and >= 0.

        Returns
        -------
        float64, shape (..., 4)
        """
        first, last = self.scalars[[0, -1]]
        u, v, given = float_array(front, "front"), float_array(back, "back"), float_array(length, "length")
        if np.isnan(u).any() or np.isnan(v).any():
            raise ValueError("front and back must be scalars, got NaN")
        if not np.all((given >= 0) & (given < np.inf)):
            raise ValueError(f"length must be finite and >= 0, got {length!r}")
        a, b, length = np.broadcast_arrays(np.clip(u, first, last), np.clip(v, first, last), given)
        a, b = np.minimum(a, b), np.maximum(a, b)
        ka, kb = (np.clip(np.searchsorted(self.scalars, s, "right") - 1, 0, len(self.scalars) - 2) for s in (a, b))
        # Both ends between the same two scalars: the local polynomial. Else two partial pieces and a difference.
        within = ka == kb
        tau, emission = self._piece(ka, a, b)
        low_tau, low_emission = self._piece(ka, a, self.scalars[ka + 1])
        high_tau, high_emission = self._piece(kb, self.scalars[kb], b)
        d = np.where(within, 1.0, b - a)
        d1, d2 = self.scalars[ka + 1] - a, b - self.scalars[kb]
        across = (d1 * low_tau + (self.extinction[kb] - self.extinction[ka + 1]) + d2 * high_tau) / d
        tau = np.where(within, tau, across)
        sums = (
            (self.emission[kb] - self.emission[ka + 1]) + d1[..., None] * low_emission + d2[..., None] * high_emission
        )
        emission = np.where(within[..., None], emission, sums / d[..., None])
        ended = a == last
        tau, emission = np.where(ended, self._last[0], tau), np.where(ended[..., None], self._last[1], emission)
        A = -np.expm1(-tau * length)
        color = np.divide(emission, tau[..., None], out=np.zeros_like(emission), where=tau[..., None] > 0)
        return np.concatenate([color * A[..., None], A[..., None]], axis=-1)

    def _piece(
        self, k: NDArray, a: NDArray[np.float64], b: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean extinction and emission from scalar a to b inside piece k."""
        u, v = ((s - self.scalars[k]) / (self.scalars[k + 1] - self.scalars[k]) for s in (a, b))
        tau = self._tau[0][k] + (u + v) / 2 * (self._tau[1][k] - self._tau[0][k])
        start, middle, end = self._emission[0][k], self._middle[k], self._emission[1][k]
        slope, curve = -3 * start + 4 * middle - end, 2 * (start - 2 * middle + end)
        return tau, start + ((u + v) / 2)[..., None] * slope + ((u * u + u * v + v * v) / 3)[..., None] * curve


def jumps_of(tf: TransferFunction, domain: tuple[float, float]) -> NDArray[np.float64]:
    """The scalars of a domain at which a transfer function jumps, ascending."""
    jumps = np.unique(tf.knots[1:][np.diff(tf.knots) == 0])
    return jumps[(jumps >= domain[0]) & (jumps <= domain[1])]


class Cut:
    """A transfer function over the n - 1 intervals of a table, cut into pieces at its own knots."""

    def __init__(self, tf: TransferFunction, n: int, domain: tuple[float, float], unit: float):
        self.tf, self.n = tf, n
        # As entries are rounded, they are off by an eighth of what they are apart, at most.
        size = float(np.abs(domain).max())
        if domain[1] - domain[0] < 4 * (n - 1) * np.spacing(size):
            raise ValueError(
                f"scalars must differ by more for a table of {n} entries along an axis, got a range of "
                f"{(domain[1] - domain[0]) / size:.2g} of their size: subtract a constant from samples and control "
                f"points first, or take an integrator without tables"
            )
        self.grid = np.linspace(*domain, n)
        # A jump that is meant to be an entry is one, to the last digit; of points that are only near to each other the
        # lowest would have what is behind the highest.
        jumps = jumps_of(tf, domain)
        nearest = np.rint((jumps - domain[0]) * ((n - 1) / (domain[1] - domain[0]))).astype(np.int64)
        same = np.abs(self.grid[nearest] - jumps) <= 2.0**-49 * np.abs(domain).max()
        self.grid[nearest[same]] = jumps[same]
        inside = tf.knots[(tf.knots > domain[0]) & (tf.knots < domain[1])]
        self.scalars = np.union1d(self.grid, inside)
        self.first = np.searchsorted(self.scalars, self.grid)
        # Of their own interval's, as it was rounded: what is the same all along it is so to the last digit.
        self.width = np.diff(self.scalars) / np.repeat(np.diff(self.grid), np.diff(self.first))
        # Extinction per ``unit``, the smallest voxel spacing [world length], at the pieces' low and high ends.
        tau = tf.knot_extinctions(unit) * unit
        self.extinctions = self._ends(tau)
        self.grid_extinctions = _limits(tf.knots, tau, self.grid, "right")

    def colors(
        self, factor: NDArray[np.float64] | Callable[[Any], Any] | None, white: bool = False
    ) -> tuple[NDArray[np.float64], ...]:
        """Colours at the pieces' low and high ends, their second-order coefficient, and colours at the table values.

        Times a ``factor`` given at the knots, linear between them as the colours are, or of scalars, linear over the
        domain: a product is quadratic.
        """
        rgb = np.ones_like(self.tf.colors) if white else self.tf.colors
        low, high = self._ends(rgb)
        at = _limits(self.tf.knots, rgb, self.grid, "right")
        if factor is None:
            return low, high, np.empty((0, 3)), at
        if callable(factor):
            parts = factor(self.scalars[:-1]), factor(self.scalars[1:]), factor(self.grid)
        else:
            parts = *self._ends(factor), _limits(self.tf.knots, factor, self.grid, "right")
        k_low, k_high, k_at = (part[:, None] for part in parts)
        curve = np.empty((0, 3)) if white else (high - low) * (k_high - k_low)
        return low * k_low, high * k_high, curve, at * k_at

    def pieces(self, colors: tuple[NDArray[np.float64], ...], real: Any, device: wp.Device) -> Any:
        """The struct of ``kernels.transfer.preintegration``, of what :meth:`colors` gives."""
        low, high, curve, at = colors
        Pieces, _ = make_pieces(real)
        precision = name_of(real)
        pieces = Pieces()
        pieces.first = wp.array(self.first.astype(np.int32), dtype=int, device=device)
        pieces.width = wp.array(self.width.astype(precision), dtype=real, device=device)
        pieces.low = vec4_array(np.column_stack([low, self.extinctions[0]]), real, device)
        pieces.high = vec4_array(np.column_stack([high, self.extinctions[1]]), real, device)
        pieces.curve = vec4_array(np.column_stack([curve, np.zeros(len(curve))]), real, device)
        pieces.value = vec4_array(np.column_stack([at, self.grid_extinctions]), real, device)
        pieces.nodes = nodes_array(precision, device)
        return pieces

    def running(self) -> NDArray[np.float64]:
        """(n, 4): integrals of emission and extinction up to each table value, in intervals."""
        line = RunningIntegrals(self)
        step = (self.n - 1) / (self.grid[-1] - self.grid[0])
        return step * np.column_stack([line.emission, line.extinction])[self.first]

    def _ends(self, at_knots: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What is given at the knots, at the low and high end of each piece, seen from inside it."""
        return (
            _limits(self.tf.knots, at_knots, self.scalars[:-1], "right"),
            _limits(self.tf.knots, at_knots, self.scalars[1:], "left"),
        )


def _limits(
    knots: NDArray[np.float64], values: NDArray[np.float64], s: NDArray[np.float64], side: Literal["left", "right"]
) -> NDArray[np.float64]:
    """``values`` at ``knots`` interpolated at ``s``, at a jump the limit from the ``side``, constant outside them."""
    # The interval [k, k + 1] of knots that s is in, as seen from the side.
    k = np.clip(np.searchsorted(knots, s, side) - 1, 0, len(knots) - 2)
    width = knots[k + 1] - knots[k]
    # Of no width is a jump that is first or last of all, and s in front of it, at it, or behind it.
    behind = s >= knots[k] if side == "right" else s > knots[k]
    share = np.divide(s - knots[k], width, out=behind.astype(np.float64), where=width > 0)
    share = np.clip(share, 0.0, 1.0).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[k] + share * values[k + 1]


def vec4_array(values: NDArray[np.float64], real: Any, device: wp.Device) -> wp.array:
    """Values (..., 4) on a device, in a precision."""
    return wp.array(np.ascontiguousarray(values, name_of(real)), dtype=vec4_of(real), device=device)
