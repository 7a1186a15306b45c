"""Values and places along rays, found in bricks: projections, isosurfaces, and where rays have an opacity."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.bricks.probe import begin_probing, make_brick_probing, make_telling
from ..kernels.integrators.found import Found
from ..launch import launch_pixels
from ..probe import Probed
from ..scene import Scene
from .brick import Brick, Caster, aim
from .grid import Index, Rect


class Finder(Caster):
    """Looks for what an integrator that probes finds in bricks, each in the pixels that see it.

    Attributes
    ----------
    found
        ``Found`` of each pixel, (height, width): what its ray has so far.
    only
        The one pixel that is looked at, (x, y); by default all are.
    half
        What bounds have besides, (height, width), of what was not read; None where that is nothing.
    """

    half: NDArray[np.float64] | None = None

    def __init__(self, *scenery: Any, only: tuple[int, int] | None = None):
        super().__init__(*scenery)
        self.only = only
        width, height = self.size
        self.found = wp.empty((height, width), dtype=Found, device=self.keep.device)
        self._launch(begin_probing, self.view, [self.view, self.found])

    def seen_in(self, low: NDArray[np.number], high: NDArray[np.number]) -> Rect | None:
        rect = super().seen_in(low, high)
        if rect is None or self.only is None:
            return rect
        (rows, columns), (x, y) = rect, self.only
        inside = rows.start <= y < rows.stop and columns.start <= x < columns.stop
        return (slice(y, y + 1), slice(x, x + 1)) if inside else None

    def nothing(self) -> Findings:  # type: ignore[override]
        """What is found, of all pixels."""
        width, height = self.size
        return Findings((slice(0, height), slice(0, width)), self.found)

    @property
    def ending(self) -> float:
        """What is through a ray is 1 until all of it is found, and then 0."""
        return 0.5

    def ended(self, image: Any, rect: Rect) -> bool:
        return not image.part(rect).through.any()

    def end(self, image: Any, rect: Rect, front: Any = None) -> None:
        """Nothing is left to be said."""

    def cast(self, index: Index, brick: Brick, image: Any, rect: Rect, front: Any = None) -> None:
        """Look into a brick, in the pixels of its ``footprint``."""
        _, halves, struct, seen = self.prepared(index, brick)
        if seen.skipped < 1.0 or not halves.field.finite:
            # Where all is absent, rays in its faces may be those of the brick beside.
            aim(struct, rect)
            self._launch(make_brick_probing(halves), struct.view, [struct, self.found[rect]])

    def state(self, rect: Rect) -> NDArray[np.uint8]:
        """What rays of some pixels have found so far, as bytes, (h, w, n)."""
        return self._bytes(self.found.numpy())[rect].copy()

    def resume(self, rect: Rect, state: NDArray[np.uint8]) -> None:
        """Have rays of some pixels go on from there."""
        every = self.found.numpy()
        self._bytes(every)[rect] = state
        if not self.keep.device.is_cpu:
            self.found.assign(every)

    @staticmethod
    def _bytes(found: NDArray) -> NDArray[np.uint8]:
        return found.view(np.uint8).reshape(*found.shape, found.dtype.itemsize)

    def told(self) -> Probed:
        """What all that was found comes to."""
        width, height = self.size
        every = slice(0, height), slice(0, width)
        # Nothing is asked of samples any more; all else is that of any brick.
        few = tuple(np.minimum(self.scene.volume.shape, 2))
        blank = Brick(np.zeros(few, self.scene.volume.dtype), np.zeros(3, np.int64), self.scene.volume)  # type: ignore[attr-defined]
        _, halves, struct, _ = self.prepared((0, 0, 0), blank)
        aim(struct, every)
        device = self.keep.device
        rgba = wp.empty((height, width), dtype=wp.vec4d, device=device)
        samples = wp.empty((height, width), dtype=int, device=device)
        numbers = [wp.empty((height, width), dtype=wp.float64, device=device) for _ in range(3)]
        self._launch(make_telling(halves), struct.view, [struct, self.found, rgba, samples, *numbers])
        bounds, values, depths = numbers
        return Probed(rgba, samples, bounds, values, depths, 0.0)

    def _launch(self, kernel: wp.Kernel, view: Any, inputs: list[Any]) -> None:
        launch_pixels(kernel, inputs, self.keep.device, view)
        wp.synchronize_device(self.keep.device)


def caster_of(scene: Scene, *scenery: Any, only: tuple[int, int] | None = None) -> Caster:
    """What renders bricks of a scene, as of ``Caster``, or looks into them."""
    return Finder(scene, *scenery, only=only) if scene.integrator.probes else Caster(scene, *scenery)


class Findings:
    """What is found in some of the pixels, in place of the image of a part."""

    def __init__(self, rect: Rect, found: wp.array):
        self.rect, self._found = rect, found

    @property
    def through(self) -> NDArray[np.float64]:
        """(h, w): 1 where more is asked for."""
        return 1.0 - self._found.numpy()["done"]

    @property
    def values(self) -> NDArray[np.float64]:
        """(h, w): so far."""
        return self._found.numpy()["value"]

    def part(self, rect: Rect) -> Findings:
        """Some of them."""
        return Findings(rect, self._found[rect])

    def at(self, rect: Rect) -> Rect:
        """Where some pixels are in its arrays."""
        rows, columns = (
            slice(part.start - own.start, part.stop - own.start) for own, part in zip(self.rect, rect, strict=True)
        )
        return rows, columns
