"""What people who come from PyVista type first: it works, or one sentence says what to type instead."""

import inspect
import io
import re
import threading
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from PIL import Image as PillowImage

import wvr
from wvr.keywords import ELSEWHERE, MovieOptions, Options

ROOT = Path(__file__).parents[1]
CAMERA = wvr.Camera((40, 30, 20), (8, 8, 8))
FAST = {"size": (16, 12), "integrator": wvr.Riemann(1.0)}


@pytest.fixture(scope="module")
def volume():
    return wvr.datasets.load("spheres", 16)


@pytest.fixture(scope="module")
def grid(volume):
    return volume.to_pyvista()


@pytest.fixture(scope="module")
def image(volume):
    return wvr.render(volume, **FAST)


def test_one_argument_is_enough_whatever_it_is(volume, grid, image, tmp_path):
    np.save(tmp_path / "a.npy", volume.numpy())
    masked = np.ma.masked_equal(volume.numpy().astype(np.int64), 0)
    for data in (grid, tmp_path / "a.npy", str(tmp_path / "a.npy"), volume.numpy(), volume.numpy().tolist()):
        assert np.array_equal(wvr.render(data, **FAST).rgba, image.rgba), type(data)
    assert wvr.render(masked, lighting=False, **FAST).rgba.max() > 0
    assert wvr.render(volume.numpy() > 100, **FAST).rgba.max() > 0


def test_axes_are_told():
    array = np.zeros((40, 20, 10), np.uint8)
    assert repr(wvr.as_volume(array)).startswith("Volume(x=10, y=20, z=40,")
    xyz = wvr.as_volume(array, axes="xyz")
    assert tuple(xyz.dimensions) == pv.wrap(array).dimensions
    with pytest.warns(UserWarning, match=r'100 along z; its first two axes .*axes="xyz"'):
        wvr.as_volume(np.zeros((100, 100, 3), np.uint8))


def test_opacities_by_name_are_those_of_pyvista():
    for name in ("linear", "geom", "geom_r", "sigmoid", "sigmoid_5", "sigmoid_3_r", "foreground", "linear_r"):
        theirs = pv.opacity_transfer_function(name, 256) / 255
        tf = wvr.TransferFunction.from_colormap("viridis", (0, 255), name)
        ours = -np.expm1(-tf.extinction(np.arange(256.0), 1.0))
        np.testing.assert_allclose(ours, theirs, atol=1.01 / 255 + 1 / 512, err_msg=name)
    # Between numbers opacity itself is linear: a quarter of the range, a quarter of it.
    tf = wvr.TransferFunction.from_colormap("viridis", (0, 1), [0, 1])
    assert -np.expm1(-tf.extinction([0.25], 1.0)[0]) == pytest.approx(0.25, abs=1 / 512)


def test_movies_cameras_and_files(volume, grid, image, tmp_path):
    assert wvr.orbit(grid, frames=2, output=tmp_path / "turn.gif", **FAST).stat().st_size > 0
    image.save(tmp_path / "a.jpg")
    assert PillowImage.open(tmp_path / "a.jpg").size == (16, 12)
    assert PillowImage.open(io.BytesIO(image.png())).size == (16, 12)
    place = [(40.0, 0.0, 9.0), (7.5, 7.5, 7.5), (0.0, 0.0, 1.0)]
    seen = wvr.render(volume, camera=place, **FAST).shown.camera
    np.testing.assert_allclose(seen.to_pyvista().position, place[0])
    axes = image.plot(scalar_bar=True, outline=True)
    assert len(axes.figure.axes) == 2


def test_what_is_cancelled_ends(volume):
    event = threading.Event()
    event.set()
    with pytest.raises(wvr.Cancelled):
        wvr.render(volume, cancel=event, **FAST)


@pytest.mark.parametrize("keyword", sorted(ELSEWHERE))
def test_keywords_of_other_libraries_say_what_to_write(grid, keyword):
    """Each names a way that there is, and none is a keyword of ours."""
    with pytest.raises(TypeError, match=f"^render has no keyword '{keyword}'; .{{12,}}"):
        wvr.render(grid, **{keyword: None})
    assert keyword not in inspect.signature(wvr.render).parameters
    for name in re.findall(r"wvr\.([\w.]+\w)", ELSEWHERE[keyword].replace("data.wvr", "data")):
        attrgetter(name)(wvr)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda v: wvr.render(v, tolerence=0.1), "'tolerence'; did you mean 'tolerance'?"),
        (lambda v: wvr.render(v, tol=0.1), "'tol'; did you mean 'tolerance'?"),
        (lambda v: wvr.render(v, budget="fast"), "budget must be seconds or a text such as \"500 MB\", got 'fast'"),
        (lambda v: wvr.render(v, memory_limit=np.int64(9)), "memory_limit must be at least 1048576 bytes, got"),
        (lambda v: next(wvr.orbit(v, cmap="viridis")), "orbit has no keyword 'cmap'; give the colour map"),
        (lambda v: wvr.time_series([v], lightning=True), "'lightning'; did you mean 'lighting'?"),
        (lambda v: v.to_pyvista().wvr.render(shade=True), "render has no keyword 'shade'; say lighting=True"),
        (lambda v: wvr.render(v, "ct_bone"), "did you mean 'ct-bone'?"),
        (lambda v: next(wvr.orbit(v, n_frames=8)), "orbit has no keyword 'n_frames'; wvr.orbit has frames=120"),
        (lambda v: next(wvr.orbit(v, "turn.gif")), "a file to write is output="),
        (lambda v: wvr.render(v, camera=(0, 0, 0)), "wvr.Camera.fit(volume, direction) looks from a direction"),
        (lambda v: wvr.render(v, integrator="mip"), "or wvr.Projection('max'), got 'mip'"),
        (lambda v: wvr.render(v, "virdis"), "did you mean 'viridis'?"),
        (lambda v: wvr.render(v, "viridis", opacity="sigmod"), "did you mean 'sigmoid'?"),
        (lambda v: wvr.render(v, camera="izo"), "did you mean 'iso'?"),
        (lambda v: wvr.render(v, lighting="centre"), "did you mean 'center'?"),
        (lambda v: wvr.render(v, background="wite"), "did you mean 'white'?"),
        (lambda v: wvr.render(v, shadows="on"), "shadows must be a ConvolutionShadows, True, False or None, got 'on'"),
        (lambda v: wvr.render(v, size=512), "such as (512, 512), got 512"),
        (lambda v: wvr.render(v, integrator="riemann"), "such as wvr.Riemann(0.5) or wvr.Projection('max'), got 'ri"),
        (lambda v: wvr.render(v, integrator=wvr.Riemann), "got the class Riemann: say Riemann(...)"),
        (lambda v: wvr.render([v, v]), "one volume, got a list of 2: wvr.time_series"),
        (lambda v: wvr.render(np.zeros((2, 8, 8, 8))), "wvr.time_series renders arrays [t, z, y, x]"),
        (lambda v: wvr.render(np.zeros((8, 8))), "a single slice is array[None]"),
        (lambda v: wvr.render(np.zeros((8, 8, 8, 4), np.uint8)), "one component a sample"),
        (lambda v: wvr.render(pv.MultiBlock([v.to_pyvista()])), "pass one of them, such as data[0]"),
        (lambda v: wvr.render(pv.Sphere()), "a surface has none"),
        (lambda v: wvr.render(pv.Plotter(off_screen=True)), "plotter.wvr.screenshot()"),
        (lambda v: wvr.render(pv.ImageData(dimensions=(2, 2, 2)).cast_to_unstructured_grid()), "no point or cell"),
        (lambda v: wvr.read(v.numpy()), "path must be a path (str or os.PathLike), got ndarray"),
        (lambda v: wvr.Volume(np.zeros((3, 3, 3), [("t", "f4")])), "pick one, e.g. array['t']"),
        (lambda v: wvr.render("sphers"), "did you mean the dataset 'spheres'?"),
        (lambda v: wvr.view(v, size=(8, 8)), "view has no keyword 'size'; a viewer is as large as its window"),
        (lambda v: wvr.Renderer(v.numpy(), "viridis").render(CAMERA), "got ndarray: volume = wvr.as_volume(data)"),
        (lambda v: wvr.Renderer(v, "viridis").render(CAMERA), "from_colormap('viridis', volume.range) makes one"),
        (lambda v: wvr.Renderer(v).render(CAMERA), "got None: wvr.presets.suggest(volume) has some"),
        (lambda v: wvr.render(v, **FAST).save("a.mp4"), "got 'a.mp4'; wvr.orbit, wvr.time_series and"),
        (lambda v: wvr.render(v, **FAST).save("a.html"), "wvr.view(data) has a page to turn it"),
        (lambda v: wvr.Projection("maximum"), "did you mean 'max'?"),
        (lambda v: wvr.Projection("average"), "what must be 'mean' for the average"),
        (lambda v: wvr.Volume(v.to_pyvista()), "wvr.as_volume takes it"),
        (lambda v: wvr.Volume("a.nrrd"), "wvr.read reads files"),
        (lambda v: wvr.Volume(np.zeros((3, 3, 3), bool)), "cast it to uint8"),
        (lambda v: wvr.Volume(np.ma.masked_all((3, 3, 3))), "wvr.as_volume(array) renders them as nothing"),
    ],
)
def test_a_slip_is_told_in_a_sentence(volume, call, message):
    with pytest.raises((TypeError, ValueError, OSError)) as caught:
        call(volume)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_grids_that_are_not_regular_are_resampled_and_say_so(volume):
    axis = np.array([0.0, 1.0, 2.5, 4.0])
    rectilinear = pv.RectilinearGrid(axis, axis, axis)
    rectilinear["a"] = np.arange(64.0)
    for grid in (rectilinear, rectilinear.cast_to_structured_grid(), rectilinear.cast_to_unstructured_grid()):
        with pytest.warns(UserWarning, match=f"the {type(grid).__name__} is resampled on .* samples"):
            wvr.as_volume(grid)


def test_type_checkers_know_the_keywords():
    """Those that are written down for them are those that there are."""
    parameters = inspect.signature(wvr.render).parameters
    keywords = {name for name, parameter in parameters.items() if parameter.kind is parameter.KEYWORD_ONLY}
    assert set(Options.__annotations__) | {"integrator", "tolerance"} == keywords
    assert set(MovieOptions.__annotations__) == keywords - {"cancel", "depth", "progress"}


def test_every_keyword_of_add_volume_is_answered():
    known = {*inspect.signature(wvr.render).parameters, *ELSEWHERE, "self", "volume", "kwargs"}
    assert set(inspect.signature(pv.Plotter.add_volume).parameters) <= known


# What stands for what the table leaves out; images are small.
LEFT_OUT = {
    "wvr.render(": "render(",
    "from_colormap(...": 'from_colormap("viridis", (0, 255), "linear"',
    "wvr.Lighting(...)": "wvr.Lighting()",
    "wvr.Camera(...)": "wvr.Camera(position, focal)",
    "frames=120": "size=(16, 12), frames=2",
    "turn.mp4": "turn.gif",
}
TABLE = re.findall(r"^\| `?(.*?)`? \| (.*) \|$", (ROOT / "docs" / "from_pyvista.md").read_text(encoding="utf-8"), re.M)


@pytest.mark.parametrize("row", TABLE[2:], ids=lambda row: row[0][:40])
def test_what_the_table_for_users_of_pyvista_says_works(row, volume, grid, image, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: raw\n\n"
    (tmp_path / "scan.nrrd").write_bytes(header.encode() + volume.numpy().astype(np.uint8).tobytes())
    monkeypatch.setattr(wvr.Image, "show", lambda image: None)  # there is no display
    plotter = pv.Plotter(off_screen=True, window_size=FAST["size"])
    plotter.add_volume(grid)
    plotter.show(auto_close=False)
    position, focal, up = (40.0, 30.0, 20.0), (8.0, 8.0, 8.0), (0.0, 0.0, 1.0)
    names = {"wvr": wvr, "grid": grid, "image": image, "plotter": plotter, "array": volume.numpy()}
    names |= {"position": position, "focal": focal, "up": up, "point": focal, "normal": up, "x": 8, "y": 6}
    names["render"] = lambda *given, **options: wvr.render(*given, **{"size": FAST["size"], **options})
    works = [text for text in re.findall(r"`([^`]+)`", row[1]) if not text.startswith('"')]
    assert works
    for text in works:
        for left_out, instead in LEFT_OUT.items():
            text = text.replace(left_out, instead)
        keyword = re.match(r"\w+=", text)
        eval(f"render(grid, {text})" if keyword else text, names)
    plotter.close()
