"""``python -m benchmarks.cluster``: what a Dask cluster adds to an image, and how far more workers can make it faster.

Seconds are those of processors, of each task and process, as other work on the machine does not count then. The bound
on what more workers gain is that of the graph of tasks: rounds one after the other, each no shorter than its tasks on
so many workers, the largest first, and the reduction behind them. What it leaves out is the client, messages
(``python -m studies.messages``) and whatever workers share: the scheduler, disks, memory.

The floor is a graph of as many tasks, with the same dependencies, that do nothing.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from heapq import heapify, heapreplace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from cyclopts import App

import wvr

app = App(help_format="plaintext")
TF = wvr.TransferFunction([(0, "navy", 0.0), (110, "teal", 0.0), (150, "gold", 0.05), (255, "white", 0.4)])


class Recorded:
    """A client that writes down which tasks it submits: name, key and the keys of what they wait for."""

    def __init__(self, client: Any):
        self.client, self.tasks = client, list[tuple[str, str, list[str]]]()

    def submit(self, function: Callable, *given: Any, **options: Any) -> Any:
        future = self.client.submit(function, *given, **options)
        flat = [one for part in given for one in (part if isinstance(part, list) else [part])]
        waits = [one.key for one in flat if hasattr(one, "key")]
        self.tasks.append((function.__name__, future.key, waits))
        return future

    def __getattr__(self, name: str) -> Any:
        return getattr(self.client, name)


def watch() -> None:
    """In a worker: write down what tasks take."""
    from distributed import get_worker

    from wvr.bricks import cluster

    taken: dict[str, float] = {}

    def timed(function: Callable) -> Callable:
        def run(*given: Any) -> Any:
            start = time.process_time()
            result = function(*given)
            taken[get_worker().get_current_task()] = time.process_time() - start
            return result

        return run

    cluster.group_image, cluster.composed = timed(cluster.group_image), timed(cluster.composed)
    cluster.taken = taken  # type: ignore[attr-defined]


def seconds() -> tuple[float, dict[str, float]]:
    """In a worker: of processor so far, and what tasks took."""
    from wvr.bricks import cluster

    return time.process_time(), dict(cluster.taken)  # type: ignore[attr-defined]


def shortest(tasks: list[tuple[str, str, list[str]]], taken: dict[str, float], workers: int) -> float:
    """Seconds of an image on so many workers: of each round its tasks, the largest first, and the levels behind."""
    depth: dict[str, int] = {}
    rounds: list[dict[int, list[float]]] = []
    before = ""
    for name, key, waits in tasks:
        if name == "itself":
            continue
        depth[key] = 0 if name == "group_image" else 1 + max(depth[one] for one in waits)
        if name == "group_image" and before != "group_image":
            rounds.append({})
        rounds[-1].setdefault(depth[key], []).append(taken.get(key, 0.0))
        before = name
    total = 0.0
    for levels in rounds:
        for times in levels.values():
            ends = [0.0] * workers
            heapify(ends)
            for one in sorted(times, reverse=True):
                heapreplace(ends, ends[0] + one)
            total += max(ends)
    return total


def nothing(*_: Any) -> None:
    """A task of the floor."""


def floor(client: Any, tasks: list[tuple[str, str, list[str]]]) -> tuple[float, float]:
    """Seconds of processor of this process, with the scheduler, and by the clock, of tasks that do nothing."""
    best = []
    for _ in range(5):
        start, clock = time.process_time(), time.perf_counter()
        futures: dict[str, Any] = {}
        for _, key, waits in tasks:
            futures[key] = client.submit(nothing, *(futures[one] for one in waits), pure=False)
        client.gather(list(futures.values()))
        best.append((time.process_time() - start, time.perf_counter() - clock))
    own, clock = np.median(best, axis=0).tolist()
    return own, clock


def measured(store: Path, workers: int, size: int) -> dict[str, Any]:
    """The third image of a cluster of so many workers: what all of them had to do."""
    from distributed import Client, LocalCluster

    local = LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0")
    with local as cluster, Client(cluster) as client:
        volume = wvr.open(store)
        camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
        client.run(watch)
        for _ in range(2):
            wvr.render(volume, TF, camera, (size, size), client=client)
        before = client.run(seconds)
        recorded = Recorded(client)
        start, clock = time.process_time(), time.perf_counter()
        image = wvr.render(volume, TF, camera, (size, size), client=recorded)
        own, clock = time.process_time() - start, time.perf_counter() - clock
        after = client.run(seconds)
        taken = {key: one for _, tasks in after.values() for key, one in tasks.items()}
        idle, idle_clock = floor(client, recorded.tasks)
    return {
        "workers": workers,
        "tasks": len(recorded.tasks),
        "rounds": image.stats["rounds"],
        "clock": clock,
        "client": own,
        "floor": idle,
        "floor_clock": idle_clock,
        "busy": sorted(after[name][0] - before[name][0] for name in after),
        "in_tasks": sum(taken.get(key, 0.0) for _, key, _ in recorded.tasks),
        "bound": {p: shortest(recorded.tasks, taken, p) for p in (1, 2, 4, 8)},
    }


@app.default
def run(
    samples: int = 512, size: int = 512, workers: tuple[int, ...] = (1, 2, 4, 8), output: Path | None = None
) -> None:
    """Render on clusters of so many processes.

    Parameters
    ----------
    samples
        Of the volume along each axis.
    size
        Pixels along each axis.
    workers
        Of each cluster.
    output
        A JSON file of all that was measured.
    """
    import zarr

    with TemporaryDirectory(prefix="wvr-cluster-") as folder:
        store = Path(folder) / "blobs.zarr"
        data = wvr.datasets.load("blobs", samples).numpy()
        array = zarr.create_array(store, shape=data.shape, chunks=(64,) * 3, dtype="u1")
        array[:] = data
        volume = wvr.build_ranges(store, client=False)
        camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
        renderer = wvr.Renderer(volume, TF, client=False)
        wvr.set_num_threads(1)
        for _ in range(2):
            start = time.process_time()
            renderer.render(camera, (size, size))
            alone = time.process_time() - start
        print(f"{volume}; one process, one thread: {alone:.2f} s of processor")
        found = []
        for count in workers:
            one = measured(store, count, size)
            found.append(one)
            busy = ", ".join(f"{seconds:.2f}" for seconds in one["busy"])
            bound = ", ".join(f"{p}: {seconds:.2f}" for p, seconds in one["bound"].items())
            print(
                f"{count} workers: {one['tasks']} tasks in {one['rounds']} rounds, {one['clock']:.2f} s by the clock; "
                f"client and scheduler {one['client']:.2f} s of processor, of which tasks that do nothing take "
                f"{one['floor']:.2f} ({one['floor_clock']:.2f} by the clock); workers {busy}, in tasks "
                f"{one['in_tasks']:.2f}; no shorter on so many workers than {bound}",
                flush=True,
            )
    if output is not None:
        output.write_text(json.dumps({"alone": alone, "clusters": found}, indent=1))


if __name__ == "__main__":
    app()
