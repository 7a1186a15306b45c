"""Pre-integration tables that integrators look up, on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import warp as wp

from ..keep import Keeper, Part
from ..kernels.precision import REALS
from ..kernels.transfer.lookup import make_table
from ..kernels.transfer.preintegration import make_stretchable
from ..launch import launch
from ..transfer_function import TransferFunction
from .preintegration import generate, tables_of
from .running import Cut, vec4_array


@dataclass(frozen=True)
class Lookup(Part):
    """The struct of ``kernels.transfer.lookup``, for look-ups of scalars minus ``shift``.

    Of segments of ``length`` units, with extinction per ``unit`` of world length and n entries along each axis over the
    ``domain``. ``generator="stretchable"``: of mean emission and extinction, for segments of any length; colours are
    those of ``length``. With light three tables: of ambient colour and opacity, and the front- and back-weighted ones.
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
        colors = cut.colors(None)
        stretchable = self.generator == "stretchable"
        generator = "incremental" if stretchable else self.generator
        table = generate(colors, cut, self.length, generator, None, self.precision, device)[0]
        if stretchable:
            running = wp.array(cut.running(), dtype=wp.vec4d, device=device)
            inputs = [running, cut.pieces(colors, real, device).value, table]
            launch(make_stretchable(real), self.n**2, inputs, device, grain=self.n)
        return [table]
