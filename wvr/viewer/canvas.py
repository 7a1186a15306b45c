"""A viewer in any canvas of rendercanvas: a window of glfw, Qt or wx, a terminal, or off the screen.

Mouse and keys are the page's; of what the page has besides there is nothing here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .painter import Picture
from .session import Message, Session
from .state import Source

EVENTS = ("resize", "pointer_down", "pointer_move", "pointer_up", "wheel", "key_down", "close")


def attach(canvas: Any, source: Source) -> Session:
    """Show a source in a canvas, until the canvas is closed.

    The canvas asks for a picture when it draws; a picture that is there then is the newest.
    """
    context = canvas.get_bitmap_context()

    def send(message: Message, picture: Picture | None) -> None:
        if picture is not None:
            opaque = np.full((*picture.pixels.shape[:2], 1), 255, np.uint8)
            context.set_bitmap(np.concatenate([picture.pixels, opaque], axis=2))
            canvas.request_draw()
            canvas.set_title(f"{source.title}: {message['status']}")
        elif message["type"] in ("text", "error"):
            print(message.get("text") or message["message"])

    session = Session(source, send)

    def handle(event: Message) -> None:
        if event["event_type"] == "close":
            session.close()
        else:
            session.receive(event)

    canvas.add_event_handler(handle, *EVENTS)
    width, height = canvas.get_logical_size()
    session.receive({"type": "resize", "width": width, "height": height, "pixel_ratio": canvas.get_pixel_ratio()})
    return session
