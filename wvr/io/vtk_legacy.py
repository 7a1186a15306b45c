"""VTK's legacy files (.vtk, https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ..interop import RESAMPLE
from ..samples import Grid, Unsupported
from .bytes import LONGEST_LINE, Flaw, empty, fill, numbers, opened
from .vtk_image import Array, Image, cells

# As they are in binary files, big endian.
TYPES = {
    "unsigned_char": "u1",
    "char": "i1",
    "signed_char": "i1",
    "unsigned_short": "u2",
    "short": "i2",
    "unsigned_int": "u4",
    "int": "i4",
    "unsigned_long": "u8",
    "long": "i8",
    "vtktypeint64": "i8",
    "vtktypeuint64": "u8",
    "vtkidtype": "i4",
    "float": "f4",
    "double": "f8",
}
OTHERS = ("rectilinear_grid", "structured_grid", "unstructured_grid", "polydata", "field")
# Attributes with a fixed number of components.
VECTORS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


class Parser:
    """Reads a file from its start to its end, and leaves samples where they are until they are asked for."""

    def __init__(self, file: BinaryIO):
        self.file = file
        self.size = os.fstat(file.fileno()).st_size
        if not self.line().startswith("# vtk DataFile"):
            raise Flaw("no VTK header at its start")
        self.line()
        kind = self.line().strip().upper()
        if kind not in ("ASCII", "BINARY"):
            raise Flaw(f"its third line must be ASCII or BINARY, got {kind[:80]!r}")
        self.binary = kind == "BINARY"
        self.fields: dict[str, list[str]] = {}
        self.arrays: dict[bool, dict[str, Array]] = {False: {}, True: {}}
        self.active: dict[bool, str] = {}
        self.on_cells: bool | None = None
        self.points = (0, 0, 0)
        self._parse()

    def line(self) -> str:
        """The next, or an empty one at the end."""
        line = self.file.readline(LONGEST_LINE)
        if len(line) == LONGEST_LINE:
            raise Flaw("a line of text does not end")
        return line.decode("utf-8", "surrogateescape")

    def words(self) -> list[str]:
        """Of the next line that is not empty; none at the end."""
        while line := self.line():
            if words := line.split():
                return words
        return []

    def _parse(self) -> None:
        while words := self.words():
            keyword = words[0].upper()
            if keyword == "DATASET":
                kind = " ".join(words[1:]).lower()
                if kind in OTHERS:
                    raise Unsupported(f"it holds a {kind.replace('_', ' ')}; {RESAMPLE}")
                if kind != "structured_points":
                    raise Flaw(f"its DATASET {kind[:80]!r} is not known")
            elif keyword in ("DIMENSIONS", "SPACING", "ASPECT_RATIO", "ORIGIN"):
                self.fields[keyword.replace("ASPECT_RATIO", "SPACING")] = words[1:]
                if keyword == "DIMENSIONS":
                    self.points = self._dimensions(words[1:])
            elif keyword in ("POINT_DATA", "CELL_DATA"):
                self.on_cells = keyword == "CELL_DATA"
                if self._integer(words, 1) != self._count():
                    raise Flaw(f"its {keyword} {words[1]} do not fit its dimensions {self.points}")
            elif keyword == "METADATA":
                while self.line().strip():
                    pass
            else:
                self._attribute(keyword, words)

    def _dimensions(self, words: list[str]) -> tuple[int, int, int]:
        nx, ny, nz = (self._integer(words, k) for k in range(3))
        if min(nx, ny, nz) < 1:
            raise Flaw(f"its DIMENSIONS must be three integers > 0, got {' '.join(words)}")
        return nx, ny, nz

    def _integer(self, words: list[str], place: int) -> int:
        try:
            return int(words[place])
        except (IndexError, ValueError):
            raise Flaw(f"a number is missing in the line {' '.join(words)[:80]!r}") from None

    def _count(self) -> int:
        shape = cells(self.points) if self.on_cells else self.points
        return shape[0] * shape[1] * shape[2]

    def _attribute(self, keyword: str, words: list[str]) -> None:
        if keyword == "FIELD":
            for _ in range(self._integer(words, 2)):
                head = self.words()
                if len(head) < 4:
                    raise Flaw(f"{words[2]} arrays are declared, some are missing")
                self._keep(head[0], self._integer(head, 1), self._integer(head, 2), head[3])
        elif keyword == "SCALARS":
            components = self._integer(words, 3) if len(words) > 3 else 1
            table = self.file.tell()
            if self.words()[:1] not in (["LOOKUP_TABLE"], ["lookup_table"]):
                self.file.seek(table)
            self._keep(words[1], components, self._count(), words[2], True)
        elif keyword in VECTORS and len(words) > 2:
            self._keep(words[1], VECTORS[keyword], self._count(), words[2])
        elif keyword == "TEXTURE_COORDINATES" and len(words) > 3:
            self._keep(words[1], self._integer(words, 2), self._count(), words[3])
        elif keyword == "COLOR_SCALARS" and len(words) > 2:
            self._keep(words[1], self._integer(words, 2), self._count(), "unsigned_char", shares=not self.binary)
        elif keyword == "LOOKUP_TABLE" and len(words) > 2:
            self._skip(4 * self._integer(words, 2), np.dtype("u1" if self.binary else "f4"))
        else:
            raise Flaw(f"{' '.join(words)[:80]!r} is not known")

    def _keep(
        self, name: str, components: int, count: int, kind: str, scalars: bool = False, shares: bool = False
    ) -> None:
        if kind.lower() not in TYPES:
            raise Unsupported(f"its array {name!r} is of {kind!r}; {', '.join(TYPES)} are supported")
        if components < 1 or count < 0:
            raise Flaw(f"its array {name!r} declares {count} x {components} numbers")
        dtype = np.dtype(TYPES[kind.lower()])
        start = self.file.tell()
        self._skip(components * count, dtype)
        if self.on_cells is None or count != self._count():
            return  # no samples
        name = unquote(name)
        self.arrays[self.on_cells][name] = Array(components, self._loader(start, dtype, shares))
        if scalars:
            self.active.setdefault(self.on_cells, name)

    def _skip(self, count: int, dtype: np.dtype) -> None:
        """Go on after so many numbers."""
        left = self.size - self.file.tell()
        if count * (dtype.itemsize if self.binary else 1) > left:
            raise Flaw(f"it declares {count:,} samples of {dtype.name} where it has {left:,} bytes left")
        if self.binary:
            self.file.seek(count * dtype.itemsize, os.SEEK_CUR)
            return
        while count > 0:
            words = self.words()
            if not words or len(words) > count:
                raise Flaw(f"{count} numbers are missing")
            count -= len(words)

    def _loader(self, start: int, dtype: np.dtype, shares: bool) -> Callable[[], NDArray]:
        """Reads an array of samples; ``shares`` are bytes that are written as parts of 255."""
        shape = (cells(self.points) if self.on_cells else self.points)[::-1]

        def load() -> NDArray:
            self.file.seek(start)
            held = self.size - start
            if self.binary:
                array = empty(shape, dtype.newbyteorder(">"), held)
                fill(array, self.file)
                return array
            array = empty(shape, dtype, held, "text")
            flat, done = array.reshape(-1), 0
            while done < len(flat):
                values = numbers([word.encode() for word in self.words()], np.dtype(np.float64) if shares else dtype)
                if shares:
                    if not np.all((values >= 0) & (values <= 1)):
                        raise Flaw("its COLOR_SCALARS must be numbers from 0 to 1")
                    values = np.rint(255 * values)
                flat[done : done + len(values)] = values
                done += len(values)
            return array

        return load


def read_legacy(path: Path, name: str | None) -> Grid:
    with opened(path) as file:
        parser = Parser(file)
        if not parser.fields.get("DIMENSIONS"):
            raise Flaw("it has no DIMENSIONS")
        spacing = numbers([word.encode() for word in parser.fields.get("SPACING", ["1"] * 3)], np.dtype(np.float64))
        origin = numbers([word.encode() for word in parser.fields.get("ORIGIN", ["0"] * 3)], np.dtype(np.float64))
        if spacing.shape != (3,) or origin.shape != (3,):
            raise Flaw("its SPACING and ORIGIN must be three numbers each")
        extent = np.array([[0, n - 1] for n in parser.points], np.int64).ravel()
        active = parser.active.get(False), parser.active.get(True)
        points, cell = parser.arrays[False], parser.arrays[True]
        return Image(extent, spacing, origin, np.eye(3), points, cell, active).grid(path, name)
