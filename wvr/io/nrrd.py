"""NRRD (https://teem.sourceforge.net/nrrd/format.html)."""

from __future__ import annotations

import errno
import re
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files import regular
from ..samples import Anatomy, Grid, Unsupported, components_error
from .bytes import Fields, Flaw, corrupt, header, opened, samples, skip_lines
from .space import in_first_unit, right_handed

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
PACKINGS = {"raw": "raw", "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
PACKINGS |= dict.fromkeys(("txt", "text", "ascii"), "text")
SPATIAL = ("domain", "space", "???", "none")
ALIASES = {"datafile": "data file", "lineskip": "line skip", "byteskip": "byte skip", "axismins": "axis mins"}
ALIASES |= {"centerings": "centers"}
VECTOR = r"none|\([^)]*\)"


class Axes(NamedTuple):
    """What the header says of the axes, fastest first."""

    sizes: list[int]
    spatial: list[bool]
    timely: list[bool]

    def of_space(self, values: list) -> list:
        return [value for value, is_spatial in zip(values, self.spatial, strict=True) if is_spatial]


def read_nrrd(path: Path) -> Grid:
    with opened(path) as file:
        lines, ended = header(file, lambda line: not line.strip())
        head = _head(lines)
        if not ended and "data file" not in head:
            raise Flaw("its header does not end")
        axes = _axes(head)
        dtype = _dtype(head)
        start = file.tell()
    extra = [n for n, spatial, time in zip(*axes, strict=True) if not spatial and not time]
    if int(np.prod(extra)) != 1:
        raise components_error(str(path), int(np.prod(extra)))
    if sum(axes.spatial) != 3 or sum(axes.timely) > 1:
        raise Unsupported(f"{path} must have three spatial axes, got {sum(axes.spatial)} (sizes {head['sizes']})")
    if head["encoding"].lower() not in PACKINGS:
        raise Unsupported(f"{path} has the encoding {head['encoding']!r}; {', '.join(PACKINGS)} are supported")
    with corrupt(path):
        steps, origin, anatomical = _place(head, axes)
    data = _data_file(path, head["data file"]) if "data file" in head else path
    with opened(data) as file:
        file.seek(start if data == path else 0)
        array = _samples(head, file, dtype, axes)
    return Grid(array, steps, origin, anatomical, tuple(dict.fromkeys((path, data))))


def _head(lines: list[str]) -> Fields:
    if not re.fullmatch(r"NRRD\d{4}\s*", lines[0]):
        raise Flaw("no NRRD magic at its start")
    head = Fields()
    for line in lines[1:]:
        if not line.strip() or line.startswith("#") or ":=" in line:
            continue
        name, colon, value = line.partition(":")
        if not colon:
            raise Flaw(f"the line {line[:80]!r} of its header is no field")
        name = name.strip().lower()
        name = ALIASES.get(name, name)
        if name in head:
            raise Flaw(f"its header has the field {name!r} twice")
        head[name] = value.strip()
    return head


def _axes(head: Fields) -> Axes:
    sizes = head.sizes("sizes")
    kinds = head["kinds"].split() if "kinds" in head else ["???"] * len(sizes)
    if "space directions" in head:
        vectors = re.findall(VECTOR, head["space directions"])
        spatial = [vector != "none" for vector in vectors]
        # Where time is an axis of the space, its vector has nothing but a last number.
        for axis, vector in enumerate(vectors):
            if vector.count(",") == 3 and not any(_vector(vector)[:3]):
                spatial[axis] = False
                kinds[axis : axis + 1] = ["time"]
    elif "kinds" in head:
        spatial = [kind in SPATIAL for kind in kinds]
    else:
        spatial = [axis >= len(sizes) - 3 for axis in range(len(sizes))]
    if not len(spatial) == len(kinds) == len(sizes) == head.numbers("dimension", int, 1)[0]:
        raise Flaw("its axes' fields disagree on how many there are")
    timely = [kind in ("time", "list") and not space for kind, space in zip(kinds, spatial, strict=True)]
    return Axes(sizes, spatial, timely)


def _dtype(head: Fields) -> np.dtype:
    kind = head["type"].lower()
    if kind not in TYPES:
        raise Flaw(f"its type {head['type']!r} is unknown; known are {', '.join(TYPES)}")
    dtype = np.dtype(TYPES[kind])
    if dtype.itemsize == 1 or PACKINGS.get(head["encoding"].lower()) == "text":
        return dtype
    if "endian" not in head:
        raise Flaw(f"samples of {dtype.name} need the field 'endian: little' or 'endian: big', its header has none")
    orders = {"little": "<", "big": ">"}
    if head["endian"].lower() not in orders:
        raise Flaw(f"its endian must be little or big, got {head['endian']!r}")
    return dtype.newbyteorder(orders[head["endian"].lower()])  # type: ignore[arg-type]


def data_file(path: Path, name: str, several: str) -> Path:
    """The one file with a header's samples, whose name may look like a pattern; ``several`` is what a pattern is."""
    if name.split()[:1] == ["LIST"] or (re.search(several, name) and not (path.parent / name).exists()):
        raise Unsupported(
            f"{path} spreads its samples over several files ({name!r}); only one is supported: merge them"
        )
    data = path.parent / name
    try:
        regular(data)
    except (FileNotFoundError, ValueError):  # names with a null character are none
        what = f"the samples of {path} are in a file that is not there"
        raise FileNotFoundError(errno.ENOENT, what, str(data)) from None
    except OSError as error:
        raise OSError(f"the samples of {path} are in {name[:200]!r}: {error.strerror or error}") from None
    return data


def _data_file(path: Path, name: str) -> Path:
    return data_file(path, name, r"%0?\d*d.*\s-?\d+\s+-?\d+\s+-?\d+")


def _samples(head: Fields, file: BinaryIO, dtype: np.dtype, axes: Axes) -> NDArray:
    skip_lines(file, head.numbers("line skip", int, 1)[0] if "line skip" in head else 0)
    skip = head.numbers("byte skip", int, 1)[0] if "byte skip" in head else 0
    packing = PACKINGS[head["encoding"].lower()]
    if skip < -1 or (skip == -1 and packing != "raw"):
        raise Flaw(f"its byte skip must be >= 0, or -1 for raw samples at its end, got {skip}")
    # For compressed samples the format counts the skipped bytes after decompression.
    array = samples(file, dtype, axes.sizes[::-1], packing, max(skip, 0), tail=skip == -1)
    if any(axes.timely):
        array = np.moveaxis(array, len(axes.sizes) - 1 - axes.timely.index(True), 0)
        return array.reshape(array.shape[0], *axes.of_space(axes.sizes)[::-1])
    return array.reshape(axes.of_space(axes.sizes)[::-1])


def _vector(text: str) -> list[float]:
    try:
        return [float(number) for number in text.strip("() ").split(",")]
    except ValueError:
        raise Flaw(f"{text!r} in its header is no vector") from None


def _words(text: str) -> list[str]:
    """Words, some in quotes."""
    return [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', text)]


def _place(head: Fields, axes: Axes) -> tuple[NDArray[np.float64], NDArray[np.float64], Anatomy]:
    """Steps and origin, from the space fields or the older per-axis ones, and which way a patient's axes go."""

    def per_axis(field: str, default: str) -> list[str]:
        values = _words(head[field]) if field in head else [default] * len(axes.sizes)
        if len(values) != len(axes.sizes):
            raise Flaw(f"its field {field!r} must have {len(axes.sizes)} entries, got {head[field]!r}")
        return axes.of_space(values)

    signs, anatomical = right_handed(head["space"]) if "space" in head else (np.ones(3), "")
    if "space directions" in head:
        vectors = axes.of_space(re.findall(VECTOR, head["space directions"]))
        steps = np.array([_vector(vector)[:3] for vector in vectors])
        origin = np.array(_vector(head.get("space origin", "(0,0,0)"))[:3])
        if steps.shape != (3, 3) or origin.shape != (3,):
            raise Flaw("its space must have three dimensions")
        if "space units" in head:
            scale = np.array(in_first_unit([1, 1, 1], _words(head["space units"])[:3]))
            steps, origin = steps * scale, origin * scale
        return signs[:, None] * steps.T, signs * origin, anatomical
    units = per_axis("units", "")
    spacing = np.array([float(value) for value in per_axis("spacings", "nan")])
    spacing = np.array(in_first_unit(np.where(np.isnan(spacing), 1.0, spacing).tolist(), units))  # NaN: unknown
    lower = np.array(in_first_unit([float(value) for value in per_axis("axis mins", "nan")], units))
    # An axis minimum is where the first cell starts, unless samples are nodes.
    half = [0.0 if centre == "node" else 0.5 for centre in per_axis("centers", "cell")]
    origin = np.where(np.isnan(lower), 0.0, lower + spacing * half)
    return np.diag(signs * spacing), signs * origin, anatomical
