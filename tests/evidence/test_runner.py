"""The runner keeps what is done and says what failed, and the report needs nothing else."""

import os
import shutil
import signal
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from studies import runner
from studies.base import harness
from studies.base.harness import machine
from studies.base.rows import write_rows
from studies.base.study import Study


@pytest.fixture
def study():
    """Of two parts; the second works as often as it is told to. And how often each was run."""
    study = Study("made-up", "A study")
    runs: list[str] = []

    @study.part("Table 1")
    def table(folder: Path, quick: bool) -> str:
        """The first table."""
        runs.append("table")
        write_rows(folder, "table", "Some <numbers>", [{"x": 1, "error": 1e-3}])
        return "One is one."

    @study.part("Table 2")
    def other(folder: Path, quick: bool) -> str:
        """The second."""
        runs.append("other")
        if runs.count("other") == 1:
            (folder / "half.csv").write_text("x")
            raise ArithmeticError("too hard")
        return "Done."

    study.runs = runs
    return study


def test_runs_resume_where_they_ended(tmp_path, study, monkeypatch):
    monkeypatch.setattr(runner, "find", lambda: [study])
    assert runner.run([study], tmp_path) == ["made-up, Table 2: ArithmeticError: too hard"]
    assert study.runs == ["table", "other"]  # the first table is not the end
    page = (tmp_path / "report.html").read_text()
    assert "One is one." in page and "Failed: ArithmeticError: too hard" in page and "Some &lt;numbers&gt;" in page
    assert runner.run([study], tmp_path, resume=True) == []
    assert study.runs == ["table", "other", "other"]
    assert not (tmp_path / "made-up" / "other" / "half.csv").exists()
    assert "Failed" not in (tmp_path / "report.html").read_text()
    # What was made in small, or by other code, is not what is asked for.
    runner.run([study], tmp_path, quick=True, resume=True)
    assert len(study.runs) == 5
    monkeypatch.setattr(runner, "_identity", lambda facts, quick: "other code")
    runner.run([study], tmp_path, quick=True, resume=True)
    assert len(study.runs) == 7
    assert not [path for path in (tmp_path / "made-up").iterdir() if path.name.startswith(".")]


def test_an_interrupted_run_keeps_what_is_done(tmp_path, study, monkeypatch):
    def interrupted(folder: Path, quick: bool) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "find", lambda: [study])
    study.part("Table 3")(interrupted)
    study.runs.append("other")
    with pytest.raises(KeyboardInterrupt):
        runner.run([study], tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "One is one." in page and "Not run." in page


@pytest.mark.parametrize("damage", ["", "{", "[]", "{}", '{"identity": 1}', "\0\0"])
def test_damaged_records_count_as_none(tmp_path, study, monkeypatch, caplog, damage):
    monkeypatch.setattr(runner, "find", lambda: [study])
    study.runs.append("other")
    assert runner.run([study], tmp_path) == []
    record = tmp_path / "made-up" / "table" / "part.json"
    record.write_text(damage)
    assert runner.run([study], tmp_path, resume=True) == []
    assert study.runs == ["other", "table", "other", "table"]
    assert str(record) in caplog.text and "is damaged" in caplog.text
    (record.parent / "table.csv").unlink()
    assert runner.run([study], tmp_path, resume=True) == []
    assert study.runs == ["other", "table", "other", "table", "table"] and (record.parent / "table.csv").exists()


def test_two_runs_do_not_share_a_folder(tmp_path, study, monkeypatch):
    monkeypatch.setattr(runner, "find", lambda: [study])

    def nested(folder: Path, quick: bool) -> str:
        with pytest.raises(OSError, match=f"{tmp_path} is in use by another run"):
            runner.run([study], tmp_path)
        return "Refused."

    study.runs.append("other")
    study.part("Table 3")(nested)
    assert runner.run([study], tmp_path) == []
    assert study.runs == ["other", "table", "other"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_killed_run_is_resumed(tmp_path, study, monkeypatch):
    """Killed in the middle of a part, of which nothing is kept; what was done before is."""
    monkeypatch.setattr(runner, "find", lambda: [study])
    child = os.fork()
    study.runs.append("other")
    if not child:

        def killed(folder: Path, quick: bool) -> str:
            (folder / "half.csv").write_text("x")
            os.kill(os.getpid(), signal.SIGKILL)
            return ""

        study.parts["other"] = replace(study.parts["other"], work=killed)
        runner.run([study], tmp_path)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL
    assert runner.run([study], tmp_path, resume=True) == []
    assert study.runs == ["other", "other"]
    assert sorted(path.name for path in (tmp_path / "made-up").iterdir()) == ["other", "table"]
    assert not (tmp_path / "made-up" / "other" / "half.csv").exists()


@pytest.mark.parametrize("commit", ["1234567-dirty", None])
def test_results_of_uncommitted_code_are_not_recorded(tmp_path, study, monkeypatch, commit):
    monkeypatch.setattr(runner, "find", lambda: [study])
    monkeypatch.setattr(runner, "RECORDED", tmp_path / "docs")
    monkeypatch.setattr(runner, "machine", lambda: machine() | {"commit": commit})
    runner.run([study], tmp_path / "out")
    with pytest.raises(ValueError, match=r"code that is not committed are not recorded: .* made-up, table$"):
        runner.record(tmp_path / "out")
    assert not (tmp_path / "docs").exists()


def test_a_commit_is_that_of_the_sources(tmp_path, monkeypatch):
    """A file that is not committed makes it dirty where results depend on it, and only there."""
    monkeypatch.setattr(harness, "ROOT", tmp_path)
    if shutil.which("git") is None:
        pytest.skip("needs git")
    assert harness.machine()["commit"] is None
    (tmp_path / "wvr").mkdir()
    (tmp_path / "wvr" / "code.py").write_text("1")
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "first"]):
        subprocess.run(["git", *who, *command], cwd=tmp_path, check=True)
    clean = harness.machine()["commit"]
    (tmp_path / "docs.md").write_text("text")
    # Nor are benchmarks' results a source of others.
    (tmp_path / "benchmarks/results").mkdir(parents=True)
    (tmp_path / "benchmarks/results/cold.json").write_text("{}")
    assert harness.machine()["commit"] == clean and not clean.endswith("-dirty")
    (tmp_path / "wvr" / "new.py").write_text("2")
    assert harness.machine()["commit"] == f"{clean}-dirty"


def test_whole_results_are_recorded(tmp_path, study, monkeypatch):
    monkeypatch.setattr(runner, "find", lambda: [study])
    monkeypatch.setattr(runner, "machine", lambda: machine() | {"commit": "1234567"})
    monkeypatch.setattr(runner, "RECORDED", tmp_path / "docs")
    (tmp_path / "docs").mkdir()
    runner.run([study], tmp_path / "out")  # of which the second part fails
    page = runner.record(tmp_path / "out").read_text()
    assert "**One is one.**" in page and "[table.csv](made-up/table/table.csv)" in page and "Table 2" not in page
    assert (tmp_path / "docs" / "made-up" / "table" / "table.csv").read_text().startswith("x,error")
    runner.run([study], tmp_path / "quick", quick=True)
    assert runner.record(tmp_path / "quick").read_text() == page
    # What was measured at another commit says so.
    then = runner.machine()
    monkeypatch.setattr(runner, "machine", lambda: then | {"commit": "89abcde"})
    runner.run([study], tmp_path / "out", resume=True)
    page = runner.record(tmp_path / "out").read_text()
    assert page.count("commit 1234567") == page.count("commit 89abcde") == 1
    assert page.index("### Table 2") < page.index("`wvr study made-up/other` on ") < page.index("commit 89abcde")


def test_the_report_needs_nothing_else(results):
    folder = results("lum2004")
    page = (folder.parent / "report.html").read_text()
    assert "http" not in page.replace("http://www.w3.org", "") and page.count('src="data:image/') >= 3
    assert "215 times at 2048" in page and "quick: small scenes" in page


def test_unknown_studies_are_refused():
    with pytest.raises(ValueError, match=r"studies are frontier, .*, got frontir"):
        runner.find(["frontir"])
    with pytest.raises(ValueError, match=r"parts of lum2004 are table1, .*, got table9"):
        runner.find(["lum2004/table9"])


def test_one_part_of_a_study():
    (study,) = runner.find(["lum2004/table1"])
    assert list(study.parts) == ["table1"] and runner._command(study, False) == "wvr study lum2004/table1"
    assert len(runner.find(["lum2004"])[0].parts) > 1
