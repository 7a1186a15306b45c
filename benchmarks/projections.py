"""Exact projections and isosurfaces, and the maximum intensity projection of VTK's processor ray caster."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

import wvr
from studies.base.harness import (
    Result,
    Row,
    Settings,
    bars,
    interleave,
    machine,
    processor_ratios,
    summarize,
    timed,
)
from studies.base.scenes import Scene
from studies.base.vtk_cpu import VtkCpu

BASELINE = "wvr maximum"
VTK = "VTK maximum, step 1"
VOLUMES = ("blobs", "tree", "turbulence")
METHODS = {
    BASELINE: wvr.Projection("max"),
    "wvr minimum": wvr.Projection("min"),
    "wvr mean": wvr.Projection("mean"),
}


def measure(settings: Settings) -> Result:
    """Wall and processor seconds a frame, the latter also in parts of VTK's."""
    size = (48, 48) if settings.quick else (512, 512)
    rows: list[Row] = []
    notes = [
        "In parts of VTK's are processor seconds, medians of runs that take turns.",
        "VTK's samples are a voxel apart and rounded to 8 bits; wvr's values are exact but for rounding in float64.",
    ]
    for name in VOLUMES:
        loaded = wvr.datasets.load(name, 32 if settings.quick else 256)
        # Of 256 levels, which VTK is fastest with.
        low, high = loaded.range
        volume = wvr.Volume(np.rint((loaded.numpy() - low) * (255 / (high - low))).astype(np.uint8))
        tf = wvr.TransferFunction.from_colormap("gray", volume.range, 1.0)
        camera = wvr.Camera.fit(volume)
        methods = METHODS | {"wvr isosurface": wvr.Isosurface(100.0)}
        renderers = {n: wvr.Renderer(volume, tf, integrator=method, device="cpu") for n, method in methods.items()}
        contenders = {n: timed(partial(one.render, camera, size)) for n, one in renderers.items()}
        with ExitStack() as stack:
            # VTK's own opacities are of no account.
            scene = Scene(name, volume, wvr.TransferFunction.from_colormap("gray", volume.range), camera, size)
            vtk = stack.enter_context(VtkCpu(scene, 1, wvr.get_num_threads(), maximum=True))
            if why := vtk.missing():
                notes.append(f"{VTK}: not available: {why}.")
            else:
                contenders[VTK] = vtk.frame
            times = interleave(contenders, settings.rounds)
        ratios = processor_ratios(times, VTK)
        for row in summarize(name, times, BASELINE):
            rows.append(replace(row, extra={"CPU, of VTK's": ratios.get(row.name)}))
    title = (
        f"Projections on the CPU, {wvr.get_num_threads()} threads: 256 x 256 x 256, uint8, {size[0]} x {size[1]} pixels"
    )
    return Result("projections", title, BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {"projections": bars(result, lambda row: (row.wall, row.fastest, row.slowest), "Seconds a frame")}
