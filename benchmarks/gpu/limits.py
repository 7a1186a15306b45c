"""What a device can do at most: how fast it copies, and a volume that fills more than half of its memory."""

from __future__ import annotations

from functools import partial
from time import perf_counter

import numpy as np
import warp as wp

import wvr
from benchmarks.scenes import transfer_functions
from wvr.memory import free_memory

from .day import Day, Row, Work
from .parity import rays_of

# Bytes that are copied, and of a rehearsal.
BYTES, FEW = 1 << 30, 1 << 22
# Of the free memory, what the samples of a large volume take.
SHARE = 0.6
ROUNDS = 5


def work(day: Day) -> Work:
    """Copies, then the volume."""
    host, device = wp.get_device("cpu"), day.device
    for name, source, target in (
        ("copy on the device", device, device),
        ("copy to the device", host, device),
        ("copy to the host", device, host),
    ):
        yield name, partial(copied, source, target, FEW if day.quick else BYTES)
    yield "a large volume, twice", partial(large, day)


def copied(source: wp.Device, target: wp.Device, count: int) -> Row:
    """The fastest of some copies: bytes read and written a second on a device, brought a second elsewhere."""
    one = wp.zeros(count // 4, dtype=wp.float32, device=source, pinned=source.is_cpu and target.is_cuda)
    other = wp.zeros(count // 4, dtype=wp.float32, device=target, pinned=target.is_cpu and source.is_cuda)
    times = []
    for _ in range(ROUNDS):
        wp.synchronize()
        start = perf_counter()
        wp.copy(other, one)
        wp.synchronize()
        times.append(perf_counter() - start)
    moved = count * (2 if source == target else 1)
    return {"MiB": count / 2**20, "GB/s": moved / min(times) / 1e9}


def large(day: Day) -> Row:
    """Two frames of it: the second finds what the first left."""
    side = 64 if day.quick else int((SHARE * free_memory(day.device)) ** (1 / 3))
    samples = np.zeros((side, side, side), np.uint8)
    samples[side // 4 : side // 2, side // 4 : side // 2] = 200
    samples.flags.writeable = False
    volume = wvr.Volume(samples)
    with rays_of(day.device):
        renderer = wvr.Renderer(volume, transfer_functions()["S1"], device=day.device)
        times = []
        for _ in range(2):
            start = perf_counter()
            image = renderer.render(wvr.Camera.fit(volume), (64, 64))
            times.append(perf_counter() - start)
    if not image.rgba[..., 3].any():
        raise AssertionError("nothing is seen of it")
    return {"samples along an axis": side, "GiB": side**3 / 2**30, "first [s]": times[0], "second [s]": times[1]}
