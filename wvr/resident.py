"""What a frame leaves on a device until a host asks for it, and what the host has of a frame after one wait."""

from __future__ import annotations

from typing import NamedTuple

import warp as wp
from numpy.typing import NDArray

from .keep import Keeper
from .kernels.settle import make_settle
from .launch import launch


class Resident(NamedTuple):
    """Pixels of an image, (height, width) of vec4f or vec4d on their device, and the largest opacity of any."""

    array: wp.array
    most: float


def stays(device: wp.Device) -> bool:
    """Whether a device has memory that a host cannot read: what is there is brought when it is asked for."""
    return device.is_cuda


def buffer(keep: Keeper, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
    """An array that a frame writes and :func:`fetched` brings: where that copies it, one that frames leave to one
    another.
    """
    if stays(keep.device):
        return keep.scratch(name, shape, dtype)
    return wp.empty(shape, dtype=dtype, device=keep.device)


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


def settled(keep: Keeper, rgba: wp.array, shown: type) -> tuple[wp.array, wp.array]:
    """Pixels as ``shown``, and an array of the largest opacity of any, on their device."""
    result = rgba if rgba.dtype is shown else wp.empty(rgba.shape, dtype=shown, device=keep.device)
    most = keep.scratch("most", (1,), wp.float32)
    most.zero_()
    launch(make_settle(rgba.dtype, shown), rgba.size, [rgba, result, most], keep.device)
    return result, most
