"""VTK image data, with VTK's own readers, which do not say by themselves that a file is damaged."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..interop import RESAMPLE

if TYPE_CHECKING:
    import pyvista as pv


def read_vtk_image(path: Path) -> pv.ImageData:
    """The ``ImageData`` in a .vti or legacy .vtk file."""
    import pyvista as pv
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    is_xml = path.suffix.lower() == ".vti"
    # VTK does not notice that raw appended samples end early.
    if is_xml and b"</VTKFile>" not in path.read_bytes()[-100:]:
        raise OSError(f"{path} is truncated: it does not end in </VTKFile>")
    reader = vtkXMLImageDataReader() if is_xml else vtkGenericDataObjectReader()
    reader.SetFileName(str(path))
    with _messages() as messages:
        reader.Update()
    if messages or reader.GetOutput() is None:
        raise OSError(f"{path} is truncated or corrupt: {messages[0] if messages else 'VTK reads nothing from it'}")
    image = pv.wrap(reader.GetOutput())
    if not isinstance(image, pv.ImageData):
        raise ValueError(f"{path} holds a {type(image).__name__}; {RESAMPLE}")
    sizes = [len(image.point_data[n]) - image.n_points for n in image.point_data]
    sizes += [len(image.cell_data[n]) - image.n_cells for n in image.cell_data]
    if not sizes or any(sizes) or image.n_points == 0:
        raise OSError(f"{path} is truncated or corrupt: its samples cannot be read")
    return image


@contextmanager
def _messages() -> Iterator[list[str]]:
    """Collects the warnings and errors that VTK would print; the list is complete after the block."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    messages: list[str] = []
    window, printed, verbosity = (
        vtkStringOutputWindow(),
        vtkOutputWindow.GetInstance(),
        vtkLogger.GetCurrentVerbosityCutoff(),
    )
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield messages
    finally:
        vtkLogger.SetStderrVerbosity(vtkLogger.ConvertToVerbosity(verbosity))
        vtkOutputWindow.SetInstance(printed)
        text = window.GetOutput() or ""  # bytes if it quotes a file's nonsense
        text = text.decode(errors="replace") if isinstance(text, bytes) else text
        messages += [message for message in text.strip().split("\n\n") if message]
