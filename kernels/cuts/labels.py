"""Labels: which transfer function holds along a ray.

Labels with the same transfer function are one state. At a point of a cell the state is that with the largest trilinear
weight, the sum of the weights of the corners that have it; for two states that is the surface where the trilinear
indicator of one is 1/2. Along a ray weights are cubics, and the state changes where another one's outgrows its own.
A state without a transfer function is a number beyond those of the transfer functions.
"""

from functools import cache

import warp as wp

from ..field.blocks import BITS, EMPTY, SEVERAL, Blocks, make_mask_of, unravel
from ..field.cell import cubic, length_within, rise, vec8d
from ..field.samples import make_samples, make_whole
from ..field.walk import ahead, cell_at, make_walk
from ..transfer.function import make_transfer, make_transparent, make_visible
from ..transfer.lookup import make_table

vec8i = wp.types.vector(8, int)

# What a block of cells is, else the state of all its samples.
MIXED = wp.constant(-1)
NOTHING = wp.constant(-2)  # to be seen, whatever the state

# What one weight's lead over another's may be off by, but for where the ray is.
ROUNDED = wp.constant(2.0**-44)


@cache
def make_labels(dtype, real):
    """The struct of states, stored as ``dtype``, and their transfer functions and tables."""
    Transfer, _, _ = make_transfer(real)
    Table, _ = make_table(real)
    Field = make_samples(dtype)

    @wp.struct
    class Labels:
        states: Field
        blocks: wp.array3d(dtype=int)  # of blocks of cells
        transfers: wp.array(dtype=Transfer)  # of the states
        tables: wp.array(dtype=Table)  # theirs, for integrators that look segments up

    return Labels


@cache
def make_states(dtype):
    """``states_of(field, i, j, k)``: the states of a cell's corners, x fastest."""
    Field, whole = make_whole(dtype)

    @wp.func
    def states_of(field: Field, i: int, j: int, k: int):
        states = vec8i()
        for n in range(8):
            states[n] = whole(field, i + (n & 1), j + ((n >> 1) & 1), k + (n >> 2))
        return states

    return states_of


@wp.func
def indicated(states: vec8i, state: int, local: wp.vec3d, direction: wp.vec3d):
    """Weight of a state along a ray, of the states of a cell's corners."""
    indicator = vec8d()
    for n in range(8):
        indicator[n] = wp.where(states[n] == state, wp.float64(1.0), wp.float64(0.0))
    return cubic(indicator, local, direction)


@wp.func
def strongest(states: vec8i, local: wp.vec3d, near: wp.float64):
    """The state of the largest weight at a point of a cell, of the states of its corners; of those that are as large
    but for ``near`` the first.
    """
    weights = vec8d()
    for n in range(8):
        weights[n] = indicated(states, states[n], local, wp.vec3d())[0]
    least = wp.max(weights) - near
    state = wp.max(states)
    for n in range(8):
        if weights[n] >= least:
            state = wp.min(state, states[n])
    return state


@wp.func
def but_for(states: vec8i, state: int):
    """The states of a cell's corners, each once: others are ``state``, as are those that are it."""
    once = states
    for n in range(8):
        for m in range(n):
            if states[m] == states[n]:
                once[n] = state
    return once


@cache
def make_label_at(dtype, real):
    """``label_at(labels, p)``: the state of a point, on a boundary the same on whichever side rounding puts p."""
    Labels = make_labels(dtype, real)
    states_of = make_states(dtype)
    near = 2.0**-18 if real is wp.float32 else 2.0**-40

    @wp.func
    def label_at(labels: Labels, p: wp.vec3d):
        cell = cell_at(labels.states.last, p)
        found = labels.blocks[cell[2] >> BITS, cell[1] >> BITS, cell[0] >> BITS]
        if found == MIXED:
            states = states_of(labels.states, cell[0], cell[1], cell[2])
            found = states[0]
            if wp.min(states) != wp.max(states):
                local = p
                for a in range(3):
                    local[a] -= wp.float64(cell[a])
                found = strongest(states, local, wp.float64(near))
        return found

    return label_at


@cache
def make_label_span(dtype, real, bounded=False):
    """``label_span(labels, origin, direction, t, length, astray)``: a ray's state from t on, and until where; and
    ``bounded``, the length in which it may be another's that is ``astray`` by so much (docs/proof.md, lemma 11).
    """
    Labels = make_labels(dtype, real)
    states_of = make_states(dtype)
    _, enter, leap, _ = make_walk(wp.float64)

    @wp.func
    def label_span(
        labels: Labels,
        origin: wp.vec3d,
        direction: wp.vec3d,
        t: wp.float64,
        length: wp.float64,
        astray: wp.float64,
    ):
        state = int(NOTHING)
        loose = wp.float64(0.0)
        w = enter(labels.states.last, origin, direction, ahead(t))
        while w.t < length:
            i = wp.max(w.cell[0], 0)
            j = wp.max(w.cell[1], 0)
            k = wp.max(w.cell[2], 0)
            found = labels.blocks[k >> BITS, j >> BITS, i >> BITS]
            bits = int(BITS)
            states = vec8i()
            if found == MIXED:
                bits = 0
                states = states_of(labels.states, i, j, k)
                if wp.min(states) == wp.max(states):
                    found = states[0]
            after = leap(w, bits, 0)
            after.t = wp.where(after.t >= w.out, length, wp.min(after.t, length))
            if after.t > w.t and found != NOTHING:
                if found == MIXED:
                    local = origin + w.t * direction - wp.vec3d(wp.float64(i), wp.float64(j), wp.float64(k))
                    if state == NOTHING:
                        state = strongest(states, local, wp.float64(0.0))
                    weight = indicated(states, state, local, direction)
                    change = after.t - w.t
                    others = but_for(states, state)
                    for n in range(8):
                        if others[n] != state:
                            lead = indicated(states, others[n], local, direction) - weight
                            # Beyond rounding: a ray in the boundary would change sides without end.
                            lead[0] -= wp.float64(ROUNDED)
                            change = wp.min(change, rise(lead, change))
                    if wp.static(bounded):
                        near = wp.float64(12.0) * astray + wp.float64(ROUNDED)
                        for n in range(8):
                            if others[n] != state:
                                lead = indicated(states, others[n], local, direction) - weight
                                loose += length_within(lead, change, near)
                    if change < after.t - w.t:
                        return state, w.t + change, loose
                elif state == NOTHING:
                    state = found
                elif state != found:
                    return state, w.t, loose
            w = after
        return state, length, loose

    return label_span


@cache
def make_label_kinds(field, dtype):
    """Kernel ``(base, data, states, ranges, transfers, skip, blocks, held)`` over blocks of cells of a ``field`` and of
    states stored as ``dtype``: which blocks and cells may see extinction by the state of any of the block's samples,
    all of them unless they ``skip``; and which states the blocks hold. No kind is that of an interval: a cell does not
    know yet by which transfer function it will be seen.
    """
    Transfer, _, _ = make_transfer(wp.float64)
    Field = field.Struct
    States, whole = make_whole(dtype)
    visible = make_visible()
    mask_of = make_mask_of(field.dtype)
    _, transparent = make_transparent(wp.float64)
    pair = wp.types.vector(2, field.dtype)

    @wp.kernel(enable_backward=False, module="unique")
    def label_kinds(
        base: int,
        data: Field,
        states: States,
        ranges: wp.array3d(dtype=pair),
        transfers: wp.array(dtype=Transfer),
        skip: bool,
        blocks: Blocks,
        held: wp.array3d(dtype=int),
    ):
        bk, bj, bi = unravel(wp.tid() + base, held.shape[1], held.shape[2])
        span = ranges[bk, bj, bi]
        low = wp.float64(span[0]) - data.shift
        high = wp.float64(span[1]) - data.shift
        # Nothing is visible up to ``first`` nor from ``last`` on, whatever the state.
        first = wp.float64(wp.inf)
        last = -wp.float64(wp.inf)
        found = int(NOTHING)
        before = int(-1)
        for k in range(bk << BITS, wp.min(bk + 1 << BITS, states.last[2] + 1) + 1):
            for j in range(bj << BITS, wp.min(bj + 1 << BITS, states.last[1] + 1) + 1):
                for i in range(bi << BITS, wp.min(bi + 1 << BITS, states.last[0] + 1) + 1):
                    state = whole(states, i, j, k)
                    if state != before:
                        before = state
                        found = wp.where(found == NOTHING or found == state, state, MIXED)
                        if state < transfers.shape[0] and low <= high:
                            tf = transfers[state]
                            if not transparent(tf, low, high):
                                a, b = visible(tf, low, high)
                                first = wp.min(first, a)
                                last = wp.max(last, b)
        kind = int(SEVERAL)
        mask = ~wp.uint64(0)
        if skip:
            if first < last:
                mask = mask_of(data, bk, bj, bi, first, last)
            else:
                kind = EMPTY
                mask = wp.uint64(0)
                found = NOTHING
        blocks.kinds[bk, bj, bi] = wp.int16(kind)
        blocks.masks[bk, bj, bi] = mask
        held[bk, bj, bi] = found

    return label_kinds
