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

from .budget import Budget, blur, brightest, budget
from .camera import Camera, image_size
from .clipping import Clip, ClipVolume, clip_list
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
from .kernels.clip import Clip as ClipShape
from .kernels.clip import make_clipping
from .kernels.field import make_field
from .kernels.importance import BLOCK, blocks, make_bends, make_distances, make_empty, make_ranges
from .kernels.label import make_label_blocks, make_label_kinds
from .kernels.precision import REALS, vec4_of
from .kernels.ray import TILE, View, item, tiles
from .kernels.raycast import make_raycast
from .kernels.scene import Light, Shading, Step, Steps, Variant, make_scene
from .kernels.slices import make_finish
from .kernels.table import make_table
from .kernels.transfer import make_transfer
from .launch import get_device, launch
from .lighting import Lighting
from .lights import Headlight
from .segmentation import Segmentation
from .shadows import ConvolutionShadows
from .simplify import Simplified, simplify
from .sweep import AHEAD, sweep_lights
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
UNIFORM = (Riemann, Simpson, Preintegrated)
INTEGRATORS = (*UNIFORM, AdaptivePreintegrated, AdaptiveSimpson, Exact, Certified)


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
    clip, segmentation
        See :func:`render`.

    Attributes
    ----------
    builds
        How often each part was built. Of the volume: ``"volume"`` (brought to the device), ``"ranges"``, ``"extents"``
        (of blocks and small blocks of cells). Of the transfer function: ``"transfer"``, ``"table"``, ``"simplified"``.
        Of both: ``"empty"``, ``"kinds"`` (which blocks and cells there is something to see in). Of clip volumes:
        ``"clips"``; of labels: ``"labels"`` (brought to the device), ``"blocks"`` (what blocks of them hold).
    """

    def __init__(
        self,
        volume: Volume,
        transfer_function: TransferFunction | None,
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
        clip: Clip | Sequence[Clip] | None = None,
        segmentation: Segmentation | None = None,
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
        self.clip = clip
        self.segmentation = segmentation
        self.builds: Counter[str] = Counter()
        self._kept: dict[str, dict[tuple, Any]] = {}
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
        shown = self._shown()
        # Of the image; what is exact or certified is computed in float64.
        precision = "float64" if rule in ("exact", "certified") else shown
        if rule == "exact":
            shown = precision
        if self.shadows is not None and self.shadows.image == "slices":
            return self._render_slices(self.shadows, camera, width, height, shown, device)
        real = REALS[precision]
        clips, labels = clip_list(self.clip), self.segmentation
        variant = self._variant(precision, rule)
        _check_memory(self.volume, clips, labels, self.shadows, width, height, device)

        scene = make_scene(variant)()
        shift = self._shift(precision)
        scene.view = view(self.volume, camera, width, height)
        scene.steps = self._steps()
        scene.field = self._field(variant, shift, device)
        if isinstance(self.integrator, Certified):
            shares = budget(self.integrator.tolerance, shown, self._functions, self.volume)
            transfers = self._simplified(shares, scene.steps, shift, device)
        else:
            transfers = self._transfers(precision, shift, device)
        scene.transfer = transfers[0]
        tables = []
        if isinstance(self.integrator, Preintegrated | AdaptivePreintegrated):
            tables = self._tables("table", *self._table_kind(), precision, shift, device)
            scene.table = tables[0]
        if clips:
            scene.clipping = self._clipping(clips, variant, device)
        if labels is not None:
            self._label(scene, variant, shift, transfers, tables, device)
        if isinstance(self.integrator, AdaptivePreintegrated):
            scene.distance = self._distance(variant, shift, transfers, scene, device)
        if self.lighting is not None:
            scene.shading, scene.lights = self._shading(self.lighting, device)
        bound, skipped = None, 0.0
        if rule == "certified":
            scene.kinds, scene.masks, skipped, low, high = self._kinds(variant, shift, scene, device)
            # Rays begin and end with what there is to see.
            scene.view.low, scene.view.high = wp.vec3d(*low), wp.vec3d(*high)
            bound = scene.bound = wp.zeros((height, width), dtype=wp.float32, device=device)
        elif labels is None and (rule == "exact" or self.skip_empty):
            scene.empty = self._empty(variant, shift, scene.transfer, device)
        if rule != "certified" and self.skip_empty:
            skipped = float(scene.empty.numpy().mean())
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
            "skipped": skipped,
            "bytes": self.volume.numpy().nbytes + rgba.capacity + samples.capacity,
            "device": device.name,
            "precision": shown,
            "integrator": repr(self.integrator),
        }
        if self.shadows is not None:
            stats |= self._shade(self.shadows, camera, rgba, precision, shown, device)[0]
            stats["seconds"] += stats["seconds_shadows"]
            stats["bytes"] += AHEAD
        tracer = None
        if isinstance(self.integrator, AdaptiveSimpson):
            whole = "a ray" if self.integrator.scope == "ray" else f"a step of {self.integrator.h0:g} voxel spacings"
            stats["tolerance_covers"] = (
                f"the error estimates of {whole}, shared out by length; not forced steps, nor what lies between samples"
            )
        if isinstance(self.integrator, AdaptivePreintegrated):
            stats["tolerance_covers"] = "what a linear scalar costs a step; not forced steps, nor their sum along a ray"
        if isinstance(self.integrator, AdaptiveSimpson | AdaptivePreintegrated):
            tracer = _tracer(variant, scene, count, device, dict(self._kept))
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

    def _variant(self, precision: str, rule: str) -> Variant:
        """What the scene has."""
        clips, labels = clip_list(self.clip), self.segmentation
        fields = {np.dtype(clip.volume.dtype) for clip in clips if isinstance(clip, ClipVolume)}
        variant = Variant(
            wp.dtype_from_numpy(self.volume.dtype),
            precision,
            rule,
            not self.volume.has_nonfinite,
            self.skip_empty,
            # Clip volumes of different dtypes are read as float64.
            clips=wp.dtype_from_numpy(fields.pop() if len(fields) == 1 else np.float64 if fields else np.uint8)
            if clips
            else None,
            clipped=any(not clip.naive and getattr(clip, "parts", None) is None for clip in clips),
            naive=any(clip.naive for clip in clips),
            parts=next((clip.parts for clip in clips if isinstance(clip, ClipVolume) and clip.parts), None),
            labels=None if labels is None else wp.dtype_from_numpy(labels.states[1].dtype),
        )
        if self.lighting is not None:
            mode = self.lighting.mode if rule == "preintegrated" else "point"
            variant = replace(variant, lit=mode, gradient=self.lighting.gradient, material=self._material)
        return variant

    def _render_slices(
        self, shadows: ConvolutionShadows, camera: Camera, width: int, height: int, precision: str, device: wp.Device
    ) -> Image:
        """A frame composed of the slices of the shadows."""
        _check_memory(self.volume, clip_list(self.clip), self.segmentation, shadows, width, height, device)
        rgba = wp.empty((height, width), dtype=vec4_of(REALS[precision]), device=device)
        stats, samples = self._shade(shadows, camera, rgba, precision, precision, device)
        stats |= {
            "seconds": stats["seconds_shadows"],
            "rays": width * height,
            "samples": int(samples.sum(dtype=np.int64)),
            "bytes": self.volume.numpy().nbytes + rgba.capacity + samples.nbytes + AHEAD,
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
        """Puts an image of a ``precision`` into shadow, or makes it, by sweeps in the precision ``swept``.

        Returns
        -------
        Statistics, and samples of the sweeps.
        """
        start = perf_counter()
        height, width = rgba.shape
        variant = self._variant(swept, "preintegrated" if shadows.preintegrated else "midpoint")
        # Samples of slices are points: clips leave them or not, and light is that of points.
        clips = clip_list(self.clip)
        variant = replace(variant, clipped=False, naive=bool(clips), parts=None, lit="point" if variant.lit else "")
        shift = self._shift(swept)
        scene = make_scene(variant)()
        scene.view = view(self.volume, camera, width, height)
        scene.steps = self._steps()
        scene.field = self._field(variant, shift, device)
        transfers = self._transfers(swept, shift, device)
        scene.transfer = transfers[0]
        tables = []
        if shadows.preintegrated:
            length = shadows.slice_distance / (shadows.subsamples + 1)
            tables = self._tables("slab table", length, "stretchable", swept, shift, device)
            scene.table = tables[0]
        if clips:
            scene.clipping = self._clipping(clips, variant, device, naive=True)
        if self.segmentation is not None:
            self._label(scene, variant, shift, transfers, tables, device)
        if self.lighting is not None:
            scene.shading, scene.lights = self._shading(self.lighting, device)
        if self.skip_empty:
            if self.segmentation is None:
                scene.empty = self._empty(variant, shift, scene.transfer, device)
            low, high = self._seen_box(scene.empty.numpy() == 0, int(BLOCK))
            scene.view.low, scene.view.high = wp.vec3d(*low), wp.vec3d(*high)
        choose, finish = make_finish(precision)
        share = shadows.image == "rays"
        shown = wp.ones((height, width), dtype=wp.uint8, device=device)
        if share:
            launch(choose, width * height, [rgba, shown], device)
        light, slices, samples, count = sweep_lights(
            self.volume, camera, shadows, variant, scene, shown, self._buffer, device
        )
        launch(finish, width * height, [light, slices, share, rgba], device)
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
            ("segmentation", self.segmentation, Segmentation),
        ):
            if value is None and name == ("segmentation" if self.segmentation is None else "transfer_function"):
                continue
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
        if self.segmentation is not None and self.segmentation.labels.shape != self.volume.shape:
            raise ValueError(
                f"segmentation must have labels of the volume's shape {self.volume.shape}, "
                f"got {self.segmentation.labels.shape}"
            )
        self._check_clips()
        choice(self.precision, "precision", ("auto", *REALS))
        if not isinstance(self.skip_empty, bool | np.bool_):
            raise TypeError(f"skip_empty must be True or False, got {self.skip_empty!r}")
        if self.termination is not None and not 0 <= self.termination < 1:
            raise ValueError(f"termination must be in [0, 1), got {self.termination!r}")
        if self.background is not None:
            linear_rgb(self.background, "background")

    def _check_clips(self) -> None:
        clips = clip_list(self.clip)
        parts = {clip.parts for clip in clips if isinstance(clip, ClipVolume) and clip.parts is not None}
        for what, used, accepted in (
            ("naive", any(clip.naive for clip in clips), UNIFORM),
            ("parts", bool(parts), (Preintegrated,)),
        ):
            if used and not isinstance(self.integrator, accepted):
                names = ", ".join(kind.__name__ for kind in accepted)
                raise ValueError(f"clip with {what} needs one of {names} as integrator, got {self.integrator!r}")
        if parts and self.lighting is not None:
            raise ValueError("clip with parts is for segments without light, got a lighting")
        if len(parts) > 1:
            raise ValueError(f"clip volumes must have the same parts, got {', '.join(map(repr, sorted(parts)))}")

    @property
    def _functions(self) -> list[TransferFunction]:
        """All transfer functions of the scene."""
        return [self.transfer_function] if self.segmentation is None else self.segmentation.states[0]  # type: ignore[list-item]

    def _shown(self) -> str:
        """Precision of the image: what is asked for, or float32 if that is good enough."""
        if self.precision != "auto":
            return self.precision
        if isinstance(self.integrator, Certified):
            # A tolerance of which rounding to float32 would take more than an eighth.
            small = self.integrator.tolerance < 4 * np.finfo("float32").eps * brightest(self._functions)
            return "float64" if small else "float32"
        return "float32"

    def _shift(self, precision: str) -> float:
        """The constant that floating-point samples are reduced by: the middle of the transfer function's knots, or 0 if
        that keeps more of them apart.
        """
        if self.volume.dtype.kind != "f":
            return 0.0
        knots = np.unique(np.concatenate([tf.knots for tf in self._functions]))
        # Rounded, so that it is the same number in every precision.
        middle = float(np.float32(0.5 * knots[0] + 0.5 * knots[-1]))
        return max(middle, 0.0, key=lambda shift: len(np.unique((knots - shift).astype(precision))))

    def _steps(self) -> Any:
        steps = Steps()
        default = getattr(self.integrator, "termination", TERMINATION)
        steps.opaque = 1.0 - (default if self.termination is None else self.termination)
        for name, value in self.integrator.steps.items():
            setattr(steps, name, value)
        return steps

    @property
    def _material(self) -> bool:
        """Whether coefficients of light vary with the scalar, and there is light."""
        given = (f for tf in self._functions for f in (tf.ambient, tf.diffuse, tf.specular))
        return self.lighting is not None and any(f is not None for f in given)

    def _shading(self, lighting: Lighting, device: wp.Device) -> tuple[Any, wp.array]:
        """The structs of ``kernels.shading``."""
        knots = np.concatenate([tf.knots for tf in self._functions])
        matrix = self.volume.index_to_world[:3, :3]
        # The gradient is a number: a change over a voxel, in parts of the transfer functions' range.
        scale = self.volume.smallest_spacing / (float(np.ptp(knots)) or 1.0)
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

    def _keep(self, part: str, key: tuple, build: Callable[[], Any]) -> Any:
        """``build()``, or what it made last for the same ``key``."""
        return self._keep_all(part, {key: build})[0]

    def _keep_all(self, part: str, builds: dict[tuple, Callable[[], Any]]) -> list[Any]:
        """Likewise several, by key."""
        before = self._kept.get(part, {})
        self.builds[part] += len(builds.keys() - before.keys())
        self._kept[part] = {key: before[key] if key in before else build() for key, build in builds.items()}
        return list(self._kept[part].values())

    def _field(self, variant: Variant, shift: float, device: wp.Device) -> Any:
        data = self._keep("volume", (self.volume, device.alias), lambda: self.volume.on(device))
        Field, _ = make_field(variant.dtype, REALS[variant.precision])
        field = Field()
        field.data = data
        field.last = wp.vec3i(*(n - 2 for n in reversed(data.shape)))
        field.shift = shift
        return field

    def _transfers(self, precision: str, shift: float, device: wp.Device) -> list[Any]:
        unit, material = self.volume.smallest_spacing, self._material

        def build(tf: TransferFunction) -> Callable[[], Any]:
            factors = transfer_factors(tf) if material else None
            return lambda: transfer_arrays(tf.knots, transfer_values(tf, unit), shift, precision, device, factors)

        return self._keep_all(
            "transfer", {(tf.key, unit, shift, precision, device.alias, material): build(tf) for tf in self._functions}
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
        key = (self._functions[0].key, self.volume, shift, variant.precision, device.alias)
        return self._keep("empty", key, build_flags)

    def _simplified(self, shares: Budget, steps: Any, shift: float, device: wp.Device) -> list[Any]:
        """Transfer functions with fewer control points; and how the tolerance is spent, into ``steps``."""
        unit, material = self.volume.smallest_spacing, self._material

        def build(tf: TransferFunction) -> Callable[[], tuple[Simplified, Any]]:
            def work() -> tuple[Simplified, Any]:
                values, factors = transfer_values(tf, unit), None
                if material:
                    # Coefficients of light belong to the control points there are.
                    points, factors = Simplified(tf.knots, values, 0.0, 0.0, 0.0), transfer_factors(tf)
                else:
                    points = simplify(tf.knots, values, shares.color, shares.relative, shares.absolute)
                return points, transfer_arrays(points.knots, points.values, shift, "float64", device, factors)

            return work

        rest = (unit, shares, shift, device.alias, material)
        built = self._keep_all("simplified", {(tf.key, *rest): build(tf) for tf in self._functions})
        if self.termination is None:
            steps.opaque = 1.0 - shares.behind
        steps.tolerance = shares.piece
        steps.brightest = shares.brightest
        steps.tinted = max(points.color + shares.brightest * points.relative for points, _ in built)
        absolute = max(points.absolute for points, _ in built)
        steps.veiled = shares.rounding + shares.brightest * absolute * shares.longest
        steps.blur = blur(*self.volume.range, shift, int(self.volume.dimensions.max()))
        return [transfer for _, transfer in built]

    def _kinds(
        self, variant: Variant, shift: float, scene: Any, device: wp.Device
    ) -> tuple[wp.array, wp.array, float, NDArray[np.float64], NDArray[np.float64]]:
        """Kinds of the small blocks of cells, which of their cells there may be something to see in, the share of
        blocks with nothing, and the box of the others in index coordinates.
        """
        data = self.volume.on(device)
        shape = small.blocks(data.shape)
        if not self.skip_empty:
            kinds, masks = (wp.empty(shape, dtype=dtype, device=device) for dtype in (wp.int16, wp.uint64))
            kinds.fill_(int(small.SEVERAL))
            masks.fill_(2**64 - 1)
            return kinds, masks, 0.0, *self.volume.index_box

        def build_extents() -> wp.array:
            result = self._buffer("extents", shape, wp.types.vector(2, variant.dtype), device)
            launch(small.make_ranges(variant.dtype), result.size, [data, result], device)
            return result

        def build() -> tuple[wp.array, wp.array, float, NDArray[np.float64], NDArray[np.float64]]:
            masks = self._buffer("masks", shape, wp.uint64, device)
            before, after = (self._buffer(name, shape, wp.int16, device) for name in ("kinds", "kinds before"))
            if variant.labels is None:
                inputs = [extents, wp.float64(shift), scene.transfer, before]
                launch(small.make_kinds(variant.dtype), masks.size, inputs, device)
            else:
                labels = scene.labels
                inputs = [data, labels.states, extents, wp.float64(shift), labels.transfers, before, masks]
                launch(make_label_kinds(variant.dtype, variant.labels), masks.size, inputs, device)
            for axis in range(3):
                launch(small.spread, masks.size, [axis, before, after], device)
                before, after = after, before
            if variant.labels is None:
                inputs = [data, extents, wp.float64(shift), scene.transfer, before, masks]
                launch(small.make_masks(variant.dtype), masks.size, inputs, device)
            seen = before.numpy() > int(small.EMPTY)
            return before, masks, 1.0 - float(seen.mean()), *self._seen_box(seen, 1 << int(small.BITS))

        extents = self._keep("extents", (self.volume, device.alias), build_extents)
        key = (*self._kept["simplified"], self.volume, self.segmentation)
        return self._keep("kinds", key, build)

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
        """An array that is made once: volumes, or frames, of one shape that follow each other write into the same."""
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

    def _clipping(self, clips: list[Clip], variant: Variant, device: wp.Device, naive: bool = False) -> Any:
        """The struct of all clips, ``naive`` or as they are; of clip volumes, samples and blocks' ranges are kept."""
        ClipStruct, Clipping = make_clipping(variant.clips)
        dtype = np.dtype(wp.dtype_to_numpy(variant.clips))

        def build(volume: Volume) -> Callable[[], tuple[wp.array, wp.array]]:
            def work() -> tuple[wp.array, wp.array]:
                same = volume if volume.dtype == dtype else Volume(volume.numpy().astype(dtype))
                data = same.on(device)
                ranges = wp.empty(blocks(data.shape), dtype=wp.vec2d, device=device)
                launch(make_ranges(variant.clips), ranges.size, [data, ranges], device)
                return data, ranges

            return work

        def placed(struct: Any, clip: Clip, world_to: NDArray[np.floating]) -> Any:
            to_world = self.volume.index_to_world
            struct.invert = clip.invert
            struct.matrix = wp.mat33d(*(world_to[:3, :3] @ to_world[:3, :3]).ravel())
            struct.offset = wp.vec3d(*(world_to[:3, :3] @ to_world[:3, 3] + world_to[:3, 3]))
            return struct

        fields = {
            (clip.volume, dtype, device.alias): build(clip.volume) for clip in clips if isinstance(clip, ClipVolume)
        }
        kept = dict(zip(fields, self._keep_all("clips", fields), strict=True)) if fields else {}
        groups: dict[str, list[Any]] = {}
        for clip in clips:
            if isinstance(clip, ClipVolume):
                struct = placed(ClipStruct(), clip, np.linalg.inv(clip.volume.index_to_world))
                data, struct.ranges = kept[clip.volume, dtype, device.alias]
                struct.field.data = data
                struct.field.last = wp.vec3i(*(n - 2 for n in reversed(data.shape)))
                struct.iso = float(clip.iso)
                struct.low, struct.high = (wp.vec3d(*corner) for corner in clip.volume.index_box)
                name = "naive_volumes" if clip.naive or naive else "partial_volumes" if clip.parts else "volumes"
            else:
                struct = placed(ClipShape(), clip, clip.world_to_shape)
                struct.kind = clip.kind
                name = "naive_shapes" if clip.naive or naive else "shapes"
            groups.setdefault(name, []).append(struct)
        clipping = Clipping()
        for name, structs in groups.items():
            kind = ClipShape if name.endswith("shapes") else ClipStruct
            setattr(clipping, name, wp.array(structs, dtype=kind, device=device))
        return clipping

    def _label(
        self, scene: Any, variant: Variant, shift: float, transfers: list[Any], tables: list[Any], device: wp.Device
    ) -> None:
        """Into the scene: states, what blocks of them hold, and the states' transfer functions and tables."""
        assert self.segmentation is not None
        segmentation, labels = self.segmentation, scene.labels
        states = segmentation.states[1]

        def build_states() -> wp.array:
            return Volume(states[segmentation.labels.numpy()]).on(device)

        def build_blocks() -> tuple[wp.array, wp.array]:
            held = wp.empty(ranges.shape, dtype=int, device=device)
            empty = wp.empty(ranges.shape, dtype=wp.uint8, device=device)
            inputs = [labels.states, labels.transfers, ranges, wp.float64(shift), self.skip_empty, held, empty]
            launch(make_label_blocks(variant.labels, real), held.size, inputs, device)
            return held, empty

        real = REALS[variant.precision]
        ranges = self._ranges(variant, device)
        labels.states = self._keep("labels", (segmentation, device.alias), build_states)
        labels.transfers = wp.array(transfers, dtype=make_transfer(real)[0], device=device)
        if tables:
            labels.tables = wp.array(tables, dtype=make_table(real)[0], device=device)
        part = "simplified" if isinstance(self.integrator, Certified) else "transfer"
        key = (segmentation, self.volume, self.skip_empty, *self._kept[part])
        labels.blocks, scene.empty = self._keep("blocks", key, build_blocks)

    def _distance(
        self, variant: Variant, shift: float, transfers: list[Any], scene: Any, device: wp.Device
    ) -> wp.array:
        """How long a step may be in each block of cells, by the integrator's tolerance."""
        data, unit = self.volume.on(device), self.volume.smallest_spacing

        def build_bends() -> wp.array:
            result = wp.empty(blocks(data.shape), dtype=wp.vec2d, device=device)
            scale = wp.vec3d(*(unit / np.array(self.volume.spacing)))
            launch(make_bends(variant.dtype), result.size, [data, scale, result], device)
            return result

        def distances(tf: TransferFunction, transfer: Any) -> wp.array:
            result = wp.empty(ranges.shape, dtype=wp.float32, device=device)
            maxima = range_maxima(tf, unit, device)
            inputs = [ranges, bends, wp.float64(shift), transfer, maxima, wp.float64(tolerance), result]
            launch(make_distances(REALS[variant.precision]), result.size, inputs, device)
            return result

        def build() -> wp.array:
            each = [distances(tf, transfer) for tf, transfer in zip(functions, transfers, strict=True)]
            if variant.labels is None:
                return each[0]
            # By its own transfer function in a block of one, else the shortest of all.
            held = scene.labels.blocks.numpy()
            result = np.min([one.numpy() for one in each], axis=0)
            for state, one in enumerate(each):
                result = np.where(held == state, one.numpy(), result)
            return wp.array(result, dtype=wp.float32, device=device)

        functions = self._functions
        tolerance = self.integrator.steps["tolerance"]
        ranges = self._ranges(variant, device)
        bends = self._keep("bends", (self.volume, device.alias), build_bends)
        key = (*self._kept["transfer"], self.volume, tolerance, self.segmentation)
        return self._keep("distances", key, build)

    def _table_kind(self) -> tuple[float, str]:
        """Length of the segments of the integrator's table, and what makes it."""
        if isinstance(self.integrator, Preintegrated):
            return self.integrator.steps["step"], self.integrator.generator
        return self.integrator.steps["shortest"], "stretchable"

    def _tables(
        self, part: str, length: float, generator: str, precision: str, shift: float, device: wp.Device
    ) -> list[Any]:
        unit = self.volume.smallest_spacing
        n, domain = _table_shape(self.volume, getattr(self.integrator, "table_size", None) if part == "table" else None)
        lit = self.lighting is not None and generator != "stretchable"
        make = lit_tables if lit else table_array

        def build(tf: TransferFunction) -> Callable[[], tuple[wp.array, ...]]:
            return lambda: make(tf, n, length, unit, domain, generator, precision, device)

        rest = (unit, length, n, domain, generator, precision, device.alias, lit)
        built = self._keep_all(part, {(tf.key, *rest): build(tf) for tf in self._functions})
        return [table_struct(tables, domain, shift, precision) for tables in built]


def render(
    volume: Volume,
    transfer_function: TransferFunction | None,
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
    clip: Clip | Sequence[Clip] | None = None,
    segmentation: Segmentation | None = None,
) -> Image:
    """Render a volume.

    Parameters
    ----------
    volume
        The field.
    transfer_function
        Colour and extinction of a scalar; not used, and may be None, with a segmentation.
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
    clip
        What is cut away: a ``ClipPlane``, ``ClipBox``, ``ClipSphere`` or ``ClipVolume``, or a list of them, of which
        what all leave is left. Rays are cut exactly, with every integrator; bounds on errors hold. See
        :mod:`wvr.clipping`.
    segmentation
        Labels of the samples and a transfer function for each, with boundaries cut as exactly; see
        :class:`Segmentation`.

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
        clip=clip,
        segmentation=segmentation,
    )
    return renderer.render(camera, size)


def view(volume: Volume, camera: Camera, width: int, height: int) -> Any:
    """The struct of ``kernels.ray`` for a camera and image size, set up in float64."""
    to_index = np.linalg.inv(volume.index_to_world[:3, :3])
    right, up, forward = camera.basis()
    half = np.tan(np.radians(camera.view_angle) / 2) if camera.parallel_scale is None else camera.parallel_scale
    pixel = 2 * half / height
    right, down = pixel * right, -pixel * up
    corner = -0.5 * (width - 1) * right - 0.5 * (height - 1) * down
    # The view's axis next to the volume's middle, counted from the nearer of the two points that define it: no
    # difference of large numbers is taken that is not that of numbers given.
    middle = volume.corners.mean(axis=0)
    near = min(camera.position, camera.target, key=lambda point: float(np.abs(point - middle).max()))
    along = float((middle - near) @ forward)
    depth = along + (near is camera.target) * float(np.linalg.norm(camera.target - camera.position))
    if not camera.parallel and depth <= 0:
        near, along, depth = camera.position, 0.0, 0.0
    axis = (near - volume.origin) + along * forward
    spread = 1.0 if camera.parallel else depth
    turns = not camera.parallel
    low, high = volume.index_box
    result = View()
    result.width, result.height, result.perspective, result.depth = width, height, turns, depth
    result.anchor = wp.vec3d(*(to_index @ (axis + spread * corner)))
    result.right, result.down = (wp.vec3d(*(to_index @ (spread * step))) for step in (right, down))
    result.way = wp.vec3d(*(forward + turns * corner))
    result.way_right, result.way_down = (wp.vec3d(*(turns * step)) for step in (right, down))
    result.to_index, result.unit = wp.mat33d(*to_index.ravel()), volume.smallest_spacing
    result.low, result.high = wp.vec3d(*low), wp.vec3d(*high)
    return result


def _tracer(
    variant: Variant, scene: Any, count: NDArray[np.int32], device: wp.Device, kept: dict[str, Any]
) -> Callable[[int, int], NDArray[np.void]]:
    """Steps of the ray of a pixel, by rendering it once more; a ray has no more steps than samples.

    ``kept`` are the arrays that structs in the scene's arrays point to.
    """
    variant = replace(variant, traced=True)

    def trace(x: int, y: int) -> NDArray[np.void]:
        assert kept  # alive as long as the tracer
        traced = make_scene(variant)()
        names = "view steps field transfer empty table distance shading lights clipping labels"
        for name in names.split():
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


def _check_memory(
    volume: Volume,
    clips: list[Clip],
    labels: Segmentation | None,
    shadows: ConvolutionShadows | None,
    width: int,
    height: int,
    device: wp.Device,
) -> None:
    volumes = {volume, *(clip.volume for clip in clips if isinstance(clip, ClipVolume))}
    needed = sum(one.numpy().nbytes for one in volumes) * (not device.is_cpu) + width * height * 64
    if labels is not None:
        needed += labels.labels.numpy().nbytes
    if shadows is not None:
        needed += AHEAD + width * height * 64
    free = device.free_memory if device.is_cuda else _free_host_memory()
    if needed > free:
        raise MemoryError(
            f"data and image need {needed / 2**30:.1f} GiB on {device.alias}, which has {free / 2**30:.1f} GiB free: "
            f"take a smaller size than {width} x {height}, or a smaller volume"
        )


def _free_host_memory() -> float:
    try:
        import os

        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return float("inf")
