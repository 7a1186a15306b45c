"""What light costs: frames of scenes with it and without, beside the same of VTK's processor ray caster."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import partial

from matplotlib.figure import Figure

import wvr
from studies.base.harness import (
    Result,
    Row,
    Settings,
    bars,
    integrator_name,
    interleave,
    machine,
    processor_ratios,
    summarize,
    timed,
)
from studies.base.scenes import make_scene
from studies.base.vtk_cpu import VtkCpu

SCENES = ("Bonsai", "Engine")
INTEGRATORS = (wvr.Certified(1 / 512), wvr.Preintegrated(1.0))
BASELINE = f"{integrator_name(INTEGRATORS[0])}, lit"
VTK = "VTK, uint8, lit"


def measure(settings: Settings) -> Result:
    """Wall and processor seconds a frame, the latter also in parts of VTK's, lit."""
    rows: list[Row] = []
    notes = [
        "In parts of VTK's, lit, are processor seconds, medians of runs that take turns. Each has light as by default.",
        "VTK's samples are a voxel apart; it has light of samples by a table of directions, and interpolates that.",
    ]
    for name in SCENES:
        scene = make_scene(name, settings.quick)
        contenders = {}
        with ExitStack() as stack:
            for lit in (False, True):
                behind = ", lit" if lit else ""
                lighting = wvr.Lighting() if lit else None
                for integrator in INTEGRATORS:
                    renderer = scene.renderer(integrator, lighting=lighting, device="cpu")
                    work = timed(partial(renderer.render, scene.camera, scene.size))
                    contenders[integrator_name(integrator) + behind] = work
                vtk = stack.enter_context(VtkCpu(scene, 1, wvr.get_num_threads(), lit=lit))
                if why := vtk.missing():
                    notes.append(f"VTK, uint8{behind}: not available: {why}.")
                else:
                    contenders[f"VTK, uint8{behind}"] = vtk.frame
            times = interleave(contenders, settings.rounds)
        ratios = processor_ratios(times, VTK)
        for row in summarize(name, times, BASELINE):
            rows.append(replace(row, extra={"CPU, of VTK's, lit": ratios.get(row.name)}))
    title = f"Light on the CPU, {wvr.get_num_threads()} threads: {scene.size[0]} x {scene.size[1]} pixels of uint8"
    return Result("lit", title, BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {"lit": bars(result, lambda row: (row.wall, row.fastest, row.slowest), "Seconds a frame")}
