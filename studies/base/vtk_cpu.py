"""VTK's processor ray caster, ``vtkFixedPointVolumeRayCastMapper``, in a process of its own.

VTK draws the mapper's image with OpenGL, even off-screen. Where there is none (no EGL, OSMesa or X) VTK may end the
process, so it runs in another one, which stays and measures its own frames.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .harness import Time, timed
from .scenes import Scene

# VTK's opacity is linear between control points, wvr's extinction; close points make them one. Per grey level, of which
# floating-point samples count as having 255.
POINTS = 16
PATIENCE = 120.0  # seconds until a frame counts as hung


class NotAvailableError(Exception):
    """VTK cannot render here; says why."""


class VtkCpu:
    """A scene in VTK; used with ``with``.

    Parameters
    ----------
    scene
        With a volume whose axes are the world's.
    scale
        What samples are multiplied by: 257 spreads uint8 over uint16, for which VTK keeps finer tables and does not
        round interpolated samples to grey levels; 1 for any other.
    threads
        VTK's number of threads.
    maximum
        Whether it projects the largest sample of a ray, its maximum intensity projection.
    """

    def __init__(self, scene: Scene, scale: int, threads: int, maximum: bool = False):
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, scene, scale, threads, maximum), daemon=True)
        self._process.start()
        other.close()

    def __enter__(self) -> VtkCpu:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._process.kill()
        self._process.join()

    def frame(self, step: float = 1.0) -> Time:
        """Renders a frame with samples ``step`` smallest voxel spacings apart: the time it took, read-back included."""
        return self._ask(step)

    def image(self) -> NDArray[np.float64]:
        """The last frame: premultiplied RGBA (height, width, 4), row 0 at the top."""
        return self._ask(None)

    def _ask(self, question: float | None) -> Any:
        try:
            self._connection.send(question)
            if not self._connection.poll(PATIENCE):
                raise NotAvailableError(f"no frame within {PATIENCE:g} s")
            answer = self._connection.recv()
        except (EOFError, OSError):
            self._process.join()
            raise NotAvailableError(
                f"its process ended with exit code {self._process.exitcode} (off-screen OpenGL needs EGL or OSMesa)"
            ) from None
        if isinstance(answer, Exception):
            raise NotAvailableError(repr(answer))
        return answer


def _serve(connection: Connection, scene: Scene, scale: int, threads: int, maximum: bool) -> None:
    """Answers questions until the parent ends it."""
    # Without a display VTK looks for X first, and may end the process.
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        window, mapper = _window(scene, scale, threads)
        if maximum:
            mapper.SetBlendModeToMaximumIntensity()
        pixels = _Pixels(window, scene.size)
        frame = timed(pixels.render)
        while True:
            step = connection.recv()
            if step is None:
                connection.send(pixels.rgba)
            else:
                _set_step(mapper, step * scene.volume.smallest_spacing)
                connection.send(frame())
    except Exception as error:  # whatever it is, the parent reports it
        connection.send(error)


class _Pixels:
    """Renders a window and reads it back."""

    def __init__(self, window: Any, size: tuple[int, int]):
        self.window, self.size = window, size

    def render(self) -> None:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        width, height = self.size
        self.window.Render()
        bytes_ = vtkUnsignedCharArray()
        self.window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, bytes_)
        self.rgba = vtk_to_numpy(bytes_).reshape(height, width, 4)[::-1] / 255


def _set_step(mapper: Any, distance: float) -> None:
    mapper.SetSampleDistance(distance)
    mapper.SetInteractiveSampleDistance(distance)


def _window(scene: Scene, scale: int, threads: int) -> tuple[Any, Any]:
    """A render window with the scene, unshaded before a transparent black background, and its mapper."""
    import pyvista as pv
    import vtkmodules.vtkRenderingOpenGL2
    import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401, the OpenGL parts register themselves
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import (
        vtkColorTransferFunction,
        vtkRenderer,
        vtkRenderWindow,
        vtkVolume,
        vtkVolumeProperty,
    )
    from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

    own = scene.volume.numpy()
    grid = pv.ImageData(dimensions=own.shape[::-1], spacing=scene.volume.spacing, origin=scene.volume.origin)
    samples = own if scale == 1 else own * np.uint16(scale)
    grid.point_data["values"] = samples.ravel()

    color, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    low, high = scene.volume.range
    levels = int(high - low) if own.dtype.kind in "iu" else 255
    scalars = np.linspace(low, high, levels * POINTS + 1)
    tf, unit = scene.transfer_function, scene.volume.smallest_spacing
    for s, rgb, tau in zip(scalars, tf.color(scalars), tf.extinction(scalars, unit), strict=True):
        color.AddRGBPoint(scale * s, *rgb)
        opacity.AddPoint(scale * s, -np.expm1(-tau * unit))
    prop = vtkVolumeProperty()
    prop.SetColor(color)
    prop.SetScalarOpacity(opacity)
    prop.SetScalarOpacityUnitDistance(unit)
    prop.SetInterpolationTypeToLinear()
    prop.ShadeOff()

    mapper = vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(grid)
    mapper.SetNumberOfThreads(threads)
    # By default VTK takes coarser steps and fewer rays to reach a frame rate.
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.SetImageSampleDistance(1.0)
    volume = vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(prop)

    renderer = vtkRenderer()
    renderer.SetBackground(0, 0, 0)
    renderer.SetBackgroundAlpha(0)
    renderer.AddVolume(volume)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*scene.camera.position)
    camera.SetFocalPoint(*scene.camera.target)
    camera.SetViewUp(*scene.camera.up)
    camera.SetViewAngle(scene.camera.view_angle)
    if scene.camera.parallel_scale is not None:
        camera.ParallelProjectionOn()
        camera.SetParallelScale(scene.camera.parallel_scale)
    renderer.ResetCameraClippingRange()

    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetAlphaBitPlanes(True)
    window.SetSize(scene.size)
    window.AddRenderer(renderer)
    return window, mapper
