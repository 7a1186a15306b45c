"""Vectors of sixteen numbers as clang has them, which it cuts to the width that a processor has: text for snippets.

Names are the function's own but for those of macros, which are the same wherever they are.
"""

VECTORS = """
#pragma clang fp contract(fast)
typedef float vf __attribute__((vector_size(64), aligned(4)));
typedef int vi __attribute__((vector_size(64), aligned(4)));
typedef float v4f __attribute__((vector_size(16), aligned(4)));
typedef float v8f __attribute__((vector_size(32), aligned(4)));
typedef int v8i __attribute__((vector_size(32), aligned(4)));
typedef double vd __attribute__((vector_size(64), aligned(8)));
typedef long long vq __attribute__((vector_size(64), aligned(8)));
typedef bool b8 __attribute__((ext_vector_type(8)));
typedef bool b16 __attribute__((ext_vector_type(16)));
const vf zero = {};
auto bits = [](vi a) -> unsigned {
    const auto one = __builtin_convertvector(a != 0, b16);
    uint16_t all;
    __builtin_memcpy(&all, &one, 2);
    return all;
};
#define MAX __builtin_elementwise_max
#define MIN __builtin_elementwise_min
#define ABS(a) ((vf)((vi)(a) & 0x7fffffff))
#define ABSD(a) ((vd)((vq)(a) & 0x7fffffffffffffffLL))
#define JOIN8(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7)
#define JOIN(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
"""


def apart(text):
    """A text as a function of its own, once, wherever what has it is called: it is compiled once."""
    return f"{VECTORS}\nauto apart = [&]() __attribute__((noinline)) {{\n{text}\n}};\napart();\n"


def wide(text, lanes):
    """A text of vectors of as many ``LANES``, 8 or 16, that says ``FLOATS`` and ``INTS``."""
    kinds = {8: ("v8f", "v8i"), 16: ("vf", "vi")}[lanes]
    for name, what in zip(("FLOATS", "INTS", "LANES"), (*kinds, str(lanes)), strict=True):
        text = text.replace(name, what)
    return text
