"""wvr, the Warp Volume Renderer: direct volume rendering of regular grids, fast and accurate, on CPUs and CUDA GPUs."""

from . import datasets, presets
from .camera import Camera
from .clipping import ClipBox, ClipPlane, ClipSphere, ClipVolume
from .compare import Comparison, compare
from .image import Image
from .integrators import AdaptivePreintegrated, AdaptiveSimpson, Certified, Exact, Preintegrated, Riemann, Simpson
from .io import read, read_raw
from .launch import get_num_threads, set_num_threads
from .lighting import Lighting
from .lights import DirectionalLight, Headlight
from .renderer import Renderer, render
from .scattering import single_scattering
from .segmentation import Segmentation
from .shadows import ConvolutionShadows
from .tables import Table, preintegrate
from .transfer_function import TransferFunction
from .volume import Volume

__all__ = [
    "AdaptivePreintegrated",
    "AdaptiveSimpson",
    "Camera",
    "Certified",
    "ClipBox",
    "ClipPlane",
    "ClipSphere",
    "ClipVolume",
    "Comparison",
    "ConvolutionShadows",
    "DirectionalLight",
    "Exact",
    "Headlight",
    "Image",
    "Lighting",
    "Preintegrated",
    "Renderer",
    "Riemann",
    "Segmentation",
    "Simpson",
    "Table",
    "TransferFunction",
    "Volume",
    "compare",
    "datasets",
    "get_num_threads",
    "preintegrate",
    "presets",
    "read",
    "read_raw",
    "render",
    "set_num_threads",
    "single_scattering",
]
__version__ = "0.1.0"
