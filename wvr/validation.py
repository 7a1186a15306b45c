"""Checks of user input that several modules share: each names the argument, what was given and what is accepted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def finite_vector(value: ArrayLike, name: str, meaning: str) -> NDArray[np.float64]:
    """``value`` as three finite float64 numbers; ``meaning`` says in the error what they are."""
    try:
        vector = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be three numbers ({meaning}), got {value!r}") from None
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"{name} must be three finite numbers ({meaning}), got {value!r}")
    return vector


def positive(value: Any, name: str) -> float:
    """``value`` as a finite float > 0."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number > 0, got {value!r}") from None
    if not (np.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be finite and > 0, got {value!r}")
    return number


def choice(value: Any, name: str, accepted: Sequence[str | None]) -> Any:
    """``value`` if it is one of ``accepted``."""
    if value not in accepted:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, accepted))}, got {value!r}")
    return value
