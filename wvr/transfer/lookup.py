"""Pre-integration tables that integrators look up, on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import warp as wp

from ..keep import Keeper, Part
from ..kernels.precision import REALS, vec4_of
from ..kernels.transfer.lookup import make_table
from ..kernels.transfer.preintegration import make_stretchable
from ..launch import launch
from ..transfer_function import TransferFunction
from .function import transfer_values
from .preintegration import generate, tables_of
from .running import Cut, jumps_of, vec4_array


def apart(tf: TransferFunction, domain: tuple[float, float]) -> tuple[float, float]:
    """The domain or, where its scalars are so near to each other that rounding is seen between entries of a table, a
    wider one around it, of 2**-25 of their size: if no more than a kink of the transfer function is in that, which is
    as good as linear there.
    """
    low, high = domain
    middle, half = 0.5 * (low + high), 2.0**-26 * max(-low, high)
    inside = np.count_nonzero(np.abs(tf.knots - middle) <= half)
    return domain if high - low >= 2 * half or inside > 1 else (middle - half, middle + half)


def on_jumps(tf: TransferFunction, n: int, domain: tuple[float, float]) -> tuple[int, tuple[float, float]]:
    """Entries, n or up to twice as many, and a domain that has the given one in it: such that a jump of the transfer
    function is at an entry, and so are two that are half an entry apart or farther; of more, all are as near to entries
    as can be, if there are not more than entries. Where a field is at a jump, an entry beside it is wrong however short
    the segments are.
    """
    low, high = domain
    jumps = jumps_of(tf, domain)
    if not 0 < jumps.size <= n:
        return n, domain
    first, last = float(jumps[0]), float(jumps[-1])
    step = (high - low) / (n - 1)
    counts = np.arange(max(np.ceil((last - first) / step), 1), np.floor(2 * (last - first) / step) + 1)
    if last > first and counts.size:
        places = (jumps - first) / (last - first) * counts[:, None]
        step = (last - first) / float(counts[np.argmin(np.round(np.abs(places - np.rint(places)).max(axis=1), 6))])
    before, after = (int(np.ceil(x / step - 1e-9)) for x in (first - low, high - first))
    # The last may be the largest sample, which rounding must not put behind the table's end.
    return before + after + 1, (first - before * step, max(first + after * step, last))


@dataclass(frozen=True)
class Lookup(Part):
    """The struct of ``kernels.transfer.lookup``, for look-ups of scalars minus ``shift``.

    Of segments of ``length`` units, with extinction per ``unit`` of world length and n entries along each axis over the
    ``domain``. With light three tables: of ambient colour and opacity, and the front- and back-weighted ones.
    """

    function: TransferFunction
    unit: float
    length: float
    n: int
    domain: tuple[float, float]
    generator: str
    shift: float
    precision: str
    lit: bool
    name: ClassVar[str] = "table"

    def build(self, keep: Keeper) -> Any:
        low, high = self.domain
        Table, _ = make_table(REALS[self.precision])
        table = Table()
        for name, entries in zip(("rgba", "front", "back"), self._tables(keep.device), strict=False):
            setattr(table, name, entries)
        table.low = low - self.shift
        table.scale = (self.n - 1) / (high - low)
        return table

    def _tables(self, device: wp.Device) -> list[wp.array]:
        real = REALS[self.precision]
        cut = Cut(self.function, self.n, self.domain, self.unit)
        if self.lit:
            tables = tables_of(self.function, cut, self.length, self.generator, "lighting", self.precision, device)
            ambient = tables.get("ambient", tables["rgba"])
            return [vec4_array(table, real, device) for table in (ambient, tables["front"], tables["back"])]
        return [generate(cut.colors(None), cut, self.length, self.generator, None, self.precision, device)[0]]


# Layers of a table of all lengths, of which the shortest are for segments that are hardly dense, if there are enough.
LAYERS = 8
HARDLY = 0.25


@dataclass(frozen=True)
class Stretchable(Part):
    """The same of mean emission and extinction, for segments of any length: layers of lengths, one behind the other
    along the first axis, from the ``longest`` on each half as long as the one before, ``most`` of them.
    """

    function: TransferFunction
    unit: float
    longest: float
    n: int
    domain: tuple[float, float]
    shift: float
    precision: str
    most: int = LAYERS
    name: ClassVar[str] = "table"

    def build(self, keep: Keeper) -> Any:
        low, high = self.domain
        real, n = REALS[self.precision], self.n
        cut = Cut(self.function, n, self.domain, self.unit)
        colors, running = cut.colors(None), wp.array(cut.running(), dtype=wp.vec4d, device=keep.device)
        layers = keep.empty((self.layers * n, n), vec4_of(real))
        for k in range(self.layers):
            layer = layers[k * n : (k + 1) * n]
            generated = generate(colors, cut, self.longest / 2**k, "incremental", None, self.precision, keep.device)[0]
            inputs = [running, cut.pieces(colors, real, keep.device).value, generated, layer]
            launch(make_stretchable(real), n**2, inputs, keep.device, grain=n)
        Table, _ = make_table(real)
        table = Table()
        table.rgba = layers
        table.low = low - self.shift
        table.scale = (n - 1) / (high - low)
        return table

    @property
    def layers(self) -> int:
        """As many as there are lengths of which the densest segment is more than hardly dense, and one."""
        depth = float(transfer_values(self.function, self.unit)[:, 3].max()) * self.longest
        return int(np.clip(np.ceil(np.log2(max(depth / HARDLY, 1.0))) + 1, 1, self.most))
