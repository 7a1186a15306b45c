"""Tables IV and V of Campagnolo et al. 2015, and Table 1 of Lum et al. 2004, the papers' numbers beside those found."""

from __future__ import annotations

from functools import partial
from typing import Any

import wvr
from studies import campagnolo2015, lum2004
from studies.base.scenes import SCENES, make_scene
from studies.brute_hoisted import make_hoisted

from .day import Day, Row, Work
from .parity import rays_of

# Entries along an axis of Lum's tables up to which brute force is tried.
BRUTE = 1024


def campagnolo(day: Day) -> Work:
    """Table IV, a row a scene and method's ratio to the first; and Table V."""
    methods: dict[str, Any] = {f"Riemann h = {h:g}": wvr.Riemann(h) for h in campagnolo2015.STEPS}
    for tolerance in campagnolo2015.TOLERANCES:
        methods[f"Coupled ε = {tolerance:g}"] = campagnolo2015.adaptive(tolerance)
        methods[f"Decoupled ε = {tolerance:g}"] = campagnolo2015.adaptive(tolerance, "decoupled")
    if day.quick:
        methods = {name: methods[name] for name in ("Riemann h = 0.5", "Coupled ε = 0.01")}
    for column, scene in enumerate(SCENES):
        yield f"IV {scene}", partial(table4, day, scene, column, methods)
    if not day.quick:
        yield "V Bonsai", partial(table5, day)


def table4(day: Day, scene: str, column: int, methods: dict[str, Any]) -> Row:
    """Frames a second, and in brackets those of the paper."""
    with rays_of(day.device):
        times = campagnolo2015.fastest(make_scene(scene, day.quick), methods, day.device.alias)
    paper = campagnolo2015.PAPER["IV"]["rows"]
    return {name: f"{1 / seconds:.1f} ({paper[name][column]:g})" for name, seconds in times.items()}


def table5(day: Day) -> Row:
    """As of Table IV, with steps of 0.4 to 4 voxels."""
    limit = campagnolo2015.TOLERANCES[-1]
    paper = campagnolo2015.PAPER["V"]["rows"]
    wide: dict[str, Any] = {"hmin": 0.4, "hmax": 4.0}
    methods = dict(
        zip(
            paper,
            (
                wvr.Riemann(0.1),
                campagnolo2015.adaptive(limit, **wide),
                campagnolo2015.adaptive(limit, "decoupled", **wide),
            ),
            strict=True,
        )
    )
    times = campagnolo2015.fastest(make_scene("Bonsai", day.quick), methods, day.device.alias)
    return {name: f"{1 / seconds:.1f} ({paper[name][1]:g})" for name, seconds in times.items()}


def lum(day: Day) -> Work:
    """Table 1: seconds to build a table."""
    hoisted = make_hoisted()
    for n in [32] if day.quick else lum2004.PAPER:
        yield f"n = {n}", partial(lum2004.table1_row, n, day.device, hoisted, n <= BRUTE)
