"""The demonstration: a generated volume with several integrators, their time, samples, and bound and measured error.

``make demo`` or ``python -m studies.demo [folder]``; the pictures go to ``out/demo``.
"""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.logging import RichHandler
from rich.table import Table

import wvr

from .base import reference
from .base.harness import integrator_name

SIZE = (512, 512)
PIXELS = 1000
# Grey levels of the generated tree: leaves about 55, wood about 125, pot about 215.
TREE = wvr.TransferFunction(
    [
        (25, "#3f6b1f", 0.0),
        (50, "#6fae2e", 0.12),
        (75, "#7a9a3a", 0.04),
        (95, "#7a4a21", 0.05),
        (130, "#a8713a", 0.25),
        (165, "#b08050", 0.08),
        (185, "#b5482a", 0.2),
        (220, "#d9673f", 0.5),
        (255, "#f0a070", 0.5),
    ]
)


def main(folder: str = "out/demo") -> None:
    """Render, measure against the reference, and write the pictures."""
    console = Console()
    logging.basicConfig(level="INFO", format="%(message)s", handlers=[RichHandler(console=console, show_path=False)])
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)

    volume = wvr.datasets.load("tree", 192)
    whole = wvr.Camera.fit(volume, direction=(1.0, 0.5, 0.35))
    camera = wvr.Camera(whole.position, whole.target, view_angle=17)
    exact = wvr.render(volume, TREE, camera, SIZE, integrator=wvr.Exact()).rgba
    # An independent check of it, at pixels drawn at random among those that see something.
    seen = np.argwhere(exact[..., 3] > 0)
    y, x = seen[np.random.default_rng(0).choice(len(seen), PIXELS, replace=False)].T
    origins, directions = (rays[y, x] for rays in camera.rays(SIZE))
    with console.status(f"integrating {PIXELS} rays in float64, cell by cell"):
        sums = reference.integrate(volume, TREE, origins, directions, parts=16)
    check = np.abs(exact[y, x] - sums).max()

    table = Table(title=f"{volume}, {SIZE[0]} x {SIZE[1]}, {wvr.get_num_threads()} threads")
    for column in ("integrator", "seconds", "M samples", "bound", "max error", "mean error"):
        table.add_column(column, justify="left" if column == "integrator" else "right")
    for integrator in (
        wvr.Riemann(1.0),
        wvr.Riemann(0.5),
        wvr.Riemann(0.1),
        wvr.Preintegrated(1.0),
        wvr.Preintegrated(0.5),
        wvr.Certified(1 / 512),
        wvr.Certified(1e-4),
    ):
        renderer = wvr.Renderer(volume, TREE, integrator=integrator)
        renderer.render(camera, SIZE)  # tables and kernels are built
        image = renderer.render(camera, SIZE)
        name = integrator_name(integrator)
        image.save(out / f"tree-{name.lower().replace('(', '-').rstrip(')')}.png", background="white")
        error = np.abs(image.rgba - exact)
        seconds, samples = image.stats["seconds"], image.stats["samples"] / 1e6
        bound = "" if image.error_bound is None else f"{image.error_bound.max():.1e}"
        table.add_row(name, f"{seconds:.3f}", f"{samples:.1f}", bound, f"{error.max():.1e}", f"{error.mean():.1e}")
    console.print(table)
    console.print(
        f"Errors are absolute, of linear premultiplied RGBA in [0, 1], against Exact(); fine sums in float64 "
        f"differ from that by {check:.0e} at most at {PIXELS} pixels. The pictures are in {out}."
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
