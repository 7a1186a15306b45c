"""Pictures, each with its cost and error: certified images of scans, simulations and generated volumes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import wvr

from .base import scenes as views
from .base.rows import write_rows
from .base.scenes import Points, Scene
from .base.study import Study
from .demo import TREE

STUDY = Study("gallery", "Gallery")

TOLERANCE = 1 / 512


def framed(name: str, quick: bool, points: Points, view_angle: float = 25.0) -> Scene:
    """A volume with control points for the range that its scan has."""
    volume = views.load(name, quick)
    span = (0.0, 4.8427) if name == "bluntfin" else (0.0, 255.0)
    tf = wvr.TransferFunction(views.stretched(points, span, volume))
    return Scene(name, volume, tf, views.camera(name, volume, view_angle), (96, 72) if quick else (640, 480))


def shown(folder: Path, scene: Scene) -> str:
    """Render, judge and write a picture."""
    image = scene.timed(wvr.Certified(TOLERANCE))
    error = wvr.compare(image, scene.render(wvr.Exact()))
    image.save(folder / f"{scene.name}.png", background="white")
    assert image.error_bound is not None
    row = {
        "volume": scene.measures,
        "s": image.stats["seconds_raycast"],
        "max error": error.max,
        "mean error": error.mean,
        "bound": float(image.error_bound.max()),
    }
    write_rows(folder, scene.name, f"{scene.name}, tolerance 1/512, {wvr.get_num_threads()} threads", [row])
    return (
        f"{scene.measures}: {row['s']:.2g} s on {wvr.get_num_threads()} threads; no channel is off by more than "
        f"{row['max error']:.1e}, guaranteed are {row['bound']:.1e}."
    )


@STUDY.part("Tree")
def tree(folder: Path, quick: bool) -> str:
    """A generated volume, leaves and wood of the demonstration."""
    volume = wvr.datasets.load("tree", 32 if quick else 192)
    camera = views.camera("tree", volume, view_angle=17.0)
    return shown(folder, Scene("tree", volume, TREE, camera, (96, 72) if quick else (640, 480)))


@STUDY.part("Bonsai")
def bonsai(folder: Path, quick: bool) -> str:
    """CT: opaque leaves, translucent wood."""
    points = [(25, "darkgreen", 0.0), (40, "olivedrab", 0.4), (70, "yellowgreen", 0.5), (90, "saddlebrown", 0.02),
              (160, "peru", 0.1), (220, "wheat", 0.5)]  # fmt: skip
    return shown(folder, framed("bonsai", quick, points))


@STUDY.part("Engine")
def engine(folder: Path, quick: bool) -> str:
    """CT: three thin surfaces, which sampling would miss."""
    scene = framed("engine", quick, [(0, "white", 0.0), (1, "white", 0.0)])
    low, high = scene.volume.range
    levels = [low + share * (high - low) for share in (0.3, 0.6, 0.85)]
    width = 0.05 * (high - low)
    tf = wvr.TransferFunction.isosurfaces(levels, ["lightsteelblue", "goldenrod", "firebrick"], 0.8, width)
    return shown(folder, replace(scene, transfer_function=tf))


@STUDY.part("Aneurism")
def aneurism(folder: Path, quick: bool) -> str:
    """Angiogram: vessels."""
    return shown(
        folder, framed("aneurism", quick, [(30, "darkred", 0.0), (90, "crimson", 0.3), (255, "mistyrose", 0.9)])
    )


@STUDY.part("BluntFin")
def bluntfin(folder: Path, quick: bool) -> str:
    """Density of a flow: fog with a shock in it."""
    points = [(0.4, "navy", 0.0), (1.0, "royalblue", 0.02), (1.4, "mediumseagreen", 0.02), (2.2, "gold", 0.3),
              (4.5, "red", 0.9)]  # fmt: skip
    return shown(folder, framed("bluntfin", quick, points))
