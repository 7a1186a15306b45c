"""``wvr render``: a volume to an image file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..defaults import framed_by
from ..pictures import ELSEWHERE, FLOAT_WRITERS, PIXEL_WRITERS
from ..validation import at_most
from .look import Look
from .options import Lens, Vector, camera_of
from .source import Input, check_kept
from .stages import Stages
from .stores import Streaming


def render(
    source: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"], allow_leading_hyphen=True)] = None,
    direction: Vector | None = None,
    up: Vector | None = None,
    view_angle: float = 30.0,
    parallel: Annotated[bool, Parameter(negative="")] = False,
    camera: Vector | None = None,
    look: Look = Look(),  # noqa: B008 - frozen
    reading: Input = Input(),  # noqa: B008 - frozen
    streaming: Streaming = Streaming(),  # noqa: B008 - frozen
) -> None:
    """Render a volume to an image file.

    Parameters
    ----------
    source
        File, folder of slices, or name of a dataset.
    output
        Image file: .png, .jpg (8 bits, sRGB), or .exr, .tif, .tiff, .npy (linear floats); "-" writes a PNG to standard
        output. By default the source's name with .png, in the current folder.
    direction
        X,Y,Z from the volume towards the camera. By default, and without --up, a view that suits the data: patients
        from the front, the head above, where the file says how they lie (DICOM, NIfTI, some NRRD); what stands on
        something, or is tall, upright. With --up, 1,0.6,0.4 for z, and turned with it.
    up
        X,Y,Z or an axis (y, -z): upwards in the image. By default as suggested; with --direction z, or y along z.
    view_angle
        Vertical angle of view in degrees.
    parallel
        Orthographic; with --camera, what is at the target keeps its size.
    camera
        A view by name, with all that is visible in the frame: iso, xy, xz, yz, ..., or of patients anterior, left, ...
        Or position and target in world coordinates, PX,PY,PZ,TX,TY,TZ. Instead of --direction.
    """
    import wvr

    keywords = look.keywords()
    width, height = keywords["size"]
    piped = output == Path("-")
    output = Path(f"{_stem(source)}.png") if output is None else output
    if not piped:
        _check_output(output, look.background)
    with Stages() as stage, streaming.client() as client:
        volume = streaming.load(source, look.nan, reading) or reading.load(source, look.nan, stage)
        keywords, read, placed = look.of(volume, keywords)
        if not piped:
            check_kept(output, volume.files + read, source)
        lens = Lens(view_angle, parallel, width / height)
        shown = keywords["segmentation"] or framed_by(keywords["integrator"], keywords["transfer_function"])
        view = camera_of(placed, shown, keywords["clip"], (camera, direction, up), lens)
        stage("rendering")
        image = wvr.render(volume, camera=view, **keywords, **streaming.options(client), progress=stage.share)
        stage(f"writing {output}")
        if piped:
            sys.stdout.buffer.write(image.png())
            sys.stdout.buffer.flush()
        else:
            image.save(output)
    samples, seconds = image.stats["samples"], image.stats["seconds"]
    bound = "" if image.error_bound is None else f", errors up to {at_most(image.max_error)}"
    if bound and (keywords["lighting"] or keywords["shadows"]):
        bound += " but for light"
    report = f"{output}: {width} x {height}, {samples:,} samples, {seconds:.3g} s{bound}"
    print(report, file=sys.stderr if piped else sys.stdout)


def _stem(source: str) -> str:
    path = Path(source).resolve()
    return Path(path.name.removesuffix(".gz")).stem or "volume"


def _check_output(output: Path, background: str | None) -> None:
    """Says what cannot be written before minutes of rendering, not after."""
    from ..files import known_suffix

    suffix = known_suffix(output, (*PIXEL_WRITERS, *FLOAT_WRITERS), "--output", ELSEWHERE)
    if suffix not in PIXEL_WRITERS and background is not None:
        raise ValueError(f"--background is for .png and .jpg, {suffix} keeps the image without one")
    if not output.parent.is_dir():
        raise FileNotFoundError(f"--output must be in a folder that exists, got {str(output)!r}")
