"""Doors for other libraries: ``grid.wvr`` and ``plotter.wvr`` of PyVista, ``array.wvr`` of xarray.

PyVista finds ``grid.wvr`` and the reader by entry points, without an import; importing this module, or wvr after the
library, is what the others need.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

from .camera import Camera
from .image import Image
from .sources import as_volume
from .transfer_function import TransferFunction
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
        sRGB-encoded: pictures differ in what is translucent. Meshes, and clipping by VTK, are not in it.

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
        """
        from .renderer import render

        plotter = self._plotter
        actors = [actor for actor in plotter.actors.values() if hasattr(actor, "GetProperty") and _is_volume(actor)]
        if len(actors) != 1:
            raise ValueError(f"plotter must have one volume, added by add_volume, got {len(actors)}")
        size = tuple(int(n) for n in plotter.window_size)
        found = {
            "transfer_function": function_of_vtk(actors[0].GetProperty()),
            "camera": Camera.from_pyvista(plotter.camera),
            "size": size,
            "background": plotter.background_color.hex_rgb,
            "lighting": bool(actors[0].GetProperty().GetShade()),
        }
        image = render(as_volume(actors[0].GetMapper().GetDataSetInput()), **(found | keywords))
        if path is not None:
            image.save(path)
        return image


def _is_volume(actor: Any) -> bool:
    return bool(actor.IsA("vtkVolume"))


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

    if hasattr(pv, "register_dataset_accessor"):  # 0.48
        pv.register_dataset_accessor("wvr", pv.DataSet)(Accessor)
    pv.Plotter.wvr = property(PlotterAccessor)


def register_xarray() -> None:
    import xarray

    for register in (xarray.register_dataarray_accessor, xarray.register_dataset_accessor):
        register("wvr")(Accessor)


for library, register in (("pyvista", register_pyvista), ("xarray", register_xarray)):
    if library in sys.modules:
        register()
