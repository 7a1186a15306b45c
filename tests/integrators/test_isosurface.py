"""Isosurfaces: crossings against enclosures and VTK's contours, and what theory says of them."""

import numpy as np
import pytest

import wvr
from wvr.defaults import Call

from ..helpers import centered
from ..scenes import volumes
from .probes import crossings, scene_of
from .test_projection import pixels

VOLUMES = volumes()
RED = wvr.TransferFunction([(-1e9, "red", 1.0), (1e9, "red", 1.0)])


def ball(n=24, dtype="float64"):
    """Distance from a place between samples, downwards: spheres are level sets of it."""
    k, j, i = np.indices((n, n, n))
    return centered((20 - np.sqrt((i - 0.47 * n) ** 2 + (j - 0.49 * n) ** 2 + (k - 0.48 * n) ** 2)).astype(dtype))


def colored(volume, opacity=(0.4, 0.7)):
    low, high = volume.range
    return wvr.TransferFunction([(low, (1, 0.2, 0), opacity[0]), (high, (0, 0.3, 1), opacity[1])])


def composite(found, tf, unit=1.0):
    """Colour and opacity of crossings from front to back."""
    rgba = np.zeros(4)
    for _, level, _ in found:
        opacity = -np.expm1(-tf.extinction(level, unit) * unit)
        rgba += (1 - rgba[3]) * opacity * np.append(tf.color(level), 1.0)
    return rgba


@pytest.mark.parametrize("name", ["noisy", "anisotropic", "holes"])
def test_crossings_are_those_of_the_field(name):
    """All of them, in order: colour and opacity to the bound, which is that of rounding, and the depth of the first."""
    volume = VOLUMES[name]
    low, high = volume.range
    levels = [low + part * (high - low) for part in (0.31, 0.52, 0.77)]
    tf = colored(volume)
    size = (24, 20)
    seen = 0
    for n, camera in enumerate(
        (
            wvr.Camera.fit(volume, (1, 0.6, 0.4)),
            wvr.Camera.fit(volume, (-0.3, 1, 0.1), parallel=True),
            wvr.Camera(volume.corners.mean(axis=0), volume.corners[0], view_angle=80),
        )
    ):
        image = wvr.render(
            volume, tf, camera, size, lighting=False, integrator=wvr.Isosurface(levels), precision="float64"
        )
        first = image.depth(1e-9)
        assert image.rgba.dtype == np.float64
        assert np.mean(image.error_bound < 1e-12) > 0.99
        forward = camera.basis()[2]
        for x, y in pixels(size, 12, n):
            found = crossings(scene_of(volume, tf), camera, size, (x, y), levels)
            expected = composite(found, tf, volume.smallest_spacing)
            assert np.abs(image.rgba[y, x] - expected).max() <= image.error_bound[y, x]
            assert np.isnan(first[y, x]) == (not found)
            if found:
                way = camera.unproject(x, y, 1.0, size) - camera.unproject(x, y, 0.0, size)
                if not camera.parallel:
                    way = camera.unproject(x, y, 1.0, size) - camera.position
                assert abs(first[y, x] - found[0][0] * (way @ forward) / np.linalg.norm(way)) < 1e-8
            seen += len(found)
    assert seen > 20


def test_depth_of_a_sphere():
    """That of the crossing of the trilinear field to 1e-6, and of the sphere to what interpolation is off by."""
    volume = ball()
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    size = (32, 32)
    image = wvr.render(volume, RED, camera, size, integrator=wvr.Isosurface(12.0))
    depth = image.depth()
    assert 0.1 < np.isfinite(depth).mean() < 0.5
    center = np.array([0.47, 0.49, 0.48]) * 24 - 11.5
    for x, y in pixels(size, 20):
        found = crossings(scene_of(volume, RED), camera, size, (x, y), [12.0])
        assert bool(found) == bool(np.isfinite(depth[y, x]))
        if found:
            point = camera.unproject(x, y, depth[y, x], size)
            assert abs(np.linalg.norm(point - camera.position) - found[0][0]) < 1e-6
            assert abs(np.linalg.norm(point - center) - 8) < 0.05
            picked = image.pick(x, y)
            assert np.allclose(picked.position, point) and picked.value == 12.0 and picked.opacity == 1.0


def test_agrees_with_a_contour_of_vtk():
    """Rays meet the triangles within a cell of where the field has the value."""
    pyvista = pytest.importorskip("pyvista")
    volume = ball()
    contour = volume.to_pyvista().contour([12.0])
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    size = (24, 24)
    depth = wvr.render(volume, RED, camera, size, integrator=wvr.Isosurface(12.0)).depth()
    met = 0
    for x, y in pixels(size, 60):
        far = camera.unproject(x, y, 200.0, size)
        points, _ = contour.ray_trace(camera.position, far, first_point=False)
        if len(points) and np.isfinite(depth[y, x]):
            near = min(np.linalg.norm(np.atleast_2d(points) - camera.position, axis=1))
            ours = np.linalg.norm(camera.unproject(x, y, depth[y, x], size) - camera.position)
            assert abs(ours - near) < 0.3
            met += 1
    assert met > 5 and isinstance(contour, pyvista.PolyData)


def test_opaque_surfaces_hide_what_is_behind():
    volume = ball()
    camera = wvr.Camera.fit(volume)
    tf = wvr.TransferFunction([(0, "red", 1.0), (11, "red", 1.0), (11, "blue", 0.3), (20, "blue", 0.3)])
    behind = wvr.render(volume, tf, camera, (16, 16), lighting=False, integrator=wvr.Isosurface([10, 12]))
    alone = wvr.render(volume, tf, camera, (16, 16), lighting=False, integrator=wvr.Isosurface([10]))
    assert np.array_equal(behind.rgba, alone.rgba) and set(np.unique(alone.rgba[..., 3])) == {0.0, 1.0}
    # From inside, blue is before red.
    inside = wvr.Camera(volume.corners.mean(axis=0), volume.corners[7])
    pixel = wvr.render(volume, tf, inside, (1, 1), lighting=False, integrator=wvr.Isosurface([10, 12])).rgba[0, 0]
    assert np.allclose(pixel, (0.7, 0, 0.3, 1), atol=1e-6)


def test_opacities_reach_what_depth_asks_for():
    volume = ball()
    camera = wvr.Camera.fit(volume)
    tf = wvr.TransferFunction([(0, "red", 0.4), (11, "red", 0.4), (11, "blue", 0.3), (20, "blue", 0.3)])
    image = wvr.render(volume, tf, camera, (9, 9), integrator=wvr.Isosurface([12, 10]))
    assert abs(image.rgba[4, 4, 3] - (1 - 0.42**2)) < 1e-6
    reached = [image.pick(4, 4, opacity).value for opacity in (0.3, 0.5, 0.7, 0.8)]
    assert reached == [10.0, 12.0, 12.0, 10.0]
    depths = [image.depth(opacity)[4, 4] for opacity in (0.3, 0.5, 0.7, 0.8)]
    assert depths == sorted(depths) and np.isnan(image.depth(0.9)[4, 4])


def test_light_is_that_of_the_gradient():
    """A headlight on a sphere: brightest where it faces the viewer, and Lambert's cosine elsewhere."""
    volume = ball(32)
    camera = wvr.Camera.fit(volume, (1, 0, 0), parallel=True)
    lighting = wvr.Lighting(ambient=0.0, diffuse=1.0, specular=0.0)
    size = (32, 32)
    image = wvr.render(volume, RED, camera, size, integrator=wvr.Isosurface(10.0), lighting=lighting)
    depth = image.depth()
    y, x = np.nonzero(np.isfinite(depth))
    points = camera.unproject(x, y, depth[y, x], size)
    normal = points - (np.array([0.47, 0.49, 0.48]) * 32 - 15.5)
    cosine = np.abs(normal @ camera.basis()[2]) / np.linalg.norm(normal, axis=1)
    assert np.abs(image.rgba[y, x, 0] - cosine).max() < 0.02
    assert "not light" in image.stats["bound_covers"]


def test_clips_labels_and_skipping():
    """What they leave, without surfaces where they cut."""
    volume = VOLUMES["noisy"]
    low, high = volume.range
    levels = [low + 0.4 * (high - low), low + 0.6 * (high - low)]
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    size = (24, 20)
    labels = np.zeros(volume.shape, np.uint8)
    labels[:, :, 8:20] = 1
    labels[:, 5:16, 20:] = 2
    functions = [colored(volume), colored(volume, (0.9, 0.1))]
    cuts = {
        "clip": [wvr.ClipPlane(volume.corners.mean(axis=0), (1, 0.3, 0.2)), wvr.ClipSphere((0, 0, 0), 8, invert=True)],
        "segmentation": wvr.Segmentation(labels, dict(zip((1, 2), functions, strict=True))),
    }
    for name, cut in cuts.items():
        tf = functions[0] if name == "clip" else None
        image, every = (
            wvr.render(
                volume,
                tf,
                camera,
                size,
                integrator=wvr.Isosurface(levels),
                precision="float64",
                lighting=False,
                skip_empty=skip,
                **{name: cut},
            )
            for skip in (True, False)
        )
        assert np.array_equal(image.rgba, every.rgba)
        assert np.mean(image.error_bound < 1e-12) > 0.98
        for x, y in pixels(size, 15):
            found = crossings(scene_of(volume, tf, **{name: cut}), camera, size, (x, y), levels)
            rgba = np.zeros(4)
            for _, level, state in found:
                one = functions[state]
                opacity = -np.expm1(-one.extinction(level))
                rgba += (1 - rgba[3]) * opacity * np.append(one.color(level), 1.0)
            assert np.abs(image.rgba[y, x] - rgba).max() <= image.error_bound[y, x], (name, x, y)


@pytest.mark.filterwarnings("ignore:nothing is visible")
def test_where_rounding_decides_the_bound_says_so():
    """Rays that touch a surface, begin in one or run along a face that lies in one; others cross one face to face."""
    x = np.abs(np.arange(-4, 5)).astype(np.uint8)
    parabola = centered(np.broadcast_to(x**2, (9, 9, 9)).copy())
    sideways = wvr.Camera((0, 0, 30), (0, 0, 0), up=(0, 1, 0), parallel_scale=1.5)
    touched = wvr.render(parabola, RED, sideways, (3, 3), lighting=False, integrator=wvr.Isosurface(1.0))
    # Rays in the plane x = 1, where all samples are 1.
    assert np.all(touched.error_bound[:, [0, 2]] >= 1) and np.all(touched.error_bound[:, 1] < 1e-6)
    # Across samples that are all at the level: one crossing, and no doubt.
    ramp = centered(np.indices((9, 9, 9), np.uint8)[0])
    through = wvr.render(ramp, RED, sideways, (3, 3), lighting=False, integrator=wvr.Isosurface(4.0))
    assert np.all(through.rgba[..., 3] == 1) and np.all(through.error_bound < 1e-6)
    assert np.abs(through.depth() - 30).max() < 1e-12
    # A valley whose bottom is at the level.
    valley = centered(np.broadcast_to(x[:, None, None], (9, 9, 9)).copy())
    bottom = wvr.render(valley, RED, sideways, (3, 3), lighting=False, integrator=wvr.Isosurface(0.0))
    assert np.all(bottom.error_bound >= 1)
    # A surface where a clip cuts.
    for place, least, most in ((0.0, 1.0, 2.0), (0.5, 0.0, 1e-6)):
        cut = wvr.render(
            ramp,
            RED,
            sideways,
            (3, 3),
            lighting=False,
            integrator=wvr.Isosurface(4.0),
            clip=wvr.ClipPlane((0, 0, place), (0, 0, -1)),
        )
        assert np.all((cut.error_bound >= least) & (cut.error_bound <= most)), place


def test_one_line():
    """Opaque, lit, framed, and as bright whatever the value; surfaces that go together differ."""
    volume = wvr.datasets.load("blobs", 24)
    low, high = volume.range
    for level in (low + 0.05 * (high - low), low + 0.6 * (high - low)):
        image = wvr.render(volume, size=(16, 16), integrator=wvr.Isosurface(level))
        assert image.background == "black" and image.rgba[..., 3].max() == 1
        shown = image.to_uint8()[image.rgba[..., 3] == 1]
        assert np.ptp(shown[:, 0]) > 40 and np.median(shown) > 120 and np.quantile(shown, 0.9) < 254
    several = Call(integrator=wvr.Isosurface([90, 120, 140])).look(volume, (8, 8)).transfer_function
    colors = several.color([90, 120, 140])
    assert (
        min(np.abs(colors[a] - colors[b]).max() for a, b in ((0, 1), (0, 2), (1, 2))) > 0.2
        and colors.max(1).min() > 0.5
    )
    assert repr(wvr.Isosurface([140, 90])) == "Isosurface(values=(90.0, 140.0))"


@pytest.mark.parametrize("values, message", [([], "one or more"), ([np.nan], "finite"), ("a", "numbers")])
def test_what_is_no_value(values, message):
    with pytest.raises((TypeError, ValueError), match=message):
        wvr.Isosurface(values)
