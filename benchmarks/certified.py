"""What a certificate costs: frames within a tolerance against uniform sampling, and against sampling as accurate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from studies.base.harness import (
    Contender,
    Result,
    Row,
    Settings,
    Time,
    errors_against_time,
    integrator_name,
    interleave,
    machine,
    summarize,
    timed,
)
from studies.base.scenes import load, make_scene

from .scenes import Scene, make_scenes

BASELINE = "Riemann(1.0)"
UNIFORM = (wvr.Riemann(1.0), wvr.Riemann(0.5), wvr.Preintegrated(0.5))
TOLERANCES = (1 / 512, 1e-3, 1e-4)
# Sampling is refined no further.
FINEST = 1 / 512


def measure(settings: Settings) -> Result:
    """Seconds a frame and the largest error of a channel against ``Exact``, then what changes cost."""
    rows: list[Row] = []
    for scene in _scenes(settings.quick):
        exact = _renderer(scene, integrator=wvr.Exact()).render(scene.camera, scene.size).rgba
        images: dict[str, NDArray] = {}
        contenders = {integrator_name(i): _frame(images, _renderer(scene, integrator=i), scene) for i in UNIFORM}
        for tolerance in TOLERANCES:
            name = integrator_name(wvr.Certified(tolerance))
            contenders[name] = _frame(images, _renderer(scene, tolerance=tolerance), scene, name)
        measured = summarize(scene.name, interleave(contenders, settings.rounds), BASELINE)
        rows += [replace(row, extra=_errors(images[row.name], exact)) for row in measured]
        rows.append(_as_accurate(scene, exact, rows[-1], measured[0].wall, settings.quick))
    rows += _changes(settings)
    notes = [
        "Max error: of any channel of any pixel, against Exact.",
        "Riemann as accurate: midpoint, its step halved until its largest error is that of Certified(0.0001), one "
        f"frame. Where that takes steps below {FINEST:g}, the error is that of the finest.",
        "Rays of uniform sampling end at a transparency of 1/1024, where it is to be as accurate never.",
        "S2 noisy is S2 with noise of 4 grey levels. Bonsai and BluntFin have transfer functions like those of "
        "Campagnolo et al. 2015; where their data are not there, generated volumes stand in.",
    ]
    return Result("certified", "Certified frames on the CPU, 512 x 512 pixels", BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    scenes = replace(result, rows=[row for row in result.rows if "max error" in row.extra])
    return {"certified": errors_against_time(scenes)}


def _scenes(quick: bool) -> list[Scene]:
    scenes = [replace(s, name=s.label.split()[0]) for s in make_scenes(quick) if s.label.endswith("perspective")]
    fog = scenes[1]
    noise = np.random.default_rng(7).normal(0, 4, fog.volume.shape)
    noisy = np.clip(np.rint(fog.volume.numpy() + noise), 0, 255).astype(np.uint8)
    scenes.insert(2, replace(fog, name="S2 noisy", volume=wvr.Volume(noisy)))
    for name in ("Bonsai", "BluntFin"):
        scene = make_scene(name, quick)
        scenes.append(replace(scene, camera=wvr.Camera.fit(scene.volume), size=scenes[0].size))
    return scenes


def _renderer(scene: Scene, **options: object) -> wvr.Renderer:
    return wvr.Renderer(scene.volume, scene.transfer_function, device="cpu", **options)  # type: ignore[arg-type]


def _frame(images: dict[str, NDArray], renderer: wvr.Renderer, scene: Scene, name: str | None = None) -> Contender:
    def frame() -> None:
        images[name or integrator_name(renderer.integrator)] = renderer.render(scene.camera, scene.size).rgba  # type: ignore[arg-type]

    return timed(frame)


def _errors(image: NDArray, exact: NDArray) -> dict[str, float | None]:
    error = np.abs(image - exact)
    return {"max error": float(error.max()), "mean error": float(error.mean())}


def _as_accurate(scene: Scene, exact: NDArray, certified: Row, baseline: float, quick: bool) -> Row:
    """Uniform sampling, refined until it is as accurate."""
    step = 1.0
    while True:
        renderer = _renderer(scene, integrator=wvr.Riemann(step), termination=0, precision="float64")
        images: dict[str, NDArray] = {}
        time: Time = _frame(images, renderer, scene)()
        error = _errors(next(iter(images.values())), exact)
        if (error["max error"] or 0.0) <= (certified.extra["max error"] or 0.0) or step <= (1 / 8 if quick else FINEST):
            extra = error | {"step": step, "times certified": time.wall / certified.wall}
            return Row(
                scene.name,
                "Riemann as accurate",
                1,
                time.wall,
                time.wall,
                time.wall,
                time.cpu,
                time.wall / baseline,
                extra,
            )
        step /= 2


def _changes(settings: Settings) -> list[Row]:
    """A new transfer function, nothing to see, and a sparse volume with and without skipping; tolerance 1/512."""
    scene = next(s for s in _scenes(settings.quick) if s.name == "Bonsai")
    tf = scene.transfer_function
    functions = [tf, wvr.TransferFunction.from_arrays(tf.knots, tf.colors, 0.999 * tf.opacities)]
    renderer = _renderer(scene)

    def changed() -> None:
        functions.reverse()
        renderer.transfer_function = functions[0]
        renderer.render(scene.camera, scene.size)

    still = _renderer(scene)
    nothing = wvr.TransferFunction([(0, "red", 0.0), (255, "red", 0.0)])
    transparent = _renderer(replace(scene, transfer_function=nothing))
    contenders = {
        "frame": timed(lambda: still.render(scene.camera, scene.size)),
        "frame with a new transfer function": timed(changed),
        "nothing to see": timed(lambda: transparent.render(scene.camera, scene.size)),
    }
    rows = summarize("changes, Bonsai", interleave(contenders, settings.rounds), "frame")
    volume = load("aneurism", settings.quick)
    lo, hi = volume.range
    points = [(lo + 0.3 * (hi - lo), "red", 0.0), (hi, "white", 0.3)]
    sparse = replace(
        scene, volume=volume, transfer_function=wvr.TransferFunction(points), camera=wvr.Camera.fit(volume)
    )
    images: dict[str, NDArray] = {}
    contenders = {
        name: _frame(images, _renderer(sparse, skip_empty=skip), sparse, name)
        for name, skip in (("skipping", True), ("not skipping", False))
    }
    return rows + summarize("sparse, aneurism", interleave(contenders, settings.rounds), "skipping")
