"""The only place that launches kernels: one launch on CUDA, strips over a thread pool on the CPU.

A Warp launch on the CPU runs on one core and lets go of Python's global lock. Kernels here write disjoint outputs and
take the index of their first item as first argument, so the items can be cut into strips for several threads; results
do not depend on how.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache, partial
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import numpy as np
import warp as wp

from . import kernel_cache
from .cancel import POLL, Lock, cancel, check_cancelled, open_locks
from .kernels.ray import TILE, tiles

# More strips than threads, so that strips of uneven cost balance.
STRIPS_PER_THREAD = 16
# The same where threads go on to the next step after each few hundred microseconds, for which they wait less often if
# those next to them are through: one less of them all, since each has to be launched.
STRIPS_PER_STEP = 2
# Threads at most, where there are fewer cores: more only cost memory.
MOST_THREADS = 64

T = TypeVar("T")
_threads: int | None = None


def set_num_threads(n: int) -> None:
    """Number of CPU threads that kernels run on.

    Parameters
    ----------
    n
        At least 1. The default is the environment variable ``WVR_NUM_THREADS`` or, without it, all cores that the
        process may use. Results do not depend on it. More than 64, or than the machine has cores where those are more,
        count as that many.

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
            return min(n, max(MOST_THREADS, os.cpu_count() or 1))
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
    kernel_cache.start()
    if device is None:
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device(device)
    except (ValueError, RuntimeError, AttributeError, TypeError) as error:
        there = ", ".join(repr(d.alias) for d in wp.get_devices())
        raise ValueError(f"device must be one of {there}, got {device!r} ({error})") from None


@contextmanager
def reporting(report: Callable[[float], object] | None) -> Iterator[None]:
    """While launches within work, their calling thread calls ``report`` with the share that is done of all there is
    to be done, every 20 ms at most, and with 1 once, at the end. What it raises ends the launch.

    Raises
    ------
    Cancelled
        Where the event of :func:`cancelling` is set before that end, if only by the last ``report`` before it.
    TypeError
        For a ``report`` that cannot be called.
    """
    if report is not None and not callable(report):
        raise TypeError(f"progress must be a function of the share that is done, or None, got {report!r}")
    token = _report.set(None if report is None else (report, 0.0, 1.0))
    try:
        yield
        check_cancelled()
        if report is not None:
            _tell(report, 1.0)
    finally:
        _report.reset(token)


def _tell(report: Callable[[float], object], share: float) -> None:
    """What is launched within is not of what is told of."""
    token = _report.set(None)
    try:
        report(share)
    finally:
        _report.reset(token)


def in_turn(items: Sequence[T], weights: Sequence[float] | None = None) -> Iterator[T]:
    """Them, one after the other: what is launched for each is a part of what is to be done, of such a weight."""
    given = _report.get()
    if given is None:
        yield from items
        return
    report, low, high = given
    weights = [1.0] * len(items) if weights is None else weights
    before = 0.0
    for item, weight in zip(items, weights, strict=True):
        begin, end = (low + (high - low) * w / sum(weights) for w in (before, before + weight))
        _report.set((report, begin, end))
        yield item
        before += weight
    _report.set(given)


def launch(
    kernel: wp.Kernel,
    items: int,
    inputs: list[Any],
    device: wp.Device,
    grain: int = 1,
    first: int = 0,
    view: Any = None,
    scratch: int = 0,
) -> None:
    """Run ``kernel(base, *inputs)`` over ``items`` work items.

    An exception, of any kind, leaves only when nothing runs any more: one in a strip when the other threads are done
    with theirs, or Ctrl-C.

    Parameters
    ----------
    kernel
        Its first argument is the index that ``wp.tid() == 0`` stands for; items write disjoint outputs.
    grain
        Items that a strip has a multiple of.
    first
        Index of the first item.
    view
        The :class:`kernels.ray.View` of the ``inputs``, where they have one: the kernel then ends between two pixels.
    scratch
        Bytes of memory that each thread has for itself, whose address takes the place of the last of the ``inputs``:
        kernels of rays that are written in vectors have some.

    Raises
    ------
    Cancelled
        Where the event of :func:`cancelling` is set; on CUDA, before the launch.
    """
    load(kernel, device.alias, deep=view is not None and scratch == 0)
    if device.is_cuda:
        check_cancelled()
        wp.launch(kernel, items, [first, *inputs], device=device)
        return
    threads = get_num_threads()
    strip = grain * max(1, -(-items // (grain * threads * STRIPS_PER_THREAD)))
    starts = range(first, first + items, strip)
    bases = iter(starts)
    flag = np.zeros(1, np.int32)
    done: list[None] = []
    if view is not None:
        view.stop = wp.array(flag, dtype=int, device=device, copy=False)

    def run() -> None:
        # Arguments are packed once a thread; a strip then costs a few microseconds, not 50.
        memory = wp.empty(max(scratch, 1), dtype=wp.uint8, device=device)
        command = wp.launch(kernel, strip, [0, *inputs], device=device, record_cmd=True)
        if scratch:
            command.set_param_at_index(len(inputs), memory.ptr)
        for base in bases:
            if flag[0]:
                return
            if (left := first + items - base) < strip:
                command.set_dim(left)
            command.set_param_at_index_from_ctype(0, base)
            command.launch()
            done.append(None)

    def stop() -> None:
        flag[0] = 1

    _work(run, min(threads, len(starts)), stop, joins=view is None, done=lambda: len(done) / len(starts))


def launch_pixels(
    kernel: wp.Kernel, inputs: list[Any], device: wp.Device, view: Any, rays: int = 1, scratch: int = 0
) -> None:
    """Run ``kernel(base, *inputs)`` over the pixels of an image, work items of ``kernels.ray.pixel``.

    Exceptions are as of :func:`launch`.

    Parameters
    ----------
    view
        The :class:`kernels.ray.View` of the ``inputs``: the kernel ends between two pixels.
    rays
        Pixels of an item of the launch.
    """
    tile = int(TILE) ** 2 // rays
    launch(kernel, tiles(view.width, view.height) * tile, inputs, device, grain=tile, view=view, scratch=scratch)


def launch_in_turn(
    kernel: wp.Kernel,
    items: int,
    steps: Sequence[tuple],
    inputs: list[Any],
    device: wp.Device,
    near: int | None = None,
) -> None:
    """Run ``kernel(base, *step, *inputs)`` over ``items`` work items for each step, one step after the other.

    For many short ones: arguments are packed once, and threads on the CPU never end between. They only wait for what a
    step depends on. Exceptions are as of :func:`launch`.

    Parameters
    ----------
    steps
        Numbers, first arguments of the kernel.
    near
        How far from an item those are whose step before it reads, or which in theirs read what it writes; by default
        all of them.
    """
    load(kernel, device.alias, deep=True)
    threads = 1 if device.is_cuda else min(get_num_threads(), items)
    strips = 1 if threads == 1 else min(STRIPS_PER_STEP * threads - 1, items)
    strip = -(-items // strips)
    strips = -(-items // strip)
    around = strips if near is None else -(-near // strip)
    order = iter(range(strips * len(steps)))
    done = [0] * strips  # steps of each
    stopped = threading.Event()
    changed = threading.Condition()
    waiting: list[None] = []

    def ready(step: int, part: int) -> bool:
        return stopped.is_set() or min(done[max(part - around, 0) : part + around + 1]) >= step

    def tell() -> None:
        with changed:
            changed.notify_all()

    def run() -> None:
        command = wp.launch(kernel, strip, [0, *steps[0], *inputs], device=device, record_cmd=True)
        last, width = 0, strip
        for n in order:
            step, part = divmod(n, strips)
            if not ready(step, part):
                with changed:
                    # Who is done from here on sees that somebody waits; who was before is seen to be done.
                    waiting.append(None)
                    changed.wait_for(partial(ready, step, part))
                    waiting.pop()
            if stopped.is_set():
                return
            if step != last:
                for index, value in enumerate(steps[step]):
                    command.set_param_at_index_from_ctype(1 + index, value)
                last = step
            if strips > 1:
                if (count := min(strip, items - part * strip)) != width:
                    command.set_dim(width := count)
                command.set_param_at_index_from_ctype(0, part * strip)
            command.launch()
            done[part] = step + 1
            if waiting:
                tell()

    def stop() -> None:
        stopped.set()
        tell()

    if device.is_cuda:
        check_cancelled()
        run()
    else:
        _work(run, threads, stop, joins=True)


# Whom to tell, and what shares the next launch begins and ends at.
_report: ContextVar[tuple[Callable[[float], object], float, float] | None] = ContextVar("wvr_report", default=None)
_own = threading.local()
_loading = Lock()


def _work(
    run: Callable[[], None],
    threads: int,
    stop: Callable[[], None],
    joins: bool,
    done: Callable[[], float] | None = None,
) -> None:
    """Have threads run until all are done; an error in any of them, Ctrl-C or a cancelled frame calls ``stop``. What
    share is ``done`` is reported meanwhile.

    The calling thread is one of them (``joins``) where strips are short; else it only waits, since Ctrl-C does not
    reach one that is inside a kernel.
    """
    check_cancelled()
    if joins and threads == 1:
        run()
        return
    errors: list[BaseException] = []
    entered: list[None] = []
    left: list[None] = []
    wake: SimpleQueue[None] = SimpleQueue()
    # Ctrl-C ends a wait at once; only an event has to be looked at.
    report = None if joins or done is None else _report.get()
    timeout = 1.0 if cancel.get() is None and report is None else POLL

    def work() -> None:
        entered.append(None)
        try:
            run()
        except BaseException as error:
            errors.append(error)
            stop()
        finally:
            left.append(None)
            wake.put(None)

    def pause() -> None:
        with suppress(Empty):
            wake.get(timeout=timeout)

    pool = _pool(get_num_threads())
    try:
        for _ in range(threads - joins):
            pool.submit(work)
        if joins:
            run()  # which Ctrl-C may end anywhere: who enters and leaves are those of the pool, that it does not reach
        while len(left) < threads - joins:
            pause()
            check_cancelled()
            if report is not None and done is not None:
                tell, low, high = report
                share = low + (high - low) * done()
                # With 1 once, when the image is there.
                if share < 1:
                    _tell(tell, share)
    except BaseException:
        stop()
        # Ctrl-C may come when a thread has started and its pool does not know it yet: it would wait for work for
        # ever. Told to end, a pool wakes all that wait; the next launch makes another.
        _own.threads = 0
        pool.shutdown(wait=False)
        # Who enters later finds that nothing is to be done.
        while len(left) < len(entered):
            with suppress(KeyboardInterrupt):  # pressed again
                pause()
        raise
    if errors:
        raise errors[0]


def _pool(threads: int) -> ThreadPoolExecutor:
    """The calling thread's own: what several threads render does not queue, and all of a launch run at a time."""
    if getattr(_own, "threads", 0) != threads:
        _own.pool, _own.threads = ThreadPoolExecutor(threads, thread_name_prefix="wvr"), threads
    return _own.pool


def _after_fork() -> None:
    """In the child of a fork there are no threads but the one that forked, and nobody to open a lock."""
    global _own
    _own = threading.local()
    open_locks()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


@cache
def load(kernel: wp.Kernel, alias: str, deep: bool) -> None:
    """Load the kernel's module, one thread at a time; how deep it is inlined is what is asked for first."""
    device = wp.get_device(alias)
    block_dim = 1 if device.is_cpu else kernel.module.options["block_dim"]
    with _loading.held():
        kernel_cache.load(kernel, device, block_dim, deep)
