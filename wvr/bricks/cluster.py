"""Bricks rendered by the workers of a Dask cluster.

A task is a group of neighbouring bricks, which a worker reads, renders and composes. Groups are a grid of bricks too,
so that they are composed in the order of visibility: eight at a time, on the workers. What comes back is one image.
Rounds of tasks go outwards from the camera, and a group whose rays all ended in a round before is never read. A task
depends on nothing but its arguments: one that is lost with its worker is done by another, and the image is the same.
"""

from __future__ import annotations

import uuid
from collections import OrderedDict
from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from threading import Lock, local
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..cancel import waited
from ..io.conventions import Meaning
from ..keep import Keeper
from ..launch import get_device, set_num_threads
from .brick import Caster
from .finder import Finder, Findings
from .grid import Bricks, Index, Rect
from .partial import Partial
from .reading import Reading
from .stored import Samples

# Bricks along an axis of a group, as many as leave each worker so many groups, and images that are composed at a time.
GROUP, EACH, ARITY = (4, 3, 2), 4, 8
# Tasks of a round for each worker, in the first round and in those after.
FIRST, LATER = 2, 4
# Bytes of blocks that a worker keeps from frame to frame, in parts of its memory.
KEPT = 0.25
# Where a worker says nothing of its memory.
MEMORY = 1 << 30

# Of the threads of a worker.
_own = local()
_tokens: WeakKeyDictionary[Any, str] = WeakKeyDictionary()


def prepared(client: Any) -> int:
    """Have all workers of a cluster, and those that come, ready; how many there are.

    Raises
    ------
    RuntimeError
        Where there are none.
    """
    from distributed.diagnostics.plugin import WorkerPlugin

    class Prepared(WorkerPlugin):
        """Each task of a worker renders with one thread."""

        name = "wvr"

        def setup(self, worker: Any) -> None:
            set_num_threads(1)

    workers = client.scheduler_info(n_workers=-1)["workers"]
    if not workers:
        raise RuntimeError("client has no workers: wait for some, client.wait_for_workers(1)")
    client.register_plugin(Prepared())
    return len(workers)


def token_of(volume: Any) -> str:
    """A name for the samples of a volume, for workers that keep some of them."""
    return f"{_tokens.setdefault(volume, uuid.uuid4().hex)} {volume.version}"


class Groups:
    """Bricks in groups, each of which a task renders."""

    def __init__(self, bricks: Bricks, order: list[Index], first: Index, least: int):
        for along in (*GROUP, 1):
            self.members: dict[Index, list[Index]] = {}
            for index in order:
                self.members.setdefault(_group(index, along), []).append(index)
            if len(self.members) >= least:
                break
        waves = Bricks(tuple((*range(0, n, along), n) for n in bricks.counts)).waves(_group(first, along))
        self.waves = [[group for group in wave if group in self.members] for wave in waves]
        self.order = [group for wave in self.waves for group in wave]


def _group(index: Index, along: int) -> Index:
    i, j, k = index
    return i // along, j // along, k // along


def render(march: Any, client: Any) -> tuple[Any, dict[str, Any]]:
    """The image of a ``Streamed`` that workers render.

    Raises
    ------
    OSError
        Where a block cannot be read, if that is an error.
    """
    caster = march.caster
    workers = prepared(client)
    groups = Groups(march.bricks, march.order, march.bricks.first(march.volume, caster.camera), workers * EACH)
    if isinstance(caster, Finder):
        return _find(march, caster, client, workers, groups)
    single = caster.scene.integrator.shown(caster.scene) == "float32"
    rounding = caster.scene.brightest if single else None
    given = Shared(caster, march.reading.missing, token_of(march.volume), rounding)
    # A task as well: what is only scattered would be lost with the workers that have it.
    shared = client.submit(itself, given, pure=False)
    image = caster.nothing()
    left, numbers, tasks, rounds = list(groups.order), Counts(), 0, 0
    while left:
        count = workers * (FIRST if rounds == 0 else LATER)
        futures: list[Any] = []
        while left and len(futures) < count:
            group = left.pop(0)
            members = [(index, rect) for index in groups.members[group] if (rect := march.wanted(image, index))]
            if not members:
                continue
            rect = union([rect for _, rect in members])
            front = image.through[rect].astype(np.float32)
            indices = [index for index, _ in members]
            futures.append(client.submit(group_image, shared, indices, rect, front, pure=False))
        tasks += len(futures)
        rounds += 1
        # Composed in the order of visibility, eight at a time, where they are.
        while len(futures) > 1:
            futures = [
                client.submit(composed, futures[i : i + ARITY], rounding, pure=False)
                for i in range(0, len(futures), ARITY)
            ]
        try:
            for future in futures:
                partial, counted = waited(future)
                image.over(partial)
                numbers.add(counted)
        except BaseException:
            client.cancel(futures)
            raise
    stats = {"workers": workers, "tasks": tasks, "rounds": rounds, **numbers.stats(march)}
    return image, stats


def _find(march: Any, caster: Finder, client: Any, workers: int, groups: Groups) -> tuple[Findings, dict[str, Any]]:
    """What rays find: wave by wave, as what each has found goes on from group to group, and no two groups of a wave are
    on one ray.
    """
    given = Shared(caster, march.reading.missing, token_of(march.volume), None)
    shared = client.submit(itself, given, pure=False)
    image = caster.nothing()
    numbers, tasks, rounds = Counts(), 0, 0
    for wave in groups.waves:
        asked = []
        for group in wave:
            members = [(index, rect) for index in groups.members[group] if (rect := march.wanted(image, index))]
            if members:
                rect = union([rect for _, rect in members])
                before = caster.state(rect)
                indices = [index for index, _ in members]
                asked.append((rect, before, client.submit(group_found, shared, indices, rect, before, pure=False)))
        tasks, rounds = tasks + len(asked), rounds + bool(asked)
        try:
            for rect, before, future in asked:
                found, counted = waited(future)
                # Rays of other groups in these pixels may have found something meanwhile.
                changed = (found != before).any(axis=-1, keepdims=True)
                caster.resume(rect, np.where(changed, found, caster.state(rect)))
                numbers.add(counted)
        except BaseException:
            client.cancel([future for *_, future in asked])
            raise
    return image, {"workers": workers, "tasks": tasks, "rounds": rounds, **numbers.stats(march)}


class Counts:
    """What tasks did."""

    NAMES = ("bricks_rendered", "bricks_missing", "blocks_read", "bytes_read")

    def __init__(self) -> None:
        self.numbers = dict.fromkeys(self.NAMES, 0)

    def add(self, other: Counts) -> None:
        for name, number in other.numbers.items():
            self.numbers[name] += number

    def stats(self, march: Any) -> dict[str, Any]:
        """Of an image."""
        total = int(np.prod(march.bricks.counts))
        return {
            "bricks": total,
            "bricks_visible": len(march.order),
            **self.numbers,
            "share_read": self.numbers["blocks_read"] / total,
        }


class Shared:
    """What all tasks of an image have in common."""

    def __init__(self, caster: Caster, missing: Any, token: str, rounding: float | None):
        self.scene, self.camera, self.size = replace(caster.given, like=None), caster.camera, caster.size
        self.ends = caster.ends
        # The brightest colour, where images travel in single precision.
        self.missing, self.token, self.rounding = missing, token, rounding


def itself(given: Any) -> Any:
    """In a worker: what a task is given."""
    return given


def union(rects: list[Rect]) -> Rect:
    """The pixels of several, and those between them."""
    rows = slice(min(r.start for r, _ in rects), max(r.stop for r, _ in rects))
    return rows, slice(min(c.start for _, c in rects), max(c.stop for _, c in rects))


def marching(shared: Shared) -> tuple[Any, Remembered]:
    """In a worker: what renders groups of an image, the same for those that a thread renders one after the other, and
    what it reads.
    """
    from .streamed import Streamed

    if getattr(_own, "shared", None) is not shared:
        # A volume of its own: what is shared may travel on to other workers.
        volume = copy(shared.scene.volume)
        _own.samples = volume.samples = Remembered(volume.samples, shared.token)  # type: ignore[attr-defined]
        scene, reading = replace(shared.scene, volume=volume), Reading(missing=shared.missing)
        keep = Keeper(get_device(None))
        _own.march = Streamed(scene, shared.camera, shared.size, keep, reading, shared.ends)
        _own.shared = shared
    _own.march.missing = _own.samples.blocks = _own.samples.bytes = 0
    return _own.march, _own.samples


def group_image(shared: Shared, indices: list[Index], rect: Rect, front: NDArray[np.float32]) -> tuple[Partial, Counts]:
    """In a worker: the image of a group of bricks, in order, behind what lets ``front`` through."""
    march, samples = marching(shared)
    image = Partial.nothing(rect, march.caster.bounded)
    counts = _each(march, samples, indices, image, front.astype(np.float64))
    return image if shared.rounding is None else image.rounded(shared.rounding), counts


def group_found(
    shared: Shared, indices: list[Index], rect: Rect, state: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], Counts]:
    """In a worker: what rays have found after a group of bricks, which go on from a ``state``."""
    march, samples = marching(shared)
    march.caster.resume(rect, state)
    counts = _each(march, samples, indices, march.caster.nothing(), None)
    return march.caster.state(rect), counts


def _each(
    march: Any, samples: Remembered, indices: list[Index], image: Any, front: NDArray[np.float64] | None
) -> Counts:
    """Render bricks, one behind the other."""
    blocks, counts = march.blocks(_memory() // 2), Counts()
    try:
        for index in indices:
            place = march.caster.footprint(index)
            if place is None:
                continue
            if (needed := march.needed(image, index, place, front)) == set():
                march.caster.end(image, place, front)
                continue
            march.cast(blocks, image, index, place, needed, front)
            march.keep.end_of_frame()
    finally:
        blocks.close()
    counts.numbers = {
        "bricks_rendered": len(indices),
        "bricks_missing": march.missing,
        "blocks_read": samples.blocks,
        "bytes_read": samples.bytes,
    }
    return counts


def composed(parts: list[tuple[Partial, Counts]], rounding: float | None) -> tuple[Partial, Counts]:
    """In a worker: the image of several, the first in front."""
    rect = union([partial.rect for partial, _ in parts])
    image, counts = Partial.nothing(rect, parts[0][0].bound is not None), Counts()
    for partial, counted in parts:
        image.over(partial)
        counts.add(counted)
    return image if rounding is None else image.rounded(rounding), counts


class Remembered:
    """Samples whose parts that were read last stay in the process."""

    _kept: ClassVar[OrderedDict[tuple, NDArray]] = OrderedDict()
    _lock: ClassVar = Lock()

    def __init__(self, samples: Samples, token: str):
        self.samples, self.token = samples, token
        self.blocks = self.bytes = 0

    @property
    def name(self) -> str:
        return self.samples.name

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.samples.shape

    @property
    def dtype(self) -> np.dtype:
        return self.samples.dtype

    @property
    def meaning(self) -> Meaning:
        return self.samples.meaning

    def read(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray:
        """As of ``Samples``."""
        key = (self.token, tuple(low.tolist()), tuple(high.tolist()))
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        samples = self.samples.read(low, high)
        self.blocks += 1
        self.bytes += samples.nbytes
        with self._lock:
            self._kept[key] = samples
            taken = sum(part.nbytes for part in self._kept.values())
            while taken > KEPT * _memory() and len(self._kept) > 1:
                taken -= self._kept.popitem(last=False)[1].nbytes
        return samples


def _memory() -> int:
    """Of this worker, for one task."""
    from distributed import get_worker

    try:
        worker = get_worker()
    except ValueError:
        return MEMORY
    limit = worker.memory_manager.memory_limit or MEMORY
    return int(limit / max(worker.state.nthreads, 1))


def ranges_of(volume: Any, left: list[Index], client: Any) -> Iterator[tuple[Index, tuple[NDArray, bool]]]:
    """Ranges of blocks that workers read, as they come."""
    from distributed import as_completed

    from .ranges import learned

    prepared(client)
    shared = client.submit(itself, volume, pure=False)
    futures = {client.submit(learned, shared, index, pure=False): index for index in left}
    for future in as_completed(futures):
        yield futures[future], future.result()
        future.release()
