"""The Python that renders what a viewer shows."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..cuts.shapes import ClipBox, ClipPlane, ClipSphere
from ..transfer_function import TransferFunction
from .state import Presentation, Source

WRITTEN = (ClipPlane, ClipBox, ClipSphere)
NAMES = (
    "AdaptivePreintegrated", "AdaptiveSimpson", "Camera", "Certified", "ClipBox", "ClipPlane", "ClipSphere",
    "ConvolutionShadows", "DirectionalLight", "Exact", "Headlight", "Isosurface", "Lighting", "Preintegrated",
    "Projection", "Riemann", "Simpson", "TransferFunction",
)  # fmt: skip


def script(source: Source, presentation: Presentation, tolerance: float | None) -> str:
    """A script with every digit; where what it needs cannot be written down, the name it has is said in a comment."""
    lighting, shadows = presentation.lights()
    arguments = {"camera": repr(presentation.camera), "size": repr(presentation.size)}
    options: dict[str, Any] = {name: value for name, value in source.options.items() if name != "tolerance"}
    if tolerance is not None:
        options.pop("integrator", None)
        arguments["tolerance"] = repr(tolerance)
    arguments |= {name: repr(value) for name, value in options.items() if value is not None}
    arguments["lighting"] = repr(lighting or False)
    arguments["shadows"] = repr(shadows or False)
    behind = source.background
    arguments["background"] = repr(behind if isinstance(behind, str) else tuple(np.asarray(behind, float).tolist()))
    said = []
    written = [clip for clip in presentation.clips if isinstance(clip, WRITTEN)]
    others = len(presentation.clips) - len(written)
    clips = [repr(clip) for clip in written]
    if others:
        said.append(f"# clips: the {others} that the viewer was given besides these")
        clips.append("*clips")
    if clips:
        arguments["clip"] = f"[{', '.join(clips)}]"
    if source.call.segmentation is not None:
        said.append("# segmentation: the wvr.Segmentation that the viewer was given")
        arguments["segmentation"] = "segmentation"
    body = _reading(source, presentation.frame) + said
    shown = "None"
    if presentation.transfer_function is not None:
        body += [f"transfer_function = {_points(presentation.transfer_function)}"]
        shown = "transfer_function"
    body += [f"camera = {arguments.pop('camera')}"]
    call = ",\n    ".join(f"{name}={value}" for name, value in arguments.items())
    body += [f"image = wvr.render(\n    volume,\n    {shown},\n    camera,\n    {call},\n)"]
    text = "\n".join(body)
    used = [name for name in NAMES if re.search(rf"\b{name}[(.]", text)]
    return f'import wvr\nfrom wvr import {", ".join(used)}\n\n{text}\nimage.save("image.png")\n'


def _reading(source: Source, frame: int) -> list[str]:
    given = source.given(frame)
    files: tuple[Any, ...] = getattr(source.volume(frame), "files", ())
    if isinstance(given, str):
        return [f"volume = wvr.as_volume({given!r})"]
    if len(files) == 1:
        return [f"volume = wvr.read({str(files[0])!r})"]
    return ["# volume: the data that the viewer was given"]


def _points(tf: TransferFunction) -> str:
    values = [f"    {np.asarray(column).tolist()!r},\n" for column in (tf.knots, tf.colors, tf.opacities)]
    values += [f"    unit_distance={tf.unit_distance!r},\n"]
    values += [f"    {name}={old.tolist()!r},\n" for name, old in tf.materials().items() if old is not None]
    return f"TransferFunction.from_arrays(\n{''.join(values)})"
