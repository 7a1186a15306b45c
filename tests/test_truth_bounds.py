"""Where bounds were false once: masks, distance, spikes, shear, control points beside large ones, small tolerances.

The truth is a closed form wherever there is one, else the exact walk.
"""

import numpy as np
import pytest

import wvr

EXACT = wvr.Exact()
DTYPES = ("uint8", "int16", "float32", "float64")


def chords(camera, size, lo, hi):
    """Lengths of an image's rays in a box of the world; of a distant camera counted from the plane of its target."""
    origins, directions = camera.rays(size)
    if not camera.parallel:
        width, height = size
        right, up, _ = camera.basis()
        distance = np.linalg.norm(camera.position - camera.target)
        half = np.tan(np.radians(camera.view_angle) / 2) / height * distance
        x, y = (2 * np.arange(width) + 1 - width) * half, (height - 1 - 2 * np.arange(height)) * half
        origins = camera.target + x[None, :, None] * right + y[:, None, None] * up
    with np.errstate(divide="ignore"):
        a, b = (lo - origins) / directions, (hi - origins) / directions
    return np.maximum(np.maximum(a, b).min(-1) - np.minimum(a, b).max(-1), 0.0)


def off(image, truth):
    return np.abs(np.asarray(image.rgba, float) - truth).max(-1)


def assert_bounded(volume, tf, camera, size=(24, 24), tolerance=1 / 512, **options):
    """That the image is within its bound of the exact one; returns both."""
    exact = wvr.render(volume, tf, camera, size, integrator=EXACT, **options)
    image = wvr.render(volume, tf, camera, size, tolerance=tolerance, **options)
    assert np.all(np.isfinite(image.rgba)) and np.all(np.isfinite(exact.rgba))
    assert np.all(off(image, exact.rgba) <= image.error_bound)
    # Whoever saw something was off by something.
    assert np.all(image.error_bound[exact.rgba.max(-1) > 0] > 0)
    return image, exact


def mask(dtype):
    samples = np.zeros((9, 9, 9), dtype)
    samples[2:8, 2:8, 2:8] = 1
    return samples


JUMP = [(0, "red", 0), (1, "red", 0), (1, "red", 0.5), (2, "red", 0.5)]


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("skip_empty", [True, False])
def test_a_mask_whose_samples_are_where_the_jump_is(dtype, skip_empty):
    volume, tf = wvr.Volume(mask(dtype)), wvr.TransferFunction(JUMP)
    camera = wvr.Camera.fit(volume)
    image, exact = assert_bounded(volume, tf, camera, (48, 48), skip_empty=skip_empty)
    opacity = 1 - 0.5 ** chords(camera, (48, 48), 2.0, 7.0)
    assert opacity.max() > 0.9
    assert np.abs(exact.rgba[..., 3] - opacity).max() < 1e-13
    assert np.all(np.abs(image.rgba[..., 3] - opacity) <= image.error_bound)


@pytest.mark.parametrize("scale, offset", [(1e-3, 0.0), (1e6, 0.0), (1e-3, 1e6), (1.0, -1e10), (3e-308, 0.0)])
def test_a_mask_of_any_scale_and_offset(scale, offset):
    volume = wvr.Volume(mask("float64") * scale + offset)
    on = volume.range[1]
    tf = wvr.TransferFunction([(offset, "red", 0), (on, "red", 0), (on, "red", 0.5), (on + scale, "red", 0.5)])
    camera = wvr.Camera.fit(volume)
    _, exact = assert_bounded(volume, tf, camera)
    opacity = 1 - 0.5 ** chords(camera, (24, 24), 2.0, 7.0)
    assert np.abs(exact.rgba[..., 3] - opacity).max() < 1e-13


@pytest.mark.parametrize("dtype", ["uint8", "float64"])
def test_labels_whose_samples_are_where_the_jump_is(dtype):
    volume = wvr.Volume(mask(dtype))
    tf = wvr.TransferFunction(JUMP)
    labels = np.ones((9, 9, 9), np.uint8)
    labels[:, :, :4] = 2
    clear = wvr.TransferFunction([(0, "blue", 0), (1, "blue", 0)])
    camera = wvr.Camera.fit(volume)
    image, exact = assert_bounded(volume, None, camera, segmentation=wvr.Segmentation(labels, {1: tf, 2: clear}))
    # Half way between the labels.
    lo, hi = np.array([3.5, 2, 2]), np.array([7.0, 7, 7])
    opacity = 1 - 0.5 ** chords(camera, (24, 24), lo, hi)
    assert opacity.max() > 0.8
    assert np.abs(exact.rgba[..., 3] - opacity).max() < 1e-13
    assert np.all(np.abs(image.rgba[..., 3] - opacity) <= image.error_bound)


@pytest.mark.parametrize("up_there", [True, False])
def test_one_label_of_many(up_there):
    """Extinction only at one value, between jumps up and down that both are samples, or at that one alone."""
    labels = np.random.default_rng(0).integers(0, 4, (7, 8, 9)).astype(np.uint8)
    labels[1:5, 2:6, 3:8] = 2
    above = 3.0 if up_there else np.nextafter(2.0, 3)
    tf = wvr.TransferFunction([(2, "red", 0), (2, "red", 0.5), (above, "red", 0.5), (above, "red", 0)])
    volume = wvr.Volume(labels)
    camera = wvr.Camera.fit(volume)
    _, exact = assert_bounded(volume, tf, camera)
    opacity = 1 - 0.5 ** chords(camera, (24, 24), np.array([3.0, 2, 1]), np.array([7.0, 5, 4]))
    assert np.all(exact.rgba[..., 3] >= opacity - 1e-13)


@pytest.mark.parametrize("distance", [1e2, 1e5, 1e7, 1e8, 1e10, 1e12, 1e15])
def test_the_image_does_not_depend_on_how_far_a_parallel_camera_is(distance):
    volume = wvr.datasets.load("blobs", 16)
    tf = wvr.TransferFunction([(0, "black", 0.0), (90, "orange", 0.1), (255, "white", 0.5)])
    target = volume.corners.mean(0)
    way = np.array([1.0, 0.5, 0.25])  # doubles without rounding
    camera, near = (wvr.Camera(target + way * d, target, parallel_scale=14.0) for d in (distance, 16.0))
    _, exact = assert_bounded(volume, tf, camera)
    truth = wvr.render(volume, tf, near, (24, 24), integrator=EXACT)
    assert off(exact, truth.rgba).max() < 1e-13


@pytest.mark.parametrize("distance", [1e2, 1e5, 1e7, 1e8, 1e10, 1e12, 1e15])
def test_a_box_seen_from_far_away(distance):
    volume = wvr.Volume(np.ones((9, 9, 9), np.float32))
    tf = wvr.TransferFunction([(0, "red", 0.2), (2, "red", 0.2)])
    target = volume.corners.mean(0)
    angle = np.degrees(2 * np.arctan(8 / distance))
    camera = wvr.Camera(target + np.array([1.0, 0.5, 0.25]) * distance, target, view_angle=angle)
    _, exact = assert_bounded(volume, tf, camera)
    opacity = 1 - 0.8 ** chords(camera, (24, 24), 0.0, 8.0)
    assert opacity.max() > 0.8
    assert np.abs(exact.rgba[..., 3] - opacity).max() < 1e-12


@pytest.mark.parametrize("axis", range(3))
def test_a_long_thin_volume(axis):
    n = 20000
    shape = np.full(3, 2)
    shape[axis] = n
    volume = wvr.Volume(np.ones(shape[::-1], np.uint8))
    tf = wvr.TransferFunction([(0, "red", 1e-4), (2, "red", 1e-4)])
    middle = volume.corners.mean(0)
    way = np.full(3, 1e-5)
    way[axis] = 1.0
    camera = wvr.Camera(middle + way * 3 * n, middle, up=np.roll(np.eye(3)[axis], 1), parallel_scale=0.6)
    _, exact = assert_bounded(volume, tf, camera, (12, 12))
    opacity = -np.expm1(chords(camera, (12, 12), 0.0, shape - 1.0) * np.log1p(-1e-4))
    assert opacity.max() > 0.8
    assert np.abs(exact.rgba[..., 3] - opacity).max() < 1e-10


def product(n=9):
    """x y, which trilinear interpolation reproduces."""
    i = np.arange(n, dtype=float)
    return np.broadcast_to(i[None, :, None] * i[None, None, :], (n, n, n)).copy()


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-8, 1e-9, 1e-10])
@pytest.mark.parametrize("tolerance", [1 / 512, 1e-5])
def test_a_thin_spike_on_a_curved_field(width, tolerance):
    volume = wvr.Volume(product())
    at = 31.3
    end = at + width
    tf = wvr.TransferFunction(
        [(at, "red", 0), (at, "red", 0.5), (end, "red", 0.5), (end, "red", 0)], unit_distance=width / 8
    )
    camera = wvr.Camera([-40, -40, 4], [4, 4, 4], parallel_scale=3)
    image, exact = assert_bounded(volume, tf, camera, tolerance=tolerance)
    # Along (1, 1, 0) the field is u^2 - d^2 / 4, u the mean of x and y and d their difference.
    origins, _ = camera.rays((24, 24))
    d = origins[..., 0] - origins[..., 1]
    length = np.sqrt(2) * (end - at) / (np.sqrt(at + d**2 / 4) + np.sqrt(end + d**2 / 4))
    opacity = 1 - 0.5 ** (length / (width / 8))
    inside = np.sqrt(end + d**2 / 4) + np.abs(d) / 2 < 8
    assert inside.sum() > 200 and 0.5 < opacity.max() < 0.7
    rounding = 1e-13 / width
    assert np.abs(exact.rgba[..., 3] - opacity)[inside].max() < 1e-12 + rounding
    assert np.all((np.abs(image.rgba[..., 3] - opacity) <= image.error_bound + rounding)[inside])


@pytest.mark.parametrize("kind", ["up", "down", "both", "box"])
@pytest.mark.parametrize("width", [1e-6, 1e-9, 1e-11, 1e-12, 1e-13, 1e-14])
def test_dense_spikes_as_narrow_as_rounding(kind, width):
    """What rounding of the scalar does to steep slopes and to spikes that it may miss altogether."""
    volume = wvr.Volume(np.random.default_rng(3).random((7, 7, 7)) * 64)
    at = 31.3
    points = {
        "up": [(at - width, "red", 0), (at, "red", 0.5), (at, "blue", 0)],
        "down": [(at - width, "red", 0), (at - width, "red", 0.5), (at, "blue", 0)],
        "both": [(at - width, "red", 0), (at, "blue", 0.5), (at + width, "red", 0)],
        "box": [(at - width, "red", 0), (at - width, "red", 0.5), (at, "red", 0.5), (at, "red", 0)],
    }
    tf = wvr.TransferFunction(points[kind], unit_distance=width / 8)
    camera = wvr.Camera([-40, -41, 5.3], [3, 3, 3], parallel_scale=4)
    image, exact = assert_bounded(volume, tf, camera)
    assert exact.rgba.max() > 0.5
    assert exact.rgba.min() >= 0
    # Whatever it is, it is a colour.
    assert image.error_bound.max() < 1.01


@pytest.mark.parametrize("trial", range(24))
def test_rays_along_which_the_scalar_is_at_a_jump(trial):
    """Of an axis-parallel ray in samples that vary across it alone: interpolated, and so rounded to either side."""
    rng = np.random.default_rng(trial)
    n, axis = int(rng.integers(2, 9)), trial % 3
    samples = rng.random(n) if trial % 2 else np.arange(n) * 0.1
    shape = np.ones(3, int)
    shape[2 - axis] = n
    volume = wvr.Volume(np.broadcast_to(samples.reshape(shape), np.where(shape > 1, n, 4)).copy())
    middle = volume.corners.mean(0)
    scale = (n - 1) / 2 * float(rng.choice([1, 0.8, 0.5, 1.1]))
    camera = wvr.Camera(middle + 7 * np.eye(3)[axis - 2], middle, up=np.eye(3)[axis], parallel_scale=scale)
    x = camera.rays((2, 16))[0][:, 0, axis]
    for at in np.interp(x, np.arange(n), samples)[::3]:
        tf = wvr.TransferFunction([(-1, "red", 0), (at, "red", 0), (at, "white", 0.5), (2, "white", 0.5)])
        assert_bounded(volume, tf, camera, (2, 16))


@pytest.mark.parametrize("fill", [1e4, 1e10, 1e16, 1e20, 1e28])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_values_that_stand_for_missing_ones(fill, dtype):
    """A sample beyond all others makes its own cells uncertain, but no others."""
    samples = np.random.default_rng(0).random((6, 6, 6)).astype(dtype)
    tf = wvr.TransferFunction([(0, "red", 0.0), (0.3, "blue", 0.2), (0.5, "green", 0), (1, "white", 0.5)])
    camera = wvr.Camera.fit(wvr.Volume(samples))
    samples[3, 2, 2], samples[1, 4, 3] = fill, -fill
    image, exact = assert_bounded(wvr.Volume(samples), tf, camera)
    assert image.error_bound.max() <= 1 / 512
    # Where they are the scalar is beyond the control points nearly at once.
    samples[3, 2, 2], samples[1, 4, 3] = 1e8, -1e8
    near = wvr.render(wvr.Volume(samples), tf, camera, (24, 24), integrator=EXACT)
    assert off(exact, near.rgba).max() < (1e-2 if fill < 1e8 else 1e-5)


@pytest.mark.parametrize("trial", [13, 27, 59])
def test_cells_that_a_clip_leaves_nothing_of(trial):
    """Where a clip's face is a face of cells, a ray may have passed a cell's end but for rounding."""
    rng = np.random.default_rng(trial)
    samples = (rng.random((6, 5, 4)) < 0.1) * rng.random((6, 5, 4))
    volume = wvr.Volume(samples, spacing=10.0 ** rng.uniform(-1, 1, 3))
    width = 1e-13
    points = [(-0.5, "red", 0), (-width, "red", 0), (0, "blue", 0.9), (width, "red", 0), (2, "red", 0)]
    tf = wvr.TransferFunction(points, unit_distance=width * volume.smallest_spacing)
    axis = rng.integers(3)
    lo, hi = volume.corners.min(0), volume.corners.max(0) + 1
    lo[axis] += volume.spacing[axis] * rng.integers(1, volume.shape[2 - axis])
    camera = wvr.Camera.fit(volume, rng.normal(size=3), parallel=True)
    assert_bounded(volume, tf, camera, clip=wvr.ClipBox(lo, hi, invert=bool(trial % 2)))


@pytest.mark.parametrize("axis", range(3))
def test_rays_in_the_upper_face_of_the_box(axis):
    """Past empty blocks, where there are as many cells as whole blocks have, or not."""
    for n in (12, 13):
        along = (axis + 1) % 3
        shape = np.full(3, n)
        shape[along] = 21
        samples = np.zeros(shape)  # [x, y, z]
        across = np.moveaxis(samples, (axis, along), (0, 1))
        across[-1, 12:] = across[0, :2] = 200
        volume = wvr.Volume(samples.T.copy())
        tf = wvr.TransferFunction([(0, "red", 0), (100, "red", 0), (255, "red", 0.5)])
        middle = np.full(3, 6.0)
        middle[axis], middle[along] = n - 1, 10
        up = np.eye(3)[(axis + 2) % 3]
        camera = wvr.Camera(middle - 40 * np.eye(3)[along], middle, up=up, parallel_scale=1)
        images = [
            wvr.render(volume, tf, camera, (3, 3), skip_empty=skip, **how).rgba[1, 1]
            for skip in (True, False)
            for how in (
                {"integrator": EXACT},
                {"tolerance": 1e-3},
                {"tolerance": 1e-5},
                {"integrator": wvr.Riemann(0.5)},
            )
        ]
        assert images[0][3] > 0.9
        assert np.abs(np.array(images) - images[4]).max() < 0.05
        assert np.abs(images[0] - images[4]).max() < 1e-12


def test_the_longest_ray_of_a_sheared_box():
    direction = np.array([[1, -1, 0], [0, 0.05, 0], [0, 0, 1.0]])
    volume = wvr.Volume(np.full((3, 12, 12), 0.5), spacing=(1, 1, 0.05), direction=direction)
    ends = volume.index_to_world[:3, :3] @ [11, -11, 0] / 2
    middle = volume.corners.mean(0)
    camera = wvr.Camera(middle + 3 * ends, middle, parallel_scale=0.02)
    worst = 0.0
    for height in np.geomspace(1e-8, 1e-4, 33):
        tf = wvr.TransferFunction([(0, "white", 0), (0, "white", 1e-12), (0.5, "white", height), (1, "white", 1e-12)])
        _, exact = assert_bounded(volume, tf, camera, (5, 5), tolerance=2e-3)
        worst = max(worst, exact.rgba.max())
    assert worst > 0.01


def test_control_points_beside_large_ones():
    tf = wvr.TransferFunction([(0, "red", 0.0), (1e-13, "red", 0.9), (1e4, "red", 0.9)])
    for value, extinction in (
        (0.0, 0.0),
        (-1.0, 0.0),
        (5e-14, 0.5 * np.log(10)),
        (1e-13, np.log(10)),
        (7.0, np.log(10)),
    ):
        volume = wvr.Volume(np.full((5, 5, 5), value))
        camera = wvr.Camera.fit(volume)
        _, exact = assert_bounded(volume, tf, camera, (16, 16))
        opacity = -np.expm1(-extinction * chords(camera, (16, 16), 0.0, 4.0))
        assert np.abs(exact.rgba[..., 3] - opacity).max() < 1e-13


@pytest.mark.parametrize(
    "dtype, exponent, largest",
    [
        ("float64", -170, 1.0),  # of which single precision holds nothing,
        ("float64", -145, 1.0),  # or a few digits,
        ("float32", -149, 1.0),
        ("float64", -1074, 1.0),  # as double precision does
        ("float64", -1074, 2.0**100),  # where scalars are counted in another unit
    ],
)
@pytest.mark.parametrize("precision", ["auto", "float64"])
def test_samples_that_underflow_beside_control_points(dtype, exponent, largest, precision):
    camera = wvr.Camera(position=(9, 6, 12), target=(2, 2, 2), up=(0, 1, 0))

    def scene(samples, largest):
        # All that counts is the side of 0: the same for samples of any size.
        points = [(-largest, "red", 0.6), (0, "red", 0.6), (0, "red", 0.0), (largest, "red", 0.0)]
        return wvr.Volume(samples), wvr.TransferFunction(points), camera, (16, 16)

    noise = np.random.default_rng(5).integers(-9, 10, (5, 5, 5))
    for samples in (noise, np.full((5, 5, 5), -1)):
        truth = wvr.render(*scene(samples.astype(float), 10.0), integrator=EXACT).rgba
        little = np.ldexp(samples.astype(dtype), exponent)
        image = wvr.render(*scene(little, largest), tolerance=1e-3, precision=precision)
        assert truth[..., 3].max() > 0.3
        assert np.all(off(image, truth) <= image.error_bound + 1e-12)
    # What rounding cannot change is known.
    assert image.error_bound.max() < 1e-3


def test_little_samples_seen_from_where_cells_meet():
    # Cells that rays only touch, and colours as steep as single precision does not hold.
    samples = np.random.default_rng(0).random((4, 4, 4), np.float32) * np.float32(1e-30)
    points = [(-1e12, "blue", 0.5), (0.0, "red", 0.0), (1e-30, "lime", 0.5)]
    camera = wvr.Camera((1, 1, 1), (2, 1.7, 1.4), (0, 0, 1), 120.0)
    image, _ = assert_bounded(
        wvr.Volume(samples), wvr.TransferFunction(points), camera, (16, 16), tolerance=1e-2, precision="float32"
    )
    assert image.error_bound.max() < 1e-2


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 3e-7, 2e-7, 1e-7])
@pytest.mark.parametrize("precision", ["auto", "float32", "float64"])
@pytest.mark.parametrize("brightness", [1.0, 30.0])
def test_bounds_are_at_most_the_tolerance_or_it_is_refused(tolerance, precision, brightness):
    volume = wvr.datasets.load("blobs", 16)
    tf = wvr.TransferFunction([(0, (0, 0, 0), 0.0), (90, (1, 0.4, 0), 0.1), (255, (brightness, 1, 1), 0.5)])
    camera = wvr.Camera.fit(volume)
    options = {"tolerance": tolerance, "precision": precision}
    try:
        image = wvr.render(volume, tf, camera, (24, 24), **options)
    except ValueError as error:
        reachable = float(str(error).split("at least ")[1].split()[0].rstrip(":,"))
        assert tolerance < reachable < (3e-7 if precision == "float32" else 1e-7) * brightness
        options["tolerance"] = tolerance = 1.01 * reachable
        image = wvr.render(volume, tf, camera, (24, 24), **options)
    exact = wvr.render(volume, tf, camera, (24, 24), integrator=EXACT)
    assert image.error_bound.max() <= tolerance
    assert np.all(off(image, exact.rgba) <= image.error_bound)
    assert image.error_bound[exact.rgba[..., 3] > 0].min() > 0


@pytest.mark.parametrize("tolerance", [1e-9, 5e-8])
def test_a_tolerance_below_rounding_is_refused(tolerance):
    volume = wvr.datasets.load("blobs", 16)
    tf = wvr.TransferFunction([(0, "black", 0.0), (255, "white", 0.5)])
    with pytest.raises(ValueError, match=r"tolerance must be at least [\d.e-]+"):
        wvr.render(volume, tf, wvr.Camera.fit(volume), (4, 4), tolerance=tolerance, precision="float32")


def test_colours_that_an_image_cannot_hold_are_refused():
    volume = wvr.datasets.load("blobs", 8)
    for brightness in (1e35, 1e39, 1e150):
        tf = wvr.TransferFunction([(0, (brightness, 0, 0), 0), (255, (brightness, 1, 1), 0.5)])
        with pytest.raises(ValueError, match="colour"):
            wvr.render(volume, tf, wvr.Camera.fit(volume), (8, 8))
