"""TIFF: a page per slice, by tifffile."""

from __future__ import annotations

import logging
import lzma
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, Unsupported, components_error, rescaled
from .bytes import DENSEST, Flaw, corrupt, empty, guess, opened
from .space import in_first_unit

# Of the codes of compression that tifffile unpacks itself, by what, up to a length.
UNPACK: dict[int, Callable[[bytes, int], bytes]] = {
    **dict.fromkeys((8, 32946), lambda data, most: zlib.decompressobj().decompress(data, most)),
    34925: lambda data, most: lzma.LZMADecompressor(memlimit=1 << 28).decompress(data, most),
}

# Kinds of ImageJ's calibrations.
STRAIGHT, NOT_CALIBRATED = 0, 20


def read_tiff(path: Path) -> Grid:
    array, spacing = stack(path)
    return Grid(array, np.diag(spacing), np.zeros(3), "", (path,))


def stack(path: Path) -> tuple[NDArray, list[float]]:
    """Samples (z, y, x), or (time, z, y, x), and spacing (x, y, z) of a TIFF file."""
    import tifffile

    with opened(path) as opened_file, _raising_log("tifffile"), tifffile.TiffFile(opened_file) as file:
        pages, size, form = list(file.pages), path.stat().st_size, file.tiff
        # tifffile does without a last directory's end, and fills strips that are not there with zeros.
        ends = [pages[-1].offset + form.tagnosize + form.tagsize * len(pages[-1].tags) + form.offsetsize]
        strips = [strip for page in pages for strip in zip(page.dataoffsets, page.databytecounts, strict=True)]
        if max(ends + [offset + count for offset, count in strips]) > size or not all(count for _, count in strips):
            raise Flaw("some of its samples are missing")
        series, spacing = file.series, _spacing(path, file)
        head = (file.imagej_metadata or {}) if file.is_imagej else {}
        axes, shape, dtype = series[0].axes, series[0].shape, series[0].dtype
        # As many samples as there may be in so many bytes, before any memory is taken for them.
        packing = "raw" if all(page.compression == 1 for page in pages) else "image"
        for page in pages:
            # Of less than a byte each, such as masks have, there are more.
            held = sum(page.databytecounts) * 8 * np.dtype(page.dtype).itemsize // page.bitspersample
            empty(page.shape, page.dtype, held, packing)
        _check_strips(opened_file, pages)
        if 0 in shape:
            raise Flaw(f"its images have no samples: {shape}")
        if len(series) > 1:
            raise Unsupported(f"it holds {len(series)} images of different size or type, a volume is one: split it")
        extra = [n for n, axis in zip(shape, axes, strict=True) if axis not in "TZYX"]
        lead = {axis: n for n, axis in zip(shape, axes, strict=True) if axis in "TZ"}
        if axes[-2:] != "YX" or (axes[0] in "CS" and int(np.prod(extra)) != 1) or len(shape) > 4:
            raise components_error(f"{path} (axes {axes}, shape {shape})", int(np.prod(extra)))
        # Pages without a meaning of their own are slices; those of a plain stack may be called time.
        if len(shape) == 4 and axes[:2] not in ("TZ", "ZT"):
            raise components_error(f"{path} (axes {axes}, shape {shape})", int(np.prod(extra)))
    with corrupt(path), _raising_log("tifffile"):
        array = _calibrated(_samples_of(path, dtype, pages).reshape(shape), head)
    if len(shape) == 4 and len(lead) == 2:
        return (array if axes[0] == "T" else array.swapaxes(0, 1)), spacing
    return array.reshape(-1, *shape[-2:]), spacing


def _check_strips(file: BinaryIO, pages: Sequence[Any]) -> None:
    """Strips hold no more than their page, where they could hold much more: they are unpacked as a whole."""
    for page in pages:
        unpack = UNPACK.get(int(page.compression))
        for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
            if unpack is not None and count * DENSEST["lzma"] > max(64 << 20, 4 * page.nbytes):
                file.seek(offset)
                if len(unpack(file.read(count), page.nbytes + 1)) > page.nbytes:
                    raise Flaw("a strip of its samples holds more than the whole page")


def _samples_of(path: Path, dtype: np.dtype, pages: Sequence[Any]) -> NDArray:
    import tifffile

    try:
        return tifffile.imread(path)
    except (ValueError, NotImplementedError) as error:
        if "imagecodecs" not in str(error):
            raise
        without = str(error)
    # LZW and other codecs that tifffile leaves to a package of its own are in Pillow.
    from PIL import Image, UnidentifiedImageError

    slices = []
    try:
        opened_image = Image.open(path)
    except UnidentifiedImageError:
        raise Unsupported(f"{without}, and Pillow does not read it either: pip install imagecodecs") from None
    with opened_image as image:
        for number, page in enumerate(pages):
            image.seek(number)
            # It turns bytes round where 0 is white, of which there is no more to be shown than of others.
            white = page.photometric == tifffile.PHOTOMETRIC.MINISWHITE and image.mode in ("1", "L")
            samples = ~np.array(image) if white else np.array(image)
            # Greys of 2 and 4 bits it spreads over 8.
            spread = 255 // (2**page.bitspersample - 1) if image.mode == "L" and page.bitspersample < 8 else 1
            slices.append(samples // spread if spread > 1 else samples)
    return np.stack(slices).astype(dtype)


def _spacing(path: Path, file: Any) -> list[float]:
    """Spacing along x, y, z where the file states a voxel's size; a plain resolution is one of print: 1."""
    if file.is_ome:
        head = file.ome_metadata
        units = dict(re.findall(r'PhysicalSize([XYZ])Unit="([^"]*)"', head))
        sizes = dict(re.findall(r'PhysicalSize([XYZ])="([^"]*)"', head))
        # Without a unit it is the micrometre.
        given = [units.get(axis, "µm") for axis in "XYZ" if axis in sizes]
        found = iter(in_first_unit([float(sizes[axis]) for axis in "XYZ" if axis in sizes], given) if given else [])
        return [next(found) if axis in sizes else 1.0 for axis in "XYZ"]
    if not file.is_imagej:
        return [1.0, 1.0, 1.0]
    head, tags = file.imagej_metadata, file.pages[0].tags
    per_unit = [tags[name].value if name in tags else (1, 1) for name in ("XResolution", "YResolution")]
    lengths = [d / n if n else 1.0 for n, d in per_unit] + [abs(float(head.get("spacing", 1.0)))]
    if "spacing" not in head and lengths[:2] != [1.0, 1.0] and len(file.pages) > 1:
        guess(path, "how far slices are apart, only how wide pixels are")
    unit = str(head.get("unit", ""))
    return in_first_unit(lengths, [unit, str(head.get("yunit", unit)), str(head.get("zunit", unit))])


def _calibrated(array: NDArray, head: dict[str, Any]) -> NDArray:
    """Values as ImageJ makes them of samples, such as those of 16 bits with a sign; of 32 bits they are the same."""
    function = head.get("cf", NOT_CALIBRATED)
    if function == NOT_CALIBRATED or array.dtype.itemsize > 2:
        return array
    if function != STRAIGHT or not all(isinstance(head.get(name), int | float) for name in ("c0", "c1")):
        raise Unsupported(f"its ImageJ calibration is no straight line (cf={function}): take it away in ImageJ first")
    values = rescaled(array, float(head["c1"]), float(head["c0"]))
    return np.maximum(values, 0) if head.get("zeroclip") else values


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
