"""Importing this opens ``grid.wvr`` and ``plotter.wvr`` of PyVista and ``array.wvr`` of xarray, whatever came first.

It is PyVista's entry point, which is imported once: wvr opens doors without it, or PyVista, imported later, had none.
"""

from contextlib import suppress

from .doors import Accessor as Accessor
from .doors import PlotterAccessor as PlotterAccessor
from .doors import read_for_pyvista as read_for_pyvista
from .doors import register_pyvista, register_xarray

register_pyvista()
with suppress(ImportError):  # xarray may not be installed
    register_xarray()
