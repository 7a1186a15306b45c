"""``wvr orbit``: a movie around a volume."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from .look import Look
from .source import Input, check_kept
from .stages import Stages
from .stores import Streaming


def orbit(
    source: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    frames: Annotated[int, Parameter(validator=Number(gte=1))] = 120,
    fps: float = 30.0,
    elevation: float = 20.0,
    turn: float = 360.0,
    look: Look = Look(),  # noqa: B008 - frozen
    reading: Input = Input(),  # noqa: B008 - frozen
    streaming: Streaming = Streaming(),  # noqa: B008 - frozen
) -> None:
    """Make a movie of a way around a volume.

    Parameters
    ----------
    source
        File, folder of slices, or name of a dataset.
    output
        .mp4 (needs the package imageio-ffmpeg), .gif, or a new folder of PNG files. By default orbit.mp4, or orbit.gif
        without that package.
    frames
        How many images.
    fps
        Images a second.
    elevation
        Of the camera above the horizon, in degrees.
    turn
        How far it goes, in degrees, counter-clockwise as seen from above.
    """
    import wvr

    keywords = look.keywords()
    if output is None:
        output = Path("orbit.mp4" if find_spec("imageio_ffmpeg") else "orbit.gif")
    with Stages() as stage, streaming.client() as client:
        volume = streaming.load(source, look.nan, reading) or reading.load(source, look.nan, stage)
        keywords, read, _ = look.of(volume, keywords)
        check_kept(output, volume.files + read)
        stage("rendering")
        way: Any = {"frames": frames, "fps": fps, "elevation": elevation, "turn": turn}
        movie = wvr.orbit(volume, output=output, **way, **keywords, **streaming.options(client))
    width, height = keywords["size"]
    print(f"{movie}: {frames} images of {width} x {height}")
