"""``wvr orbit``: a movie around a volume."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from .options import Vector, lighting_of, size_of, transfer_function_of
from .source import Reading
from .stages import Stages


def orbit(
    source: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("orbit.mp4"),
    frames: Annotated[int, Parameter(validator=Number(gte=1))] = 120,
    fps: float = 30.0,
    elevation: float = 20.0,
    turn: float = 360.0,
    size: str = "512x512",
    tf: str | None = None,
    cmap: str | None = None,
    opacity: Vector | None = None,
    clim: Vector | None = None,
    lighting: str | None = None,
    tolerance: float | None = None,
    background: str | None = None,
    reading: Reading = Reading(),  # noqa: B008 - frozen
) -> None:
    """Make a movie of a way around a volume.

    Parameters
    ----------
    source
        File, folder of slices, or name of a dataset.
    output
        .mp4 (needs the package imageio-ffmpeg), .gif, or a new folder of PNG files.
    frames
        How many images.
    fps
        Images a second.
    elevation
        Of the camera above the horizon, in degrees.
    turn
        How far it goes, in degrees, counter-clockwise as seen from above.
    size
        WIDTHxHEIGHT in pixels.
    tf
        As of "wvr render", as are the following.
    cmap
        Colour map.
    opacity
        Of the colour map.
    clim
        LO,HI of the colour map.
    lighting
        on, off, or a mode.
    tolerance
        Largest error of any channel.
    background
        Colour behind the volume.
    """
    import wvr

    light = None if lighting is None else lighting_of(lighting)
    pixels = size_of(size)
    with Stages() as stage:
        volume = reading.load(source, "error", stage)
        function, chosen = transfer_function_of(tf, cmap, opacity, clim, volume)
        if chosen is not None:
            light = chosen.surfaces if light is None else light
            background = "black" if background is None else background
        stage("rendering")
        movie = wvr.orbit(
            volume,
            function,
            frames,
            output,
            size=pixels,
            elevation=elevation,
            turn=turn,
            fps=fps,
            lighting=light,
            tolerance=tolerance,
            background=background,
        )
    print(f"{movie}: {frames} images of {pixels[0]} x {pixels[1]}")
