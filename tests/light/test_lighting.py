"""Light against closed forms of a linear field and a sphere, orders of the modes, superposition, and limits."""

from dataclasses import replace

import numpy as np
import pytest

import wvr

from ..helpers import every_kind, max_error

MODES = ["center", "average", "interpolated", "isosurface", "closest-isosurface", "supersampled"]
# A rotated, anisotropic grid.
DIRECTION = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
SPACING = np.array([1.0, 2.0, 1.5])


@pytest.fixture
def smooth_tf():
    return wvr.TransferFunction.from_arrays([0, 255], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]], [0.1, 0.7])


def ramp_volume(n=12, gradient=(3.0, 2.0, -1.0)):
    """Linear in world space, with the gradient given there."""
    k, j, i = np.meshgrid(*[np.arange(n)] * 3, indexing="ij")
    world = np.stack([i, j, k], axis=-1) * SPACING @ DIRECTION.T
    return wvr.Volume((world @ gradient).astype(np.float32), spacing=tuple(SPACING), direction=DIRECTION)


def side_camera(volume):
    return wvr.Camera.fit(volume, direction=(1, 0.6, 0.4), parallel=True)


def linear_tf(volume, **factors):
    lo, hi = volume.range
    colors = [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]]
    return wvr.TransferFunction.from_arrays([lo, hi], colors, [0.05, 0.3], **factors)


def expected(unlit, gradient, camera, lighting):
    """The image of a field whose gradient is the same everywhere, from that without light."""
    eye = np.asarray(camera.position) - np.asarray(camera.target)
    eye = eye / np.linalg.norm(eye)
    normal = np.asarray(gradient) / np.linalg.norm(gradient)
    diffuse, specular = np.zeros(3), np.zeros(3)
    for light in lighting.lights:
        toward = np.asarray(getattr(light, "direction", eye))
        half = (toward + eye) / np.linalg.norm(toward + eye)
        diffuse += np.asarray(light.color) * abs(normal @ toward)
        specular += np.asarray(light.color) * abs(normal @ half) ** lighting.shininess
    rgb = unlit[..., :3] * (lighting.ambient + lighting.diffuse * diffuse)
    rgb = rgb + lighting.specular * specular * unlit[..., 3:]
    return np.concatenate([rgb, unlit[..., 3:]], axis=-1)


LIGHTS = wvr.Lighting(
    light=[
        wvr.DirectionalLight((1, -2, 0.5), color=(0.9, 0.5, 0.2)),
        wvr.Headlight(color=(0.1, 0.3, 0.4)),
    ],
    shininess=9.0,
)


@every_kind
def test_constant_gradient(integrator):
    """Where the gradient is the same everywhere light is a factor, on a rotated, anisotropic grid too."""
    gradient = (3.0, 2.0, -1.0)
    volume = ramp_volume(gradient=gradient)
    tf, camera = linear_tf(volume), side_camera(volume)
    unlit = wvr.render(volume, tf, camera, (24, 24), integrator=integrator, termination=0)
    lit = wvr.render(volume, tf, camera, (24, 24), integrator=integrator, termination=0, lighting=LIGHTS)
    assert max_error(lit, expected(unlit.rgba, gradient, camera, LIGHTS)) < 2e-5
    assert lit.rgba[..., :3].max() > 0.2


@pytest.mark.parametrize("mode", MODES)
def test_constant_gradient_in_every_mode(mode):
    volume = ramp_volume()
    tf, camera = linear_tf(volume), side_camera(volume)
    lighting = wvr.Lighting(mode=mode, light=LIGHTS.light, shininess=9.0)
    unlit = wvr.render(volume, tf, camera, (24, 24), integrator=wvr.Exact())
    lit = wvr.render(volume, tf, camera, (24, 24), integrator=wvr.Preintegrated(0.7), termination=0, lighting=lighting)
    # The table's own error is 1e-4.
    assert max_error(lit, expected(unlit.rgba, (3.0, 2.0, -1.0), camera, lighting)) < 3e-4


def sphere(n=48, scale=100.0):
    """Distance from the centre in world units, the cube's half edge being ``scale``."""
    x = np.linspace(-scale, scale, n)
    z, y, x = np.meshgrid(x, x, x, indexing="ij")
    spacing = 2 * scale / (n - 1)
    radius = np.sqrt(x * x + y * y + z * z)
    return wvr.Volume(radius.astype(np.float32), spacing=(spacing,) * 3, origin=(-scale,) * 3)


@pytest.mark.parametrize("integrator", [wvr.Certified(1e-3), wvr.Preintegrated(0.5)], ids=lambda i: type(i).__name__)
def test_sphere_is_shaded_as_a_sphere(integrator):
    """To 1% at normal incidence, and as |n.l| up to 50 degrees from it."""
    volume, radius = sphere(), 60.0
    tf = wvr.TransferFunction([(radius - 2, "white", 0.0), (radius, "white", 1.0), (radius + 2, "white", 0.0)])
    camera = wvr.Camera((300, 0, 0), (0, 0, 0), parallel_scale=70.0)
    lighting = wvr.Lighting(specular=0.2, shininess=10.0)
    image = wvr.render(volume, tf, camera, (141, 141), integrator=integrator, lighting=lighting)
    offset = np.arange(-70, 71) * (140 / 141)
    sine = np.hypot(offset[:, None], offset) / radius
    cosine = np.sqrt(np.clip(1 - sine**2, 0, None))
    shade = 0.2 + 0.7 * cosine + 0.2 * cosine**10
    seen = sine < np.sin(np.radians(50))
    assert abs(image.rgba[70, 70, 0] - 1.1) < 0.011
    assert np.abs(image.rgba[..., 0] - shade)[seen].max() < 0.03


def test_light_adds_up_and_leaves_opacity_alone(blobs, smooth_tf):
    camera = wvr.Camera.fit(blobs)
    first, second = wvr.Headlight((1, 0.5, 0.2)), wvr.DirectionalLight((0, 1, 2), (0.2, 0.2, 0.9))

    def image(lights):
        lighting = wvr.Lighting(light=lights)
        return wvr.render(blobs, smooth_tf, camera, (32, 32), tolerance=1e-3, precision="float64", lighting=lighting)

    dark, both = image([]), image([first, second])
    sum_of_each = image([first]).rgba + image([second]).rgba - dark.rgba
    assert max_error(both, sum_of_each) < 1e-11
    unlit = wvr.render(blobs, smooth_tf, camera, (32, 32), tolerance=1e-3, precision="float64")
    assert np.abs(both.rgba[..., 3] - unlit.rgba[..., 3]).max() < 1e-11
    assert np.abs(dark.rgba[..., :3] - 0.2 * unlit.rgba[..., :3]).max() < 1e-3
    assert both.error_bound == pytest.approx(unlit.error_bound, abs=1e-9)
    assert "not the lighting" in both.stats["bound_covers"]


def test_no_gradient_no_direction():
    """Homogeneous data look the same from wherever light comes, and as without light where the light is white."""
    volume = wvr.Volume(np.full((9, 9, 9), 5.0, np.float32))
    tf = wvr.TransferFunction([(0, "orange", 0.1), (10, "orange", 0.1)])
    camera = wvr.Camera.fit(volume)
    unlit = wvr.render(volume, tf, camera, (16, 16))
    for light in (wvr.Headlight(), wvr.DirectionalLight((1, 2, 3))):
        lighting = wvr.Lighting(light=light, ambient=0.25, diffuse=0.75)
        image = wvr.render(volume, tf, camera, (16, 16), lighting=lighting)
        assert max_error(image, unlit.rgba) < 1e-6


def test_light_fades_continuously_with_the_gradient():
    """From 1e-7 to 1 of the transfer function's range a voxel, without a step."""
    lighting = wvr.Lighting(light=wvr.DirectionalLight((0, 0, 1)), specular=0.0)
    seen = []
    for slope in np.geomspace(1e-7, 1, 57):
        volume = wvr.Volume((slope * np.arange(8) * np.ones((8, 8, 8))).astype(np.float32))  # along x
        tf = wvr.TransferFunction([(-0.5, "white", 0.1), (0.5, "white", 0.1)])
        camera = wvr.Camera((3.5, -50, 3.5), (3.5, 3.5, 3.5), parallel_scale=1.0)
        seen.append(wvr.render(volume, tf, camera, (1, 1), lighting=lighting).rgba[0, 0, 0])
    share = np.array(seen) / seen[0]
    # Light along z does nothing to a gradient along x.
    assert share[-1] == pytest.approx(0.2 / 0.9, rel=1e-3)
    assert np.all(np.diff(share) <= 1e-6) and np.abs(np.diff(share)).max() < 0.25


def test_materials(blobs):
    """Coefficients of the transfer function multiply those of the light, and vary with the scalar."""
    volume, camera = wvr.Volume(blobs.numpy().astype(np.float32), blobs.spacing), wvr.Camera.fit(blobs)
    arrays = ([0, 102, 255], [[0.9, 0.1, 0.3], [0.5, 0.5, 0.1], [0.1, 0.6, 1.0]], [0.02, 0.2, 0.5])
    plain = wvr.TransferFunction.from_arrays(*arrays)
    even = wvr.TransferFunction.from_arrays(*arrays, ambient=[0.5] * 3, diffuse=[0.25] * 3, specular=[2.0] * 3)
    varied = wvr.TransferFunction.from_arrays(
        *arrays, ambient=[1.0, 0.2, 0.5], diffuse=[0.1, 1.0, 0.3], specular=[0.0, 0.5, 2.0]
    )

    def image(tf, integrator, **lighting):
        return wvr.render(
            volume, tf, camera, (32, 32), integrator=integrator, termination=0, lighting=wvr.Lighting(**lighting)
        )

    scaled = {"ambient": 0.1, "diffuse": 0.7 * 0.25, "specular": 0.6}
    for integrator in (wvr.Exact(), wvr.Certified(1e-4), wvr.Preintegrated(0.5)):
        assert max_error(image(even, integrator), image(plain, integrator, **scaled).rgba) < 3e-4
    truth = image(varied, wvr.Exact()).rgba
    assert np.abs(truth - image(plain, wvr.Exact()).rgba).max() > 0.05
    for integrator, most in (
        (wvr.Certified(1e-4), 3e-4),
        (wvr.Preintegrated(0.1), 2e-3),
    ):
        assert max_error(image(varied, integrator), truth) < most


def test_materials_that_vary_within_a_cell_follow_the_tolerance():
    """Where light is the same everywhere, too."""
    volume = ramp_volume(n=3)
    camera, (low, high) = side_camera(volume), volume.range
    colors = [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]]
    tf = wvr.TransferFunction.from_arrays([low, high], colors, [0.6, 0.05], ambient=[0, 4])
    lighting = wvr.Lighting(ambient=1, diffuse=0, specular=0)
    images = [
        wvr.render(volume, tf, camera, (24, 24), integrator=one, lighting=lighting, precision="float64")
        for one in (wvr.Certified(1e-6), wvr.Exact())
    ]
    assert max_error(images[0], images[1].rgba) < 1e-6


def spiked_sphere(n, radii=(40, 60, 80), width=0.3):
    """Images by mode, and many parts with the same linear scalar: what is left between them is lighting alone."""
    volume = sphere(n, 100.0)
    # What a table says between its entries is an error too: make them dense.
    volume = wvr.Volume(np.clip(volume.numpy(), 36, 84), volume.spacing, volume.origin)
    spikes = wvr.TransferFunction.isosurfaces(radii, colors=["red", "lime", "blue"], opacity=0.02, width=width)
    camera = wvr.Camera.fit(volume, direction=(1, 0.3, 0.2))
    renderer = wvr.Renderer(volume, spikes, integrator=wvr.Preintegrated(1.0, table_size=2048), termination=0)

    def image(mode, **kwargs):
        renderer.lighting = wvr.Lighting(mode=mode, light=wvr.DirectionalLight((1, 1, 1)), **kwargs)
        return renderer.render(camera, (28, 28))

    return image, image("supersampled", supersample=32).rgba[..., :3]


def test_interpolated_light_is_of_second_order():
    """Spikes thinner than a step: about order 1 for one sample of light, 2 where it is interpolated.

    The latter without the table's own error: a segment of one part is interpolated from control point to control point.
    """
    sizes = np.array([24, 48, 96])
    found = []
    for n in sizes:
        image, truth = spiked_sphere(int(n))
        images = image("center"), image("interpolated"), image("supersampled", supersample=1)
        found.append([np.abs(one.rgba[..., :3] - truth).mean() / truth.mean() for one in images])
    center, table, interpolated = np.transpose(found)
    order = [-np.polyfit(np.log(sizes - 1), np.log(errors), 1)[0] for errors in (center, interpolated)]
    assert order[0] < 1.4
    assert order[1] > 1.8
    assert table[1] < 0.4 * center[1] and table[2] < 0.3 * center[2]
    assert np.abs(table - interpolated).max() < 1e-3


def test_isosurfaces_in_order():
    """At a peak of the transfer function light is that of the peak, of each; the closest one's alone is not."""
    image, truth = spiked_sphere(24, (58, 60, 62), 1.0)
    error = {mode: np.abs(image(mode).rgba[..., :3] - truth).mean() for mode in MODES}
    assert error["isosurface"] < 0.5 * error["center"]
    assert error["closest-isosurface"] > 2 * error["isosurface"]


def test_nested_surfaces_show_no_jumps():
    """Second differences along a scan line: interpolated light jumps no more than light at the surfaces themselves."""
    volume = wvr.Volume(np.clip(sphere(48).numpy(), 52, 68), (200 / 47,) * 3, (-100,) * 3)
    tf = wvr.TransferFunction.isosurfaces([56, 60, 64], colors=["red", "lime", "blue"], opacity=0.9, width=1.0)
    camera = wvr.Camera.fit(volume, direction=(1, 0.3, 0.2))
    renderer = wvr.Renderer(volume, tf, integrator=wvr.Preintegrated(2.0, table_size=1024), termination=0)

    def line(mode):
        renderer.lighting = wvr.Lighting(mode, wvr.DirectionalLight((1, 1, 1)), supersample=32)
        return renderer.render(camera, (192, 192)).rgba[96, :, :3]

    truth = line("supersampled")
    jump = {mode: np.abs(np.diff(line(mode) - truth, 2, axis=0)).max() for mode in ("center", *MODES[2:4])}
    assert jump["interpolated"] <= jump["isosurface"]
    assert jump["interpolated"] < 0.7 * jump["center"]


def test_light_knows_clips_and_labels(blobs):
    """Two labels of one transfer function are one; two halves of a lit volume are the whole, but for the cut's face."""
    tf = wvr.TransferFunction([(25, "red", 0.0), (153, "white", 0.4)])
    camera = wvr.Camera.fit(blobs, parallel=True)
    labels = wvr.Volume((np.indices(blobs.shape)[0] > 15).astype(np.uint8))
    segmentation = wvr.Segmentation(labels, {0: tf, 1: tf})

    def image(tolerance, **options):
        seen = None if "segmentation" in options else tf
        return wvr.render(blobs, seen, camera, (32, 32), tolerance=tolerance, lighting=wvr.Lighting(), **options)

    # By one walk, since at this tolerance all is double; by two, rays end elsewhere within the tolerance.
    assert max_error(image(1e-5, segmentation=segmentation), image(1e-5).rgba) < 1e-6
    whole = image(8e-5)
    assert max_error(image(8e-5, segmentation=segmentation), whole.rgba) < 8e-5
    # A plane that rays run along cuts none of them.
    forward = np.asarray(camera.target) - np.asarray(camera.position)
    across = np.cross(forward, (0, 0, 1))
    point = np.asarray(blobs.corners.mean(axis=0)) + 1e-3 * across
    halves = [image(8e-5, clip=wvr.ClipPlane(point, side * across)).rgba for side in (1, -1)]
    assert whole.stats["walk"] == "float32" and max_error(whole, halves[0] + halves[1]) < 1e-6


@pytest.mark.parametrize(
    "integrator", [wvr.Certified(1e-3), wvr.Preintegrated(0.1)], ids=lambda integrator: type(integrator).__name__
)
def test_cut_faces_are_lit_by_the_cut(integrator):
    """Homogeneous data have no gradient; where a plane cuts them open the plane is the surface."""
    volume = wvr.Volume(np.full((9, 9, 9), 5, np.uint8), spacing=(1.0, 2.0, 1.0))
    tf = wvr.TransferFunction([(0, "white", 0.9999), (10, "white", 0.9999)])
    normal = np.array([-1.0, 0.3, -0.2]) / np.linalg.norm([1.0, 0.3, 0.2])
    clip = wvr.ClipPlane((4, 8, 4), normal)
    camera = wvr.Camera((100, 8, 4), (4, 8, 4), parallel_scale=1.0)
    light = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    lighting = wvr.Lighting(light=wvr.DirectionalLight(light), specular=0.0)
    image = wvr.render(volume, tf, camera, (3, 3), integrator=integrator, clip=clip, lighting=lighting)
    assert image.rgba[1, 1, 0] == pytest.approx(0.2 + 0.7 * abs(normal @ light), rel=5e-3)


@pytest.mark.parametrize(("gradient", "integrator"), [("central", wvr.Certified(1 / 512)), ("cell", wvr.Riemann(0.5))])
def test_absent_data_are_not_lit(gradient, integrator):
    data = wvr.datasets.load("blobs", 16).numpy().astype(np.float32)
    data[5:9, 5:9, 5:9] = np.nan
    volume = wvr.Volume(data, nan="transparent")
    tf = wvr.TransferFunction([(0, "red", 0.1), (1, "white", 0.9)])
    camera, lighting = wvr.Camera.fit(volume), wvr.Lighting(gradient=gradient)
    image = wvr.render(volume, tf, camera, (32, 32), integrator=integrator, lighting=lighting)
    assert np.all(np.isfinite(image.rgba)) and image.rgba[..., 0].max() > 0.1


def test_certified_light_converges(blobs):
    tf = wvr.TransferFunction.isosurfaces([76, 128], colors=["red", "lime"], opacity=0.5, width=13)
    camera, lighting = wvr.Camera.fit(blobs), wvr.Lighting(shininess=8.0)
    truth = wvr.render(blobs, tf, camera, (48, 48), integrator=wvr.Exact(), lighting=lighting).rgba
    errors = []
    for tolerance in (1e-2, 1e-4, 1e-5):
        image = wvr.render(blobs, tf, camera, (48, 48), tolerance=tolerance, lighting=lighting, precision="float64")
        errors.append(np.abs(image.rgba - truth)[..., :3].mean())
        assert np.all(np.abs(image.rgba - truth)[..., 3] <= image.error_bound)
    assert errors[0] < 2e-3 and errors[2] < 1e-6
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("shape", [(7, 6, 8), (6, 1, 8)])
def test_light_of_certified_and_exact_images_is_that_of_small_steps(shape):
    """In noise, too, where normals turn within a piece and cosines bend."""
    volume = wvr.Volume(np.random.default_rng(3).integers(256, size=shape, dtype=np.uint8))
    tf = wvr.TransferFunction([(0, "red", 0.02), (120, "green", 0.1), (255, "blue", 0.5)])
    camera = wvr.Camera.fit(volume, (0, 0, 1), up=(0, 1, 0), parallel=True)
    lighting = wvr.Lighting(shininess=1.0)
    small = wvr.Riemann(0.002)
    truth = wvr.render(
        volume, tf, camera, (9, 9), integrator=small, lighting=lighting, precision="float64", termination=0
    )
    for how in ({"tolerance": 1e-5}, {"tolerance": 1e-5, "precision": "float64"}, {"integrator": wvr.Exact()}):
        image = wvr.render(volume, tf, camera, (9, 9), lighting=lighting, **how)
        assert max_error(image, truth.rgba) < 1e-5, how


@pytest.mark.parametrize("cut", [False, True])
def test_light_is_within_the_tolerance_where_normals_reverse(cut, monkeypatch):
    """Where gradients nearly vanish, as in flat parts of scans, between two points of a piece; and behind a cut's face,
    whose normal has one of two signs. In lanes, in double precision, exact, and as on GPUs.
    """
    volume = wvr.Volume((100 + np.random.default_rng(2).integers(3, size=(7, 7, 7))).astype(np.uint8))
    tf = wvr.TransferFunction([(100, "white", 0.0), (101, "orange", 0.8)])
    camera = wvr.Camera.fit(volume, (1, 0.7, 0.4), parallel=True)
    clip = wvr.ClipPlane((3, 3, 3), (-1, -0.5, -0.2)) if cut else None

    def image(**options):
        return wvr.render(volume, tf, camera, (24, 24), lighting=wvr.Lighting(), clip=clip, **options)

    truth = image(integrator=wvr.Riemann(2e-5 if cut else 1e-4), precision="float64", termination=0).rgba
    assert max_error(image(integrator=wvr.Exact()), truth) < 1e-5
    for tolerance in (1 / 512, 1e-4):
        found = image(tolerance=tolerance)
        assert found.stats["walk"] == "float32" and max_error(found, truth) < 0.25 * tolerance
    if not cut:  # then as exact
        assert max_error(image(tolerance=1e-4, precision="float64"), truth) < 2.5e-5
    halves = wvr.frame.Frame.halves
    monkeypatch.setattr(wvr.frame.Frame, "halves", lambda self, *args: replace(halves(self, *args), vectors=False))
    assert max_error(image(tolerance=1e-4), truth) < 2.5e-5


def test_light_of_layers_does_not_add_up_to_more_than_the_tolerance(monkeypatch):
    """Where normals reverse at the same place in each of hundreds of thin pieces: it was 36 times the tolerance."""
    _, y, x = np.indices((5, 5, 256))
    volume = wvr.Volume((24 * np.sin(x * np.pi / 2 + 0.7) + 40 * y + 24).astype(np.uint8))
    camera = wvr.Camera((306, 2, 2), (128, 2, 2), parallel_scale=2)
    lighting = wvr.Lighting(light=wvr.DirectionalLight((1, 0, 0.2)), ambient=0, diffuse=1, specular=0)
    tolerance = 1e-4
    halves = wvr.frame.Frame.halves
    for opacity in (1e-3, 1e-2):
        tf = wvr.TransferFunction([(0, "white", opacity), (255, "white", opacity)])

        def image(*, tf=tf, **options):
            return wvr.render(volume, tf, camera, (3, 3), lighting=lighting, **options)

        truth = image(integrator=wvr.Riemann(0.002), precision="float64", termination=0).rgba
        assert max_error(image(integrator=wvr.Exact()), truth) < 5e-6
        assert max_error(image(tolerance=tolerance), truth) < 0.5 * tolerance
        assert max_error(image(tolerance=tolerance, precision="float64"), truth) < 0.5 * tolerance
        with monkeypatch.context() as on_gpus:
            on_gpus.setattr(wvr.frame.Frame, "halves", lambda self, *args: replace(halves(self, *args), vectors=False))
            assert max_error(image(tolerance=tolerance), truth) < 0.5 * tolerance


def test_parts_of_a_piece_weigh_what_they_see():
    """Of one whose extinction falls to 0, in halves with other light: behind a cut, where the field has no gradient."""
    data = np.zeros((5, 4, 7), np.uint8) + (100 + 20 * (np.arange(5) % 2)).astype(np.uint8)[:, None, None]
    volume = wvr.Volume(data, spacing=(0.508, 2.011, 0.379))
    tf = wvr.TransferFunction([(107.8, "white", 0.0), (109.1, "white", 0.97), (110.4, "white", 0.0)])
    camera = wvr.Camera((1, 3.135, 0.982), (-3.69, 0.435, 0.695), up=(0.02, 0.93, -0.2), view_angle=60)
    lighting = wvr.Lighting(ambient=0, diffuse=1, specular=0)
    clip = wvr.ClipPlane((1.518, 2.257, 0.64), (0.0129, 0.1294, -0.6377))
    small = {"integrator": wvr.Riemann(2e-4), "precision": "float64", "termination": 0}
    images = [
        wvr.render(volume, tf, camera, (20, 20), lighting=lighting, clip=clip, **how).rgba
        for how in (small, {"integrator": wvr.Exact()})
    ]
    assert images[0].max() > 0.1 and np.abs(images[1] - images[0]).max() < 5e-6


@every_kind
def test_light_right_behind_does_not_glint(integrator):
    """Where a light and the viewer are opposite there is no way half between them: rounding used to choose one."""
    volume = ramp_volume()
    tf, camera = linear_tf(volume), side_camera(volume)
    *_, forward = camera.basis()
    behind = wvr.DirectionalLight(forward)
    for aside, low, high in ((0.0, 0.0, 1e-6), (2e-3, 1e-3, 0.1), (2e-2, 0.1, 1.0)):
        towards = wvr.DirectionalLight(forward + aside * np.array([0.48, 0.6, -0.64]))
        lit = [
            wvr.render(volume, tf, camera, (6, 6), integrator=integrator, lighting=light).rgba[..., :3].max()
            for light in (
                wvr.Lighting(ambient=0, diffuse=0, specular=1, shininess=1.0, light=one) for one in (towards, behind)
            )
        ]
        assert low <= lit[0] <= high and lit[1] < 1e-6


def test_powers_below_1_are_not_those_of_rounding():
    """They are steep where a normal is across the view."""
    _, y, x = np.indices((8, 8, 8), np.uint8)
    volume = wvr.Volume(24 * x + 8 * y)
    camera = wvr.Camera.fit(volume, (1, -3, 1), parallel=True)
    lighting = wvr.Lighting(ambient=0, diffuse=0, specular=1, shininess=0.3)
    assert wvr.render(volume, linear_tf(volume), camera, (6, 6), lighting=lighting).rgba[..., :3].max() < 1e-4


def test_scales_of_data_change_nothing(blobs):
    """Light depends on the gradient's direction: not on the unit of scalars or lengths."""
    data = blobs.numpy() / 255
    images = []
    for scale, spacing in ((1.0, 1.0), (1e12, 1e-6), (1e-12, 1e6)):
        volume = wvr.Volume((scale * data).astype(np.float32), spacing=(spacing,) * 3)
        tf = wvr.TransferFunction([(0, "red", 0.0), (scale, "white", 0.5)])
        images.append(wvr.render(volume, tf, wvr.Camera.fit(volume), (24, 24), lighting=wvr.Lighting()).rgba)
    assert np.abs(images[1] - images[0]).max() < 1e-5
    assert np.abs(images[2] - images[0]).max() < 1e-5


def test_renderer_rebuilds_nothing_for_a_light(blobs, smooth_tf):
    renderer = wvr.Renderer(blobs, smooth_tf, lighting=wvr.Lighting())
    camera = wvr.Camera.fit(blobs)
    renderer.render(camera, (8, 8))
    before = dict(renderer.builds)
    renderer.lighting = wvr.Lighting(light=wvr.DirectionalLight((1, 0, 0)), shininess=4.0)
    renderer.render(camera, (8, 8))
    assert dict(renderer.builds) == before


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: wvr.Lighting(mode="phong"), "mode must be one of 'center'"),
        (lambda: wvr.Lighting(gradient="sobel"), "gradient must be one of"),
        (lambda: wvr.Lighting(ambient=-0.1), "ambient must be a finite number >= 0"),
        (lambda: wvr.Lighting(diffuse=float("nan")), "diffuse must be a finite number >= 0"),
        (lambda: wvr.Lighting(shininess=0), "shininess must be finite and > 0"),
        (lambda: wvr.Lighting(supersample=0), "supersample must be an integer from 1 to 4096"),
        (lambda: wvr.Lighting(light="sun"), "light must be a Headlight or DirectionalLight"),
        (lambda: wvr.DirectionalLight((0, 0, 0)), "direction must not be zero"),
        (lambda: wvr.DirectionalLight((0, 0)), "direction must be three finite numbers"),
        (lambda: wvr.Headlight("no such colour"), "color must be"),
        (lambda: wvr.Headlight((1, -1, 0)), "color must be"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()


@pytest.mark.parametrize(
    "options",
    [
        {"lighting": wvr.Lighting(ambient=1e31)},
        {"lighting": wvr.Lighting(specular=1e20, light=wvr.Headlight((0, 1e20, 0)))},
        {"lighting": wvr.Lighting(specular=0, diffuse=1e-30, light=[wvr.Headlight((1e308, 0, 0))] * 2)},
        {"shadows": wvr.ConvolutionShadows(light=wvr.Headlight((1e31, 0, 0)))},
        {"lighting": wvr.Lighting(ambient=1e20), "shadows": wvr.ConvolutionShadows(light=wvr.Headlight((1e20, 0, 0)))},
    ],
)
def test_light_beyond_what_images_hold_is_refused(blobs, smooth_tf, options):
    with pytest.raises(ValueError, match=r"light makes numbers of .* float32 images hold up to 1e[+]30"):
        wvr.render(blobs, smooth_tf, wvr.Camera.fit(blobs), (8, 8), **options)


@pytest.mark.parametrize("integrator", [wvr.Riemann(0.5), wvr.Exact()])
def test_light_that_glances_is_no_more_than_the_light(integrator):
    """Rounding makes cosines that are more than 1, and of these powers are as large as one likes."""
    x = np.mgrid[:5, :5, :5][::-1]
    for direction in np.random.default_rng(0).normal(size=(8, 3)):
        volume = wvr.Volume(np.tensordot(direction, x, 1).astype(np.float32))
        camera = wvr.Camera.fit(volume, direction, parallel=True)
        lighting = wvr.Lighting(ambient=0, diffuse=0, specular=1, shininess=1e17)
        tf = wvr.TransferFunction([(-20, "white", 0.5), (20, "white", 0.5)])
        rgba = wvr.render(volume, tf, camera, (4, 4), integrator=integrator, lighting=lighting).rgba
        assert np.all(rgba[..., :3] <= rgba[..., 3:] * 1.00001)


def test_bad_input_of_render(blobs, smooth_tf):
    camera = wvr.Camera.fit(blobs)
    with pytest.raises(TypeError, match=r"lighting must be a Lighting, True, False or None, .* got 1\.0"):
        wvr.render(blobs, smooth_tf, camera, lighting=1.0)
    with pytest.raises(ValueError, match='generator="approximate"'):
        wvr.render(
            blobs,
            smooth_tf,
            camera,
            integrator=wvr.Preintegrated(1.0, generator="approximate"),
            lighting=wvr.Lighting(),
        )
