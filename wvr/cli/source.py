"""The volume that a command is for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..validation import near
from .stages import Stages

if TYPE_CHECKING:
    from ..volume import Volume


def load(
    source: str, scalars: str | None, nan: Literal["error", "transparent"], size: int | None, stage: Stages
) -> Volume:
    from .. import datasets
    from ..io import read

    if Path(source).exists():
        if size is not None:
            raise ValueError(f"--dataset-size is for generated datasets, {source!r} is a file")
        stage(f"reading {source}")
        return read(source, scalars, nan)
    if source not in datasets.names():
        raise FileNotFoundError(
            f"{source!r} is neither a file or folder nor a dataset; datasets are {', '.join(datasets.names())}"
            f"{near(source, [*_files_beside(source), *datasets.names()])}"
        )
    if scalars is not None:
        raise ValueError(f"--scalars is for files with several arrays, {source!r} is a dataset")
    if source in datasets.GENERATED:
        stage(f"generating {source}")
        return datasets.load(source, 128 if size is None else size)
    if size is not None:
        raise ValueError(f"--dataset-size is for generated datasets, {source!r} is downloaded as it is")
    return datasets.fetch(source)  # which shows its own progress


def _files_beside(source: str) -> list[str]:
    """What else there is where the source was looked for, as it would be given."""
    folder = Path(source).parent
    try:
        return [str(folder / name.name) for name in folder.iterdir()]
    except OSError:
        return []


def load_raw(source: str, shape: str, dtype: str, spacing: str | None, stage: Stages) -> Volume:
    """A file of bare samples."""
    import numpy as np

    from ..io import read_raw

    def numbers(text: str, kind: Any, option: str, example: str) -> tuple[Any, ...]:
        try:
            found = tuple(kind(part) for part in text.replace("x", ",").split(","))
        except ValueError:
            found = ()
        if len(found) != 3:
            raise ValueError(f"{option} must be three numbers along x, y, z, such as {example}, got {text!r}")
        return found

    try:
        kind = np.dtype(dtype)
    except TypeError:
        raise ValueError(
            f"--dtype must be one of NumPy's, such as uint8, int16, >i2 or float32, got {dtype!r}"
        ) from None
    nx, ny, nz = numbers(shape, int, "--shape", "256x256x128")
    steps = (1.0, 1.0, 1.0) if spacing is None else numbers(spacing, float, "--spacing", "0.5,0.5,1.25")
    stage(f"reading {source}")
    order: Literal["little", "big"] = "big" if kind.byteorder == ">" else "little"
    return read_raw(source, (nz, ny, nx), kind.newbyteorder("="), steps, byteorder=order)
