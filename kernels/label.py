"""Labels: which transfer function holds along a ray.

Labels with the same transfer function are one state. At a point of a cell the state is that with the largest trilinear
weight, the sum of the weights of the corners that have it; for two states that is the surface where the trilinear
indicator of one is 1/2. Along a ray weights are cubics, and the state changes where another one's outgrows its own.
A state without a transfer function is a number beyond those of the transfer functions.
"""

from functools import cache

import warp as wp

from .blocks import BITS, EMPTY, SEVERAL, make_mask_of, make_visible
from .cell import cubic, rise, vec8d
from .importance import BLOCK, unravel
from .precision import REALS
from .table import make_table
from .transfer import make_transfer, make_transparent
from .walk import ahead, cell_at, entering, leaving

vec8i = wp.types.vector(8, int)

# What a block of cells is, else the state of all its samples.
MIXED = wp.constant(-1)
NOTHING = wp.constant(-2)  # to be seen, whatever the state


@cache
def make_labels(dtype, precision):
    """The struct of states, stored as ``dtype``, and their transfer functions and tables."""
    real = REALS[precision]
    Transfer, _, _ = make_transfer(real)
    Table, _ = make_table(real)

    @wp.struct
    class Labels:
        states: wp.array3d(dtype=dtype)  # [z, y, x] of samples
        blocks: wp.array3d(dtype=int)  # of blocks of cells, as of ``importance``
        transfers: wp.array(dtype=Transfer)  # of the states
        tables: wp.array(dtype=Table)

    return Labels


@cache
def make_strongest():
    """Of the states of a cell's corners: ``strongest(states, local, direction)`` -> state, weight, and
    ``indicated(states, state, local, direction)`` -> weight of a state along a ray.
    """

    @wp.func
    def strongest(states: vec8i, local: wp.vec3d, direction: wp.vec3d):
        """State of the largest weight at a point of a cell, and where on the ray another one's outgrows it."""
        state = int(0)
        weight = wp.vec4d(-1.0, 0.0, 0.0, 0.0)
        for n in range(8):
            w = indicated(states, states[n], local, direction)
            if w[0] > weight[0] or (w[0] == weight[0] and states[n] < state):
                state = states[n]
                weight = w
        return state, weight

    @wp.func
    def indicated(states: vec8i, state: int, local: wp.vec3d, direction: wp.vec3d):
        """Weight of a state along a ray."""
        indicator = vec8d()
        for n in range(8):
            indicator[n] = wp.where(states[n] == state, wp.float64(1.0), wp.float64(0.0))
        return cubic(indicator, local, direction)

    return strongest, indicated


@cache
def make_label_at(dtype, precision):
    """``label_at(labels, last, p)``: the state of a point."""
    Labels = make_labels(dtype, precision)
    strongest, _ = make_strongest()

    @wp.func
    def label_at(labels: Labels, last: wp.vec3i, p: wp.vec3d):
        cell = cell_at(last, p)
        found = labels.blocks[cell[2] // BLOCK, cell[1] // BLOCK, cell[0] // BLOCK]
        if found == MIXED:
            states = vec8i()
            for n in range(8):
                states[n] = int(labels.states[cell[2] + (n >> 2), cell[1] + ((n >> 1) & 1), cell[0] + (n & 1)])
            found = states[0]
            if wp.min(states) != wp.max(states):
                local = p
                for a in range(3):
                    local[a] -= wp.float64(cell[a])
                found, _weight = strongest(states, local, wp.vec3d())
        return found

    return label_at


@cache
def make_label_span(dtype, precision):
    """``label_span(labels, last, origin, direction, t, length)``: a ray's state from t on, and until where."""
    Labels = make_labels(dtype, precision)
    strongest, indicated = make_strongest()

    @wp.func
    def label_span(
        labels: Labels, last: wp.vec3i, origin: wp.vec3d, direction: wp.vec3d, t: wp.float64, length: wp.float64
    ):
        state = int(NOTHING)
        here = ahead(t)
        cell = cell_at(last, origin + here * direction)
        while here < length:
            found = labels.blocks[cell[2] // BLOCK, cell[1] // BLOCK, cell[0] // BLOCK]
            size = int(BLOCK)
            states = vec8i()
            if found == MIXED:
                size = 1
                for n in range(8):
                    states[n] = int(labels.states[cell[2] + (n >> 2), cell[1] + ((n >> 1) & 1), cell[0] + (n & 1)])
                if wp.min(states) == wp.max(states):
                    found = states[0]
            end, axis = leaving(last, origin, direction, cell, size)
            stop = wp.min(end, length)
            if stop > here and found != NOTHING:
                if found == MIXED:
                    local = origin + here * direction
                    for a in range(3):
                        local[a] -= wp.float64(cell[a])
                    found, weight = strongest(states, local, direction)
                    if state == NOTHING:
                        state = found
                    weight = indicated(states, state, local, direction)
                    change = stop - here
                    for n in range(8):
                        if states[n] != state:
                            over = indicated(states, states[n], local, direction) - weight
                            change = wp.min(change, rise(over, stop - here))
                    if change < stop - here:
                        return state, here + change
                elif state == NOTHING:
                    state = found
                elif state != found:
                    return state, here
            here = wp.max(here, stop)
            if end < length:
                cell = entering(last, origin, direction, cell, size, end, axis)
        return state, length

    return label_span


@cache
def make_label_blocks(dtype, real):
    """Kernel ``(base, states, transfers, ranges, shift, skip, blocks, empty)`` over blocks of cells: their states, and
    whether nothing in them has any extinction.
    """
    Transfer, _, _ = make_transfer(real)
    transparent = make_transparent(real)

    @wp.kernel(enable_backward=False, module="unique")
    def label_blocks(
        base: int,
        states: wp.array3d(dtype=dtype),
        transfers: wp.array(dtype=Transfer),
        ranges: wp.array3d(dtype=wp.vec2d),
        shift: wp.float64,
        skip: bool,
        blocks: wp.array3d(dtype=int),
        empty: wp.array3d(dtype=wp.uint8),
    ):
        bk, bj, bi = unravel(wp.tid() + base, blocks.shape[1], blocks.shape[2])
        low = real(ranges[bk, bj, bi][0] - shift)
        high = real(ranges[bk, bj, bi][1] - shift)
        found = int(NOTHING)
        before = int(-1)
        clear = bool(True)
        for k in range(bk * BLOCK, wp.min(bk * BLOCK + BLOCK + 1, states.shape[0])):
            for j in range(bj * BLOCK, wp.min(bj * BLOCK + BLOCK + 1, states.shape[1])):
                for i in range(bi * BLOCK, wp.min(bi * BLOCK + BLOCK + 1, states.shape[2])):
                    state = int(states[k, j, i])
                    if state != before:
                        found = wp.where(found == NOTHING, state, MIXED)
                        if state < transfers.shape[0] and low <= high:
                            clear = clear and transparent(transfers[state], low, high)
                        before = state
        clear = clear and skip
        blocks[bk, bj, bi] = wp.where(clear, NOTHING, found)
        empty[bk, bj, bi] = wp.where(clear, wp.uint8(1), wp.uint8(0))

    return label_blocks


@cache
def make_label_kinds(dtype, states_dtype):
    """Kernel ``(base, data, states, ranges, shift, transfers, kinds, masks)`` over small blocks of cells: which cells
    may see extinction by the state of any of the block's samples. No kind is that of an interval: a cell does not know
    yet by which transfer function it will be seen.
    """
    Transfer, _, _ = make_transfer(wp.float64)
    visible = make_visible()
    mask_of = make_mask_of(dtype)
    transparent = make_transparent(wp.float64)
    pair = wp.types.vector(2, dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def label_kinds(
        base: int,
        data: wp.array3d(dtype=dtype),
        states: wp.array3d(dtype=states_dtype),
        ranges: wp.array3d(dtype=pair),
        shift: wp.float64,
        transfers: wp.array(dtype=Transfer),
        kinds: wp.array3d(dtype=wp.int16),
        masks: wp.array3d(dtype=wp.uint64),
    ):
        bk, bj, bi = unravel(wp.tid() + base, masks.shape[1], masks.shape[2])
        low = wp.float64(ranges[bk, bj, bi][0])
        high = wp.float64(ranges[bk, bj, bi][1])
        # Nothing is visible up to ``first`` nor from ``last`` on, whatever the state.
        first = wp.float64(wp.inf)
        last = -wp.float64(wp.inf)
        before = int(-1)
        if low <= high:
            for k in range(bk << BITS, wp.min((bk + 1 << BITS) + 1, data.shape[0])):
                for j in range(bj << BITS, wp.min((bj + 1 << BITS) + 1, data.shape[1])):
                    for i in range(bi << BITS, wp.min((bi + 1 << BITS) + 1, data.shape[2])):
                        state = int(states[k, j, i])
                        if state != before and state < transfers.shape[0]:
                            tf = transfers[state]
                            if not transparent(tf, low - shift, high - shift):
                                a, b = visible(tf, low - shift, high - shift)
                                first = wp.min(first, a)
                                last = wp.max(last, b)
                        before = state
        kind = int(EMPTY)
        mask = wp.uint64(0)
        if first < last:
            kind = SEVERAL
            mask = mask_of(data, shift, bk, bj, bi, first, last)
        kinds[bk, bj, bi] = wp.int16(kind)
        masks[bk, bj, bi] = mask

    return label_kinds
