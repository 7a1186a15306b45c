"""NIfTI-1 and -2 (https://nifti.nimh.nih.gov), also as pairs of files, and FreeSurfer's MGH, by nibabel's headers."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error, rescaled
from .bytes import Flaw, guess, opened, packing_of, samples, start_of

# Bytes of the longest header.
HEADER = 540


class Layout(NamedTuple):
    """What a header says of samples: file, dtype, lengths along x, y, z, time and so on, first byte, scale, place."""

    data: Path
    dtype: np.dtype
    dims: tuple[int, ...]
    start: int
    slope: float
    intercept: float
    place: tuple[NDArray[np.float64], NDArray[np.float64]]


def read_nifti(path: Path) -> Grid:
    data, dtype, dims, start, slope, intercept, place = layout(path)
    dims = (*dims, *[1] * (7 - len(dims)))
    components = int(np.prod(dims[4:]))
    components *= len(dtype.names) if dtype.names else 1 + (dtype.kind == "c")
    if components != 1:
        raise components_error(str(path), components)
    with opened(data) as file:
        array = rescaled(samples(file, dtype, dims[3::-1], packing_of(file), start), slope, intercept)
    array = array if dims[3] > 1 else array[0]
    return Grid(array, *place, "RAS", tuple(dict.fromkeys((path, data))))


def layout(path: Path) -> Layout:
    from nibabel import Nifti1Header, Nifti2Header, imageglobals

    with opened(path) as file:
        content = start_of(file, HEADER)
        kinds = {348: Nifti1Header, 540: Nifti2Header}
        sizes = [int(np.frombuffer(content, order + "i4", 1)[0]) for order in "<>"]
        kind = next((kinds[size] for size in sizes if size in kinds), None)
        if kind is None:
            raise Flaw("no NIfTI header at its start")
        size = kind.sizeof_hdr
        magic = content[344:348] if size == 348 else content[4:8]
        if len(content) < size or magic[:3] not in (b"n+1", b"n+2", b"ni1", b"ni2"):
            raise Flaw(f"its magic is {magic!r} where n+1, n+2, ni1 or ni2 is expected")
        with imageglobals.LoggingOutputSuppressor():
            head = kind.from_fileobj(BytesIO(content[:size]), check=False)
        place = place_of(path, head)
        dimension, *dims = (int(n) for n in head["dim"])
        if not 1 <= dimension <= 7 or min(dims[:dimension]) < 1:
            raise Flaw(f"its header has the dimensions {dims[: max(dimension, 0)]}")
        dtype = head.get_data_dtype()
        pair = magic[1:2] == b"i"
        start, least = int(head["vox_offset"]), 0 if pair else size
        if start < least and start != 0:
            raise Flaw(f"its samples start at byte {start}, within its header of {least}")
        # A slope of 0 or NaN means none.
        slope, intercept = float(head["scl_slope"]), float(head["scl_inter"])
        if not slope or not np.isfinite(slope):
            slope, intercept = 1.0, 0.0
    data = _partner(path) if pair else path
    intercept = intercept if np.isfinite(intercept) else 0.0
    return Layout(data, dtype, tuple(dims[:dimension]), max(start, least), slope, intercept, place)


def read_mgh(path: Path) -> Grid:
    from nibabel.freesurfer.mghformat import MGHHeader

    with opened(path) as file:
        content = start_of(file, MGHHeader.template_dtype.itemsize)
        head = MGHHeader.from_fileobj(BytesIO(content), check=False)
        if head["version"] != 1:
            raise Flaw(f"its version is {head['version']}; 1 is known")
        affine = head.get_affine()
        dtype, shape = head.get_data_dtype(), head["dims"].tolist()
        if min(shape) < 1:
            raise Flaw(f"its header has the dimensions {shape}")
        # After the samples there may be more, of any length.
        array = samples(file, dtype, shape[::-1], packing_of(file), head.get_data_offset(), footer=True)
    return Grid(array if shape[3] > 1 else array[0], affine[:3, :3], affine[:3, 3], "RAS", (path,))


def _partner(path: Path) -> Path:
    """The file with the samples of a header."""
    name = path.name.removesuffix(".gz")
    stem = name[:-4]
    for candidate in (f"{stem}.img", f"{stem}.img.gz", f"{stem}.IMG"):
        if (path.parent / candidate).exists():
            return path.parent / candidate
    raise FileNotFoundError(f"{path} is the header of {stem}.img, which is not beside it")


def place_of(path: Path, head: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """That of the sform; where it is none, of the qform; without one, spacing alone."""
    for name in ("sform", "qform"):
        # Codes that say what it is are > 0; one that is all zero is none.
        if head[f"{name}_code"] <= 0 or not np.any((form := getattr(head, f"get_{name}")())[:3, :3]):
            continue
        if not np.all(np.isfinite(form)) or np.linalg.det(form[:3, :3]) == 0:
            raise Flaw(f"its {name} is {form[:3].tolist()}, which is no place in the world")
        return form[:3, :3].astype(np.float64), form[:3, 3].astype(np.float64)
    spacing = np.abs(head["pixdim"][1:4].astype(np.float64))
    if not np.all(spacing > 0):
        spacing = np.where(spacing > 0, spacing, guess(path, "how wide voxels are along every axis"))
    return np.diag(spacing), np.zeros(3)
