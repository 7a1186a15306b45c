"""What a user waits for before the first image: imports, and kernels that are compiled or loaded."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure

import wvr
from studies.base.harness import (
    Contender,
    Result,
    Settings,
    Time,
    bars,
    integrator_name,
    interleave,
    machine,
    summarize,
)
from wvr.renderer import TOLERANCE

from .scenes import make_scenes

INTEGRATORS = (wvr.Riemann(1.0), wvr.Certified(TOLERANCE))
BASELINE = "import wvr"
EMPTY = "empty cache"
CHILD = """\
import json, time
wall, cpu = time.perf_counter(), time.process_time()
{work}
print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu]))
"""
ONE_LINE = """\
import wvr
wvr.render("volume.npy", device="cpu")
"""
FIRST_IMAGE = """\
import numpy as np, wvr
volume = wvr.Volume(np.load("volume.npy"))
tf = wvr.TransferFunction.load("tf.json")
camera = wvr.Camera.fit(volume, parallel=True)
wvr.render(volume, tf, camera, {size}, integrator=wvr.{integrator!r}, device="cpu")
"""


def measure(settings: Settings) -> Result:
    """Seconds of imports and of the first image in new processes."""
    scene = make_scenes(settings.quick)[0]
    with TemporaryDirectory() as name:
        folder = Path(name)
        np.save(folder / "volume.npy", scene.volume.numpy())
        scene.transfer_function.save(folder / "tf.json")
        contenders = {module: _process(module, folder) for module in ("import warp", BASELINE)}
        contenders[f"one line, {EMPTY}"] = _process(ONE_LINE, folder, empty=True)
        contenders["one line, warm cache"] = _process(ONE_LINE, folder)
        for integrator in INTEGRATORS:
            work = FIRST_IMAGE.format(size=scene.size, integrator=integrator)
            first = f"first image, {integrator_name(integrator)}"
            contenders[f"{first}, {EMPTY}"] = _process(work, folder, empty=True)
            contenders[f"{first}, warm cache"] = _process(work, folder)
        # Compiling takes long: the first run and, of five, the last.
        every = {name: max(1, settings.rounds - 1) for name in contenders if name.endswith(EMPTY)}
        rows = summarize("new process", interleave(contenders, settings.rounds, every), BASELINE)
    notes = [
        "Each run is a new process, timed from its first statement on, without the start of Python itself.",
        "One line: wvr.render of a file, certified, lit, 512 x 512 pixels.",
        f"First image: import wvr, load the volume of scene {scene.name}, render. With an empty cache the kernel is "
        "compiled, with a warm one loaded.",
    ]
    return Result("cold", f"Until the first image, on the CPU: {scene.measures}", BASELINE, rows, notes, machine())


def charts(result: Result) -> dict[str, Figure]:
    """By file name."""
    return {"cold": bars(result, lambda row: (row.wall, row.fastest, row.slowest), "Wall clock [s]")}


def _process(work: str, folder: Path, empty: bool = False) -> Contender:
    """A new process that works in ``folder``; its kernel cache is there or, with ``empty``, new.

    Bytecode is kept, as where nobody says otherwise: to compile all that is imported takes longer than to import it.
    """

    def run() -> Time:
        with TemporaryDirectory() as new:
            environment = {**os.environ, "WARP_CACHE_PATH": new if empty else str(folder / "cache")}
            environment.pop("PYTHONDONTWRITEBYTECODE", None)
            command = [sys.executable, "-c", CHILD.format(work=work)]
            child = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        if child.returncode != 0:
            raise RuntimeError(child.stderr)
        return Time(*json.loads(child.stdout.splitlines()[-1]))

    return run
