"""Arrays of any library as stored volumes: which axes are z, y, x, their chunks, and where they are in the world."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..io.coordinates import Axis, places, spatial
from ..samples import Unsupported
from ..validation import near
from .stored import ALONG, Samples, StoredVolume

# What to do about coordinates that are not equally spaced.
ADVICE = "resample the data, or give spacing, by which they are drawn as if they were"
# Chunks along an axis, each of which is kept in mind.
MOST = 1 << 20


def named(names: list[str], name: str | None, what: str) -> str:
    """The one that is meant."""
    listed = ", ".join(map(repr, names))
    if not names:
        raise ValueError(f"{what} holds no array of three axes or more")
    if name is None and len(names) > 1:
        raise ValueError(f"scalars must name one of the arrays of {what}: {listed}")
    if name is not None and name.strip("/") not in names:
        raise ValueError(f"scalars must be one of {listed} of {what}, got {name!r}{near(name, names)}")
    return names[0] if name is None else name.strip("/")


def _selected(names: list[str], sizes: tuple[int, ...], selection: dict, what: str) -> tuple[tuple, tuple]:
    """Which axes are z, y, x, and the index along each other one."""
    unknown = [name for name in selection if name not in names]
    if unknown:
        raise ValueError(f"{unknown[0]} is no axis of {what}, whose axes are {', '.join(names)}")
    axes = spatial(names, selection)
    if len(axes) != 3:
        raise ValueError(f"{what} must have three axes besides those that are selected, has {', '.join(names)}")
    fixed = []
    for n, name in enumerate(names):
        if n in axes:
            continue
        at = selection.get(name)
        if at is None:
            if sizes[n] != 1:
                raise ValueError(f"{what} has {sizes[n]} along {name}: select one, wvr.open(..., {name}=0)")
            at = 0
        if isinstance(at, bool) or not isinstance(at, int | np.integer) or not -sizes[n] <= at < sizes[n]:
            raise ValueError(f"{name} must be an index from 0 to {sizes[n] - 1} of {what}, got {at!r}")
        fixed.append((n, int(at) % sizes[n]))
    return tuple(axes), tuple(fixed)


def of_array(
    array: Any, name: str, chunks: Any, selection: dict, names: list[str] | None = None, **more: Any
) -> StoredVolume:
    """Of an array with chunks: their lengths along each axis, or all equal."""
    dims = len(array.shape)
    if dims < 3:
        raise ValueError(f"store must have three axes (z, y, x) or more, {name} has shape {tuple(array.shape)}")
    if any(n != n for n in array.shape):
        raise ValueError(f"{name} does not know its shape, {array.shape}: array.compute_chunk_sizes() finds it")
    if names is None:
        names = ([f"axis{n}" for n in range(dims - 5)] + ["t", "c", "z", "y", "x"])[-dims:]
    axes, fixed = _selected(names, tuple(array.shape), selection, name)
    lengths = None
    for axis in axes:
        n, chunk = int(array.shape[axis]), ALONG if chunks is None else chunks[axis]
        count = len(chunk) if isinstance(chunk, tuple) else -(-n // max(int(chunk), 1))
        if count > MOST:
            raise ValueError(f"{name} has {count:,} chunks along axis {axis}, at most {MOST:,} can be: use larger ones")
    if chunks is not None:
        lengths = tuple(_lengths(chunks[axis], int(array.shape[axis])) for axis in axes)
    samples = Samples(array, name, axes, fixed, lengths, **more)
    _ = samples.dtype
    return StoredVolume(samples)


def _lengths(chunk: Any, n: int) -> tuple[int, ...]:
    if isinstance(chunk, tuple):
        # Dask has chunks without samples.
        return tuple(int(length) for length in chunk if length) or (0,)
    return tuple(min(int(chunk), n - start) for start in range(0, n, int(chunk)))


def placed(volume: StoredVolume, steps: ArrayLike, origin: ArrayLike) -> StoredVolume:
    """At world steps along x, y, z, which may be negative, or columns of a matrix."""
    given = np.asarray(steps, np.float64)
    columns = np.diag(given) if given.ndim == 1 else given
    with np.errstate(all="ignore"):
        spacing = np.linalg.norm(columns, axis=0)
        direction = columns / np.where(spacing > 0, spacing, 1)
    try:
        return StoredVolume(volume.samples, spacing, origin, direction, volume.nan, volume.anatomical)
    except ValueError as error:
        raise ValueError(f"{volume.samples.name}: {error}") from None


def placed_by(volume: StoredVolume, axis: Callable[[int], Axis]) -> StoredVolume:
    """Where its axes, by their numbers, say; what those cannot say is in ``unplaced``."""
    axes = [axis(number) for number in reversed(volume.samples.axes)]
    try:
        return placed(volume, *places(axes, ADVICE))
    except Unsupported as error:
        # Where they start and which way they go is known of another spacing as well.
        result = placed(volume, *np.transpose([_ends(one) for one in axes]))
        result.unplaced = f"{volume.samples.name}: {error}"
        return result


def _ends(axis: Axis) -> tuple[float, float]:
    """1 or -1, which way an axis goes, and where it starts."""
    values = axis.numbers
    if values is None or not np.all(np.isfinite(values[[0, -1]])):
        return 1.0, 0.0
    return (-1.0 if values[-1] < values[0] else 1.0), float(values[0])
