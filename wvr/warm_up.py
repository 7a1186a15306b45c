"""Compiles kernels before they are needed."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from .cuts.labels import Segmentation
from .defaults import segmentation_of
from .integrators import Integrator, Isosurface
from .light.lighting import Lighting
from .light.shadows import ConvolutionShadows
from .renderer import render
from .samples import DTYPES
from .transfer_function import TransferFunction
from .validation import flag
from .volume import Volume

# Of the volume that is rendered.
SHAPE = (6, 6, 6)
# Keywords of render that no kernel is made for.
ANY = ("camera", "size", "opacity", "clim", "depth")


def warm_up(
    lighting: bool | Lighting | Sequence[bool | Lighting] = (True, False),
    shadows: bool | ConvolutionShadows = False,
    *,
    dtype: DTypeLike | Sequence[DTypeLike] = ("uint8", "int16", "float32"),
    nan: bool = False,
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
    nan
        Samples of floating-point dtypes that are NaN or infinite, of a volume with ``nan="transparent"``: kernels of
        their own.
    integrator
        By default that of :func:`wvr.render`.
    device
        Warp device; by default as for :func:`wvr.render`.
    **options
        Other keywords of :func:`wvr.render` that a kernel is made for: ``clip``, ``precision``, ``segmentation``, of
        labels of any shape; ``transfer_function``, a :class:`TransferFunction`, where it has coefficients of light.

    Returns
    -------
    list of str
        What is compiled now, a line a combination.
    """
    for name in ANY:
        if name in options:
            raise TypeError(f"warm_up has no keyword {name!r}: kernels are the same whatever it is")
    lit = list(lighting) if isinstance(lighting, list | tuple) else [lighting]
    if getattr(integrator, "unlit", False):
        lit = [False]
    dtypes = list(dtype) if isinstance(dtype, list | tuple) else [dtype]
    kinds = [_kind(one) for one in dtypes]
    if not isinstance(shadows, bool | np.bool_ | ConvolutionShadows):
        raise TypeError(f"shadows must be True, False or a ConvolutionShadows, got {shadows!r}")
    shade = shadows if isinstance(shadows, ConvolutionShadows) else ConvolutionShadows() if shadows else None
    if isinstance(integrator, Isosurface):
        integrator = replace(integrator, values=50.0)  # where there is one
    samples = np.linspace(0, 100, 6**3).reshape(SHAPE)
    absent = np.where(samples < 10, np.nan, samples) if flag(nan, "nan") else samples
    # Certified images of what is gentle, and of jumps or what is steep as a colour map that ends opaque, have a kernel
    # each.
    functions = [
        TransferFunction([(0, "black", 0.0), (30, "red", 0.0), (100, "white", 0.5)]),
        TransferFunction([(0, "black", 0.0), (50, "red", 0.0), (50, "red", 0.3), (100, "white", 0.5)]),
    ]
    if (own := options.pop("transfer_function", None)) is not None:
        if not isinstance(own, TransferFunction):
            raise TypeError(f"transfer_function must be a TransferFunction, got {own!r}")
        functions = [own]
    labels = options.pop("segmentation", None)
    done = []
    for kind in kinds:
        volume = Volume((absent if kind.kind == "f" else samples).astype(kind), nan="transparent")
        for light in lit:
            scene = {"lighting": light, "shadows": shade, "integrator": integrator, "device": device}
            for tf in functions:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # of clips and labels that leave nothing here
                    render(volume, tf, "iso", (16, 16), segmentation=_small(labels, tf), **(scene | options))
            done.append(f"{kind}, {'lit' if light else 'not lit'}{', with shadows' if shade else ''}")
    return done


def _small(labels: Any, tf: TransferFunction) -> Segmentation | None:
    """The same transfer functions, and labels for the volume that is rendered."""
    if labels is None:
        return None
    own = labels if isinstance(labels, Segmentation) else segmentation_of(labels, tf)
    return Segmentation(np.resize(own.labels.host(), SHAPE), own.transfer_functions, own.other)


def _kind(given: Any) -> np.dtype:
    try:
        kind = np.dtype(given)
        if given is not None and kind.name in DTYPES:
            return kind
    except (TypeError, ValueError):
        pass
    raise TypeError(f"dtype must be one or several of {', '.join(DTYPES)}, got {given!r}")
