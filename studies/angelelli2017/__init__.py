"""Angelelli and Bruckner, "Performance and Quality Analysis of Convolution-Based Volume Illumination" (2017).

Figures 1 and 3 to 7 and Table 1, the paper's numbers beside ours: by the sweep of ``wvr``, and slice by slice as the
paper has it. Then what the paper leaves open: how fast the image converges in the slice distance, how good the model
is, and a new volume each frame.
Head, abdomen and bonsai (for the carp) are scans where they are there, else generated volumes stand in; the cardiac
ultrasound is generated. Transfer functions and views are not published, so times compare in kind.
"""

from . import defaults, figures, model, slice_by_slice, speed
from .methods import STUDY

__all__ = ["STUDY", "defaults", "figures", "model", "slice_by_slice", "speed"]
