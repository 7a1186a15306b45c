"""The true value of a pixel, enclosed between two that ball arithmetic proves to be below and above it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import index
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera, image_size
from ..cuts.base import Clip, clip_list
from ..cuts.labels import Segmentation
from ..transfer_function import TransferFunction
from ..validation import positive
from ..volume import Volume


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Between which values the true channels of a pixel are.

    Attributes
    ----------
    lower, upper
        Premultiplied linear red, green, blue and opacity, float64 of shape (4,), rounded outwards.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]

    @property
    def width(self) -> float:
        """How far apart they are, of the channel where that is most."""
        return float((self.upper - self.lower).max())


def enclose(
    volume: Volume,
    transfer_function: TransferFunction | None,
    camera: Camera,
    x: int,
    y: int,
    size: tuple[int, int] = (512, 512),
    *,
    clip: Clip | Sequence[Clip] | None = None,
    segmentation: Segmentation | None = None,
    lighting: None = None,
    shadows: None = None,
    width: float = 1e-12,
) -> Enclosure:
    """Enclose the true value of one pixel: rigorously, and without any code of those who render.

    The model is that of :func:`render`: trilinear field, piecewise linear extinction and colour, one ray through the
    pixel's centre that does not end early. All that is computed are balls (F. Johansson, "Arb: efficient
    arbitrary-precision midpoint-radius interval arithmetic", 2017, by python-flint), from the numbers of the arguments
    as exact ones, so that the truth is between ``lower`` and ``upper`` whatever is rounded. Some milliseconds a ray.

    Parameters
    ----------
    volume, transfer_function, camera, size, clip, segmentation
        As of :func:`render`.
    x, y
        Column and row of the pixel, row 0 at the top.
    lighting, shadows
        None: neither is enclosed.
    width
        How far apart ``lower`` and ``upper`` may be, > 0. Precision is doubled, from 192 bits to 1536, until they are
        so close, or come no closer: where a ray runs along a jump, or along the face of a cell that is absent, the
        truth itself is undecided, and the enclosure wide.

    Returns
    -------
    Enclosure

    Raises
    ------
    ImportError
        Without python-flint, which ``pip install "wvr[enclose]"`` brings.
    TypeError
        For arguments of another kind, clips of another kind than wvr's own included.
    ValueError
        For a pixel outside the image, ``width`` <= 0, clips that are naive or cut segments, labels of another shape
        than the volume's, lighting or shadows.

    Notes
    -----
    The precision of python-flint is one for the whole process while a pixel is enclosed, and put back: use processes to
    enclose several at a time, not threads.

    Examples
    --------
    >>> import numpy as np, wvr
    >>> volume = wvr.Volume(np.ones((3, 3, 3)))
    >>> tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    >>> camera = wvr.Camera((1, 1, 9), (1, 1, 1), up=(0, 1, 0), parallel_scale=1)
    >>> pixel = wvr.enclose(volume, tf, camera, 1, 1, size=(3, 3))
    >>> bool(np.all(pixel.lower <= 0.75) and np.all(pixel.upper >= 0.75) and pixel.width < 1e-15)
    True
    """
    scene = prepare(volume, transfer_function, clip, segmentation, lighting, shadows)
    if not isinstance(camera, Camera):
        raise TypeError(f"camera must be a Camera, got {type(camera).__name__}")
    columns, rows = image_size(size)
    for name, given, number in (("x", x, columns), ("y", y, rows)):
        try:
            known = 0 <= index(given) < number
        except TypeError:
            raise TypeError(f"{name} must be an integer, got {given!r}") from None
        if not known:
            raise ValueError(f"{name} must be from 0 to {number - 1} in an image of {columns} x {rows}, got {given!r}")
    return Enclosure(*scene.enclose(camera, (columns, rows), index(x), index(y), positive(width, "width")))


def prepare(
    volume: Volume,
    transfer_function: TransferFunction | None,
    clip: Clip | Sequence[Clip] | None = None,
    segmentation: Segmentation | None = None,
    lighting: Any = None,
    shadows: Any = None,
) -> Any:
    """The scene of :func:`enclose`, checked, for many of its rays."""
    try:
        from .cuts import check
        from .rays import Scene
    except ImportError as error:
        raise ImportError(f'wvr.enclose needs python-flint: pip install "wvr[enclose]" ({error})') from error
    for name, given in (("lighting", lighting), ("shadows", shadows)):
        if given is not None:
            raise ValueError(f"{name} must be None: an enclosure is of the image without light, got {given!r}")
    if not isinstance(volume, Volume):
        raise TypeError(f"volume must be a Volume, got {type(volume).__name__}")
    if segmentation is None and not isinstance(transfer_function, TransferFunction):
        raise TypeError(f"transfer_function must be a TransferFunction, got {type(transfer_function).__name__}")
    if segmentation is not None and not isinstance(segmentation, Segmentation):
        raise TypeError(f"segmentation must be a Segmentation or None, got {type(segmentation).__name__}")
    clips = clip_list(clip)
    check(clips)
    # Samples that had to be copied may have been written since.
    labels = None if segmentation is None else segmentation.labels
    for one in (volume, labels, *(getattr(clip, "volume", None) for clip in clips)):
        if one is not None:
            one.look()
    if labels is not None and labels.shape != volume.shape:
        raise ValueError(f"segmentation must have labels of the volume's shape {volume.shape}, got {labels.shape}")
    tf = None if transfer_function is None else transfer_function.for_volume(volume)
    return Scene(volume, tf, clips, None if segmentation is None else segmentation.for_volume(volume))
