"""Projections: against NumPy along the axes, against enclosures on any ray, and what theory says of them."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

import wvr
import wvr.frame
from wvr.field.tops import Tops
from wvr.keep import Keeper
from wvr.kernels.field.climb import LEVELS
from wvr.launch import get_device

from ..extending.marschner_lobb import Half, MarschnerLobb
from ..helpers import centered
from ..scenes import volumes
from .probes import project, scene_of

GREY = wvr.TransferFunction([(0, "black", 1.0), (255, "white", 1.0)])
SPAN = wvr.TransferFunction([(-1e9, "black", 1.0), (1e9, "white", 1.0)])
WHAT = ("max", "min", "mean", "sum")
VOLUMES = volumes()


def image_of(volume, what, camera, size=(24, 20), **options):
    return wvr.render(volume, SPAN, camera, size, integrator=wvr.Projection(what), **options)


def held(image, what, scene, camera, pixels):
    """That values of pixels are as near to the truth as their bounds say; the number of them."""
    height, width = image.values.shape
    for x, y in pixels:
        truth = project(scene, camera, (width, height), (x, y))
        value, bound = image.values[y, x], image.error_bound[y, x]
        if truth is None:
            assert np.isnan(value)
            continue
        middle, radius = truth[what]
        assert radius < 1e-20 * (1 + abs(middle))
        assert abs(value - middle) <= bound, (what, x, y)
    return len(pixels)


def pixels(size, count, seed=0):
    rng = np.random.default_rng(seed)
    return [(int(rng.integers(size[0])), int(rng.integers(size[1]))) for _ in range(count)]


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float16", "float64"])
def test_maximum_along_an_axis(dtype):
    """That of the samples, which is where it is taken."""
    samples = np.random.default_rng(1).integers(0, 120, (9, 11, 13)).astype(dtype)
    camera = wvr.Camera((6, 5, 50), (6, 5, 4), up=(0, 1, 0), parallel_scale=5.5)
    image = wvr.render(wvr.Volume(samples), GREY, camera, (13, 11), integrator=wvr.Projection("max"))
    expected = samples.max(axis=0)[::-1].astype(np.float64)
    assert np.array_equal(image.values, expected)
    assert np.allclose(image.rgba[..., 0], expected / 255, atol=1e-6) and np.all(image.rgba[..., 3] == 1)
    nearest = 8 - np.argmax(samples[::-1], axis=0)[::-1]
    assert np.abs(image.depth() - (50 - nearest)).max() < 1e-9
    assert np.all(image.error_bound[1:-1, 1:-1] < 1e-9)
    # Rounding decides whether rays in a face meet the volume.
    assert np.all(np.isinf(image.error_bound[0]))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("what", ["min", "mean", "sum"])
def test_others_along_an_axis(axis, what):
    """Minima of samples, and means and integrals by the trapezoidal rule, which is exact between samples."""
    samples = np.random.default_rng(2).integers(0, 256, (8, 10, 12)).astype(np.uint8)
    h = 0.7
    volume = wvr.Volume(samples, (h, h, h))
    middle = h * (np.array(samples.shape[::-1]) - 1) / 2
    ahead, up = 2 - axis, (4 - axis) % 3
    camera = wvr.Camera(
        middle + 40 * np.eye(3)[ahead], middle, np.eye(3)[up], parallel_scale=h * volume.dimensions[up] / 2
    )
    width, height = volume.dimensions[3 - ahead - up], volume.dimensions[up]
    image = image_of(volume, what, camera, (width, height))
    lines = np.moveaxis(samples.astype(float), axis, -1)
    integral = np.trapezoid(lines, axis=-1) * h
    expected = {"min": lines.min(-1), "sum": integral, "mean": integral / (h * (samples.shape[axis] - 1))}[what]
    # Rays in the faces of the volume may miss it.
    x, y = (n.ravel() for n in np.meshgrid(np.arange(1, width - 1), np.arange(1, height - 1)))
    index = np.rint(camera.unproject(x, y, np.full(x.shape, 40.0), (width, height)) / h).astype(int)[:, ::-1]
    along_axis = np.delete(index, axis, axis=1)
    off = np.abs(image.values[y, x] - expected[tuple(along_axis.T)])
    assert off.max() < 1e-11 and np.all(off <= image.error_bound[y, x])


@pytest.mark.parametrize("what", WHAT)
@pytest.mark.parametrize("name", ["noisy", "anisotropic", "holes"])
def test_any_ray_is_within_its_bound(what, name):
    volume = VOLUMES[name]
    size = (24, 20)
    for n, camera in enumerate(
        (
            wvr.Camera.fit(volume, (1, 0.6, 0.4)),
            wvr.Camera.fit(volume, (-0.3, 1, 0.1), parallel=True),
            wvr.Camera(volume.corners.mean(axis=0), volume.corners[0], view_angle=80),
        )
    ):
        image = image_of(volume, what, camera, size)
        held(image, what, scene_of(volume, SPAN), camera, pixels(size, 12, n))
        low, high = volume.range
        known = np.isfinite(image.error_bound)
        length = volume.longest * volume.smallest_spacing if what == "sum" else 1.0
        assert known.mean() > 0.99 and image.error_bound[known].max() < 1e-6 * max(abs(low), high) * length


CLIPS = {
    "plane and ball": lambda v: [
        wvr.ClipPlane(v.corners.mean(axis=0), (1, 0.3, 0.2)),
        wvr.ClipSphere(v.corners.mean(axis=0), 14.0, invert=True),
    ],
    "volume": lambda v: wvr.ClipVolume(
        centered(np.random.default_rng(5).integers(0, 256, (6, 6, 6), np.uint8), (7, 7, 7)), 127.5
    ),
}


@pytest.mark.parametrize("what", ["max", "mean"])
@pytest.mark.parametrize("name", CLIPS)
def test_clips_are_exact(what, name):
    volume = VOLUMES["noisy"]
    clip = CLIPS[name](volume)
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    image = image_of(volume, what, camera, clip=clip)
    held(image, what, scene_of(volume, SPAN, clip), camera, pixels((24, 20), 12))
    assert np.median(image.error_bound[np.isfinite(image.values)]) < 1e-6


def test_the_tree_of_the_longest_axis_has_room():
    """A node of a level is as long as four of the one below, and one of the last is as long as an axis may be."""
    assert 4**LEVELS >= 2**31 - 2


def test_trees_of_any_number_of_cells_are_arrays():
    """Which have less than 2^31 of anything along an axis: there may be more cells than that."""
    volume, keep = VOLUMES["noisy"], Keeper(get_device("cpu"))
    low, high = volume.range
    codes = keep(Tops(volume.part(), 1, low, high, True)).codes
    assert codes.size >= np.prod(np.array(volume.shape) - 1) and max(codes.shape) <= codes.size // 64


def test_labels_leave_out_what_has_no_transfer_function():
    volume = VOLUMES["noisy"]
    labels = np.zeros(volume.shape, np.uint8)
    labels[:, :, 8:20] = 1
    labels[:, 5:16, 20:] = 2
    red = wvr.TransferFunction([(0, "red", 0.5), (255, "red", 0.5)])
    segmentation = wvr.Segmentation(labels, {1: red, 2: SPAN})
    camera = wvr.Camera.fit(volume, (0.2, 0.1, 1))
    for what in ("max", "mean"):
        image = image_of(volume, what, camera, segmentation=segmentation)
        held(image, what, scene_of(volume, None, None, segmentation), camera, pixels((24, 20), 12))
    image = image_of(volume, "max", camera, segmentation=segmentation)
    colored = image.rgba[..., 3] == 1
    assert np.any(image.rgba[colored, 1] == 0) and np.any(image.rgba[colored, 1] > 0)
    with pytest.raises(ValueError, match="transfer_function must be given besides a segmentation"):
        wvr.render(volume, None, camera, (4, 4), integrator=wvr.Projection("sum"), segmentation=segmentation)


@pytest.mark.parametrize("what", WHAT)
def test_nothing_that_counts_is_skipped(what):
    volume = wvr.datasets.load("blobs", 40)
    camera = wvr.Camera.fit(volume)
    some, every = (image_of(volume, what, camera, (40, 40), skip_empty=skip) for skip in (True, False))
    assert np.allclose(some.values, every.values, rtol=1e-13, atol=0, equal_nan=True)


@pytest.mark.parametrize("what", ["max", "min"])
def test_of_equal_values_in_long_volumes_the_nearest_is_taken(what):
    """Whole numbers of few values, in a tree of more levels along one axis than along others; nothing is missed."""
    samples = np.random.default_rng(4).integers(0, 7, (5, 270, 18)).astype(np.uint8)
    samples[:, 100:160] = 3
    middle = np.array((8.5, 134.5, 2))
    for away in ((12, 400, 3), (-9, -400, 2)):
        camera = wvr.Camera(middle + away, middle, (0, 0, 1), parallel_scale=4)
        some, every = (image_of(wvr.Volume(samples), what, camera, (12, 9), skip_empty=skip) for skip in (True, False))
        assert np.isfinite(some.values).sum() > 40
        assert np.array_equal(some.values, every.values, equal_nan=True)
        assert np.array_equal(some.depth(), every.depth(), equal_nan=True)


def test_smallest_is_the_largest_of_the_negative():
    samples = np.random.default_rng(3).normal(size=(9, 10, 11))
    camera = wvr.Camera.fit(wvr.Volume(samples))
    low = image_of(wvr.Volume(samples), "min", camera).values
    high = image_of(wvr.Volume(-samples), "max", camera).values
    assert np.array_equal(low, -high, equal_nan=True)
    mean = image_of(wvr.Volume(samples), "mean", camera).values
    seen = np.isfinite(mean)
    assert np.all(low[seen] <= mean[seen]) and np.all(
        mean[seen] <= -image_of(wvr.Volume(-samples), "min", camera).values[seen]
    )


def test_integral_of_a_constant_is_its_length():
    """Of a box's chord, which is known."""
    volume = wvr.Volume(np.full((5, 6, 7), 3.0), (2, 2, 2))
    straight = wvr.Camera((6, 50, 4), (6, 5, 4), parallel_scale=3)
    image = image_of(volume, "sum", straight, (5, 5))
    assert np.allclose(image.values, 3.0 * 10, atol=1e-12)
    slanted = wvr.Camera((6, 5 + 30, 4 + 30), (6, 5, 4), up=(1, 0, 0), parallel_scale=0.5)
    image = image_of(volume, "sum", slanted, (1, 1))
    assert abs(image.values[0, 0] - 3.0 * 8 * np.sqrt(2)) < 1e-11


@pytest.mark.parametrize("shape", [(1, 9, 8), (1, 1, 9), (2, 2, 2)])
def test_thin_volumes(shape):
    samples = np.random.default_rng(4).integers(0, 255, shape).astype(np.uint8)
    volume = centered(samples)
    camera = wvr.Camera.fit(volume, (0.3, 0.2, 1))
    image = image_of(volume, "max", camera)
    held(image, "max", scene_of(volume, SPAN), camera, pixels((24, 20), 10))
    assert np.nanmax(image.values) <= samples.max()


def test_far_cameras_and_far_worlds_see_the_same():
    samples = np.random.default_rng(6).integers(0, 255, (12, 13, 14)).astype(np.uint8)
    near = wvr.Volume(samples)
    center = near.corners.mean(axis=0)
    way = np.array([0.5, 0.7, 0.3])
    base = image_of(near, "max", wvr.Camera(center + 40 * way, center, parallel_scale=8))
    away = image_of(near, "max", wvr.Camera(center + 4e8 * way, center, parallel_scale=8))
    at = np.array([1e6, -3e5, 2e6])
    moved = image_of(
        wvr.Volume(samples, origin=tuple(at)), "max", wvr.Camera(center + at + 40 * way, center + at, parallel_scale=8)
    )
    for image in (away, moved):
        sure = np.isfinite(image.error_bound + base.error_bound + base.values)
        assert sure.sum() > 100
        off = np.abs(image.values - base.values)[sure]
        assert np.all(off <= (image.error_bound + base.error_bound)[sure]) and off.max() < 1e-4


def test_absent_samples_are_not_there():
    samples = np.full((6, 6, 6), 5.0, np.float32)
    samples[:, :, 3] = np.nan
    samples[0, 0, 0] = np.inf
    volume = wvr.Volume(samples, nan="transparent")
    camera = wvr.Camera((2.5, 2.5, 30), (2.5, 2.5, 2.5), up=(0, 1, 0), parallel_scale=2)
    for what in WHAT:
        values = image_of(volume, what, camera, (11, 11)).values
        # Cells that have one of the absent samples for a corner, from 2 to 4.
        assert np.all(np.isnan(values[:, 4:8])) and np.all(np.isfinite(values[:, :3]))


def test_magnitudes():
    """Of any size, far beyond those of the colours, and with one sample far from all others."""
    base = np.random.default_rng(7).normal(size=(6, 7, 8))
    camera = wvr.Camera.fit(wvr.Volume(base))
    for scale in (1e-300, 1e-30, 1e30, 1e90):
        ours = image_of(wvr.Volume(base * scale), "max", camera)
        assert np.allclose(
            ours.values / scale, image_of(wvr.Volume(base), "max", camera).values, rtol=1e-12, equal_nan=True
        )
        assert np.nanmax(ours.error_bound[np.isfinite(ours.error_bound)]) < 2e-11 * scale + 1e-300
    outlier = base.copy()
    outlier[3, 3, 3] = 1e20
    image = image_of(wvr.Volume(outlier), "min", camera)
    held(image, "min", scene_of(wvr.Volume(outlier), SPAN), camera, pixels((24, 20), 8))


@pytest.mark.parametrize("what", WHAT)
def test_samples_that_underflow_along_a_long_cell(what):
    """Coefficients are off by 5e-324, and values by that times cubes of a ray's length in a cell."""
    samples = np.random.default_rng(1).random((6, 3, 3))
    for scale, unit, longer in ((1e-312, 1.0, 1e12), (1e-308, 1.0, 1e12), (1e-308, 1e-10, 1.0), (1e-320, 1e-30, 1e3)):
        volume = wvr.Volume(scale * samples, spacing=(unit, unit, unit * longer))
        middle = np.array([1, 1, 2.5]) * volume.spacing
        camera = wvr.Camera(middle * [1, 1, 5], middle, up=(0, 1, 0), parallel_scale=0.4 * unit)
        image = image_of(volume, what, camera, (1, 1))
        along = [Fraction(float(s)) for s in scale * samples[:, 1, 1]]
        total = sum((a + b) / 2 for a, b in pairwise(along))
        length = Fraction(float(volume.spacing[2]))
        truth = {"max": max(along), "min": min(along), "mean": total / 5, "sum": total * length}[what]
        assert abs(Fraction(image.values[0, 0]) - truth) <= Fraction(image.error_bound[0, 0])


@pytest.mark.parametrize("what", ["mean", "sum"])
def test_products_that_underflow_along_a_short_ray(what):
    """Of lengths with what is seen in them: of a ray through the edge of a box, all that there is."""
    short, unit = 2.0**-30, 2.0**40
    samples = np.random.default_rng(4).random((3, 3, 3)) * 2.0**-1050
    volume = wvr.Volume(samples, spacing=(unit,) * 3)
    target = np.array([0, 2 - short, 1]) * unit
    camera = wvr.Camera(target - np.array([8, 8, 0]) * unit, target, parallel_scale=unit)
    image = image_of(volume, what, camera, (1, 1))
    truth = samples[1, 2, 0] * (np.sqrt(2) * short * unit if what == "sum" else 1.0)
    assert abs(image.values[0, 0] - truth) <= image.error_bound[0, 0] + 1e-8 * truth
    assert image.values[0, 0] == 0 and image.error_bound[0, 0] < 2**30 * truth


@pytest.mark.parametrize("what", WHAT)
def test_denormal_samples(what):
    """Along any ray through long cells."""
    volume = wvr.Volume(np.random.default_rng(8).normal(size=(5, 6, 7)) * 1e-312, (1, 60, 60))
    middle, along = volume.corners.mean(axis=0), np.array((1, 60, 48))
    camera = wvr.Camera(middle + 9 * along, middle, parallel_scale=1.5)
    image = image_of(volume, what, camera)
    assert held(image, what, scene_of(volume, SPAN), camera, pixels((24, 20), 60)) == 60
    assert np.isfinite(image.error_bound).all()


@pytest.mark.parametrize("what", WHAT)
def test_rays_cross_cells_however_long(what):
    """By next to nothing of a cell a unit of length, yet several of them on their way."""
    spacing = np.array([1e-20, 1.0, 1e20])
    volume = wvr.Volume(np.random.default_rng(2).random((4, 4, 4)), spacing)
    camera = wvr.Camera(spacing * (11.5, 7.5, 21.5), spacing * 1.5, up=(1, 2, 3), parallel_scale=1e-20)
    image = image_of(volume, what, camera, (3, 3))
    assert held(image, what, scene_of(volume, SPAN), camera, [(0, 0), (1, 1), (2, 1)]) == 3
    assert np.ptp(image.values) > 0 and image.error_bound.max() < np.inf


def test_one_line():
    """Grey over the range of what there is; no light, opacities do not matter, and black behind."""
    volume = wvr.datasets.load("blobs", 24)
    image = wvr.render(volume, size=(16, 16), integrator=wvr.Projection("max"))
    assert image.background == "black" and np.nanmax(image.rgba[..., 0]) > 0.9
    total = wvr.render(volume, size=(16, 16), integrator=wvr.Projection("sum"))
    assert 0.2 < np.nanmax(total.rgba[..., 0]) < 2
    mapped = wvr.render(volume, "viridis", "iso", (16, 16), clim=(0, 100), integrator=wvr.Projection("mean"))
    assert set(np.unique(mapped.rgba[..., 3])) == {0.0, 1.0}


class Cells(MarschnerLobb):
    """Which says what it is inside a cell."""

    @property
    def half(self):
        return InCells()


class InCells(Half):
    cubic = seek = climb = Half.value


def test_what_it_cannot_do():
    volume = wvr.datasets.load("blobs", 16)
    with pytest.raises(
        ValueError, match="what must be one of 'max', 'min', 'mean', 'sum', got 'mex'; did you mean 'max'"
    ):
        wvr.Projection("mex")
    with pytest.raises(ValueError, match="light does not change"):
        wvr.render(volume, GREY, integrator=wvr.Projection(), lighting=True)
    # They had none, without a word.
    for shadows in (True, wvr.ConvolutionShadows(image="slices")):
        for integrator in (wvr.Projection(), wvr.Isosurface(100)):
            with pytest.raises(ValueError, match="shadows must be None for " + repr(integrator)[:9]):
                wvr.render(volume, GREY, integrator=integrator, shadows=shadows)
    # Of which differences or sums overflow: there was nothing to be seen, or an infinite mean, within a bound.
    huge = wvr.Volume(np.where(np.indices((3, 3, 3)).sum(axis=0) % 2, 1.7e308, -1.7e308))
    wide = wvr.TransferFunction([(0, "black", 0), (1e308, "white", 1)])
    for integrator in (*map(wvr.Projection, ("max", "mean")), wvr.Isosurface(0)):
        with pytest.raises(ValueError, match=r"volume has samples from -1.7e\+308 .* up to 1e\+200"):
            wvr.render(huge, wide, wvr.Camera.fit(huge), (8, 8), integrator=integrator)
    with pytest.raises(ValueError, match="only samples the volume"):
        wvr.render(MarschnerLobb(), GREY, wvr.Camera.fit(MarschnerLobb()), integrator=wvr.Projection())
    with pytest.raises(ValueError, match=r"a MarschnerLobb does not say what it is inside a cell \(cubic\)"):
        wvr.render(MarschnerLobb(), GREY, wvr.Camera.fit(MarschnerLobb()), integrator=wvr.Projection("sum"))
    # That says it, but not which ranges its blocks have.
    for integrator in (*map(wvr.Projection, WHAT), wvr.Isosurface(0.5)):
        with pytest.raises(ValueError, match=r"only samples the volume, .* a Cells does not say .* \(blocks\)"):
            wvr.render(Cells(), GREY, wvr.Camera.fit(Cells()), (4, 4), integrator=integrator)
    image = image_of(volume, "mean", wvr.Camera.fit(volume), (8, 8))
    with pytest.raises(ValueError, match="somewhere on a ray"):
        image.depth()
    picked = image.pick(4, 4)
    assert picked.value == image.values[4, 4] and np.all(np.isnan(picked.position))


@pytest.mark.parametrize("what", ["max", "min"])
def test_an_edge_that_is_touched_is_not_of_the_ray(what):
    """Of the one cell that is present a ray meets an edge, over no length: it sees nothing."""
    samples = np.full((4, 4, 4), np.nan, np.float32)
    samples[:2, :2, :2] = 1.0
    volume = wvr.Volume(samples, nan="transparent")
    edge, forward = np.array([1.0, 1.0, 0.5]), np.array([1.0, -1.0, 0.0])
    for aside, seen in ((0.0, False), (-0.1, True)):
        target = edge + aside * np.array([1.0, 1.0, 0.0])
        camera = wvr.Camera(target - 10 * forward, target, (0, 0, 1), parallel_scale=1.0)
        image = wvr.render(volume, SPAN, camera, (1, 1), integrator=wvr.Projection(what))
        assert np.isfinite(image.values[0, 0]) == seen


@pytest.mark.parametrize("what", ["max", "min"])
def test_infinite_samples_are_absent_as_nan_is(what):
    """Also where a ray is first looked at in the place of the one beside."""
    samples = VOLUMES["holes"].numpy()
    camera = wvr.Camera.fit(VOLUMES["holes"], (1, 0.6, 0.4))
    expected = image_of(VOLUMES["holes"], what, camera).values
    for absent in (np.inf, -np.inf):
        other = wvr.Volume(np.where(np.isnan(samples), np.float32(absent), samples), nan="transparent")
        assert np.array_equal(image_of(other, what, camera).values, expected, equal_nan=True)


def test_rays_one_by_one_find_what_vectors_do(monkeypatch):
    camera = wvr.Camera.fit(VOLUMES["holes"], (1, 0.6, 0.4))
    image = image_of(VOLUMES["holes"], "min", camera, device="cpu")
    halves = wvr.frame.Frame.halves
    monkeypatch.setattr(wvr.frame.Frame, "halves", lambda self, *args: replace(halves(self, *args), vectors=False))
    other = image_of(VOLUMES["holes"], "min", camera, device="cpu")
    assert np.isfinite(image.values).sum() > 100
    off = np.abs(image.values - other.values)
    assert np.all((off <= image.error_bound + other.error_bound) | np.isnan(off))
    assert np.array_equal(np.isnan(image.values), np.isnan(other.values))


def test_a_camera_at_the_face_of_absent_cells_sees_nothing_in_them():
    """Though rays beside, and the sample that it is at, have a value there."""
    z, y, x = np.indices((9, 9, 9))
    samples = (5 + abs(x - 4) + abs(y - 4) + abs(z - 4)).astype(np.float32)
    samples[:, :, :4] = np.nan
    camera = wvr.Camera((4, 4, 4), (4, 0, 4), (0, 0, 1), view_angle=60)  # right is towards smaller x
    volume = wvr.Volume(samples, nan="transparent")
    image = wvr.render(volume, SPAN, camera, (12, 5), integrator=wvr.Projection("min"))
    assert np.all(image.values[:, :6] == 5) and np.isnan(image.values[:, 6:]).all()


def test_cells_that_are_touched_to_rounding_where_a_ray_begins_are_not_its_own(monkeypatch):
    """Vectors take over where the pixel beside had its smallest value, if the ray runs there: as one by one has it."""
    halves = wvr.frame.Frame.halves
    for seed in (714, 1268, 3097):
        rng = np.random.default_rng(seed)
        data = rng.random((5, 6, 7)).astype("float32")
        data[rng.random(data.shape) < 0.05] = np.nan
        at = rng.integers(1, 4, 3).astype(float)
        camera = wvr.Camera(at, at + rng.normal(size=3), (0, 0, 1), 90.0)
        volume = wvr.Volume(data, nan="transparent")
        values = []
        for vectors in (True, False):
            if not vectors:
                monkeypatch.setattr(wvr.frame.Frame, "halves", lambda *args: replace(halves(*args), vectors=False))
            image = wvr.render(volume, None, camera, (16, 4), integrator=wvr.Projection("min"))
            values.append(image.values)
            monkeypatch.setattr(wvr.frame.Frame, "halves", halves)
        np.testing.assert_allclose(values[0], values[1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("what", ["max", "min"])
def test_a_ray_that_ends_where_the_box_begins_may_meet_nothing(what):
    """By rounding it is in there for 1e-10 of a voxel: with absent samples the bound says so as without."""
    samples = np.random.default_rng(1).integers(0, 255, (2, 4, 6)).astype(np.float32)
    samples[0, 0, 0] = np.nan
    volume = wvr.Volume(samples, (0.03,) * 3, (1.95, 0.4, 0.85), nan="transparent")
    top = Fraction(0.85) + Fraction(0.03)
    for x, y, height in (
        ("0x1.0a8b563c357b3p+1", "0x1.d4aebf058e3f8p-2", "0x1.7f81740668456p+16"),
        ("0x1.f9cd34c9f6899p+0", "0x1.dfe3763ec0a8ap-2", "0x1.13017b03cb9fdp+16"),
    ):
        x, y, height = map(float.fromhex, (x, y, height))
        depth = float(Fraction(height) - top)
        assert Fraction(height) - Fraction(depth) >= top
        camera = wvr.Camera((x, y, height), (x, y, 0.6), (0.49, 1, 0), parallel_scale=0.01)
        image = wvr.render(volume, SPAN, camera, (2, 2), depth=np.full((2, 2), depth), integrator=wvr.Projection(what))
        assert np.all(np.isnan(image.values) | np.isinf(image.error_bound))
