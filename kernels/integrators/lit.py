"""Cells lit sixteen at a time, in vectors: what ``shone`` says of one, and ``light.shine`` how."""

import warp as wp

from ..field.gradients import ROWS
from ..light.shine import rows_of, shining

# What a task is.
CELLS, PIECE, CUT = range(3)
# Cells at a time whose gradients are known.
JOBS = 256
# Of a thread's memory [bytes]: a cell's middle and half the length of its piece, the numbers of a piece of it, and
# gradients of cells, of which that is the first.
PLACES = (0, 32, 128)
SCRATCH = 128 + 4 * ROWS * JOBS

LIGHT = """
Lit p;
vf out[3];
const int64_t room = gradient.shape[1];
auto given = [&](int n) -> vf { return *(const vf*)(gradient.data + n * room); };
for (int n = 0; n < LIT_ROWS; ++n) p.gradient[n] = given(n);
float* one = numbers.data;
float* of = found.data + first;
int* r = row.data + first;
auto at = [&](int n) -> vf& { return *(vf*)(of + n * found.shape[1]); };
vi dark = (vi){-1}, mine = dark;
if (task.what == PIECE) {  // by its numbers
    for (int n = 0; n < 8; ++n) ((vf*)&p)[n] = zero + one[n];
    for (int n = 0; n < 8; ++n) p.color[n] = zero + one[8 + n];
    for (int n = 0; n < LIT_ROWS; ++n) p.gradient[n] = zero + p.gradient[n][0];
    p.V = p.off = zero;
} else {
    const vi k = *(const vi*)r;
    // Those that somebody else put there are lit already.
    const vi lane = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    mine = lane < count;
    dark = (k >= 0) & (at(1) > 0.0f) & mine;
    if (!__builtin_reduce_or(dark)) return;
    alignas(64) int which[16];
    *(vi*)which = dark ? k : (vi){};
    vf c[8];
    columns(rows.row.data, which, c);
    columns(rows.row.data + 8, which, p.color);
    p.x = at(0);
    p.A = at(1);
    p.V = at(2);
    p.off = at(3);
    p.g = given(18) * (c[3] + 2.0f * p.off * c[4]);
    p.m1 = given(15);
    p.m2 = given(16);
    p.m3 = given(17);
    p.mid = zero;
    p.half = zero + 1.0f;
}
lit(p, dark, zero + clear, out);
if (task.what == PIECE) {
    for (int n = 0; n < 3; ++n) one[16 + n] = out[n][0];
    return;
}
const vi k = *(const vi*)r, done = (k >= 0) & mine;
const int to[3] = {2, 3, 5};
for (int n = 0; n < 3; ++n) at(to[n]) = dark ? out[n] : done ? zero : at(to[n]);
*(vi*)r = done ? (vi){} - 1 : k;
"""


@wp.struct
class Task:
    """What is to be lit: cells of a ray, a piece, or all that is cut."""

    what: int
    cubic: wp.array2d(dtype=wp.float64)  # these five as of ``crossings.make_crossings``
    which: wp.array2d(dtype=int)
    found: wp.array2d(dtype=wp.float32)
    row: wp.array(dtype=int)
    pieces: wp.array(dtype=int)
    gradient: wp.array2d(dtype=wp.float32)  # as of ``field.gradients``
    numbers: wp.array(dtype=wp.float32)  # of a piece, as of ``alone``; the last three are its colour in the end
    clear: wp.float32  # transparency of the ray
    tolerance: wp.float32  # of a piece, in parts of its opacity
    first: int  # of so many cells, of which those that have no light yet are lit
    count: int


MEMBERS = [name for name in Task.vars if name != "what"]


def light_text(clipped):
    """What is ``lit``, for a function that has the members of a ``Task`` and ``rows``; behind it, only what is cut."""
    text = LIGHT.replace("PIECE", str(PIECE)).replace("LIT_ROWS", str(rows_of(clipped)))
    return f"{shining(clipped)}\nif (task.what != {CUT}) {{\n{text}\nreturn;\n}}\n"


def in_lanes(halves):
    """Whether pieces are lit so."""
    return halves.light is not None and halves.vectors and getattr(halves.march, "single", False)
