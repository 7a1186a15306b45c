"""``python -m wvr``, the same as the command ``wvr``."""

import sys

from .cli import main

sys.exit(main())
