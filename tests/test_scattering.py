"""Single scattering against closed forms, its orders of convergence, and invariances."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expn

import wvr
from wvr.scattering import cone

from .helpers import along, centered

WHITE = (1.0, 1.0, 1.0)


def slab(tau: float, n: int = 9, spacing=(1.0, 1.0, 1.0)) -> tuple[wvr.Volume, wvr.TransferFunction]:
    """A uniform medium of an extinction per world length, seen along z; wide, so that no cone leaves at its sides."""
    volume = centered(np.ones((n, 2, 2), np.uint8), np.array([1e3, 1e3, 1.0]) * spacing)
    opacity = -np.expm1(-tau)
    return volume, wvr.TransferFunction([(0, "white", opacity), (2, "white", opacity)], unit_distance=1.0)


def scattered(volume, tf, camera=None, size=(1, 1), **options) -> wvr.Image:
    options = {"precision": "float64", "termination": 0} | options
    return wvr.single_scattering(volume, tf, camera or along(2), size, **options)


# The cone


@pytest.mark.parametrize("spread", [1e-3, 5.0, 20.0, 60.0])
def test_cone_is_uniform(spread):
    """Of unit length, within the cone; its moments are those of a spherical cap: sec(a) - 1 the mean square tangent."""
    d = cone(spread, 4000)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, rtol=1e-14)
    assert np.all(d[:, 2] > np.cos(np.radians(spread)))
    a = np.radians(spread)
    np.testing.assert_allclose(d[:, 2].mean(), (1 + np.cos(a)) / 2, rtol=1e-7)
    slopes = d[:, :2] / d[:, 2:]
    variance = 1 / np.cos(a) - 1
    np.testing.assert_allclose((slopes**2).sum(axis=1).mean(), variance, rtol=1e-6)
    np.testing.assert_allclose(slopes.T @ slopes / len(d), np.eye(2) * variance / 2, atol=1e-3 * variance)
    np.testing.assert_allclose(slopes.mean(axis=0), 0, atol=1e-3 * np.sqrt(variance))


def test_no_spread_is_one_direction():
    np.testing.assert_array_equal(cone(0, 64), [[0, 0, 1]])


# Closed forms


@pytest.mark.parametrize("tau", [0.05, 0.7])
@pytest.mark.parametrize(
    ("light", "behind"),
    [(wvr.Headlight(), False), (wvr.DirectionalLight((0, 0, -1)), False), (wvr.DirectionalLight((0, 0, 1)), True)],
)
def test_uniform_slab(device, light, behind, tau):
    """L = exp(-tau z) from the light: from its side (1 - exp(-2 tau D)) / 2, from the other tau D exp(-tau D)."""
    volume, tf = slab(tau)
    image = scattered(volume, tf, light=light, spread=0, step=1 / 32, device=device)
    D = 8.0
    expected = tau * D * np.exp(-tau * D) if behind else -np.expm1(-2 * tau * D) / 2
    np.testing.assert_allclose(image.rgba[0, 0, :3], expected, rtol=1e-4)
    np.testing.assert_allclose(image.rgba[0, 0, 3], -np.expm1(-tau * D), rtol=1e-12)


@pytest.mark.parametrize("spread", [20.0, 60.0])
def test_uniform_slab_with_a_cone(device, spread):
    """What arrives is the mean of exp(-tau z / cos) over the cap: (E2(x) - c E2(x / c)) / (1 - c), c = cos(spread)."""
    tau, c = 0.3, np.cos(np.radians(spread))
    volume, tf = slab(tau)

    def light(x):
        return (expn(2, x) - c * expn(2, x / c)) / (1 - c)

    expected = quad(lambda z: tau * light(tau * z) * np.exp(-tau * z), 0, 8)[0]
    image = scattered(volume, tf, spread=spread, step=1 / 16, directions=256, device=device)
    np.testing.assert_allclose(image.rgba[0, 0, :3], expected, rtol=3e-4)


def test_nothing_in_the_way(device):
    """One thin layer under a light that comes from its own side: as bright as without shadows."""
    data = np.zeros((9, 3, 3), np.uint8)
    data[4] = 1
    tf = wvr.TransferFunction([(0, "orange", 0.0), (1, "orange", 1e-4)])
    volume = centered(data)
    light = wvr.DirectionalLight((0.3, 0.2, -1))
    image = scattered(volume, tf, light=light, step=0.1, device=device)
    plain = wvr.render(volume, tf, along(2), (1, 1), integrator=wvr.Riemann(0.1), precision="float64", device=device)
    np.testing.assert_allclose(image.rgba, plain.rgba, rtol=3e-4)


def test_hard_shadow_has_its_place(device):
    """A small opaque block above a plane: its shadow lies where the light says, and spreads with the cone."""
    n = 33
    data = np.zeros((n, n, n), np.uint8)
    data[24:27] = 1  # the plane, at z = 25
    data[7:10, 14:19, 14:19] = 1  # the block, 17 before it
    volume = centered(data)
    tf = wvr.TransferFunction([(0.4, "white", 0.0), (0.6, "white", 0.9)])
    camera = along(2, scale=16)  # up is +x: columns run along +-y, rows along -x
    light = wvr.DirectionalLight((8 / 17, 0, -1))  # shadows fall 8 voxels towards -x
    seen = {}
    for spread in (0, 12):
        image = scattered(volume, tf, camera, (33, 33), light=light, spread=spread, directions=48, device=device)
        seen[spread] = image.rgba[..., 0]
    column = seen[0][:, 16]
    rows = np.flatnonzero(column < 0.3)
    middle = 16 - (rows.mean() - 16)  # index along x, which runs upwards
    assert len(rows) and abs(middle - (16 - 8)) < 1
    soft = seen[12][:, 16]
    assert soft.min() > column.min() + 0.1
    edges = [np.count_nonzero((values > 0.05) & (values < 0.33)) for values in (column, soft)]
    assert edges[1] > edges[0] + 2


# Convergence


def test_second_order_in_the_step(device, blobs):
    """Fitted over three halvings of the step, against a finer one."""
    tf = wvr.TransferFunction([(0, (1, 0.5, 0.2), 0.0), (255, (0.2, 0.5, 1), 0.3)])
    camera = wvr.Camera.fit(blobs)
    options = dict(light=wvr.DirectionalLight((0.3, 1, 0.5)), spread=15, directions=4, skip_empty=False, device=device)
    steps = [1.0, 0.5, 0.25, 0.125]
    *coarse, fine = (scattered(blobs, tf, camera, (8, 8), step=h, **options).rgba for h in [*steps, 1 / 64])
    errors = [np.abs(rgba - fine).mean() for rgba in coarse]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 1.8


def test_converges_in_directions(device, blobs):
    """At least first order in 1 / directions; the equal-weight spiral has no seam that would make it half an order."""
    tf = wvr.TransferFunction([(0, "white", 0.0), (255, "white", 0.3)])
    camera = wvr.Camera.fit(blobs)
    options = dict(light=wvr.DirectionalLight((0.3, 1, 0.5)), spread=30, step=0.5, device=device)
    counts = [4, 16, 64]
    *coarse, fine = (scattered(blobs, tf, camera, (8, 8), directions=n, **options).rgba for n in [*counts, 1024])
    errors = [np.abs(rgba - fine).mean() for rgba in coarse]
    assert np.polyfit(np.log(counts), np.log(errors), 1)[0] < -0.9
    assert errors[-1] < 1e-3


# Invariances


def test_spread_to_zero_is_a_hard_shadow(device, blobs, smooth_tf):
    tf = wvr.TransferFunction([(0, "white", 0.0), (255, "white", 0.3)])
    camera = wvr.Camera.fit(blobs)
    light = wvr.DirectionalLight((0.3, 1, 0.5))
    hard, soft = (scattered(blobs, tf, camera, (6, 6), light=light, spread=a, device=device) for a in (0, 0.05))
    np.testing.assert_allclose(soft.rgba, hard.rgba, atol=1e-5)


def test_rotation(device, blobs):
    """Axes permuted with camera and light: the same image, but for where the cone's directions are."""
    tf = wvr.TransferFunction([(0, (1, 0.5, 0.2), 0.0), (255, (0.2, 0.5, 1), 0.3)])
    images = []
    for turn in range(3):
        data = np.moveaxis(blobs.numpy(), [0, 1, 2], np.roll([0, 1, 2], turn))
        spacing, origin = (np.roll(v, turn) for v in ((1.0, 1.2, 0.8), (3.0, -2.0, 1.0)))
        volume = wvr.Volume(np.ascontiguousarray(data), spacing, origin)
        camera = wvr.Camera.fit(volume, np.roll((1, 0.6, 0.4), turn), up=np.roll((0, 0, 1), turn))
        light = wvr.DirectionalLight(np.roll((0.2, 1, 0.4), turn))
        images.append(scattered(volume, tf, camera, (8, 8), light=light, directions=256, device=device).rgba)
    for image in images[1:]:
        np.testing.assert_allclose(image, images[0], atol=2e-4)


def test_lights_add_up(device, blobs):
    tf = wvr.TransferFunction([(0, (1, 0.5, 0.2), 0.0), (255, (0.2, 0.5, 1), 0.3)])
    lights = [wvr.DirectionalLight((0.3, 1, 0.5), (1, 0.25, 0)), wvr.Headlight((0, 0.5, 2))]
    camera = wvr.Camera.fit(blobs, parallel=True)
    both, *each = (
        scattered(blobs, tf, camera, (6, 6), light=light, directions=8, device=device).rgba
        for light in (lights, *lights)
    )
    np.testing.assert_allclose(both[..., :3], each[0][..., :3] + each[1][..., :3], rtol=1e-12)
    np.testing.assert_array_equal(both[..., 3], each[0][..., 3])
    assert not each[0][..., 2].any() and not each[1][..., 0].any()


def test_skipping_and_precision_change_nothing(device):
    """Empty blocks are leapt over by both kinds of rays; absent data neither emit nor cast a shadow."""
    data = np.zeros((40, 40, 40), np.float32)
    data[12:20, 10:25, 14:22] = 1
    data[14, 12, 16] = np.nan
    volume = wvr.Volume(data, nan="transparent")
    tf = wvr.TransferFunction([(0.1, "red", 0.0), (1, "white", 0.3)])
    options = dict(light=wvr.DirectionalLight((1, 0.5, 0.2)), directions=8)
    camera = wvr.Camera.fit(volume)
    fast = scattered(volume, tf, camera, (24, 24), device=device, **options)
    slow = scattered(volume, tf, camera, (24, 24), device=device, skip_empty=False, **options)
    np.testing.assert_allclose(fast.rgba, slow.rgba, atol=1e-12)
    assert fast.stats["samples"] < 0.6 * slow.stats["samples"]
    single = scattered(volume, tf, camera, (24, 24), device=device, precision="float32", **options)
    assert single.rgba.dtype == np.float32
    np.testing.assert_allclose(single.rgba, fast.rgba, atol=2e-3)


def test_a_length_that_the_volume_says():
    volume, tf = slab(0.7)
    tf = wvr.TransferFunction(list(zip(tf.knots, tf.colors, tf.opacities, strict=True)), unit_distance="pyvista")
    image = scattered(volume, tf)
    assert image.rgba.any() and np.array_equal(image.rgba, scattered(volume, tf.for_volume(volume)).rgba)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (dict(spread=-1), "spread"),
        (dict(spread=90), "spread"),
        (dict(spread=np.nan), "spread"),
        (dict(directions=0), "directions"),
        (dict(directions=2.5), "directions"),
        (dict(step=0), "step"),
        (dict(size=(0, 4)), "size"),
        (dict(termination=1), "termination"),
        (dict(precision="half"), "precision"),
    ],
)
def test_bad_input(blobs, smooth_tf, wrong, named):
    with pytest.raises(ValueError, match=named):
        wvr.single_scattering(blobs, smooth_tf, wvr.Camera.fit(blobs), **wrong)


def test_bad_light(blobs, smooth_tf):
    with pytest.raises(TypeError, match="light"):
        wvr.single_scattering(blobs, smooth_tf, wvr.Camera.fit(blobs), light="sun")


# The sweep's model


def test_diffusion_is_the_cones(device):
    """2 D, the variance that a unit of length adds, is the cone's to leading order: a^2 / 4 along each axis."""
    for spread, tolerance in ((1.0, 2e-3), (20.0, 0.04)):
        slopes = cone(spread, 4096)
        slopes = slopes[:, :2] / slopes[:, 2:]
        variance = (slopes**2).sum(axis=1).mean() / 2
        np.testing.assert_allclose(2 * wvr.ConvolutionShadows(spread=spread).diffusion, variance, rtol=tolerance)


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize(
    "light",
    [wvr.Headlight(), wvr.DirectionalLight((0.3, 1, 0.9)), wvr.DirectionalLight((-1, 0.3, 0.1))],
    ids=["headlight", "before", "behind"],
)
def test_sweep_is_single_scattering(device, blobs, light, parallel):
    """Without spread the same model, in the image's centre and at its borders, from before and from behind; with it
    nearly: what reaches a point through a box with things in it is not quite what diffuses there.
    """
    tf = wvr.TransferFunction([(0, "orange", 0.0), (255, "royalblue", 0.3)])
    camera = wvr.Camera.fit(blobs, parallel=parallel)
    for spread, most in ((0.0, 1e-3), (20.0, 0.05)):
        truth = scattered(blobs, tf, camera, (16, 16), light=light, spread=spread, step=0.25, device=device)
        shadows = wvr.ConvolutionShadows(0.5, light=light, spread=spread, cell=0.25, image="slices")
        image = wvr.render(
            blobs, tf, camera, (16, 16), shadows=shadows, precision="float64", termination=0, device=device
        )
        difference = np.abs(image.rgba - truth.rgba)
        assert difference[..., :3].mean() < most / 10
        assert np.quantile(difference[..., :3], 0.99) < most
