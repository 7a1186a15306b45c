"""The hunt, in small; and that it fails, and says how to see it, where a pixel is beyond its bound."""

import runpy

import pytest

from studies import hunt

from .helpers import rows_of


def test_some_kinds(tmp_path):
    for part in list(hunt.STUDY.parts.values())[:3]:
        folder = tmp_path / part.name
        folder.mkdir()
        assert "None of" in part.work(folder, True)
        (row,) = rows_of(folder, "rays")
        assert row["rays"] > 0 and row["beyond their bound"] == 0 and 0 <= row["worst error / bound"] < 1


def test_what_is_beyond_its_bound_is_written_as_a_program(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(hunt, "EXACT", -1.0)
    monkeypatch.setattr(hunt, "SIZE", (3, 3))
    monkeypatch.setattr(hunt, "errors", lambda pixel, truth: (1.5, 1.5))
    with pytest.raises(AssertionError, match="further off than their bound"):
        hunt.STUDY.parts["masks"].work(tmp_path, True)
    program = sorted(tmp_path.glob("*.py"))[0]
    runpy.run_path(str(program))
    assert "Enclosure" in capsys.readouterr().out
