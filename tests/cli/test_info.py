"""``wvr info`` says what a volume is, and suggests what can be pasted and saved."""

import re

import numpy as np
import pytest

import wvr
from wvr.cli.options import function_of
from wvr.presets import suggest

from .helpers import SIZE, spheres


def lines(out):
    """Lines of ``wvr info`` by their first word or two."""
    return {line[2:13].strip(): line[14:] for line in out.splitlines()[1:]}


def test_info_of_a_file(run):
    holes = np.linspace(-1, 1, 4 * 5 * 6, dtype=np.float32).reshape(4, 5, 6)
    holes[0, 0, :2] = np.nan
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    volume = wvr.Volume(holes, (0.5, 1, 2), (7, 8, 9), turn, nan="transparent")
    volume.to_pyvista().save("a.vti")
    code, out, err = run("info", "a.vti")
    assert (code, err) == (0, "") and out.startswith("a.vti\n")
    facts = lines(out)
    expected = {
        "dimensions": "6 x 5 x 4",
        "dtype": "float32",
        "memory": "0.0 MiB",
        "spacing": "0.5, 1, 2",
        "origin": "7, 8, 9",
        "world size": "2.5, 4, 6",
        "not finite": "2 of 120 samples",
        "direction": "(0, 1, 0)  (-1, 0, 0)  (0, 0, 1)",
        "range": "-0.966387 .. 1",
    }
    assert {name: facts[name] for name in expected} == expected
    assert "0.5: 0.008403" in facts["quantiles"]


def test_suggestions_can_be_pasted_and_saved(run):
    volume = spheres()
    code, out, _ = run("info", "spheres", "--dataset-size", SIZE, "--save-tf", "surfaces", "a.json")
    assert code == 0 and "direction" not in out
    scalars = np.linspace(*volume.range, 1001)
    for name, tf in suggest(volume).items():
        pasted = function_of(lines(out)[name], None)
        np.testing.assert_allclose(pasted.extinction(scalars), tf.extinction(scalars), rtol=2e-3, atol=1e-4)
        np.testing.assert_allclose(pasted.color(scalars), tf.color(scalars), atol=5e-3)
    assert wvr.TransferFunction.load("a.json") == suggest(volume)["surfaces"]


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float16", "float64"])
def test_the_histogram_counts_every_finite_sample_once(run, dtype):
    samples = (np.random.default_rng(0).normal(100, 20, (9, 8, 7))).astype(dtype)
    if samples.dtype.kind == "f":
        samples[0, 0, 0] = np.inf
    np.save("a.npy", samples)
    code, out, _ = run("info", "a.npy", "--histogram")
    rows = re.findall(r"^ *([-\d.e+]+) +(\S*) +([\d,]+)$", out, re.MULTILINE)
    assert code == 0 and 25 <= len(rows) <= 32
    counts = [int(count.replace(",", "")) for _, _, count in rows]
    finite = samples[np.isfinite(samples)].astype(float)
    assert sum(counts) == finite.size
    starts = [float(start) for start, _, _ in rows]
    assert starts[0] == pytest.approx(finite.min(), rel=1e-4)
    if samples.dtype.kind in "iu":
        assert np.ptp(np.diff(starts)) == 0 and starts[1].is_integer()
        assert counts[5] == np.count_nonzero((finite >= starts[5]) & (finite < starts[6]))
    assert len(rows[int(np.argmax(counts))][1]) == 50
    assert "█" not in run("info", "a.npy")[1]


def test_info_of_a_constant_volume_and_of_one_without_finite_samples(run):
    np.save("a.npy", np.full((3, 3, 3), 7, np.uint8))
    code, out, _ = run("info", "a.npy", "--histogram")
    assert code == 0 and lines(out)["range"] == "7 .. 7" and "no suggested transfer functions: volume must have" in out
    np.save("a.npy", np.full((3, 3, 3), np.nan))
    code, out, _ = run("info", "a.npy", "--histogram")
    assert code == 0 and "range" not in lines(out) and lines(out)["not finite"] == "27 of 27 samples"
    assert run("info", "a.npy", "--save-tf", "bands", "b.json")[0] == 2


def test_bare_samples_and_times(run, tmp_path):
    times = np.arange(2 * 3 * 4 * 5, dtype=">u2").reshape(2, 3, 4, 5)
    times[1].tofile("a.raw")
    code, out, _ = run("info", "a.raw", "--shape", "3,4,5", "--dtype", ">u2", "--spacing", "1,2,3")
    assert code == 0 and "5 x 4 x 3" in out and "60 .. 119" in out and "1, 2, 3" in out
    np.save("times.npy", times.astype(np.int32))
    code, out, _ = run("info", "times.npy", "--frame", "0")
    assert code == 0 and "0 .. 59" in out
    np.save("nan.npy", np.full((2, 2, 2), np.nan))
    np.savez("two.npz", a=times[0], b=times[1])
    for arguments, message in {
        "info times.npy": "times.npy holds 2 volumes (time): pick one with --frame, from 0 to 1",
        "info a.raw": "a.raw holds bare samples, and does not say how many",
        "info a.raw --shape 3,4,5": "--shape and --dtype are for bare samples, and go together",
        "info a.raw --shape 3,4,5 --dtype no": "--dtype must be a type of numbers",
        "info a.raw --shape 3,4,0 --dtype u2": "--shape must be three integers > 0, NZ,NY,NX, got '3,4,0'",
        "info a.raw --shape 3,4,5 --dtype u1": "a.raw has 120 bytes",
        "info times.npy --offset 4": "--offset is for bare samples",
        "info tree --frame 0": "--frame is for files, 'tree' is a dataset",
        "info two.npz": "--scalars must name one of 'a', 'b'",
        "render nan.npy": "pass --nan transparent",
    }.items():
        code, out, err = run(*arguments.split())
        assert code in (1, 2) and message in err, err
