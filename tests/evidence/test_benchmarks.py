"""The benchmarks measure what they say, in turns, and write it whole; how long anything takes is not tested."""

import json
from io import BytesIO

import numpy as np
import pytest
from PIL import Image as PillowImage

import wvr
from benchmarks import __main__ as command
from benchmarks import certified, lit, numpy_marcher, peers, scenes
from studies.base import harness, reference
from studies.base.harness import Row, Settings, Time
from studies.base.peer import NotAvailableError

from ..helpers import max_error


def clock(seconds):
    """A contender that takes, by its own account, these seconds one after the other."""
    runs = iter(seconds)
    return lambda: Time(next(runs), 2.0)


def test_rows_have_medians_ranges_and_ratios_and_the_first_round_does_not_count():
    times = harness.interleave({"a": clock([99, 1, 5, 2]), "b": clock([99, 6, 4, 3])}, rounds=3)
    a, b = harness.summarize("group", times, "a", lambda name, wall: {"double": 2 * wall})
    assert a == Row("group", "a", 3, 2, 1, 5, 2.0, 1.0, {"double": 4})
    assert b == Row("group", "b", 3, 4, 3, 6, 2.0, 2.0, {"double": 8})


def test_contenders_take_turns():
    order = []
    contenders = {name: lambda name=name: order.append(name) or Time(1, 1) for name in "abc"}
    times = harness.interleave(contenders, rounds=3, every={"c": 2})
    assert "".join(order) == "abc" + "abc" + "ab" + "abc"
    assert [len(runs) for runs in times.values()] == [3, 3, 2]


def test_a_timed_contender_does_its_work_once():
    done = []
    assert harness.timed(lambda: done.append(1))() >= (0, 0)
    assert done == [1]


def test_results_survive_json(tmp_path):
    rows = [Row("g", "a", 3, 0.1, 1 / 3, 2.0, 0.7, 1.0, {"max error": 1e-17, "none": None})]
    result = harness.Result("entry", "A title", "a", rows, ["a note"], harness.machine())
    harness.save(result, tmp_path / "result.json")
    assert harness.load(tmp_path / "result.json") == result


@pytest.fixture
def quick(tmp_path, monkeypatch):
    """Runs the command line's function on small scenes, with records in a folder of the test."""
    monkeypatch.setattr(command, "RESULTS", tmp_path / "results")

    def run(name):
        command.run(name, rounds=2, quick=True, out=tmp_path, record="here")
        files = {path.name for path in (tmp_path / "results/here").iterdir()}
        assert {f"{name}.json", f"{name}.md"} <= files <= {f"{name}.json", f"{name}.md", "peers.png"}
        assert (tmp_path / f"{name}.svg").stat().st_size > 0
        result = harness.load(tmp_path / f"{name}.json")
        assert json.loads((tmp_path / f"{name}.json").read_text())["machine"]["cores"] == wvr.get_num_threads()
        assert all(0 < row.fastest <= row.wall <= row.slowest for row in result.rows)
        return result, (tmp_path / f"{name}.md").read_text()

    return run


def test_throughput_compares_one_and_all_threads(quick, threads):
    threads(2)
    result, text = quick("throughput")
    assert [row.name for row in result.rows] == ["1 thread", "all threads"] * 4
    assert all(row.extra["scaling"] * row.ratio == pytest.approx(1) for row in result.rows)
    assert all(row.extra["M samples/s"] > 0 for row in result.rows)
    assert wvr.get_num_threads() == 2
    assert text.count("| S1 parallel, ") == 4


def test_cuts_and_labels(quick):
    result, text = quick("clipping")
    names = [row.name for row in result.rows if row.group == "Preintegrated(0.5)"]
    assert names[0] == "none" and len(names) == 7 and len(result.rows) == 14
    samples = {row.name: row.extra["samples per ray"] for row in result.rows if row.group == "Preintegrated(0.5)"}
    assert samples["plane that keeps all"] == samples["none"] > samples["plane through the middle"] > 0
    assert "samples per ray" in text


def test_light_beside_vtk_or_a_note_says_why_not(quick):
    result, text = quick("lit")
    ours = {f"{name}{behind}" for name in ("Certified(0.00195)", "Preintegrated(1.0)") for behind in ("", ", lit")}
    for scene in lit.SCENES:
        names = {row.name for row in result.rows if row.group == scene}
        assert ours <= names and (lit.VTK in names or any("not available" in note for note in result.notes))
    assert all(row.extra["CPU, of VTK's, lit"] == 1 for row in result.rows if row.name == lit.VTK)
    assert "CPU, of VTK's, lit" in text


def test_certified_frames_are_within_their_tolerances(quick):
    result, text = quick("certified")
    errors = {(row.group, row.name): row.extra["max error"] for row in result.rows if "max error" in row.extra}
    for group in ("S1", "S2", "S2 noisy", "S3", "Bonsai", "BluntFin"):
        for tolerance in certified.TOLERANCES:
            assert errors[group, f"Certified({tolerance:.3g})"] <= tolerance
        last = next(row for row in result.rows if (row.group, row.name) == (group, "Riemann as accurate"))
        assert last.extra["step"] <= 1 and last.extra["times certified"] > 0
    assert {row.name for row in result.rows} >= {"nothing to see", "frame with a new transfer function", "not skipping"}
    assert "times certified" in text


def test_peers_have_errors_and_vtk_is_there_or_a_note_says_why_not(quick, monkeypatch):
    # Each scene starts each peer in a process of its own.
    monkeypatch.setattr(peers, "make_scenes", lambda quick: scenes.make_scenes(quick)[::4])
    result, text = quick("peers")
    errors = {(row.group, row.name): row.extra["max error"] for row in result.rows}
    assert len(errors) == len(result.rows)
    for group in ("S1 parallel", "S3 parallel"):
        for name in peers.VTK:
            missing = any(note.startswith(f"{name}: not available: ") for note in result.notes)
            assert ((group, name) in errors) != missing
        # Another image than wvr's, or the same in another place, would be off by tenths.
        limit = 1.0 if group == "S3 parallel" else 0.05
        assert all(error < limit for (place, _), error in errors.items() if place == group)
        ours = errors[group, peers.BASELINE]
        assert errors[group, peers.NUMPY] == pytest.approx(ours, abs=1 / 1000)
    assert "max error" in text


def test_peers_without_vtk_say_why(monkeypatch, tmp_path):
    class Unavailable:
        def __init__(self, *_):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def frame(self):
            raise NotAvailableError("no OpenGL")

    monkeypatch.setattr(peers, "VtkCpu", Unavailable)
    monkeypatch.setattr(peers, "MARCHER", {})
    result = peers.measure(Settings(rounds=1, quick=True, out=tmp_path))
    assert not {row.name for row in result.rows} & set(peers.VTK)
    assert [note for note in result.notes if "no OpenGL" in note] == [
        f"{name}: not available: no OpenGL." for name in peers.VTK
    ]


def test_a_viewer_answers_before_it_is_done(quick):
    result, text = quick("viewer")
    rows = {row.name: row for row in result.rows}
    assert {"coarse picture", "final picture"} <= rows.keys()
    page = "first picture on a page"
    assert page in rows or any(note.startswith("No page: ") for note in result.notes)
    assert all(row.extra["p95 [s]"] >= row.fastest for name, row in rows.items() if name != "final picture")
    assert "p95" in text


def test_unknown_names_are_refused(tmp_path):
    with pytest.raises(
        ValueError, match=r"throughput, certified, clipping, peers, cold, projections, lit, viewer, got speed"
    ):
        command.run("speed", out=tmp_path)


@pytest.mark.parametrize("index", [0, 1, 2, 3])
def test_the_numpy_marcher_converges_to_the_reference(index):
    """With the square of the step, as the midpoint rule does; at step 1 it is what Riemann(1.0) computes."""
    scene = scenes.make_scenes(quick=True)[index]
    exact = reference.render(scene.volume, scene.transfer_function, scene.camera, scene.size)
    coarse, fine = (float(np.abs(numpy_marcher.render(scene, step) - exact).max()) for step in (1.0, 0.25))
    assert fine < coarse / 8
    assert coarse < 5e-3
    image = wvr.render(
        scene.volume,
        scene.transfer_function,
        scene.camera,
        scene.size,
        integrator=wvr.Riemann(1.0),
        precision="float64",
        termination=0,
        device="cpu",
    )
    assert max_error(image, numpy_marcher.render(scene)) < 1e-9


def test_the_truth_is_kept(tmp_path, monkeypatch):
    scene = scenes.make_scenes(quick=True)[0]
    first = scenes.truth(scene, 20, tmp_path)
    assert first.change <= scenes.CONVERGED
    assert first.errors(reference.render(scene.volume, scene.transfer_function, scene.camera, scene.size, first.parts))[
        "max error"
    ] == pytest.approx(0, abs=1e-14)
    monkeypatch.setattr(scenes, "_integrate", None)
    assert np.array_equal(scenes.truth(scene, 20, tmp_path).rgba, first.rgba)


def test_large_pictures_are_smaller_and_look_the_same():
    smooth = np.linspace(0, 255, 700)
    pixels = np.stack(np.broadcast_arrays(smooth[:, None], smooth[None], (smooth[:, None] + smooth) / 2), -1)
    pixels = (pixels + np.random.default_rng(1).normal(0, 4, pixels.shape)).clip(0, 255).astype(np.uint8)
    png = BytesIO()
    PillowImage.fromarray(pixels).save(png, "PNG")
    few = harness.smaller(png.getvalue())
    shown = np.asarray(PillowImage.open(BytesIO(few)).convert("RGB")).astype(float)
    assert len(few) < 0.4 * len(png.getvalue())
    # Dithered: over a few pixels colours are what they were.
    blocks = lambda a: a.reshape(100, 7, 100, 7, 3).mean((1, 3))  # noqa: E731
    assert np.abs(blocks(shown) - blocks(pixels.astype(float))).mean() < 2
    assert harness.smaller(few[:1000]) == few[:1000]
