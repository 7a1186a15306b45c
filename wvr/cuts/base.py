"""Clips: what of a volume is cut away. Several leave what all of them do. Lengths and positions are world units.

Every integrator cuts the ray itself, exactly, and integrates what is left as it does a whole ray; ``naive=True`` is the
way that leaves slices: whole samples are dropped. A cut face is lit by the cut's normal.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..validation import flag

if TYPE_CHECKING:
    from ..scene import Scene

Floats = NDArray[np.float64]


class Clip:
    """What all clips have: whether they keep what is outside (``invert``) and leave out whole samples (``naive``)."""

    invert: bool
    naive: bool
    #: How a segment is cut, of clips that cut segments instead of rays.
    parts: str | None = None

    def keeps(self, points: Floats) -> NDArray[np.bool_]:
        """Which world points (n, 3) it leaves, as far as that is known here; all where it is not."""
        return np.ones(len(points), bool)

    def check_flags(self) -> None:
        """Say so where ``invert`` or ``naive`` is neither True nor False."""
        flag(self.invert, "invert"), flag(self.naive, "naive")

    def exact(self) -> Clip:
        """The same, with rays cut where its surface is."""
        return replace(self, naive=False) if self.naive else self  # type: ignore[type-var]

    def check(self, scene: Scene) -> None:
        """Say so where the scene's other pieces do not go with this one."""
        if self.parts is not None and scene.material:
            raise ValueError("clip with parts is lit without coefficients of the transfer function, which has some")


@dataclass(frozen=True)
class Shape(Clip):
    """A convex shape: that of its device ``half`` (as of ``kernels.cuts.shapes``) under an affine map, which a subclass
    defines.
    """

    half: ClassVar[Any]
    to_shape: Floats = field(init=False, repr=False, compare=False)
    shape_origin: Floats = field(init=False, repr=False, compare=False)

    def define(self, matrix: Floats, origin: Floats, **vectors: Floats) -> None:
        """The map: p in the world to ``matrix @ (p - origin)``. Equal vectors make equal clips; arrays would not."""
        self.check_flags()
        for name, vector in vectors.items():
            object.__setattr__(self, name, tuple(vector.tolist()))
        object.__setattr__(self, "to_shape", matrix)
        object.__setattr__(self, "shape_origin", origin)

    def near(self, points: Floats) -> Shape:
        """One that leaves the same of the box of world points (n, 3), of numbers as large as that."""
        return self

    def holds(self, points: Floats) -> NDArray[np.bool_] | None:
        """Which points of its own coordinates (n, 3) are inside; None where a subclass does not say."""
        return None

    def keeps(self, points: Floats) -> NDArray[np.bool_]:
        inside = self.holds((points - self.shape_origin) @ self.to_shape.T)
        return super().keeps(points) if inside is None else inside ^ self.invert


def clip_list(clip: object) -> tuple[Clip, ...]:
    """None, a clip or several of them as a tuple."""
    clips: list[Any] = [] if clip is None else list(clip) if isinstance(clip, list | tuple) else [clip]
    for one in clips:
        if not isinstance(one, Clip):
            raise TypeError(
                f"clip must be None, one of ClipPlane, ClipBox, ClipSphere, ClipVolume or another Clip, or a list of "
                f"them, got {one!r}"
            )
    return tuple(clips)
