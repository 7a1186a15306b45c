"""Light swept through slices: closed forms, order in the slice distance, and what must change nothing."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import wvr
from studies.angelelli2017.aliasing import moved
from wvr.frame import view
from wvr.kernels.field.grid import Grid
from wvr.kernels.light.travel import BORDER, ROWS, RUN, Half, Shade, make_state, make_travel, run_of
from wvr.kernels.scene import Halves
from wvr.launch import get_device, launch_in_turn
from wvr.light.sweep import place

from ..helpers import max_error

DIRECTED = wvr.DirectionalLight((-1.0, 0.7, 1.5))


def slab(tau, n=9):
    """A uniform medium of an extinction, wide, that z goes through."""
    volume = wvr.Volume(np.ones((n, 3, 3), np.float32), spacing=(50.0, 50.0, 1.0), origin=(-50, -50, -(n - 1) / 2))
    opacity = -np.expm1(-tau)
    return volume, wvr.TransferFunction([(0, "white", opacity), (2, "white", opacity)], unit_distance=1.0)


def down(parallel_scale=1.0):
    return wvr.Camera((0, 0, 100), (0, 0, 0), up=(0, 1, 0), parallel_scale=parallel_scale)


def shaded(volume, tf, camera, size=(1, 1), integrator=None, render=None, **options):
    render = {"precision": "float64", "termination": 0} | (render or {})
    shadows = wvr.ConvolutionShadows(**options)
    return wvr.render(volume, tf, camera, size, integrator=integrator or wvr.Exact(), shadows=shadows, **render)


@pytest.mark.parametrize("tau", [0.02, 0.3])
@pytest.mark.parametrize("image", ["rays", "slices"])
def test_uniform_medium(tau, image):
    """L = exp(-tau z): what the eye sees of it is (1 - exp(-2 tau D)) / 2. The light of slices is exact, and a part
    of depth x = tau h has it of its middle times 1 + x^2 / 8 for cosh(x / 2), or is traced, which is exact.
    """
    volume, tf = slab(tau)
    exact = -np.expm1(-2 * tau * 8) / 2
    for h in (2.0, 1.0, 0.5):
        seen = shaded(volume, tf, down(), slice_distance=h, subsamples=0, spread=0.0, image=image).rgba[0, 0, 0]
        assert exact * (1 - (tau * h) ** 4 / 384 - 1e-9) < seen < exact * (1 + 1e-9)


@pytest.mark.parametrize("precision", ["auto", "float64"])
@pytest.mark.parametrize("depth, n", [(0.16, 9), (3.2, 33), (16.0, 33), (40.0, 9)])
def test_uniform_medium_as_it_is_shown(depth, n, precision):
    """The same by default, slices four voxels apart and rays that end at a hundredth: 1.2 % too bright if light were
    linear between slices, and if what rays leave had the light of what they have seen. In double, rays one by one.
    """
    volume = wvr.Volume(np.full((n, 12, 12), 100, np.uint8))
    opacity = -np.expm1(-depth / (n - 1))
    tf = wvr.TransferFunction([(50, "white", opacity), (150, "white", opacity)])
    camera = wvr.Camera((5.5, 5.5, -40), (5.5, 5.5, 0), up=(0, 1, 0), parallel_scale=1.0)
    seen = wvr.render(volume, tf, camera, (2, 2), shadows=wvr.ConvolutionShadows(), precision=precision)
    np.testing.assert_allclose(seen.rgba[..., 0], -np.expm1(-2 * depth) / 2, rtol=1.5e-3)


def sweep_of_light(n, q):
    """Light after n steps of diffusion by a variance q each: a spot on black, away from the border."""
    halves = Halves(wp.float64, Grid(wp.float32, True), Half(preintegrated=True))
    _, step = make_travel(halves)
    device = get_device("cpu")
    rows, columns, border, run = 96, 96, int(BORDER), int(RUN)
    start = np.ones((2, rows + 2 * border, columns + 2 * run))
    inner = start[0, border:-border, run:-run]
    inner[:] = 0.0
    inner[rows // 2, columns // 2] = 1.0
    state, shade = make_state(wp.float64)(), Shade()
    shade.items = 1
    state.light = wp.array(start.reshape(2, rows + 2 * border, -1, run), dtype=run_of(wp.float64), device=device)
    state.rest = wp.zeros((rows, columns // run), dtype=run_of(wp.float64), device=device)
    # Every tile may be in shadow, and nothing is in the way.
    shade.touched = wp.ones((rows // int(ROWS) + 2, columns // run + 2), dtype=wp.uint8, device=device)
    scenes = wp.zeros(1, dtype=halves.Scene, device=device)
    steps = [(0, wp.float64(q), k % 2, -1) for k in range(n)]
    launch_in_turn(step, rows, steps, [scenes, shade, state], device)
    return state.light.numpy()[n % 2].reshape(start.shape[1:])[border:-border, run:-run]


def test_spot_spreads_by_its_variance_and_loses_nothing():
    n, q = 12, 0.3
    light = sweep_of_light(n, q)
    x = np.arange(96) - 48
    # The border is bright: what came from there has not reached the spot.
    inner = light[24:-23, 24:-23]
    total = inner.sum()
    assert total == pytest.approx(1, abs=1e-3)
    variance = (inner * x[24:-23, None] ** 2).sum() / total
    assert variance == pytest.approx(n * q, rel=0.01)
    assert abs((inner * x[24:-23, None]).sum()) < 1e-12
    assert inner.min() >= 0


def test_diffusion_is_a_semigroup_to_second_order():
    """Twice half a step is a step but for the third power of it: three taps have only the square."""
    difference = []
    for q in (0.2, 0.1):
        once, twice = sweep_of_light(1, q), sweep_of_light(2, q / 2)
        difference.append(np.abs(once - twice)[20:-20, 20:-20].max())
    assert difference[0] / difference[1] > 7


@pytest.mark.parametrize(
    ("options", "low", "high"),
    [
        ({}, 1.8, 3.0),
        ({"splitting": "lie", "received": "front", "preintegrated": False}, 0.9, 1.4),
        ({"preintegrated": False}, 1.7, 3.0),
    ],
    ids=["default", "lie, front", "samples"],
)
def test_order_of_the_image(options, low, high):
    """In the slice distance, on a smooth scene, cells of light being what they are."""
    x = np.linspace(-1, 1, 24)
    z, y, x = np.meshgrid(x, x, x, indexing="ij")
    volume = wvr.Volume(np.rint(255 * np.exp(-3 * (x * x + 1.5 * y * y + z * z) - x * z)).astype(np.uint8))
    tf = wvr.TransferFunction([(0, "navy", 0.0), (255, "white", 0.25)])
    camera = wvr.Camera.fit(volume, direction=(0.2, 0.3, 1), up=(0, 1, 0), parallel=True)
    rest = {"image": "slices", "cell": 1.0, "light": DIRECTED} | options

    def image(distance):
        shadows = wvr.ConvolutionShadows(distance, **rest)
        return wvr.render(volume, tf, camera, (24, 24), shadows=shadows, termination=0).rgba[..., :3]

    truth = image(1 / 16)
    errors = [np.abs(image(distance) - truth).mean() for distance in (1.0, 0.5, 0.25)]
    order = np.log2(errors[0] / errors[2]) / 2
    assert low < order < high
    if not options:
        assert np.abs(image(0.2) - image(0.1)).mean() < 1e-3


@pytest.mark.parametrize("integrator", [wvr.Exact(), wvr.Certified(1e-3)], ids=["rays one by one", "in vectors"])
@pytest.mark.parametrize("steep", [0.5, 5.0])
@pytest.mark.parametrize("tilt", [(0.3, 0.2), (-0.6, 0.35), (0.0, 0.8)])
def test_no_stripes_on_a_surface(steep, tilt, integrator):
    """Layers of any profile, dense below: light goes through as much more than the eye as it is more aslant, so that
    cos_l / (cos_l + cos_e) of the surface is lit everywhere, wherever slices and cells are (Lommel, Seeliger).
    """
    n = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    z, y, x = np.indices((48, 48, 48)) - 23.5
    volume = wvr.Volume((-(n[0] * x + n[1] * y + n[2] * z)).astype(np.float32))
    tf = wvr.TransferFunction([(0, "white", 0.0), (1 / steep, "white", 0.99)])
    camera = wvr.Camera((23.5, 23.5, 100), (23.5, 23.5, 23.5), up=(0, 1, 0), parallel_scale=5.0)
    light = np.array([0.55, -0.35, 1.0]) / np.linalg.norm([0.55, -0.35, 1.0])
    exact = (n @ light) / (n @ light + n[2])
    options = {"light": wvr.DirectionalLight(tuple(light)), "spread": 0.0}
    shares = shaded(volume, tf, camera, (64, 64), integrator, {"precision": "float32"}, **options).rgba[..., 0]
    assert shares.std() < 0.03 * exact
    assert shares.mean() == pytest.approx(exact, rel=0.03)


def test_no_stripes_on_a_face_that_a_clip_cuts():
    """The same of a dense medium that a plane cuts."""
    n = np.array([-0.6, 0.35, 1.0]) / np.linalg.norm([-0.6, 0.35, 1.0])
    light = np.array([0.55, -0.35, 1.0]) / np.linalg.norm([0.55, -0.35, 1.0])
    volume = wvr.Volume(np.ones((48, 48, 48), np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.9), (2, "white", 0.9)])
    camera = wvr.Camera((23.5, 23.5, 100), (23.5, 23.5, 23.5), up=(0, 1, 0), parallel_scale=5.0)
    clip = {"clip": wvr.ClipPlane((23.5, 23.5, 23.5), -n)}
    share = shaded(volume, tf, camera, (64, 64), render=clip, light=wvr.DirectionalLight(tuple(light)), spread=0.0)
    exact = (n @ light) / (n @ light + n[2])
    assert share.rgba[..., 0].std() < 0.05 * exact
    assert share.rgba[..., 0].mean() == pytest.approx(exact, rel=0.05)


def test_cells_of_light_do_not_show(blobs):
    """Light between cells is blurred alike wherever they lie: linear in between, the image changes by 6e-3."""
    tf = wvr.TransferFunction([(0, "white", 0.0), (255, "white", 0.4)])
    camera = wvr.Camera.fit(blobs)
    renderer = wvr.Renderer(blobs, tf, shadows=wvr.ConvolutionShadows(light=wvr.DirectionalLight((-1, 1, 1))))
    usual = renderer.render(camera, (48, 48)).rgba
    with moved(cells=0.5):
        assert np.abs(renderer.render(camera, (48, 48)).rgba - usual).max() < 3e-3


def test_fixed_kernel_does_not_converge(blobs):
    """Its blur grows with the number of slices."""
    tf = wvr.TransferFunction([(60, "white", 0.0), (200, "white", 0.5)])
    camera = wvr.Camera.fit(blobs, parallel=True)

    def image(distance, kernel):
        return shaded(
            blobs, tf, camera, (32, 32), slice_distance=distance, kernel=kernel, cell=1.0, image="slices", spread=40.0
        ).rgba[..., :3]

    change = {k: [np.abs(image(2 * d, k) - image(d, k)).mean() for d in (0.5, 0.125)] for k in ("fixed", "diffusive")}
    assert change["diffusive"][1] < 0.15 * change["diffusive"][0]
    assert change["fixed"][1] > 0.5 * change["fixed"][0]


@pytest.mark.parametrize(
    ("options", "render"),
    [
        ({"slice_distance": 0.1, "light": DIRECTED}, {}),
        ({"light": wvr.Headlight()}, {}),
        ({"light": [DIRECTED, wvr.Headlight()]}, {"lighting": wvr.Lighting(light=DIRECTED)}),
    ],
    ids=["thin slabs", "a headlight", "lit"],
)
def test_float32_loses_nothing(blobs, options, render):
    """Nor do vectors, in which it is computed where there are some: the same light, the same places, the same edges.
    At a tolerance at which the walk is the same, in double precision.
    """
    tf = wvr.TransferFunction([(60, "white", 0.0), (130, "red", 0.02), (200, "white", 0.9)])
    camera = wvr.Camera.fit(blobs)
    both = [
        shaded(blobs, tf, camera, (24, 24), wvr.Certified(1e-5), {"precision": p, "termination": 0} | render, **options)
        for p in ("float32", "float64")
    ]
    assert max_error(both[0], both[1].rgba) < 1e-5


def test_a_hard_shadow_has_its_place():
    """A block over a floor, light at 45 degrees: the shadow is beside the block, as far away as it is high."""
    data = np.zeros((33, 33, 33), np.float32)
    data[4:8] = 1.0  # the floor, z = 4 .. 7
    data[20:24, 12:20, 4:12] = 1.0  # x = 4 .. 11, y = 12 .. 19, z = 20 .. 23
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction([(0.4, "white", 0.0), (0.6, "white", 0.95)])
    camera = wvr.Camera((16, 16, 100), (16, 16, 16), up=(0, 1, 0), parallel_scale=16.0)
    light = wvr.DirectionalLight((-1, 0, 1))
    image = shaded(volume, tf, camera, (32, 32), light=light, spread=0.0, slice_distance=0.5, cell=0.5).rgba
    bright = image[..., 0] / image[..., 3]
    row = bright[16]  # y = 16, columns are x
    # From the top of the floor up to the block it is 12.5 to 16.5: so far to the right of it.
    x = np.arange(32) + 0.5
    assert np.all(row[(x > 22) & (x < 24)] < 0.1)
    assert np.all(row[(x > 14) & (x < 15)] > 0.3) and np.all(row[(x > 30)] > 0.3)
    assert bright[4, 23] > 0.3 and bright[28, 23] > 0.3


def test_headlight_from_inside(blobs):
    """A camera in the volume, light from there along every ray: of an opacity A, A (1 - A / 2) is seen."""
    tf = wvr.TransferFunction([(0, "white", 0.0), (255, "white", 0.1)])
    center = blobs.corners.mean(axis=0)
    camera = wvr.Camera(center, center + np.array([1, 0.3, 0.2]), view_angle=60)
    for image in ("rays", "slices"):
        rgba = shaded(blobs, tf, camera, (16, 16), spread=0.0, slice_distance=0.25, cell=0.1, image=image).rgba
        assert np.abs(rgba[..., 0] - rgba[..., 3] * (1 - rgba[..., 3] / 2)).max() < 1e-3


def test_shadows_stay_within_what_is_emitted(blobs, smooth_tf):
    """Light is between none and all of it, and opacity that of the integrator, bound and all."""
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.5)])
    camera = wvr.Camera.fit(blobs)
    plain = wvr.render(blobs, tf, camera, (32, 32), tolerance=1e-3)
    for light in (DIRECTED, wvr.Headlight(), wvr.DirectionalLight((0.3, -1, -1))):
        image = wvr.render(
            blobs, tf, camera, (32, 32), tolerance=1e-3, shadows=wvr.ConvolutionShadows(light=light, spread=10.0)
        )
        assert np.all(image.rgba[..., 3] == plain.rgba[..., 3])
        assert np.all(image.rgba[..., :3] <= plain.rgba[..., :3] + 1e-6) and image.rgba.min() >= 0
        assert np.all(image.error_bound == plain.error_bound)
        assert "not the shadows" in image.stats["bound_covers"]
        dimmed = image.rgba[..., :3].sum() / plain.rgba[..., :3].sum()
        assert 0.1 < dimmed < 0.95


def test_lights_add_up(blobs):
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.5)])
    camera = wvr.Camera.fit(blobs)
    first, second = wvr.Headlight((1, 0.5, 0.2)), wvr.DirectionalLight((0, -1, -2), (0.2, 0.2, 0.9))

    def image(lights):
        return shaded(blobs, tf, camera, (24, 24), light=lights).rgba

    assert np.abs(image([first, second]) - image([first]) - image([second]))[..., :3].max() < 1e-12


@pytest.mark.parametrize("light", [DIRECTED, wvr.Headlight(), wvr.DirectionalLight((0.3, -1, -1.2))])
@pytest.mark.parametrize("parallel", [False, True])
def test_against_single_scattering(blobs, light, parallel):
    """In front, from the viewer and behind, parallel and not: the light of a narrow cone, to 2% of the image."""
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.3)])
    camera = wvr.Camera.fit(blobs, direction=(0.3, 0.2, 1), up=(0, 1, 0), parallel=parallel)
    truth = wvr.single_scattering(blobs, tf, camera, (24, 24), light=light, spread=5.0, directions=16, step=0.5).rgba
    image = shaded(blobs, tf, camera, (24, 24), light=light, spread=5.0, slice_distance=0.5).rgba
    seen = truth[..., 3] > 0.05
    assert np.abs(image - truth)[seen].mean() < 0.02 * truth[seen].mean()


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.5, 1.0, 2.0)])
def test_places_and_units_change_nothing(blobs, spacing):
    """A world a thousand times as large, somewhere else, has the same image."""
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.3)])
    images = []
    for scale, origin in ((1.0, 0.0), (1e3, 1e5)):
        volume = wvr.Volume(blobs.numpy(), spacing=np.multiply(spacing, scale), origin=(origin,) * 3)
        images.append(shaded(volume, tf, wvr.Camera.fit(volume), (24, 24), light=DIRECTED).rgba)
    assert np.abs(images[0] - images[1]).max() < 1e-7


def test_a_field_that_stays_at_a_jump_is_in_the_same_shadow_whatever_its_scale():
    """The jump is an entry of the table, as grey levels are: beside one, shadows were 0.013 off."""
    z, y, x = np.indices((16, 16, 16)) - 7.5
    shells = np.clip(np.round(np.sqrt(x * x + y * y + z * z) / 2) * 2, 0, 8) / 8
    images = []
    for scale, dtype in ((200, "u1"), (311.3, "f4"), (3000, "u2")):
        volume = wvr.Volume((scale * shells).astype(dtype))
        jump = float(np.full(1, scale * 0.5).astype(dtype)[0])
        tf = wvr.TransferFunction([(0, "white", 0.02), (jump, "white", 0.02), (jump, "red", 0.3), (scale, "blue", 0.1)])
        camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
        shadows = wvr.ConvolutionShadows(subsamples=1)
        images.append(wvr.render(volume, tf, camera, (24, 24), integrator=wvr.Exact(), shadows=shadows))
    assert max(max_error(one, images[0].rgba) for one in images[1:]) < 2e-3


def test_what_is_cut_away_casts_no_shadow():
    """Nor does a label that has no transfer function."""
    data = np.zeros((24, 24, 24), np.uint8)
    data[2:8] = 1
    data[16:20] = 1
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction([(0.4, "white", 0.0), (0.6, "white", 0.15)])
    options = {"light": wvr.DirectionalLight((0, -0.5, 1)), "cell": 1.0, "slice_distance": 0.25}
    camera = wvr.Camera((11, -60, 30), (11, 11, 10), parallel_scale=14.0)
    alone = data.copy()
    alone[12:] = 0
    expected = shaded(wvr.Volume(alone), tf, camera, (24, 24), **options).rgba
    cut = shaded(volume, tf, camera, (24, 24), render={"clip": wvr.ClipPlane((0, 0, 12), (0, 0, -1))}, **options)
    assert np.abs(cut.rgba - expected).max() < 0.02
    labels = wvr.Segmentation(wvr.Volume((np.indices(data.shape)[0] < 12).astype(np.uint8)), {1: tf})
    labelled = shaded(volume, None, camera, (24, 24), render={"segmentation": labels}, **options)
    assert np.abs(labelled.rgba - expected).max() < 0.02
    whole = shaded(volume, tf, camera, (24, 24), **options).rgba
    assert np.abs(whole - expected).max() > 0.1


@pytest.mark.parametrize("way", [(0, 0, -1), (1, 0, 0)], ids=["across", "along"])
def test_slices_in_the_face_of_an_absent_cell_are_of_both_its_sides(way):
    """And light along it: whichever way the samples are stored."""
    data = np.random.default_rng(1).uniform(0.2, 0.9, (9, 9, 9)).astype(np.float32)
    data[5:] = data[:, :, :4] = np.nan
    tf = wvr.TransferFunction([(0, "white", 0.2), (1, "white", 0.4)], unit_distance=1.0)
    camera = wvr.Camera((0, 0, 20), (0, 0, 0), up=(0, 1, 0), parallel_scale=3.9)
    shadows = wvr.ConvolutionShadows(light=wvr.DirectionalLight(way), image="slices")
    images = []
    for turn in (slice(None), slice(None, None, -1)):
        side = 1 if turn.step is None else -1
        volume = wvr.Volume(
            data[turn, :, turn].copy(), (1, 1, 1), (-4 * side, -4, -4 * side), np.diag([side, 1, side]), "transparent"
        )
        images.append(wvr.render(volume, tf, camera, (8, 8), shadows=shadows, lighting=False).rgba)
    assert np.abs(images[0] - images[1]).max() < 1e-5
    # Half of it is there.
    assert 1 - 0.8**4 < images[0][..., 3].max() < 1 - 0.6**4 and not images[0][:, :3].any()


def test_light_along_the_boundary_of_labels_is_the_same_whatever_they_are_called():
    volume = wvr.Volume(np.ones((8, 8, 8), np.uint8))
    thin, dense = (wvr.TransferFunction([(0, "white", a), (2, "white", a)]) for a in (0.1, 0.5))
    right = (np.indices(volume.shape)[2] > 3).astype(np.uint8)
    camera = wvr.Camera((3.5, 3.5, 20), (3.5, 3.5, 3.5), up=(0, 1, 0), parallel_scale=4)
    named = [
        wvr.Segmentation(right, {0: thin, 1: dense}),
        wvr.Segmentation(right, {1: dense, 0: thin}),
        wvr.Segmentation(7 - 5 * right, {2: dense, 7: thin}),
        wvr.Segmentation(right, {1: dense}, other=thin),
    ]
    images = [shaded(volume, None, camera, (8, 8), render={"segmentation": labels}).rgba for labels in named]
    assert images[0].any() and all(np.array_equal(image, images[0]) for image in images[1:])


def test_rounding_does_not_decide_on_labels_of_light_along_their_boundary():
    """Nor does the way in which they are stored: columns of light are half-way between samples."""
    labels = np.random.default_rng(3).integers(0, 2, (6, 6, 6)).astype(np.uint8)
    functions = {n: wvr.TransferFunction([(0, "white", a), (2, "white", a)]) for n, a in enumerate((0.1, 0.5))}
    camera = wvr.Camera((0, 0, 20), (0, 0, 0), up=(0, 1, 0), parallel_scale=3)
    images = []
    for side in (1, -1):
        volume = wvr.Volume(np.ones((6, 6, 6), np.uint8), origin=(-2.5 * side,) * 3, direction=side * np.eye(3))
        stored = wvr.Segmentation(labels[::side, ::side, ::side].copy(), functions)
        options = {"spread": 0.0, "slice_distance": 5 / 7}
        images.append(shaded(volume, None, camera, (8, 8), render={"segmentation": stored}, **options).rgba)
    assert images[0].any() and np.abs(images[0] - images[1]).max() < 1e-9


def test_lit_and_in_shadow(blobs):
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.5)])
    camera, lighting = wvr.Camera.fit(blobs), wvr.Lighting(light=DIRECTED)
    lit = wvr.render(blobs, tf, camera, (24, 24), lighting=lighting)
    both = wvr.render(blobs, tf, camera, (24, 24), lighting=lighting, shadows=wvr.ConvolutionShadows(light=DIRECTED))
    assert np.all(both.rgba[..., :3] <= lit.rgba[..., :3] + 1e-6)
    assert 0.2 < both.rgba[..., :3].sum() / lit.rgba[..., :3].sum() < 0.95


def test_streaming_reuses_what_it_can():
    """A new volume each frame: ranges of blocks and what follows from them, nothing else."""
    frames = [wvr.datasets.load("heart", 24, phase=phase) for phase in (0.0, 0.25, 0.5)]
    tf = wvr.TransferFunction([(60, "black", 0.0), (255, "white", 0.3)])
    camera = wvr.Camera.fit(frames[0])
    renderer = wvr.Renderer(frames[0], tf, shadows=wvr.ConvolutionShadows(light=DIRECTED, image="slices"))
    images = []
    for frame in frames:
        renderer.volume = frame
        images.append(renderer.render(camera, (16, 16)).rgba)
    assert renderer.builds["transfer"] == 2 and renderer.builds["ranges"] == 3 and renderer.builds["kinds"] == 3
    assert np.abs(images[0] - images[2]).max() > 0.01


@pytest.mark.parametrize("light", [DIRECTED, wvr.Headlight(), wvr.DirectionalLight((0.5, 0.4, -1.0))])
def test_how_far_light_is_ahead_changes_nothing(blobs, light, monkeypatch):
    """The eye may follow every 16 slabs, or once at the end."""
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.5)])
    options = {"light": light, "slice_distance": 0.25, "image": "slices"}
    images = []
    for ahead in (1 << 30, 1):
        monkeypatch.setattr("wvr.light.sweep.AHEAD", ahead)
        images.append(shaded(blobs, tf, wvr.Camera.fit(blobs), (24, 24), **options))
    assert images[0].stats["slices"] > 40
    assert max_error(images[0], images[1].rgba) < 1e-12


@pytest.mark.parametrize("image", ["rays", "slices"])
def test_skipping_changes_nothing(image):
    """Neither blocks without extinction, nor tiles that no shadow has reached."""
    data = np.zeros((41, 41, 41), np.uint8)
    data[:3, :3, :3] = data[-3:, -3:, -3:] = data[17:24, 15:23, 18:24] = 200
    volume, tf = wvr.Volume(data), wvr.TransferFunction([(100, "green", 0.0), (220, "peru", 0.7)])
    images = [
        shaded(
            volume,
            tf,
            wvr.Camera.fit(volume),
            (24, 24),
            render={"skip_empty": skip},
            light=DIRECTED,
            image=image,
            spread=60,
        )
        for skip in (True, False)
    ]
    assert images[0].stats["shadow_samples"] < 0.5 * images[1].stats["shadow_samples"]
    assert max_error(images[0], images[1].rgba) < 1e-12


@pytest.mark.parametrize("light", [DIRECTED, wvr.Headlight(), wvr.DirectionalLight((1, 0.2, -0.1))])
@pytest.mark.parametrize("integrator", [wvr.Exact(), wvr.Certified(1e-4)], ids=["rays one by one", "in vectors"])
def test_slices_and_their_parts_are_those_of_the_volume(light, integrator):
    """However little there is to see in it, which blocks of four cells say from one corner on: samples stored the other
    way round, or with nothing skipped, are the same scene. They were 0.04 to 0.19 apart.
    """
    rng = np.random.default_rng(5)
    tf = wvr.TransferFunction([(0, "white", 0), (0.45, "white", 0), (0.6, "red", 0.3), (1, "gold", 0.9)])
    for shape, direction in (((11, 13, 9), (1.0, 0.6, 0.4)), ((8, 17, 12), (-0.3, 0.9, -1.2))):
        samples = np.zeros(shape, np.float32)
        samples[2:-3, 3:-2, 1:-4] = rng.random([n - 5 for n in shape])
        volume = wvr.Volume(samples, (0.7, 1.0, 1.3))
        turned = wvr.Volume(np.flip(samples).copy(), (0.7, 1.0, 1.3), volume.corners[-1], -np.eye(3))
        camera = wvr.Camera.fit(volume, direction)
        one, unskipped, other = (
            shaded(given, tf, camera, (20, 20), integrator, options, light=light)
            for given, options in (
                (volume, {"precision": "auto"}),
                (volume, {"precision": "auto", "skip_empty": False}),
                (turned, {"precision": "auto"}),
            )
        )
        assert one.rgba[..., 0].max() > 0.1
        assert max_error(unskipped, one.rgba) < 2e-3 and max_error(other, one.rgba) < 2e-3


def test_memory_for_light_is_asked_for(blobs, smooth_tf, monkeypatch):
    monkeypatch.setattr("wvr.memory.free_host_memory", lambda: 100e6)
    renderer = wvr.Renderer(blobs, smooth_tf)
    without = renderer.render(wvr.Camera.fit(blobs), (8, 8)).stats["bytes"]
    renderer.shadows = wvr.ConvolutionShadows()
    with pytest.raises(MemoryError, match=r"need 0\.1 GiB on cpu, which has 0\.1 GiB free"):
        renderer.render(wvr.Camera.fit(blobs), (8, 8))
    monkeypatch.undo()
    assert renderer.render(wvr.Camera.fit(blobs), (8, 8)).stats["bytes"] > without + 1e8


def test_memory_for_slices_of_small_cells_is_asked_for(blobs, smooth_tf, monkeypatch):
    monkeypatch.setattr(wvr.light.sweep, "free_memory", lambda device: 2.0**28)
    shadows = wvr.ConvolutionShadows(cell=0.01)
    with pytest.raises(MemoryError, match=r"slices of light need .* GiB on cpu, which has 0\.2 GiB free"):
        wvr.render(blobs, smooth_tf, wvr.Camera.fit(blobs), (8, 8), shadows=shadows)


def test_nothing_to_see(blobs):
    tf = wvr.TransferFunction([(0, "red", 0.0), (255, "white", 0.0)])
    for image in ("rays", "slices"):
        shadows = wvr.ConvolutionShadows(image=image)
        assert not wvr.render(blobs, tf, wvr.Camera.fit(blobs), (8, 8), shadows=shadows).rgba.any()


def test_threads_change_nothing(threads, blobs):
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.5)])
    images = []
    for n in (1, 3):
        threads(n)
        images.append(shaded(blobs, tf, wvr.Camera.fit(blobs), (24, 24), light=DIRECTED))
    assert max_error(images[0], images[1].rgba) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"slice_distance": 0}, "slice_distance must be finite and > 0"),
        ({"slice_distance": float("nan")}, "slice_distance must be finite and > 0"),
        ({"subsamples": -1}, "subsamples must be an integer >= 0"),
        ({"subsamples": 1.5}, "subsamples must be an integer >= 0"),
        ({"preintegrated": 1}, "preintegrated must be True or False"),
        ({"spread": -1}, r"spread must be an angle in \[0, 90\)"),
        ({"spread": 90}, r"spread must be an angle in \[0, 90\)"),
        ({"splitting": "trotter"}, "splitting must be one of"),
        ({"kernel": "box"}, "kernel must be one of"),
        ({"mode": "sideways"}, "mode must be one of"),
        ({"cell": 0}, "cell must be finite and > 0"),
        ({"light": "sun"}, "light must be a Headlight or DirectionalLight"),
        ({"light": []}, "light must be a Headlight or DirectionalLight"),
        ({"mode": "occlusion", "light": DIRECTED}, 'mode "occlusion" is for a Headlight alone'),
        ({"slice_distance": 1e300}, "slice_distance must be at most 16384 voxel spacings"),
        ({"cell": 1e300}, "cell must be at most 16384 voxel spacings"),
    ],
)
def test_bad_input(options, message):
    with pytest.raises((ValueError, TypeError), match=message):
        wvr.ConvolutionShadows(**options)


def test_bad_input_of_render(blobs, smooth_tf):
    camera = wvr.Camera.fit(blobs)
    with pytest.raises(TypeError, match=r"shadows must be a ConvolutionShadows, True, False or None, got 1\.0"):
        wvr.render(blobs, smooth_tf, camera, shadows=1.0)
    with pytest.raises(ValueError, match=r"clip must be without parts for .* image=.slices., .* got parts='power'"):
        shaded(blobs, smooth_tf, camera, image="slices", render={"clip": wvr.ClipVolume(blobs, 100, parts="power")})
    behind = wvr.DirectionalLight(np.subtract(camera.target, camera.position))
    with pytest.raises(ValueError, match=r"need light from the side of the viewer, got .* 180 degrees from the view"):
        shaded(blobs, smooth_tf, camera, light=behind, mode="view-aligned")


@pytest.mark.parametrize("light", ["headlight", "directional"])
def test_light_of_any_width_is_finite(light):
    """Where more blur is asked for than there are steps of diffusion, which grow no oscillation."""
    volume = wvr.Volume(np.full((1, 11, 5), 128, np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.5), (255, "white", 0.5)])
    camera = wvr.Camera.fit(volume, (0.2, 1, 0.3))
    one = wvr.Headlight() if light == "headlight" else wvr.DirectionalLight(tuple(camera.basis()[2]))
    shadows = wvr.ConvolutionShadows(spread=85, slice_distance=20, light=one)
    rgba = wvr.render(volume, tf, camera, (16, 12), shadows=shadows).rgba
    assert np.isfinite(rgba).all() and rgba.min() >= 0 and rgba.max() <= 1
    # And light has no more cells around the volume than blur there is.
    wide, wider = (
        place(volume, camera, replace(shadows, spread=spread), one, view(volume, camera, 16, 12))[1]
        for spread in (89, 89.9)
    )
    assert wide == wider and max(wider) < 200


def test_no_colour_is_below_zero():
    """Light straight against the view, where next to nothing of it is left: what is curved is summed by lines."""
    rng = np.random.default_rng(349)
    samples = (255 * rng.random((24, 20, 17)) * (rng.random((24, 20, 17)) < 0.5)).astype(np.uint8)
    volume = wvr.Volume(samples)
    tf = wvr.TransferFunction([(25, "red", 0.0), (71, "gold", 0.8), (96, "white", 0.6), (108, "white", 1.0)])
    for way in rng.normal(size=(12, 3)):
        camera = wvr.Camera.fit(volume, way)
        options = {"light": wvr.DirectionalLight(camera.basis()[2]), "slice_distance": 1.0}
        image = shaded(volume, tf, camera, (24, 24), render={"lighting": wvr.Lighting(shininess=0.5)}, **options)
        assert image.rgba.min() >= 0
