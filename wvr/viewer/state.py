"""What a viewer shows: a presentation that users change piece by piece, and what is drawn over its picture."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..cached import cached_property
from ..camera import Camera
from ..color import is_clear
from ..cuts.base import Clip, clip_list
from ..defaults import Call, lighting_of, shadows_of, studio
from ..integrators import Projection
from ..launch import get_device
from ..light.lighting import Lighting
from ..light.lights import DirectionalLight
from ..light.shadows import ConvolutionShadows
from ..presets import suggest
from ..renderer import Renderer
from ..sources import as_volume
from ..transfer_function import TransferFunction
from ..volume import Volume
from .clips import DEFAULTS, Settings
from .histogram import histogram

if TYPE_CHECKING:
    from ..defaults import LightingLike

# Behind a volume where nothing is said of a background: a screen has something there.
BACKGROUND = "black"
# The size before anybody looks.
UNSEEN = (1, 1)
# Pixels at most that a viewer renders, whatever a screen asks for.
MOST_PIXELS = 1 << 24


@dataclass(frozen=True)
class Presentation:
    """What is rendered, as its user left it.

    Attributes
    ----------
    size
        (width, height) in pixels.
    frame
        Which of the volumes.
    lighting, shadows
        As of :func:`wvr.render`: True is light at the upper left of the camera, wherever that goes.
    lamp
        Where the first light is instead, seen from the camera's way to the target: degrees to the right, and upwards.
    clips
        Those given from the start, and those of the viewer.
    """

    camera: Camera
    transfer_function: TransferFunction | None
    size: tuple[int, int] = UNSEEN
    frame: int = 0
    lighting: LightingLike = False
    shadows: ConvolutionShadows | bool | None = None
    lamp: tuple[float, float] | None = None
    clips: tuple[Clip, ...] = ()

    def lights(self) -> tuple[Lighting | None, ConvolutionShadows | None]:
        """Lighting and shadows for the camera as it is."""
        lighting = lighting_of(self.lighting, False, self.camera)
        # Where nothing is lit, light casts shadows all the same, and that is moved.
        shining = studio(self.camera) if lighting is None else lighting
        if self.lamp is not None and shining.lights:
            first, *others = shining.lights
            lamp = DirectionalLight(towards(self.lamp, self.camera), first.color)
            shining = replace(shining, light=(lamp, *others))
        return None if lighting is None else shining, shadows_of(self.shadows, shining, self.camera)


@dataclass(frozen=True)
class State:
    """A presentation, and what is drawn over its picture: the bound on its error, the edges of the box, and handles.

    Attributes
    ----------
    cuts
        The settings of the presentation's clips that are the viewer's.
    anchor
        While a handle is held: the handles of the plane are where this is nearest to the plane.
    """

    presentation: Presentation
    bound: bool = False
    outline: bool = False
    cuts: Settings = field(default_factory=lambda: DEFAULTS)
    anchor: tuple[float, ...] | None = None


def towards(lamp: tuple[float, float], camera: Camera) -> tuple[float, ...]:
    """The direction to a light so many degrees to the right of the camera and above it, as the target sees them."""
    right, up, forward = camera.basis()
    azimuth, elevation = np.radians(lamp)
    level = -np.cos(azimuth) * forward + np.sin(azimuth) * right
    return tuple((np.cos(elevation) * level + np.sin(elevation) * up).tolist())


def lamp_of(lighting: Lighting | None, camera: Camera) -> tuple[float, float]:
    """Where the first light is, as of :func:`towards`."""
    right, up, forward = camera.basis()
    lights = () if lighting is None else lighting.lights
    direction = np.array(lights[0].vector) if lights and any(lights[0].vector) else -forward
    azimuth = np.degrees(np.arctan2(direction @ right, -direction @ forward))
    return float(azimuth), float(np.degrees(np.arcsin(np.clip(direction @ up, -1, 1))))


@dataclass
class Source:
    """What a viewer was opened with: volumes, and a call of :func:`wvr.render`.

    Attributes
    ----------
    given_volumes
        What stands for the volumes: files are read when their turn comes.
    options
        Of a :class:`wvr.Renderer`, but for what a presentation says.
    first
        The presentation that every client starts with.
    """

    given_volumes: Sequence[Any]
    call: Call
    options: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._reading = threading.Lock()
        self._other: tuple[int, Any] = 0, None
        self.first_volume: Any = as_volume(self.given_volumes[0])
        # Says what it does not accept before anybody looks.
        Renderer(self.first_volume, None, **self.options)
        get_device(self.options.get("device"))
        look = self.call.look(self.first_volume, (512, 512))
        self.segmentation = look.segmentation
        self.background = BACKGROUND if is_clear(look.background) else look.background
        given = self.call.lighting
        lighting = given if given is not None else look.lighting is not None
        shadows = self.call.shadows
        self.clips = clip_list(self.call.clip)
        # With labels, a transfer function is not used but by what has the colour of none of them.
        method = self.call.integrator
        alone = self.segmentation is None or (isinstance(method, Projection) and not method.seeks)
        function = look.transfer_function if alone else None
        self.first = Presentation(look.camera, function, lighting=lighting, shadows=shadows, clips=self.clips)

    def given(self, frame: int) -> Any:
        """What stands for the volume of a frame."""
        return self.given_volumes[frame]

    def volume(self, frame: int) -> Any:
        """The volume of a frame; the last one asked for, and the first, are kept."""
        with self._reading:
            if frame != 0 and self._other[0] != frame:
                self._other = frame, as_volume(self.given_volumes[frame])
            return self.first_volume if frame == 0 else self._other[1]

    def loaded(self, frame: int) -> Any:
        """The volume of a frame if it is there, else None."""
        return self.first_volume if frame == 0 else self._other[1] if self._other[0] == frame else None

    @property
    def framed(self) -> bool:
        """Whether all that is visible shall be in the frame: no place of the camera was given."""
        given: Any = self.call.camera
        return given is None or isinstance(given, str) or np.shape(given) == (3,)

    @cached_property
    def suggestions(self) -> dict[str, TransferFunction]:
        """Transfer functions by name that suit the first volume; none of a field, of labels or of one value."""
        if self.first.transfer_function is None or not isinstance(self.first_volume, Volume):
            return {}
        try:
            return suggest(self.first_volume)
        except ValueError:
            return {}

    @cached_property
    def histogram(self) -> tuple[NDArray[np.float64], tuple[float, float]]:
        """That of the first volume."""
        return histogram(self.first_volume)

    @property
    def title(self) -> str:
        """What to call it."""
        files = getattr(self.first_volume, "files", ())
        return files[0].name if files else type(self.first_volume).__name__.lower()
