"""Deliberate faults: mistakes put into a copy of the code, one at a time, each of which a named test must catch.

A test of a proof is worth what it would catch. Each fault is a line of a file and what stands in its place; where the
same is written twice, for one ray and for many, in both: that the two agree is another test.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from .base.rows import write_rows
from .base.study import Study

STUDY = Study("faults", "Deliberate faults, and the tests that catch them")

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Fault:
    """What is wrong, where, and which test says so."""

    what: str
    file: str
    right: str
    wrong: str
    test: str
    twins: tuple[tuple[str, str, str], ...] = ()  # files, and what is right and wrong there


SERIES = "kernels/integrators/series.py"
PROOF = "tests/integrators/test_proof.py"
TRUTH = "tests/test_truth_bounds.py"
SINGLE = "tests/integrators/test_single.py"
SIMPLER = "tests/transfer/test_simplify.py"
FAULTS = (
    Fault(
        "the series' remainder halved",
        SERIES,
        "error = real(wp.static(1.0 / 3.0",
        "error = real(wp.static(1.0 / 6.0",
        f"{PROOF}::test_the_kernels_series_and_its_bounds",
    ),
    Fault(
        "a sign in the series",
        SERIES,
        "- times(aa, vw)",
        "+ times(aa, vw)",
        f"{PROOF}::test_the_kernels_series_and_its_bounds",
    ),
    Fault(
        "a term of the series left out",
        SERIES,
        "ww + times(g, wwW) - times(a, vww)",
        "ww - times(a, vww)",
        f"{PROOF}::test_the_kernels_series_and_its_bounds",
    ),
    Fault(
        "too few nodes of quadrature",
        "kernels/integrators/pieces.py",
        "    return low\n",
        "    return 100.0 * low\n",
        f"{PROOF}::test_quadrature_of_a_piece",
    ),
    Fault(
        "a mask one cell short",
        "kernels/field/blocks.py",
        "        for (int x = 0; x < 4; ++x) {\n            const double a",
        "        for (int x = 0; x < 3; ++x) {\n            const double a",
        "tests/field/test_blocks.py::test_masks_have_every_cell_that_is_seen",
    ),
    Fault(
        "rays are never astray",
        "wvr/frame.py",
        "ASTRAY = 2.0**-49",
        "ASTRAY = 2.0**-59",
        f"{PROOF}::test_rays_are_no_farther_astray_than_said",
    ),
    Fault(
        "faces of the box left out of the bound",
        "kernels/integrators/certified.py",
        "return most * (loose",
        "return zero * (loose",
        f"{PROOF}::test_a_ray_along_a_face_is_bounded_by_all_that_it_may_see",
    ),
    Fault(
        "faces of the box left out of the bound of rays in lanes",
        "kernels/rays.py",
        "const vd around = most *",
        "const vd around = none *",
        f"{PROOF}::test_a_ray_along_a_face_is_bounded_by_all_that_it_may_see",
    ),
    Fault(
        "jumps left out of the bound",
        "kernels/integrators/pieces.py",
        "        return size\n\n    @wp.func\n    def fuzzy",
        "        return real(0.0) * size\n\n    @wp.func\n    def fuzzy",
        f"{TRUTH}::test_rays_along_which_the_scalar_is_at_a_jump",
    ),
    Fault(
        "a cell in single precision a third as wrong as it is",
        "kernels/integrators/packet.py",
        "e = 1.00001f * (bright",
        "e = 0.33f * (bright",
        f"{SINGLE}::test_random_scenes_are_within_their_bounds",
        tuple(
            (f"kernels/integrators/{name}.py", "result.e = real(1.00001)", "result.e = real(0.33)")
            for name in ("rowed", "single")
        ),
    ),
    Fault(
        "a cell that is cut a fifth as wrong as it is",
        "kernels/integrators/crossings.py",
        "e = 1.00001f * (linear",
        "e = 0.2f * (linear",
        f"{SINGLE}::test_cut_cells_are_within_their_bounds",
    ),
    Fault(
        "rounding of the image left out of the budget",
        "wvr/integrators/certified.py",
        "float(np.finfo(self.shown(scene)).eps) / 2)",
        "0.0)",
        f"{TRUTH}::test_bounds_are_at_most_the_tolerance_or_it_is_refused",
    ),
    Fault(
        "the simpler transfer function left out of the bound",
        "wvr/integrators/certified.py",
        "max(one.color + shares.brightest * one.relative for one in points)",
        "0.0",
        f"{SIMPLER}::test_what_a_simpler_transfer_function_leaves_out_is_in_the_bound",
    ),
    Fault(
        "control points of jumps left out of the simpler transfer function",
        "wvr/transfer/simplify.py",
        "if jumps[j] > jumps[i]:",
        "if False:",
        f"{SIMPLER}::test_deviations",
    ),
)


def fails(test: str, folder: Path) -> bool:
    """Whether a test fails in a copy of the code."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", test]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    code = subprocess.run(command, cwd=folder, env=environment, capture_output=True).returncode
    if code not in (0, 1):
        raise AssertionError(f"{test} did not run: pytest ended with {code}")
    return code == 1


def caught(fault: Fault, folder: Path) -> bool:
    """Whether its test fails in a copy of the code in ``folder`` that has it."""
    before = {}
    for name, right, wrong in ((fault.file, fault.right, fault.wrong), *fault.twins):
        path = folder / name
        text = before[path] = path.read_text()
        if text.count(right) != 1:
            raise AssertionError(f"{fault.what}: {name} must have once {right!r}")
        path.write_text(text.replace(right, wrong))
    try:
        return fails(fault.test, folder)
    finally:
        for path, text in before.items():
            path.write_text(text)


@STUDY.part("Deliberate faults")
def faults(folder: Path, quick: bool) -> str:
    """Faults in the series, the masks, the rounding and the budget, and whether the tests named catch them."""
    rows = []
    with TemporaryDirectory() as place:
        copy = Path(place)
        for name in ("wvr", "tests", "studies", "kernels"):
            shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", copy)
        # As it is installed, so that nothing else is found.
        (copy / "wvr/kernels").symlink_to(copy / "kernels")
        chosen = FAULTS[:1] if quick else FAULTS
        for test in dict.fromkeys(fault.test for fault in chosen):
            if fails(test, copy):
                raise AssertionError(f"{test} fails without any fault")
        for fault in chosen:
            rows.append({"fault": fault.what, "test": fault.test, "caught": "yes" if caught(fault, copy) else "NO"})
    write_rows(folder, "faults", "Deliberate faults", rows)
    missed = [row["fault"] for row in rows if row["caught"] == "NO"]
    if missed:
        raise AssertionError(f"no test caught: {', '.join(missed)}")
    return f"All of {len(rows)} faults are caught by the test named."
