"""A page and its socket on this machine: the ``websockets`` library, and who may come in.

rendercanvas has a backend for browsers, too. It is not used here since it has one canvas in a process, which the first
client alone drives, and accepts whoever asks; what it is made of, uvicorn and websockets, is more than this needs.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import threading
from collections.abc import Iterable
from http import HTTPStatus
from time import monotonic
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from .outbox import Outbox
from .page import resource
from .session import Session
from .state import Source

# Clients at a time, bytes of a message, and messages a second and in a burst: more than people and their mice make.
MOST_CLIENTS = 8
MOST_BYTES = 1 << 18
RATE, BURST = 300.0, 600.0
# The socket's name, beside the files of the page.
SOCKET = "socket"
PAGE = {
    "": ("index.html", "text/html"),
    "page.js": ("page.js", "text/javascript"),
    "viewer.js": ("viewer.js", "text/javascript"),
    "editor.js": ("editor.js", "text/javascript"),
    "overlay.js": ("overlay.js", "text/javascript"),
    "panel.js": ("panel.js", "text/javascript"),
    "viewer.css": ("viewer.css", "text/css"),
}
HOME = ("127.0.0.1", "localhost", "::1")
# Nothing from elsewhere is loaded, and nobody puts the page into a frame.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self' {socket}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Allowance:
    """So many messages a second, with bursts."""

    def __init__(self) -> None:
        self._left, self._at = BURST, monotonic()

    def take(self) -> bool:
        """Whether there is one more."""
        now = monotonic()
        self._left = min(self._left + RATE * (now - self._at), BURST)
        self._at = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Server:
    """Serves a source to browsers, in a thread of its own.

    Parameters
    ----------
    source
        What there is to see; each client has a session of its own.
    host, port
        Where; port 0 is a free one.
    token
        What the address has to have in it.

    Raises
    ------
    OSError
        Where the port is taken.
    """

    def __init__(self, source: Source, host: str, port: int, token: str):
        self._source = source
        self._host = host
        self._token = token
        self._sessions: set[Session] = set()
        self.arrived = threading.Event()
        self._ready = threading.Event()
        self._failed: BaseException | None = None
        self.port = port
        self.bound: set[str] = set()
        self._thread = threading.Thread(target=self._run, name="wvr-viewer-server", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._failed is not None:
            raise self._failed

    @property
    def address(self) -> str:
        """Where the page is."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self.port}/{self._token}/"

    @property
    def clients(self) -> int:
        """How many there are."""
        return len(self._sessions)

    @property
    def running(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def close(self) -> None:
        """End all sessions and the server; nothing is left running when this returns."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._closing.set)
            self._thread.join()

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        self._loop, self._closing = asyncio.get_running_loop(), asyncio.Event()
        log = logging.getLogger("wvr.viewer")
        log.setLevel(logging.CRITICAL)  # whoever is refused has no business in a user's terminal
        try:
            server = await serve(
                self._client,
                self._host,
                self.port,
                process_request=self._request,
                max_size=MOST_BYTES,
                compression=None,
                server_header=None,
                logger=log,
                close_timeout=1,
            )
        except (OSError, OverflowError) as error:
            self._failed = OSError(f"port {self.port} of {self._host} cannot be served: {error}")
            self._ready.set()
            return
        names = [socket.getsockname() for socket in server.sockets]
        self.port, self.bound = names[0][1], {name[0] for name in names}
        self._ready.set()
        async with server:
            await self._closing.wait()
            # No picture is waited for when connections are closed.
            for session in list(self._sessions):
                await asyncio.to_thread(session.close)

    async def _client(self, connection: ServerConnection) -> None:
        if len(self._sessions) >= MOST_CLIENTS:
            await connection.close(1013, f"{MOST_CLIENTS} clients are here already")
            return
        outbox, allowance = Outbox(), Allowance()
        session = Session(self._source, outbox.put)
        self._sessions.add(session)
        self.arrived.set()
        sender = asyncio.create_task(_send(connection, outbox))
        try:
            session.greet()
            async for text in connection:
                if not allowance.take():
                    await connection.close(1008, f"more than {RATE:g} messages a second")
                    break
                message = _parsed(text)
                if message is None:
                    await connection.close(1003, "messages are JSON objects")
                    break
                if message.get("type") == "seen":
                    outbox.seen()
                else:
                    session.receive(message)
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            await asyncio.to_thread(session.close)
            self._sessions.discard(session)

    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file of the page, or None for the socket; what is not known is not there, and no reason is given."""
        host = request.headers.get("Host", "")
        name = urlsplit(f"//{host}").hostname
        if name not in (*HOME, self._host):
            return connection.respond(HTTPStatus.FORBIDDEN, "not a name of this machine\n")
        origin = request.headers.get("Origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return connection.respond(HTTPStatus.FORBIDDEN, "a page from elsewhere\n")
        token, _, rest = request.path.partition("?")[0].removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self._token.encode()):
            return connection.respond(HTTPStatus.NOT_FOUND, "nothing here: the address has a token in it\n")
        if rest == SOCKET:
            return None
        if rest not in PAGE:
            return connection.respond(HTTPStatus.NOT_FOUND, "nothing here\n")
        file, kind = PAGE[rest]
        response = connection.respond(HTTPStatus.OK, resource(file))
        for header, value in _headers(kind, POLICY.format(socket=f"ws://{host} wss://{host}")):
            if header in response.headers:
                del response.headers[header]
            response.headers[header] = value
        return response


def _headers(kind: str, policy: str) -> Iterable[tuple[str, str]]:
    yield "Content-Type", f"{kind}; charset=utf-8"
    yield "Content-Security-Policy", policy
    yield "Cache-Control", "no-store"
    yield "Referrer-Policy", "no-referrer"
    yield "X-Content-Type-Options", "nosniff"
    yield "Cross-Origin-Resource-Policy", "same-origin"


async def _send(connection: ServerConnection, outbox: Outbox) -> None:
    try:
        while True:
            await connection.send(await outbox.take())
    except ConnectionClosed:
        pass
    except Exception:
        # Open, it would look as if nothing happened any more; closed, the page says so and comes back.
        await connection.close(1011, "a message could not be sent")
        raise


def _parsed(text: str | bytes) -> dict[str, Any] | None:
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None
