"""A cheap checksum of an array's memory, to notice that somebody wrote into it: 0.1 ms a megabyte."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

# Words go into so many sums by turns. Primes, of which one divides none of an array's axes: rows or planes that change
# places are noticed.
SUMS = (4093, 4091, 4079, 4073)


def checksum(data: Any) -> bytes:
    """Of a C-contiguous NumPy or Warp array, of three axes at most; on a device, of all that anybody's stream there was
    asked for before.
    """
    number = next(prime for prime in SUMS if all(n % prime for n in data.shape))
    if isinstance(data, np.ndarray):
        content = data.reshape(-1).view(np.uint8)
        words = content[: content.size // 8 * 8].view(np.uint64)
        rows = len(words) // number
        sums = np.add.reduce(words[: rows * number].reshape(rows, number), axis=0)
        return sums.tobytes() + words[rows * number :].tobytes() + content[content.size // 8 * 8 :].tobytes()
    wp.synchronize_device(data.device)
    # GPUs read words from multiples of their size alone, where samples of one byte need not begin.
    before = min(-data.ptr % 8, data.capacity)
    words = wp.array(ptr=data.ptr + before, dtype=wp.uint64, shape=(data.capacity - before) // 8, device=data.device)
    behind = before + 8 * words.size
    first, last = (
        wp.array(ptr=data.ptr + start, dtype=wp.uint8, shape=end - start, device=data.device)
        for start, end in ((0, before), (behind, data.capacity))
    )
    sums = wp.empty(number + 1, dtype=wp.uint64, device=data.device)
    wp.launch(_sum, number + 1, [words, first, last, sums], device=data.device)
    return sums.numpy().tobytes()


@wp.kernel(enable_backward=False)
def _sum(
    words: wp.array(dtype=wp.uint64),  # type: ignore[valid-type]
    first: wp.array(dtype=wp.uint8),  # type: ignore[valid-type]
    last: wp.array(dtype=wp.uint8),  # type: ignore[valid-type]
    sums: wp.array(dtype=wp.uint64),  # type: ignore[valid-type]
):
    """The last item has the bytes before and behind the words, so that all comes with one copy."""
    n = wp.tid()
    many = sums.shape[0]
    total = wp.uint64(0)
    if n + 1 < many:  # type: ignore[operator]
        for i in range(n, words.shape[0], many - 1):  # type: ignore[arg-type]
            total += words[i]
    else:
        for j in range(first.shape[0]):
            # An odd number takes no byte out of the word.
            total = total * wp.uint64(257) + wp.uint64(first[j])
        for j in range(last.shape[0]):
            total = total * wp.uint64(257) + wp.uint64(last[j])
    sums[n] = total
