"""Pictures of a state: coarse ones, and those that a still would be."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..image import Image
from ..integrators import Certified, Preintegrated
from ..light.shadows import ConvolutionShadows
from ..renderer import Renderer
from ..validation import at_most
from .marks import marked
from .pace import Pace, shrunk
from .state import Presentation, Source, State

# Of coarse pictures [smallest voxel spacings]: however thin, nothing of the transfer function is missed.
STEP = 2.0
# Coarse shadows have slices so many times as far apart, and cells of light so wide.
SLICES, CELL = 4.0, 8.0


class Stage(NamedTuple):
    """A picture with one pixel for each ``divisor`` by ``divisor`` of the final one, coarsely integrated or not."""

    divisor: int
    coarse: bool


@dataclass(frozen=True, eq=False)
class Picture:
    """What is seen of a state.

    Attributes
    ----------
    pixels
        sRGB, uint8 (height, width, 3).
    image
        The image that it is of.
    whole
        Whether it is the last one: all pixels, integrated as asked for.
    tolerance
        That its error shall be within; None where nothing is said of errors.
    """

    pixels: NDArray[np.uint8]
    image: Image
    state: State
    whole: bool
    tolerance: float | None

    @property
    def status(self) -> str:
        """How many pixels, how wrong they are at most, and whether that is what was asked for."""
        width, height = self.image.size
        size = self.state.presentation.size
        of = "" if self.image.size == size else f" of {size[0]} × {size[1]}"
        return f"{width} × {height}{of} pixels, {self.accuracy}"

    @property
    def accuracy(self) -> str:
        """What is known of its error."""
        image = self.image
        if image.error_bound is None:
            return "error not bounded" if self.whole else "error not bounded yet"
        bound = image.max_error
        light = self.state.presentation.lights()
        but = ", but for light" if any(light) else ""
        text = f"error ≤ {at_most(bound)}{but}"
        if not self.whole or self.tolerance is None:
            return text
        return f"{text}, {'within' if self.met else 'not within'} the tolerance {self.tolerance:.3g}"

    @property
    def met(self) -> bool:
        """Whether all pixels are there, with errors within the tolerance."""
        return self.whole and self.tolerance is not None and self.image.max_error <= self.tolerance


class Painter:
    """Renders a source's states.

    Coarse pictures have a renderer of their own, so that neither makes the other build its parts anew.
    """

    def __init__(self, source: Source, pace: Pace | None = None):
        self.source = source
        self.pace = Pace() if pace is None else pace
        volume, tf = source.first_volume, source.first.transfer_function
        segmentation, background = source.segmentation, source.background
        self._fine = Renderer(volume, tf, segmentation=segmentation, background=background, **source.options)
        self._coarse = Renderer(volume, tf, segmentation=segmentation, background=background, **source.options)
        self._last: tuple[Presentation, Image] | None = None
        self.tolerance: float | None = None
        if isinstance(self._fine.integrator, Certified):
            self.tolerance = self._fine.integrator.tolerance
            self._coarse.integrator = Preintegrated(STEP)

    def stages(self, state: State) -> list[Stage]:
        if self._last is not None and self._last[0] == state.presentation:
            return [Stage(1, False)]
        size = state.presentation.size
        return [Stage(self.pace.first(size), True), *(Stage(k, False) for k in self.pace.refinements(size))]

    def paint(self, state: State, stage: Stage, cancel: threading.Event) -> Picture:
        whole = stage == Stage(1, False)
        image = self._image(state.presentation, stage, cancel, whole)
        tolerance = self.tolerance
        return Picture(marked(image, state, tolerance), image, state, whole, tolerance)

    def _image(self, presentation: Presentation, stage: Stage, cancel: threading.Event, whole: bool) -> Image:
        if whole and self._last is not None and self._last[0] == presentation:
            return self._last[1]
        renderer = self._coarse if stage.coarse else self._fine
        renderer.volume = self.source.volume(presentation.frame)
        renderer.transfer_function = presentation.transfer_function
        renderer.clip = presentation.clips
        renderer.lighting, shadows = presentation.lights()
        renderer.shadows = coarser(shadows) if stage.coarse else shadows
        size = shrunk(presentation.size, stage.divisor)
        start = perf_counter()
        image = renderer.render(presentation.camera, size, cancel)
        self.pace.took(perf_counter() - start, size[0] * size[1], stage.coarse)
        if whole:
            self._last = presentation, image
        return image


def coarser(shadows: ConvolutionShadows | None) -> ConvolutionShadows | None:
    """Shadows that take a fraction of the time, and converge to the same."""
    if shadows is None or shadows.alone or shadows.kernel == "fixed":
        return shadows
    return replace(shadows, slice_distance=SLICES * shadows.slice_distance, cell=max(CELL, shadows.cell_width))
