"""TIFF: a page per slice, or a folder with a file per slice."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error
from .bytes import corrupt


def read_tiff(path: Path) -> Grid:
    array, spacing = _stack(path)
    return Grid(array, np.diag(spacing), np.zeros(3))


def read_tiff_folder(path: Path) -> Grid:
    files = sorted(tiff_files(path), key=lambda file: [int(t) if t.isdigit() else t for t in _digits(file.name)])
    slices = [_stack(file) for file in files]
    first, spacing = slices[0]
    for file, (array, _) in zip(files, slices, strict=True):
        if array.shape != (1, *first.shape[1:]) or array.dtype != first.dtype:
            raise ValueError(
                f"{file} holds {array.shape} {array.dtype}, one slice (1, {first.shape[1]}, {first.shape[2]}) of "
                f"{first.dtype} is expected, as in {files[0].name}"
            )
    return Grid(np.concatenate([array for array, _ in slices]), np.diag(spacing), np.zeros(3))


def _digits(name: str) -> list[str]:
    return re.split(r"(\d+)", name.lower())


def tiff_files(path: Path) -> list[Path]:
    return [file for file in path.iterdir() if file.suffix.lower() in (".tif", ".tiff") and file.is_file()]


def _stack(path: Path) -> tuple[NDArray, list[float]]:
    """Samples (z, y, x) and spacing (x, y, z) of a TIFF file."""
    import tifffile

    with corrupt(path), _raising_log("tifffile"), tifffile.TiffFile(path) as file:
        pages, size, form = list(file.pages), path.stat().st_size, file.tiff
        # tifffile does without a last directory's end, and fills strips that are not there with zeros.
        ends = [pages[-1].offset + form.tagnosize + form.tagsize * len(pages[-1].tags) + form.offsetsize]
        strips = [strip for page in pages for strip in zip(page.dataoffsets, page.databytecounts, strict=True)]
        if max(ends + [offset + count for offset, count in strips]) > size or not all(count for _, count in strips):
            raise EOFError("some of its samples are missing")
        series, spacing = file.series, _spacing(file)
        axes, shape, dtype = series[0].axes, series[0].shape, series[0].dtype
    if len(series) > 1:
        raise ValueError(
            f"{path} holds {len(series)} images of different size or type; a volume is one: split the file"
        )
    if axes[-2:] != "YX" or len(shape) > 3 or axes[0] in "CS":
        extra = [n for n, axis in zip(shape, axes, strict=True) if axis not in "ZYX"]
        raise components_error(f"{path} (axes {axes}, shape {shape})", int(np.prod(extra)))
    with corrupt(path), _raising_log("tifffile"):
        array = _samples_of(path, dtype, len(pages))
    return array.reshape(-1, *shape[-2:]), spacing


def _samples_of(path: Path, dtype: np.dtype, pages: int) -> NDArray:
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


def _spacing(file: Any) -> list[float]:
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
