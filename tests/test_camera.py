import copy
import dataclasses
import itertools
import pickle
import types

import mpmath
import numpy as np
import pytest
from vtkmodules.vtkRenderingCore import vtkCamera, vtkRenderer

import wvr
from wvr.camera import Camera, image_size

SIZES = [(7, 5), (5, 8), (6, 6), (1, 1)]


def vtk_camera(camera):
    vtk = vtkCamera()
    vtk.SetPosition(camera.position)
    vtk.SetFocalPoint(camera.target)
    vtk.SetViewUp(camera.up)
    vtk.SetViewAngle(camera.view_angle)
    if camera.parallel:
        vtk.ParallelProjectionOn()
        vtk.SetParallelScale(camera.parallel_scale)
    return vtk


def vtk_rays(camera, size):
    """Lines through the pixel centres by VTK's inverse projection: points on the near and on the far plane."""
    width, height = size
    vtk = vtk_camera(camera)
    distance = np.linalg.norm(camera.target - camera.position)
    vtk.SetClippingRange(0.5 * distance, 2 * distance)
    matrix = vtk.GetCompositeProjectionTransformMatrix(width / height, -1, 1)
    inverse = np.linalg.inv([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    x = (2 * np.arange(width) + 1) / width - 1
    y = 1 - (2 * np.arange(height) + 1) / height

    def unproject(depth):
        points = np.ones((height, width, 4))
        points[..., 0], points[..., 1], points[..., 2] = x, y[:, None], depth
        points = points @ inverse.T
        return points[..., :3] / points[..., 3:]

    return unproject(-1), unproject(1)


def random_cameras(parallel, count=20):
    rng = np.random.default_rng(4)
    for _ in range(count):
        position, target, up = rng.normal(size=(3, 3)) * [[30], [3], [5]]
        yield Camera(position, target, up, rng.uniform(2, 120), rng.uniform(0.1, 50) if parallel else None)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("parallel", [False, True])
def test_rays_are_vtks(parallel, size):
    for camera in random_cameras(parallel):
        origins, directions = camera.rays(size)
        near, far = vtk_rays(camera, size)
        assert origins.shape == directions.shape == (size[1], size[0], 3)
        assert origins.dtype == directions.dtype == np.float64
        np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-12)
        along = far - near
        length = np.linalg.norm(along, axis=-1, keepdims=True)
        np.testing.assert_allclose(directions, along / length, atol=1e-9)
        # The origin is on VTK's line.
        off_line = np.cross(origins - near, along / length)
        np.testing.assert_allclose(off_line, 0, atol=1e-9 * np.linalg.norm(camera.position - camera.target))


def test_parallel_origins_lie_on_the_plane_of_the_position():
    for camera in random_cameras(True):
        origins, directions = camera.rays((4, 3))
        np.testing.assert_allclose((origins - camera.position) @ camera.basis()[2], 0, atol=1e-12)
        np.testing.assert_array_equal(directions, np.broadcast_to(camera.basis()[2], directions.shape))


def test_orientation_by_hand():
    # Looking along +y with z up: the first pixel is at the left (-x) and the top (+z).
    origins, directions = Camera((0, -10, 0), (0, 0, 0), parallel_scale=3).rays((2, 3))
    np.testing.assert_allclose(origins[:, :, 0], [[-1, 1]] * 3, atol=1e-15)
    np.testing.assert_allclose(origins[:, :, 2], [[2, 2], [0, 0], [-2, -2]], atol=1e-15)
    np.testing.assert_allclose(directions, np.broadcast_to([0, 1, 0], (3, 2, 3)), atol=1e-15)


def test_basis_is_right_handed_and_orthonormal():
    for camera in random_cameras(False):
        right, up, forward = basis = np.stack(camera.basis())
        np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(np.cross(right, up), -forward, atol=1e-14)
        assert up @ camera.up > 0


def test_far_from_the_origin_keeps_its_precision():
    near = Camera((3, 4, 5), (0, 0, 0)).rays((4, 4))[1]
    far = Camera((1e6 + 3, 1e6 + 4, 1e6 + 5), (1e6, 1e6, 1e6)).rays((4, 4))[1]
    np.testing.assert_allclose(far, near, atol=1e-12)


def axis_aligned_volume():
    return wvr.Volume(np.zeros((4, 6, 9), np.uint8), spacing=(0.5, 1.5, 2.0), origin=(-3, 10, 2))


def vtk_reset(volume, direction, up, size):
    renderer = vtkRenderer()
    renderer.SetAspect(size[0] / size[1], 1)  # what a window would set; making one may need OpenGL
    camera = vtkCamera()
    renderer.SetActiveCamera(camera)
    camera.SetPosition(np.array(direction, float))
    camera.SetFocalPoint(0, 0, 0)
    camera.SetViewUp(up)
    lo, hi = volume.corners.min(axis=0), volume.corners.max(axis=0)
    renderer.ResetCamera(np.stack([lo, hi], axis=1).ravel())
    return camera


@pytest.mark.parametrize("size", [(400, 400), (640, 400), (300, 400)])
@pytest.mark.parametrize(
    "direction, up",
    [((1, 0.6, 0.4), (0, 0, 1)), ((0, -2, 0), (0.1, 0.2, 1)), ((0, 0, 3), (0, 0, 1)), ((0.01, 0, -1), (0, 0, 2))],
)
@pytest.mark.parametrize("parallel", [False, True])
def test_fit_is_vtks_reset(direction, up, parallel, size):
    volume = axis_aligned_volume()
    vtk = vtk_reset(volume, direction, up, size)
    camera = Camera.fit(volume, direction, up, parallel, aspect=size[0] / size[1])
    np.testing.assert_allclose(camera.position, vtk.GetPosition(), rtol=1e-12)
    np.testing.assert_allclose(camera.target, vtk.GetFocalPoint(), rtol=1e-12)
    np.testing.assert_allclose(camera.up / np.linalg.norm(camera.up), vtk.GetViewUp(), atol=1e-12)
    assert camera.view_angle == vtk.GetViewAngle()
    assert camera.parallel == parallel
    if parallel:
        assert camera.parallel_scale == pytest.approx(vtk.GetParallelScale(), rel=1e-12)


def test_fit_of_a_rotated_box_uses_the_box_itself():
    c, s = np.cos(0.7), np.sin(0.7)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    volume = wvr.Volume(np.zeros((4, 6, 9), np.uint8), (0.5, 1.5, 2.0), (-3, 10, 2), rotation)
    camera = Camera.fit(volume, parallel=True)
    extent = np.array([8, 5, 3]) * [0.5, 1.5, 2.0]
    assert camera.parallel_scale == pytest.approx(np.linalg.norm(extent) / 2, rel=1e-12)
    np.testing.assert_allclose(camera.target, rotation @ extent / 2 + [-3, 10, 2], rtol=1e-12)


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("size", [(400, 400), (640, 400), (300, 400)])
def test_fit_sees_every_corner(parallel, size):
    volume = axis_aligned_volume()
    camera = Camera.fit(volume, (0.2, -1, 0.3), parallel=parallel, view_angle=70, aspect=size[0] / size[1])
    right, up, forward = camera.basis()
    x, y, depth = ((volume.corners - camera.position) @ axis for axis in (right, up, forward))
    half = camera.parallel_scale if parallel else depth * np.tan(np.radians(camera.view_angle / 2))
    assert np.all(depth > 0)
    assert np.all(abs(y) <= half)
    assert np.all(abs(x) <= half * size[0] / size[1])


def test_fit_defaults():
    camera = Camera.fit(axis_aligned_volume())
    towards = camera.position - camera.target
    np.testing.assert_allclose(np.cross(towards, [1, 0.6, 0.4]), 0, atol=1e-12)
    assert towards[0] > 0
    assert not camera.parallel
    assert camera.view_angle == 30


def pyvista_like(**changes):
    fields = {
        "position": (1.0, 2.0, 3.0),
        "focal_point": (0.0, 0.5, 0.0),
        "up": (0.0, 1.0, 0.0),
        "view_angle": 25.0,
        "parallel_projection": False,
        "parallel_scale": 7.0,
    }
    return types.SimpleNamespace(**{**fields, **changes})


def test_from_pyvista():
    camera = Camera.from_pyvista(pyvista_like())
    np.testing.assert_array_equal(camera.position, (1, 2, 3))
    np.testing.assert_array_equal(camera.target, (0, 0.5, 0))
    np.testing.assert_array_equal(camera.up, (0, 1, 0))
    assert camera.view_angle == 25
    assert camera.parallel_scale is None
    assert Camera.from_pyvista(pyvista_like(parallel_projection=True)).parallel_scale == 7
    assert Camera.from_pyvista(types.SimpleNamespace(camera=pyvista_like())).view_angle == 25


def test_from_a_real_pyvista_camera():
    import pyvista as pv

    source = pv.Camera()
    source.position, source.focal_point, source.up = (4, -5, 6), (1, 0, 0), (0, 1, 1)
    source.view_angle = 50
    camera = Camera.from_pyvista(source)
    np.testing.assert_array_equal(camera.position, (4, -5, 6))
    np.testing.assert_array_equal(camera.target, (1, 0, 0))
    np.testing.assert_allclose(camera.up, np.array([0, 1, 1]) / np.sqrt(2))
    assert camera.view_angle == 50
    source.enable_parallel_projection()
    source.parallel_scale = 3
    assert Camera.from_pyvista(source).parallel_scale == 3


def test_from_pyvista_refuses_others():
    with pytest.raises(TypeError, match="camera must be a PyVista Camera or Plotter, got str"):
        Camera.from_pyvista("front")


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"position": (0, np.nan, 1)}, "position must be three finite numbers"),
        ({"position": (0, 1)}, "position must be three"),
        ({"target": (np.inf, 0, 0)}, "target must be three finite numbers"),
        ({"target": (1, 2, 3)}, "position must differ from target"),
        ({"up": (0, 0, 0)}, "up must not be zero"),
        ({"up": (-2, -4, -6)}, "up must not be parallel"),
        ({"up": "z"}, "up must be three numbers"),
        ({"view_angle": 0}, "view_angle must be"),
        ({"view_angle": 180}, "view_angle must be between 0 and 180 degrees, got 180"),
        ({"view_angle": -30}, "view_angle must be"),
        ({"view_angle": np.nan}, "view_angle must be"),
        ({"parallel_scale": 0}, "parallel_scale must be finite and > 0, got 0"),
        ({"parallel_scale": np.inf}, "parallel_scale must be"),
        ({"parallel_scale": 1e200}, r"parallel_scale must be within 1e\+150, got 1e\+200"),
        ({"target": (1e200, 0, 0)}, r"target must be within 1e\+150, got"),
        ({"position": (1, -1e151, 0)}, r"position must be within 1e\+150, got"),
    ],
)
def test_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Camera(**{"position": (1, 2, 3), "target": (0, 0, 0), **changes})


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("size", [1e30, 1e80, 1e150])
def test_as_large_as_cameras_are(size):
    """Whatever is that far away, or that far aside, the bound is not less than the error."""
    volume = wvr.Volume(np.random.default_rng(1).integers(0, 255, (4, 5, 6), np.uint8))
    tf = wvr.TransferFunction([(0, "navy", 0.05), (100, "white", 0.3), (255, "red", 0.7)])
    near, way = np.array([5.5, 3, 2.5]), np.array([-1.0, 0.2, -0.3])
    for camera, (width, height) in (
        (Camera(near, near + size * way), (3, 3)),
        (Camera(near, near + size * way, parallel_scale=3.0), (3, 3)),
        (Camera(near - size * way, near, parallel_scale=3.0), (3, 3)),
        (Camera(near - size * way, near + size * way), (3, 3)),
        (Camera(near, near + way, parallel_scale=size), (3, 3)),
        (Camera(near, near + way, parallel_scale=size), (20001, 1)),
    ):
        image = wvr.render(volume, tf, camera, (width, height))
        x, y = width // 2, height // 2
        pixel = wvr.enclose(volume, tf, camera, x, y, (width, height))
        off = np.maximum(pixel.lower - image.rgba[y, x], image.rgba[y, x] - pixel.upper).max()
        assert off <= image.error_bound[y, x]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"direction": (0, 0, 0)}, "direction must not be zero"),
        ({"direction": (0, np.nan, 0)}, "direction must be three finite numbers"),
        ({"up": (0, 0, 0)}, "up must not be zero"),
        ({"view_angle": 200}, "view_angle must be between 0 and 180"),
        ({"aspect": 0}, "aspect must be"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_fit_refuses(changes, message):
    with pytest.raises(ValueError, match=message):
        Camera.fit(axis_aligned_volume(), **changes)


@pytest.mark.parametrize("size", [(0, 5), (5, -1), (5,), (5, 5, 5), (5.0, 5), 5, "ab"])
def test_size_refused(size):
    with pytest.raises(ValueError, match="size must be"):
        Camera((1, 0, 0), (0, 0, 0)).rays(size)


@pytest.mark.parametrize("size", [(46336, 46336), (2**23, 240), (1, 2**23)])
def test_pixels_are_counted_in_32_bits(size):
    """In whole tiles, as kernels count them."""
    assert image_size(size) == size
    if min(size) > 1:
        with pytest.raises(
            ValueError, match=r"size must be .* of at most 2147483647 pixels, in whole tiles of 16 x 16"
        ):
            image_size((size[0], size[1] + 1))


@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3)))
def test_fit_finds_another_upward_direction(signs):
    """Of (1, -1, 1) the one that VTK takes is along it as well."""
    for up in (signs, np.negative(signs), np.add(signs, (1e-5, 0, 0))):
        camera = Camera.fit(axis_aligned_volume(), signs, up)
        np.testing.assert_allclose(np.cross(camera.basis()[2], signs), 0, atol=1e-12)
        assert abs(camera.up @ signs) < 0.99 * np.linalg.norm(camera.up) * np.sqrt(3)


def test_size_of_numpy_integers():
    assert image_size(np.array([3, 4])) == (3, 4)


def test_cameras_do_not_change():
    position = np.array([1.0, 2.0, 3.0])
    camera = Camera(position, (0, 0, 0))
    position[0] = 9
    assert camera.position[0] == 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        camera.view_angle = 20
    copies = [copy.copy(camera), copy.deepcopy(camera), *(pickle.loads(pickle.dumps(camera, n)) for n in range(6))]
    for one in (camera, *copies):
        for name in ("position", "target", "up"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(one, name)[0] = 9
        assert repr(one) == repr(camera)
    assert dataclasses.replace(camera, view_angle=20).view_angle == 20
    assert repr(camera) == "Camera((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0), view_angle=30.0)"


@pytest.mark.parametrize("angle", [1e-3, 1e-6, 1e-8, 2e-9])
def test_up_may_be_nearly_along_the_view(angle):
    """Directions across the view, in many digits."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        way, position = rng.normal(size=3), rng.normal(size=3) * 10
        way /= np.linalg.norm(way)
        up = way + angle * np.cross(way, rng.normal(size=3))
        try:
            camera = wvr.Camera(position, position + 7 * way, up)
        except ValueError:
            continue
        with mpmath.workdps(50):
            a = [mpmath.mpf(x) - mpmath.mpf(y) for x, y in zip(camera.target.tolist(), position.tolist(), strict=True)]
            b = [mpmath.mpf(x) for x in up.tolist()]
            cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
            length = mpmath.sqrt(sum(x * x for x in cross))
            right = [float(x / length) for x in cross]
        assert np.abs(camera.basis()[0] - right).max() < 4e-16


@pytest.mark.parametrize("angle", [1e-9, 1.0, 30.0, 90.0, 91.0, 179.0, 179.9999999, 180 - 2**-40])
def test_half_the_height_of_a_view_of_any_angle(angle):
    camera = wvr.Camera((0, 0, 9), (0, 0, 0), up=(0, 1, 0), view_angle=angle)
    with mpmath.workdps(50):
        truth = float(mpmath.tan(mpmath.mpf(angle) * mpmath.pi / 360))
    assert abs(camera.half_height - truth) <= 4e-16 * truth
