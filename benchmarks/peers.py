"""wvr and what else a Python user has on a CPU: time a frame and error against the true image."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from studies.base.harness import (
    Contender,
    Result,
    Row,
    Settings,
    errors_against_time,
    integrator_name,
    interleave,
    machine,
    summarize,
    timed,
)
from studies.base.ospray_cpu import OsprayCpu
from studies.base.peer import NotAvailableError, Peer
from studies.base.vtk_cpu import VtkCpu

from . import numpy_marcher
from .marcher import Marcher
from .scenes import CONVERGED, Scene, Truth, make_scenes, truth

INTEGRATORS = (
    wvr.Riemann(1.0),
    wvr.Riemann(0.5),
    wvr.Preintegrated(1.0),
    wvr.Preintegrated(0.5),
    wvr.Certified(1 / 512),
)
BASELINE = "wvr Riemann(1.0)"
NUMPY = "NumPy and SciPy, step 1"
# What uint8 samples are multiplied by.
VTK = {"VTK, uint8, step 1": 1, "VTK, uint16, step 1": 257}
OSPRAY = "OSPRay scivis, step 1"
# Steps of the marcher by hand.
MARCHER = {"C++ AVX-512, step 1": 1.0, "C++ AVX-512, step 0.5": 0.5}


def measure(settings: Settings) -> Result:
    """Wall and CPU seconds a frame, and errors over all channels of random pixels."""
    scenes = [scene for scene in make_scenes(settings.quick) if scene.camera.parallel or not settings.quick]
    missing: dict[str, str] = {}
    rows: list[Row] = []
    truths = {scene.label: truth(scene, settings.pixels, settings.out) for scene in scenes}
    for scene in scenes:
        rows += _compare(scene, settings, truths[scene.label], missing)
    notes = [
        f"Errors are absolute, of linear premultiplied RGBA in [0, 1], over {settings.pixels} random pixels, against a "
        f"float64 reference that refining moves by less than {CONVERGED:g}.",
        "Parts that the reference cuts a ray in a cell into, and what half as many change: "
        + "; ".join(f"{label}: {true.parts}, {true.change:.1e}" for label, true in truths.items())
        + ".",
        "wvr ends rays at a transparency of 1/1024, its default, and VTK where its fixed point does; NumPy does not.",
        "VTK's time includes drawing its image with OpenGL and reading it back, in 8 bits a channel.",
        f"{NUMPY} has fewer runs, because it is slow.",
        "C++ is benchmarks/marcher.cpp, about the most that a processor can do, with no bound on the error.",
        *(f"{name}: not available: {reason}." for name, reason in missing.items()),
    ]
    title = f"Peers on the CPU, {wvr.get_num_threads()} threads: {scenes[0].measures}"
    return Result("peers", title, BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {"peers": errors_against_time(result)}


def _compare(scene: Scene, settings: Settings, true: Truth, missing: dict[str, str]) -> list[Row]:
    """The rows of a scene; ``missing`` collects who cannot run, and why."""
    images: dict[str, NDArray] = {}

    def contender(name: str, render: Callable[[], NDArray]) -> Contender:
        def work() -> None:
            images[name] = render()

        return timed(work)

    contenders = {}
    for integrator in INTEGRATORS:
        name = f"wvr {integrator_name(integrator)}"
        renderer = wvr.Renderer(scene.volume, scene.transfer_function, integrator=integrator, device="cpu")
        contenders[name] = contender(name, lambda r=renderer: r.render(scene.camera, scene.size).rgba)  # type: ignore[misc]
    contenders[NUMPY] = contender(NUMPY, lambda: numpy_marcher.render(scene))
    threads = wvr.get_num_threads()
    others: dict[str, Callable[[], Peer]] = {
        **{name: lambda scale=scale: VtkCpu(scene, scale, threads) for name, scale in VTK.items()},  # type: ignore[misc]
        OSPRAY: lambda: OsprayCpu(scene, threads),
    }
    with ExitStack() as stack:
        started = {}
        for name in [*others, *MARCHER]:
            try:
                if name in missing:
                    continue
                if name in MARCHER:
                    marcher = Marcher(scene, MARCHER[name], threads, settings.out)
                    contenders[name] = contender(name, marcher.render)
                else:
                    other = stack.enter_context(others[name]())
                    other.frame()
                    started[name], contenders[name] = other, other.frame
            except NotAvailableError as error:
                missing[name] = str(error)
        # In the first round only: a frame takes as long as dozens of the others.
        times = interleave(contenders, settings.rounds, {NUMPY: settings.rounds})
        images |= {name: other.image() for name, other in started.items()}
    return summarize(scene.label, times, BASELINE, lambda name, wall: dict(true.errors(images[name])))
