"""What options are on the command line, and what they mean."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number

if TYPE_CHECKING:
    from ..camera import Camera
    from ..cuts.base import Clip
    from ..integrators import Integrator
    from ..light.lighting import Lighting
    from ..light.shadows import ConvolutionShadows
    from ..transfer_function import TransferFunction
    from ..volume import Volume

# "--direction -1,0,0" is a value that looks like an option.
Vector = Annotated[str, Parameter(allow_leading_hyphen=True)]
Vectors = Annotated[list[str], Parameter(allow_leading_hyphen=True, negative="")]
Size = Annotated[int, Parameter(validator=Number(gte=2))]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
AXES |= {f"-{name}": (0 - x, 0 - y, 0 - z) for name, (x, y, z) in AXES.items()}


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
    if len(numbers) != example.count(",") + 1:
        raise ValueError(f"{option} must be numbers such as {example}, got {text!r}")
    return numbers


def integrator_of(text: str) -> Integrator:
    from .. import integrators

    kinds: dict[str, Callable[..., Integrator]] = {kind.__name__.lower(): kind for kind in integrators.KINDS}
    name, *values = text.split(":")
    if name not in kinds:
        raise ValueError(f"--integrator must start with one of {', '.join(kinds)}, got {text!r}")
    try:
        return kinds[name](*map(_literal, values))
    except TypeError as error:
        raise ValueError(
            f"--integrator must be like riemann:0.5:left or preintegrated:0.5, got {text!r}: {error}"
        ) from error


def lighting_of(text: str) -> Lighting:
    from ..light.lighting import MODES, Lighting

    mode, *values = text.split(":")
    names = ("ambient", "diffuse", "specular", "shininess")
    numbers = [_literal(value) for value in values]
    if mode not in MODES or len(values) > len(names) or any(isinstance(number, str) for number in numbers):
        raise ValueError(
            f"--lighting must be one of {', '.join(MODES)}, or like interpolated:0.2:0.7:0.3:32, got {text!r}"
        )
    return Lighting(mode, **dict(zip(names, numbers, strict=False)))  # type: ignore[arg-type]


def shadows_of(text: str) -> ConvolutionShadows:
    from ..light.lights import DirectionalLight
    from ..light.shadows import ConvolutionShadows

    if text == "headlight":
        return ConvolutionShadows()
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

    def allnumbers(texts: list[str] | None, option: str, example: str) -> list[tuple[Any, ...]]:
        return [numbers(text, option, example) for text in texts or []]

    return [
        *(ClipPlane(n[:3], n[3:]) for n in allnumbers(planes, "--clip-plane", "64,64,64,0,0,1")),
        *(ClipBox(n[:3], n[3:]) for n in allnumbers(boxes, "--clip-box", "0,0,0,64,64,64")),
        *(ClipSphere(n[:3], n[3]) for n in allnumbers(balls, "--clip-sphere", "64,64,64,32")),
    ]


def camera_of(
    volume: Volume,
    direction: str | None,
    up: str,
    view_angle: float,
    parallel: bool,
    camera: str | None,
    aspect: float,
) -> Camera:
    from ..camera import Camera

    upward = AXES.get(up) or numbers(up, "--up", "0,0,1")
    if camera is None:
        towards = _default_direction(upward) if direction is None else numbers(direction, "--direction", "1,0.6,0.4")
        return Camera.fit(volume, towards, upward, parallel, view_angle, aspect)
    if direction is not None:
        raise ValueError("give --camera or --direction, not both")
    place = numbers(camera, "--camera", "300,200,100,0,0,0")
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


def transfer_function_of(text: str | None, domain: str | None, volume: Volume) -> TransferFunction:
    import matplotlib

    from ..presets import HOUNSFIELD, PRESETS, suggest
    from ..transfer_function import TransferFunction

    span = None if domain is None else numbers(domain, "--domain", "0,255")
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
