"""Slabs drawn pass by pass, as in section 3 of Roettger et al. (2003): a pass over all pixels reads the frame buffer,
blends one slab or several with it, back to front, and writes it.

A slab has two fetches of the volume and one of its pre-integration table; several at once share the fetches between
them and the buffer. Lit, the volume holds normals and scalars in four bytes a sample, and a slab has the light of its
front, as the paper's shaders do (appendix 8.3).

Clipped (section 2 and appendix 8.2), a slab also has two fetches of a clip volume and one of the table of Figure 2,
which says for the clip values at both ends how to adjust the scalars (r, g), emission and opacity (b) and light (a).
Where a clip value is less than half of 255 there is nothing to see.
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
    point, along, length, _ = entry(view, x, y)
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


def factors(front: np.ndarray, back: np.ndarray) -> dict[str, np.ndarray]:
    """The paper's adjustment factors for clip values at a segment's ends, visible from 0.5 on."""
    with np.errstate(divide="ignore", invalid="ignore"):
        r = np.where(front < 0.5, np.clip((0.5 - front) / (back - front), 0, 1), 0.0)
        g = 1 - np.where(back < 0.5, np.clip((0.5 - back) / (front - back), 0, 1), 0.0)
    clipped = (front < 0.5) & (back < 0.5)
    b = np.where(clipped, 0.0, g - r)
    return {
        "r": np.where(clipped, 0.0, r),
        "g": np.where(clipped, 0.0, g),
        "b": b,
        "a": np.where(clipped, 0, (r + g) / 2),
    }


@cache
def make_pass(dtype: type, slabs: int, lit: bool, clipped: bool):
    """Kernel over pixels (height, width) of a pass of so many slabs, the first of them number ``slab``."""
    Field = make_samples(dtype)
    Clip = make_samples(wp.uint8)
    value = make_value(dtype, float)
    clip_value = make_value(wp.uint8, float)
    Table, lookup = make_table(float)

    @wp.struct
    class Volumes:
        field: Field
        packed: wp.array3d(dtype=vec4ub)  # normal and scalar, where there is light
        light: wp.vec3
        clip: Clip
        to_clip: wp.vec3  # indices of the clip volume per index
        factors: Table

    @wp.func
    def fetched(v: Volumes, p: wp.vec3):
        """The scalar, what light does there, and the clip value."""
        s = wp.vec3(0.0, 1.0, 255.0)
        if wp.static(lit):
            c = normal_and_scalar(v.packed, v.field.last, p)
            n = wp.vec3(c[0], c[1], c[2]) * 2.0 - wp.vec3(1.0, 1.0, 1.0)
            s[0] = c[3] * 255.0
            s[1] = wp.min(0.5 + wp.abs(wp.dot(n, v.light)), 1.0)
        else:
            s[0] = value(v.field, p)
        if wp.static(clipped):
            s[2] = clip_value(v.clip, wp.cw_mul(p, v.to_clip))
        return s

    @wp.kernel(enable_backward=False, module="unique")
    def blend(
        volumes: Volumes,
        table: Table,
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
            back = fetched(volumes, o + wp.min(float(slab + wp.static(slabs)) * step, length) * d)
            for n in range(wp.static(slabs)):
                at = float(slab + wp.static(slabs) - 1 - n) * step
                if at < length:
                    front = fetched(volumes, o + at * d)
                    light = front[1]
                    q = wp.vec4()
                    if wp.static(clipped):
                        f = lookup(volumes.factors, front[2], back[2])
                        change = back[0] - front[0]
                        q = f[2] * lookup(table, front[0] + f[0] * change, front[0] + f[1] * change)
                        light += f[3] * (back[1] - front[1])
                    else:
                        q = lookup(table, front[0], back[0])
                    pixel = wp.vec4(light * q[0], light * q[1], light * q[2], q[3]) + (1.0 - q[3]) * pixel
                    back = front
            buffer[y, x] = pixel

    return Volumes, blend


@dataclass
class Passes:
    """A scene drawn in passes of slabs, on the CPU; ``clip``: values over the volume, uint8, seen from 127.5 on."""

    scene: Scene
    lit: bool
    clip: np.ndarray | None = None

    def __post_init__(self) -> None:
        data, device = self.scene.volume.numpy(), get_device("cpu")
        self.device, self.dtype = device, wp.dtype_from_numpy(data.dtype)
        volumes = make_pass(self.dtype, 1, self.lit, self.clip is not None)[0]()
        volumes.field = samples(data, device)
        volumes.light = wp.normalize(wp.vec3(1.0, 1.0, 1.0))
        low, high = self.scene.volume.range
        if self.lit:
            gradient = np.stack(np.gradient(data.astype(np.float32))[::-1], axis=-1)
            normal = gradient / np.maximum(np.linalg.norm(gradient, axis=-1, keepdims=True), 1e-6)
            scalar = (data.astype(np.float32) - low) / (high - low)
            packed = np.concatenate([0.5 + 0.5 * normal, scalar[..., None]], axis=-1)
            volumes.packed = wp.array(np.rint(255 * packed).astype(np.uint8), dtype=vec4ub, device=device)
        if self.clip is not None:
            volumes.clip = samples(self.clip, device)
            sizes = [np.array(one.shape[::-1]) - 1 for one in (self.clip, data)]
            volumes.to_clip = wp.vec3(*(sizes[0] / sizes[1]))
            # Entries where clip values are.
            values = np.arange(256) / 255
            table = factors(*np.meshgrid(values, values, indexing="ij"))
            volumes.factors = looked_up(np.stack([table[name] for name in "rgba"], axis=-1), 0.0, 1.0, device)
        self.volumes = volumes

    def draw(self, camera: wvr.Camera, step: float, slabs: int) -> tuple[np.ndarray, float]:
        """The image, and processor seconds of its passes without what it costs to start one."""
        width, height = self.scene.size
        low, high = self.scene.volume.range
        unit = self.scene.volume.smallest_spacing
        made = wvr.preintegrate(self.scene.transfer_function, 256, step * unit, (low, high))
        # The packed volume has 0 to 255 in place of the range.
        placed = (0.0, 1.0) if self.lit else (low, 255 / (high - low))
        table = looked_up(made.rgba, *placed, self.device)
        origin, direction = (wp.empty((height, width), dtype=wp.vec3, device=self.device) for _ in range(2))
        reach = wp.empty((height, width), dtype=float, device=self.device)
        shape = (height, width)
        seen = view(self.scene.volume, camera, width, height)
        wp.launch(set_up, shape, [seen, origin, direction, reach], device=self.device)
        buffer = wp.zeros(shape, dtype=wp.vec4, device=self.device)
        _, blend = make_pass(self.dtype, slabs, self.lit, self.clip is not None)
        count = int(np.ceil(reach.numpy().max() / step / slabs))

        def passes(shape: tuple[int, int]) -> float:
            start = time.process_time()
            for n in range(count - 1, -1, -1):
                inputs = [self.volumes, table, n * slabs, step, origin, direction, reach, buffer]
                wp.launch(blend, shape, inputs, device=self.device)
            return time.process_time() - start

        passes((1, 1))
        overhead = passes((1, 1))
        buffer.zero_()
        seconds = passes(shape) - overhead
        return buffer.numpy(), seconds


def samples(data: np.ndarray, device: wp.Device):
    """The struct of a field."""
    dtype = wp.dtype_from_numpy(data.dtype)
    field = make_samples(dtype)()
    field.data = wp.array(data, dtype=dtype, device=device)
    field.last = wp.vec3i(*(n - 2 for n in data.shape[::-1]))
    return field


def looked_up(rgba: np.ndarray, low: float, scale: float, device: wp.Device):
    """The struct of a table."""
    table = make_table(float)[0]()
    table.rgba = wp.array(rgba.astype(np.float32), dtype=wp.vec4, device=device)
    table.low, table.scale = low, scale
    return table
