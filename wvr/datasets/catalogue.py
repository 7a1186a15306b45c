"""Volumes by name, generated or downloaded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from ..memory import free_host_memory
from ..validation import integer
from ..volume import Volume
from .downloads import DOWNLOADS, fetch
from .fields import blobs, gyroid, marschner_lobb, shepp_logan, spheres, turbulence
from .heart import heart
from .tree import tree

GENERATED: dict[str, Callable[..., NDArray]] = {
    "marschner_lobb": marschner_lobb,
    "spheres": spheres,
    "shepp_logan": shepp_logan,
    "blobs": blobs,
    "gyroid": gyroid,
    "turbulence": turbulence,
    "tree": tree,
    "heart": heart,
}

# Bytes that generating takes for a sample.
BYTES = 60


def names() -> list[str]:
    """What :func:`load` knows: the generated volumes (the keys of ``GENERATED``), then those of ``DOWNLOADS``."""
    return [*GENERATED, *DOWNLOADS]


def load(name: str, size: int = 128, **options: Any) -> Volume:
    """A volume by name.

    Parameters
    ----------
    name
        One of :func:`names`.
    size
        Samples along each axis of a generated volume, >= 2; a downloaded one has the size it has.
    **options
        Of the generated volume: ``seed`` of ``"blobs"``, ``"turbulence"``, ``"tree"`` and ``"heart"``, ``count`` of
        ``"blobs"``, ``periods`` of ``"gyroid"``, ``phase`` of ``"heart"`` (of a beat, 0 to 1 and on); of a downloaded
        one: ``cache``, see :func:`fetch`.

    Raises
    ------
    ValueError
        For an unknown name or a size that is no integer >= 2.
    MemoryError
        For a size that would not fit the memory.
    OSError
        When a download fails.
    """
    if not isinstance(name, str):
        raise TypeError(f"name must be one of {', '.join(map(repr, names()))}, got {name!r}")
    if name in DOWNLOADS:
        return fetch(name, **options)
    if name not in GENERATED:
        raise ValueError(f"name must be one of {', '.join(map(repr, names()))}, got {name!r}")
    size = integer(size, "size", 2)
    if (needed := BYTES * size**3) > (free := free_host_memory()):
        raise MemoryError(
            f"size = {size} takes {needed / 2**30:.1f} GiB to generate, of which {free / 2**30:.1f} GiB are free"
        )
    return Volume(GENERATED[name](size, **options))
