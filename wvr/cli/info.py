"""``wvr info``: what a volume is, and transfer functions for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from .source import Input
from .stages import Stages
from .stores import Level, whole

if TYPE_CHECKING:
    from ..transfer_function import TransferFunction
    from ..volume import Volume

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999)
BINS = 32


def info(
    source: str,
    /,
    *,
    histogram: Annotated[bool, Parameter(negative="")] = False,
    level: Level = None,
    select: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    save_tf: Annotated[tuple[str, Path] | None, Parameter(negative="")] = None,
    reading: Input = Input(),  # noqa: B008 - frozen
) -> None:
    """Describe a volume and suggest transfer functions for it.

    Parameters
    ----------
    source
        File, folder of slices, or name of a dataset.
    histogram
        Draw the histogram; bars are as long as the logarithm of the count.
    level
        Of a store (zarr, OME-Zarr) that is a pyramid, 0 is the finest. All of it is read into memory.
    select
        AXIS:INDEX of a store's axes that are not x, y or z: t:0, c:1. May be given several times.
    save_tf
        NAME FILE: write the suggestion of that name to a .json file, every digit of it.
    """
    from ..presets import suggest

    with Stages() as stage:
        volume = whole(source, level, select, "transparent", reading, stage)
        stage("counting")
        values = volume.numpy().ravel()
        finite = values[np.isfinite(values)] if volume.has_nonfinite else values
        facts = _facts(volume, finite)
        table = _histogram(finite, volume.range) if histogram and finite.size else None
        try:
            suggestions, problem = suggest(volume), ""
        except ValueError as error:
            suggestions, problem = {}, str(error)
    if save_tf is not None:
        name, path = save_tf
        if name not in suggestions:
            raise ValueError(
                f"--save-tf must name one of {', '.join(suggestions) or f'none ({problem})'}, got {name!r}"
            )
        if path.suffix.lower() != ".json":
            raise ValueError(f"--save-tf must name a .json file, got {str(path)!r}")
        suggestions[name].save(path)
    print(source)
    for name, fact in facts.items():
        print(f"  {name:<11} {fact}")
    if table is not None:
        from rich import print as rich_print

        rich_print(table)
    print(
        f"  no suggested transfer functions: {problem}" if problem else "  suggestions, as --tf takes them (rounded):"
    )
    for name, suggestion in suggestions.items():
        print(f"  {name:<11} {_points(suggestion)}")


def _points(tf: TransferFunction) -> str:
    """The control points as ``--tf`` takes them."""
    from matplotlib.colors import to_hex

    from ..color import linear_to_srgb

    colors = np.clip(linear_to_srgb(tf.colors), 0, 1)
    points = zip(tf.knots, colors, tf.opacities, strict=True)
    return ",".join(f"{scalar:.6g}:{to_hex(color)}:{opacity:.4g}" for scalar, color, opacity in points)


def _facts(volume: Volume, finite: np.ndarray) -> dict[str, str]:
    low, high = volume.index_box
    steps = np.linalg.norm(volume.index_to_world[:3, :3], axis=0)
    facts: dict[str, Any] = {
        "dimensions": " x ".join(map(str, volume.dimensions)),
        "dtype": volume.dtype,
        "memory": f"{volume.numpy().nbytes / 2**20:,.1f} MiB",
        "spacing": _listed(volume.spacing),
        "origin": _listed(volume.origin),
        "world size": _listed((high - low) * steps),
        "not finite": f"{volume.numpy().size - finite.size:,} of {volume.numpy().size:,} samples",
    }
    if not np.array_equal(volume.direction, np.eye(3)):
        facts["direction"] = "  ".join(f"({_listed(column)})" for column in volume.direction.T)
    if finite.size:
        facts["range"] = "{:.6g} .. {:.6g}".format(*volume.range)
        quantiles = np.quantile(finite, QUANTILES, method="lower")
        facts["quantiles"] = "  ".join(f"{q:.3g}: {v:.4g}" for q, v in zip(QUANTILES, quantiles, strict=True))
    return facts


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


def _histogram(finite: np.ndarray, span: tuple[float, float]) -> Any:
    """Where each bin starts, a bar as long as the logarithm of its count, and the count."""
    from rich.bar import Bar
    from rich.table import Table

    lo, hi = span
    bins = BINS
    if finite.dtype.kind in "iu":
        # Every bin has the same number of integers.
        width = -(-(int(hi - lo) + 1) // BINS)
        bins = -(-(int(hi - lo) + 1) // width)
        hi = lo + bins * width
    counts, edges = np.histogram(finite, bins, (lo, hi))
    table = Table.grid(padding=(0, 1))
    table.add_column(justify="right")
    table.add_column(width=50)
    table.add_column(justify="right")
    for edge, count in zip(edges, counts, strict=False):
        table.add_row(f"{edge:.5g}", Bar(np.log1p(counts.max()), 0, np.log1p(count)), f"{count:,}")
    return table
