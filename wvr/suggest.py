"""Transfer functions suggested by a volume's own samples, by the kind of data that they look like."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from .color import linear_rgb
from .statistics import BINS, Kind, Statistics
from .transfer_function import TransferFunction
from .volume import Volume

# The foreground is four bands of scalars, at these fractions of it; a ray through all that is in a band shall cross on
# average this optical depth. The rare and dense thus stand out of the common and thin, and sparse data get more opacity
# than solid ones.
FRACTIONS = np.array([0.05, 0.25, 0.5, 0.8])
SHARES = np.array([0.02, 0.4, 0.8, 0.97])
DEPTHS = np.array([0.4, 1.4, 2.5, 4.0])
MAX_OPACITY = 0.9
# A part of the range without samples that separates an object from its background.
GAP = 0.1
# Depth of a label, and of one that is more than this part of all, in which others may lie.
SOLID, VEIL, LARGE = 8.0, 0.8, 0.4
# Part of the samples that must be far below a background, and as many far above, for both to be shown.
AROUND = 0.02
# Of what is bright in murk: the parts of it below the control points, and their depths.
MURKY_SHARES, MURKY_DEPTHS = np.array([0.2, 0.4, 0.65, 0.9]), np.array([1.0, 6.0, 8.0, 8.0])
# Half the width of a field's shells, the distance of two [their whole range], and the depths of a shell and of what is
# between two, in those of a band.
THIN, SEPARATE, SHELL, BETWEEN = 0.02, 0.06, 1.6, 0.1

PALETTES = {
    "bands": ["#5d9a63", "#bb5a34", "#efaa48", "#fff4da"],
    "warm": ["#4f1529", "#9a332b", "#d5622c", "#f2b24c"],
}
SURFACE_COLORS = ["#4f7fc0", "#e0952f", "#fff0d0"]
MURKY_COLORS = ["#6e1f2a", "#b8402f", "#e3925a", "#fff0d8"]
# Below and above the usual value of a field, from near to far.
COLD, HOT = ["#4f74e0", "#3fa9e0", "#86e2ea", "#ecffff"], ["#b45ad8", "#f2608a", "#fba14e", "#fff3c0"]
# Of labels: distinguishable next to each other (Matplotlib's tab10, brighter), then around the circle of hues.
LABEL_COLORS = ["#e4572e", "#4c9be8", "#7bc950", "#f3c13a", "#b57edc", "#2ec4b6", "#f78fb3", "#c8a27c", "#9aa5b1"]
# Scalars of tissues [HU], and the depths of fat, skin and soft tissue, of contrast medium and cancellous bone, and of
# bone.
TISSUES = [-450.0, -150.0, 130.0, 350.0, 900.0]
TISSUE_COLORS = ["#b5764a", "#c98a62", "#b8402f", "#e3b57c", "#fff6e6"]
TISSUE_DEPTHS = [0.5, 2.0, 5.0]


class Suggestion(NamedTuple):
    """What to show of a volume: transfer functions by name, the best first, and whether light tells surfaces."""

    kind: Kind
    functions: dict[str, TransferFunction]
    surfaces: bool


# Samples up to here have sums and differences.
LARGEST = 1e304
# Of volumes that are still there, with the version of their samples.
_made: WeakKeyDictionary[Volume, tuple[int, Suggestion]] = WeakKeyDictionary()


def suggestion(volume: Volume) -> Suggestion:
    """For a volume; see :func:`wvr.presets.suggest`. Made once for the samples that there are."""
    volume.look()
    low, high = volume.range
    if max(abs(low), abs(high)) > LARGEST:
        raise ValueError(
            f"volume must have samples of sizes up to {LARGEST:.0e} to suggest a transfer function, has {low:.3g} to "
            f"{high:.3g}; scale them, or give a transfer function"
        )
    version, made = _made.get(volume, (-1, None))
    if made is None or version != volume.version:
        made = _suggested(Statistics.of(volume))
        _made[volume] = volume.version, made
    return made


def _suggested(found: Statistics) -> Suggestion:
    makers: dict[Kind, Callable[[Statistics], Suggestion]] = {
        "labels": _labels,
        "ct": _tissues,
        "object": _object,
        "field": _field,
    }
    return makers[found.kind](found)


def _labels(found: Statistics) -> Suggestion:
    """Each label a solid of a colour of its own; that of the rim, or 0, is nothing."""
    levels = found.levels
    values, counts = np.unique(found.rim, return_counts=True)
    common = float(values[np.argmax(counts)])
    background = common if counts.max() >= 0.5 * found.rim.size or levels[0] != 0 else 0.0
    shown = [level for level in levels if level != background]
    colors = label_colors(len(shown))
    if len(shown) == 1:
        colors = ["#e9dcc0"]
    seen = found.samples != background
    points = []
    for i, level in enumerate(levels):
        # A label's samples, and half the way to the next: surfaces are where trilinear values cross it.
        below = (levels[i - 1] + level) / 2 if i else level - 0.5
        above = (level + levels[i + 1]) / 2 if i + 1 < len(levels) else level + 0.5
        color, opacity = "black", 0.0
        if level != background:
            own = found.samples == level
            veils = len(shown) > 1 and own.sum() > LARGE * seen.sum()
            chord = _mean_chord(own, found.lengths)
            color = colors[shown.index(level)]
            opacity = float(min(-np.expm1(-(VEIL if veils else SOLID) / max(chord, 1.0)), MAX_OPACITY))
        points += [(below, color, opacity), (above, color, opacity)]
    return Suggestion("labels", {"labels": TransferFunction(points), **_bands(found)}, True)


def label_colors(count: int) -> list[str]:
    """So many colours that can be told apart, as far as they can."""
    from matplotlib.colors import hsv_to_rgb, to_hex

    golden = 0.618034
    more = [to_hex(hsv_to_rgb(((0.1 + golden * i) % 1, 0.5 + 0.2 * (i % 2), 0.95))) for i in range(count)]
    return (LABEL_COLORS + more)[:count]


def _tissues(found: Statistics) -> Suggestion:
    """CT in Hounsfield units: skin and soft tissue as a veil, bone and contrast medium solid."""
    samples = found.samples
    bounds = [(TISSUES[0], TISSUES[2]), (TISSUES[2], TISSUES[3]), (TISSUES[3], np.inf)]
    veil, vessels, bone = (
        _opacity(samples, *band, depth, found.lengths) for band, depth in zip(bounds, TISSUE_DEPTHS, strict=True)
    )
    opacities = [veil, veil, max(veil, min(vessels, 0.3)), max(veil, bone)]
    points = [(TISSUES[0], TISSUE_COLORS[0], 0.0)]
    points += list(zip(TISSUES[1:], TISSUE_COLORS[1:], opacities, strict=True))
    return Suggestion("ct", {"tissues": TransferFunction(points), **_bands(found)}, True)


def _object(found: Statistics) -> Suggestion:
    """What differs from the background of the rim."""
    start, (lo, hi) = found.background, found.span
    assert start is not None
    beside = max(0.1 * (hi - lo), 5 * found.noise)
    around = min(np.mean(found.finite < start - beside), np.mean(found.finite > start + beside)) > AROUND
    if around or (found.padding is not None and not found.volume.whole):
        return _field(found, start)
    functions = _bands(found)
    knots = next(iter(functions.values())).knots
    sides = (-np.inf, knots[-1]) if knots[0] < start else (knots[0], np.inf)
    # With noise, and more between it and the foreground than in that, nothing ends anywhere: veils are but murk.
    clear = start + 5 * found.noise + 0.02 * (hi - lo)
    bright, dim = np.mean(found.finite > knots[0]), np.mean((found.finite > clear) & (found.finite <= knots[0]))
    if found.noise and AROUND < bright < dim:
        functions = {"solid": _solid(found, float(knots[0])), **functions}
    return Suggestion("object", functions, found.smooth(*sides))


def _solid(found: Statistics, start: float) -> TransferFunction:
    """What is above ``start``, from its darkest fifth on opaque within a few samples; colours by how rare it is."""
    knots = np.quantile(found.finite[found.finite > start], MURKY_SHARES)
    knots = np.maximum(knots, start) + (found.span[1] - start) * 1e-3 * np.arange(1, 5)
    limits = [start, *(knots[:-1] + knots[1:]) / 2, np.inf]
    opacities = [
        _opacity(found.samples, *band, found.lengths) for band in zip(limits, limits[1:], MURKY_DEPTHS, strict=False)
    ]
    ramp = np.minimum.accumulate(opacities[::-1])[::-1].tolist()
    points = zip([start, *knots], [MURKY_COLORS[0], *MURKY_COLORS], [0.0, *ramp], strict=True)
    return TransferFunction(list(points))


def _bands(found: Statistics) -> dict[str, TransferFunction]:
    """Bands, a ramp and surfaces of the foreground, above the background or below."""
    samples, finite, span = found.samples, found.finite, found.span
    counts, edges = np.histogram(finite, BINS, span)
    background = float(edges[np.argmax(counts)]) if found.background is None else found.background
    sign = 1
    if background > (span[0] + span[1]) / 2:
        # A bright background is a dark one in the negative.
        sign, counts, edges, samples, finite = -1, counts[::-1], -edges[::-1], -samples, -finite
        background = -background
    start, end = _foreground(counts, edges, finite, background)
    return _banded(samples, start, end, found.lengths, sign)


def _banded(
    samples: NDArray[np.float64], start: float, end: float, lengths: NDArray[np.float64], sign: int
) -> dict[str, TransferFunction]:
    # Half-way between fractions of the range and of the samples: what is rare does not take the contrast of the rest.
    inside = samples[(samples > start) & (samples <= end)]
    shares = np.quantile(inside, SHARES) if inside.size else start + (end - start) * FRACTIONS
    knots = (start + (end - start) * FRACTIONS + shares) / 2
    knots = np.maximum.accumulate(knots) + (end - start) * 1e-3 * np.arange(4)
    limits = [start, *(knots[:-1] + knots[1:]) / 2, np.inf]
    bands = [_opacity(samples, *band, lengths) for band in zip(limits, limits[1:], DEPTHS, strict=False)]
    # Less of a quantity is never more opaque, however little there is in its band.
    ramp = np.minimum.accumulate(bands[::-1])[::-1]
    suggestions = {}
    for name, palette in PALETTES.items():
        points = list(zip([start, *knots], [palette[0], *palette], [0.0, *ramp.tolist()], strict=True))
        suggestions[name] = TransferFunction([(sign * s, c, o) for s, c, o in points][::sign])
    half, levels = (end - start) / 10, start + (end - start) * FRACTIONS[1:]
    # A triangle has half the optical depth of its peak; half again on top, since a ray meets but part of a shell.
    peaks = [
        _opacity(samples, s - half, s + half, 3 * depth, lengths) for s, depth in zip(levels, DEPTHS[:-1], strict=True)
    ]
    suggestions["surfaces"] = TransferFunction.isosurfaces(
        sign * levels, [linear_rgb(color) for color in SURFACE_COLORS], peaks, width=2 * half
    )
    return suggestions


def _field(found: Statistics, usual: float | None = None) -> Suggestion:
    """A quantity that is everywhere: what is far from the usual value, on both sides if there is much on both."""
    samples, (lo, hi) = found.samples, found.span
    usual = _mode(found.finite, found.span) if usual is None else usual
    above, below = (hi - usual) / (hi - lo), (usual - lo) / (hi - lo)
    low, high = np.quantile(found.finite, [0.001, 0.999]).tolist()
    points: list[tuple[float, str, float]] = []
    # Between padding and the rest trilinear values pass through all that is below.
    if below > 0.15 and found.padding is None:
        points += _side(-samples, -usual, -low, found.lengths, COLD, -1)
    if above > 0.15:
        points += _side(samples, usual, high, found.lengths, HOT, 1)
    if not points:
        return Suggestion("field", _bands(found), found.smooth(lo))
    function = TransferFunction(sorted(points, key=lambda point: point[0]))
    edges = [point[0] for point in points if point[2] > 0]
    return Suggestion(
        "field", {"deviation": function, **_bands(found)}, found.smooth(min(edges) if above > 0.15 else lo)
    )


def _side(
    samples: NDArray[np.float64],
    usual: float,
    end: float,
    lengths: NDArray[np.float64],
    palette: list[str],
    sign: int,
) -> list[tuple[float, str, float]]:
    """Control points of what is above ``usual``, up to ``end``, of a field times ``sign``."""
    distant = samples[samples > usual]
    start = max(usual + 0.15 * (end - usual), float(np.quantile(distant, 0.6)))
    start = min(start, usual + 0.7 * (end - usual))
    # Four thin shells, and nearly nothing between: what is smooth everywhere has no other surfaces. Half-way between
    # fractions of the range and of the samples, so that each has something to show, and apart.
    width = end - start
    inside = samples[(samples > start) & (samples <= end)]
    fractions = (np.quantile(inside, SHARES) - start) / width if inside.size else FRACTIONS
    apart = SEPARATE * np.arange(4)
    fractions = np.maximum.accumulate((fractions + FRACTIONS) / 2 - apart) + apart
    points, half = [(start, palette[0], 0.0)], THIN * width
    for level, color, depth in zip((start + width * fractions).tolist(), palette, DEPTHS, strict=True):
        veil = _opacity(samples, level - half, level + 10 * half, BETWEEN * depth, lengths)
        shell = _opacity(samples, level - half, level + half, SHELL * depth, lengths)
        points += [(level - half, color, veil), (level, color, shell), (level + half, color, veil)]
    points[-1] = (points[-1][0], palette[-1], points[-2][2])  # the innermost is solid
    return [(sign * s, c, o) for s, c, o in points]


def _mode(finite: NDArray[np.float64], span: tuple[float, float]) -> float:
    """The commonest value, of a histogram that is smoothed a little."""
    counts, edges = np.histogram(finite, BINS, span)
    smooth = np.convolve(counts, np.ones(9) / 9, "same")
    peak = int(np.argmax(smooth))
    return float((edges[peak] + edges[peak + 1]) / 2)


def _foreground(
    counts: NDArray[np.int64], edges: NDArray[np.float64], finite: NDArray[np.float64], background: float
) -> tuple[float, float]:
    """Where the noise of the background ends, and where all but the highest 1 % of the foreground does.

    The noise ends at the knee of the logarithmic histogram right of its mode, which is where it is farthest below the
    straight line to its end (the triangle method of Zack, Rogers and Latt, J. Histochem. Cytochem. 25(7), 1977), or
    where the counts fall to 0.5 % of the mode's, and at the latest where 8 % of the samples are left.
    """
    first = int(np.clip(np.searchsorted(edges, background, side="right") - 1, 0, len(counts) - 1))
    near = slice(max(0, first - 3), first + 4)
    mode = near.start + int(np.argmax(counts[near]))
    # Integers have fewer values than there are bins.
    filled = mode + np.flatnonzero(counts[mode:])
    falling = np.minimum.accumulate(counts[filled])
    ends = edges[filled + 1]
    above = np.cumsum(counts[filled]) - counts[mode]
    last = int(np.searchsorted(above, 0.999 * above[-1]))
    x, y = ends[: last + 1], np.log(falling[: last + 1])
    knee = np.argmin((x - x[0]) / ((x[-1] - x[0]) or 1.0) - (y[-1] - y) / ((y[0] - y[-1]) or 1.0))
    low = ends[falling < 0.005 * falling[0]]
    # What lies apart from the background is no noise of it.
    apart = ends[:-1][np.diff(edges[filled]) > GAP * (edges[-1] - edges[0])]
    start = min(ends[knee], *low[:1], *apart[:1], max(np.quantile(finite, 0.92), ends[0]))
    bin_width = edges[1] - edges[0]
    beyond = finite[finite > start]
    end = np.quantile(beyond, 0.99) if beyond.size else start
    return float(start), float(max(end, start + bin_width))


def _opacity(
    samples: NDArray[np.float64], lower: float, upper: float, depth: float, lengths: NDArray[np.float64]
) -> float:
    """Opacity of a voxel such that a ray crosses ``depth`` on average in the samples between the two."""
    chord = _mean_chord((samples >= lower) & (samples < upper), lengths)
    return float(np.minimum(-np.expm1(-depth / max(chord, 1.0)), MAX_OPACITY))


def _mean_chord(inside: NDArray[np.bool_], lengths: NDArray[np.float64]) -> float:
    """Mean length [smallest voxel spacings] within the samples ``inside`` of the axis-parallel rays that hit any.

    ``lengths`` are the distances of neighbours along z, y, x. Rays are equally dense along the three axes, so that a
    thin structure counts as seen from its broad side, as in Cauchy's mean chord of 4 volume / surface.
    """
    count = np.count_nonzero(inside)
    hits = np.array([np.count_nonzero(inside.any(axis=axis)) for axis in range(3)])
    return float(3 * count / np.sum(hits / lengths)) if count else 0.0
