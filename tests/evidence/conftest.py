"""Quick runs of studies, one of each in a file of tests."""

from pathlib import Path

import pytest

from studies import runner


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder of the results of a quick run of a study."""
    out = tmp_path_factory.mktemp("studies")
    done = set()

    def run(name: str) -> Path:
        if name not in done:
            assert runner.run(runner.find([name]), out, quick=True) == []
            done.add(name)
        return out / name

    return run
