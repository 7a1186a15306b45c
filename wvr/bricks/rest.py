"""Sums along rays, and isosurfaces, of what a budget allows, or of what can be read: the rest is in the bound.

For a sum bricks are read first whose samples have the largest range. For isosurfaces they are read from the camera
outwards, and where a ray meets one that was not read, whatever may be behind what it has found is in its bound.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.bricks.rest import Sums, settle_for_sums, settle_for_surfaces
from ..launch import launch_pixels
from .allowance import Allowance
from .blocks import BrickReader
from .extremes import struct_of
from .finder import Finder
from .grid import Index

if TYPE_CHECKING:
    from .streamed import Streamed


class Rest:
    """Bricks that were not read.

    Attributes
    ----------
    numbers
        (z, y, x) of bricks among the ranges, negative of those that were read.
    """

    def __init__(self, march: Streamed):
        self.march = march
        assert isinstance(march.caster, Finder)
        self.caster: Finder = march.caster
        self.numbers = np.full(march.limits.shape[:-1], -1, np.int32)
        for index in march.order:
            self.numbers[index[::-1]] = march.number(index)
        width, height = self.caster.size
        self.half = wp.zeros((height, width), dtype=wp.float64, device=march.keep.device)

    @property
    def order(self) -> list[Index]:
        """Bricks as they are to be read."""
        march = self.march
        if self.caster.scene.integrator.surfaces or not march.reading.budgeted:
            return march.order
        spread = np.subtract(march.limits[..., 1], march.limits[..., 0])
        return sorted(march.order, key=lambda index: -spread[index[::-1]])

    @property
    def partly(self) -> bool:
        """Whether something may be cut away or absent, nobody knows where."""
        scene = self.caster.scene
        return bool(scene.clips) or scene.segmentation is not None or not scene.volume.half.finite

    def settle(self, numbers: NDArray[np.int32], found: wp.array) -> None:
        """Have what rays found, and ``half`` of how far it may be off, with bricks of those numbers not read."""
        march, scene, view = self.march, self.caster.scene, self.caster.view
        least, most = np.moveaxis(march.limits, -1, 0)
        struct = struct_of(march, numbers, least, most)
        struct.brightest = scene.brightest
        view.width, view.height = self.caster.size
        kernel, inputs = settle_for_surfaces, [view, struct, found, self.half]
        if not scene.integrator.surfaces:
            sums = Sums()
            sums.mean, sums.unit = scene.integrator.what == "mean", scene.unit  # type: ignore[attr-defined]
            sums.partly = self.partly
            kernel, inputs = settle_for_sums, [view, struct, sums, found, self.half]
        launch_pixels(kernel, inputs, march.keep.device, view)
        wp.synchronize_device(march.keep.device)


def render(march: Streamed, blocks: BrickReader, allowance: Allowance) -> tuple[Any, int]:
    """What rays find, and how many bricks were looked into."""
    rest = Rest(march)
    caster, order = rest.caster, rest.order
    image: Any = caster.nothing()
    cast, lost = 0, set()
    if allowance.seconds is not None:
        with allowance.work("all"):
            rest.settle(rest.numbers, wp.clone(caster.found))
            rest.half.zero_()

    def ends() -> bool:
        return allowance.ends(blocks.bytes, allowance.expected("brick") + allowance.expected("all"))

    for index, read in march.through(blocks, image, order, allowance, ends):
        cast += read is not None
        if read is not False:
            rest.numbers[index[::-1]] = -1
            continue
        lost.add(index)
        if caster.scene.integrator.surfaces:
            # Before anything behind it is found.
            one = np.where(rest.numbers == march.number(index), rest.numbers, -1)
            rest.settle(one, caster.found)
    march.rest = [index for index in order if rest.numbers[index[::-1]] >= 0 and index not in lost]
    rest.settle(rest.numbers, caster.found)
    caster.half = rest.half.numpy()
    return image, cast
