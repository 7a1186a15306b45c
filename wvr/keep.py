"""Kept parts: what is built once for a scene and stays for the next frame.

The fields of a part are what it depends on, so a key can forget nothing: equal fields, equal part. Parts may have parts
as fields. Of each kind those that the last frame asked for stay, and others as long as there is room.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import warp as wp

from .cancel import Cancelled, Lock

# Bytes of parts that the last frame did not ask for.
SPARE = 1 << 30


class Part(ABC):
    """Something that is built from its fields alone; subclasses are frozen dataclasses."""

    name: ClassVar[str]  #: what ``Keeper.builds`` counts it as

    @abstractmethod
    def build(self, keep: Keeper) -> Any:
        """Make it; ``keep`` gives the parts that it needs, and arrays to write into."""


class Keeper:
    """Parts on a device, by what they are.

    Attributes
    ----------
    builds
        How often parts of a name were built.
    lock
        For threads that share it.
    """

    def __init__(self, device: wp.Device):
        self.device = device
        self.lock = Lock()
        self._beside: Keeper | None = None
        self.builds: Counter[str] = Counter()
        self._torn = False  # a frame began and has not ended, or it did so anywhere
        self._forget()

    def _forget(self) -> None:
        """Have nothing."""
        self._kept: dict[Part, Any] = {}  # those asked for last come last
        self._asked: dict[Part, Any] = {}
        self._building: list[Part] = []
        self._needs: dict[Part, list[Part]] = {}  # that a part was built from
        self._arrays: dict[Part, list[wp.array]] = {}  # that a part was given to write into
        self._free: list[wp.array] = []
        self._scratch: dict[str, wp.array] = {}

    def __call__(self, part: Part) -> Any:
        """The part: kept, or built now."""
        if self._building:
            self._needs[self._building[-1]].append(part)
        if part not in self._kept:
            self._building.append(part)
            self._needs[part] = []
            try:
                self._kept[part] = part.build(self)
            except BaseException:
                self._let_go(part)
                raise
            finally:
                self._building.pop()
            self.builds[part.name] += 1
        self._ask(part)
        return self._kept[part]

    def beside(self) -> Keeper:
        """Another, always the same, for what is asked of images: the parts here may be another scene's by then."""
        if self._beside is None:
            self._beside = Keeper(self.device)
        return self._beside

    def _ask(self, part: Part) -> None:
        """What a part was built from stays with it: what is built next may need that too."""
        if part in self._kept and part not in self._asked:
            self._asked[part] = self._kept[part]
            for need in self._needs[part]:
                self._ask(need)

    def _let_go(self, part: Part) -> None:
        self._needs.pop(part, None)
        self._free += self._arrays.pop(part, [])

    def empty(self, shape: tuple[int, ...], dtype: Any) -> wp.array:
        """An array for the part that is being built, one of a part that was let go if there is such: memory that a
        process touches for the first time is slow, and volumes of one shape follow each other.
        """
        fits = (i for i, array in enumerate(self._free) if array.shape == tuple(shape) and array.dtype is dtype)
        found = next(fits, None)
        array = wp.empty(shape, dtype=dtype, device=self.device) if found is None else self._free.pop(found)
        self._arrays.setdefault(self._building[-1], []).append(array)
        return array

    def scratch(self, name: str, shape: tuple[int, ...], dtype: Any, host: bool = False) -> wp.array:
        """An array that frames leave to one another, for what does not outlast a frame; on the ``host`` page-locked
        memory that the device copies to.
        """
        array = self._scratch.get(name)
        if array is None or array.shape != tuple(shape) or array.dtype is not dtype:
            where = wp.get_device("cpu") if host else self.device
            pinned = host and self.device.is_cuda
            array = None
            self._scratch.pop(name, None)  # before there is another
            self._scratch[name] = array = wp.empty(shape, dtype=dtype, device=where, pinned=pinned)
        return array

    def held(self, name: str) -> int:
        """Bytes of an array of ``scratch`` that is there."""
        return self._scratch[name].capacity if name in self._scratch else 0

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Within it parts are asked for. Where it ends anywhere, as Ctrl-C ends one, what is known of parts and arrays
        may be half written down: the next one begins with nothing.
        """
        if self._torn:
            self._forget()
        self._torn = True
        try:
            yield
        except Cancelled:
            self.end_of_frame()
            self._torn = False
            raise
        self.end_of_frame()
        self._torn = False

    def end_of_frame(self) -> None:
        """Let go of what was not asked for: parts of the names that were, and others that there is no room for."""
        names = {part.name for part in self._asked}
        spare = {part: built for part, built in self._kept.items() if part not in self._asked}
        room = SPARE - sum(_bytes(built) for part, built in spare.items() if part.name not in names)
        kept = {}
        for part, built in spare.items():
            if part.name not in names and room >= 0:
                kept[part] = built
            else:
                room += _bytes(built) * (part.name not in names)
                self._let_go(part)
        while self._free and sum(array.capacity for array in self._free) > SPARE:
            self._free.pop(0)
        self._kept = kept | self._asked
        self._asked = {}


def _bytes(built: Any) -> int:
    """Memory of the arrays in what was built."""
    if isinstance(built, wp.array):
        return built.capacity
    return sum(map(_bytes, built)) if isinstance(built, tuple | list) else 0
