"""Frames that end early, and locks that nobody waits for then."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from math import inf
from time import perf_counter
from types import FrameType
from typing import Any, TypeVar
from weakref import WeakSet

T = TypeVar("T")
# How often a waiting thread looks whether its frame is cancelled [s].
POLL = 0.02

cancel: ContextVar[Any] = ContextVar("wvr_cancel", default=None)


class Cancelled(Exception):  # noqa: N818 - no error, somebody asked for it
    """A frame ended early since its ``cancel`` was set.

    Not a RuntimeError: Warp raises those where a device fails, and who handles them must not take this for a failure.
    """


@contextmanager
def cancelling(event: Any) -> Iterator[None]:
    """Launches within end early, with :class:`Cancelled`, once the ``event`` is set; None never is.

    Raises
    ------
    TypeError
        For an event without a method ``is_set``.
    """
    if event is not None and not callable(getattr(event, "is_set", None)):
        raise TypeError(f"cancel must be a threading.Event or None, got {event!r}")
    token = cancel.set(event)
    try:
        yield
    finally:
        cancel.reset(token)


def waited(future: Any, until: float | None = None) -> Any:
    """The result of a future, of ``concurrent.futures`` or Dask; a cancelled frame does not wait for it.

    Raises
    ------
    Cancelled
        Where the event of :func:`cancelling` is set.
    TimeoutError
        As of the future, where it is not there after so many seconds.
    """
    end = inf if until is None else perf_counter() + until
    if cancel.get() is not None:
        while not future.done() and perf_counter() < end:
            check_cancelled()
            # That it is not there yet, or what is raised again below.
            with suppress(Exception):
                future.exception(min(POLL, end - perf_counter()))
    return future.result(None if until is None else max(0.0, end - perf_counter()))


def check_cancelled() -> None:
    event = cancel.get()
    if event is not None and event.is_set():
        raise Cancelled("cancel was set")


def aside(work: Callable[..., T], *arguments: Any) -> T:
    """What some work comes to, not in the main thread: Ctrl-C comes there, and is lost where h5py lets go of things."""
    if threading.current_thread() is not threading.main_thread():
        return work(*arguments)
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(copy_context().run, work, *arguments).result()


class Lock:
    """A lock that a cancelled frame does not wait for, that is open in a forked child whoever held it, and open to the
    thread whose frame Ctrl-C ended on its way out.
    """

    def __init__(self) -> None:
        self.open()
        _locks.add(self)

    def open(self) -> None:
        self._lock = threading.RLock()
        self._holder: list[int] = []  # which thread, by which call: each time another list

    def __reduce__(self) -> tuple:
        return Lock, ()  # a copy, or what is unpickled, has one of its own

    @contextmanager
    def held(self) -> Iterator[None]:
        """Raises RuntimeError where the thread itself holds it: it would wait for ever."""
        frame: FrameType | None = sys._getframe(2)
        mine = [threading.get_ident(), id(frame)]
        while frame is not None and self._holder[:1] == mine[:1]:
            if id(frame) == self._holder[1]:
                raise RuntimeError("a renderer is busy with a frame of this thread: progress= must not ask for another")
            frame = frame.f_back
        if not self._holder or self._holder[:1] == mine[:1]:
            self._release()  # what Ctrl-C left: who took it is at work no more
        try:
            while not self._lock.acquire(timeout=POLL):
                check_cancelled()
            self._holder = mine
            check_cancelled()
            yield
        finally:
            # Ctrl-C may come before it is written down who has it.
            if not self._holder or self._holder is mine:
                self._release()

    def _release(self) -> None:
        """Open it if the thread has it."""
        if self._holder[:1] == [threading.get_ident()]:
            self._holder = []
        with suppress(RuntimeError):
            self._lock.release()


_locks: WeakSet[Lock] = WeakSet()


def open_locks() -> None:
    """In the child of a fork, where nobody else is to open any."""
    for lock in _locks:
        lock.open()
