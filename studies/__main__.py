"""Run every study: ``python -m studies [--quick]``; results go to ``out/studies``."""

import sys

from . import lum2004, stability

for study in (lum2004, stability):
    study.main(*sys.argv[1:])
