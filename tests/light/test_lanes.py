"""Light in lanes: as that of points, opacity and bounds left alone, and how much it changes along a piece."""

import numpy as np
import pytest
import warp as wp

import wvr
from wvr.kernels.integrators.packet import COLUMNS, FADING
from wvr.kernels.light.points import Light, Lights, Shading
from wvr.kernels.light.shine import shining
from wvr.kernels.vectors import VECTORS

from ..helpers import max_error


def lit_scene(dtype):
    data = wvr.datasets.load("blobs", 24).numpy().astype(np.float64)
    if np.dtype(dtype).kind != "f":
        data = data * 200
    data = data.astype(dtype)
    if np.dtype(dtype).kind == "f":
        data[10:12, 9:13, 9:12] = np.nan
    volume = wvr.Volume(data, spacing=(1.0, 1.3, 0.9), nan="transparent")
    high = float(np.nanmax(data))
    tf = wvr.TransferFunction([(0.2 * high, "red", 0.0), (0.5 * high, "white", 0.3), (0.9 * high, "blue", 0.8)])
    lights = [wvr.DirectionalLight((1, 2, 1), "orange"), wvr.Headlight()]
    return volume, tf, {"lighting": wvr.Lighting(light=lights)}


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@pytest.mark.parametrize("inside", [False, True])
def test_light_in_lanes_is_that_of_exact(dtype, inside):
    volume, tf, options = lit_scene(dtype)
    middle = volume.corners.mean(axis=0)
    camera = wvr.Camera(middle, middle + np.array([1, 0.3, 0.2])) if inside else wvr.Camera.fit(volume)
    truth = wvr.render(volume, tf, camera, (32, 32), integrator=wvr.Exact(), **options).rgba
    # No bound is of light: a row that spans control points says within a tolerance what a cell comes to, and less of
    # where in it that is.
    for tolerance, most in ((1 / 512, 2e-2), (1e-4, 4e-3)):
        image = wvr.render(volume, tf, camera, (32, 32), tolerance=tolerance, **options)
        error = np.abs(image.rgba - truth)
        assert np.all(error[..., 3] <= image.error_bound) and image.error_bound.max() <= tolerance
        assert error.max() < most and error.mean() < most / 50


def test_cuts_and_own_differences_are_lit_in_lanes():
    volume, tf, options = lit_scene("uint8")
    options["lighting"] = wvr.Lighting(gradient="cell")
    options["clip"] = wvr.ClipPlane(volume.corners.mean(axis=0), (1, 0.5, 0.2))
    camera = wvr.Camera.fit(volume)
    truth = wvr.render(volume, tf, camera, (32, 32), integrator=wvr.Exact(), **options).rgba
    image = wvr.render(volume, tf, camera, (32, 32), **options)
    error = np.abs(image.rgba - truth)
    assert np.all(error[..., 3] <= image.error_bound)
    assert error.max() < 2e-2 and error.mean() < 4e-4


def test_memory_that_was_used_before_changes_nothing(monkeypatch):
    empty = wp.empty
    before = [0.0]

    def used(shape, dtype=float, **options):
        array = empty(shape, dtype=dtype, **options)
        if dtype is wp.uint8 and isinstance(shape, int):  # a thread's own
            memory = array.numpy()[: shape // 8 * 8].view(np.float64)
            memory[:] = -before[0] * np.arange(len(memory))
        return array

    monkeypatch.setattr(wp, "empty", used)
    volume = wvr.Volume((256 * np.random.default_rng(5).random((12, 12, 12))).astype(np.uint8))
    tf = wvr.TransferFunction([(25, "red", 0), (77, "white", 0.5), (154, "blue", 0.2), (192, "green", 1)])
    camera = wvr.Camera.fit(volume, (1, 0.5, 0.3))
    clip = wvr.ClipPlane((5.7, 5.2, 6.0), (0.9, -0.3, -1.4))
    renderer = wvr.Renderer(volume, tf, tolerance=1e-3, termination=0, lighting=wvr.Lighting(), clip=clip)
    images = []
    for slope in (0.0, 1.0, 3.0, 10.0, 30.0, 100.0):
        before[0] = slope
        images.append(renderer.render(camera, (24, 24)))
    for image in images[1:]:
        assert np.array_equal(image.rgba, images[0].rgba) and np.array_equal(image.samples, images[0].samples)


@pytest.mark.filterwarnings("ignore:.*bounded by more")
@pytest.mark.parametrize("unit", [1e-2, 1e-25])
def test_what_is_opaque_at_once_is_lit_where_it_is_seen(unit):
    """Pieces beside near jumps are in double precision, and deeper than what an opacity says, or single precision."""
    volume = lit_scene("uint8")[0]
    tf = wvr.TransferFunction.from_arrays(
        [0, 40, 40 + 1e-7, 90, 200], np.ones((5, 3)), [0, 0.01, 0.6, 0.8, 0.2], unit_distance=unit
    )
    camera, lighting = wvr.Camera.fit(volume), wvr.Lighting(light=wvr.DirectionalLight((1, 2, 3)), specular=0.0)
    truth = wvr.render(volume, tf, camera, (32, 32), integrator=wvr.Exact(), lighting=lighting)
    assert max_error(wvr.render(volume, tf, camera, (32, 32), lighting=lighting), truth.rgba) < 1e-3


def test_where_all_is_ambient_light_is_none():
    volume, tf, _ = lit_scene("uint8")
    camera = wvr.Camera.fit(volume)
    lighting = wvr.Lighting(ambient=1.0, diffuse=0.0, specular=0.0)
    lit = wvr.render(volume, tf, camera, (32, 32), lighting=lighting)
    assert max_error(lit, wvr.render(volume, tf, camera, (32, 32)).rgba) < 1e-6


@pytest.mark.parametrize("unit", [1e-30, 1e24])
def test_light_is_the_same_in_any_unit_of_length(unit):
    """The square of which may be beyond single precision, as that of a megaparsec in metres."""
    volume, tf, options = lit_scene("uint8")
    other = wvr.Volume(volume.numpy(), spacing=unit * np.array(volume.spacing))
    images = [wvr.render(one, tf, (1, 0.6, 0.4), (16, 16), **options) for one in (volume, other)]
    assert max_error(images[1], images[0].rgba) < 1e-6


CHANGING = """
Lit p;
for (int n = 0; n < 15; ++n) p.gradient[n] = *(const vf*)(gradient.data + 16 * n);
p.mid = *(const vf*)(gradient.data + 16 * 15);
p.half = *(const vf*)(gradient.data + 16 * 16);
*(vf*)(gradient.data + 16 * 17) = changes(p.gradient, p.mid, p.half);
"""


@wp.func_native(VECTORS + FADING + COLUMNS + shining(False) + CHANGING)
def changing(lights: Lights, tolerance: wp.float32, gradient: wp.array2d(dtype=wp.float32)): ...


@wp.kernel(enable_backward=False, module="unique")
def changing_kernel(lights: Lights, gradient: wp.array2d(dtype=wp.float32)):
    changing(lights, wp.float32(1.0), gradient)


def test_light_changes_by_no_more_than_is_said():
    """From the middle of a piece on, of random cubics of gradients; and somewhere by a third of that (S21)."""

    rng = np.random.default_rng(5)
    shading = Shading()
    shading.diffuse, shading.specular, shading.faint = 0.7, 0.3, 1e-8
    light = Light()
    light.color = wp.vec3d(1.0, 1.0, 1.0)
    tight = 0.0
    for _ in range(60):
        shading.shininess = float(rng.choice([1.0, 8.0, 32.0]))
        lights = Lights()
        lights.shading, lights.lights = shading, wp.array([light], dtype=Light, device="cpu")
        rows = rng.normal(size=(18, 16)) * 10.0 ** rng.uniform(-4, 0)
        for n in range(12):
            rows[n] *= 10.0 ** (-rng.uniform(0.3, 1.5) * (n % 4))
        rows[12:15] /= np.linalg.norm(rows[12:15], axis=0)
        rows[15], rows[16] = rng.uniform(-0.5, 0.5, 16), rng.uniform(0, 0.5, 16)
        given = wp.array(rows.astype(np.float32), dtype=wp.float32, device="cpu")
        wp.launch(changing_kernel, 1, [lights, given], device="cpu")
        said = given.numpy().astype(float)[17]
        rows = rows.astype(np.float32).astype(float)
        u = rows[15] + rows[16] * np.linspace(-1, 1, 201)[:, None]
        g = np.stack([sum(rows[4 * c + m] * u**m for m in range(4)) for c in range(3)])
        square = (g**2).sum(axis=0)
        clear = square / (square + shading.faint)
        facing = np.abs((g * rows[12:15, None]).sum(axis=0)) / np.sqrt(square)
        # Both are seen by the same light; each changes by its own.
        light_there = 0.7 * (clear * facing + 1 - clear) + 0.3 * clear * facing**shading.shininess
        change = np.abs(light_there - light_there[100]).max(axis=0)
        assert np.all(change <= said * (1 + 1e-4) + 1e-6)
        tight = max(tight, (change / said).max())
    assert tight > 0.3
    rows[:12] = 0.0  # where there is no gradient it changes nowhere, and two points will do
    given = wp.array(rows.astype(np.float32), dtype=wp.float32, device="cpu")
    wp.launch(changing_kernel, 1, [lights, given], device="cpu")
    assert not given.numpy()[17].any()
