"""Doors for other libraries: ``grid.wvr`` and ``plotter.wvr`` of PyVista, ``array.wvr`` of xarray.

Importing wvr opens those of libraries that are there, :mod:`wvr.accessors` all of them.
"""

from __future__ import annotations

import os
import sys
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from .camera import Camera
from .image import Image
from .sources import as_volume
from .transfer_function import TransferFunction
from .validation import outside
from .volume import Volume

if TYPE_CHECKING:
    import pyvista as pv


class Accessor:
    """wvr for a dataset: ``dataset.wvr.render(...)``.

    Parameters
    ----------
    dataset
        Whatever :func:`wvr.as_volume` takes.
    """

    def __init__(self, dataset: Any):
        self._dataset = dataset

    def volume(self, scalars: str | None = None) -> Volume:
        """The dataset as a volume, see :func:`wvr.as_volume`."""
        return as_volume(self._dataset, scalars=scalars)

    def render(self, *arguments: Any, scalars: str | None = None, **keywords: Any) -> Image:
        """Render it: the arguments of :func:`wvr.render` but the first, and which array it is of."""
        from .renderer import render

        return render(self.volume(scalars), *arguments, **keywords)

    def orbit(self, *arguments: Any, scalars: str | None = None, **keywords: Any) -> Any:
        """A way around it: the arguments of :func:`wvr.orbit` but the first."""
        from .movies import orbit

        return orbit(self.volume(scalars), *arguments, **keywords)


class PlotterAccessor:
    """wvr for a PyVista plotter with a volume: the same view, colours and opacities, within a tolerance."""

    def __init__(self, plotter: pv.Plotter):
        self._plotter = plotter

    def screenshot(self, path: str | os.PathLike[str] | None = None, **keywords: Any) -> Image:
        """Render the volume that the plotter shows, as large as its window, in front of its background.

        Opacities are linear between VTK's control points, to 1/512, and colours as light, where VTK composites them
        sRGB-encoded: pictures differ in what is translucent. Meshes, clipping and cropping by VTK, other blending and
        gradients behind are not in it.

        Parameters
        ----------
        path
            Where to save it, if anywhere.
        **keywords
            As of :func:`wvr.render`; what is given there goes before what the plotter has.

        Raises
        ------
        ValueError
            For a plotter without a volume, or with several.

        Warns
        -----
        UserWarning
            For what the plotter has and the picture has not.
        """
        from .renderer import render

        plotter = self._plotter
        shown = [actor for actor in plotter.actors.values() if actor.GetVisibility()]
        actors = [actor for actor in shown if actor.IsA("vtkVolume")]
        if len(actors) != 1:
            raise ValueError(f"plotter must have one visible volume, added by add_volume, got {len(actors)}")
        if out := left_out(actors[0].GetMapper(), plotter.renderer, shown):
            warnings.warn(
                f"the plotter has {', '.join(out)}, which is not in this picture: docs/projections.md has meshes, "
                f"clip= and integrator= what else there is",
                stacklevel=outside(),
            )
        size = tuple(int(n) for n in plotter.window_size)
        found = {
            "transfer_function": function_of_vtk(actors[0].GetProperty()),
            "camera": Camera.from_pyvista(plotter.camera),
            "size": size,
            "background": plotter.background_color.hex_rgb,
            "lighting": bool(actors[0].GetProperty().GetShade()),
        }
        volume = as_volume(actors[0].GetMapper().GetDataSetInput())
        image = render(moved(volume, actors[0].GetMatrix()), **(found | keywords))
        if path is not None:
            image.save(path)
        return image


def left_out(mapper: Any, renderer: Any, shown: list[Any]) -> list[str]:
    """What VTK shows beside a volume, or does to it, and wvr does not."""
    planes = mapper.GetClippingPlanes()
    there = {
        "meshes": any(actor.IsA("vtkActor") for actor in shown),
        "clipping planes": planes is not None and planes.GetNumberOfItems() > 0,
        "cropping": bool(mapper.GetCropping()),
        "other blending": mapper.GetBlendMode() != 0,
        "a gradient behind": bool(renderer.GetGradientBackground()),
    }
    return [name for name, is_there in there.items() if is_there]


def moved(volume: Volume, matrix: Any) -> Volume:
    """A volume where the matrix of VTK's actor takes it."""
    place = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    if np.array_equal(place, np.eye(4)):
        return volume
    pose = place @ volume.index_to_world
    spacing = np.linalg.norm(pose[:3, :3], axis=0)
    return Volume(volume.numpy(), spacing, pose[:3, 3], pose[:3, :3] / spacing, nan=volume.nan)


def function_of_vtk(volume_property: Any) -> TransferFunction:
    """The transfer function of a ``vtkVolumeProperty``, by 256 or more samples of its colours and opacities."""
    from .color import srgb_to_linear

    rgb, opacity = volume_property.GetRGBTransferFunction(), volume_property.GetScalarOpacity()
    at: list[float] = []
    for function, values in ((rgb, 6), (opacity, 4)):
        node = [0.0] * values
        for n in range(function.GetSize()):
            function.GetNodeValue(n, node)
            at.append(node[0])
    scalars = np.unique([*at, *np.linspace(min(at), max(at), 256)])
    colors = srgb_to_linear([rgb.GetColor(s) for s in scalars])
    opacities = np.clip([opacity.GetValue(s) for s in scalars], 0, 1)
    return TransferFunction.from_arrays(scalars, colors, opacities, volume_property.GetScalarOpacityUnitDistance())


def read_for_pyvista(path: str, **keywords: Any) -> pv.ImageData:
    """A PyVista ``ImageData`` of a file, for ``pyvista.read``; see :func:`wvr.read`."""
    from .io import read

    return read(path, **keywords).to_pyvista()


def register_pyvista() -> None:
    import pyvista as pv

    if hasattr(pv.Plotter, "wvr"):
        return
    if hasattr(pv, "register_dataset_accessor"):  # 0.48
        pv.register_dataset_accessor("wvr", pv.DataSet)(Accessor)
    pv.Plotter.wvr = property(PlotterAccessor)


def register_xarray() -> None:
    import xarray

    if hasattr(xarray.DataArray, "wvr"):
        return
    for register in (xarray.register_dataarray_accessor, xarray.register_dataset_accessor):
        register("wvr")(Accessor)


def register_imported() -> None:
    """Open the doors of the libraries that are imported, and import none."""
    for library, register in (("pyvista", register_pyvista), ("xarray", register_xarray)):
        if library in sys.modules:
            register()
