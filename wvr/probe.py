"""What is found along the rays of a frame: values, and where they are taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .keep import Keeper
from .kernels.probe import make_probing
from .kernels.ray import item
from .launch import launch, launch_pixels

if TYPE_CHECKING:
    from .clock import Clock
    from .frame import Frame
    from .scene import Scene

Floats = NDArray[np.float64]
# Values, and depths from the camera's plane, of all pixels or one, where a ray has an opacity, and what it has up to
# there, or to its end.
Prober = Callable[[float, tuple[int, int] | None], tuple[Floats, Floats, Floats]]


class Probed(NamedTuple):
    """Of each pixel, shape (height, width)."""

    rgba: wp.array
    samples: wp.array
    bounds: wp.array
    values: wp.array
    depths: wp.array
    skipped: float  # share of blocks


def probe(frame: Frame, clock: Clock | None = None, pixel: tuple[int, int] | None = None) -> Probed:
    """What an integrator that probes finds in all pixels, or in one; a clock is told when rays begin and end."""
    halves = frame.halves(wp.float64, frame.scene.integrator.half(frame.scene))
    struct, seen = frame.struct(halves)
    shape, device = (frame.height, frame.width), frame.device
    rgba = wp.empty(shape, dtype=wp.vec4d, device=device)
    samples = wp.empty(shape, dtype=int, device=device)
    numbers = [wp.empty(shape, dtype=wp.float64, device=device) for _ in range(3)]
    if clock is not None:
        clock.mark()
    kernel, inputs = make_probing(halves), [struct, rgba, samples, *numbers]
    if pixel is None:
        launch_pixels(kernel, inputs, device, struct.view)
    else:
        numbers[2].fill_(np.nan)  # depths beside it are no hint
        launch(kernel, 1, inputs, device, first=item(frame.width, *pixel))
    if clock is not None:
        clock.mark()
    bounds, values, depths = numbers
    return Probed(rgba, samples, bounds, values, depths, seen.skipped)


def make_prober(frame: Any, again: Callable[[Scene, Keeper, tuple[int, int] | None], list[Floats]]) -> Prober:
    """Finds where rays have an opacity: values, depths and colours that those of another scene find, in all pixels or
    in one, when asked ``again``.
    """
    scene, given, camera = frame.scene, frame.given, frame.camera
    keep = frame.keep.beside()
    volumes = given.volumes()
    versions = [volume.version for volume in volumes]
    clips = tuple(clip.exact() for clip in scene.clips)

    def prober(opacity: float, pixel: tuple[int, int] | None) -> tuple[Floats, Floats, Floats]:
        if pixel is None and scene.integrator.valued and not scene.integrator.seeks:
            raise ValueError(f"depth needs an image of what is somewhere on a ray, got {scene.integrator!r}")
        for volume in volumes:
            volume.look()
        if [volume.version for volume in volumes] != versions:
            raise ValueError("depth needs the samples that the image was made of, which somebody wrote into since")
        integrator = scene.integrator.reaching(opacity)
        if any(not hasattr(scene.volume.half, name) for name in integrator.asks):
            kind = type(scene.volume).__name__
            raise ValueError(f"depth needs a volume that says what it is inside a cell, which a {kind} does not")
        # Where the image ended is no end here: an opacity may be asked for that is reached behind it.
        sought = replace(given, integrator=integrator, lighting=None, shadows=None, termination=None, clips=clips)
        sought.check(camera)
        with keep.lock.held(), keep.frame():
            values, depths, rgba = again(sought, keep, pixel)
        at: Any = slice(None) if pixel is None else (pixel[1], pixel[0])
        return values[at], depths[at], rgba[..., 3][at]

    return prober


def tightest(bounds: Floats) -> NDArray[np.float32]:
    """As float32, rounded up."""
    return (bounds * (1 + 2.0**-23)).astype(np.float32)
