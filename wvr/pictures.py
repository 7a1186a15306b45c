"""Files of images: eight bits of sRGB, or linear floats."""

from __future__ import annotations

from collections.abc import Callable
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray


def check_sides(suffix: str, size: tuple[int, int], name: str) -> None:
    """Say so where a format does not hold so many pixels along a side; ``name`` is that of the path."""
    if max(size) > (most := WIDEST.get(suffix, max(size))):
        raise ValueError(
            f"{name} must be of a format that holds {size[0]} x {size[1]} pixels, got {suffix}, which holds up to "
            f"{most} along a side"
        )


def write_png(file: BinaryIO, pixels: NDArray[np.uint8]) -> None:
    from PIL import Image as PillowImage
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    info.add_text("Software", "wvr")
    PillowImage.fromarray(pixels).save(file, "PNG", pnginfo=info)


def write_jpeg(file: BinaryIO, pixels: NDArray[np.uint8]) -> None:
    from PIL import Image as PillowImage

    PillowImage.fromarray(pixels).save(file, "JPEG", quality=95, subsampling=0)


def write_exr(file: BinaryIO, rgba: NDArray[np.floating]) -> None:
    import OpenEXR

    with np.errstate(over="ignore"):
        pixels = np.ascontiguousarray(rgba, np.float32)
    if pixels.dtype != rgba.dtype and not np.array_equal(np.isfinite(pixels), np.isfinite(rgba)):
        most = np.abs(rgba[np.isfinite(rgba)]).max()
        raise ValueError(f"path must end in .tiff or .npy for numbers up to {most:.3g}, got .exr, which is float32")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "software": "wvr"}
    try:
        with OpenEXR.File(header, {"RGBA": pixels}) as exr:
            exr.write(file.name)
    except RuntimeError as error:
        raise OSError(f"could not write the EXR file: {error}") from error


def write_tiff(file: BinaryIO, rgba: NDArray[np.floating]) -> None:
    import tifffile

    tifffile.imwrite(file, rgba, photometric="rgb", extrasamples=["assocalpha"], metadata=None, software="wvr")


PIXEL_WRITERS: dict[str, Callable[[BinaryIO, NDArray[np.uint8]], None]] = {
    ".png": write_png,
    ".jpg": write_jpeg,
    ".jpeg": write_jpeg,
}
FLOAT_WRITERS: dict[str, Callable[[BinaryIO, NDArray[np.floating]], None]] = {
    ".exr": write_exr,
    ".tif": write_tiff,
    ".tiff": write_tiff,
    ".npy": np.save,
}
# Pixels along a side that formats of files, or those who write them, hold.
WIDEST = {".jpg": 65500, ".jpeg": 65500, ".gif": 65535, ".mp4": 16384}
# What writes what is no picture, or no pixels.
ELSEWHERE = {
    ".gif": "wvr.orbit, wvr.time_series and wvr.save_movie write movies",
    ".mp4": "wvr.orbit, wvr.time_series and wvr.save_movie write movies",
    ".pdf": "image.plot().figure.savefig(path) writes figures",
    ".svg": "image.plot().figure.savefig(path) writes figures",
    ".html": "wvr.view(data) has a page to turn it",
}
