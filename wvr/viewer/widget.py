"""The viewer in a Jupyter notebook: an anywidget with the page's own front end.

A notebook that is read without a kernel shows the last final picture: a PNG in the cell's output, for those who know no
widgets, and the same in the widget's saved state.
"""

from __future__ import annotations

import base64
import re
from threading import Lock
from typing import Any

import anywidget
import traitlets

from .outbox import UNSEEN, png
from .page import resource
from .painter import Picture
from .session import Message, Session
from .state import Source

# Of the picture that is there before anybody looks [pixels], and how long it is waited for [s].
STILL = 512
PATIENCE = 60.0
# Each after what it imports.
MODULES = ("editor.js", "overlay.js", "panel.js", "viewer.js", "widget.js")


def front_end() -> str:
    """The page's modules as one, which is what anywidget takes."""
    text = "\n".join(resource(name) for name in MODULES)
    text = re.sub(r"^import .*$", "", text, flags=re.MULTILINE)
    return re.sub(r"^export (?!default)", "", text, flags=re.MULTILINE)


class Widget(anywidget.AnyWidget):
    """A view of a source, which the widget's places in a notebook drive together.

    Attributes
    ----------
    session
        What it shows.
    still
        The last final picture, as a data URL.
    """

    _esm = traitlets.Unicode(front_end()).tag(sync=True)
    _css = traitlets.Unicode(resource("viewer.css")).tag(sync=True)
    still = traitlets.Unicode("").tag(sync=True)

    def __init__(self, source: Source):
        super().__init__()
        self._lock = Lock()
        self._waiting: tuple[Message, Picture] | None = None
        self._unseen = UNSEEN  # nobody looks yet
        self.session = Session(source, self._put)
        self.on_msg(self._receive)
        self.session.receive({"type": "resize", "width": STILL, "height": STILL})
        self.session.settle(PATIENCE)

    def close(self) -> None:
        """End it."""
        self.session.close()
        super().close()

    def _put(self, message: Message, picture: Picture | None) -> None:
        if picture is None:
            self.send(message)
            return
        with self._lock:
            self._waiting = message, picture
        if picture.whole or not self.still:
            self.still = "data:image/png;base64," + base64.b64encode(png(picture)).decode()
        self._send_waiting()

    def _receive(self, _: Any, message: Any, __: Any) -> None:
        if not isinstance(message, dict):
            return
        if message.get("type") == "hello":
            self._unseen = 0
            self.session.greet()
            self._send_waiting()
        elif message.get("type") == "seen":
            self._unseen = max(self._unseen - 1, 0)
            self._send_waiting()
        else:
            self.session.receive(message)

    def _send_waiting(self) -> None:
        """The newest picture, if what was sent before has been drawn."""
        with self._lock:
            if self._waiting is None or self._unseen >= UNSEEN:
                return
            message, picture = self._waiting
            self._waiting = None
            self._unseen += 1
        self.send(message, [png(picture)])

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        bundle = super()._repr_mimebundle_(**kwargs)
        data, metadata = bundle if isinstance(bundle, tuple) else (bundle or {}, {})
        return data | {"image/png": self.still.partition(",")[2]}, metadata
