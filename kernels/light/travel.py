"""Light that travels from slice to slice.

Slices are planes across the axis of a sweep, numbered the way light goes. Light is kept in a frame that travels with
it: its cells are squares across its own direction, or fan out from the camera for a headlight in perspective, so that
nothing is displaced, however tilted light is. From slice to slice it obeys ``dL/dl = D laplace(L) - tau L`` by
splitting (Angelelli and Bruckner 2017, section 3, made convergent): a share of the slab's attenuation, diffusion, the
rest. The step of diffusion is ``I + G + G^2 / 2``, G the five-point Laplacian: of second order, not only its moments.
All updates are differences, so that float32 loses nothing where little happens.

Cells go in runs of ``RUN`` along a row, which compilers turn into a few wide instructions. Only tiles with blocks in
them that are not empty look at the volume, and tiles that no shadow has reached are left as they are.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field.blocks import BITS, EMPTY
from ..precision import vec3_of
from ..segment import make_absorbed
from .lanes import Ways, absorbed_of, lanes_of
from .tissue import make_depth

RUN = wp.constant(8)
# Slabs and rows of a tile, which has the columns of a run.
SLABS = wp.constant(2)
ROWS = wp.constant(4)
# Cells of full light around all others, so that none has to ask whether it has neighbours; one run to either side.
BORDER = wp.constant(2)


@wp.struct
class Sweep:
    """Depth z along the axis and all lengths in units of the smallest voxel spacing."""

    start: wp.float64  # z of slice 0
    thickness: wp.float64  # of a slab
    slices: int
    parts: int  # that a slab is sampled in
    ahead: wp.vec3d  # z = dot(ahead, p) + offset, p in index coordinates
    offset: wp.float64
    diverging: bool  # a cell's width grows with z, and is that at z = 1
    across: wp.mat33d  # rows 0, 1: u, v = across p + shift; over z if diverging; then less corner
    shift: wp.vec3d
    corner: wp.vec2d  # u, v of cell (0, 0)
    origin: wp.vec3d  # p = origin + z along + (u + corner) side[0] + (v + corner) side[1]; times z if diverging
    along: wp.vec3d
    side: wp.mat33d  # columns 0, 1
    slant: wp.float64  # length of light's way over that along the axis
    widening: wp.float64  # square of a cell's width where z = 1, if diverging
    before: wp.float64  # share of a slab's attenuation before diffusion
    after: wp.float64
    reach: wp.float64  # length that light which tissue receives is traced back
    steps: int  # in so many parts
    lead: int  # slices of the stack before those that the eye passes
    pairs: wp.array2d(dtype=wp.vec2)  # where tissue is seen in vectors, the table's extinctions [i, j] and [i + 1, j]


@dataclass(frozen=True)
class Half:
    """The device half of a sweep, in place of an integrator's: what ``scene.march`` is, and how tissue is seen."""

    preintegrated: bool  # by a table of the scalars at both ends, else by the scalar in the middle
    traced: bool = True  # light that dense tissue receives is traced back to slices

    @property
    def tabled(self):
        return self.preintegrated

    def Struct(self, halves):
        return Sweep


@wp.struct
class Shade:
    """Where light may be shaded."""

    occupied: wp.array3d(dtype=wp.uint8)  # [z, y, x] of tiles
    touched: wp.array2d(dtype=wp.uint8)  # of tiles, with a border of one: which may have less than full light
    items: int  # of a launch over slices, of each row
    octants: wp.array4d(dtype=wp.uint8)  # as of ``strides``, where tissue is seen in vectors


def run_of(real):
    """Light of a run of cells."""
    return wp.types.vector(int(RUN), real)


@cache
def make_less(real):
    """``less(a, b)``: whether any cell of a run has less than that of another. In one instruction, where a ``min`` of
    eight numbers goes one after the other and looks for NaN.
    """
    Run = run_of(real)

    @wp.func_native("bool any = false;\nfor (int n = 0; n < 8; ++n) any |= a[n] < b[n];\nreturn any;\n")
    def less(a: Run, b: Run) -> bool: ...

    return less


@cache
def make_state(real):
    """The struct of the light that travels, in runs of cells."""
    Run = run_of(real)

    @wp.struct
    class State:
        light: wp.array3d(dtype=Run)  # two slices, by turns what is and what becomes, with a border
        rest: wp.array2d(dtype=Run)  # of a slab's attenuation, after diffusion
        stack: wp.array3d(dtype=Run)  # slices that are through

    return State


@cache
def make_way(real):
    """``way_of(sweep, z, i, j)`` -> where a cell is at depth z, the way of its light per unit of depth, and that way's
    length; i and j need not be whole.
    """

    @wp.func
    def way_of(sweep: Sweep, z: wp.float64, i: real, j: real):
        u = wp.float64(i) + sweep.corner[0]
        v = wp.float64(j) + sweep.corner[1]
        w = u * wp.vec3d(sweep.side[0, 0], sweep.side[1, 0], sweep.side[2, 0]) + v * wp.vec3d(
            sweep.side[0, 1], sweep.side[1, 1], sweep.side[2, 1]
        )
        p = sweep.origin + z * sweep.along
        if sweep.diverging:
            return p + z * w, sweep.along + w, wp.sqrt(wp.float64(1.0) + sweep.widening * (u * u + v * v))
        return p + w, sweep.along, sweep.slant

    return way_of


def make_depths(halves, measured):
    """``depths`` of ``make_travel`` in vectors."""
    Run = run_of(halves.real)
    Scene = halves.Scene
    less = make_less(halves.real)
    way_of = make_way(halves.real)

    @wp.func
    def slant(sweep: Sweep, i: int, j: int):
        if not sweep.diverging:
            return wp.float32(sweep.slant)
        u = wp.float32(wp.float64(i) + sweep.corner[0])
        v = wp.float32(wp.float64(j) + sweep.corner[1])
        return wp.sqrt(wp.float32(1.0) + wp.float32(sweep.widening) * (u * u + v * v))

    @wp.func
    def depths(scene: Scene, shade: Shade, z: wp.float64, i: int, j: int, L: Run):
        sweep = scene.march
        if not less(Run(wp.float32(1.0e-6)), L):
            return Run()
        ways = Ways()
        p, d, _ = way_of(sweep, z, wp.float32(i), wp.float32(j))
        ways.p = p
        side = wp.vec3d(sweep.side[0, 0], sweep.side[1, 0], sweep.side[2, 0])
        ways.p_step = side
        if sweep.diverging:
            ways.p_step = z * side
            ways.d_step = sweep.thickness * side
        ways.d = sweep.thickness * d
        cells = int(RUN)
        for n in range(cells):
            ways.lengths[n] = wp.float32(sweep.thickness) * slant(sweep, i + n, j)
        view = scene.view
        table = scene.table
        low = view.low
        return measured(scene.field, table, sweep.pairs, shade.octants, low, view.high, ways, sweep.parts)

    return depths


@cache
def make_travel(halves):
    """The kernels ``occupy`` and ``travel`` of a sweep."""
    real = halves.real
    vec3 = vec3_of(real)
    Run = run_of(real)
    State = make_state(real)
    Scene = halves.Scene
    less = make_less(real)
    absorbed, _ = make_absorbed(real)
    depth = make_depth(halves)
    way_of = make_way(real)

    @wp.func
    def opacities(D: Run):
        A = Run()
        cells = int(RUN)  # not a constant: the loop stays one
        for n in range(cells):
            A[n] = absorbed(D[n])
        return A

    @wp.func
    def depths(scene: Scene, shade: Shade, z: wp.float64, i: int, j: int, L: Run):
        """Of a slab from z on, those of a run of cells in which there is light L."""
        sweep = scene.march
        D = Run()
        cells = int(RUN)
        for n in range(cells):
            # What is left behind a transparency of 1e-6 can be seen by nobody.
            if L[n] > real(1.0e-6):
                p, d, slant = way_of(sweep, z, real(i + n), real(j))
                length = real(slant * sweep.thickness)
                D[n] = depth(scene, vec3(p), vec3(sweep.thickness * d), length, sweep.parts)
        return D

    lanes = lanes_of(halves)
    if lanes is not None:
        depths, opacities = make_depths(halves, lanes.depths), absorbed_of

    @wp.func
    def on1(a: Run, b: Run):
        return Run(a[1], a[2], a[3], a[4], a[5], a[6], a[7], b[0])

    @wp.func
    def on2(a: Run, b: Run):
        return Run(a[2], a[3], a[4], a[5], a[6], a[7], b[0], b[1])

    @wp.func
    def back1(a: Run, b: Run):
        return Run(a[7], b[0], b[1], b[2], b[3], b[4], b[5], b[6])

    @wp.func
    def back2(a: Run, b: Run):
        return Run(a[6], a[7], b[0], b[1], b[2], b[3], b[4], b[5])

    @wp.kernel(enable_backward=False, module="unique")
    def occupy(base: int, scene: Scene, every: int, result: wp.array3d(dtype=wp.uint8)):
        """Whether the smallest box around a tile has a block in it that is not empty: two tiles together along each
        axis, then each if those have. The items of a row, of two rows of tiles, take them by turns.
        """
        sweep = scene.march
        item = wp.tid() + base
        rows = (result.shape[1] + 1) // 2
        row = item // every
        z = 2 * (row // rows)
        y = 2 * (row - (row // rows) * rows)
        across = wp.vec3d(sweep.side[0, 0], sweep.side[1, 0], sweep.side[2, 0])
        down = wp.vec3d(sweep.side[0, 1], sweep.side[1, 1], sweep.side[2, 1])
        deep = wp.float64(wp.static(float(int(SLABS)))) * sweep.thickness
        none = wp.vec3d()
        for x in range(2 * (item - row * every), result.shape[2], 2 * every):
            n = int(0)
            while n < 9:
                # First all eight, then one by one.
                number = wp.max(n - 1, 0)
                i = x + (number & 1)
                j = y + ((number >> 1) & 1)
                k = z + (number >> 2)
                size = wp.where(n == 0, 2, 1)
                n += 1
                if i >= result.shape[2] or j >= result.shape[1] or k >= result.shape[0]:
                    continue
                # All that is linear in places in slices is least and most in corners.
                columns = wp.float64(size * RUN - 1) * across
                lines = wp.float64(size * ROWS - 1) * down
                less = wp.min(columns, none) + wp.min(lines, none)
                more = wp.max(columns, none) + wp.max(lines, none)
                near = sweep.start + wp.float64(k) * deep
                far = near + wp.float64(size) * deep
                p, way, _length = way_of(sweep, near, real(i * RUN), real(j * ROWS))
                onward = (far - near) * way
                low = p + less + wp.min(onward, none)
                high = p + more + wp.max(onward, none)
                if sweep.diverging:
                    low = sweep.origin + wp.min(near * (way + less), far * (way + less))
                    high = sweep.origin + wp.max(near * (way + more), far * (way + more))
                occupied = bool(True)
                first = wp.vec3i()
                last = wp.vec3i()
                for a in range(3):
                    # As much wider as positions may be rounded.
                    margin = wp.float64(1.0e-3)
                    if high[a] + margin < scene.view.seen_low[a] or low[a] - margin > scene.view.seen_high[a]:
                        occupied = False
                    most = wp.float64(scene.field.last[a])
                    first[a] = int(wp.clamp(low[a] - margin, wp.float64(0.0), most)) >> BITS
                    last[a] = int(wp.clamp(high[a] + margin, wp.float64(0.0), most)) >> BITS
                if occupied:
                    # Empty blocks know how far others are: often the one in the middle says it all.
                    middle = (first + last) / 2
                    kind = int(scene.blocks.kinds[middle[2], middle[1], middle[0]])
                    occupied = EMPTY - kind < wp.max(last - middle)
                    if occupied and kind <= EMPTY:
                        occupied = bool(False)
                        bk = first[2]
                        while bk <= last[2] and not occupied:
                            bj = first[1]
                            while bj <= last[1] and not occupied:
                                bi = first[0]
                                while bi <= last[0] and not occupied:
                                    kind = int(scene.blocks.kinds[bk, bj, bi])
                                    occupied = kind > EMPTY
                                    bi += wp.max(EMPTY - kind, 0) + 1
                                bj += 1
                            bk += 1
                if n > 1:
                    result[k, j, i] = wp.uint8(wp.where(occupied, 1, 0))
                elif not occupied:
                    for c in range(8):
                        if x + (c & 1) < result.shape[2] and y + ((c >> 1) & 1) < result.shape[1]:
                            if z + (c >> 2) < result.shape[0]:
                                result[z + (c >> 2), y + ((c >> 1) & 1), x + (c & 1)] = wp.uint8(0)
                    n = 9

    @wp.kernel(enable_backward=False, module="unique")
    def travel(
        base: int,
        slab: int,
        q: real,
        source: int,
        slot: int,
        scenes: wp.array(dtype=Scene),
        shade: Shade,
        state: State,
    ):
        """Diffusion by a variance of q, at most 1/2, along each axis, of light that is through with the slab's first
        share of attenuation. If a ``slot`` of the stack is given, diffusion is done: the rest of attenuation, and the
        first share of the next slab's. ``touched`` tiles, with a border of one, may have less than full light. The
        items of a row take runs by turns.
        """
        item = wp.tid() + base
        every = shade.items
        j = item // every
        for i in range(item - j * every, state.rest.shape[1], every):
            shaded = bool(False)  # by the next slab, perhaps
            if slot >= 0 and slab + 1 < shade.occupied.shape[0] * SLABS:
                shaded = shade.occupied[(slab + 1) // SLABS, j // ROWS, i] != wp.uint8(0)
            if not shaded and shade.touched[j // ROWS + 1, i + 1] == wp.uint8(0):
                # Full light is left as it is.
                if slot >= 0:
                    state.stack[slot, j, i] = Run(real(1.0))
                continue
            y = j + BORDER
            x = i + 1
            L = state.light[source, y, x]
            west = state.light[source, y, x - 1]
            east = state.light[source, y, x + 1]
            # Of the rows above and below together.
            rows = state.light[source, y - 1, x] + state.light[source, y + 1, x]
            rows_west = state.light[source, y - 1, x - 1] + state.light[source, y + 1, x - 1]
            rows_east = state.light[source, y - 1, x + 1] + state.light[source, y + 1, x + 1]
            near = rows + back1(west, L) + on1(L, east)
            far = state.light[source, y - 2, x] + state.light[source, y + 2, x] + back2(west, L) + on2(L, east)
            corners = back1(rows_west, rows) + on1(rows, rows_east)
            four = real(4.0) * L
            L += q * (
                (real(0.5) - q) * (near - four) + q * (real(0.125) * (far - four) + real(0.25) * (corners - four))
            )
            if slot >= 0:
                if slab >= 0:
                    if shade.occupied[slab // SLABS, j // ROWS, i] != wp.uint8(0):
                        L -= wp.cw_mul(L, state.rest[j, i])
                state.stack[slot, j, i] = L
                if shaded:
                    scene = scenes[0]
                    sweep = scene.march
                    z = sweep.start + wp.float64(slab + 1) * sweep.thickness
                    D = depths(scene, shade, z, i * RUN, j, L)
                    A = opacities(real(sweep.before) * D)
                    B = A
                    if sweep.after != sweep.before:
                        B = opacities(real(sweep.after) * D)
                    L -= wp.cw_mul(L, A)
                    state.rest[j, i] = B
            state.light[1 - source, y, x] = L
            if less(L, Run(real(1.0))):
                # Diffusion reaches two cells.
                above = (j - 2 + ROWS) // ROWS
                below = (j + 2) // ROWS + 1
                for c in range(3):
                    shade.touched[above, i + c] = wp.uint8(1)
                    shade.touched[below, i + c] = wp.uint8(1)

    return occupy, travel
