"""Damaged files: read twice, they are the same twice, or refused with an error that names them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from wvr.io import read

from . import seeds

# What errors about a file may be.
CLEAR = (OSError, ValueError, TypeError, MemoryError, ImportError)
NUMBERS = (0, 1, -1, 2, 127, 255, 256, 32767, 65535, 65536, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, -(2**63), 10**20)
WORDS = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e300",
    b"1e-300",
    b"",
    b"x",
    b"\xff\xfe",
    b"%d",
    b"../..",
    b"/dev/zero",
    b"9" * 400,
)


class Files:
    def __init__(self, folder: Path):
        (folder / "seeds").mkdir()
        self.seeds = seeds.make(folder / "seeds")
        self.folder = folder

    def run(self, rng: np.random.Generator) -> str:
        """What is wrong with how a damaged file is read; nothing if all is right."""
        seed = self.seeds[rng.integers(len(self.seeds))]
        path = self.folder / seed.name
        if path.is_dir():
            shutil.rmtree(path)
        if seed.is_dir():
            shutil.copytree(seed, path)
            inside = sorted(path.iterdir())
            damaged = inside[rng.integers(len(inside))]
        else:
            shutil.copy(seed, path)
            damaged = path
        other = self.seeds[rng.integers(len(self.seeds))]
        damaged.write_bytes(mutated(damaged.read_bytes(), other.read_bytes() if other.is_file() else b"", rng))
        frame = None if rng.random() < 0.8 else int(rng.integers(3))
        try:
            first = read(path, nan="transparent", frame=frame)
            second = read(path, nan="transparent", frame=frame)
        except CLEAR as error:
            name = damaged.name if damaged.parent == path else path.name
            named = name in str(error) or path.name in str(error)
            return "" if named else f"unclear: {type(error).__name__} without a name: {error}"
        for name in ("numpy", "index_to_world"):
            one, two = (getattr(volume, name) for volume in (first, second))
            one, two = (one(), two()) if callable(one) else (one, two)
            if one.dtype != two.dtype or not np.array_equal(one, two, equal_nan=one.dtype.kind == "f"):
                return f"wrong: {name} of {path.name} differs from one reading to the next"
        return ""


def mutated(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Damage in one to a few places, near the start more often than elsewhere, as headers are there."""
    data = bytearray(content)
    for _ in range(1 + rng.geometric(0.5)):
        at = int(len(data) * rng.random() ** rng.choice([1, 3]))
        kind = rng.integers(10)
        length = int(rng.integers(1, 9))
        if kind < 2 and data:
            data[min(at, len(data) - 1)] ^= 1 << int(rng.integers(8))
        elif kind == 2 and data:
            data[min(at, len(data) - 1)] = int(rng.integers(256))
        elif kind == 3:
            data[at:] = b""
        elif kind == 4:
            data[at : at + length] = b""
        elif kind == 5:
            data[at:at] = rng.bytes(length)
        elif kind == 6:
            data[at:at] = data[at : at + 10 * length]
        elif kind == 7:
            order, size = ("little", "big")[rng.integers(2)], (2, 4, 8)[rng.integers(3)]
            number = int(NUMBERS[rng.integers(len(NUMBERS))]) % 2 ** (8 * size)
            data[at : at + size] = number.to_bytes(size, order)
        elif kind == 8:
            _renumber(data, rng)
        else:
            start = int(rng.integers(len(other) + 1))
            data[at : at + 8 * length] = other[start : start + 8 * length]
    return bytes(data)


def _renumber(data: bytearray, rng: np.random.Generator) -> None:
    """Another number, or a word, where one is written in digits."""
    digits = [k for k in range(min(len(data), 2000)) if 48 <= data[k] <= 57]
    if digits:
        start = end = digits[rng.integers(len(digits))]
        while end < len(data) and (48 <= data[end] <= 57):
            end += 1
        choices = (*(str(number).encode() for number in NUMBERS), *WORDS)
        data[start:end] = choices[rng.integers(len(choices))]
