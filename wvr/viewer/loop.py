"""The progressive loop: of the newest state a coarse picture at once, then better ones until it is done.

An event makes a new state. A refinement ends within a few rays when one comes. A coarse picture is always finished and
shown, however fast events come, or the picture would stand still while a mouse moves; what comes meanwhile is taken up
together in the next. So

- states are shown in the order that they came in, none after a newer one;
- a coarse picture is of the state that was the newest when it was begun, a refinement of the one that is the newest
  when it is shown;
- the last picture is that of the last state, refined to the end.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Generic, Protocol, TypeVar

from ..cancel import Cancelled

State = TypeVar("State")
Stage = TypeVar("Stage")
Picture = TypeVar("Picture")
StateIn = TypeVar("StateIn", contravariant=True)
PictureOut = TypeVar("PictureOut", covariant=True)


class Painter(Protocol[StateIn, Stage, PictureOut]):
    """What makes pictures."""

    def stages(self, state: StateIn) -> Sequence[Stage]:
        """Stages of a state, the coarse one first, the final one last."""

    def paint(self, state: StateIn, stage: Stage, cancel: threading.Event) -> PictureOut:
        """The picture of a stage.

        Raises
        ------
        Cancelled
            Where ``cancel`` is set before it is done.
        """


class Loop(Generic[State, Stage, Picture]):
    """A thread that paints the newest state.

    Parameters
    ----------
    state
        Before the first event; it is not painted.
    painter
        Makes the pictures.
    show
        Called with the number of a state and a picture of it, or the error that there is instead. No event comes in
        while it runs, so it must not wait for anything.
    """

    def __init__(
        self,
        state: State,
        painter: Painter[State, Stage, Picture],
        show: Callable[[int, Picture | Exception], None],
    ):
        self._painter = painter
        self._show = show
        self._changed = threading.Condition()
        self._state = state
        self._number = 0
        self._done = 0
        self._refining = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wvr-viewer", daemon=True)
        self._thread.start()

    @property
    def state(self) -> State:
        """The newest."""
        return self._state

    def change(self, update: Callable[[State], State]) -> int:
        """An event: the newest state becomes another; returns its number. Any thread may call it."""
        with self._changed:
            state = update(self._state)
            if state != self._state:
                self._state = state
                self._number += 1
                self._refining.set()
                self._changed.notify_all()
            return self._number

    def settle(self, timeout: float | None = None) -> bool:
        """Wait until the newest state is painted to the end; whether it is."""
        end = None if timeout is None else monotonic() + timeout
        with self._changed:
            while self._done != self._number and not self._closing.is_set():
                self._changed.wait(None if end is None else max(end - monotonic(), 0))
                if end is not None and monotonic() >= end:
                    break
            return self._done == self._number

    def close(self) -> None:
        """End it; nothing is shown or running any more when this returns."""
        with self._changed:
            self._closing.set()
            self._refining.set()
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._done == self._number and not self._closing.is_set():
                    self._changed.wait()
                if self._closing.is_set():
                    return
                number, state = self._number, self._state
                self._refining = threading.Event()
            self._paint(number, state)

    def _paint(self, number: int, state: State) -> None:
        try:
            for n, stage in enumerate(self._painter.stages(state)):
                picture = self._painter.paint(state, stage, self._closing if n == 0 else self._refining)
                if not self._present(number, picture, coarse=n == 0):
                    return
        except Cancelled:
            return
        except Exception as error:  # whatever it is, whoever looks at the viewer has to know
            if not self._present(number, error, coarse=False):
                return
        with self._changed:
            self._done = number
            self._changed.notify_all()

    def _present(self, number: int, picture: Picture | Exception, coarse: bool) -> bool:
        """Show a picture, unless it is stale; whether its state is still the newest."""
        with self._changed:
            newest = number == self._number
            if not self._closing.is_set() and (coarse or newest):
                self._show(number, picture)
            return newest and not self._closing.is_set()
