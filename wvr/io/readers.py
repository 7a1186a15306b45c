"""Reads the volume in a file or folder, with the reader of its extension or content."""

from __future__ import annotations

import bz2
import errno
import logging
import os
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..volume import DTYPES, Volume

if TYPE_CHECKING:
    import pyvista as pv

NanPolicy = Literal["error", "transparent"]


class _Grid(NamedTuple):
    """What a file holds: ``array[z, y, x]``, the world steps along x, y, z as columns, the first sample's position."""

    array: NDArray
    steps: NDArray[np.float64]
    origin: NDArray[np.float64]
    anatomical: bool = False


def read(path: str | os.PathLike[str], scalars: str | None = None, nan: NanPolicy = "error") -> Volume:
    """The volume in a file or folder.

    Parameters
    ----------
    path
        NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), NIfTI (.nii, .nii.gz), VTK image data (.vti, legacy .vtk), TIFF
        with a page per slice (.tif, .tiff), NumPy (.npy, three axes z, y, x), DICOM (.dcm); or a folder with either one
        TIFF per slice, in natural order of their names, or one DICOM series, in order of position.
    scalars
        Name of the array, for VTK files with several; by default the active one. Samples stored on cells sit at the
        cells' centres: the volume is then half a cell smaller on every side than the file's box.
    nan
        What to do with NaN and infinite samples, see :class:`Volume`.

    Returns
    -------
    Volume
        ``array[z, y, x]`` in the file's dtype (see the module's notes for the exceptions) and world coordinates. TIFF
        spacing is known from ImageJ and OME files only, NumPy files have none: 1.

    Raises
    ------
    FileNotFoundError
        No such file, or a folder without TIFF or DICOM images.
    OSError
        A truncated or corrupt file.
    ValueError
        An unknown extension, more than one component a sample, a grid that is not regular, an unknown ``scalars``, or
        samples that :class:`Volume` refuses.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, "no such file or folder", str(path))
    reader = _folder_reader(path) if path.is_dir() else _file_reader(path)
    if reader is _vtk_image:
        return from_pyvista(reader(path), scalars, nan)
    if scalars is not None:
        raise ValueError(f"scalars={scalars!r}: {path} holds one array without a name; leave scalars out")
    array, steps, origin, anatomical = reader(path)
    lengths = np.linalg.norm(steps, axis=0)
    volume = Volume(_narrowed(array), lengths, origin, steps / np.where(lengths > 0, lengths, 1), nan)
    volume.anatomical = anatomical
    return volume


def read_raw(
    path: str | os.PathLike[str],
    shape: Sequence[int],
    dtype: DTypeLike,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    direction: ArrayLike | None = None,
    offset: int = 0,
    byteorder: Literal["little", "big"] = "little",
    nan: NanPolicy = "error",
) -> Volume:
    """The volume in a file of bare samples, x fastest, memory-mapped where dtype and byte order need no conversion.

    Parameters
    ----------
    path
        The file.
    shape
        ``(nz, ny, nx)``, as the array's.
    dtype
        Of the samples in the file; integers that a volume does not accept are narrowed as in :func:`read`.
    spacing, origin, direction, nan
        See :class:`Volume`.
    offset
        Bytes before the first sample.
    byteorder
        ``"little"`` or ``"big"``.

    Raises
    ------
    FileNotFoundError
        No such file.
    OSError
        The file's size is not ``offset`` plus that of the samples.
    ValueError
        Arguments out of range.
    """
    path = Path(path)
    size = path.stat().st_size
    if len(shape) != 3 or any(n != int(n) or n < 1 for n in shape):
        raise ValueError(f"shape must be three integers > 0 (nz, ny, nx), got {shape!r}")
    if offset < 0:
        raise ValueError(f"offset must be >= 0 bytes, got {offset}")
    if byteorder not in ("little", "big"):
        raise ValueError(f'byteorder must be "little" or "big", got {byteorder!r}')
    kind = np.dtype(dtype).newbyteorder("<" if byteorder == "little" else ">")
    expected = offset + kind.itemsize * int(np.prod(shape, dtype=np.int64))
    if size != expected:
        raise OSError(f"{path} has {size} bytes; {offset} + {tuple(shape)} samples of {kind.name} are {expected} bytes")
    array = np.memmap(path, kind, "r", offset, tuple(int(n) for n in shape))
    return Volume(_narrowed(array), spacing, origin, direction, nan)


def from_pyvista(image_data: pv.ImageData, scalars: str | None = None, nan: NanPolicy = "error") -> Volume:
    """The volume of a PyVista ``ImageData``, sharing its memory where the dtype allows.

    Parameters
    ----------
    image_data
        ``pyvista.ImageData`` or ``vtkImageData`` with one component a sample.
    scalars
        Name of the point or cell array; by default the active one. Cell samples sit at the cells' centres: the volume
        is then half a cell smaller on every side than the grid's box.
    nan
        See :class:`Volume`.

    Raises
    ------
    TypeError
        For anything but a regular grid.
    ValueError
        For an unknown name, no array or several with none active, more than one component.
    """
    import pyvista as pv

    image = pv.wrap(image_data)
    if not isinstance(image, pv.ImageData):
        raise TypeError(f"image_data must be a pyvista.ImageData, got {type(image_data).__name__}; {_RESAMPLE}")
    values, on_cells = _pick_array(image, scalars)
    if values.ndim > 1:
        raise _components(f"array {scalars!r}" if scalars else "the active array", values.shape[1])
    points = np.array(image.dimensions)
    size = np.maximum(points - 1, 1) if on_cells else points
    spacing = np.array(image.spacing)
    matrix = image.GetDirectionMatrix()
    direction = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
    # VTK's origin is that of index (0, 0, 0), which need not be a point of the grid.
    first = np.array(image.GetExtent()[::2]) + np.where(points > 1, 0.5, 0.0) * on_cells
    origin = np.array(image.origin) + direction @ (spacing * first)
    array = _narrowed(np.asarray(values).reshape(size[::-1]))
    # VTK allows a negative spacing, which is a reversed axis.
    return Volume(array, np.abs(spacing), origin, direction * np.where(spacing < 0, -1, 1), nan)


def to_pyvista(volume: Volume) -> pv.ImageData:
    """A PyVista ``ImageData`` of the volume, with its box and orientation.

    Parameters
    ----------
    volume
        Any volume.

    Returns
    -------
    pyvista.ImageData
        With point data ``"values"`` in the volume's dtype, sharing its memory where both live on the CPU: change it and
        the volume changes. VTK has no float16: that becomes float32, which holds every such value.
    """
    import pyvista as pv

    nz, ny, nx = volume.shape
    image = pv.ImageData(dimensions=(nx, ny, nz), spacing=tuple(volume.spacing), origin=tuple(volume.origin))
    image.SetDirectionMatrix(*volume.direction.ravel())
    values = volume.numpy()
    image.point_data["values"] = (values.astype(np.float32) if values.dtype == np.float16 else values).reshape(-1)
    image.set_active_scalars("values")
    return image


_RESAMPLE = (
    "wvr renders regular grids: resample it, e.g. pyvista.ImageData(dimensions=..., spacing=..., "
    "origin=...).sample(grid), and pass that to Volume.from_pyvista"
)


def _pick_array(image: pv.ImageData, scalars: str | None) -> tuple[NDArray, bool]:
    """The array to render and whether it is on cells."""
    names = list(image.point_data.keys()) + list(image.cell_data.keys())
    if scalars is None:
        scalars = image.point_data.active_scalars_name or image.cell_data.active_scalars_name
        if scalars is None and len(names) == 1:
            scalars = names[0]
    if not names:
        raise ValueError("image_data has no point or cell array to render")
    if scalars not in names:
        problem = (
            "scalars must name the array, none is active" if scalars is None else f"scalars={scalars!r} is unknown"
        )
        raise ValueError(f"{problem}; there are {', '.join(map(repr, names))}")
    on_cells = scalars not in image.point_data
    return (image.cell_data if on_cells else image.point_data)[scalars], on_cells


def _narrowed(array: NDArray) -> NDArray:
    """The array itself, or for bool and wide integers its values in the smallest accepted dtype that holds them all."""
    if array.dtype.kind not in "biu" or array.dtype.newbyteorder("=").name in DTYPES or array.size == 0:
        return array
    lo, hi = int(array.min()), int(array.max())
    for name in ("uint8", "int8", "uint16", "int16"):
        if np.iinfo(name).min <= lo and hi <= np.iinfo(name).max:
            return array.astype(name)
    if max(-lo, hi) > 2**53:
        raise ValueError(f"samples of {array.dtype} from {lo} to {hi} fit no accepted dtype exactly; scale them first")
    return array.astype(np.float64)


def _rescaled(array: NDArray, slope: float, intercept: float) -> NDArray:
    """``slope * array + intercept``: exact integers for whole numbers, else float32, or float64 for wide samples."""
    if (slope, intercept) == (1, 0):
        return array
    if array.dtype.kind in "iu" and float(slope).is_integer() and float(intercept).is_integer():
        return array.astype(np.int64) * int(slope) + int(intercept)
    wide = array.dtype.itemsize > (4 if array.dtype.kind == "f" else 2)
    return (array * np.float64(slope) + intercept).astype(np.float64 if wide else np.float32)


def _components(what: str, count: int) -> ValueError:
    return ValueError(
        f"{what} has {count} components a sample, a volume has one: load the data with another tool, pick a component "
        f"(array[..., 0]) or combine them (e.g. their norm) and pass the result to wvr.Volume"
    )


@contextmanager
def _corrupt(path: Path) -> Iterator[None]:
    """Turns what parsers raise on nonsense into an ``OSError`` that names the file."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:  # a parser may trip over nonsense in any way
        if isinstance(error, OSError) and str(path) in str(error):
            raise
        raise OSError(f"{path} is truncated or corrupt: {type(error).__name__}: {error}") from error


def _inflated(data: bytes | memoryview) -> bytes:
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


def _samples(data: bytes | memoryview, dtype: np.dtype, shape: Sequence[int]) -> NDArray:
    """The samples in ``data`` as ``array[shape]``, if it is all of them."""
    expected = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    if len(data) != expected:
        raise EOFError(f"{expected} bytes of samples expected, got {len(data)}")
    return np.frombuffer(data, dtype).reshape(shape)


# --- NRRD (https://teem.sourceforge.net/nrrd/format.html) -----------------------------------------------------------

_NRRD_TYPES = {
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
_NRRD_DECODERS: dict[str, Callable[[Any], Any]] = {
    "raw": memoryview,
    "gzip": _inflated,
    "gz": _inflated,
    "bzip2": bz2.decompress,
    "bz2": bz2.decompress,
}


def _read_nrrd(path: Path) -> _Grid:
    content = path.read_bytes()
    with _corrupt(path):
        head, data = _nrrd_parts(content)
        sizes = [int(n) for n in head["sizes"].split()]
        spatial = _nrrd_spatial(head, len(sizes))
        if len(spatial) != len(sizes) or int(head["dimension"]) != len(sizes):
            raise ValueError("its axes' fields disagree on how many there are")
        dtype = np.dtype(_NRRD_TYPES[head["type"]]).newbyteorder(">" if head.get("endian") == "big" else "<")
    components = int(np.prod([n for n, is_spatial in zip(sizes, spatial, strict=True) if not is_spatial]))
    if components != 1:
        raise _components(str(path), components)
    if sum(spatial) != 3:
        raise ValueError(f"{path} must have three spatial axes, got {sum(spatial)} (sizes {head['sizes']})")
    if "data file" in head:
        data = memoryview(_nrrd_data_file(path, head["data file"]).read_bytes())
    with _corrupt(path):
        shape = [n for n, is_spatial in zip(sizes, spatial, strict=True) if is_spatial][::-1]
        return _Grid(_nrrd_samples(head, data, dtype, shape), *_nrrd_place(head, spatial), "space" in head)


def _nrrd_parts(content: bytes) -> tuple[dict[str, str], memoryview]:
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


def _nrrd_spatial(head: dict[str, str], dimension: int) -> list[bool]:
    """Which axes are in space; the others are components, time or the like."""
    if "space directions" in head:
        return [vector != "none" for vector in re.findall(r"none|\([^)]*\)", head["space directions"])]
    if "kinds" in head:
        return [kind in ("domain", "space", "???", "none") for kind in head["kinds"].split()]
    return [axis >= dimension - 3 for axis in range(dimension)]


def _nrrd_data_file(path: Path, name: str) -> Path:
    if name.startswith("LIST") or "%" in name:
        raise ValueError(f"{path} spreads its samples over several files ({name!r}); only one is supported: merge them")
    return path.parent / name


def _nrrd_samples(head: dict[str, str], data: Any, dtype: np.dtype, shape: Sequence[int]) -> NDArray:
    encoding = head["encoding"].lower()
    for _ in range(int(head.get("line skip", 0))):
        data = data[bytes(data).index(b"\n") + 1 :]
    if encoding in ("txt", "text", "ascii"):
        return np.array(bytes(data).split()).astype(dtype).reshape(shape)
    if encoding not in _NRRD_DECODERS:
        raise ValueError(f"unknown encoding {encoding!r}")
    skip = int(head.get("byte skip", 0))
    if skip == -1:  # raw samples at the end of a file whose header is of no interest
        data = data[-int(np.prod(shape)) * dtype.itemsize :]
    # For compressed data the format counts the skipped bytes after decompression.
    return _samples(memoryview(_NRRD_DECODERS[encoding](data))[max(skip, 0) :], dtype, shape)


def _nrrd_place(head: dict[str, str], spatial: list[bool]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


# --- MetaImage (https://itk.org/Wiki/MetaIO/Documentation) ----------------------------------------------------------

_MET_TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG": "i4",
    "MET_ULONG": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}


def _read_meta_image(path: Path) -> _Grid:
    content = path.read_bytes()
    with _corrupt(path):
        end = re.search(rb"ElementDataFile\s*=\s*([^\r\n]*)\r?\n?", content)
        if end is None:
            raise ValueError("no ElementDataFile in its header")
        lines = content[: end.end()].decode("latin-1").splitlines()
        head = {name.strip(): value.strip() for name, value in (line.split("=", 1) for line in lines if line.strip())}
        name = head["ElementDataFile"]
        components = int(head.get("ElementNumberOfChannels", 1))
        shape = [int(n) for n in head["DimSize"].split()][::-1]
    if components != 1:
        raise _components(str(path), components)
    if len(shape) != 3:
        raise ValueError(f"{path} must have three dimensions, got DimSize = {head['DimSize']}")
    if name.startswith("LIST") or "%" in name:
        raise ValueError(f"{path} spreads its samples over several files ({name!r}); only one is supported: merge them")
    data = (
        memoryview(content)[end.end() :] if name.upper() == "LOCAL" else memoryview((path.parent / name).read_bytes())
    )
    with _corrupt(path):
        return _Grid(_meta_samples(head, data, shape), *_meta_place(head), "AnatomicalOrientation" in head)


def _meta_field(head: dict[str, str], names: str, default: str) -> str:
    """The first field there is of several that mean the same."""
    return next((head[name] for name in names.split() if name in head), default)


def _meta_samples(head: dict[str, str], data: memoryview, shape: Sequence[int]) -> NDArray:
    big = _meta_field(head, "BinaryDataByteOrderMSB ElementByteOrderMSB", "False").lower() == "true"
    dtype = np.dtype(_MET_TYPES[head["ElementType"]]).newbyteorder(">" if big else "<")
    if head.get("BinaryData", "True").lower() == "false":
        return np.array(bytes(data).split()).astype(dtype).reshape(shape)
    skip = int(head.get("HeaderSize", 0))
    data = data[-int(np.prod(shape)) * dtype.itemsize :] if skip == -1 else data[skip:]
    compressed = head.get("CompressedData", "False").lower() == "true"
    return _samples(_inflated(data) if compressed else data, dtype, shape)


def _meta_place(head: dict[str, str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    spacing = np.array(_meta_field(head, "ElementSpacing ElementSize", "1 1 1").split(), np.float64).reshape(3)
    origin = np.array(_meta_field(head, "Offset Position Origin", "0 0 0").split(), np.float64).reshape(3)
    matrix = _meta_field(head, "TransformMatrix Rotation Orientation", "1 0 0 0 1 0 0 0 1").split()
    # Rows of the file's matrix are the axes' directions, as ITK (whose format it is) reads and writes it.
    return np.array(matrix, np.float64).reshape(3, 3).T * spacing, origin


# --- NIfTI-1 and -2 (https://nifti.nimh.nih.gov) --------------------------------------------------------------------

_NIFTI_TYPES = {
    2: "u1",
    4: "i2",
    8: "i4",
    16: "f4",
    64: "f8",
    256: "i1",
    512: "u2",
    768: "u4",
    1024: "i8",
    1280: "u8",
}
_NIFTI_COMPONENTS = {32: 2, 1792: 2, 128: 3, 2304: 4}  # complex, complex, RGB, RGBA
# header size: (name, type, byte offset) of the fields that matter
_NIFTI_FIELDS = {
    348: (
        ("dim", "8i2", 40), ("datatype", "i2", 70), ("pixdim", "8f4", 76), ("offset", "f4", 108), ("slope", "f4", 112),
        ("intercept", "f4", 116), ("qform", "i2", 252), ("sform", "i2", 254), ("quatern", "3f4", 256),
        ("qoffset", "3f4", 268), ("srow", "(3,4)f4", 280), ("magic", "S4", 344),
    ),
    540: (
        ("magic", "S4", 4), ("datatype", "i2", 12), ("dim", "8i8", 16), ("pixdim", "8f8", 104), ("offset", "i8", 168),
        ("slope", "f8", 176), ("intercept", "f8", 184), ("qform", "i4", 344), ("sform", "i4", 348),
        ("quatern", "3f8", 352), ("qoffset", "3f8", 376), ("srow", "(3,4)f8", 400),
    ),
}  # fmt: skip


def _read_nifti(path: Path) -> _Grid:
    content = path.read_bytes()
    with _corrupt(path):
        if path.name.lower().endswith(".gz"):
            content = _inflated(content)
        head, order = _nifti_header(content)
        dimension, *dims = head["dim"].tolist()
        if not 1 <= dimension <= 7:
            raise ValueError(f"{dimension} dimensions")
        dims = dims[:dimension] + [1] * (7 - dimension)
    components = _NIFTI_COMPONENTS.get(int(head["datatype"]), 1) * int(np.prod(dims[3:]))
    if components != 1:
        raise _components(str(path), components)
    with _corrupt(path):
        dtype = np.dtype(_NIFTI_TYPES[int(head["datatype"])]).newbyteorder(order)
        array = _samples(memoryview(content)[int(head["offset"]) :], dtype, dims[2::-1])
        # A slope of 0 or NaN means none.
        slope, intercept = (float(head["slope"]), float(head["intercept"])) if head["slope"] else (1.0, 0.0)
        array = _rescaled(array, slope, intercept) if np.isfinite(slope) else array
        return _Grid(array, *_nifti_place(head), anatomical=True)


def _nifti_header(content: bytes) -> tuple[Any, Literal["<", ">"]]:
    """The header's fields and the file's byte order, known from the header's size at its start."""
    orders: tuple[Literal["<", ">"], ...] = ("<", ">")
    for order in orders:
        size = int(np.frombuffer(content, order + "i4", 1)[0])
        if size in _NIFTI_FIELDS:
            names, formats, offsets = zip(*_NIFTI_FIELDS[size], strict=True)
            layout = {"names": names, "formats": formats, "offsets": offsets, "itemsize": size}
            head = np.frombuffer(content, np.dtype(layout).newbyteorder(order), 1)[0]  # type: ignore[call-overload]
            if head["magic"] not in (b"n+1", b"n+2"):
                raise ValueError(f"magic {head['magic']!r} where n+1 or n+2 is expected")
            return head, order
    raise ValueError("no NIfTI header at its start")


def _nifti_place(head: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if head["sform"] > 0:
        rows = head["srow"].astype(np.float64)
        return rows[:, :3], rows[:, 3]
    spacing = np.abs(head["pixdim"][1:4].astype(np.float64))
    if head["qform"] <= 0:
        return np.diag(spacing), np.zeros(3)
    b, c, d = head["quatern"].astype(np.float64)
    a = np.sqrt(max(0.0, 1 - b * b - c * c - d * d))
    rotation = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    flip = -1.0 if head["pixdim"][0] < 0 else 1.0  # "qfac": the handedness of the axes
    return rotation * spacing * [1, 1, flip], head["qoffset"].astype(np.float64)


# --- TIFF -----------------------------------------------------------------------------------------------------------


def _read_tiff(path: Path) -> _Grid:
    array, spacing = _tiff(path)
    return _Grid(array, np.diag(spacing), np.zeros(3))


def _read_tiff_folder(path: Path) -> _Grid:
    files = sorted(_tiff_files(path), key=lambda file: [int(t) if t.isdigit() else t for t in _digits(file.name)])
    slices = [_tiff(file) for file in files]
    first, spacing = slices[0]
    for file, (array, _) in zip(files, slices, strict=True):
        if array.shape != (1, *first.shape[1:]) or array.dtype != first.dtype:
            raise ValueError(
                f"{file} holds {array.shape} {array.dtype}, one slice (1, {first.shape[1]}, {first.shape[2]}) of "
                f"{first.dtype} is expected, as in {files[0].name}"
            )
    return _Grid(np.concatenate([array for array, _ in slices]), np.diag(spacing), np.zeros(3))


def _digits(name: str) -> list[str]:
    return re.split(r"(\d+)", name.lower())


def _tiff_files(path: Path) -> list[Path]:
    return [file for file in path.iterdir() if file.suffix.lower() in (".tif", ".tiff") and file.is_file()]


def _tiff(path: Path) -> tuple[NDArray, list[float]]:
    """Samples (z, y, x) and spacing (x, y, z) of a TIFF file."""
    import tifffile

    with _corrupt(path), _raising_log("tifffile"), tifffile.TiffFile(path) as file:
        pages, size, form = list(file.pages), path.stat().st_size, file.tiff
        # tifffile does without a last directory's end, and fills strips that are not there with zeros.
        ends = [pages[-1].offset + form.tagnosize + form.tagsize * len(pages[-1].tags) + form.offsetsize]
        strips = [strip for page in pages for strip in zip(page.dataoffsets, page.databytecounts, strict=True)]
        if max(ends + [offset + count for offset, count in strips]) > size or not all(count for _, count in strips):
            raise EOFError("some of its samples are missing")
        series, spacing = file.series, _tiff_spacing(file)
        axes, shape, dtype = series[0].axes, series[0].shape, series[0].dtype
    if len(series) > 1:
        raise ValueError(
            f"{path} holds {len(series)} images of different size or type; a volume is one: split the file"
        )
    if axes[-2:] != "YX" or len(shape) > 3 or axes[0] in "CS":
        extra = [n for n, axis in zip(shape, axes, strict=True) if axis not in "ZYX"]
        raise _components(f"{path} (axes {axes}, shape {shape})", int(np.prod(extra)))
    with _corrupt(path), _raising_log("tifffile"):
        array = _tiff_samples(path, dtype, len(pages))
    return array.reshape(-1, *shape[-2:]), spacing


def _tiff_samples(path: Path, dtype: np.dtype, pages: int) -> NDArray:
    import tifffile

    try:
        return tifffile.imread(path)
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
    # LZW and other codecs that tifffile leaves to a package of its own are in Pillow.
    from PIL import Image

    slices = []
    with Image.open(path) as image:
        for page in range(pages):
            image.seek(page)
            slices.append(np.array(image))
    return np.stack(slices).astype(dtype)


def _tiff_spacing(file: Any) -> list[float]:
    """Spacing along x, y, z where the file states a voxel's size; a plain resolution is one of print: 1."""
    if file.is_ome:
        if len(set(re.findall(r'PhysicalSize[XYZ]Unit="([^"]*)"', file.ome_metadata))) > 1:
            raise ValueError("its voxel size mixes units")
        sizes = dict(re.findall(r'PhysicalSize([XYZ])="([^"]*)"', file.ome_metadata))
        return [float(sizes.get(axis, 1.0)) for axis in "XYZ"]
    if not file.is_imagej:
        return [1.0, 1.0, 1.0]
    tags = file.pages[0].tags
    per_unit = [tags[name].value if name in tags else (1, 1) for name in ("XResolution", "YResolution")]
    return [d / n if n else 1.0 for n, d in per_unit] + [float(file.imagej_metadata.get("spacing", 1.0))]


@contextmanager
def _raising_log(name: str) -> Iterator[None]:
    """Raises what a library only logs, at its end; tifffile says so that way when pages are missing."""
    records: list[logging.LogRecord] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = records.append  # type: ignore[method-assign,assignment]
    logger = logging.getLogger(name)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagate
    if records:
        raise ValueError(records[0].getMessage())


# --- DICOM ----------------------------------------------------------------------------------------------------------


def _read_dicom(path: Path) -> _Grid:
    return _dicom_grid(path, [path])


def _read_dicom_folder(path: Path) -> _Grid:
    return _dicom_grid(path, _dicom_files(path))


def _dicom_files(path: Path) -> list[Path]:
    return [file for file in sorted(path.iterdir()) if file.is_file() and _is_dicom(file)]


def _is_dicom(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM" or path.suffix.lower() == ".dcm"


def _dicom_grid(path: Path, files: list[Path]) -> _Grid:
    slices = [slice_ for file in files if (slice_ := _dicom_slice(file)) is not None]
    if not slices:
        raise FileNotFoundError(errno.ENOENT, "no DICOM images", str(path))
    series = {str(s.head.get("SeriesInstanceUID", "")) for s in slices}
    if len(series) > 1:
        raise ValueError(f"{path} holds {len(series)} DICOM series; put the one to read into a folder of its own")
    if len({(s.array.shape, tuple(s.head.get("ImageOrientationPatient", ()))) for s in slices}) > 1:
        raise ValueError(f"{path} holds DICOM slices of different size or orientation")
    first = slices[0].head
    row, column = np.array(first.get("ImageOrientationPatient", (1, 0, 0, 0, 1, 0)), np.float64).reshape(2, 3)
    normal = np.cross(row, column)
    # Slices without a position (no patient) are ordered by number and stacked along the normal.
    thickness = float(first.get("SpacingBetweenSlices") or first.get("SliceThickness") or 1.0)
    slices.sort(key=lambda s: int(s.head.get("InstanceNumber") or 0))
    place = [
        np.array(s.head.get("ImagePositionPatient", normal * thickness * k), np.float64) for k, s in enumerate(slices)
    ]
    order = np.argsort([normal @ position for position in place], kind="stable")
    between = np.diff(np.array(place)[order], axis=0)
    step = between.mean(axis=0) if len(slices) > 1 else normal * thickness
    if np.any(np.linalg.norm(between - step, axis=1) > 0.02 * np.linalg.norm(step)) or not np.any(step):
        raise ValueError(f"{path} holds DICOM slices that are not evenly spaced: some are missing or doubled")
    down, across = (float(v) for v in first.get("PixelSpacing", (1.0, 1.0)))
    steps = np.stack([row * across, column * down, step], axis=1)
    return _Grid(np.stack([slices[k].array for k in order]), steps, place[order[0]], anatomical=True)


class _Slice(NamedTuple):
    head: Any
    array: NDArray


def _dicom_slice(path: Path) -> _Slice | None:
    """Header and rescaled samples of one DICOM image; None for a file without any, such as a DICOMDIR."""
    try:
        import pydicom
    except ImportError as error:
        raise ImportError("reading DICOM needs the package pydicom: pip install pydicom") from error

    with _corrupt(path):
        head = pydicom.dcmread(path)
        if "Rows" not in head:
            return None
        components, frames = int(head.get("SamplesPerPixel", 1)), int(head.get("NumberOfFrames") or 1)
    if components > 1:
        raise _components(str(path), components)
    if frames > 1:
        raise ValueError(
            f"{path} is a DICOM file of {frames} frames; only one a file is supported: convert it, e.g. to NIfTI"
        )
    with _corrupt(path):
        slope, intercept = float(head.get("RescaleSlope", 1)), float(head.get("RescaleIntercept", 0))
        return _Slice(head, _rescaled(head.pixel_array, slope, intercept))


# --- NumPy and VTK --------------------------------------------------------------------------------------------------


def _read_npy(path: Path) -> _Grid:
    with _corrupt(path):
        return _Grid(np.load(path, allow_pickle=False), np.eye(3), np.zeros(3))


def _vtk_image(path: Path) -> pv.ImageData:
    """The ``ImageData`` in a .vti or legacy .vtk file."""
    import pyvista as pv
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    is_xml = path.suffix.lower() == ".vti"
    # VTK does not notice that raw appended samples end early.
    if is_xml and b"</VTKFile>" not in path.read_bytes()[-100:]:
        raise OSError(f"{path} is truncated: it does not end in </VTKFile>")
    reader = vtkXMLImageDataReader() if is_xml else vtkGenericDataObjectReader()
    reader.SetFileName(str(path))
    with _vtk_messages() as messages:
        reader.Update()
    if messages or reader.GetOutput() is None:
        raise OSError(f"{path} is truncated or corrupt: {messages[0] if messages else 'VTK reads nothing from it'}")
    image = pv.wrap(reader.GetOutput())
    if not isinstance(image, pv.ImageData):
        raise ValueError(f"{path} holds a {type(image).__name__}; {_RESAMPLE}")
    sizes = [len(image.point_data[n]) - image.n_points for n in image.point_data]
    sizes += [len(image.cell_data[n]) - image.n_cells for n in image.cell_data]
    if not sizes or any(sizes) or image.n_points == 0:
        raise OSError(f"{path} is truncated or corrupt: its samples cannot be read")
    return image


@contextmanager
def _vtk_messages() -> Iterator[list[str]]:
    """Collects the warnings and errors that VTK would print; the list is complete after the block."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    messages: list[str] = []
    window, printed, verbosity = (
        vtkStringOutputWindow(),
        vtkOutputWindow.GetInstance(),
        vtkLogger.GetCurrentVerbosityCutoff(),
    )
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield messages
    finally:
        vtkLogger.SetStderrVerbosity(vtkLogger.ConvertToVerbosity(verbosity))
        vtkOutputWindow.SetInstance(printed)
        text = window.GetOutput() or ""  # bytes if it quotes a file's nonsense
        text = text.decode(errors="replace") if isinstance(text, bytes) else text
        messages += [message for message in text.strip().split("\n\n") if message]


# --- Which reader ---------------------------------------------------------------------------------------------------

_READERS: dict[str, Callable[[Path], Any]] = {
    ".nrrd": _read_nrrd,
    ".nhdr": _read_nrrd,
    ".mha": _read_meta_image,
    ".mhd": _read_meta_image,
    ".nii": _read_nifti,
    ".nii.gz": _read_nifti,
    ".vti": _vtk_image,
    ".vtk": _vtk_image,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".dcm": _read_dicom,
    ".npy": _read_npy,
}
_OTHER_GRIDS = {
    ".vtr": "rectilinear grid",
    ".vts": "curvilinear grid",
    ".vtu": "unstructured grid",
    ".vtp": "surface",
}


def _file_reader(path: Path) -> Callable[[Path], Any]:
    name = path.name.lower()
    for ending, reader in _READERS.items():
        if name.endswith(ending):
            return reader
    if path.suffix.lower() in _OTHER_GRIDS:
        raise ValueError(f"{path} holds a {_OTHER_GRIDS[path.suffix.lower()]}; {_RESAMPLE}")
    raise ValueError(
        f"{path} has an unknown extension; accepted are {', '.join(_READERS)} and folders of TIFF or DICOM slices; "
        f"bare samples: wvr.read_raw; what PyVista reads: wvr.Volume.from_pyvista(pyvista.read(path))"
    )


def _folder_reader(path: Path) -> Callable[[Path], Any]:
    tiff, dicom = _tiff_files(path), _dicom_files(path)
    if tiff and dicom:
        raise ValueError(f"{path} holds {len(tiff)} TIFF and {len(dicom)} DICOM files; keep one kind")
    if not tiff and not dicom:
        raise FileNotFoundError(errno.ENOENT, "no TIFF or DICOM images in the folder", str(path))
    return _read_tiff_folder if tiff else _read_dicom_folder
