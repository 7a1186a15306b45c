"""One image: asks the pieces of a scene for parts and device halves, launches, and lets them report."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .cached import cached_property
from .camera import Camera
from .clock import Clock
from .cuts.labels import label_struct
from .cuts.volumes import clip_dtype, clip_kinds, clipping_struct
from .display import Shown
from .faces import proven
from .field.base import Field
from .field.blocks import Seen
from .image import BoundedImage, Image
from .keep import Keeper
from .kernels.cuts.stretches import Cuts
from .kernels.integrators.steps import Step
from .kernels.precision import REALS, vec4_of
from .kernels.ray import View, item
from .kernels.raycast import make_raycast
from .kernels.scene import Halves
from .launch import in_turn, launch, launch_pixels
from .light.sweep import AHEAD, Sweeping, shade
from .memory import check_room
from .probe import Prober, make_prober, probe, tightest
from .resident import Rays, Resident, fetched, settled, stays
from .scene import Scene
from .transfer.function import struct_of
from .validation import computed, float_array, outside

# How far a ray may be from where it should be, in parts of the numbers that it is made of (docs/proof.md, lemma 3).
ASTRAY = 2.0**-49
# How far the plane of their anchors may be, in the same parts: of a sum of three products and two more numbers.
ROUNDED = 2.0**-49
# Parts of a direction that are no move along an axis: one over a ray's has to be a number.
STILL = 1e-100
# Bytes of a pixel, and of one that is probed, while there is an image of them.
PIXEL, PROBED = 64, 96

# Of a pixel, and of the samples of its ray.
Tracer = Callable[[int, int, int], NDArray[np.void]]


class Frame:
    """A scene seen by a camera in so many pixels, along rays that end where ``ends`` says.

    Attributes
    ----------
    error_bound
        Of the image, once it is there, on its device if it stays there; None where the integrator gives none.
    rays
        What is known of them then.
    """

    rays: Rays
    #: Whether something was left out that would be seen.
    partly = False

    def __init__(
        self, scene: Scene, camera: Camera, size: tuple[int, int], keep: Keeper, ends: NDArray[np.float64] | None = None
    ):
        self.given = scene
        self.scene = scene.normal
        self.camera = camera
        self.width, self.height = size
        self.keep = keep
        self.ends = ends
        self.device = keep.device
        self.error_bound: NDArray[np.float32] | wp.array | None = None

    def render(self) -> Image:
        """The image."""
        clock = Clock(self.device)
        scene, integrator = self.scene, self.scene.integrator
        self.check_memory()
        if integrator.probes:
            return self._probed(clock)
        shown = integrator.shown(scene)
        stats: dict[str, Any]
        if scene.shadows is not None and scene.shadows.alone:
            rgba = wp.empty((self.height, self.width), dtype=vec4_of(REALS[shown]), device=self.device)
            shaded = shade(self, rgba, shown)
            pixels, counts, _ = self._settled(rgba, shown, shaded.samples, None)
            clock.mark()
            (seconds,) = clock.seconds()
            stats = shaded.said(self.rays.samples, seconds) | {"seconds": seconds, "integrator": repr(scene.shadows)}
            stats["bytes"] = scene.volume.nbytes + rgba.capacity + shaded.samples.capacity + AHEAD
            return self._image(pixels, counts, stats)
        precision = integrator.precision(scene)
        halves = self.halves(REALS[precision], integrator.half(scene))
        struct, seen = self.struct(halves)
        size = (self.height, self.width)
        vec4 = vec4_of(halves.real)
        if vec4 is vec4_of(REALS[shown]):
            rgba = wp.empty(size, dtype=vec4, device=self.device)
        else:
            rgba = self.keep.scratch("rgba", size, vec4)
        samples = wp.empty(size, dtype=wp.int32, device=self.device)
        bounds = wp.empty(size if halves.march.bounded else (1, 1), dtype=wp.float32, device=self.device)
        clock.mark()
        turns = in_turn(("rays", "light")[: 1 if scene.shadows is None else 2])
        next(turns)
        self.launch(halves, struct, rgba, samples, bounds)
        next(turns, None)
        clock.mark()
        more = []
        if scene.shadows is not None:
            shaded = shade(self, rgba, shown)
            more.append(shaded.samples)
            clock.mark()
        pixels, counts, found = self._settled(rgba, shown, samples, bounds if halves.march.bounded else None, *more)
        stages = clock.seconds()
        stats = {
            "seconds": sum(stages),
            "seconds_prepare": stages[0],
            "seconds_raycast": stages[1],
            "skipped": seen.skipped,
            "bytes": scene.volume.nbytes + rgba.capacity + samples.capacity,
            "integrator": repr(integrator),
        }
        if scene.shadows is not None:
            stats |= shaded.said(int(found[0].sum(dtype=np.int64)), stages[2])
            stats["bytes"] += AHEAD
        tracer = self._tracer() if integrator.traces else None
        return self._image(pixels, counts, stats | integrator.report(self), tracer)

    def _probed(self, clock: Clock) -> Image:
        """The image of an integrator that probes."""
        scene, integrator = self.scene, self.scene.integrator
        found = probe(self, clock)
        pixels, counts, (bounds, values) = self._settled(
            found.rgba, integrator.shown(scene), found.samples, None, found.bounds, found.values
        )
        prepared, cast = clock.seconds()
        stats = {
            "seconds": prepared + cast,
            "seconds_prepare": prepared,
            "seconds_raycast": cast,
            "skipped": found.skipped,
            "bytes": scene.volume.nbytes + found.rgba.capacity + found.samples.capacity + 3 * found.values.capacity,
            "integrator": repr(integrator),
        }
        self.error_bound = bounds if integrator.valued else tightest(bounds)
        image = self._image(pixels, counts, stats | integrator.report(self))
        image.values = values if integrator.valued else None
        return image

    def launch(self, halves: Halves, struct: Any, rgba: wp.array, samples: wp.array, bounds: wp.array) -> None:
        """Cast the rays of all pixels; a CPU is done then."""
        inputs = [struct, rgba, samples, bounds, 0]
        # Few rays are left to another.
        for part in in_turn(halves.launches, (9, 1)[: len(halves.launches)]):
            launch_pixels(make_raycast(part), inputs, self.device, struct.view, part.rays, part.scratch)

    def _settled(
        self, rgba: wp.array, shown: str, samples: wp.array, bounds: wp.array | None, *others: wp.array
    ) -> tuple[NDArray[np.floating] | Resident, NDArray[np.int32] | wp.array, list[NDArray]]:
        """Pixels as ``shown`` and the samples of rays, on their device where they stay there, as their bounds do; and
        others on the host: after one wait.
        """
        tolerance = getattr(self.scene.integrator, "tolerance", 0.0)
        if stays(self.device):
            self.error_bound = bounds
            pixels, self.rays, found = settled(
                self.keep, rgba, vec4_of(REALS[shown]), samples, bounds, tolerance, *others
            )
            return pixels, samples, found
        self.error_bound = None if bounds is None else bounds.numpy()
        counts, *found = fetched(self.keep, samples, *others)
        self.rays = Rays.of(counts, self.error_bound, tolerance)
        return rgba.numpy().astype(shown, copy=False), counts, found

    def _image(
        self,
        pixels: NDArray[np.floating] | Resident,
        samples: NDArray[np.int32] | wp.array,
        stats: dict[str, Any],
        tracer: Tracer | None = None,
    ) -> Image:
        # Without this frame, whose keeper has more than an image should hold.
        camera, size, ends = self.camera, (self.width, self.height), self.ends

        def again(scene: Scene, keep: Keeper, pixel: tuple[int, int] | None) -> list[NDArray]:
            found = probe(Frame(scene, camera, size, keep, ends), pixel=pixel)
            return fetched(keep, found.values, found.depths, found.rgba)

        return image_of(self, pixels, samples, stats, tracer, make_prober(self, again))

    def halves(self, real: type, march: Any) -> Halves:
        """What a kernel with a ``march`` in a precision is made of."""
        scene = self.scene
        clips, labels = scene.clips, scene.segmentation
        cuts = Cuts(
            clip_kinds(clips),
            wp.dtype_from_numpy(clip_dtype(clips)),
            clipped=any(not clip.naive and clip.parts is None for clip in clips),
            naive=any(clip.naive for clip in clips),
            parts=next((clip.parts for clip in clips if clip.parts is not None), None),
            labels=None if labels is None else wp.dtype_from_numpy(labels.states.of_label.dtype),
        )
        lighting = scene.lighting
        light = None if lighting is None else lighting.half(scene, scene.integrator.segments)
        return Halves(real, scene.volume.half, march, cuts, light, self.device.is_cpu)

    def struct(self, halves: Halves, sweep: Sweeping | None = None, rays: Any = None) -> tuple[Any, Seen]:
        """The scene's struct for a kernel of these halves, filled, and what there is to see; for the integrator, or a
        sweep of light; with those ``rays`` (a ``kernels.ray.View``), by default all of the frame.
        """
        scene, keep = self.scene, self.keep
        integrator: Any = scene.integrator if sweep is None else sweep
        struct = halves.Scene()
        struct.view = self._view if rays is None else rays
        if self.ends is not None:
            struct.view.ends = wp.array(self.ends, dtype=wp.float64, device=self.device)
        struct.field = scene.volume.struct(keep, scene.shift)
        if rays is None and not halves.field.finite:
            size = self.width, self.height
            struct.proven = wp.vec3i(*proven(scene.volume, self.camera, size, struct.view.astray))
        ending = integrator.termination(scene) if scene.termination is None else scene.termination
        struct.opaque = 1.0 - ending
        for name, value in integrator.numbers(scene, keep).items():
            setattr(struct.march, name, value)
        for name, part in integrator.parts(scene).items():
            setattr(struct.march, name, keep(part))
        transfers = [struct_of(keep(integrator.function(scene, tf))) for tf in scene.functions]
        tables = [keep(table) for tf in scene.functions if (table := integrator.table(scene, tf)) is not None]
        struct.transfer = transfers[0]
        if tables:
            struct.table = tables[0]
        seen = keep(scene.kinds(sweep is not None))
        struct.blocks = seen.struct
        low, high = (seen.low, seen.high) if integrator.anywhere else scene.volume.index_box
        struct.view.seen_low, struct.view.seen_high = wp.vec3d(*low), wp.vec3d(*high)
        if scene.segmentation is not None:
            struct.cuts.labels = label_struct(scene.segmentation, seen, transfers, tables, halves, keep)
        if scene.clips:
            astray = struct.view.astray
            struct.cuts.clipping = clipping_struct(scene.clips, scene.volume, keep, astray, naive=sweep is not None)
        if scene.lighting is not None:
            struct.light = scene.lighting.struct(scene, self.device)
        return struct, seen

    @cached_property
    def _view(self) -> Any:
        """All of its rays; where something is seen of each is set for every struct."""
        return view(self.scene.volume, self.camera, self.width, self.height)

    def _tracer(self) -> Tracer:
        """Steps of the ray of a pixel, by rendering it once more; a ray has no more steps than samples."""
        scene, camera, size, ends = self.scene, self.camera, (self.width, self.height), self.ends
        # Parts of its own: those of the renderer may be another scene's by then.
        keep = Keeper(self.device)
        volumes = self.given.volumes()
        versions = [volume.version for volume in volumes]

        def trace(x: int, y: int, samples: int) -> NDArray[np.void]:
            for volume in volumes:
                volume.look()
            if [volume.version for volume in volumes] != versions:
                raise ValueError("trace needs the samples that the image was made of, which somebody wrote into since")
            frame = Frame(scene, camera, size, keep, ends)
            halves = frame.halves(REALS[scene.integrator.precision(scene)], scene.integrator.half(scene))
            halves = replace(halves, traced=True)
            with keep.lock.held(), keep.frame():
                struct, _ = frame.struct(halves)
            steps = wp.zeros(samples, dtype=Step, device=keep.device)
            struct.trace.steps = steps
            rgba = wp.empty(size[::-1], dtype=vec4_of(halves.real), device=keep.device)
            counts = wp.empty(size[::-1], dtype=int, device=keep.device)
            bounds = wp.empty((1, 1), dtype=wp.float32, device=keep.device)
            first = item(size[0], x, y)
            launch(make_raycast(halves), 1, [struct, rgba, counts, bounds, 0], keep.device, first=first)
            taken = steps.numpy()
            return taken[taken["length"] > 0]

        return trace

    def check_memory(self) -> None:
        """Say so where there is too little of it, before any is taken."""
        scene, device, pixels = self.scene, self.device, self.width * self.height
        needed = sum(volume.missing_on(device) for volume in set(scene.volumes()))
        needed += pixels * (PROBED if scene.integrator.probes else PIXEL)
        if scene.shadows is not None:
            needed += AHEAD + pixels * PIXEL
        size = f"{self.width} x {self.height}"
        check_room(needed, device, "data and image", f"a smaller size than {size}, or a smaller volume")


def image_of(
    frame: Any,
    rgba: NDArray[np.floating] | Resident,
    samples: NDArray[np.int32] | wp.array,
    stats: dict[str, Any],
    tracer: Tracer | None = None,
    prober: Prober | None = None,
) -> Image:
    """The image that a frame came to, with what ``stats`` every image has."""
    given = frame.given
    stats |= {
        "rays": samples.size,
        "samples": frame.rays.samples,
        "device": frame.keep.device.name,
        "precision": frame.scene.integrator.shown(frame.scene),
    }
    limits, anatomical = given.volume.range, getattr(given.volume, "anatomical", "")
    scenery = Shown(frame.camera, given.volume.corners, limits, given.transfer_function, anatomical)
    kind = Image if frame.error_bound is None else BoundedImage
    return kind(rgba, samples, frame.error_bound, stats, given.background, tracer, scenery, prober=prober)


def ends_of(depth: Any, size: tuple[int, int]) -> NDArray[np.float64] | None:
    """Depths at which rays end, infinite where they do not, as a caller gives them."""
    if depth is None:
        return None
    width, height = size
    depth = computed(depth)
    gone = np.ma.getmaskarray(depth) if isinstance(depth, np.ma.MaskedArray) else False
    ends = np.where(gone, np.inf, float_array(np.ma.getdata(depth) if np.any(gone) else depth, "depth"))
    if ends.shape != (height, width):
        raise ValueError(
            f"depth must have the shape (height, width) = {(height, width)} of the image, got {ends.shape}"
        )
    finite = ends[np.isfinite(ends)]
    if finite.size and finite.max() < 0:
        warnings.warn(
            f"depth is behind the camera in all pixels, from {finite.min():g} to {finite.max():g}: of a plotter of "
            f"PyVista it is -plotter.get_image_depth()",
            stacklevel=outside(),
        )
    return np.where(np.isnan(ends), np.inf, np.maximum(ends, -1e100))


def view(volume: Field, camera: Camera, width: int, height: int) -> Any:
    """The struct of ``kernels.ray`` for a camera and image size, set up in float64."""
    to_index = np.linalg.inv(volume.index_to_world[:3, :3])
    to_index[np.abs(to_index) < STILL * np.abs(to_index).max(axis=1, keepdims=True)] = 0.0
    right, up, forward = (np.where(np.abs(axis) < STILL, 0.0, axis) for axis in camera.basis())
    pixel = 2 * camera.half_height / height
    right, down = pixel * right, -pixel * up
    corner = -0.5 * (width - 1) * right - 0.5 * (height - 1) * down
    # The view's axis next to the volume's middle, counted from the nearer of the two points that define it: no
    # difference of large numbers is taken that is not that of numbers given.
    middle = volume.corners.mean(axis=0)
    near = min(camera.position, camera.target, key=lambda point: float(np.abs(point - middle).max()))
    along = float((middle - near) @ forward)
    depth = along + (near is camera.target) * float(np.linalg.norm(camera.target - camera.position))
    # At the camera, where that is nearer than the edges of so wide a view are there.
    wide = depth * float(np.linalg.norm(corner)) >= float(np.linalg.norm(camera.position - middle))
    if not camera.parallel and (depth <= 0 or wide):
        near, along, depth = camera.position, 0.0, 0.0
    axis = (near - volume.index_to_world[:3, 3]) + along * forward
    spread = 1.0 if camera.parallel else depth
    turns = not camera.parallel
    low, high = volume.index_box
    result = View()
    result.width, result.height, result.perspective, result.depth = width, height, turns, depth
    result.rounded = ROUNDED * float(np.linalg.norm(middle - near) + np.linalg.norm(camera.target - camera.position))
    result.anchor = wp.vec3d(*(to_index @ (axis + spread * corner)))
    result.right, result.down = (wp.vec3d(*(to_index @ (spread * step))) for step in (right, down))
    result.way = wp.vec3d(*(forward + turns * corner))
    result.way_right, result.way_down = (wp.vec3d(*(turns * step)) for step in (right, down))
    result.to_index, result.unit = wp.mat33d(*to_index.ravel()), volume.smallest_spacing
    result.low, result.high = wp.vec3d(*low), wp.vec3d(*high)
    result.seen_low, result.seen_high = result.low, result.high
    # What it is made of, along each axis of the world: each is rounded a few times, and so is the inverse.
    extent = spread * (width * np.abs(right) + height * np.abs(down)) / 2
    reach = np.abs(volume.corners - near).max(axis=0) + np.abs(near - volume.index_to_world[:3, 3])
    sizes = reach + extent + abs(along) * np.abs(forward)
    # Directions are sums in which much cancels in the middle of a wide view; they turn rays about their anchors.
    edges = 0.0
    if turns:
        edges = (width * float(np.linalg.norm(right)) + height * float(np.linalg.norm(down))) / 2
        farthest = np.linalg.norm(volume.corners - near, axis=1).max() + abs(along) + np.linalg.norm(extent)
        sizes += edges * float(farthest)
    result.broad = 1.0 + edges
    inverse = np.abs(to_index)
    result.astray = ASTRAY * float((inverse @ np.abs(volume.index_to_world[:3, :3]) @ inverse @ sizes).max())
    return result
