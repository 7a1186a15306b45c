"""AmiraMesh, of Amira and Avizo (their user's guide, "AmiraMesh"): regular grids with uniform coordinates."""

from __future__ import annotations

import io
import math
import os
import re
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interop import RESAMPLE
from ..samples import Grid, Unsupported, components_error
from .bytes import LONGEST_LINE, Flaw, Inflating, Stream, empty, fill, guess, header, numbers, opened, too_many

TYPES = {"byte": "u1", "sbyte": "i1", "short": "i2", "ushort": "u2", "int": "i4", "float": "f4", "double": "f8"}
# Names of what is packed, and of that in terms of ``bytes.DENSEST``.
PACKINGS = {"HxByteRLE": "rle", "HxZip": "zlib"}
MAGIC = re.compile(r"#\s*(?:AmiraMesh|Avizo)\b(.*)")
# Blanks and names never overlap, so that no line takes longer than its length.
SIZES = re.compile(r"^[ \t]*define[ \t]+(\w+)((?:[ \t]+\d+)+)", re.MULTILINE)
ARRAY = re.compile(
    r'^[ \t]*(\w+)[ \t]*\{[ \t]*(\w+)(?:\[(\d+)\])?[ \t]+("[^"\n]*"|[\w.-]+)[ \t]*\}[^@\n]*'
    r"@(\d+)(?:\((\w+),[ \t]*(\d+)\))?",
    re.MULTILINE,
)


class Declared(NamedTuple):
    """An array of the header."""

    at: str
    dtype: np.dtype
    components: int
    name: str
    section: int
    packing: str
    length: int  # of what is packed [bytes]


def read_amira(path: Path, scalars: str | None) -> Grid:
    with opened(path) as file:
        lines, whole = header(file, lambda line: re.match(rb"@\d+\s*$", line) is not None)
        text = "\n".join(lines)
        magic = MAGIC.match(lines[0])
        if not magic or not whole:
            raise Flaw("no header of an AmiraMesh at its start" if whole else "its header has no data after it")
        sizes = {name: [int(n) for n in counts.split()] for name, counts in SIZES.findall(text)}
        if re.search(r'CoordType\s+"(?!uniform")', text) or len(sizes.get("Lattice", [])) != 3:
            raise Unsupported(f"it holds no grid with uniform coordinates in three dimensions; {RESAMPLE}")
        coded = magic[1].split()
        order = "" if "ASCII" in coded else "<" if "BINARY-LITTLE-ENDIAN" in coded else ">"
        arrays = {one.section: one for one in _arrays(text, order)}
        wanted = _wanted([one for one in arrays.values() if one.at == "Lattice"], scalars)
        if wanted.components != 1:
            raise components_error(str(path), wanted.components)
        counts = sizes["Lattice"]
        section = int(lines[-1][1:])
        while section != wanted.section:
            if section not in arrays:
                raise Flaw(f"its data begin with @{section}, which its header does not declare")
            section = _next(file, arrays[section], sizes, bool(order))
        array = _samples(file, wanted, counts[::-1], bool(order))
        steps, origin = _place(path, text, counts)
    return Grid(array, steps, origin, "", (path,))


def _arrays(text: str, order: str) -> list[Declared]:
    arrays = []
    for at, kind, components, name, section, packing, length in ARRAY.findall(text):
        if kind not in TYPES:
            raise Flaw(f"the type {kind!r} of its array {name!r} is none of {', '.join(TYPES)}")
        if packing and packing not in PACKINGS:
            raise Flaw(f"its array {name!r} is packed by {packing!r}, which is none of {', '.join(PACKINGS)}")
        dtype = np.dtype((order or "=") + TYPES[kind])
        arrays.append(
            Declared(
                at,
                dtype,
                int(components or 1),
                name.strip('"'),
                int(section),
                PACKINGS.get(packing, ""),
                int(length or 0),
            )
        )
    return arrays


def _wanted(arrays: list[Declared], name: str | None) -> Declared:
    names = [one.name for one in arrays]
    if not arrays:
        raise Flaw("its header declares no samples on its lattice")
    if name is None and len(arrays) > 1:
        raise Unsupported(f"it holds several arrays: pick one with scalars=, of {', '.join(names)}")
    if name is not None and name not in names:
        raise Unsupported(f"it has no array scalars={name!r}, but {', '.join(names)}")
    return arrays[0 if name is None else names.index(name)]


def _next(file: BinaryIO, array: Declared, sizes: dict[str, list[int]], binary: bool) -> int:
    """The section after that of an array, of which the file is then at the start."""
    if binary:
        count = math.prod(sizes.get(array.at, [0])) * array.components * array.dtype.itemsize
        file.seek(array.length if array.packing else min(count, os.fstat(file.fileno()).st_size), os.SEEK_CUR)
    while line := file.readline(LONGEST_LINE):
        if found := re.match(rb"@(\d+)\s*$", line):
            return int(found[1])
        if binary and line.strip():
            break
    raise Flaw(f"its array {array.name!r} does not end where the next begins")


def _samples(file: BinaryIO, array: Declared, shape: list[int], binary: bool) -> NDArray:
    held = os.fstat(file.fileno()).st_size - file.tell()
    if not binary:
        return _from_text(file, empty(shape, array.dtype, held, "text"))
    if array.packing == "rle" and array.dtype.itemsize > 1:
        raise Unsupported(f"its array {array.name!r} has {array.dtype} packed by runs of bytes: save it as binary")
    samples = empty(shape, array.dtype, array.length if array.packing else held, array.packing or "raw")
    stream: Stream = file
    if array.packing:
        packed = file.read(array.length)
        if len(packed) < array.length:
            raise Flaw(f"it declares {array.length:,} packed bytes, {array.length - len(packed):,} are missing")
        stream = RunLengths(packed) if array.packing == "rle" else Inflating(io.BytesIO(packed))
    fill(samples, stream)
    if array.packing and (extra := len(stream.read(1))):
        raise too_many(extra, samples, "or more ")
    rest = b"" if array.packing else file.read(LONGEST_LINE)
    if rest.strip() and not re.match(rb"\s*@\d+\s", rest):
        raise too_many(len(rest), samples, "or more ")
    return samples


def _from_text(file: BinaryIO, array: NDArray) -> NDArray:
    """Samples that are written as numbers, to the next section or the end."""
    words: list[bytes] = []
    while (line := file.readline(LONGEST_LINE)) and not line.startswith(b"@"):
        words += line.split()
        if len(words) > array.size:
            break
    if len(words) != array.size:
        raise Flaw(f"it declares {array.size:,} samples and holds {len(words):,} or more: correct it, or copy it again")
    array[:] = numbers(words, array.dtype).reshape(array.shape)
    return array


class RunLengths:
    """What becomes of runs: a byte below 128 repeats the next that often, one from 128 on is followed by 128 fewer
    bytes as they are.
    """

    def __init__(self, packed: bytes):
        self._packed = packed
        self._at = 0
        self._rest = b""

    def read(self, count: int, /) -> bytes:
        """At most ``count`` bytes; none at the end."""
        packed, at, parts = self._packed, self._at, bytearray(self._rest)
        while len(parts) < count and at < len(packed):
            run = packed[at]
            end = at + (2 if run < 128 else run - 127)
            if end > len(packed):
                raise Flaw("its packed samples end within a run")
            parts += packed[at + 1 : end] * (run if run < 128 else 1)
            at = end
        self._at, self._rest = at, bytes(parts[count:])
        return bytes(parts[:count])


def _place(path: Path, text: str, counts: list[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps and the first sample's position: the box goes from the first sample to the last."""
    box = _numbers(text, "BoundingBox", 6)
    if box is None:
        box = np.ravel([(0.0, guess(path, "its BoundingBox") * max(n - 1, 1)) for n in counts])
    low, high = box[::2], box[1::2]
    with np.errstate(all="ignore"):
        spacing = (high - low) / np.maximum(np.array(counts) - 1, 1)
    spacing = np.where((np.array(counts) == 1) & (spacing == 0), 1.0, spacing)
    steps, origin = np.diag(spacing), low
    matrix = _numbers(text, "TransformationMatrix", 16)
    if matrix is not None:
        # Points are rows, which are multiplied from the left.
        rows = matrix.reshape(4, 4)
        if not np.array_equal(rows[:, 3], (0, 0, 0, 1)):
            raise Unsupported(f"its TransformationMatrix is no affine one; {RESAMPLE}")
        steps, origin = rows[:3, :3].T @ steps, low @ rows[:3, :3] + rows[3, :3]
    return steps, origin


def _numbers(text: str, name: str, count: int) -> NDArray[np.float64] | None:
    """The numbers of a parameter, if it is there."""
    found = re.search(rf"\b{name}\s+([^,}}\n]*)", text)
    if not found:
        return None
    values = numbers(found[1].encode().split(), np.dtype(np.float64))
    if len(values) != count:
        raise Flaw(f"its {name} must be {count} numbers, got {found[1]!r}")
    return values
