"""wvr, the Warp Volume Renderer: direct volume rendering of regular grids, fast and accurate, on CPUs and CUDA GPUs."""

from pathlib import Path

# Kernels are beside this folder where it is that of a checkout, and not of an installation.
if not (Path(__file__).parent / "kernels").is_dir():
    __path__.append(str(Path(__file__).parents[1]))

from . import datasets, doors, presets
from .bricks.open import build_ranges
from .bricks.open import open as open
from .bricks.stored import StoredVolume
from .camera import Camera
from .cancel import Cancelled
from .compare import Comparison, compare
from .cuts.labels import Segmentation
from .cuts.shapes import ClipBox, ClipPlane, ClipSphere
from .cuts.volumes import ClipVolume
from .enclosure import Enclosure, enclose
from .image import BoundedImage, Image, Pick
from .integrators import (
    AdaptivePreintegrated,
    AdaptiveSimpson,
    Certified,
    Exact,
    Isosurface,
    Preintegrated,
    Projection,
    Riemann,
    Simpson,
)
from .io import read, read_raw
from .launch import get_num_threads, set_num_threads
from .light.lighting import Lighting
from .light.lights import DirectionalLight, Headlight
from .light.shadows import ConvolutionShadows
from .movies import orbit, save_movie, time_series
from .renderer import Renderer, render
from .scattering import single_scattering
from .sources import as_volume
from .transfer.preintegration import preintegrate
from .transfer.table import Table
from .transfer_function import TransferFunction
from .viewer import Viewer, view
from .volume import Volume
from .warm_up import warm_up

__all__ = [
    "AdaptivePreintegrated",
    "AdaptiveSimpson",
    "BoundedImage",
    "Camera",
    "Cancelled",
    "Certified",
    "ClipBox",
    "ClipPlane",
    "ClipSphere",
    "ClipVolume",
    "Comparison",
    "ConvolutionShadows",
    "DirectionalLight",
    "Enclosure",
    "Exact",
    "Headlight",
    "Image",
    "Isosurface",
    "Lighting",
    "Pick",
    "Preintegrated",
    "Projection",
    "Renderer",
    "Riemann",
    "Segmentation",
    "Simpson",
    "StoredVolume",
    "Table",
    "TransferFunction",
    "Viewer",
    "Volume",
    "as_volume",
    "build_ranges",
    "compare",
    "datasets",
    "enclose",
    "get_num_threads",
    "open",
    "orbit",
    "preintegrate",
    "presets",
    "read",
    "read_raw",
    "render",
    "save_movie",
    "set_num_threads",
    "single_scattering",
    "time_series",
    "view",
    "warm_up",
]
__version__ = "0.2.0"

# Whoever imports xarray or PyVista first finds wvr at their objects; others import wvr.accessors.
doors.register_imported()
