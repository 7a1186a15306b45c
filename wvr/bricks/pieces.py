"""Which blocks the cells of a brick need that may be seen.

A brick is its block and the cells between that and its neighbours towards the camera: eight pieces, of cells whose
samples are of one, two, four or eight blocks. What only a piece needs is not read where ranges say that nothing is to
be seen in it, or where no ray meets it that goes on: edges and corners of blocks are missed by most rays.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

from .brick import Caster
from .grid import Index, Rect

# Which cells of which brick: as of ``Pieces.visible``.
Piece = tuple[int, int, int, int, int, int]
# How near to a piece a ray may come that misses it [samples]: far more than any rounding.
NEAR = 1 / 64
# Of so many pixels at most, whether a ray meets a piece is looked at.
MANY = 1 << 14


class Pieces:
    """Of bricks as of ``Bricks.of_chunks``.

    Parameters
    ----------
    visible
        (2, 2, 2, bz, by, bx): in which there may be something to see, as of ``BlockRanges.of_pieces``.
    towards
        The block that the camera is in, or nearest to.
    """

    def __init__(self, caster: Caster, visible: NDArray[np.bool_], towards: Index):
        self.caster, self.visible, self.towards = caster, visible, towards

    def needed(self, index: Index, rect: Rect, going: Callable[[Piece], NDArray[np.bool_]]) -> set[Index]:
        """Blocks that a brick is made of, those that some ray needs.

        Parameters
        ----------
        rect, going
            The pixels of its footprint, and which of their rays go on into a piece of those that are ``visible``.
        """
        # Whether the neighbour towards the camera is before it or behind, along x, y, z.
        sides = [(at > i) - (at < i) for at, i in zip(self.towards, index, strict=True)]
        low, high = self.caster.bricks.box(index)
        blocks: set[Index] = set()
        for seam in product(*((0, 1) if side else (0,) for side in sides)):
            spans = [(i, i + side) if cut else (i,) for i, side, cut in zip(index, sides, seam, strict=True)]
            these: set[Index] = set(product(*spans))  # type: ignore[arg-type]
            piece: Piece = seam[::-1] + index[::-1]  # type: ignore[assignment]
            if these <= blocks or not self.visible[piece]:
                continue
            first, last = low.copy(), high.copy()
            for axis, (side, cut) in enumerate(zip(sides, seam, strict=True)):
                # The cells between are the first ones or the last.
                if side and cut == (side < 0):
                    last[axis] = low[axis] + 1 if cut else high[axis] - 1
                elif side:
                    first[axis] = high[axis] - 1 if cut else low[axis] + 1
            if self._met(first, last, rect, going(piece)):
                blocks |= these
        return blocks

    def _met(self, low: NDArray, high: NDArray, rect: Rect, going: NDArray[np.bool_]) -> bool:
        """Whether a ray that is ``going`` meets the cells between two samples."""
        if not going.any():
            return False
        place = self.caster.seen_in(low, high)
        if place is None:
            return False
        rows, columns = (slice(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(place, rect, strict=True))
        at = (
            slice(rows.start - rect[0].start, rows.stop - rect[0].start),
            slice(columns.start - rect[1].start, columns.stop - rect[1].start),
        )
        going = going[at]
        if going.size > MANY or not going.any():
            return bool(going.any())
        y, x = np.nonzero(going)
        origin, way = self.caster.lines(x + columns.start, y + rows.start)
        near = NEAR + 2 * self.caster.view.astray + 0.5 * (np.array(self.caster.scene.volume.shape[::-1]) == 1)
        faces = np.stack([low - near, high + near])
        with np.errstate(divide="ignore", invalid="ignore"):
            times = np.sort((faces[:, None] - origin) / way, axis=0)
        # A ray across an axis is between the faces all along, or never.
        across, within = way == 0, (origin >= faces[0]) & (origin <= faces[1])
        enter = np.where(across, np.where(within, -np.inf, np.inf), times[0]).max(axis=1)
        leave = np.where(across, np.inf, times[1]).min(axis=1)
        return bool(np.any(leave >= enter))
