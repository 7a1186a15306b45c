"""Odd arguments, of kinds that nearly every callable has: an error that names the argument, or it is of use."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import wvr
from wvr.validation import at_most

VOLUME = wvr.Volume((np.arange(64, dtype=np.uint8) * 4).reshape(4, 4, 4))
TF = wvr.TransferFunction([(0, "black", 0.0), (255, "white", 0.9)])
CAMERA = wvr.Camera.fit(VOLUME)
SCENE = (VOLUME, TF, CAMERA, (4, 4))
FAST = {"integrator": wvr.Riemann(1.0), "device": "cpu"}
IMAGE = wvr.Image(np.zeros((4, 4, 4), np.float32), np.zeros((4, 4), np.int32))
TABLE = wvr.preintegrate(TF, 4, device="cpu")
HUGE = 10**400


@pytest.mark.parametrize(
    "takes_a_path",
    [
        wvr.read,
        wvr.TransferFunction.load,
        TF.save,
        IMAGE.save,
        wvr.compare(IMAGE, IMAGE).save,
        lambda path: wvr.read_raw(path, (4, 4, 4), "uint8"),
        lambda path: wvr.save_movie([np.zeros((4, 4, 3), np.uint8)], path),
    ],
)
@pytest.mark.parametrize("path", [1, None, [], np.zeros(3), "a\0b", ""])
def test_paths(takes_a_path, path):
    with pytest.raises((TypeError, ValueError), match="path must"):
        takes_a_path(path)


def test_paths_in_bytes(tmp_path):
    path = os.fsencode(tmp_path / "größe.npy")
    IMAGE.save(path)
    np.save(tmp_path / "v.npy", VOLUME.numpy())
    assert wvr.read(os.fsencode(tmp_path / "v.npy")).shape == (4, 4, 4)
    assert np.load(tmp_path / "größe.npy").shape == (4, 4, 4)


def test_only_regular_files_are_transfer_functions(tmp_path):
    for path in ("/dev/zero", tmp_path):
        if Path(path).exists():
            with pytest.raises(OSError, match="a regular file is expected"):
                wvr.TransferFunction.load(path)
    os.truncate(os.open(tmp_path / "a.json", os.O_CREAT | os.O_WRONLY), 1 << 31)  # sparse
    with pytest.raises(OSError, match=r"a\.json has 2,147,483,648 bytes; a text of at most"):
        wvr.TransferFunction.load(tmp_path / "a.json")


@pytest.mark.parametrize(
    "name, call",
    {
        "step": lambda x: wvr.Riemann(x),
        "tolerance": lambda x: wvr.Certified(x),
        "hmin": lambda x: wvr.AdaptiveSimpson(1e-3, hmin=x),
        "oversampling": lambda x: wvr.Preintegrated(1.0, x),
        "radius": lambda x: wvr.ClipSphere((0, 0, 0), x),
        "iso": lambda x: wvr.ClipVolume(VOLUME, x),
        "spread": lambda x: wvr.ConvolutionShadows(spread=x),
        "cell": lambda x: wvr.ConvolutionShadows(cell=x),
        "specular": lambda x: wvr.Lighting(specular=x),
        "supersample": lambda x: wvr.Lighting(supersample=x),
        "view_angle": lambda x: wvr.Camera((9, 9, 9), (0, 0, 0), view_angle=x),
        "termination": lambda x: wvr.render(*SCENE, termination=x, **FAST),
        "unit_distance": lambda x: wvr.TransferFunction([(0, "red", 0), (1, "red", 1)], x),
        "n_colors": lambda x: wvr.TransferFunction.from_colormap("viridis", 1.0, n_colors=x),
        "width": lambda x: wvr.TransferFunction.isosurfaces([1], width=x),
        "n": lambda x: wvr.preintegrate(TF, x, device="cpu"),
        "frames": lambda x: wvr.orbit(VOLUME, TF, frames=x, size=(4, 4)),
        "seed": lambda x: wvr.datasets.load("blobs", 8, seed=x),
        "phase": lambda x: wvr.datasets.load("heart", 8, phase=x),
        "directions": lambda x: wvr.single_scattering(*SCENE, directions=x, device="cpu"),
    }.items(),
)
@pytest.mark.parametrize("value", ["1", b"1", [], np.zeros(3), True, 1j, np.nan, -HUGE, np.datetime64("2026-01-01")])
def test_numbers(name, call, value):
    with pytest.raises((TypeError, ValueError), match=f"{name} must be"):
        call(value)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("array", wvr.Volume),
        ("data", wvr.as_volume),
        ("labels", lambda value: wvr.Segmentation(value, {0: TF})),
        ("values", wvr.Isosurface),
        ("clim", lambda value: wvr.render(VOLUME, "viridis", clim=value)),
        ("background", lambda value: IMAGE.composited(value)),
        ("images", lambda value: wvr.save_movie([value], "movie.gif")),
    ],
)
def test_rows_of_several_lengths(name, call):
    with pytest.raises(TypeError, match=f"{name} must be"):
        call([[1, 2], [3]])


def test_numbers_of_any_library_are_plain_ones():
    """Equal, hashable, and rendered with."""
    for half in (np.float32(0.5), np.float64(0.5), np.array(0.5), np.longdouble(0.5)):
        assert wvr.Riemann(half) == wvr.Riemann(0.5) and type(wvr.Riemann(half).step) is float
        integrator = wvr.Preintegrated(half, np.int8(2), np.uint16(16))
        assert wvr.render(*SCENE, integrator=integrator, device="cpu").size == (4, 4)
    lighting = wvr.Lighting(ambient=np.float16(0.5), supersample=np.int64(4))
    assert lighting == wvr.Lighting(ambient=0.5, supersample=4)
    assert wvr.ConvolutionShadows(np.array(1.0), np.int8(1), np.True_) == wvr.ConvolutionShadows(1.0, 1, True)


@pytest.mark.parametrize(
    "name, call",
    {
        "invert": lambda x: wvr.ClipPlane((0, 0, 0), (0, 0, 1), x),
        "naive": lambda x: wvr.ClipVolume(VOLUME, naive=x),
        "parallel": lambda x: wvr.Camera.fit(VOLUME, parallel=x),
        "log_scale": lambda x: wvr.TransferFunction.from_colormap("viridis", (1, 2), log_scale=x),
        "skip_empty": lambda x: wvr.render(*SCENE, skip_empty=x, **FAST),
        "preintegrated": lambda x: wvr.ConvolutionShadows(preintegrated=x),
    }.items(),
)
@pytest.mark.parametrize("value", [1, "no", None, np.zeros(3)])
def test_flags(name, call, value):
    with pytest.raises(TypeError, match=f"{name} must be True or False"):
        call(value)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: wvr.Camera((HUGE, 0, 0), (0, 0, 0)), "position must be three"),
        (lambda: wvr.Camera([1, 2, np.array([3.0])], (0, 0, 0)), "position must be three"),
        (lambda: wvr.Camera(np.array([1j, 2, 3]), (0, 0, 0)), "position must be three"),
        (lambda: wvr.Camera(["1", "2", "3"], (0, 0, 0)), "position must be three"),
        (lambda: wvr.Headlight((HUGE, 0, 0)), "color must be"),
        (lambda: wvr.render(*SCENE, background=np.zeros(0), **FAST), "background must be"),
        (lambda: wvr.render(*SCENE, background=np.zeros((4, 4)), **FAST), "background must be"),
        (lambda: wvr.TransferFunction(5), "points must be"),
        (lambda: wvr.TransferFunction(np.array("red")), "points must be"),
        (lambda: wvr.TransferFunction.from_arrays([0, "a"], [[0] * 3] * 2, [0, 1]), "scalars must be numbers"),
        (lambda: wvr.TransferFunction.from_colormap(np.array("viridis"), 1.0), "colormap must be"),
        (lambda: wvr.TransferFunction.isosurfaces([[1], 4]), "values must be numbers"),
        (lambda: wvr.TransferFunction.isosurfaces([1, 4], colors=np.array(0.5)), "colors must be"),
        (lambda: wvr.TransferFunction.isosurfaces([1, 4], width=1e-300), "width must be more than rounding"),
        (lambda: wvr.TransferFunction.isosurfaces([1, 4], opacity=[[1, 2], [3]]), "opacity must be numbers"),
        (lambda: TF.color([[1], 2]), "s must be numbers"),
        (lambda: TF.extinction(object()), "s must be numbers"),
        (lambda: CAMERA.project("x", (4, 4)), "points must be numbers"),
        (lambda: CAMERA.project((1, 2), (4, 4)), "points must be"),
        (lambda: TABLE.lookup(np.nan, 0), "front and back must be scalars"),
        (lambda: TABLE.lookup(0, "x"), "back must be numbers"),
        (lambda: wvr.preintegrate(TF, 4, domain=5), "domain must"),
        (lambda: wvr.preintegrate(TF, 4, length=[[1, 2]]), "length must be"),
        (lambda: wvr.compare({}, IMAGE), "image must be numbers"),
        (lambda: wvr.compare(IMAGE, IMAGE, None), "limits must"),
        (lambda: wvr.Comparison(np.zeros((4, 4)), [1e-3]), "difference must be"),
        (lambda: wvr.compare(IMAGE, IMAGE).histogram([1e-2, 1e-3]), "decades must be > 0 and ascending"),
        (lambda: wvr.Volume.from_pyvista(np.zeros((2, 2, 2))), "image_data must be a pyvista.ImageData"),
        (lambda: wvr.Volume.from_pyvista("x"), "image_data must be a pyvista.ImageData"),
        (lambda: wvr.Volume.from_pyvista(VOLUME.to_pyvista(), np.zeros(2)), "scalars must be the name"),
        (lambda: wvr.as_volume(VOLUME.numpy(), nan=np.zeros(2)), "nan must be one of"),
        (lambda: wvr.datasets.load([]), "name must be one of"),
        (lambda: wvr.datasets.load("blobs", 8, sed=1), "of 'blobs' are seed, count, got 'sed'; did you mean 'seed'"),
        (lambda: wvr.datasets.load("spheres", 8, seed=1), "options are none of 'spheres', got 'seed'"),
        (lambda: wvr.datasets.fetch("skull", cache=5), "cache must be a path"),
        (lambda: wvr.render(VOLUME, TF, CAMERA, (HUGE, 4), **FAST), "size must be"),
        (lambda: wvr.datasets.load("spheres", HUGE), "size must be an integer from 2 to"),
        (lambda: wvr.preintegrate(TF, HUGE, generator="running", device="cpu"), "n must be an integer from 2 to"),
        (lambda: wvr.save_movie([np.zeros((4, 4, 3), np.uint8)], "a.gif", 1e-30), "fps must be from"),
        (lambda: wvr.orbit(VOLUME, TF, 2, "a.gif", fps=1e9), "fps must be from"),
        (lambda: wvr.warm_up(dtype="int64", device="cpu"), "dtype must be one or several of"),
        (lambda: wvr.warm_up(shadows=[], device="cpu"), "shadows must be True, False or"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_a_copy_that_would_not_fit():
    """Of an array that takes no memory as it is."""
    with pytest.raises(MemoryError, match="array is copied, as it is not C-contiguous"):
        wvr.Volume(np.broadcast_to(np.uint8(0), (2**16, 2**16, 2**16)))


def test_what_a_renderer_has_not_is_not_assigned():
    """It would be without effect, and nobody told."""
    renderer = wvr.Renderer(VOLUME, TF, **FAST)
    with pytest.raises(AttributeError, match=r"no 'clips' to assign, but .*; did you mean 'clip'"):
        renderer.clips = wvr.ClipSphere((0, 0, 0), 1.0)
    renderer.tolerance = 1e-3
    assert renderer.integrator == wvr.Certified(1e-3) and renderer.tolerance == 1e-3
    with pytest.raises(ValueError, match="tolerance must be below 1"):
        renderer.tolerance = 2


@pytest.mark.parametrize("bound", [0.0, 1e-3, 0.00125, 0.00120001, 9.95e-5, 3.3e-16, 1.0000001, np.inf])
def test_bounds_are_printed_rounded_up(bound):
    assert bound <= float(at_most(bound)) <= 1.1 * bound


def test_numbers_beyond_floats_are_named():
    huge = 10**400
    with pytest.raises(ValueError, match="direction must be"):
        wvr.Volume(np.zeros((2, 2, 2), np.uint8), direction=[[huge, 0, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(TypeError, match="camera must be"):
        wvr.render(np.arange(27, dtype=np.uint8).reshape(3, 3, 3), camera=(huge, 0, 0), size=(2, 2))
    with pytest.raises(ValueError, match="data must not be empty"):
        wvr.render("")


def masked(numbers):
    """With one of them masked."""
    numbers = np.asarray(numbers)
    return np.ma.array(numbers, mask=np.arange(numbers.size).reshape(numbers.shape) == 1)


@pytest.mark.parametrize(
    ("name", "call"),
    {
        "scalars": lambda: wvr.TransferFunction.from_arrays(masked([0.0, 1, 2]), np.ones((3, 3)), [0, 0.1, 0.2]),
        "rgb": lambda: wvr.TransferFunction.from_arrays([0, 1], [np.ones(3), masked(np.ones(3))], [0, 0.1]),
        "opacity": lambda: wvr.TransferFunction.from_colormap("viridis", (0, 1), masked([0, 0.1, 0.2])),
        "colour": lambda: wvr.TransferFunction([(0, masked([1.0, 1, 1]), 0), (1, "red", 1)]),
        "s": lambda: TF.extinction(masked([1.0, 2])),
        "position": lambda: wvr.Camera(masked([9.0, 9, 9]), (0, 0, 0)),
        "camera": lambda: wvr.render(VOLUME, TF, masked([9.0, 9, 9]), (4, 4), **FAST),
        "direction": lambda: wvr.Volume(VOLUME.numpy(), direction=masked(np.eye(3))),
        "spacing": lambda: wvr.Volume(VOLUME.numpy(), masked([1.0, 1, 1])),
        "lo": lambda: wvr.ClipBox(masked([1.0, 1, 1]), (9, 9, 9)),
        "labels": lambda: wvr.Segmentation([masked(one) for one in np.ones((4, 4, 4), np.uint8)], {1: TF}),
        "rgba": lambda: wvr.Image(masked(IMAGE.rgba), IMAGE.samples),
        "error_bound": lambda: wvr.Image(IMAGE.rgba, IMAGE.samples, masked(np.zeros((4, 4)))),
        "background": lambda: IMAGE.composited(masked(np.ones((4, 4, 3)))),
        "reference": lambda: wvr.compare(IMAGE, masked(IMAGE.rgba)),
        "values": lambda: wvr.Isosurface(masked([90.0, 140])),
        "front": lambda: TABLE.lookup(masked([1.0, 2]), 3.0),
        "images": lambda: wvr.save_movie([masked(np.ones((16, 16, 3), np.uint8))], "none.gif"),
    }.items(),
)
def test_masked_numbers_are_none(name, call):
    """What is under a mask was taken for what it hides, without a word."""
    with pytest.raises((TypeError, ValueError), match=rf"{name}.* must .*(masked|--)"):
        call()
