"""What a frame leaves on a device until a host asks for it, and what the host knows of it after one wait."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .keep import Keeper
from .kernels.settle import PIXELS, make_settle
from .launch import launch


class Rays(NamedTuple):
    """What is known of all rays of an image together.

    Attributes
    ----------
    samples
        Of all of them.
    over
        How many have a bound above the tolerance.
    bound
        The largest.
    """

    samples: int
    over: int = 0
    bound: float = 0.0

    @classmethod
    def of(cls, samples: NDArray[np.int32], bounds: NDArray[np.floating] | None, tolerance: float) -> Rays:
        """Of what a host has."""
        total = int(samples.sum(dtype=np.int64))
        if bounds is None:
            return cls(total)
        return cls(total, int(np.count_nonzero(bounds > tolerance)), float(bounds.max(initial=0.0)))


class Resident(NamedTuple):
    """Pixels of an image, (height, width) of vec4f or vec4d on their device, and the largest opacity of any."""

    array: wp.array
    most: float


def stays(device: wp.Device) -> bool:
    """Whether a device has memory that a host cannot read: what is there is brought when it is asked for."""
    return device.is_cuda


def fetched(keep: Keeper, *arrays: wp.array) -> list[NDArray]:
    """Arrays of a frame as NumPy's, after one wait for all that was launched: of a host their memory, of other devices
    copies, by page-locked memory that frames leave to one another.
    """
    device = keep.device
    if not stays(device):
        return [array.numpy() for array in arrays]
    staged = []
    for n, array in enumerate(arrays):
        staged.append(keep.scratch(f"fetched {n}", array.shape, array.dtype, host=True))
        wp.copy(staged[-1], array)
    wp.synchronize_device(device)
    return [array.numpy().copy() for array in staged]


def settled(
    keep: Keeper,
    rgba: wp.array,
    shown: type,
    samples: wp.array,
    bounds: wp.array | None,
    tolerance: float,
    *others: wp.array,
) -> tuple[Resident, Rays, list[NDArray]]:
    """An image that stays on its device, with pixels as ``shown``, what is known of its rays, and ``others`` as
    NumPy's, after one wait.
    """
    device = keep.device
    result = rgba if rgba.dtype is shown else wp.empty(rgba.shape, dtype=shown, device=device)
    most = keep.scratch("most", (2,), wp.float32)
    counts = keep.scratch("counts", (2,), wp.int64)
    most.zero_()
    counts.zero_()
    kernel = make_settle(rgba.dtype, shown, bounds is not None)
    given = samples if bounds is None else bounds
    launch(kernel, -(-rgba.size // PIXELS), [rgba, result, samples, given, tolerance, most, counts], device)
    (opacity, bound), (total, over), *found = fetched(keep, most, counts, *others)
    return Resident(result, float(opacity)), Rays(int(total), int(over), float(bound)), found
