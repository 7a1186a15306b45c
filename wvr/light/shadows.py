"""Light that travels: shadows by convolution, from slice to slice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..validation import choice, define, flag, integer, positive, real
from .lights import Headlight, Light, light_list

if TYPE_CHECKING:
    from ..scene import Scene


# Cells of light across a volume: slices of as many by as many are kept.
MOST_CELLS = 2**14
# Voxel spacings of a cell, and from slice to slice: a distance is sampled in as many parts.
WIDEST = 2**14


@dataclass(frozen=True)
class ConvolutionShadows:
    """Shadows by light that is attenuated and spread from slice to slice.

    Convolution shadows after Patel et al. and, supersampled and pre-integrated, Angelelli and Bruckner, "Performance
    and Quality Analysis of Convolution-Based Volume Illumination" (2017). Slices are planes that light and viewer pass
    in order. Light L obeys ``dL/dl = D laplace(L) - tau L`` along its way l, with the Laplacian across it; a slab
    between two slices is one step of it. What a point emits is seen times the light that arrives there; outside the
    volume that is 1. Distances are in units of the smallest voxel spacing.

    Parameters
    ----------
    slice_distance
        Between slices, > 0 and at most 16384; the last digit gives way so that slices divide what there is to see
        evenly. The image converges as it goes to 0: with order 2, by Strang's splitting, 5-point steps of diffusion and
        traced light.
    subsamples
        Samples between two slices besides the one, >= 0; light is interpolated to them (SCS; 0 is ICS). By default as
        many as leave them at most a voxel apart: slices are for light, samples are for what is lit.
    preintegrated
        Slabs, or their parts, are looked up in a pre-integration table by the scalars at their ends (PI-ICS, PI-SCS).
        Else they are what they are in their middle, which shows as stripes on dense surfaces.
    spread
        Half-angle of the light's cone [degrees], in [0, 90). The blur after a unit of length is that of the cone: a
        disc of radius ``tan(spread)``, of variance ``tan(spread)^2 / 4`` along each axis, so that
        ``D = tan(spread)^2 / 8``. Independent of slice distance and image size, up to a blur of 5.6 cells from slice to
        slice: more, by default from 85 degrees on, counts as that.
    light
        A :class:`Headlight` or :class:`DirectionalLight`, or a sequence of them. A headlight shines from the camera's
        place. Extinction has no colour, so light keeps its own.
    splitting
        ``"strang"``: half of a slab's attenuation, diffusion, the other half (order 2); ``"lie"``: attenuation, then
        diffusion (order 1).
    kernel
        ``"diffusive"``: diffusion over a slab in proportion to its thickness. ``"fixed"``: that of a unit of length
        with each slice, however thick, as in the papers: light does not converge with the slice distance.
    mode
        Which way slices lie: ``"view-aligned"`` (for light from the viewer's side; any number of directions is
        multidirectional occlusion shading), ``"half-angle"`` (half-way between light and view, for any light),
        ``"occlusion"`` (view-aligned, for a headlight alone: directional occlusion shading), or ``"auto"``: for each
        light, view-aligned where it comes within 60 degrees of the view, else half-angle.
    received
        Light that tissue is seen by. ``"traced"``: that of slices, linear between them, a quadratic spline between
        their cells, so that those do not show; where tissue is so dense that light ends within a cell, what arrives a
        slab and a cell before it, less what is absorbed from there on, and the emission of a part in closed form, so
        that nothing depends on where slices and cells lie. ``"front"``: that at a slab's front as in the papers, of
        order 1; sub-samples have what is interpolated between slices.
    image
        ``"rays"``: the image of the renderer's integrator, times the share of each pixel's emission that light reaches
        by the slices; what aliases in the slices is in both parts of the share. Opacity is the integrator's.
        ``"slices"``: composed of the slices themselves, as in the papers; there is no integrator.
    cell
        Width of the cells of light, > 0 and at most 16384; across the light in the middle of the volume, for a
        headlight in perspective. By default ``5.5 tan(spread)``, at least 1 and at most 2 (from 20 degrees on). Wide
        cells are fast and blur shadows.

    Raises
    ------
    ValueError
        For a number out of its range, an unknown choice, or ``mode="occlusion"`` with another light than a headlight.
    TypeError
        For a light that is none, or ``preintegrated`` that is no bool.
    """

    slice_distance: float = 4.0
    subsamples: int | None = None
    preintegrated: bool = True
    spread: float = 20.0
    light: Light | Sequence[Light] = field(default_factory=Headlight)
    splitting: Literal["strang", "lie"] = "strang"
    kernel: Literal["diffusive", "fixed"] = "diffusive"
    mode: Literal["auto", "view-aligned", "half-angle", "occlusion"] = "auto"
    received: Literal["traced", "front"] = "traced"
    image: Literal["rays", "slices"] = "rays"
    cell: float | None = None

    def __post_init__(self) -> None:
        define(
            self,
            slice_distance=positive(self.slice_distance, "slice_distance"),
            cell=None if self.cell is None else positive(self.cell, "cell"),
            subsamples=None if self.subsamples is None else integer(self.subsamples, "subsamples", 0),
            preintegrated=flag(self.preintegrated, "preintegrated"),
            spread=real(self.spread, "spread", "an angle in [0, 90) degrees"),
        )
        for name, value in (("slice_distance", self.slice_distance), ("cell", self.cell)):
            if value is not None and value > WIDEST:
                raise ValueError(f"{name} must be at most {WIDEST} voxel spacings, got {value!r}")
        if not 0 <= self.spread < 90:
            raise ValueError(f"spread must be an angle in [0, 90) degrees, got {self.spread!r}")
        choice(self.splitting, "splitting", ("strang", "lie"))
        choice(self.kernel, "kernel", ("diffusive", "fixed"))
        choice(self.mode, "mode", ("auto", "view-aligned", "half-angle", "occlusion"))
        choice(self.received, "received", ("traced", "front"))
        choice(self.image, "image", ("rays", "slices"))
        lights = light_list(self.light, empty=False)
        object.__setattr__(self, "light", lights)
        if any(light.way(np.array([0.0, 0.0, 1.0])) is None for light in lights):
            raise TypeError(f"light must go one way, as Headlight and DirectionalLight do, got {self.light!r}")
        if self.mode == "occlusion" and not all(isinstance(light, Headlight) for light in lights):
            raise ValueError(f'mode "occlusion" is for a Headlight alone, got {self.light!r}')

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights, also where one was given."""
        assert isinstance(self.light, tuple)
        return self.light

    @property
    def parts(self) -> int:
        """That a slab between two slices is sampled in."""
        return math.ceil(self.slice_distance - 1e-9) or 1 if self.subsamples is None else int(self.subsamples) + 1

    @property
    def shortest(self) -> float:
        """Distance between samples [smallest voxel spacing]."""
        return self.slice_distance / self.parts

    @property
    def cell_width(self) -> float:
        """``cell``, or what it is by default."""
        return float(np.clip(5.5 * np.tan(np.radians(self.spread)), 1, 2)) if self.cell is None else self.cell

    @property
    def diffusion(self) -> float:
        """D [smallest voxel spacing]: a spot of light widens by a variance of 2 D along each axis a unit of length."""
        return float(np.tan(np.radians(self.spread)) ** 2 / 8)

    @property
    def alone(self) -> bool:
        """Whether the image is composed of slices, without an integrator."""
        return self.image == "slices"

    def check(self, scene: Scene) -> None:
        """All that emits can be in shadow, but for cells of light that are too many."""
        if scene.integrator.probes:
            raise ValueError(
                f"shadows must be None for {scene.integrator!r}: they are on what emits along a ray, of which it "
                f"looks for one value"
            )
        parts = [clip.parts for clip in scene.clips if clip.parts is not None]
        if self.alone and parts:
            raise ValueError(
                f'clip must be without parts for shadows with image="slices", whose slices are cut point by point, got '
                f'parts={parts[0]!r}: leave them out, or give image="rays"'
            )
        if scene.volume.longest / self.cell_width > MOST_CELLS:
            raise ValueError(
                f"shadows must have cells of at least {scene.volume.longest / MOST_CELLS:.3g} voxel spacings in this "
                f"volume, {MOST_CELLS} across its diagonal of {scene.volume.longest:.6g}, got cell={self.cell_width:g}"
            )
