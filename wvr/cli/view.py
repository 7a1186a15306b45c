"""``wvr view``: a volume to turn, in a browser."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from .look import Look
from .source import Input
from .stages import Stages
from .stores import Level, whole


def view(
    *sources: str,
    port: Annotated[int, Parameter(validator=Number(gte=0, lte=65535))] = 0,
    open_browser: Annotated[bool, Parameter(negative="--no-open-browser")] = True,
    level: Level = None,
    select: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    look: Look = Look(),  # noqa: B008 - frozen
    reading: Input = Input(),  # noqa: B008 - frozen
) -> None:
    """Turn, light, cut and classify a volume in a browser, until Ctrl-C.

    The page is on this machine alone (127.0.0.1), and its address, which is printed, has a token in it that is new each
    time, or what the environment variable WVR_VIEW_TOKEN says.

    Parameters
    ----------
    sources
        File, folder of slices, or name of a dataset; several are a series in time.
    port
        Of the page; 0 is a free one.
    open_browser
        Whether to open the page in a browser.
    level
        Of a store (zarr, OME-Zarr) that is a pyramid, 0 is the finest. All of it is read into memory.
    select
        AXIS:INDEX of a store's axes that are not x, y or z: t:0, c:1. May be given several times.
    """
    import wvr

    if not sources:
        raise ValueError("give a file, a folder of slices or the name of a dataset")
    if look.size != Look.size:
        raise ValueError(f"--size is for images, a page has its own, got {look.size!r}")
    keywords = look.keywords()
    with Stages() as stage:
        volumes = [whole(source, level, select, look.nan, reading, stage) for source in sources]
        keywords = look.of(volumes[0], keywords).keywords
        del keywords["size"]
        token = os.environ.get("WVR_VIEW_TOKEN") or None
        viewer = wvr.view(volumes, port=port, open_browser=False, token=token, **keywords)
    # Ctrl-C is how it ends, whenever it comes.
    with viewer, suppress(KeyboardInterrupt):
        print(viewer.address, flush=True)
        print("wvr: Ctrl-C ends it", file=sys.stderr)
        if open_browser:
            import webbrowser

            webbrowser.open(viewer.address)
        viewer.wait(forever=True)
