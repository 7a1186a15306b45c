"""Kernels as they are compiled for CUDA, run on the CPU: PTX is written as C, an instruction a line, and counted.

It is the compiler's own code for a GPU that makes the image then: what it does to the arithmetic is seen without
a GPU, and so is which instructions are executed how often. Approximate functions of GPUs are exact ones here, and a
block has its threads one after the other. What is read or written outside of all arrays, or where no such number may
begin, is an error. It needs a C compiler.
"""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any
from unittest.mock import patch

import numpy as np
import warp as wp

import wvr
import wvr.frame
from wvr.kernels.ray import TILE
from wvr.launch import tiles

from .cuda import as_on_gpus, compiled

# Threads of a block.
BLOCK = 256
PRELUDE = """
#include <stdint.h>
#include <string.h>
#include <math.h>
#include <fenv.h>
typedef uint8_t u8; typedef uint16_t u16; typedef uint32_t u32; typedef uint64_t u64;
typedef int8_t s8; typedef int16_t s16; typedef int32_t s32; typedef int64_t s64;
typedef u8 b8; typedef u16 b16; typedef u32 b32; typedef u64 b64; typedef float f32; typedef double f64;
static inline f32 F(u32 x) { f32 y; memcpy(&y, &x, 4); return y; }
static inline u32 from_f32(f32 x) { u32 y; memcpy(&y, &x, 4); return y; }
static inline f32 H(u16 x) { _Float16 y; memcpy(&y, &x, 2); return y; }
static inline f64 D(u64 x) { f64 y; memcpy(&y, &x, 8); return y; }
static inline u64 from_f64(f64 x) { u64 y; memcpy(&y, &x, 8); return y; }
static inline u32 prmt(u32 a, u32 b, u32 s) {
  u64 all = (u64)b << 32 | a; u32 out = 0;
  for (int i = 0; i < 4; i++) { u32 n = s >> 4 * i & 15; u32 v = all >> 8 * (n & 7) & 255;
    if (n & 8) v = v & 128 ? 255 : 0; out |= v << 8 * i; }
  return out; }
static __attribute__((noinline)) f32 fma_rounded(f32 a, f32 b, f32 c, int way) {
  int before = fegetround(); fesetround(way); volatile f32 x = a, y = b, z = c; volatile f32 r = fmaf(x, y, z);
  fesetround(before); return r; }
#define SATURATED(name, type, low, high) static inline type name(f64 x) { \\
  return x != x ? 0 : x <= (f64)(low) ? (low) : x >= (f64)(high) ? (high) : (type)x; }
SATURATED(to_s32, s32, INT32_MIN, INT32_MAX) SATURATED(to_u32, u32, 0, UINT32_MAX)
SATURATED(to_s64, s64, INT64_MIN, INT64_MAX) SATURATED(to_u64, u64, 0, UINT64_MAX)
SATURATED(to_s16, s16, INT16_MIN, INT16_MAX) SATURATED(to_u16, u16, 0, UINT16_MAX)
static const u64 (*known)[2]; static u64 wrong, own[8][2]; static u8 nowhere[64] __attribute__((aligned(64)));
static int in(u64 at, u64 size, const u64 (*ranges)[2]) {
  for (; (*ranges)[1]; ranges++) if (at >= (*ranges)[0] && at + size <= (*ranges)[1]) return 1;
  return 0; }
static inline u64 checked(u64 at, u64 size) {
  if (at % size == 0 && (in(at, size, known) || in(at, size, own))) return at;
  wrong++; return (u64)nowhere; }
"""
# By operation, what C has for it: of integers and floats alike.
SIGNS = {"add": "+", "sub": "-", "and": "&", "or": "|", "xor": "^", "div": "/", "rem": "%"}
CALLS = {"sqrt": "sqrt", "ex2": "exp2", "lg2": "log2", "sin": "sin", "cos": "cos", "abs": "fabs"}
# Functions of doubles.
CALLED = {"__internal_accurate_pow": "pow"}
COMPARED = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
UNSIGNED = {"lo": "lt", "ls": "le", "hi": "gt", "hs": "ge"}
ROUNDED = {"rni": "nearbyint", "rmi": "floor", "rpi": "ceil", "rzi": "trunc"}
SPECIAL = {"tid.x": "tid", "ctaid.x": "ctaid", "ntid.x": "ntid", "nctaid.x": "nctaid"}
# That wait for others or say something of what comes, of which one thread after the other needs nothing.
NOTHING = ("bar", "membar", "fence", "pragma")
# In float64, but not by its units.
MOVED = ("ld", "st", "mov", "selp", "cvta")


class Unknown(NotImplementedError):  # noqa: N818 - an instruction
    """An instruction that no scene had so far."""


def bits(kind: str) -> int:
    return int(kind[1:])


class Translation:
    """A kernel in C.

    Attributes
    ----------
    source
        ``run(args, blocks, threads, counts, ranges)`` -> how many addresses are wrong: ``counts`` of how often each
        block of instructions began, ``ranges`` of addresses that there is something at, up to one that ends at 0.
    blocks
        The instructions of each.
    """

    def __init__(self, ptx: str):
        _, _, rest = ptx.partition(".visible .entry ")
        names = re.findall(r"\.param[^,\n)]*?([\w$]+)(?:\[\d+\])?\s*[,\n)]", rest.partition("{")[0])
        self.parameters = {name: n for n, name in enumerate(names)}
        self.widths: dict[str, str] = {}
        self.symbols: dict[str, str] = {name: f"(u64)args[{n}]" for name, n in self.parameters.items()}
        self.blocks: list[Counter[str]] = []
        self.locals = 0
        # Functions that it calls stand behind it.
        body = rest[rest.index("{") + 1 : rest.index("\n}")]
        lines = ["static void thread(void** args, u32 tid, u32 ctaid, u32 ntid, u32 nctaid, u64* counts) {"]
        lines.append("static _Thread_local u8 shared[1 << 16];")
        fresh = True
        for text in statements(body):
            label = re.fullmatch(r"([$\w]+):", text)
            if label or fresh:
                if label:
                    lines.append(f"{named(label.group(1))}:;")
                lines.append(f"counts[{len(self.blocks)}]++;" if not text.startswith(".") else "")
                if not text.startswith("."):
                    self.blocks.append(Counter())
                    fresh = False
                if label:
                    continue
            if text in "{}":
                lines.append(text)
            elif text.startswith("."):
                lines.append(self.declared(text))
            else:
                code, opcode = self.instruction(text)
                self.blocks[-1][opcode] += 1
                lines.append(code)
                fresh = opcode.startswith(("bra", "ret", "exit"))
        lines.append("}")
        lines.append(
            "u64 run(void** args, u32 blocks, u32 threads, u64* counts, const void* ranges) { "
            "known = ranges; wrong = 0; for (u32 b = 0; b < blocks; b++) "
            "for (u32 t = 0; t < threads; t++) thread(args, t, b, threads, blocks, counts); return wrong; }"
        )
        self.source = PRELUDE + "\n".join(lines) + "\n"

    def declared(self, text: str) -> str:
        """Registers and memory of a thread or block."""
        if found := re.fullmatch(r"\.reg \.(\w+)\s+(.*);", text):
            kind, which_ = found.groups()
            kind = {"pred": "u8"}.get(kind, f"u{kind[1:]}")
            out = []
            for name in which_.split(","):
                several = re.fullmatch(r"\s*(%[\w$]+)<(\d+)>\s*", name)
                names = [f"{several[1]}{n}" for n in range(int(several[2]))] if several else [name.strip()]
                self.widths |= dict.fromkeys(names, kind)
                out += [f"{kind} {named(one)} = 0;" for one in names]
            return " ".join(out)
        if found := re.fullmatch(r"\.local \.align (\d+) \.b8\s+([\w$]+)\[(\d+)\];", text):
            align, name, size = found.groups()
            self.symbols[name] = f"(u64){named(name)}"
            self.locals += 1
            place = f"own[{self.locals - 1}]"
            put = f"{place}[0] = (u64){named(name)}; {place}[1] = {place}[0] + {size};"
            return f"u8 {named(name)}[{size}] __attribute__((aligned({align}))); {put}"
        if found := re.fullmatch(r"\.shared \.align \d+ \.b8\s+([\w$]+)\[(\d+)\];", text):
            self.symbols[found.group(1)] = "(u64)shared"
            return ""
        if found := re.fullmatch(r"\.param \.b64 (\w+);", text):
            self.symbols[found[1]] = f"(u64)&{found[1]}"
            return f"u64 {found[1]};"
        if text.startswith(".pragma"):
            return ""
        raise Unknown(text)

    def value(self, operand: str, kind: str) -> str:
        """An operand as a number of a kind."""
        if operand[1:] in SPECIAL or operand[1:3] in ("ct", "nt", "nc", "ti"):
            # Grids have one axis.
            return SPECIAL.get(operand[1:], "0" if operand[1:].startswith(("ctaid", "tid")) else "1")
        if operand.startswith("0f"):
            return f"F(0x{operand[2:]}u)"
        if operand.startswith("0d"):
            return f"D(0x{operand[2:]}ull)"
        if operand.startswith("%"):
            name = named(operand)
            return {"f32": f"F({name})", "f64": f"D({name})", "pred": name}.get(kind, f"(({kind}){name})")
        if operand in self.symbols:
            return f"(({kind})({self.symbols[operand]}))" if "shared" not in self.symbols[operand] else "0"
        if kind in ("f32", "f64"):
            raise Unknown(operand)
        return f"(({kind}){operand}ll)"

    def put(self, register: str, kind: str, code: str) -> str:
        """A number of a kind into a register, as wide as that is."""
        code = f"from_{kind}({code})" if kind in ("f32", "f64") else code
        width = self.widths[register]
        signed = f"(s{width[1:]})" if kind.startswith("s") else ""
        return f"{named(register)} = ({width}){signed}({code});"

    def address(self, operand: str, space: str) -> str:
        base, _, offset = operand.strip("[]").partition("+")
        start = self.symbols.get(base)
        if start is None:
            start = f"(u64){named(base)}"
        if space == "shared":
            start = f"(u64)shared + {'0' if base in self.symbols else named(base)}"
        return f"({start} + ({offset or 0}))"

    def instruction(self, text: str) -> tuple[str, str]:
        """What it is in C, and its opcode."""
        if called := re.fullmatch(r"call\.uni \((\w+)\),\s*(\w+),\s*\(([\w, ]*)\);", text):
            result, function, arguments = called.groups()
            if function not in CALLED:
                raise Unknown(text)
            given = ", ".join(f"D({one})" for one in operands(arguments))
            return f"{result} = from_f64({CALLED[function]}({given}));", "call"
        found = re.fullmatch(r"(?:@(!?)(%p\d+)\s+)?([a-z][\w.:]*)\s*(.*);", text)
        if not found:
            raise Unknown(text)
        no, guard, opcode, rest = found.groups()
        try:
            code = self.translated(opcode, operands(rest), text)
        except (KeyError, ValueError, IndexError) as error:
            raise Unknown(f"{text} ({error!r})") from error
        return (f"if ({no}{named(guard)}) {{ {code} }}" if guard else code), opcode

    def translated(self, opcode: str, given: list[str], text: str) -> str:
        op, *how = opcode.split(".")
        kind = how[-1] if how else ""
        if op in NOTHING:
            return ""
        if op in ("ret", "exit"):
            return "return;"
        if op == "bra":
            return f"goto {named(given[0])};"
        if op in ("ld", "st"):
            return self.memory(op, how, given)
        if op == "mov":
            return self.moved(kind, given)
        if op == "cvta":
            return self.put(given[0], "u64", self.value(given[1], "u64"))
        if op == "setp":
            return self.compared(how, given)
        if op == "cvt":
            return self.converted(how, given)
        if op == "selp":
            a, b = (self.value(one, kind) for one in given[1:3])
            return self.put(given[0], kind, f"{named(given[3])} ? {a} : {b}")
        if kind == "pred":
            first, *second = (self.value(one, kind) for one in given[1:])
            code = f"!{first}" if op == "not" else f"({first} {SIGNS[op]} {second[0]}) & 1"
            return f"{named(given[0])} = {code};"
        return self.computed(op, how, given, text)

    def computed(self, op: str, how: list[str], given: list[str], text: str) -> str:
        """Arithmetic."""
        kind = how[-1]
        floating = kind in ("f32", "f64")
        if floating and set(how) & {"rz", "rm", "rp"} and (op, kind) != ("fma", "f32"):
            raise Unknown(text)
        a = [self.value(one, kind) for one in given[1:]]
        tail = "f" if kind == "f32" else ""
        wide = kind[0] + str(2 * bits(kind)) if not floating and bits(kind) < 64 else kind
        result = kind
        if op in SIGNS:
            code = f"{a[0]} {SIGNS[op]} {a[1]}"
        elif op == "mul" or op == "mad":
            more = "" if op == "mul" else f" + {self.value(given[3], wide if 'wide' in how else kind)}"
            if "wide" in how:
                code, result = f"({wide}){a[0]} * ({wide}){a[1]}{more}", wide
            elif "hi" in how:
                code = f"({'__int128' if kind[0] == 's' else 'unsigned __int128'}){a[0]} * {a[1]} >> {bits(kind)}"
            else:
                code = f"{a[0]} * {a[1]}{more}"
        elif op == "fma":
            way = next((w for w in ("rm", "rp", "rz") if w in how), None)
            if way:
                mode = {"rm": "FE_DOWNWARD", "rp": "FE_UPWARD", "rz": "FE_TOWARDZERO"}[way]
                code = f"fma_rounded({a[0]}, {a[1]}, {a[2]}, {mode})"
            else:
                code = f"fma{tail}({a[0]}, {a[1]}, {a[2]})"
        elif op in ("min", "max"):
            less = "<" if op == "min" else ">"
            code = f"f{op}{tail}({a[0]}, {a[1]})" if floating else f"{a[0]} {less} {a[1]} ? {a[0]} : {a[1]}"
        elif op == "neg":
            code = f"-{a[0]}"
        elif op == "abs" and not floating:
            code = f"{a[0]} < 0 ? -{a[0]} : {a[0]}"
        elif op in CALLS:
            code = f"{CALLS[op]}{tail}({a[0]})"
        elif op in ("rcp", "rsqrt"):
            code = f"1 / {a[0]}" if op == "rcp" else f"1 / sqrt{tail}({a[0]})"
        elif op == "copysign":
            code = f"copysign{tail}({a[1]}, {a[0]})"
        elif op == "not":
            code = f"~{a[0]}"
        elif op in ("shl", "shr"):
            by, size = self.value(given[2], "u32"), bits(kind)
            beyond = f"({a[0]} < 0 ? -1 : 0)" if op == "shr" and kind[0] == "s" else "0"
            code = f"{by} >= {size} ? {beyond} : ({kind})({a[0]} {'<<' if op == 'shl' else '>>'} {by})"
        elif op in ("clz", "popc", "brev", "bfi", "bfe", "bfind", "prmt", "shf"):
            return self.of_bits(op, how, given, text)
        else:
            raise Unknown(text)
        if "sat" in how:
            code = f"fmin{tail}(fmax{tail}({code}, 0), 1)"
        return self.put(given[0], result, code)

    def of_bits(self, op: str, how: list[str], given: list[str], text: str) -> str:
        kind = how[-1]
        a = [self.value(one, kind) for one in given[1:]]
        n = [self.value(one, "u32") for one in given[1:]]
        long = "ll" if bits(kind) == 64 else ""
        if op == "popc":
            return self.put(given[0], "u32", f"__builtin_popcount{long}({a[0]})")
        if op == "clz":
            return self.put(given[0], "u32", f"{a[0]} ? __builtin_clz{long}({a[0]}) : {bits(kind)}")
        if op == "brev":
            last = bits(kind) - 1
            turned = f"for (int i = 0; i <= {last}; i++) y |= (x >> i & 1) << ({last} - i);"
            return f"{{ {kind} x = {a[0]}, y = 0; {turned} {self.put(given[0], kind, 'y')} }}"
        if op == "prmt":
            return self.put(given[0], "u32", f"prmt({n[0]}, {n[1]}, {n[2]})")
        if op == "bfi":
            mask = f"((({kind})1 << {n[3]}) - 1) << {n[2]}"
            return self.put(given[0], kind, f"({a[1]} & ~({mask})) | ({a[0]} << {n[2]} & ({mask}))")
        if op == "bfe" and kind[0] == "u":
            return self.put(given[0], kind, f"{a[0]} >> {n[1]} & ((({kind})1 << {n[2]}) - 1)")
        if op == "shf" and "wrap" in how:
            both = f"((u64){n[1]} << 32 | {n[0]})"
            by = f"({n[2]} & 31)"
            return self.put(given[0], "u32", f"{both} << {by} >> 32" if "l" in how else f"{both} >> {by}")
        raise Unknown(text)

    def memory(self, op: str, how: list[str], given: list[str]) -> str:
        kind, space = how[-1], how[0]
        where, what = (given[1], given[0]) if op == "ld" else (given[0], given[1])
        size = bits(kind) // 8
        registers = operands(what.strip("{}")) if what.startswith("{") else [what]
        start = self.address(where, space)
        if space not in ("param", "shared", "const"):
            start = f"checked({start}, {size * len(registers)})"
        # Loads may write the register that their address is in.
        out = [f"u64 at = {start};"]
        for n, register in enumerate(registers):
            at = f"(({kind}*)at)[{n}]"
            out.append(self.put(register, kind, at) if op == "ld" else f"{at} = {self.value(register, kind)};")
        return f"{{ {' '.join(out)} }}"

    def moved(self, kind: str, given: list[str]) -> str:
        target, source = given
        if kind == "pred":
            return f"{named(target)} = {'1' if source in ('1', '-1') else '0' if source == '0' else named(source)};"
        if target.startswith("{"):
            parts = operands(target.strip("{}"))
            each = bits(kind) // len(parts)
            whole = self.value(source, f"u{bits(kind)}")
            put = [self.put(part, f"u{each}", f"whole >> {n * each}") for n, part in enumerate(parts) if part != "_"]
            return f"{{ u{bits(kind)} whole = {whole}; {' '.join(put)} }}"
        if source.startswith("{"):
            parts = operands(source.strip("{}"))
            each = bits(kind) // len(parts)
            joined = " | ".join(
                f"(u{bits(kind)}){self.value(part, f'u{each}')} << {n * each}" for n, part in enumerate(parts)
            )
            return self.put(target, f"u{bits(kind)}", joined)
        if source[:2] in ("0f", "0d") and kind[0] == "b":
            kind = f"f{kind[1:]}"
        return self.put(target, kind, self.value(source, kind))

    def compared(self, how: list[str], given: list[str]) -> str:
        kind = how[-1]
        how = [one for one in how[:-1] if one != "ftz"]
        compare = how[0]
        floating = kind in ("f32", "f64")
        a, b = (self.value(one, kind) for one in given[1:3])
        if compare in ("num", "nan"):
            code = f"({a} == {a} && {b} == {b})" if compare == "num" else f"({a} != {a} || {b} != {b})"
        elif floating and compare.endswith("u"):
            opposite = {"equ": "ne", "neu": "eq", "ltu": "ge", "leu": "gt", "gtu": "le", "geu": "lt"}[compare]
            code = f"!({a} < {b} || {a} > {b})" if opposite == "ne" else f"!({a} {COMPARED[opposite]} {b})"
        elif floating and compare == "ne":
            code = f"({a} < {b} || {a} > {b})"
        else:
            code = f"({a} {COMPARED[UNSIGNED.get(compare, compare)]} {b})"
        if len(how) > 1:
            code = f"({code} {SIGNS[how[1]]} {self.value(given[3], 'pred')})"
        return f"{named(given[0])} = {code} & 1;"

    def converted(self, how: list[str], given: list[str]) -> str:
        target, source = how[-2:]
        code = f"H({named(given[1])})" if source == "f16" else self.value(given[1], source)
        way = next((ROUNDED[one] for one in how if one in ROUNDED), None)
        if way:
            code = f"{way}{'f' if source == 'f32' else ''}({code})"
        if source[0] == "f" and target[0] != "f":
            code = f"to_{target}({code})"
        if "sat" in how:
            code = f"fmin(fmax({code}, 0), 1)"
        return self.put(given[0], target, f"({target})({code})")


def statements(body: str) -> Iterator[str]:
    """Lines without what is said of them; of calls, which have several, all of them in one."""
    call = ""
    for line in body.splitlines():
        text = re.sub(r"//.*", "", line).strip()
        if text.startswith("call") or call:
            call += text
            if text.endswith(";"):
                yield call
                call = ""
        elif len(text) > 1 and text[0] + text[-1] == "{}":
            yield from ("{", text[1:-1].strip(), "}")
        elif text:
            yield text


def named(symbol: str) -> str:
    """In C."""
    return re.sub(r"\W", "_", symbol)


def operands(text: str) -> list[str]:
    """Of an instruction, of which a vector is one."""
    return [one.strip() for one in re.findall(r"\{[^}]*\}|\[[^\]]*\]|[^,\s][^,]*", text)]


class Compiled:
    """A kernel's code for CUDA as a function of the CPU."""

    def __init__(self, kernel: wp.Kernel, folder: Path):
        self.translation = Translation(compiled(kernel, folder).read_text())
        source, library = folder / "kernel.c", folder / "kernel.so"
        source.write_text(self.translation.source)
        command = [
            "cc",
            "-O1",
            "-w",
            "-ffp-contract=off",
            "-frounding-math",
            "-fno-strict-aliasing",
            "-shared",
            "-fPIC",
        ]
        subprocess.run([*command, "-o", str(library), str(source), "-lm"], check=True)
        self._run = ctypes.CDLL(str(library)).run
        self._run.restype = ctypes.c_uint64

    def __call__(self, items: int, inputs: list[Any]) -> Counter[str]:
        """Run it over items; how often each instruction was executed."""
        arguments = [_Bounds(items, items, 1), ctypes.c_int32(0), *map(_packed, inputs)]
        pointers = (ctypes.c_void_p * len(arguments))(*(ctypes.addressof(one) for one in arguments))
        counts = np.zeros(len(self.translation.blocks), np.uint64)
        ranges = np.array([*_ranges(inputs), (0, 0)], np.uint64)
        places = (one.ctypes.data_as(ctypes.c_void_p) for one in (counts, ranges))
        if wrong := self._run(pointers, -(-items // BLOCK), BLOCK, *places):
            raise RuntimeError(f"{wrong} addresses are outside of all arrays, or where no such number may begin")
        result: Counter[str] = Counter()
        for count, block in zip(counts.tolist(), self.translation.blocks, strict=True):
            for opcode, many in block.items():
                result[opcode] += many * count
        return result


class _Bounds(ctypes.Structure):
    """How Warp tells a kernel what it runs over."""

    _fields_ = (("shape", ctypes.c_uint32), ("size", ctypes.c_size_t), ("mult", ctypes.c_size_t))


def arrays_of(value: Any) -> Iterator[wp.array]:
    """Those that a kernel gets by an argument, in structs as well."""
    if isinstance(value, wp.array):
        yield value
    elif isinstance(value, list | tuple):
        for one in value:
            yield from arrays_of(one)
    elif hasattr(value, "_cls"):
        for name in value._cls.vars:
            yield from arrays_of(getattr(value, name))


def _ranges(inputs: list[Any]) -> Iterator[tuple[int, int]]:
    """Addresses from where to where arrays are, those in arrays of structs as well."""
    for array in arrays_of(inputs):
        if array.size:
            yield array.ptr, array.ptr + array.capacity
            if hasattr(array.dtype, "vars"):
                yield from _ranges_in(array.numpy())


def _ranges_in(records: np.ndarray) -> Iterator[tuple[int, int]]:
    if "strides" in (records.dtype.names or ()):
        for one in records[records["data"] > 0].ravel():
            yield int(one["data"]), int(one["data"]) + int(one["shape"][0]) * int(one["strides"][0])
    for name in records.dtype.names or ():
        yield from _ranges_in(records[name])


def _packed(value: Any) -> Any:
    """An argument of a kernel, in memory."""
    if isinstance(value, wp.array):
        return value.__ctype__()
    if isinstance(value, int):
        return ctypes.c_uint64(value)
    return value._ctype


@contextmanager
def cast_by_cuda(executed: dict[str, Counter[str]]) -> Iterator[Callable[[], AbstractContextManager[None]]]:
    """Rays of frames are cast by code for CUDA, run on the CPU; ``executed`` gets instructions by launch of a frame.
    What it gives is a context in which the CPU casts them as usual.
    """
    own = wvr.frame.launch_pixels, wvr.frame.Frame.halves
    with TemporaryDirectory() as place:

        @cache
        def made(kernel: wp.Kernel) -> Compiled:
            folder = Path(mkdtemp(dir=place))
            return Compiled(kernel, folder)

        def launch(kernel: wp.Kernel, inputs: list[Any], device: wp.Device, view: Any, *_: Any) -> None:
            items = tiles(view.width, view.height) * int(TILE) ** 2
            executed[f"launch {len(executed) + 1}"] = made(kernel)(items, inputs)

        @contextmanager
        def usual() -> Iterator[None]:
            launch_pixels, halves = own
            with (
                patch.object(wvr.frame, "launch_pixels", launch_pixels),
                patch.object(wvr.frame.Frame, "halves", halves),
            ):
                yield

        with as_on_gpus(), patch.object(wvr.frame, "launch_pixels", launch):
            yield usual


def has_compiler() -> bool:
    return which("cc") is not None


def float64(executed: Counter[str]) -> float:
    """The share of executed instructions that units for float64 have to do, conversions among them."""
    by_units = sum(n for op, n in executed.items() if ".f64" in op and op.partition(".")[0] not in MOVED)
    return by_units / max(1, sum(executed.values()))
