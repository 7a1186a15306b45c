"""Rendering: what a scene is, what is kept between frames, and what depends on what."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .camera import Camera, image_size
from .color import linear_rgb
from .image import Image
from .integrators import (
    AdaptivePreintegrated,
    AdaptiveSimpson,
    Certified,
    Exact,
    Integrator,
    Preintegrated,
    Riemann,
    Simpson,
)
from .kernels import blocks as small
from .kernels.field import make_field
from .kernels.importance import BLOCK, blocks, make_bends, make_distances, make_empty, make_ranges
from .kernels.precision import REALS, vec4_of
from .kernels.ray import TILE, View, item, tiles
from .kernels.raycast import make_raycast
from .kernels.scene import Light, Shading, Step, Steps, Variant, make_scene
from .kernels.slices import make_finish
from .launch import get_device, launch
from .lighting import Lighting
from .lights import Headlight
from .shadows import ConvolutionShadows
from .simplify import Simplified, simplify
from .sweep import sweep_lights
from .tables import (
    lit_tables,
    nodes_array,
    range_maxima,
    table_array,
    table_struct,
    transfer_arrays,
    transfer_factors,
    transfer_values,
)
from .transfer_function import TransferFunction
from .validation import choice
from .volume import Volume

DEFAULT = Certified(1 / 512)
TERMINATION = 1 / 1024
# Gradient at which light has half faded [range of the transfer function per smallest voxel spacing].
FAINT = 1e-4
INTEGRATORS = (Riemann, Simpson, Preintegrated, AdaptivePreintegrated, AdaptiveSimpson, Exact, Certified)


class Renderer:
    """A volume and how to render it; keeps what can be kept between frames.

    Assign ``volume``, ``transfer_function``, ``integrator`` and so on; what depends on them, and nothing else, is
    rebuilt with the next frame. A new camera or size rebuilds nothing.

    Parameters
    ----------
    volume, transfer_function
        What to render.
    integrator, tolerance
        One of them; by default the tolerance is 1/512. See :func:`render`.
    lighting
        Light on what is emitted; by default none.
    shadows
        Light that travels; by default none.
    precision
        ``"float32"``, ``"float64"`` or ``"auto"``; see :func:`render`.
    device
        Warp device; by default CUDA where there is one, else the CPU.
    termination
        A ray ends when less than this transparency is left, in [0, 1); 0 is never. By default 1/1024, 0 for ``Exact``,
        at most 1/256 for ``AdaptivePreintegrated``, and a quarter of the tolerance for ``Certified``.
    background
        What display and PNG files put behind the volume; ``rgba`` never has it.
    skip_empty
        Leap over blocks of the volume in which nothing has any extinction; the image is the same to rounding.

    Attributes
    ----------
    builds
        How often each part was built. Of the volume: ``"volume"`` (brought to the device), ``"ranges"``, ``"extents"``
        (of blocks and small blocks of cells). Of the transfer function: ``"transfer"``, ``"table"``, ``"simplified"``.
        Of both: ``"empty"``, ``"kinds"`` (which blocks and cells there is something to see in).
    """

    def __init__(
        self,
        volume: Volume,
        transfer_function: TransferFunction,
        *,
        integrator: Integrator | None = None,
        tolerance: float | None = None,
        lighting: Lighting | None = None,
        shadows: ConvolutionShadows | None = None,
        precision: str = "auto",
        device: Any = None,
        termination: float | None = None,
        background: str | Sequence[float] | None = None,
        skip_empty: bool = True,
    ):
        if tolerance is not None:
            if integrator is not None:
                raise ValueError(f"tolerance = {tolerance!r} and integrator = {integrator!r}: give one of the two")
            integrator = Certified(tolerance)
        self.volume = volume
        self.transfer_function = transfer_function
        self.integrator: Integrator = DEFAULT if integrator is None else integrator
        self.lighting = lighting
        self.shadows = shadows
        self.precision = precision
        self.device = device
        self.termination = termination
        self.background = background
        self.skip_empty = skip_empty
        self.builds: Counter[str] = Counter()
        self._kept: dict[str, tuple[tuple, Any]] = {}
        self._buffers: dict[tuple, wp.array] = {}

    def render(self, camera: Camera, size: tuple[int, int] = (512, 512)) -> Image:
        """Render one frame.

        Parameters
        ----------
        camera
            Where it is seen from.
        size
            (width, height) in pixels.
        """
        start = perf_counter()
        self._check(camera)
        width, height = image_size(size)
        device = get_device(self.device)
        rule = self.integrator.rule
        shown = "float32" if self.precision == "auto" else self.precision
        # Of the image; what is exact or certified is computed in float64.
        precision = "float64" if rule in ("exact", "certified") else shown
        if rule == "exact":
            shown = precision
        if self.shadows is not None and self.shadows.image == "slices":
            return self._render_slices(self.shadows, camera, width, height, shown, device)
        real = REALS[precision]
        variant = Variant(
            wp.dtype_from_numpy(self.volume.dtype), precision, rule, not self.volume.has_nonfinite, self.skip_empty
        )
        if self.lighting is not None:
            mode = self.lighting.mode if rule == "preintegrated" else "point"
            variant = replace(variant, lit=mode, gradient=self.lighting.gradient, material=self._material)
        _check_memory(self.volume, width, height, device)

        scene = make_scene(variant)()
        shift = self._shift()
        scene.view = view(self.volume, camera, width, height)
        scene.steps = self._steps()
        scene.field = self._field(variant, shift, device)
        if isinstance(self.integrator, Certified):
            scene.transfer = self._simplified(self.integrator.tolerance, shown, scene.steps, shift, device)
        else:
            scene.transfer = self._transfer(precision, shift, device)
        if isinstance(self.integrator, Preintegrated | AdaptivePreintegrated):
            length, generator = self._table_kind()
            scene.table = self._table("table", length, generator, precision, shift, device)
        if isinstance(self.integrator, AdaptivePreintegrated):
            scene.distance = self._distance(variant, shift, scene.transfer, device)
        if self.lighting is not None:
            scene.shading, scene.lights = self._shading(self.lighting, device)
        bound = None
        if rule == "certified":
            scene.kinds, scene.masks, low, high = self._kinds(variant, shift, scene.transfer, device)
            # Rays begin and end with what there is to see.
            scene.view.low, scene.view.high = wp.vec3d(*low), wp.vec3d(*high)
            bound = scene.bound = wp.zeros((height, width), dtype=wp.float32, device=device)
        elif rule == "exact" or self.skip_empty:
            scene.empty = self._empty(variant, shift, scene.transfer, device)
        if rule in ("preintegrated", "exact", "certified"):
            scene.nodes = nodes_array(precision, device)
        rgba = wp.empty((height, width), dtype=vec4_of(real), device=device)
        samples = wp.empty((height, width), dtype=int, device=device)
        wp.synchronize_device(device)
        prepared = perf_counter()
        tile = int(TILE) ** 2
        launch(make_raycast(variant), tiles(width, height) * tile, [scene, rgba, samples], device, grain=tile)
        wp.synchronize_device(device)
        end = perf_counter()
        count = samples.numpy()
        stats = {
            "seconds": end - start,
            "seconds_prepare": prepared - start,
            "seconds_raycast": end - prepared,
            "rays": width * height,
            "samples": int(count.sum(dtype=np.int64)),
            "bytes": self.volume.numpy().nbytes + rgba.capacity + samples.capacity,
            "device": device.name,
            "precision": shown,
            "integrator": repr(self.integrator),
        }
        if self.shadows is not None:
            stats |= self._shade(self.shadows, camera, rgba, precision, shown, device)[0]
            stats["seconds"] += stats["seconds_shadows"]
        tracer = None
        if isinstance(self.integrator, AdaptiveSimpson):
            whole = "a ray" if self.integrator.scope == "ray" else f"a step of {self.integrator.h0:g} voxel spacings"
            stats["tolerance_covers"] = (
                f"the error estimates of {whole}, shared out by length; not forced steps, nor what lies between samples"
            )
        if isinstance(self.integrator, AdaptivePreintegrated):
            stats["tolerance_covers"] = "what a linear scalar costs a step; not forced steps, nor their sum along a ray"
        if isinstance(self.integrator, AdaptiveSimpson | AdaptivePreintegrated):
            tracer = _tracer(variant, scene, count, device)
        error_bound = None
        if isinstance(self.integrator, Certified):
            assert bound is not None
            error_bound = bound.numpy()
            over = int(np.count_nonzero(error_bound > self.integrator.tolerance))
            extras = [name for name in ("lighting", "shadows") if getattr(self, name) is not None]
            covered = f"opacity and the unlit integral, not the {' and '.join(extras)}" if extras else "all channels"
            stats["bound_covers"] = (
                f"{covered}: where rays ended, simplification of the transfer function, series and rounding"
            )
            stats["rays_over_tolerance"] = over
        return Image(rgba.numpy().astype(shown, copy=False), count, error_bound, stats, self.background, tracer)

    def _render_slices(
        self, shadows: ConvolutionShadows, camera: Camera, width: int, height: int, precision: str, device: wp.Device
    ) -> Image:
        """A frame composed of the slices of the shadows."""
        _check_memory(self.volume, width, height, device)
        rgba = wp.empty((height, width), dtype=vec4_of(REALS[precision]), device=device)
        stats, samples = self._shade(shadows, camera, rgba, precision, precision, device)
        stats |= {
            "seconds": stats["seconds_shadows"],
            "rays": width * height,
            "samples": int(samples.sum(dtype=np.int64)),
            "bytes": self.volume.numpy().nbytes + rgba.capacity + samples.nbytes,
            "device": device.name,
            "precision": precision,
            "integrator": repr(shadows),
        }
        return Image(rgba.numpy(), samples, None, stats, self.background, None)

    def _shade(
        self,
        shadows: ConvolutionShadows,
        camera: Camera,
        rgba: wp.array,
        precision: str,
        swept: str,
        device: wp.Device,
    ) -> tuple[dict[str, Any], NDArray[np.int32]]:
        """Puts an image of a ``precision`` into shadow, or makes it, by sweeps in the precision ``swept``; statistics and
        samples of the sweeps.
        """
        start = perf_counter()
        height, width = rgba.shape
        variant = Variant(
            wp.dtype_from_numpy(self.volume.dtype),
            swept,
            "preintegrated" if shadows.preintegrated else "midpoint",
            not self.volume.has_nonfinite,
            self.skip_empty,
        )
        if self.lighting is not None:
            variant = replace(variant, lit="point", gradient=self.lighting.gradient, material=self._material)
        shift = self._shift()
        scene = make_scene(variant)()
        scene.view = view(self.volume, camera, width, height)
        scene.steps = self._steps()
        scene.field = self._field(variant, shift, device)
        scene.transfer = self._transfer(swept, shift, device)
        if shadows.preintegrated:
            length = shadows.slice_distance / (shadows.subsamples + 1)
            scene.table = self._table("slab table", length, "stretchable", swept, shift, device)
        if self.lighting is not None:
            scene.shading, scene.lights = self._shading(self.lighting, device)
        if self.skip_empty:
            scene.empty = self._empty(variant, shift, scene.transfer, device)
            low, high = self._seen_box(scene.empty.numpy() == 0, int(BLOCK))
            scene.view.low, scene.view.high = wp.vec3d(*low), wp.vec3d(*high)
        light, slices, samples, count = sweep_lights(self.volume, camera, shadows, variant, scene, device)
        share = shadows.image == "rays"
        launch(make_finish(precision), width * height, [light, slices, share, rgba], device)
        wp.synchronize_device(device)
        stats = {
            "seconds_shadows": perf_counter() - start,
            "slices": count,
            "shadow_samples": int(samples.sum(dtype=np.int64)),
            "shadows": repr(shadows),
        }
        return stats, samples

    def _check(self, camera: Camera) -> None:
        for name, value, accepted in (
            ("volume", self.volume, Volume),
            ("transfer_function", self.transfer_function, TransferFunction),
            ("camera", camera, Camera),
        ):
            if not isinstance(value, accepted):
                raise TypeError(f"{name} must be a {accepted.__name__}, got {type(value).__name__}")
        if not isinstance(self.integrator, INTEGRATORS):
            names = ", ".join(kind.__name__ for kind in INTEGRATORS)
            raise TypeError(f"integrator must be one of {names}, got {self.integrator!r}")
        if self.lighting is not None and not isinstance(self.lighting, Lighting):
            raise TypeError(f"lighting must be a Lighting or None, got {type(self.lighting).__name__}")
        if self.shadows is not None and not isinstance(self.shadows, ConvolutionShadows):
            raise TypeError(f"shadows must be ConvolutionShadows or None, got {type(self.shadows).__name__}")
        if self.lighting is not None and getattr(self.integrator, "generator", None) == "approximate":
            raise ValueError(
                'integrator: lighting weighs where in a segment it is lit, which generator="approximate" leaves out; '
                'take "incremental" or "brute"'
            )
        choice(self.precision, "precision", ("auto", *REALS))
        if self.termination is not None and not 0 <= self.termination < 1:
            raise ValueError(f"termination must be in [0, 1), got {self.termination!r}")
        if self.background is not None:
            linear_rgb(self.background, "background")

    def _shift(self) -> float:
        """The constant that floating-point samples are reduced by: the middle of the transfer function's knots."""
        if self.volume.dtype.kind != "f":
            return 0.0
        knots = self.transfer_function.knots
        # Rounded, so that it is the same number in every precision.
        return float(np.float32(0.5 * (knots[0] + knots[-1])))

    def _steps(self) -> Any:
        steps = Steps()
        default = getattr(self.integrator, "termination", TERMINATION)
        if isinstance(self.integrator, Certified):
            default /= self._brightest
        steps.opaque = 1.0 - (default if self.termination is None else self.termination)
        for name, value in self.integrator.steps.items():
            setattr(steps, name, value)
        return steps

    @property
    def _material(self) -> bool:
        """Whether coefficients of light vary with the scalar, and there is light."""
        tf = self.transfer_function
        return self.lighting is not None and any(f is not None for f in (tf.ambient, tf.diffuse, tf.specular))

    def _shading(self, lighting: Lighting, device: wp.Device) -> tuple[Any, wp.array]:
        """The structs of ``kernels.shading``."""
        knots = self.transfer_function.knots
        matrix = self.volume.index_to_world[:3, :3]
        # The gradient is a number: a change over a voxel, in parts of the transfer function's range.
        scale = self.volume.smallest_spacing / ((knots[-1] - knots[0]) or 1.0)
        shading = Shading()
        for name in ("ambient", "diffuse", "specular", "shininess"):
            setattr(shading, name, getattr(lighting, name))
        shading.faint = FAINT**2
        shading.parts = lighting.supersample
        shading.to_world = wp.mat33d(*(scale * np.linalg.inv(matrix).T).ravel())
        shading.ahead = wp.mat33d(*matrix.ravel())
        lights = []
        for light in lighting.lights:
            lights.append(Light())
            lights[-1].headlight = isinstance(light, Headlight)
            lights[-1].toward = wp.vec3d(*getattr(light, "direction", (0.0, 0.0, 0.0)))
            lights[-1].color = wp.vec3d(*light.color)
        return shading, wp.array(lights, dtype=Light, device=device)

    @property
    def _brightest(self) -> float:
        """Largest component of a colour, 1 or more: what a unit of opacity can change in any channel."""
        return max(1.0, float(self.transfer_function.colors.max()))

    def _keep(self, part: str, key: tuple, build: Any) -> Any:
        """``build()``, or what it made last for the same ``key``."""
        if part not in self._kept or self._kept[part][0] != key:
            self._kept[part] = (key, build())
            self.builds[part] += 1
        return self._kept[part][1]

    def _field(self, variant: Variant, shift: float, device: wp.Device) -> Any:
        data = self._keep("volume", (self.volume, device.alias), lambda: self.volume.on(device))
        Field, _ = make_field(variant.dtype, REALS[variant.precision])
        field = Field()
        field.data = data
        field.last = wp.vec3i(*(n - 2 for n in reversed(data.shape)))
        field.shift = shift
        return field

    def _transfer(self, precision: str, shift: float, device: wp.Device) -> Any:
        tf, unit = self.transfer_function, self.volume.smallest_spacing
        factors = transfer_factors(tf) if self._material else None
        key = (tf.key, unit, shift, precision, device.alias, self._material)
        return self._keep(
            "transfer",
            key,
            lambda: transfer_arrays(tf.knots, transfer_values(tf, unit), shift, precision, device, factors),
        )

    def _empty(self, variant: Variant, shift: float, transfer: Any, device: wp.Device) -> wp.array:
        """Flags of the blocks of cells in which nothing has any extinction."""

        def build_flags() -> wp.array:
            result = wp.empty(ranges.shape, dtype=wp.uint8, device=device)
            launch(
                make_empty(REALS[variant.precision]), result.size, [ranges, wp.float64(shift), transfer, result], device
            )
            return result

        if not self.skip_empty:
            return wp.zeros(blocks(self.volume.on(device).shape), dtype=wp.uint8, device=device)
        ranges = self._ranges(variant, device)
        key = (self.transfer_function.key, self.volume, shift, variant.precision, device.alias)
        return self._keep("empty", key, build_flags)

    def _simplified(self, tolerance: float, shown: str, steps: Any, shift: float, device: wp.Device) -> Any:
        """The transfer function with fewer control points; and how the tolerance is spent, into ``steps``."""
        tf, unit = self.transfer_function, self.volume.smallest_spacing
        brightest = self._brightest
        low, high = self.volume.index_box
        longest = float(np.linalg.norm(self.volume.index_to_world[:3, :3] @ (high - low))) / unit

        def build() -> tuple[Simplified, Any]:
            share = tolerance / 12
            values = transfer_values(tf, unit)
            if self._material:
                # Coefficients of light belong to the control points there are.
                points = Simplified(tf.knots, values, 0.0, 0.0, 0.0)
                return points, transfer_arrays(tf.knots, values, shift, "float64", device, transfer_factors(tf))
            points = simplify(tf.knots, values, share, share / brightest, share / (brightest * longest))
            return points, transfer_arrays(points.knots, points.values, shift, "float64", device)

        key = (tf.key, unit, longest, tolerance, shift, device.alias, self._material)
        points, transfer = self._keep("simplified", key, build)
        steps.tolerance = tolerance / 4
        steps.brightest = brightest
        steps.tinted = points.color + brightest * points.relative
        # Rounding: of cuts at control points and of float64 sums, and of the image.
        steps.veiled = brightest * (points.absolute * longest + 1e-8 + (np.finfo(shown).eps / 2))
        return transfer

    def _kinds(
        self, variant: Variant, shift: float, transfer: Any, device: wp.Device
    ) -> tuple[wp.array, wp.array, NDArray[np.float64], NDArray[np.float64]]:
        """Kinds of the small blocks of cells, which of their cells there may be something to see in, and the box of
        those blocks in index coordinates.
        """
        data = self.volume.on(device)
        shape = small.blocks(data.shape)
        if not self.skip_empty:
            kinds, masks = (wp.empty(shape, dtype=dtype, device=device) for dtype in (wp.int16, wp.uint64))
            kinds.fill_(int(small.SEVERAL))
            masks.fill_(2**64 - 1)
            return kinds, masks, *self.volume.index_box

        def build_extents() -> wp.array:
            result = self._buffer("extents", shape, wp.types.vector(2, variant.dtype), device)
            launch(small.make_ranges(variant.dtype), result.size, [data, result], device)
            return result

        def build() -> tuple[wp.array, wp.array, NDArray[np.float64], NDArray[np.float64]]:
            masks = self._buffer("masks", shape, wp.uint64, device)
            before, after = (self._buffer(name, shape, wp.int16, device) for name in ("kinds", "kinds before"))
            launch(small.make_kinds(variant.dtype), masks.size, [extents, wp.float64(shift), transfer, before], device)
            for axis in range(3):
                launch(small.spread, masks.size, [axis, before, after], device)
                before, after = after, before
            inputs = [data, extents, wp.float64(shift), transfer, before, masks]
            launch(small.make_masks(variant.dtype), masks.size, inputs, device)
            return before, masks, *self._seen_box(before.numpy() > int(small.EMPTY), 1 << int(small.BITS))

        extents = self._keep("extents", (self.volume, device.alias), build_extents)
        return self._keep("kinds", (self._kept["simplified"][0], self.volume), build)

    def _seen_box(self, seen: NDArray[np.bool_], size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Box of the blocks (z, y, x) of a ``size`` that are seen, in index coordinates; a point if none is."""
        low, high = self.volume.index_box
        if not seen.any():
            return low, low
        for axis in range(3):
            if self.volume.dimensions[axis] > 1:
                at = np.flatnonzero(seen.any(axis=tuple(a for a in range(3) if a != 2 - axis))) * size
                low[axis] = at[0]
                high[axis] = min(high[axis], at[-1] + size)
        return low, high

    def _buffer(self, name: str, shape: tuple[int, ...], dtype: Any, device: wp.Device) -> wp.array:
        """An array that is made once: volumes of one shape that follow each other write into the same."""
        key = (name, shape, dtype, device.alias)
        if key not in self._buffers:
            self._buffers = {k: v for k, v in self._buffers.items() if k[0] != name}
            self._buffers[key] = wp.empty(shape, dtype=dtype, device=device)
        return self._buffers[key]

    def _ranges(self, variant: Variant, device: wp.Device) -> wp.array:
        """Smallest and largest sample of each block of cells."""
        data = self.volume.on(device)

        def build() -> wp.array:
            result = wp.empty(blocks(data.shape), dtype=wp.vec2d, device=device)
            launch(make_ranges(variant.dtype), result.size, [data, result], device)
            return result

        return self._keep("ranges", (self.volume, device.alias), build)

    def _distance(self, variant: Variant, shift: float, transfer: Any, device: wp.Device) -> wp.array:
        """How long a step may be in each block of cells, by the integrator's tolerance."""
        data, tf, unit = self.volume.on(device), self.transfer_function, self.volume.smallest_spacing

        def build_bends() -> wp.array:
            result = wp.empty(blocks(data.shape), dtype=wp.vec2d, device=device)
            scale = wp.vec3d(*(unit / np.array(self.volume.spacing)))
            launch(make_bends(variant.dtype), result.size, [data, scale, result], device)
            return result

        def build() -> wp.array:
            result = wp.empty(ranges.shape, dtype=wp.float32, device=device)
            maxima = range_maxima(tf, unit, device)
            inputs = [ranges, bends, wp.float64(shift), transfer, maxima, wp.float64(tolerance), result]
            launch(make_distances(REALS[variant.precision]), result.size, inputs, device)
            return result

        tolerance = self.integrator.steps["tolerance"]
        ranges = self._ranges(variant, device)
        bends = self._keep("bends", (self.volume, device.alias), build_bends)
        key = (tf.key, self.volume, shift, variant.precision, device.alias, tolerance)
        return self._keep("distances", key, build)

    def _table_kind(self) -> tuple[float, str]:
        """Length of the segments of the integrator's table, and what makes it."""
        if isinstance(self.integrator, Preintegrated):
            return self.integrator.steps["step"], self.integrator.generator
        return self.integrator.steps["shortest"], "stretchable"

    def _table(
        self, part: str, length: float, generator: str, precision: str, shift: float, device: wp.Device
    ) -> Any:
        tf, unit = self.transfer_function, self.volume.smallest_spacing
        n, domain = _table_shape(self.volume, getattr(self.integrator, "table_size", None) if part == "table" else None)
        lit = self.lighting is not None and generator != "stretchable"
        key = (tf.key, unit, length, n, domain, generator, precision, device.alias, lit)
        arguments = (tf, n, length, unit, domain, generator, precision, device)
        build = lit_tables if lit else table_array
        return table_struct(self._keep(part, key, lambda: build(*arguments)), domain, shift, precision)


def render(
    volume: Volume,
    transfer_function: TransferFunction,
    camera: Camera,
    size: tuple[int, int] = (512, 512),
    *,
    integrator: Integrator | None = None,
    tolerance: float | None = None,
    lighting: Lighting | None = None,
    shadows: ConvolutionShadows | None = None,
    background: str | Sequence[float] | None = None,
    precision: str = "auto",
    device: Any = None,
    termination: float | None = None,
    skip_empty: bool = True,
) -> Image:
    """Render a volume.

    Parameters
    ----------
    volume
        The field.
    transfer_function
        Colour and extinction of a scalar.
    camera
        Where it is seen from.
    size
        (width, height) in pixels.
    tolerance
        Largest absolute error that any channel of any pixel may have, in (0, 1): the integrator is then
        ``Certified(tolerance)``, and the image comes with an ``error_bound``. By default 1/512, less than an 8-bit
        grey level.
    integrator
        Any other of ``wvr.integrators``, instead of a tolerance.
    lighting
        A :class:`Lighting`: light on what is emitted, by default none. A tolerance then holds for opacity and for the
        image without light; with light, colours converge as it decreases.
    shadows
        A :class:`ConvolutionShadows`: light that is attenuated and spread on its way, by default none. A tolerance then
        holds for opacity and for the image without shadows. Colours lit by ``lighting``, if there is any, are in shadow
        as a whole.
    background
        What display and PNG files put behind the volume: a colour name, ``"#rrggbb"`` or three linear numbers.
    precision
        ``"auto"`` (float32), ``"float32"`` or ``"float64"``: that of everything along a ray but the sums, which are
        always float64, and that of the image. ``Exact`` is float64 whatever is given; ``Certified`` computes in float64
        and rounds the image.
    device
        Warp device; by default CUDA where there is one, else the CPU.
    termination
        A ray ends when less than this transparency is left, in [0, 1); 0 is never. By default 1/1024, 0 for ``Exact``,
        at most 1/256 for ``AdaptivePreintegrated``, and a quarter of the tolerance for ``Certified``.
    skip_empty
        Leap over blocks of the volume in which nothing has any extinction. False computes everything; the image is the
        same to rounding.

    Returns
    -------
    Image

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind or value, or a tolerance and an integrator; each says which, what was given and
        what is accepted.
    MemoryError
        Where volume and image cannot fit the device's memory.
    """
    renderer = Renderer(
        volume,
        transfer_function,
        integrator=integrator,
        tolerance=tolerance,
        lighting=lighting,
        shadows=shadows,
        precision=precision,
        device=device,
        termination=termination,
        background=background,
        skip_empty=skip_empty,
    )
    return renderer.render(camera, size)


def view(volume: Volume, camera: Camera, width: int, height: int) -> Any:
    """The struct of ``kernels.ray`` for a camera and image size, set up in float64."""
    to_index = np.linalg.inv(volume.index_to_world)
    right, up, forward = camera.basis()
    half = np.tan(np.radians(camera.view_angle) / 2) if camera.parallel_scale is None else camera.parallel_scale
    pixel = 2 * half / height
    right, down = pixel * right, -pixel * up
    corner = -0.5 * (width - 1) * right - 0.5 * (height - 1) * down
    position = to_index[:3, :3] @ camera.position + to_index[:3, 3]
    if camera.parallel:
        right, down, corner = to_index[:3, :3] @ right, to_index[:3, :3] @ down, position + to_index[:3, :3] @ corner
    else:
        corner = corner + forward
    low, high = volume.index_box
    result = View()
    result.width, result.height, result.perspective = width, height, not camera.parallel
    result.origin, result.corner = wp.vec3d(*position), wp.vec3d(*corner)
    result.right, result.down, result.forward = wp.vec3d(*right), wp.vec3d(*down), wp.vec3d(*forward)
    result.to_index, result.unit = wp.mat33d(*to_index[:3, :3].ravel()), volume.smallest_spacing
    result.low, result.high = wp.vec3d(*low), wp.vec3d(*high)
    return result


def _tracer(
    variant: Variant, scene: Any, count: NDArray[np.int32], device: wp.Device
) -> Callable[[int, int], NDArray[np.void]]:
    """Steps of the ray of a pixel, by rendering it once more; a ray has no more steps than samples."""
    variant = replace(variant, traced=True)

    def trace(x: int, y: int) -> NDArray[np.void]:
        traced = make_scene(variant)()
        for name in ("view", "steps", "field", "transfer", "empty", "table", "distance", "shading", "lights"):
            setattr(traced, name, getattr(scene, name))
        traced.trace = wp.zeros(int(count[y, x]), dtype=Step, device=device)
        rgba = wp.empty(count.shape, dtype=vec4_of(REALS[variant.precision]), device=device)
        samples = wp.empty(count.shape, dtype=int, device=device)
        launch(make_raycast(variant), 1, [traced, rgba, samples], device, first=item(count.shape[1], x, y))
        steps = traced.trace.numpy()
        return steps[steps["length"] > 0]

    return trace


def _table_shape(volume: Volume, table_size: int | None) -> tuple[int, tuple[float, float]]:
    """Entries and domain of a table: the volume's range, so that no segment reaches outside."""
    lo, hi = volume.range
    if lo == hi:
        lo, hi = lo - 0.5, hi + 0.5
    levels = int(hi - lo) + 1
    if table_size is not None:
        return int(table_size), (lo, hi)
    if volume.dtype.kind in "iu" and levels <= 512:
        # Entries at the grey levels, and halfway: kinks of a table transfer function then lie on entries.
        return (2 * levels - 1 if levels <= 256 else levels), (lo, hi)
    return 512, (lo, hi)


def _check_memory(volume: Volume, width: int, height: int, device: wp.Device) -> None:
    needed = volume.numpy().nbytes * (not device.is_cpu) + width * height * 64
    free = device.free_memory if device.is_cuda else _free_host_memory()
    if needed > free:
        raise MemoryError(
            f"volume and image need {needed / 2**30:.1f} GiB on {device.alias}, which has {free / 2**30:.1f} GiB free; "
            f"take a smaller size than {width} x {height}, or a smaller volume"
        )


def _free_host_memory() -> float:
    try:
        import os

        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return float("inf")
