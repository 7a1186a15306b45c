"""Pre-integration: tables of segments over the scalars at their two ends."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any, Literal, overload

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.precision import REALS, vec4_of
from ..kernels.transfer.preintegration import make_approximate, make_generators
from ..launch import get_device, launch, load
from ..memory import free_host_memory, free_memory, gib
from ..transfer_function import TransferFunction
from ..validation import choice, finite_array, float_array, integer, positive
from .function import LARGEST as MAGNITUDES
from .running import Cut, RunningIntegrals
from .table import Table

Weights = Literal["lighting", "lum"]

GENERATORS = ("incremental", "brute", "approximate", "running")
# The largest n whose square kernels can count to.
LARGEST = 46340
# Bytes that the integrals of a transfer function need on the way, for an entry.
ENTRY = 500
WEIGHTS = (None, "lighting", "lum")


@overload
def preintegrate(
    tf: TransferFunction,
    n: int = ...,
    length: float | Sequence[float] = ...,
    domain: tuple[float, float] | None = ...,
    generator: Literal["incremental", "brute", "approximate"] = ...,
    weights: Weights | None = ...,
    device: Any = ...,
    precision: Literal["float32", "float64"] = ...,
) -> Table: ...
@overload
def preintegrate(
    tf: TransferFunction,
    n: int = ...,
    length: float | Sequence[float] = ...,
    domain: tuple[float, float] | None = ...,
    *,
    generator: Literal["running"],
    weights: Weights | None = ...,
    device: Any = ...,
    precision: Literal["float32", "float64"] = ...,
) -> RunningIntegrals: ...
def preintegrate(
    tf: TransferFunction,
    n: int = 256,
    length: float | Sequence[float] = 1.0,
    domain: tuple[float, float] | None = None,
    generator: Literal["incremental", "brute", "approximate", "running"] = "incremental",
    weights: Weights | None = None,
    device: Any = None,
    precision: Literal["float32", "float64"] = "float32",
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
        For n < 2 or > 46340, lengths <= 0, NaN or not ascending, lo >= hi or too near to it for n entries, a
        transfer function of a single scalar without ``domain``, colours and optical depths beyond 1e30 (float32) or
        1e100, or weights with a generator that has none.
    MemoryError
        For tables that would not fit the memory, before it is taken.

    Examples
    --------
    >>> import wvr
    >>> tf = wvr.TransferFunction([(0, "red", 0.0), (1, "blue", 0.5)])
    >>> wvr.preintegrate(tf, 16, length=2.0, device="cpu").rgba.shape
    (16, 16, 4)
    """
    if not isinstance(tf, TransferFunction):
        raise TypeError(f"tf must be a TransferFunction, got {type(tf).__name__}")
    n = integer(n, "n", 2)
    given = np.atleast_1d(float_array(length, "length"))
    lengths = [positive(value, "length") for value in given.ravel().tolist()]
    if given.ndim > 1 or not lengths or np.any(np.diff(lengths) <= 0):
        raise ValueError(f"length must be one number > 0, or one or more ascending, got {length!r}")
    choice(generator, "generator", GENERATORS)
    choice(weights, "weights", WEIGHTS)
    choice(precision, "precision", tuple(REALS))
    if weights is not None and generator not in ("incremental", "brute"):
        raise ValueError(f"weights must be None for generator={generator!r}, got {weights!r}")
    if weights == "lum" and generator == "brute":
        raise ValueError('weights="lum" is a way of generator="incremental", got generator="brute"')
    if weights == "lum" and any(one is not None for one in tf.materials().values()):
        raise ValueError('weights="lum" is for transfer functions without ambient, diffuse and specular coefficients')
    lo, hi = _domain(tf, domain)
    on = get_device(device)
    if generator != "running" and n > LARGEST:
        raise ValueError(f"n must be at most {LARGEST} for tables of n x n entries, got {n}")
    square = 0 if generator == "running" else _bytes(tf, n, len(lengths), weights, precision)
    _check_memory(ENTRY * n + square, n, len(lengths), on)
    cut = Cut(tf, n, (lo, hi), 1.0)
    most = MAGNITUDES[precision]
    for what, size in (("colours", tf.colors.max()), ("optical depths", tf.knot_extinctions().max() * lengths[-1])):
        if size > most:
            raise ValueError(f"tf and length make {what} of {size:.3g}; {precision} tables hold up to {most:.0e}")
    if generator == "running":
        return RunningIntegrals(cut)
    layers = [tables_of(tf, cut, value, generator, weights, precision, on) for value in lengths]
    tables = {name: np.stack([layer[name] for layer in layers]) for name in layers[0]}
    if np.ndim(length) == 0:
        return Table(domain=(lo, hi), length=lengths[0], **{name: entries[0] for name, entries in tables.items()})
    return Table(domain=(lo, hi), length=np.array(lengths), **tables)


def _check_memory(needed: int, n: int, lengths: int, device: wp.Device) -> None:
    """Of bytes that tables need while they are made, on the device and on the host, before any is taken."""
    free = min(free_memory(device), free_host_memory())
    if needed > free:
        raise MemoryError(
            f"n = {n} entries along an axis and {lengths} lengths need {gib(needed)}, of which "
            f"{gib(free)} are free: take a smaller n"
        )


def _bytes(tf: TransferFunction, n: int, lengths: int, weights: str | None, precision: str) -> int:
    """Of square tables: on the way those of a length, and twice all of them, as they come and in one."""
    kinds = (1 + (tf.ambient is not None)) + 2 * (weights is not None) * (1 + (tf.diffuse is not None))
    return (16 if precision == "float32" else 32) * n * n * kinds * (2 * lengths + 1)


def tables_of(
    tf: TransferFunction,
    cut: Cut,
    length: float,
    generator: str,
    weights: str | None,
    precision: str,
    device: wp.Device,
) -> dict[str, NDArray]:
    """The arrays of :class:`Table` for one length."""

    def arrays(colors: tuple, weights: str | None) -> list[NDArray]:
        return [table.numpy() for table in generate(colors, cut, length, generator, weights, precision, device)]

    plain = arrays(cut.colors(None), None if weights == "lum" else weights)
    tables = {"rgba": plain[0]}
    if tf.ambient is not None:
        tables["ambient"] = arrays(cut.colors(tf.ambient), None)[0]
    if weights == "lum":
        back = ramped(cut, plain[0], length, generator, precision, device)
        tables["front"], tables["back"] = plain[0] - back, back
    elif weights is not None:
        diffuse, specular = plain, None
        if tf.diffuse is not None:
            diffuse = arrays(cut.colors(tf.diffuse), weights)
        if tf.specular is not None:
            specular = arrays(cut.colors(tf.specular, white=True), weights)
        total, back = diffuse[0].copy(), diffuse[1]
        if specular is not None:
            total[..., 3], back[..., 3] = specular[0][..., 0], specular[1][..., 0]
        tables["front"], tables["back"] = total - back, back
    return tables


def ramped(
    cut: Cut, plain: NDArray[np.floating], length: float, generator: str, precision: str, device: wp.Device
) -> NDArray[np.floating]:
    """Back-weighted entries as Lum et al. (2004) have them, section 4.3: the table of colours times a ramp over the
    whole table, less i times the ``plain`` one, over how many intervals the entry has, all in the table's precision.
    White in place of the opacity. On the diagonal, which the paper leaves open, the ramp is in length.
    """
    real = plain.dtype.type
    n = cut.n
    i = np.arange(n, dtype=real)
    apart = i[None, :] - i[:, None]
    depth = -np.log1p(-np.minimum(np.diagonal(plain[..., 3]).astype(np.float64), 1 - 1e-16))
    thin = np.minimum(depth, 0.1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = np.where(
            depth > 0.1, 1 / depth - 1 / np.expm1(depth), 0.5 - thin / 12 + thin**3 / 720 - thin**5 / 30240
        )
    back = plain * share.astype(real)[:, None, None]
    for rising in (True, False):
        # Entries from the first one on or, for segments that fall, from the last.
        ramp = partial(np.interp, xp=cut.grid[[0, -1]], fp=[0, n - 1] if rising else [n - 1, 0])
        made = [
            generate(cut.colors(ramp, white=white), cut, length, generator, None, precision, device)[0].numpy()
            for white in (False, True)
        ]
        globally = np.concatenate([made[0][..., :3], made[1][..., :1]], axis=-1)
        origin = i[:, None] if rising else n - 1 - i[:, None]
        there = apart > 0 if rising else apart < 0
        back[there] = ((globally - origin[..., None] * plain) / np.where(there, np.abs(apart), real(1.0))[..., None])[
            there
        ]
    return back


def generate(
    colors: tuple[NDArray[np.float64], ...],
    cut: Cut,
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
    diagonal, incremental, brute = make_generators(real, weights is not None)
    launch(diagonal, n, [pieces, length, table, moments], device, grain=n)
    if generator == "brute":
        launch(brute, n * n, [pieces, length, table, moments], device, grain=n)
    else:
        bins = _bins(n, device.alias)
        # In half the time, and compiled as soon.
        load(incremental, device.alias, deep=True)
        launch(incremental, len(bins), [pieces, bins, length, table, moments], device, grain=16)
    return [table, moments] if weights else [table]


def _domain(tf: TransferFunction, domain: Sequence[float] | None) -> tuple[float, float]:
    given = tf.knots[[0, -1]] if domain is None else finite_array(domain, "domain", (2,))
    lo, hi = float(given[0]), float(given[1])
    if not (np.isfinite(lo) and np.isfinite(hi) and lo < hi):
        what = f"domain must be (lo, hi) with lo < hi, got {domain!r}"
        raise ValueError(what if domain is not None else f"{what}, and the control points are all at {lo:g}")
    return lo, hi


@lru_cache(4)
def _bins(n: int, alias: str) -> wp.array:
    """Work items (r, start) of incremental subrange integration, the long ones first."""
    count = (n - 1) // np.arange(n - 1, 0, -1)
    r = np.repeat(np.arange(n - 1, 0, -1), count)
    start = r * (np.arange(len(r)) - np.repeat(np.cumsum(count) - count, count))
    return wp.array(np.stack([r, start], axis=1).astype(np.int32), dtype=wp.vec2i, device=alias)
