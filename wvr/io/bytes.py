"""What a file declares against what it holds: the one place where memory is taken for the samples of a file.

Only regular files are opened, as others may never end. Memory is taken for what the file can hold at most, no more is
read or inflated than is declared, and one byte after it, to see that it ends. Nothing is made up for what is missing.
"""

from __future__ import annotations

import bz2
import math
import os
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..files import regular
from ..memory import free_host_memory, gib
from ..samples import Unsupported

CHUNK = 1 << 14
# Lengths of lines and headers beyond any that is meant.
LONGEST_LINE = 1 << 20
LONGEST_HEADER = 1 << 24
# How many bytes become of one at most; a stream of bzip2 that says "the same again" is that dense.
DENSEST = {
    "raw": 1,
    "text": 4,  # a digit and what ends it are a number of eight bytes
    "rle": 64,
    "lz4": 256,
    "gzip": 1040,
    "zlib": 1040,
    "lzma": 10_000,
    "image": 100_000,
    "bzip2": 2_000_000,
}


class Flaw(Exception):  # noqa: N818 - of a file
    """What is wrong with a file, by our own checks."""


class Surplus(Flaw):
    """It is whole, and there is more."""


@contextmanager
def corrupt(path: Path) -> Iterator[None]:
    """Turns what parsers raise on nonsense into an ``OSError`` that names the file."""
    try:
        yield
    except Unsupported as error:
        raise error if str(path) in str(error) else Unsupported(f"{path}: {error}") from None
    except ImportError:  # which says what to install
        raise
    except Surplus as flaw:
        raise OSError(f"{path} holds more than it declares: {flaw}") from None
    except Flaw as flaw:
        raise OSError(f"{path} is truncated or corrupt: {flaw}") from None
    except MemoryError as error:
        if str(path) in str(error):
            raise
        raise MemoryError(f"{path} needs more memory than there is: {error}") from None
    except Exception as error:  # a parser may trip over nonsense in any way
        if isinstance(error, OSError) and str(path) in str(error):
            raise
        raise OSError(
            f"{path} is truncated or corrupt: {type(error).__name__}: {error}; copy it again, or write it anew with "
            f"the program that made it"
        ) from error


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """A regular file to read; what is wrong with it names it."""
    regular(path)
    with corrupt(path), path.open("rb") as file:
        yield file


@contextmanager
def needs(package: str, what: str, extra: str) -> Iterator[None]:
    """Around an import: says what to install."""
    try:
        yield
    except ImportError as error:
        raise ImportError(
            f"reading {what} needs the package {package}, which is not there ({error}): pip install 'wvr[{extra}]'"
        ) from error


class Fields(dict[str, str]):
    """The fields of a header."""

    def __missing__(self, name: str) -> str:
        raise Flaw(f"its header lacks the field {name!r}")

    def numbers(self, name: str, kind: Callable[[str], Any] = float, count: int | None = None) -> list[Any]:
        """The numbers of a field."""
        text = self[name].split()
        try:
            numbers = [kind(word) for word in text]
        except ValueError:
            numbers = []
        if not numbers or count not in (None, len(numbers)):
            what = "numbers" if count is None else f"{count} number{'s' * (count > 1)}"
            raise Flaw(f"its field {name!r} must be {what}, got {self[name]!r}")
        return numbers

    def sizes(self, name: str) -> list[int]:
        """The lengths of the axes."""
        sizes = self.numbers(name, int)
        if min(sizes) < 1:
            raise Flaw(f"its field {name!r} must be integers > 0, got {self[name]!r}")
        return sizes


def header(file: BinaryIO, ends: Callable[[bytes], bool]) -> tuple[list[str], bool]:
    """Lines up to and with the first that ``ends`` the header, and whether there is such; names in them are as the file
    system has them.
    """
    lines, length = [], 0
    while True:
        line = file.readline(LONGEST_LINE)
        length += len(line)
        if length > LONGEST_HEADER or (len(line) == LONGEST_LINE and not line.endswith(b"\n")):
            raise Flaw(f"its header does not end within {length} bytes")
        lines.append(line.decode("utf-8", "surrogateescape").rstrip("\r\n"))
        if not line or ends(line):
            return lines, bool(line)


def guess(path: Path, what: str) -> float:
    """1 for a length that a file does not say, and a warning."""
    warnings.warn(f"{path} does not say {what}: 1 is taken", UserWarning, stacklevel=2)
    return 1.0


def skip_lines(file: BinaryIO, count: int) -> None:
    for skipped in range(count):
        if not file.readline(LONGEST_LINE):
            raise Flaw(f"{count} lines are to be skipped, it has {skipped}")


def empty(shape: Sequence[int], dtype: DTypeLike, held: int, packing: str = "raw") -> NDArray:
    """Memory for ``array[shape]``, if as many bytes as the file holds for it can be that many samples."""
    dtype = np.dtype(dtype)
    if dtype.hasobject or not dtype.itemsize or any(n < 0 for n in shape):
        raise Flaw(f"it declares {_counted(shape)} samples of {dtype}, which cannot be")
    declared = math.prod(int(n) for n in shape) * dtype.itemsize
    if declared > DENSEST[packing] * held + (packing != "raw") * CHUNK:
        raise Flaw(f"it declares {_counted(shape)} samples of {dtype.name}, {declared:,} bytes, and holds {held:,}")
    if declared > free_host_memory():
        raise MemoryError(f"{_counted(shape)} samples of {dtype.name} are {gib(declared)}")
    return np.empty([int(n) for n in shape], dtype)


def samples(
    file: BinaryIO,
    dtype: DTypeLike,
    shape: Sequence[int],
    packing: str = "raw",
    skip: int = 0,
    tail: bool = False,
    footer: bool = False,
) -> NDArray:
    """``array[shape]`` from here to the end of the file, if that is what there is.

    Parameters
    ----------
    packing
        "raw", "gzip" or "zlib" (either), "bzip2", or "text".
    skip
        Bytes before the samples, of what was unpacked.
    tail
        Raw samples are the last bytes, whatever is before them.
    footer
        Whatever may be after them.
    """
    held = os.fstat(file.fileno()).st_size - file.tell()
    if packing == "text":
        return _from_text(file, empty(shape, dtype, held, packing))
    array = empty(shape, dtype, max(held - skip, 0) if packing == "raw" else held, packing)
    if tail:
        skip = max(held - array.nbytes, 0)
    if packing == "raw":
        file.seek(skip, os.SEEK_CUR)
        if not footer and (extra := held - skip - array.nbytes) > 0:
            raise too_many(extra, array)
        fill(array, file)
        return array
    stream = unpacking(file, packing)
    while skip:
        part = stream.read(min(skip, CHUNK))
        if not part:
            raise Flaw("it ends before its samples")
        skip -= len(part)
    fill(array, stream)
    if (extra := len(stream.read(1))) and not footer:
        raise too_many(extra, array, "or more ")
    return array


def too_many(extra: int, array: NDArray, more: str = "") -> Surplus:
    return Surplus(
        f"{extra:,} {more}bytes after {array.nbytes:,} bytes of samples ({_counted(array.shape)} of "
        f"{array.dtype.name}); correct its header, or read it with wvr.read_raw, unless it is damaged"
    )


class Stream(Protocol):
    """Bytes one after the other."""

    def read(self, count: int, /) -> bytes: ...


def fill(array: NDArray, stream: Stream) -> None:
    """All bytes of an array from a stream."""
    view: Any = array.reshape(-1).view(np.uint8).data
    done = 0
    while done < len(view):
        part = stream.read(min(len(view) - done, 1 << 20))
        if not part:
            raise Flaw(
                f"it declares {array.nbytes:,} bytes of samples ({_counted(array.shape)} of {array.dtype.name}), "
                f"{array.nbytes - done:,} are missing: copy it again"
            )
        view[done : done + len(part)] = part
        done += len(part)


def packing_of(file: BinaryIO) -> str:
    """How the file is packed, by its first bytes; it is then at its start."""
    file.seek(0)
    magic = file.read(3)
    file.seek(0)
    return "gzip" if magic[:2] == b"\x1f\x8b" else "bzip2" if magic == b"BZh" else "raw"


def start_of(file: BinaryIO, count: int) -> bytes:
    """The first bytes of what is in a file that may be packed."""
    packing = packing_of(file)
    stream: Stream = file if packing == "raw" else unpacking(file, packing)
    content = b""
    while len(content) < count and (part := stream.read(count - len(content))):
        content += part
    return content


def unpacking(file: Any, packing: str) -> Stream:
    """The content of a packed file."""
    return bz2.BZ2File(file) if packing == "bzip2" else Inflating(file)


class Inflating:
    """The content of a gzip file (all its members) or of a zlib stream, checked to its end and check sum; or, as by
    ``wbits``, of a stream without header.
    """

    def __init__(self, file: Stream, wbits: int = 47):
        self._file = file
        self._stream = zlib.decompressobj(wbits=wbits)
        self._data = b""

    def read(self, count: int, /) -> bytes:
        """At most ``count`` bytes; none at the end."""
        while True:
            if self._stream.eof:
                data = self._stream.unused_data
                data = data if len(data) > 1 else data + self._file.read(CHUNK)
                if not data.startswith(b"\x1f\x8b"):
                    return b""
                self._data, self._stream = data, zlib.decompressobj(wbits=47)
            part = self._stream.decompress(self._data, count)
            self._data = self._stream.unconsumed_tail
            if part:
                return part
            if not self._data and not self._stream.eof:
                self._data = self._file.read(CHUNK)
                if not self._data:
                    raise Flaw("its compressed samples end early")


def _from_text(file: BinaryIO, array: NDArray) -> NDArray:
    """Samples written as decimal numbers, as many as the array has."""
    flat, done, rest = array.reshape(-1), 0, b""
    while True:
        text = file.read(1 << 20)
        rest += text
        cut = len(rest) if not text else max(rest.rfind(space) for space in (b" ", b"\n", b"\t", b"\r")) + 1
        if len(rest) - cut > LONGEST_LINE:
            raise Flaw("its samples are no text")
        values = numbers(rest[:cut].split(), array.dtype)
        if done + len(values) > len(flat):
            raise Surplus(f"numbers after {len(flat):,} samples ({_counted(array.shape)}); correct its header")
        flat[done : done + len(values)] = values
        done, rest = done + len(values), rest[cut:]
        if not text:
            break
    if done < len(flat):
        raise Flaw(f"it declares {len(flat):,} samples and holds {done:,}: copy it again")
    return array


def numbers(words: list[bytes], dtype: np.dtype) -> NDArray:
    """Words as numbers of a dtype that holds them."""
    if not words:
        return np.empty(0, dtype)
    try:
        if dtype.kind == "f":
            return np.array(words).astype(np.float64).astype(dtype)
        values = np.array(words).astype(np.uint64 if dtype == np.uint64 else np.int64)
    except (ValueError, OverflowError) as error:
        raise Flaw(f"its samples must be numbers: {error}") from None
    limits = np.iinfo(dtype)
    if values.min() < limits.min or values.max() > limits.max:
        raise Flaw(f"its samples, from {values.min()} to {values.max()}, are beyond {dtype.name}")
    return values.astype(dtype)


def _counted(shape: Sequence[int]) -> str:
    return " x ".join(str(n) for n in reversed(shape)) or "1"


def layout_of(shape: Any, dtype: Any, offset: Any) -> tuple[tuple[int, int, int], np.dtype]:
    """Shape and dtype of bare samples that begin after so many bytes, of what a user says."""
    try:
        whole = len(shape) == 3 and all(n == int(n) and n >= 1 for n in shape)
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole:
        raise ValueError(f"shape must be three integers > 0 (nz, ny, nx), got {shape!r}")
    if isinstance(offset, bool) or not isinstance(offset, int | np.integer) or offset < 0:
        raise ValueError(f"offset must be >= 0 bytes, got {offset}")
    try:
        kind = np.dtype(dtype)
    except (TypeError, ValueError):
        kind = np.dtype("V1")
    if kind.kind not in "biuf":
        raise TypeError(f"dtype must be that of numbers, such as uint16, got {dtype!r}")
    nz, ny, nx = map(int, shape)
    return (nz, ny, nx), kind
