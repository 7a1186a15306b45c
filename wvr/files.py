"""Files that appear whole or not at all, and what their names must end in."""

from __future__ import annotations

import hashlib
import os
import secrets
import stat
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


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
    # Hidden, of this name alone and of any length of it.
    stem = f".wvr-{hashlib.blake2b(target.name.encode('utf-8', 'surrogateescape'), digest_size=6).hexdigest()}-"
    _clean(target.parent, stem)
    temporary = target.with_name(stem + secrets.token_hex(6))
    # Opened here, an unwritable folder is the same OSError whatever the encoder would have made of it.
    file = temporary.open("xb")
    try:
        with file:
            _lock(file)
            if target.exists():
                os.chmod(temporary, stat.S_IMODE(target.stat().st_mode))
            yield file
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _lock(file: BinaryIO) -> None:
    """Keep others from taking a file for one that was left behind, where the system knows locks."""
    with suppress(ImportError, OSError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _clean(folder: Path, stem: str) -> None:
    """Take away what processes that were killed have left."""
    try:
        import fcntl
    except ImportError:
        return
    for old in folder.glob(f"{stem}*"):
        with suppress(OSError), old.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # fails where somebody writes it
            old.unlink()


def write_text(path: Path, text: str) -> None:
    """``text`` as a UTF-8 file that appears whole or not at all."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8"))


def known_suffix(path: Path, accepted: Collection[str], name: str = "path") -> str:
    """The extension of ``path`` in lower case if it is one of ``accepted``; ``name`` says in the error whose it is."""
    suffix = path.suffix.lower()
    if suffix not in accepted:
        raise ValueError(f"{name} must end in {', '.join(accepted)}, got {str(path)!r}")
    return suffix
