"""MRC and CCP4 maps (https://www.ccpem.ac.uk/mrc_format/mrc2014.php), by mrcfile's headers."""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..samples import Grid, components_error
from .bytes import Flaw, needs, opened, packing_of, samples, start_of

HEADER = 1024
# What IMOD writes into its headers, where a flag says whether bytes have a sign.
IMOD = 1146047817


def read_mrc(path: Path) -> Grid:
    with needs("mrcfile", "MRC", "mrc"):
        from mrcfile.mrcinterpreter import MrcInterpreter
        from mrcfile.utils import data_dtype_from_header, data_shape_from_header

    with opened(path) as file:
        content = bytearray(start_of(file, HEADER))
        if len(content) < HEADER:
            raise Flaw(f"its header has {HEADER} bytes, {HEADER - len(content)} are missing")
        extended, content[92:96] = bytes(content[92:96]), bytes(4)  # which mrcfile would read
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            head = MrcInterpreter(BytesIO(content), header_only=True).header
        order: Any = "<" if content[212] == 0x44 else ">"
        skip = HEADER + int(np.frombuffer(extended, order + "i4")[0])
        stack = head.ispg > 400
        if min(head.nx, head.ny, head.nz) < 1 or (stack and (head.mz < 1 or head.nz % head.mz)) or skip < HEADER:
            raise Flaw(f"its header has {head.nx} x {head.ny} x {head.nz} samples, {head.mz} sections a volume")
        dtype, shape = data_dtype_from_header(head), data_shape_from_header(head)
        stamp, flags = np.frombuffer(content, order + "i4", 2, 152)
        if dtype == np.int8 and stamp == IMOD and not flags & 1:
            dtype = np.dtype(np.uint8)
        axes = [int(axis) - 1 for axis in (head.mapc, head.mapr, head.maps)]
        if axes == [-1, -1, -1]:
            axes = [0, 1, 2]
        if sorted(axes) != [0, 1, 2]:
            raise Flaw(f"its axes are {[axis + 1 for axis in axes]}, which should be 1, 2 and 3 in any order")
        steps, origin = _place(head, axes)
        if dtype.kind == "c":
            raise components_error(str(path), 2)
        array = samples(file, dtype, (1,) * (3 - len(shape)) + shape, packing_of(file), skip)
    return Grid(array, steps, origin, "", (path,))


def _place(head: Any, axes: list[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps along columns, rows and sections, from the cell's edges and angles, and the first sample's position."""

    def three(record: Any, names: str) -> NDArray[np.float64]:
        values = np.array([record[name] for name in names.split()], np.float64)
        return values if np.all(np.isfinite(values)) else np.zeros(3)

    edges, angles = three(head.cella, "x y z"), np.radians(three(head.cellb, "alpha beta gamma"))
    counts = np.array([head.mx, head.my, head.mz], np.float64)
    spacing = np.where((edges > 0) & (counts > 0), edges / np.maximum(counts, 1), 1.0)
    cos, sin = np.cos(angles), np.sin(angles)
    cell = np.eye(3)
    if np.all(angles > 0) and np.any(np.abs(angles - np.pi / 2) > 1e-6):
        # The first edge along x, the second in the plane of x and y.
        cell[:, 1] = cos[2], sin[2], 0.0
        third = (cos[0] - cos[1] * cos[2]) / sin[2]
        cell[:, 2] = cos[1], third, np.sqrt(max(1 - cos[1] ** 2 - third**2, 0.0))
    steps = (cell * spacing)[:, axes]
    start = np.array([head.nxstart, head.nystart, head.nzstart], np.float64)
    origin = three(head.origin, "x y z")
    # Files say where they begin in either way; where the origin is given, that counts.
    return steps, origin if np.any(origin) else steps @ start
