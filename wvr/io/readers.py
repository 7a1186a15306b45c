"""Reads the volume in a file or folder, with the reader of its extension or content."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from math import prod
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..files import regular
from ..interop import RESAMPLE
from ..samples import Grid, NanPolicy, Unsupported, narrowed
from ..validation import choice, path_of
from ..volume import Volume
from .amira import read_amira
from .bytes import layout_of
from .dicom import dicom_files, is_dicom, read_dicom, read_dicom_folder
from .hdf5 import read_hdf5
from .meta_image import read_meta_image
from .mrc import read_mrc
from .nifti import read_mgh, read_nifti
from .npy import read_npy, read_npz
from .nrrd import read_nrrd
from .slices import read_slices, slice_files
from .tiff import read_tiff
from .vtk_legacy import read_legacy
from .vtk_xml import read_vti


def read(
    path: str | os.PathLike[str], scalars: str | None = None, nan: NanPolicy = "error", frame: int | None = None
) -> Volume:
    """The volume in a file or folder.

    Parameters
    ----------
    path
        NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), NIfTI (.nii, .nii.gz, .hdr and .img), MGH (.mgh, .mgz), MRC and
        CCP4 (.mrc, .map, .ccp4), VTK image data (.vti, legacy .vtk), AmiraMesh (.am), TIFF with a page per slice
        (.tif, .tiff), NumPy (.npy, .npz, axes z, y, x), HDF5 (.h5, .hdf5), DICOM (any name); or a folder with either
        one TIFF, PNG, JPEG or BMP image per slice, in natural order of their names, or one DICOM series, in order of
        position.
    scalars
        Name of the array, for VTK, AmiraMesh, npz and HDF5 files with several; by default the only or, of VTK's, the
        active one. Samples stored on cells sit at the cells' centres: the volume is then half a cell smaller on every
        side than the file's box.
    nan
        What to do with NaN and infinite samples, see :class:`Volume`.
    frame
        Which volume, from 0 on, of a file or series with several in time (of NumPy and HDF5 files, along the first of
        four axes).

    Returns
    -------
    Volume
        ``array[z, y, x]`` in the file's dtype (but for bool and wide integers, which become the smallest dtype that
        holds every value) and world coordinates. TIFF spacing is known from ImageJ and OME files only, NumPy files and
        other images have none: 1.

    Raises
    ------
    FileNotFoundError
        No such file, or a folder without slices.
    OSError
        A truncated or corrupt file, one that holds more or less than it declares, or no regular file.
    ImportError
        A format that needs a package that is not there; the message names it.
    MemoryError
        A volume for which there is no memory.
    ValueError
        An unknown extension, more than one component a sample, a grid that is not regular, an unknown ``scalars``,
        several volumes without ``frame``, or samples that :class:`Volume` refuses.
    """
    path = path_of(path)
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, "no such file or folder", str(path))
    if path.is_dir():
        grid = _read_folder(path, scalars)
    else:
        regular(path)
        reader = _reader(path)
        if scalars is not None and not reader.named:
            raise _unnamed(path, scalars)
        grid = reader.read(path, scalars) if reader.named else reader.read(path)
    array = _frame_of(path, grid.array, frame)
    try:
        with np.errstate(all="ignore"):
            lengths = np.linalg.norm(grid.steps, axis=0)
            direction = grid.steps / np.where(lengths > 0, lengths, 1)
        volume = Volume(narrowed(array), lengths, grid.origin, direction, nan)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{path}: {error}") from None
    volume.anatomical, volume.files = grid.anatomical, grid.files
    return volume


def _frame_of(path: Path, array: NDArray, frame: int | None) -> NDArray:
    """The volume to render of one, or of several in time."""
    if array.ndim != 4:
        if frame is not None and not (isinstance(frame, int | np.integer) and frame == 0):
            raise ValueError(f"frame must be 0 or None for one volume, as in {path}, got {frame!r}")
        return array
    count = len(array)
    if frame is None and count > 1:
        raise ValueError(f"{path} holds {count} volumes (time): pick one with frame=, from 0 to {count - 1}")
    frame = 0 if frame is None else frame
    if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)) or not 0 <= frame < count:
        raise ValueError(f"frame must be an integer from 0 to {count - 1}, as {path} holds {count}, got {frame!r}")
    # Not the others with it in memory.
    return array[frame].copy() if count > 1 else array[frame]


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
    path = path_of(path)
    size = regular(path)
    counts, kind = layout_of(shape, dtype, offset)
    choice(byteorder, "byteorder", ("little", "big"))
    kind = kind.newbyteorder("<" if byteorder == "little" else ">")
    expected = offset + kind.itemsize * prod(counts)
    if size != expected:
        odd = f"{abs(size - expected):,} too {'many' if size > expected else 'few'}"
        raise OSError(
            f"{path} has {size} bytes; {offset} + {counts} samples of {kind.name} are {expected} bytes: {odd}; "
            f"check shape, dtype and offset"
        )
    array = np.memmap(path, kind, "r", offset, counts)
    volume = Volume(narrowed(array), spacing, origin, direction, nan)
    volume.files = (path,)
    return volume


class Format(NamedTuple):
    """How files of an extension are read, and whether their arrays have names."""

    read: Callable[..., Grid]
    named: bool = False


READERS = {
    ".nrrd": Format(read_nrrd),
    ".nhdr": Format(read_nrrd),
    ".mha": Format(read_meta_image),
    ".mhd": Format(read_meta_image),
    ".nii": Format(read_nifti),
    ".nii.gz": Format(read_nifti),
    ".hdr": Format(read_nifti),
    ".mgh": Format(read_mgh),
    ".mgz": Format(read_mgh),
    ".mrc": Format(read_mrc),
    ".mrc.gz": Format(read_mrc),
    ".map": Format(read_mrc),
    ".map.gz": Format(read_mrc),
    ".ccp4": Format(read_mrc),
    ".vti": Format(read_vti, named=True),
    ".vtk": Format(read_legacy, named=True),
    ".am": Format(read_amira, named=True),
    ".tif": Format(read_tiff),
    ".tiff": Format(read_tiff),
    ".dcm": Format(read_dicom),
    ".npy": Format(read_npy),
    ".npz": Format(read_npz, named=True),
    ".h5": Format(read_hdf5, named=True),
    ".hdf5": Format(read_hdf5, named=True),
}
OTHER_GRIDS = {
    ".vtr": "rectilinear grid",
    ".vts": "curvilinear grid",
    ".vtu": "unstructured grid",
    ".vtp": "surface",
}
BARE = (".raw", ".bin", ".dat")


def _unnamed(path: Path, scalars: str) -> ValueError:
    return ValueError(f"scalars={scalars!r}: {path} holds one array without a name; leave scalars out")


def _reader(path: Path) -> Format:
    name = path.name.lower()
    for ending, reader in READERS.items():
        if name.endswith(ending):
            return reader
    if is_dicom(path):
        return READERS[".dcm"]
    if path.suffix.lower() in OTHER_GRIDS:
        raise ValueError(f"{path} holds a {OTHER_GRIDS[path.suffix.lower()]}; {RESAMPLE}")
    if path.suffix.lower() in BARE:
        raise ValueError(
            f"{path} holds bare samples, and does not say how many: wvr.read_raw(path, (nz, ny, nx), dtype) reads it, "
            f"on the command line --shape NZ,NY,NX --dtype uint16"
        )
    raise ValueError(
        f"{path} has an unknown extension; accepted are {', '.join(READERS)}, DICOM under any name, and folders of "
        f"TIFF, PNG, JPEG, BMP or DICOM slices; bare samples: wvr.read_raw (wvr render --shape --dtype); netCDF 4 and "
        f"zarr: wvr.open; what PyVista reads: wvr.Volume.from_pyvista(pyvista.read(path))"
    )


def _read_folder(path: Path, scalars: str | None) -> Grid:
    if scalars is not None:
        raise _unnamed(path, scalars)
    images = slice_files(path)
    dicom = dicom_files(path, below=not images)
    if images and dicom:
        raise Unsupported(f"{path} holds {len(images)} images and {len(dicom)} DICOM files; keep one kind")
    if not images and not dicom:
        raise FileNotFoundError(
            errno.ENOENT, "no TIFF, PNG, JPEG, BMP or DICOM images in the folder (wvr.open is for zarr)", str(path)
        )
    return read_slices(path) if images else read_dicom_folder(path)
