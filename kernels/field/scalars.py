"""The scalar at eight or sixteen places at a time: what ``samples.make_value`` says, in vectors of single precision."""

from .cubics import PAIRS

SCALARS = """
// Comparisons, since those of vectors also look for NaN.
#define LESS(a, b) ((a) < (b) ? (a) : (b))
#define MORE(a, b) ((a) > (b) ? (a) : (b))
const auto* __restrict data = field.data.data;
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const FLOATS none = {};
const INTS first = {};
// The scalar at each place.
auto scalars = [&](FLOATS x, FLOATS y, FLOATS z) -> FLOATS {
#define CELL(p, a) MORE(LESS(__builtin_convertvector(p, INTS), first + field.last[a]), first)
    const INTS i = CELL(x, 0), j = CELL(y, 1), k = CELL(z, 2);
    x -= __builtin_convertvector(i, FLOATS);
    y -= __builtin_convertvector(j, FLOATS);
    z -= __builtin_convertvector(k, FLOATS);
    alignas(64) int cell[3][LANES];
    alignas(64) int64_t at[LANES];
    *(INTS*)cell[0] = i;
    *(INTS*)cell[1] = j;
    *(INTS*)cell[2] = k;
#define LONG(m) __builtin_convertvector(*(const v8i*)(cell[m] + l), vq)
    for (int l = 0; l < LANES; l += 8) *(vq*)(at + l) = LONG(2) * nxy + LONG(1) * nx + LONG(0);
    STORE
    for (int l = 0; l < LANES; ++l) {
        const auto* c = data + at[l];
        LOAD
    }
#define CORNER(m) *(const FLOATS*)corner[m]
    CORNERS
    const FLOATS c00 = c000 + x * (c100 - c000), c10 = c010 + x * (c110 - c010);
    const FLOATS c01 = c001 + x * (c101 - c001), c11 = c011 + x * (c111 - c011);
    const FLOATS c0 = c00 + y * (c10 - c00), c1 = c01 + y * (c11 - c01);
    return c0 + z * (c1 - c0);
};
"""
# Pairs of corners along x, two numbers in one.
INTEGER = {
    "STORE": "alignas(64) int pair[4][LANES];",
    "LOAD": """PAIR p[4];
        __builtin_memcpy(p, c, sizeof(PAIR));
        __builtin_memcpy(p + 1, c + nx, sizeof(PAIR));
        __builtin_memcpy(p + 2, c + nxy, sizeof(PAIR));
        __builtin_memcpy(p + 3, c + nxy + nx, sizeof(PAIR));
        for (int m = 0; m < 4; ++m) pair[m][l] = p[m];""",
    "CORNERS": """
#define TWO(m) (*(const INTS*)pair[m])
#define LOW(m) __builtin_convertvector(LOWER(TWO(m)), FLOATS)
#define HIGH(m) __builtin_convertvector(UPPER(TWO(m)), FLOATS)
    const FLOATS c000 = LOW(0), c100 = HIGH(0), c010 = LOW(1), c110 = HIGH(1);
    const FLOATS c001 = LOW(2), c101 = HIGH(2), c011 = LOW(3), c111 = HIGH(3);""",
}
FLOATING = {
    "STORE": "alignas(64) float corner[8][LANES];",
    "LOAD": """for (int m = 0; m < 8; ++m)
            corner[m][l] = (float)(double(c[(m >> 2) * nxy + (m >> 1 & 1) * nx + (m & 1)]) - field.shift);""",
    "CORNERS": """const FLOATS c000 = CORNER(0), c100 = CORNER(1), c010 = CORNER(2), c110 = CORNER(3);
    const FLOATS c001 = CORNER(4), c101 = CORNER(5), c011 = CORNER(6), c111 = CORNER(7);""",
}


def scalars_of(dtype):
    """Text for ``vectors.wide`` of ``scalars(x, y, z)`` -> scalars at places, of a ``field`` of ``dtype`` samples."""
    text = SCALARS
    for name, code in (INTEGER if dtype in PAIRS else FLOATING).items():
        text = text.replace(name, code)
    if dtype in PAIRS:
        kind, lower, upper = PAIRS[dtype]
        text = text.replace("PAIR", kind)
        text = f"#define LOWER(a) {lower.format('(a)')}\n#define UPPER(a) {upper.format('(a)')}\n{text}"
    return text
