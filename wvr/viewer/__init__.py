"""A progressive viewer that says how wrong its picture is: docs/viewer.md."""

from .viewer import Viewer, view

__all__ = ["Viewer", "view"]
