"""Warnings where an image shows nothing, or one end of a transfer function alone: what does not fit, and what would."""

from __future__ import annotations

import warnings

import numpy as np

from .field.base import Field
from .image import Image
from .scene import Scene
from .transfer_function import TransferFunction
from .validation import outside

# Opacity of which no pixel of 8 bits shows a trace, and up to which an image is as good as empty.
NOTHING, FAINT = 1 / 255, 0.02
# A smaller part of a transfer function than is ever meant: it is for other scalars.
NARROW = 1 / 15
# Of a box's longest edge, what rays with rounding may miss.
THIN = 1e-12
# Optical depth of a ray that would show what it meets.
OPAQUE = 1.0


def _thinnest(volume: Field) -> float:
    """The shortest edge of the box, in parts of the longest."""
    edges = np.linalg.norm(volume.index_to_world[:3, :3], axis=0) * np.maximum(volume.dimensions - 1, 1)
    return float(edges.min() / edges.max())


def advise(scene: Scene, image: Image) -> None:
    """Warn where there is nothing to see in an image, or the scalars are a small part of the transfer function's."""
    low, high = scene.volume.range
    data = f"the volume's scalars {f'go from {low:g} to {high:g}' if low < high else f'are all {low:g}'}"
    shown = [span for span in map(shown_by, scene.functions) if span is not None]
    most = image.most_opaque
    # A cell with a sample that is no number is not there.
    cut = f"clips, labels{'' if scene.volume.half.finite else ', samples that are NaN'} and depth"
    if most <= FAINT:
        begin, end = min((a for a, _ in shown), default=0.0), max((b for _, b in shown), default=0.0)
        what = f"opacity from {begin:g} to {end:g}" if shown else "no opacity at all"
        opaque = f"the transfer function has {what}"
        if not shown or end <= low or begin >= high:
            advice = "give it control points with opacity among them, or a preset clim=(low, high)"
        elif (thin := _thinnest(scene.volume)) < THIN:
            advice = (
                f"the box is {thin:.0e} times as thick as long, which rounding does not tell from nothing: see spacing"
            )
        elif not image.samples.any():
            advice = (
                f"no ray meets any of it: see that the camera looks at the volume (Camera.fit) and that {cut} leave it"
            )
        elif _deepest(scene) > OPAQUE:
            advice = (
                f"what is opaque is small or out of view: see where the camera looks, what {cut} leave, and wvr info"
            )
        else:
            advice = "raise opacities, or make unit_distance smaller"
        if misses := scene.integrator.misses(low, high):
            opaque, advice = misses.split("; ")
        little = "nothing" if most < NOTHING else "nearly nothing"
        _warn(f"{little} is visible (the largest opacity is {most:.2g}): {data}, {opaque}; {advice}")
    elif scene.segmentation is None and not scene.integrator.valued:
        tf = scene.functions[0]
        first, last = float(tf.knots[0]), float(tf.knots[-1])
        if is_narrow(tf, low, high):
            _warn(
                f"{data}, a small part of the transfer function's, from {first:g} to {last:g}, so that all looks much "
                f"the same: if it is for others, such as Hounsfield units, pass it domain=({low:g}, {high:g}), "
                f"or clim to wvr.render and on the command line"
            )


def is_narrow(tf: TransferFunction, low: float, high: float) -> bool:
    """Whether scalars between the two are so small a part of a transfer function that it is hardly meant for them."""
    first, last = float(tf.knots[0]), float(tf.knots[-1])
    varies = bool(np.ptp(tf.opacities) or np.ptp(tf.colors, axis=0).any())
    return varies and low < high and min(high, last) - max(low, first) < NARROW * (last - first)


def _deepest(scene: Scene) -> float:
    """Optical depth of the longest ray, if all of it were as opaque as the most opaque scalar that there is."""
    low, high = scene.volume.range
    ends = [np.append(tf.knots[(tf.knots > low) & (tf.knots < high)], (low, high)) for tf in scene.functions]
    most = max(float(tf.extinction(s, scene.unit).max()) for tf, s in zip(scene.functions, ends, strict=True))
    return most * scene.unit * scene.volume.longest


def shown_by(tf: TransferFunction) -> tuple[float, float] | None:
    """The first and last scalar with any opacity."""
    opaque = np.flatnonzero(tf.opacities)
    if not len(opaque):
        return None
    first, last = max(opaque[0] - 1, 0), min(opaque[-1] + 1, len(tf.knots) - 1)
    # The ends go on to all scalars beyond them.
    below = -np.inf if opaque[0] == 0 else float(tf.knots[first])
    above = np.inf if opaque[-1] == len(tf.knots) - 1 else float(tf.knots[last])
    return below, above


def _warn(message: str) -> None:
    warnings.warn(message, UserWarning, stacklevel=outside())
