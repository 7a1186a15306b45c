"""Run every study: ``python -m studies [--quick]``; results go to ``out/studies``."""

import sys

from . import angelelli2017, campagnolo2015, frontier, lum2004, roettger2003, stability

for study in (lum2004, roettger2003, campagnolo2015, angelelli2017, stability, frontier):
    study.main(*sys.argv[1:])
