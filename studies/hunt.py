"""The hunt: certified images of scenes in which bounds are easily false, by the million rays, before ``Exact``.

A part a kind of ``base.adversarial``, so that a study that was stopped goes on with the kinds that are left. Pixels
that differ from ``Exact`` by more than their bound are held against enclosures, which decide; each that is beyond its
bound is written as a small program that shows it, and the study fails.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import wvr
from wvr.files import write_text

from .base.adversarial import KINDS, Adversary, adversary, errors
from .base.rows import write_rows
from .base.study import Study
from .enclosure import tolerance_of

STUDY = Study("hunt", "The hunt: bounds by the million rays")

SIZE = (48, 48)
SCENES = 720
# What ``Exact`` may be off by itself, in parts of the brightest colour, before an enclosure is asked.
EXACT = 1e-12

PROGRAM = '''"""A pixel beyond its bound: off by {error!r}, bound {bound!r}."""

import wvr
from studies.hunt import hunted

scene = hunted({kind!r}, {seed!r})
image = scene.render(wvr.Certified({tolerance!r}), precision={precision!r})
print(image.rgba[{y}, {x}], image.error_bound[{y}, {x}], scene.enclose({x}, {y}))
'''


@dataclass
class Bag:
    """What a hunt came back with."""

    scenes: int = 0
    rays: int = 0
    refused: int = 0
    asked: int = 0  # enclosures
    undecided: int = 0
    ratio: float = 0.0  # worst error over bound before ``Exact``


def hunted(name: str, seed: int) -> Adversary:
    """A scene of a kind; seeds are others than those of the study of enclosures."""
    return replace(adversary(name, seed + 1_000_000), size=SIZE)


def hunt(name: str, seed: int, bag: Bag) -> list[dict[str, Any]]:
    """Pixels of a scene that are beyond their bound."""
    scene = hunted(name, seed)
    tolerance, precision = tolerance_of(seed + 1_000_000)
    try:
        image = scene.render(wvr.Certified(tolerance), precision=precision)
    except ValueError as error:
        if "tolerance must be at least" not in str(error):
            raise
        bag.refused += 1
        return []
    exact = scene.render(wvr.Exact())
    assert image.error_bound is not None
    bound = image.error_bound.astype(np.float64)
    off = np.abs(image.rgba.astype(np.float64) - exact.rgba).max(axis=2)
    bag.scenes += 1
    bag.rays += off.size
    # Not what rounding of ``Exact`` may come to.
    bag.ratio = max(bag.ratio, float(np.max((off - EXACT) / np.maximum(bound, 1e-30))))
    beyond = []
    for y, x in np.argwhere(~(off <= bound + EXACT * max(1.0, float(exact.rgba.max())))).tolist():
        bag.asked += 1
        least, most = errors(image.rgba[y, x], scene.enclose(x, y))
        if least > bound[y, x]:
            where = {"kind": name, "seed": seed, "x": x, "y": y, "tolerance": tolerance, "precision": precision}
            beyond.append(where | {"error": least, "bound": float(bound[y, x])})
        elif most > bound[y, x]:
            bag.undecided += 1
    return beyond


def _part(name: str) -> Callable[[Path, bool], str]:
    def work(folder: Path, quick: bool) -> str:
        bag, beyond = Bag(), []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of rays over their tolerance, and where nothing is visible
            for seed in range(2 if quick else SCENES):
                beyond += hunt(name, seed, bag)
        row = {
            "kind": name,
            "scenes": bag.scenes,
            "tolerances refused": bag.refused,
            "rays": bag.rays,
            "beyond their bound": len(beyond),
            "worst error / bound": bag.ratio,
            "enclosures asked": bag.asked,
            "undecided": bag.undecided,
        }
        write_rows(folder, "rays", f"Rays of {name}", [row])
        for one in beyond:
            write_text(
                folder / "beyond-{kind}-{seed}-{x}-{y}.py".format(**one).replace(" ", "_"), PROGRAM.format(**one)
            )
        if beyond:
            raise AssertionError(f"{len(beyond)} pixels of {name} are further off than their bound: {beyond[:3]}")
        return f"None of {bag.rays} rays of {bag.scenes} scenes is further off than its bound."

    work.__name__ = name
    work.__doc__ = f"Rays of scenes of {name}: those beyond their bound, and the worst error over bound."
    return work


for _name in KINDS:
    STUDY.part(_name.capitalize())(_part(_name))
