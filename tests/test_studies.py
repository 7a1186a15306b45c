"""The studies run, in small, and what they promise holds."""

import json

import numpy as np
import pytest

import wvr
from studies import angelelli2017, campagnolo2015, common, frontier, lum2004, roettger2003, stability


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


def test_campagnolo2015(folder):
    campagnolo2015.main("--quick")
    folder = folder / "campagnolo2015"
    names = {path.name for path in folder.iterdir()}
    assert {f"figure{i}.png" for i in range(2, 7)} <= names
    assert {f"table{i}.csv" for i in ("I", "II", "III", "V", "VI")} <= names
    rows = json.loads((folder / "tableI.json").read_text())["rows"]
    over = {row["method"]: row["A of exact"] for row in rows if row["limit"] == 0.001}
    # The order of the paper's Table I: adaptive steps of a ray's tolerance, fine uniform ones, coarse ones.
    assert over["Coupled"] < 1 and over["Decoupled"] < 1
    assert over["Coupled"] < over["Riemann h = 0.1"] < over["Riemann h = 0.5"]
    assert over["midpoint h = 0.5"] < over["Riemann h = 0.5"]
    steps = json.loads((folder / "figure6.json").read_text())["rows"]
    assert max(step["length"] for step in steps) <= 4 and steps[-1]["A"] > 0.5
    first = next(row for row in rows if row["method"] == "Riemann h = 0.5" and row["limit"] == 0.01)
    assert first["A paper"] == 12.766


def test_roettger2003(folder):
    roettger2003.main("--quick")
    folder = folder / "roettger2003"
    names = {path.name for path in folder.iterdir()}
    assert {f"{n}.png" for n in ("figure4", "oversampling", "figure6", "threshold", "artefacts", "figure7")} <= names
    rows = json.loads((folder / "oversampling.json").read_text())["rows"]
    mean = {(row["scene"], row["method"]): row["mean"] for row in rows}
    for scene in roettger2003.SCENES:
        by_oversampling = [mean[scene, f"pre-integrated, {n}x"] for n in roettger2003.OVERSAMPLING]
        # Order 2, down to where the table's own look-up shows.
        assert by_oversampling[0] > 2 * by_oversampling[1] > 4 * by_oversampling[2] > by_oversampling[3]
    # Ten times the error of floats and more; less where four slabs are blended before they are written.
    buffers = {row["method"]: row["mean"] for row in json.loads((folder / "figure7.json").read_text())["rows"]}
    each, four, floats, adaptive = buffers.values()
    assert each > four > 10 * floats and four > 10 * adaptive
    rows = json.loads((folder / "speed.json").read_text())["rows"]
    assert rows[2]["paper s"] == "2.2" and rows[0]["adaptive M samples"] < rows[0]["4x slicing M samples"]


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


def test_angelelli2017(folder, monkeypatch):
    for name, value in (("DISTANCES", (0.5, 1.0, 2.0)), ("SUBSAMPLES", (1, 3)), ("FINE", 0.25)):
        monkeypatch.setattr(angelelli2017, name, value)
    angelelli2017.main("--quick", "--size=32", "--views=1")
    folder = folder / "angelelli2017"
    names = {path.name for path in folder.iterdir()}
    assert {f"figure{i}.png" for i in (1, 3, 4, 5, 6, 7)} <= names

    def rows(name):
        return json.loads((folder / f"{name}.json").read_text())["rows"]

    order = {row["variant"]: row["order"] for row in rows("convergence")}
    assert order["Strang, mean light"] > 1.8 and 0.9 < order["Lie, front light"] < 1.2
    # With the kernel of the papers finer slices go away from it.
    fixed = rows("convergence")[-1]
    assert fixed["0.25"] > 1.5 * fixed["0.5"] > 1.5 * fixed["1"]
    assert all("extents" not in row["built"] for row in rows("streaming"))
    difference = {(row["distance"], row["subsamples"]): row["difference"] for row in rows("table1")}
    assert difference[0.2, 0] == 0 and difference[0.8, 3] < difference[0.8, 0]
    assert rows("table1")[-1]["paper ms"] == 182
    assert {row["method"] for row in rows("figure5")} == {"ray cast", "Phong", "ICS", "SCS", "PI-ICS", "PI-SCS"}


def test_aliasing_is_what_is_fine():
    """Brightness that changes over the image is none, stripes are as much as they are."""
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
    assert angelelli2017.aliasing(image(0.5 + 0.1 * (-1.0) ** x), plain) == pytest.approx(0.1, rel=0.03)


def test_frontier(folder):
    frontier.main("--quick")
    folder = folder / "frontier"
    assert {path.name for path in folder.glob("*.png")} == {"blobs.png", "scaling.png"}
    rows = json.loads((folder / "blobs.json").read_text())["rows"]
    assert {row["scene"] for row in rows} == {"smooth", "sharp", "opaque"}
    for method in frontier.METHODS:
        coarse, fine = (r["mean error"] for r in rows if (r["method"], r["scene"]) == (method.name, "opaque"))
        assert fine < 0.7 * coarse < 0.02
    # Where opacity is in spikes, pre-integration is what sees them.
    sharp = {r["method"]: r["mean error"] for r in rows if r["scene"] == "sharp" and r["step or tolerance"] == 1}
    assert sharp["Preintegrated"] < 0.2 * sharp["Riemann, midpoint"]
    rows = json.loads((folder / "scaling.json").read_text())["rows"]
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
