"""Convolution shadows as their papers have them (Patel et al. 2013; Angelelli and Bruckner 2017, sections 3 and 4).

Slices across the view, one after the other; a pixel of a slice is a work item, which does what a fragment does. Light
that left the slice before is convolved with K x K taps, samples are classified, seen in that light and composed, and
what they absorb is taken from it before it goes on: *one array of samples feeds eye and light*. ICS has one sample a
slice; SCS has more between it and the slice before, in light that is linear between the two. Nothing is skipped.

The camera is parallel, so that the kernel is the same everywhere. Light comes from the upper left of the viewer, and
the kernel has the mean and the variance that it gains over a slab, so that one scene has one light whatever the slice
distance. Both fit into five taps by five; more of them are zero, and are read all the same.
"""
# mypy: ignore-errors

from dataclasses import dataclass
from functools import cache
from time import process_time
from typing import NamedTuple

import numpy as np
import warp as wp

import wvr
from wvr.kernels.field.samples import make_samples, make_value
from wvr.launch import get_device, launch_in_turn

from ..slab_passes import samples

KERNELS = (3, 5, 7, 9, 13)
# Full light around all pixels.
BORDER = 12
# Of light, to the right and downwards, per unit of depth; and the half-angle of its cone.
TILT = 0.12
SPREAD = 36.0
ENTRIES = 4096


@cache
def make_slice(dtype: type, taps: int):
    """The structs of a scene and of what slices leave, and the kernel of a slice."""
    Field = make_samples(dtype)
    value = make_value(dtype, float)

    @wp.struct
    class Sliced:
        field: Field
        corner: wp.vec3  # of pixel (0, 0) on slice 0 [index coordinates]
        right: wp.vec3  # from pixel to pixel
        down: wp.vec3
        ahead: wp.vec3  # from slice to slice
        last: wp.vec3
        parts: int  # that a slab is sampled in
        table: wp.array(dtype=wp.vec4)  # colour and opacity of a sample, premultiplied
        low: float
        scale: float
        weights: wp.array2d(dtype=float)

    @wp.struct
    class Left:
        out: wp.array3d(dtype=float)  # light that leaves a slice and the one before, with a border
        light: wp.array2d(dtype=float)  # that arrives at a slice
        rgba: wp.array2d(dtype=wp.vec4)

    @wp.kernel(enable_backward=False, module="unique")
    def one_slice(base: int, number: int, scene: Sliced, left: Left):
        item = wp.tid() + base
        y = item // left.light.shape[1]
        x = item - y * left.light.shape[1]
        before = (number + 1) & 1
        row = y + BORDER - taps // 2
        column = x + BORDER - taps // 2
        light = wp.float32(0.0)
        count = int(taps)
        for j in range(count):
            line = wp.float32(0.0)
            for i in range(count):
                line += scene.weights[j, i] * left.out[before, row + j, column + i]
            light += line
        passed = left.light[y, x]
        pixel = left.rgba[y, x]
        start = scene.corner + float(x) * scene.right + float(y) * scene.down
        through = wp.float32(1.0)
        for m in range(scene.parts):
            share = float(m + 1) / float(scene.parts)
            p = start + (float(number - 1) + share) * scene.ahead
            if wp.min(p) >= 0.0 and wp.min(scene.last - p) >= 0.0:
                u = (value(scene.field, p) - scene.low) * scene.scale
                q = scene.table[int(wp.clamp(u, 0.0, wp.static(float(ENTRIES - 1))))]
                lit = (1.0 - pixel[3]) * (passed + share * (light - passed))
                pixel += wp.vec4(lit * q[0], lit * q[1], lit * q[2], (1.0 - pixel[3]) * q[3])
                through *= 1.0 - q[3]
        left.rgba[y, x] = pixel
        left.light[y, x] = light
        left.out[number & 1, y + BORDER, x + BORDER] = light * through

    return Sliced, Left, one_slice


def kernel_of(mean: float, variance: float, taps: int) -> np.ndarray:
    """Taps along an axis of light that comes from as far before: twice three, that have half of both."""
    f, q = 0.5 * mean, 0.5 * variance
    three = np.array([0.5 * (q + f * f + f), 1 - q - f * f, 0.5 * (q + f * f - f)])
    assert three.min() >= 0, f"{three} for a mean of {mean:g} and a variance of {variance:g}"
    five = np.convolve(three, three)
    if taps < 5:
        return five[1:-1] / five[1:-1].sum()
    return np.pad(five, (taps - 5) // 2)


class Drawn(NamedTuple):
    """An image, its slices, and processor seconds of a slice, of those that were drawn."""

    rgba: np.ndarray
    slices: int
    seconds: float


@dataclass
class Slices:
    """A volume drawn slice by slice."""

    volume: wvr.Volume
    tf: wvr.TransferFunction

    def __post_init__(self) -> None:
        self.device = get_device("cpu")
        self.dtype = wp.dtype_from_numpy(self.volume.dtype)
        self.field = samples(self.volume.numpy(), self.device)
        low, high = float(self.tf.knots[0]), float(self.tf.knots[-1])
        self.low, self.scale = low, (ENTRIES - 1) / (high - low)
        s = np.linspace(low, high, ENTRIES)
        self.color, self.extinction = self.tf.color(s), self.tf.extinction(s, self.volume.smallest_spacing)

    def draw(
        self,
        camera: wvr.Camera,
        size: int,
        distance: float,
        subsamples: int = 0,
        taps: int = 5,
        some: int | None = None,
        window: int | None = None,
        nearer: float = 0.0,
    ) -> Drawn:
        """An image of a parallel camera, or a ``window`` of its middle, slices a part of their distance ``nearer``; of
        ``some`` slices alone, evenly apart, it is only the time.
        """
        unit = self.volume.smallest_spacing
        Sliced, Left, one_slice = make_slice(self.dtype, taps)
        right, up, ahead = camera.basis()
        pixel = 2 * camera.half_height / size
        depths = (self.volume.corners - camera.target) @ ahead / unit
        start = depths.min() - nearer * distance
        count = int(np.ceil((depths.max() - start) / distance)) + 1
        into = np.linalg.inv(self.volume.index_to_world)
        shown = size if window is None else window
        corner = camera.target + 0.5 * (shown - 1) * pixel * (up - right) + start * unit * ahead
        scene = Sliced()
        scene.field, scene.parts = self.field, subsamples + 1
        scene.corner = wp.vec3(*(into[:3, :3] @ corner + into[:3, 3]))
        scene.right, scene.down = (wp.vec3(*(into[:3, :3] @ (pixel * axis))) for axis in (right, -up))
        scene.ahead = wp.vec3(*(into[:3, :3] @ (distance * unit * ahead)))
        scene.last = wp.vec3(*(np.array(self.volume.dimensions) - 1.0))
        opacity = -np.expm1(-self.extinction * distance / scene.parts)
        table = np.column_stack([self.color * opacity[:, None], opacity]).astype(np.float32)
        scene.table = wp.array(table, dtype=wp.vec4, device=self.device)
        scene.low, scene.scale = self.low, self.scale
        a_voxel = unit / pixel
        spread = np.tan(np.radians(SPREAD)) ** 2 / 4 * distance * a_voxel**2
        line = kernel_of(TILT * distance * a_voxel, spread, taps)
        scene.weights = wp.array(np.outer(line, line).astype(np.float32), device=self.device)
        left = Left()
        shape = (2, shown + 2 * BORDER, shown + 2 * BORDER)
        left.out = wp.ones(shape, dtype=float, device=self.device)
        left.light = wp.ones((shown, shown), dtype=float, device=self.device)
        left.rgba = wp.zeros((shown, shown), dtype=wp.vec4, device=self.device)
        numbers = range(count) if some is None else np.linspace(1, count - 1, some).astype(int).tolist()
        launch_in_turn(one_slice, 1, [(0,)], [scene, left], self.device)
        began = process_time()
        launch_in_turn(one_slice, shown * shown, [(number,) for number in numbers], [scene, left], self.device)
        return Drawn(left.rgba.numpy(), count, (process_time() - began) / len(numbers))
