"""Movies have the frames that were asked for, whole or not at all; an orbit keeps everything in the frame."""

import warnings

import numpy as np
import pytest
from PIL import Image as PillowImage
from PIL import ImageSequence

import wvr
from wvr.views import suggested_view

SIZE = (24, 18)
FAST = {"size": SIZE, "integrator": wvr.Riemann(1.0)}


@pytest.fixture(scope="module")
def volume():
    return wvr.datasets.load("spheres", 12)


def flat(value, size=SIZE):
    return np.full((size[1], size[0], 3), value, np.uint8)


def frames_of(path):
    if path.suffix == ".gif":
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(PillowImage.open(path))]
    if path.is_dir():
        return [np.asarray(PillowImage.open(file)) for file in sorted(path.iterdir())]
    reader = pytest.importorskip("imageio_ffmpeg").read_frames(str(path))
    width, height = next(reader)["size"]
    return [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]


@pytest.mark.parametrize("name", ["turn.gif", "turn.mp4", "turn"])
@pytest.mark.parametrize("size", [(24, 18), (23, 17)])
def test_frames_are_what_was_given(tmp_path, name, size):
    if name.endswith("mp4"):
        pytest.importorskip("imageio_ffmpeg")
    values = (10, 120, 250)
    path = wvr.save_movie((flat(value, size) for value in values), tmp_path / name, fps=10)
    frames = frames_of(path)
    assert len(frames) == 3 and list(tmp_path.iterdir()) == [path]
    for frame, value in zip(frames, values, strict=True):
        # An edge is repeated where a movie must be even.
        assert frame.shape[0] - size[1] in (0, 1) and np.abs(frame.astype(int) - value).max() <= 4


def test_images_are_in_front_of_their_background(tmp_path):
    empty = np.zeros((2, 3, 4), np.float32), np.zeros((2, 3), np.int32)
    images = [wvr.Image(*empty), wvr.Image(*empty, background="red"), wvr.Image(*empty, background="transparent")]
    frames = frames_of(wvr.save_movie(images, tmp_path / "a"))
    assert [frame[0, 0].tolist() for frame in frames] == [[255, 255, 255], [255, 0, 0], [255, 255, 255]]


@pytest.mark.parametrize(
    ("images", "name", "error", "message"),
    [
        ([], "a.gif", ValueError, "images must be at least one"),
        ([flat(1), flat(1, (9, 9))], "a.gif", ValueError, r"one size, got \(24, 18\) and \(9, 9\)"),
        ([np.zeros((4, 4))], "a.gif", TypeError, "uint8"),
        ([flat(1)], "a.avi", ValueError, "path must end in .mp4, .gif"),
        ([flat(1)], "nowhere/a.gif", FileNotFoundError, "folder that exists"),
        ([flat(1)], "full", ValueError, "new or empty folder"),
    ],
)
def test_nothing_is_half_written(tmp_path, images, name, error, message):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a.txt").write_text("")
    with pytest.raises(error, match=message):
        wvr.save_movie(images, tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["full"]


def test_a_movie_that_fails_leaves_the_old_one(tmp_path):
    def images():
        yield flat(1)
        raise KeyboardInterrupt

    (tmp_path / "a.gif").write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt):
        wvr.save_movie(images(), tmp_path / "a.gif")
    assert (tmp_path / "a.gif").read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


def test_without_ffmpeg_it_is_said_before_anything_is_rendered(volume, tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"pip install imageio-ffmpeg"):
        wvr.orbit(volume, output=tmp_path / "a.mp4", frames=1, **FAST)


@pytest.mark.parametrize(("suffix", "most"), [(".gif", 65535), (".mp4", 16384)])
def test_formats_hold_so_many_pixels_along_a_side(volume, tmp_path, suffix, most):
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / f"a{suffix}"
    wvr.save_movie([flat(0, (most, 2)), flat(9, (most, 2))], path)
    with pytest.raises(ValueError, match=f"path must .* that holds 1 x {most + 1} pixels, got {suffix}"):
        wvr.save_movie([flat(0, (1, most + 1))], path)
    with pytest.raises(ValueError, match=f"output must be of a format that holds {most + 1} x 1 pixels"):
        wvr.orbit(volume, frames=2, output=path, size=(most + 1, 1))
    with pytest.raises(ValueError, match=f"output must be of a format that holds {most + 1} x 1 pixels"):
        wvr.time_series([volume], output=path, size=(most + 1, 1))


def test_an_orbit_is_counter_clockwise_and_keeps_its_distance(volume):
    images = list(wvr.orbit(volume, frames=4, elevation=30, **FAST))
    cameras = [image.shown.camera for image in images]
    towards = np.array([-camera.basis()[2] for camera in cameras])
    # From the side that the suggested view is from.
    front, level = suggested_view(volume).direction * [1, 1, 0], np.cos(np.pi / 6)
    x, y, _ = level * front / np.linalg.norm(front)
    np.testing.assert_allclose(towards, [[x, y, 0.5], [-y, x, 0.5], [-x, -y, 0.5], [y, -x, 0.5]], atol=1e-12)
    distances = [np.linalg.norm(camera.position - camera.target) for camera in cameras]
    np.testing.assert_allclose(distances, distances[0])
    for image in images:
        # All is in the frame, which is filled, and lit from where the camera is.
        alpha = image.rgba[..., 3] > 0.05
        assert not alpha[[0, -1]].any() and not alpha[:, [0, -1]].any() and np.ptp(np.nonzero(alpha)[0]) > 10
    np.testing.assert_allclose(images[0].rgba, images[2].rgba, atol=0.05)  # a sphere


def test_an_orbit_of_a_store_is_that_of_the_volume():
    values = np.zeros((12, 12, 12), np.uint8)
    values[3:9, :2, 3:9] = values[5:7, :9, 5:7] = 200
    for one, other in zip(*(wvr.orbit(data, frames=2, **FAST) for data in (values, wvr.open(values))), strict=True):
        np.testing.assert_allclose(one.shown.camera.position, other.shown.camera.position, atol=1e-9)


def test_an_orbit_frames_what_an_integrator_shows():
    """Of a maximum all that is not dark, whatever is opaque; of an isosurface what is above it."""
    values = np.zeros((12, 12, 12), np.uint8)
    values[2:10, 2:10, 2:10] = 150
    values[5:7, 5:7, 5:7] = 250
    rare = wvr.TransferFunction([(0, "black", 0.0), (200, "white", 0.0), (250, "white", 0.9)])
    whole = wvr.TransferFunction([(0, "gold", 1.0), (1, "gold", 1.0)])
    for tf, method, least in ((rare, wvr.Projection("max"), 12), (whole, wvr.Isosurface(200), 8)):
        for image in wvr.orbit(values, tf, 2, size=(24, 24), integrator=method):
            seen = np.argwhere(image.rgba[..., 0] > 0.1)
            assert seen.min() > 0 and seen.max() < 23 and np.ptp(seen, axis=0).min() > least


def test_what_stands_is_upright_all_the_way_around():
    values = np.zeros((12, 12, 12), np.uint8)
    values[3:9, :2, 3:9] = values[5:7, :9, 5:7] = 200  # on a face of the lowest y
    for image in wvr.orbit(values, frames=3, elevation=0, **FAST):
        np.testing.assert_allclose(image.shown.camera.basis()[1], (0, 1, 0), atol=1e-12)


def test_an_orbit_takes_what_render_takes(volume, tmp_path):
    path = wvr.orbit(volume, "viridis", 2, tmp_path / "a", opacity="linear", clim=(0, 100), lighting=False, **FAST)
    assert len(frames_of(path)) == 2
    for name, *wrong in (("frames", 0, 2.0, None, np.inf), ("elevation", 90, "x", None), ("turn", np.nan, [], 10**400)):
        for value in wrong:
            with pytest.raises(ValueError, match=f"{name} must be"):
                wvr.orbit(volume, **(FAST | {name: value}))
    with pytest.raises(TypeError, match="output must be a path"):
        wvr.orbit(volume, output=1, **FAST)
    with pytest.raises(TypeError, match="images must be iterable"):
        wvr.save_movie(1, tmp_path / "b")
    # As many as there shall be, one after the other.
    assert next(wvr.orbit(volume, frames=10**9, **FAST)).size == next(wvr.orbit(volume, frames=1, **FAST)).size
    with pytest.raises(TypeError, match="camera is what orbit chooses"):
        wvr.orbit(volume, camera="iso", **FAST)


@pytest.mark.parametrize("kind", ["list", "array", "xarray"])
def test_a_time_series_has_one_look(kind, tmp_path):
    moments = np.zeros((3, 8, 8, 8), np.uint8)
    for n in range(3):
        moments[n, 2:6, 2:6, 2 : 4 + n] = 200
    data = {"list": list(moments), "array": moments}.get(kind)
    if kind == "xarray":
        data = pytest.importorskip("xarray").DataArray(moments, dims=("time", "z", "y", "x"))
    images = list(wvr.time_series(data, **FAST))
    camera = images[0].shown.camera
    assert all(repr(image.shown.camera) == repr(camera) for image in images)
    tf = images[0].shown.transfer_function
    alone = wvr.render(moments[2], tf, camera, lighting=wvr.render(moments[0], **FAST) and True, **FAST)
    np.testing.assert_array_equal(images[2].rgba[..., 3], alone.rgba[..., 3])
    assert len(frames_of(wvr.time_series(data, output=tmp_path / "a", **FAST))) == 3


def test_a_time_series_frames_what_clips_leave(volume):
    options = FAST | {"clip": wvr.ClipBox((0, 0, 0), (5, 5, 5)), "lighting": False}
    first, single = next(wvr.time_series([volume], **options)), wvr.render(volume, **options)
    np.testing.assert_array_equal(first.shown.camera.position, single.shown.camera.position)
    np.testing.assert_array_equal(first.rgba, single.rgba)


def test_a_time_series_may_begin_with_nothing():
    """As simulations do; over what scalars colours are is then said."""
    moments = np.zeros((2, 8, 8, 8), np.uint8)
    moments[1, 2:6, 2:6, 2:5] = 200
    first, second = wvr.time_series(moments, "viridis", clim=(0, 255), **FAST)
    assert not first.rgba.any() and second.rgba[..., 3].max() > 0.1
    with pytest.raises(ValueError, match=r"all are 0; give .* clim=\(low, high\)"):
        wvr.time_series(moments, "viridis", **FAST)


def test_a_series_that_grows_beyond_its_colours_is_warned_of():
    moments = np.zeros((3, 8, 8, 8), np.uint8)
    moments[:, 2:6, 2:6, 2:5] = np.array([40, 45, 200])[:, None, None, None]
    with pytest.warns(UserWarning, match="volume 2 of the series go from 0 to 200, colours from 0 to 40 .* give clim="):
        list(wvr.time_series(moments, "viridis", **FAST))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        list(wvr.time_series(moments, "viridis", clim=(0, 200), **FAST))


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        ([], ValueError, "at least one volume"),
        (np.zeros((3, 4, 5)), ValueError, "four axes"),
        ("a.nrrd", TypeError, "a sequence of volumes"),
    ],
)
def test_what_is_no_time_series(data, error, message):
    with pytest.raises(error, match=message):
        wvr.time_series(data, **FAST)


def test_all_volumes_of_a_time_series_have_one_shape():
    images = wvr.time_series([np.indices((4, n, n), np.uint8).sum(axis=0, dtype=np.uint8) for n in (4, 5)], **FAST)
    next(images)
    with pytest.raises(ValueError, match=r"one shape, got \(4, 4, 4\) and \(4, 5, 5\)"):
        next(images)
