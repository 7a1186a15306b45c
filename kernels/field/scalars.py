"""The scalar at eight places at a time, in vectors: what ``samples.make_value`` says in Warp, in single precision."""

from .cubics import PAIRS

SCALARS = """
const auto* __restrict data = field.data.data;
const int64_t nx = field.data.shape[2], nxy = nx * field.data.shape[1];
const v8f none = {};
const v8i first = {};
// The scalar at eight places.
auto scalars = [&](v8f x, v8f y, v8f z) -> v8f {
#define CELL(p, a) MAX(MIN(__builtin_convertvector(p, v8i), first + field.last[a]), first)
    const v8i i = CELL(x, 0), j = CELL(y, 1), k = CELL(z, 2);
    x -= __builtin_convertvector(i, v8f);
    y -= __builtin_convertvector(j, v8f);
    z -= __builtin_convertvector(k, v8f);
    STORE
    for (int l = 0; l < 8; ++l) {
        const auto* c = data + (int64_t)k[l] * nxy + (int64_t)j[l] * nx + i[l];
        LOAD
    }
#define CORNER(m) *(const v8f*)corner[m]
    CORNERS
    const v8f c00 = c000 + x * (c100 - c000), c10 = c010 + x * (c110 - c010);
    const v8f c01 = c001 + x * (c101 - c001), c11 = c011 + x * (c111 - c011);
    const v8f c0 = c00 + y * (c10 - c00), c1 = c01 + y * (c11 - c01);
    return c0 + z * (c1 - c0);
};
"""
# Pairs of corners along x, two numbers in one.
INTEGER = {
    "STORE": "alignas(32) int pair[4][8];",
    "LOAD": """PAIR p[4];
        __builtin_memcpy(p, c, sizeof(PAIR));
        __builtin_memcpy(p + 1, c + nx, sizeof(PAIR));
        __builtin_memcpy(p + 2, c + nxy, sizeof(PAIR));
        __builtin_memcpy(p + 3, c + nxy + nx, sizeof(PAIR));
        for (int m = 0; m < 4; ++m) pair[m][l] = p[m];""",
    "CORNERS": """
#define TWO(m) (*(const v8i*)pair[m])
#define LOW(m) __builtin_convertvector(LOWER(TWO(m)), v8f)
#define HIGH(m) __builtin_convertvector(UPPER(TWO(m)), v8f)
    const v8f c000 = LOW(0), c100 = HIGH(0), c010 = LOW(1), c110 = HIGH(1);
    const v8f c001 = LOW(2), c101 = HIGH(2), c011 = LOW(3), c111 = HIGH(3);""",
}
FLOATING = {
    "STORE": "alignas(32) float corner[8][8];",
    "LOAD": """for (int m = 0; m < 8; ++m)
            corner[m][l] = (float)(double(c[(m >> 2) * nxy + (m >> 1 & 1) * nx + (m & 1)]) - field.shift);""",
    "CORNERS": """const v8f c000 = CORNER(0), c100 = CORNER(1), c010 = CORNER(2), c110 = CORNER(3);
    const v8f c001 = CORNER(4), c101 = CORNER(5), c011 = CORNER(6), c111 = CORNER(7);""",
}


def scalars_of(dtype):
    """Text of ``scalars(x, y, z)`` -> scalars at eight places, of a ``field`` of ``dtype`` samples."""
    text = SCALARS
    for name, code in (INTEGER if dtype in PAIRS else FLOATING).items():
        text = text.replace(name, code)
    if dtype in PAIRS:
        kind, lower, upper = PAIRS[dtype]
        text = text.replace("PAIR", kind)
        text = f"#define LOWER(a) {lower.format('(a)')}\n#define UPPER(a) {upper.format('(a)')}\n{text}"
    return text
