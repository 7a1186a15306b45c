"""The studies run, in small, and what they promise holds; the runner keeps what is done and says what failed."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context

import wvr
from studies import angelelli2017, campagnolo2015, clipping, frontier, lighting, roettger2003, runner, stability
from studies.base.harness import STYLE
from studies.base.rows import write_rows
from studies.base.study import Study


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


def rows_of(folder: Path, name: str) -> list[dict]:
    return json.loads((folder / f"{name}.json").read_text())["rows"]


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


def test_campagnolo2015(results):
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
    rows = rows_of(folder / "speed", "speed")
    assert rows[2]["paper s"] == "2.2" and rows[0]["adaptive M samples"] < rows[0]["4x slicing M samples"]


def test_clipping(results):
    folder = results("clipping")
    assert {path.name for path in folder.glob("*/*.png")} == {
        f"{n}.png" for n in ("figure2", "figure3", "figure8", "labels")
    }
    rows = rows_of(folder / "figure3", "figure3")
    mean = {(row.get("slices"), row["method"]): row["mean"] for row in rows}
    for slices in (32, 128):
        exact, ratio, first, naive = (
            mean[slices, method] for method in ("rays cut", "parts='ratio'", "parts='first-order'", "naive")
        )
        assert exact < ratio < first < 0.2 * naive
    assert mean[None, "Certified(1/512)"] < 1e-4


def test_lighting(results):
    folder = results("lighting")
    assert {path.stem for path in folder.glob("*/*.png")} == {"modes", *(f"figure{n}" for n in (1, 2, 7, 8)), "plates"}
    rows = rows_of(folder / "modes", "modes")
    share = {row["scene"]: row["over center"] for row in rows if row["mode"] == lighting.EXACT}
    assert share["sphere"] < 0.3 and max(share.values()) < 0.9
    assert len(rows_of(folder / "table2", "table2")) == 4


def test_factors():
    """Of a clip field that is linear between the ends: where it is 0.5."""
    front, back = np.random.default_rng(0).random((2, 1000))
    factors = clipping.factors(front, back)
    t = np.linspace(0, 1, 20001)
    visible = front[:, None] + t * (back - front)[:, None] >= 0.5
    np.testing.assert_allclose(factors["b"], visible.mean(axis=1), atol=1e-4)
    some = visible.any(axis=1)
    np.testing.assert_allclose(factors["r"][some], t[visible[some].argmax(axis=1)], atol=1e-4)


def test_frame_buffer():
    """Without rounding, slabs blended in groups are the float image; with it, what is thin is lost."""
    scene = roettger2003.make_scene("NegHIP, semi-transparent", quick=True)
    camera = wvr.Camera.fit(scene.volume, parallel=True)
    scene = roettger2003.replace(scene, camera=camera, size=(12, 12))
    buffers = roettger2003.blended(scene, 4, {"one": (1, None), "four": (4, None), "fine": (1, 2**24), "2": (1, 2)})
    np.testing.assert_allclose(buffers["four"], buffers["one"], atol=1e-12)
    np.testing.assert_allclose(buffers["fine"], buffers["one"], atol=1e-4)
    assert buffers["one"].max() > 0.1 and not buffers["2"].any()
    assert wvr.compare(buffers["one"], scene.render(wvr.Exact())).max < 5e-3


def test_angelelli2017(tmp_path, monkeypatch):
    for name, value in (("DISTANCES", (0.5, 1.0, 2.0)), ("SUBSAMPLES", (1, 3)), ("FINE", 0.25)):
        monkeypatch.setattr(angelelli2017, name, value)
    with rc_context(STYLE):
        for part in angelelli2017.STUDY.parts.values():
            assert part.work(tmp_path, True)
    assert {f"figure{i}.png" for i in (1, 3, 4, 5, 6, 7)} <= {path.name for path in tmp_path.iterdir()}
    rows = {name: rows_of(tmp_path, name) for name in ("convergence", "streaming", "table1", "figure5")}
    order = {row["variant"]: row["order"] for row in rows["convergence"]}
    assert order["Strang, mean light"] > 1.8 and 0.9 < order["Lie, front light"] < 1.2
    # With the kernel of the papers finer slices go away from it.
    fixed = rows["convergence"][-1]
    assert fixed["0.25"] > 1.5 * fixed["0.5"] > 1.5 * fixed["1"]
    assert all("extents" not in row["built"] for row in rows["streaming"])
    difference = {(row["distance"], row["subsamples"]): row["difference"] for row in rows["table1"]}
    assert difference[0.2, 0] == 0 and difference[0.8, 3] < difference[0.8, 0]
    assert rows["table1"][-1]["paper ms"] == 182
    assert {row["method"] for row in rows["figure5"]} == {"ray cast", "Phong", "ICS", "SCS", "PI-ICS", "PI-SCS"}


def test_aliasing_is_what_is_fine():
    """Brightness that changes over the image is none; stripes are, but for the ninth of them in a window's mean."""
    x = np.arange(64)
    rgba = np.ones((64, 64, 4), np.float32)

    def image(red):
        rgba[..., :3] = linear(np.broadcast_to(red, (64, 64)))[..., None]
        return wvr.Image(rgba.copy(), np.zeros((64, 64), np.int32))

    def linear(s):
        return np.where(s < 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)

    plain = image(0.5)
    assert angelelli2017.aliasing(plain, plain) == 0
    assert angelelli2017.aliasing(image(0.3 + x / 256), plain) < 2e-3
    assert angelelli2017.aliasing(image(0.5 + 0.1 * (-1.0) ** x), plain) == pytest.approx(0.1 * 8 / 9, rel=0.02)


def test_frontier(tmp_path):
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


def test_linear_opacity():
    """The opacity of a step is tau h, in world units of any size."""
    tf = wvr.TransferFunction([(0, "red", 0.0), (1, "blue", 0.6)])
    changed = campagnolo2015.linear_opacity(tf, unit=0.1, h=0.5)
    s = np.linspace(0, 1, 7)
    np.testing.assert_allclose(
        -np.expm1(-changed.extinction(s, 0.1) * 0.05), tf.extinction(s, 0.1) * 0.05, rtol=0, atol=1e-7
    )
    np.testing.assert_allclose(changed.color(s), tf.color(s), atol=1e-12)


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


def test_whole_results_are_recorded(tmp_path, study, monkeypatch):
    monkeypatch.setattr(runner, "find", lambda: [study])
    monkeypatch.setattr(runner, "RECORDED", tmp_path / "docs")
    (tmp_path / "docs").mkdir()
    runner.run([study], tmp_path / "out")  # of which the second part fails
    page = runner.record(tmp_path / "out").read_text()
    assert "**One is one.**" in page and "[table.csv](made-up/table/table.csv)" in page and "Table 2" not in page
    assert (tmp_path / "docs" / "made-up" / "table" / "table.csv").read_text().startswith("x,error")
    runner.run([study], tmp_path / "quick", quick=True)
    assert runner.record(tmp_path / "quick").read_text() == page


def test_the_report_needs_nothing_else(results):
    folder = results("lum2004")
    page = (folder.parent / "report.html").read_text()
    assert "http" not in page.replace("http://www.w3.org", "") and page.count('src="data:image/') >= 3
    assert "215 times at 2048" in page and "quick: small scenes" in page


def test_unknown_studies_are_refused():
    with pytest.raises(ValueError, match=r"studies are frontier, .*, got frontir"):
        runner.find(["frontir"])
