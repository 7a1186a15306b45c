"""NRRD (https://teem.sourceforge.net/nrrd/format.html)."""

from __future__ import annotations

import bz2
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error
from .bytes import corrupt, inflated, samples

TYPES = {
    alias.strip(): kind
    for kind, aliases in {
        "i1": "signed char, int8, int8_t",
        "u1": "uchar, unsigned char, uint8, uint8_t",
        "i2": "short, short int, signed short, signed short int, int16, int16_t",
        "u2": "ushort, unsigned short, unsigned short int, uint16, uint16_t",
        "i4": "int, signed int, int32, int32_t",
        "u4": "uint, unsigned int, uint32, uint32_t",
        "i8": "longlong, long long, long long int, signed long long, signed long long int, int64, int64_t",
        "u8": "ulonglong, unsigned long long, unsigned long long int, uint64, uint64_t",
        "f4": "float",
        "f8": "double",
    }.items()
    for alias in aliases.split(",")
}
DECODERS: dict[str, Callable[[Any], Any]] = {
    "raw": memoryview,
    "gzip": inflated,
    "gz": inflated,
    "bzip2": bz2.decompress,
    "bz2": bz2.decompress,
}


def read_nrrd(path: Path) -> Grid:
    content = path.read_bytes()
    with corrupt(path):
        head, data = _parts(content)
        sizes = [int(n) for n in head["sizes"].split()]
        spatial = _spatial(head, len(sizes))
        if len(spatial) != len(sizes) or int(head["dimension"]) != len(sizes):
            raise ValueError("its axes' fields disagree on how many there are")
        dtype = np.dtype(TYPES[head["type"]]).newbyteorder(">" if head.get("endian") == "big" else "<")
    components = int(np.prod([n for n, is_spatial in zip(sizes, spatial, strict=True) if not is_spatial]))
    if components != 1:
        raise components_error(str(path), components)
    if sum(spatial) != 3:
        raise ValueError(f"{path} must have three spatial axes, got {sum(spatial)} (sizes {head['sizes']})")
    if "data file" in head:
        data = memoryview(_data_file(path, head["data file"]).read_bytes())
    with corrupt(path):
        shape = [n for n, is_spatial in zip(sizes, spatial, strict=True) if is_spatial][::-1]
        return Grid(_samples_of(head, data, dtype, shape), *_place(head, spatial), _anatomical(head))


def _parts(content: bytes) -> tuple[dict[str, str], memoryview]:
    """The header's fields and the bytes after it."""
    if not content.startswith(b"NRRD"):
        raise ValueError("no NRRD magic at its start")
    end = re.search(rb"\r?\n\r?\n", content)
    lines = content[: end.start() if end else None].decode("latin-1").splitlines()[1:]
    fields = [line.split(": ", 1) for line in lines if not line.startswith("#") and ":=" not in line]
    head = {name.strip().lower(): value.strip() for name, value in fields}
    for alias, name in {"datafile": "data file", "lineskip": "line skip", "byteskip": "byte skip"}.items():
        if alias in head:
            head[name] = head.pop(alias)
    if end is None and "data file" not in head:
        raise EOFError("its header does not end")
    return head, memoryview(content)[end.end() if end else len(content) :]


def _spatial(head: dict[str, str], dimension: int) -> list[bool]:
    """Which axes are in space; the others are components, time or the like."""
    if "space directions" in head:
        return [vector != "none" for vector in re.findall(r"none|\([^)]*\)", head["space directions"])]
    if "kinds" in head:
        return [kind in ("domain", "space", "???", "none") for kind in head["kinds"].split()]
    return [axis >= dimension - 3 for axis in range(dimension)]


def _data_file(path: Path, name: str) -> Path:
    if name.startswith("LIST") or "%" in name:
        raise ValueError(f"{path} spreads its samples over several files ({name!r}); only one is supported: merge them")
    return path.parent / name


def _samples_of(head: dict[str, str], data: Any, dtype: np.dtype, shape: Sequence[int]) -> NDArray:
    encoding = head["encoding"].lower()
    for _ in range(int(head.get("line skip", 0))):
        data = data[bytes(data).index(b"\n") + 1 :]
    if encoding in ("txt", "text", "ascii"):
        return np.array(bytes(data).split()).astype(dtype).reshape(shape)
    if encoding not in DECODERS:
        raise ValueError(f"unknown encoding {encoding!r}")
    skip = int(head.get("byte skip", 0))
    if skip == -1:  # raw samples at the end of a file whose header is of no interest
        data = data[-int(np.prod(shape)) * dtype.itemsize :]
    # For compressed data the format counts the skipped bytes after decompression.
    return samples(memoryview(DECODERS[encoding](data))[max(skip, 0) :], dtype, shape)


def _anatomical(head: dict[str, str]) -> str:
    """The patient's directions that the axes of the space run to, of ``left-posterior-superior`` as of ``LPS``."""
    space = head.get("space", "").strip('"').upper()
    letters = "".join(word[:1] for word in space.split("-")) if "-" in space else space[:3]
    pairs = ("LR", "PA", "SI")
    return letters if len(letters) == 3 and all(sum(c in pair for c in letters) == 1 for pair in pairs) else ""


def _place(head: dict[str, str], spatial: list[bool]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps and origin, from the space fields or the older per-axis ones."""

    def per_axis(field: str, default: str) -> list[str]:
        values = head.get(field, " ".join([default] * len(spatial))).split()
        return [value for value, is_spatial in zip(values, spatial, strict=True) if is_spatial]

    if "space directions" in head:
        vectors = re.findall(r"\(([^)]*)\)", head["space directions"])
        steps = np.array([[float(v) for v in vector.split(",")] for vector in vectors]).T
        origin = head.get("space origin", "(0,0,0)").strip("() ").split(",")
        return steps.reshape(3, 3), np.array(origin, np.float64).reshape(3)
    spacing = np.array(per_axis("spacings", "1"), np.float64)
    lower = np.array(per_axis("axis mins", "nan"), np.float64)
    # An axis minimum is where the first cell starts, unless samples are nodes.
    half = [0.0 if centre == "node" else 0.5 for centre in per_axis("centers", "cell")]
    return np.diag(spacing), np.where(np.isnan(lower), 0.0, lower + spacing * half)
