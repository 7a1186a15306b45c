"""Files that appear whole or not at all, and what their names must end in."""

from __future__ import annotations

import os
import secrets
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write to, which becomes ``path`` if the block ends well, else vanishes.

    It is open, as encoders that are given a name add the extension they like and write to another file. The few that
    take nothing but a name find it in ``.name``.
    """
    if not path.parent.is_dir():
        raise FileNotFoundError(f"path must be in a folder that exists, got {str(path)!r}")
    temporary = path.with_name(f".{secrets.token_hex(6)}")
    # Opened here, an unwritable folder is the same OSError whatever the encoder would have made of it.
    file = temporary.open("xb")
    try:
        with file:
            yield file
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


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
