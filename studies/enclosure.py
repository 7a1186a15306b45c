"""An independent judge: certified and exact images against enclosures of their pixels by ball arithmetic.

Whole rays of scenes in which bounds are easily false, of each kind of ``base.adversarial``, at tolerances from 3e-7 to
0.3 and in all precisions; and single pieces, of one cell in which the transfer function is linear, of any optical
depth. A pixel that is further off than its bound is listed, with the scene that it is of, and the study fails.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import wvr
from wvr.scene import Precision

from .base.adversarial import KINDS, Adversary, adversary, errors
from .base.harness import save_figure
from .base.rows import write_rows
from .base.study import Study

STUDY = Study("enclosure", "Enclosures: bounds before an independent judge")

# From which on an enclosure does not say on which side of a jump the truth is.
WIDE = 1e-9
# What nothing may come to in an enclosure, where a clip's face is a cell's.
NOTHING = 1e-30
PRECISIONS: tuple[Precision, ...] = ("auto", "float32", "float64")


@dataclass
class Verdict:
    """What was found of the pixels of some images."""

    scenes: int = 0
    rays: int = 0
    undecided: int = 0
    over: list[dict[str, Any]] = field(default_factory=list)
    ratio: float = 0.0  # worst error over bound
    exact: float = 0.0  # worst error of ``Exact``, over the brightest colour
    refused: int = 0

    def judge(self, scene: Adversary, name: str, seed: int, tolerance: float, precision: Precision) -> None:
        """All pixels of a scene."""
        exact = scene.render(wvr.Exact())
        try:
            image = scene.render(wvr.Certified(tolerance), precision=precision)
        except ValueError as error:
            if "tolerance must be at least" not in str(error):
                raise
            self.refused += 1
            return
        assert image.error_bound is not None
        self.scenes += 1
        for y, x in np.ndindex(image.rgba.shape[:2]):
            truth = scene.enclose(x, y)
            bound = float(image.error_bound[y, x])
            least, most = errors(image.rgba[y, x], truth)
            if not truth.upper.any() and not image.rgba[y, x].any():
                continue  # it sees nothing, and says so
            self.rays += 1
            self.exact = max(self.exact, errors(exact.rgba[y, x], truth)[0] / brightest(scene))
            if bound > 0:
                self.ratio = max(self.ratio, least / bound)
            if least > bound:
                where = {"kind": name, "seed": seed, "x": x, "y": y, "tolerance": tolerance, "precision": precision}
                self.over.append(where | {"error": least, "bound": bound})
            elif most > bound and not (bound == 0 and truth.width < NOTHING):
                self.undecided += 1
                if truth.width < WIDE:
                    raise AssertionError(f"{name} {seed}, pixel {x}, {y}: an enclosure as wide as {truth.width:.3g}")


def brightest(scene: Adversary) -> float:
    """The largest component of a colour, 1 or more."""
    functions = [scene.tf] if scene.tf is not None else list(scene.options["segmentation"].transfer_functions.values())
    return max(1.0, *(float(tf.colors.max()) for tf in functions))


def tolerance_of(seed: int) -> tuple[float, Precision]:
    """From 3e-7 to 0.3."""
    rng = np.random.default_rng(seed)
    return float(10 ** rng.uniform(-6.5, -0.5)), PRECISIONS[int(rng.integers(3))]


@STUDY.part("Rays")
def rays(folder: Path, quick: bool) -> str:
    """Whole rays by kind of scene: those beyond their bound, the worst error over bound, and errors of Exact."""
    rows: list[dict[str, Any]] = []
    over: list[dict[str, Any]] = []
    for name in KINDS:
        verdict = Verdict()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of rays over their tolerance, and where nothing is visible
            for seed in range(2 if quick else 160):
                verdict.judge(adversary(name, seed), name, seed, *tolerance_of(seed))
        over += verdict.over
        rows.append(
            {
                "kind": name,
                "scenes": verdict.scenes,
                "tolerances refused": verdict.refused,
                "rays": verdict.rays,
                "undecided": verdict.undecided,
                "over their bound": len(verdict.over),
                "worst error / bound": verdict.ratio,
                "Exact, worst error": verdict.exact,
            }
        )
    write_rows(folder, "rays", "Rays against enclosures; errors of Exact in parts of the brightest colour", rows)
    _fail(folder, over)
    total, undecided = (sum(row[column] for row in rows) for column in ("rays", "undecided"))
    return (
        f"None of {total} rays is further off than its bound ({undecided} run along a jump or an absent cell's face, "
        f"where nobody can tell); at worst the error is {max(row['worst error / bound'] for row in rows):.3f} of it."
    )


def piece(seed: int, pixels: int) -> tuple[Adversary, float]:
    """A cell in which extinction and colour are linear in the scalar, seen from anywhere; and its largest depth."""
    rng = np.random.default_rng([seed, 1])
    samples = [rng.random((2, 2, 2)), (rng.random((2, 2, 2)) < 0.5) * 1.0, rng.random((2, 2, 2)) ** 8][seed % 3]
    samples[0, 0, 0], samples[1, 1, 1] = 0, 1
    spacing = 10.0 ** rng.uniform(-0.5, 0.5, 3)
    volume = wvr.Volume(samples, spacing)
    opacity = rng.permutation(np.array([rng.choice([0.0, rng.random()]), 0.5]))
    depth = 10 ** rng.uniform(-7, 3)
    unit = float(np.log(2) * np.linalg.norm(spacing) / depth)
    tf = wvr.TransferFunction.from_arrays([0, 1], rng.random((2, 3)), opacity, unit)
    middle = volume.corners.mean(0) + 0.2 * rng.normal(size=3) * spacing
    way = rng.normal(size=3)
    scale = 0.3 * float(spacing.min())
    return Adversary(
        volume, tf, wvr.Camera(middle - 9 * way, middle, rng.normal(size=3), 30.0, scale), (pixels, pixels)
    ), depth


@STUDY.part("Pieces")
def pieces(folder: Path, quick: bool) -> str:
    """Single pieces by optical depth: those beyond their bound, and the error of Exact over opacity and colour."""
    found: list[
        tuple[float, float, float, float, float]
    ] = []  # depth, error of Exact, opacity, of Certified, its bound
    over: list[dict[str, Any]] = []
    for seed in range(10 if quick else 1100):
        scene, _ = piece(seed, 5 if quick else 10)
        tolerance, precision = tolerance_of(seed)
        exact = scene.render(wvr.Exact())
        image = scene.render(wvr.Certified(tolerance), precision=precision)
        assert image.error_bound is not None
        for y, x in np.ndindex(image.rgba.shape[:2]):
            truth = scene.enclose(x, y)
            opacity = float(truth.lower[3])
            if opacity == 0:
                continue
            bound = float(image.error_bound[y, x])
            off, _ = errors(image.rgba[y, x], truth)
            if errors(image.rgba[y, x], truth)[1] > bound:
                over.append({"seed": seed, "x": x, "y": y, "tolerance": tolerance, "error": off, "bound": bound})
            depth = float(-np.log1p(-min(opacity, 1 - 1e-16)))
            found.append((depth, errors(exact.rgba[y, x], truth)[0], opacity, off, bound))
    table = np.array(found)
    rows = [row for low in range(-7, 2) if (row := _decade(table, low)) is not None]
    write_rows(folder, "pieces", "Pieces of one cell against enclosures", rows)
    save_figure(_figure(table), folder / "pieces")
    _fail(folder, over)
    relative = table[:, 1] / table[:, 2]
    return (
        f"None of {len(table)} pieces is further off than its bound. Exact is at most {table[:, 1].max():.1e} off, and "
        f"{relative.max():.1e} of the piece's opacity."
    )


def _decade(table: NDArray[np.float64], low: int) -> dict[str, Any] | None:
    """Of pieces whose depth is from 10**low on."""
    some = table[(table[:, 0] >= 10.0**low) & ((table[:, 0] < 10.0 ** (low + 1)) | (low == 1))]
    if len(some) == 0:
        return None
    return {
        "optical depth from": f"1e{low}",
        "pieces": len(some),
        "worst error / bound": float((some[:, 3] / some[:, 4]).max()),
        "Exact, worst error": float(some[:, 1].max()),
        "of the opacity": float((some[:, 1] / some[:, 2]).max()),
    }


def _figure(table: NDArray[np.float64]) -> Figure:
    figure = Figure(figsize=(6, 3.5))
    axes = figure.subplots()
    axes.plot(table[:, 0], np.maximum(table[:, 1] / table[:, 2], 1e-18), ".", markersize=1)
    axes.set(xscale="log", yscale="log", xlabel="optical depth of a piece", ylabel="error of Exact / opacity")
    axes.grid()
    return figure


def _fail(folder: Path, over: list[dict[str, Any]]) -> None:
    """Where a pixel is beyond its bound."""
    if over:
        write_rows(folder, "over", "Beyond their bound", over)
        raise AssertionError(f"{len(over)} pixels are further off than their bound: {over[:3]}")
