"""Warp's folder of compiled kernels: whether it can be written to, and whether what is in it is whole.

Warp takes what it finds there as it is, and a damaged file or a full disk ends the process. So a module is sealed, once
it was loaded, with check sums of its files; what is not sealed, or another than was sealed, is compiled anew. Where the
folder cannot be used, a temporary one is, for as long as the process lives.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import warp as wp

from .notices import announce, log

SEAL = "wvr-seal.json"
# Bytes that have to be free: a module takes less than one of these.
ROOM = 1 << 24
# No kernel has bfloat16, and Warp's headers take a third less time without: as Warp itself defines it, but also where
# headers are compiled ahead. What they make of their own templates is made with them: a twenty-fifth of compiling less,
# the objects are the same.
LEAN = "-DWP_NO_BFLOAT16= -fpch-instantiate-templates"
# Warp has everything inlined that is not huge. Only rays one by one and tables are faster for it, and it takes half as
# long again.
DEEP = "-mllvm=-"


def start() -> None:
    """Initialise Warp, with a folder of kernels that can be made."""
    with wp.ScopedLogLevel(wp.LOG_WARNING):
        try:
            wp.init()
        except OSError as error:
            _go_elsewhere(Path(wp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH", "~/.cache/warp")), error)
            wp.init()


def load(kernel: wp.Kernel, device: wp.Device, block_dim: int, deep: bool = True) -> None:
    """Load the module of a kernel, compiled now unless it was and is whole; ``deep``, with large functions inlined."""
    module = kernel.module
    flags = module.options["cpu_compiler_flags"]
    if flags is None:
        flags = "-march=native" if wp.config.cpu_compiler_flags is None else wp.config.cpu_compiler_flags
        kept = [flag for flag in flags.split() if deep or not flag.startswith(DEEP)]
        wp.set_module_options({"cpu_compiler_flags": " ".join([*kept, LEAN])}, module)
    name = module.get_module_identifier(block_dim)
    with _alone(name), wp.ScopedLogLevel(wp.LOG_WARNING):
        if not _whole(_folder() / name):
            _make_room(name)
            kind = kernel.key.rpartition("__")[2]
            announce(
                "compiling the kernel %s for %s (once; a few seconds; wvr.warm_up does it ahead)", kind, device.alias
            )
        module.load(device, block_dim)
        with suppress(OSError):
            _seal(_folder() / name)


def _folder() -> Path:
    return Path(wp.config.kernel_cache_dir)


@contextmanager
def _alone(name: str) -> Iterator[None]:
    """No other process compiles the same meanwhile, where the file system knows locks."""
    try:
        import fcntl

        file = (_folder() / f".{name}.lock").open("w")
    except (ImportError, OSError):
        yield
        return
    with file:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _sums(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.iterdir() if path.name != SEAL and path.is_file())
    return {path.name: hashlib.blake2b(path.read_bytes()).hexdigest() for path in files}


def _whole(folder: Path) -> bool:
    try:
        return json.loads((folder / SEAL).read_bytes()) == _sums(folder)
    except (OSError, ValueError):
        return False


def _seal(folder: Path) -> None:
    if not _whole(folder):
        temporary = folder / f".{SEAL}.{os.getpid()}"
        sums = _sums(folder)
        temporary.write_text(json.dumps(sums), encoding="utf-8")
        os.replace(temporary, folder / SEAL)


def _make_room(name: str) -> None:
    """Take away what is not whole, and see that there is space for it to be made anew; else go elsewhere."""
    folder = _folder()
    try:
        if (folder / name).is_dir():
            shutil.rmtree(folder / name)
        else:
            (folder / name).unlink(missing_ok=True)
        _try_to_write(folder)
    except OSError as error:
        _go_elsewhere(folder, error)


def _try_to_write(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as file:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, ROOM)
        else:
            file.write(bytes(ROOM))
            file.flush()


def _go_elsewhere(folder: Path, error: OSError) -> None:
    reason = error.strerror or str(error)
    temporary = None
    try:
        temporary = Path(tempfile.mkdtemp(prefix="wvr-kernels-"))
        atexit.register(_remove, temporary, os.getpid())
        _try_to_write(temporary)
    except OSError as other:
        raise OSError(
            f"kernels can be compiled neither into {folder} ({reason}) nor into {temporary or tempfile.gettempdir()} "
            f"({other.strerror or other}): free some space, or set WARP_CACHE_PATH to a folder that can be written to"
        ) from None
    log.warning(
        "kernels cannot be kept in %s (%s): they are compiled into %s for this process alone; set WARP_CACHE_PATH to a "
        "folder that can be written to",
        folder,
        reason,
        temporary,
    )
    wp.config.kernel_cache_dir = str(temporary)


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # not a forked child
        shutil.rmtree(folder, ignore_errors=True)
