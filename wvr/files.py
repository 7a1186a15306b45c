"""Files that appear whole or not at all, what their names must end in, and which are read at all."""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

# Bytes of a text that is read at once, beyond any that is meant.
LONGEST_TEXT = 1 << 26


def regular(path: Path) -> int:
    """The size of a file.

    Raises
    ------
    FileNotFoundError
        Where there is none.
    OSError
        For anything but a regular file, as others may never end.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        kinds = (
            (stat.S_ISDIR, "folder"), (stat.S_ISFIFO, "pipe"), (stat.S_ISSOCK, "socket"), (stat.S_ISCHR, "device"),
        )  # fmt: skip
        kind = next((name for is_kind, name in kinds if is_kind(found.st_mode)), "device")
        raise OSError(f"{path} is a {kind}, a regular file is expected: write its content into one first")
    return found.st_size


def read_text(path: Path) -> str:
    """The text of a UTF-8 file."""
    if (size := regular(path)) > LONGEST_TEXT:
        raise OSError(f"{path} has {size:,} bytes; a text of at most {LONGEST_TEXT:,} is expected")
    return path.read_text(encoding="utf-8")


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, which becomes ``path`` if the block ends well, else vanishes.

    What was there keeps its mode, and a symbolic link goes on to what it names. It is open, as encoders that are given
    a name add the extension they like and write to another file. The few that take nothing but a name find it in
    ``.name``.
    """
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in a folder that exists, got {str(path)!r}")
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OSError(f"path must be a file, or none yet, got {str(path)!r}, which is no regular file")
    temporary = _beside(target)
    # Opened here, an unwritable folder is the same OSError whatever the encoder would have made of it.
    with naming(path):
        file = temporary.open("xb")
    try:
        with naming(path), _encoding(path), file:
            _lock(file.fileno())
            if target.exists():
                os.chmod(temporary, stat.S_IMODE(target.stat().st_mode))
            yield file
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def scratch_folder(target: Path) -> Iterator[Path]:
    """A hidden folder beside what is to be made in it, which vanishes with all that is left there."""
    folder, descriptor = _beside(target), None
    with naming(target):
        folder.mkdir(mode=0o700)
    try:
        with suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            _lock(descriptor)
        with naming(target):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if descriptor is not None:
            os.close(descriptor)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """What a system refuses, such as space, names the file that was asked for."""
    try:
        yield
    except OSError as error:
        if error.filename is not None and ".wvr-" not in str(error.filename):
            raise  # it is about another
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def _encoding(path: Path) -> Iterator[None]:
    """Encoders say how many bytes were not written, but neither where nor why."""
    try:
        yield
    except OSError as error:
        if error.errno is not None or str(path) in str(error):
            raise
        raise OSError(f"{path} could not be written: {error}; is there space for it?") from error


def _beside(target: Path) -> Path:
    """A hidden name of its own beside a target; what killed processes have left under others is taken away."""
    # Of this name alone and of any length of it.
    stem = f".wvr-{hashlib.blake2b(target.name.encode('utf-8', 'surrogateescape'), digest_size=6).hexdigest()}-"
    _clean(target.parent, stem)
    return target.with_name(stem + secrets.token_hex(6))


def _lock(descriptor: int) -> None:
    """Keep others from taking a file for one that was left behind, where the system knows locks."""
    with suppress(ImportError, OSError):
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _clean(folder: Path, stem: str) -> None:
    try:
        import fcntl
    except ImportError:
        return
    for old in folder.glob(f"{stem}*"):
        with suppress(OSError):
            descriptor = os.open(old, os.O_RDONLY)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails where somebody writes it
                shutil.rmtree(old) if old.is_dir() else old.unlink()
            finally:
                os.close(descriptor)


def write_text(path: Path, text: str) -> None:
    """``text`` as a UTF-8 file that appears whole or not at all."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8"))


def known_suffix(
    path: Path, accepted: Collection[str], name: str = "path", elsewhere: Mapping[str, str] = MappingProxyType({})
) -> str:
    """The extension of ``path`` in lower case if it is one of ``accepted``; ``name`` says in the error whose it is, and
    ``elsewhere`` what writes others.
    """
    suffix = path.suffix.lower()
    if suffix not in accepted:
        said = f"; {elsewhere[suffix]}" if suffix in elsewhere else ""
        raise ValueError(f"{name} must end in {', '.join(accepted)}, got {str(path)!r}{said}")
    return suffix
