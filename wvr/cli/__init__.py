"""The command line: ``wvr render``, ``wvr info`` and ``wvr study``.

Results go to stdout, everything else to stderr. Exit codes: 0; 1 where a file, device, memory or study fails; 2 for
arguments that are not accepted; 130 for Ctrl-C.
"""

from .app import app, main
from .info import info
from .render import render
from .study import study

__all__ = ["app", "info", "main", "render", "study"]
