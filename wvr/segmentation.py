"""Segmented volumes: a label for each sample, a transfer function for each label."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .transfer_function import TransferFunction
from .volume import Volume

DTYPES = ("uint8", "uint16")


class Segmentation:
    """A label for each sample of a volume, and what labels look like.

    Between samples the label at a point is the one with the largest trilinear weight, the sum of the weights of the
    eight samples around it that carry it: of two labels, the smooth surface where the trilinear interpolation of their
    indicator is 1/2. Rays are cut exactly there, whatever the integrator. Labels with equal transfer functions are one.

    Parameters
    ----------
    labels
        (nz, ny, nx), uint8 or uint16, the shape of the volume it is used with: an array, or a Volume, whose samples
        count and whose place in the world does not.
    transfer_functions
        By label. Labels that no sample has are allowed.
    other
        Transfer function of labels that are not named; None, the default, is transparent.

    Raises
    ------
    TypeError
        For labels of another dtype, or what is not a transfer function.
    ValueError
        For labels that are not three-dimensional or empty, a label that the dtype cannot hold, a label that is named
        without a transfer function, or none and no ``other``.
    """

    def __init__(
        self,
        labels: Any,
        transfer_functions: Mapping[int, TransferFunction],
        other: TransferFunction | None = None,
    ):
        array = labels.numpy() if hasattr(labels, "numpy") else np.asarray(labels)
        if array.dtype.newbyteorder("=").name not in DTYPES:
            raise TypeError(f"labels must be uint8 or uint16, got {array.dtype}; cast them with .astype('uint16')")
        self.labels = Volume(array)
        if not isinstance(transfer_functions, Mapping):
            raise TypeError(
                f"transfer_functions must be a dict from labels to transfer functions, got {transfer_functions!r}"
            )
        if other is not None and not isinstance(other, TransferFunction):
            raise TypeError(f"other must be a TransferFunction or None, got {other!r}")
        most = np.iinfo(self.labels.dtype).max
        for label, tf in transfer_functions.items():
            if not isinstance(label, int | np.integer) or isinstance(label, bool) or not 0 <= label <= most:
                raise ValueError(
                    f"transfer_functions must be by label, an integer from 0 to {most} for {self.labels.dtype}, "
                    f"got {label!r}"
                )
            if tf is None:
                raise ValueError(
                    f"transfer_functions must have a transfer function for each label, got None for {label}; labels "
                    f"that are not named have that of other, and are transparent without one"
                )
            if not isinstance(tf, TransferFunction):
                raise TypeError(f"transfer_functions[{label}] must be a TransferFunction, got {tf!r}")
        if not transfer_functions and other is None:
            raise ValueError("transfer_functions must name a label, or other be given: nothing would be visible")
        self.transfer_functions = {int(label): tf for label, tf in transfer_functions.items()}
        self.other = other

    @cached_property
    def states(self) -> tuple[list[TransferFunction], NDArray[np.unsignedinteger]]:
        """The different transfer functions, and the index of each label's own; one past the last is transparent."""
        number = np.iinfo(self.labels.dtype).max + 1
        functions: dict[bytes, TransferFunction] = {tf.key: tf for tf in self.transfer_functions.values()}
        if self.other is not None and len(self.transfer_functions) < number:
            functions.setdefault(self.other.key, self.other)
        index = {key: i for i, key in enumerate(functions)}
        rest = len(functions) if self.other is None else index.get(self.other.key, len(functions))
        states = np.full(number, rest)
        for label, tf in self.transfer_functions.items():
            states[label] = index[tf.key]
        return list(functions.values()), states.astype("uint8" if states.max() < 256 else "uint16")

    def __repr__(self) -> str:
        nz, ny, nx = self.labels.shape
        return f"Segmentation({nx} x {ny} x {nz} {self.labels.dtype}, {len(self.transfer_functions)} labels)"
