"""What was compiled ahead is not compiled again, and who waits for a compiler is told so."""

import os
import subprocess
import sys

import wvr

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
