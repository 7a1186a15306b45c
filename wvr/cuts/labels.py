"""Segmented volumes: a label for each sample, a transfer function for each label."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..color import linear_rgb
from ..copied import Copied
from ..field.base import Field
from ..field.blocks import Ranges, Seen, seen_of, spread
from ..field.samples import Data, samples_struct
from ..io.coordinates import spatial
from ..keep import Keeper, Part
from ..kernels.cuts.labels import MIXED, make_label_kinds, make_labels
from ..kernels.field.blocks import Blocks
from ..kernels.transfer.function import make_transfer
from ..kernels.transfer.lookup import make_table
from ..launch import launch
from ..pose import Fixed
from ..suggest import label_colors
from ..transfer.function import struct_of
from ..transfer_function import TransferFunction
from ..validation import any_array
from ..volume import Volume

if TYPE_CHECKING:
    from ..scene import Scene

DTYPES = ("uint8", "uint16")


class Stated(NamedTuple):
    """What labels come to: labels with equal transfer functions are one state."""

    functions: list[TransferFunction]  # of the states
    of_label: NDArray[np.unsignedinteger]  # the state of each label; one past the last is transparent


class Segmentation(Fixed):
    """A label for each sample of a volume, and what labels look like.

    Between samples the label at a point is the one with the largest trilinear weight, the sum of the weights of the
    eight samples around it that carry it: of two labels, the smooth surface where the trilinear interpolation of their
    indicator is 1/2. Rays are cut exactly there, whatever the integrator. Labels with equal transfer functions are one.

    Parameters
    ----------
    labels
        (nz, ny, nx), whole numbers from 0 to 65535 of any integer dtype, or bool, the shape of the volume it is used
        with: an array, of xarray in any order of its dimensions x, y, z, or a Volume, whose samples count and whose
        place in the world does not.
    transfer_functions
        By label. Labels that no sample has are allowed.
    other
        Transfer function of labels that are not named; None, the default, is transparent.

    Raises
    ------
    TypeError
        For labels of another dtype, or what is not a transfer function.
    ValueError
        For labels that are not three-dimensional, empty or out of range, a label that the dtype cannot hold, a label
        that is named without a transfer function, or none and no ``other``.
    """

    fixed = ("labels", "other")

    def __init__(
        self,
        labels: Any,
        transfer_functions: Mapping[int, TransferFunction],
        other: TransferFunction | None = None,
    ):
        self.labels = _labels(labels)
        self._stated: Stated | None = None
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
        self._functions = {int(label): tf for label, tf in transfer_functions.items()}
        self.other = other

    @classmethod
    def colored(cls, labels: Any, transfer_function: TransferFunction) -> Segmentation:
        """Each label in a colour of its own, with the opacity of a transfer function; 0 is nothing."""
        volume = _labels(labels)
        values = [int(value) for value in np.unique(volume.host()) if value > 0]
        if not values:
            raise ValueError("labels must have one besides 0, which is nothing")
        knots, opacities = transfer_function.knots, transfer_function.opacities
        functions = {
            value: TransferFunction.from_arrays(
                knots,
                np.tile(linear_rgb(color), (len(knots), 1)),
                opacities,
                transfer_function.unit_distance,
                **transfer_function.materials(),
            )
            for value, color in zip(values, label_colors(len(values)), strict=True)
        }
        return cls(volume, functions)

    @property
    def transfer_functions(self) -> Mapping[int, TransferFunction]:
        """By label, to read: of others another segmentation is made."""
        return MappingProxyType(self._functions)

    @property
    def states(self) -> Stated:
        """The different transfer functions, and which of them each label has."""
        number = np.iinfo(self.labels.dtype).max + 1
        # What is written into labels may take the wider dtype.
        if self._stated is None or len(self._stated.of_label) != number:
            self._stated = self._states_of(number)
        return self._stated

    def _states_of(self, number: int) -> Stated:
        """Of so many labels."""
        functions: dict[bytes, TransferFunction] = {tf.key: tf for tf in self.transfer_functions.values()}
        if self.other is not None and len(self.transfer_functions) < number:
            functions.setdefault(self.other.key, self.other)
        # In an order of their own: of two that weigh the same the first is there, whatever labels are called.
        functions = dict(sorted(functions.items(), key=lambda item: (item[1].colors.tobytes(), item[0])))
        index = {key: i for i, key in enumerate(functions)}
        rest = len(functions) if self.other is None else index.get(self.other.key, len(functions))
        states = np.full(number, rest)
        for label, tf in self.transfer_functions.items():
            states[label] = index[tf.key]
        return Stated(list(functions.values()), states.astype("uint8" if states.max() < 256 else "uint16"))

    def scaled(self, exponent: int) -> Segmentation:
        """The same for scalars times ``2**exponent``."""
        functions = {label: tf.scaled(exponent) for label, tf in self.transfer_functions.items()}
        return Segmentation(self.labels, functions, None if self.other is None else self.other.scaled(exponent))

    def for_volume(self, volume: Field) -> Segmentation:
        """The same with lengths for unit distances that a volume says, as of ``TransferFunction.for_volume``."""
        functions = {label: tf.for_volume(volume) for label, tf in self.transfer_functions.items()}
        other = None if self.other is None else self.other.for_volume(volume)
        same = functions == self.transfer_functions and other == self.other
        return self if same else Segmentation(self.labels, functions, other)

    def check(self, scene: Scene) -> None:
        """Say so where the labels are not those of the scene's volume."""
        if self.labels.shape != scene.volume.shape:
            raise ValueError(
                f"segmentation must have labels of the volume's shape {scene.volume.shape}, got {self.labels.shape}"
            )

    def __repr__(self) -> str:
        nz, ny, nx = self.labels.shape
        return f"Segmentation({nx} x {ny} x {nz} {self.labels.dtype}, {len(self.transfer_functions)} labels)"


def _labels(given: Any) -> Volume:
    """A volume of unsigned labels; what is written into an array of another dtype is seen later on."""
    if isinstance(given, Volume) and given.dtype.name in DTYPES:
        return given
    if isinstance(given, str | PathLike) or getattr(given, "stored", False):
        raise TypeError(f"labels must be an array or a Volume in memory, as wvr.read makes of a file, got {given!r}")
    if hasattr(given, "dims") and hasattr(given, "transpose") and getattr(given, "ndim", 0) == 3:
        # Of xarray, by the names of its axes, as volumes are.
        given = given.transpose(*(given.dims[axis] for axis in spatial([str(dim) for dim in given.dims])))
    array = given.numpy() if hasattr(given, "numpy") else any_array(given, "labels")
    labels = Volume(_unsigned(array))
    shared = array.dtype.newbyteorder("=").name in DTYPES
    return labels if shared else labels.copied(Copied.of(array, lambda owner: owner, _unsigned))


def _unsigned(labels: NDArray) -> NDArray:
    """In the smaller dtype that holds them, as they are where they have one of the two."""
    if labels.dtype.newbyteorder("=").name in DTYPES:
        return labels
    if labels.dtype.kind not in "biu":
        raise TypeError(f"labels must be whole numbers of an integer dtype, got {labels.dtype}")
    low, high = (int(labels.min()), int(labels.max())) if labels.size else (0, 0)
    if low < 0 or high > 65535:
        raise ValueError(f"labels must be from 0 to 65535, got {low} to {high}")
    return labels.astype("uint8" if high < 256 else "uint16")


@dataclass(frozen=True)
class States(Part):
    """The state of each sample, on the device; ``of_label`` are the bytes of ``Stated.of_label``.

    Not of a segmentation: each frame may make another of the same labels (``for_volume``, ``scaled``).
    """

    labels: Data
    of_label: bytes
    dtype: str
    name: ClassVar[str] = "labels"

    @classmethod
    def of(cls, segmentation: Segmentation) -> States:
        of_label = segmentation.states.of_label
        return cls(segmentation.labels.part(), of_label.tobytes(), of_label.dtype.name)

    def build(self, keep: Keeper) -> wp.array:
        of_label = np.frombuffer(self.of_label, self.dtype)
        return Volume(of_label[self.labels.volume.host()]).on(keep.device)


@dataclass(frozen=True)
class LabelKinds(Part):
    """``Seen`` of a field by the transfer functions of labels, and which states its blocks hold."""

    field: Field
    ranges: Ranges
    states: States
    functions: tuple[Part, ...]
    shift: float
    skip: bool
    name: ClassVar[str] = "kinds"

    def build(self, keep: Keeper) -> Seen:
        data, states, ranges = keep(self.ranges.data), keep(self.states), keep(self.ranges)
        transfers = [struct_of(keep(function)) for function in self.functions]
        kinds, masks = keep.empty(ranges.shape, wp.int16), keep.empty(ranges.shape, wp.uint64)
        held = keep.empty(ranges.shape, int)
        struct = Blocks()
        struct.kinds, struct.masks = kinds, masks
        inputs = [
            samples_struct(data, self.shift),
            samples_struct(states),
            ranges,
            wp.array(transfers, dtype=make_transfer(wp.float64)[0], device=keep.device),
            self.skip,
            struct,
            held,
        ]
        launch(make_label_kinds(self.field.half, states.dtype), kinds.size, inputs, keep.device)
        found = spread(kinds.numpy())
        kinds.assign(found)
        return seen_of(self.field, kinds, masks, found)._replace(held=held)


def label_struct(
    segmentation: Segmentation, seen: Seen, transfers: list[Any], tables: list[Any], halves: Any, keep: Keeper
) -> Any:
    """The struct of labels for kernels of these ``halves``, with the transfer functions and tables of the states."""
    struct = make_labels(halves.cuts.labels, halves.real)()
    struct.states = samples_struct(keep(States.of(segmentation)))
    # Where nothing is known of blocks, cells are looked at.
    struct.blocks = wp.full(seen.kinds.shape, int(MIXED), int, keep.device) if seen.held is None else seen.held
    struct.transfers = wp.array(transfers, dtype=make_transfer(halves.real)[0], device=keep.device)
    if tables:
        struct.tables = wp.array(tables, dtype=make_table(halves.real)[0], device=keep.device)
    return struct
