"""``wvr render``: a volume to an image file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from .options import (
    Vector,
    Vectors,
    camera_of,
    clips_of,
    integrator_of,
    lighting_of,
    shadows_of,
    size_of,
    transfer_function_of,
)
from .source import Reading
from .stages import Stages

if TYPE_CHECKING:
    from ..volume import Volume


def render(
    source: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    tf: str | None = None,
    domain: Vector | None = None,
    tolerance: float | None = None,
    integrator: str | None = None,
    lighting: str | None = None,
    shadows: Vector | None = None,
    size: str = "512x512",
    direction: Vector | None = None,
    up: Vector | None = None,
    view_angle: float = 30.0,
    parallel: Annotated[bool, Parameter(negative="")] = False,
    camera: Vector | None = None,
    background: str | None = None,
    precision: Literal["auto", "float32", "float64"] = "auto",
    device: str | None = None,
    termination: float | None = None,
    clip_plane: Vectors | None = None,
    clip_box: Vectors | None = None,
    clip_sphere: Vectors | None = None,
    threads: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    nan: Literal["error", "transparent"] = "error",
    reading: Reading = Reading(),  # noqa: B008 - frozen
) -> None:
    """Render a volume to an image file.

    Parameters
    ----------
    source
        File, folder of slices, or name of a dataset.
    output
        Image file: .png (8 bits, sRGB), or .exr, .tif, .tiff, .npy (linear floats). By default the source's name with
        .png, in the current folder.
    tf
        Transfer function: a suggestion of "wvr info" (bands, warm, surfaces), a preset (ct-bone, mri, ...), a
        Matplotlib colour map (opacity then grows with the scalar), a .json file, or control points
        SCALAR:COLOUR:OPACITY,SCALAR:COLOUR:OPACITY,... By default the first suggestion.
    domain
        Scalars LO,HI that a preset or colour map spans: by default the volume's range, or Hounsfield units for ct-*.
    tolerance
        Largest absolute error of any channel of any pixel, above 0 and below 1; by default 1/512.
    integrator
        Instead of a tolerance: NAME:VALUE:... with the values in the order of the API: riemann:0.5, riemann:0.5:left,
        preintegrated:1:4.
    lighting
        Light from the camera: interpolated, or another mode of the API, MODE:AMBIENT:DIFFUSE:SPECULAR:SHININESS with
        what is left out as in the API.
    shadows
        X,Y,Z towards a light that casts them, or "headlight".
    size
        WIDTHxHEIGHT in pixels.
    direction
        X,Y,Z from the volume towards the camera. By default 1,0.6,0.4 for --up z, and turned with --up.
    up
        X,Y,Z or an axis (y, -z): upwards in the image. By default z for generated datasets and files that say where
        the head is (DICOM, NIfTI, some NRRD), else y, as in VTK's own default view: few files say where up is.
    view_angle
        Vertical angle of view in degrees.
    parallel
        Orthographic; with --camera, what is at the target keeps its size.
    camera
        Position and target in world coordinates, PX,PY,PZ,TX,TY,TZ; instead of --direction, which shows all.
    background
        Colour name or #rrggbb behind the volume, for .png; by default the image is transparent.
    precision
        Of everything along a ray.
    device
        cpu, cuda:0, ...; by default CUDA where there is one.
    termination
        A ray ends when less than this transparency is left; 0: never.
    clip_plane
        PX,PY,PZ,NX,NY,NZ: keep the side of the plane through P that N points to [world coordinates]. This and the
        other clips may be given several times; what all keep is left.
    clip_box
        X0,Y0,Z0,X1,Y1,Z1: keep the box between two corners.
    clip_sphere
        X,Y,Z,RADIUS: keep the ball.
    threads
        CPU threads; by default all cores.
    nan
        NaN and infinite samples are an error, or transparent.
    """
    import wvr

    method = None if integrator is None else integrator_of(integrator)
    light = None if lighting is None else lighting_of(lighting)
    shade = None if shadows is None else shadows_of(shadows)
    width, height = size_of(size)
    output = Path(f"{_stem(source)}.png") if output is None else output
    _check_output(output, background)
    clips = clips_of(clip_plane, clip_box, clip_sphere)
    if threads is not None:
        wvr.set_num_threads(threads)
    with Stages() as stage:
        volume = reading.load(source, nan, stage)
        _check_kept(output, volume)
        transfer_function = transfer_function_of(tf, domain, volume)
        if up is None:
            from ..datasets import GENERATED

            up = "z" if volume.anatomical or source in GENERATED else "y"
        view = camera_of(volume, direction, up, view_angle, parallel, camera, width / height)
        stage("rendering")
        image = wvr.render(
            volume,
            transfer_function,
            view,
            (width, height),
            integrator=method,
            tolerance=tolerance,
            lighting=light,
            shadows=shade,
            background=background,
            precision=precision,
            device=device,
            termination=termination,
            clip=clips,
        )
        stage(f"writing {output}")
        image.save(output)
    samples, seconds = image.stats["samples"], image.stats["seconds"]
    bound = "" if image.error_bound is None else f", errors up to {image.error_bound.max():.2g}"
    if bound and (light or shade):
        bound += " but for light"
    print(f"{output}: {width} x {height}, {samples:,} samples, {seconds:.3g} s{bound}")


def _stem(source: str) -> str:
    path = Path(source).resolve()
    return Path(path.name.removesuffix(".gz")).stem or "volume"


def _check_output(output: Path, background: str | None) -> None:
    """Says what cannot be written before minutes of rendering, not after."""
    from ..files import known_suffix
    from ..image import FLOAT_WRITERS

    suffix = known_suffix(output, (".png", *FLOAT_WRITERS), "--output")
    if suffix != ".png" and background is not None:
        raise ValueError(f"--background is for .png, {suffix} keeps the image without one")
    if not output.parent.is_dir():
        raise FileNotFoundError(f"--output must be in a folder that exists, got {str(output)!r}")


def _check_kept(output: Path, volume: Volume) -> None:
    """Nothing that was read is written to."""
    if output.exists() and any(file.exists() and output.samefile(file) for file in volume.files):
        raise ValueError(f"--output must not be the volume itself, which is read from {str(output)!r}")
