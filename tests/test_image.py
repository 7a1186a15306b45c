import os
import pickle
import tempfile
from pathlib import Path

import numpy as np
import pytest

import wvr
from wvr.color import srgb_to_linear
from wvr.image import Image

FLOAT_SUFFIXES = [".exr", ".tif", ".tiff", ".npy"]


def make_image(dtype=np.float32, background=None, height=5, width=7):
    shape = (height, width)
    rng = np.random.default_rng(2)
    rgba = rng.random((*shape, 4))
    rgba[..., :3] *= rgba[..., 3:]  # premultiplied
    rgba[0, 0] = 0
    return Image(rgba.astype(dtype), np.full(shape, 3, np.int32), stats={"seconds": 0.2149}, background=background)


def uniform(rgba, background=None):
    return Image(np.array([[rgba]], np.float64), np.zeros((1, 1), np.int32), background=background)


def test_attributes():
    bound = np.zeros((5, 7))
    image = Image(np.zeros((5, 7, 4), np.float32), np.zeros((5, 7), np.int32), bound)
    assert image.size == (7, 5)
    assert image.error_bound is bound
    assert image.stats == {}
    assert image.background is None


@pytest.mark.parametrize(
    "arguments, message",
    [
        ((np.zeros((5, 7, 3)), np.zeros((5, 7))), "rgba must be"),
        ((np.zeros((5, 7, 4), np.uint8), np.zeros((5, 7))), "rgba must be"),
        ((np.zeros((5, 0, 4)), np.zeros((5, 0))), "rgba must have a pixel or more"),
        ((np.zeros((5, 7, 4)), np.zeros((7, 5))), "samples must have the shape"),
        ((np.zeros((5, 7, 4)), np.zeros((5, 7)), np.zeros(3)), "error_bound must have the shape"),
        ((np.zeros((5, 7, 4)), np.zeros((5, 7)), None, None, "whitish"), "background must be"),
    ],
)
def test_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Image(*arguments)


def test_composited_is_linear_over():
    image = uniform([0.1, 0.2, 0.3, 0.6])
    np.testing.assert_allclose(image.composited((1, 0.5, 0))[0, 0], [0.5, 0.4, 0.3], atol=1e-15)
    grey = srgb_to_linear(128 / 255)
    np.testing.assert_allclose(image.composited("#808080")[0, 0], np.array([0.1, 0.2, 0.3]) + 0.4 * grey, atol=1e-15)
    assert make_image().composited("white").dtype == np.float64


def test_uint8_with_background():
    # Black of opacity 1/2 over linear white is linear 1/2, which sRGB encodes as 187.5: not 128.
    np.testing.assert_array_equal(uniform([0, 0, 0, 0.5]).to_uint8("white"), [[[188, 188, 188]]])
    assert make_image().to_uint8("white").shape == (5, 7, 3)


def test_uint8_without_background_is_straight():
    # Half-covering linear (1, 0.5, 0): colour by itself, alpha linear.
    np.testing.assert_array_equal(uniform([0.5, 0.25, 0, 0.5]).to_uint8(), [[[255, 188, 0, 128]]])
    np.testing.assert_array_equal(uniform([0, 0, 0, 0]).to_uint8(), [[[0, 0, 0, 0]]])


def test_uint8_rounds_to_nearest_and_clips():
    codes = np.arange(256)
    for offset in (-0.49, 0.0, 0.49):
        linear = srgb_to_linear(np.clip(codes + offset, 0, 255) / 255)
        rgba = np.stack([linear, linear, linear, np.ones(256)], axis=-1)[None]
        image = Image(rgba, np.zeros((1, 256), np.int32))
        np.testing.assert_array_equal(image.to_uint8("black")[0, :, 0], codes)
    np.testing.assert_array_equal(uniform([1.7, 0.0, -1e-9, 1.0]).to_uint8("black"), [[[255, 0, 0]]])


def test_a_background_of_any_kind_of_numbers_is_kept_as_floats():
    given = np.array([0.1, 0.2, 0.3])
    image = make_image(background=given)
    given[:] = 1
    assert image.background == (0.1, 0.2, 0.3)
    np.testing.assert_array_equal(image.to_uint8(), make_image().to_uint8((0.1, 0.2, 0.3)))


def test_pixels_behind_are_uint8_or_floats():
    for dtype in (np.uint16, np.int64, bool):
        with pytest.raises(ValueError, match="uint8 sRGB or finite linear"):
            make_image().composited(np.ones((5, 7, 3), dtype))


def test_own_background_and_transparent():
    image = make_image(background="orange")
    np.testing.assert_array_equal(image.to_uint8(), make_image().to_uint8("orange"))
    np.testing.assert_array_equal(image.to_uint8("white"), make_image().to_uint8("white"))
    np.testing.assert_array_equal(image.to_uint8("transparent"), make_image().to_uint8())
    assert image.rgba[0, 0, 3] == 0


@pytest.mark.parametrize("background", [None, "white", (0.2, 0.4, 3.0)])
def test_png(tmp_path, background):
    from PIL import Image as PillowImage

    image = make_image()
    image.save(tmp_path / "a.PNG", background=background)
    with PillowImage.open(tmp_path / "a.PNG") as png:
        assert png.info["Software"] == "wvr"
        np.testing.assert_array_equal(np.asarray(png), image.to_uint8(background))
    assert os.listdir(tmp_path) == ["a.PNG"]


def test_png_with_own_background(tmp_path):
    from PIL import Image as PillowImage

    make_image(background="white").save(str(tmp_path / "a.png"))
    with PillowImage.open(tmp_path / "a.png") as png:
        assert png.mode == "RGB"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_npy(tmp_path, dtype):
    image = make_image(dtype, background="white")
    image.save(tmp_path / "a.npy")
    loaded = np.load(tmp_path / "a.npy")
    assert loaded.dtype == dtype
    np.testing.assert_array_equal(loaded, image.rgba)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("suffix", [".tif", ".tiff"])
def test_tiff(tmp_path, dtype, suffix):
    import tifffile

    image = make_image(dtype, background="white")
    image.save(tmp_path / f"a{suffix}")
    with tifffile.TiffFile(tmp_path / f"a{suffix}") as tiff:
        page = tiff.pages[0]
        assert page.photometric == tifffile.PHOTOMETRIC.RGB
        assert page.extrasamples == (tifffile.EXTRASAMPLE.ASSOCALPHA,)
        loaded = page.asarray()
    assert loaded.dtype == dtype
    np.testing.assert_array_equal(loaded, image.rgba)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_exr(tmp_path, dtype):
    import OpenEXR

    image = make_image(dtype, background="white")
    image.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as exr:
        channels = exr.channels()
        assert set(channels) == set("RGBA")
        loaded = np.stack([channels[c].pixels for c in "RGBA"], axis=-1)
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, image.rgba.astype(np.float32))


def test_exr_of_a_view(tmp_path):
    import OpenEXR

    rgba = make_image(np.float64).rgba[::-1, ::2]
    Image(rgba, np.zeros(rgba.shape[:2], np.int32)).save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr")) as exr:
        np.testing.assert_array_equal(exr.channels()["RGBA"].pixels, rgba.astype(np.float32))


@pytest.mark.parametrize("suffix", FLOAT_SUFFIXES)
def test_float_formats_refuse_a_background(tmp_path, suffix):
    with pytest.raises(ValueError, match=f"background must be None for {suffix}"):
        make_image().save(tmp_path / f"a{suffix}", background="white")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["a.jp2", "a", "png", "a.png.bak"])
def test_unknown_extension(tmp_path, name):
    with pytest.raises(ValueError, match=r"path must end in \.png, \.jpg, \.jpeg, \.exr, \.tif, \.tiff, \.npy, got"):
        make_image().save(tmp_path / name)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("suffix", [".png", *FLOAT_SUFFIXES])
def test_missing_folder(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match="path must be in a folder that exists"):
        make_image().save(tmp_path / "missing" / f"a{suffix}")
    assert os.listdir(tmp_path) == []


def test_wrong_background_leaves_nothing(tmp_path):
    with pytest.raises(ValueError, match="background must be"):
        make_image().save(tmp_path / "a.png", background="whitish")
    assert os.listdir(tmp_path) == []


@pytest.fixture
def unwritable_folder():
    """A folder with one file that this process may not write to, as root neither."""
    root = os.geteuid() == 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for suffix in (".png", *FLOAT_SUFFIXES):
            make_image().save(folder / f"warm-up{suffix}")  # nobody may not be able to import the encoders
            (folder / f"warm-up{suffix}").unlink()
        folder.chmod(0o555)
        if root:
            os.seteuid(65534)
        try:
            yield folder
        finally:
            if root:
                os.seteuid(0)
            folder.chmod(0o755)


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="needs POSIX permissions")
@pytest.mark.parametrize("suffix", [".png", *FLOAT_SUFFIXES])
def test_unwritable_folder(unwritable_folder, suffix):
    with pytest.raises(PermissionError):
        make_image().save(unwritable_folder / f"a{suffix}")
    assert os.listdir(unwritable_folder) == []


@pytest.mark.parametrize("suffix", [".png", ".jpg", *FLOAT_SUFFIXES])
def test_failing_encoder_keeps_the_old_file(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"old")

    def disk_full(target, *args, **kwargs):
        target.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("wvr.image.PIXEL_WRITERS", dict.fromkeys([".png", ".jpg"], disk_full))
    monkeypatch.setattr("wvr.image.FLOAT_WRITERS", dict.fromkeys(FLOAT_SUFFIXES, disk_full))
    with pytest.raises(OSError, match="No space left"):
        make_image().save(path)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [path.name]


def test_exr_failure_is_an_os_error(tmp_path, monkeypatch):
    import OpenEXR

    def fail(self, path):
        raise RuntimeError("cannot write scanline")

    monkeypatch.setattr(OpenEXR.File, "write", fail)
    with pytest.raises(OSError, match="could not write the EXR file: cannot write scanline"):
        make_image().save(tmp_path / "a.exr")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("suffix", [".png", *FLOAT_SUFFIXES])
def test_overwrites(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    make_image(height=2).save(path)
    small = path.stat().st_size
    make_image(height=50).save(path)
    assert path.stat().st_size > small
    assert os.listdir(tmp_path) == [path.name]


def test_files_get_the_usual_permissions(tmp_path):
    (tmp_path / "plain").touch()
    make_image().save(tmp_path / "a.npy")
    assert (tmp_path / "a.npy").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_target_that_is_a_folder(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(OSError):
        make_image().save(tmp_path / "a.png")
    assert os.listdir(tmp_path) == ["a.png"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_only_numbers_are_shown(tmp_path, wrong):
    """Files of floats keep the others."""
    image = make_image()
    image.rgba[2, 3, 1] = wrong
    for suffix in (".png", ".jpg"):
        with pytest.raises(ValueError, match="rgba must be finite where it is shown"):
            image.save(tmp_path / f"a{suffix}")
    assert not list(tmp_path.iterdir())
    for suffix in FLOAT_SUFFIXES:
        image.save(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), image.rgba)


@pytest.mark.filterwarnings("error")
def test_what_is_beyond_a_format_is_refused(tmp_path):
    bright = uniform([1e39, 0.5, 0, 1])
    with pytest.raises(ValueError, match=r"path must end in .tiff or .npy for numbers up to 1e\+39, got .exr"):
        bright.save(tmp_path / "a.exr")
    for suffix, most in ((".jpg", 65500), (".jpeg", 65500)):
        make_image(height=1, width=most).save(tmp_path / f"a{suffix}")
        with pytest.raises(ValueError, match=f"path must .* that holds 1 x {most + 1} pixels, got {suffix}"):
            make_image(height=most + 1, width=1).save(tmp_path / f"b{suffix}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.jpeg", "a.jpg"]
    bright.save(tmp_path / "c.npy")
    np.testing.assert_array_equal(bright.to_uint8((1e308, 0, 0)), [[[255, 188, 0]]])


def test_notebook_shows_the_png():
    from io import BytesIO

    from PIL import Image as PillowImage

    image = make_image(background="white")
    with PillowImage.open(BytesIO(image._repr_png_())) as png:
        np.testing.assert_array_equal(np.asarray(png), image.to_uint8())


def test_pickled():
    """A copy has what was rendered, and knows nothing of the volume."""
    camera = wvr.Camera.fit(volume := wvr.datasets.load("blobs", 16))
    image = wvr.render(volume, "viridis", camera, (8, 6), lighting=False)
    copy = pickle.loads(pickle.dumps(image))
    assert type(copy) is type(image) and copy.stats == image.stats
    for name in ("rgba", "error_bound", "samples"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(image, name))
    copy.plot(axes=True)
    with pytest.raises(ValueError, match=r"pick needs an image that wvr.render made, in the process that made it"):
        copy.pick(1, 1)


def test_as_array():
    image = make_image()
    assert np.asarray(image) is image.rgba or np.shares_memory(np.asarray(image), image.rgba)
    assert not np.shares_memory(np.array(image), image.rgba)
    assert np.asarray(image, np.float64).dtype == np.float64


def test_repr():
    assert repr(make_image()) == "Image(7 x 5, 105 samples, 0.215 s)"
    image = Image(np.zeros((512, 512, 4), np.float32), np.full((512, 512), 47, np.int32), stats={"seconds": 0.21})
    assert repr(image) == "Image(512 x 512, 12.3 M samples, 0.21 s)"
    assert repr(Image(image.rgba, np.full((512, 512), 2**14, np.int32))) == "Image(512 x 512, 4.29 G samples)"
    for count, said in (
        (999_400, "999 k"),
        (999_700, "1 M"),
        (999_499_999, "999 M"),
        (999_500_000, "1 G"),
        (999, "999"),
    ):
        assert repr(Image(np.zeros((1, 1, 4)), np.array([[count]]))) == f"Image(1 x 1, {said} samples)"


@pytest.mark.parametrize("name", ["a.jpg", "b.JPEG"])
def test_jpegs_are_in_front_of_white_or_what_is_asked_for(tmp_path, name):
    from PIL import Image as PillowImage

    for background, behind in ((None, 255), ("black", 0)):
        uniform([0, 0, 0, 0]).save(tmp_path / name, background)
        np.testing.assert_array_equal(np.asarray(PillowImage.open(tmp_path / name)), [[[behind] * 3]])
    uniform([0, 0, 0, 0], "black").save(tmp_path / name)
    assert not np.asarray(PillowImage.open(tmp_path / name)).any()
    with pytest.raises(ValueError, match="background must be a colour for"):
        uniform([0, 0, 0, 0]).save(tmp_path / name, "transparent")


def test_the_largest_bound():
    assert make_image().max_error == np.inf
    image = Image(np.zeros((2, 3, 4), np.float32), np.zeros((2, 3), np.int32), np.arange(6.0).reshape(2, 3))
    assert image.max_error == 5


@pytest.fixture(scope="module")
def lit():
    """Of a box that is twice as long along x, from straight above: what is where is known."""
    import wvr

    volume = wvr.Volume(np.tile(np.uint8([2, 4, 6, 8, 9]), (3, 3, 1)))
    tf = wvr.TransferFunction([(0, "red", 0.5), (10, "blue", 0.5)])
    camera = wvr.Camera((2, 1, 9), (2, 1, 1), up=(0, 1, 0), parallel_scale=2)
    return wvr.render(volume, tf, camera, (40, 20), background="black", integrator=wvr.Riemann(1.0))


def test_a_plot_shows_what_a_png_does(lit):
    import matplotlib.pyplot as plt

    ax = lit.plot(outline=True)
    try:
        np.testing.assert_array_equal(ax.images[0].get_array(), lit.to_uint8())
        # The outline's corners are where the box's are: a scale of 2 is 10 pixels high, 5 pixels a voxel.
        corners = {tuple(np.round(point, 6)) for line in ax.lines for point in line.get_xydata()}
        assert {(9.5, 4.5), (29.5, 14.5)} <= corners and len(ax.lines) == 12
        # x to the right, y upwards, z at the viewer: its tip is where the arrows start.
        tips = {text.get_text(): np.array(text.get_position()) for text in ax.texts if text.get_text()}
        assert set(tips) == {"x", "y", "z"}
        assert tips["x"][0] > tips["z"][0] and tips["y"][1] < tips["z"][1]
        (bar,) = (other for other in ax.figure.axes if other is not ax)
        assert bar.get_ylim() == (2, 9)
    finally:
        plt.close(ax.figure)


def test_a_plot_without_anything_and_on_axes_that_there_are(lit):
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    assert lit.plot(ax, scalar_bar=False, axes=False) is ax
    assert not ax.texts and len(ax.figure.axes) == 1
    # An image whose scene is not known is just drawn.
    assert len(make_image().plot(Figure().subplots()).figure.axes) == 1


def test_show_says_so_where_there_is_no_display(lit):
    import matplotlib

    matplotlib.use("agg")
    with pytest.raises(RuntimeError, match=r"show needs a display.*image\.save"):
        lit.show()


def test_strips_are_seamless_and_need_little_memory(monkeypatch):
    import tracemalloc

    image = make_image(height=60, width=50)
    whole = [image.to_uint8(background) for background in (None, "red")]
    monkeypatch.setattr("wvr.image.STRIP", 170)
    for background, pixels in zip((None, "red"), whole, strict=True):
        np.testing.assert_array_equal(image.to_uint8(background), pixels)
    monkeypatch.undo()
    large = Image(np.ones((3000, 1000, 4), np.float32), np.ones((3000, 1000), np.int32))
    tracemalloc.start()
    large.to_uint8("red")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # The result is 9 MB; float64 of all would be 72 MB and more.
    assert peak < 60e6


def test_an_image_says_how_wrong_it_is():
    pixels, samples = np.zeros((2, 3, 4), np.float32), np.zeros((2, 3), np.int32)
    assert "errors" not in repr(Image(pixels, samples))
    bounded = Image(pixels, samples, np.full((2, 3), 0.00125, np.float32))
    assert repr(bounded) == "Image(3 x 2, errors up to 0.0013, 0 samples)"
    asked = {"integrator": "Certified(tolerance=0.002)", "bound_covers": "opacity, not the lighting"}
    lit = repr(Image(pixels, samples, bounded.error_bound, asked))
    assert lit == "Image(3 x 2, Certified(tolerance=0.002), errors up to 0.0013 but for light, 0 samples)"
