"""DICOM: one image a file, one series a folder."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error, rescaled
from .bytes import corrupt


def read_dicom(path: Path) -> Grid:
    return _grid(path, [path])


def read_dicom_folder(path: Path) -> Grid:
    return _grid(path, dicom_files(path))


def dicom_files(path: Path) -> list[Path]:
    return [file for file in sorted(path.iterdir()) if file.is_file() and _is_dicom(file)]


def _is_dicom(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM" or path.suffix.lower() == ".dcm"


def _grid(path: Path, files: list[Path]) -> Grid:
    slices = [slice_ for file in files if (slice_ := _slice(file)) is not None]
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
    return Grid(np.stack([slices[k].array for k in order]), steps, place[order[0]], anatomical="LPS")


class _Slice(NamedTuple):
    head: Any
    array: NDArray


def _slice(path: Path) -> _Slice | None:
    """Header and rescaled samples of one DICOM image; None for a file without any, such as a DICOMDIR."""
    try:
        import pydicom
    except ImportError as error:
        raise ImportError("reading DICOM needs the package pydicom: pip install pydicom") from error

    with corrupt(path):
        head = pydicom.dcmread(path)
        if "Rows" not in head:
            return None
        components, frames = int(head.get("SamplesPerPixel", 1)), int(head.get("NumberOfFrames") or 1)
    if components > 1:
        raise components_error(str(path), components)
    if frames > 1:
        raise ValueError(
            f"{path} is a DICOM file of {frames} frames; only one a file is supported: convert it, e.g. to NIfTI"
        )
    with corrupt(path):
        slope, intercept = float(head.get("RescaleSlope", 1)), float(head.get("RescaleIntercept", 0))
        return _Slice(head, rescaled(head.pixel_array, slope, intercept))
