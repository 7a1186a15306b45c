"""Keywords of :func:`wvr.render`: for type checkers, and what other libraries call them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

from .validation import near

if TYPE_CHECKING:
    from threading import Event

    from .bricks.reading import Missing
    from .colormaps import Opacity
    from .cuts.base import Clip
    from .defaults import LightingLike, SegmentationLike
    from .integrators import Integrator
    from .light.shadows import ConvolutionShadows
    from .scene import Precision


class Look(TypedDict, total=False):
    """What is common to images and movies."""

    opacity: Opacity | None
    clim: Sequence[float] | float | None
    lighting: LightingLike | None
    shadows: ConvolutionShadows | bool | None
    background: str | Sequence[float] | None
    precision: Precision
    device: Any
    termination: float | None
    skip_empty: bool
    clip: Clip | Sequence[Clip] | None
    segmentation: SegmentationLike | None
    memory_limit: int | str | None
    budget: float | str | None
    missing: Missing
    client: Any


class Options(Look, total=False):
    """Keywords of :func:`wvr.render` but those that say which kind of image it returns."""

    depth: Any
    cancel: Event | None
    progress: Callable[[float], object] | None


class MovieOptions(Look, total=False):
    """Keywords that all movies pass on."""

    integrator: Integrator | None
    tolerance: float | None


class SeriesOptions(MovieOptions, total=False):
    """Keywords of :func:`wvr.time_series` but ``output``."""

    size: tuple[int, int]
    fps: float


class OrbitOptions(SeriesOptions, total=False):
    """Keywords of :func:`wvr.orbit`."""

    elevation: float
    turn: float


MAPPED = 'give the colour map, its name or a list of colours as the transfer function: wvr.render(data, "viridis")'
MAP = "make a transfer function, wvr.TransferFunction.from_colormap(cmap, clim, opacity, {})"
ARRAY = "say it with the array: wvr.as_volume(array, {})"
LIGHT = "say lighting=wvr.Lighting({})"
PLOT = "image.plot({}) draws around an image, and returns Matplotlib's axes to draw more"
WINDOW = "rendering opens no window: image.show() does, image.save(path) writes a file"
SIZE = "say size=(width, height)"
STEP = "say integrator=wvr.Riemann(step), or tolerance= for an error"
# Of PyVista's add_volume, plotters and show, and of others: what to write here.
ELSEWHERE = {
    "cmap": MAPPED,
    "colormap": MAPPED,
    "tf": "the transfer function is the second argument: wvr.render(data, tf)",
    "shade": "say lighting=True",
    "blending": 'say integrator=wvr.Projection("max"), or "min", "mean" or "sum"; without it, emission and absorption',
    "projection": 'say integrator=wvr.Projection("max"), or "min", "mean" or "sum"',
    "isosurface": "say integrator=wvr.Isosurface(value), or of a list of values",
    "isosurfaces": "say integrator=wvr.Isosurface([90, 140])",
    "n_frames": "wvr.orbit has frames=120",
    "n_colors": MAP.format("n_colors=8"),
    "log_scale": MAP.format("log_scale=True"),
    "opacity_unit_distance": MAP.format("unit_distance=2.0"),
    "flip_scalars": 'reverse the colour map: "viridis_r"',
    "scalars": 'say wvr.as_volume(data, scalars="name"), or data.wvr.render(scalars="name")',
    "preference": "point and cell arrays are told apart by their length; data.cell_data_to_point_data() moves them",
    "mapper": "there is one for all; device= says where it runs",
    "categories": "labels are recognised; wvr.Segmentation gives each a transfer function",
    "labels": "say segmentation=labels, or wvr.Segmentation(labels, {1: transfer_function})",
    "annotations": PLOT.format(""),
    "show_scalar_bar": PLOT.format("scalar_bar=True"),
    "scalar_bar_args": PLOT.format("scalar_bar=True"),
    "ambient": LIGHT.format("ambient=0.2"),
    "diffuse": LIGHT.format("diffuse=0.7"),
    "specular": LIGHT.format("specular=0.3"),
    "specular_power": LIGHT.format("shininess=32"),
    "resolution": ARRAY.format("spacing=(1, 1, 2.5)"),
    "spacing": ARRAY.format("spacing=(1, 1, 2.5)"),
    "origin": ARRAY.format("origin=(0, 0, 0)"),
    "axes": ARRAY.format('axes="xyz"'),
    "nan": ARRAY.format('nan="transparent"'),
    "multi_colors": "there is one volume in a picture",
    "name": "there is one volume in a picture",
    "pickable": "image.pick(x, y) says what is under any pixel",
    "culling": "a volume has no faces that could be culled",
    "reset_camera": "what is visible fills the frame unless there is a camera=",
    "render": WINDOW,
    "user_matrix": "say it with the volume: wvr.Volume(array, spacing, origin, direction)",
    "window_size": SIZE,
    "width": SIZE,
    "height": SIZE,
    "cpos": 'say camera="iso", or camera=[position, focal point, up]',
    "camera_position": 'say camera="iso", or camera=[position, focal point, up]',
    "color": "colours are of scalars: wvr.render(data, ['black', 'red'])",
    "off_screen": WINDOW,
    "notebook": "notebooks show the image that a cell ends with",
    "jupyter_backend": "notebooks show the image that a cell ends with",
    "screenshot": WINDOW,
    "output": WINDOW,
    "filename": WINDOW,
    "threads": "wvr.set_num_threads(n) sets it for all",
    "num_threads": "wvr.set_num_threads(n) sets it for all",
    "step": STEP,
    "step_size": STEP,
    "sample_distance": STEP,
    "interpolation": "between samples the field is trilinear, always",
}


# Of wvr.render, where something else has not got them.
OF_RENDER = {
    "size": "a viewer is as large as its window",
    "cancel": "only wvr.render, and a Renderer's render, are cancelled",
    "progress": "only wvr.render, and a Renderer's render, report it",
    "depth": "wvr.render ends rays at depths, which are those of one camera",
    "memory_limit": "of volumes in bricks wvr.render makes images",
    "budget": "of volumes in bricks wvr.render makes images",
    "missing": "of volumes in bricks wvr.render makes images",
    "client": "of volumes in bricks wvr.render makes images",
}


def refuse(function: str, unknown: Mapping[str, Any], known: Sequence[str]) -> None:
    """An error for keywords that a function does not have, with what to write instead where that is known."""
    if unknown:
        name = next(iter(unknown))
        instead = ELSEWHERE | OF_RENDER
        said = f"; {instead[name]}" if name in instead else near(name, known)
        raise TypeError(f"{function} has no keyword {name!r}{said}")
