"""The command line passes on what it is given, writes results to stdout only, and fails in one line."""

import io
import logging
import re
import subprocess
import sys
import time
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
import tifffile
from matplotlib import colormaps
from PIL import Image as PillowImage

import wvr
from wvr.cli import stages
from wvr.cli.render import _stem
from wvr.color import srgb_to_linear
from wvr.defaults import Call
from wvr.framing import framed, visible_points
from wvr.presets import preset, suggest

from .helpers import SIZE, spheres

CUBE = (np.arange(4 * 5 * 6).reshape(4, 5, 6) * 2).astype(np.uint8)


def render_spheres(run, *arguments):
    code, out, err = run("render", "spheres", "--dataset-size", SIZE, *arguments)
    assert (code, err) == (0, "")
    return out


def same_camera(camera, expected):
    assert repr(camera) == repr(expected)


# Rendering


def test_the_defaults_are_those_of_the_api(run):
    expected = wvr.render(spheres(), size=(40, 30))
    code, out, _ = run("render", "spheres", "--dataset-size", SIZE, "--size", "40x30", "-o", "a.npy")
    assert code == 0
    np.testing.assert_array_equal(np.load("a.npy"), expected.rgba)
    samples = f"{int(expected.samples.sum()):,}"
    assert re.fullmatch(rf"a\.npy: 40 x 30, {samples} samples, [\d.e-]+ s, errors up to [\d.e-]+ but for light\n", out)


def test_the_bound_does_not_speak_of_light(run):
    code, out, _ = run(
        "render", "spheres", "--dataset-size", SIZE, "--size", "8x6", "--lighting", "center", "-o", "a.npy"
    )
    assert code == 0 and re.search(r"errors up to [\d.e-]+ but for light\n$", out)


def test_every_option_arrives(run, rendered, monkeypatch):
    threads = []
    monkeypatch.setattr(wvr, "set_num_threads", threads.append)
    options = "--lighting center:0.1:0.5 --shadows -1,0,2 "
    options += "--size 8x6 --integrator riemann:0.25:left --precision float64 --device cpu --termination 0 --threads 3"
    assert (
        render_spheres(run, *options.split(), "--background", "white")
        == "spheres.png: 8 x 6, 1,234,567 samples, 0.25 s\n"
    )
    expected = {
        "size": (8, 6),
        "integrator": wvr.Riemann(0.25, "left"),
        "lighting": wvr.Lighting("center", ambient=0.1, diffuse=0.5),
        "shadows": wvr.ConvolutionShadows(light=wvr.DirectionalLight((-1, 0, 2))),
        "precision": "float64",
        "device": "cpu",
        "termination": 0,
        "background": "white",
    }
    assert {name: rendered[name] for name in expected} == expected
    assert threads == [3] and rendered["volume"].shape == (SIZE,) * 3


def test_clips(run, rendered):
    render_spheres(
        run,
        *("--clip-plane", "1,2,3,0,0,-1", "--clip-box", "-1,-2,-3,4,5,6", "--clip-sphere", "1,1,1,2.5"),
        *("--clip-plane", "-1,0,0,1,0,0"),
    )
    assert rendered["clip"] == [
        wvr.ClipPlane((1, 2, 3), (0, 0, -1)),
        wvr.ClipPlane((-1, 0, 0), (1, 0, 0)),
        wvr.ClipBox((-1, -2, -3), (4, 5, 6)),
        wvr.ClipSphere((1, 1, 1), 2.5),
    ]


def test_what_is_not_given_is_left_to_the_api(run, rendered):
    render_spheres(run)
    assert rendered["size"] == (512, 512) and rendered["precision"] == "auto"
    assert [rendered[name] for name in ("integrator", "shadows", "device", "segmentation")] == [None] * 4
    assert not rendered["clip"]


@pytest.mark.parametrize(
    ("text", "integrator"),
    [
        ("riemann:1", wvr.Riemann(1)),
        ("simpson:0.5", wvr.Simpson(0.5)),
        ("adaptivesimpson:0.001", wvr.AdaptiveSimpson(0.001)),
        ("exact", wvr.Exact()),
        ("preintegrated", wvr.Preintegrated()),
        ("preintegrated:0.5:2:64:brute", wvr.Preintegrated(0.5, 2, 64, "brute")),
    ],
)
def test_integrators(run, rendered, text, integrator):
    render_spheres(run, "--integrator", text)
    assert rendered["integrator"] == integrator


@pytest.mark.parametrize(
    ("arguments", "direction", "up", "lens"),
    [
        ("--up y", (0.6, 0.4, 1), (0, 1, 0), {}),
        ("--up -y", (0.6, -0.4, 1), (0, -1, 0), {}),
        ("--up x --parallel", (0.4, 1, 0.6), (1, 0, 0), {"parallel": True}),
        ("--direction -1,0,2 --up 0,0.5,-1 --view-angle 20", (-1, 0, 2), (0, 0.5, -1), {"view_angle": 20}),
        ("--direction 0,-1,0", (0, -1, 0), (0, 0, 1), {}),
        ("--direction 0,0,2", (0, 0, 2), (0, 1, 0), {}),
        ("--camera yz", (1, 0, 0), (0, 0, 1), {}),
        ("--camera iso --up y --size 10x20", (1, 1, 1), (0, 1, 0), {"aspect": 0.5}),
    ],
)
def test_a_camera_that_shows_all_that_is_visible(run, rendered, arguments, direction, up, lens):
    render_spheres(run, *arguments.split())
    same_camera(rendered["camera"], framed(visible_points(spheres(), rendered["tf"]), direction, up, **lens))


def test_the_default_camera_is_that_of_the_api(run, rendered):
    render_spheres(run)
    same_camera(rendered["camera"], Call().look(spheres(), (512, 512)).camera)


def test_a_camera_by_position_and_target(run, rendered):
    place = (-30, 2, 3), (1, 2, 3)
    arguments = ("--camera", "-30,2,3,1,2,3", "--up", "y", "--view-angle", "40")
    render_spheres(run, *arguments)
    same_camera(rendered["camera"], wvr.Camera(*place, up=(0, 1, 0), view_angle=40))
    render_spheres(run, *arguments, "--parallel")
    assert rendered["camera"].parallel_scale == pytest.approx(31 * np.tan(np.radians(20)))


@pytest.mark.parametrize(
    ("arguments", "tf"),
    [
        (["warm"], lambda volume: suggest(volume)["warm"]),
        (["mri"], lambda volume: preset("mri", volume.range)),
        (["mri", "--domain", "-5,100"], lambda volume: preset("mri", (-5, 100))),
        (["ct-bone", "--domain", "0,255"], lambda volume: preset("ct-bone", (0, 255))),
        (["-9:red:0,90:#ffffff:0.5"], lambda volume: wvr.TransferFunction([(-9, "red", 0), (90, "white", 0.5)])),
        (["0:red:0,90:#ffffff:0.5"], lambda volume: wvr.TransferFunction([(0, "red", 0), (90, "white", 0.5)])),
    ],
)
def test_transfer_functions(run, rendered, arguments, tf):
    render_spheres(run, "--tf", *arguments)
    assert rendered["tf"] == tf(spheres())


def test_a_transfer_function_of_a_file(run, rendered):
    tf = wvr.TransferFunction([(0, (0.1, 0.2, 0.3), 1 / 3), (1, "white", 1)], unit_distance=2)
    tf.save("a.json")
    render_spheres(run, "--tf", "a.json")
    assert rendered["tf"] == tf


def test_a_colour_map_spans_the_range_and_does_not_depend_on_resolution(run, rendered):
    render_spheres(run, "--tf", "viridis")
    # Its opacities are the suggested ones.
    tf, first = rendered["tf"], suggest(spheres())["bands"]
    s, (lo, hi) = np.linspace(0, 255, 400), spheres().range
    np.testing.assert_allclose(tf.extinction(s), first.extinction(s), atol=1e-12)
    middle = srgb_to_linear(colormaps["viridis"](0.5)[:3])
    np.testing.assert_allclose(tf.color((lo + hi) / 2), middle, atol=0.02)
    render_spheres(run, "--cmap", "viridis", "--opacity", "0,0.5", "--clim", "7,9")
    assert (rendered["tf"].knots[0], rendered["tf"].knots[-1]) == (7, 9)
    assert rendered["tf"].opacities[-1] == 0.5 and rendered["lighting"] is None
    render_spheres(run, "--cmap", "black,red", "--opacity", "sigmoid_5_r")
    assert rendered["tf"].opacities[0] > 0.99
    np.testing.assert_array_equal(rendered["tf"].colors[-1], [1, 0, 0])


def test_a_png_goes_into_a_pipe_and_what_is_said_does_not(tmp_path):
    np.save(tmp_path / "a.npy", CUBE)
    command = [sys.executable, "-m", "wvr", "render", "a.npy", "-o", "-", "--size", "12x10"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True)
    assert done.returncode == 0 and b"-: 12 x 10" in done.stderr
    assert PillowImage.open(io.BytesIO(done.stdout)).size == (12, 10)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]


def test_files_of_bare_samples(run, rendered):
    Path("a.raw").write_bytes(CUBE.astype(">i2").tobytes())
    assert run("render", "a.raw", "--shape", "4,5,6", "--dtype", ">i2", "--spacing", "1,1,2")[0] == 0
    np.testing.assert_array_equal(rendered["volume"].numpy(), CUBE)
    assert rendered["volume"].spacing.tolist() == [1, 1, 2]
    for wrong in ("--shape 4,5,6", "--shape 4,5 --dtype u1", "--shape 4,5,6 --dtype byte8"):
        code, _, err = run("render", "a.raw", *wrong.split())
        assert code == 2 and ("--shape" in err or "--dtype" in err)


def test_labels_have_colours_of_their_own(run, rendered):
    labels = np.zeros(CUBE.shape, np.int64)
    labels[1:3], labels[3:] = 4, 9
    np.save("a.npy", CUBE)
    np.save("labels.npy", labels)
    assert run("render", "a.npy", "--labels", "labels.npy")[0] == 0
    functions = rendered["segmentation"].transfer_functions
    assert list(functions) == [4, 9]
    assert not np.array_equal(functions[4].colors[0], functions[9].colors[0])
    np.testing.assert_array_equal(functions[4].opacities, rendered["tf"].opacities)


def test_movies_have_the_options_of_images(run, monkeypatch):
    """All that say how it looks, by the same names."""
    passed = []
    monkeypatch.setattr(wvr, "render", lambda volume, camera, **keywords: passed.append(keywords) or 1 / 0)
    monkeypatch.setattr(
        wvr, "orbit", lambda volume, frames, output, fps, elevation, turn, **keywords: passed.append(keywords)
    )
    look = "--tf warm --size 9x8 --shadows on --clip-box 0,0,0,4,4,4 --integrator riemann:1"
    options = ["--dataset-size", "8", *look.split()]
    with pytest.raises(ZeroDivisionError):
        run("render", "spheres", *options)
    assert run("orbit", "spheres", *options)[0] == 0
    assert callable(passed[0].pop("progress"))  # movies count images
    assert passed[0] == passed[1] and passed[0]["shadows"] is True and passed[0]["size"] == (9, 8)


def test_warnings_are_one_line(run, rendered):
    np.save("a.npy", CUBE.astype(np.int16) * 8)
    code, _, err = run("render", "a.npy", "--tf", "ct-bone")
    assert code == 0 and re.fullmatch(r"wvr: warning: 'ct-bone' is in Hounsfield units, .*\n", err)
    code, _, err = run("render", "b.npy")
    assert code == 1 and err.endswith("; did you mean 'a.npy'?\n")


def test_a_movie(run):
    code, out, _ = run("orbit", "spheres", "--dataset-size", SIZE, "-o", "turn.gif", "--frames", 3, "--size", "12x10")
    assert (code, out) == (0, "turn.gif: 3 images of 12 x 10\n")
    assert PillowImage.open("turn.gif").n_frames == 3
    code, _, err = run("orbit", "spheres", "-o", "turn.avi")
    assert code == 2 and "output must end in .mp4, .gif" in err


def test_kernels_are_compiled_ahead(run, monkeypatch):
    given = []
    monkeypatch.setattr(wvr, "warm_up", lambda *values, **options: given.append((values, options)) or ["uint8, lit"])
    assert run("warm-up", "--dtype", "uint8", "--shadows")[:2] == (0, "uint8, lit\nuint8, lit\n")
    assert [values for values, _ in given] == [(), (True, True)] and given[0][1]["dtype"] == ("uint8",)


@pytest.mark.parametrize(
    ("source", "image"), [("a.b.npy", "a.b.png"), ("sub/c.npy", "c.png"), ("d.nii.gz", "d.png"), (".", "here.png")]
)
def test_the_image_is_named_after_the_source_and_in_the_current_folder(source, image, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert f"{_stem(source)}.png" == image


def test_files_and_their_options(run, rendered):
    image = wvr.Volume(CUBE).to_pyvista()
    image["other"] = np.arange(CUBE.size, dtype=np.float32)
    image.save("a.vti")
    assert run("render", "a.vti", "--scalars", "other")[0] == 0
    np.testing.assert_array_equal(rendered["volume"].numpy().ravel(), np.arange(CUBE.size))
    holes = CUBE.astype(np.float32)
    holes[1, 2, 3] = np.nan
    np.save("a.npy", holes)
    code, out, err = run("render", "a.npy")
    assert (code, out) == (2, "") and "1 NaN" in err
    assert run("render", "a.npy", "--nan", "transparent")[0] == 0
    assert rendered["volume"].nan == "transparent"


def test_a_file_comes_before_a_dataset_of_its_name(run, rendered):
    Path("tree").mkdir()
    code, _, err = run("render", "tree")
    assert code == 1 and "or DICOM images in the folder" in err


def test_the_background_is_in_png_files(run, rendered):
    render_spheres(run, "--size", "2x2", "-o", "a.png", "--background", "white")
    render_spheres(run, "--size", "2x2", "-o", "b.png", "--background", "transparent")
    assert PillowImage.open("a.png").mode == "RGB" and PillowImage.open("b.png").mode == "RGBA"
    # Black where opacities are suggested, nothing where they are given.
    render_spheres(run, "--size", "2x2")
    assert rendered["background"] == "black"
    render_spheres(run, "--size", "2x2", "--tf", "0:red:0,90:#ffffff:0.5")
    assert rendered["background"] is None


def test_outputs_are_where_they_were_asked_for(run, rendered):
    render_spheres(run, "--size", "4x3", "-o", "A.NPY")
    assert np.load("A.NPY").shape == (3, 4, 4)
    assert run("info", "spheres", "--dataset-size", SIZE, "--save-tf", "bands", "A.JSON")[0] == 0
    assert wvr.TransferFunction.load("A.JSON") == suggest(wvr.datasets.load("spheres", SIZE))["bands"]
    assert sorted(path.name for path in Path().iterdir()) == ["A.JSON", "A.NPY"]


# Failures


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("render", 2, "SOURCE"),
        ("frobnicate", 2, "frobnicate"),
        ("render spheres --bogus 1", 2, "--bogus"),
        (
            "render nowhere.nrrd",
            1,
            "'nowhere.nrrd' is neither a file or folder nor a dataset; datasets are marschner_lobb",
        ),
        ("info nowhere.nrrd", 1, "neither a file or folder nor a dataset"),
        ("render volume.npy --dataset-size 8", 2, "'volume.npy' is a file"),
        ("render spheres --scalars a", 2, "'spheres' is a dataset"),
        ("render skull --dataset-size 8", 2, "'skull' is downloaded"),
        ("render spheres --dataset-size 1", 2, "--dataset-size"),
        ("render broken.nrrd", 1, "broken.nrrd is truncated or corrupt"),
        ("render spheres --size 512", 2, "--size must be WIDTHxHEIGHT"),
        ("render spheres --size 0x512", 2, "--size must be"),
        ("render spheres --size -3x5", 2, "size"),
        ("render spheres --threads 0", 2, "--threads"),
        ("render spheres --precision half", 2, "float64"),
        (
            "render spheres --integrator simpsons:1",
            2,
            "--integrator must start with one of riemann, simpson",
        ),
        ("render spheres --shadows 1,2", 2, "--shadows must be 3 numbers such as 1,2,3"),
        ("render spheres --shadows yes", 2, "--shadows must be on, off, headlight or a direction towards a light"),
        ("render spheres --shadows 0,0,0", 2, "direction must not be zero"),
        ("render spheres --lighting phong", 2, "--lighting must be one of center, average"),
        ("render spheres --lighting center:x", 2, "or like interpolated:0.2:0.7:0.3:32"),
        ("render spheres --lighting center:-1", 2, "ambient must be"),
        ("render spheres --integrator riemann", 2, "step"),
        ("render spheres --integrator riemann:left", 2, "step must be a number"),
        ("render spheres --integrator riemann:0", 2, "step must be"),
        ("render spheres --integrator riemann:1:left:2", 2, "riemann:1:left:2"),
        ("render spheres --tf nope", 2, "simulation, bands, warm, surfaces"),
        ("render spheres --tf 0:red", 2, "points[0]"),
        ("render spheres --tf 0:red:0,9:reddish:1", 2, "points[1]"),
        ("render spheres --tf nope.json", 1, "nope.json"),
        ("render spheres --tf warm --domain 0,1", 2, "--clim is for colour maps and presets"),
        ("render spheres --tf mri --domain 0,1,2", 2, "--clim must be 2 numbers such as 0,255"),
        ("render spheres --tf mri --clim 0 255", 2, "nothing takes '255'; several numbers are one argument"),
        ("render spheres --tf mri --domain 1,0", 2, "clim must be"),
        ("render spheres --direction 1,2", 2, "--direction must be 3 numbers"),
        ("render spheres --direction 0,0,0", 2, "direction must not be zero"),
        ("render spheres --up w", 2, "--up must be 3 numbers such as 0,0,1 or an axis such as -z, got 'w'"),
        ("render spheres --camera 1,2,3", 2, "--camera must be 6 numbers"),
        ("render spheres --camera 1,2,3,4,5,6 --direction 1,0,0", 2, "not both"),
        ("render spheres --view-angle 180", 2, "view_angle"),
        ("render spheres --background nocolour", 2, "background"),
        ("render spheres --termination 1", 2, "termination"),
        ("render spheres --clip-plane 1,2,3", 2, "--clip-plane must be 6 numbers such as 64,64,64,0,0,1, got '1,2,3'"),
        ("render spheres --clip-plane 1,2,3,0,0,0", 2, "normal must not be zero"),
        ("render spheres --clip-box 1,1,1,0,2,2", 2, "lo must be below hi"),
        ("render spheres --clip-sphere 1,1,1,-1", 2, "radius must be finite and > 0"),
        ("render spheres --device cuda:99", 2, "device"),
        ("render spheres -o a.jp2", 2, "--output must end in .png, .jpg"),
        ("render spheres -o nowhere/a.png", 1, "--output must be in a folder that exists"),
        ("render spheres -o a.exr --background white", 2, "--background is for .png"),
        ("render volume.npy -o volume.npy", 2, "--output must not be the volume itself"),
        ("render constant.npy", 2, "at least two different"),
        ("info spheres --save-tf nope a.json", 2, "--save-tf must name one of bands, warm, surfaces"),
        ("info spheres --save-tf bands a.txt", 2, "--save-tf must name a .json file"),
        ("info spheres --save-tf bands nowhere/a.json", 1, "folder that exists"),
    ],
)
def test_errors_are_one_line_and_nothing_is_written(run, arguments, code, message):
    np.save("volume.npy", CUBE)
    np.save("constant.npy", np.zeros((3, 3, 3), np.uint8))
    Path("broken.nrrd").write_bytes(b"NRRD0005\ntype: uint8\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\nabc")
    before = {path: path.read_bytes() for path in Path().iterdir()}
    got, out, err = run(*arguments.split())
    assert (got, out) == (code, "")
    assert err.startswith("wvr: error: ") and message in err and err.count("\n") == 1
    assert {path: path.read_bytes() for path in Path().iterdir()} == before


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt, 130, ""),
        (MemoryError, 1, "wvr: error: MemoryError\n"),
        (MemoryError("9 GiB\n needed"), 1, "wvr: error: 9 GiB needed\n"),
        (OSError(28, "No space left", "a.png"), 1, "wvr: error: No space left: a.png\n"),
    ],
)
def test_failures_while_rendering(run, monkeypatch, error, code, line):
    def render(*arguments, **options):
        raise error

    monkeypatch.setattr(wvr, "render", render)
    assert run("render", "spheres", "--dataset-size", SIZE) == (code, "", line)
    assert not list(Path().iterdir())


# Progress


def test_the_log_goes_to_stderr_while_a_command_runs(run, rendered, monkeypatch):
    spy = wvr.render

    def render(*arguments, **options):
        logging.getLogger("wvr").info("compiling the kernel %s", "march")
        return spy(*arguments, **options)

    monkeypatch.setattr(wvr, "render", render)
    code, out, err = run("render", "spheres", "--dataset-size", SIZE)
    assert (code, err) == (0, "wvr: compiling the kernel march\n") and out.count("\n") == 1
    assert not logging.getLogger("wvr").handlers


@pytest.mark.parametrize("terminal", [True, False])
def test_a_spinner_with_the_stage_is_on_terminals_only(run, rendered, monkeypatch, terminal):
    spy = wvr.render

    def render(*arguments, **options):
        time.sleep(0.3)
        return spy(*arguments, **options)

    monkeypatch.setattr(wvr, "render", render)
    monkeypatch.setattr(stages, "Timer", lambda seconds, start: Timer(0.1, start))
    monkeypatch.setenv("TTY_COMPATIBLE", "1" if terminal else "0")  # what Rich takes for a terminal
    code, out, err = run("render", "spheres", "--dataset-size", SIZE)
    assert code == 0 and out.count("\n") == 1
    assert ("rendering" in err and "0:00:00" in err) if terminal else err == ""


# As installed


def test_the_installed_command(tmp_path):
    script = Path(sys.executable).with_name("wvr")
    if not script.exists():
        pytest.skip("wvr is not installed beside this Python")

    def wvr_command(*arguments):
        return subprocess.run([script, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=120)

    done = wvr_command("render", "spheres", "--dataset-size", "16", "--size", "32x24", "--background", "white")
    assert done.returncode == 0 and re.fullmatch(
        r"spheres\.png: 32 x 24, .* samples, .* s, errors up to .*\n", done.stdout
    )
    pixels = np.asarray(PillowImage.open(tmp_path / "spheres.png"))
    assert pixels.shape == (24, 32, 3) and tuple(pixels[0, 0]) == (255, 255, 255) and pixels[12, 16].min() < 255
    failed = wvr_command("render", "spheres", "--size", "big")
    assert failed.returncode == 2 and failed.stdout == "" and "Traceback" not in failed.stderr


def test_help_needs_neither_pyvista_nor_matplotlib():
    code = "import sys; from wvr.cli import main; sys.argv = ['wvr', 'render', '--help']; assert main() == 0\n"
    code += "assert not {'pyvista', 'vtkmodules', 'matplotlib', 'PIL'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "--integrator" in done.stdout
    done = subprocess.run([sys.executable, "-m", "wvr", "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, f"{wvr.__version__}\n")


def test_whoever_reads_may_have_enough(tmp_path):
    """As of ``wvr info | head``."""
    np.save(tmp_path / "a.npy", np.arange(27.0).reshape(3, 3, 3))
    command = [sys.executable, "-m", "wvr", "info", tmp_path / "a.npy"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        said = process.stderr.read()
    assert process.returncode == 1 and "Broken" not in said and "Traceback" not in said


def test_studies_are_listed_run_and_reported(run, monkeypatch):
    code, out, err = run("study")
    assert (code, err) == (0, "") and "lum2004: Lum, Wilson and Ma" in out and "    Table 1: " in out
    monkeypatch.setattr("studies.runner.record", lambda out: f"{out} is recorded")
    code, _, err = run("study", "lum2003")
    assert code == 2 and "studies are frontier" in err
    code, _, err = run("study", "lum2004", "--all")
    assert code == 2 and "not both" in err

    from studies import runner

    asked = []
    monkeypatch.setattr(runner, "run", lambda *arguments: asked.append(arguments) or ["lum2004, Table 1: too hard"])
    code, out, err = run("study", "lum2004", "--quick", "--resume")
    assert (code, out) == (1, "out/studies-quick/report.html\n") and "failed: lum2004, Table 1: too hard" in err
    assert [study.name for study in asked[0][0]] == ["lum2004"] and asked[0][1:] == (
        Path("out/studies-quick"),
        True,
        True,
    )
    _, out, _ = run("study", "--all", "-o", "here", "--record")
    assert "here is recorded" in out
    assert len(asked[1][0]) == len(runner.NAMES) and asked[1][1:] == (Path("here"), False, False)
    monkeypatch.setattr(wvr, "__file__", "/nowhere/wvr/__init__.py")
    code, _, err = run("study")
    assert code == 1 and "not installed" in err


def test_a_patient_is_seen_from_the_front(run, rendered, tmp_path):
    volume = spheres()
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 12 12 12\nencoding: raw\nspace: {}\n{}\n"
    place = "space directions: (1,0,0) (0,1,0) (0,0,1)\n"
    for space, front in (("left-posterior-superior", -1), ("right-anterior-superior", 1)):
        content = head.format(space, place).encode() + volume.numpy().tobytes()
        tmp_path.joinpath("head.nrrd").write_bytes(content)
        assert run("render", "head.nrrd")[0] == 0
        right, up, forward = rendered["camera"].basis()
        assert -front * forward[1] > 0.8 and up[2] > 0.9
        # The patient's left is on the right of the image.
        assert right[0] * -front > 0.8


def test_nothing_that_was_read_is_written_to(run):
    """Nor slices of a folder, nor the samples of a header."""
    array = np.arange(60, dtype=np.uint16).reshape(4, 3, 5)
    Path("slices").mkdir()
    for k, page in enumerate(array):
        tifffile.imwrite(f"slices/{k}.tif", page)
    Path("link.tif").symlink_to("slices/2.tif")
    before = {path: path.read_bytes() for path in Path("slices").iterdir()}
    for output in ("slices/2.tif", "link.tif"):
        code, _, err = run("render", "slices", "-o", output)
        assert code == 2 and "--output must not be the volume itself" in err
    code, _, err = run("render", "slices", "-o", "slices/new.png")
    assert code == 2 and "--output must not be among the slices in 'slices'" in err
    np.save("a.npy", array)
    code, _, err = run("render", "a.npy", "--labels", "slices", "-o", "link.tif")
    assert code == 2 and "--output must not be the volume itself or its labels" in err
    assert {path: path.read_bytes() for path in Path("slices").iterdir()} == before
    Path("m.gif").write_bytes(array.tobytes())
    head = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 5 3 4\nencoding: raw\nendian: little\ndata file: m.gif\n"
    Path("m.nhdr").write_text(head)
    code, _, err = run("orbit", "m.nhdr", "-o", "m.gif")
    assert code == 2 and "--output must not be the volume itself" in err
    assert Path("m.gif").read_bytes() == array.tobytes()


def test_warnings_are_lines_of_their_own(run):
    np.save("dark.npy", np.arange(64, dtype=np.uint8).reshape(4, 4, 4))
    code, _, err = run(
        "render", "dark.npy", "--tf", "500:red:0,600:red:1", "--size", "4x4", "--integrator", "riemann:1"
    )
    assert (
        code == 0 and "wvr: warning: nothing is visible" in err and "from 0 to 63" in err and "from 500 to inf" in err
    )


def test_projections_and_isosurfaces(run, tmp_path):
    """As of the API, and one of the ways at a time."""
    for option, integrator in (
        (("--projection", "max"), wvr.Projection("max")),
        (("--isosurface", "60,120"), wvr.Isosurface([60, 120])),
    ):
        output = tmp_path / "picture.npy"
        out = render_spheres(run, *option, "--size", "9x8", "-o", output)
        assert "errors up to" in out
        expected = wvr.render(spheres(), size=(9, 8), integrator=integrator)
        assert np.array_equal(np.load(output), expected.rgba)
    code, _, err = run("render", "spheres", "--projection", "max", "--isosurface", "60", "-o", tmp_path / "a.png")
    assert code != 0 and "give one of --projection, --isosurface" in err
    code, _, err = run("render", "spheres", "--isosurface", "much", "-o", tmp_path / "a.png")
    assert code != 0 and "--isosurface must be scalars such as 90 or 90,140, got 'much'" in err
