"""The first cases of every kind; more of them by ``make fuzz``."""

from __future__ import annotations

import inspect
import json

import numpy as np
import pytest

import wvr

from .arguments import bases
from .files import mutated
from .run import run

pytest.importorskip("h5py")
pytest.importorskip("mrcfile")
resource = pytest.importorskip("resource")


@pytest.mark.parametrize("kind, cases", [("files", 500), ("arguments", 250), ("scenes", 10)])
def test_nothing_breaks_it(kind, cases):
    found = [one for one in run(kind, range(cases)) if one.outcome != "right"]
    assert not found, "\n".join(f"{one.kind} {one.number}: {one.outcome} {one.note}" for one in found)


def test_everything_public_is_called(tmp_path):
    called = {name.partition(".")[0] for name in bases(tmp_path)}
    public = {name for name in wvr.__all__ if callable(getattr(wvr, name)) and not name.startswith("_")}
    public -= {name for name in public if inspect.isclass(one := getattr(wvr, name)) and issubclass(one, Exception)}
    # Two serve pages, and two are made by ``open`` and ``Image.pick``.
    assert public - {"Viewer", "view", "StoredVolume", "Pick"} <= called


def test_what_goes_wrong_is_noticed(tmp_path, monkeypatch):
    """Each outcome, of workers for cases that bring it about."""
    from . import run as runner

    monkeypatch.setitem(runner.LIMITS, "files", 1.0)
    script = tmp_path / "worker.py"
    script.write_text(
        "import os, sys, time\n"
        "from tests.fuzz import worker\n"
        "class Cases:\n"
        "    def __init__(self, folder): self.kept = []\n"
        "    def run(self, rng):\n"
        "        number = int(rng)\n"
        "        if number == 1: os.abort()\n"
        "        if number == 2: time.sleep(60)\n"
        "        if number == 3: self.kept.append(b'x' * (worker.GROWTH + 2**26))\n"
        "        if number == 4: raise KeyError('what')\n"
        "        if number == 5: print('words', flush=True)\n"
        "        return 'wrong: it is' if number == 6 else ''\n"
        "worker.cases_of = lambda kind: Cases\n"
        "worker.rng_of = lambda kind, number: number\n"
        "worker.main()\n"
    )
    monkeypatch.setattr(runner, "COMMAND", (*runner.COMMAND[:1], str(script)))
    monkeypatch.setenv("PYTHONPATH", str(runner.ROOT))
    outcomes = [one.outcome for one in runner.run("files", range(7))]
    assert outcomes == ["right", "crash", "hang", "blow-up", "unclear", "unclear", "wrong"]


def test_cases_follow_from_their_number():
    content, other = b"NRRD0004\nsizes: 5 3 4\n\n" + bytes(100), b"other" * 20

    def cases():
        return [mutated(content, other, np.random.default_rng([0, n])) for n in range(200)]

    assert cases() == cases()
    assert len(set(cases())) > 150


def test_it_goes_on_where_it_ended(tmp_path, monkeypatch, capsys):
    from . import __main__ as program
    from .run import Found

    numbers = []

    def few(kind, given):
        for number in given:
            numbers.append((kind, number))
            yield Found(kind, number, "wrong" if number == 1 else "right", "wrong: it is" if number == 1 else "")

    clock = iter(range(10**6))
    monkeypatch.setattr(program, "run", few)
    monkeypatch.setattr(program.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr("sys.argv", ["fuzz", "files", "--minutes", "0.1", "--state", str(tmp_path / "state.json")])
    assert program.main() == 1
    once = len(numbers)
    assert program.main() == 1
    assert numbers == [("files", number) for number in range(len(numbers))] and len(numbers) > once
    assert json.loads((tmp_path / "state.json").read_text())["found"] == [["files", 1, "wrong", "wrong: it is", ""]]
    assert "files 1: wrong: it is" in capsys.readouterr().out
