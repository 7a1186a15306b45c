"""Slabs drawn pass by pass, as in section 3 of Roettger et al. (2003): a pass over all pixels reads the frame buffer,
blends one slab or several with it, back to front, and writes it.

A slab has two fetches of the volume and one of its pre-integration table; several at once share the fetches between
them and the buffer. Lit, the volume holds normals and scalars in four bytes a sample, and a slab has the light of its
front, as the paper's shaders do (appendix 8.3).
"""
# mypy: ignore-errors

import time
from dataclasses import dataclass
from functools import cache

import numpy as np
import warp as wp

import wvr
from wvr.frame import view
from wvr.kernels.field.samples import make_samples, make_value
from wvr.kernels.ray import View, entry
from wvr.kernels.transfer.lookup import make_table
from wvr.launch import get_device

from .base.scenes import Scene

vec4ub = wp.types.vector(4, wp.uint8)


@wp.kernel(enable_backward=False, module="unique")
def set_up(
    view: View,
    origin: wp.array2d(dtype=wp.vec3),
    direction: wp.array2d(dtype=wp.vec3),
    reach: wp.array2d(dtype=float),
):
    """Where rays enter and how far they go, which interpolators of graphics hardware know."""
    y, x = wp.tid()
    point, along, length = entry(view, x, y)
    origin[y, x] = wp.vec3(point)
    direction[y, x] = wp.vec3(along)
    reach[y, x] = float(length)


@wp.func
def normal_and_scalar(volume: wp.array3d(dtype=vec4ub), last: wp.vec3i, p: wp.vec3):
    """Trilinear, each from -1 to 1 or 0 to 1."""
    i = wp.max(wp.min(int(p[0]), last[0]), 0)
    j = wp.max(wp.min(int(p[1]), last[1]), 0)
    k = wp.max(wp.min(int(p[2]), last[2]), 0)
    x = p[0] - float(i)
    y = p[1] - float(j)
    z = p[2] - float(k)
    c00 = wp.vec4(volume[k, j, i]) * (1.0 - x) + wp.vec4(volume[k, j, i + 1]) * x
    c10 = wp.vec4(volume[k, j + 1, i]) * (1.0 - x) + wp.vec4(volume[k, j + 1, i + 1]) * x
    c01 = wp.vec4(volume[k + 1, j, i]) * (1.0 - x) + wp.vec4(volume[k + 1, j, i + 1]) * x
    c11 = wp.vec4(volume[k + 1, j + 1, i]) * (1.0 - x) + wp.vec4(volume[k + 1, j + 1, i + 1]) * x
    c = (c00 * (1.0 - y) + c10 * y) * (1.0 - z) + (c01 * (1.0 - y) + c11 * y) * z
    return c * (1.0 / 255.0)


@cache
def make_pass(dtype: type, slabs: int, lit: bool):
    """Kernel over pixels (height, width) of a pass of so many slabs, the first of them number ``slab``."""
    Field = make_samples(dtype)
    value = make_value(dtype, float)
    Table, lookup = make_table(float)

    @wp.func
    def fetched(field: Field, volume: wp.array3d(dtype=vec4ub), light: wp.vec3, p: wp.vec3):
        """The scalar, and what light does there."""
        if wp.static(lit):
            c = normal_and_scalar(volume, field.last, p)
            n = wp.vec3(c[0], c[1], c[2]) * 2.0 - wp.vec3(1.0, 1.0, 1.0)
            return wp.vec2(c[3] * 255.0, wp.min(0.5 + wp.abs(wp.dot(n, light)), 1.0))
        return wp.vec2(value(field, p), 1.0)

    @wp.kernel(enable_backward=False, module="unique")
    def blend(
        field: Field,
        volume: wp.array3d(dtype=vec4ub),
        table: Table,
        light: wp.vec3,
        slab: int,
        step: float,
        origin: wp.array2d(dtype=wp.vec3),
        direction: wp.array2d(dtype=wp.vec3),
        reach: wp.array2d(dtype=float),
        buffer: wp.array2d(dtype=wp.vec4),
    ):
        y, x = wp.tid()
        length = reach[y, x]
        if float(slab) * step < length:
            o = origin[y, x]
            d = direction[y, x]
            pixel = buffer[y, x]
            back = fetched(field, volume, light, o + wp.min(float(slab + wp.static(slabs)) * step, length) * d)
            for n in range(wp.static(slabs)):
                at = float(slab + wp.static(slabs) - 1 - n) * step
                if at < length:
                    front = fetched(field, volume, light, o + at * d)
                    q = lookup(table, front[0], back[0])
                    pixel = wp.vec4(front[1] * q[0], front[1] * q[1], front[1] * q[2], q[3]) + (1.0 - q[3]) * pixel
                    back = front
            buffer[y, x] = pixel

    return blend


@dataclass
class Passes:
    """A scene drawn in passes of slabs, on the CPU."""

    scene: Scene
    lit: bool

    def __post_init__(self) -> None:
        data = self.scene.volume.numpy()
        self.device = get_device("cpu")
        self.dtype = wp.dtype_from_numpy(data.dtype)
        self.field = make_samples(self.dtype)()
        self.field.data = wp.array(data, dtype=self.dtype, device=self.device)
        self.field.last = wp.vec3i(*(n - 2 for n in data.shape[::-1]))
        self.volume = wp.zeros((1, 1, 1), dtype=vec4ub, device=self.device)
        if self.lit:
            gradient = np.stack(np.gradient(data.astype(np.float32))[::-1], axis=-1)
            normal = gradient / np.maximum(np.linalg.norm(gradient, axis=-1, keepdims=True), 1e-6)
            low, high = self.scene.volume.range
            scalar = (data.astype(np.float32) - low) / (high - low)
            packed = np.concatenate([0.5 + 0.5 * normal, scalar[..., None]], axis=-1)
            self.volume = wp.array(np.rint(255 * packed).astype(np.uint8), dtype=vec4ub, device=self.device)

    def draw(self, camera: wvr.Camera, step: float, slabs: int) -> tuple[np.ndarray, float]:
        """The image, and processor seconds of its passes without what it costs to start one."""
        width, height = self.scene.size
        low, high = self.scene.volume.range
        unit = self.scene.volume.smallest_spacing
        made = wvr.preintegrate(self.scene.transfer_function, 256, step * unit, (low, high))
        table = make_table(float)[0]()
        table.rgba = wp.array(made.rgba, dtype=wp.vec4, device=self.device)
        # The packed volume has 0 to 255 in place of the range.
        table.low, table.scale = (0.0, 1.0) if self.lit else (low, 255 / (high - low))
        origin, direction = (wp.empty((height, width), dtype=wp.vec3, device=self.device) for _ in range(2))
        reach = wp.empty((height, width), dtype=float, device=self.device)
        shape = (height, width)
        seen = view(self.scene.volume, camera, width, height)
        wp.launch(set_up, shape, [seen, origin, direction, reach], device=self.device)
        buffer = wp.zeros(shape, dtype=wp.vec4, device=self.device)
        blend = make_pass(self.dtype, slabs, self.lit)
        towards = wp.vec3(*(wp.normalize(wp.vec3(1.0, 1.0, 1.0))))
        count = int(np.ceil(reach.numpy().max() / step / slabs))

        def passes(shape: tuple[int, int]) -> float:
            start = time.process_time()
            for n in range(count - 1, -1, -1):
                inputs = [self.field, self.volume, table, towards, n * slabs, step, origin, direction, reach, buffer]
                wp.launch(blend, shape, inputs, device=self.device)
            return time.process_time() - start

        passes((1, 1))
        overhead = passes((1, 1))
        buffer.zero_()
        seconds = passes(shape) - overhead
        return buffer.numpy(), seconds
