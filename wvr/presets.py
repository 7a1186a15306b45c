"""Named transfer functions, and transfer functions suggested by a volume's own histogram.

The CT presets are in Hounsfield units (HU; water 0, air -1000). The ranges of tissues behind them are those of
textbooks (Buzug, Computed Tomography, Springer 2008; Prokop and Galanski, Spiral and Multislice Computed Tomography of
the Body, Thieme 2003), in HU:

==================  ==============  ==========================================
air                 -1000
lung                -950 .. -550    towards -500 with blood, vessels up to soft tissue
fat                 -100 .. -50
water               0
soft tissue, blood  10 .. 70        muscle, liver, kidney, brain, heart
iodine in vessels   100 .. 500      by dose and phase
cancellous bone     100 .. 400
cortical bone       400 .. 2000
enamel, metal       above 2000
==================  ==============  ==========================================

The others are on a relative scale from 0 (nothing) to 1 (the largest signal): magnetic resonance has no absolute one.
"""

from __future__ import annotations

from .preset_points import HOUNSFIELD, PRESETS, RELATIVE, Preset, PresetName, preset_points
from .suggest import suggestion
from .transfer_function import TransferFunction
from .volume import Volume

__all__ = ["HOUNSFIELD", "PRESETS", "RELATIVE", "Preset", "names", "preset", "suggest"]


def names() -> list[str]:
    """Names of the presets."""
    return list(PRESETS)


def preset(name: PresetName, domain: tuple[float, float] | None = None) -> TransferFunction:
    """A transfer function with a name.

    Parameters
    ----------
    name
        One of :func:`names`: "ct-bone", "ct-soft-tissue", "ct-angiography" and "ct-lung" in Hounsfield units; "mri",
        "isosurfaces" and "simulation" on a scale from 0 to 1.
    domain
        For data on another scale: the scalars ``(lo, hi)`` of air and dense cortical bone (-1000 and 2000 HU), or of
        0 and 1; the preset is mapped affinely. None takes the preset's own scale.

    Returns
    -------
    TransferFunction
        Its opacities are those of the smallest voxel spacing.

    Raises
    ------
    ValueError
        For an unknown name, or ``domain`` not finite with lo < hi.
    """
    return TransferFunction(preset_points(name, domain))


def suggest(volume: Volume) -> dict[str, TransferFunction]:
    """Transfer functions fitted to the volume's own histogram, the best default first.

    By the kind of data that the samples look like: ``"labels"``, ``"tissues"`` (CT in Hounsfield units),
    ``"deviation"`` (of what is everywhere: four thin shells), ``"solid"`` (of scans with noise that pass into their
    background without an end). And of any: the background, the commonest value at the rim with noise, is
    transparent; what is above it (below, where the background is the brighter end) is seen in four bands whose
    opacities follow from how much of each there is along a ray. ``"bands"`` has a colour for each: green, brown, gold,
    ivory; ``"warm"`` is a ramp from dark red to light yellow; ``"surfaces"`` is three isosurfaces.

    Parameters
    ----------
    volume
        At most 128^3 of its samples, equally spaced, are looked at (all, where those are all the same); those not
        finite are left out.

    Raises
    ------
    TypeError
        For anything but a volume.
    ValueError
        For a volume with fewer than two different finite samples.
    """
    if not isinstance(volume, Volume):
        raise TypeError(f"volume must be a Volume, got {type(volume).__name__}")
    return dict(suggestion(volume).functions)
