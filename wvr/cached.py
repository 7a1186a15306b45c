"""Properties that are computed once, without the lock for all objects of a class that ``functools`` holds meanwhile up
to Python 3.11: threads with scenes of their own waited for each other, and a child that was forked then for ever.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or sys.version_info >= (3, 12):
    from functools import cached_property
else:
    import functools

    class cached_property(functools.cached_property):  # noqa: N801 - as it is called there
        """As that of Python 3.12: two threads may compute it at a time."""

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            if instance is None:
                return self
            kept = vars(instance)
            if self.attrname not in kept:
                kept[self.attrname] = self.func(instance)
            return kept[self.attrname]


__all__ = ["cached_property"]
