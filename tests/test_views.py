"""Views are where they are named, patients are seen from the front, and what is visible fills the frame."""

import hypothesis
import numpy as np
import pytest
import pyvista as pv
from hypothesis import strategies as st

import wvr
from wvr.defaults import Call, camera_of
from wvr.framing import MARGIN, framed, visible_points
from wvr.views import NAMES, WORLD, named_view, seen_from, suggested_view

# Nothing below 50.
SEEN = wvr.TransferFunction([(50, "red", 0.0), (100, "white", 0.5)])
vectors = st.tuples(*[st.floats(-1, 1)] * 3)


def box(low, high, shape=(40, 40, 40), **place):
    """A volume with 100 between two corners x, y, z."""
    values = np.zeros(shape, np.uint8)
    (x0, y0, z0), (x1, y1, z1) = low, high
    values[z0:z1, y0:y1, x0:x1] = 100
    return wvr.Volume(values, **place)


def test_far_away_and_tiny(points=((0, 0, 0), (1, 2, 3))):
    for scale, offset in ((1e-9, 0), (1, 1e9), (1e12, 0)):
        camera = framed(scale * np.array(points) + offset, (1, 1, 1), (0, 0, 1))
        x, y = camera.project(scale * np.array(points) + offset, (100, 100)).T
        assert np.all((x > 0) & (x < 99) & (y > 0) & (y < 99)) and max(np.ptp(x), np.ptp(y)) > 80


@hypothesis.settings(max_examples=60, deadline=None)
@hypothesis.given(
    st.lists(vectors, min_size=2, max_size=9),
    vectors,
    st.floats(0.3, 3),
    st.floats(5, 100),
    st.booleans(),
)
def test_all_points_are_in_the_frame_and_touch_its_edge(points, direction, aspect, angle, parallel):
    points = np.array(points)
    if np.linalg.norm(direction) < 0.1 or np.ptp(points, axis=0).max() < 0.1:
        return
    up = np.eye(3)[np.argmin(np.abs(direction))]
    camera = framed(points, direction, up, angle, aspect, parallel)
    height = 1000.0
    width = height * aspect
    x, y = camera.project(points, (max(1, round(width)), 1000)).T
    # Of the half image, in parts, from its middle.
    across = np.abs((2 * x + 1) / round(width) - 1)
    down = np.abs((2 * y + 1) / height - 1)
    assert np.all(np.isfinite(x)) and max(across.max(), down.max()) <= 1 - 2 * MARGIN + 0.01
    right, upward, forward = camera.basis()
    wide = max(np.ptp(points @ right), np.ptp(points @ upward))
    near, far = np.sort((points - camera.position) @ forward)[[0, -1]]
    # Unless nothing but the nearest point keeps the camera from coming nearer.
    if wide > 0.2 and (parallel or near > 2e-3 * (far - near)):
        assert max(across.max(), down.max()) >= 1 - 2 * MARGIN - 0.02


@pytest.mark.parametrize("parallel", [False, True])
def test_project_is_where_rays_go(parallel):
    camera = wvr.Camera((5, 2, 1), (0, 0.5, 0), (0, 1, 4), parallel_scale=2.5 if parallel else None)
    origins, directions = camera.rays((7, 5))
    pixels = camera.project(origins + 3.7 * directions, (7, 5))
    np.testing.assert_allclose(pixels[..., 0], np.arange(7)[None, :].repeat(5, 0), atol=1e-9)
    np.testing.assert_allclose(pixels[..., 1], np.arange(5)[:, None].repeat(7, 1), atol=1e-9)
    if not parallel:
        assert np.all(np.isnan(camera.project((20, 8, 4), (7, 5))))


def test_visible_points_are_around_what_is_visible():
    volume = box((8, 12, 20), (16, 20, 36), spacing=(1, 2, 0.5), origin=(3, 4, 5))
    low, high = np.array([8, 12, 20]), np.array([15, 19, 35])
    points = (visible_points(volume, SEEN) - volume.origin) / volume.spacing
    assert np.all(points.min(axis=0) <= low) and np.all(points.min(axis=0) >= low - 2)
    assert np.all(points.max(axis=0) >= high) and np.all(points.max(axis=0) <= high + 2)
    empty = wvr.Volume(np.zeros((4, 4, 4)))
    np.testing.assert_array_equal(visible_points(empty, SEEN), empty.corners)


@pytest.mark.parametrize("shape", [(60, 31, 47), (2, 9, 130), (5, 6, 7), (1, 40, 2)])
def test_a_frame_is_of_the_ends_of_what_is_visible(shape):
    """The same as of all of it: what is between others is on no edge of a frame."""
    rng = np.random.default_rng(5)
    corner = [-40.0] * 3
    all_of_it = wvr.ClipBox(corner, [400.0] * 3)
    for part in (0.0005, 0.01, 0.2):
        seen = rng.random(shape) < max(part, 4 / np.prod(shape))
        volume = wvr.Volume(np.uint8(100) * seen, spacing=(1, 2, 0.5))
        ends, points = visible_points(volume, SEEN), visible_points(volume, SEEN, [all_of_it])
        assert len(ends) <= len(points)
        for direction in rng.normal(size=(6, 3)):
            for parallel in (False, True):
                one, other = (framed(p, direction, (0, 0, 1), parallel=parallel) for p in (ends, points))
                np.testing.assert_allclose(one.position, other.position, rtol=1e-12, atol=1e-9)
                assert one.half_height == pytest.approx(other.half_height, rel=1e-12)


def test_what_is_cut_away_is_not_visible():
    volume = box((8, 8, 8), (32, 32, 32))
    clips = [wvr.ClipPlane((20, 0, 0), (-1, 0, 0)), wvr.ClipBox((0, 0, 0), (40, 15, 40)), wvr.ClipSphere((8, 8, 8), 20)]
    points = visible_points(volume, SEEN, clips)
    assert points[:, 0].max() <= 20 and points[:, 1].max() <= 15
    assert np.linalg.norm(points - 8, axis=1).max() <= 20 and points.min() <= 8
    points = visible_points(volume, SEEN, [wvr.ClipSphere((20, 20, 20), 15, invert=True)])
    assert np.linalg.norm(points - 20, axis=1).min() >= 15
    # Where nothing is left the frame is that of the whole.
    nothing = visible_points(volume, SEEN, [wvr.ClipSphere((0, 0, 0), 1)])
    for edge in (np.min, np.max):
        np.testing.assert_array_equal(edge(nothing, axis=0), edge(visible_points(volume, SEEN), axis=0))


def test_labels_are_visible_where_their_functions_are():
    volume = box((0, 0, 0), (40, 40, 40))
    labels = np.zeros((40, 40, 40), np.uint8)
    labels[10:20, 12:22, 14:24] = 5
    points = visible_points(volume, wvr.Segmentation(labels, {5: SEEN}))
    assert np.all(points.min(axis=0) >= (12, 10, 8)) and np.all(points.max(axis=0) <= (26, 24, 22))
    np.testing.assert_array_less(visible_points(volume, wvr.Segmentation(labels, {7: SEEN}, SEEN)).min(axis=0), 1)


def test_the_image_is_filled():
    """Of a small thing in a large volume: by a picture."""
    image = wvr.render(box((4, 4, 4), (14, 10, 8)), SEEN, size=(96, 64), integrator=wvr.Riemann(1.0))
    rows, columns = np.nonzero(image.rgba[..., 3] > 0.01)
    assert max(np.ptp(rows) / 64, np.ptp(columns) / 96) > 0.7
    assert rows.min() > 0 and rows.max() < 63 and columns.min() > 0 and columns.max() < 95


@pytest.mark.parametrize("name", WORLD)
def test_views_are_those_of_pyvista(name):
    plotter = pv.Plotter(off_screen=True)
    plotter.add_mesh(pv.Cube())
    plotter.camera_position = name
    theirs = wvr.Camera.from_pyvista(plotter.camera)
    plotter.close()
    ours = camera_of(name, box((10, 10, 10), (30, 30, 30)), SEEN, 1.0)
    np.testing.assert_allclose(ours.basis(), theirs.basis(), atol=1e-6)


@pytest.mark.parametrize(("axes", "left", "back"), [("LPS", 1, 1), ("RAS", -1, -1)])
def test_patients_are_seen_as_named_whatever_the_files_axes(axes, left, back):
    volume = box((10, 10, 10), (30, 30, 30))
    volume.anatomical = axes
    towards = {
        "anterior": (0, -back, 0),
        "posterior": (0, back, 0),
        "left": (left, 0, 0),
        "right": (-left, 0, 0),
        "superior": (0, 0, 1),
        "inferior": (0, 0, -1),
    }
    for name, direction in towards.items():
        camera = camera_of(name, volume, SEEN, 1.0)
        np.testing.assert_allclose(-camera.basis()[2], direction, atol=1e-12)
        assert camera.basis()[1] @ (0, 0, 1) > 0.99 or camera.basis()[1] @ (0, -back, 0) > 0.99
    right, up, forward = camera_of(None, volume, SEEN, 1.0).basis()
    assert forward[1] * back > 0.8 and up[2] > 0.9 and right[0] * left > 0.8


def test_a_patients_view_needs_a_patient():
    with pytest.raises(ValueError, match="camera='left' needs a volume whose file says how the patient lies"):
        named_view("left", box((1, 1, 1), (3, 3, 3)))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1, 1])
def test_what_stands_on_a_side_is_seen_upright(axis, side):
    """A ball on a plate that touches a face of the box."""
    values = np.zeros((32, 32, 32), np.uint8)
    z, y, x = np.ogrid[:32, :32, :32]
    values[(x - 16) ** 2 + (y - 16) ** 2 + (z - 16) ** 2 < 60] = 100
    plate = [slice(4, 28)] * 3
    plate[2 - axis] = slice(0, 3) if side < 0 else slice(29, 32)
    values[tuple(plate)] = 100
    view = suggested_view(wvr.Volume(values))
    np.testing.assert_array_equal(view.up, np.eye(3)[axis] * -side)
    assert 0 < view.direction @ view.up < np.linalg.norm(view.direction)


def test_a_view_is_the_same_whatever_a_volume_is_seen_with():
    """A bright ball on a plate that only some transfer functions show, beneath a dark lid that only others do."""
    values = np.zeros((32, 32, 32), np.uint8)
    z, y, x = np.ogrid[:32, :32, :32]
    values[29:, 4:28, 4:28] = 60
    values[(x - 16) ** 2 + (y - 16) ** 2 + (z - 16) ** 2 < 60] = 200
    values[4:28, :3, 4:28] = 200
    volume = wvr.Volume(values)
    labels = wvr.Segmentation(wvr.Volume((values > 100).astype(np.uint8)), {1: SEEN})
    lid = wvr.TransferFunction([(40, "red", 0.0), (50, "red", 0.5), (70, "red", 0.5), (80, "red", 0.0)])
    bright = wvr.TransferFunction([(150, "red", 0.0), (160, "red", 0.5)])
    wanted = suggested_view(volume)
    for shown in (None, lid, bright, "ct-bone", "viridis", labels):
        call = Call(segmentation=labels) if shown is labels else Call(shown)
        for method in (None, wvr.Projection("max"), wvr.Isosurface(100)):
            right, up, forward = call._replace(integrator=method).look(volume, (8, 8)).camera.basis()
            assert -forward @ wanted.direction == pytest.approx(np.linalg.norm(wanted.direction))
            assert abs(right @ wanted.up) < 1e-12 and up @ wanted.up > 0.5
    values[:] = np.flip(values, 1)  # what was known of other samples is not
    np.testing.assert_array_equal(suggested_view(volume).up, -wanted.up)


@pytest.mark.parametrize("axis", range(3))
def test_what_is_tall_stands_and_what_is_flat_is_seen_from_its_face(axis):
    low, high = [16, 16, 16], [24, 24, 24]
    low[axis], high[axis] = 4, 36
    np.testing.assert_array_equal(suggested_view(box(low, high)).up, np.eye(3)[axis])
    low, high = [4, 4, 4], [36, 36, 36]
    low[axis], high[axis] = 18, 22
    view = suggested_view(box(low, high))
    # From its face where it lies on the ground, else upright.
    if axis == 2:
        assert view.direction[2] > 0.8 * np.linalg.norm(view.direction)


def test_simulations_have_z_upwards():
    volume = box((2, 16, 16), (38, 24, 24))
    np.testing.assert_array_equal(suggested_view(wvr.Volume(volume.numpy().astype(np.float32))).up, (0, 0, 1))


@pytest.mark.parametrize(("x", "y"), [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_simulations_are_seen_from_where_they_are_dense(x, y):
    """A plume that gets thinner away from an edge of the box, in which it is smooth."""
    zs, ys, xs = np.meshgrid(*[np.linspace(-1, 1, 32)] * 3, indexing="ij")
    field = np.exp(1.5 * x * xs + 1.2 * y * ys - 3 * zs**2)
    direction = suggested_view(wvr.Volume(field.astype(np.float32))).direction
    assert direction[0] * x > 0 and direction[1] * y > 0 and direction[2] > 0


def test_a_patient_of_few_slices_is_seen_from_the_head():
    volume = box((4, 4, 18), (36, 36, 22))
    volume.anatomical = "LPS"
    assert suggested_view(volume).direction[2] < 2 * np.abs(suggested_view(volume).direction[1])
    thin = wvr.Volume(volume.numpy()[18:22].copy())
    thin.anatomical = "LPS"
    view = suggested_view(thin)
    assert view.direction[2] > 2 * -view.direction[1] > 0 and view.up @ (0, 0, 1) == 1


def test_a_single_slice_is_seen_along_its_normal():
    for axis in range(3):
        shape = [9, 9, 9]
        shape[2 - axis] = 1
        volume = wvr.Volume(np.full(shape, 100, np.uint8))
        view = suggested_view(volume)
        np.testing.assert_allclose(np.abs(view.direction), np.eye(3)[axis])
        assert view.up @ view.direction == 0
        volume.anatomical = "LPS"
        expected = {0: "left", 1: "anterior", 2: "inferior"}[axis]
        np.testing.assert_array_equal(suggested_view(volume), named_view(expected, volume))


def test_orbits():
    volume = box((10, 10, 10), (30, 30, 30))
    whole = wvr.Camera.fit(volume, (1, 0, 0))
    np.testing.assert_allclose(wvr.Camera.orbit(volume, 0, 0).position, whole.position)
    camera = wvr.Camera.orbit(volume, 90, 30)
    direction = -camera.basis()[2]
    np.testing.assert_allclose(direction, [0, np.cos(np.pi / 6), 0.5], atol=1e-12)
    np.testing.assert_allclose(wvr.Camera.orbit(volume, 450, 30).position, camera.position)
    volume.anatomical = "LPS"
    np.testing.assert_allclose(-wvr.Camera.orbit(volume, 0, 0).basis()[2], (0, -1, 0), atol=1e-12)
    with pytest.raises(ValueError, match="elevation must be"):
        wvr.Camera.orbit(volume, 0, 90)


@pytest.mark.parametrize("elevation", [88.0, -89.0, 89.9999999, -(90 - 1e-13)])
def test_orbits_do_not_turn_about_the_view_next_to_a_pole(elevation):
    """What is to the right stays there, in cameras and in movies."""
    volume = box((10, 10, 10), (30, 30, 30))
    for azimuth in (0.0, 90.0, 200.0):
        right = wvr.Camera.orbit(volume, azimuth, 0).basis()[0]
        np.testing.assert_allclose(wvr.Camera.orbit(volume, azimuth, elevation).basis()[0], right, atol=1e-12)
    tf = wvr.TransferFunction([(0, "black", 0.0), (255, "white", 0.2)])
    level, polar = (
        next(wvr.orbit(volume, tf, frames=1, elevation=above, size=(24, 8), integrator=wvr.Riemann(2.0)))
        for above in (0.0, elevation)
    )
    right, *_ = polar.shown.camera.basis()
    np.testing.assert_allclose(right, level.shown.camera.basis()[0], atol=1e-12)
    assert not polar.rgba[:, [0, -1], 3].any() and polar.rgba[..., 3].any()


@pytest.mark.parametrize("scale", [None, 3.0])
def test_cameras_to_pyvista_and_back(scale):
    camera = wvr.Camera((5, 2, 1), (0, 0.5, 0), (0, 1, 4), 40, scale)
    back = wvr.Camera.from_pyvista(camera.to_pyvista())
    np.testing.assert_allclose(back.basis(), camera.basis(), atol=1e-12)
    np.testing.assert_allclose(back.position, camera.position)
    assert (back.view_angle, back.parallel_scale) == (pytest.approx(40), scale)


def test_cameras_in_other_words():
    volume = box((10, 10, 10), (30, 30, 30))
    camera = wvr.Camera((50, 2, 1), (0, 0.5, 0), (0, 1, 4))
    plotter = pv.Plotter(off_screen=True)
    plotter.camera = camera.to_pyvista()
    for given in (camera, camera.to_pyvista(), plotter, plotter.camera_position, [(50, 2, 1), (0, 0.5, 0), (0, 1, 4)]):
        same = camera_of(given, volume, SEEN, 1.0)
        np.testing.assert_allclose(same.basis(), camera.basis(), atol=1e-9)
        np.testing.assert_allclose(same.position, camera.position, atol=1e-9)
    plotter.close()
    for direction in ((1, 2, 3), (0, 0, -2)):
        found = -camera_of(direction, volume, SEEN, 1.0).basis()[2]
        np.testing.assert_allclose(found, np.array(direction) / np.linalg.norm(direction), atol=1e-9)
    assert len(set(NAMES)) == 13


def test_a_direction_along_z_is_seen_with_y_upwards():
    """As the view "xy"; and so is what is 1 degree from it, where z would say little of what is upwards."""
    cases = [((0, 0, 3), 1), ((0, 0.05, -3), 1), ((0, 0.3, 3), 2), ((1e200, 0, 0), 2), ((0, 0, 1e-300), 1)]
    for direction, up in cases:
        view = seen_from(direction)
        np.testing.assert_array_equal(view.direction, direction)
        np.testing.assert_array_equal(view.up, np.eye(3)[up])
