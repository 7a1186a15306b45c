"""Samples that had to be copied, of an array that somebody else may still write into."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from .checksum import checksum


class Copied:
    """What samples were copied from, for as long as somebody else has it, and how they are copied.

    Parameters
    ----------
    owner
        Who has the memory. It is not kept: it ends with its last user.
    read
        The NumPy or Warp array in that memory, of its owner; None where it has another one now.
    copy
        Makes samples of that array.
    """

    def __init__(self, owner: Any, read: Callable[[Any], Any], copy: Callable[[Any], Any]):
        self._read, self._copy = read, copy
        try:
            self._owner: Callable[[], Any] = ref(owner)
        except TypeError:
            self._owner = lambda: None
        self._sums = self._found = () if self.gone else _checksums(read(owner))

    @classmethod
    def of(cls, source: Any, read: Callable[[Any], Any], copy: Callable[[Any], Any]) -> Copied:
        """Of what a user gave: an array of NumPy's, or of a library that ``read`` shares memory with; others are gone
        at once.
        """
        if isinstance(source, np.ndarray):
            return cls(*_owner_of(source), copy)
        return cls(source if has_memory(source) else None, read, copy)

    @property
    def gone(self) -> bool:
        """Whether nobody has it any more, or it cannot be asked."""
        return self._owner() is None

    def renewed(self) -> Any:
        """Samples of what is there now; None where that is what it was when it was ``taken`` last, or is gone."""
        owner = self._owner()
        array = None if owner is None else self._read(owner)
        if array is None:
            return None
        self._found = _checksums(array)
        return None if self._found == self._sums else self._copy(array)

    def taken(self) -> None:
        """Say that what was renewed is in place, and nothing is left that was made of other samples: what Ctrl-C ended
        before that is asked again.
        """
        self._sums = self._found


def has_memory(array: Any) -> bool:
    """Whether it is an array of a library whose memory can be shared."""
    protocols = ("__dlpack__", "__cuda_array_interface__")
    return type(array).__module__.startswith("warp") or any(hasattr(array, name) for name in protocols)


class _View:
    """What NumPy makes an array of that lies in the memory of another, its ``owner``."""

    def __init__(self, interface: dict[str, Any], owner: NDArray):
        self.__array_interface__ = interface
        self.owner = owner


def _owner_of(source: NDArray) -> tuple[NDArray, Callable[[Any], NDArray | None]]:
    """The array whose memory a view, such as ``array[::2]``, is of, and how the view is made of it again."""
    owner: NDArray = source
    while type(owner) is np.ndarray and isinstance(owner.base, np.ndarray):
        owner = owner.base
    if owner is source or type(owner) is not np.ndarray:
        return source, lambda there: there
    interface, memory = source.__array_interface__, owner.__array_interface__["data"]
    # It has other memory if it was resized.
    return (
        owner,
        lambda there: (
            np.asarray(_View(interface, there)) if there.__array_interface__["data"][0] == memory[0] else None
        ),
    )


def _checksums(array: Any) -> tuple[bytes, ...]:
    """Of its memory, and of its mask."""
    if isinstance(array, np.ma.MaskedArray):
        return _checksums(array.data) + _checksums(np.ma.getmaskarray(array))
    if not isinstance(array, np.ndarray):
        return (checksum(array.contiguous()),)
    return (checksum(np.ascontiguousarray(array.T if array.flags.f_contiguous else array)),)
