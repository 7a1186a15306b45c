"""Stress of the numerics: what breaks where, for inputs far from ordinary.

Pre-integration tables: optical depth from 1e-12 to 1e6, sizes from 2 to 4096, opacity 0 and 1, spikes one entry wide,
steps, nearest-neighbour and random transfer functions, every generator and weighting, both precisions. For each the
largest error against adaptive quadrature at entries drawn at random, and the number of entries that are NaN, infinite,
negative, or have an opacity outside [0, 1]; these must all be 0.

Images: one scene, and from it along one axis after the other to where numbers are hard, for every integrator and
precision. For each the largest error against ``Exact``, which in turn is held against the float64 reference in NumPy,
and the number of channels that no ray can have, and of pixels beyond their bound; these must be 0.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import ArrayLike, NDArray

import wvr
from wvr.integrators import Integrator
from wvr.light.lighting import MODES
from wvr.transfer.preintegration import Weights

from .base.harness import save_figure
from .base.reference import integrate, quadrature
from .base.rows import write_rows
from .base.scenes import Scene
from .base.study import Study

Precision = Literal["float32", "float64"]
STUDY = Study("stability", "Stability: what breaks where, for inputs far from ordinary")

DEPTHS = (1e-12, 1e-9, 1e-6, 1e-4, 1e-2, 0.1, 1.0, 10.0, 1e3, 1e6)
SIZES = (2, 3, 16, 64, 256, 1024)
LARGE = 4096  # a few tables only: half a gigabyte each
SCHEMES = ("incremental", "weighted", "lum", "brute", "approximate")
BRUTE_UP_TO = 256
BASELINES = ("lum", "approximate")  # without a promise
# The bounds that are promised.
PROMISED: dict[Precision, float] = {"float32": 2e-6, "float64": 1e-12}
COUNTS = ("NaN or Inf", "negative", "opacity outside [0, 1]")


def make_transfer_function(kind: str, n: int, depth: float, rng: np.random.Generator) -> tuple:
    """A transfer function over [0, 1] whose largest extinction times the length is ``depth``; and that length."""
    s, heights = {
        "constant": (np.array([0.0, 1.0]), np.ones(2)),
        "ramp": (np.array([0.0, 1.0]), np.array([0.0, 1.0])),
        # One entry wide, between two entries at its sides.
        "spike": (0.37 + np.array([-0.37, -0.5 / n, 0.0, 0.5 / n, 0.63]), np.array([0.0, 0.0, 1.0, 0.0, 0.0])),
        "step": (np.array([0.0, 0.43, 0.43, 1.0]), np.array([0.0, 0.0, 1.0, 1.0])),
        "nearest": (np.repeat(np.linspace(0, 1, 17), 2)[1:-1], np.repeat(rng.random(16), 2)),
        "random": (np.linspace(0, 1, 24), rng.random(24) ** 3),
    }[kind]
    # Opacity cannot say more than an extinction of 16.6: longer segments do.
    length = max(depth / 16.0, 1.0)
    opacity = -np.expm1(-heights / heights.max() * depth / length)
    return wvr.TransferFunction.from_arrays(s, rng.random((len(s), 3)), opacity), length


def make_table(scheme: str, tf: wvr.TransferFunction, n: int, length: float, precision: Precision) -> wvr.Table:
    """The table of a generator or weighting."""
    if scheme == "brute":
        return wvr.preintegrate(tf, n, length, (0, 1), "brute", precision=precision)
    if scheme == "approximate":
        return wvr.preintegrate(tf, n, length, (0, 1), "approximate", precision=precision)
    weighted: dict[str, Weights | None] = {"incremental": None, "weighted": "lighting", "lum": "lum"}
    return wvr.preintegrate(tf, n, length, (0, 1), weights=weighted[scheme], precision=precision)


def faults(table: wvr.Table) -> dict[str, int]:
    """Entries that no segment can have."""
    counts = dict.fromkeys(COUNTS, 0)
    for entries in (table.rgba, table.front, table.back):
        if entries is not None:
            # A weighted entry is a difference: rounding below zero, of the size of a rounding, is none.
            tiny = -np.finfo(entries.dtype).eps if entries is not table.rgba else 0.0
            counts["NaN or Inf"] += int(np.count_nonzero(~np.isfinite(entries)))
            counts["negative"] += int(np.count_nonzero(entries < tiny))
    alpha = table.rgba[..., 3]
    counts["opacity outside [0, 1]"] = int(np.count_nonzero((alpha < 0) | (alpha > 1)))
    return counts


def error(table: wvr.Table, scheme: str, tf: wvr.TransferFunction, pairs: NDArray[np.int64], length: float) -> float:
    """Largest error at the entries ``pairs``."""
    scalars = np.linspace(0, 1, len(table.rgba))
    worst = 0.0
    for i, j in pairs:
        if scheme in ("weighted", "lum"):
            assert table.back is not None
            exact = quadrature(tf, scalars[i], scalars[j], length, ramp=lambda t: t)
            worst = max(worst, float(np.abs(table.back[i, j] - exact).max()))
        exact = quadrature(tf, scalars[i], scalars[j], length)
        worst = max(worst, float(np.abs(table.rgba[i, j] - exact).max()))
    return worst


def sweep(depths: tuple[float, ...], sizes: tuple[int, ...], entries: int) -> list[dict]:
    """A row for every combination."""
    kinds = ("constant", "ramp", "spike", "step", "nearest", "random")
    cases: list[tuple[str, float, int, Precision, tuple[str, ...]]] = [
        (*case, SCHEMES) for case in product(kinds, depths, sizes, PROMISED)
    ]
    if max(sizes) >= 1024:
        cases += [
            (*case, ("weighted",)) for case in product(("spike", "random"), (1e-12, 1.0, 1e6), (LARGE,), PROMISED)
        ]
    rows = []
    for kind, depth, n, precision, schemes in cases:
        # The same transfer function and entries for both precisions and all schemes.
        rng = np.random.default_rng(zlib.crc32(f"{kind} {depth} {n}".encode()))
        tf, length = make_transfer_function(kind, n, depth, rng)
        i = rng.integers(0, n, entries)
        pairs = np.stack([i, np.clip(i + rng.choice([-2, -1, 0, 1, 2, n // 3, -n // 3], entries), 0, n - 1)], axis=1)
        for scheme in schemes:
            if scheme == "brute" and n > BRUTE_UP_TO:
                continue
            table = make_table(scheme, tf, n, length, precision)
            rows.append(
                {
                    "scheme": scheme,
                    "precision": precision,
                    "kind": kind,
                    "depth": depth,
                    "n": n,
                    "max error": error(table, scheme, tf, pairs, length),
                    **faults(table),
                }
            )
    return rows


def summarize(rows: list[dict]) -> list[dict]:
    """By scheme and precision: the worst of all."""
    result = []
    for scheme, precision in product(SCHEMES, PROMISED):
        those = [row for row in rows if (row["scheme"], row["precision"]) == (scheme, precision)]
        worst = max(those, key=lambda row: row["max error"])
        result.append(
            {
                "scheme": scheme,
                "precision": precision,
                "tables": len(those),
                "max error": worst["max error"],
                "at": f"{worst['kind']}, depth {worst['depth']:g}, n = {worst['n']}",
                **{count: sum(row[count] for row in those) for count in COUNTS},
            }
        )
    return result


def heat_map(rows: list[dict], depths: tuple[float, ...]) -> Figure:
    """Largest error by scheme and optical depth."""
    figure = Figure(figsize=(8, 3.2))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, precision in zip(panels, PROMISED, strict=True):
        cells = np.array(
            [
                [
                    max(
                        row["max error"]
                        for row in rows
                        if (row["scheme"], row["precision"], row["depth"]) == (scheme, precision, depth)
                    )
                    for depth in depths
                ]
                for scheme in SCHEMES
            ]
        )
        shown = _cells(axes, cells, LogNorm(1e-18, 1e-2))
        axes.set_xticks(range(len(depths)), [f"{depth:g}" for depth in depths], rotation=60, fontsize=7)
        axes.set_yticks(range(len(SCHEMES)), SCHEMES)
        axes.set(title=f"{precision} (promised: {PROMISED[precision]:g})", xlabel="largest extinction × length")
    figure.colorbar(shown, ax=panels, label="largest abs error (cells: log10)")
    return figure


@STUDY.part("Pre-integration tables")
def tables(folder: Path, quick: bool) -> str:
    """Largest error of every generator over optical depth, table size, transfer function and precision."""
    depths = (1e-12, 1.0, 1e6) if quick else DEPTHS
    rows = sweep(depths, (2, 16) if quick else SIZES, 2 if quick else 6)
    summary = summarize(rows)
    write_rows(folder, "tables", "Pre-integration tables under stress", summary)
    save_figure(heat_map(rows, depths), folder / "tables")
    kept = [row for row in summary if row["scheme"] not in BASELINES]
    broken = [
        row for row in kept if any(row[count] for count in COUNTS) or row["max error"] > PROMISED[row["precision"]]
    ]
    if broken:
        raise AssertionError(f"promises broken: {broken}")
    return (
        f"{sum(row['tables'] for row in summary)} tables, no entry that no segment can have; "
        + "; ".join(
            f"in {precision} at most {max(r['max error'] for r in kept if r['precision'] == precision):.1e} off "
            f"(promised: {promised:g})"
            for precision, promised in PROMISED.items()
        )
        + "."
    )


# --- Images -----------------------------------------------------------------------------------------------------------

METHODS: dict[str, Integrator] = {
    "Riemann, left": wvr.Riemann(0.5, "left"),
    "Riemann, midpoint": wvr.Riemann(0.5),
    "Riemann, trapezoid": wvr.Riemann(0.5, "trapezoid"),
    "Simpson": wvr.Simpson(0.5),
    "Preintegrated": wvr.Preintegrated(0.5),
    "AdaptivePreintegrated": wvr.AdaptivePreintegrated(1e-3),
    "AdaptiveSimpson, coupled": wvr.AdaptiveSimpson(1e-3),
    "AdaptiveSimpson, decoupled": wvr.AdaptiveSimpson(1e-3, coupling="decoupled"),
    "Certified": wvr.Certified(1e-3),
}
EXACT = "Exact (against fine sums)"
PRECISIONS = ("float32", "float64")
IMPOSSIBLE = ("NaN or Inf", "out of range", "over the bound")
PARTS = 64  # of a ray's piece in a cell, of the fine sums
PIXELS = 24  # that they are taken at
SURE = 1e-4  # sums that change by more with twice the parts judge nothing


@dataclass(frozen=True)
class Case:
    """A scene far from ordinary: along which axis, and where on it.

    ``step`` is that of the integrators that have one, ``options`` are further ones of :meth:`Scene.render`.
    """

    axis: str
    value: str
    scene: Scene
    step: float | None = None
    options: dict[str, Any] = field(default_factory=dict)


def waves(shape: tuple[int, int, int]) -> NDArray[np.float64]:
    """Waves in [0, 1], at nodes (z, y, x)."""
    z, y, x = np.meshgrid(*(np.arange(n) / max(n - 1, 1) for n in shape), indexing="ij")
    return 0.5 + 0.5 * np.sin(7 * x + 1) * np.cos(5 * y - 6 * z)


def plain(
    samples: NDArray | None = None, spacing: ArrayLike = (1, 1, 1), origin: ArrayLike = (0, 0, 0), size: int = 17
) -> Scene:
    """The ordinary scene, or one with other samples in another place."""
    samples = waves((14, 14, 14)) if samples is None else samples
    volume = wvr.Volume(samples.astype(np.float32), spacing=spacing, origin=origin)
    tf = wvr.TransferFunction([(0.2, "navy", 0.0), (0.5, "orange", 0.1), (0.6, "lime", 0.02), (1.0, "white", 0.4)])
    return Scene("waves", volume, tf, wvr.Camera.fit(volume), (size, size))


def cases(quick: bool) -> list[Case]:
    """All of them, or the ends of each axis."""
    base = plain()
    result: list[Case] = []

    def add(axis: str, values: tuple, make: Callable[..., Scene], step: bool = False) -> None:
        for value in (values[0], values[-1]) if quick else values:
            name = value if isinstance(value, str) else f"{value:g}"
            result.append(Case(axis, name, make(value), value if step else None))

    def shown(points: list[tuple], unit: float | None = None) -> Scene:
        return replace(base, transfer_function=wvr.TransferFunction(points, unit_distance=unit))

    def depth(x: float) -> Scene:
        # Opacity cannot say more than an extinction of 16.6: shorter unit distances do.
        unit = min(1.0, 8.0 / x)
        return shown([(0, "navy", 0.0), (1, "orange", -np.expm1(-x * unit))], unit)

    def spike(width: float) -> Scene:
        return shown([(0, "red", 0.0), (0.5 - width, "red", 0.0), (0.5, "red", 1.0), (0.5 + width, "red", 0.0)])

    def jumps(count: float) -> Scene:
        levels = np.repeat(np.linspace(0, 1, int(count) + 1), 2)[1:-1]
        colors = np.repeat(np.random.default_rng(0).random((int(count), 4)), 2, axis=0)
        tf = wvr.TransferFunction.from_arrays(levels, colors[:, :3], colors[:, 3])
        return replace(base, transfer_function=tf)

    def scaled(scale: float, offset: float) -> Scene:
        moved = plain(waves((14, 14, 14)) * scale + offset)
        knots = base.transfer_function.knots * scale + offset
        tf = wvr.TransferFunction.from_arrays(knots, base.transfer_function.colors, base.transfer_function.opacities)
        return replace(moved, transfer_function=tf)

    def ray(kind: str) -> Scene:
        position, target, options = {
            "axis-parallel": ((6.5, 6.5, 50), (6.5, 6.5, 6.5), {"parallel_scale": 7.0}),
            "in the face": ((0, 0, 50), (0, 0, 6.5), {"parallel_scale": 7.0}),
            "along a node": ((6, 6, 50), (6, 6, 6.5), {"parallel_scale": 8.0}),
            "grazing": ((60, 13, 6.5), (6.5, 12.999, 6.5), {"parallel_scale": 0.01}),
            "diagonal": ((50, 50, 50), (6.5, 6.5, 6.5), {"parallel_scale": 7.0}),
            "missing": ((60, 80, 6.5), (6.5, 80, 6.5), {"parallel_scale": 1.0}),
            "camera inside": ((6.3, 6.1, 5.9), (13, 9, 7), {"view_angle": 90.0}),
            "camera on a node": ((6, 6, 6), (13, 9, 7), {"view_angle": 90.0}),
            "camera on the face": ((0, 6.5, 6.5), (13, 6.5, 6.5), {"view_angle": 90.0}),
            "far away": ((1e6, 6.5, 6.5), (6.5, 6.5, 6.5), {"view_angle": 1e-3}),
        }[kind]
        up = (0, 1, 0) if position[0] == target[0] else (0, 0, 1)
        return replace(base, camera=wvr.Camera(position, target, up, **options))

    def thin(shape: str) -> Scene:
        nx, ny, nz = map(int, shape.split("x"))
        return plain(waves((nz, ny, nx)))

    depths = (1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e2, 1e4, 1e6)
    add("optical depth of a voxel", depths, depth)
    add("opacity", (0.0, 1e-7, 0.5, 1.0), lambda a: shown([(0, "navy", a), (1, "orange", a)]))
    add("width of a spike", (1e-9, 1e-6, 1e-4, 1e-2), spike)
    add("jumps", (1, 2, 16, 256), jumps)
    add("step", (1e-3, 0.03, 0.3, 3.0, 100.0), lambda _: plain(size=8), step=True)
    add("offset of the data", (-1e6, -100.0, 100.0, 1e6), lambda offset: scaled(1.0, offset))
    add("scale of the data", (1e-30, 1e-6, 1e6, 1e30), lambda scale: scaled(scale, 0.0))
    add("origin", (-1e6, 1e3, 1e6), lambda x: plain(origin=(x, -x, 2 * x)))
    add("spacing", (1e-6, 1e-3, 1e3, 1e6), lambda h: plain(spacing=(h, h, h)))
    add("anisotropy", (1e-4, 1e-2, 1e2, 1e4), lambda a: plain(spacing=(1, 1, a)))
    kinds = ("axis-parallel", "in the face", "along a node", "grazing", "diagonal", "missing", "camera inside",
             "camera on a node", "camera on the face", "far away")  # fmt: skip
    add("rays", kinds, ray)
    result += [
        Case("leaping", name, base, options={"skip_empty": leap}) for name, leap in (("yes", True), ("no", False))
    ]

    def with_options(axis: str, options: dict[str, dict[str, Any]]) -> None:
        result.extend(Case(axis, name, base, options=each) for name, each in options.items())

    tilted = wvr.DirectionalLight((1, -2, 0.5))
    along = wvr.DirectionalLight(tuple(np.subtract(base.camera.target, base.camera.position)))
    with_options("light", {mode: {"lighting": wvr.Lighting(mode, [wvr.Headlight(), tilted])} for mode in MODES})
    with_options("light", {"cell": {"lighting": wvr.Lighting(light=along, gradient="cell", shininess=1e4)}})
    middle = (6.5, 6.5, 6.5)
    clips: dict[str, Any] = {
        "plane": wvr.ClipPlane(middle, (1, 2, -3)),
        "plane of nodes": wvr.ClipPlane((6, 6, 6), (0, 0, 1)),
        "face of the box": wvr.ClipPlane((0, 6.5, 6.5), (1, 0, 0)),
        "nothing left": wvr.ClipPlane((20, 0, 0), (1, 0, 0)),
        "box": wvr.ClipBox((2, 2.5, 3), (9, 9, 9)),
        "leaf": wvr.ClipBox((6, 0, 0), (6 + 1e-9, 13, 13)),
        "ball": wvr.ClipSphere(middle, 5.0),
        "hollow": wvr.ClipSphere(middle, 5.0, invert=True),
        "three": [wvr.ClipPlane(middle, (0, 1, 0)), wvr.ClipSphere(middle, 6.0), wvr.ClipBox((0, 0, 0), middle)],
        "volume": wvr.ClipVolume(wvr.Volume(waves((20, 20, 20)), spacing=(0.7, 0.7, 0.7)), 0.5),
    }
    with_options("clip", {name: {"clip": clip} for name, clip in clips.items()})
    with_options(
        "shadows",
        {
            "headlight": {"shadows": wvr.ConvolutionShadows()},
            "tilted": {"shadows": wvr.ConvolutionShadows(light=tilted, spread=0.0)},
            "from behind": {"shadows": wvr.ConvolutionShadows(light=along, spread=60.0)},
            "lit and cut": {
                "shadows": wvr.ConvolutionShadows(light=tilted),
                "lighting": wvr.Lighting(light=tilted),
                "clip": clips["ball"],
            },
        },
    )
    add("samples", ("1x1x1", "14x1x1", "14x14x1", "14x14x2", "2x2x2", "1x14x2"), thin)
    return result


def measure(case: Case, methods: dict[str, Integrator]) -> list[dict[str, Any]]:
    """A row for each method and precision."""
    scene = case.scene
    exact = scene.render(wvr.Exact(), **case.options)
    plain = not case.options.keys() & {"lighting", "shadows", "clip"}
    rows = []

    def add(method: str, precision: str, image: wvr.Image, error: float | None) -> None:
        counts = dict(zip(IMPOSSIBLE, impossible(image, case, exact), strict=True))
        where = {"axis": case.axis, "value": case.value, "method": method, "precision": precision}
        rows.append(where | {"max error": error} | counts)

    add(EXACT, "float64", exact, _against_sums(scene, exact) if plain else None)
    for (method, integrator), precision in product(methods.items(), PRECISIONS):
        if case.step is not None and hasattr(integrator, "step"):
            integrator = replace(integrator, step=case.step)  # type: ignore[type-var]
        image = scene.render(integrator, precision=precision, **case.options)
        error = np.abs(image.rgba.astype(np.float64) - exact.rgba)
        add(method, precision, image, float(np.nanmax(error)))
    return rows


def impossible(image: wvr.Image, case: Case, exact: wvr.Image) -> tuple[int, int, int]:
    """Channels that are not finite, that no ray can have but for rounding, and pixels further off than their bound,
    which is that of opacity alone where there is light.
    """
    rgba = image.rgba.astype(np.float64)
    tiny = 8 * np.finfo(image.rgba.dtype).eps
    brightest = case.scene.transfer_function.colors.max(axis=0)
    light: wvr.Lighting | None = case.options.get("lighting")
    if light is not None:
        n = len(light.lights)
        brightest = (light.ambient + n * light.diffuse) * brightest + n * light.specular
    highest = np.concatenate([rgba[..., 3:] * brightest, np.ones_like(rgba[..., 3:])], axis=-1) + tiny
    outside = (rgba < -tiny) | (rgba > highest)
    over: NDArray = np.zeros(1)
    if image.error_bound is not None:
        bound = slice(3, 4) if case.options.keys() & {"lighting", "shadows"} else slice(4)
        over = np.abs(rgba - exact.rgba)[..., bound].max(axis=-1) > image.error_bound
    return int(np.count_nonzero(~np.isfinite(rgba))), int(np.count_nonzero(outside)), int(np.count_nonzero(over))


def _against_sums(scene: Scene, exact: wvr.Image) -> float | None:
    """How far ``Exact`` is from fine sums, at pixels drawn at random; None where the sums themselves are not sure."""
    width, height = scene.size
    at = np.random.default_rng(0).choice(width * height, PIXELS, replace=False)
    origins, directions = (rays.reshape(-1, 3)[at] for rays in scene.camera.rays(scene.size))
    coarse, fine = (
        integrate(scene.volume, scene.transfer_function, origins, directions, n, from_origin=not scene.camera.parallel)
        for n in (PARTS // 2, PARTS)
    )
    # Sums agree on what none of them can see: what a part absorbs before its first node, and spikes between nodes.
    knots = scene.transfer_function.knots
    tau = scene.transfer_function.extinction(knots, scene.volume.smallest_spacing).max()
    thickest = tau * np.linalg.norm(scene.volume.index_to_world[:3, :3] @ np.ones(3)) / PARTS
    finest = np.diff(np.unique(knots)).min() / max(np.ptp(scene.volume.range), np.ptp(knots))
    if thickest > 1 or finest < 4 / PARTS or np.abs(fine - coarse).max() > SURE:
        return None
    return float(np.abs(exact.rgba.reshape(-1, 4)[at] - fine).max())


@STUDY.part("Images")
def images(folder: Path, quick: bool) -> str:
    """Largest error of every integrator and precision, along each axis away from an ordinary scene."""
    methods = {name: METHODS[name] for name in ("Preintegrated", "Certified")} if quick else METHODS
    rows = [row for case in cases(quick) for row in measure(case, methods)]
    write_rows(folder, "images", "Images under stress", rows)
    save_figure(image_map(rows), folder / "images")
    broken = [row for row in rows if any(row[count] for count in IMPOSSIBLE)]
    if broken:
        raise AssertionError(f"{len(broken)} images that no scene can have: {broken[:3]}")
    certified = max(
        row["max error"] for row in rows if row["method"] == "Certified" and row["axis"] not in ("light", "shadows")
    )
    sums = [row["max error"] for row in rows if row["method"] == EXACT]
    sure = [error for error in sums if error is not None]
    return (
        f"{len(rows)} images: every channel finite and possible, no pixel further off than its bound. Certified at "
        f"1e-3 is at most {certified:.1e} off. Exact differs from fine sums by at most {max(sure):.1e} in the "
        f"{len(sure)} of {len(sums)} scenes in which those have converged."
    )


def image_map(rows: list[dict[str, Any]], columns: int = 5) -> Figure:
    """Largest error by method and precision, and the value on each axis."""
    names = list(dict.fromkeys((row["method"], row["precision"]) for row in rows))
    values = {axis: [] for axis in dict.fromkeys(row["axis"] for row in rows)}  # type: dict[str, list[str]]
    for row in rows:
        if row["value"] not in values[row["axis"]]:
            values[row["axis"]].append(row["value"])
    lines = -(-len(values) // columns)
    figure = Figure(figsize=(15, lines * (1.3 + 0.17 * len(names))))
    panels = figure.subplots(lines, columns, sharey=True, squeeze=False)
    for axes in panels.flat[len(values) :]:
        axes.set_visible(False)
    for axes, (axis, places) in zip(panels.flat, values.items(), strict=False):
        cells = np.full((len(names), len(places)), np.nan)
        for row in rows:
            if row["axis"] == axis and row["max error"] is not None:
                cells[names.index((row["method"], row["precision"])), places.index(row["value"])] = row["max error"]
        shown = _cells(axes, cells, LogNorm(1e-9, 1))
        axes.set_xticks(range(len(places)), places, rotation=40, ha="right")
        axes.set_yticks(range(len(names)), [f"{method}, {precision}" for method, precision in names])
        axes.set_title(axis)
    figure.colorbar(shown, ax=panels, label="largest abs error of a channel (cells: log10)", shrink=0.4, extend="min")
    return figure


def _cells(axes: Axes, cells: NDArray[np.float64], norm: LogNorm) -> AxesImage:
    """A heat map with the decimal logarithm in each cell; NaN is left blank."""
    shown = axes.imshow(np.maximum(cells, 1e-18), norm=norm, cmap="viridis", aspect="auto")
    for (y, x), value in np.ndenumerate(cells):
        if np.isfinite(value):
            color = "w" if value < 1e-3 * (norm.vmax or 1.0) else "k"
            exponent = round(np.log10(max(value, 1e-18)))
            axes.text(x, y, str(exponent), ha="center", va="center", fontsize=6, color=color)
    return shown
