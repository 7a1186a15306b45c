"""What the paper leaves open: how fast the image converges in the slice distance, and how good the model is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import wvr

from ..base.harness import COLORS, save_figure
from ..base.rows import write_rows
from ..lighting import panels
from .methods import STUDY, Method
from .scenes import Scene, key_light, make_scene

VARIANTS: dict[str, dict[str, Any]] = {
    "paper: Lie, front light, fixed kernel": {"kernel": "fixed"},
    "Lie, front light": {},
    "Lie, traced light": {"received": "traced"},
    "Strang, front light": {"splitting": "strang"},
    "Strang, traced light": {"splitting": "strang", "received": "traced"},
    "the same, fixed kernel": {"splitting": "strang", "received": "traced", "kernel": "fixed"},
}


@STUDY.part("Order of convergence")
def convergence(folder: Path, quick: bool) -> str:
    """Order of the image in the slice distance, on a smooth scene."""
    volume = wvr.datasets.load("blobs", 48)
    tf = wvr.TransferFunction([(0, "orange", 0.0), (255, "royalblue", 0.4)])
    scene = Scene("blobs", volume, tf, (1, 0.6, 0.4), (0, 0, 1), 24 if quick else 128)
    distances = np.array([2.0, 1.0, 0.5, 0.25])
    fine = Method("ICS", 1 / 32).render(scene, **VARIANTS["Strang, traced light"]).rgba
    rows = []
    figure = Figure(figsize=(5, 3.6), layout="constrained")
    axes = figure.subplots()
    for i, (name, options) in enumerate(VARIANTS.items()):
        errors = [float(np.abs(Method("ICS", d).render(scene, **options).rgba - fine).mean()) for d in distances]
        order = float(np.polyfit(np.log(distances), np.log(errors), 1)[0])
        rows.append(
            {"variant": name} | {f"{d:g}": e for d, e in zip(distances, errors, strict=True)} | {"order": order}
        )
        axes.loglog(distances, errors, "os^DvP"[i] + "-", ms=4, color=COLORS[i], label=f"{name}: {order:.1f}")
    axes.set(xlabel="slice distance [voxels]", ylabel="mean error")
    axes.set_xticks(distances, [f"{d:g}" for d in distances])
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize="x-small", title="order", title_fontsize="x-small")
    axes.grid(color="0.9")
    save_figure(figure, folder / "convergence")
    write_rows(folder, "convergence", "Mean error against slices 1/32 voxel apart, Strang and traced light", rows)
    return "Orders: " + ", ".join(f"{row['variant']} {row['order']:.2f}" for row in rows) + "."


@STUDY.part("The model")
def model(folder: Path, quick: bool) -> str:
    """How far light that diffuses is from light that is scattered once in a cone, and which spread is the nearest."""
    return " ".join(
        _model(folder, make_scene(name, quick, 192), 8 if quick else 64) for name in ("bonsai", "head, bone")
    )


def _model(folder: Path, scene: Scene, directions: int) -> str:
    camera, size = scene.camera(), (scene.size, scene.size)
    light, name = key_light(camera), scene.name.split(",")[0]
    unlit = wvr.render(scene.volume, scene.tf, camera, size)

    def swept(angle: float) -> wvr.Image:
        return Method("ICS", 0.5, 1).render(scene, spread=angle, **VARIANTS["Strang, traced light"])

    rows, nearest, images = [], [], {}
    for angle in (0.0, 5.0, 20.0, 40.0):
        truth = wvr.single_scattering(
            scene.volume, scene.tf, camera, size, light=light, spread=angle, directions=directions
        )
        seen = truth.rgba[..., 3] > 0
        shadow = float(np.abs(unlit.rgba - truth.rgba)[seen][:, :3].mean())

        def compared(
            image: wvr.Image, truth: wvr.Image = truth, seen: np.ndarray = seen, shadow: float = shadow
        ) -> dict:
            difference = np.abs(image.rgba - truth.rgba)[seen][:, :3]
            return {
                "mean difference": float(difference.mean()),
                "of what shadows do [%]": 100 * float(difference.mean()) / shadow,
                "brighter [%]": 100 * float(image.rgba[seen][:, :3].mean() / truth.rgba[seen][:, :3].mean() - 1),
            }

        image = swept(angle)
        rows.append({"spread": angle} | compared(image) | {"reference s": truth.stats["seconds"]})
        rows[-1]["sweep s"] = image.stats["seconds"]
        if angle == 20:
            images["scattered, 20 degrees"] = truth, f"{truth.stats['seconds']:.0f} s"
            images["swept, 20 degrees"] = image, f"mean difference {rows[-1]['mean difference']:.3f}"
            for wide in (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0):
                other = swept(wide)
                nearest.append({"spread of the sweep": wide} | compared(other))
                if wide == 60:
                    images["swept, 60 degrees"] = other, f"mean difference {nearest[-1]['mean difference']:.3f}"
    title = (
        f"Sweep, slices 0.5 apart with 1 subsample, against single scattering, {directions} directions: {scene.name}"
    )
    write_rows(folder, f"model-{name}", title, rows)
    write_rows(folder, f"nearest-{name}", "Sweeps of other spreads against single scattering of 20 degrees", nearest)
    panels(folder, f"model-{name}", images)
    means = ", ".join(f"{row['mean difference']:.3f} at {row['spread']:g}" for row in rows)
    best = min(nearest, key=lambda row: row["mean difference"])
    return (
        f"{scene.name}: mean difference {means} degrees; a cone of 20 is nearest to a spread of "
        f"{best['spread of the sweep']:g}: {best['mean difference']:.3f}."
    )
