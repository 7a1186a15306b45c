"""VTK's ray casters, of processors (``vtkFixedPointVolumeRayCastMapper``) and of GPUs, in a process of their own.

VTK draws the mapper's image with OpenGL, even off-screen. Where there is none (no EGL, OSMesa or X) VTK may end the
process, so it runs in another one, which stays and measures its own frames.
"""

from __future__ import annotations

import os
import re
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wvr

from .peer import Peer
from .scenes import Scene

# VTK's opacity is linear between control points, wvr's extinction; close points make them one. Per grey level, of which
# floating-point samples count as having 255.
POINTS = 16
HINT = "off-screen OpenGL needs EGL or OSMesa"


class VtkCpu(Peer):
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
    lit
        Whether by VTK's headlight.
    """

    def __init__(self, scene: Scene, scale: int, threads: int, maximum: bool = False, lit: bool = False):
        super().__init__(Painter, scene, scale, threads, maximum, lit, hint=HINT)


class VtkGpu(Peer):
    """A scene in VTK's ray caster for GPUs, ``vtkGPUVolumeRayCastMapper``, through OpenGL; used with ``with``."""

    def __init__(self, scene: Scene):
        super().__init__(Painter, scene, 1, None, False, False, hint=HINT)

    def renderer(self) -> str:
        """What draws, as OpenGL says: a processor can, too."""
        return self.ask("renderer")


class Painter:
    """Renders a scene in a window and reads it back."""

    def __init__(self, scene: Scene, scale: int, threads: int | None, maximum: bool, lit: bool):
        # Without a display VTK looks for X first, and may end the process.
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        self.window, self.mapper = _window(scene, scale, threads, lit)
        if maximum:
            self.mapper.SetBlendModeToMaximumIntensity()
        self.size, self.spacing = scene.size, scene.volume.smallest_spacing

    def draw(self, step: float, camera: wvr.Camera | None) -> None:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        self.mapper.SetSampleDistance(step * self.spacing)
        if hasattr(self.mapper, "SetInteractiveSampleDistance"):
            self.mapper.SetInteractiveSampleDistance(step * self.spacing)
        if camera is not None:
            _set_camera(self.window.GetRenderers().GetFirstRenderer(), camera)
        width, height = self.size
        self.window.Render()
        bytes_ = vtkUnsignedCharArray()
        self.window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, bytes_)
        self.rgba = vtk_to_numpy(bytes_).reshape(height, width, 4)[::-1] / 255

    def image(self) -> NDArray[np.floating]:
        return self.rgba

    def renderer(self) -> str:
        found = re.search(r"renderer string: *(.*)", self.window.ReportCapabilities())
        return found.group(1) if found else ""


def _set_camera(renderer: Any, given: wvr.Camera) -> None:
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*given.position)
    camera.SetFocalPoint(*given.target)
    camera.SetViewUp(*given.up)
    camera.SetViewAngle(given.view_angle)
    if given.parallel_scale is not None:
        camera.ParallelProjectionOn()
        camera.SetParallelScale(given.parallel_scale)
    renderer.ResetCameraClippingRange()


def _window(scene: Scene, scale: int, threads: int | None, lit: bool) -> tuple[Any, Any]:
    """A render window with the scene before a transparent black background, and its mapper."""
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
    from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper, vtkGPUVolumeRayCastMapper

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
    prop.SetShade(lit)

    mapper = vtkGPUVolumeRayCastMapper() if threads is None else vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(grid)
    if threads is not None:
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
    _set_camera(renderer, scene.camera)

    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetAlphaBitPlanes(True)
    window.SetSize(scene.size)
    window.AddRenderer(renderer)
    return window, mapper
