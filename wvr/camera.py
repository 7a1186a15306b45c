"""The camera, with VTK's conventions: where rays start and which way they run.

The view plane normal points from the target to the position, the view-up is made orthogonal to it, the view angle is
vertical, and the aspect ratio (width / height) stretches the view horizontally. Rays run through pixel centres; row 0
is the top of the image.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from operator import index
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .field.base import Field
from .kernels.ray import TILE, tiles
from .memory import check_room
from .pose import Fixed
from .validation import finite_vector, flag, float_array, positive, within

if TYPE_CHECKING:
    import pyvista as pv


# Pixels along a side of an image: bytes of what is kept of a row are counted in 32 bits.
WIDEST = 2**23
# Pixels of an image, in whole tiles: kernels count them in 32 bits.
MOST_PIXELS = 2**31 - 1
# Bytes of a ray while many are made.
RAY = 128
# Lengths in the world whose squares are numbers.
FARTHEST = 1e150


@dataclass(frozen=True, init=False, eq=False)
class Camera(Fixed):
    """A perspective camera or, with ``parallel_scale``, an orthographic one.

    Parameters
    ----------
    position
        Where the camera is, world x, y, z. An orthographic camera only takes the direction of view and the centre of
        the image from it: its rays start behind everything.
    target
        The point at the centre of the image (VTK's focal point), world x, y, z.
    up
        A direction that is upwards in the image; need not be perpendicular to the direction of view.
    view_angle
        Vertical angle of view [degrees], in (0, 180); 30 by default. Without effect on an orthographic image.
    parallel_scale
        Half the height of an orthographic view [world length], > 0; None, the default, is perspective.

    Raises
    ------
    ValueError
        For numbers that are not finite, lengths beyond 1e150, a position at the target, an ``up`` that is zero or
        parallel to the direction of view, a view angle outside (0, 180), or ``parallel_scale`` <= 0.
    """

    fixed = ("position", "target", "up")
    position: NDArray[np.float64]
    target: NDArray[np.float64]
    up: NDArray[np.float64]
    view_angle: float
    parallel_scale: float | None

    def __init__(
        self,
        position: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 0.0, 1.0),
        view_angle: float = 30.0,
        parallel_scale: float | None = None,
    ):
        fields: dict[str, Any] = {
            "position": finite_vector(position, "position", "the camera's place"),
            "target": finite_vector(target, "target", "the point at the image's centre"),
            "up": finite_vector(up, "up", "the upward direction"),
            "view_angle": _view_angle(view_angle),
            "parallel_scale": None if parallel_scale is None else positive(parallel_scale, "parallel_scale"),
        }
        for name in ("position", "target", "parallel_scale"):
            if fields[name] is not None and np.abs(fields[name]).max() > FARTHEST:
                raise ValueError(f"{name} must be within {FARTHEST:g}, got {fields[name]}")
        for name, value in fields.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)
        if np.array_equal(self.position, self.target):
            raise ValueError(
                f"position must differ from target, got {tuple(self.position.tolist())} for both"
                f"; wvr.Camera.fit(volume, direction) looks from a direction"
            )
        if not np.any(self.up):
            raise ValueError(f"up must not be zero, got {up!r}")
        if np.linalg.norm(np.cross(_unit(self.up), _unit(self.target - self.position))) < 1e-9:
            raise ValueError(f"up must not be parallel to the direction of view, got {tuple(self.up.tolist())}")

    @property
    def parallel(self) -> bool:
        """Whether the camera is orthographic."""
        return self.parallel_scale is not None

    @property
    def half_height(self) -> float:
        """Half the view's height: world length, of a perspective view that at distance 1."""
        if self.parallel_scale is not None:
            return self.parallel_scale
        if self.view_angle <= 90:
            return float(np.tan(np.radians(self.view_angle / 2)))
        # Of what lacks to 180 degrees, which is exact; the tangent of a rounded right angle is not.
        return float(1 / np.tan(np.radians((180 - self.view_angle) / 2)))

    def basis(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Orthonormal world directions (right, up, forward) of the image, each of shape (3,)."""
        forward = _unit(self.target - self.position)
        right = _unit(_across(self.target, self.position, self.up))
        return right, np.cross(right, forward), forward

    def rays(self, size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The rays through the pixel centres of an image.

        Parameters
        ----------
        size
            (width, height) in pixels.

        Returns
        -------
        origins, directions
            World coordinates, float64, shape (height, width, 3), row 0 at the top. The directions are of unit length.
            Rays of an orthographic camera are given from the plane through ``position`` across the direction of view,
            though they are rendered from behind everything.

        Raises
        ------
        MemoryError
            Where there is not enough of it.
        """
        width, height = image_size(size)
        check_room(RAY * width * height, None, f"rays of {width} x {height} pixels", "a smaller size")
        right, up, forward = self.basis()
        half_height = self.half_height
        x = (2 * np.arange(width) + 1 - width) / height * half_height
        y = (height - 1 - 2 * np.arange(height)) / height * half_height
        across = x[None, :, None] * right + y[:, None, None] * up
        if self.parallel:
            return self.position + across, np.broadcast_to(forward, across.shape).copy()
        directions = forward + across
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, across.shape).copy(), directions

    @classmethod
    def fit(
        cls,
        volume: Field,
        direction: ArrayLike = (1.0, 0.6, 0.4),
        up: ArrayLike = (0.0, 0.0, 1.0),
        parallel: bool = False,
        view_angle: float = 30.0,
        aspect: float = 1.0,
    ) -> Camera:
        """A camera that sees the whole volume, placed as VTK's ``ResetCamera`` does.

        The sphere around the volume's box touches the upper and lower edge of the view or, where the image is narrower
        than high, its left and right edge.

        Parameters
        ----------
        volume
            What to look at.
        direction
            World direction from the volume towards the camera, of any length.
        up
            Upward direction. One within 2.6 degrees of ``direction`` is replaced by (-up[2], up[0], up[1]), as in VTK,
            or where that is along it as well, by (up[1], up[2], up[0]).
        parallel
            Orthographic instead of perspective.
        view_angle
            Vertical angle of view [degrees], in (0, 180).
        aspect
            Width / height of the image. Only below 1 does it matter: such an image needs more distance.

        Examples
        --------
        >>> import wvr
        >>> camera = wvr.Camera.fit(wvr.datasets.load("blobs", 8), direction=(1, 0, 0))
        >>> camera.target.tolist()
        [3.5, 3.5, 3.5]
        """
        towards = finite_vector(direction, "direction", "from the volume towards the camera")
        if not np.any(towards):
            raise ValueError(f"direction must not be zero, got {direction!r}")
        towards = _unit(towards)
        upward = finite_vector(up, "up", "the upward direction")
        if not np.any(upward):
            raise ValueError(f"up must not be zero, got {up!r}")
        if not isinstance(volume, Field):
            raise TypeError(f"volume must be a Volume, got {type(volume).__name__}")
        up = not_along(upward, towards)
        narrowness = min(positive(aspect, "aspect"), 1.0)
        center = volume.corners.mean(axis=0)
        radius = float(np.linalg.norm(volume.corners - center, axis=1).max())
        half_angle = np.arctan(np.tan(np.radians(_view_angle(view_angle)) / 2) * narrowness)
        position = center + radius / np.sin(half_angle) * towards
        return cls(position, center, up, view_angle, radius / narrowness if flag(parallel, "parallel") else None)

    @classmethod
    def orbit(
        cls,
        volume: Field,
        azimuth: float = 0.0,
        elevation: float = 20.0,
        parallel: bool = False,
        view_angle: float = 30.0,
        aspect: float = 1.0,
    ) -> Camera:
        """A camera on a sphere around the volume, from which all of it is seen as by :meth:`fit`.

        Parameters
        ----------
        volume
            What to look at.
        azimuth
            Degrees around the upward axis, counter-clockwise as seen from above; 0 is in front: +x of most volumes, the
            anterior side of patients.
        elevation
            Degrees above the horizon, in (-90, 90). Upwards is +z, of patients towards the head.
        parallel, view_angle, aspect
            As of :meth:`fit`.

        Examples
        --------
        >>> import wvr
        >>> camera = wvr.Camera.orbit(wvr.datasets.load("blobs", 8), azimuth=90, elevation=0)
        >>> bool(abs(camera.position[0] - 3.5) < 1e-9 and camera.position[1] > 3.5)
        True
        """
        from .views import front_and_up, seen_around

        azimuth, elevation = within(azimuth, "azimuth", np.inf), within(elevation, "elevation", 90.0)
        view = seen_around(*front_and_up(volume), azimuth, elevation)
        return cls.fit(volume, *view, parallel, view_angle, aspect)

    def project(self, points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        """Where world points are in an image.

        Parameters
        ----------
        points
            (..., 3) world coordinates.
        size
            (width, height) in pixels.

        Returns
        -------
        float64, shape (..., 2)
            Column and row; (0, 0) is the centre of the first pixel. NaN for what is not in front of the camera.
        """
        width, height = image_size(size)
        right, up, forward = self.basis()
        given = float_array(points, "points")
        if given.ndim < 1 or given.shape[-1] != 3:
            raise ValueError(f"points must be (..., 3) world coordinates, got shape {given.shape}")
        offset = given - self.position
        depth = offset @ forward
        half: Any = self.half_height
        if not self.parallel:
            half = np.where(depth > 0, depth, np.nan) * half
        x, y = offset @ right / half, offset @ up / half
        return np.stack([(x * height + width - 1) / 2, (height - 1 - y * height) / 2], axis=-1)

    def unproject(self, x: ArrayLike, y: ArrayLike, depth: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        """World points of an image, of which :meth:`project` is the inverse.

        Parameters
        ----------
        x, y
            Columns and rows; (0, 0) is the centre of the first pixel.
        depth
            From the camera's plane along the view [world length], as of :meth:`Image.depth`.
        size
            (width, height) in pixels.

        Returns
        -------
        float64, shape (..., 3)
        """
        width, height = image_size(size)
        right, up, forward = self.basis()
        pixel = 2 * self.half_height / height
        given = [float_array(one, name) for name, one in (("x", x), ("y", y), ("depth", depth))]
        try:
            x, y, depth = (one[..., None] for one in np.broadcast_arrays(*given))
        except ValueError:
            shapes = ", ".join(str(one.shape) for one in given)
            raise ValueError(f"x, y and depth must have shapes that go together, got {shapes}") from None
        across = pixel * ((x - (width - 1) / 2) * right - (y - (height - 1) / 2) * up)
        return self.position + (across if self.parallel else depth * across) + depth * forward

    def to_pyvista(self) -> pv.Camera:
        """The same as a PyVista ``Camera``, for ``plotter.camera``; VTK then chooses its clipping range.

        Two cameras of wvr may differ where this does not: a VTK camera that is orthographic starts at its position.
        """
        import pyvista as pv

        camera = pv.Camera()
        camera.position, camera.focal_point = tuple(self.position), tuple(self.target)
        camera.up, camera.view_angle = tuple(self.up), self.view_angle
        if self.parallel_scale is not None:
            camera.parallel_projection, camera.parallel_scale = True, self.parallel_scale
        return camera

    @classmethod
    def from_pyvista(cls, camera: Any) -> Camera:
        """The camera of a PyVista ``Camera`` or ``Plotter``; its clipping range, shear and window centre are left."""
        camera = getattr(camera, "camera", camera)
        try:
            scale = camera.parallel_scale if camera.parallel_projection else None
            return cls(camera.position, camera.focal_point, camera.up, camera.view_angle, scale)
        except AttributeError:
            raise TypeError(f"camera must be a PyVista Camera or Plotter, got {type(camera).__name__}") from None

    def __repr__(self) -> str:
        position, target, up = (tuple(v.tolist()) for v in (self.position, self.target, self.up))
        view = f"parallel_scale={self.parallel_scale}" if self.parallel else f"view_angle={self.view_angle}"
        return f"Camera({position}, {target}, up={up}, {view})"


def not_along(up: ArrayLike, direction: ArrayLike) -> NDArray[np.float64]:
    """The upward direction, or where that is along the direction of view, to 2.6 degrees, another, as VTK takes it but
    for (1, -1, 1), of which VTK's is along that as well.
    """
    upward, towards = np.asarray(up, np.float64), np.asarray(direction, np.float64)
    x, y, z = upward
    for other in (upward, np.array([-z, x, y])):
        if not np.any(upward) or not np.any(towards) or abs(_unit(other) @ _unit(towards)) <= 0.999:
            return other
    return np.array([y, z, x])


def image_size(size: Any) -> tuple[int, int]:
    """``size`` as (width, height), two integers >= 1."""
    try:
        width, height = (index(n) for n in size)
    except (TypeError, ValueError):
        raise ValueError(f"size must be two integers (width, height), such as (512, 512), got {size!r}") from None
    if width < 1 or height < 1:
        raise ValueError(f"size must be (width, height), each >= 1, got {size!r}")
    if max(width, height) > WIDEST:
        raise ValueError(f"size must be (width, height), each at most {WIDEST}, got {size!r}")
    if tiles(width, height) * int(TILE) ** 2 > MOST_PIXELS:
        raise ValueError(
            f"size must be (width, height) of at most {MOST_PIXELS} pixels, in whole tiles of {TILE} x {TILE}, got "
            f"{size!r}: {width * height} pixels"
        )
    return width, height


def _view_angle(value: Any) -> float:
    angle = positive(value, "view_angle")
    if angle >= 180:
        raise ValueError(f"view_angle must be between 0 and 180 degrees, got {value!r}")
    return angle


def _across(target: NDArray[np.float64], position: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction of ``(target - position) x up``, of exact numbers: of vectors that are nearly parallel, rounded
    ones would leave few digits of it.
    """
    a = [Fraction(to) - Fraction(at) for to, at in zip(target.tolist(), position.tolist(), strict=True)]
    b = [Fraction(x) for x in up.tolist()]
    cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    largest = max(map(abs, cross))
    return np.array([float(x / largest) for x in cross])


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    # Divided by the largest component first, so that neither square nor root leaves the range of numbers.
    vector = vector / np.abs(vector).max()
    return vector / np.linalg.norm(vector)
