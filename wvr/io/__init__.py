"""Files to volumes and back: NRRD, MetaImage, NIfTI, TIFF, DICOM, NumPy, VTK image files, raw samples, PyVista.

World coordinates are those of the file: nothing is flipped or turned, what a file says of spacing, origin and
orientation ends up in ``Volume.spacing``, ``.origin`` and ``.direction`` (NRRD and NIfTI often mean right-anterior-
superior, MetaImage and DICOM left-posterior-superior). Where a file stores a slope and an intercept (NIfTI, DICOM) they
are applied.

A volume keeps the file's dtype. Types it does not accept (bool, 32- and 64-bit integers) become the smallest of uint8,
int8, uint16, int16, float64 that holds every value exactly, or are refused if none does.

NRRD, MetaImage and NIfTI are parsed here and not by VTK, whose readers lose what this module must keep (VTK 9.7):
vtkNrrdReader takes the first axis of a volume with ``space directions`` for components and drops rotations;
vtkMetaImageReader transposes ``TransformMatrix``; vtkNIFTIImageReader leaves orientation and slope aside; and all of
them fill what a truncated file lacks with whatever the memory holds. vtkDICOMImageReader and vtkTIFFReader turn the
rows upside down as well and drop orientations, so pydicom and tifffile read those.
"""

from ..interop import from_pyvista, to_pyvista
from ..samples import NanPolicy
from .readers import read, read_raw

__all__ = ["NanPolicy", "from_pyvista", "read", "read_raw", "to_pyvista"]
