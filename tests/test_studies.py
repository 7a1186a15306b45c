"""The studies run, in small, and what they promise holds."""

import json

import pytest

from studies import common, lum2004, stability


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(common, "OUT", tmp_path)
    return tmp_path


def test_lum2004(folder):
    lum2004.main("--quick")
    rows = json.loads((folder / "lum2004" / "accuracy.json").read_text())["rows"]
    assert all(row["incremental float32"] < 2e-6 and row["incremental float64"] < 1e-12 for row in rows)
    names = {path.name for path in (folder / "lum2004").iterdir()}
    assert {"table1-cpu.csv", "table1-cpu.png", "lookups.svg", "opaque-spikes.png"} <= names


def test_stability(folder):
    stability.main("--quick")
    rows = json.loads((folder / "stability" / "tables.json").read_text())["rows"]
    assert len(rows) == 10 and not any(row[count] for row in rows for count in stability.COUNTS)
