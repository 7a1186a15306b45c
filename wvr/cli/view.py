"""``wvr view``: a volume to turn, in a browser."""

from __future__ import annotations

import os
import sys
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from .options import Vector, lighting_of, shadows_of, transfer_function_of
from .source import Reading
from .stages import Stages


def view(
    *sources: str,
    tf: str | None = None,
    cmap: str | None = None,
    opacity: Vector | None = None,
    clim: Vector | None = None,
    lighting: str | None = None,
    shadows: Vector | None = None,
    tolerance: float | None = None,
    background: str | None = None,
    port: Annotated[int, Parameter(validator=Number(gte=0, lte=65535))] = 0,
    open_browser: Annotated[bool, Parameter(negative="--no-open-browser")] = True,
    reading: Reading = Reading(),  # noqa: B008 - frozen
) -> None:
    """Turn, light, cut and classify a volume in a browser, until Ctrl-C.

    The page is on this machine alone (127.0.0.1), and its address, which is printed, has a token in it that is new each
    time, or what the environment variable WVR_VIEW_TOKEN says.

    Parameters
    ----------
    sources
        File, folder of slices, or name of a dataset; several are a series in time.
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
    shadows
        on, headlight, or X,Y,Z towards a light.
    tolerance
        Largest error of any channel.
    background
        Colour behind the volume.
    port
        Of the page; 0 is a free one.
    open_browser
        Whether to open the page in a browser.
    """
    import wvr

    if not sources:
        raise ValueError("give a file, a folder of slices or the name of a dataset")
    light = None if lighting is None else lighting_of(lighting)
    shade = None if shadows is None else shadows_of(shadows)
    with Stages() as stage:
        volumes = [reading.load(source, "error", stage) for source in sources]
        function, chosen = transfer_function_of(tf, cmap, opacity, clim, volumes[0])
        if chosen is not None:
            light = chosen.surfaces if light is None else light
            background = "black" if background is None else background
        viewer = wvr.view(
            volumes,
            function,
            port=port,
            open_browser=False,
            token=os.environ.get("WVR_VIEW_TOKEN") or None,
            lighting=light,
            shadows=shade,
            tolerance=tolerance,
            background=background,
        )
    with viewer:
        print(viewer.address, flush=True)
        print("wvr: Ctrl-C ends it", file=sys.stderr)
        if open_browser:
            import webbrowser

            webbrowser.open(viewer.address)
        viewer.wait(forever=True)
