"""Run every study: ``python -m studies [--quick]``; results go to ``out/studies``."""

import sys

from . import campagnolo2015, clipping, frontier, lum2004, roettger2003, stability

for study in (lum2004, roettger2003, clipping, campagnolo2015, stability, frontier):
    study.main(*sys.argv[1:])
