"""What an editor of transfer functions draws behind its points: how many samples have which scalar."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

BINS = 256
# Samples that are looked at, along each axis at most.
SAMPLES = 128


def histogram(volume: Any) -> tuple[NDArray[np.float64], tuple[float, float]]:
    """Logarithms of the counts of samples, the largest 1, and the scalars of the first and last edge of the bins.

    Of volumes with more than 128 samples along an axis, equally spaced ones; a field without samples has no counts.
    """
    lo, hi = (float(end) for end in volume.range)
    if not lo < hi:
        lo, hi = lo - 0.5, hi + 0.5
    if not hasattr(volume, "host"):
        return np.zeros(0), (lo, hi)
    steps = [-(-n // SAMPLES) for n in volume.shape]
    samples = volume.host()[tuple(slice(None, None, step) for step in steps)]
    values = samples[np.isfinite(samples)]
    bins = BINS
    if values.dtype.kind in "iu" and hi - lo < BINS:
        # One for each whole number, centred on it: narrower ones would be empty now and then.
        lo, hi, bins = lo - 0.5, hi + 0.5, int(hi - lo) + 1
    counts, _ = np.histogram(values, bins, (lo, hi))
    heights = np.log1p(counts)
    return heights / (heights.max() or 1.0), (lo, hi)
