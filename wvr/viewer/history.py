"""Undo and redo."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

Edited = TypeVar("Edited")
# Undo goes so many edits back.
MOST = 200


class History(Generic[Edited]):
    """What was before edits, and before they were undone. Edits of one drag are one."""

    def __init__(self) -> None:
        self._past: list[Edited] = []
        self._future: list[Edited] = []
        self._drag: Any = None

    def note(self, before: Edited, drag: Any = None) -> None:
        """An edit of ``before``; those with an equal ``drag`` that is not None are one."""
        if drag is None or drag != self._drag:
            self._past = [*self._past, before][-MOST:]
        self._future, self._drag = [], drag

    def undo(self, now: Edited) -> Edited:
        """What was before; the same where there is none."""
        return self._step(self._past, self._future, now)

    def redo(self, now: Edited) -> Edited:
        """What was undone last; the same where there is none."""
        return self._step(self._future, self._past, now)

    @property
    def depth(self) -> tuple[int, int]:
        """How often undo and redo do something."""
        return len(self._past), len(self._future)

    def _step(self, source: list[Edited], sink: list[Edited], now: Edited) -> Edited:
        self._drag = None
        if not source:
            return now
        sink.append(now)
        return source.pop()
