"""The commands and what their options mean."""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import App, CycloptsError, Parameter
from cyclopts.validators import Number

from .. import __version__

if TYPE_CHECKING:
    from ..camera import Camera
    from ..clipping import Clip
    from ..integrators import Integrator
    from ..lighting import Lighting
    from ..shadows import ConvolutionShadows
    from ..transfer_function import TransferFunction
    from ..volume import Volume

app = App(name="wvr", help="Direct volume rendering, fast and accurate.", version=__version__, help_format="plaintext")

# "--direction -1,0,0" is a value that looks like an option.
Vector = Annotated[str, Parameter(allow_leading_hyphen=True)]
Vectors = Annotated[list[str], Parameter(allow_leading_hyphen=True, negative="")]
Size = Annotated[int, Parameter(validator=Number(gte=2))]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
AXES |= {f"-{name}": (0 - x, 0 - y, 0 - z) for name, (x, y, z) in AXES.items()}
QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999)
BINS = 32


def main() -> int:
    """Run the command line in ``sys.argv``; returns the exit code."""
    try:
        command, bound, *_ = app.parse_args(sys.argv[1:], exit_on_error=False, print_error=False, verbose=False)
        return command(*bound.args, **bound.kwargs) or 0
    except KeyboardInterrupt:
        return 130
    except (CycloptsError, ValueError, TypeError) as error:
        return _failed(error, 2)
    except (OSError, MemoryError, ImportError) as error:
        return _failed(error, 1)


def _failed(error: Exception, code: int) -> int:
    # One line, whatever the message quotes. A MemoryError of Python's own has no message.
    message = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, OSError) and error.filename is not None:
        message = f"{error.strerror}: {error.filename}"
    print(f"wvr: error: {message}", file=sys.stderr)
    return code


@app.command
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
    scalars: str | None = None,
    nan: Literal["error", "transparent"] = "error",
    dataset_size: Size | None = None,
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
    scalars
        Array to render, of a VTK file with several.
    nan
        NaN and infinite samples are an error, or transparent.
    dataset_size
        Samples along each axis of a generated dataset; by default 128.
    """
    import wvr

    method = None if integrator is None else _integrator(integrator)
    light = None if lighting is None else _lighting(lighting)
    shade = None if shadows is None else _shadows(shadows)
    width, height = _size(size)
    output = Path(f"{_stem(source)}.png") if output is None else output
    _check_output(output, source, background)
    planes, boxes, balls = (
        [_numbers(text, option, example) for text in given or []]
        for option, given, example in (
            ("--clip-plane", clip_plane, "64,64,64,0,0,1"),
            ("--clip-box", clip_box, "0,0,0,64,64,64"),
            ("--clip-sphere", clip_sphere, "64,64,64,32"),
        )
    )
    clips: list[Clip] = [
        *(wvr.ClipPlane(numbers[:3], numbers[3:]) for numbers in planes),
        *(wvr.ClipBox(numbers[:3], numbers[3:]) for numbers in boxes),
        *(wvr.ClipSphere(numbers[:3], numbers[3]) for numbers in balls),
    ]
    if threads is not None:
        wvr.set_num_threads(threads)
    with _Stages() as stage:
        volume = _load(source, scalars, nan, dataset_size, stage)
        transfer_function = _transfer_function(tf, domain, volume)
        if up is None:
            from ..datasets import GENERATED

            up = "z" if volume.anatomical or source in GENERATED else "y"
        view = _camera(volume, direction, up, view_angle, parallel, camera, width / height)
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


@app.command
def info(
    source: str,
    /,
    *,
    histogram: Annotated[bool, Parameter(negative="")] = False,
    save_tf: tuple[str, Path] | None = None,
    scalars: str | None = None,
    dataset_size: Size | None = None,
) -> None:
    """Describe a volume and suggest transfer functions for it.

    Parameters
    ----------
    source
        File, folder of slices, or name of a dataset.
    histogram
        Draw the histogram; bars are as long as the logarithm of the count.
    save_tf
        NAME FILE: write the suggestion of that name to a .json file, every digit of it.
    scalars
        Array to describe, of a VTK file with several.
    dataset_size
        Samples along each axis of a generated dataset; by default 128.
    """
    from ..presets import suggest

    with _Stages() as stage:
        volume = _load(source, scalars, "transparent", dataset_size, stage)
        stage("counting")
        values = volume.numpy().ravel()
        finite = values[np.isfinite(values)] if volume.has_nonfinite else values
        facts = _facts(volume, finite)
        table = _histogram(finite, volume.range) if histogram and finite.size else None
        try:
            suggestions, problem = suggest(volume), ""
        except ValueError as error:
            suggestions, problem = {}, str(error)
    if save_tf is not None:
        name, path = save_tf
        if name not in suggestions:
            raise ValueError(
                f"--save-tf must name one of {', '.join(suggestions) or f'none ({problem})'}, got {name!r}"
            )
        if path.suffix.lower() != ".json":
            raise ValueError(f"--save-tf must name a .json file, got {str(path)!r}")
        suggestions[name].save(path)
    print(source)
    for name, fact in facts.items():
        print(f"  {name:<11} {fact}")
    if table is not None:
        from rich import print as rich_print

        rich_print(table)
    print(
        f"  no suggested transfer functions: {problem}" if problem else "  suggestions, as --tf takes them (rounded):"
    )
    for name, suggestion in suggestions.items():
        print(f"  {name:<11} {_points(suggestion)}")


@app.command
def study(
    *names: str,
    every: Annotated[bool, Parameter(name="--all", negative="")] = False,
    quick: Annotated[bool, Parameter(negative="")] = False,
    resume: Annotated[bool, Parameter(negative="")] = False,
    record: Annotated[bool, Parameter(negative="")] = False,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
) -> int:
    """Repeat the studies that wvr's claims rest on, in a checkout; without a name, list them.

    Parameters
    ----------
    names
        The studies to run.
    every
        Run all.
    quick
        Small scenes and generated volumes: shows that the studies work, within minutes.
    resume
        Keep the parts that were finished by the same code on the same machine.
    record
        Also copy what is in the folder and was not made with --quick to docs/results, for the documentation.
    output
        Folder for tables, charts and report.html; by default out/studies, with --quick out/studies-quick.
    """
    if every and names:
        raise ValueError(f"give names or --all, not both, got {' '.join(names)}")
    runner = _studies()
    if not every and not names:
        for known in runner.find():
            print(f"{known.name}: {known.title}")
            for part in known.parts.values():
                print(f"    {part.title}: {part.what}")
        return 0
    out = Path("out/studies-quick" if quick else "out/studies") if output is None else output
    failed = runner.run(runner.find(names or runner.NAMES), out, quick, resume)
    print(out / "report.html")
    if record:
        print(runner.record(out))
    for reason in failed:
        print(f"wvr: failed: {reason}", file=sys.stderr)
    return 1 if failed else 0


def _studies() -> Any:
    """The module that runs studies. They are part of a checkout, not of what is installed."""
    import wvr

    root = Path(wvr.__file__).resolve().parents[1]
    if not (root / "studies" / "runner.py").exists():
        raise FileNotFoundError(
            "the studies are not installed with wvr; in a checkout of its repository, run make studies"
        )
    sys.path.insert(0, str(root))
    from studies import runner

    return runner


class _Stages(logging.Handler):
    """Says on stderr what is going on: the log of wvr and, on a terminal after two seconds, a spinner."""

    def __enter__(self) -> _Stages:
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
        self.progress = Progress(*columns, console=Console(stderr=True), transient=True)
        self.task = self.progress.add_task("")
        self.timer: Timer | None = None
        self.log = logging.getLogger("wvr")
        self.log.addHandler(self)
        self.log.setLevel(logging.INFO)
        return self

    def __call__(self, name: str) -> None:
        self.progress.update(self.task, description=name)
        if self.timer is None and self.progress.console.is_terminal:
            self.timer = Timer(2, self.progress.start)
            self.timer.daemon = True
            self.timer.start()

    def emit(self, record: logging.LogRecord) -> None:
        print(f"wvr: {record.getMessage()}", file=sys.stderr)
        if "compiling" in record.getMessage():
            self("compiling, then rendering")

    def __exit__(self, *error: object) -> None:
        self.log.removeHandler(self)
        if self.timer is not None:
            self.timer.cancel()
            self.timer.join()
            self.progress.stop()


def _load(
    source: str, scalars: str | None, nan: Literal["error", "transparent"], size: int | None, stage: _Stages
) -> Volume:
    from .. import datasets
    from ..io import read

    if Path(source).exists():
        if size is not None:
            raise ValueError(f"--dataset-size is for generated datasets, {source!r} is a file")
        stage(f"reading {source}")
        return read(source, scalars, nan)
    if source not in datasets.names():
        raise FileNotFoundError(
            f"{source!r} is neither a file or folder nor a dataset; datasets are {', '.join(datasets.names())}"
        )
    if scalars is not None:
        raise ValueError(f"--scalars is for files with several arrays, {source!r} is a dataset")
    if source in datasets.GENERATED:
        stage(f"generating {source}")
        return datasets.load(source, 128 if size is None else size)
    if size is not None:
        raise ValueError(f"--dataset-size is for generated datasets, {source!r} is downloaded as it is")
    return datasets.fetch(source)  # which shows its own progress


def _stem(source: str) -> str:
    path = Path(source).resolve()
    return Path(path.name.removesuffix(".gz")).stem or "volume"


def _check_output(output: Path, source: str, background: str | None) -> None:
    """Says what cannot be written before minutes of rendering, not after."""
    from ..files import known_suffix
    from ..image import FLOAT_WRITERS

    suffix = known_suffix(output, (".png", *FLOAT_WRITERS), "--output")
    if suffix != ".png" and background is not None:
        raise ValueError(f"--background is for .png, {suffix} keeps the image without one")
    if not output.parent.is_dir():
        raise FileNotFoundError(f"--output must be in a folder that exists, got {str(output)!r}")
    if output.exists() and Path(source).exists() and output.samefile(source):
        raise ValueError(f"--output must not be the volume itself, got {str(output)!r}")


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)[xX](\d+)", text)
    if match is None or 0 in (size := (int(match[1]), int(match[2]))):
        raise ValueError(f"--size must be WIDTHxHEIGHT in pixels, such as 800x600, got {text!r}")
    return size


def _numbers(text: str, option: str, example: str) -> tuple[Any, ...]:
    """As many numbers as the example has."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != example.count(",") + 1:
        raise ValueError(f"{option} must be numbers such as {example}, got {text!r}")
    return numbers


def _integrator(text: str) -> Integrator:
    from ..renderer import INTEGRATORS

    kinds: dict[str, Callable[..., Integrator]] = {kind.__name__.lower(): kind for kind in INTEGRATORS}
    name, *values = text.split(":")
    if name not in kinds:
        raise ValueError(f"--integrator must start with one of {', '.join(kinds)}, got {text!r}")
    try:
        return kinds[name](*map(_literal, values))
    except TypeError as error:
        raise ValueError(
            f"--integrator must be like riemann:0.5:left or preintegrated:0.5, got {text!r}: {error}"
        ) from error


def _lighting(text: str) -> Lighting:
    from ..lighting import MODES, Lighting

    mode, *values = text.split(":")
    names = ("ambient", "diffuse", "specular", "shininess")
    numbers = [_literal(value) for value in values]
    if mode not in MODES or len(values) > len(names) or any(isinstance(number, str) for number in numbers):
        raise ValueError(
            f"--lighting must be one of {', '.join(MODES)}, or like interpolated:0.2:0.7:0.3:32, got {text!r}"
        )
    return Lighting(mode, **dict(zip(names, numbers, strict=False)))  # type: ignore[arg-type]


def _shadows(text: str) -> ConvolutionShadows:
    from ..lights import DirectionalLight
    from ..shadows import ConvolutionShadows

    if text == "headlight":
        return ConvolutionShadows()
    return ConvolutionShadows(light=DirectionalLight(_numbers(text, "--shadows", "1,2,3")))


def _literal(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _camera(
    volume: Volume,
    direction: str | None,
    up: str,
    view_angle: float,
    parallel: bool,
    camera: str | None,
    aspect: float,
) -> Camera:
    from ..camera import Camera

    upward = AXES.get(up) or _numbers(up, "--up", "0,0,1")
    if camera is None:
        towards = _default_direction(upward) if direction is None else _numbers(direction, "--direction", "1,0.6,0.4")
        return Camera.fit(volume, towards, upward, parallel, view_angle, aspect)
    if direction is not None:
        raise ValueError("give --camera or --direction, not both")
    place = _numbers(camera, "--camera", "300,200,100,0,0,0")
    perspective = Camera(place[:3], place[3:], upward, view_angle)
    if not parallel:
        return perspective
    distance = np.linalg.norm(perspective.position - perspective.target)
    scale = float(distance * np.tan(np.radians(view_angle) / 2))
    return Camera(place[:3], place[3:], upward, parallel_scale=scale)


def _default_direction(up: tuple[float, ...]) -> tuple[float, ...]:
    """That of ``Camera.fit``, turned with its up from z to the axis nearest to ``up``: the same little from above."""
    axis = int(np.argmax(np.abs(up)))
    direction = np.roll((1.0, 0.6, 0.4), axis - 2)
    direction[axis] = np.copysign(direction[axis], up[axis])
    return tuple(direction.tolist())


def _transfer_function(text: str | None, domain: str | None, volume: Volume) -> TransferFunction:
    import matplotlib

    from ..presets import HOUNSFIELD, PRESETS, suggest
    from ..transfer_function import TransferFunction

    span = None if domain is None else _numbers(domain, "--domain", "0,255")
    if text in PRESETS:
        hounsfield = PRESETS[text].range == HOUNSFIELD
        return TransferFunction.preset(text, span or (None if hounsfield else volume.range))
    if text is not None and text in matplotlib.colormaps:
        # The square leaves the noise of a dark background transparent; the unit makes it independent of resolution.
        lengths = np.linalg.norm(volume.index_to_world[:3, :3], axis=0) * volume.dimensions
        opacity = 0.9 * np.linspace(0, 1, 9) ** 2
        return TransferFunction.from_colormap(text, span or volume.range, opacity, float(lengths.max()) / 16)
    if span is not None:
        raise ValueError(f"--domain is for presets and colour maps, --tf is {text or 'a suggestion'}")
    if text is not None and text.lower().endswith(".json"):
        return TransferFunction.load(text)
    if text is not None and ":" in text:
        points: list[Any] = [part.split(":") for part in text.split(",")]
        return TransferFunction(points)
    suggestions = suggest(volume)
    if text is None:
        return next(iter(suggestions.values()))
    if text not in suggestions:
        raise ValueError(
            f"--tf must be one of {', '.join([*suggestions, *PRESETS])}, a Matplotlib colour map, a .json file or "
            f"SCALAR:COLOUR:OPACITY,..., got {text!r}"
        )
    return suggestions[text]


def _points(tf: TransferFunction) -> str:
    """The control points as ``--tf`` takes them."""
    from matplotlib.colors import to_hex

    from ..color import linear_to_srgb

    colors = np.clip(linear_to_srgb(tf.colors), 0, 1)
    points = zip(tf.knots, colors, tf.opacities, strict=True)
    return ",".join(f"{scalar:.6g}:{to_hex(color)}:{opacity:.4g}" for scalar, color, opacity in points)


def _facts(volume: Volume, finite: np.ndarray) -> dict[str, str]:
    low, high = volume.index_box
    steps = np.linalg.norm(volume.index_to_world[:3, :3], axis=0)
    facts: dict[str, Any] = {
        "dimensions": " x ".join(map(str, volume.dimensions)),
        "dtype": volume.dtype,
        "memory": f"{volume.numpy().nbytes / 2**20:,.1f} MiB",
        "spacing": _listed(volume.spacing),
        "origin": _listed(volume.origin),
        "world size": _listed((high - low) * steps),
        "not finite": f"{volume.numpy().size - finite.size:,} of {volume.numpy().size:,} samples",
    }
    if not np.array_equal(volume.direction, np.eye(3)):
        facts["direction"] = "  ".join(f"({_listed(column)})" for column in volume.direction.T)
    if finite.size:
        facts["range"] = "{:.6g} .. {:.6g}".format(*volume.range)
        quantiles = np.quantile(finite, QUANTILES, method="lower")
        facts["quantiles"] = "  ".join(f"{q:.3g}: {v:.4g}" for q, v in zip(QUANTILES, quantiles, strict=True))
    return facts


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


def _histogram(finite: np.ndarray, span: tuple[float, float]) -> Any:
    """Where each bin starts, a bar as long as the logarithm of its count, and the count."""
    from rich.bar import Bar
    from rich.table import Table

    lo, hi = span
    bins = BINS
    if finite.dtype.kind in "iu":
        # Every bin has the same number of integers.
        width = -(-(int(hi - lo) + 1) // BINS)
        bins = -(-(int(hi - lo) + 1) // width)
        hi = lo + bins * width
    counts, edges = np.histogram(finite, bins, (lo, hi))
    table = Table.grid(padding=(0, 1))
    table.add_column(justify="right")
    table.add_column(width=50)
    table.add_column(justify="right")
    for edge, count in zip(edges, counts, strict=False):
        table.add_row(f"{edge:.5g}", Bar(np.log1p(counts.max()), 0, np.log1p(count)), f"{count:,}")
    return table
