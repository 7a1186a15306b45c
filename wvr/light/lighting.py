"""How a scene is lit: Blinn-Phong shading by the field's gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import warp as wp

from ..kernels.light.glow import rules
from ..kernels.light.points import KINDS, Lamp, Lights, Lit, Shading, Sheen
from ..kernels.light.points import Light as LightStruct
from ..validation import choice, define, integer, positive, real
from .lights import Headlight, Light, light_list

if TYPE_CHECKING:
    from ..scene import Scene

# Gradient at which light has half faded [range of the transfer function per smallest voxel spacing].
FAINT = 1e-4
Mode = Literal["center", "average", "interpolated", "isosurface", "closest-isosurface", "supersampled"]
MODES: tuple[Mode, ...] = get_args(Mode)

# Rounding of light in single precision, of a gradient that does not vanish (docs/proof-single.md, S20), and how much of
# a tolerance it may be.
ULPS = 64
LITTLE = 1 / 2
# Parts of a segment, each lit: no more differ.
MOST_PARTS = 4096


@dataclass(frozen=True)
class Lighting:
    """Light on the emission of a volume.

    With unit vectors n along the gradient, l to a light and h half-way between l and the viewer, a point of colour c
    is seen with ``c (ambient + diffuse sum_l L_l |n.l|) + specular sum_l L_l |n.h|^shininess``, L_l the light's colour.
    Opacity is not affected. Surfaces have two sides. Where the gradient vanishes no direction of light is invented:
    continuously, diffuse light becomes that of a point that faces every light, and specular light none. Nor is there a
    direction half-way to a light that is right behind: specular light fades to none in the last 0.6 degrees.
    A transfer function's own ``ambient``, ``diffuse`` and ``specular`` multiply these coefficients; what is seen of
    them is integrated like colour (Roettger et al. 2003, section 1).

    Parameters
    ----------
    mode
        How a pre-integrated segment is lit, the scalar in it taken to be linear (Lum, Wilson and Ma 2004, section 3):

        - ``"interpolated"``: by the light at its ends, weighted by where in the segment the emission is;
        - ``"center"``: by that of the mean of the ends' normals, the usual way;
        - ``"average"``: by the mean of that at its ends;
        - ``"isosurface"``: the gradient where the scalar crosses each peak of the transfer function, in order;
        - ``"closest-isosurface"``: that of the first, for all of the segment, which is wrong behind it;
        - ``"supersampled"``: interpolated over ``supersample`` parts, the reference of the others.

        That is for :class:`Preintegrated`. :class:`AdaptivePreintegrated` lights by the average. The others evaluate
        emission at points and light each of them, :class:`Exact` and :class:`Certified` at as many of each of their
        pieces as it takes.
    light
        A :class:`Headlight` or :class:`DirectionalLight`, or a sequence of them.
    ambient, diffuse, specular
        Coefficients, >= 0.
    shininess
        Exponent of specular light, > 0.
    supersample
        Parts of a segment in the mode ``"supersampled"``, >= 1.
    gradient
        ``"central"``: differences of the trilinear field over a voxel to each side; ``"cell"``: its own derivative,
        which jumps from cell to cell.

    Raises
    ------
    ValueError
        For an unknown mode or gradient, or a coefficient or number out of its range.
    TypeError
        For a light that is none.
    """

    mode: Mode = "interpolated"
    light: Light | Sequence[Light] = field(default_factory=Headlight)
    ambient: float = 0.2
    diffuse: float = 0.7
    specular: float = 0.3
    shininess: float = 32.0
    supersample: int = 8
    gradient: Literal["central", "cell"] = "central"

    def __post_init__(self) -> None:
        choice(self.mode, "mode", MODES)
        choice(self.gradient, "gradient", ("central", "cell"))
        for name in ("ambient", "diffuse", "specular"):
            value = real(getattr(self, name), name, "a finite number >= 0")
            if not 0 <= value < np.inf:
                raise ValueError(f"{name} must be a finite number >= 0, got {getattr(self, name)!r}")
            define(self, **{name: value})
        parts = integer(self.supersample, "supersample", 1, MOST_PARTS)
        define(self, shininess=positive(self.shininess, "shininess"), supersample=parts, light=light_list(self.light))

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights, also where one was given."""
        assert isinstance(self.light, tuple)
        return self.light

    def check(self, scene: Scene) -> None:
        """Say so where the integrator's segments cannot be lit."""
        if scene.integrator.unlit:
            raise ValueError(f"integrator: {scene.integrator.unlit}")

    def largest(self, scene: Scene) -> float:
        """The largest number that light is counted with: a coefficient, a sum of lights, or a colour that is lit."""
        light = sum(max(one.color) for one in self.lights)
        ambient, diffuse, specular = (
            getattr(self, name) * max(1.0 if (f := tf.materials()[name]) is None else f.max() for tf in scene.functions)
            for name in ("ambient", "diffuse", "specular")
        )
        lit = scene.brightest * (ambient + diffuse * light) + specular * light
        return float(max(self.ambient, self.diffuse, self.specular, light, lit))

    def half(self, scene: Scene, segments: bool) -> Lit:
        """The device half, for integrators that light whole ``segments`` or points."""
        own = dict.fromkeys(light.half for light in self.lights)
        kinds = (*KINDS, *(half for half in own if half not in KINDS))
        return Lit(kinds, self.mode if segments else "point", self.gradient, scene.material)

    def in_lanes(self, scene: Scene) -> bool:
        """Whether kernels of single precision know the lights, and rounding is little beside ``tolerance``."""
        # Of powers below 1, which are steep where they are 0, that power of it.
        sharp = (ULPS * 2.0**-24) ** min(self.shininess, 1.0) * max(self.shininess, 1.0) ** 0.5
        little = sharp * (self.specular + self.diffuse) <= LITTLE * getattr(scene.integrator, "tolerance", 0.0)
        return little and not scene.material and self.half(scene, False).kinds == KINDS

    def struct(self, scene: Scene, device: wp.Device) -> Any:
        """That of ``kernels.light.points``."""
        kinds = self.half(scene, False).kinds
        knots = np.concatenate([tf.knots for tf in scene.functions])
        matrix = scene.volume.index_to_world
        # The gradient is a number: a change over a voxel, in parts of the range of what is seen.
        seen = scene.volume.range if scene.integrator.surfaces else knots
        scale = scene.unit / (float(np.ptp(seen)) or 1.0)
        shading = Shading()
        for name in ("ambient", "diffuse", "specular", "shininess"):
            setattr(shading, name, getattr(self, name))
        shading.faint = FAINT**2
        shading.parts = self.supersample
        shading.to_world = wp.mat33d(*(scale * np.linalg.inv(matrix[:3, :3]).T).ravel())
        shading.ahead = wp.mat33d(*matrix[:3, :3].ravel())
        shading.home = wp.vec3d(*matrix[:3, 3])
        sheen = Sheen()
        for name in ("ambient", "diffuse", "specular", "shininess", "faint"):
            # A shininess beyond single precision is as good as its largest.
            setattr(sheen, name, min(getattr(shading, name), 1e30))
        sheen.steep = 1.6 * min(self.shininess, 1e30) ** 0.5
        lights, lamps = [], []
        for light in self.lights:
            lights.append(LightStruct())
            lamps.append(Lamp())
            lights[-1].kind = lamps[-1].kind = kinds.index(light.half)
            lights[-1].vector, lamps[-1].vector = wp.vec3d(*light.vector), wp.vec3(*light.vector)
            lights[-1].color = wp.vec3d(*light.color)
            lamps[-1].color = wp.vec3(*(self.diffuse * np.array(light.color)))
            lamps[-1].glint = wp.vec3(*(self.specular * np.array(light.color)))
        result = Lights()
        result.shading, result.sheen, result.to_world = shading, sheen, wp.mat33(shading.to_world)
        result.lights = wp.array(lights, dtype=LightStruct, device=device)
        result.lamps = wp.array(lamps, dtype=Lamp, device=device)
        result.rules = _rules(device.alias)
        return result


@cache
def _rules(device: str) -> wp.array:
    """Those of ``kernels.light.glow``."""
    return wp.array(rules(), dtype=wp.vec2, device=device)
