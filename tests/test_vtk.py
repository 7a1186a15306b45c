"""The same camera shows the same pixels in VTK: catches mirrored axes, half-pixel shifts and wrong orientations."""

import subprocess
import sys

import numpy as np
import pytest

import wvr

SIZE = (150, 110)
UNIT_DISTANCE = 2.0
# Opacity is linear between VTK's control points and extinction between ours: close points make them one.
SCALARS = np.arange(256.0)
OPACITY = 0.9 * SCALARS / 255


@pytest.fixture(scope="module", autouse=True)
def needs_opengl():
    """Without OpenGL a render window may crash the process, so another process tries it first."""
    try_it = "import pyvista; pyvista.Plotter(off_screen=True).screenshot(return_img=True)"
    try:
        trial = subprocess.run([sys.executable, "-c", try_it], capture_output=True, timeout=120)
    except subprocess.TimeoutExpired:
        pytest.skip("VTK's off-screen rendering hangs")
    if trial.returncode != 0:
        pytest.skip(f"VTK cannot render off-screen (it needs EGL, OSMesa or X): exit status {trial.returncode}")


def rotation():
    """Turned about all three axes: no axis of the volume stays on one of the world."""
    a, b, c = 0.5, -0.4, 0.9
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def make_volume(direction=None):
    """A bar along each axis, all of other lengths, from one corner block: no mirror image and no turn is the same."""
    data = np.zeros((12, 15, 18), np.uint8)
    data[2:5, 2:5, 2:16] = 255
    data[2:5, 2:13, 2:5] = 255
    data[2:9, 2:4, 2:4] = 255
    return wvr.Volume(data, spacing=(1.5, 1.0, 2.0), origin=(10.0, -20.0, 5.0), direction=direction)


def make_camera(volume, parallel):
    camera = wvr.Camera.fit(volume, (0.8, 1.0, 0.6), (0.3, 0.1, 1.0), parallel=parallel, view_angle=40)
    # Off the volume's centre, so that a mirrored image cannot match by symmetry of the view.
    right, up, _ = camera.basis()
    shift = 3.0 * right - 2.0 * up
    return wvr.Camera(
        camera.position + shift, camera.target + shift, camera.up, camera.view_angle, camera.parallel_scale
    )


def vtk_opacity(volume, camera, size):
    """Opacity (height, width) by VTK's GPU ray caster: brightness of a white volume on black."""
    import pyvista as pv
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction

    grid = pv.ImageData(dimensions=volume.dimensions, spacing=volume.spacing, origin=volume.origin)
    grid.direction_matrix = volume.direction
    grid.point_data["values"] = volume.numpy().ravel()
    plotter = pv.Plotter(off_screen=True, window_size=size, lighting=None)
    try:
        plotter.set_background("black")
        actor = plotter.add_volume(
            grid,
            cmap=["white"],
            clim=(0, 255),
            opacity_unit_distance=UNIT_DISTANCE,
            show_scalar_bar=False,
            mapper="gpu",
        )
        opacity = vtkPiecewiseFunction()
        for scalar, value in zip(SCALARS, OPACITY, strict=True):
            opacity.AddPoint(scalar, value)
        actor.prop.SetScalarOpacity(opacity)
        actor.prop.SetInterpolationTypeToLinear()
        actor.mapper.SetAutoAdjustSampleDistances(False)
        actor.mapper.SetSampleDistance(0.05)
        plotter.camera.position, plotter.camera.focal_point = camera.position, camera.target
        plotter.camera.up, plotter.camera.view_angle = camera.up, camera.view_angle
        if camera.parallel:
            plotter.camera.enable_parallel_projection()
            plotter.camera.parallel_scale = camera.parallel_scale
        plotter.renderer.reset_camera_clipping_range()
        return plotter.screenshot(return_img=True)[..., 0] / 255
    finally:
        plotter.close()


@pytest.mark.parametrize("parallel", [False, True], ids=["perspective", "parallel"])
@pytest.mark.parametrize("direction", [None, rotation()], ids=["straight", "rotated"])
def test_same_pixels(direction, parallel):
    volume = make_volume(direction)
    camera = make_camera(volume, parallel)
    expected = vtk_opacity(volume, camera, SIZE)
    transfer_function = wvr.TransferFunction.from_arrays(SCALARS, np.ones((256, 3)), OPACITY, UNIT_DISTANCE)
    image = wvr.render(volume, transfer_function, camera, size=SIZE, integrator=wvr.Preintegrated(0.1))
    opacity = image.rgba[..., 3]
    difference = abs(opacity - expected)
    assert np.count_nonzero(expected > 0.5) > 700
    # VTK rounds to eight bits, steps and filters its texture with low precision.
    assert difference.max() < 0.02
    assert np.count_nonzero((opacity > 0.5) != (expected > 0.5)) <= 5
    # Half a pixel to the side would not pass.
    assert abs((opacity[:, 1:] + opacity[:, :-1]) / 2 - expected[:, 1:]).max() > 0.1
    assert abs((opacity[1:] + opacity[:-1]) / 2 - expected[1:]).max() > 0.1


def test_meshes_end_rays():
    """Fog in front of a board that stands askew: as deep as the board is at each pixel, whatever the camera."""
    import pyvista as pv

    volume = wvr.Volume(np.full((20, 20, 20), 100, np.uint8), origin=(-9.5, -9.5, -9.5))
    tf = wvr.TransferFunction([(0, "white", 0.1), (255, "white", 0.1)], unit_distance=1.0)
    normal = np.array([0.8, 0.5, 0.3])
    board = pv.Plane(center=(1, 0, 0), direction=normal, i_size=60, j_size=60)
    for parallel in (False, True):
        plotter = pv.Plotter(off_screen=True, window_size=(60, 50))
        plotter.add_mesh(board)
        plotter.camera_position = [(30, 20, 16), (0, 1, -1), (0, 0, 1)]
        if parallel:
            plotter.camera.enable_parallel_projection()
            plotter.camera.parallel_scale = 8.0
        plotter.show(auto_close=False)
        depth, camera = -plotter.get_image_depth(), wvr.Camera.from_pyvista(plotter)
        plotter.close()
        image = wvr.render(volume, tf, camera, (60, 50), depth=depth, integrator=wvr.Exact())
        clip = wvr.ClipPlane((1, 0, 0), normal)
        expected = wvr.render(volume, tf, camera, (60, 50), clip=clip, integrator=wvr.Exact())
        # VTK puts polygons behind where they are, by some 1e-4 of its clipping range; half a pixel would be 0.02.
        assert np.abs(image.rgba - expected.rgba).max() < 4e-3 and image.rgba.any()
