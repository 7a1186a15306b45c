"""``python -m benchmarks.larger``: a volume larger than memory, from a store that is made for it and deleted after.

The store has a logical size of 64 GiB (4096^3 bytes in chunks of 128^3): air that is not stored, fog, and structures in
a few chunks. Chunks are made of periodic patterns, of which each is encoded once and linked wherever it is.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import warnings
from itertools import product
from pathlib import Path
from tempfile import mkdtemp
from time import perf_counter
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter
from numpy.typing import NDArray

import wvr
from wvr.bricks.brick import Brick, Caster
from wvr.bricks.grid import Bricks
from wvr.bricks.ranges import ALL
from wvr.bricks.reading import Reading
from wvr.bricks.streamed import Streamed
from wvr.keep import Keeper
from wvr.launch import get_device
from wvr.scene import Scene

CHUNK = 128
# Rolled copies of each pattern, so that few chunks are alike.
COPIES = 6
# Parts that are computed by Dask at a time.
FEW = 64
# What is visible: structures, in fog that is clear, or thin.
CLEAR = [(0, "navy", 0.0), (60, "navy", 0.0), (120, "orange", 0.02), (200, "gold", 0.1)]
THIN = [(0, "navy", 0.0), (4, "navy", 0.0), (40, "steelblue", 0.0004), (120, "orange", 0.02), (200, "gold", 0.1)]
app = App(help_format="plaintext")


def patterns() -> list[NDArray[np.uint8]]:
    """Fog, and fog with structures; periodic, so that chunks go on into each other."""
    rng = np.random.default_rng(0)
    wave = np.fft.rfftn(rng.normal(size=(CHUNK,) * 3))
    along, half = np.fft.fftfreq(CHUNK) * CHUNK, np.fft.rfftfreq(CHUNK) * CHUNK
    square = along[:, None, None] ** 2 + along[:, None] ** 2 + half**2
    smooth = np.fft.irfftn(wave * np.exp(-square / 8), s=(CHUNK,) * 3, axes=(0, 1, 2))
    fog = np.clip(14 + 4 * smooth / smooth.std(), 5, 30)
    z, y, x = (2 * np.pi * axis / CHUNK for axis in np.indices((CHUNK,) * 3))
    gyroid = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    shell = 200 * np.exp(-((gyroid / 0.15) ** 2))
    return [fog.astype(np.uint8), np.maximum(fog, shell).astype(np.uint8)]


def make(folder: Path, size: int) -> Path:
    """The store."""
    import zarr

    seeds = zarr.create_array(
        folder / "seeds.zarr", shape=(2 * COPIES * CHUNK, CHUNK, CHUNK), chunks=(CHUNK,) * 3, dtype="u1"
    )
    for n, pattern in enumerate(patterns()):
        for copy in range(COPIES):
            start = (n * COPIES + copy) * CHUNK
            seeds[start : start + CHUNK] = np.roll(pattern, (17 * copy, 29 * copy, 41 * copy), (0, 1, 2))
    store = folder / "large.zarr"
    array = zarr.create_array(store, shape=(size,) * 3, chunks=(CHUNK,) * 3, dtype="u1")
    count = size // CHUNK
    grid = np.moveaxis(np.indices((count,) * 3), 0, -1) - (count - 1) / 2
    radius = np.linalg.norm(grid, axis=-1) / (count / 2)
    rng = np.random.default_rng(1)
    structure = (np.abs(radius - 0.55) < 0.06) | ((radius < 0.3) & (rng.random(radius.shape) < 0.3))
    kind = np.where(structure, 1, np.where(radius < 0.8, 0, -1))
    copies = rng.integers(0, COPIES, kind.shape)
    for at in np.ndindex(kind.shape):
        if kind[at] >= 0:
            target = store / array.metadata.encode_chunk_key(at)
            target.parent.mkdir(parents=True, exist_ok=True)
            seed = (int(kind[at] * COPIES + copies[at]), 0, 0)
            os.link(folder / "seeds.zarr" / seeds.metadata.encode_chunk_key(seed), target)
    return store


def measured(store: Path, **options: object) -> dict[str, float]:
    """An image in a process of its own: seconds, peak memory and what was read."""
    script = f"from benchmarks.larger import child; child({str(store)!r}, {options!r})"
    done = subprocess.run([sys.executable, "-c", script], check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def child(store: str, options: dict) -> None:
    """What ``measured`` measures; prints it."""
    tf = wvr.TransferFunction(THIN if options.pop("thin", False) else CLEAR, unit_distance=1.0)
    # Kernels are there before, as they are after the first image on a machine; nothing is visible.
    warnings.simplefilter("ignore")
    warm = wvr.open(np.zeros((40, 40, 40), np.uint8))
    wvr.render(wvr.build_ranges(warm), tf, "iso", (8, 8), budget=0)
    wvr.render(warm, tf, "iso", (8, 8))
    wvr.render(wvr.build_ranges(warm), tf, "iso", (8, 8), integrator=wvr.Projection("max"), budget=0)
    wvr.render(warm, tf, "iso", (8, 8), integrator=wvr.Projection("max"))
    start, cpu, base = perf_counter(), os.times(), peak()
    volume = wvr.open(store)
    opened = perf_counter() - start
    floor = options.pop("floor", False)
    read = recorded(volume) if floor else []
    if what := options.pop("projection", None):
        options["integrator"] = wvr.Projection(what)
    image = wvr.render(volume, tf, wvr.Camera.fit(volume, (1, 0.6, 0.4)), **options)
    now = os.times()
    assert image.error_bound is not None
    found = {name: value for name, value in image.stats.items() if isinstance(value, int | float)}
    found |= {"opening": opened, "all": perf_counter() - start, "cpu": now.user + now.system - cpu.user - cpu.system}
    found |= {
        "before": base,
        "peak": peak(),
        "max": float(image.error_bound.max()),
        "mean": float(image.error_bound.mean()),
    }
    if floor:
        found |= computed(store, read)
    print(json.dumps(found))


def recorded(volume: Any) -> list[tuple[slice, ...]]:
    """What will be read of a volume."""
    read: list[tuple[slice, ...]] = []
    region = volume.region

    def reading(low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray:
        read.append(tuple(slice(a, b + 1) for a, b in zip(low[::-1].tolist(), high[::-1].tolist(), strict=True)))
        return region(low, high)

    volume.region = reading
    return read


def computed(store: str, read: list[tuple[slice, ...]]) -> dict[str, float]:
    """Seconds, and those of processor, that ``dask.array.compute`` takes of the same parts, a few at a time."""
    import dask
    import dask.array

    array = dask.array.from_zarr(store)
    start, cpu = perf_counter(), os.times()
    for first in range(0, len(read), FEW):
        dask.compute(*(array[part] for part in read[first : first + FEW]), scheduler="threads")
    now = os.times()
    return {"floor": perf_counter() - start, "floor_cpu": now.user + now.system - cpu.user - cpu.system}


def peak() -> float:
    """Peak resident memory of this process [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def least(store: Path) -> int:
    """Blocks that any exact method must read: with a sample of a cell in which a ray has some extinction before it is
    opaque to 1/256. Cells of bricks are rendered apart that are of one, two, four or eight blocks.
    """
    volume = wvr.open(store)
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    nothing = dict.fromkeys(("lighting", "shadows", "background", "segmentation"))
    tf = wvr.TransferFunction(CLEAR, unit_distance=1.0)
    options = {"precision": "auto", "skip_empty": True, "clips": (), "termination": 2 / 256}
    scene = Scene(volume, tf, wvr.Certified(1 / 256), **options, **nothing)  # type: ignore[arg-type]
    keep = Keeper(get_device("cpu"))
    march = Streamed(scene, camera, (512, 512), keep, Reading())
    edges = [sorted({0, *(s - 1 for s in along[1:-1]), *along[1:-1], along[-1] - 1}) for along in volume.starts]
    apart = Bricks(tuple(map(tuple, edges)))
    caster = Caster(scene, camera, (512, 512), apart, keep)
    blocks, image = march.blocks(1 << 30), caster.nothing()
    must: set[tuple[int, ...]] = set()
    first = apart.first(volume, camera)
    for index in march.order:
        if march.wanted(image, index) is None:
            continue
        brick, (low, high) = blocks.take(index), march.bricks.box(index)
        spans = [
            [k for k in range(len(along) - 1) if a <= along[k] and along[k + 1] <= b]
            for along, a, b in zip(apart.edges, low, high, strict=True)
        ]
        parts = [(i, j, k) for i, j, k in product(*spans)]
        for part in sorted(parts, key=lambda p: sum(abs(i - j) for i, j in zip(p, first, strict=True))):
            rect = caster.footprint(part)
            if rect is None or caster.ended(image, rect):
                continue
            low, high = apart.box(part)
            at = tuple(
                slice(a, b + 1) for a, b in zip((low - brick.first)[::-1], (high - brick.first)[::-1], strict=True)
            )
            before = image.samples[rect].sum()
            caster.cast(part, Brick(brick.numpy()[at].copy(), low, volume), image, rect)
            if image.samples[rect].sum() > before:
                must.update(product(*volume.spans(low, high)))
        keep.end_of_frame()
    blocks.close()
    assert volume.ranges is not None
    one = volume.ranges.values[:, :, :, ALL, ALL, ALL]
    # Those of one value are known.
    return sum(bool(one[block[::-1]][0] != one[block[::-1]][1]) for block in must)


def least_of_maximum(store: Path) -> int:
    """Blocks of which a ray meets cells whose samples go beyond the largest value that it finds."""
    volume = wvr.open(store)
    nothing = dict.fromkeys(("lighting", "shadows", "background", "segmentation", "termination"))
    tf = wvr.TransferFunction(CLEAR, unit_distance=1.0)
    options = {"precision": "auto", "skip_empty": True, "clips": ()}
    scene = Scene(volume, tf, wvr.Projection("max"), **options, **nothing)  # type: ignore[arg-type]
    march = Streamed(scene, wvr.Camera.fit(volume, (1, 0.6, 0.4)), (512, 512), Keeper(get_device("cpu")), Reading())
    image, _ = march.render()
    march.unneeded.clear()
    must = [march.needed(image, index, rect) for index in march.order if (rect := march.caster.footprint(index))]
    assert volume.ranges is not None
    one = volume.ranges.values[:, :, :, ALL, ALL, ALL]
    blocks = {block for these in must if these for block in these}
    return sum(bool(one[block[::-1]][0] != one[block[::-1]][1]) for block in blocks)


@app.default
def run(
    size: int = 4096,
    folder: Path | None = None,
    memory_limit: str = "2GiB",
    tolerance: float = 1 / 256,
    least_: Annotated[bool, Parameter("--least", negative=())] = False,
) -> None:
    """Make the store, find its ranges, render; print what that costs, and delete it.

    Parameters
    ----------
    size
        Samples along each axis, a multiple of 128.
    folder
        Where the store is made; by default one for temporary files.
    memory_limit
        Of rendering.
    tolerance
        Of the image.
    least_
        Also count the blocks that any exact method must read, which takes longer than the image.
    """
    place = Path(mkdtemp(dir=folder, prefix="wvr-larger-"))
    try:
        start = perf_counter()
        store = make(place, size)
        print(f"made {size**3 / 2**30:.3g} GiB (logical) in {perf_counter() - start:.1f} s", flush=True)
        start = perf_counter()
        volume = wvr.build_ranges(store)
        print(f"ranges of {volume.ranges.known.size} blocks in {perf_counter() - start:.1f} s", flush=True)  # type: ignore[union-attr]
        for name, options in (
            ("nothing read", {"budget": 0}),
            ("nothing read, thin fog", {"budget": 0, "thin": True}),
            ("two seconds", {"budget": 2.0}),
            ("maximum, nothing read", {"projection": "max", "budget": 0}),
            ("maximum", {"projection": "max", "memory_limit": memory_limit}),
            (f"tolerance {tolerance:.4g}", {"tolerance": tolerance, "memory_limit": memory_limit, "floor": True}),
        ):
            found = measured(store, **options)
            read, visible = found["blocks_read"], found["bricks_visible"]
            print(
                f"{name}: {found['all']:.2f} s ({found['cpu']:.2f} s of processor, {found['opening']:.2f} s opening), "
                f"peak {found['peak']:.0f} MiB (before {found['before']:.0f}), blocks read {read:.0f} of {visible:.0f} "
                f"visible of {found['bricks']:.0f}, again {found['blocks_read_again']:.0f}, rendered "
                f"{found['bricks_rendered']:.0f}, bound {found['max']:.4f}, mean {found['mean']:.4f}",
                flush=True,
            )
            if "floor" in found:
                floor, cpu = found["floor"], found["floor_cpu"]
                print(f"dask.array.compute of what was read: {floor:.2f} s ({cpu:.2f} s of processor)")
        if least_:
            print(f"any exact method must read {least(store)} blocks, for the maximum {least_of_maximum(store)}")
    finally:
        shutil.rmtree(place)


if __name__ == "__main__":
    app()
