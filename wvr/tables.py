"""Transfer functions on their way to the device: as exact arrays, and as pre-integration tables."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, Literal, overload

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .kernels.importance import vec8d
from .kernels.precision import REALS, vec3_of, vec4_of
from .kernels.segment import gauss_nodes
from .kernels.table import make_approximate, make_generators, make_pieces, make_stretchable, make_table
from .kernels.transfer import make_transfer
from .launch import get_device, launch
from .transfer_function import TransferFunction
from .validation import choice, positive

GENERATORS = ("incremental", "brute", "approximate", "running")
WEIGHTS = (None, "lighting", "lum")
# Least distance of control points that are no jump, for scalars of order one: slopes stay finite.
CLOSEST = {"float32": 2.0**-60, "float64": 2.0**-500}


def transfer_values(tf: TransferFunction, unit: float) -> NDArray[np.float64]:
    """(r, g, b, extinction per ``unit``) at the knots; ``unit`` is the smallest voxel spacing [world length]."""
    return np.concatenate([tf.colors, tf.knot_extinctions(unit)[:, None] * unit], axis=1)


def transfer_factors(tf: TransferFunction) -> NDArray[np.float64]:
    """(ambient, diffuse, specular) coefficients at the knots, 1 where there are none."""
    given = (tf.ambient, tf.diffuse, tf.specular)
    return np.column_stack([np.ones(len(tf.knots)) if factor is None else factor for factor in given])


def transfer_arrays(
    scalars: NDArray[np.float64],
    values: NDArray[np.float64],
    shift: float,
    precision: str,
    device: wp.Device,
    factors: NDArray[np.float64] | None = None,
) -> Any:
    """The struct of ``kernels.transfer``, of control points (n,) and what they have (n, 4); scalars minus ``shift``.

    Where light is, with their ``transfer_factors``.
    """
    real = REALS[precision]
    Transfer, _, _ = make_transfer(real)
    numpy_real = np.dtype(precision)
    knots = _apart(scalars, (scalars - shift).astype(numpy_real))
    n = len(knots)
    widths = np.diff(knots.astype(np.float64))
    # A jump is an interval without width: nothing is ever in it.
    steps = np.where(widths > 0, widths, 1.0)[:, None]

    def values_and_slopes(values: NDArray[np.float64]) -> list[NDArray]:
        flat = np.zeros((1, values.shape[1]))
        slopes = np.concatenate([flat, np.diff(values, axis=0) / steps, flat])
        return [np.ascontiguousarray(a, numpy_real) for a in (np.concatenate([values[:1], values]), slopes)]

    first, last = scalars[0], scalars[-1]
    bins = int(np.clip(8 * n, 512, 8192)) if last > first else 1
    scale = bins / (last - first) if last > first else 1.0
    # Which intervals a bin may need, with a margin for the rounding of its index.
    edges = np.linspace(first, last, bins + 1) - shift
    margin = 4 * np.spacing(np.abs(edges).max().astype(numpy_real)) + 0.01 / scale
    begin = np.searchsorted(knots, edges[:-1] - margin, "right")
    end = np.searchsorted(knots, edges[1:] + margin, "right") + 1
    begin[0], end[-1] = 0, n + 1

    transfer = Transfer()
    transfer.knot = wp.array(np.concatenate([knots[:1], knots]), dtype=real, device=device)
    transfer.value, transfer.slope = (
        wp.array(a, dtype=vec4_of(real), device=device) for a in values_and_slopes(values)
    )
    if factors is not None:
        transfer.factor, transfer.factor_slope = (
            wp.array(a, dtype=vec3_of(real), device=device) for a in values_and_slopes(factors)
        )
    transfer.visible = wp.array(_next_visible(values[:, 3]), dtype=int, device=device)
    transfer.bins = wp.array(np.stack([begin, end], axis=1).astype(np.int32), dtype=wp.vec2i, device=device)
    transfer.low = first - shift
    transfer.scale = scale
    return transfer


def _apart(scalars: NDArray[np.float64], knots: NDArray) -> NDArray:
    """``knots``, which are ``scalars`` rounded, with those apart that rounding put together: what is no jump stays none."""
    least = knots.dtype.type(CLOSEST[knots.dtype.name])
    if np.all((np.diff(knots) >= least) | (np.diff(scalars) == 0)):
        return knots
    for k in range(1, len(knots)):
        if scalars[k] == scalars[k - 1]:
            knots[k] = knots[k - 1]
        else:
            next_one = np.nextafter(knots[k - 1], knots.dtype.type(np.inf))
            knots[k] = max(knots[k], next_one, knots[k - 1] + least)
    return knots


def _next_visible(extinctions: NDArray[np.float64]) -> NDArray[np.int32]:
    """For each of the n + 1 intervals of n knots, the first from it on that has any extinction, n + 1 if none."""
    ends = np.concatenate([extinctions[:1], extinctions, extinctions[-1:]])
    k = np.arange(len(ends) - 1)
    own = np.where((ends[:-1] > 0) | (ends[1:] > 0), k, len(k))
    return np.minimum.accumulate(own[::-1])[::-1].astype(np.int32)


def range_maxima(tf: TransferFunction, unit: float, device: wp.Device) -> wp.array:
    """Bounds on a transfer function over any range of its n + 1 intervals: row l has at k those of k .. k + 2**l - 1.

    Per interval: how much an error of the scalar changes emission, |tau'| + tau |c'| for extinction tau per ``unit`` of
    length and colours up to 1; extinction; colour; minus colour, so that all are maxima.
    """
    values = transfer_values(tf, unit)
    ends = np.stack([values[[0, *range(len(values))]], values[[*range(len(values)), -1]]])
    extinction = ends[:, :, 3].max(axis=0)
    change = np.abs(ends[1] - ends[0])
    width = np.concatenate([[1.0], np.diff(tf.knots), [1.0]])
    # A jump is infinitely steep, unless nobody sees it.
    with np.errstate(divide="ignore", invalid="ignore"):
        visibility = (change[:, 3] + extinction * change[:, :3].max(axis=1)) / width
    visibility = np.nan_to_num(visibility, nan=0.0, posinf=np.inf)
    # A colour that nobody sees is none.
    colors = np.where(
        extinction[:, None] > 0, np.hstack([ends[:, :, :3].max(axis=0), -ends[:, :, :3].min(axis=0)]), -np.inf
    )
    rows = [np.column_stack([visibility, extinction, colors])]
    while 2 ** len(rows) <= len(extinction):
        half = 2 ** (len(rows) - 1)
        row = rows[-1].copy()
        row[:-half] = np.maximum(row[:-half], row[half:])
        rows.append(row)
    return wp.array(np.stack(rows), dtype=vec8d, device=device)


def table_array(
    tf: TransferFunction,
    n: int,
    length: float,
    unit: float,
    domain: tuple[float, float],
    generator: str,
    precision: str,
    device: wp.Device,
) -> tuple[wp.array]:
    """The (n, n) table of segments of ``length`` units on the device, extinction per ``unit`` of world length.

    ``generator="stretchable"``: of mean emission and extinction, for segments of any length; colours are those of
    ``length``.
    """
    cut = _Cut(tf, n, domain, unit)
    colors = cut.colors(None)
    if generator != "stretchable":
        return (_generate(colors, cut, length, generator, None, precision, device)[0],)
    table = _generate(colors, cut, length, "incremental", None, precision, device)[0]
    real = REALS[precision]
    inputs = [wp.array(cut.running(), dtype=wp.vec4d, device=device), cut.pieces(colors, real, device).value, table]
    launch(make_stretchable(real), n * n, inputs, device, grain=n)
    return (table,)


def lit_tables(
    tf: TransferFunction,
    n: int,
    length: float,
    unit: float,
    domain: tuple[float, float],
    generator: str,
    precision: str,
    device: wp.Device,
) -> tuple[wp.array, wp.array, wp.array]:
    """The (n, n) table of ambient colour and opacity, and the front- and back-weighted ones."""
    tables = _tables(tf, _Cut(tf, n, domain, unit), length, generator, "lighting", precision, device)
    ambient = tables.get("ambient", tables["rgba"])
    return tuple(_vec4(table, REALS[precision], device) for table in (ambient, tables["front"], tables["back"]))


def table_struct(tables: Sequence[wp.array], domain: tuple[float, float], shift: float, precision: str) -> Any:
    """The struct of ``kernels.table`` for look-ups of scalars minus ``shift``."""
    Table, _ = make_table(REALS[precision])
    table = Table()
    for name, entries in zip(("rgba", "front", "back"), tables, strict=False):
        setattr(table, name, entries)
    table.low = domain[0] - shift
    table.scale = (table.rgba.shape[0] - 1) / (domain[1] - domain[0])
    return table


def nodes_array(precision: str, device: wp.Device) -> wp.array:
    """The quadrature nodes that ``kernels.segment`` reads."""
    return _nodes(precision, device.alias)


@cache
def _nodes(precision: str, alias: str) -> wp.array:
    dtype = wp.vec2d if precision == "float64" else wp.vec2
    return wp.array(gauss_nodes(precision).astype(precision), dtype=dtype, device=alias)


class Table:
    """A pre-integration table: segments whose scalar runs linearly between two of n equally spaced values.

    Attributes
    ----------
    rgba
        (n, n, 4), or (m, n, n, 4) for m lengths: [..., i, j, :] is the segment from table value i (front) to j (back):
        premultiplied colour and opacity. NumPy, in the table's precision.
    front, back
        With weights, of the shape of ``rgba``: the integrals of diffuse colour and of white specular light (last
        channel), weighted by a ramp that falls from 1 at the front to 0 at the back, and by the opposite one
        (Lum, Wilson and Ma 2004, section 3). Without coefficients in the transfer function front + back = rgba, so
        that two tables are all that a lit segment reads. None without weights.
    ambient
        ``rgba`` with colours times the transfer function's ambient coefficient; None where it has none.
    domain
        Scalars of the first and last value.
    length
        Length of the segments [world length], or (m,) ascending lengths.
    """

    def __init__(
        self,
        rgba: NDArray[np.floating],
        domain: tuple[float, float],
        length: float | NDArray[np.float64],
        front: NDArray[np.floating] | None = None,
        back: NDArray[np.floating] | None = None,
        ambient: NDArray[np.floating] | None = None,
    ):
        self.rgba, self.front, self.back, self.ambient = rgba, front, back, ambient
        self.domain = domain
        self.length = length

    def lookup(
        self, front: ArrayLike, back: ArrayLike, length: ArrayLike | None = None, table: str = "rgba"
    ) -> NDArray[np.float64]:
        """Segments that run from scalar ``front`` to ``back``, interpolated linearly between entries.

        Parameters
        ----------
        front, back
            Scalars, broadcast together; those outside the domain are clamped to it.
        length
            Lengths [world length]. A 2D table has one and needs none; a 3D table interpolates between its lengths (and
            length 0, which is nothing), up to the last.
        table
            Which: ``"rgba"``, ``"front"``, ``"back"`` or ``"ambient"``.

        Returns
        -------
        float64, shape (..., 4)
        """
        entries = getattr(self, choice(table, "table", ("rgba", "front", "back", "ambient")))
        if entries is None:
            raise ValueError(f"table must be one that was generated, got {table!r}")
        u, v = (np.asarray(s, np.float64) for s in (front, back))
        if np.ndim(self.length) == 0:
            if length is not None and np.any(length != self.length):
                raise ValueError(f"length must be that of the table, {self.length}, got {length!r}")
            return self._bilinear(entries, u, v)
        lengths = np.concatenate([[0.0], self.length])
        given = np.asarray(length, np.float64)
        if length is None or not np.all((given >= 0) & (given <= lengths[-1])):
            raise ValueError(f"length must be in [0, {lengths[-1]}], got {length!r}")
        layer = np.clip(np.searchsorted(lengths, given, "right") - 1, 0, len(lengths) - 2)
        share = ((given - lengths[layer]) / np.diff(lengths)[layer])[..., None]
        below = np.where((layer > 0)[..., None], self._bilinear(entries, u, v, np.maximum(layer - 1, 0)), 0.0)
        return (1 - share) * below + share * self._bilinear(entries, u, v, layer)

    def _bilinear(
        self, entries: NDArray, front: NDArray[np.float64], back: NDArray[np.float64], *layer: NDArray
    ) -> NDArray[np.float64]:
        n = entries.shape[-2]
        (lo, hi), last = self.domain, n - 1
        u, v = (np.clip((s - lo) / (hi - lo) * last, 0, last) for s in (front, back))
        i, j = (np.minimum(w.astype(int), n - 2) for w in (u, v))
        x, y = (u - i)[..., None], (v - j)[..., None]
        e00, e01, e10, e11 = (entries[tuple([*layer, i + a, j + b])] for a in (0, 1) for b in (0, 1))
        e0, e1 = e00 * (1 - y) + e01 * y, e10 * (1 - y) + e11 * y
        return e0 * (1 - x) + e1 * x


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

    def __init__(self, cut: _Cut):
        rgb, tau = cut.colors(None), cut.extinctions
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
            Broadcast together; scalars outside the domain are clamped to it.

        Returns
        -------
        float64, shape (..., 4)
        """
        first, last = self.scalars[[0, -1]]
        a, b, length = np.broadcast_arrays(np.clip(front, first, last), np.clip(back, first, last), length)
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


@overload
def preintegrate(
    tf: TransferFunction,
    n: int = ...,
    length: float | Sequence[float] = ...,
    domain: tuple[float, float] | None = ...,
    generator: Literal["incremental", "brute", "approximate"] = ...,
    weights: str | None = ...,
    device: Any = ...,
    precision: str = ...,
) -> Table: ...
@overload
def preintegrate(
    tf: TransferFunction,
    n: int = ...,
    length: float | Sequence[float] = ...,
    domain: tuple[float, float] | None = ...,
    *,
    generator: Literal["running"],
    weights: str | None = ...,
    device: Any = ...,
    precision: str = ...,
) -> RunningIntegrals: ...
def preintegrate(
    tf: TransferFunction,
    n: int = 256,
    length: float | Sequence[float] = 1.0,
    domain: tuple[float, float] | None = None,
    generator: str = "incremental",
    weights: str | None = None,
    device: Any = None,
    precision: str = "float32",
) -> Table | RunningIntegrals:
    """Pre-integrate a transfer function: a table of segments over the scalars at their two ends.

    Parameters
    ----------
    tf
        The transfer function. A ``unit_distance`` of None counts as 1.
    n
        Entries along an axis, >= 2.
    length
        Length of a segment [world length], > 0; a sequence of ascending ones makes a 3D table (m, n, n, 4).
    domain
        Scalars ``(lo, hi)`` of the first and last entry; by default the first and last control point.
    generator
        ``"incremental"``: subrange integration of Lum, Wilson and Ma (2004), exact in O(n^2) a length; ``"brute"``: the
        same table in O(n^3); ``"approximate"``: without attenuation inside a segment (Engel et al. 2001), O(n^2) and
        wrong where dense, its colour may exceed its opacity; ``"running"``: one-dimensional running integrals, for any
        length.
    weights
        ``"lighting"`` adds the front- and back-weighted tables, by first moments; ``"lum"`` the same by the subtraction
        of section 4.3 of the paper, which loses digits.
    device
        Warp device that computes it; CUDA where there is one, by default.
    precision
        ``"float32"`` (max abs error 2e-6) or ``"float64"`` (1e-12).

    Returns
    -------
    Table, or RunningIntegrals for ``generator="running"``

    Raises
    ------
    ValueError
        For n < 2, lengths <= 0, NaN or not ascending, lo >= hi, a transfer function of a single scalar without
        ``domain``, or weights with a generator that has none.

    Examples
    --------
    >>> import wvr
    >>> tf = wvr.TransferFunction([(0, "red", 0.0), (1, "blue", 0.5)])
    >>> wvr.preintegrate(tf, 16, length=2.0, device="cpu").rgba.shape
    (16, 16, 4)
    """
    if not isinstance(tf, TransferFunction):
        raise TypeError(f"tf must be a TransferFunction, got {type(tf).__name__}")
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 2:
        raise ValueError(f"n must be an integer >= 2, got {n!r}")
    lengths = [positive(value, "length") for value in ([length] if np.ndim(length) == 0 else length)]  # type: ignore[union-attr]
    if not lengths or np.any(np.diff(lengths) <= 0):
        raise ValueError(f"length must be one number > 0, or one or more ascending, got {length!r}")
    choice(generator, "generator", GENERATORS)
    choice(weights, "weights", WEIGHTS)
    choice(precision, "precision", tuple(REALS))
    if weights is not None and generator not in ("incremental", "brute"):
        raise ValueError(f"weights must be None for generator={generator!r}, got {weights!r}")
    if weights == "lum" and generator == "brute":
        raise ValueError('weights="lum" is a way of generator="incremental", got generator="brute"')
    lo, hi = _domain(tf, domain)
    cut = _Cut(tf, int(n), (lo, hi), 1.0)
    if generator == "running":
        return RunningIntegrals(cut)
    on = get_device(device)
    layers = [_tables(tf, cut, value, generator, weights, precision, on) for value in lengths]
    tables = {name: np.stack([layer[name] for layer in layers]) for name in layers[0]}
    if np.ndim(length) == 0:
        return Table(domain=(lo, hi), length=lengths[0], **{name: entries[0] for name, entries in tables.items()})
    return Table(domain=(lo, hi), length=np.array(lengths), **tables)


def _tables(
    tf: TransferFunction,
    cut: _Cut,
    length: float,
    generator: str,
    weights: str | None,
    precision: str,
    device: wp.Device,
) -> dict[str, NDArray]:
    """The arrays of :class:`Table` for one length."""

    def generate(colors: tuple, weights: str | None) -> list[NDArray]:
        return [table.numpy() for table in _generate(colors, cut, length, generator, weights, precision, device)]

    plain = generate(cut.colors(None), weights)
    tables = {"rgba": plain[0]}
    if tf.ambient is not None:
        tables["ambient"] = generate(cut.colors(tf.ambient), None)[0]
    if weights is not None:
        diffuse, specular = plain, None
        if tf.diffuse is not None:
            diffuse = generate(cut.colors(tf.diffuse), weights)
        if tf.specular is not None:
            specular = generate(cut.colors(tf.specular, white=True), weights)
        total, back = diffuse[0].copy(), diffuse[1]
        if specular is not None:
            total[..., 3], back[..., 3] = specular[0][..., 0], specular[1][..., 0]
        tables["front"], tables["back"] = total - back, back
    return tables


def _generate(
    colors: tuple[NDArray[np.float64], ...],
    cut: _Cut,
    length: float,
    generator: str,
    weights: str | None,
    precision: str,
    device: wp.Device,
) -> list[wp.array]:
    """The (n, n) table of ``colors`` (low, high, curve, at the values) and, with weights, the back-weighted one."""
    real = REALS[precision]
    n = cut.n
    pieces = cut.pieces(colors, real, device)
    table = wp.empty((n, n), dtype=vec4_of(real), device=device)
    if generator == "approximate":
        running = wp.array(cut.running(), dtype=wp.vec4d, device=device)
        launch(make_approximate(real), n * n, [running, pieces.value, length, table], device, grain=n)
        return [table]
    moments = wp.empty_like(table) if weights else table
    diagonal, incremental, brute = make_generators(real, weights or "none")
    launch(diagonal, n, [pieces, length, table, moments], device, grain=n)
    if generator == "brute":
        launch(brute, n * n, [pieces, length, table, moments], device, grain=n)
    else:
        bins = _bins(n, device.alias)
        launch(incremental, len(bins), [pieces, bins, length, table, moments], device, grain=16)
    return [table, moments] if weights else [table]


def _domain(tf: TransferFunction, domain: Sequence[float] | None) -> tuple[float, float]:
    lo, hi = map(float, (tf.knots[0], tf.knots[-1]) if domain is None else domain)
    if not (np.isfinite(lo) and np.isfinite(hi) and lo < hi):
        given = f"domain must be (lo, hi) with lo < hi, got {domain!r}"
        raise ValueError(given if domain is not None else f"{given}, and the control points are all at {lo:g}")
    return lo, hi


class _Cut:
    """A transfer function over the n - 1 intervals of a table, cut into pieces at its own knots."""

    def __init__(self, tf: TransferFunction, n: int, domain: tuple[float, float], unit: float):
        self.tf, self.n = tf, n
        self.grid = np.linspace(*domain, n)
        inside = tf.knots[(tf.knots > domain[0]) & (tf.knots < domain[1])]
        self.scalars = np.union1d(self.grid, inside)
        self.first = np.searchsorted(self.scalars, self.grid)
        self.width = np.diff(self.scalars) * ((n - 1) / (domain[1] - domain[0]))
        # Extinction per ``unit``, the smallest voxel spacing [world length], at the pieces' low and high ends.
        tau = tf.knot_extinctions(unit) * unit
        self.extinctions = self._ends(tau)
        self._grid_extinctions = _limits(tf.knots, tau, self.grid, "right")

    def colors(self, factor: NDArray[np.float64] | None, white: bool = False) -> tuple[NDArray[np.float64], ...]:
        """Colours at the pieces' low and high ends, their second-order coefficient, and colours at the table values.

        Times a ``factor`` given at the knots, linear between them as the colours are: a product is quadratic.
        """
        rgb = np.ones_like(self.tf.colors) if white else self.tf.colors
        low, high = self._ends(rgb)
        at = _limits(self.tf.knots, rgb, self.grid, "right")
        if factor is None:
            return low, high, np.empty((0, 3)), at
        k_low, k_high = (k[:, None] for k in self._ends(factor))
        k_at = _limits(self.tf.knots, factor, self.grid, "right")[:, None]
        curve = np.empty((0, 3)) if white else (high - low) * (k_high - k_low)
        return low * k_low, high * k_high, curve, at * k_at

    def pieces(self, colors: tuple[NDArray[np.float64], ...], real: Any, device: wp.Device) -> Any:
        """The struct of ``kernels.table``."""
        low, high, curve, at = colors
        Pieces, _ = make_pieces(real)
        precision = "float64" if real is wp.float64 else "float32"
        pieces = Pieces()
        pieces.first = wp.array(self.first.astype(np.int32), dtype=int, device=device)
        pieces.width = wp.array(self.width.astype(precision), dtype=real, device=device)
        pieces.low = _vec4(np.column_stack([low, self.extinctions[0]]), real, device)
        pieces.high = _vec4(np.column_stack([high, self.extinctions[1]]), real, device)
        pieces.curve = _vec4(np.column_stack([curve, np.zeros(len(curve))]), real, device)
        pieces.value = _vec4(np.column_stack([at, self._grid_extinctions]), real, device)
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
    """``values`` at ``knots`` interpolated at ``s``, at a jump the limit from the ``side``."""
    # The interval [k, k + 1] of knots that s is in, as seen from the side.
    k = np.clip(np.searchsorted(knots, s, side) - 1, 0, len(knots) - 2)
    width = knots[k + 1] - knots[k]
    share = np.divide(s - knots[k], width, out=np.full(len(s), float(side == "right")), where=width > 0)
    share = np.clip(share, 0.0, 1.0).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[k] + share * values[k + 1]


@lru_cache(4)
def _bins(n: int, alias: str) -> wp.array:
    """Work items (r, start) of incremental subrange integration, the long ones first."""
    count = (n - 1) // np.arange(n - 1, 0, -1)
    r = np.repeat(np.arange(n - 1, 0, -1), count)
    start = r * (np.arange(len(r)) - np.repeat(np.cumsum(count) - count, count))
    return wp.array(np.stack([r, start], axis=1).astype(np.int32), dtype=wp.vec2i, device=alias)


def _vec4(values: NDArray[np.float64], real: Any, device: wp.Device) -> wp.array:
    dtype = np.float64 if real is wp.float64 else np.float32
    return wp.array(np.ascontiguousarray(values, dtype), dtype=vec4_of(real), device=device)
