"""The volume that a command is for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from ..validation import near
from .options import Size, Vector, numbers
from .stages import Stages

if TYPE_CHECKING:
    from ..volume import Volume


@Parameter(name="*")
@dataclass(frozen=True)
class Input:
    """How the source is read.

    Attributes
    ----------
    scalars
        Array to read, of a VTK, npz or HDF5 file or a store with several.
    frame
        Volume to read, from 0 on, of a file or series with several in time.
    shape
        NZ,NY,NX: samples along z, y, x of a file of bare samples, x fastest; with --dtype.
    dtype
        Type of bare samples: uint8, int16, float32, ...; big-endian is >u2, >f4, ...
    spacing
        DX,DY,DZ: distances of bare samples along x, y, z; by default 1,1,1. Of a store, instead of those that it says.
    offset
        Bytes before the first bare sample.
    dataset_size
        Samples along each axis of a generated dataset; by default 128.
    """

    scalars: str | None = None
    frame: Annotated[int | None, Parameter(validator=Number(gte=0))] = None
    shape: str | None = None
    dtype: str | None = None
    spacing: Vector | None = None
    offset: Annotated[int | None, Parameter(validator=Number(gte=0))] = None
    dataset_size: Size | None = None

    def load(self, source: str, nan: Literal["error", "transparent"], stage: Stages) -> Volume:
        """The volume of a file, folder or dataset."""
        from .. import datasets

        if Path(source).exists():
            if self.dataset_size is not None:
                raise ValueError(f"--dataset-size is for generated datasets, {source!r} is a file")
            stage(f"reading {source}")
            try:
                return self._read(source, nan)
            except ValueError as error:
                # It names what Python calls them.
                message = str(error).replace('nan="transparent"', "--nan transparent").replace("frame=", "--frame")
                raise ValueError(message.replace("scalars must name", "--scalars must name")) from None
        if source not in datasets.names():
            raise FileNotFoundError(
                f"{source!r} is neither a file or folder nor a dataset; datasets are {', '.join(datasets.names())}"
                f"{near(source, [*_files_beside(source), *datasets.names()])}"
            )
        self._refuse("scalars", "frame", "shape", "dtype", "spacing", "offset", of=f"files, {source!r} is a dataset")
        if source in datasets.GENERATED:
            stage(f"generating {source}")
            return datasets.load(source, 128 if self.dataset_size is None else self.dataset_size)
        if self.dataset_size is not None:
            raise ValueError(f"--dataset-size is for generated datasets, {source!r} is downloaded as it is")
        return datasets.fetch(source)  # which shows its own progress

    def of_store(self, source: str) -> dict[str, Any]:
        """Keywords of :func:`wvr.open`, for what stays where it is."""
        whole = f"what is read as a whole, {source!r} is read as it is seen"
        self._refuse("frame", "shape", "dtype", "offset", "dataset_size", of=whole)
        spacing = None if self.spacing is None else numbers(self.spacing, "--spacing", "1,1,2.5")
        return {"scalars": self.scalars, "spacing": spacing}

    def _read(self, source: str, nan: Literal["error", "transparent"]) -> Volume:
        from ..io import read

        if self.shape is not None or self.dtype is not None:
            return self._bare(source, nan)
        self._refuse("spacing", "offset", of=f"bare samples, with --shape and --dtype; {source!r} is no such")
        return read(source, self.scalars, nan, self.frame)

    def _refuse(self, *names: str, of: str) -> None:
        if given := [name for name in names if getattr(self, name) is not None]:
            raise ValueError(f"--{given[0].replace('_', '-')} is for {of}")

    def _bare(self, source: str, nan: Literal["error", "transparent"]) -> Volume:
        import numpy as np

        from ..io import read_raw

        if self.shape is None or self.dtype is None:
            raise ValueError("--shape and --dtype are for bare samples, and go together")
        self._refuse("scalars", "frame", of="files that say what they hold, --shape and --dtype for those that do not")
        shape = numbers(self.shape, "--shape", "64,128,256")
        try:
            dtype = np.dtype(self.dtype)
        except TypeError:
            raise ValueError(f"--dtype must be a type of numbers, such as uint8 or >i2, got {self.dtype!r}") from None
        if any(n != int(n) or n < 1 for n in shape):
            raise ValueError(f"--shape must be three integers > 0, NZ,NY,NX, got {self.shape!r}")
        spacing = (1.0, 1.0, 1.0) if self.spacing is None else numbers(self.spacing, "--spacing", "1,1,2.5")
        order: Literal["little", "big"] = "big" if dtype.str.startswith(">") else "little"
        whole = [int(n) for n in shape]
        return read_raw(source, whole, dtype, spacing, offset=self.offset or 0, byteorder=order, nan=nan)


def _files_beside(source: str) -> list[str]:
    """What else there is where the source was looked for, as it would be given."""
    folder = Path(source).parent
    try:
        return [str(folder / name.name) for name in folder.iterdir()]
    except OSError:
        return []


def check_kept(output: Path, files: tuple[Path, ...], source: str = "") -> None:
    """Nothing that was read is written to, and no image becomes a slice of the folder that is the source."""
    from ..io.slices import KINDS

    if output.exists() and any(file.exists() and output.samefile(file) for file in files):
        raise ValueError(f"--output must not be the volume itself or its labels, which are read from {str(output)!r}")
    slices = bool(files) and files[0].suffix.lower() in KINDS and output.suffix.lower() in KINDS
    if slices and Path(source).is_dir() and output.parent.samefile(source):
        raise ValueError(f"--output must not be among the slices in {source!r}, one of which it would be next time")
