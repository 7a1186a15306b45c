"""A field that is a formula: the signal of Marschner and Lobb (1994), without samples.

    s(x, y, z) = (1 - sin(pi z / 2) + a (1 + cos(2 pi f cos(pi r / 2)))) / (2 (1 + a)),  r^2 = x^2 + y^2,

on the cube from -1 to 1.
"""

from dataclasses import dataclass
from functools import cache
from math import pi

import numpy as np
import warp as wp

from wvr.field.base import Field
from wvr.kernels.precision import vec3_of


@wp.struct
class Signal:
    last: wp.vec3i  # the last cell along x, y, z
    cell: wp.float64  # width of a cell
    frequency: wp.float64
    alpha: wp.float64


@cache
def make_value(real):
    """``value(field, p)`` at index coordinates p."""
    vec3 = vec3_of(real)

    @wp.func
    def value(field: Signal, p: vec3):
        cell, a, turn = real(field.cell), real(field.alpha), real(wp.static(pi / 2.0))
        x, y, z = cell * p[0] - real(1.0), cell * p[1] - real(1.0), cell * p[2] - real(1.0)
        wave = wp.cos(real(4.0) * turn * real(field.frequency) * wp.cos(turn * wp.sqrt(x * x + y * y)))
        return (real(1.0) - wp.sin(turn * z) + a * (real(1.0) + wave)) / (real(2.0) * (real(1.0) + a))

    return value


@cache
def make_differences(real):
    """``differences(field, p)``: its gradient, per index."""
    vec3 = vec3_of(real)

    @wp.func
    def differences(field: Signal, p: vec3):
        cell, a, turn = real(field.cell), real(field.alpha), real(wp.static(pi / 2.0))
        x, y, z = cell * p[0] - real(1.0), cell * p[1] - real(1.0), cell * p[2] - real(1.0)
        r = wp.sqrt(x * x + y * y)
        slope = real(0.0)  # of the wave along r, over r
        if r > real(0.0):
            rate = real(4.0) * turn * real(field.frequency)
            slope = a * wp.sin(rate * wp.cos(turn * r)) * rate * turn * wp.sin(turn * r) / r
        return cell / (real(2.0) * (real(1.0) + a)) * vec3(slope * x, slope * y, -turn * wp.cos(turn * z))

    return differences


@dataclass(frozen=True)
class Half:
    """The device half."""

    finite = True
    Struct = Signal

    def value(self, real):
        return make_value(real)

    def differences(self, real, kind):
        return make_differences(real)


@dataclass(frozen=True)
class MarschnerLobb(Field):
    """The signal of a ``frequency`` f and an amplitude ``alpha``; ``nodes`` along each axis set the unit of steps."""

    nodes: int = 41
    frequency: float = 6.0
    alpha: float = 0.25

    @property
    def shape(self):
        return (self.nodes,) * 3

    @property
    def index_to_world(self):
        cell = 2 / (self.nodes - 1)
        return np.array([[cell, 0, 0, -1], [0, cell, 0, -1], [0, 0, cell, -1], [0, 0, 0, 1]])

    @property
    def range(self):
        return 0.0, 1.0

    @property
    def half(self):
        return Half()

    def struct(self, keep, shift):
        signal = Signal()
        signal.last = wp.vec3i(*(n - 2 for n in self.shape))
        signal.cell, signal.frequency, signal.alpha = 2 / (self.nodes - 1), self.frequency, self.alpha
        return signal
