"""What an editor of transfer functions says, done."""

from __future__ import annotations

from typing import Any

from ..defaults import function_of, recolored
from ..transfer_function import TransferFunction
from ..validation import choice
from . import points
from .state import Source

OPERATIONS = ("move", "color", "add", "remove", "density", "choose", "load")


def edited(tf: TransferFunction, message: dict[str, Any], source: Source) -> TransferFunction:
    """The transfer function after an edit.

    Parameters
    ----------
    message
        ``op``, one of ``OPERATIONS``, and what it needs: ``index``, ``scalar``, ``opacity`` and ``color`` (#rrggbb) of
        a point, ``factor`` of the extinction, ``name`` of a suggestion, preset or colour map, ``text`` of a file.
    """
    op = choice(message["op"], "op", OPERATIONS)
    if op == "move":
        return points.moved(tf, message["index"], float(message["scalar"]), float(message["opacity"]))
    if op == "color":
        return points.colored(tf, message["index"], message["color"])
    if op == "add":
        return points.added(tf, float(message["scalar"]), message.get("opacity"))
    if op == "remove":
        return points.removed(tf, message["index"])
    if op == "density":
        return points.rescaled(tf, float(message["factor"]))
    if op == "load":
        return TransferFunction.from_json(message["text"]).for_volume(source.first_volume)
    name = message["name"]
    if not isinstance(name, str) or name.lower().endswith(".json"):  # no file of the server's
        raise ValueError(f"name must be a suggestion, a preset or a colour map, got {name!r}")
    if name in source.suggestions:
        return source.suggestions[name]
    volume = source.first_volume
    chosen, suggested = function_of(name, volume)
    # A colour map alone recolours what is there.
    return recolored(tf, name, volume.range) if suggested is not None else chosen.for_volume(volume)
