"""Studies of steps, adaptive and not: what they promise holds, in small."""

from matplotlib import rc_context

from studies import frontier
from studies.base import scenes
from studies.base.harness import STYLE

from .helpers import rows_of


def test_campagnolo2015(results, monkeypatch):
    # Of grey levels as its other volumes, whose kernels they share.
    monkeypatch.setitem(scenes.SCANS, "bluntfin", scenes.SCANS["bluntfin"]._replace(stand_in="blobs"))
    folder = results("campagnolo2015")
    names = {path.name for path in folder.glob("*/*")}
    assert {f"figure{i}.png" for i in range(2, 7)} <= names
    assert {f"table{i}.csv" for i in ("I", "II", "III", "V", "VI")} <= names
    rows = rows_of(folder / "table1", "tableI")
    over = {row["method"]: row["A of exact"] for row in rows if row["limit"] == 0.001}
    # The order of the paper's Table I: adaptive steps of a ray's tolerance, fine uniform ones, coarse ones.
    assert over["Coupled"] < 1 and over["Decoupled"] < 1
    assert over["Coupled"] < over["Riemann h = 0.1"] < over["Riemann h = 0.5"]
    assert over["midpoint h = 0.5"] < over["Riemann h = 0.5"]
    steps = rows_of(folder / "figure6", "figure6")
    assert max(step["length"] for step in steps) <= 4 and steps[-1]["A"] > 0.5
    first = next(row for row in rows if row["method"] == "Riemann h = 0.5" and row["limit"] == 0.01)
    assert first["A paper"] == 12.766


def test_frontier(tmp_path, monkeypatch):
    monkeypatch.setattr(frontier, "PEERS", {"VTK": frontier.PEERS["VTK"]})
    with rc_context(STYLE):
        assert "a mean error below 0.001 is first reached by" in frontier.bonsai(tmp_path, quick=True)
        frontier.scaling(tmp_path, quick=True)
    assert {path.name for path in tmp_path.glob("*.png")} == {"bonsai.png", "bonsai-short.png", "scaling.png"}
    rows = rows_of(tmp_path, "bonsai")
    assert {row["scene"] for row in rows} == {"smooth", "sharp", "opaque"}
    for method in frontier.METHODS:
        coarse, fine = (r["mean error"] for r in rows if (r["method"], r["scene"]) == (method.name, "smooth"))
        assert fine < coarse < 0.02, method.name
    # Where opacity is in spikes, pre-integration is what sees them.
    sharp = {r["method"]: r["mean error"] for r in rows if r["scene"] == "sharp" and r["step or tolerance"] == 1}
    assert sharp["Preintegrated"] < 0.5 * sharp["Riemann, midpoint"]
    rows = rows_of(tmp_path, "scaling")
    assert len({row["against"] for row in rows}) == 4 and all(row["seconds"] > 0 for row in rows)
