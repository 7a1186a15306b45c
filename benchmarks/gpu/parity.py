"""Images of every kind: as the CPU has them, and within their bounds of the exact ones."""

from __future__ import annotations

import multiprocessing
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from multiprocessing.pool import AsyncResult
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

import wvr
from studies.base import cuda
from wvr.launch import get_device
from wvr.renderer import TOLERANCE

from .day import FAILED, Day, Row, Work

# What images may be off by from those of the CPU: rounding, in another order.
CLOSE = 1e-5
# And of look-ups beside a jump in a table, which multiplies the rounding of scalars: code for CUDA that a CPU runs is
# off by 1.6e-5.
LOOKED_UP = 5e-5
# Of a scene each: samples along an axis, and pixels.
SIDE, PIXELS = 24, 64
# Scenes of a rehearsal.
FEW = ["certified", "certified smooth", "riemann", "preintegrated lit", "shadows lit", "isosurface"]


def work(day: Day) -> Work:
    """Each scene in a process of its own, several at a time: one that ends badly takes no other with it."""
    names = FEW if day.quick else list(cuda.scenes())
    with multiprocessing.get_context("spawn").Pool(min(wvr.get_num_threads(), len(names)), maxtasksperchild=1) as pool:
        started = [(name, pool.apply_async(compared, (name, day.device.alias))) for name in names]
        for name, answer in started:
            # One that ended without an answer is not heard of again.
            yield name, partial(answered, answer, day)


def answered(answer: AsyncResult, day: Day) -> Row:
    """What a process came to, if it does in time."""
    return answer.get(timeout=day.left)


def compared(name: str, device: str, side: int = SIDE, pixels: int = PIXELS) -> Row:
    """A scene on a device, beside the CPU and the exact image."""
    render = cuda.scenes(side, pixels)[name]
    options: dict[str, Any] = render.keywords
    integrator = options.get("integrator") or wvr.Certified(TOLERANCE)
    on_cpu = partial(render, device="cpu")
    with rays_of(get_device(device)):
        start = perf_counter()
        image = render(device=device)
        first = perf_counter() - start
    reference = on_cpu()
    limit = allowed(integrator)
    row: Row = {"first frame [s]": first, "off the CPU": off(image.rgba, reference.rgba)}
    row["samples differ"] = int(np.sum(image.samples != reference.samples))
    wrong = []
    if row["off the CPU"] > limit:
        wrong.append(f"off the CPU by {row['off the CPU']:.2g}, {limit:g} allowed")
    if image.error_bound is not None and not integrator.probes:
        # With light or shadows the bound is that of opacity.
        channels = slice(3, 4) if options["lighting"] or options.get("shadows") else slice(0, 4)
        exact = on_cpu(integrator=wvr.Exact()).rgba
        error = np.abs(image.rgba[..., channels] - exact[..., channels]).max(axis=-1)
        row["off exact"] = float(error.max())
        row["bounds broken"] = int(np.sum(error > image.error_bound))
        row["largest bound"] = float(image.error_bound.max())
        if row["bounds broken"]:
            wrong.append(f"{row['bounds broken']} bounds broken")
    if name == cuda.DEPTH:
        depths, others = image.depth(), reference.depth()
        row["depths off the CPU"] = off(np.nan_to_num(depths), np.nan_to_num(others))
        if row["depths off the CPU"] > CLOSE or not np.array_equal(np.isnan(depths), np.isnan(others)):
            wrong.append("depths differ")
    return row | ({FAILED: "; ".join(wrong)} if wrong else {})


def rays_of(device: wp.Device) -> AbstractContextManager:
    """Within, a device casts rays as GPUs do; the CPU, too."""
    return cuda.as_on_gpus() if device.is_cpu else nullcontext()


def off(one: np.ndarray, other: np.ndarray) -> float:
    """The largest difference."""
    return float(np.abs(one.astype(np.float64) - other).max(initial=0.0))


def allowed(integrator: Any) -> float:
    """How far from the CPU's image one may be: other steps of what has a tolerance may, in light, count twice."""
    return max(
        LOOKED_UP if isinstance(integrator, wvr.Preintegrated) else CLOSE, 4 * getattr(integrator, "tolerance", 0.0)
    )
