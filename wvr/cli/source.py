"""The volume that a command is for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

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
        )
    if scalars is not None:
        raise ValueError(f"--scalars is for files with several arrays, {source!r} is a dataset")
    if source in datasets.GENERATED:
        stage(f"generating {source}")
        return datasets.load(source, 128 if size is None else size)
    if size is not None:
        raise ValueError(f"--dataset-size is for generated datasets, {source!r} is downloaded as it is")
    return datasets.fetch(source)  # which shows its own progress
