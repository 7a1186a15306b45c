"""Volumes by name: generated ones, which need nothing, and classic scans and simulations, which are downloaded once.

Generated volumes are cubes with spacing 1, the same for the same arguments. Downloads come from the Open
SciVis Datasets (https://klacansky.com/open-scivis-datasets/), whose names, sizes, spacings and SHA-512 sums
``DOWNLOADS`` repeats; several of these datasets are for research only, see there. Environment variables:
``WVR_DATASETS_URL``, a mirror with the same files; ``WVR_CACHE``, the folder to keep them in (by default the user's
cache folder).
"""

from .catalogue import GENERATED, load, names
from .downloads import DOWNLOADS, URL, Download, fetch

__all__ = ["DOWNLOADS", "GENERATED", "URL", "Download", "fetch", "load", "names"]
