"""Named transfer functions, and transfer functions suggested by a volume's own histogram.

The CT presets are in Hounsfield units (HU; water 0, air -1000). The ranges of tissues behind them are those of
textbooks (Buzug, Computed Tomography, Springer 2008; Prokop and Galanski, Spiral and Multislice Computed Tomography of
the Body, Thieme 2003), in HU:

==================  ==============  ==========================================
air                 -1000
lung                -950 .. -550    towards -500 with blood, vessels up to soft tissue
fat                 -100 .. -50
water               0
soft tissue, blood  10 .. 70        muscle, liver, kidney, brain, heart
iodine in vessels   100 .. 500      by dose and phase
cancellous bone     100 .. 400
cortical bone       400 .. 2000
enamel, metal       above 2000
==================  ==============  ==========================================

The others are on a relative scale from 0 (nothing) to 1 (the largest signal): magnetic resonance has no absolute one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .color import linear_rgb
from .preset_points import HOUNSFIELD, PRESETS, RELATIVE, Preset, preset_points
from .transfer_function import TransferFunction
from .volume import Volume

__all__ = ["HOUNSFIELD", "PRESETS", "RELATIVE", "Preset", "names", "preset", "suggest"]


def names() -> list[str]:
    """Names of the presets."""
    return list(PRESETS)


def preset(name: str, domain: tuple[float, float] | None = None) -> TransferFunction:
    """A transfer function with a name.

    Parameters
    ----------
    name
        One of :func:`names`: "ct-bone", "ct-soft-tissue", "ct-angiography" and "ct-lung" in Hounsfield units; "mri",
        "isosurfaces" and "simulation" on a scale from 0 to 1.
    domain
        For data on another scale: the scalars ``(lo, hi)`` of air and dense cortical bone (-1000 and 2000 HU), or of
        0 and 1; the preset is mapped affinely. None takes the preset's own scale.

    Returns
    -------
    TransferFunction
        Its opacities are those of the smallest voxel spacing.

    Raises
    ------
    ValueError
        For an unknown name, or ``domain`` not finite with lo < hi.
    """
    return TransferFunction(preset_points(name, domain))


# Suggestions. The foreground is four bands of scalars, at these fractions of it; a ray through all that is in a band
# shall cross on average this optical depth. The rare and dense thus stand out of the common and thin, and sparse data
# get more opacity than solid ones.
FRACTIONS = np.array([0.05, 0.25, 0.5, 0.8])
DEPTHS = np.array([0.35, 1.0, 2.0, 3.0])
MAX_OPACITY = 0.9
SAMPLES = 128  # at most, along an axis, are looked at
BINS = 256

PALETTES = {
    "bands": ["#4f7d40", "#9a4f2a", "#e8a23d", "#fff3d6"],
    "warm": ["#4f1529", "#9a332b", "#d5622c", "#f2b24c"],
}
SURFACE_COLORS = ["#4f7fc0", "#e0952f", "#fff0d0"]


def suggest(volume: Volume) -> dict[str, TransferFunction]:
    """Transfer functions fitted to the volume's own histogram, the best default first.

    The background, which is the largest mode of the histogram with its noise, is transparent; what is above it (below,
    where the background is the brighter end) is seen in four bands whose opacities follow from how much of each there
    is along a ray. ``"bands"`` has a colour for each: green, brown, gold, ivory; ``"warm"`` is a ramp from dark red to
    light yellow; ``"surfaces"`` is three isosurfaces.

    Parameters
    ----------
    volume
        At most 128^3 of its samples, equally spaced, are looked at (all, where those are all the same); those not
        finite are left out.

    Raises
    ------
    TypeError
        For anything but a volume.
    ValueError
        For a volume with fewer than two different finite samples.
    """
    if not isinstance(volume, Volume):
        raise TypeError(f"volume must be a Volume, got {type(volume).__name__}")
    strides, samples, finite, span = _look(volume)
    counts, edges = np.histogram(finite, BINS, span)
    sign = 1
    if np.argmax(counts) >= BINS // 2:
        # A bright background is a dark one in the negative.
        sign, counts, edges, samples, finite = -1, counts[::-1], -edges[::-1], -samples, -finite
    start, end = _foreground(counts, edges, finite)
    lengths = np.array(strides) * np.linalg.norm(volume.index_to_world[:3, :3], axis=0)[::-1] / volume.smallest_spacing

    def opacity(lower: float, upper: float, depth: float) -> float:
        """Opacity of a voxel such that a ray crosses ``depth`` on average in the samples between the two."""
        chord = _mean_chord((samples >= lower) & (samples < upper), lengths)
        return float(np.minimum(-np.expm1(-depth / max(chord, 1.0)), MAX_OPACITY))

    knots = start + (end - start) * FRACTIONS
    limits = [start, *(knots[:-1] + knots[1:]) / 2, np.inf]
    bands = [opacity(*band) for band in zip(limits, limits[1:], DEPTHS, strict=False)]
    # Less of a quantity is never more opaque, however little there is in its band.
    ramp = np.minimum.accumulate(bands[::-1])[::-1]
    suggestions = {}
    for name, palette in PALETTES.items():
        points = list(zip([start, *knots], [palette[0], *palette], [0.0, *ramp.tolist()], strict=True))
        suggestions[name] = TransferFunction([(sign * s, c, o) for s, c, o in points][::sign])
    half = (end - start) / 10
    # A triangle has half the optical depth of its peak; half again on top, since a ray meets but part of a shell.
    peaks = [opacity(s - half, s + half, 3 * depth) for s, depth in zip(knots[1:], DEPTHS[:-1], strict=True)]
    suggestions["surfaces"] = TransferFunction.isosurfaces(
        sign * knots[1:], [linear_rgb(color) for color in SURFACE_COLORS], peaks, width=2 * half
    )
    return suggestions


def _look(volume: Volume) -> tuple[list[int], NDArray[np.float64], NDArray[np.float64], tuple[float, float]]:
    """Strides along z, y, x, the samples at them, the finite ones, and the range of those.

    The range leaves out one sample in 10 000 at either end, if any are left then.
    """
    lo = hi = float("nan")
    for most in (SAMPLES, max(volume.shape)):
        strides = [-(-n // most) for n in volume.shape]
        samples = volume.numpy()[tuple(slice(None, None, step) for step in strides)].astype(np.float64)
        finite = samples[np.isfinite(samples)]
        if finite.size == 0:
            continue
        lo, hi = float(np.quantile(finite, 1e-4, method="lower")), float(np.quantile(finite, 1 - 1e-4, method="higher"))
        if lo == hi:
            lo, hi = float(finite.min()), float(finite.max())
        # Closer than this, float64 cannot keep the control points apart.
        if hi - lo > 1e-12 * max(abs(lo), abs(hi)):
            return strides, samples, finite, (lo, hi)
    raise ValueError(
        f"volume must have at least two different finite samples to suggest a transfer function, all are {lo:g}; "
        f"give a transfer function, or a preset with a domain"
    )


def _foreground(
    counts: NDArray[np.int64], edges: NDArray[np.float64], finite: NDArray[np.float64]
) -> tuple[float, float]:
    """Where the noise of the background ends, and where all but the highest 0.1 % of the foreground does.

    The noise ends at the knee of the logarithmic histogram right of its mode, which is where it is farthest below the
    straight line to its end (the triangle method of Zack, Rogers and Latt, J. Histochem. Cytochem. 25(7), 1977), or
    where the counts fall to 0.5 % of the mode's, and at the latest where 8 % of the samples are left.
    """
    mode = int(np.argmax(counts))
    # Integers have fewer values than there are bins.
    filled = mode + np.flatnonzero(counts[mode:])
    falling = np.minimum.accumulate(counts[filled])
    ends = edges[filled + 1]
    above = np.cumsum(counts[filled]) - counts[mode]
    last = int(np.searchsorted(above, 0.999 * above[-1]))
    x, y = ends[: last + 1], np.log(falling[: last + 1])
    knee = np.argmin((x - x[0]) / (x[-1] - x[0]) - (y[-1] - y) / ((y[0] - y[-1]) or 1.0))
    low = ends[falling < 0.005 * falling[0]]
    start = min(ends[knee], *low[:1], max(np.quantile(finite, 0.92), ends[0]))
    bin_width = edges[1] - edges[0]
    return float(start), float(max(np.quantile(finite[finite > start], 0.999), start + bin_width))


def _mean_chord(inside: NDArray[np.bool_], lengths: NDArray[np.float64]) -> float:
    """Mean length [smallest voxel spacings] within the samples ``inside`` of the axis-parallel rays that hit any.

    ``lengths`` are the distances of neighbours along z, y, x. Rays are equally dense along the three axes, so that a
    thin structure counts as seen from its broad side, as in Cauchy's mean chord of 4 volume / surface.
    """
    count = np.count_nonzero(inside)
    hits = np.array([np.count_nonzero(inside.any(axis=axis)) for axis in range(3)])
    return float(3 * count / np.sum(hits / lengths)) if count else 0.0
