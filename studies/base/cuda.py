"""Which kernels a GPU would run, and what they are compiled to: NVRTC comes with Warp and needs no driver."""

from __future__ import annotations

import os
import pkgutil
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import product
from pathlib import Path
from shutil import which
from typing import Any
from unittest.mock import patch
from warnings import catch_warnings, simplefilter

import numpy as np
import warp as wp

import wvr
import wvr.checksum
import wvr.frame
import wvr.kernels
import wvr.launch
import wvr.probe
import wvr.resident
from wvr.bricks.frame import BrickedFrame
from wvr.bricks.grid import Bricks
from wvr.datasets.fields import blobs
from wvr.field.samples import extremes
from wvr.integrators import Integrator
from wvr.kernels.field.strides import make_octants
from wvr.light.lighting import MODES

# The oldest that Warp's compiler knows; what is made for it runs on all later ones.
ARCH = 75
# Of vectors, as clang has them.
HOST_ONLY = (make_octants,)

TF = wvr.TransferFunction([(0, "black", 0.0), (90, "red", 0.0), (90, "gold", 0.2), (255, "white", 0.3)])
# Without jumps.
SMOOTH = wvr.TransferFunction([(0, "black", 0.0), (90, "red", 0.0), (120, "gold", 0.2), (255, "white", 0.3)])
INTEGRATORS: dict[str, Integrator] = {
    "certified": wvr.Certified(1 / 512),
    "exact": wvr.Exact(),
    "riemann": wvr.Riemann(0.5),
    "left": wvr.Riemann(0.5, "left"),
    "trapezoid": wvr.Riemann(0.5, "trapezoid"),
    "simpson": wvr.Simpson(0.5),
    "preintegrated": wvr.Preintegrated(1.0),
    "adaptive simpson": wvr.AdaptiveSimpson(1e-3),
    "adaptive preintegrated": wvr.AdaptivePreintegrated(1e-3),
}
DTYPES = ("uint8", "int16", "float32", "float64", "float16", "uint16", "int8")
# The scene whose image is asked for its depth, too.
DEPTH = "depth"


def scenes(side: int = 6, pixels: int = 16) -> dict[str, partial[wvr.Image]]:
    """By name, calls that between them ask for a kernel of every kind: images of ``pixels`` x ``pixels``, of volumes
    with ``side`` samples along an axis; they take more keywords of :func:`wvr.render`.
    """

    def volume(dtype: str = "uint8", absent: bool = False) -> wvr.Volume:
        samples = (blobs(side) // 2).astype(dtype)  # what int8 holds
        if absent:
            samples[0, 0, 0] = np.nan
        return wvr.Volume(samples, nan="transparent" if absent else "error")

    last = side - 1
    box = wvr.ClipBox((0.2 * last,) * 3, (0.8 * last,) * 3)
    ball = wvr.ClipSphere((0.4 * last,) * 3, 0.4 * last, invert=True)
    solid = wvr.ClipVolume(volume("float32"), 50.0)
    labels = wvr.Segmentation((volume().numpy() > 50).astype(np.uint8), {0: TF, 1: SMOOTH})
    extras: dict[str, dict[str, Any]] = {
        "": {},
        "lit": {"lighting": wvr.Lighting()},
        "cut": {"clip": [box, ball]},
        "float64": {"precision": "float64"},
    }
    calls: dict[str, partial[wvr.Image]] = {}

    def add(name: str, field: Any, tf: Any = TF, **options: Any) -> None:
        calls[name] = partial(wvr.render, field, tf, "iso", (pixels, pixels), **({"lighting": False} | options))

    for n, ((name, integrator), extra) in enumerate(product(INTEGRATORS.items(), extras)):
        add(f"{name} {extra}".strip(), volume(DTYPES[n % 3]), integrator=integrator, **extras[extra])
    for name in ("certified", "exact", "preintegrated", "adaptive simpson"):
        options: dict[str, Any] = {"integrator": INTEGRATORS[name]}
        add(f"{name} labels", volume(), None, segmentation=labels, **options)
        add(f"{name} clip volume", volume(), clip=solid, **options)
        add(f"{name} absent", volume("float32", absent=True), **options)
    for name in ("", "lit", "cut"):
        add(f"certified smooth {name}".strip(), volume(), SMOOTH, integrator=INTEGRATORS["certified"], **extras[name])
    add("certified smooth absent", volume("float32", absent=True), SMOOTH, integrator=INTEGRATORS["certified"])
    add("certified smooth float64", volume("float64"), SMOOTH, integrator=INTEGRATORS["certified"])
    for dtype in DTYPES:
        add(f"riemann {dtype}", volume(dtype), integrator=wvr.Riemann(0.5))
    for mode in MODES:
        lighting = wvr.Lighting(mode, light=wvr.DirectionalLight((1, 1, 1)), gradient="cell")
        add(f"preintegrated {mode}", volume(), integrator=wvr.Preintegrated(1.0), lighting=lighting)
    add("maximum", volume(), integrator=wvr.Projection("max"))
    add("minimum absent", volume("float32", absent=True), integrator=wvr.Projection("min"))
    add("maximum labels cut", volume(), integrator=wvr.Projection("max"), segmentation=labels, clip=box)
    add("mean", volume("int16"), integrator=wvr.Projection("mean"))
    add("isosurface", volume(), integrator=wvr.Isosurface([95, 110]))
    add("isosurface lit", volume("float16"), integrator=wvr.Isosurface([95]), lighting=wvr.Lighting())
    add(DEPTH, volume(), integrator=wvr.Riemann(0.5))
    stored = wvr.build_ranges(wvr.open(volume("uint8").numpy()))
    others = {"maximum": wvr.Projection("max"), "mean": wvr.Projection("mean"), "isosurface": wvr.Isosurface([95])}
    for name in ("certified", "exact", "riemann", "preintegrated", *others):
        add(f"{name} bricks", volume(), integrator=(INTEGRATORS | others)[name], memory_limit="1 GiB")
    for name in ("certified", *others):
        for budget in (0, "1 B"):
            add(f"{name} of {budget}", stored, integrator=(INTEGRATORS | others)[name], budget=budget)
    for preintegrated in (False, True):
        name = "preintegrated shadows" if preintegrated else "shadows"
        shadows = wvr.ConvolutionShadows(preintegrated=preintegrated, subsamples=int(preintegrated))
        add(f"{name} lit", volume(), lighting=wvr.Lighting(), shadows=shadows)
        add(f"{name} labels cut", volume(), None, segmentation=labels, clip=box, shadows=shadows)
    return calls


def others(side: int = 6, pixels: int = 16) -> dict[str, Callable[[], object]]:
    """By name, what else asks for kernels: volumes in bricks, samples that are on a device, tables, scattering."""
    samples = (blobs(side) // 2).astype(np.uint8)
    volume = wvr.Volume(samples)
    camera = wvr.Camera.fit(volume)
    given: dict[str, Any] = {"camera": camera, "size": (pixels, pixels), "lighting": False, "memory_limit": "1 GiB"}
    labels = wvr.Segmentation((samples > 50).astype(np.uint8), {0: TF, 1: SMOOTH})
    bricked = partial(wvr.render, volume, TF, **given)
    calls: dict[str, Callable[[], object]] = {
        "bricks smooth": partial(wvr.render, volume, SMOOTH, **given),
        "bricks lit": partial(wvr.render, volume, TF, **(given | {"lighting": wvr.Lighting()})),
        "bricks labels": partial(wvr.render, volume, None, segmentation=labels, **given),
        "bricks adaptive preintegrated": partial(bricked, integrator=INTEGRATORS["adaptive preintegrated"]),
        "scattering": partial(wvr.single_scattering, volume, TF, camera, (pixels, pixels), directions=1),
    }
    for dtype in DTYPES:
        calls[f"on a device {dtype}"] = partial(extremes, wp.array(samples.astype(dtype), device="cpu"))
    for generator in ("brute", "approximate"):
        calls[f"table {generator}"] = partial(wvr.preintegrate, TF, 8, generator=generator)
    return calls


def ready_made() -> Iterator[wp.Kernel]:
    """Kernels that are made for nothing in particular."""
    names = [module.name for module in pkgutil.walk_packages(wvr.kernels.__path__, "wvr.kernels.")]
    for module in (*map(import_module, names), wvr.checksum):
        yield from (kernel for kernel in vars(module).values() if isinstance(kernel, wp.Kernel))


@contextmanager
def as_on_gpus() -> Iterator[None]:
    """A CPU casts rays as GPUs do: one a work item, without vectors."""
    halves = wvr.frame.Frame.halves

    def without_vectors(*given: Any) -> Any:
        return replace(halves(*given), vectors=False)

    with patch.object(wvr.frame.Frame, "halves", without_vectors):
        yield


@contextmanager
def _asked_for(kernels: dict[wp.Kernel, str], name: str) -> Iterator[None]:
    """Kernels that calls within would run on a GPU; those of pixels are not run."""
    load, launch = wvr.launch.load, wvr.launch.launch

    def asked(kernel: wp.Kernel, what: str) -> None:
        if kernel not in HOST_ONLY:
            kernels.setdefault(kernel, what)

    def maker(make: Callable[[Any], wp.Kernel]) -> Callable[[Any], wp.Kernel]:
        def made(halves: Any) -> wp.Kernel:
            kernel = make(halves)
            asked(kernel, f"{name} again" if halves.again else name)
            return kernel

        return made

    def launched(
        kernel: wp.Kernel, items: int, inputs: list[Any], *rest: Any, view: Any = None, **options: Any
    ) -> None:
        if view is None:
            launch(kernel, items, inputs, *rest, **options)
            return
        asked(kernel, f"{_key(kernel)}, {name}")
        for given in inputs:
            if isinstance(given, wp.array):
                given.zero_()

    def loaded(kernel: wp.Kernel, alias: str, deep: bool) -> None:
        asked(kernel, f"{_key(kernel)}, {name}")
        load(kernel, alias, deep)

    with (
        patch.object(wvr.frame, "make_raycast", maker(wvr.frame.make_raycast)),
        patch.object(wvr.probe, "make_probing", maker(wvr.probe.make_probing)),
        patch.object(wvr.launch, "launch", launched),
        patch.object(wvr.launch, "load", loaded),
        # Images stay on their device.
        patch.object(wvr.resident, "stays", lambda device: True),
        patch.object(wvr.frame, "stays", lambda device: True),
        patch.object(BrickedFrame, "bricks", lambda self: Bricks.regular(self.scene.volume.dimensions, (4, 4, 4))),
        as_on_gpus(),
        catch_warnings(),
    ):
        simplefilter("ignore")  # of images of nothing
        yield


def _key(kernel: wp.Kernel) -> str:
    return kernel.key.rpartition("__")[2]


def kernels(names: list[str] | None = None) -> dict[wp.Kernel, str]:
    """Each kernel, and the first scene that asks for it; of the scenes of these names, or of all, and of the rest."""
    found: dict[wp.Kernel, str] = {}
    calls: dict[str, Callable[[], Any]] = {**scenes(), **others()}
    for name in calls if names is None else names:
        with _asked_for(found, name):
            image = calls[name]()
            if name == DEPTH:
                image.depth()
    if names is None:
        for kernel in ready_made():
            if kernel not in HOST_ONLY:
                found.setdefault(kernel, _key(kernel))
    return found


def compiled(kernel: wp.Kernel, folder: Path) -> Path:
    """The file that a kernel is compiled to, in PTX.

    Raises
    ------
    RuntimeError
        Where it does not compile.
    """
    try:
        (path,) = wp.compile_aot_module(kernel.module, arch=ARCH, module_dir=folder, use_ptx=True)
    except Exception as error:  # of whatever kind
        raise RuntimeError(f"does not compile for sm_{ARCH}: {error}") from error
    # The compiler's text is a string in C, with its last character.
    text = path.read_bytes().rstrip(b"\0").decode()
    path.write_text(text)
    if f".target sm_{ARCH}" not in text or ".entry" not in text:
        raise RuntimeError(f"has no entry for sm_{ARCH}")
    return path


def several(work: Callable[..., Any], jobs: Sequence[tuple]) -> list[Any]:
    """``work`` of each, several at a time, since compilers let others run; errors in place of results."""

    def one(job: tuple) -> Any:
        try:
            return work(*job)
        except RuntimeError as error:
            return error

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(one, jobs))


def instructions(ptx: str) -> tuple[int, float]:
    """How many instructions there are, and the share of them that are in or around float64."""
    lines = [line.strip() for line in ptx.splitlines()]
    every = [line for line in lines if line.endswith(";") and not line.startswith((".", "//"))]
    return len(every), sum(".f64" in line for line in every) / max(1, len(every))


def resources(path: Path, assembler: str) -> dict[str, int]:
    """Registers a thread, and bytes of stack and spills, as ``ptxas`` says for an architecture."""
    command = [assembler, "-v", f"-arch=sm_{ARCH}", "-o", os.devnull, str(path)]
    said = subprocess.run(command, capture_output=True, text=True)
    if said.returncode != 0:
        raise RuntimeError(f"ptxas: {said.stderr.strip()}")
    numbers = {
        name: [int(n) for n in re.findall(pattern, said.stderr)]
        for name, pattern in (
            ("registers", r"Used (\d+) registers"),
            ("stack [bytes]", r"(\d+) bytes stack frame"),
            ("spills [bytes]", r"(\d+) bytes spill stores"),
        )
    }
    return {name: max(found, default=0) for name, found in numbers.items()}


def find_assembler() -> str | None:
    """A ``ptxas`` that knows what Warp's compiler writes: of the wheel ``nvidia-cuda-nvcc``, or of the path."""
    wheels = [path for folder in sys.path for path in sorted((Path(folder) / "nvidia").glob("*/bin/ptxas"))]
    for path in map(str, filter(None, (*wheels, which("ptxas")))):
        said = subprocess.run([path, "--version"], capture_output=True, text=True).stdout
        release = re.search(r"release (\d+)\.(\d+)", said)
        if release and tuple(map(int, release.groups())) >= wp.get_cuda_toolkit_version():
            return path
    return None
