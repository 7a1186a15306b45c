"""How many samples a second the ray caster takes, on one thread and on all: no ray ends early, no space is skipped."""

from __future__ import annotations

from dataclasses import replace

from matplotlib.figure import Figure

import wvr
from studies.base.harness import (
    Contender,
    Result,
    Row,
    Settings,
    Time,
    bars,
    integrator_name,
    interleave,
    machine,
    summarize,
    timed,
)

from .scenes import Scene, make_scenes

INTEGRATORS = (wvr.Riemann(1.0), wvr.Preintegrated(1.0))
SCENES = ("S1 parallel", "S2 parallel")
BASELINE = "1 thread"
RATE = "M samples/s"


def measure(settings: Settings) -> Result:
    """Seconds a frame, million samples a second, and how many times faster than one thread."""
    threads = wvr.get_num_threads()
    scenes = [scene for scene in make_scenes(settings.quick) if scene.label in SCENES]
    rows: list[Row] = []
    try:
        for scene in scenes:
            for integrator in INTEGRATORS:
                renderer = wvr.Renderer(
                    scene.volume,
                    scene.transfer_function,
                    integrator=integrator,
                    termination=0,
                    skip_empty=False,
                    device="cpu",
                )
                millions = renderer.render(scene.camera, scene.size).stats["samples"] / 1e6
                contenders = {BASELINE: _frame(renderer, scene, 1), "all threads": _frame(renderer, scene, threads)}
                group = f"{scene.label}, {integrator_name(integrator)}"
                for row in summarize(group, interleave(contenders, settings.rounds), BASELINE):
                    rows.append(replace(row, extra={RATE: millions / row.wall, "scaling": 1 / row.ratio}))
    finally:
        wvr.set_num_threads(threads)
    notes = [
        f"All threads: {threads}. Scaling: how many times faster than one.",
        "No early termination, no skipping: rays walk through the whole volume. A sample is a segment of length 1.",
    ]
    title = f"Throughput on the CPU: {scenes[0].measures}"
    return Result("throughput", title, BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""

    def rate(row: Row) -> tuple[float, float, float]:
        """Of the median, slowest and fastest run."""
        millions = (row.extra[RATE] or 0.0) * row.wall
        return millions / row.wall, millions / row.slowest, millions / row.fastest

    return {"throughput": bars(result, rate, "Million samples a second")}


def _frame(renderer: wvr.Renderer, scene: Scene, threads: int) -> Contender:
    run = timed(lambda: renderer.render(scene.camera, scene.size))

    def frame() -> Time:
        wvr.set_num_threads(threads)
        return run()

    return frame
