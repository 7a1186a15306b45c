"""Clips: what of a volume is cut away. Several leave what all of them do. Lengths and positions are world units.

Every integrator cuts the ray itself, exactly, and integrates what is left as it does a whole ray; ``naive=True`` is the
way that leaves slices: whole samples are dropped. A cut face is lit by the cut's normal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .kernels.clip import BOX, PLANE, SPHERE
from .kernels.partial import PARTS
from .validation import choice, finite_vector, positive
from .volume import Volume

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Shape:
    """A convex shape under an affine map: ``world_to_shape`` is that of ``kernels.clip``."""

    kind: int = field(init=False, repr=False)
    world_to_shape: Floats = field(init=False, repr=False, compare=False)

    def _define(self, kind: int, matrix: Floats, offset: Floats, **vectors: Floats) -> None:
        """Equal vectors make equal clips, which arrays would not."""
        for name, vector in vectors.items():
            object.__setattr__(self, name, tuple(vector.tolist()))
        object.__setattr__(self, "kind", int(kind))
        object.__setattr__(self, "world_to_shape", np.column_stack([matrix, offset]))


@dataclass(frozen=True)
class ClipPlane(_Shape):
    """Keeps the side of a plane that its normal points to, as VTK does.

    Parameters
    ----------
    point
        Any point of the plane [world coordinates].
    normal
        Direction of any length but zero.
    invert
        Keep the other side.
    naive
        Leave out whole samples instead of cutting the ray: a segment is there, all of it, where its sample is kept
        (the first one, of rules with samples at both ends). For Riemann, Simpson and Preintegrated.

    Raises
    ------
    ValueError
        For a zero normal, NaN or infinite numbers.
    """

    point: ArrayLike
    normal: ArrayLike
    invert: bool = False
    naive: bool = False

    def __post_init__(self) -> None:
        point = finite_vector(self.point, "point", "a point of the plane")
        normal = finite_vector(self.normal, "normal", "a direction that is not zero")
        if not np.any(normal):
            raise ValueError(f"normal must not be zero, got {self.normal!r}")
        # Scaled first, so that no square under- or overflows.
        unit = normal / np.abs(normal).max()
        unit /= np.linalg.norm(unit)
        matrix, offset = np.zeros((3, 3)), np.zeros(3)
        matrix[0], offset[0] = unit, -unit @ point
        self._define(PLANE, matrix, offset, point=point, normal=normal)


@dataclass(frozen=True)
class ClipBox(_Shape):
    """Keeps a box along the world's axes.

    Parameters
    ----------
    lo, hi
        Its corners, lo < hi along each axis [world coordinates].
    invert
        Keep what is outside.
    naive
        As of :class:`ClipPlane`.

    Raises
    ------
    ValueError
        For lo >= hi along an axis, NaN or infinite numbers.
    """

    lo: ArrayLike
    hi: ArrayLike
    invert: bool = False
    naive: bool = False

    def __post_init__(self) -> None:
        lo = finite_vector(self.lo, "lo", "the lower corner of the box")
        hi = finite_vector(self.hi, "hi", "the upper corner of the box")
        if np.any(lo >= hi):
            raise ValueError(f"lo must be below hi along x, y and z, got lo = {self.lo!r} and hi = {self.hi!r}")
        half = (hi - lo) / 2
        self._define(BOX, np.diag(1 / half), -(lo + half) / half, lo=lo, hi=hi)


@dataclass(frozen=True)
class ClipSphere(_Shape):
    """Keeps a ball.

    Parameters
    ----------
    center
        [world coordinates].
    radius
        [world length], > 0.
    invert
        Keep what is outside.
    naive
        As of :class:`ClipPlane`.

    Raises
    ------
    ValueError
        For a radius that is not > 0, NaN or infinite numbers.
    """

    center: ArrayLike
    radius: float
    invert: bool = False
    naive: bool = False

    def __post_init__(self) -> None:
        center = finite_vector(self.center, "center", "the centre of the sphere")
        radius = positive(self.radius, "radius")
        self._define(SPHERE, np.eye(3) / radius, -center / radius, center=center)


@dataclass(frozen=True)
class ClipVolume:
    """Keeps what is inside an isosurface of another volume, of any resolution and pose.

    A ray is cut where the clip volume's own cubic along it crosses ``iso``, cell by cell of its grid, so that the cut
    is exact whatever the integrator.

    Parameters
    ----------
    volume
        The clip field, of finite samples; it has its own spacing, origin and direction. Outside its box nothing is
        kept (all is, with ``invert``).
    iso
        What is kept has at least this value.
    invert
        Keep what is below, and what is outside the clip volume's box.
    naive
        As of :class:`ClipPlane`.
    parts
        For Preintegrated, how Roettger et al. (2003, section 2) cut: segment by segment, the clip field linear between
        a segment's ends, and continued beyond its box. The scalars at the ends move to the cut, and the table's entry
        (C, A) for them counts by the share b of the segment that is left: ``"first-order"``, b C and b A;
        ``"power"``, b C and 1 - (1 - A)^b; ``"ratio"``, that opacity and colour in proportion; ``"isosurface"``, as it
        is, for tables whose entries do not depend on length; ``"length"``, integrated for the length that is left.
        None, the default, cuts rays exactly.

    Raises
    ------
    TypeError
        For a clip volume that is not a Volume.
    ValueError
        For samples or an iso that are not finite, unknown ``parts``, or naive ``parts``.
    """

    volume: Volume
    iso: float = 0.5
    invert: bool = False
    naive: bool = False
    parts: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.volume, Volume):
            raise TypeError(f"volume of a ClipVolume must be a Volume, got {type(self.volume).__name__}")
        if self.volume.has_nonfinite:
            raise ValueError("volume of a ClipVolume must have finite samples, got NaN or infinite ones")
        if isinstance(self.iso, bool | str) or not np.isfinite(self.iso):
            raise ValueError(f"iso must be a finite number, got {self.iso!r}")
        choice(self.parts, "parts", (None, *PARTS))
        if self.naive and self.parts is not None:
            raise ValueError(f"naive = True and parts = {self.parts!r}: give one of the two")


Shape = ClipPlane | ClipBox | ClipSphere
Clip = ClipPlane | ClipBox | ClipSphere | ClipVolume
KINDS = (ClipPlane, ClipBox, ClipSphere, ClipVolume)


def clip_list(clip: object) -> list[Clip]:
    """None, a clip or several of them as a list."""
    clips: list[Any] = [] if clip is None else list(clip) if isinstance(clip, list | tuple) else [clip]
    for one in clips:
        if not isinstance(one, KINDS):
            names = ", ".join(kind.__name__ for kind in KINDS)
            raise TypeError(f"clip must be None, one of {names}, or a list of them, got {one!r}")
    return clips
