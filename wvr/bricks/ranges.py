"""Smallest and largest sample of each block of a store, and of its outermost layers: what need not be read is known by
these. They are kept beside the store, in a file that is built in one pass.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..files import whole_file
from ..launch import get_num_threads
from ..notices import announce
from .grid import Index

if TYPE_CHECKING:
    from .stored import StoredVolume

SUFFIX = ".ranges.npz"
VERSION = 1
# Seconds between files of what is done so far.
EVERY = 10.0
# Layers along an axis: all of a block, its first one, its last one.
ALL, FIRST, LAST = 0, 1, 2


@dataclass(eq=False)
class BlockRanges:
    """Of each block, and of its layers.

    Attributes
    ----------
    starts
        First sample of each block along x, y, z, and one past the last.
    values
        (bz, by, bx, 3, 3, 3, 2): smallest and largest finite sample where each axis is ``ALL``, ``FIRST`` or ``LAST``;
        the wrong way round where there is none.
    known
        (bz, by, bx): which are there.
    holes
        (bz, by, bx): which have samples that are NaN or infinite.
    marks
        (bz, by, bx) text that changes with a block's chunks; empty where nothing tells.
    identity
        Of which part of which array they are.
    """

    starts: tuple[tuple[int, ...], ...]
    values: NDArray
    known: NDArray[np.bool_]
    holes: NDArray[np.bool_]
    marks: NDArray[np.str_]
    identity: str

    @classmethod
    def empty(cls, volume: StoredVolume) -> BlockRanges:
        starts = volume.starts
        shape = tuple(len(along) - 1 for along in reversed(starts))
        values = np.zeros((*shape, 3, 3, 3, 2), volume.samples.dtype)
        flags = np.zeros(shape, bool), np.zeros(shape, bool)
        return cls(starts, values, *flags, np.full(shape, "", "U16"), volume.samples.identity)

    def limits(self) -> tuple[float, float]:
        """Smallest and largest sample of all; (0, 0) where there is none."""
        whole = self.values[:, :, :, ALL, ALL, ALL]
        there = whole[..., 0] <= whole[..., 1]
        if not there.any():
            return 0.0, 0.0
        return float(whole[..., 0][there].min()), float(whole[..., 1][there].max())

    def whole(self) -> NDArray[np.float64]:
        """Smallest and largest sample of each block, (bz, by, bx, 2)."""
        return self.values[:, :, :, ALL, ALL, ALL].astype(np.float64)

    def of_pieces(self, towards: Index) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Ranges (2, 2, 2, bz, by, bx, 2) of the pieces that ``Bricks.of_chunks`` are of, and whether they are known:
        along each axis the block itself, or the cells between it and the neighbour towards the camera; the wrong way
        round where there are no samples, or no such cells.
        """
        shape = self.known.shape
        low, high = np.full((2, 2, 2, *shape), np.inf), np.full((2, 2, 2, *shape), -np.inf)
        known = np.ones((2, 2, 2, *shape), bool)
        near, own, other, there = [], [], [], []
        for axis, n in enumerate(shape):
            i, at = np.arange(n), towards[2 - axis]
            near.append(np.where(i > at, i - 1, np.where(i < at, i + 1, i)))
            # The layers on both sides of the cells between.
            own.append(np.where(i > at, FIRST, LAST))
            other.append(np.where(i > at, LAST, FIRST))
            there.append(i != at)
        for seam in product((0, 1), repeat=3):
            for take in product(*((0, 1) if cut else (0,) for cut in seam)):
                which = np.ix_(*(near[a] if take[a] else np.arange(shape[a]) for a in range(3)))
                sides = [other[a] if take[a] else own[a] if seam[a] else np.full(shape[a], ALL) for a in range(3)]
                values = self.values[which + np.ix_(*sides)].astype(np.float64)
                some = values[..., 0] <= values[..., 1]
                for axis in range(3):
                    if seam[axis]:
                        some &= np.moveaxis(there[axis][:, None, None], 0, axis)
                low[seam] = np.where(some, np.minimum(low[seam], values[..., 0]), low[seam])
                high[seam] = np.where(some, np.maximum(high[seam], values[..., 1]), high[seam])
                known[seam] &= self.known[which]
        return np.stack([low, high], axis=-1), known

    def around(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Ranges of blocks with all their neighbours, and whether they are known."""
        pad = [(1, 1)] * 3
        whole = self.whole()
        there = whole[..., 0] <= whole[..., 1]
        low = np.pad(np.where(there, whole[..., 0], np.inf), pad, constant_values=np.inf)
        high = np.pad(np.where(there, whole[..., 1], -np.inf), pad, constant_values=-np.inf)
        known = np.pad(self.known, pad, constant_values=True)
        window = np.lib.stride_tricks.sliding_window_view
        axes = (3, 4, 5)
        low, high = window(low, (3, 3, 3)).min(axis=axes), window(high, (3, 3, 3)).max(axis=axes)
        return np.stack([low, high], axis=-1), np.asarray(window(known, (3, 3, 3)).all(axis=axes))

    def save(self, path: Path) -> None:
        """As a file that appears whole or not at all."""
        arrays: dict[str, Any] = {
            f"starts_{axis}": np.array(along) for axis, along in zip("xyz", self.starts, strict=True)
        }
        with whole_file(path) as file:
            np.savez_compressed(
                file,
                version=VERSION,
                values=self.values,
                known=self.known,
                holes=self.holes,
                marks=self.marks,
                identity=self.identity,
                **arrays,
            )

    @classmethod
    def load(cls, path: Path) -> BlockRanges:
        """Of a file that :meth:`save` wrote."""
        try:
            with np.load(path, allow_pickle=False) as file:
                if int(file["version"]) != VERSION:
                    raise ValueError(f"version {int(file['version'])}")
                starts = tuple(tuple(file[f"starts_{axis}"].tolist()) for axis in "xyz")
                return cls(starts, file["values"], file["known"], file["holes"], file["marks"], str(file["identity"]))
        except Exception as error:
            if isinstance(error, OSError) and str(path) in str(error):
                raise
            raise OSError(f"{path} is not a file of ranges ({error}): delete it, and build it anew") from error


def _limits(samples: NDArray) -> tuple[Any, Any]:
    if samples.dtype.kind != "f":
        return samples.min(), samples.max()
    low, high = samples.min(), samples.max()
    if np.isfinite(low) and np.isfinite(high):
        return low, high
    finite = samples[np.isfinite(samples)]
    return (finite.min(), finite.max()) if finite.size else (1.0, 0.0)


def limits_of(samples: NDArray) -> tuple[NDArray, bool]:
    """Of a block, (nz, ny, nx): smallest and largest sample of its layers, (3, 3, 3, 2), and whether some are not
    finite.
    """
    values = np.zeros((3, 3, 3, 2), samples.dtype)
    parts = (slice(None), slice(0, 1), slice(-1, None))
    for layer in product(range(3), repeat=3):
        values[layer] = _limits(samples[tuple(parts[which] for which in layer)])
    return values, samples.dtype.kind == "f" and not bool(np.isfinite(samples).all())


def marks_of(volume: StoredVolume) -> NDArray[np.str_]:
    """What tells of each block whether it changed, (bz, by, bx); empty texts where nothing does."""
    samples = volume.samples
    if samples.marks is None:
        return np.full(tuple(reversed(volume.blocks_along)), "", "U16")
    marked = samples.marks()
    lengths = samples.chunks or tuple((n,) for n in samples.shape)
    edges = [np.concatenate([[0], np.cumsum(along)]) for along in lengths]
    # Chunks of each block along each axis.
    spans = [
        [
            range(int(np.searchsorted(edge, a, "right")) - 1, int(np.searchsorted(edge, b - 1, "right")))
            for a, b in pairwise(along)
        ]
        for edge, along in zip(edges, reversed(volume.starts), strict=True)
    ]
    return marked(spans)


def attach(volume: StoredVolume, path: Path) -> None:
    """Give a volume the ranges of a file, unless it is of another array; those of blocks that changed since, as far as
    the store tells, are left out.
    """
    ranges = BlockRanges.load(path)
    if ranges.identity != volume.samples.identity or ranges.starts != volume.starts:
        announce("%s is of another array, or of other chunks (%s), and is not used", path, ranges.identity)
        return
    volume.ranges = ranges
    now = marks_of(volume)
    changed = ranges.known & (now != "") & (ranges.marks != now)
    if changed.any():
        announce("%d of %d blocks changed since %s was built: they are read", changed.sum(), changed.size, path)
        ranges.known &= ~changed


def build(
    volume: StoredVolume, path: Path | None, client: Any = None, report: Callable[[int, int], None] | None = None
) -> BlockRanges:
    """Ranges of all blocks: those of the file ``path`` that still hold, and of the others, which are read.

    Parameters
    ----------
    report
        Called with how many blocks are known, and how many there are.
    """
    # A file cannot tell what of an array was said to have changed since.
    forgotten = volume.version > 0 and volume.samples.marks is None
    if path is not None and path.exists() and not forgotten:
        attach(volume, path)
    ranges = BlockRanges.empty(volume) if volume.ranges is None else volume.ranges
    marks = marks_of(volume)
    left = [at[::-1] for at in np.ndindex(ranges.known.shape) if not ranges.known[at]]
    saved = monotonic()
    for done, (index, other) in enumerate(_read(volume, left, client), 1 + ranges.known.size - len(left)):
        at = index[::-1]
        ranges.values[at], ranges.holes[at] = other
        ranges.known[at], ranges.marks[at] = True, marks[at]
        if report is not None:
            report(done, ranges.known.size)
        if path is not None and monotonic() - saved > EVERY:
            ranges.save(path)
            saved = monotonic()
    if path is not None and left:
        ranges.save(path)
    return ranges


def learned(volume: StoredVolume, index: Index) -> tuple[NDArray, bool]:
    """Ranges of a block's layers, and whether it has samples that are NaN or infinite."""
    low, high = volume.block(index)
    return limits_of(volume.region(low, high))


def _read(volume: StoredVolume, left: list[Index], client: Any) -> Iterator[tuple[Index, tuple[NDArray, bool]]]:
    if client is not None:
        from .cluster import ranges_of

        yield from ranges_of(volume, left, client)
        return
    with ThreadPoolExecutor(get_num_threads()) as pool:
        # Few at a time: each has its samples in memory.
        waiting: list[tuple[Index, Any]] = []
        for index in left:
            waiting.append((index, pool.submit(learned, volume, index)))
            if len(waiting) > 2 * get_num_threads():
                first, future = waiting.pop(0)
                yield first, future.result()
        for index, future in waiting:
            yield index, future.result()


def in_memory(volume: StoredVolume) -> BlockRanges:
    """Of a volume without a file of all of them; the rest of it is read."""
    announce("reading %s once for the range of its samples; wvr.build_ranges keeps it in a file", volume.samples.name)
    return build(volume, None)


def sidecar(location: str | os.PathLike[str], inside: str = "", selection: dict[str, Any] | None = None) -> Path:
    """The file beside a store, for an array ``inside`` of it and a selection of its axes."""
    path = Path(location)
    selected = [f"{name}{at}" for name, at in sorted((selection or {}).items())]
    parts = [path.name, *inside.strip("/").split("/"), *selected]
    return path.with_name(".".join(part for part in parts if part) + SUFFIX)
