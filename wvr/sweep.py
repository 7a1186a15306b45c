"""Sweeps of light: how slices lie, and which kernel runs when."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .camera import Camera
from .kernels.precision import REALS
from .kernels.ray import TILE, tiles
from .kernels.scene import Variant, make_scene
from .kernels.slices import gather, make_advance
from .kernels.travel import BORDER, ROWS, RUN, SLABS, Sweep, make_travel, run_of
from .launch import launch, launch_in_turn
from .lights import Headlight, Light
from .shadows import ConvolutionShadows
from .volume import Volume

# Bytes of the slices that light is ahead of the eye: rays take up their state that much less often.
AHEAD = 128 << 20
# Largest variance of a step of diffusion [cells], at which its weights are positive.
LARGEST_STEP = 0.5
# Steps of diffusion a slab at most; only right in front of a camera inside the volume more would be asked for.
MOST_STEPS = 64
# Cosine between light and view down to which slices are view-aligned by themselves.
ALIGNED = 0.5
# Standard deviations of blur that light's frame has around the volume.
MARGIN = 3.0


def sweep_lights(
    volume: Volume,
    camera: Camera,
    shadows: ConvolutionShadows,
    variant: Variant,
    scene: Any,
    shown: wp.array,
    buffer: Callable[..., wp.array],
    device: wp.Device,
) -> tuple[wp.array, wp.array, NDArray[np.int32], int]:
    """Run the sweeps of all lights.

    Parameters
    ----------
    scene
        Of the ``variant``, whose rule is ``"midpoint"`` or ``"preintegrated"``; its view's box is what there is to see.
    shown
        (height, width) of uint8: the pixels that are asked for.
    buffer
        ``buffer(name, shape, dtype, device)``: an array that frames leave to one another, since memory that a process
        touches for the first time is slow: 68 MB take 30 to 90 ms.

    Returns
    -------
    result, rgba
        (height, width) of vec3d and vec4d: colour in the light of all lights or, where the image is one of rays, the
        share of emission that light reaches; and the composite of the slices without shadows.
    samples
        Of each ray.
    slices
        Of all sweeps.
    """
    height, width = scene.view.height, scene.view.width
    advance = make_advance(variant)
    result = wp.zeros((height, width), dtype=wp.vec3d, device=device)
    samples = wp.zeros((height, width), dtype=int, device=device)
    rgba = buffer("composite", (height, width), wp.vec4d, device)
    lit = buffer("lit", (height, width), wp.vec3d, device)
    slices = 0
    for light in shadows.lights:
        rgba.zero_()
        lit.zero_()
        sweep, shape, variance = place(volume, camera, shadows, light, scene.view)
        tile = int(TILE) ** 2
        for first, count, stack in travel(variant, scene, sweep, shape, variance, buffer, device):
            inputs = [scene, sweep, first, count, stack, shown, rgba, lit, samples]
            launch(advance, tiles(width, height) * tile, inputs, device, grain=tile)
        launch(gather, width * height, [rgba, lit, wp.vec3d(*light.color), shadows.image == "rays", result], device)
        slices += sweep.slices
    return result, rgba, samples.numpy(), slices


def travel(
    variant: Variant,
    scene: Any,
    sweep: Any,
    shape: tuple[int, int],
    variance: Callable[[int], float],
    buffer: Callable[..., wp.array],
    device: wp.Device,
) -> Iterator[tuple[int, int, wp.array]]:
    """Let light travel: yields the first slab, the number of slabs, and the light of the slices around them, which
    only lasts until the next.
    """
    occupy, step = make_travel(variant)
    real = REALS[variant.precision]
    rows, columns = shape
    runs = columns // int(RUN)
    occupied = wp.empty((-(-sweep.slices // int(SLABS)), -(-rows // int(ROWS)), runs), dtype=wp.uint8, device=device)
    launch(occupy, occupied.size, [scene, sweep, occupied], device)
    state = wp.ones((2, rows + 2 * int(BORDER), runs + 2), dtype=run_of(real), device=device)
    rest = wp.empty((rows, runs), dtype=run_of(real), device=device)
    touched = wp.zeros((occupied.shape[1] + 2, runs + 2), dtype=wp.uint8, device=device)
    # Of one size whatever the view, so that the next frame can have it: what is not used takes no memory.
    whole = buffer("light", (max(AHEAD // wp.types.type_size_in_bytes(real), 17 * rows * columns),), real, device)
    chunk = min(whole.size // (rows * columns) - 1, sweep.slices)
    stack = wp.array(ptr=whole.ptr, dtype=real, shape=(chunk + 1, rows, columns), device=device)
    stacked = wp.array(ptr=whole.ptr, dtype=run_of(real), shape=(chunk + 1, rows, runs), device=device)
    scenes = wp.array([scene], dtype=make_scene(variant), device=device)
    sweeps = wp.array([sweep], dtype=Sweep, device=device)
    source = 0
    for first in range(0, sweep.slices, chunk):
        count = min(chunk, sweep.slices - first)
        steps: list[tuple] = []
        # The light in front of all slabs is attenuated by the first of them.
        for slab in range(first - (first == 0), first + count):
            q = variance(slab) if slab >= 0 else 0.0
            parts = min(int(np.ceil(q / LARGEST_STEP)) or 1, MOST_STEPS)
            for part in range(parts):
                slot = slab + 1 - first if part == parts - 1 else -1
                steps.append((slab, real(q / parts), source, slot))
                source = 1 - source
        inputs = [scenes, sweeps, occupied, state, rest, touched, stacked]
        launch_in_turn(step, rows * runs, steps, inputs, device)
        yield first, count, stack
        wp.copy(stack[0], stack[count])


def axis_of(camera: Camera, light: Light, mode: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors, in world space: the axis of the sweep, and the way light goes (that in the image's centre)."""
    _, _, forward = camera.basis()
    way = forward if isinstance(light, Headlight) else -np.array(light.direction)
    cosine = float(way @ forward)
    if mode == "auto":
        mode = "view-aligned" if cosine >= ALIGNED else "half-angle"
    if mode == "half-angle":
        axis = way + forward if cosine >= 0 else way - forward
        return axis / np.linalg.norm(axis), way
    if cosine < 0.05:
        raise ValueError(
            f'shadows with mode "view-aligned" need light from the side of the viewer, got {light!r} '
            f'{np.degrees(np.arccos(cosine)):.0f} degrees from the view; take "auto" or "half-angle"'
        )
    return forward, way


def place(
    volume: Volume, camera: Camera, shadows: ConvolutionShadows, light: Light, view: Any
) -> tuple[Any, tuple[int, int], Callable[[int], float]]:
    """The slices of a light: the struct of the kernels, rows and columns of its cells, and the variance, in cells, by
    which light spreads along each axis in a slab.
    """
    unit = volume.smallest_spacing
    axis, way = axis_of(camera, light, shadows.mode)
    fans = isinstance(light, Headlight) and not camera.parallel
    low, high = np.array(view.low), np.array(view.high)
    matrix = volume.index_to_world[:3, :3] / unit
    home = camera.position if not camera.parallel else volume.corners.mean(axis=0)
    # World coordinates here are relative to home, in units of the smallest voxel spacing.
    shift = (volume.index_to_world[:3, 3] - home) / unit
    picks = np.array([[(n >> a) & 1 for a in range(3)] for n in range(8)])
    corners = np.where(picks, high, low) @ matrix.T + shift
    z = corners @ axis
    start, end = float(z.min()), float(z.max())
    if fans:
        # Nothing behind the camera is seen, nor casts a shadow that is.
        start = max(start, 0.0)
        end = max(end, start + shadows.slice_distance)
    if not camera.parallel:
        sweeps_all(camera, axis, view)
    slices = max(1, int(np.ceil((end - start) / shadows.slice_distance - 1e-9)))
    thickness = (end - start) / slices or shadows.slice_distance

    right, up, _ = camera.basis()
    if not isinstance(light, Headlight):
        # Light's columns run across the image as far as they can.
        right = np.cross(way, up if abs(way @ up) < 0.9 else right)
        right /= np.linalg.norm(right)
        up = np.cross(right, way)
    cell, reference = shadows.cell_width, 1.0
    slant = 1.0 / float(axis @ way)
    if fans:
        reference = 0.5 * (start + end)
        cell /= reference
    side = np.stack([right, up]) / cell
    flat = corners @ side.T
    if fans:
        half = np.tan(np.radians(camera.view_angle) / 2)
        extent = half / cell * np.array([view.width / view.height, 1.0])
        flat = np.stack([-extent, extent])
        if z.min() > 0:
            flat = np.clip(corners @ side.T / z[:, None], -extent, extent)
    blur = MARGIN * np.sqrt(2 * shadows.diffusion * (end - start) * slant) / shadows.cell_width
    corner = np.floor(flat.min(axis=0) - blur) - 1
    columns, rows = (np.ceil(flat.max(axis=0) + blur) + 2 - corner).astype(int)
    columns = -(-columns // int(RUN)) * int(RUN)

    # From (u, v, z) back: three planes that meet in a point.
    back = np.linalg.inv(np.stack([*side, axis]))
    to_index = np.linalg.inv(matrix)
    sweep = Sweep()
    sweep.start, sweep.thickness, sweep.slices = start, thickness, slices
    sweep.parts = shadows.subsamples + 1
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
    sweep.front = shadows.received == "front"

    def variance(slab: int) -> float:
        way = thickness * slant if shadows.kernel == "diffusive" else 1.0
        width = cell * (start + (slab + 0.5) * thickness) if fans else cell
        return 2 * shadows.diffusion * way / width**2

    return sweep, (int(rows), int(columns)), variance


def sweeps_all(camera: Camera, axis: NDArray[np.float64], view: Any) -> None:
    """Says so where a ray of the image does not pass slices across ``axis`` in the order that the others do."""
    right, up, forward = camera.basis()
    half = np.tan(np.radians(camera.view_angle) / 2)
    across = half * view.width / view.height * right
    rates = [axis @ (forward + i * across + j * half * up) for i in (-1, 1) for j in (-1, 1)]
    if min(rates) <= 0.02 and max(rates) >= -0.02:
        raise ValueError(
            f"view_angle = {camera.view_angle!r} is too wide for slices half-way between this light and the view; take "
            "a narrower view or a light that is closer to its direction"
        )
