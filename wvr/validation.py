"""Checks of user input that several modules share: each names the argument, what was given and what is accepted."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cancel import aside

# The largest integer that machines count in.
LARGEST = 2**63 - 1


def finite_vector(value: ArrayLike, name: str, meaning: str) -> NDArray[np.float64]:
    """``value`` as three finite float64 numbers; ``meaning`` says in the error what they are."""
    try:
        vector = float_array(value, name)
    except TypeError:
        raise ValueError(f"{name} must be three numbers ({meaning}), got {value!r}") from None
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"{name} must be three finite numbers ({meaning}), got {value!r}")
    return vector


def positive(value: Any, name: str) -> float:
    """``value`` as a finite float > 0."""
    number = real(value, name, "a number > 0")
    if not (np.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be finite and > 0, got {value!r}")
    return number


def below_one(value: Any, name: str) -> float:
    """``value`` as a float > 0 and < 1."""
    number = positive(value, name)
    if number >= 1:
        raise ValueError(f"{name} must be below 1, got {value!r}")
    return number


def share(value: Any, name: str) -> float:
    """``value`` as a float > 0 and <= 1."""
    number = real(value, name, "a number in (0, 1]")
    if not 0 < number <= 1:
        raise ValueError(f"{name} must be in (0, 1], got {value!r}")
    return number


def define(instance: Any, **fields: Any) -> None:
    """Fields of a frozen dataclass as its checks return them: plain numbers, which are equal and hashable."""
    for name, value in fields.items():
        object.__setattr__(instance, name, value)


def within(value: Any, name: str, limit: float) -> float:
    """``value`` as a float between ``-limit`` and ``limit``."""
    try:
        number = real(value, name)
    except TypeError:
        number = np.nan
    if not -limit < number < limit:
        raise ValueError(f"{name} must be a number in (-{limit:g}, {limit:g}), got {value!r}")
    return number


def real(value: Any, name: str, what: str = "a number") -> float:
    """``value`` as a float, of anything that is one number, no text and no truth; those beyond floats are infinite."""
    try:
        if isinstance(value, bool | np.bool_ | str | bytes | bytearray | np.datetime64 | np.timedelta64):
            raise TypeError
        return float(value)
    except OverflowError:
        return np.inf if value > 0 else -np.inf
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be {what}, got {value!r}") from None


def integer(value: Any, name: str, least: int, most: int | None = None) -> int:
    """``value`` as an int from ``least`` to ``most``."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not least <= value <= (LARGEST if most is None else most):
        far = whole and value > LARGEST  # beyond what sizes are counted in
        accepted = f"from {least} to {LARGEST if most is None else most}" if far or most is not None else f">= {least}"
        raise ValueError(f"{name} must be an integer {accepted}, got {value!r}")
    return int(value)


def flag(value: Any, name: str) -> bool:
    """``value`` if it is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {value!r}")
    return bool(value)


def path_of(value: Any, name: str = "path") -> Path:
    """``value`` as a path that a system may know."""
    try:
        path = Path(os.fsdecode(value))
    except TypeError:
        raise TypeError(f"{name} must be a path (str or os.PathLike), got {type(value).__name__}") from None
    if not os.fspath(value):
        raise ValueError(f"{name} must not be empty")
    if "\0" in str(path):
        raise ValueError(f"{name} must not have a null character in it, got {value!r}")
    return path


def computed(values: Any) -> Any:
    """What Dask computes of its arrays, and one of a list of arrays of which some are masked: with the mask, of which
    ``np.asarray`` says nothing.
    """
    if isinstance(values, list | tuple) and any(map(np.ma.is_masked, values)):
        with suppress(ValueError):  # rows that differ in length
            return np.ma.array(values)
    return values.compute() if type(values).__module__.startswith("dask.array") else values


def unmasked(values: Any, name: str) -> Any:
    """``values``, of which none is masked: what is under a mask is no number that anybody means."""
    values = computed(values)
    if np.ma.is_masked(values):
        raise TypeError(
            f"{name} must have no masked numbers, got {np.ma.count_masked(values)}: {name}.filled(value) gives them one"
        )
    return values


def any_array(values: Any, name: str, masks: bool = False) -> NDArray:
    """What NumPy makes of ``values``, with what is masked or refused; lists of lists of several lengths are none."""
    values = computed(values) if masks else unmasked(values, name)
    if np.ma.is_masked(values):
        return values
    try:
        # What has a shape and is not in memory is read.
        held = isinstance(values, np.ndarray | np.generic) or not hasattr(values, "shape")
        return np.asarray(values) if held else aside(np.asarray, values)
    except ValueError:
        raise TypeError(f"{name} must be an array, got a {type(values).__name__} whose rows differ in length") from None


def float_array(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """A float64 copy of numbers, which are real and no text."""
    values = unmasked(values, name)
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biufO":
            raise TypeError
        with np.errstate(over="ignore"):
            return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be numbers, got {values!r}") from None


def at_most(bound: float) -> str:
    """A bound >= 0 in two digits, rounded up, so that it is one."""
    if not 0 < bound < np.inf:
        return f"{bound:g}"
    digit = 10.0 ** (floor(log10(bound)) - 1)
    return f"{ceil(bound / digit * (1 - 1e-12)) * digit:.2g}"


def choice(value: Any, name: str, accepted: Sequence[str | None]) -> Any:
    """``value`` if it is one of ``accepted``."""
    if not isinstance(value, str | None) or value not in accepted:
        raise ValueError(
            f"{name} must be one of {', '.join(map(repr, accepted))}, got {value!r}{near(value, accepted)}"
        )
    return value


def finite_array(values: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """A read-only finite float64 copy of ``values`` of this shape (-1: any length)."""
    # Adding 0 turns -0 into 0, so that equal transfer functions have equal keys.
    array = float_array(values, name) + 0.0
    expected = tuple(got if want == -1 else want for want, got in zip(shape, array.shape, strict=False))
    if array.ndim != len(shape) or array.shape != expected:
        wanted = str(shape).replace("-1", "n")
        raise ValueError(f"{name} must have shape {wanted}, got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} must be finite, got {array[~np.isfinite(array)][0]}")
    array.flags.writeable = False
    return array


def check_domain(domain: Any) -> tuple[float, float]:
    """``domain`` as (lo, hi), finite and lo < hi."""
    lo, hi = finite_array(domain, "domain", (2,)).tolist()
    if not lo < hi or hi - lo == np.inf:
        raise ValueError(f"domain must be (lo, hi) with lo < hi, got ({lo!r}, {hi!r})")
    return lo, hi


def near(given: Any, accepted: Sequence[Any]) -> str:
    """A question for the end of an error, whether the closest of the accepted names was meant; empty if none is."""
    if not isinstance(given, str):
        return ""
    names = {str(name).lower(): name for name in accepted if isinstance(name, str)}
    tried = (given.lower(), given.lower().replace("_", "-"))
    found = [match for one in tried for match in get_close_matches(one, names, 1, 0.65)]
    # "maximum" of "max", and "tol" of "tolerance".
    pairs = [(name, one) for name in names for one in tried if min(len(name), len(one)) > 2]
    found += [name for name, one in pairs if one.startswith(name) or name.startswith(one)]
    return f"; did you mean {names[found[0]]!r}?" if found else ""


def outside() -> int:
    """How many frames up the first one is that is not wvr's, for warnings to name a line of the user's."""
    package = str(Path(__file__).parent)
    frame, level = sys._getframe(1), 1
    while frame is not None and frame.f_code.co_filename.startswith(package):
        frame, level = frame.f_back, level + 1  # type: ignore[assignment]
    return level
