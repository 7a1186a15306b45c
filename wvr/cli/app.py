"""Which command it is, and what its failures are."""

from __future__ import annotations

import os
import sys
import warnings

from cyclopts import App, CycloptsError, UnusedCliTokensError

from .. import __version__
from .info import info
from .orbit import orbit
from .render import render
from .stores import ranges
from .study import study
from .view import view
from .warm_up import warm_up

app = App(name="wvr", help="Direct volume rendering, fast and accurate.", version=__version__, help_format="markdown")
for command in (render, orbit, view, info, ranges, warm_up, study):
    app.command(command)
app.register_install_completion_command(help="Have the shell complete commands and options.")


def main() -> int:
    """Run the command line in ``sys.argv``; returns the exit code."""
    warnings.showwarning = _warned
    try:
        command, bound, *_ = app.parse_args(sys.argv[1:], exit_on_error=False, print_error=False, verbose=False)
        code = command(*bound.args, **bound.kwargs) or 0
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever reads has enough; Python flushes once more at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except UnusedCliTokensError as error:
        rest = " ".join(error.unused_tokens or ())
        return _failed(ValueError(f"nothing takes {rest!r}; several numbers are one argument, as in --clim 0,255"), 2)
    except (CycloptsError, ValueError, TypeError) as error:
        return _failed(error, 2)
    except (OSError, MemoryError, ImportError) as error:
        return _failed(error, 1)


def _warned(message: Warning | str, *_: object, **__: object) -> None:
    # Of no line of the user's.
    print(f"wvr: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _failed(error: Exception, code: int) -> int:
    # One line, whatever the message quotes. A MemoryError of Python's own has no message.
    message = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, OSError) and error.filename is not None:
        message = f"{error.strerror}: {error.filename}"
    print(f"wvr: error: {message}", file=sys.stderr)
    return code
