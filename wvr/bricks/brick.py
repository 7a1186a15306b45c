"""A brick as a volume, and the image of it that those of others are composed with."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil, log2
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..cached import cached_property
from ..camera import Camera
from ..cuts.labels import Segmentation
from ..faces import proven
from ..field.base import Field
from ..field.blocks import Seen
from ..frame import Frame, view
from ..keep import Keeper
from ..kernels.precision import REALS
from ..kernels.scene import Halves
from ..scene import Scene
from ..volume import Volume
from .grid import UPPER, Bricks, Index, Rect, common, footprint, from_camera
from .partial import Partial


class Brick(Volume):
    """The samples of a part of a field, and its rays.

    Parameters
    ----------
    samples
        (nz, ny, nx), with a halo where something looks beyond what is the brick's own.
    first
        Which of the field's samples the first is, along x, y, z.
    entire
        The field.
    """

    def __init__(self, samples: NDArray, first: NDArray[np.int64], entire: Field):
        self._entire = entire
        self.first = first
        super().__init__(samples, nan=getattr(entire, "nan", "error"))

    @property
    def entire(self) -> Field:
        return self._entire

    @cached_property
    def index_to_world(self) -> NDArray[np.float64]:
        matrix = self.entire.index_to_world.copy()
        matrix[:3, 3] += matrix[:3, :3] @ self.first
        return matrix

    @property
    def range(self) -> tuple[float, float]:
        """That of the field: what is made of it is of all its bricks."""
        return self.entire.range

    @property
    def longest(self) -> float:
        return self.entire.longest

    @property
    def half(self) -> Any:
        return self.entire.half

    def look(self) -> None:
        """Samples of bricks are nobody else's."""


@dataclass(frozen=True)
class Halo:
    """How many samples beyond its own a brick needs along x, y, z."""

    samples: tuple[int, int, int]

    @classmethod
    def of(cls, scene: Scene) -> Halo:
        """Gradients look at one more, and segments of one length reach out by half."""
        volume, integrator = scene.volume, scene.integrator
        step = integrator.shortest if getattr(integrator.half(scene), "anchored", False) else None
        reach = 0.0 if step is None else step / 2 * scene.unit
        along = np.linalg.norm(np.linalg.inv(volume.index_to_world[:3, :3]), axis=1)  # index lengths of a world length
        lit = scene.lighting is not None
        return cls(tuple(int(lit) + ceil(reach * n * (1 + 1e-9)) for n in along))

    def box(self, bricks: Bricks, index: Index) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First and last sample of a brick with its halo."""
        low, high = bricks.box(index)
        most = np.array([along[-1] for along in bricks.edges])
        return np.maximum(low - self.samples, 0), np.minimum(high + self.samples, most)


# A frame, its kernel's halves and struct, and what there is to see.
Prepared = tuple[Frame, Halves, Any, Seen]


class Caster:
    """Renders bricks of a scene for one camera, each in the pixels that see it, along rays that end where ``ends``,
    depths (height, width), say.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        size: tuple[int, int],
        bricks: Bricks,
        keep: Keeper,
        ends: NDArray[np.float64] | None = None,
    ):
        self.given, self.ends = scene, ends
        self.scene = scene.normal
        self.camera, self.size, self.bricks, self.keep = camera, size, bricks, keep
        self.halo = Halo.of(scene)
        self.basis = camera.basis()
        self._like: Scene | None = None
        self.made: dict[Index, Prepared] | None = None  # of bricks that are cast more than once, if they are kept
        field = self.scene.volume
        matrix = field.index_to_world
        self.eye = np.linalg.inv(matrix[:3, :3]) @ (camera.position - matrix[:3, 3])
        self.view = view(field, camera, *size)
        # Rays that rounding puts on another side of a face than the camera are put into it: no order is ever wrong.
        self.grain = 2.0 ** ceil(log2(4 * self.view.astray))
        if self.grain > 0.125:
            raise ValueError(
                f"camera must be nearer: rounding puts rays off by {self.view.astray:.2g} voxels, and bricks are not "
                f"rendered then"
            )
        self.view.grain = self.grain
        if ends is not None:
            self.view.ends = wp.array(ends, dtype=wp.float64, device=keep.device)
        self.view.astray += self.grain / 2 + _offset_rounding(field)
        integrator = self.scene.integrator
        self.precision = integrator.precision(self.scene)
        self.bounded = bool(getattr(integrator.half(self.scene), "bounded", False))

    def footprint(self, index: Index) -> Rect | None:
        """The pixels that may see a brick; None where there are none, or all their rays end in front of it."""
        low, high = self.bricks.box(index)
        rect = self.seen_in(low, high)
        if rect is not None and self.ends is not None:
            matrix = self.scene.volume.index_to_world
            corners = np.where(UPPER, high + 1.0, low - 1.0) @ matrix[:3, :3].T + matrix[:3, 3]
            nearest = from_camera(corners, self.scene.volume, self.camera, self.basis)[2].min()
            farthest = self.ends[rect].max()
            # As far as rounding may put what is there, as ``kernels.ray.slack`` has it.
            off = self.view.rounded + 2.0**-48 * self.view.broad * (abs(farthest) + abs(self.view.depth))
            if nearest - off > farthest:
                return None
        return rect

    def seen_in(self, low: NDArray[np.number], high: NDArray[np.number]) -> Rect | None:
        """The pixels that may see cells between two places."""
        thin = np.array(self.scene.volume.shape[::-1]) == 1
        off = 0.5 * thin + 2 * self.view.astray
        box = low - off, high + off
        return footprint(self.scene.volume, box, self.camera, self.basis, self.size)

    def lines(self, x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where rays of pixels are, and where they go, in index coordinates, (n, 3): as of ``kernels.ray.line``."""
        view, to_index = self.view, np.array(self.view.to_index).reshape(3, 3)
        at, way = (
            np.array(first) + x[:, None] * np.array(right) + y[:, None] * np.array(down)
            for first, right, down in (
                (view.anchor, view.right, view.down),
                (view.way, view.way_right, view.way_down),
            )
        )
        return at, way @ to_index.T

    @cached_property
    def proven(self) -> wp.vec3i:
        """As of ``faces.proven``, of all bricks."""
        return wp.vec3i(*proven(self.scene.volume, self.camera, self.size, self.view.astray))

    @property
    def ending(self) -> float:
        """Transparency at which a ray ends."""
        scene = self.scene
        return scene.integrator.termination(scene) if scene.termination is None else scene.termination

    def nothing(self) -> Partial:
        """An image of nothing, of all pixels, for bricks from the camera outwards."""
        width, height = self.size
        return replace(Partial.nothing((slice(0, height), slice(0, width)), self.bounded), foremost=True)

    def ended(self, image: Partial, rect: Rect) -> bool:
        """Whether all rays of some pixels ended, so that nothing behind is asked for."""
        through = image.through[rect]
        return bool((through[::16, ::16] < self.ending).all() and (through < self.ending).all())

    def end(self, image: Partial, rect: Rect, front: NDArray[np.float64] | None = None) -> None:
        """Have the bound of rays that ended hold for whatever is behind, which is between 0 and the brightest;
        ``front`` as of ``cast``.
        """
        if image.bound is not None:
            here = image.part(rect)
            gone = (here.through if front is None else here.through * front[image.at(rect)]) < self.ending
            assert here.bound is not None
            here.bound[gone] += here.through[gone] * self.scene.brightest
            here.through[gone] = 0.0

    def _edges(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
        """Whether rays may begin or end within a box, or so near that being astray counts; at absent cells, too."""
        field = self.scene.volume
        first, last = field.index_box
        near = 1.0 + 2 * self.view.astray
        if np.any(low <= first) or np.any(high >= last) or not field.half.finite:
            return True
        return not self.camera.parallel and bool(np.all((self.eye >= low - near) & (self.eye <= high + near)))

    def part_of(self, brick: Brick) -> Scene:
        """The scene of a brick."""
        labels = self.scene.segmentation
        if labels is not None:
            at = tuple(slice(a, a + n) for a, n in zip(brick.first[::-1], brick.shape, strict=True))
            labels = Segmentation(labels.labels.host()[at].copy(), labels.transfer_functions, labels.other)
        part = replace(self.scene, volume=brick, segmentation=labels, like=self._like)
        self._like = self._like or part
        return part

    def cast(
        self, index: Index, brick: Brick, image: Partial, rect: Rect, front: NDArray[np.float64] | None = None
    ) -> None:
        """Compose the image of a brick into that of what is in front of it, in the pixels of its ``footprint``.

        Parameters
        ----------
        front
            Transparency of what is in front of all of the ``image``, in its pixels.
        """
        if (ready := self.ready(index, brick, rect)) is not None:
            ready.compose(image, front)

    def ready(self, index: Index, brick: Brick, rect: Rect) -> Ready | None:
        """All that it takes to ``cast`` a brick; None where there is nothing to see."""
        frame, halves, struct, seen = self.prepared(index, brick)
        if seen.skipped == 1.0 and frame.scene.integrator.anywhere:
            return None
        box = self._seen_box(frame.scene, seen)
        looked = common(rect, self.seen_in(*box))
        if looked is None:
            return None
        aim(struct, looked)
        struct.opaque = 1.0 - self.ending
        struct.brick.edges = self._edges(*box)
        struct.brick.longest = frame.scene.volume.longest
        for name, value in frame.scene.integrator.spent(frame.scene, self.keep).items():
            setattr(struct.brick, name, value)
        return Ready(frame, halves, struct, looked)

    def prepared(self, index: Index, brick: Brick) -> Prepared:
        """A frame of a brick, its kernel's halves and struct for pixels that one can ``aim`` at, and what there is to
        see.
        """
        made = None if self.made is None else self.made.get(index)
        if made is None:
            made = self._made(index, brick)
            if self.made is not None:
                self.made[index] = made
        frame, halves, struct, seen = made
        box = self._seen_box(frame.scene, seen)
        struct.view = self.view
        if not halves.field.finite:
            struct.proven = self.proven
        struct.view.seen_low, struct.view.seen_high = (wp.vec3d(*corner) for corner in box)
        return made

    def _made(self, index: Index, brick: Brick) -> Prepared:
        """The same, but for what is there to see of it, which is the camera's."""
        scene = self.part_of(brick)
        frame = Frame(scene, self.camera, self.size, self.keep)
        halves = replace(frame.halves(REALS[self.precision], scene.integrator.half(scene)), brick=True)
        struct, seen = frame.struct(halves, rays=self.view)
        struct.brick.low, struct.brick.high = (wp.vec3d(*corner) for corner in self.bricks.own(index))
        struct.brick.offset = wp.vec3d(*brick.first.astype(np.float64))
        return frame, halves, struct, seen

    def _seen_box(self, scene: Scene, seen: Seen) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Of what there is to see in a brick, in the whole's index coordinates, or all of the whole."""
        if not scene.integrator.anywhere or scene.integrator.probes:
            return self.scene.volume.index_box
        assert isinstance(scene.volume, Brick)
        return seen.low + scene.volume.first, seen.high + scene.volume.first


@dataclass(frozen=True)
class Ready:
    """A brick whose rays are to be cast, in the pixels ``looked`` at."""

    frame: Frame
    halves: Halves
    struct: Any
    looked: Rect

    def compose(self, image: Partial, front: NDArray[np.float64] | None = None) -> None:
        """Cast them, as of ``Caster.cast``."""
        device, part = self.frame.device, image.part(self.looked)
        self.struct.brick.foremost = image.foremost and front is None
        if front is not None:
            self.struct.brick.front = wp.array(front[image.at(self.looked)], dtype=wp.float64, device=device)
        bound = np.zeros((1, 1)) if part.bound is None else part.bound
        with shared(device, (part.rgbt, wp.vec4d), (part.samples, int), (bound, wp.float64)) as outputs:
            self.frame.launch(self.halves, self.struct, *outputs)


def aim(struct: Any, rect: Rect) -> None:
    """Have a kernel work in those pixels."""
    rows, columns = rect
    struct.view.width, struct.view.height = columns.stop - columns.start, rows.stop - rows.start
    struct.brick.row, struct.brick.column = rows.start, columns.start


@contextmanager
def shared(device: wp.Device, *arrays: tuple[NDArray, Any]) -> Iterator[list[wp.array]]:
    """Arrays that a kernel reads and writes: the same memory on a processor, and else copies, which come back."""
    there = [wp.array(array, dtype=dtype, device=device, copy=False) for array, dtype in arrays]
    yield there
    if not device.is_cpu:
        for (array, _), copied in zip(arrays, there, strict=True):
            array[...] = copied.numpy()


def _offset_rounding(field: Any) -> float:
    """How far apart the places are in the world that a sample has as one of a brick's and of the field's, in voxels."""
    matrix, origin = field.index_to_world[:3, :3], np.abs(field.index_to_world[:3, 3])
    sizes = origin + np.abs(matrix) @ np.array(field.shape[::-1])
    return 2.0**-50 * float((np.abs(np.linalg.inv(matrix)) @ sizes).max())
