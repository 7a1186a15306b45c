"""What an integrator is: it declares itself, and nobody else knows it.

Lengths are in units of the smallest voxel spacing.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..keep import Keeper, Part
from ..transfer.function import Transfer
from ..transfer_function import TransferFunction

if TYPE_CHECKING:
    from ..field.base import Field
    from ..frame import Frame
    from ..scene import Scene

# Transparency at which a ray ends, unless an integrator or a user says otherwise.
TERMINATION = 1 / 1024


class Integrator(ABC):
    """How the integral of a ray is approximated; subclasses are frozen dataclasses.

    The scene (:class:`wvr.scene.Scene`) is what an integrator may ask about everything else that is to be seen.
    """

    #: Whether its steps can be written down (:meth:`wvr.Image.trace`).
    traces: ClassVar[bool] = False
    #: Whether rays may begin and end with what there is to see; else they begin with the box.
    anywhere: ClassVar[bool] = False
    #: Whether cells, and not only blocks of them, are skipped.
    cells: ClassVar[bool] = False
    #: Whether light has whole segments to light, in the ways of ``Lighting.mode``.
    segments: ClassVar[bool] = False
    #: Whether a ray may be integrated brick by brick, each brick composed by ``over`` with those behind it.
    splits: ClassVar[bool] = False
    #: What it asks of a field's device half besides ``value`` and ``differences``: "cubic", "centered", "extent",
    #: "seek", "climb".
    asks: ClassVar[tuple[str, ...]] = ()
    #: Whether it looks for values and places along rays (``kernels.probe``), and does not march them.
    probes: ClassVar[bool] = False
    #: Whether what it finds are values, which colours and the bound are of.
    valued: ClassVar[bool] = False
    #: 1 where it looks for the largest value along rays, -1 for the smallest: parts that have none are never asked for.
    seeks: int = 0
    #: Whether it shows surfaces, which are lit by default; None where data say that.
    surfaces: ClassVar[bool | None] = None
    #: Ways of clipping that it has steps for, besides the exact one.
    clips: ClassVar[tuple[str, ...]] = ()

    #: A colour map, or a list of colours, over its ``domain`` where a call says nothing of colours.
    colors: Sequence[str] | str = "gray"

    @property
    @abstractmethod
    def order(self) -> float:
        """Order of convergence in the step on smooth integrands."""

    @property
    def shortest(self) -> float | None:
        """Its shortest regular step; None where steps are the cells'."""
        return None

    @property
    def unlit(self) -> str | None:
        """Why it cannot be lit, if so."""
        return None

    @abstractmethod
    def half(self, scene: Scene) -> Any:
        """The device half, as of ``kernels.scene.Halves``."""

    def numbers(self, scene: Scene, keep: Keeper) -> dict[str, Any]:
        """Fields of the half's struct that are numbers or arrays."""
        return {}

    def parts(self, scene: Scene) -> dict[str, Part]:
        """Fields of the half's struct that are kept."""
        return {}

    def function(self, scene: Scene, tf: TransferFunction) -> Part:
        """A transfer function as used: a struct of ``kernels.transfer.function``, or a tuple that ends with one."""
        return Transfer(tf, scene.unit, scene.shift, self.precision(scene), scene.material)

    def table(self, scene: Scene, tf: TransferFunction) -> Part | None:
        """The table that segments are looked up in, if they are."""
        return None

    def precision(self, scene: Scene) -> str:
        """Of everything along a ray but the sums."""
        return self.shown(scene)

    def shown(self, scene: Scene) -> str:
        """Precision of the image: what is asked for, or float32 if that is good enough."""
        return "float32" if scene.precision == "auto" else scene.precision

    def termination(self, scene: Scene) -> float:
        """Transparency at which a ray ends, where the user does not say."""
        return TERMINATION

    def kinds(self, scene: Scene) -> Part | None:
        """Which blocks it has something to see in, where transfer functions do not say that."""
        return None

    def strides(self, scene: Scene) -> bool:
        """Whether its rays go by ``wvr.field.blocks.Octants`` on a processor, and by no distances of empty blocks."""
        return False

    def sees(self, scene: Scene, ranges: NDArray[np.float64]) -> NDArray[np.bool_] | None:
        """Of parts of a volume with samples in ``ranges``, (n, 2), in which it has something to see, where transfer
        functions do not say that.
        """
        return None

    def domain(self, volume: Field) -> tuple[float, float] | None:
        """What colours are of where a call says nothing of them, of those that are of values; opacities are 1 then."""
        return None

    def framed(self, tf: TransferFunction) -> TransferFunction:
        """By what is opaque to a transfer function, what it shows: a camera that is not given frames that."""
        return tf

    def misses(self, low: float, high: float) -> str:
        """Why it finds nothing among scalars from low to high, and what to do; empty if it may find something."""
        return ""

    def reaching(self, opacity: float) -> Integrator:
        """Another, that finds where rays have an opacity."""
        from .reach import Reach

        return Reach(opacity)

    def check(self, scene: Scene) -> None:  # noqa: B027 - most have nothing to say
        """Say so where it cannot do what the scene asks for."""

    def spent(self, scene: Scene, keep: Keeper) -> dict[str, float]:
        """Of one with a bound, what rays of a brick count beside their pieces: fields of ``kernels.bricks.brick``."""
        return {}

    def sharing(self, scene: Scene) -> tuple[Integrator, float]:
        """One that leaves some of a tolerance for parts of a volume that are not read, and how much; none where there
        is none to leave.
        """
        return self, 0.0

    def report(self, frame: Frame) -> dict[str, Any]:
        """What it adds to the image's statistics."""
        return {}
