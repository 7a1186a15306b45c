"""Clips by isosurfaces of other volumes, that cut rays or segments, against planes and dense sampling."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base.reference import trilinear
from wvr.kernels.cuts.partial import PARTS

from ..helpers import SMOOTH, along, block, centered, constant, every_kind, max_error, middle, ramp


@every_kind
def test_a_plane_and_the_volume_of_that_plane(device, integrator, blobs):
    volume = centered(blobs.numpy())
    normal, offset = np.array([0.6, -0.64, 0.48]), 1.234
    plane = wvr.ClipPlane(offset * normal, normal)
    # Linear along its own last axis, which is the normal; of the type that kernels without clip volumes name as well.
    turn = np.linalg.qr(np.column_stack([normal, np.eye(3)[:, :2]]))[0][:, ::-1]
    turn[:, 2] = normal
    spacing = np.array([3.1, 2.7, 2.9])
    values = np.broadcast_to(12 * np.arange(21, dtype=np.uint8)[:, None, None], (21, 21, 21))
    field = wvr.Volume(values, spacing, -turn @ (10 * spacing), turn)
    iso = 12 * (offset / spacing[2] + 10)
    camera = wvr.Camera.fit(volume, (0.5, 1, 0.7))
    images = [
        wvr.render(volume, SMOOTH, camera, (32, 24), integrator=integrator, clip=clip, device=device)
        for clip in (plane, wvr.ClipVolume(field, iso))
    ]
    assert max_error(images[0], images[1].rgba) < 1e-5 and images[0].rgba[..., 3].max() > 0.5
    inverted = wvr.render(
        volume, SMOOTH, camera, (32, 24), integrator=integrator, clip=wvr.ClipVolume(field, iso, invert=True)
    )
    other = wvr.ClipPlane(plane.point, plane.normal, invert=True)
    expected = wvr.render(volume, SMOOTH, camera, (32, 24), integrator=integrator, clip=other)
    assert max_error(inverted, expected.rgba) < 1e-5


def field_length(volume, clip, camera, size, n=4000):
    """Visible length by dense sampling of the clip field and bisection between samples."""
    origins, directions = camera.rays(size)
    to_index = np.linalg.inv(clip.volume.index_to_world)
    result = np.zeros(origins.shape[:2])

    def inside(t, o, d):
        points = (o + t[:, None] * d) @ to_index[:3, :3].T + to_index[:3, 3]
        low, high = clip.volume.index_box
        within = np.all((points >= low) & (points <= high), axis=-1)
        above = trilinear(clip.volume.numpy(), np.clip(points, low, high)) >= clip.iso
        return (within & above) != clip.invert

    to_volume = np.linalg.inv(volume.index_to_world)
    for pixel in np.ndindex(*result.shape):
        o, d = origins[pixel], directions[pixel]
        i, v = to_volume[:3, :3] @ o + to_volume[:3, 3], to_volume[:3, :3] @ d
        near, far = (np.sort([(bound - i) / v for bound in volume.index_box], axis=0)[k] for k in (0, 1))
        near, far = max(near.max(), 0 if not camera.parallel else -np.inf), far.min()
        if far <= near:
            continue
        t = np.linspace(near, far, n)
        seen = inside(t, o, d)
        change = np.flatnonzero(seen[1:] != seen[:-1])
        a, b, first = t[change], t[change + 1], seen[change]
        for _ in range(50):
            c = (a + b) / 2
            same = inside(c, o, d) == first
            a, b = np.where(same, c, a), np.where(same, b, c)
        cuts = np.concatenate([[near], (a + b) / 2, [far]])
        result[pixel] = np.diff(cuts)[0 if seen[0] else 1 :: 2].sum()
    return result


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_clip_volume(seed):
    """Random samples, resolution and pose, reaching beyond the volume or not, thin ones too."""
    rng = np.random.default_rng(seed)
    volume = block()
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    spacing, shape = rng.uniform(0.8, 4, 3), rng.integers(1, 12, 3)
    origin = middle(volume) - turn @ (spacing * (shape[::-1] - 1) / 2) + rng.normal(0, 2, 3)
    field = wvr.Volume(rng.integers(0, 256, shape, np.uint8), spacing, origin, turn)
    clip = wvr.ClipVolume(field, rng.uniform(60, 200), invert=bool(rng.random() < 0.5))
    camera = wvr.Camera.fit(volume, rng.normal(size=3), rng.normal(size=3), parallel=bool(rng.random() < 0.5))
    image = wvr.render(volume, constant(0.1), camera, (6, 5), integrator=wvr.Exact(), clip=clip)
    expected = 1 - 0.9 ** field_length(volume, clip, camera, (6, 5))
    # Where the reference's samples miss a stretch, it is off by no more than a few of their distances.
    off = np.abs(image.rgba[..., 3] - expected)
    assert np.median(off) < 1e-9 and off.max() < 2e-3


def test_clip_volumes_of_any_dtype(device, blobs):
    """Of one dtype and of several, in an intersection."""
    camera = wvr.Camera.fit(blobs)
    fields = [ramp(np.array([0.6, 0.0, 0.8]), 0.5), ramp(np.array([0.0, 1.0, 0.0]), -0.5)]
    fields = [wvr.Volume(f.numpy(), (4, 4, 4), (-10, -10, -10)) for f in fields]

    def rendered(dtypes):
        typed = [wvr.Volume(f.numpy().astype(t), f.spacing, f.origin) for f, t in zip(fields, dtypes, strict=True)]
        clips = [wvr.ClipVolume(f, 0.25) for f in typed]
        return wvr.render(blobs, SMOOTH, camera, (16, 16), integrator=wvr.Exact(), clip=clips, device=device)

    both = rendered(("float64", "float64"))
    assert max_error(rendered(("float32", "float64")), both.rgba) < 1e-5
    assert both.rgba.any()


# Segments cut one by one, after the paper


def parts_error(parts, volume, tf, step, clip_volume):
    camera = wvr.Camera.fit(volume, (0.4, 1, 0.6), parallel=True)
    scene = volume, tf, camera, (24, 24)
    exact = wvr.render(*scene, integrator=wvr.Exact(), clip=wvr.ClipVolume(clip_volume, 0.0))
    clip = wvr.ClipVolume(clip_volume, 0.0, parts=parts)
    image = wvr.render(*scene, integrator=wvr.Preintegrated(step), clip=clip, termination=0)
    return np.abs(image.rgba - exact.rgba).max(axis=(0, 1))


@pytest.mark.parametrize("step", [0.37, 2.0])
def test_opacity_of_cut_segments(step):
    """T^b is exact for a clip field linear along a ray, colour by b is not; what ignores the length is far off."""
    volume = centered(np.full((9, 9, 9), 100, np.uint8))
    tf = wvr.TransferFunction([(0, (1, 0.5, 0.2), 0.9), (255, (1, 0.5, 0.2), 0.9)], unit_distance=1.0)
    field = ramp(np.array([0.0, 0.6, 0.8]), 0.7)
    off = {parts: parts_error(parts, volume, tf, step, field) for parts in PARTS}
    assert off["length"].max() < 1e-6 and off["ratio"].max() < 1e-6
    assert off["power"][3] < 1e-6 < 0.02 < off["power"][0]
    assert off["first-order"][3] > 0.02 and off["isosurface"][3] > 0.2


def test_parts_approach_exact_with_the_step(blobs):
    """With thin segments all but "isosurface" do: "length" with order 2, colour by b with the segments' depth."""
    volume = centered(blobs.numpy())
    field = ramp(np.array([0.6, 0.0, 0.8]), 0.7, (30, 30, 30), (1.2, 1.2, 1.2))
    for parts, order in (("length", 1.8), ("ratio", 1.8), ("power", 1.8), ("first-order", 1.8)):
        coarse, fine = (parts_error(parts, volume, SMOOTH, step, field).max() for step in (0.5, 0.125))
        assert np.log(coarse / fine) / np.log(4) > order, parts


@pytest.mark.parametrize("mode", ["interpolated", "center"])
def test_light_of_cut_segments(mode):
    """One segment, cut in the middle: each half has the light of its own middle, and both together that of the mean."""
    z, _, x = np.indices((2, 5, 5))
    volume = centered(100 + 20.0 * z * (x - 2) + 5 * x)
    tf = wvr.TransferFunction([(0, (1, 0.5, 0.2), 0.4), (255, (1, 0.5, 0.2), 0.4)])
    field = ramp(np.array([0.0, 0.0, 1.0]), 0.0)
    light = wvr.DirectionalLight((1, 0, 0))

    def rendered(mode, **clip):
        clips = [wvr.ClipVolume(field, 0.0, parts="first-order", **clip)] if clip else None
        camera, lighting = along(2), wvr.Lighting(mode, light, ambient=0.1, diffuse=0.8, specular=0.3)
        how = {"integrator": wvr.Preintegrated(1.0), "lighting": lighting, "precision": "float64", "termination": 0}
        return wvr.render(volume, tf, camera, (5, 5), clip=clips, **how).rgba[1:-1, 1:-1]

    near, far, whole = rendered(mode, invert=False), rendered(mode, invert=True), rendered("average")
    np.testing.assert_allclose(near + far, whole, rtol=0, atol=1e-9)
    assert np.abs(near - far)[..., :3].max() > 0.02 and np.abs(near - far)[..., 3].max() < 1e-9


def test_cut_segments_are_lit_without_coefficients():
    tf = wvr.TransferFunction.from_arrays([0, 1], [[1, 1, 1]] * 2, [0.1, 0.2], diffuse=[0.5, 1.0])
    clip = wvr.ClipVolume(ramp(np.array([0.0, 0.0, 1.0]), 0.0), parts="ratio")
    how = {"integrator": wvr.Preintegrated(1.0), "lighting": wvr.Lighting(), "clip": clip}
    with pytest.raises(ValueError, match="clip with parts is lit without coefficients"):
        wvr.render(centered(np.ones((3, 3, 3))), tf, along(2), (2, 2), **how)
