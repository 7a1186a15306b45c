"""A rendered image: linear premultiplied RGBA, what each ray cost and how wrong it may be; display and files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from io import BytesIO
from operator import index
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .cached import cached_property
from .color import is_clear, linear_rgb, linear_to_srgb, srgb_to_linear
from .display import Shown, plot
from .files import known_suffix, whole_file
from .pictures import ELSEWHERE, FLOAT_WRITERS, PIXEL_WRITERS, check_sides, write_png
from .resident import Resident
from .validation import any_array, at_most, path_of, share, unmasked

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .probe import Prober

Background: TypeAlias = str | Sequence[float] | NDArray[Any]
# Pixels that are encoded at a time.
STRIP = 1 << 18
# Backends of Matplotlib that only write files.
WITHOUT_DISPLAY = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")


class Pick(NamedTuple):
    """What is under a pixel (:meth:`Image.pick`).

    Attributes
    ----------
    position
        World coordinates, (3,); NaN where the ray does not get there.
    value
        The scalar there.
    opacity
        Of the pixel.
    """

    position: NDArray[np.float64]
    value: float
    opacity: float


class Image:
    """What a render returns; notebooks show it.

    ``numpy.asarray(image)`` is its ``rgba``, linear and premultiplied: arithmetic on light is done with that, and
    ``to_uint8()`` is what screens show.

    Parameters
    ----------
    rgba
        Linear RGBA, premultiplied, without background: float32 or float64, shape (height, width, 4), row 0 at the top.
    samples
        Field evaluations (or segments) of each ray: int32, shape (height, width).
    error_bound
        Bound on the absolute error of any channel, shape (height, width); None where the method gives none.
    stats
        Seconds by stage, counts and sizes, the share of the volume that was skipped, what a tolerance covers; empty by
        default.
    background
        What display and PNG files put behind the volume: a colour name, ``"#rrggbb"`` or three linear numbers; None,
        the default, leaves them transparent. ``rgba`` never has it.
    tracer
        What :meth:`trace` calls; None where the method has no steps to tell.
    shown
        What it is an image of, for :meth:`plot` to draw around it; None where that is not known.
    values
        Of a :class:`Projection` the values, float64 (height, width), NaN where a ray misses; None of others. Then
        ``error_bound`` is theirs.
    prober
        What :meth:`depth` and :meth:`pick` call; None where nothing is known of rays.
    """

    def __init__(
        self,
        rgba: NDArray[np.floating] | Resident,
        samples: NDArray[np.int32] | wp.array,
        error_bound: NDArray[np.floating] | wp.array | None = None,
        stats: dict[str, Any] | None = None,
        background: str | Sequence[float] | None = None,
        tracer: Callable[[int, int, int], NDArray[np.void]] | None = None,
        shown: Shown | None = None,
        values: NDArray[np.float64] | None = None,
        prober: Prober | None = None,
    ):
        if isinstance(rgba, Resident):
            self._resident: Resident | None = rgba
            self._of_rays = samples, error_bound
        else:
            self._resident = None
            for name, given in (("rgba", rgba), ("samples", samples), ("error_bound", error_bound)):
                if not isinstance(given, np.ndarray) and not (given is None and name == "error_bound"):
                    raise TypeError(f"{name} must be a NumPy array, got {type(given).__name__}")
                unmasked(given, name)
            if rgba.ndim != 3 or rgba.shape[2] != 4 or rgba.dtype not in (np.float32, np.float64):
                raise ValueError(f"rgba must be float32 or float64 (height, width, 4), got {rgba.dtype} {rgba.shape}")
            if not rgba.size:
                raise ValueError(f"rgba must have a pixel or more, got shape {rgba.shape}")
            for name, array in (("samples", samples), ("error_bound", error_bound)):
                if array is not None and array.shape != rgba.shape[:2]:
                    raise ValueError(f"{name} must have the shape {rgba.shape[:2]} of rgba, got {array.shape}")
            self.rgba, self.samples, self.error_bound = rgba, samples, error_bound
        if not is_clear(background):
            color = linear_rgb(background, "background")  # type: ignore[arg-type]
            background = background if isinstance(background, str) else tuple(color.tolist())
        self.stats = {} if stats is None else stats
        self.background = background
        self.shown = shown
        self.values = values
        self._tracer = tracer
        self._prober = prober

    def __getstate__(self) -> dict[str, Any]:
        """What was rendered, without the volume: a copy has no ``trace``, ``depth`` and ``pick``."""
        here = {"rgba": self.rgba, "samples": self.samples, "error_bound": self.error_bound}
        return vars(self) | here | {"_resident": None, "_of_rays": None, "_tracer": None, "_prober": None}

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = self.rgba.shape[:2] if self._resident is None else self._resident.array.shape
        return width, height

    @cached_property
    def rgba(self) -> NDArray[np.floating]:
        """Linear RGBA, premultiplied, without background: float32 or float64, (height, width, 4), row 0 at the top.

        What a GPU rendered is brought from it when it is asked for.
        """
        assert self._resident is not None
        return self._resident.array.numpy()

    @cached_property
    def samples(self) -> NDArray[np.int32]:
        """Field evaluations (or segments) of each ray: int32, shape (height, width)."""
        return _brought(self._of_rays[0])

    @cached_property
    def error_bound(self) -> NDArray[np.floating] | None:
        """Bound on the absolute error of any channel, shape (height, width); None where the method gives none."""
        return _brought(self._of_rays[1])

    @property
    def device_rgba(self) -> wp.array:
        """``rgba`` where it was rendered: a Warp array (height, width) of vec4f or vec4d, to read.

        Kernels of Warp take it as it is, and by ``torch.from_dlpack``, ``jax.dlpack.from_dlpack`` or
        ``cupy.from_dlpack`` it is an array (height, width, 4) that has the same memory: nothing leaves the device. All
        has been written.
        """
        if self._resident is not None:
            return self._resident.array
        vec4 = wp.vec4f if self.rgba.dtype == np.float32 else wp.vec4d
        return wp.array(np.ascontiguousarray(self.rgba), dtype=vec4, device="cpu", copy=False)

    @property
    def most_opaque(self) -> float:
        """The largest opacity of a pixel."""
        return float(self.rgba[..., 3].max()) if self._resident is None else self._resident.most

    @property
    def max_error(self) -> float:
        """The largest bound of any pixel; infinite where the method gives none."""
        return float("inf") if self.error_bound is None else float(self.error_bound.max(initial=0.0))

    def trace(self, x: int, y: int) -> NDArray[np.void]:
        """The steps of one ray, of an adaptive method.

        Parameters
        ----------
        x, y
            Column and row of the pixel, from the top left.

        Returns
        -------
        structured array, one element a step
            ``t`` where it starts and ``length``, in units of the smallest voxel spacing from where the ray enters the
            volume; ``tolerance`` of a step of that length; the estimates ``depth_error`` (of optical depth) and
            ``error`` (of any channel); ``forced``, whether it was taken in spite of an estimate above the tolerance;
            ``rgba``, the ray's composite at its end. A ray that misses the volume has none.

        Raises
        ------
        ValueError
            For an image of a method without adaptive steps, of a volume in bricks, or that is a copy; and where
            somebody wrote into its samples since.
        IndexError
            For a pixel outside the image.
        """
        if self._tracer is None:
            raise ValueError(
                f"trace needs an image that wvr.render made with an adaptive integrator, of a volume that is not in "
                f"bricks, in the process that made it, got one of {self.stats.get('integrator', 'none')}"
            )
        column, row = self._pixel(x, y)
        return self._tracer(column, row, int(self.samples[row, column]))

    def depth(self, opacity: float = 0.5) -> NDArray[np.float64]:
        """How far it is to where each ray has an opacity: from the camera's plane along the view [world length].

        What meshes have in a depth buffer, to put them before and behind a volume: see ``depth`` of :func:`render`.
        It is that of the exact integral, whatever the integrator; naive clips are taken as exact ones. Of an
        :class:`Isosurface` it is that of the crossing at which the ray has the opacity, of a :class:`Projection` that
        of the largest or smallest value.

        Parameters
        ----------
        opacity
            In (0, 1].

        Returns
        -------
        float64, shape (height, width)
            NaN where rays do not get there.

        Raises
        ------
        ValueError
            For an opacity out of its range; of images whose field is not known inside cells, of a mean or sum, which
            are of the whole ray, and where samples were written into since.
        """
        prober = self._probing("depth")
        return prober(share(opacity, "opacity"), None)[1]

    def pick(self, x: int, y: int, opacity: float | None = None) -> Pick:
        """What is under a pixel.

        Parameters
        ----------
        x, y
            Column and row of the pixel, from the top left.
        opacity
            Where its ray has this opacity, in (0, 1]; by default half of what the pixel has or, where the bound on its
            error is so large that the ray does not get there, half of what the ray has, so that there is something
            wherever anything is visible.

        Returns
        -------
        Pick
            ``position`` (world coordinates, (3,)), the scalar ``value`` there, and the pixel's own ``opacity``;
            position and value are NaN where the ray does not get there.

        Raises
        ------
        IndexError
            For a pixel outside the image.
        ValueError
            As :meth:`depth`, but that of a mean or sum the value is known and the position NaN.
        """
        prober = self._probing("pick")
        column, row = self._pixel(x, y)
        own = float(self.rgba[row, column, 3])
        asked = 0.5 * own if opacity is None else share(opacity, "opacity")
        value, depth = np.nan, np.nan
        if self.values is not None:
            value = float(self.values[row, column])
        if own > 0:
            value, depth, there = map(float, prober(asked, (column, row)))
            if opacity is None and self.values is None and np.isnan(depth) and there > 0:
                # The image's opacity is off by half of it, or more.
                value, depth, _ = map(float, prober(0.5 * there, (column, row)))
        assert self.shown is not None
        return Pick(self.shown.camera.unproject(column, row, depth, self.size), value, own)

    def _probing(self, what: str) -> Prober:
        if self._prober is None:
            raise ValueError(f"{what} needs an image that wvr.render made, in the process that made it")
        return self._prober

    def _pixel(self, x: int, y: int) -> tuple[int, int]:
        width, height = self.size
        try:
            column, row = index(x), index(y)
        except TypeError:
            raise TypeError(f"x, y must be integers, got {x!r}, {y!r}") from None
        if not (0 <= column < width and 0 <= row < height):
            raise IndexError(f"x, y must be a pixel of the {width} x {height} image, got {x!r}, {y!r}")
        return column, row

    def composited(self, background: Background) -> NDArray[np.float64]:
        """Linear RGB in front of a background.

        Parameters
        ----------
        background
            A colour name or ``"#rrggbb"``, decoded from sRGB, or three linear numbers >= 0; or what is behind each
            pixel, (height, width, 3): uint8 sRGB, such as PyVista's ``plotter.screenshot()``, or linear floats.

        Returns
        -------
        float64, shape (height, width, 3)
        """
        transparency = 1.0 - self.rgba[..., 3:].astype(np.float64)
        return self.rgba[..., :3] + transparency * _behind(background, self.size)

    def to_uint8(self, background: Background | None = None) -> NDArray[np.uint8]:
        """The image as screens and PNG files want it: sRGB-encoded, 0 to 255, rounded to nearest, clipped to [0, 1].

        Parameters
        ----------
        background
            As for :meth:`composited`. None, the default, is the image's own ``background``; ``"transparent"`` is none.

        Returns
        -------
        uint8
            Shape (height, width, 3) in front of a background; without one (height, width, 4), whose colour is not
            premultiplied and whose alpha is linear.

        Raises
        ------
        ValueError
            For another background, and where ``rgba`` is NaN or infinite.
        """
        background = self.background if background is None else background
        behind = None if is_clear(background) else _behind(background, self.size)  # type: ignore[arg-type]
        width, height = self.size
        pixels = np.empty((height, width, 4 if behind is None else 3), np.uint8)
        # In strips: what is on the way is many times as large as what comes of it.
        rows = max(STRIP // width, 1)
        for start in range(0, height, rows):
            strip = self.rgba[start : start + rows].astype(np.float64)
            if not np.isfinite(strip).all():
                raise ValueError("rgba must be finite where it is shown; files of floats keep NaN and infinite numbers")
            here = behind if behind is None or behind.ndim == 1 else behind[start : start + rows]
            pixels[start : start + rows] = _straight(strip) if here is None else _in_front(strip, here)
        return pixels

    def plot(self, ax: Axes | None = None, scalar_bar: bool = True, axes: bool = True, outline: bool = False) -> Axes:
        """Draw the image with Matplotlib, as screens want it.

        ``plt.imshow(image)`` would show linear colours as if they were sRGB: too dark.

        Parameters
        ----------
        ax
            Where to; by default a new figure of its size.
        scalar_bar
            With the colours of the transfer function, over the scalars that there are.
        axes
            With the directions of the world's x, y and z, of a patient's where the file says them.
        outline
            With the edges of the volume's box.

        Returns
        -------
        matplotlib.axes.Axes
            In pixels, the centre of the first at (0, 0).
        """
        return plot(self, ax, scalar_bar, axes, outline)

    def show(self) -> None:
        """Show it in a window (Matplotlib's), with a scalar bar and the world's axes; in a notebook below the cell.

        Raises
        ------
        RuntimeError
            Where there is no display.
        """
        import matplotlib
        import matplotlib.pyplot as plt

        backend = matplotlib.get_backend()
        if backend.lower() in WITHOUT_DISPLAY:
            raise RuntimeError(
                f"show needs a display, Matplotlib has none (backend {backend}): use image.save('image.png'), or "
                f"image.plot() and its figure's savefig"
            )
        self.plot()
        plt.show()

    def save(self, path: str | os.PathLike[str], background: Background | None = None) -> None:
        """Write the image; the file appears whole or not at all.

        Parameters
        ----------
        path
            The extension, in any case, says what is written: ``.png``, ``.jpg`` and ``.jpeg`` sRGB, 8 bits; the others
            the linear premultiplied floats: ``.exr`` float32 R, G, B, A; ``.tif``, ``.tiff`` and ``.npy`` in the
            precision of ``rgba``.
        background
            For PNG and JPEG only, as for :meth:`to_uint8`; a JPEG cannot be transparent and is white by default.

        Raises
        ------
        ValueError
            For another extension, a background with a format that keeps the floats, and where a format does not hold
            the image: more than 65500 pixels along a side in a JPEG, what is beyond float32 in an EXR, and NaN or
            infinite numbers in those of 8 bits.
        OSError
            Where the file cannot be written; ``FileNotFoundError`` where its folder does not exist.
        """
        path = path_of(path)
        suffix = known_suffix(path, (*PIXEL_WRITERS, *FLOAT_WRITERS), elsewhere=ELSEWHERE)
        check_sides(suffix, self.size, "path")
        if suffix in PIXEL_WRITERS:
            background = self.background if background is None else background
            if suffix != ".png":
                if background is not None and is_clear(background):
                    raise ValueError(f'background must be a colour for {suffix}, which is opaque, got "transparent"')
                background = "white" if background is None else background
            pixels = self.to_uint8(background)
            with whole_file(path) as file:
                PIXEL_WRITERS[suffix](file, pixels)
        elif background is not None:
            raise ValueError(
                f"background must be None for {suffix}, which keeps linear RGBA, got {background!r}; "
                f"save image.composited(background) yourself, or a .png"
            )
        else:
            with whole_file(path) as file:
                FLOAT_WRITERS[suffix](file, self.rgba)

    def png(self, background: Background | None = None) -> bytes:
        """The bytes of a PNG file, for pipes and web pages; ``background`` as for :meth:`to_uint8`."""
        png = BytesIO()
        write_png(png, self.to_uint8(background))
        return png.getvalue()

    def _repr_png_(self) -> bytes:
        return self.png()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray:
        # NumPy 1 knows no None.
        return np.asarray(self.rgba, dtype) if copy is None else np.array(self.rgba, dtype, copy=copy)

    def __repr__(self) -> str:
        width, height = self.size
        parts = [f"{width} x {height}", *([self.stats["integrator"]] if "integrator" in self.stats else [])]
        if self.error_bound is not None:
            light = " but for light" if ", not " in self.stats.get("bound_covers", "") else ""
            parts.append(f"errors up to {at_most(self.max_error)}{light}")
        parts.append(f"{_counted(int(self.samples.sum(dtype=np.int64)))} samples")
        if "seconds" in self.stats:
            parts.append(f"{self.stats['seconds']:.3g} s")
        return f"Image({', '.join(parts)})"


class BoundedImage(Image):
    """An image with a bound on its error: what :func:`wvr.render` returns where a tolerance says how large it may be.

    Shadows with ``image="slices"`` make images of their own, which have none.
    """

    error_bound: NDArray[np.floating]


def _brought(array: Any) -> Any:
    """To the host, from where it is."""
    return array.numpy() if isinstance(array, wp.array) else array


def _behind(background: Background, size: tuple[int, int]) -> NDArray[np.float64]:
    """Linear RGB of a background, (3,) or of each pixel."""
    many = isinstance(background, np.ndarray | list | tuple)
    pixels = any_array(background if many else (), "background")
    if pixels.ndim < 2:
        return linear_rgb(background, "background")  # type: ignore[arg-type]
    known = pixels.dtype == np.uint8 or (pixels.dtype.kind == "f" and np.isfinite(pixels).all())
    if pixels.shape != (*size[::-1], 3) or not known:
        raise ValueError(
            f"background must be a colour or (height, width, 3) = {(*size[::-1], 3)}, uint8 sRGB or finite linear "
            f"floats, got {pixels.dtype} {pixels.shape}"
        )
    return srgb_to_linear(pixels / 255) if pixels.dtype == np.uint8 else pixels.astype(np.float64)


def _straight(rgba: NDArray[np.float64]) -> NDArray[np.uint8]:
    """sRGB that is not premultiplied, and linear opacity."""
    color, alpha = rgba[..., :3], rgba[..., 3:]
    straight = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return _quantised(np.concatenate([linear_to_srgb(straight), alpha], axis=-1))


def _in_front(rgba: NDArray[np.float64], behind: NDArray[np.float64]) -> NDArray[np.uint8]:
    """sRGB in front of a background."""
    return _quantised(linear_to_srgb(rgba[..., :3] + (1.0 - rgba[..., 3:]) * behind))


def _quantised(encoded: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.rint(np.clip(encoded, 0.0, 1.0) * 255).astype(np.uint8)


def _counted(count: int) -> str:
    """Three digits and a thousands' prefix: 12345678 as ``12.3 M``."""
    for unit, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if count >= 0.9995 * unit:
            return f"{count / unit:.3g} {prefix}"
    return str(count)
