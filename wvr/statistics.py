"""What a volume's samples say of it: background, padding, noise, and which kind of data it may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .cached import cached_property
from .volume import Volume

Kind = Literal["labels", "ct", "object", "field"]

SAMPLES = 128  # at most, along an axis, are looked at
BINS = 256
# Ranges down to here are so many numbers that there are bins.
LEAST = 1e-316
# So many labels at most; so many neighbours of all that are not both background have the same.
MOST_LABELS, ALIKE = 256, 0.75
# A padding is at least this part of all samples and at most that, and so far from all others [their range].
PADDED, PADDING_MOST, APART = 0.005, 0.5, 0.05
# Of the rim, so much is background if there is any.
RIM = 0.4


@dataclass(frozen=True, eq=False)
class Statistics:
    """Samples of a volume, at most 128 along an axis and equally spaced, and what they say.

    Attributes
    ----------
    samples
        (nz, ny, nx) float64; NaN where they are padding or not finite.
    strides
        Between the samples, along z, y, x.
    span
        Range of the samples but for one in 10 000 at either end, if any are left then.
    padding
        The value that stands for no data, or None.
    """

    volume: Volume
    samples: NDArray[np.float64]
    strides: list[int]
    span: tuple[float, float]
    padding: float | None

    @classmethod
    def of(cls, volume: Volume) -> Statistics:
        """Those of a volume.

        Raises
        ------
        ValueError
            For one with fewer than two different finite samples.
        """
        lo = float("nan")
        # All samples, where those that are looked at are all the same.
        for most in (SAMPLES, max(volume.shape)):
            strides = [-(-n // most) for n in volume.shape]
            picked = volume.host()[tuple(slice(None, None, step) for step in strides)].astype(np.float64)
            samples = np.where(np.isfinite(picked), picked, np.nan)
            finite = samples[np.isfinite(samples)]
            if finite.size == 0:
                continue
            lo, hi = _span(finite)
            # Closer than this, float64 cannot keep the control points apart.
            if hi - lo <= max(1e-12 * max(abs(lo), abs(hi)), LEAST):
                continue
            padding = _padding(finite)
            if padding is not None:
                samples[samples == padding] = np.nan
                lo, hi = _span(samples[np.isfinite(samples)])
                if hi - lo <= max(1e-12 * max(abs(lo), abs(hi)), LEAST):
                    return cls(volume, np.where(np.isfinite(picked), picked, np.nan), strides, _span(finite), None)
            return cls(volume, samples, strides, (lo, hi), padding)
        raise ValueError(
            f"volume must have at least two different finite samples to suggest a transfer function, all are {lo:g}; "
            f"give a transfer function, or a colour map with clim=(low, high) and an opacity"
        )

    @cached_property
    def finite(self) -> NDArray[np.float64]:
        return self.samples[np.isfinite(self.samples)]

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Distances of neighbours along z, y, x [smallest voxel spacing]."""
        steps = np.linalg.norm(self.volume.index_to_world[:3, :3], axis=0)[::-1]
        return np.array(self.strides) * steps / self.volume.smallest_spacing

    @cached_property
    def rim(self) -> NDArray[np.float64]:
        """Samples at the faces of the box (of axes with several), and next to padding; padding left out."""
        values = self.samples
        axes = [axis for axis in range(3) if values.shape[axis] > 2]
        faces = [np.take(values, side, axis).ravel() for axis in axes for side in (0, -1)]
        if self.padding is not None:
            absent = np.isnan(values)
            for axis in axes:
                ahead, behind = (np.take(absent, span, axis) for span in _pairs(values.shape[axis]))
                low, high = (np.take(values, span, axis) for span in _pairs(values.shape[axis]))
                faces += [low[~ahead & behind], high[ahead & ~behind]]
        rim = np.concatenate(faces) if faces else values.ravel()
        rim = rim[np.isfinite(rim)]
        return rim if rim.size >= 16 else self.finite

    @cached_property
    def levels(self) -> NDArray[np.float64]:
        """Different values, if all are whole numbers and there are at most 256; else none."""
        if not self.volume.whole:
            return np.empty(0)
        values = np.unique(self.finite)
        return values if len(values) <= MOST_LABELS else np.empty(0)

    @cached_property
    def background(self) -> float | None:
        """What surrounds the object: the commonest value at the rim, if most of the rim is about like it."""
        rim, (lo, hi) = self.rim, self.span
        counts, edges = np.histogram(rim, BINS, (lo, hi))
        mode = int(np.argmax(counts))
        near = np.abs(rim - (edges[mode] + edges[mode + 1]) / 2) <= 0.06 * (hi - lo)
        return float(np.median(rim[near])) if near.mean() >= RIM else None

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the background, as of a normal distribution by its median; 0 without one."""
        if self.background is None:
            return 0.0
        return 1.4826 * float(np.median(np.abs(self.rim - self.background)))

    @cached_property
    def kind(self) -> Kind:
        """Labels (or a mask), CT in Hounsfield units, an object that is surrounded by nothing, or a field."""
        if len(self.levels) >= 2 and self._alike() >= ALIKE:
            return "labels"
        if self._hounsfield():
            return "ct"
        return "field" if self.background is None else "object"

    def _alike(self) -> float:
        """Part of the neighbours, but those that both are of the commonest value, that have the same value.

        Noise, and slopes between two values, make that small.
        """
        values = self.volume.host()
        # Next to each other in the volume, not in what was picked: a window of all samples in the middle.
        window = tuple(slice(max(0, n // 2 - 48), n // 2 + 48) for n in values.shape)
        whole = values[window]
        low, counts = np.unique(self.finite, return_counts=True)
        common = low[np.argmax(counts)]
        same = seen = 0
        for axis in range(3):
            a, b = (np.take(whole, span, axis) for span in _pairs(whole.shape[axis]))
            some = ~((a == common) & (b == common))
            seen += int(some.sum())
            same += int((some & (a == b)).sum())
        return 1.0 if seen == 0 and len(low) <= 2 else same / max(seen, 1)

    def _hounsfield(self) -> bool:
        """Whether there is air, about -1000, and soft tissue, about 0, and little below."""
        values, (lo, hi) = self.finite, self.span
        if not (-2100 < lo < -800 and 250 < hi < 32768):
            return False
        air, tissue = np.mean((values > -1100) & (values < -850)), np.mean((values > -160) & (values < 160))
        return bool(air > 0.01 and tissue > 0.02)

    def smooth(self, above: float, below: float = np.inf) -> bool:
        """Whether samples between the two vary less from one to the next than they would at random."""
        inside = (self.samples > above) & (self.samples < below)
        # In parts of the largest: no square is too large.
        some = self.samples[inside].astype(np.float64)
        largest = float(np.abs(some).max(initial=0.0)) or 1.0
        spread = float(np.std(some / largest)) if some.size > 8 else 0.0
        if spread == 0:
            return True
        differences = []
        values = self.volume.host()
        window = tuple(slice(max(0, n // 2 - 48), n // 2 + 48) for n in values.shape)
        whole = values[window].astype(np.float64)
        for axis in range(3):
            a, b = (np.take(whole, span, axis) for span in _pairs(whole.shape[axis]))
            both = (a > above) & (b > above) & (a < below) & (b < below)
            differences.append(a[both] - b[both])  # none of infinite ones
        steps = np.concatenate(differences)
        return steps.size < 8 or float(np.sqrt(np.mean((steps / largest) ** 2))) < 0.9 * np.sqrt(2) * spread


def _pairs(n: int) -> tuple[range, range]:
    """Indices of all but the last, and of those behind them."""
    return range(n - 1), range(1, n)


def _span(finite: NDArray[np.float64]) -> tuple[float, float]:
    lo, hi = float(np.quantile(finite, 1e-4, method="lower")), float(np.quantile(finite, 1 - 1e-4, method="higher"))
    return (float(finite.min()), float(finite.max())) if lo == hi else (lo, hi)


def _padding(finite: NDArray[np.float64]) -> float | None:
    """The lowest value, where it is not rare, and all others, which are most, lie far above it."""
    lowest = finite.min()
    others = finite[finite > lowest]
    part = 1 - others.size / finite.size
    if not (PADDED <= part <= PADDING_MOST) or others.size < 2:
        return None
    least, most = others.min(), np.quantile(others, 0.999)
    # Levels of few values are all as far apart.
    gaps = np.diff(np.unique(np.quantile(others, np.linspace(0, 1, 65), method="lower")))
    usual = float(np.median(gaps)) if gaps.size else 0.0
    return float(lowest) if least - lowest > max(APART * (most - least), 3 * usual) else None
