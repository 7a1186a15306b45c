"""Sweeps of light: how slices lie, which kernel runs when, and an image in shadow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..camera import Camera
from ..field.base import Field
from ..field.blocks import Octants
from ..keep import Keeper, Part
from ..kernels.light.lanes import lanes_of
from ..kernels.light.shares import Turn, make_shares
from ..kernels.light.slices import Eye, make_advance
from ..kernels.light.travel import BORDER, ROWS, RUN, SLABS, Half, Sweep, make_state, make_travel, run_of
from ..kernels.light.travel import Shade as ShadeStruct
from ..kernels.precision import REALS
from ..launch import in_turn, launch, launch_in_turn, launch_pixels
from ..memory import free_memory, gib
from ..transfer.function import Transfer
from ..transfer.lookup import Stretchable
from ..transfer_function import TransferFunction
from .lights import Headlight, Light
from .shadows import ConvolutionShadows

if TYPE_CHECKING:
    from ..frame import Frame
    from ..kernels.scene import Halves
    from ..scene import Scene

# Bytes of the slices that light is ahead of the eye: rays take up their state that much less often.
AHEAD = 128 << 20
# Largest variance of a step of diffusion [cells], at which its weights are positive.
LARGEST_STEP = 0.5
# Steps of diffusion a slab at most: right in front of a camera inside the volume, and of light as wide as it is long,
# more would be asked for, and there is less blur.
MOST_STEPS = 64
# Cosine between light and view down to which slices are view-aligned by themselves.
ALIGNED = 0.5
# Standard deviations of blur that light's frame has around the volume.
MARGIN = 3.0
# What only a share of an image is made of: transparency that rays end at, and entries of the table.
ENDING = 0.01
ENTRIES: Final = 256


class Shaded(NamedTuple):
    """The shadows of an image, how many slices they took, and samples of the sweeps' rays, (height, width)."""

    shadows: ConvolutionShadows
    slices: int
    samples: wp.array

    def said(self, samples: int, seconds: float) -> dict[str, Any]:
        """Statistics of the image, once the host knows how many samples there are."""
        return {
            "seconds_shadows": seconds,
            "slices": self.slices,
            "shadow_samples": samples,
            "shadows": repr(self.shadows),
        }


@dataclass(frozen=True)
class Sweeping:
    """In place of an integrator, of which it has what a frame asks for: how sweeps see tissue, in a precision."""

    shadows: ConvolutionShadows
    precision: str
    anywhere: ClassVar[bool] = True

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        return {}

    def parts(self, scene: Scene) -> dict[str, Part]:
        return {}

    def function(self, scene: Scene, tf: TransferFunction) -> Part:
        return Transfer(tf, scene.unit, scene.shift, self.precision, scene.material)

    def table(self, scene: Scene, tf: TransferFunction) -> Part | None:
        if not self.shadows.preintegrated:
            return None
        n, domain = scene.table_shape(tf) if self.shadows.alone else scene.table_shape(tf, ENTRIES)
        if scene.volume.whole and domain[0] >= 0 and domain[1] <= 255:
            n, domain = (511 if self.shadows.alone else 256), (0.0, 255.0)  # of all volumes of bytes, frame by frame
        length = self.shadows.shortest
        return Stretchable(tf, scene.unit, length, n, domain, scene.shift, self.precision, most=1)

    def termination(self, scene: Scene) -> float:
        ending = scene.integrator.termination(scene)
        return ending if self.shadows.alone else max(ending, ENDING)


@dataclass(frozen=True)
class Extinctions(Part):
    """Those of a table that are next to each other along its first axis, in pairs: in vectors tissue that only takes
    light has all four that it is between in one place.
    """

    table: Part
    name: ClassVar[str] = "extinctions"

    def build(self, keep: Keeper) -> wp.array:
        entries = keep(self.table).rgba.numpy()[..., 3]
        pairs = np.stack([entries, np.roll(entries, -1, axis=0)], axis=-1)  # of the last entry no one asks
        return wp.array(pairs, dtype=wp.vec2, device=keep.device)


def shade(frame: Frame, rgba: wp.array, precision: str) -> Shaded:
    """Puts an image into shadow, or makes it, by sweeps in a precision."""
    height, width = rgba.shape
    scene, device, keep = frame.scene, frame.device, frame.keep
    shadows = scene.shadows
    assert shadows is not None
    halves = frame.halves(REALS[precision], Half(bool(shadows.preintegrated), shadows.received == "traced"))
    # Samples of slices are points: clips leave them or not, and light is that of points.
    cuts = replace(halves.cuts, clipped=False, naive=bool(scene.clips), parts=None)
    halves = replace(halves, cuts=cuts, light=halves.light and replace(halves.light, mode="point"))
    sweeping = Sweeping(shadows, precision)
    struct, _ = frame.struct(halves, sweeping)
    size, every = (height, width), items(width, device)
    choose, gather = make_shares(REALS["float64" if rgba.dtype is wp.vec4d else "float32"])
    eye, turn = Eye(), Turn()
    turn.share = not shadows.alone
    if turn.share:
        eye.shown = wp.empty(size, dtype=wp.uint8, device=device)
        launch(choose, height * every, [rgba, eye.shown, every], device)
    else:
        eye.shown = wp.ones(size, dtype=wp.uint8, device=device)
    eye.samples = wp.zeros(size, dtype=int, device=device)
    eye.rgba = keep.scratch("composite", size, wp.vec4d)
    eye.lit = keep.scratch("lit", size, wp.vec3d)
    octants = pairs = None
    if lanes_of(halves) is not None:
        eye.octants = octants = keep(Octants(scene.kinds(True)))
        table = sweeping.table(scene, scene.functions[0])
        assert table is not None
        pairs = keep(Extinctions(table))
    lights = shadows.lights
    sums = keep.scratch("share", size if len(lights) > 1 else (1, 1), wp.vec3d)
    slices = 0
    for number, light in enumerate(in_turn(lights)):
        slices += sweep_light(frame, halves, struct, light, eye, octants, pairs)
        turn.color, turn.first, turn.last = wp.vec3d(*light.color), number == 0, number == len(lights) - 1
        launch(gather, height * every, [eye, turn, sums, rgba, every], device)
    return Shaded(shadows, slices, eye.samples)


def sweep_light(
    frame: Frame,
    halves: Halves,
    struct: Any,
    light: Light,
    eye: Any,
    octants: wp.array | None,
    pairs: wp.array | None,
) -> int:
    """Sweep one light, with the eye's rays behind it; the number of slices. ``struct`` is the scene's, for kernels of
    the ``halves``; the box of what its view sees is what there is to see.
    """
    shadows = frame.scene.shadows
    assert shadows is not None
    advance, rays = make_advance(halves)
    struct.march, shape, variance = place(frame.scene.volume, frame.camera, shadows, light, struct.view)
    if pairs is not None:
        struct.march.pairs = pairs
    for first, count, lead, stack in travel(halves, struct, shape, variance, octants, frame.keep):
        struct.march.lead = lead
        inputs = [struct, first, count, first == 0, stack, eye]
        launch_pixels(advance, inputs, frame.device, struct.view, rays)
    return int(struct.march.slices)


def travel(
    halves: Halves,
    scene: Any,
    shape: tuple[int, int],
    variance: Callable[[int], float],
    octants: wp.array | None,
    keep: Keeper,
) -> Iterator[tuple[int, int, int, wp.array]]:
    """Let light travel: yields the first slab, the number of slabs, and the light of the slices around them and of so
    many before, which only lasts until the next. ``scene`` is the struct, with the sweep in it.
    """
    occupy, step = make_travel(halves)
    real, device = halves.real, keep.device
    rows, columns = shape
    runs = columns // int(RUN)
    sweep = scene.march
    slices = sweep.slices
    behind = min(int(np.ceil(sweep.reach / sweep.thickness)), int(slices)) if halves.march.traced else 0
    least = (behind + 17) * rows * columns + 1
    needed = least * wp.types.type_size_in_bytes(real)
    if needed > max(AHEAD, (free := free_memory(device)) + keep.held("light")):
        raise MemoryError(
            f"slices of light need {gib(needed)} on {device.alias}, which has {gib(free)} free: take wider cells "
            f"(cell=) than those that make {rows} x {columns} of a slice"
        )
    shade = ShadeStruct()
    shade.items = items(runs, device)
    if octants is not None:
        shade.octants = octants
    shade.occupied = wp.empty((-(-slices // int(SLABS)), -(-rows // int(ROWS)), runs), dtype=wp.uint8, device=device)
    deep, high, _ = shade.occupied.shape
    launch(occupy, -(-deep // 2) * -(-high // 2) * shade.items, [scene, shade.items, shade.occupied], device)
    shade.touched = wp.zeros((shade.occupied.shape[1] + 2, runs + 2), dtype=wp.uint8, device=device)
    state = make_state(real)()
    state.light = wp.ones((2, rows + 2 * int(BORDER), runs + 2), dtype=run_of(real), device=device)
    state.rest = wp.empty((rows, runs), dtype=run_of(real), device=device)
    # Of one size whatever the view, so that the next frame can have it: what is not used takes no memory, and what a
    # process touches for the first time is slow (68 MB take 30 to 90 ms).
    whole = keep.scratch("light", (max(AHEAD // wp.types.type_size_in_bytes(real), least),), real)
    chunk = min((whole.size - 1) // (rows * columns) - 1 - behind, slices)
    depth = behind + chunk + 1
    stack = wp.array(ptr=whole.ptr, dtype=real, shape=(depth, rows, columns), device=device)
    state.stack = wp.array(ptr=whole.ptr, dtype=run_of(real), shape=(depth, rows, runs), device=device)
    # Byte by byte: to make out what an array of structs is like takes 0.7 ms.
    packed = wp.array(np.frombuffer(scene.__ctype__(), np.uint8), dtype=wp.uint8, device=device)
    scenes = wp.array(ptr=packed.ptr, dtype=halves.Scene, shape=(1,), device=device)
    scenes._ref = packed  # as Warp has it of views: whoever holds the one holds the other
    source = 0
    for first in range(0, slices, chunk):
        count, lead = min(chunk, slices - first), min(behind, first)
        steps: list[tuple] = []
        # The light in front of all slabs is attenuated by the first of them.
        for slab in range(first - (first == 0), first + count):
            q = variance(slab) if slab >= 0 else 0.0
            parts = min(int(np.ceil(q / LARGEST_STEP)) or 1, MOST_STEPS)
            for part in range(parts):
                slot = lead + slab + 1 - first if part == parts - 1 else -1
                steps.append((slab, min(q / parts, LARGEST_STEP), source, slot))
                source = 1 - source
        # Diffusion reaches as far as there is a border.
        near = int(BORDER) * shade.items
        launch_in_turn(step, rows * shade.items, steps, [scenes, shade, state], device, near)
        yield first, count, lead, stack
        # What the next needs of these, from the front on: they may overlap.
        kept = min(behind, first + count) + 1 if first + count < slices else 0
        for n in range(kept):
            wp.copy(stack[n], stack[lead + count + 1 - kept + n])


def items(row: int, device: wp.Device) -> int:
    """Of a launch over a row of so many: on GPUs one each, else one for all, which costs less."""
    return row if device.is_cuda else 1


def axis_of(forward: NDArray[np.float64], light: Light, mode: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors, in world space: the axis of the sweep, and the way light goes (that in the image's centre), of a
    camera that looks ``forward``.
    """
    way = light.way(forward)
    assert way is not None
    cosine = float(way @ forward)
    if mode == "auto":
        mode = "view-aligned" if cosine >= ALIGNED else "half-angle"
    if mode == "half-angle":
        axis = way + forward if cosine >= 0 else way - forward
        return axis / np.linalg.norm(axis), way
    if cosine < 0.05:
        raise ValueError(
            f'shadows with mode "view-aligned" need light from the side of the viewer, got {light!r} '
            f'{np.degrees(np.arccos(np.clip(cosine, -1, 1))):.0f} degrees from the view; take "auto" or "half-angle"'
        )
    return forward, way


def place(
    volume: Field, camera: Camera, shadows: ConvolutionShadows, light: Light, view: Any
) -> tuple[Any, tuple[int, int], Callable[[int], float]]:
    """The slices of a light: the struct of the kernels, rows and columns of its cells, and the variance, in cells, by
    which light spreads along each axis in a slab.
    """
    unit = volume.smallest_spacing
    right, up, forward = basis = camera.basis()
    axis, way = axis_of(forward, light, shadows.mode)
    fans = isinstance(light, Headlight) and not camera.parallel
    low, high = np.array(view.seen_low), np.array(view.seen_high)
    matrix = volume.index_to_world[:3, :3] / unit
    home = camera.position if not camera.parallel else volume.corners.mean(axis=0)
    # World coordinates here are relative to home, in units of the smallest voxel spacing.
    shift = (volume.index_to_world[:3, 3] - home) / unit
    picks = np.array([[(n >> a) & 1 for a in range(3)] for n in range(8)])
    corners = np.where(picks, high, low) @ matrix.T + shift
    # Slices divide all of the volume, wherever in it there is something to see.
    volume_z = (np.where(picks, np.array(view.high), np.array(view.low)) @ matrix.T + shift) @ axis
    near, far = float(volume_z.min()), float(volume_z.max())
    if fans:
        # Nothing behind the camera is seen, nor casts a shadow that is.
        near = max(near, 0.0)
        far = max(far, near + shadows.slice_distance)
    if not camera.parallel:
        sweeps_all(camera, basis, axis, view)
    most = max(1, int(np.ceil((far - near) / shadows.slice_distance - 1e-9)))
    thickness = (far - near) / most or shadows.slice_distance
    z = corners @ axis
    first, last = ((float(end) - near) / thickness for end in (z.min(), z.max()))
    before = int(np.clip(np.floor(first + 1e-9), 0, most - 1))
    slices = int(np.clip(np.ceil(last - 1e-9), before + 1, most)) - before
    start = near + before * thickness
    end = start + slices * thickness

    if not isinstance(light, Headlight):
        # Light's columns run across the image as far as they can.
        right = np.cross(way, up if abs(way @ up) < 0.9 else right)
        right /= np.linalg.norm(right)
        up = np.cross(right, way)
    cell, reference = shadows.cell_width, 1.0
    slant = 1.0 / float(axis @ way)
    if fans:
        reference = 0.5 * (near + far)
        cell /= reference
    side = np.stack([right, up]) / cell
    flat = corners @ side.T
    if fans:
        half = camera.half_height
        extent = half / cell * np.array([view.width / view.height, 1.0])
        flat = np.stack([-extent, extent])
        if z.min() > 0:
            flat = np.clip(corners @ side.T / z[:, None], -extent, extent)
    # Of no more than there are steps for.
    most = np.sqrt(slices * MOST_STEPS * LARGEST_STEP)
    blur = MARGIN * min(np.sqrt(2 * shadows.diffusion * (end - start) * slant) / shadows.cell_width, most)
    corner = np.floor(flat.min(axis=0) - blur) - 1
    columns, rows = (np.ceil(flat.max(axis=0) + blur) + 2 - corner).astype(int)
    columns = -(-columns // int(RUN)) * int(RUN)

    # From (u, v, z) back: three planes that meet in a point.
    back = np.linalg.inv(np.stack([*side, axis]))
    to_index = np.linalg.inv(matrix)
    sweep = Sweep()
    sweep.start, sweep.thickness, sweep.slices = start, thickness, slices
    sweep.parts = shadows.parts
    sweep.ahead, sweep.offset = wp.vec3d(*(axis @ matrix)), float(axis @ shift)
    sweep.diverging = fans
    sweep.across = wp.mat33d(*np.vstack([side @ matrix, np.zeros(3)]).ravel())
    sweep.shift = wp.vec3d(*np.append(side @ shift, 0.0))
    sweep.corner = wp.vec2d(*corner)
    sweep.origin = wp.vec3d(*(-to_index @ shift))
    sweep.along = wp.vec3d(*(to_index @ back[:, 2]))
    sweep.side = wp.mat33d(*np.column_stack([to_index @ back[:, :2], np.zeros(3)]).ravel())
    sweep.slant = slant
    sweep.widening = cell**2
    sweep.before = 0.5 if shadows.splitting == "strang" else 1.0
    sweep.after = 1.0 - sweep.before
    # Back to where slices and cells have nothing between them of what is dark behind a surface.
    sweep.reach = shadows.cell_width + max(shadows.cell_width, shadows.slice_distance)
    sweep.steps = max(1, round(sweep.reach / shadows.shortest))

    def variance(slab: int) -> float:
        way = thickness * slant if shadows.kernel == "diffusive" else 1.0
        width = cell * (start + (slab + 0.5) * thickness) if fans else cell
        return 2 * shadows.diffusion * way / width**2

    return sweep, (int(rows), int(columns)), variance


def sweeps_all(camera: Camera, basis: Sequence[NDArray[np.float64]], axis: NDArray[np.float64], view: Any) -> None:
    """Says so where a ray of the image does not pass slices across ``axis`` in the order that the others do."""
    right, up, forward = basis
    half = camera.half_height
    across = half * view.width / view.height * right
    rates = [axis @ (forward + i * across + j * half * up) for i in (-1, 1) for j in (-1, 1)]
    if min(rates) <= 0.02 and max(rates) >= -0.02:
        raise ValueError(
            f"view_angle = {camera.view_angle!r} is too wide for slices half-way between this light and the view; take "
            "a narrower view or a light that is closer to its direction"
        )
