"""Single scattering by brute force: the model that shadows by convolution approximate."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Event
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .camera import Camera, image_size
from .cancel import cancelling
from .field.base import Field
from .frame import Frame
from .image import Image
from .integrators import Riemann
from .keep import Keeper
from .kernels.light.scattering import make_scattering
from .kernels.precision import REALS, vec4_of
from .launch import get_device, launch_pixels
from .light.lighting import Lighting
from .light.lights import Headlight, Light
from .scene import Precision, Scene
from .transfer_function import TransferFunction
from .validation import integer, real
from .volume import Volume

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))

# Directions of a cone at most, for each of which there is a ray from every sample.
MOST = 2**16


def single_scattering(
    volume: Volume,
    transfer_function: TransferFunction,
    camera: Camera,
    size: tuple[int, int] = (512, 512),
    *,
    light: Light | Sequence[Light] | None = None,
    spread: float = 20.0,
    directions: int = 64,
    step: float = 0.5,
    background: str | Sequence[float] | None = None,
    precision: Precision = "auto",
    device: Any = None,
    termination: float | None = None,
    skip_empty: bool = True,
    cancel: Event | None = None,
) -> Image:
    """Render a volume with soft shadows, each sample lit by rays of its own: a reference, and slow.

    A point emits ``colour * extinction * sum_l L_l I_l``, where L_l is a light's colour and I_l in [0, 1] what arrives
    of it: the mean, over the directions of a circular cone of half-angle ``spread`` about that to the light, of
    exp(-optical depth to the edge of the volume). Without anything in the way I_l is 1, so that a scene without shadows
    under one white light is the unlit one. Directions are uniform in solid angle, so that those of a cone of half-angle
    a have mean square tangents sec(a) - 1 to its axis, half of that along either direction across it.

    Both integrals are sums of the midpoint rule with exact opacities: of second order in ``step``, and about first in
    1 / ``directions``. Directions are the same for all points: points of a spiral by the golden angle, of equal weight.

    Parameters
    ----------
    volume, transfer_function, camera, size
        As of :func:`render`.
    light
        A :class:`Headlight` or :class:`DirectionalLight`, or a sequence of them; by default a headlight, which shines
        from the viewer along the rays.
    spread
        Half-angle of a light's cone [degrees], in [0, 90); 0 is a hard shadow.
    directions
        Rays to each light, >= 1.
    step
        Length of a step of all rays, in units of the smallest voxel spacing, > 0.
    background, precision, device, termination, skip_empty, cancel
        As of :func:`render`. Samples are of this precision, sums always float64.

    Returns
    -------
    Image
        ``samples`` counts those of the rays to the lights too.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind or value; each says which, what was given and what is accepted.
    Cancelled
        Where ``cancel`` is set before the image is done.
    """
    if isinstance(volume, Field) and isinstance(transfer_function, TransferFunction):
        transfer_function = transfer_function.for_volume(volume)
    scene = Scene(
        volume=volume,
        transfer_function=transfer_function,
        integrator=Riemann(step),
        lighting=Lighting(light=Headlight() if light is None else light),
        shadows=None,
        precision=precision,
        termination=termination,
        background=background,
        skip_empty=skip_empty,
        clips=(),
        segmentation=None,
    )
    for one in scene.volumes():
        one.look()
    scene.check(camera)
    directions_of = cone(spread, directions)
    at = get_device(device)
    start = perf_counter()
    with cancelling(cancel):
        width, height = image_size(size)
        frame = Frame(scene, camera, (width, height), Keeper(at))
        frame.check_memory()
        integrator = scene.integrator
        along = integrator.precision(scene)
        halves = frame.halves(REALS[along], integrator.half(scene))
        struct, _ = frame.struct(halves)
        rgba = wp.empty((height, width), dtype=vec4_of(halves.real), device=at)
        samples = wp.empty((height, width), dtype=int, device=at)
        inputs = [struct, wp.array(directions_of, dtype=wp.vec3d, device=at), rgba, samples]
        launch_pixels(make_scattering(halves), inputs, at, struct.view)
    pixels, count = rgba.numpy(), samples.numpy()
    stats = {
        "seconds": perf_counter() - start,
        "rays": width * height,
        "directions": len(directions_of),
        "samples": int(count.sum(dtype=np.int64)),
        "device": at.name,
        "precision": along,
        "integrator": f"single scattering, {integrator!r}",
    }
    return Image(pixels, count, None, stats, background)


def cone(spread: float, directions: int) -> NDArray[np.float64]:
    """Unit vectors about z, evenly over the solid angle of a cone of half-angle ``spread`` [degrees]: (n, 3)."""
    if not 0 <= real(spread, "spread", "an angle in [0, 90) degrees") < 90:
        raise ValueError(f"spread must be an angle in [0, 90) degrees, got {spread!r}")
    directions = integer(directions, "directions", 1, MOST)
    if spread == 0:
        directions = 1
    k = np.arange(directions)
    # 1 - cos is what is uniform; by sines, which do not cancel where the cone is narrow.
    short = 2 * np.sin(np.radians(spread) / 2) ** 2 * (k + 0.5) / directions
    radius = np.sqrt(short * (2 - short))
    return np.stack([radius * np.cos(k * GOLDEN_ANGLE), radius * np.sin(k * GOLDEN_ANGLE), 1 - short], axis=-1)
