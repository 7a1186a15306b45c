"""Reads the volume in a file or folder, with the reader of its extension or content."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ..interop import RESAMPLE, from_pyvista
from ..samples import NanPolicy, narrowed
from ..volume import Volume
from .dicom import dicom_files, read_dicom, read_dicom_folder
from .meta_image import read_meta_image
from .nifti import read_nifti
from .npy import read_npy
from .nrrd import read_nrrd
from .tiff import read_tiff, read_tiff_folder, tiff_files
from .vtk import read_vtk_image


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
        ``array[z, y, x]`` in the file's dtype (but for bool and wide integers, which become the smallest dtype that
        holds every value) and world coordinates. TIFF spacing is known from ImageJ and OME files only, NumPy files have
        none: 1.

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
    if reader is read_vtk_image:
        return from_pyvista(reader(path), scalars, nan)
    if scalars is not None:
        raise ValueError(f"scalars={scalars!r}: {path} holds one array without a name; leave scalars out")
    array, steps, origin, anatomical = reader(path)
    lengths = np.linalg.norm(steps, axis=0)
    volume = Volume(narrowed(array), lengths, origin, steps / np.where(lengths > 0, lengths, 1), nan)
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
    return Volume(narrowed(array), spacing, origin, direction, nan)


READERS: dict[str, Callable[[Path], Any]] = {
    ".nrrd": read_nrrd,
    ".nhdr": read_nrrd,
    ".mha": read_meta_image,
    ".mhd": read_meta_image,
    ".nii": read_nifti,
    ".nii.gz": read_nifti,
    ".vti": read_vtk_image,
    ".vtk": read_vtk_image,
    ".tif": read_tiff,
    ".tiff": read_tiff,
    ".dcm": read_dicom,
    ".npy": read_npy,
}
OTHER_GRIDS = {
    ".vtr": "rectilinear grid",
    ".vts": "curvilinear grid",
    ".vtu": "unstructured grid",
    ".vtp": "surface",
}


def _file_reader(path: Path) -> Callable[[Path], Any]:
    name = path.name.lower()
    for ending, reader in READERS.items():
        if name.endswith(ending):
            return reader
    if path.suffix.lower() in OTHER_GRIDS:
        raise ValueError(f"{path} holds a {OTHER_GRIDS[path.suffix.lower()]}; {RESAMPLE}")
    raise ValueError(
        f"{path} has an unknown extension; accepted are {', '.join(READERS)} and folders of TIFF or DICOM slices; "
        f"bare samples: wvr.read_raw; what PyVista reads: wvr.Volume.from_pyvista(pyvista.read(path))"
    )


def _folder_reader(path: Path) -> Callable[[Path], Any]:
    tiff, dicom = tiff_files(path), dicom_files(path)
    if tiff and dicom:
        raise ValueError(f"{path} holds {len(tiff)} TIFF and {len(dicom)} DICOM files; keep one kind")
    if not tiff and not dicom:
        raise FileNotFoundError(errno.ENOENT, "no TIFF or DICOM images in the folder", str(path))
    return read_tiff_folder if tiff else read_dicom_folder
