"""Compiles kernels before they are needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from .integrators import Integrator
from .light.lighting import Lighting
from .light.shadows import ConvolutionShadows
from .renderer import render
from .samples import DTYPES
from .transfer_function import TransferFunction
from .volume import Volume


def warm_up(
    lighting: bool | Lighting | Sequence[bool | Lighting] = (True, False),
    shadows: bool | ConvolutionShadows = False,
    *,
    dtype: DTypeLike | Sequence[DTypeLike] = ("uint8", "int16", "float32"),
    integrator: Integrator | None = None,
    device: Any = None,
    **options: Any,
) -> list[str]:
    """Compile what will be needed, so that the first image does not wait for it.

    Kernels stay in Warp's cache (``warp.config.kernel_cache_dir``) until wvr or Warp changes: once on each machine, as
    after an installation or when a container is built.

    Parameters
    ----------
    lighting
        Lit (True, or a :class:`Lighting` whose mode matters) and not lit; by default both.
    shadows
        With shadows (True, or a :class:`ConvolutionShadows`); by default none.
    dtype
        Of samples, one or several; by default those of most scans and simulations.
    integrator
        By default that of :func:`wvr.render`.
    device
        Warp device; by default as for :func:`wvr.render`.
    **options
        Other keywords of :func:`wvr.render` that a kernel is made for: ``clip``, ``precision``, ``segmentation``...

    Returns
    -------
    list of str
        What is compiled now, a line a combination.
    """
    lit = list(lighting) if isinstance(lighting, list | tuple) else [lighting]
    dtypes = list(dtype) if isinstance(dtype, list | tuple) else [dtype]
    kinds = [_kind(one) for one in dtypes]
    if not isinstance(shadows, bool | np.bool_ | ConvolutionShadows):
        raise TypeError(f"shadows must be True, False or a ConvolutionShadows, got {shadows!r}")
    shade = shadows if isinstance(shadows, ConvolutionShadows) else ConvolutionShadows() if shadows else None
    samples = np.linspace(0, 100, 6**3).reshape(6, 6, 6)
    # Certified images of what is gentle, and of jumps or what is steep as a colour map that ends opaque, have a kernel
    # each.
    functions = (
        TransferFunction([(0, "black", 0.0), (30, "red", 0.0), (100, "white", 0.5)]),
        TransferFunction([(0, "black", 0.0), (50, "red", 0.0), (50, "red", 0.3), (100, "white", 0.5)]),
    )
    done = []
    for kind in kinds:
        for light in lit:
            if light is not False and getattr(integrator, "unlit", False):
                continue
            scene = {"lighting": light, "shadows": shade, "integrator": integrator, "device": device}
            for tf in functions:
                render(Volume(samples.astype(kind)), tf, "iso", (16, 16), **(scene | options))
            done.append(f"{kind}, {'lit' if light else 'not lit'}{', with shadows' if shade else ''}")
    return done


def _kind(given: Any) -> np.dtype:
    try:
        kind = np.dtype(given)
        if given is not None and kind.name in DTYPES:
            return kind
    except (TypeError, ValueError):
        pass
    raise TypeError(f"dtype must be one or several of {', '.join(DTYPES)}, got {given!r}")
