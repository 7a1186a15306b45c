"""Files of images: eight bits of sRGB, or linear floats."""

from __future__ import annotations

from collections.abc import Callable
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray


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

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "software": "wvr"}
    try:
        with OpenEXR.File(header, {"RGBA": np.ascontiguousarray(rgba, np.float32)}) as exr:
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
# What writes what is no picture, or no pixels.
ELSEWHERE = {
    ".gif": "wvr.orbit, wvr.time_series and wvr.save_movie write movies",
    ".mp4": "wvr.orbit, wvr.time_series and wvr.save_movie write movies",
    ".pdf": "image.plot().figure.savefig(path) writes figures",
    ".svg": "image.plot().figure.savefig(path) writes figures",
    ".html": "wvr.view(data) has a page to turn it",
}
