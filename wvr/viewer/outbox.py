"""What one client is to be sent: messages in order, and of pictures always the newest."""

from __future__ import annotations

import asyncio
import struct
from collections import deque
from contextlib import suppress
from io import BytesIO
from threading import Lock
from typing import Any

from .describe import dumps
from .painter import Picture

Message = dict[str, Any]
# Pictures that are under way and not yet drawn: more would be old when they come.
UNSEEN = 2
# Of these only the last counts.
REPLACED = ("state", "picked")


class Outbox:
    """Filled by any thread, emptied by one task of an event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._lock = Lock()
        self._messages: deque[Message] = deque()
        self._picture: tuple[Message, Picture] | None = None
        self._unseen = 0
        self._stirred = asyncio.Event()

    def put(self, message: Message, picture: Picture | None) -> None:
        """A message, and the picture that it is of; a picture that waits is dropped for a newer one."""
        with self._lock:
            if picture is not None:
                self._picture = message, picture
            else:
                if message["type"] in REPLACED:
                    self._messages = deque(m for m in self._messages if m["type"] != message["type"])
                self._messages.append(message)
        self._stir()

    def seen(self) -> None:
        """The client has drawn a picture."""
        self._unseen = max(self._unseen - 1, 0)
        self._stirred.set()

    async def take(self) -> str | bytes:
        """What is to be sent next, when there is something."""
        while True:
            self._stirred.clear()
            with self._lock:
                if self._messages:
                    return dumps(self._messages.popleft())
                taken = self._picture if self._unseen < UNSEEN else None
                if taken is not None:
                    self._picture = None
            if taken is not None:
                self._unseen += 1
                return await asyncio.to_thread(framed, *taken)
            await self._stirred.wait()

    def _stir(self) -> None:
        with suppress(RuntimeError):  # the server has ended
            self._loop.call_soon_threadsafe(self._stirred.set)


def framed(message: Message, picture: Picture) -> bytes:
    """A picture for the wire: the length of the message, big-endian, the message, and a PNG."""
    header = dumps(message).encode()
    return struct.pack(">I", len(header)) + header + png(picture)


def png(picture: Picture) -> bytes:
    """Its pixels, no digit lost; written as fast as can be, since they are not kept."""
    from PIL import Image

    file = BytesIO()
    Image.fromarray(picture.pixels).save(file, "PNG", compress_level=1)
    return file.getvalue()
