"""How many samples a second the ray caster takes, on one thread and on all: no ray ends early, no space is skipped."""

from __future__ import annotations

from matplotlib.figure import Figure

import wvr

from .harness import Contender, Result, Settings, Time, bars, integrator_name, interleave, machine, summarize, timed
from .scenes import Scene, make_scenes

INTEGRATORS = (wvr.Riemann(1.0), wvr.Preintegrated(1.0))
SCENES = ("S1", "S2")
RATE = "M samples/s"


def measure(settings: Settings) -> Result:
    """Seconds a frame, million samples a second, and speed relative to one thread."""
    before = wvr.get_num_threads()
    threads = sorted({1, before})
    rows = []
    try:
        for scene in make_scenes(settings.quick):
            if scene.name not in SCENES or not scene.camera.parallel:
                continue
            contenders, samples, alone = {}, {}, {}
            for integrator in INTEGRATORS:
                renderer = wvr.Renderer(
                    scene.volume, scene.transfer_function, integrator=integrator, termination=0, device="cpu"
                )
                count = renderer.render(scene.camera, scene.size).stats["samples"]
                for n in threads:
                    name = _name(integrator, n)
                    contenders[name] = _on(n, renderer, scene)
                    samples[name], alone[name] = count, _name(integrator, 1)
            times = interleave(contenders, settings.rounds)
            walls = {row.name: row.wall for row in summarize(scene.label, times, _name(INTEGRATORS[0], 1))}

            def extra(name: str, wall: float, samples=samples, walls=walls, alone=alone) -> dict[str, float | None]:
                return {RATE: samples[name] / wall / 1e6, "scaling": walls[alone[name]] / wall}

            rows += summarize(scene.label, times, _name(INTEGRATORS[0], 1), extra)
    finally:
        wvr.set_num_threads(before)
    notes = [
        "No early termination: every ray walks through the whole volume. A sample is a segment of length 1.",
        "Scaling: how many times faster than on one thread.",
    ]
    width, height = scene.size
    title = f"Throughput on the CPU: {width} x {height} pixels, {scene.volume}"
    return Result("throughput", title, _name(INTEGRATORS[0], 1), rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {
        "throughput": bars(
            result, lambda row: tuple(row.extra[RATE] * row.wall / t for t in (row.wall, row.slowest, row.fastest)), RATE
        )
    }


def _name(integrator: wvr.Riemann | wvr.Preintegrated, threads: int) -> str:
    return f"{integrator_name(integrator)}, {threads} thread{'s' * (threads > 1)}"


def _on(threads: int, renderer: wvr.Renderer, scene: Scene) -> Contender:
    run = timed(lambda: renderer.render(scene.camera, scene.size))

    def frame() -> Time:
        wvr.set_num_threads(threads)
        return run()

    return frame
