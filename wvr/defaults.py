"""What is left out of a call of :func:`wvr.render`, and what shorthands stand for."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from .advice import is_narrow, shown_by
from .camera import Camera
from .colormaps import Colors, Opacity, entries
from .cuts.base import Clip, clip_list
from .cuts.labels import Segmentation
from .field.base import Field
from .framing import Showing, framed, visible_points
from .integrators import Integrator
from .light.lighting import Lighting, Mode
from .light.lights import DirectionalLight, Headlight
from .light.shadows import ConvolutionShadows
from .preset_points import HOUNSFIELD, PRESETS
from .suggest import Suggestion, suggestion
from .transfer_function import TransferFunction
from .validation import float_array, near, outside
from .views import NAMES, View, ViewName, named_view, seen_from, suggested_view
from .volume import Volume

if TYPE_CHECKING:
    import pyvista as pv

    Function: TypeAlias = TransferFunction | Colors | Sequence[Any]
    # A string is a sequence, too: with Sequence a name with a slip would do.
    CameraLike: TypeAlias = Camera | ViewName | list[Any] | tuple[Any, ...] | NDArray[Any] | pv.Camera | pv.Plotter
    LightingLike: TypeAlias = Lighting | bool | Mode
    SegmentationLike: TypeAlias = Segmentation | Volume | NDArray[Any]
SUGGESTED = ("bands", "warm", "surfaces", "solid", "labels", "tissues", "deviation")
# What is behind a volume where nothing at all was said of colours.
BACKGROUND = "black"
# Of a scan in Hounsfield units there is something below, unless it is cropped to soft tissue.
AIR = -20


class Look(NamedTuple):
    """What a call asks for, in full."""

    transfer_function: TransferFunction | None
    camera: Camera
    lighting: Lighting | None
    shadows: ConvolutionShadows | None
    background: Any
    segmentation: Segmentation | None
    shown: Any  # what says where there is something to see, to a camera


class Call(NamedTuple):
    """What a call says of its look, as it was given."""

    transfer_function: Function | None = None
    camera: CameraLike | None = None
    opacity: Opacity | None = None
    clim: Sequence[float] | float | None = None
    lighting: LightingLike | None = None
    shadows: ConvolutionShadows | bool | None = None
    background: Any = None
    segmentation: SegmentationLike | None = None
    clip: Clip | Sequence[Clip] | None = None
    integrator: Integrator | None = None

    def asks(self, volume: Field) -> bool:
        """Whether samples of a volume in a store are looked at, for opacities or the scalars that colours are over."""
        given = self.transfer_function
        if isinstance(given, TransferFunction) or _are_points(given):
            return False
        if isinstance(given, str) and given.lower().endswith(".json"):
            return False
        if given is None and isinstance(self.segmentation, Segmentation):
            return False
        preset = isinstance(given, str) and given in PRESETS
        suggested = isinstance(given, str) and given in SUGGESTED
        if preset or self.opacity is not None or (not suggested and domain_of(self.integrator, volume) is not None):
            # Of floating-point samples the range is asked for in any case.
            ranges = getattr(volume, "ranges", None)
            return self.clim is None and not volume.shifts and (ranges is None or not ranges.known.all())
        return True

    def looks_at(self, volume: Field) -> tuple[Any, Any]:
        """By what opacities and colours are chosen, and by what it is known where things are: the volume, or, of one in
        a store, fewer samples, if there are such or something is to be suggested.
        """
        seen: Any = getattr(volume, "preview", None) or volume
        if not volume.stored or seen is not volume or not self.asks(volume):
            return seen, seen
        seen = volume.some
        # Some of the samples do not say where things are: ranges do, or else the box is framed.
        return seen, seen if seen.shape == volume.shape else volume

    def function(self, volume: Field, seen: Field) -> tuple[TransferFunction, Suggestion | None]:
        """The transfer function of a volume of which so much is ``seen``, and the suggestion it is from, if it is."""
        function, chosen = function_of(self.transfer_function, seen, self.opacity, self.clim, self.integrator)
        if chosen is not None and seen is not volume and function.unit_distance is None:
            function = function.per(seen.smallest_spacing)
        return function.for_volume(volume), chosen

    def lit(self, volume: Field, chosen: Suggestion | None) -> bool:
        """Whether there are surfaces to light: in the data, or those that the integrator looks for."""
        method = self.integrator
        if isinstance(method, Integrator) and method.surfaces is not None:
            return method.surfaces
        return chosen is not None and chosen.surfaces and not volume.stored

    def behind(self, seen: Field, chosen: Suggestion | None) -> Any:
        """The background, where none is given that of opacities that are suggested, or of values."""
        plain = self.transfer_function is None and domain_of(self.integrator, seen) is not None
        return BACKGROUND if self.background is None and (chosen is not None or plain) else self.background

    def look(self, volume: Field, size: tuple[int, int]) -> Look:
        """For a volume and so many pixels.

        Raises
        ------
        TypeError, ValueError
            For what is no shorthand, naming the argument.
        """
        chosen: Suggestion | None = None
        function: TransferFunction | None = None
        seen: Any = volume
        placed: Any = volume
        if not (isinstance(self.transfer_function, TransferFunction) and isinstance(self.camera, Camera)):
            volume.look()
            seen, placed = self.looks_at(volume)
        segmentation: Any = self.segmentation
        own = isinstance(segmentation, Segmentation)
        if self.transfer_function is not None or not own:
            function, chosen = self.function(volume, seen)
        else:
            for name, value in (("opacity", self.opacity), ("clim", self.clim)):
                _refuse(name, value, "labels have transfer functions of their own")
        shown: Any = None if function is None else framed_by(self.integrator, function)
        if segmentation is not None:
            segmentation = segmentation if own else segmentation_of(segmentation, function)
            shown = segmentation.for_volume(volume)
        camera = camera_of(self.camera, placed, shown, size[0] / size[1], clip_list(self.clip))
        lighting = lighting_of(self.lighting, self.lit(volume, chosen), camera)
        shadows = shadows_of(self.shadows, lighting, camera)
        return Look(function, camera, lighting, shadows, self.behind(seen, chosen), segmentation, shown)


def domain_of(integrator: Integrator | None, volume: Field) -> tuple[float, float] | None:
    """Over what colours are, of an integrator that does not need opacities."""
    return integrator.domain(volume) if isinstance(integrator, Integrator) else None


def framed_by(integrator: Integrator | None, tf: TransferFunction) -> TransferFunction:
    """What is seen of a transfer function."""
    return integrator.framed(tf) if isinstance(integrator, Integrator) else tf


def function_of(
    given: Function | None,
    volume: Field,
    opacity: Opacity | None = None,
    clim: Sequence[float] | float | None = None,
    method: Integrator | None = None,
) -> tuple[TransferFunction, Suggestion | None]:
    """The transfer function that is meant, and the suggestion it is from if opacities are not given.

    Parameters
    ----------
    given
        A transfer function; control points; a colour map, its name or a list of colours; the name of a preset, a
        suggestion, or a .json file; None is the first suggestion.
    opacity, clim
        Those of a colour map, as of ``from_colormap``; by default opacities are suggested, and it spans the volume.
    method
        The integrator: where it says what colours are over by default, and which, opacity is 1.
    """
    if isinstance(given, TransferFunction) or _are_points(given):
        _refuse("opacity", opacity, "a transfer function has its own")
        _refuse("clim", clim, "a transfer function has its own scalars")
        return (given if isinstance(given, TransferFunction) else TransferFunction(given)), None  # type: ignore[arg-type]
    if isinstance(given, str) and (given in PRESETS or given.lower().endswith(".json")):
        _refuse("opacity", opacity, f"{given!r} has its own")
        if given in PRESETS:
            # Of a relative scale nothing but the data says what 1 is.
            own = None if PRESETS[given].range == HOUNSFIELD else volume.range
            name: Any = given
            made = TransferFunction.preset(name, own if clim is None else _limits(clim))
            if own is None and clim is None:
                _doubt_hounsfield(given, made, volume)
            return made, None
        _refuse("clim", clim, f"{given!r} has its own scalars")
        return TransferFunction.load(given), None
    domain = domain_of(method, volume)
    if domain is not None and not (isinstance(given, str) and given in SUGGESTED):
        low, high = domain if clim is None else _limits(clim)
        assert method is not None
        colors: Any = method.colors if given is None else given
        _check_colors(colors)
        limits = (low, high if low < high else low + 1.0)
        strengths: Any = 1.0 if opacity is None else opacity
        return TransferFunction.from_colormap(colors, limits, strengths), None
    if given is None and opacity is None and clim is None:
        chosen = _suggestion(volume)
        return next(iter(chosen.functions.values())), chosen
    if isinstance(given, str) and given in SUGGESTED:
        chosen = _suggestion(volume)
        _refuse("opacity", opacity, f"{given!r} has its own")
        _refuse("clim", clim, f"{given!r} has its own scalars")
        if given not in chosen.functions:
            raise ValueError(
                f"transfer_function must be one of {', '.join(chosen.functions)} for such data, got {given!r}"
            )
        return chosen.functions[given], chosen
    colors = "viridis" if given is None else given
    limits = volume.range if clim is None else _limits(clim)
    _check_colors(colors)
    if opacity is not None:
        if limits[0] == limits[1]:
            raise ValueError(f"clim must be given for a volume whose samples are all {limits[0]:g}")
        return TransferFunction.from_colormap(colors, limits, opacity, "pyvista"), None
    if clim is not None and volume.range[0] == volume.range[1]:
        # Of samples that are all one, as a simulation begins, nothing can be suggested.
        return TransferFunction.from_colormap(colors, limits, "linear", "pyvista"), None
    chosen = _suggestion(volume)
    return recolored(next(iter(chosen.functions.values())), colors, limits), chosen


def _doubt_hounsfield(name: str, tf: TransferFunction, volume: Field) -> None:
    """Warn where the samples cannot be in Hounsfield units: of air, -1000, and something.

    Where hardly anything of the transfer function is left, the image is warned of.
    """
    lo, hi = volume.range
    begin, end = shown_by(tf) or (lo, hi)
    if (lo > AIR or hi < 0) and not is_narrow(tf, lo, hi) and begin < hi and end > lo:
        warnings.warn(
            f"{name!r} is in Hounsfield units, air about -1000 and bone up to 2000, and the samples are from {lo:g} to "
            f"{hi:g}: clim=(lo, hi) says which of them stand for -1000 and 2000",
            stacklevel=outside(),
        )


def _refuse(name: str, value: Any, why: str) -> None:
    if value is not None:
        raise ValueError(f"{name} is for colour maps{' and presets' * (name == 'clim')}, {why}, got {value!r}")


def _limits(clim: Any) -> tuple[float, float]:
    one = isinstance(clim, Real) and not isinstance(clim, bool)
    limits = float_array((-clim, clim) if one else clim, "clim")
    if limits.shape != (2,) or not limits[0] < limits[1] or not np.all(np.isfinite(limits)):
        raise ValueError(f"clim must be (lo, hi) with lo < hi, or one number for (-n, n), got {clim!r}")
    return float(limits[0]), float(limits[1])


def _are_points(given: Any) -> bool:
    """Whether it is a list of (scalar, colour, opacity), and not one of colours."""
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        return False
    rows = (p for p in given if isinstance(p, Sequence) and not isinstance(p, str) and len(p) == 3)
    return len(given) == sum(not isinstance(p[1], int | float | np.number) for p in rows)


def _check_colors(colors: Any) -> None:
    """Say what names there are, of everything that a name may mean."""
    import matplotlib

    if isinstance(colors, str) and colors not in matplotlib.colormaps:
        known = [*matplotlib.colormaps, *PRESETS, *SUGGESTED]
        file = "; a file to write is output=" if os.path.splitext(colors)[1] in (".mp4", ".gif", ".png") else ""
        raise ValueError(
            f"transfer_function must be a TransferFunction, control points, a Matplotlib colour map, a list of "
            f"colours, a .json file or one of {', '.join((*PRESETS, *SUGGESTED))}, got {colors!r}{file}"
            f"{near(colors, known)}"
        )
    if not isinstance(colors, str | list | tuple | np.ndarray | matplotlib.colors.Colormap):
        raise TypeError(
            f"transfer_function must be a TransferFunction, control points, a colour map or a list of colours, got "
            f"{type(colors).__name__}"
        )


def _suggestion(volume: Field) -> Suggestion:
    if not isinstance(volume, Volume):
        raise TypeError(
            f"transfer_function must be given: a {type(volume).__name__} has no samples in memory to "
            f'suggest opacities from; a colour map with its range is one: "viridis", clim=(0, 255), opacity="linear"'
        )
    return suggestion(volume)


def recolored(tf: TransferFunction, colors: Colors, limits: tuple[float, float]) -> TransferFunction:
    """The same extinction in the colours of a colour map over ``limits``."""
    rgb = entries(colors)
    at = np.linspace(*limits, len(rgb))
    inside = at[(at > tf.knots[0]) & (at < tf.knots[-1])]
    added = np.setdiff1d(inside, tf.knots)
    order = np.argsort(np.concatenate([tf.knots, added]), kind="stable")
    knots = np.concatenate([tf.knots, added])[order]
    unit = 1.0 if tf.unit_distance is None else tf.unit_distance
    opacity = np.concatenate([tf.opacities, -np.expm1(-tf.extinction(added) * unit)])[order]
    materials = {
        name: None if values is None else np.concatenate([values, np.interp(added, tf.knots, values)])[order]
        for name, values in tf.materials().items()
    }
    # In parts of the range: of denormal numbers the slopes overflow.
    with np.errstate(over="ignore"):
        parts = (knots - at[0]) / (at[-1] - at[0])
    painted = np.stack([np.interp(parts, np.linspace(0, 1, len(rgb)), channel) for channel in rgb.T], axis=-1)
    return TransferFunction.from_arrays(knots, painted, opacity, tf.unit_distance, **materials)


def camera_of(
    given: CameraLike | None, volume: Field, shown: Showing, aspect: float, clips: Sequence[Clip] = ()
) -> Camera:
    """The camera that is meant.

    Parameters
    ----------
    given
        A camera of wvr or PyVista, a plotter; [position, focal point, up]; a direction from the volume towards the
        camera, or the name of a view, with all that is visible in the frame; None is a view that suits the volume.
    """
    if isinstance(given, Camera):
        return given
    view: View | None = None
    if given is None:
        view = suggested_view(volume)
    elif isinstance(given, str):
        if given not in NAMES:
            raise ValueError(f"camera must be one of {', '.join(NAMES)}, got {given!r}{near(given, NAMES)}")
        view = named_view(given, volume)
    elif hasattr(given, "camera") or hasattr(given, "view_angle"):
        return Camera.from_pyvista(given)
    elif hasattr(given, "viewup"):
        place: Any = given
        return Camera(place.position, place.focal_point, place.viewup)
    else:
        try:
            vectors = float_array(given, "camera")
        except TypeError:
            vectors = np.empty(0)
        if vectors.shape == (3, 3):
            return Camera(*vectors)
        if vectors.shape != (3,):
            raise TypeError(
                f"camera must be a Camera, a PyVista camera or plotter, [position, focal point, up], a direction "
                f"(x, y, z), or one of {', '.join(NAMES)}, got {given!r}"
            )
        view = seen_from(vectors)
    return framed(visible_points(volume, shown, clips), *view, aspect=aspect)


def lighting_of(given: LightingLike | None, surfaces: bool, camera: Camera) -> Lighting | None:
    """The lighting that is meant: True is light from the upper left of the camera, None that where there are
    ``surfaces``.
    """
    if isinstance(given, Lighting):
        return given
    if given is None or isinstance(given, bool | np.bool_):
        return studio(camera) if given or (given is None and surfaces) else None
    if isinstance(given, str) and given in get_args(Mode):
        return Lighting(given)
    raise TypeError(
        f"lighting must be a Lighting, True, False or None, or one of its modes {', '.join(get_args(Mode))}, got "
        f"{given!r}{near(given, get_args(Mode))}"
    )


def shadows_of(given: Any, lighting: Lighting | None, camera: Camera) -> ConvolutionShadows | None:
    """The shadows that are meant: True is those of the lighting's first light that goes one way, or of that from the
    upper left.
    """
    if isinstance(given, np.bool_):
        given = bool(given)
    if given is True:
        lights = () if lighting is None else lighting.lights
        own = [light for light in lights if light.way(camera.basis()[2]) is not None]
        return ConvolutionShadows(light=(own or studio(camera).lights)[0])
    if given is None or given is False or isinstance(given, ConvolutionShadows):
        return given or None
    raise TypeError(f"shadows must be a ConvolutionShadows, True, False or None, got {given!r}")


def segmentation_of(given: Any, function: TransferFunction | None) -> Segmentation:
    """Labels that are given without transfer functions: each has a colour of its own, 0 is nothing."""
    if not isinstance(given, Volume) and not hasattr(given, "__array__"):
        raise TypeError(
            f"segmentation must be a Segmentation, an array of labels or None, got {type(given).__name__}: "
            f"wvr.Segmentation(labels, {{1: transfer_function}})"
        )
    assert function is not None
    return Segmentation.colored(given, function)


def studio(camera: Camera) -> Lighting:
    """A light above the photographer's left shoulder, and a weak one at the camera."""
    right, up, forward = camera.basis()
    key = DirectionalLight(tuple((-forward + 0.8 * up - 0.6 * right).tolist()), (0.95, 0.95, 0.95))
    return Lighting(light=(key, Headlight((0.3, 0.3, 0.3))), ambient=0.22, diffuse=0.78, specular=0.2)
