"""Volumes by name, generated or downloaded."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..memory import free_host_memory, gib
from ..validation import choice, integer, near, within
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

# How options of generated volumes are checked.
OPTIONS: dict[str, Callable[[Any, str], Any]] = {
    "seed": lambda value, name: integer(value, name, 0),
    "count": lambda value, name: integer(value, name, 1),
    "periods": lambda value, name: within(value, name, 1e6),
    "phase": lambda value, name: within(value, name, np.inf),
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
    choice(name, "name", names())
    size = integer(size, "size", 2)
    accepted = list(signature(GENERATED[name]).parameters)[1:]
    for option, value in options.items():
        if option not in accepted:
            there = f"of {name!r} are {', '.join(accepted)}" if accepted else f"are none of {name!r}"
            raise TypeError(f"options {there}, got {option!r}{near(option, accepted)}")
        options[option] = OPTIONS[option](value, option)
    if (needed := BYTES * size**3) > (free := free_host_memory()):
        raise MemoryError(f"size = {size} takes {gib(needed)} to generate, of which {gib(free)} are free")
    return Volume(GENERATED[name](size, **options))
