"""What options are on the command line, and what they mean."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number

from ..validation import near

if TYPE_CHECKING:
    from ..camera import Camera
    from ..cuts.base import Clip
    from ..cuts.labels import Segmentation
    from ..framing import Showing
    from ..integrators import Integrator
    from ..light.lighting import Lighting
    from ..light.shadows import ConvolutionShadows
    from ..transfer_function import TransferFunction
    from ..views import View
    from ..volume import Volume

# "--direction -1,0,0" is a value that looks like an option.
Vector = Annotated[str, Parameter(allow_leading_hyphen=True)]
Vectors = Annotated[list[str], Parameter(allow_leading_hyphen=True, negative="")]
Size = Annotated[int, Parameter(validator=Number(gte=2))]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
AXES |= {f"-{name}": (0 - x, 0 - y, 0 - z) for name, (x, y, z) in AXES.items()}


class Lens(NamedTuple):
    """Of a camera: vertical angle [degrees], whether it is orthographic, and width / height of the image."""

    view_angle: float
    parallel: bool
    aspect: float


def size_of(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)[xX](\d+)", text)
    if match is None or 0 in (size := (int(match[1]), int(match[2]))):
        raise ValueError(f"--size must be WIDTHxHEIGHT in pixels, such as 800x600, got {text!r}")
    return size


def numbers(text: str, option: str, example: str) -> tuple[Any, ...]:
    """As many numbers as the example has."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != (count := example.count(",") + 1):
        raise ValueError(f"{option} must be {count} numbers such as {example}, got {text!r}")
    return numbers


def integrator_of(text: str) -> Integrator:
    from .. import integrators

    kinds: dict[str, Callable[..., Integrator]] = {kind.__name__.lower(): kind for kind in integrators.KINDS}
    name, *values = text.split(":")
    if name not in kinds:
        raise ValueError(
            f"--integrator must start with one of {', '.join(kinds)}, got {text!r}{near(name, list(kinds))}"
        )
    try:
        return kinds[name](*map(_literal, values))
    except TypeError as error:
        raise ValueError(
            f"--integrator must be like riemann:0.5:left or preintegrated:0.5, got {text!r}: {error}"
        ) from error


def lighting_of(text: str) -> Lighting | bool:
    if text in ("on", "off"):
        return text == "on"
    from ..light.lighting import MODES, Lighting

    mode, *values = text.split(":")
    names = ("ambient", "diffuse", "specular", "shininess")
    given = [_literal(value) for value in values]
    if mode not in MODES or len(values) > len(names) or any(isinstance(number, str) for number in given):
        raise ValueError(
            f"--lighting must be one of {', '.join(MODES)}, or like interpolated:0.2:0.7:0.3:32, or on or off, got "
            f"{text!r}{near(mode, MODES)}"
        )
    return Lighting(mode, **dict(zip(names, given, strict=False)))  # type: ignore[arg-type]


def shadows_of(text: str) -> ConvolutionShadows | bool:
    if text in ("on", "off"):
        return text == "on"
    from ..light.lights import DirectionalLight
    from ..light.shadows import ConvolutionShadows

    if text == "headlight":
        return ConvolutionShadows()
    if not re.match(r"[-+.\d]", text):
        raise ValueError(f"--shadows must be on, off, headlight or a direction towards a light, 1,2,3, got {text!r}")
    return ConvolutionShadows(light=DirectionalLight(numbers(text, "--shadows", "1,2,3")))


def _literal(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def clips_of(planes: list[str] | None, boxes: list[str] | None, balls: list[str] | None) -> list[Clip]:
    from ..cuts.shapes import ClipBox, ClipPlane, ClipSphere

    def several(texts: list[str] | None, option: str, example: str) -> list[tuple[Any, ...]]:
        return [numbers(text, option, example) for text in texts or []]

    return [
        *(ClipPlane(n[:3], n[3:]) for n in several(planes, "--clip-plane", "64,64,64,0,0,1")),
        *(ClipBox(n[:3], n[3:]) for n in several(boxes, "--clip-box", "0,0,0,64,64,64")),
        *(ClipSphere(n[:3], n[3]) for n in several(balls, "--clip-sphere", "64,64,64,32")),
    ]


def upward_of(text: str | None) -> tuple[Any, ...]:
    """What --up means; by default z."""
    return AXES.get(text or "z") or numbers(text or "", "--up", "0,0,1 or an axis such as -z")


def view_of(volume: Volume, direction: str | None, up: str | None) -> View:
    """Where it is seen from: as suggested, but for what is given."""
    from ..views import View, seen_from, suggested_view

    if direction is None and up is None:
        return suggested_view(volume)
    upward = upward_of(up)
    towards = _default_direction(upward) if direction is None else numbers(direction, "--direction", "1,0.6,0.4")
    if not np.any(towards):
        raise ValueError(f"direction must not be zero, got {direction!r}")
    return seen_from(towards) if up is None else View(np.array(towards), np.array(upward))


def camera_of(
    volume: Volume,
    shown: Showing,
    clips: list[Clip],
    place: tuple[str | None, str | None, str | None],
    lens: Lens,
) -> Camera:
    """From ``place``, what is given for --camera, --direction and --up."""
    from ..camera import Camera
    from ..framing import framed, visible_points
    from ..views import NAMES, named_view

    camera, direction, up = place
    view_angle, parallel, aspect = lens
    if camera is None:
        view = view_of(volume, direction, up)
        return framed(visible_points(volume, shown, clips), *view, view_angle, aspect, parallel)
    if direction is not None:
        raise ValueError("give --camera or --direction, not both")
    if not re.match(r"[-+.\d]", camera):
        if camera not in NAMES:
            raise ValueError(
                f"--camera must be one of {', '.join(NAMES)}, or PX,PY,PZ,TX,TY,TZ, got {camera!r}{near(camera, NAMES)}"
            )
        view = named_view(camera, volume)
        if up is not None:
            view = view._replace(up=view_of(volume, None, up).up)
        return framed(visible_points(volume, shown, clips), *view, view_angle, aspect, parallel)
    at = numbers(camera, "--camera", "300,200,100,0,0,0")
    upward = upward_of(up)
    perspective = Camera(at[:3], at[3:], upward, view_angle)
    if not parallel:
        return perspective
    distance = np.linalg.norm(perspective.position - perspective.target)
    scale = float(distance * np.tan(np.radians(view_angle) / 2))
    return Camera(at[:3], at[3:], upward, parallel_scale=scale)


def _default_direction(up: tuple[float, ...]) -> tuple[float, ...]:
    """That of ``Camera.fit``, turned with its up from z to the axis nearest to ``up``: the same little from above."""
    axis = int(np.argmax(np.abs(up)))
    direction = np.roll((1.0, 0.6, 0.4), axis - 2)
    direction[axis] = np.copysign(direction[axis], up[axis])
    return tuple(direction.tolist())


def method_of(integrator: str | None, projection: str | None, isosurface: str | None) -> Integrator | None:
    """The integrator that one of the options means."""
    given = [
        (n, t) for n, t in (("integrator", integrator), ("projection", projection), ("isosurface", isosurface)) if t
    ]
    if len(given) > 1:
        raise ValueError(
            f"give one of {', '.join(f'--{name}' for name, _ in given)}, got {given[0][1]!r} and {given[1][1]!r}"
        )
    if projection is not None:
        from ..integrators import Projection

        return Projection(projection)  # type: ignore[arg-type]
    if isosurface is not None:
        from ..integrators import Isosurface

        try:
            values = [float(part) for part in isosurface.split(",")]
        except ValueError:
            raise ValueError(f"--isosurface must be scalars such as 90 or 90,140, got {isosurface!r}") from None
        return Isosurface(values)
    return None if integrator is None else integrator_of(integrator)


def function_of(text: str | None, cmap: str | None) -> Any:
    """What --tf or --cmap mean, as :func:`wvr.render` takes it."""
    from ..transfer_function import TransferFunction

    if text is not None and cmap is not None:
        raise ValueError(f"give --tf or --cmap, not both, got {text!r} and {cmap!r}")
    if text is not None and ":" in text:
        return TransferFunction([tuple(part.split(":")) for part in text.split(",")])  # type: ignore[misc]
    if cmap is None:
        return text
    return cmap.split(",") if "," in cmap else _checked_colormap(cmap)


def strengths_of(opacity: str | None) -> Any:
    """What --opacity means: a name, a number or several."""
    if opacity is None or not re.match(r"[-+.\d]", opacity):
        return opacity
    try:
        strengths = [float(part) for part in opacity.split(",")]
    except ValueError:
        raise ValueError(f"--opacity must be a name or numbers such as 0,0.2,0.9, got {opacity!r}") from None
    return strengths[0] if len(strengths) == 1 else strengths


@contextmanager
def renamed() -> Iterator[None]:
    """Errors of transfer functions call arguments by the names that they have here."""
    try:
        yield
    except (TypeError, ValueError) as error:
        message = re.sub("^transfer_function must", "--tf must", str(error))
        message = message.replace(
            '"viridis", clim=(0, 255), opacity="linear"', "--cmap viridis --clim 0,255 --opacity linear"
        )
        raise ValueError(re.sub("^(clim|opacity) ", r"--\1 ", message)) from None


def _checked_colormap(name: str) -> str:
    import matplotlib  # which takes a while, and is not needed where colours are suggested

    if name not in matplotlib.colormaps:
        raise ValueError(
            f"--cmap must be a Matplotlib colour map, or two or more colours such as black,red,white, got "
            f"{name!r}{near(name, list(matplotlib.colormaps))}"
        )
    return name


def labels_of(path: Path, tf: TransferFunction) -> tuple[Segmentation, tuple[Path, ...]]:
    """The labels in a file, each in a colour of its own with the opacity of the transfer function, and what was read.

    0 is nothing.
    """
    from ..cuts.labels import Segmentation
    from ..io import read

    labels = read(path)
    if labels.dtype.kind not in "iu" or labels.range[0] < 0:
        raise ValueError(f"--labels must be a file of whole numbers from 0, {path} has {labels.dtype}")
    return Segmentation.colored(labels, tf), labels.files
