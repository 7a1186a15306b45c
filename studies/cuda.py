"""Kernels for CUDA, on a machine without a GPU: all compile, and what a GPU would have to hold to run them.

``pip install nvidia-cuda-nvcc`` brings the assembler, without which the table has no registers, stack and spills.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import warp as wp

from .base import cuda
from .base.rows import write_rows
from .base.study import Study

STUDY = Study("cuda", "Kernels for CUDA")
# Of what there is, for a quick run.
SAMPLE = ["certified smooth", "certified of 0"]


def row(kernel: wp.Kernel, name: str, folder: Path, assembler: str | None) -> dict[str, Any]:
    """What a kernel is compiled to."""
    path = cuda.compiled(kernel, folder)
    count, share = cuda.instructions(path.read_text())
    result = {"kernel": name, "instructions": count, "float64 [%]": 100 * share}
    return result if assembler is None else result | cuda.resources(path, assembler)


def rows_of(found: dict[wp.Kernel, str]) -> list[dict[str, Any]]:
    """Of kernels, by name.

    Raises
    ------
    AssertionError
        Where any does not compile; it says which, and why.
    """
    assembler = cuda.find_assembler()
    with TemporaryDirectory() as place:
        jobs = [(kernel, name, Path(place) / str(n), assembler) for n, (kernel, name) in enumerate(found.items())]
        rows = cuda.several(row, jobs)
    wrong = [
        f"{name} {error}" for name, error in zip(found.values(), rows, strict=True) if isinstance(error, Exception)
    ]
    if wrong:
        raise AssertionError("\n".join(wrong))
    return rows


@STUDY.part("Kernels for CUDA")
def kernels(folder: Path, quick: bool) -> str:
    """Of each kernel that a GPU would run: instructions of PTX, the share of them in or around float64, and registers,
    stack and spills of a thread. An entry is named by the first scene that asks for it.
    """
    rows = rows_of(cuda.kernels(SAMPLE if quick else None))
    write_rows(folder, "kernels", "Kernels for CUDA", rows)
    said = f"All of {len(rows)} kernels compile for sm_{cuda.ARCH}."
    if "registers" not in rows[0]:
        return said
    spilling = sum(row["spills [bytes]"] > 0 for row in rows)
    full = sum(row["registers"] > 128 for row in rows)
    return f"{said} {full} need more than 128 registers a thread, {spilling} spill some."
