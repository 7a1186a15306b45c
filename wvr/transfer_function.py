"""Transfer functions: what colour and how much extinction a scalar has, exact in float64.

Extinction and colour are linear in the scalar between control points and constant outside them; two control points
at one scalar are a jump. Opacity is that of a homogeneous slab of thickness ``unit_distance``, so that the extinction
at a control point is ``tau_k = -log1p(-opacity_k) / unit_distance``. Note that opacity is therefore not linear
between control points. Colours are linear RGB; names, hex strings and colour maps are decoded from sRGB once.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from itertools import zip_longest
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cached import cached_property
from .color import doubt_bytes, linear_rgb
from .colormaps import Colors, Opacity, check_opacity, entries, opacities, sampled
from .files import known_suffix, read_text, write_text
from .pose import Fixed
from .preset_points import PresetName, preset_points
from .validation import check_domain, finite_array, flag, float_array, path_of, positive, real

Floats = NDArray[np.float64]

# Opacity 1 is an infinite extinction; the largest float32 below 1 stands for it.
MAX_OPACITY = 1 - 2.0**-24

# Of a unit distance [world length]; None is the smallest voxel spacing.
Unit: TypeAlias = float | Literal["pyvista"] | None

FORMAT = "wvr transfer function"
VERSION = 1
MATERIALS = ("ambient", "diffuse", "specular")


class TransferFunction(Fixed):
    """Colour and extinction of a scalar, piecewise linear. Immutable; equal when all that defines it is equal.

    Parameters
    ----------
    points
        Control points ``(scalar, colour, opacity)``, at least two, sorted by scalar. Two at one scalar are a jump:
        the first holds below, the second at the scalar and above. A colour is a name that Matplotlib knows or a hex
        string (both sRGB), or three linear RGB numbers >= 0, which may exceed 1. An opacity in [0, 1] is that of a
        homogeneous slab of thickness ``unit_distance``.
    unit_distance
        Thickness that opacities refer to [world length], > 0; None (the default) is the smallest voxel spacing of
        the volume it is used with, ``"pyvista"`` that of PyVista's ``add_volume``, see :meth:`from_colormap`.

    Attributes
    ----------
    knots
        Scalars of all control points, (n,) float64, sorted; a jump is two equal entries.
    colors
        Linear RGB at the control points, (n, 3) float64.
    opacities
        Opacity of ``unit_distance`` at the control points, (n,) float64.
    ambient, diffuse, specular
        Lighting coefficients at the control points, (n,) float64, or None.

    Raises
    ------
    ValueError
        For fewer than two, unsorted, NaN or infinite control points, three at one scalar, NaN or negative colours,
        unknown colour names, opacities outside [0, 1], ``unit_distance`` <= 0 or NaN.

    Examples
    --------
    >>> tf = TransferFunction([(0, (0, 0, 0), 0.0), (100, (1, 0.5, 0), 0.0), (200, (1, 1, 1), 0.5)])
    >>> float(tf.extinction(200))  # log(2)
    0.6931471805599453
    """

    fixed = ("knots", "colors", "opacities", "unit_distance", *MATERIALS)
    knots: Floats
    colors: Floats
    opacities: Floats
    unit_distance: Unit
    ambient: Floats | None
    diffuse: Floats | None
    specular: Floats | None

    def __init__(self, points: Iterable[tuple[float, Any, float]], unit_distance: Unit = None):
        scalars, rgb, opacity = [], [], []
        try:
            listed = list(points)
        except (TypeError, ValueError):  # nothing to iterate over, or used up
            raise TypeError(f"points must be a list of (scalar, colour, opacity), got {points!r}") from None
        for i, point in enumerate(listed):
            several = isinstance(point, Iterable) and not isinstance(point, str) and getattr(point, "ndim", 1) > 0
            if not several or len(triple := tuple(point)) != 3:
                raise ValueError(f"points[{i}] must be (scalar, colour, opacity), got {point!r}")
            scalars.append(_number(triple[0], f"scalar of points[{i}]"))
            rgb.append(linear_rgb(triple[1], f"colour of points[{i}]"))
            opacity.append(_number(triple[2], f"opacity of points[{i}]"))
        self._define(scalars, rgb, opacity, unit_distance)

    @classmethod
    def from_arrays(
        cls,
        scalars: ArrayLike,
        rgb: ArrayLike,
        opacity: ArrayLike,
        unit_distance: Unit = None,
        ambient: ArrayLike | None = None,
        diffuse: ArrayLike | None = None,
        specular: ArrayLike | None = None,
    ) -> TransferFunction:
        """The transfer function of n control points given as arrays.

        Parameters
        ----------
        scalars
            (n,), sorted; two equal ones are a jump.
        rgb
            (n, 3) linear RGB, >= 0.
        opacity
            (n,) opacity of a homogeneous slab of thickness ``unit_distance``, in [0, 1].
        unit_distance
            [world length]; None is the smallest voxel spacing.
        ambient, diffuse, specular
            (n,) lighting coefficients >= 0 at the control points, or None where those of the lighting hold.
        """
        tf = cls.__new__(cls)
        tf._define(scalars, rgb, opacity, unit_distance, ambient, diffuse, specular)
        return tf

    @classmethod
    def from_colormap(
        cls,
        colormap: Colors,
        domain: tuple[float, float] | float,
        opacity: Opacity = "linear",
        unit_distance: Unit = None,
        *,
        log_scale: bool = False,
        n_colors: int | None = None,
    ) -> TransferFunction:
        """Colours of a colour map over a range of scalars, with opacities equally spaced over the same range.

        Parameters
        ----------
        colormap
            A Matplotlib colour map, the name of one, or a list of two or more colours. Its N entries (256 for most)
            become colours equally spaced over ``domain``, decoded from sRGB; between them colour is linear.
        domain
            Scalars ``(lo, hi)`` of the first and last entry, lo < hi (PyVista's ``clim``); one number is (-n, n).
        opacity
            As in PyVista: ``"linear"`` (0 to 1), ``"geom"``, ``"sigmoid"``, ``"sigmoid_5"`` (any number), the same
            ending in ``"_r"``, from 1 to 0, or ``"foreground"`` (all but the lowest); or m >= 2 numbers from 0 to 1,
            equally spaced over ``domain``; one number is constant. Between numbers the *opacity* is linear, to 1/512:
            control points are added, since between control points it is extinction that is linear.
        unit_distance
            Thickness that opacities refer to [world length]; None is the smallest voxel spacing of the volume it is
            used with, and ``"pyvista"`` what PyVista's ``add_volume`` takes by default, the diagonal of the volume's
            box over the mean number of samples along an axis less one.
        log_scale
            Colours and opacities are equally spaced in the logarithm of the scalar; lo must be > 0.
        n_colors
            So many colours of the map, equally spaced; by default all. As in PyVista's volumes, colour is linear
            between them.

        Raises
        ------
        ValueError
            For an unknown name, ``domain`` not finite with lo < hi, and as the class.
        TypeError
            Where ``colormap`` is neither a name, a colour map nor a list of colours.
        """
        lo, hi = check_domain((-domain, domain) if isinstance(domain, int | float) else domain)
        if flag(log_scale, "log_scale") and lo <= 0:
            raise ValueError(f"domain must be above 0 with log_scale, got ({lo!r}, {hi!r})")
        u, rgb, between = sampled(entries(colormap, n_colors), opacities(opacity))
        scalars = np.exp(np.log(lo) + u * (np.log(hi) - np.log(lo))) if log_scale else lo + (hi - lo) * u
        scalars[0], scalars[-1] = lo, hi
        return cls.from_arrays(np.clip(scalars, lo, hi), rgb, between, unit_distance)

    @classmethod
    def isosurfaces(
        cls,
        values: ArrayLike,
        colors: Iterable[Any] | None = None,
        opacity: ArrayLike = 0.6,
        width: float = 2.0,
        unit_distance: Unit = None,
    ) -> TransferFunction:
        """A triangular spike of extinction at each value and nothing between: surfaces of finite thickness.

        Parameters
        ----------
        values
            Scalars of the surfaces, one or more, in any order.
        colors
            One colour a value, as for the class; by default from the colour map viridis.
        opacity
            Opacity at the peak of a spike, that of ``unit_distance``, in [0, 1]; one number or one a value.
        width
            Base width of a spike [scalar units], > 0; at most the smallest distance between two values.
        unit_distance
            [world length]; None is the smallest voxel spacing.

        Raises
        ------
        ValueError
            Where spikes overlap (the message has the largest width that does not), and as the class.
        """
        peaks = finite_array(np.atleast_1d(float_array(values, "values")), "values", (-1,))
        n = len(peaks)
        if n == 0:
            raise ValueError("values must be one or more, got none")
        width = positive(width, "width")
        given = float_array(opacity, "opacity")
        heights = finite_array(np.full(n, given) if given.ndim == 0 else given, "opacity", (n,))
        order = np.argsort(peaks)
        peaks, heights = peaks[order], heights[order]
        rgb = _spread_colors(n) if colors is None else _color_list(colors, n)[order]
        left, right = peaks - width / 2, peaks + width / 2
        if np.any(left == peaks) or np.any(right == peaks):
            raise ValueError(f"width must be more than rounding of values up to {np.abs(peaks).max():g}, got {width!r}")
        if n > 1:
            distance = float(np.diff(peaks).min())
            # Spikes that touch but for rounding touch.
            if width - distance > 4 * np.spacing(np.abs(peaks).max()):
                raise ValueError(f"width must be at most {distance!r}, or the spikes overlap, got {width!r}")
            right[:-1] = np.minimum(right[:-1], left[1:])
        zero = np.zeros(n)
        return cls.from_arrays(
            np.stack([left, peaks, right], axis=1).ravel(),
            np.repeat(rgb, 3, axis=0),
            np.stack([zero, heights, zero], axis=1).ravel(),
            unit_distance,
        )

    @classmethod
    def preset(cls, name: PresetName, domain: tuple[float, float] | None = None) -> TransferFunction:
        """A transfer function with a name; see :func:`wvr.presets.preset`."""
        return cls(preset_points(name, domain))

    def _define(
        self,
        scalars: ArrayLike,
        rgb: ArrayLike,
        opacity: ArrayLike,
        unit_distance: Unit,
        *materials: ArrayLike | None,
    ) -> None:
        self.knots = knots = finite_array(scalars, "scalars", (-1,))
        n = len(knots)
        if n < 2:
            raise ValueError(f"scalars must have at least two control points, got {n}")
        if np.any(falling := knots[1:] < knots[:-1]):
            i = int(np.argmax(falling))
            raise ValueError(f"scalars must be sorted, got {knots[i]:g} before {knots[i + 1]:g} at index {i}")
        if np.any(triple := knots[2:] == knots[:-2]):
            scalar = knots[int(np.argmax(triple))]
            raise ValueError(
                f"scalars must have at most two control points (a jump) at one scalar, got three at {scalar:g}"
            )
        if float(knots[-1]) - float(knots[0]) == np.inf:
            raise ValueError(f"scalars must span a finite range, got {knots[0]:g} to {knots[-1]:g}")
        doubt_bytes(rgb, "rgb")
        self.colors = finite_array(rgb, "rgb", (n, 3))
        if np.any(self.colors < 0):
            raise ValueError(f"rgb must be >= 0, got {self.colors.min():g}")
        self.opacities = finite_array(opacity, "opacity", (n,))
        check_opacity(self.opacities)
        named = unit_distance is None or (isinstance(unit_distance, str) and unit_distance == "pyvista")
        self.unit_distance = unit_distance if named else positive(unit_distance, "unit_distance")
        for name, values in zip_longest(MATERIALS, materials):
            coefficients = None if values is None else finite_array(values, name, (n,))
            if coefficients is not None and np.any(coefficients < 0):
                raise ValueError(f"{name} must be >= 0, got {coefficients.min():g}")
            setattr(self, name, coefficients)

    def knot_extinctions(self, smallest_spacing: float = 1.0) -> Floats:
        """Extinction [1/world length] at the control points, (n,).

        Parameters
        ----------
        smallest_spacing
            Smallest voxel spacing [world length], > 0, which opacities refer to where ``unit_distance`` is None.
        """
        if self.unit_distance == "pyvista":
            raise ValueError('unit_distance must be a length, got "pyvista", which a volume says: see for_volume')
        unit = positive(smallest_spacing, "smallest_spacing") if self.unit_distance is None else self.unit_distance
        return _depth(self.opacities) / unit

    def for_volume(self, volume: Any) -> TransferFunction:
        """The same with a length for its ``unit_distance`` where that is ``"pyvista"``; a renderer asks for it."""
        if self.unit_distance != "pyvista":
            return self
        diagonal = float(np.linalg.norm(volume.corners.max(axis=0) - volume.corners.min(axis=0)))
        unit = diagonal / max(float(np.mean(volume.dimensions)) - 1, 1.0)
        return self.from_arrays(self.knots, self.colors, self.opacities, unit, **self.materials())

    def per(self, unit_distance: float) -> TransferFunction:
        """The same opacities for another ``unit_distance`` [world length]."""
        return self.from_arrays(self.knots, self.colors, self.opacities, unit_distance, **self.materials())

    def extinction(self, s: ArrayLike, smallest_spacing: float = 1.0) -> Floats:
        """Extinction [1/world length] at scalars ``s``, of the shape of ``s``; 0 where ``s`` is NaN."""
        return self._interpolate(s, self.knot_extinctions(smallest_spacing))

    def color(self, s: ArrayLike) -> Floats:
        """Linear RGB at scalars ``s``, shape ``(*s.shape, 3)``; black where ``s`` is NaN."""
        return self._interpolate(s, self.colors)

    def scaled(self, exponent: int) -> TransferFunction:
        """The same for scalars times ``2**exponent``."""
        knots = np.ldexp(self.knots, exponent)
        return self.from_arrays(knots, self.colors, self.opacities, self.unit_distance, **self.materials())

    def _interpolate(self, s: ArrayLike, values: Floats) -> Floats:
        """``values`` (n, ...) at the control points, linear between, constant outside, right value at a jump."""
        s = float_array(s, "s")
        inside = np.clip(s, self.knots[0], self.knots[-1])
        i = np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, None)
        j = np.minimum(i + 1, len(self.knots) - 1)
        width = self.knots[j] - self.knots[i]
        # A width of zero is the last knot, or left of a jump at the first one; there the left value holds.
        t = np.divide(inside - self.knots[i], width, out=np.zeros_like(inside), where=width > 0)
        axes = (..., *[None] * (values.ndim - 1))
        between = values[i] + t[axes] * (values[j] - values[i])
        return np.where(np.isnan(s)[axes], 0.0, between)

    @cached_property
    def key(self) -> bytes:
        """Digest of all that defines the transfer function; caches compare by it."""
        digest = hashlib.blake2b(digest_size=16)
        unit = -1.0 if self.unit_distance == "pyvista" else self.unit_distance
        for values in (unit, self.knots, self.colors, self.opacities, *self.materials().values()):
            content = b"" if values is None else np.asarray(values, np.float64).tobytes()
            digest.update(len(content).to_bytes(8, "little") + content)
        return digest.digest()

    def __eq__(self, other: object) -> bool:
        return self.key == other.key if isinstance(other, TransferFunction) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.key)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the transfer function as JSON, every float exact; the file appears whole or not at all.

        Parameters
        ----------
        path
            A ``.json`` file, in any case.

        Raises
        ------
        ValueError
            For another extension.
        OSError
            Where the file cannot be written.
        """
        path = path_of(path)
        known_suffix(path, (".json",))
        write_text(path, self.to_json())

    def to_json(self) -> str:
        """The text that :meth:`save` writes, every float exact."""
        lines = ",\n".join(f"    {json.dumps(point)}" for point in self._points())
        return (
            f'{{\n  "format": {json.dumps(FORMAT)},\n  "version": {VERSION},\n'
            f'  "unit_distance": {json.dumps(self.unit_distance)},\n  "points": [\n{lines}\n  ]\n}}\n'
        )

    def _points(self) -> list[dict[str, Any]]:
        columns = {"scalar": self.knots, "color": self.colors, "opacity": self.opacities, **self.materials()}
        given = {name: values.tolist() for name, values in columns.items() if values is not None}
        return [dict(zip(given, row, strict=True)) for row in zip(*given.values(), strict=True)]

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TransferFunction:
        """The transfer function that :meth:`save` wrote.

        Raises
        ------
        OSError
            Where the file cannot be read.
        ValueError
            Where it is no JSON, no transfer function, of a version not known, or holds a wrong control point.
        """
        try:
            text = read_text(path_of(path))
        except ValueError as error:
            raise ValueError(f"{path} is not a JSON file: {error}") from None
        return cls.from_json(text, str(path))

    @classmethod
    def from_json(cls, text: str, name: str = "text") -> TransferFunction:
        """The transfer function of a text of :meth:`to_json`; errors are as of :meth:`load` and say the ``name``."""
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{name} is not a JSON file: {error}") from None
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise ValueError(f'{name} is not a transfer function: it must be an object with "format": "{FORMAT}"')
        if content.get("version") != VERSION:
            raise ValueError(f"{name} has version {content.get('version')!r} of the format; this wvr reads {VERSION}")
        try:
            points, unit_distance = content["points"], content["unit_distance"]
            given = [name for name in MATERIALS if any(name in point for point in points)]
            column = {name: [point[name] for point in points] for name in ("scalar", "color", "opacity", *given)}
            ambient, diffuse, specular = (column.get(name) for name in MATERIALS)
            return cls.from_arrays(
                column["scalar"], column["color"], column["opacity"], unit_distance, ambient, diffuse, specular
            )
        except KeyError as error:
            raise ValueError(f"{name} lacks {error}") from None
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} holds no valid transfer function: {error}") from None

    def __repr__(self) -> str:
        return (
            f"TransferFunction({len(self.knots)} control points on [{self.knots[0]:g}, {self.knots[-1]:g}], "
            f"opacity up to {self.opacities.max():g}, unit_distance={self.unit_distance})"
        )

    def materials(self) -> dict[str, Floats | None]:
        """Coefficients of light at the control points, by name."""
        return {name: getattr(self, name) for name in MATERIALS}


def _spread_colors(n: int) -> Floats:
    """``n`` colours equally spaced in viridis, without its darkest."""
    viridis = entries("viridis")
    return viridis[np.linspace(64, len(viridis) - 1, n).astype(int)]


def _color_list(colors: Iterable[Any], n: int) -> Floats:
    try:
        listed = [] if isinstance(colors, str) else list(colors)
    except TypeError:
        listed = []
    if len(listed) != n:
        raise ValueError(f"colors must be a list of one colour a value ({n}), got {colors!r}")
    return np.array([linear_rgb(color, f"colors[{i}]") for i, color in enumerate(listed)])


def _depth(opacity: ArrayLike) -> Floats:
    """Optical depth of a slab of this opacity."""
    return -np.log1p(-np.minimum(opacity, MAX_OPACITY))


def _number(value: Any, name: str) -> float:
    """A number, also one that is written."""
    try:
        return real(float(value) if isinstance(value, str) else value, name)
    except ValueError:
        raise TypeError(f"{name} must be a number, got {value!r}") from None
