"""VTK's XML files of image data (.vti, https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html)."""

from __future__ import annotations

import base64
import binascii
import lzma
import os
import zlib
from collections.abc import Callable
from functools import partial
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from ..interop import RESAMPLE
from ..samples import Grid, Unsupported
from .bytes import CHUNK, Fields, Flaw, empty, numbers, opened
from .vtk_image import Array, Image, cells

TYPES = {f"{kind}{bits}": f"{kind[0].lower()}{bits // 8}" for kind in ("Int", "UInt") for bits in (8, 16, 32, 64)}
TYPES |= {"Float32": "f4", "Float64": "f8", "vtkIdType": "i8"}
# Elements whose arrays are samples, and where they are.
SAMPLES = {"PointData": False, "CellData": True}


class Data(NamedTuple):
    """An array of a piece: its attributes and what is written inside it."""

    fields: Fields
    text: bytes


class Piece(NamedTuple):
    extent: NDArray[np.int64]
    arrays: dict[bool, dict[str, Data]]  # on points (False) and cells (True)


class Document:
    """The elements of a file up to its appended samples."""

    def __init__(self, file: BinaryIO):
        self.file = file
        self.root = Fields()
        self.grid = Fields()
        self.pieces: list[Piece] = []
        self.active: dict[bool, str | None] = {}
        #: How the appended samples are written, and where they begin.
        self.encoding = ""
        self.start = 0
        self._where: bool | None = None
        self._array: tuple[Fields, list[bytes]] | None = None
        self._names: list[str] = []
        self._parse()
        orders: dict[str, Any] = {"LittleEndian": "<", "BigEndian": ">"}
        self.order: Any = orders.get(self.root["byte_order"])
        if self.order is None:
            raise Flaw(f"its byte_order {self.root['byte_order']!r} is unknown")
        sizes = {"UInt32": "u4", "UInt64": "u8"}
        if (kind := self.root.get("header_type", "UInt32")) not in sizes:
            raise Flaw(f"its header_type {kind!r} is none of {', '.join(sizes)}")
        self.count = np.dtype(self.order + sizes[kind])

    def _parse(self) -> None:
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._written
        parser.StartDoctypeDeclHandler = _refuse
        self._parser = parser
        try:
            while chunk := self.file.read(CHUNK):
                parser.Parse(chunk, False)
                if self.encoding:
                    break
            else:
                parser.Parse(b"", True)
        except expat.ExpatError:
            # What follows the start of appended samples is no XML.
            if not self.encoding:
                raise
        if self.encoding:
            self.file.seek(self.start)
            tag = self.file.read(CHUNK)
            mark = tag.find(b"_", tag.find(b">"))
            if mark < 0:
                raise Flaw("its appended samples do not begin")
            self.start += mark + 1

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        fields = Fields(attributes)
        self._names.append(name)
        if len(self._names) == 1:
            if name != "VTKFile":
                raise Flaw(f"its element {name!r} is no VTKFile")
            self.root = fields
        elif name == "ImageData":
            self.grid = fields
        elif name == "Piece":
            extent = np.array(fields.numbers("Extent", int, 6), np.int64)
            self.pieces.append(Piece(extent, {False: {}, True: {}}))
        elif name in SAMPLES and self.pieces:
            self._where = SAMPLES[name]
            self.active.setdefault(self._where, fields.get("Scalars") or None)
        elif name == "DataArray" and self._where is not None:
            self._array = fields, []
        elif name == "AppendedData":
            self.encoding, self.start = fields["encoding"], self._parser.CurrentByteIndex

    def _written(self, text: str) -> None:
        if self._array is not None:
            self._array[1].append(text.encode())

    def _end(self, name: str) -> None:
        self._names.pop()
        if name in SAMPLES:
            self._where = None
        elif name == "DataArray" and self._array is not None and self._where is not None:
            fields, text = self._array
            if fields.get("type") in TYPES:  # others are no samples
                self.pieces[-1].arrays[self._where][fields["Name"]] = Data(fields, b"".join(text))
            self._array = None


def _refuse(*_: Any) -> None:
    raise Flaw("it has a document type, which VTK's files have not")


def read_vti(path: Path, name: str | None) -> Grid:
    with opened(path) as file:
        document = Document(file)
        if document.root.get("type") != "ImageData":
            raise Unsupported(f"{path} holds a {document.root.get('type', 'nothing')}; {RESAMPLE}")
        return _image(document).grid(path, name)


def _image(document: Document) -> Image:
    fields = document.grid
    whole = np.array(fields.numbers("WholeExtent", int, 6), np.int64)
    if np.any(np.abs(whole) > 2**31) or np.any(whole[1::2] < whole[::2]):
        raise Flaw(f"its WholeExtent is {fields['WholeExtent']}")
    spacing = np.array(fields.numbers("Spacing", float, 3) if "Spacing" in fields else [1.0] * 3)
    origin = np.array(fields.numbers("Origin", float, 3) if "Origin" in fields else [0.0] * 3)
    turned = np.reshape(fields.numbers("Direction", float, 9), (3, 3)) if "Direction" in fields else np.eye(3)
    pieces = [piece for piece in document.pieces if np.all(piece.extent[1::2] >= piece.extent[::2])]
    if not pieces:
        raise Flaw("it has no piece with samples")
    for piece in pieces:
        if np.any(piece.extent[::2] < whole[::2]) or np.any(piece.extent[1::2] > whole[1::2]):
            raise Flaw(f"its piece {piece.extent.tolist()} is not within its WholeExtent {whole.tolist()}")

    def arrays(on_cells: bool) -> dict[str, Array]:
        known = pieces[0].arrays[on_cells]
        load = partial(_loaded, document, pieces, whole, on_cells)
        return {name: Array(_components(data), partial(load, name)) for name, data in known.items()}

    active = document.active.get(False), document.active.get(True)
    return Image(whole, spacing, origin, turned, arrays(False), arrays(True), active)


def _components(data: Data) -> int:
    return data.fields.numbers("NumberOfComponents", int, 1)[0] if "NumberOfComponents" in data.fields else 1


def _loaded(document: Document, pieces: list[Piece], whole: NDArray[np.int64], on_cells: bool, name: str) -> NDArray:
    """The samples of an array, of all pieces."""
    parts = []
    for piece in pieces:
        if name not in piece.arrays[on_cells]:
            raise Flaw(f"its piece {piece.extent.tolist()} lacks the array {name!r}")
        shape = _size(piece.extent, on_cells)[::-1]
        parts.append(_decoded(document, piece.arrays[on_cells][name], prod(shape)).reshape(shape))
    shape = _size(whole, on_cells)[::-1]
    if len(parts) == 1 and parts[0].shape == shape:
        return parts[0]
    array = empty(shape, parts[0].dtype, sum(part.nbytes for part in parts))
    there = np.zeros(shape, bool)
    for piece, part in zip(pieces, parts, strict=True):
        start = (piece.extent[::2] - whole[::2])[::-1]
        place = tuple(slice(a, a + n) for a, n in np.stack([start, part.shape], axis=1).tolist())
        if part.dtype != array.dtype or there[place].shape != part.shape:
            raise Flaw(f"its pieces are of {array.dtype.name} and {part.dtype.name}, or reach out of the whole")
        array[place], there[place] = part, True
    if not there.all():
        raise Flaw(f"its pieces leave {there.size - np.count_nonzero(there)} of {there.size} samples open")
    return array


def _size(extent: NDArray[np.int64], on_cells: bool) -> tuple[int, ...]:
    points = tuple((extent[1::2] - extent[::2] + 1).tolist())
    return cells(points) if on_cells else points


def _decoded(document: Document, data: Data, count: int) -> NDArray:
    """The samples of an array, if there are as many as ``count``."""
    fields = data.fields
    dtype = np.dtype(TYPES[fields["type"]])
    if fields["format"] == "ascii":
        values = numbers(data.text.split(), dtype)
        if len(values) != count:
            raise Flaw(f"it declares {count:,} samples and holds {len(values):,}")
        return values
    dtype = dtype.newbyteorder(document.order)
    if fields["format"] == "binary":
        text = BytesIO(b"".join(data.text.split()))
        return _unpacked(document, Written(text, 0, text.getbuffer().nbytes, True), dtype, count)
    if fields["format"] != "appended" or document.encoding not in ("raw", "base64"):
        raise Flaw(f"its format {fields['format']!r}, encoding {document.encoding!r}, is unknown")
    offset = fields.numbers("offset", int, 1)[0]
    if offset < 0:
        raise Flaw(f"its offset {offset} is negative")
    size = os.fstat(document.file.fileno()).st_size
    return _unpacked(
        document, Written(document.file, document.start + offset, size, document.encoding == "base64"), dtype, count
    )


class Written(NamedTuple):
    """Where an array's bytes are, and whether in base64."""

    file: BinaryIO
    start: int
    end: int
    in_text: bool

    def read(self, at: int, count: int) -> tuple[bytes, int]:
        """``count`` bytes from a place on, where a stream begins, and where a stream of so many ends."""
        length = -(-count // 3) * 4 if self.in_text else count
        if length > self.end - self.start - at:
            raise Flaw(f"{count:,} bytes are declared where it has {max(self.end - self.start - at, 0):,} left")
        self.file.seek(self.start + at)
        content = self.file.read(length)
        if self.in_text:
            try:
                content = base64.b64decode(content, validate=True)
            except binascii.Error as error:
                raise Flaw(f"its base64 is none: {error}") from None
        if len(content) < count:
            raise Flaw(f"{count:,} bytes are declared, {len(content):,} are there")
        return content[:count], at + length

    def padded(self, at: int) -> bool:
        """Whether a stream ends just before a place."""
        self.file.seek(self.start + at - 1)
        return self.in_text and self.file.read(1) == b"="


def _unpacked(document: Document, written: Written, dtype: np.dtype, count: int) -> NDArray:
    compressor = document.root.get("compressor", "")
    size = count * dtype.itemsize
    width = document.count.itemsize
    if not compressor:
        head, end = written.read(0, width)
        declared = int(np.frombuffer(head, document.count)[0])
        if declared != size:
            raise Flaw(f"{count:,} samples of {dtype.name} are {size:,} bytes, its header says {declared:,}")
        if written.padded(end):
            content, _ = written.read(end, size)
        else:
            content = written.read(0, width + size)[0][width:]
        array = empty((count,), dtype, len(content))
        array.view(np.uint8)[:] = np.frombuffer(content, np.uint8)
        return array
    if compressor not in UNPACK:
        raise Unsupported(f"its compressor {compressor!r} is none of {', '.join(UNPACK)}")
    packing, unpack = UNPACK[compressor]
    blocks, block, last = np.frombuffer(written.read(0, 3 * width)[0], document.count).tolist()
    if blocks > (written.end - written.start) // width or last > block:
        raise Flaw(f"{blocks:,} blocks of {block:,} bytes are declared, the last of {last:,}")
    head, end = written.read(0, (3 + blocks) * width)
    packed = np.frombuffer(head, document.count)[3:].tolist()
    sizes = [block] * (blocks - (last > 0)) + [last] * (last > 0)
    if sum(sizes) != size:
        raise Flaw(f"{count:,} samples of {dtype.name} are {size:,} bytes, its blocks {sum(sizes):,}")
    array = empty((count,), dtype, sum(packed), packing)
    view, done = array.view(np.uint8).data, 0
    content, at = (written.read(end, sum(packed))[0], 0) if written.in_text else (b"", end)
    for length, whole in zip(packed, sizes, strict=True):
        part = unpack(content[at : at + length] if written.in_text else written.read(at, length)[0], whole)
        if len(part) != whole:
            raise Flaw(f"a block of {whole:,} bytes has {len(part):,}")
        view[done : done + whole] = part
        at, done = at + length, done + whole
    return array


def _inflate(data: bytes, size: int) -> bytes:
    return zlib.decompressobj().decompress(data, size + 1)


def _unxz(data: bytes, size: int) -> bytes:
    return lzma.LZMADecompressor(memlimit=1 << 28).decompress(data, size + 1)


def _unlz4(data: bytes, size: int) -> Any:
    """By VTK, within the length that is given."""
    from vtkmodules.vtkIOCore import vtkLZ4DataCompressor

    compressor: Any = vtkLZ4DataCompressor()
    block = np.empty(size, np.uint8)
    compressor.AddObserver("ErrorEvent", lambda *_: None)  # which it would print
    done = compressor.Uncompress(data, len(data), block, size)
    return block[:done].data


UNPACK: dict[str, tuple[str, Callable[[bytes, int], Any]]] = {
    "vtkZLibDataCompressor": ("zlib", _inflate),
    "vtkLZMADataCompressor": ("lzma", _unxz),
    "vtkLZ4DataCompressor": ("lz4", _unlz4),
}
