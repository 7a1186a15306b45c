"""Another renderer in a process of its own, which measures its own frames: what ends it ends nothing else."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

import wvr

from .harness import Time, timed

if TYPE_CHECKING:
    from typing_extensions import Self

PATIENCE = 120.0  # seconds until a frame counts as hung


class NotAvailableError(Exception):
    """A peer cannot render here; says why."""


class Painter(Protocol):
    """What renders in the other process."""

    def draw(self, step: float, camera: wvr.Camera | None) -> None:
        """Render a frame, as far as an array on the host, with samples ``step`` smallest voxel spacings apart, from
        the scene's camera or another one.
        """

    def image(self) -> NDArray[np.floating]:
        """The last frame: premultiplied RGBA (height, width, 4), row 0 at the top."""


class Peer:
    """A peer's process; used with ``with``.

    Parameters
    ----------
    make
        Returns the painter; a function at the top of a module, as another process has to find it.
    arguments
        What it is called with there.
    hint
        Why the process may have ended.
    """

    def __init__(self, make: Callable[..., Painter], *arguments: Any, hint: str):
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, make, arguments), daemon=True)
        self._hint = hint
        self._process.start()
        other.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._process.kill()
        self._process.join()

    def frame(self, step: float = 1.0, camera: wvr.Camera | None = None) -> Time:
        """Render a frame with samples ``step`` smallest voxel spacings apart, from another camera if one is given: the
        time it took, read-back included.
        """
        return self.ask("draw", step, camera)

    def missing(self) -> str | None:
        """Why it cannot render here; None where it does, as its first frame tells."""
        try:
            self.frame()
        except NotAvailableError as error:
            return str(error)
        return None

    def image(self) -> NDArray[np.floating]:
        """The last frame: premultiplied RGBA (height, width, 4), row 0 at the top."""
        return self.ask("image")

    def ask(self, *question: Any) -> Any:
        """What a method of the painter returns, by its name and arguments; of ``draw``, how long it took."""
        try:
            self._connection.send(question)
            if not self._connection.poll(PATIENCE):
                raise NotAvailableError(f"no frame within {PATIENCE:g} s")
            answer = self._connection.recv()
        except (EOFError, OSError):
            self._process.join()
            raise NotAvailableError(
                f"its process ended with exit code {self._process.exitcode} ({self._hint})"
            ) from None
        if isinstance(answer, NotAvailableError):
            raise answer
        if isinstance(answer, Exception):
            raise NotAvailableError(repr(answer))
        return answer


def _serve(connection: Connection, make: Callable[..., Painter], arguments: tuple[Any, ...]) -> None:
    """Answers questions until the parent ends it."""
    try:
        painter = make(*arguments)
        while True:
            name, *given = connection.recv()
            work = partial(getattr(painter, name), *given)
            connection.send(timed(work)() if name == "draw" else work())
    except Exception as error:  # whatever it is, the parent reports it
        connection.send(error)
