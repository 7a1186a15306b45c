"""Many images: around a volume, through time, and into a movie."""

from __future__ import annotations

import os
import shutil
import stat
import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from .camera import Camera, image_size
from .cuts.base import clip_list
from .defaults import Call, lighting_of, shadows_of
from .files import scratch_folder
from .framing import framed, visible_points
from .image import Image
from .keywords import MovieOptions, refuse
from .pictures import check_sides
from .renderer import Renderer
from .sources import as_volume
from .validation import any_array, integer, outside, path_of, positive, within
from .views import View, seen_around, suggested_view
from .volume import Volume

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .keywords import OrbitOptions, SeriesOptions

SUFFIXES = (".mp4", ".gif")
# Images a second.
SLOWEST, FASTEST = 1 / 600, 1000.0
# What of a call of render says how it looks; a Renderer takes the rest.
LOOK = ("opacity", "clim", "lighting", "shadows", "background", "segmentation")


@overload
def orbit(
    data: Any, transfer_function: Any = ..., frames: int = ..., output: None = ..., **options: Unpack[OrbitOptions]
) -> Iterator[Image]: ...
@overload
def orbit(
    data: Any,
    transfer_function: Any = ...,
    frames: int = ...,
    *,
    output: str | os.PathLike[str],
    **options: Unpack[OrbitOptions],
) -> Path: ...
@overload
def orbit(
    data: Any, transfer_function: Any, frames: int, output: str | os.PathLike[str], **options: Unpack[OrbitOptions]
) -> Path: ...
def orbit(
    data: Any,
    transfer_function: Any = None,
    frames: int = 120,
    output: str | os.PathLike[str] | None = None,
    *,
    size: tuple[int, int] = (512, 512),
    elevation: float = 20.0,
    turn: float = 360.0,
    fps: float = 30.0,
    **options: Unpack[MovieOptions],
) -> Iterator[Image] | Path:
    """Images from a way around a volume, or a movie of them.

    Parameters
    ----------
    data, transfer_function
        As of :func:`wvr.render`.
    frames
        How many, >= 1, equally spaced over the ``turn``.
    output
        ``.mp4`` (which needs the package imageio-ffmpeg), ``.gif``, or a folder of PNG files; see :func:`save_movie`.
        By default there is no movie, and images are rendered as they are asked for.
    size
        (width, height) in pixels.
    elevation
        Of the camera above the horizon [degrees]; the horizon, and the side where it begins, are those of the view
        that ``render`` chooses.
    turn
        How far it goes, counter-clockwise as seen from above [degrees].
    fps
        Images a second; a GIF plays at most 50.
    **options
        Other keywords of :func:`wvr.render`: ``opacity``, ``lighting``, ``tolerance``, ... The distance is one from
        which all that is visible is in all frames; light stays where the camera is.

    Returns
    -------
    pathlib.Path or iterator of Image
        Where the movie is, or the images.

    Examples
    --------
    >>> import wvr
    >>> [image.size for image in wvr.orbit(wvr.datasets.load("blobs", 16), frames=2, size=(8, 6))]
    [(8, 6), (8, 6)]
    """
    frames = integer(frames, "frames", 1)
    elevation, turn = within(elevation, "elevation", 90.0), within(turn, "turn", np.inf)
    size = image_size(size)
    _check_output(output, fps, size)
    volume = as_volume(data)
    if "camera" in options:
        raise TypeError("camera is what orbit chooses: give elevation and turn")
    call, rest = _split("orbit", transfer_function, options)
    look = call._replace(camera="iso").look(volume, size)
    placed = call.looks_at(volume)[1]  # as ``render`` frames it
    points = visible_points(placed, look.shown, clip_list(call.clip))
    cameras = _around(points, placed, frames, elevation, turn, size[0] / size[1])
    renderer = Renderer(
        volume, look.transfer_function, background=look.background, segmentation=look.segmentation, **rest
    )

    def images() -> Iterator[Image]:
        for camera in cameras:
            renderer.lighting = lighting_of(call.lighting, look.lighting is not None, camera)
            renderer.shadows = shadows_of(call.shadows, renderer.lighting, camera)
            yield renderer.render(camera, size)

    if output is None:
        return images()
    return save_movie(images(), output, fps, frames)


def _level(view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors: where a view is from, on the horizon, and upwards."""
    up = view.up / np.linalg.norm(view.up)
    front = view.direction - (view.direction @ up) * up
    return front / np.linalg.norm(front), up


def _around(
    points: NDArray[np.float64], volume: Any, frames: int, elevation: float, turn: float, aspect: float
) -> Iterator[Camera]:
    """Cameras at one distance, on which all points are in all frames."""
    level = _level(suggested_view(volume))

    def view(n: int) -> View:
        return seen_around(*level, turn * (n / frames), elevation)

    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    distance = 0.0
    for n in range(0, frames, max(1, frames // 36)):
        # Mirrored at the middle as well, so that the nearest camera is right in front of it.
        camera = framed(np.concatenate([points, 2 * middle - points]), *view(n), aspect=aspect)
        distance = max(distance, float(np.linalg.norm(camera.position - middle)))
    return (Camera(middle + distance * direction, middle, up) for direction, up in map(view, range(frames)))


@overload
def time_series(
    data: Any, transfer_function: Any = ..., camera: Any = ..., *, output: None = ..., **options: Unpack[SeriesOptions]
) -> Iterator[Image]: ...
@overload
def time_series(
    data: Any,
    transfer_function: Any = ...,
    camera: Any = ...,
    *,
    output: str | os.PathLike[str],
    **options: Unpack[SeriesOptions],
) -> Path: ...
def time_series(
    data: Any,
    transfer_function: Any = None,
    camera: Any = None,
    *,
    size: tuple[int, int] = (512, 512),
    output: str | os.PathLike[str] | None = None,
    fps: float = 10.0,
    **options: Unpack[MovieOptions],
) -> Iterator[Image] | Path:
    """Images of a volume that changes, all in the same colours from the same camera, or a movie of them.

    Parameters
    ----------
    data
        A sequence of what :func:`wvr.render` takes (volumes, paths, arrays), such as ``sorted(folder.glob("*.nrrd"))``;
        an array with four axes, [t, z, y, x]; or an xarray ``DataArray`` with a dimension named time or t. All must
        have the shape of the first. They are read one after the other.
    transfer_function, camera
        As of :func:`wvr.render`. By default both are suggested for the first volume; a colour map spans the first
        volume's range unless ``clim`` says otherwise.
    size
        (width, height) in pixels.
    output, fps
        As of :func:`orbit`.
    **options
        Other keywords of :func:`wvr.render`.
    """
    size = image_size(size)
    _check_output(output, fps, size)
    moments, count = _moments(data)
    try:
        first = next(moments)
    except StopIteration:
        raise ValueError("data must have at least one volume, got none") from None
    call, rest = _split("time_series", transfer_function, options)
    look = call._replace(camera=camera).look(first, size)
    renderer = Renderer(
        first,
        look.transfer_function,
        lighting=look.lighting,
        shadows=look.shadows,
        background=look.background,
        segmentation=look.segmentation,
        **rest,
    )

    # Colours that are of the first volume are hardly meant for scalars far beyond its own.
    tf = look.transfer_function
    named = (transfer_function is None or isinstance(transfer_function, str)) and call.clim is None
    warned = tf is None or not named or tf.knots[0] < first.range[0] or tf.knots[-1] > first.range[1]

    def images() -> Iterator[Image]:
        nonlocal warned
        for number, volume in enumerate(chain([first], moments)):
            if volume.shape != first.shape:
                raise ValueError(f"volumes of a time series must have one shape, got {first.shape} and {volume.shape}")
            if not warned and _beyond(volume, first):
                warned = True
                warnings.warn(
                    f"the scalars of volume {number} of the series go from {volume.range[0]:g} to {volume.range[1]:g}, "
                    f"colours from {first.range[0]:g} to {first.range[1]:g} as the first volume's do: give clim="
                    f"(low, high) of all",
                    UserWarning,
                    stacklevel=outside(),
                )
            renderer.volume = volume
            yield renderer.render(look.camera, size)

    if output is None:
        return images()
    return save_movie(images(), output, fps, count)


def _beyond(volume: Volume, first: Volume) -> bool:
    """Whether scalars go on for a quarter of the range of the first volume's or more where those end."""
    low, high = first.range
    return max(low - volume.range[0], volume.range[1] - high) >= (high - low) / 4


def _moments(data: Any) -> tuple[Iterator[Volume], int | None]:
    """The volumes one after the other, and how many they are if that is known."""
    # A class is no volume, whatever it has.
    if isinstance(data, str | os.PathLike | type) or not (hasattr(data, "ndim") or isinstance(data, Iterable)):
        raise TypeError(f"data must be a sequence of volumes, paths or arrays, or an array [t, z, y, x], got {data!r}")
    if hasattr(data, "dims") and hasattr(data, "isel"):
        name = next((dim for dim in data.dims if str(dim).lower() in ("time", "t")), None)
        if name is None:
            raise ValueError(f"data must have a dimension named time or t, got {tuple(data.dims)}")
        return (as_volume(data.isel({name: n})) for n in range(data.sizes[name])), int(data.sizes[name])
    if hasattr(data, "ndim"):
        if data.ndim != 4:
            raise ValueError(f"data must be an array of four axes [t, z, y, x], got shape {tuple(data.shape)}")
        return (as_volume(data[n]) for n in range(len(data))), len(data)
    return (as_volume(one) for one in data), len(data) if isinstance(data, Sequence) else None


def _split(function: str, transfer_function: Any, options: MovieOptions) -> tuple[Call, dict[str, Any]]:
    """What says how it looks, and what a renderer is made with."""
    given: dict[str, Any] = dict(options)
    known = MovieOptions.__annotations__
    refuse(function, {name: given[name] for name in given if name not in known}, tuple(known))
    look = {name: given[name] for name in LOOK if name in given}
    call = Call(transfer_function, clip=given.get("clip"), integrator=given.get("integrator"), **look)
    return call, {name: given[name] for name in given if name not in LOOK}


def save_movie(
    images: Iterable[Image], path: str | os.PathLike[str], fps: float = 30.0, count: int | None = None
) -> Path:
    """Write images as a movie; it appears whole or not at all.

    Parameters
    ----------
    images
        All of one size; an iterator is asked for one after the other. Each is put in front of its own background, or
        of white. They may also be uint8 arrays (height, width, 3).
    path
        ``.mp4``, H.264 in 8-bit sRGB with an edge repeated where width or height is odd, which needs the package
        imageio-ffmpeg; ``.gif``; or a name without extension, or ending in ``/``: a
        folder that must not exist or be empty, of files 0000.png, 0001.png, ...
    fps
        Images a second, from 1/600 to 1000. A GIF counts in hundredths of a second.
    count
        How many there will be, for the progress that terminals show; by default what ``len`` says.

    Returns
    -------
    pathlib.Path
        That of the movie.

    Raises
    ------
    ValueError
        For another extension, no images, images of several sizes, a folder with something in it, and where the format
        does not hold so many pixels along a side: 65535 of a GIF, 16384 of an MP4.
    ImportError
        Where imageio-ffmpeg is missing.
    OSError
        Where the movie cannot be written.
    """
    if not isinstance(images, Iterable) or getattr(images, "ndim", 1) == 0:
        raise TypeError(f"images must be iterable, a list of images or the like, got {images!r}")
    named, kind = path_of(path), _kind(path, "path")
    target = Path(os.path.realpath(named))
    _check_fps(fps)
    if count is None and isinstance(images, Sequence):
        count = len(images)
    pixels = _of_one_size(_progress(images, count))
    try:
        first = next(pixels)
    except StopIteration:
        raise ValueError("images must be at least one, got none") from None
    check_sides(kind, first.shape[1::-1], "path")
    parent = target.parent
    if not parent.is_dir():
        raise FileNotFoundError(f"path must be in a folder that exists, got {str(target)!r}")
    with scratch_folder(target) as folder:
        made = folder / ("movie" + kind)
        WRITERS[kind](chain([first], pixels), made, float(fps))
        if kind == "":
            if target.is_dir():
                target.rmdir()
            made.chmod(0o777 & ~_umask())
            shutil.move(made, target)
        else:
            if target.exists():
                made.chmod(stat.S_IMODE(target.stat().st_mode))
            os.replace(made, target)
    return named


def _check_output(output: Any, fps: Any, size: tuple[int, int]) -> None:
    """Of a movie that is asked for, before anything is rendered."""
    if output is not None:
        check_sides(_kind(output, "output"), size, "output")
        _check_fps(fps)


def _check_fps(fps: Any) -> None:
    """What all formats can say: a GIF counts hundredths of a second up to 65535."""
    if not SLOWEST <= positive(fps, "fps") <= FASTEST:
        raise ValueError(f"fps must be from {SLOWEST:g} to {FASTEST:g}, got {fps!r}")


def _kind(given: str | os.PathLike[str], name: str) -> str:
    """The extension of a movie, empty for a folder; ``name`` is that of the argument."""
    path = path_of(given, name)
    suffix = path.suffix.lower()
    folder = os.fsdecode(given).endswith(("/", os.sep)) or suffix == ""
    if not folder and suffix not in SUFFIXES:
        raise ValueError(
            f"{name} must end in {', '.join(SUFFIXES)}, or be a folder (a name ending in /), got {str(path)!r}"
        )
    if folder and path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise ValueError(f"{name} must be a new or empty folder, got {str(path)!r}")
    if suffix == ".mp4" and not folder:
        _ffmpeg()
    return "" if folder else suffix


def _ffmpeg() -> Any:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise ImportError(
            "an .mp4 needs the package imageio-ffmpeg: pip install imageio-ffmpeg; a .gif, or a folder, needs nothing"
        ) from None
    return imageio_ffmpeg


def _of_one_size(images: Iterable[Any]) -> Iterator[NDArray[np.uint8]]:
    size = None
    for image in images:
        pixels = image
        if isinstance(image, Image):
            pixels = image.to_uint8("white" if image.background in (None, "transparent") else None)
        pixels = any_array(pixels, "images")
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
            raise TypeError(f"images must be wvr.Image or uint8 (height, width, 3), got {pixels.dtype} {pixels.shape}")
        if size not in (None, pixels.shape):
            raise ValueError(f"images must have one size, got {size[1::-1]} and {pixels.shape[1::-1]}")
        size = pixels.shape
        yield pixels


def _progress(images: Iterable[Any], count: int | None) -> Iterator[Any]:
    """The same, shown on stderr where that is a terminal or a notebook."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    if not (console.is_terminal or console.is_jupyter):
        return iter(images)
    return iter(track(images, "rendering", total=count, console=console, transient=True))


def _write_mp4(frames: Iterator[NDArray[np.uint8]], path: Path, fps: float) -> None:
    first = next(frames)
    height, width = first.shape[0] + first.shape[0] % 2, first.shape[1] + first.shape[1] % 2
    # Few errors, and colours at every pixel are halved only in chroma, as players expect.
    writer = _ffmpeg().write_frames(
        str(path), (width, height), fps=fps, codec="libx264", quality=None, macro_block_size=1,
        output_params=["-crf", "16", "-preset", "medium"], ffmpeg_log_level="fatal",
    )  # fmt: skip
    writer.send(None)
    count = 0
    try:
        for frame in chain([first], frames):
            count += 1
            padded = np.pad(frame, [(0, height - frame.shape[0]), (0, width - frame.shape[1]), (0, 0)], "edge")
            writer.send(np.ascontiguousarray(padded))
    finally:
        writer.close()
    # Nobody says how ffmpeg ended, and it leaves what it has where a disk is full.
    try:
        written = _ffmpeg().count_frames_and_secs(str(path))[0]
    except (RuntimeError, OSError):
        written = 0
    if written != count:
        raise OSError(
            f"ffmpeg wrote {written} of {count} frames of {width} x {height} pixels: is there space for them?"
        )


def _write_gif(frames: Iterator[NDArray[np.uint8]], path: Path, fps: float) -> None:
    from PIL import Image as PillowImage

    pictures = (PillowImage.fromarray(frame).quantize(256, dither=PillowImage.Dither.NONE) for frame in frames)
    first = next(pictures)
    with path.open("wb") as file:
        first.save(
            file, "GIF", save_all=True, append_images=pictures, duration=max(20, round(1000 / fps)), loop=0, disposal=1
        )


def _write_folder(frames: Iterator[NDArray[np.uint8]], path: Path, fps: float) -> None:
    from .pictures import write_png

    path.mkdir()
    for number, frame in enumerate(frames):
        with (path / f"{number:04d}.png").open("wb") as file:
            write_png(file, frame)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


WRITERS = {".mp4": _write_mp4, ".gif": _write_gif, "": _write_folder}
