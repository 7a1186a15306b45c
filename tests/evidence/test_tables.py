"""Studies of tables and of segments cut by volumes: what they promise holds, in small."""

import numpy as np
import pytest

import wvr
from studies import roettger2003, runner, stability
from studies.base.study import VERDICTS

from .helpers import rows_of


def test_lum2004(results):
    folder = results("lum2004")
    rows = rows_of(folder / "accuracy", "accuracy")
    assert all(row["incremental float32"] < 2e-6 and row["incremental float64"] < 1e-12 for row in rows)
    names = {path.name for path in folder.glob("*/*")}
    assert {"table1-cpu.csv", "table1-cpu.png", "lookups.svg", "opaque-spikes.png"} <= names
    assert rows_of(folder / "table1", "table1-cpu")[0]["paper s"] == 0.00078


def test_stability_of_tables(tmp_path):
    assert "no entry that no segment can have" in stability.tables(tmp_path, quick=True)
    rows = rows_of(tmp_path, "tables")
    assert len(rows) == 10 and not any(row[count] for row in rows for count in stability.COUNTS)


def test_stability_of_images(tmp_path, monkeypatch):
    few = [case for case in stability.cases(quick=True) if case.axis in ("opacity", "rays", "samples")]
    monkeypatch.setattr(stability, "cases", lambda quick: few)
    assert "no pixel further off than its bound" in stability.images(tmp_path, quick=True)
    rows = rows_of(tmp_path, "images")
    assert {row["value"] for row in rows} == {case.value for case in few}
    # What has no place in an image is found: an opacity below 0 leaves no room for colour either.
    scene = few[0].scene
    exact = scene.render(wvr.Exact())
    case = stability.Case("made up", "one", scene)
    for value, counts in ((np.nan, (1, 0, 0)), (1.5, (0, 1, 1)), (-0.5, (0, 4, 1)), (0.5, (0, 0, 1))):
        image = scene.render(wvr.Certified(1e-3))
        image.rgba[3, 4, 3] = value
        image.error_bound[3, 4] *= np.isfinite(value)
        assert stability.impossible(image, case, exact) == counts, value
    monkeypatch.setattr(stability, "impossible", lambda *_: (0, 1, 0))
    with pytest.raises(AssertionError, match="images that no scene can have"):
        stability.images(tmp_path, quick=True)


def test_roettger2003(results):
    folder = results("roettger2003")
    names = {path.name for path in folder.glob("*/*.png")}
    assert {f"{n}.png" for n in ("figure4", "oversampling", "figure6", "threshold", "artefacts", "figure7")} <= names
    rows = rows_of(folder / "oversampling", "oversampling")
    mean = {(row["scene"], row["method"]): row["mean"] for row in rows}
    for scene in roettger2003.SCENES:
        by_oversampling = [mean[scene, f"pre-integrated, {n}x"] for n in roettger2003.OVERSAMPLING]
        # Order 2, down to where the table's own look-up shows.
        assert by_oversampling[0] > 2 * by_oversampling[1] > 4 * by_oversampling[2] > by_oversampling[3]
    # Ten times the error of floats and more; less where four slabs are blended before they are written.
    buffers = {row["method"]: row["mean"] for row in rows_of(folder / "figure7", "figure7")}
    each, four, floats, adaptive = buffers.values()
    assert each > four > 10 * floats and four > 10 * adaptive
    rows = {row["scene"]: row for row in rows_of(folder / "speed", "speed")}
    assert rows["NegHIP, semi-transparent"]["paper s"] == "2.2" and rows.keys() == roettger2003.SCENES.keys()
    for row in rows.values():
        assert row["adaptive M samples"] < row["4x, leaping M samples"] < row["4x slices M samples"]
    # Passes of several slabs draw what passes of one do, and light only darkens.
    scene = roettger2003.replace(roettger2003.make_scene("NegHIP, opaque", True), size=(12, 12))
    unlit, lit = (roettger2003.Passes(scene, light) for light in (False, True))
    one, four = (unlit.draw(scene.camera, 0.5, slabs)[0] for slabs in (1, 4))
    np.testing.assert_allclose(one, four, rtol=0, atol=1e-5)
    assert wvr.compare(one, scene.render(wvr.Exact())).mean < 0.02
    assert np.all(lit.draw(scene.camera, 0.5, 4)[0][..., :3] <= four[..., :3] + 0.02)


def test_clipping(results):
    folder = results("clipping")
    assert {path.name for path in folder.glob("*/*.png")} == {
        f"{n}.png" for n in ("figure2", "figure3", "passes", "figure8", "labels")
    }
    rows = rows_of(folder / "figure3", "figure3")
    mean = {(row.get("slices"), row["method"]): row["mean"] for row in rows}
    for slices in (32, 128):
        exact, ratio, first, naive = (
            mean[slices, method] for method in ("rays cut", "parts='ratio'", "parts='first-order'", "naive")
        )
        assert exact < ratio < first < 0.2 * naive
    assert mean[None, "Certified(1/512)"] < 1e-4


@pytest.mark.parametrize(
    ("study", "page"),
    [
        ("roettger2003", "roettger2003"),
        ("clipping", "clipping"),
        ("lum2004", "tables"),
        ("lighting", "lighting"),
        ("campagnolo2015", "adaptive"),
        ("angelelli2017", "shadows"),
    ],
)
def test_each_claim_has_a_verdict_on_the_page_of_its_paper(study, page):
    (found,) = runner.find([study])
    text = (runner.ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert found.paper["claims"].keys() <= found.parts.keys()
    for part, claim in found.paper["claims"].items():
        assert claim["verdict"] in VERDICTS, part
        assert f"| {claim['where']} | {claim['says']} | {claim['verdict']} | {claim['why']} |" in text, part
