"""Images of every kind: as the CPU has them, as far as both bounds say, and within their bounds of the exact ones."""

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
    # What is compiled for longest first.
    names = sorted(FEW if day.quick else cuda.scenes(), key=lambda name: not ("lit" in name or "shadows" in name))
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
    # With light or shadows bounds are those of opacity.
    channels = slice(3, 4) if options["lighting"] or options.get("shadows") else slice(0, 4)
    row: Row = {"first frame [s]": first, "off the CPU": off(image.rgba, reference.rgba)}
    row["samples differ"] = int(np.sum(image.samples != reference.samples))
    apart = np.abs(image.rgba.astype(np.float64) - reference.rgba)
    limits = allowed(image, reference, integrator, channels)
    # In parts of what is allowed; where that is nothing, any difference is too much.
    parts = np.where(apart > 0.0, apart / np.maximum(limits, 1e-300), 0.0)
    row["of what is allowed"] = float(parts.max())
    wrong = []
    if row["of what is allowed"] > 1.0:
        at = np.unravel_index(np.argmax(parts), parts.shape)
        wrong.append(f"off the CPU by {apart[at]:.2g}, {limits[at]:.2g} allowed")
    if image.values is not None and reference.values is not None:
        # Where there is nothing there is no number.
        differ = np.abs(image.values - reference.values) > bounds_of(image) + bounds_of(reference)
        differ |= np.isnan(image.values) != np.isnan(reference.values)
        row["values differ"] = int(differ.sum())
        if row["values differ"]:
            wrong.append(f"{row['values differ']} values differ by more than both bounds")
    if image.error_bound is not None and not integrator.probes:
        # With all samples, however few of them the image was made of.
        whole = {"budget": None} if "budget" in options else {}
        exact = on_cpu(integrator=wvr.Exact(), **whole).rgba
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


def bounds_of(image: wvr.Image) -> np.ndarray:
    """Of each pixel."""
    assert image.error_bound is not None
    return image.error_bound.astype(np.float64)


def allowed(image: wvr.Image, reference: wvr.Image, integrator: Any, channels: slice) -> np.ndarray:
    """How far from the CPU's image one may be, (height, width, 4): in ``channels`` that have bounds by both of them; of
    those that have none by rounding, and what has a tolerance may take other steps, which in light count twice.
    """
    most = LOOKED_UP if isinstance(integrator, wvr.Preintegrated) else CLOSE
    limits = np.full(image.rgba.shape, max(most, 4 * getattr(integrator, "tolerance", 0.0)))
    if image.error_bound is not None and reference.error_bound is not None and image.values is None:
        limits[..., channels] = (bounds_of(image) + bounds_of(reference))[..., None]
    return limits
