"""Which blocks and cells have samples on both sides of a level."""

from functools import cache

import warp as wp

from .blocks import EMPTY, SEVERAL, Blocks, make_mask_of
from .samples import make_samples


@cache
def make_level_kinds(dtype):
    """Kernel ``(base, field, ranges, levels, margin, blocks)`` over rows of blocks along x: cells whose samples are not
    all farther than a margin from each of the levels, and on the same side.
    """
    Field = make_samples(dtype)
    mask_of = make_mask_of(dtype)
    pair = wp.types.vector(2, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def level_kinds(
        base: int,
        field: Field,
        ranges: wp.array3d(dtype=pair),
        levels: wp.array(dtype=wp.float64),
        margin: wp.float64,
        blocks: Blocks,
    ):
        item = wp.tid() + base
        bk = item // ranges.shape[1]
        bj = item - bk * ranges.shape[1]
        for bi in range(ranges.shape[2]):
            span = ranges[bk, bj, bi]
            low = wp.float64(span[0])
            high = wp.float64(span[1])
            mask = wp.uint64(0)  # an array of bits
            for n in range(levels.shape[0]):
                # Blocks of one sample have no crossing, nor have those that are absent.
                if low < high and levels[n] >= low - margin and levels[n] <= high + margin:
                    mask = mask | mask_of(field, bk, bj, bi, levels[n] - margin, levels[n] + margin)
            blocks.masks[bk, bj, bi] = mask
            blocks.kinds[bk, bj, bi] = wp.int16(wp.where(mask == wp.uint64(0), EMPTY, SEVERAL))

    return level_kinds
