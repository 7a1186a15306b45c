"""NumPy arrays: .npy, and .npz with one or several of them. Pickles are refused."""

from __future__ import annotations

import zipfile
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..samples import Grid, Unsupported
from .bytes import Flaw, Stream, corrupt, empty, fill, opened, too_many

# Bytes that a header has at most: NumPy itself refuses to parse longer ones.
LONGEST = 10_000 + 12


def read_npy(path: Path) -> Grid:
    with opened(path) as file:
        return Grid(_array(file, path.stat().st_size), np.eye(3), np.zeros(3), "", (path,))


def read_npz(path: Path, name: str | None) -> Grid:
    with opened(path) as file, zipfile.ZipFile(file) as archive:
        entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
    name = pick(path, name, list(entries))
    with corrupt(path), zipfile.ZipFile(path) as archive:
        entry = entries[name]
        with archive.open(entry) as member:
            # What the archive says of sizes, the member has to hold in the end: it is packed once, as zlib does.
            held = min(entry.file_size, entry.compress_size * 1040 + 1040)
            return Grid(_array(member, held), np.eye(3), np.zeros(3), "", (path,))


def pick(path: Path, name: str | None, names: list[str]) -> str:
    """Which of several arrays is meant."""
    listed = ", ".join(map(repr, names))
    if not names:
        raise Unsupported(f"{path} holds no array to render")
    if name is None and len(names) > 1:
        raise Unsupported(f"{path} holds several arrays: scalars must name one of {listed}")
    if name is not None and name not in names:
        raise Unsupported(f"scalars={name!r} is not in {path}; there are {listed}")
    return names[0] if name is None else name


class Header(NamedTuple):
    """What an array is, and of how many bytes that is said."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype
    length: int


def header_of(start: bytes) -> Header:
    """By the first bytes of a file."""
    head = BytesIO(start)
    version = npy.read_magic(head)
    if version not in ((1, 0), (2, 0), (3, 0)):
        raise Flaw(f"its version is {version}; 1.0, 2.0 and 3.0 are known")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(head)
    if dtype.hasobject:
        raise Flaw("it holds Python objects (a pickle), which are not read: save an array of numbers")
    return Header(shape, fortran, dtype, head.tell())


def _array(stream: Stream, held: int) -> NDArray:
    start = b""
    while len(start) < LONGEST and (part := stream.read(LONGEST - len(start))):
        start += part
    shape, fortran, dtype, length = header_of(start)
    array = empty(shape[::-1] if fortran else shape, dtype, held - length)
    fill(array, _After(start[length:], stream))
    if extra := held - length - array.nbytes:
        raise too_many(extra, array)
    return array.T if fortran else array


class _After:
    """A stream after bytes that were read from it."""

    def __init__(self, first: bytes, stream: Stream):
        self._first = first
        self._stream = stream

    def read(self, count: int, /) -> bytes:
        part, self._first = self._first[:count], self._first[count:]
        return part or self._stream.read(count)
