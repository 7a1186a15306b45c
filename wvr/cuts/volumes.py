"""Clips by another volume, and all clips of a scene on their way to the device."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..field.base import Field
from ..field.blocks import Ranges
from ..field.samples import Data, samples_struct
from ..keep import Keeper, Part
from ..kernels.cuts.partial import PARTS
from ..kernels.cuts.shapes import KINDS
from ..kernels.cuts.shapes import Clip as ClipStruct
from ..kernels.cuts.volumes import make_clipping
from ..kernels.field.cell import UNDERFLOW
from ..validation import choice, define, real
from ..volume import Volume
from .base import Clip, Shape

if TYPE_CHECKING:
    from ..scene import Scene

# What a map to a clip's own coordinates rounds, in parts of the numbers that it is made of (docs/proof.md, lemma 11).
ROUNDED = 2.0**-47
# Size of a sample of which cubics along rays are finite.
LARGEST = 1e200


@dataclass(frozen=True)
class ClipVolume(Clip):
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
        Lit, a segment has the light at its ends moved to the cut (the gradients' factor, a), whatever the mode.
        None, the default, cuts rays exactly.

    Raises
    ------
    TypeError
        For a clip volume that is not a Volume.
    ValueError
        For samples or an iso that are not finite, samples beyond 1e200, unknown ``parts``, or naive ``parts``.
    """

    volume: Volume
    iso: float = 0.5
    invert: bool = False
    naive: bool = False
    parts: Literal["first-order", "power", "ratio", "isosurface", "length"] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.volume, Volume):
            raise TypeError(f"volume of a ClipVolume must be a Volume, got {type(self.volume).__name__}")
        self._check_finite()
        self.check_flags()
        iso = real(self.iso, "iso")
        if not np.isfinite(iso):
            raise ValueError(f"iso must be a finite number, got {self.iso!r}")
        define(self, iso=iso)
        choice(self.parts, "parts", (None, *PARTS))
        if self.naive and self.parts is not None:
            raise ValueError(f"naive = True and parts = {self.parts!r}: give one of the two")

    def _check_finite(self) -> None:
        if self.volume.has_nonfinite:
            raise ValueError("volume of a ClipVolume must have finite samples, got NaN or infinite ones")
        low, high = self.volume.range
        if max(abs(low), abs(high)) > LARGEST:
            raise ValueError(
                f"volume of a ClipVolume must have samples of sizes up to {LARGEST:.0e}, got {low:.3g} to {high:.3g}: "
                f"scale them, and iso, first"
            )

    def exact(self) -> ClipVolume:
        return replace(self, naive=False, parts=None)

    def check(self, scene: Scene) -> None:
        # They may have been written since.
        self._check_finite()
        super().check(scene)


@dataclass(frozen=True)
class ClipData(Part):
    """(samples, ranges of their blocks) of a clip volume, in a ``dtype``."""

    data: Data
    dtype: str
    name: ClassVar[str] = "clips"

    def build(self, keep: Keeper) -> tuple[wp.array, wp.array]:
        volume = self.data.volume
        if volume.dtype == self.dtype:
            return keep(self.data), keep(Ranges(self.data))
        wider = Volume(volume.host().astype(self.dtype)).part()
        return keep(wider), keep(Ranges(wider))


def clip_dtype(clips: tuple[Clip, ...]) -> np.dtype:
    """Of the samples of all clip volumes: their own or, where they differ, float64; uint8 where there are none."""
    dtypes = {clip.volume.dtype for clip in clips if isinstance(clip, ClipVolume)}
    return dtypes.pop() if len(dtypes) == 1 else np.dtype(np.float64 if dtypes else np.uint8)


def clip_kinds(clips: tuple[Clip, ...]) -> tuple:
    """Device halves of the kinds of shapes that a kernel must know."""
    own = dict.fromkeys(clip.half for clip in clips if isinstance(clip, Shape))
    return (*KINDS, *(half for half in own if half not in KINDS))


def clipping_struct(
    clips: tuple[Clip, ...], volume: Field, keep: Keeper, astray: float = 0.0, naive: bool = False
) -> Any:
    """The struct of all clips, ``naive`` or as they are, for a volume whose rays may be ``astray`` by so much."""
    to_world = volume.index_to_world
    reach = np.abs(to_world[:3, :3]) @ np.abs(volume.entire.index_box).max(axis=0)  # of its box from its origin
    dtype, kinds = clip_dtype(clips), clip_kinds(clips)
    VolumeStruct, Clipping = make_clipping(wp.dtype_from_numpy(dtype))

    def placed(struct: Any, clip: Clip, matrix: NDArray, origin: NDArray, parts: NDArray | None = None) -> Any:
        """World p to matrix @ (p - origin) in the clip's own coordinates, which rounds the matrix in ``parts``: None,
        where matrix and origin are each rounded a few times.
        """
        to_own = matrix @ to_world[:3, :3]
        # Of the distance between both, which loses no digits of where they are in the world.
        apart = to_world[:3, 3] - origin
        struct.invert = clip.invert
        struct.matrix = wp.mat33d(*to_own.ravel())
        struct.offset = wp.vec3d(*(matrix @ apart))
        sizes = reach + np.abs(apart)
        rounded = np.abs(matrix) @ (sizes + np.abs(origin)) + 1 if parts is None else parts @ sizes
        struct.astray = hypot(*(2 * astray * np.abs(to_own).sum(axis=1) + ROUNDED * rounded))
        return struct

    groups: dict[str, list[Any]] = {}
    for clip in clips:
        if isinstance(clip, ClipVolume):
            own = clip.volume.index_to_world
            to_own = np.linalg.inv(own[:3, :3])
            parts = np.abs(to_own) @ np.abs(own[:3, :3]) @ np.abs(to_own)
            struct = placed(VolumeStruct(), clip, to_own, own[:3, 3], parts)
            data, struct.ranges = keep(ClipData(clip.volume.part(), dtype.name))
            struct.field = samples_struct(data)
            struct.iso = float(clip.iso)
            low, high = map(float, clip.volume.range)
            struct.extent = wp.vec2d(high - low, max(abs(low), abs(high)))
            # Coefficients of a cubic count up to three lengths of a ray in a cell.
            edges = float(np.linalg.norm(own[:3, :3], axis=0).sum()) / volume.smallest_spacing
            struct.tiny = float(UNDERFLOW) * max(1.0, min(edges, volume.longest)) ** 3
            struct.low, struct.high = (wp.vec3d(*corner) for corner in clip.volume.index_box)
            name = "naive_volumes" if clip.naive or naive else "partial_volumes" if clip.parts else "volumes"
        else:
            assert isinstance(clip, Shape)
            clip = clip.near(volume.entire.corners)
            struct = placed(ClipStruct(), clip, clip.to_shape, clip.shape_origin)
            struct.kind = kinds.index(clip.half)
            name = "naive_shapes" if clip.naive or naive else "shapes"
        groups.setdefault(name, []).append(struct)
    clipping = Clipping()
    for name, structs in groups.items():
        kind = ClipStruct if name.endswith("shapes") else VolumeStruct
        setattr(clipping, name, wp.array(structs, dtype=kind, device=keep.device))
    return clipping
