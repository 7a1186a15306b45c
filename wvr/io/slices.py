"""A folder with an image per slice, in natural order of their names: TIFF by tifffile, PNG, JPEG and BMP by Pillow."""

from __future__ import annotations

import re
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, Unsupported, components_error
from ..validation import outside
from .bytes import corrupt, empty, opened
from .tiff import stack

KINDS = {".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP"}


def slice_files(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.suffix.lower() in KINDS and file.is_file()]


def read_slices(folder: Path) -> Grid:
    """The slices of the only kind of image there is in a folder."""
    files = sorted(slice_files(folder), key=lambda file: [int(t) if t.isdigit() else t for t in _digits(file.name)])
    kinds = sorted({KINDS[file.suffix.lower()] for file in files})
    if len(kinds) > 1:
        raise Unsupported(f"{folder} holds {' and '.join(kinds)} images; keep one kind")
    _look_for_gaps(folder, files)
    first, spacing = _slice(files[0])
    array = np.empty((0, 0, 0))
    for place, file in enumerate(files):
        pixels = first if place == 0 else _slice(file)[0]
        if pixels.shape != (1, *first.shape[1:]) or pixels.dtype != first.dtype:
            raise Unsupported(
                f"{file} holds {pixels.shape} {pixels.dtype}, one slice (1, {first.shape[1]}, {first.shape[2]}) of "
                f"{first.dtype} is expected, as in {files[0].name}"
            )
        if place == 0:
            with corrupt(folder):
                array = empty((len(files), *first.shape[1:]), first.dtype, len(files) * first.nbytes)
        array[place] = pixels[0]
    return Grid(array, np.diag(spacing), np.zeros(3), "", tuple(files))


def _look_for_gaps(folder: Path, files: list[Path]) -> None:
    """Warn where the one number that counts through the names leaves some out."""
    parts = [_digits(file.name) for file in files]
    if len({len(part) for part in parts}) > 1:
        return
    counting = [of for of in zip(*parts, strict=True) if len(set(of)) > 1]
    if len(counting) != 1 or not all(part.isdigit() for part in counting[0]):
        return
    steps = [int(b) - int(a) for a, b in pairwise(counting[0])]
    least = min(steps)
    if least > 0 and max(steps) > least and not any(step % least for step in steps):
        at = next(n for n, step in enumerate(steps) if step > least)
        warnings.warn(
            f"{folder} has no slice between {files[at].name} and {files[at + 1].name}: they are taken as neighbours",
            UserWarning,
            stacklevel=outside(),
        )


def _digits(name: str) -> list[str]:
    return re.split(r"(\d+)", name.lower())


def _slice(path: Path) -> tuple[NDArray, list[float]]:
    return stack(path) if KINDS[path.suffix.lower()] == "TIFF" else (_pixels(path)[None], [1.0, 1.0, 1.0])


def _pixels(path: Path) -> NDArray:
    """Grey values (y, x); colours that are all grey count as such."""
    from PIL import Image

    with opened(path) as file, Image.open(file, formats=("PNG", "JPEG", "BMP")) as image:
        bands = len(image.getbands())
        empty((image.height, image.width, bands), np.uint16, path.stat().st_size, "image")
        if image.mode in ("RGB", "RGBA", "LA") and any(";16" in str(tile[3]) for tile in image.tile):
            raise Unsupported(
                f"{path} has 16 bits a sample in {bands} channels, of which 8 would be read: save it as grey"
            )
        if image.mode == "1":
            return np.array(image.convert("L"))
        if image.mode in ("P", "PA", "CMYK", "YCbCr"):
            image = image.convert("RGB")
        pixels = np.array(image)
        if pixels.ndim == 2:
            # Pillow has 16 bits a sample in more than one way, of which one is wider.
            return pixels.astype(np.uint16) if pixels.dtype == np.int32 and pixels.max(initial=0) < 2**16 else pixels
        colors = pixels[..., : 3 if pixels.shape[2] > 2 else 1]
        if np.any(colors != colors[..., :1]):
            raise components_error(f"{path}, an image in colour,", colors.shape[2])
        return np.ascontiguousarray(colors[..., 0])
