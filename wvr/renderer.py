"""Rendering: a renderer that keeps what can be kept, and the one function for a single image."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from threading import Event
from typing import TYPE_CHECKING, Any, NoReturn, overload

from .advice import advise
from .bricks.frame import BrickedFrame
from .bricks.reading import Missing, Reading
from .bricks.store import BrickStore
from .camera import Camera, image_size
from .cancel import Cancelled, Lock, cancelling
from .colormaps import Opacity
from .cuts.base import Clip, clip_list
from .cuts.labels import Segmentation
from .defaults import Call
from .field.base import Field
from .frame import Frame, ends_of
from .image import BoundedImage, Image
from .integrators import Bounding, Integrator, of_tolerance
from .keep import Keeper
from .keywords import MovieOptions, refuse
from .launch import get_device, reporting
from .light.lighting import Lighting
from .light.shadows import ConvolutionShadows
from .scene import Precision, Scene
from .sources import as_volume
from .transfer_function import TransferFunction
from .validation import near

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .defaults import CameraLike, Function, LightingLike, SegmentationLike
    from .keywords import Options

# Less than an 8-bit grey level.
TOLERANCE = 1 / 512
# What of a Renderer is assigned.
ATTRIBUTES = (
    "volume", "transfer_function", "integrator", "tolerance", "lighting", "shadows", "precision", "device",
    "termination", "background", "skip_empty", "clip", "segmentation",
)  # fmt: skip


class Renderer:
    """A volume and how to render it; keeps what can be kept between frames.

    Assign ``volume``, ``transfer_function``, ``integrator`` and so on; what depends on them, and nothing else, is
    rebuilt with the next frame. A new camera or size rebuilds nothing.

    Parameters
    ----------
    volume, transfer_function
        What to render; with a segmentation a transfer function is not used.
    integrator, tolerance
        One of them; by default the tolerance is 1/512. See :func:`render`.
    lighting
        Light on what is emitted; by default none.
    shadows
        Light that travels; by default none.
    precision
        ``"float32"``, ``"float64"`` or ``"auto"``; see :func:`render`.
    device
        Warp device; by default CUDA where there is one, else the CPU.
    termination
        A ray ends when less than this transparency is left, in [0, 1); 0 is never. By default 1/1024, 0 for ``Exact``,
        at most 1/256 for ``AdaptivePreintegrated``, and a quarter of the tolerance for ``Certified``.
    background
        What display and PNG files put behind the volume; ``rgba`` never has it.
    skip_empty
        Leap over blocks of the volume in which nothing has any extinction; the image is the same to rounding, but that
        adaptive Simpson steps begin elsewhere.
    clip, segmentation, memory_limit, budget, missing, client
        See :func:`render`.
    """

    def __init__(
        self,
        volume: Field,
        transfer_function: TransferFunction | None = None,
        *,
        integrator: Integrator | None = None,
        tolerance: float | None = None,
        lighting: Lighting | None = None,
        shadows: ConvolutionShadows | None = None,
        precision: Precision = "auto",
        device: Any = None,
        termination: float | None = None,
        background: str | Sequence[float] | None = None,
        skip_empty: bool = True,
        clip: Clip | Sequence[Clip] | None = None,
        segmentation: Segmentation | None = None,
        memory_limit: int | str | None = None,
        budget: float | str | None = None,
        missing: Missing = "error",
        client: Any = None,
    ):
        if tolerance is not None:
            if integrator is not None:
                raise ValueError(f"tolerance = {tolerance!r} and integrator = {integrator!r}: give one of the two")
            integrator = of_tolerance(tolerance)
        self.volume: Field = volume
        self.transfer_function = transfer_function
        self.integrator: Integrator = of_tolerance(TOLERANCE) if integrator is None else integrator
        self.lighting = lighting
        self.shadows = shadows
        self.precision: Precision = precision
        self.device = device
        self.termination = termination
        self.background = background
        self.skip_empty = skip_empty
        self.clip = clip
        self.segmentation = segmentation
        self._reading = Reading.of(memory_limit, budget, missing, client)
        self._bricks: BrickStore | None = None
        self._keepers: dict[str, Keeper] = {}
        self._lock = Lock()

    def __setattr__(self, name: str, value: Any) -> None:
        """What is assigned is something that there is; else it would be without effect, and nobody told."""
        if not name.startswith("_") and name not in ATTRIBUTES:
            there = f"{', '.join(ATTRIBUTES)}{near(name, ATTRIBUTES)}"
            raise AttributeError(f"a Renderer has no {name!r} to assign, but {there}")
        super().__setattr__(name, value)

    def __getstate__(self) -> dict[str, Any]:
        """What it was told: a copy, also of a pickle, builds what it keeps anew and has frames of its own."""
        return vars(self) | {"_bricks": None, "_keepers": {}, "_lock": Lock()}

    @property
    def tolerance(self) -> float | None:
        """That of the integrator, if it has one; what is assigned is that of :class:`wvr.Certified`."""
        return getattr(self.integrator, "tolerance", None)

    @tolerance.setter
    def tolerance(self, value: float) -> None:
        self.integrator = of_tolerance(value)

    @property
    def builds(self) -> Counter[str]:
        """How often each part was built, by its name.

        Of the volume: ``"volume"`` (brought to the device), ``"ranges"`` (of blocks of cells), ``"peaks"``,
        ``"tops"`` and ``"flat"`` (of projections). Of the transfer function: ``"transfer"``, ``"simplified"``,
        ``"rows"``, ``"table"``, ``"extinctions"`` (of a table), ``"changes"``. Of both: ``"kinds"`` (which blocks and
        cells there is something to see in), ``"octants"``. Of clip volumes: ``"clips"``; of labels: ``"labels"``. Where
        blocks are not known or not skipped, ``"everything"``.
        """
        return sum((keep.builds for keep in self._keepers.values()), Counter())

    def render(
        self,
        camera: Camera,
        size: tuple[int, int] = (512, 512),
        cancel: Event | None = None,
        depth: Any = None,
        progress: Callable[[float], object] | None = None,
    ) -> Image:
        """Render one frame.

        Threads may share a renderer: its frames come one after the other, each of the attributes that there are when
        it begins.

        Parameters
        ----------
        camera
            Where it is seen from.
        size
            (width, height) in pixels.
        cancel
            Ends the frame early once it is set; see :func:`render`. What was kept for other frames is kept.
        depth
            Where rays end; see :func:`render`.
        progress
            What is called with the share that is done; see :func:`render`.

        Raises
        ------
        Cancelled
            Where ``cancel`` is set before the frame is done.
        """
        with cancelling(cancel), self._lock.held(), reporting(progress):
            return self._render(camera, size, depth)

    def _render(self, camera: Camera, size: tuple[int, int], depth: Any) -> Image:
        # Of one set of attributes, whatever is assigned meanwhile.
        given, tf, labels = self.volume, self.transfer_function, self.segmentation
        if isinstance(given, Field):
            tf = tf.for_volume(given) if isinstance(tf, TransferFunction) else tf
            labels = labels.for_volume(given) if isinstance(labels, Segmentation) else labels
        scene = Scene(
            volume=given,
            transfer_function=tf,
            integrator=self.integrator,
            lighting=self.lighting,
            shadows=self.shadows,
            precision=self.precision,
            termination=self.termination,
            background=self.background,
            skip_empty=self.skip_empty,
            clips=clip_list(self.clip),
            segmentation=labels,
        )
        for volume in scene.volumes():
            volume.look()
        scene.check(camera)
        size = image_size(size)
        ends = ends_of(depth, size)
        device = get_device(self.device)
        keep = self._keepers.setdefault(device.alias, Keeper(device))
        frame: Frame | BrickedFrame
        with keep.frame():
            if self._reading.limited or scene.volume.stored:
                frame = BrickedFrame(scene, camera, size, keep, self._reading, ends)
                bricks, self._bricks = self._bricks, None  # nor do those stay of a frame that ends anywhere
                try:
                    image, self._bricks = frame.render(bricks)
                except Cancelled:
                    self._bricks = bricks
                    raise
            else:
                frame = Frame(scene, camera, size, keep, ends)
                image = frame.render()
        # What there is to see in what was not read nobody knows.
        if not frame.partly:
            advise(scene, image)
        return image


@overload
def render(
    volume: Any,
    transfer_function: Function | None = ...,
    camera: CameraLike | None = ...,
    size: tuple[int, int] = ...,
    *,
    integrator: Bounding | None = ...,
    tolerance: float | None = ...,
    **options: Unpack[Options],
) -> BoundedImage: ...
@overload
def render(
    volume: Any,
    transfer_function: Function | None = ...,
    camera: CameraLike | None = ...,
    size: tuple[int, int] = ...,
    *,
    integrator: Integrator | None,
    tolerance: float | None = ...,
    **options: Unpack[Options],
) -> Image: ...
def render(
    volume: Any,
    transfer_function: Function | None = None,
    camera: CameraLike | None = None,
    size: tuple[int, int] = (512, 512),
    *,
    integrator: Integrator | None = None,
    tolerance: float | None = None,
    opacity: Opacity | None = None,
    clim: Sequence[float] | float | None = None,
    lighting: LightingLike | None = None,
    shadows: ConvolutionShadows | bool | None = None,
    background: str | Sequence[float] | None = None,
    precision: Precision = "auto",
    device: Any = None,
    termination: float | None = None,
    skip_empty: bool = True,
    clip: Clip | Sequence[Clip] | None = None,
    segmentation: SegmentationLike | None = None,
    depth: Any = None,
    memory_limit: int | str | None = None,
    budget: float | str | None = None,
    missing: Missing = "error",
    client: Any = None,
    cancel: Event | None = None,
    progress: Callable[[float], object] | None = None,
    **unknown: NoReturn,
) -> Image:
    """Render a volume: ``wvr.render(data)``. What is left out suits the data.

    Parameters
    ----------
    volume
        A :class:`Volume`, or whatever :func:`wvr.as_volume` takes: a path, an array, an xarray, a PyVista dataset.
    transfer_function
        Colour and extinction of a scalar: a :class:`TransferFunction` or a list of its control points; or a colour map,
        the name of one, or a list of two or more colours; or the name of a preset, a suggestion (``"bands"``,
        ``"warm"``, ``"surfaces"``) or a .json file. By default what :func:`wvr.presets.suggest` suggests first. Not
        used, and may be None, with a segmentation.
    camera
        A :class:`Camera`; a PyVista camera or plotter; ``[position, focal point, up]``; a direction from the volume
        towards the camera; or a view by name, ``"iso"``, ``"xy"``, ``"xz"``, ``"yz"``, ``"yx"``, ``"zx"``, ``"zy"`` as
        in PyVista, and of patients ``"anterior"``, ``"posterior"``, ``"left"``, ``"right"``, ``"superior"``,
        ``"inferior"``. What is visible fills the frame. By default a view that suits the data: patients from the
        front, what stands on something upright, a single slice along its normal.
    size
        (width, height) in pixels.
    opacity
        Of a colour map: ``"linear"``, ``"geom"``, ``"sigmoid_5"``, ... or numbers, of PyVista's unit distance; see
        :meth:`TransferFunction.from_colormap`. By default as suggested for the data.
    clim
        Scalars ``(lo, hi)`` that a colour map spans, by default all; or a preset (its own scale).
    tolerance
        Largest absolute error that any channel of any pixel may have, in (0, 1): the integrator is then
        ``Certified(tolerance)``, and the image comes with an ``error_bound``. By default 1/512, less than an 8-bit
        grey level. One that rounding exceeds is refused.
    integrator
        Any other of ``wvr.integrators``, instead of a tolerance.
    lighting
        A :class:`Lighting`: light on what is emitted; True is a light at the camera's upper left, False none. By
        default that light where opacities are suggested and the data have surfaces, and else none. A tolerance then
        holds for opacity and for the image without light; with light, colours converge as it decreases.
    shadows
        A :class:`ConvolutionShadows`: light that is attenuated and spread on its way; True is that of the first light
        of the lighting that goes one way, or of one at the camera's upper left. By default none. A tolerance then holds
        for opacity and for the image without shadows. Colours lit by ``lighting``, if there is any, are in shadow as a
        whole.
    background
        What display, PNG and JPEG files put behind the volume: a colour name, ``"#rrggbb"`` or three linear numbers,
        or ``"transparent"``. By default black where opacities are suggested, and else nothing.
    precision
        ``"auto"`` (float32), ``"float32"`` or ``"float64"``: that of everything along a ray but the sums, which are
        always float64, and that of the image. ``Exact`` is float64 whatever is given; ``Certified`` computes in float64
        but for cells whose bound allows less, in float32 images; with ``"auto"`` images are float32 where the tolerance
        allows it, and with ``"float64"`` all is in float64.
    device
        Warp device; by default CUDA where there is one, else the CPU.
    termination
        A ray ends when less than this transparency is left, in [0, 1); 0 is never. By default 1/1024, 0 for ``Exact``,
        at most 1/256 for ``AdaptivePreintegrated``, and a quarter of the tolerance for ``Certified``.
    skip_empty
        Leap over blocks of the volume in which nothing has any extinction. False computes everything; the image is the
        same to rounding, but that adaptive Simpson steps begin elsewhere.
    clip
        What is cut away: a ``ClipPlane``, ``ClipBox``, ``ClipSphere`` or ``ClipVolume``, or a list of them, of which
        what all leave is left. Rays are cut exactly, with every integrator; bounds on errors hold.
    segmentation
        Labels of the samples and a transfer function for each, with boundaries cut as exactly; see
        :class:`Segmentation`. An array of labels: each has a colour of its own, with the opacity of the transfer
        function, and 0 is nothing (:meth:`Segmentation.colored`).
    depth
        (height, width): where rays end, from the camera's plane along the view [world length]; NaN and infinite are no
        end. What is behind something opaque is not seen then, exactly, and bounds hold: of a PyVista plotter that has
        been shown it is ``-plotter.get_image_depth()``. See docs/projections.md.
    memory_limit
        Bytes, or a text such as ``"4 GiB"``, that samples and what is made of them take at a time beside the process
        itself: the volume is rendered in bricks, from the camera outwards, of which no more are there than fit. By
        default a volume in memory is rendered as it is, and one of :func:`wvr.open` in a quarter of what is free.
    budget
        Of a volume of :func:`wvr.open`: seconds after which, or bytes (a text such as ``"200 MB"``) once they are read,
        nothing more is read; what was not read is in the ``error_bound``.
    missing
        What becomes of chunks of a volume of :func:`wvr.open` that cannot be read: ``"error"``, an ``OSError`` that
        names one, or ``"bound"``: what they may look like is in the ``error_bound``.
    client
        A ``distributed.Client`` (Dask), whose workers read and render the bricks of a volume of :func:`wvr.open`. By
        default one that is active, as Dask's own computations find it, but under a budget, or for a maximum or minimum;
        False is none.
    cancel
        A ``threading.Event``. Once another thread sets it, rays under way are finished, on CUDA all that was launched,
        and the render ends with :class:`Cancelled`; nothing is left running. A kernel that is being compiled is
        finished first, which takes seconds. By default nothing cancels it.
    progress
        What is called meanwhile with the share of the image that is done, from 0 to 1, on the thread that renders, at
        most 50 times a second and with 1 at the end. What it raises ends the render, as does ``cancel`` if it sets
        that; where it does so when called with 1, the image is there and is returned. On CUDA, on Dask's workers and
        under a budget only the end is told.
    **unknown
        Keywords of other libraries, such as ``cmap``: an error, which says what to write here.

    Returns
    -------
    Image
        With a tolerance, which is the default, a :class:`BoundedImage`.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind or value, or a tolerance and an integrator; each says which, what was given and
        what is accepted.
    Cancelled
        Where ``cancel`` is set before the image is done.
    MemoryError
        Where volume and image cannot fit the device's memory.

    Warns
    -----
    UserWarning
        Where nothing or nearly nothing is visible, or the scalars are a small part of the transfer function's: with the
        ranges of both.

    Examples
    --------
    >>> import wvr
    >>> wvr.render(wvr.datasets.load("blobs", 16), "viridis", opacity="sigmoid_5", camera="iso", size=(8, 6)).size
    (8, 6)
    """
    refuse(
        "render",
        unknown,
        ("transfer_function", "camera", "size", "depth", "cancel", "progress", *MovieOptions.__annotations__),
    )
    volume = as_volume(volume)
    size = image_size(size)
    call = Call(transfer_function, camera, opacity, clim, lighting, shadows, background, segmentation, clip, integrator)
    look = call.look(volume, size)
    renderer = Renderer(
        volume,
        look.transfer_function,
        integrator=integrator,
        tolerance=tolerance,
        lighting=look.lighting,
        shadows=look.shadows,
        precision=precision,
        device=device,
        termination=termination,
        background=look.background,
        skip_empty=skip_empty,
        clip=clip,
        segmentation=look.segmentation,
        memory_limit=memory_limit,
        budget=budget,
        missing=missing,
        client=client,
    )
    return renderer.render(look.camera, size, cancel, depth, progress)
