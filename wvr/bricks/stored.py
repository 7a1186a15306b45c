"""A volume whose samples stay in a store, and are read block by block as they are seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from ..cached import cached_property
from ..cancel import aside
from ..field.base import Field
from ..io.conventions import PLAIN, Meaning
from ..keep import Keeper
from ..kernels.field.grid import Grid
from ..memory import free_host_memory, gib
from ..pose import Posed, pose_of
from ..samples import DTYPES, NanPolicy, times_power
from ..validation import choice, computed
from ..volume import Volume
from .grid import Index
from .ranges import BlockRanges

# Blocks of several chunks have at most so many samples along an axis, and in all.
ALONG, IN_ALL = 128, 1 << 22
# Of blocks along z, y, x, which chunks they are of: texts (bz, by, bx) that change with those.
Marked = Callable[[list[list[range]]], NDArray[np.str_]]
# Bytes of a preview at most, and of samples that stand in for one.
PREVIEW = 1 << 28


@dataclass(frozen=True, eq=False)
class Samples:
    """An array that is sliced when it is read, with its axes in any order and others that are fixed.

    Attributes
    ----------
    array
        Anything with ``shape``, ``dtype`` and slicing.
    name
        What errors call it.
    axes
        Which of its axes are z, y, x.
    fixed
        Index along each other axis.
    chunks
        Lengths of chunks along z, y, x; None where any part is read alike.
    meaning
        What stored samples mean.
    marks
        What tells whether chunks changed, as of now; None where nothing does.
    """

    array: Any
    name: str
    axes: tuple[int, int, int] = (0, 1, 2)
    fixed: tuple[tuple[int, int], ...] = ()
    chunks: tuple[tuple[int, ...], ...] | None = None
    meaning: Meaning = PLAIN
    marks: Callable[[], Marked] | None = None

    @property
    def identity(self) -> str:
        """Which part of which array, but for where that is."""
        given = [f"{axis}:{at}" for axis, at in self.fixed]
        axes = "".join(map(str, self.axes))
        scale = (self.meaning.slope, self.meaning.intercept)
        known = f"{self.shape} {self.dtype} axes {axes} {' '.join(given)} scale {scale}"
        return known if self.meaning == Meaning(*scale) else f"{known} {self.meaning}"

    @property
    def shape(self) -> tuple[int, int, int]:
        return tuple(int(self.array.shape[axis]) for axis in self.axes)  # type: ignore[return-value]

    @cached_property
    def dtype(self) -> np.dtype:
        """Of samples as they are read."""
        stored = self.meaning.dtype(np.dtype(self.array.dtype).newbyteorder("="))
        if stored.kind == "b":
            return np.dtype("uint8")
        if stored.kind in "iu" and stored.name not in DTYPES:
            return np.dtype("float64")
        if stored.name not in DTYPES:
            raise TypeError(f"{self.name} has dtype {stored}; accepted are bool, integers, {', '.join(DTYPES)}")
        return stored

    def read(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray:
        """Samples from ``low`` to ``high``, both included, along x, y, z: (nz, ny, nx)."""
        key: list[Any] = [slice(None)] * len(self.array.shape)
        for axis, at in self.fixed:
            key[axis] = at
        for axis, a, b in zip(self.axes, low[::-1].tolist(), high[::-1].tolist(), strict=True):
            key[axis] = slice(a, b + 1)
        part = np.asanyarray(computed(self.array[tuple(key)]))
        if np.ma.is_masked(part):
            if part.dtype.kind != "f":
                raise ValueError(f"{self.name} has masked samples, which {part.dtype} does not hold: make it float32")
            part = part.filled(np.nan)
        part = np.asarray(part)
        left = [axis for axis in range(len(key)) if axis not in dict(self.fixed)]
        part = part.transpose([left.index(axis) for axis in self.axes])
        said, shape = np.dtype(self.array.dtype), tuple((high - low + 1)[::-1].tolist())
        if part.dtype.newbyteorder("=") != said.newbyteorder("=") or part.shape != shape:
            # As of Dask, whose arrays are what they were said to be, and are computed later.
            raise ValueError(f"{self.name} says samples {shape} of {said}, and has {part.shape} of {part.dtype}")
        return np.ascontiguousarray(self.meaning.values(part), self.dtype)


class StoredVolume(Posed, Field):
    """Scalar samples in a store and their place in the world: what :func:`wvr.open` returns.

    It is rendered in bricks, one for each block of its chunks, those that are seen, read while others are rendered.
    With ``ranges`` (:func:`wvr.build_ranges`) blocks with nothing to see are not read.

    Parameters
    ----------
    samples
        How they are read.
    spacing, origin, direction, nan
        As of :class:`Volume`.
    anatomical
        Where the world's axes run in a patient, ``"LPS"``, ``"RAS"`` or empty.

    Attributes
    ----------
    ranges
        Smallest and largest sample of each block; None where they are not known.
    """

    stored = True
    #: Files that were read as a whole.
    files: tuple[Path, ...] = ()
    #: Why its place in the world is not known.
    unplaced = ""

    def __init__(
        self,
        samples: Samples,
        spacing: ArrayLike = (1.0, 1.0, 1.0),
        origin: ArrayLike = (0.0, 0.0, 0.0),
        direction: ArrayLike | None = None,
        nan: NanPolicy = "error",
        anatomical: str = "",
    ):
        self.samples = samples
        self.spacing, self.origin, self.direction = pose_of(spacing, origin, direction)
        self.nan = choice(nan, "nan", ("error", "transparent"))
        self.anatomical = anatomical
        self.ranges: BlockRanges | None = None
        self.coarse: StoredVolume | None = None
        self.place: Path | None = None  # of the file of ranges
        self.exponent = 0
        self.version = 0
        self._marks: NDArray[np.str_] | None = None
        self._starts = _blocks(samples)
        if 0 in self.shape:
            raise ValueError(f"{samples.name} must not be empty, got shape {self.shape}")

    @property
    def shape(self) -> tuple[int, int, int]:
        """``(nz, ny, nx)``."""
        return self.samples.shape

    @property
    def dtype(self) -> np.dtype:
        """Of samples as they are read."""
        return np.dtype("float64") if self.exponent else self.samples.dtype

    @property
    def starts(self) -> tuple[tuple[int, ...], ...]:
        """First sample of each block along x, y, z, and one past the last."""
        return self._starts if self.ranges is None else self.ranges.starts

    @property
    def blocks_along(self) -> Index:
        """Blocks along x, y, z."""
        return tuple(len(along) - 1 for along in self.starts)  # type: ignore[return-value]

    def block(self, index: Index) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and last sample of a block along x, y, z."""
        pairs = [along[i : i + 2] for along, i in zip(self.starts, index, strict=True)]
        return np.array([a for a, _ in pairs]), np.array([b - 1 for _, b in pairs])

    def spans(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> list[Any]:
        """Which blocks the samples from ``low`` to ``high`` are of, along x, y, z."""
        pairs = zip(self.starts, low, high, strict=True)
        return [np.arange(*np.searchsorted(along, (a, b), "right") - (1, 0)).tolist() for along, a, b in pairs]

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest sample; where ranges are not known, those that the dtype holds, and of floating-point
        samples those of all blocks, which are read for it.
        """
        if self.ranges is None or not self.ranges.known.all():
            if self.samples.dtype.kind in "iu":
                limits = np.iinfo(self.samples.dtype)
                return float(limits.min), float(limits.max)
            from .ranges import in_memory

            self.ranges = in_memory(self)
        low, high = times_power(np.array(self.ranges.limits()), self.exponent).tolist()
        return low, high

    @property
    def half(self) -> Grid:
        finite = self.samples.dtype.kind != "f" or self.nan == "error"
        return Grid(wp.dtype_from_numpy(self.dtype), finite)

    @property
    def shifts(self) -> bool:  # type: ignore[override]
        return self.dtype.kind == "f"

    @property
    def whole(self) -> bool:  # type: ignore[override]
        return not self.shifts

    @property
    def nbytes(self) -> int:  # type: ignore[override]
        return math.prod(self.shape) * self.dtype.itemsize

    def region(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray:
        """The samples from ``low`` to ``high``, both included, along x, y, z.

        Raises
        ------
        OSError
            Where they cannot be read; it says which.
        ValueError
            For NaN or infinite ones, of a volume with ``nan="error"``.
        """
        where = ", ".join(f"{axis} {a} to {b}" for axis, a, b in zip("xyz", low.tolist(), high.tolist(), strict=True))
        try:
            samples = aside(self.samples.read, low, high)
        except Exception as error:
            way = 'missing="bound" renders without them'
            if self.samples.dtype.kind == "f" and (self.ranges is None or not self.ranges.known.all()):
                # What they may be nobody knows.
                way += ", by ranges (wvr.build_ranges) of a time when they could be read"
            raise OSError(
                f"{self.samples.name}: the samples at {where} could not be read "
                f"({type(error).__name__}: {error}); {way}"
            ) from error
        missing = "missing, " if self.samples.meaning.sparse else ""
        if samples.dtype.kind == "f" and self.nan == "error" and not np.all(np.isfinite(samples)):
            raise ValueError(
                f"{self.samples.name} has {missing}NaN or infinite samples at {where}; clean it, or pass "
                f'nan="transparent" to wvr.open to render the cells that touch one as nothing'
            )
        return times_power(samples, self.exponent) if self.exponent else samples

    def look(self) -> None:
        """Notice what was written into the store since this was called last, by the sizes and times of its files, where
        it has such; what is known of blocks that changed is then forgotten. A renderer asks before each frame.
        """
        if self.samples.marks is None:
            return
        from .ranges import marks_of

        marks = marks_of(self)
        changed = np.zeros(marks.shape, bool)
        if self.ranges is not None:
            changed |= self.ranges.known & (self.ranges.marks != marks)
        if self._marks is not None and self._marks.shape == marks.shape:
            changed |= self._marks != marks
        if changed.any():
            self.changed(changed)
        self._marks = marks

    def changed(self, which: NDArray[np.bool_] | None = None) -> None:
        """Say that samples changed: of some blocks, (bz, by, bx), or of all. Ranges of those are forgotten."""
        self.version += 1
        vars(self).pop("range", None)
        vars(self).pop("preview", None)
        vars(self).pop("some", None)
        if self.ranges is not None:
            self.ranges.known &= False if which is None else ~which

    def struct(self, keep: Keeper, shift: float) -> Any:
        """Refused: its samples are not at hand."""
        raise TypeError("volume must be in memory here, one of wvr.open is not: read a part of it, or a coarser level")

    def scaled(self, exponent: int) -> StoredVolume:
        """The same with samples times ``2**exponent``, in float64."""
        other = StoredVolume(self.samples, self.spacing, self.origin, self.direction, self.nan, self.anatomical)
        other.ranges, other.exponent = self.ranges, exponent
        return other

    @cached_property
    def preview(self) -> Volume | None:
        """The same with fewer samples, in memory: the coarsest level of a pyramid; None without one."""
        coarse = self.coarse
        return None if coarse is None or coarse.nbytes > PREVIEW else coarse.loaded()

    @cached_property
    def some(self) -> Volume:
        """Samples that stand in for a preview where there is none: all of few, else some."""
        from .sampled import sampled

        return sampled(self, PREVIEW)

    def loaded(self) -> Volume:
        """The same with all of its samples in memory.

        Raises
        ------
        MemoryError
            Where there is not enough of it.
        """
        if self.nbytes > free_host_memory():
            raise MemoryError(
                f"{self.samples.name} takes {gib(self.nbytes)} in memory, of which {gib(free_host_memory())} are free: "
                f"take a coarser level, if it has some"
            )
        last = np.array(self.shape[::-1]) - 1
        samples = self.region(np.zeros(3, np.int64), last)
        volume = Volume(samples, self.spacing, self.origin, self.direction, self.nan)
        volume.anatomical = self.anatomical
        return volume

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        known = "" if self.ranges is None else ", ranges known"
        blocks = " x ".join(map(str, self.blocks_along))
        spacing = tuple(self.spacing.tolist())
        return f"StoredVolume(x={nx}, y={ny}, z={nz}, {self.dtype}, spacing={spacing}, {blocks} blocks{known})"

    def at(self, **changes: Any) -> StoredVolume:
        """The same with other samples; what is known of these is not of those."""
        samples = replace(self.samples, **changes)
        return StoredVolume(samples, self.spacing, self.origin, self.direction, self.nan, self.anatomical)


def _blocks(samples: Samples) -> tuple[tuple[int, ...], ...]:
    """Starts of blocks of whole chunks along x, y, z, as large as is good to render, where chunks are smaller."""
    shape = samples.shape
    chunks = samples.chunks or tuple(tuple([ALONG] * (n // ALONG) + [n % ALONG] * (n % ALONG > 0)) for n in shape)
    starts = [np.concatenate([[0], np.cumsum(along)]).tolist() for along in chunks]
    factors = [1, 1, 1]
    while True:
        lengths = [max(np.diff(along[::factor]), default=1) for along, factor in zip(starts, factors, strict=True)]
        total = int(np.prod(lengths))
        grow = [
            a for a in range(3) if 2 * lengths[a] <= ALONG and factors[a] < len(starts[a]) - 1 and 2 * total <= IN_ALL
        ]
        if not grow:
            break
        factors[min(grow, key=lambda a: lengths[a])] *= 2
    merged = [[*along[:-1:factor], along[-1]] for along, factor in zip(starts, factors, strict=True)]
    for along in merged:
        if len(along) > 2 and along[-1] - along[-2] == 1:
            # A block of one sample has no cells of its own.
            del along[-2]
    return tuple(tuple(along) for along in reversed(merged))
