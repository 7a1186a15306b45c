"""A volume in bricks is the volume: any split, any camera, bounds included."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from wvr.bricks import frame
from wvr.bricks.frame import BrickedFrame
from wvr.bricks.grid import Bricks, footprint
from wvr.bricks.partial import Partial

RNG = np.random.default_rng(7)
TURN = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
NOISY = np.clip(wvr.datasets.load("blobs", 25).numpy() + RNG.normal(0, 10, (25, 25, 25)), 0, 255).astype(np.uint8)
# Anisotropic, rotated, elsewhere.
VOLUME = wvr.Volume(NOISY[::2, :21, :18].copy(), (2.0, 1.0, 0.7), (3.0, -5.0, 100.0), TURN)
# With a jump, so that rounding of the scalar counts, and opaque.
TF = wvr.TransferFunction(
    [(0, "navy", 0.0), (60, "green", 0.02), (140, "gold", 0.3), (140, "red", 0.1), (255, "white", 0.5)]
)
# And without.
GENTLE = wvr.TransferFunction([(0, "navy", 0.0), (100, "green", 0.0), (140, "gold", 0.1), (255, "white", 0.6)])
SIZE = (13, 11)
WHOLE = {"termination": 0.0, "precision": "float64"}


def world(*index: float) -> np.ndarray:
    """Where index coordinates are."""
    return VOLUME.index_to_world[:3, :3] @ index + VOLUME.index_to_world[:3, 3]


def cameras() -> dict[str, wvr.Camera]:
    """Outside and inside, and with rays in faces of bricks of 6 samples, along their edges and nearly so."""
    middle = VOLUME.corners.mean(axis=0)
    found = {
        "outside": wvr.Camera.fit(VOLUME, (1, 0.6, 0.4)),
        "parallel": wvr.Camera.fit(VOLUME, (-1, 0.6, 0.4), parallel=True),
        "inside": wvr.Camera(middle + 0.3, middle + np.array([3, 2, 1]), view_angle=80),
    }
    edge = world(6, 6, 6)
    for axis in range(3):
        along, up = VOLUME.direction[:, axis], VOLUME.direction[:, axis - 2]
        scale = 6 * float(VOLUME.spacing[axis - 2])
        found[f"edges {axis}"] = wvr.Camera(edge - 50 * along, edge, up, parallel_scale=scale)
        near = edge - 50 * along + 1e-13 * RNG.normal(size=3)
        found[f"nearly {axis}"] = wvr.Camera(near, edge, up, parallel_scale=scale)
        found[f"from a face {axis}"] = wvr.Camera(edge + 1e-14 * RNG.normal(size=3), edge + along, up, view_angle=90)
    return found


CAMERAS = cameras()
SPLITS = [(6, 6, 6), (9, 20, 2)]


@pytest.fixture
def split(monkeypatch):
    """Renders in bricks of so many cells along x, y, z."""

    def render(cells, camera, **options):
        cut = Bricks.regular(VOLUME.dimensions, cells)
        monkeypatch.setattr(BrickedFrame, "bricks", lambda self: cut)
        tf = None if "segmentation" in options else TF
        return wvr.render(VOLUME, tf, camera, SIZE, memory_limit="1 GiB", **options)

    return render


def assert_within(image: wvr.Image, whole: wvr.Image, exact: wvr.Image) -> None:
    """Within its bound of the exact image and both bounds of the whole, and the bound within the tolerance."""
    error = np.abs(image.rgba - exact.rgba).max(axis=2)
    assert np.all(error <= image.error_bound), float((error - image.error_bound).max())
    apart = np.abs(image.rgba.astype(float) - whole.rgba).max(axis=2)
    assert np.all(apart <= image.error_bound + whole.error_bound)
    assert image.error_bound.max() <= 1 / 256 and image.stats["rays_over_tolerance"] == 0


def far_away(way) -> wvr.Camera:
    """A parallel camera whose position has no digits next to the volume."""
    target = VOLUME.corners.mean(axis=0)
    return wvr.Camera(target - 2.0**60 * np.array(way), target, (0.3, 1, 0.2), parallel_scale=4.0)


@pytest.mark.parametrize("camera", [*CAMERAS.values(), far_away((1, 0.6, 0.4))], ids=[*CAMERAS, "far away"])
def test_certified_bricks_are_within_their_bounds(split, camera):
    exact = wvr.render(VOLUME, TF, camera, SIZE, integrator=wvr.Exact())
    whole = wvr.render(VOLUME, TF, camera, SIZE, tolerance=1 / 256)
    for cells in SPLITS:
        assert_within(split(cells, camera, tolerance=1 / 256), whole, exact)


@pytest.mark.parametrize("integrator", [wvr.Exact(), wvr.Riemann(0.77), wvr.Preintegrated(1.3)], ids=repr)
def test_bricks_are_the_whole(split, integrator):
    for name, camera in CAMERAS.items():
        whole = wvr.render(VOLUME, TF, camera, SIZE, integrator=integrator, **WHOLE)
        for cells in SPLITS:
            image = split(cells, camera, integrator=integrator, **WHOLE)
            np.testing.assert_allclose(image.rgba, whole.rgba, atol=1e-11, err_msg=f"{name} {cells}")


@pytest.mark.parametrize("method", [wvr.AdaptiveSimpson(1e-4, scope="ray"), wvr.AdaptivePreintegrated(1e-4)], ids=repr)
def test_adaptive_steps_begin_anew_in_each_brick(split, method):
    """And are as near to the exact image as those of the whole."""
    for name in ("outside", "edges 0"):
        exact = wvr.render(VOLUME, TF, CAMERAS[name], SIZE, integrator=wvr.Exact())
        whole = wvr.render(VOLUME, TF, CAMERAS[name], SIZE, integrator=method)
        image = split((6, 6, 6), CAMERAS[name], integrator=method)
        off, before = (np.abs(one.rgba - exact.rgba).max() for one in (image, whole))
        assert off < max(2 * before, 5e-4) and before < 0.02


def test_clips_and_labels_split_alike(split):
    middle = VOLUME.corners.mean(axis=0)
    labels = (RNG.random(VOLUME.shape) < 0.5).astype(np.uint8)
    labels[:, 5:9] = 1
    paint = wvr.TransferFunction([(0, "red", 0.0), (100, "white", 0.1), (255, "blue", 0.3)])
    clips = [wvr.ClipPlane(middle, (1, 0.2, 0.3)), wvr.ClipSphere(middle, 6.0, invert=True)]
    cut = {"clip": clips, "segmentation": wvr.Segmentation(labels, {0: GENTLE, 1: paint})}
    for camera in (CAMERAS["outside"], CAMERAS["inside"]):
        exact = wvr.render(VOLUME, None, camera, SIZE, integrator=wvr.Exact(), **cut)
        whole = wvr.render(VOLUME, None, camera, SIZE, tolerance=1 / 256, **cut)
        assert_within(split((6, 6, 6), camera, tolerance=1 / 256, **cut), whole, exact)
        # By clips alone: abreast.
        exact, whole = (
            wvr.render(VOLUME, TF, camera, SIZE, clip=clips, integrator=method)
            for method in (wvr.Exact(), wvr.Certified(1 / 256))
        )
        assert_within(split((6, 6, 6), camera, tolerance=1 / 256, clip=clips), whole, exact)
        riemann = {"integrator": wvr.Riemann(0.77), "clip": clips, **WHOLE}
        whole = wvr.render(VOLUME, TF, camera, SIZE, **riemann)
        np.testing.assert_allclose(split((6, 6, 6), camera, **riemann).rgba, whole.rgba, atol=1e-11)


@pytest.mark.filterwarnings("ignore:.* are bounded by more")
def test_depths_from_far_away_are_loose_in_bricks_too(split):
    """Rounding of so long a depth is more than the volume: nobody knows which bricks a ray ends in front of."""
    for way in np.random.default_rng(3).normal(size=(4, 3)):
        camera = far_away(way)
        depth = np.full(SIZE[::-1], np.linalg.norm(camera.target - camera.position))
        for image in (
            wvr.render(VOLUME, TF, camera, SIZE, tolerance=1 / 256, depth=depth),
            split((6, 6, 6), camera, tolerance=1 / 256, depth=depth),
        ):
            assert image.error_bound.min() > 0.5


@pytest.mark.parametrize("integrator", [wvr.Certified(1 / 256), wvr.Exact(), wvr.Riemann(0.77)], ids=repr)
def test_rays_end_at_a_depth_in_any_brick(split, integrator):
    """Also in a face of bricks; what is behind is not asked for."""
    for name in ("outside", "parallel", "inside", "edges 0"):
        camera = CAMERAS[name]
        far = (VOLUME.corners - camera.position) @ camera.basis()[2]
        depth = RNG.uniform(max(far.min(), 0), far.max(), SIZE[::-1])
        depth[RNG.random(depth.shape) < 0.2] = np.nan
        depth[0] = (world(6, 6, 6) - camera.position) @ camera.basis()[2]
        options = {"integrator": integrator, "depth": depth}
        exact = wvr.render(VOLUME, TF, camera, SIZE, **options | {"integrator": wvr.Exact()})
        if isinstance(integrator, wvr.Certified):
            assert_within(split((6, 6, 6), camera, **options), wvr.render(VOLUME, TF, camera, SIZE, **options), exact)
        else:
            whole = wvr.render(VOLUME, TF, camera, SIZE, **options, **WHOLE)
            np.testing.assert_allclose(split((6, 6, 6), camera, **options, **WHOLE).rgba, whole.rgba, atol=1e-11)


def test_light_looks_beyond_a_brick(split):
    """At gradients, whose samples are of the neighbours."""
    lit = {"integrator": wvr.Riemann(0.77), "lighting": wvr.Lighting(), **WHOLE}
    whole = wvr.render(VOLUME, TF, CAMERAS["outside"], SIZE, **lit)
    np.testing.assert_allclose(split((6, 6, 6), CAMERAS["outside"], **lit).rgba, whole.rgba, atol=1e-11)


@pytest.mark.filterwarnings("ignore:.* visible")
@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_random_splits_are_within_their_bounds(seed):
    """Several rays at a time, in bricks of any size, opaque or not, from anywhere; never a bound above what there is to
    see at all.
    """
    rng = np.random.default_rng(seed)
    data = np.clip(np.cumsum(rng.normal(0, 12, rng.integers(5, 30, 3)), axis=rng.integers(3)) + 100, 0, 255)
    volume = wvr.Volume(data.astype(np.uint8), 10 ** rng.uniform(-0.5, 0.5, 3), rng.normal(size=3) * 100)
    cut = Bricks.regular(volume.dimensions, tuple(rng.integers(2, 20, 3).tolist()))
    at = np.array([rng.choice(along) for along in cut.edges], float) * volume.spacing + volume.origin
    way = np.roll([1.0, 0, 0], rng.integers(3)) + 10.0 ** rng.uniform(-15, 0) * rng.normal(size=3) * rng.integers(2)
    camera = wvr.Camera(at - rng.choice([0, 50]) * way, at + way, np.roll(way, 1), view_angle=60)
    exact = wvr.render(volume, GENTLE, camera, (17, 12), integrator=wvr.Exact())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BrickedFrame, "bricks", lambda self: cut)
        image = wvr.render(volume, GENTLE, camera, (17, 12), tolerance=1 / 256, memory_limit="1 GiB")
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=2) <= image.error_bound)
    assert image.error_bound.max() <= 1 + 1e-6


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_waves_are_in_order_along_any_ray(seed):
    """The bricks of a ray come in waves of ascending numbers, each of its own."""
    rng = np.random.default_rng(seed)
    bricks = Bricks.regular(np.array(VOLUME.shape[::-1]), tuple(rng.integers(1, 12, 3).tolist()))
    at, way = rng.uniform(-30, 50, 3), rng.normal(size=3)
    waves = bricks.waves(bricks.near(at))
    wave_of = {index: n for n, wave in enumerate(waves) for index in wave}
    t = np.sort(rng.uniform(0, 80, 500))
    points = at + t[:, None] * way
    inside = points[np.all((points > 0) & (points < np.array(VOLUME.shape[::-1]) - 1), axis=1)]
    passed = list(dict.fromkeys(bricks.near(p) for p in inside))
    assert all(wave_of[a] < wave_of[b] for a, b in pairwise(passed))


def test_bricks_of_chunks_have_their_layers_in_front():
    """Each cell is of one brick, and each brick needs its chunk and samples of chunks nearer to the camera alone."""
    starts = ((0, 8, 16, 21),) * 3
    for towards in (0, 1, 2):
        edges = Bricks.of_chunks(starts, (towards,) * 3).edges[0]
        assert edges[0] == 0 and edges[-1] == 20 and all(a < b for a, b in pairwise(edges))
        for k, (a, b) in enumerate(pairwise(edges)):
            chunks = {int(np.searchsorted(starts[0], s, "right")) - 1 for s in range(a, b + 1)}
            assert k in chunks and chunks <= {k, k - 1 if k > towards else k, k + 1 if k < towards else k}


def test_footprints_hold_all_pixels_that_see_a_box():
    for camera in CAMERAS.values():
        for _ in range(20):
            low = RNG.uniform(0, 10, 3)
            box = low, low + RNG.uniform(0.5, 5, 3)
            rect = footprint(VOLUME, box, camera, camera.basis(), (40, 30))
            points = RNG.uniform(*box, (200, 3)) @ VOLUME.index_to_world[:3, :3].T + VOLUME.index_to_world[:3, 3]
            column, row = camera.project(points, (40, 30)).T
            seen = (column > -0.5) & (column < 39.5) & (row > -0.5) & (row < 29.5)
            if not camera.parallel:
                seen &= (points - camera.position) @ camera.basis()[2] > 0
            if rect is None:
                assert not seen.any()
            else:
                assert np.all((row[seen] > rect[0].start - 0.5) & (row[seen] < rect[0].stop - 0.5))
                assert np.all((column[seen] > rect[1].start - 0.5) & (column[seen] < rect[1].stop - 0.5))


@given(st.lists(st.floats(0, 1), min_size=9, max_size=9))
def test_bounds_compose(numbers):
    """Whatever maps two parts truly are, within their bounds, the composition is within its own, and attained."""
    c1, t1, b1, c2, t2, b2, x, s1, s2 = numbers
    t1, t2 = min(t1, 1 - c1), min(t2, 1 - c2)
    at = slice(0, 1), slice(0, 1)

    def part(c, t, b):
        shape = np.zeros((1, 1), np.int32)
        return Partial(at, np.array([[[c, c, c, t]]]), np.full((1, 1), b), shape)

    front = part(c1, t1, b1)
    front.over(part(c2, t2, b2))
    # True maps that are off by no more than their bounds.
    true2 = np.clip(c2 + t2 * x + (2 * s2 - 1) * b2, 0, 1)
    true1 = c1 + t1 * true2 + (2 * s1 - 1) * b1
    off = abs(true1 - (front.color[0, 0, 0] + front.through[0, 0] * x))
    assert off <= front.bound[0, 0] + 1e-12
    assert front.bound[0, 0] == pytest.approx(b1 + t1 * b2)


class Own(wvr.Exact):
    """Of somebody who did not say that its rays are composed."""

    splits = False


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"integrator": Own()}, "integrator"),
        ({"shadows": True}, "shadows"),
        ({"memory_limit": "much"}, "memory_limit"),
        ({"memory_limit": "1e400"}, "memory_limit"),
        ({"memory_limit": 10}, "memory_limit"),
        ({"budget": -1.0}, "budget"),
        ({"missing": "zero"}, "missing"),
        ({"client": 3}, "client"),
        (
            {
                "integrator": wvr.Riemann(0.5),
                "segmentation": wvr.Segmentation(np.ones(VOLUME.shape, np.uint8), {1: TF}),
            },
            "segmentation",
        ),
    ],
)
def test_what_bricks_cannot_do_is_said(options, named):
    with pytest.raises((ValueError, TypeError), match=named):
        wvr.render(VOLUME, TF, CAMERAS["outside"], SIZE, **({"memory_limit": "1 GiB"} | options))


def test_samples_written_between_frames_are_seen():
    data = np.zeros((9, 9, 9), np.uint8)
    volume = wvr.Volume(data)
    renderer = wvr.Renderer(volume, TF, memory_limit="1 GiB")
    camera = wvr.Camera.fit(volume)
    with pytest.warns(UserWarning, match="nothing is visible"):
        assert not renderer.render(camera, (5, 5)).rgba.any()
    data[2:7, 2:7, 2:7] = 255
    assert renderer.render(camera, (5, 5)).rgba[2, 2, 3] > 0.9


def test_a_small_limit_keeps_few_bricks_and_changes_nothing():
    """The same image, of bricks that were let go and read again."""
    volume = wvr.datasets.load("blobs", 100)
    camera = wvr.Camera.fit(volume, (1, 0.6, 0.4))
    images = [wvr.Renderer(volume, TF, memory_limit=limit).render(camera, SIZE) for limit in ("1 MiB", "1 GiB")]
    assert images[0].stats["bricks"] > images[1].stats["bricks"] == 1
    apart = np.abs(images[0].rgba - images[1].rgba).max(axis=2)
    assert np.all(apart <= images[0].error_bound + images[1].error_bound)


def test_what_bricks_in_front_have_not_spent_is_spent_behind(split):
    """Else each brick cuts cells anew that the whole has room for: in all 1.01 times as many samples."""
    options = {"integrator": wvr.Certified(1 / 16)}
    of_bricks = of_whole = 0
    for name in ("outside", "parallel", "inside"):
        image = split((6, 6, 6), CAMERAS[name], **options)
        of_bricks += image.stats["samples"]
        of_whole += wvr.render(VOLUME, TF, CAMERAS[name], SIZE, **options).stats["samples"]
        assert image.error_bound.max() <= 1 / 16
    assert of_bricks < 0.99 * of_whole


def test_nothing_is_spent_behind_what_lets_nothing_through(monkeypatch):
    """Cells there that single precision does not hold are not let pass by shares over a transparency of 0."""
    data = np.full((24, 4, 4), 50, np.float32)
    data[8:], data[15:] = 1e20, -1e20
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction([(-100, "white", 0.99), (100, "black", 0.5)], unit_distance=0.01)
    camera = wvr.Camera((1.5, 1.5, -40), (1.5, 1.5, 10), (0, 1, 0), parallel_scale=1)
    monkeypatch.setattr(frame, "CELLS", (8,))
    image = wvr.render(volume, tf, camera, SIZE, tolerance=1 / 256, termination=0, memory_limit="1 GiB")
    off = np.abs(image.rgba - wvr.render(volume, tf, camera, SIZE, integrator=wvr.Exact()).rgba)
    assert np.all(off.max(axis=2) <= image.error_bound) and image.error_bound.max() <= 1 / 256


def test_a_kept_renderer_of_bricks_sees_what_changed(monkeypatch):
    """What is kept of bricks is of one scene: after any change the image is that of a new renderer, to the last bit."""
    monkeypatch.setattr(frame, "CELLS", (8,))
    samples, ids = NOISY[:12, :12, :12].copy(), np.arange(12**3, dtype=np.uint8).reshape(12, 12, 12) % 3
    volume, labels, mask = wvr.Volume(samples), wvr.Volume(ids), wvr.Volume(ids.copy())
    other = wvr.TransferFunction([(0, "red", 0.0), (255, "white", 0.9)])
    kept = wvr.Renderer(volume, TF, memory_limit="1 GiB")
    seen = set()

    def look(camera, depth=None):
        new = wvr.Renderer(volume, kept.transfer_function, memory_limit="1 GiB")
        for name in ("integrator", "lighting", "clip", "segmentation", "termination"):
            setattr(new, name, getattr(kept, name))
        for _ in range(2):
            image, fresh = (one.render(camera, SIZE, depth=depth) for one in (kept, new))
            assert np.array_equal(image.rgba, fresh.rgba) and image.stats["bricks"] == 8
            assert image.stats["samples"] == fresh.stats["samples"]
        seen.add(image.rgba.tobytes())

    for camera in (wvr.Camera.fit(volume, (1, 0.6, 0.4)), wvr.Camera.fit(volume, (-1, 0.2, 0.4))):
        kept.integrator, kept.clip, kept.segmentation, kept.transfer_function = wvr.Certified(1 / 256), None, None, TF
        look(camera)
        look(camera, np.full(SIZE[::-1], 30.0))
        kept.transfer_function = other
        look(camera)
        kept.clip, kept.transfer_function = wvr.ClipPlane((6, 6, 6), (1, 1, 0)), TF
        look(camera)
        kept.clip = wvr.ClipVolume(mask, 0.5)
        look(camera)
        mask.numpy()[:6] = 0
        mask.changed()
        look(camera)
        kept.clip, kept.integrator = None, wvr.Exact()
        look(camera)
        kept.integrator = wvr.Projection("mean")
        look(camera)
        kept.integrator, kept.clip = wvr.Certified(1 / 256), wvr.ClipPlane((6, 6, 6), (1, 1, 0))
        kept.segmentation = wvr.Segmentation(labels, {1: GENTLE, 2: other})
        look(camera)
        labels.numpy()[:] = np.roll(labels.numpy(), 1)
        labels.changed()
        look(camera)
        samples[:6] //= 2
        volume.changed()
        look(camera)
        mask.numpy()[:] = ids
        mask.changed()
    assert len(seen) == 22
