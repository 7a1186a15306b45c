"""What was compiled ahead is not compiled again, and who waits for a compiler is told so."""

import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

import wvr

from .helpers import SMOOTH

CODE = """
import numpy as np, wvr
if {ahead}:
    print(wvr.warm_up(lighting=False, dtype="int8", integrator=wvr.Riemann(1.0)))
    print("warm", file=__import__("sys").stderr)
volume = wvr.Volume(np.arange(60, dtype=np.int8).reshape(3, 4, 5))
tf = wvr.TransferFunction([(0, "red", 0.0), (60, "red", 0.5)])
wvr.render(volume, tf, "iso", (8, 8), integrator=wvr.Riemann(0.5))
"""


def test_compiling_ahead(tmp_path):
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}

    def run(ahead):
        command = [sys.executable, "-c", CODE.format(ahead=ahead)]
        return subprocess.run(command, env=environment, capture_output=True, text=True)

    done = subprocess.run(
        [sys.executable, "-c", CODE.format(ahead=True)], env=environment, capture_output=True, text=True
    )
    assert done.stdout == "['int8, not lit']\n", done.stderr
    before, after = done.stderr.split("warm\n")
    # Said on stderr though nobody set up logging, once a kernel, and nothing more afterwards.
    assert before.count("wvr: compiling the kernel") >= 2 and "compiling" not in after
    again = subprocess.run(
        [sys.executable, "-c", CODE.format(ahead=False)], env=environment, capture_output=True, text=True
    )
    assert again.returncode == 0 and "compiling" not in again.stderr


def test_logging_silences_it():
    code = "import logging; from wvr.notices import announce; announce('a %s', 1); "
    code += "logging.getLogger('wvr').setLevel('WARNING'); announce('b')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("", "wvr: a 1\n")


def test_combinations():
    made = wvr.warm_up((True, False), integrator=wvr.Riemann(1.0), dtype=["uint8", "float32"])
    assert made == ["uint8, lit", "uint8, not lit", "float32, lit", "float32, not lit"]


def test_what_a_scene_is_warmed_up_for():
    """Labels of any shape, clips wherever they are, samples that are absent; without a word of what is to be seen."""
    labels = np.zeros((3, 40, 5), np.uint8)
    labels[0] = 7
    far = wvr.ClipBox((100, 100, 100), (200, 200, 200))
    options = {"lighting": False, "dtype": "float32", "nan": True, "integrator": wvr.Riemann(1.0)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for given in (labels, wvr.Segmentation(labels, {7: SMOOTH})):
            assert wvr.warm_up(clip=far, segmentation=given, **options) == ["float32, not lit"]
        # What light does not change is compiled without.
        assert wvr.warm_up(True, integrator=wvr.Projection("max"), dtype="uint8") == ["uint8, not lit"]


@pytest.mark.parametrize("name", ["size", "camera", "depth", "clim", "opacity"])
def test_what_no_kernel_is_made_for(name):
    with pytest.raises(TypeError, match=f"warm_up has no keyword '{name}': kernels are the same"):
        wvr.warm_up(**{name: None})
    with pytest.raises(TypeError, match="transfer_function must be a TransferFunction"):
        wvr.warm_up(transfer_function="viridis")
