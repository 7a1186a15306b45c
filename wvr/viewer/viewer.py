"""``wvr.view``: a viewer of a volume, in a browser or a notebook."""

from __future__ import annotations

import os
import re
import secrets
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..defaults import Call
from ..field.base import Field
from ..keywords import refuse

if TYPE_CHECKING:
    from .server import Server
    from .state import Source

HOST = "127.0.0.1"
# Of a renderer, what a viewer takes besides how it looks.
OPTIONS = ("integrator", "tolerance", "precision", "device", "termination", "skip_empty")
LOOK = tuple(name for name in Call._fields if name != "transfer_function")
# After the last client has gone, so long for it to come back [s].
GRACE = 5.0


def view(
    data: Any,
    transfer_function: Any = None,
    *,
    port: int = 0,
    open_browser: bool = True,
    token: str | None = None,
    **options: Any,
) -> Any:
    """Turn, light, cut and classify a volume; the picture says how wrong it is at any time.

    A page on this machine, in a browser; in a Jupyter notebook a widget. Every event is answered by a coarse picture at
    once, which is then refined until its error is within the tolerance; the last one is that of :func:`wvr.render` for
    the same camera, bit for bit. All is computed here, nothing in the browser. See docs/viewer.md.

    Parameters
    ----------
    data, transfer_function
        As of :func:`wvr.render`; or a list of volumes, files or arrays [z, y, x], of which a slider shows one.
    port
        Of the page, on 127.0.0.1; 0, the default, is a free one.
    open_browser
        Whether to open the page. A script then waits here until the page is closed, or for Ctrl-C.
    token
        What the page's address has in it, at least 16 letters, digits, - and _; by default a new random one. Who does
        not know it sees nothing. With a token and a port of one's own, pages find a viewer that was started again.
    **options
        Other keywords of :func:`wvr.render`: ``camera``, ``tolerance``, ``lighting``, ``clip``, ...; but for ``size``,
        ``cancel``, ``depth``, and those of volumes in bricks (``memory_limit``, ``budget``, ``missing``, ``client``).

    Returns
    -------
    Viewer
        With its ``address``; a notebook shows a widget instead.

    Raises
    ------
    TypeError, ValueError
        As :func:`wvr.render`.
    ImportError
        Without the packages of ``pip install wvr[viewer]``.
    OSError
        Where the port is taken.

    Examples
    --------
    >>> import wvr
    >>> with wvr.view(wvr.datasets.load("blobs", 16), open_browser=False) as viewer:
    ...     viewer.address.startswith("http://127.0.0.1:")
    True
    """
    source = source_of(data, transfer_function, options)
    if in_notebook():
        try:
            from .widget import Widget
        except ImportError as error:
            raise ImportError(f"in notebooks the viewer needs anywidget: pip install wvr[viewer] ({error})") from None
        return Widget(source)
    viewer = Viewer(source, port, token)
    if open_browser:
        import webbrowser

        print(f"wvr: {source.title} at {viewer.address}", file=sys.stderr)
        webbrowser.open(viewer.address)
        if not (hasattr(sys, "ps1") or sys.flags.interactive or _shell() is not None):
            viewer.wait()
    return viewer


class Viewer:
    """A page with a volume on it, served until it is closed; made by :func:`wvr.view`.

    Parameters
    ----------
    source
        What there is to see, as of ``wvr.viewer.viewer.source_of``.
    port, token
        As of :func:`wvr.view`.

    Attributes
    ----------
    address
        Of the page. It has a token in it: who is told the address may look and turn.
    """

    def __init__(self, source: Source, port: int = 0, token: str | None = None):
        if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 65536:
            raise ValueError(f"port must be an integer from 0 to 65535, got {port!r}")
        if token is not None and (not isinstance(token, str) or not re.fullmatch(r"[A-Za-z0-9_-]{16,}", token)):
            raise ValueError("token must be at least 16 letters, digits, - and _")  # which it is, is not said
        server_of = _imported()
        self._server: Server = server_of(source, HOST, port, token or secrets.token_urlsafe(24))
        self.address = self._server.address

    @property
    def clients(self) -> int:
        """How many pages are open."""
        return self._server.clients

    def wait(self, forever: bool = False) -> None:
        """Stay until all pages are closed, one at least having been open, or Ctrl-C; then close.

        Parameters
        ----------
        forever
            Stay until Ctrl-C or :meth:`close` from another thread.
        """
        try:
            alone = time.monotonic()
            while self._server.running:
                if self.clients or not self._server.arrived.is_set():
                    alone = time.monotonic()
                if not forever and time.monotonic() - alone > GRACE:
                    break
                time.sleep(0.1)
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def close(self) -> None:
        """End it; nothing is left running when this returns."""
        self._server.close()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Viewer({self.address}, {self.clients} open)" if self._server.running else "Viewer(closed)"


def source_of(data: Any, transfer_function: Any, options: dict[str, Any]) -> Source:
    """What a call of :func:`view` is to show."""
    from .state import Source

    known = (*LOOK, *OPTIONS)
    refuse("view", {name: options[name] for name in options if name not in known}, known)
    call = Call(transfer_function, **{name: options[name] for name in LOOK if name in options})
    frames = list(data) if _are_frames(data) else [data]
    return Source(frames, call, {name: options[name] for name in OPTIONS if name in options})


def _are_frames(data: Any) -> bool:
    """Whether these are several volumes, and not the numbers or slices of one."""
    if not isinstance(data, Sequence) or isinstance(data, str) or not data:
        return False
    return all(isinstance(one, Field | str | os.PathLike) or getattr(one, "ndim", 0) >= 3 for one in data)


def in_notebook() -> bool:
    """Whether this runs in a kernel of Jupyter, which shows widgets."""
    return hasattr(_shell(), "kernel")


def _shell() -> Any:
    """IPython's, if this runs in one."""
    ipython = sys.modules.get("IPython")
    return None if ipython is None else ipython.get_ipython()


def _imported() -> Any:
    try:
        from .server import Server
    except ImportError as error:
        raise ImportError(f"the viewer needs the package websockets: pip install wvr[viewer] ({error})") from None
    return Server
