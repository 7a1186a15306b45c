"""The files of the page."""

from importlib.resources import files


def resource(name: str) -> str:
    """The text of one of them."""
    return (files(__name__) / name).read_text(encoding="utf-8")
