"""Rows of a transfer function for cells in single precision: a polynomial in a window of scalars and its deviation.

Those of intervals are exact but for rounding. A colour map of hundreds of control points, most of which change little,
is fitted too: extinction by parabolas, colour by lines, in windows of all widths, so that a cell finds one that holds
all that it sees and is no wider than it must be.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..kernels.transfer.rows import Rows

Floats = NDArray[np.float64]

# Of the narrowest fitted windows there are 2^LEVELS; each level has half as many, twice as wide.
LEVELS = 9
BINS = 1024
# Intervals that are so narrow, in parts of all scalars, are left to double precision, and so are those beside them.
NARROW = 1e-6
# Nodes that rows are fitted in.
NODES = 12


@dataclass(frozen=True)
class FittedRows(Part):
    """The struct of ``kernels.transfer.rows`` for a transfer function as of ``transfer.simplify``, and scalars in
    [low, high].
    """

    function: Part
    low: float
    high: float
    name: ClassVar[str] = "rows"

    def build(self, keep: Keeper) -> Any:
        points, transfer = keep(self.function)
        knots = transfer.knot.numpy()[1:]
        result = Rows()
        table, bins, numbers = rows(knots, points.values, self.low, self.high)
        result.row = wp.array(table, dtype=wp.float32, device=keep.device)
        result.jumps = wp.array(jumps(knots, points.values, numbers["narrow"]), dtype=wp.float32, device=keep.device)
        result.knots = transfer.knot
        result.bins = wp.array(bins, dtype=wp.float32, device=keep.device)
        for name, value in numbers.items():
            setattr(result, name, value)
        return result


def rows(
    knots: Floats, values: Floats, low: float, high: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], dict[str, Any]]:
    """Rows (n, 16) of control points (m,) with colour and extinction (m, 4), those of bins, and the numbers of the
    struct.

    A row is: middle and half width of its window; extinction ``t0 + t1 w + t2 w^2`` at w from the middle; the largest
    deviation of extinction and of colour; the steepest colour; colour in the middle and its slope, behind which are, of
    an interval, what extinction and colour are off by where it is drawn a unit too far.
    """
    span = knots[-1] - knots[0] or max(high - low, abs(knots[0]), 1.0)
    begin, end = max(low, knots[0] - span / 64), min(high, knots[-1] + span / 64)
    if not begin < end:
        begin, end = min(begin, end), min(begin, end) + span
    # The outer intervals, as far as there are scalars.
    ends = np.concatenate([[min(low, knots[0]) - span], knots, [max(high, knots[-1]) + span]])
    at = np.concatenate([values[:1], values, values[-1:]])
    own = _lines(ends, at)
    wide = (end - begin) / 2**LEVELS * 2.0 ** np.arange(LEVELS + 1)
    middles = [begin + (np.arange(2 ** (LEVELS - j)) + 0.5) * wide[j] for j in range(LEVELS + 1)]
    halves = np.repeat(2.50001 * wide, [len(m) for m in middles])
    fitted = _parabolas(ends, at, np.concatenate(middles), halves)
    scale = BINS / (end - begin)
    of_bin = np.searchsorted(ends, begin + (np.arange(BINS) + 0.5) / scale, "right") - 1
    of_bin = np.clip(of_bin, 0, len(own) - 1)
    bins = np.zeros((BINS, 4), np.float32)
    bins[:, 0], bins[:, 1:3] = of_bin, own[of_bin, :2]
    numbers = {
        "low": begin,
        "scale": scale,
        "fine": 1 / wide[0],
        "least": 0.5 / wide[0],
        "narrow": (1 - 2.0**-20) * NARROW * (ends[-1] - ends[0]),
        "levels": LEVELS,
        "fitted": len(own),
    }
    return np.concatenate([own, fitted]), bins, numbers


def jumps(knots: Floats, values: Floats, narrow: float) -> NDArray[np.float32]:
    """(intervals, 8): what extinction and colour of an interval are off by where it is drawn a unit too far, were there
    no jumps at its ends; what they jump by below it, colour times extinction, and above; rounded up. -1 in the first
    place of an interval that is itself a jump; infinite beside one that is ``narrow``.
    """
    width = np.concatenate([[np.inf], np.diff(knots), [np.inf]])
    at = np.concatenate([values[:1], values, values[-1:]])
    step = np.abs(np.diff(at, axis=0))
    step[:, :3] *= np.maximum(at[1:, 3:], at[:-1, 3:])
    wide, none = np.flatnonzero(width > 0), np.flatnonzero(width == 0)
    slope = np.diff(at, axis=0)[wide] / width[wide, None]
    # Between an interval and the next: jumps, which are rounded as sums are, and a change of slopes.
    pair = np.searchsorted(wide, none) - 1
    sizes = np.zeros((len(wide) - 1, 2))
    for column, size in enumerate((step[none, 3], step[none, :3].max(axis=1, initial=0.0))):
        np.add.at(sizes[:, column], pair, size)
    change = np.abs(np.diff(slope, axis=0))
    change = np.stack([change[:, 3], change[:, :3].max(axis=1)], axis=-1)
    change[np.minimum(width[wide[1:]], width[wide[:-1]]) <= 1.001 * narrow] = np.inf
    table = np.zeros((len(width), 8))
    table[none, 0] = -1
    table[wide[1:], 2:4], table[wide[:-1], 4:6] = sizes, sizes
    off = np.pad(change, ((1, 1), (0, 0)))
    table[wide, :2] = np.maximum(off[1:], off[:-1])
    table[wide, 0] += np.abs(slope[:, 3])
    with np.errstate(over="ignore"):
        return (table * (1 + 2.0**-20)).astype(np.float32)


def _lines(ends: Floats, at: Floats) -> NDArray[np.float32]:
    """Rows of intervals, in single precision."""
    width = np.diff(ends)
    table = np.zeros((len(width), 16), np.float32)
    slope = np.diff(at, axis=0) / np.where(width > 0, width, 1.0)[:, None]
    table[:, 0] = ends[:-1] + 0.5 * width
    middle = table[:, 0].astype(np.float64)
    center = at[:-1] + (middle - ends[:-1])[:, None] * slope
    half = np.minimum(middle - ends[:-1], ends[1:] - middle)
    _fill(table, center[:, 3], slope[:, 3], 0.0, center[:, :3], slope[:, :3])
    # What is in the window is in the interval.
    table[:, 1] = np.where(half > 0, np.nextafter(half.astype(np.float32), np.float32(-1)), -1)
    off = np.zeros((2, len(width)))
    for end in range(2):
        off = np.maximum(off, _deviations(table, ends[end : len(width) + end] - middle, at[end : len(width) + end]))
    table = _closed(table, off)
    # What a line drawn a unit too far is off by (docs/proof-single.md, S13), of extinction with what that falls below
    # 0. Beside intervals too narrow to say so, everything.
    change = np.abs(np.diff(np.pad(slope, ((1, 1), (0, 0)), mode="edge"), axis=0))
    change = np.maximum(change[:-1], change[1:])
    narrow = width <= NARROW * (ends[-1] - ends[0])
    beside = narrow | np.append(narrow[1:], False) | np.insert(narrow[:-1], 0, False)
    table[:, 11] = np.where(beside, np.inf, change[:, 3] + np.abs(slope[:, 3])) * (1 + 2.0**-20)
    table[:, 15] = np.where(beside, np.inf, change[:, :3].max(axis=1)) * (1 + 2.0**-20)
    return table


def _parabolas(ends: Floats, at: Floats, middle: Floats, half: Floats) -> NDArray[np.float32]:
    """Rows fitted in windows."""
    table = np.zeros((len(middle), 16), np.float32)
    table[:, 0] = middle
    middle = table[:, 0].astype(np.float64)
    table[:, 1] = half
    half = table[:, 1].astype(np.float64)
    # Chebyshev's polynomials, as good as the best but for little.
    node = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    y = _evaluate(ends, at, middle[:, None] + half[:, None] * node)
    a0, a1, a2 = (np.einsum("n,bnc->bc", t, y) / NODES for t in (np.ones(NODES), 2 * node, 4 * node**2 - 2))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        linear, bend = a1 / half[:, None], 2 * a2[:, 3] / half**2
    _fill(table, a0[:, 3] - a2[:, 3], linear[:, 3], bend, a0[:, :3], linear[:, :3])
    # Deviations are largest at the window's ends and at control points inside; both values of a jump count. Where it
    # ends is rounded, and a control point may be between: what is looked at reaches a little farther.
    reach = half + 2.0**-50 * (np.abs(middle) + half)
    low, high = middle - reach, middle + reach
    off = np.zeros((2, len(middle)))
    for end in (low, high):
        off = np.maximum(off, _deviations(table, end - middle, _evaluate(ends, at, end)))
    first = np.searchsorted(ends, low, "left")
    number = np.searchsorted(ends, high, "right") - first
    longest = high - low
    some = np.flatnonzero(number)
    if len(some):
        many, begin = number[some], np.cumsum(number[some]) - number[some]
        row = np.repeat(some, many)
        k = np.repeat(first[some] - begin, many) + np.arange(many.sum())
        inside = _deviations(table[row], ends[k] - middle[row], at[k])
        off[:, some] = np.maximum(off[:, some], np.maximum.reduceat(inside, begin, axis=1))
        gaps = np.diff(ends, prepend=-np.inf)[k]
        gaps[begin] = ends[k[begin]] - low[some]
        last = high[some] - ends[k[begin + many - 1]]
        longest[some] = np.maximum(np.maximum.reduceat(gaps, begin), last)
    # And between them that of a parabola from its chord.
    with np.errstate(invalid="ignore"):
        off[0] += np.abs(table[:, 4].astype(np.float64)) * longest**2 / 4
    return _closed(table, off)


def _fill(table: NDArray, t0: Any, t1: Any, t2: Any, color: Floats, slope: Floats) -> None:
    with np.errstate(over="ignore"):
        table[:, 2], table[:, 3], table[:, 4] = t0, t1, t2
        table[:, 8:11], table[:, 12:15] = color, slope
        table[:, 7] = np.abs(table[:, 12:15]).max(axis=1)


def _deviations(table: NDArray[np.float32], w: Floats, at: Floats) -> Floats:
    """Of rows from extinction and colour at w from their middles."""
    row = table.astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        tau = row[:, 2] + w * (row[:, 3] + w * row[:, 4])
        color = row[:, 8:11] + w[:, None] * row[:, 12:15]
        return np.stack([np.abs(tau - at[:, 3]), np.abs(color - at[:, :3]).max(axis=1)])


def _closed(table: NDArray[np.float32], off: Floats) -> NDArray[np.float32]:
    """Rows with their deviations, rounded up; those that single precision does not hold hold nothing."""
    row = table.astype(np.float64)
    # Rounding of the deviations themselves, in double, and of the scalars that they are taken at.
    far = np.abs(row[:, 0]) + np.abs(row[:, 1])
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(row[:, 2]) + np.abs(row[:, 3]) * far + np.abs(row[:, 4]) * row[:, 1] ** 2
        bright = np.abs(row[:, 8:15]).max(axis=1) * (1 + far)
        rounded = (off + 2.0**-48 * np.stack([size, bright])).T.astype(np.float32)
    table[:, 5:7] = np.maximum(np.nextafter(rounded, np.float32(np.inf)), 1e-30)
    table[~np.isfinite(table).all(axis=1) | (np.abs(table) > 1e18).any(axis=1), 1] = -1
    # A cell that a ray only touches has any row, nothing times it: that is to be nothing.
    for seen in (table[:, 2:5], table[:, 8:15]):
        seen[~np.isfinite(seen)] = 0.0
    return table


def _evaluate(ends: Floats, at: Floats, s: Floats) -> Floats:
    k = np.clip(np.searchsorted(ends, s, "right") - 1, 0, len(ends) - 2)
    width = np.diff(ends)
    t = np.clip((s - ends[k]) / np.where(width > 0, width, 1.0)[k], 0.0, 1.0)
    return at[k] + t[..., None] * (at[k + 1] - at[k])
