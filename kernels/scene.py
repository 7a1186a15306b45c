"""What a ray-casting kernel is specialised for, and the struct of all that it reads."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from .clip import make_clipping
from .field import make_field
from .label import make_labels
from .precision import REALS
from .ray import View
from .table import make_table
from .transfer import make_transfer


@dataclass(frozen=True)
class Variant:
    """What a kernel is specialised for."""

    dtype: type  # of the stored samples
    precision: str  # "float32" or "float64", of everything along a ray but the sums
    rule: str  # how a ray is integrated, a key of ``raycast.MARCHES``
    finite: bool  # no sample is NaN or infinite
    skip: bool = False  # leap over empty blocks
    traced: bool = False  # the steps of a ray are written down, by a march that has them
    lit: str = ""  # how a segment is lit, a mode of ``lit``, or "point" where every sample is; "" is not at all
    gradient: str = "central"  # that light sees: "central" differences or those of the "cell"
    material: bool = False  # ambient, diffuse and specular coefficients vary with the scalar
    clips: type | None = None  # there are clips; of the clip volumes' samples, uint8 where there are shapes only
    clipped: bool = False  # clips cut the ray
    naive: bool = False  # clips leave out samples
    parts: str | None = None  # clips cut segments, as ``partial`` does
    labels: type | None = None  # of the states as they are stored, where labels say which transfer function holds

    @property
    def cut(self) -> bool:
        """Whether a ray is marched in stretches."""
        return self.clipped or self.labels is not None


@wp.struct
class Steps:
    """Lengths in units of the smallest voxel spacing; a rule reads those it knows."""

    step: wp.float64
    shortest: wp.float64
    longest: wp.float64
    tolerance: wp.float64  # of the whole, or of what a piece adds in parts of its opacity
    scope: wp.float64  # length that the tolerance belongs to; 0 is the ray's own
    opaque: wp.float64  # a ray ends when its opacity exceeds this
    brightest: wp.float64  # largest component of a colour, 1 or more
    tinted: wp.float64  # error of a simpler transfer function, in parts of a ray's opacity
    veiled: wp.float64  # and of any ray, rounding included
    blur: wp.float64  # rounding of a scalar along a ray


@wp.struct
class Step:
    """A step that a ray took; lengths in units of the smallest voxel spacing, errors absolute in any channel."""

    t: wp.float64  # where it starts
    length: wp.float64
    tolerance: wp.float64  # that of its length
    depth_error: wp.float64  # estimate, for its length, of the interval of the inner integral that it lies in
    error: wp.float64  # estimate of the outer integral; 0 where nothing absorbs
    forced: bool  # taken in spite of an estimate above the tolerance
    rgba: wp.vec4d  # the ray's composite at its end


@wp.struct
class Light:
    headlight: bool
    toward: wp.vec3d  # unit vector from the scene to the light, in world space
    color: wp.vec3d


@wp.struct
class Shading:
    ambient: wp.float64
    diffuse: wp.float64
    specular: wp.float64
    shininess: wp.float64
    faint: wp.float64  # square of the gradient where light has half faded [scalars per world length]^2
    parts: int  # that a segment is lit in, by the mode "supersampled"
    to_world: wp.mat33d  # index gradients to world gradients
    ahead: wp.mat33d  # index directions to world directions


def make_scene(variant):
    """The struct with all that a kernel of ``variant`` reads: the same where variants differ in other things."""
    return _make_scene(variant.dtype, variant.precision, variant.clips, variant.labels, variant.traced)


@cache
def _make_scene(dtype, precision, clips, labels, traced):
    real = REALS[precision]
    Field, _ = make_field(dtype, real)
    Transfer, _, _ = make_transfer(real)
    Table, _ = make_table(real)
    _, Clipping = make_clipping(clips or wp.uint8)
    Labels = make_labels(labels or wp.uint8, precision)
    vec2 = wp.vec2d if real is wp.float64 else wp.vec2

    @wp.struct
    class Scene:
        view: View
        steps: Steps
        field: Field
        transfer: Transfer
        empty: wp.array3d(dtype=wp.uint8)  # [z, y, x] of blocks of cells, as of ``importance``
        kinds: wp.array3d(dtype=wp.int16)  # [z, y, x] of small blocks of cells, as of ``blocks``
        masks: wp.array3d(dtype=wp.uint64)  # of their cells
        bound: wp.array2d(dtype=wp.float32)  # on the error of each ray
        shading: Shading
        lights: wp.array(dtype=Light)
        table: Table
        nodes: wp.array(dtype=vec2)  # of ``segment.gauss_nodes``
        distance: wp.array3d(dtype=wp.float32)  # [z, y, x] of blocks, as of ``importance``
        clipping: Clipping
        cut: wp.vec3d  # lit: normal of the clip that the stretch of the ray begins at, in world space, or 0
        cut_point: wp.vec3d  # and where that is
        labels: Labels

    @wp.struct
    class TracedScene:
        view: View
        steps: Steps
        field: Field
        transfer: Transfer
        empty: wp.array3d(dtype=wp.uint8)
        shading: Shading
        lights: wp.array(dtype=Light)
        table: Table
        distance: wp.array3d(dtype=wp.float32)
        clipping: Clipping
        cut: wp.vec3d  # lit: normal of the clip that the stretch of the ray begins at, in world space, or 0
        cut_point: wp.vec3d  # and where that is
        labels: Labels
        trace: wp.array(dtype=Step)
        taken: int  # steps in stretches of the ray before this one
        start: wp.float64  # where this one begins
        front: wp.vec4d  # composite of those before

    return TracedScene if traced else Scene
