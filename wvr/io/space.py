"""Anatomical spaces and units of length, as files name them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..samples import Anatomy, Unsupported

# In millimetres.
UNITS = {
    **dict.fromkeys(("fm", "femtometer", "femtometre"), 1e-12),
    **dict.fromkeys(("pm", "picometer", "picometre"), 1e-9),
    **dict.fromkeys(("å", "Å", "a", "angstrom", "ångström", "\\u00c5", "\\u00c5ngstrom"), 1e-7),
    **dict.fromkeys(("nm", "nanometer", "nanometre", "nanometers"), 1e-6),
    **dict.fromkeys(
        ("µm", "μm", "um", "micron", "microns", "micrometer", "micrometre", "micrometers", "\\u00b5m", "\\u03bcm"), 1e-3
    ),
    **dict.fromkeys(("mm", "millimeter", "millimetre", "millimeters"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimetre", "centimeters"), 10.0),
    **dict.fromkeys(("dm", "decimeter", "decimetre"), 100.0),
    **dict.fromkeys(("m", "meter", "metre", "meters", "metres"), 1e3),
    **dict.fromkeys(("km", "kilometer", "kilometre", "kilometers", "kilometres"), 1e6),
    "Mm": 1e9,  # of the sun; others are the same in lower case
    **dict.fromkeys(("in", "inch", "inches", '"'), 25.4),
}


def in_first_unit(lengths: Sequence[float], units: Sequence[str]) -> list[float]:
    """Lengths along the axes, each in a unit of its own, all in the first.

    Raises
    ------
    Unsupported
        For different units of which one is none of length.
    """
    if len({unit.strip().lower() for unit in units}) == 1:
        return list(lengths)
    factors = in_units_of_first(units)
    if factors is None:
        unknown = next(unit for unit in units if _millimetres(unit) is None)
        raise Unsupported(f"its axes are in {', '.join(map(repr, units))}, and {unknown!r} is no unit of length")
    return (np.asarray(lengths) * factors).tolist()


def in_units_of_first(units: Sequence[str | None]) -> NDArray[np.float64] | None:
    """What lengths along the axes, each in a unit of its own, are times in the first; None where one is none of
    length.
    """
    sizes = [size for unit in units if (size := _millimetres(unit)) is not None]
    return np.array([size / sizes[0] for size in sizes]) if len(sizes) == len(units) else None


def _millimetres(unit: str | None) -> float | None:
    name = (unit or "").strip()
    return UNITS.get(name, UNITS.get(name.lower()))


def right_handed(space: str) -> tuple[NDArray[np.float64], Anatomy]:
    """Signs of the axes x, y, z that turn a space into one that is right-handed, and which of a patient's that is.

    A patient's becomes right-anterior-superior or left-posterior-superior, whichever has the same x. Drawn as they are,
    left-handed coordinates would show the patient's mirror image.

    Parameters
    ----------
    space
        As NRRD names them: ``"left-anterior-superior"``, ``"LAS"``, ``"3D-left-handed"``, each also with a time.

    Raises
    ------
    Unsupported
        For another name.
    """
    name = space.strip().lower().removesuffix("-time")
    if name in ("scanner-xyz", "3d-right-handed"):
        return np.ones(3), ""
    if name == "3d-left-handed":
        return np.array([1.0, 1.0, -1.0]), ""
    letters = [word[:1] for word in name.split("-")] if "-" in name else list(name[:3])
    pairs = ("rl", "ap", "si")
    if len(letters) != 3 or any(letter not in pair for letter, pair in zip(letters, pairs, strict=True)):
        raise Unsupported(f"its space {space!r} is unknown; known are left-posterior-superior and the like")
    up = 1.0 if letters[2] == "s" else -1.0
    turned = letters[:2] in (["r", "a"], ["l", "p"])
    return np.array([1.0, 1.0 if turned else -1.0, up]), "RAS" if letters[0] == "r" else "LPS"
