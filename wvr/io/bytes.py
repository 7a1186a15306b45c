"""Bytes to samples, checked: nothing is made up for what a file lacks."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@contextmanager
def corrupt(path: Path) -> Iterator[None]:
    """Turns what parsers raise on nonsense into an ``OSError`` that names the file."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:  # a parser may trip over nonsense in any way
        if isinstance(error, OSError) and str(path) in str(error):
            raise
        raise OSError(f"{path} is truncated or corrupt: {type(error).__name__}: {error}") from error


def inflated(data: bytes | memoryview) -> bytes:
    """The content of a gzip file (all its members) or zlib stream, checked to its end and check sum."""
    parts = []
    while True:
        stream = zlib.decompressobj(wbits=47)  # either header
        parts.append(stream.decompress(data))
        if not stream.eof:
            raise EOFError("the compressed stream ends early")
        data = stream.unused_data
        if not data.startswith(b"\x1f\x8b"):
            return b"".join(parts)


def samples(data: bytes | memoryview, dtype: np.dtype, shape: Sequence[int]) -> NDArray:
    """The samples in ``data`` as ``array[shape]``, if it is all of them."""
    expected = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    if len(data) != expected:
        raise EOFError(f"{expected} bytes of samples expected, got {len(data)}")
    return np.frombuffer(data, dtype).reshape(shape)
