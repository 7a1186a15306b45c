"""The only place that launches kernels: one launch on CUDA, strips over a thread pool on the CPU.

A Warp launch on the CPU runs on one core and lets go of Python's global lock. Kernels here write disjoint outputs and
take the index of their first item as first argument, so the items can be cut into strips for several threads; results
do not depend on how.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

log = logging.getLogger("wvr")

# More strips than threads, so that strips of uneven cost balance.
STRIPS_PER_THREAD = 16
# The same where threads wait for each other after each few hundred microseconds.
STRIPS_PER_STEP = 2

_threads: int | None = None


def set_num_threads(n: int) -> None:
    """Number of CPU threads that kernels run on.

    Parameters
    ----------
    n
        At least 1. The default is the environment variable ``WVR_NUM_THREADS`` or, without it, all cores that the
        process may use. Results do not depend on it.

    Raises
    ------
    ValueError
        For anything but an integer >= 1.
    """
    global _threads
    _threads = _thread_count(n, "n")


def get_num_threads() -> int:
    """Number of CPU threads that kernels run on; see :func:`set_num_threads`."""
    if _threads is not None:
        return _threads
    given = os.environ.get("WVR_NUM_THREADS")
    if given:
        return _thread_count(given, "WVR_NUM_THREADS")
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _thread_count(value: Any, name: str) -> int:
    try:
        n = int(value)
        if n >= 1 and n == float(value) and not isinstance(value, bool):
            return n
    except (TypeError, ValueError, OverflowError):
        pass
    raise ValueError(f"{name} must be an integer >= 1, got {value!r}")


def get_device(device: Any = None) -> wp.Device:
    """The Warp device of a name or device; None is the first CUDA device or, without one, the CPU.

    Raises
    ------
    ValueError
        For a device that is not there.
    """
    with wp.ScopedLogLevel(wp.LOG_WARNING):
        wp.init()
    if device is None:
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device(device)
    except (ValueError, RuntimeError, AttributeError, TypeError) as error:
        there = ", ".join(repr(d.alias) for d in wp.get_devices())
        raise ValueError(f"device must be one of {there}, got {device!r} ({error})") from None


def launch(kernel: wp.Kernel, items: int, inputs: list[Any], device: wp.Device, grain: int = 1, first: int = 0) -> None:
    """Run ``kernel(base, *inputs)`` over ``items`` work items.

    Parameters
    ----------
    kernel
        Its first argument is the index that ``wp.tid() == 0`` stands for; items write disjoint outputs.
    grain
        Items that a strip has a multiple of.
    first
        Index of the first item.
    """
    _load(kernel, device.alias)
    threads = get_num_threads()
    if device.is_cuda or threads == 1 or items <= grain:
        wp.launch(kernel, items, [first, *inputs], device=device)
        return
    strip = grain * max(1, -(-items // (grain * threads * STRIPS_PER_THREAD)))
    starts = iter(range(first, first + items, strip))

    def run() -> None:
        # Arguments are packed once a thread; a strip then costs a few microseconds, not 50.
        command = wp.launch(kernel, strip, [0, *inputs], device=device, record_cmd=True)
        for base in starts:
            command.set_dim(min(strip, first + items - base))
            command.set_param_at_index(0, base)
            command.launch()

    others = [_pool(threads - 1).submit(run) for _ in range(threads - 1)]
    run()
    for done in others:
        done.result()


def launch_in_turn(kernel: wp.Kernel, items: int, steps: Sequence[tuple], inputs: list[Any], device: wp.Device) -> None:
    """Run ``kernel(base, *step, *inputs)`` over ``items`` work items for each step, one step after the other.

    For many short ones: arguments are packed once, and on the CPU threads wait for each other but never end between.

    Parameters
    ----------
    steps
        Numbers, first arguments of the kernel.
    """
    _load(kernel, device.alias)
    threads = 1 if device.is_cuda else min(get_num_threads(), items)
    strips = 1 if threads == 1 else min(STRIPS_PER_STEP * threads, items)
    strip = -(-items // strips)
    strips = -(-items // strip)
    barrier = threading.Barrier(threads)
    order = iter(range(strips * len(steps)))

    def run() -> None:
        # Every thread has a strip of each step, so when all wait, the step before is done.
        try:
            command = wp.launch(kernel, strip, [0, *steps[0], *inputs], device=device, record_cmd=True)
            last = 0
            for n in order:
                step, part = divmod(n, strips)
                if step != last:
                    for index, value in enumerate(steps[step]):
                        command.set_param_at_index(1 + index, value)
                    last = step
                    if threads > 1:
                        barrier.wait()
                if strips > 1:
                    command.set_dim(min(strip, items - part * strip))
                    command.set_param_at_index(0, part * strip)
                command.launch()
        except threading.BrokenBarrierError:
            return  # the thread that broke it says why
        except BaseException:
            barrier.abort()
            raise

    with ThreadPoolExecutor(threads) as pool:
        others = [pool.submit(run) for _ in range(threads - 1)]
        run()
        for done in others:
            done.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="wvr")


@cache
def _load(kernel: wp.Kernel, alias: str) -> None:
    """Load the kernel's module, saying so where that means compiling."""
    device = wp.get_device(alias)
    block_dim = 1 if device.is_cpu else kernel.module.options["block_dim"]
    with wp.ScopedLogLevel(wp.LOG_WARNING):
        if not (Path(wp.config.kernel_cache_dir) / kernel.module.get_module_identifier(block_dim)).is_dir():
            log.info("compiling the kernel %s for %s (once; a few seconds)", kernel.key.rpartition("__")[2], alias)
        kernel.module.load(device, block_dim)
