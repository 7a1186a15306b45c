"""All that is to be seen: a frozen record whose pieces check themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from .cached import cached_property
from .camera import Camera
from .color import is_clear, linear_rgb
from .cuts.base import Clip
from .cuts.labels import LabelKinds, Segmentation, States
from .field.base import Field
from .field.blocks import Everything, Kinds, Ranges
from .integrators.base import Integrator
from .keep import Part
from .kernels.precision import REALS
from .light.lighting import Lighting
from .light.shadows import ConvolutionShadows
from .transfer.function import CLOSEST, LARGEST, Transfer
from .transfer.lookup import apart, on_jumps
from .transfer_function import TransferFunction
from .validation import choice, real

Precision = Literal["auto", "float32", "float64"]
# Of control points that are taken as they are, whatever their size.
LEAST = 1e-300
# Scalars of magnitudes from 2**-30 to 2**30 are used as they are; others are counted in another unit. Cells in single
# precision hold no more than 1e12 (docs/proof-single.md, S9), and no squares of slopes beyond 1e18.
ORDINARY = 30
# Steps along the longest ray: as many as float32 counts.
MOST_STEPS = 2**24


@dataclass(frozen=True, eq=False)
class Scene:
    """What is to be seen; :class:`wvr.Renderer` says what the fields are."""

    volume: Field
    transfer_function: TransferFunction | None
    integrator: Integrator
    lighting: Lighting | None
    shadows: ConvolutionShadows | None
    precision: Precision
    termination: float | None
    background: str | Sequence[float] | None
    skip_empty: bool
    clips: tuple[Clip, ...]
    segmentation: Segmentation | None
    like: Scene | None = None  # a scene that differs in which brick it is of alone

    def check(self, camera: Camera) -> None:
        """Say what is wrong with it: which argument, what was given, what is accepted."""
        for name, value, accepted in (
            ("volume", self.volume, Field),
            ("transfer_function", self.transfer_function, TransferFunction),
            ("camera", camera, Camera),
            ("integrator", self.integrator, Integrator),
            ("lighting", self.lighting, Lighting),
            ("shadows", self.shadows, ConvolutionShadows),
            ("segmentation", self.segmentation, Segmentation),
        ):
            optional = name in ("lighting", "shadows", "segmentation")
            optional = optional or (name == "transfer_function" and self.segmentation is not None)
            if not isinstance(value, accepted) and not (optional and value is None):
                kind = "Volume" if accepted is Field else accepted.__name__
                more = " or None" if optional else ""
                if accepted is Integrator:
                    more = ", such as wvr.Riemann(0.5) or wvr.Projection('max')"
                hint = ""
                if name == "volume":
                    hint = ": volume = wvr.as_volume(data)"
                elif name == "transfer_function":
                    hint = f": {_function_for(value)}"
                article = f"a{'n' * (kind[0] in 'AEIO')}"
                raise TypeError(f"{name} must be {article} {kind}{more}, got {_described(value)}{hint}")
        choice(self.precision, "precision", ("auto", *REALS))
        if not isinstance(self.skip_empty, bool | np.bool_):
            raise TypeError(f"skip_empty must be True or False, got {self.skip_empty!r}")
        if self.termination is not None and not 0 <= real(self.termination, "termination") < 1:
            raise ValueError(f"termination must be in [0, 1), got {self.termination!r}")
        if not is_clear(self.background):
            linear_rgb(self.background, "background")  # type: ignore[arg-type]
        # First of all, since other checks count with these numbers.
        self._check_magnitudes()
        alone = self.shadows is not None and self.shadows.alone  # and no integrator runs
        if not alone:
            self._check_integrator()
        for piece in (self.shadows, self.segmentation, *self.clips):
            if piece is not None:
                piece.check(self)
        parts = sorted({clip.parts for clip in self.clips if clip.parts is not None})
        if len(parts) > 1:
            raise ValueError(f"clip volumes must have the same parts, got {', '.join(map(repr, parts))}")
        self._check_steps()

    def _check_integrator(self) -> None:
        """The integrator, and what it does with light and clips."""
        without = [name for name in self.integrator.asks if not hasattr(self.volume.half, name)]
        if without:
            raise ValueError(
                f"integrator must be one that only samples the volume, such as Riemann or Simpson, got "
                f"{self.integrator!r}: a {type(self.volume).__name__} does not say what it is inside a cell "
                f"({', '.join(without)})"
            )
        self.integrator.check(self)
        if self.lighting is not None:
            self.lighting.check(self)
        for clip in self.clips:
            ways = [way for way, used in (("naive", clip.naive), ("parts", clip.parts is not None)) if used]
            if other := [way for way in ways if way not in self.integrator.clips]:
                raise ValueError(
                    f"clip with {other[0]} needs an integrator that has such steps, got {self.integrator!r}"
                )

    def _check_steps(self) -> None:
        """Says so where steps are too many to count, before any is taken."""
        longest = self.volume.longest
        for name, given in (("integrator", self.integrator), ("shadows", self.shadows)):
            if given is not None and given.shortest is not None and longest / given.shortest > MOST_STEPS:
                raise ValueError(
                    f"{name} must take at most {MOST_STEPS} steps through the volume, got {given!r}, which takes "
                    f"{longest / given.shortest:.3g} along its diagonal of {longest:.6g} voxel spacings: a step must "
                    f"be {longest / MOST_STEPS:.3g} or longer"
                )

    def _check_magnitudes(self) -> None:
        precision = min(self.integrator.precision(self), self.integrator.shown(self), key=LARGEST.__getitem__)
        most = LARGEST[precision]
        for tf in self.functions:
            extinction = tf.knot_extinctions(self.unit) * self.unit
            values = {"a colour": tf.colors, f"an extinction per voxel (unit_distance {tf.unit_distance})": extinction}
            values |= {name: factor for name, factor in tf.materials().items() if factor is not None}
            for name, value in values.items():
                if value.max() > most:
                    raise ValueError(
                        f"transfer_function has {name} of {value.max():.3g}; {precision} images hold up to {most:.0e}"
                    )
            gaps = np.diff(tf.knots)
            close = gaps[gaps > 0].min(initial=np.inf)
            if close < np.abs(tf.knots).max() * CLOSEST["float64"]:
                raise ValueError(
                    f"transfer_function has control points {close:.3g} apart, which is too close for float64"
                )
        light = 0.0 if self.lighting is None else self.lighting.largest(self)
        if self.shadows is not None:
            of_shadows = sum(max(one.color) for one in self.shadows.lights)
            light = max(light, of_shadows, max(light, self.brightest) * of_shadows)
        if not light <= most:
            raise ValueError(f"light makes numbers of {light:.3g} of colours; {precision} images hold up to {most:.0e}")
        low, high = self.volume.range if self.volume.shifts else (0.0, 0.0)
        scale = max(float(np.abs(tf.knots).max()) for tf in self.functions) or 1.0
        if self.integrator.probes and scale < LEAST:
            raise ValueError(
                f"transfer_function has control points up to {scale:.3g}, below {LEAST:g}, between which slopes "
                f"overflow; scale them and the volume's samples first"
            )
        # What is only looked for is float64.
        most = LARGEST["float64"] if self.integrator.probes else most
        if max(abs(low), abs(high)) > scale * most:
            raise ValueError(
                f"volume has samples from {low:.3g} to {high:.3g}, which {precision} does not hold together with "
                f"control points up to {scale:.3g}"
            )

    @cached_property
    def normal(self) -> Scene:
        """The same, with scalars of order one: where they are far from it, in another unit, a power of two."""
        if not self.volume.shifts or self.integrator.probes:
            return self
        exponent = int(np.frexp(max(float(np.abs(tf.knots).max()) for tf in self.functions))[1])
        if abs(exponent) <= ORDINARY:
            return self
        tf, labels = self.transfer_function, self.segmentation
        return replace(
            self,
            volume=self.volume.scaled(-exponent),
            transfer_function=None if tf is None else tf.scaled(-exponent),
            segmentation=None if labels is None else labels.scaled(-exponent),
        )

    @property
    def functions(self) -> list[TransferFunction]:
        """All transfer functions."""
        if self.segmentation is not None:
            return self.segmentation.states.functions
        assert self.transfer_function is not None
        return [self.transfer_function]

    @cached_property
    def unit(self) -> float:
        """The smallest voxel spacing [world length]."""
        return self.volume.smallest_spacing

    @cached_property
    def brightest(self) -> float:
        """Largest component of a colour, 1 or more: what a unit of opacity can change in any channel."""
        return max(1.0, *(float(tf.colors.max()) for tf in self.functions))

    @property
    def material(self) -> bool:
        """Whether coefficients of light vary with the scalar, and there is light."""
        given = (factor for tf in self.functions for factor in tf.materials().values())
        return self.lighting is not None and any(factor is not None for factor in given)

    @cached_property
    def shift(self) -> float:
        """The constant that floating-point samples are reduced by: about the middle of the control points where they
        are far from 0 for how far apart they are, else 0.

        All that is between half of it and twice of it is reduced without rounding, and what is less or more stays so:
        a sample is on the same side of a control point as before.
        """
        if not self.volume.shifts or self.integrator.probes:
            return 0.0
        ends = [tf.knots[[0, -1]] for tf in self.functions]
        low, high = float(np.min(ends)), float(np.max(ends))
        middle = 0.5 * low + 0.5 * high
        if getattr(self.volume, "dtype", None) != np.float64:
            # A number of the samples' precision, which they are reduced in.
            middle = float(np.float32(middle))
        return middle if low * high > 0 and min(abs(low), abs(high)) > 0.51 * abs(middle) else 0.0

    def ranges(self) -> Ranges:
        """Of the volume's blocks."""
        ranges = self.volume.blocks()
        assert isinstance(ranges, Ranges)
        return ranges

    def kinds(self, sweeps: bool = False) -> Part:
        """Which blocks there is something to see in, for the integrator or for sweeps of light: ``Kinds``,
        ``LabelKinds`` or ``Everything``.
        """
        own = None if sweeps else self.integrator.kinds(self)
        if own is not None and self.skip_empty:
            return own
        if self.volume.blocks() is None or (not self.skip_empty and self.segmentation is None):
            return Everything(self.volume)
        shift = self.shift
        exact = self.integrator.precision(self) == "float64" and not sweeps
        functions = tuple(
            self.integrator.function(self, tf) if exact else Transfer(tf, self.unit, shift, "float64", False)
            for tf in self.functions
        )
        if self.segmentation is not None:
            states = States.of(self.segmentation)
            return LabelKinds(self.volume, self.ranges(), states, functions, shift, bool(self.skip_empty))
        cells, strides = (False, False) if sweeps else (self.integrator.cells, self.integrator.strides(self))
        return Kinds(self.volume, self.ranges(), functions[0], shift, cells, strides)

    @property
    def scalars(self) -> tuple[float, float]:
        """What tables are over: the volume's range, so that no segment reaches outside; one value is in the middle."""
        low, high = self.volume.range
        return (low, high) if low < high else (low - 0.5, high + 0.5)

    def table_shape(self, tf: TransferFunction, entries: Literal[256, 512] = 512) -> tuple[int, tuple[float, float]]:
        """Entries of a table, so many or as many as it takes for a field that stays at a value of its own, and domain.

        Grey levels are entries, where there are not more than 512 of them: between few levels there is as much to be
        seen as between many. Else jumps of the transfer function are (:func:`wvr.transfer.lookup.on_jumps`).
        """
        low, high = self.scalars
        if not self.volume.whole or high - low >= 512:
            return on_jumps(tf, entries, apart(tf, (low, high)))
        gaps = int(high - low)
        each = -(-256 // gaps) if gaps < 128 else entries // 256 if gaps < 256 else 1
        return gaps * each + 1, (low, high)

    def volumes(self) -> list[Any]:
        """All objects with samples that may be written to between frames."""
        own = [self.volume, getattr(self.segmentation, "labels", None)]
        return [one for one in (*own, *(getattr(clip, "volume", None) for clip in self.clips)) if hasattr(one, "look")]


def _function_for(value: Any) -> str:
    """What makes a transfer function of something that wvr.render takes for one."""
    if value is None:
        return "wvr.presets.suggest(volume) has some, or give a segmentation"
    if isinstance(value, list | tuple) and value and not isinstance(value[0], str | int | float):
        return "wvr.TransferFunction(points) makes one of control points; wvr.render takes such as they are"
    name = repr(value) if isinstance(value, str) else "colors"
    return f"wvr.TransferFunction.from_colormap({name}, volume.range) makes one; wvr.render takes such as they are"


def _described(value: Any) -> str:
    if isinstance(value, type):
        return f"the class {value.__name__}: say {value.__name__}(...)"
    return repr(value) if isinstance(value, str | int | float | None) else type(value).__name__
