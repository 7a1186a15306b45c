"""The command line: ``wvr render``, ``wvr orbit``, ``wvr view``, ``wvr info``, ``wvr ranges``, ``wvr warm-up`` and
``wvr study``.

Results go to stdout, everything else to stderr. Exit codes: 0; 1 where a file, device, memory or study fails; 2 for
arguments that are not accepted; 130 for Ctrl-C.
"""

from .app import app, main
from .info import info
from .orbit import orbit
from .render import render
from .stores import ranges
from .study import study
from .view import view
from .warm_up import warm_up

__all__ = ["app", "info", "main", "orbit", "ranges", "render", "study", "view", "warm_up"]
