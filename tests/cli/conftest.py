"""Command lines that are run in this process."""

import re
import sys

import numpy as np
import pytest

import wvr
from wvr import cli


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Runs a command line in an empty folder: exit code, stdout, and stderr but for kernels that are compiled."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["wvr", *map(str, arguments)])
        code = cli.main()
        out, err = capsys.readouterr()
        return code, out, re.sub("^wvr: compiling .* ahead\\)\n", "", err, flags=re.MULTILINE)

    return run


@pytest.fixture
def rendered(monkeypatch):
    """What the command line passes to ``wvr.render``, which renders nothing."""
    passed = {}

    def render(volume, *, transfer_function, size, **options):
        passed.update(volume=volume, tf=transfer_function, size=size, **options)
        image = np.full((size[1], size[0], 4), 0.5, np.float32)
        stats = {"samples": 1234567, "seconds": 0.25}
        return wvr.Image(image, np.ones(image.shape[:2], np.int32), None, stats, options["background"])

    monkeypatch.setattr(wvr, "render", render)
    return passed
