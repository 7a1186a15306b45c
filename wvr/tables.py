"""Transfer functions on their way to the device: as exact arrays, and as pre-integration tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .kernels.precision import REALS, vec4_of
from .kernels.segment import gauss_nodes
from .kernels.table import make_generators, make_pieces, make_table
from .kernels.transfer import make_transfer
from .launch import get_device, launch
from .transfer_function import TransferFunction
from .validation import choice, positive

GENERATORS = ("incremental", "brute")


def transfer_arrays(tf: TransferFunction, unit: float, shift: float, precision: str, device: wp.Device) -> Any:
    """``tf`` as the struct of ``kernels.transfer``: extinction per ``unit`` of length, scalars minus ``shift``."""
    real = REALS[precision]
    Transfer, _, _ = make_transfer(real)
    numpy_real = np.dtype(precision)
    knots = (tf.knots - shift).astype(numpy_real)
    values = _values(tf, unit)
    n = len(knots)
    widths = np.diff(tf.knots)
    # A jump is an interval without width: nothing is ever in it.
    slopes = np.diff(values, axis=0) / np.where(widths > 0, widths, 1.0)[:, None]
    first, last = tf.knots[0], tf.knots[-1]
    bins = int(np.clip(8 * n, 64, 8192)) if last > first else 1
    scale = bins / (last - first) if last > first else 1.0
    # Which intervals a bin may need, with a margin for the rounding of its index.
    edges = np.linspace(first, last, bins + 1) - shift
    margin = 4 * np.spacing(np.abs(edges).max().astype(numpy_real)) + 0.01 / scale
    begin = np.searchsorted(knots, edges[:-1] - margin, "right")
    end = np.searchsorted(knots, edges[1:] + margin, "right") + 1
    begin[0], end[-1] = 0, n + 1

    transfer = Transfer()
    transfer.knot = wp.array(np.concatenate([knots[:1], knots]), dtype=real, device=device)
    transfer.value = _vec4(np.concatenate([values[:1], values]), real, device)
    transfer.slope = _vec4(np.concatenate([np.zeros((1, 4)), slopes, np.zeros((1, 4))]), real, device)
    transfer.bins = wp.array(np.stack([begin, end], axis=1).astype(np.int32), dtype=wp.vec2i, device=device)
    transfer.low = first - shift
    transfer.scale = scale
    return transfer


def table_array(
    tf: TransferFunction,
    n: int,
    length: float,
    unit: float,
    domain: tuple[float, float],
    generator: str,
    precision: str,
    device: wp.Device,
) -> wp.array:
    """The (n, n) table of segments of ``length`` units on the device, extinction per ``unit`` of world length."""
    real = REALS[precision]
    diagonal, incremental, brute = make_generators(real)
    pieces = _pieces(tf, n, unit, domain, real, device)
    table = wp.empty((n, n), dtype=vec4_of(real), device=device)
    launch(diagonal, n, [pieces, length, table], device, grain=n)
    if generator == "brute":
        launch(brute, n * n, [pieces, length, table], device, grain=n)
    else:
        items = _bins(n)
        launch(incremental, len(items), [pieces, wp.array(items, dtype=wp.vec2i, device=device), length, table], device)
    return table


def table_struct(rgba: wp.array, domain: tuple[float, float], shift: float, precision: str) -> Any:
    """The struct of ``kernels.table`` for look-ups of scalars minus ``shift``."""
    Table, _ = make_table(REALS[precision])
    table = Table()
    table.rgba = rgba
    table.low = domain[0] - shift
    table.scale = (rgba.shape[0] - 1) / (domain[1] - domain[0])
    return table


def nodes_array(precision: str, device: wp.Device) -> wp.array:
    """The quadrature nodes that ``kernels.segment`` reads."""
    dtype = wp.vec2d if precision == "float64" else wp.vec2
    return wp.array(gauss_nodes(precision).astype(precision), dtype=dtype, device=device)


class Table:
    """A 2D pre-integration table.

    Attributes
    ----------
    rgba
        (n, n, 4): [i, j] is the segment whose scalar runs linearly from table value i to j: premultiplied colour and
        opacity. NumPy, in the table's precision.
    domain
        Scalars of the first and last entry; the entries between are equally spaced.
    length
        Length of the segments [world length].
    """

    def __init__(self, rgba: NDArray[np.floating], domain: tuple[float, float], length: float):
        self.rgba = rgba
        self.domain = domain
        self.length = length

    def lookup(self, front: ArrayLike, back: ArrayLike, length: float | None = None) -> NDArray[np.float64]:
        """Colour and opacity of segments that run from scalar ``front`` to ``back``, bilinear between entries.

        Parameters
        ----------
        front, back
            Scalars, broadcast together; those outside the domain are clamped to it.
        length
            That of the table, or None: a 2D table is for one length.

        Returns
        -------
        float64, shape (..., 4)
        """
        if length is not None and length != self.length:
            raise ValueError(f"length must be that of the table, {self.length}, got {length!r}")
        n = len(self.rgba)
        (lo, hi), last = self.domain, n - 1
        u, v = (np.clip((np.asarray(s, np.float64) - lo) / (hi - lo) * last, 0, last) for s in (front, back))
        i, j = (np.minimum(w.astype(int), n - 2) for w in (u, v))
        x, y = (u - i)[..., None], (v - j)[..., None]
        rgba = self.rgba.astype(np.float64)
        e0 = rgba[i, j] * (1 - y) + rgba[i, j + 1] * y
        e1 = rgba[i + 1, j] * (1 - y) + rgba[i + 1, j + 1] * y
        return e0 * (1 - x) + e1 * x


def preintegrate(
    tf: TransferFunction,
    n: int = 256,
    length: float = 1.0,
    domain: tuple[float, float] | None = None,
    generator: str = "incremental",
    device: Any = None,
    precision: str = "float32",
) -> Table:
    """Pre-integrate a transfer function: a table of segments over the scalars at their two ends.

    Parameters
    ----------
    tf
        The transfer function. A ``unit_distance`` of None counts as 1.
    n
        Entries along an axis, >= 2.
    length
        Length of a segment [world length], > 0.
    domain
        Scalars ``(lo, hi)`` of the first and last entry; by default the first and last control point.
    generator
        ``"incremental"``: subrange integration of Lum, Wilson and Ma (2004), exact in O(n^2); ``"brute"``: the same
        table in O(n^3).
    device
        Warp device that computes it; CUDA where there is one, by default.
    precision
        ``"float32"`` (max abs error 2e-6) or ``"float64"`` (1e-12).

    Raises
    ------
    ValueError
        For n < 2, ``length`` <= 0 or NaN, lo >= hi, or a transfer function of a single scalar without ``domain``.
    """
    if not isinstance(tf, TransferFunction):
        raise TypeError(f"tf must be a TransferFunction, got {type(tf).__name__}")
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 2:
        raise ValueError(f"n must be an integer >= 2, got {n!r}")
    positive(length, "length")
    choice(generator, "generator", GENERATORS)
    choice(precision, "precision", tuple(REALS))
    lo, hi = _domain(tf, domain)
    rgba = table_array(tf, int(n), length, 1.0, (lo, hi), generator, precision, get_device(device))
    return Table(rgba.numpy(), (lo, hi), float(length))


def _domain(tf: TransferFunction, domain: Sequence[float] | None) -> tuple[float, float]:
    lo, hi = map(float, (tf.knots[0], tf.knots[-1]) if domain is None else domain)
    if not (np.isfinite(lo) and np.isfinite(hi) and lo < hi):
        given = f"domain must be (lo, hi) with lo < hi, got {domain!r}"
        raise ValueError(given if domain is not None else f"{given}, and the control points are all at {lo:g}")
    return lo, hi


def _values(tf: TransferFunction, unit: float) -> NDArray[np.float64]:
    """(r, g, b, extinction per ``unit``) at the knots; ``unit`` is the smallest voxel spacing [world length]."""
    return np.concatenate([tf.colors, tf.knot_extinctions(unit)[:, None] * unit], axis=1)


def _pieces(
    tf: TransferFunction, n: int, unit: float, domain: tuple[float, float], real: Any, device: wp.Device
) -> Any:
    """The transfer function over the table's n - 1 intervals, cut at its knots; see ``kernels.table``."""
    Pieces, _ = make_pieces(real)
    precision = "float64" if real is wp.float64 else "float32"
    grid = np.linspace(*domain, n)
    inside = tf.knots[(tf.knots > domain[0]) & (tf.knots < domain[1])]
    cuts = np.union1d(grid, inside)
    first = np.searchsorted(cuts, grid).astype(np.int32)
    width = np.diff(cuts) * ((n - 1) / (domain[1] - domain[0]))

    pieces = Pieces()
    pieces.first = wp.array(first, dtype=int, device=device)
    pieces.width = wp.array(width.astype(precision), dtype=real, device=device)
    pieces.low = _vec4(_limits(tf, cuts[:-1], "right", unit), real, device)
    pieces.high = _vec4(_limits(tf, cuts[1:], "left", unit), real, device)
    pieces.value = _vec4(_limits(tf, grid, "right", unit), real, device)
    pieces.nodes = nodes_array(precision, device)
    return pieces


def _limits(tf: TransferFunction, s: NDArray[np.float64], side: str, unit: float) -> NDArray[np.float64]:
    """(r, g, b, extinction per ``unit``) at scalars ``s``, at a jump the limit from the ``side``."""
    values = _values(tf, unit)
    # The interval [k, k + 1] of knots that s is in, as seen from the side.
    k = np.clip(np.searchsorted(tf.knots, s, "right" if side == "right" else "left") - 1, 0, len(tf.knots) - 2)
    width = tf.knots[k + 1] - tf.knots[k]
    share = np.divide(s - tf.knots[k], width, out=np.full(len(s), float(side == "right")), where=width > 0)
    share = np.clip(share, 0.0, 1.0)[:, None]
    return (1 - share) * values[k] + share * values[k + 1]


def _bins(n: int) -> NDArray[np.int32]:
    """Work items (r, start) of incremental subrange integration, the long ones first."""
    items = [np.stack(np.broadcast_arrays(r, np.arange(0, n - r, r)), axis=1) for r in range(n - 1, 0, -1)]
    return np.concatenate(items).astype(np.int32)


def _vec4(values: NDArray[np.float64], real: Any, device: wp.Device) -> wp.array:
    dtype = np.float64 if real is wp.float64 else np.float32
    return wp.array(np.ascontiguousarray(values, dtype), dtype=vec4_of(real), device=device)
