"""Damaged files and stores: read twice, they are the same twice, or refused with an error that names them."""

from __future__ import annotations

import bz2
import ctypes
import gzip
import io
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

import wvr
from wvr.io import read, read_raw
from wvr.io.dicom import is_dicom

from . import memory, seeds

# What errors about a file may be.
CLEAR = (OSError, ValueError, TypeError, MemoryError, ImportError)
NUMBERS = (
    0, 1, -1, 2, 3, 127, 255, 256, 4096, 32767, 65535, 65536, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, -(2**63),
    10**20,
)  # fmt: skip
WORDS = (
    b"nan", b"inf", b"-inf", b"1e300", b"1e-300", b"-0.0", b"", b"x", b"\xff\xfe", b"%d", b"../..", b".", b"/dev/zero",
    b"/proc/self/mem", b"\0", b"none", b"raw", b"gzip", b"9" * 400, b"0x10", b"1_0", b"\xc2\xb5m",
)  # fmt: skip
# Options of reading, which come with some cases.
OPTIONS: tuple[dict[str, Any], ...] = (
    {}, {}, {}, {}, {}, {}, {"frame": 0}, {"frame": 1}, {"frame": 2**40}, {"scalars": "a"},
    {"scalars": "values"}, {"nan": "error"},
)  # fmt: skip
# glibc's mallopt for the byte that memory holds before anybody writes into it.
PERTURB = -6


class Files:
    def __init__(self, folder: Path):
        self.seeds = seeds.make(folder)
        # The files of each, and what is in them.
        self.inside = {
            seed: sorted(file for file in seed.rglob("*") if file.is_file()) if seed.is_dir() else [seed]
            for seed in self.seeds
        }
        self.sound = {file: file.read_bytes() for files in self.inside.values() for file in files}
        self.subject = ""
        self.peak: int | None = None
        try:
            self.mallopt: Any = ctypes.CDLL(None).mallopt
        except (OSError, AttributeError):
            self.mallopt = lambda *_: 0

    def run(self, rng: np.random.Generator) -> str:
        """What is wrong with how a damaged file is read; nothing if all is right."""
        seed = self.seeds[rng.integers(len(self.seeds))]
        inside = self.inside[seed]
        damaged = inside[rng.integers(len(inside))]
        headers = [file for file in inside if file.suffix in (".nhdr", ".mhd", ".hdr")]
        path = headers[0] if headers else seed
        other = self.sound[self.inside[self.seeds[rng.integers(len(self.seeds))]][0]]
        damaged.write_bytes(damage(self.sound[damaged], other, rng))
        try:
            return self._read(seed, path, damaged, rng)
        finally:
            damaged.write_bytes(self.sound[damaged])

    def _read(self, seed: Path, path: Path, damaged: Path, rng: np.random.Generator) -> str:
        """What comes of a file that is damaged, or of the one that it belongs to."""
        options = {"nan": "transparent"} | OPTIONS[rng.integers(len(OPTIONS))]
        bare = damaged == path and rng.random() < 0.02
        shape, dtype = rng.integers(1, 12, 3).tolist(), ("u1", "i2", "f4", "f8", "u8")[rng.integers(5)]
        stored = seed.suffix == ".zarr" or (seed.suffix in (".npy", ".nii", ".h5") and rng.random() < 0.3)
        volumes: list[Any] = []
        self.subject = f"{'bare' if bare else _format(seed)}{' as a store' * stored}, read"

        def once() -> Any:
            if stored:
                return Stored(path)
            if bare:
                return read_raw(path, shape, dtype, nan="transparent", offset=path.stat().st_size // 3)
            return read(path, **options)

        try:
            # Memory that nobody wrote into differs from one reading to the next. Not at first, and not where pydicom
            # asks for as much as an element declares and takes what there is: it is then all touched.
            for byte in (0, 0 if is_dicom(damaged) else 0xC3):
                self.mallopt(PERTURB, byte)
                try:
                    volumes.append(once())
                finally:
                    # Of the first: what libraries ask for and leave as it is counts only where it is not filled.
                    self.peak = memory.peak() if not byte else self.peak
        except CLEAR as error:
            self.subject = self.subject.replace(", read", ", refused")
            names = {path.name, damaged.name, seed.name, *options}
            named = any(name in str(error) for name in names)
            return "" if named else f"unclear: {type(error).__name__} without a name: {error}"
        finally:
            self.mallopt(PERTURB, 0)
        for name in ("numpy", "index_to_world"):
            one, two = (getattr(volume, name) for volume in volumes)
            one, two = (one(), two()) if callable(one) else (one, two)
            if one.dtype != two.dtype or not np.array_equal(one, two, equal_nan=one.dtype.kind == "f"):
                return f"wrong: {name} of {path.name} differs from one reading to the next"
        return ""


class Stored:
    """The first and the last samples of a store, and where they are."""

    def __init__(self, path: Path):
        volume = wvr.open(path)
        last = np.array(volume.shape[::-1], np.int64) - 1
        self.index_to_world = volume.index_to_world
        parts = [
            volume.region(low, np.minimum(low + 5, last)) for low in (np.zeros(3, np.int64), np.maximum(last - 5, 0))
        ]
        self._samples = np.concatenate([part.ravel() for part in parts])

    def numpy(self) -> np.ndarray:
        return self._samples


def _format(seed: Path) -> str:
    """What a seed is of: the extension of it or of what is in it."""
    inside = seed.is_dir() and seed.suffix != ".zarr"
    ending = next((file.suffix for file in sorted(seed.iterdir())), "") if inside else seed.suffix
    return {"": ".dcm", ".mrc.gz": ".mrc", ".bz2": ".nhdr", ".raw": ".nhdr"}.get(ending, ending)


def damage(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """The content of a file, damaged; or, where it is packed, now and then what is in it."""
    inside = rng.random() < 0.6
    with suppress(OSError, EOFError, zipfile.BadZipFile):
        if inside and content.startswith(b"\x1f\x8b"):
            return gzip.compress(mutated(gzip.decompress(content), other, rng), 1)
        if inside and content.startswith(b"BZh"):
            return bz2.compress(mutated(bz2.decompress(content), other, rng), 1)
        if inside and content.startswith(b"PK"):
            packed = io.BytesIO()
            with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(packed, "w") as new:
                for entry in old.infolist():
                    new.writestr(entry.filename, mutated(old.read(entry), other, rng), entry.compress_type)
            return packed.getvalue()
    return mutated(content, other, rng)


def mutated(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Damage in one to a few places, near the start more often than elsewhere, as headers are there."""
    data = bytearray(content)
    for _ in range(rng.geometric(0.6)):
        at = int(len(data) * rng.random() ** rng.choice([1, 3]))
        kind = rng.integers(12)
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
        elif kind == 9:
            _reword(data, rng)
        elif kind == 10:
            _reline(data, rng)
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


def _reword(data: bytearray, rng: np.random.Generator) -> None:
    """Another word of the header in the place of one."""
    head = bytes(data[:1000])
    words = head.split()
    if len(words) > 1:
        old, new = (words[rng.integers(len(words))] for _ in range(2))
        at = head.find(old)
        data[at : at + len(old)] = new if rng.random() < 0.7 else WORDS[rng.integers(len(WORDS))]


def _reline(data: bytearray, rng: np.random.Generator) -> None:
    """A line of the header left out, or one of them again in another place."""
    head = bytes(data[:1000])
    lines = head.splitlines(keepends=True)
    if len(lines) > 2:
        line = lines.pop(rng.integers(len(lines) - 1))
        if rng.random() < 0.6:
            lines.insert(int(rng.integers(len(lines))), line)
            if rng.random() < 0.5:
                lines.insert(int(rng.integers(len(lines))), line)
        data[: len(head)] = b"".join(lines)
