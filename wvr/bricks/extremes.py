"""Largest or smallest values along rays: bricks in the order of what is in them at most.

Each ray says in which brick there may be most, by the ranges of samples, if that is more than what it has found; all of
these are read, and rays asked again. So what is read is what nobody could leave out: where a range goes beyond the
largest value of a ray in the end. Under a budget the rest is in the bound: the value is then between the largest of
what was found and of what bricks that were not read have at least, and the largest of what those have at most.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.bricks.tops import ask_for_most, settle_for_middles
from ..kernels.bricks.unread import Unread
from ..launch import launch_pixels
from .allowance import Allowance
from .blocks import BrickReader
from .finder import Finder
from .grid import FAR, Index

if TYPE_CHECKING:
    from .streamed import Streamed

Floats = NDArray[np.float64]
# Rays along an axis that are asked first, while they find something.
RAYS = 128
# Bricks that are read under a budget before rays are asked again.
FEW = 16


class Extremes:
    """Bricks of which some are read, and what there is in the others at most."""

    def __init__(self, march: Streamed):
        self.march = march
        assert isinstance(march.caster, Finder)
        self.caster: Finder = march.caster
        scene, volume = self.caster.scene, march.volume
        every = (0, 1, 2)
        tops = march.tops.max(axis=every)
        low, high = np.moveaxis(march.limits, -1, 0)
        least = low if scene.integrator.seeks > 0 else -high
        partly = scene.clips or scene.segmentation is not None or not volume.half.finite
        # What is cut away or absent is not there.
        self.least = np.full(tops.shape, -np.inf) if partly else least
        self.tops = tops
        numbers = np.arange(tops.size, dtype=np.int32).reshape(tops.shape)
        there = np.zeros(tops.shape, bool)
        for index in march.order:
            there[index[::-1]] = True
        self.numbers = np.where(there, numbers, -1).astype(np.int32)
        # Those that could not be read.
        self.lost: set[Index] = set()

    def next(self, allowance: Allowance) -> list[Index]:
        """Bricks to be read now, those first that most rays ask for; none where no ray may find more."""
        width, height = self.caster.size
        only = self.caster.only
        steps = [1] if only else sorted({max(1, min(width, height) // RAYS), 1}, reverse=True)
        numbers = self.numbers.copy()
        for index in self.lost:
            numbers[index[::-1]] = -1
        for step in steps:
            struct = struct_of(self.march, numbers, self.least, self.tops)
            struct.stride = step
            shape = -(-height // step), -(-width // step)
            asked = wp.empty(shape, dtype=int, device=self.caster.keep.device)
            with allowance.work("ray", asked.size):
                self._launch(ask_for_most, struct, [asked], shape)
            found = asked.numpy() if only is None else asked.numpy()[only[1], only[0]]
            counts = np.bincount(found[found >= 0], minlength=1)
            if counts.any():
                order = np.argsort(-counts, kind="stable")[: np.count_nonzero(counts)]
                return [tuple(map(int, np.unravel_index(n, numbers.shape)))[::-1] for n in order]  # type: ignore[misc]
        return []

    def done(self, index: Index) -> None:
        """No ray finds more in a brick."""
        self.numbers[index[::-1]] = -1

    def settle(self) -> NDArray[np.float64] | None:
        """Have values in the middle of what they may be, and half of how far that is; None where all is known."""
        if not (self.numbers >= 0).any():
            return None
        width, height = self.caster.size
        half = wp.zeros((height, width), dtype=wp.float64, device=self.caster.keep.device)
        self._launch(
            settle_for_middles, struct_of(self.march, self.numbers, self.least, self.tops), [half], (height, width)
        )
        return half.numpy()

    def _launch(self, kernel: wp.Kernel, struct: Any, outputs: list[wp.array], shape: tuple[int, int]) -> None:
        view, device = self.caster.view, self.caster.keep.device
        view.height, view.width = shape
        launch_pixels(kernel, [view, struct, self.caster.found, *outputs], device, view)
        wp.synchronize_device(device)


def struct_of(march: Streamed, numbers: NDArray[np.int32], least: Floats, most: Floats) -> Any:
    """The struct of kernels for ``numbers`` (z, y, x) of bricks among what those have at least and at most, negative
    where they are left out.
    """
    device = march.keep.device
    struct = Unread()
    for name, along in zip("xyz", march.bricks.edges, strict=True):
        faces = np.array(along, np.float64)
        faces[0], faces[-1] = -FAR, FAR
        setattr(struct, name, wp.array(faces, dtype=wp.float64, device=device))
    struct.number = wp.array(numbers, dtype=int, device=device)
    struct.least = wp.array(least.ravel(), dtype=wp.float64, device=device)
    struct.most = wp.array(most.ravel(), dtype=wp.float64, device=device)
    struct.grain, struct.astray, struct.stride = march.caster.grain, march.caster.view.astray, 1
    return struct


def render(march: Streamed, blocks: BrickReader, allowance: Allowance) -> tuple[Any, int]:
    """What rays find, and how many bricks were looked into."""
    extremes = Extremes(march)
    caster = extremes.caster
    image: Any = caster.nothing()
    place = {index: n for n, index in enumerate(march.order)}
    limited, pixels = march.reading.budgeted, caster.size[0] * caster.size[1]
    cast = 0

    def ends() -> bool:
        # All rays are asked once more in the end.
        return allowance.ends(blocks.bytes, allowance.expected("brick") + allowance.expected("ray", pixels))

    while not ends():
        if not (asked := extremes.next(allowance)):
            # What else there is no ray asks for.
            for index in set(march.order) - extremes.lost:
                extremes.done(index)
            break
        batch = asked[:FEW] if limited else sorted(asked, key=place.__getitem__)
        for index, found in march.through(blocks, image, batch, allowance, ends):
            cast += found is not None
            if found is False:
                extremes.lost.add(index)
            else:
                extremes.done(index)
    march.rest = [index for index in march.order if extremes.numbers[index[::-1]] >= 0]
    caster.half = extremes.settle()
    return image, cast
