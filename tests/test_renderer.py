"""The renderer: what is kept between frames, what a render refuses, and its statistics."""

import copy
import pickle

import numpy as np
import pytest

import wvr

TF = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.3)])


@pytest.fixture
def scene(blobs):
    return blobs, TF, wvr.Camera.fit(blobs)


def test_only_what_depends_on_a_change_is_rebuilt(blobs, device):
    renderer = wvr.Renderer(blobs, TF, integrator=wvr.Preintegrated(0.5), device=device)
    first = renderer.render(wvr.Camera.fit(blobs), (16, 16))
    # The transfer function is that of float32 along rays, and that of float64 for blocks.
    assert renderer.builds == {"volume": 1, "ranges": 1, "kinds": 1, "transfer": 2, "table": 1}
    renderer.render(wvr.Camera.fit(blobs, (0, 1, 0)), (20, 10))
    renderer.transfer_function = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.3)])  # equal content
    renderer.render(wvr.Camera.fit(blobs), (16, 16))
    assert renderer.builds == {"volume": 1, "ranges": 1, "kinds": 1, "transfer": 2, "table": 1}
    renderer.transfer_function = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.4)])
    changed = renderer.render(wvr.Camera.fit(blobs), (16, 16))
    assert renderer.builds == {"volume": 1, "ranges": 1, "kinds": 2, "transfer": 4, "table": 2}
    assert not np.array_equal(changed.rgba, first.rgba)
    renderer.integrator = wvr.Riemann(0.5)
    renderer.render(wvr.Camera.fit(blobs), (16, 16))
    assert renderer.builds == {"volume": 1, "ranges": 1, "kinds": 2, "transfer": 4, "table": 2}
    renderer.volume = wvr.Volume(255 - blobs.numpy())
    inverted = renderer.render(wvr.Camera.fit(blobs), (16, 16))
    assert renderer.builds == {"volume": 2, "ranges": 2, "kinds": 3, "transfer": 4, "table": 2}
    again = wvr.render(
        renderer.volume, renderer.transfer_function, wvr.Camera.fit(blobs), (16, 16), integrator=wvr.Riemann(0.5)
    )
    assert np.abs(inverted.rgba - again.rgba).max() < 1e-5


def test_what_a_certified_frame_keeps(blobs, device):
    renderer = wvr.Renderer(blobs, TF, tolerance=1e-3, device=device)
    camera = wvr.Camera.fit(blobs)
    renderer.render(camera, (16, 16))
    # What cells in single precision are measured by, and on a CPU what vectors are filled from.
    single = ("rows", "octants") if device == "cpu" else ("rows",)
    built = {"volume": 1, "ranges": 1, "simplified": 1, "kinds": 1} | dict.fromkeys(single, 1)
    assert renderer.builds == built
    renderer.render(wvr.Camera.fit(blobs, (0, 1, 0)), (20, 10))
    assert renderer.builds == built
    renderer.transfer_function = wvr.TransferFunction([(0, "navy", 0.0), (200, "gold", 0.4)])
    renderer.render(camera, (16, 16))
    assert renderer.builds == built | {"simplified": 2, "kinds": 2} | dict.fromkeys(single, 2)
    renderer.volume = wvr.Volume(255 - blobs.numpy())
    streamed = renderer.render(camera, (16, 16))
    assert renderer.builds == {"volume": 2, "ranges": 2, "simplified": 2, "kinds": 3} | dict(
        zip(single, (2, 3), strict=False)
    )
    again = wvr.render(renderer.volume, renderer.transfer_function, camera, (16, 16), tolerance=1e-3, device=device)
    assert np.array_equal(streamed.rgba, again.rgba)


def test_volumes_of_one_shape_are_prepared_in_the_same_memory(blobs, device):
    """Once there is memory for two, that of the last frame and that of this one, no more is asked for."""
    renderer = wvr.Renderer(blobs, TF, tolerance=1e-3, device=device)
    camera = wvr.Camera.fit(blobs)

    def arrays():
        (keeper,) = renderer._keepers.values()
        return {array.ptr for arrays in (*keeper._arrays.values(), keeper._free) for array in arrays}

    seen = []
    for k in range(5):
        renderer.volume = wvr.Volume((blobs.numpy() + 10 * k).astype(np.uint8))
        renderer.render(camera, (16, 16))
        seen.append(arrays())
    assert len(seen[0]) > 2 and len(seen[1]) == 2 * len(seen[0]) and seen[1] == seen[2] == seen[3] == seen[4]


def test_what_is_new_takes_nothing_away(blobs):
    """Blocks of the volume are as they were, whatever other volumes came and went meanwhile."""
    renderer = wvr.Renderer(blobs, TF, integrator=wvr.Riemann(0.5))
    camera = wvr.Camera.fit(blobs)
    renderer.render(camera, (8, 8))
    for k in (1, 2, 3):
        renderer.clip = wvr.ClipVolume(wvr.Volume(blobs.numpy() // k), 20)
        renderer.render(camera, (8, 8))
    before = renderer.builds.copy()
    renderer.transfer_function = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.4)])
    renderer.render(camera, (8, 8))
    assert renderer.builds - before == {"transfer": 2, "kinds": 1}


def test_point_rules_build_no_table(scene):
    volume, tf, camera = scene
    renderer = wvr.Renderer(volume, tf, integrator=wvr.Riemann(0.5))
    renderer.render(camera, (8, 8))
    assert "table" not in renderer.builds


def test_default_is_certified_in_float32(scene):
    image = wvr.render(*scene, (8, 6))
    assert image.rgba.shape == (6, 8, 4) and image.rgba.dtype == np.float32 and image.samples.dtype == np.int32
    same = wvr.render(*scene, (8, 6), tolerance=1 / 512, precision="float32")
    assert np.array_equal(image.rgba, same.rgba)
    assert image.error_bound.max() <= 1 / 512 and image.stats["rays"] == 48 and image.stats["seconds"] > 0
    assert image.stats["bytes"] >= scene[0].numpy().nbytes


def test_constant_volume_renders_with_a_table():
    volume = wvr.Volume(np.full((3, 3, 3), 100, np.uint8))
    alpha = wvr.render(volume, TF, wvr.Camera.fit(volume), (9, 9)).rgba[4, 4, 3]
    assert 0.2 < alpha < 0.5


def test_empty_view(blobs):
    away = wvr.Camera((500, 0, 0), (600, 0, 0))
    image = wvr.render(blobs, TF, away, (5, 5))
    assert not image.rgba.any() and not image.samples.any()


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (16, 16), (17, 33)])
def test_any_size(scene, size):
    whole = wvr.render(*scene, size)
    assert whole.size == size and np.all(np.isfinite(whole.rgba))


def test_background_is_only_put_behind(scene):
    plain, red = wvr.render(*scene, (8, 8)), wvr.render(*scene, (8, 8), background="red")
    assert np.array_equal(plain.rgba, red.rgba) and red.to_uint8().shape[2] == 3


def test_table_size_and_generator(scene):
    images = [
        wvr.render(*scene, (16, 16), integrator=wvr.Preintegrated(0.5, table_size=n, generator=g), termination=0)
        for n, g in ((64, "incremental"), (64, "brute"), (700, "incremental"))
    ]
    assert np.abs(images[0].rgba - images[1].rgba).max() < 2e-6
    assert 0 < np.abs(images[0].rgba - images[2].rgba).max() < 1e-2


@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"volume": ...}, TypeError, "data must be a Volume, a path, an array .*, got ellipsis"),
        (
            {"transfer_function": "bonee"},
            ValueError,
            "transfer_function must be a Tr.*got 'bonee'; did you mean 'bone'",
        ),
        ({"transfer_function": 7}, TypeError, "transfer_function must be a TransferFunction, .* got int"),
        ({"camera": "ios"}, ValueError, "camera must be one of iso, .*got 'ios'; did you mean 'iso'"),
        ({"camera": 7}, TypeError, "camera must be a Camera, .*got 7"),
        ({"lighting": "phong"}, TypeError, "lighting must be a Lighting, True, .*got 'phong'"),
        ({"opacity": "linear"}, ValueError, "opacity is for colour maps, .*got 'linear'"),
        ({"clim": (0, 1)}, ValueError, "clim is for colour maps and presets, .*got"),
        ({"integrator": "riemann"}, TypeError, "integrator must be an Integrator, such as .*, got 'riemann'"),
        ({"size": (0, 5)}, ValueError, r"size must be \(width, height\), each >= 1, got \(0, 5\)"),
        ({"size": (5, -1)}, ValueError, "size"),
        ({"size": 512}, ValueError, "size must be two integers"),
        ({"size": (2.5, 2)}, ValueError, "size must be two integers"),
        ({"size": (2**23 + 1, 1)}, ValueError, "size must be .* each at most 8388608"),
        ({"precision": "half"}, ValueError, "precision must be one of 'auto', 'float32', 'float64', got 'half'"),
        ({"device": "cuda:99"}, ValueError, "device must be one of .*got 'cuda:99'"),
        ({"termination": 1.0}, ValueError, r"termination must be in \[0, 1\), got 1.0"),
        ({"termination": -0.1}, ValueError, "termination"),
        ({"termination": float("nan")}, ValueError, "termination"),
        ({"background": "reddish"}, ValueError, "background must be a colour name.*got 'reddish'"),
        ({"skip_empty": "no"}, TypeError, "skip_empty must be True or False, got 'no'"),
        ({"size": (10**6, 10**6)}, ValueError, r"size must be .* of at most 2147483647 pixels, in whole tiles of 16"),
    ],
    ids=str,
)
def test_errors(scene, kwargs, error, message):
    arguments = dict(zip(("volume", "transfer_function", "camera"), scene, strict=True), size=(4, 4), device="cpu")
    with pytest.raises(error, match=message):
        wvr.render(**(arguments | kwargs))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: wvr.Riemann(0), "step must be finite and > 0, got 0"),
        (lambda: wvr.Riemann(-1), "step"),
        (lambda: wvr.Riemann(float("nan")), "step"),
        (lambda: wvr.Riemann(float("inf")), "step"),
        (lambda: wvr.Riemann(1, "right"), "rule must be one of 'midpoint', 'left', 'trapezoid', got 'right'"),
        (lambda: wvr.Preintegrated(0), "step"),
        (lambda: wvr.Preintegrated(1, oversampling=0), "oversampling must be an integer >= 1, got 0"),
        (lambda: wvr.Preintegrated(1, oversampling=1.5), "oversampling"),
        (lambda: wvr.Preintegrated(1, table_size=1), "table_size must be an integer from 2 to 8192, got 1"),
        (lambda: wvr.Preintegrated(1, generator="running"), "generator must be one of"),
    ],
)
def test_integrator_errors(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("integrator", [wvr.Certified(1e-2), wvr.Riemann(1.0)], ids=lambda i: type(i).__name__)
def test_share_of_the_volume_that_is_skipped(integrator):
    """All of it, none of it, and about the half that is empty; none where nothing is to be skipped."""
    data = np.zeros((65, 65, 65), np.uint8)
    data[:, :, 32:] = 100
    volume = wvr.Volume(data)
    camera = wvr.Camera.fit(volume)

    def skipped(points, **options):
        tf = wvr.TransferFunction(points)
        return wvr.render(volume, tf, camera, (8, 8), integrator=integrator, **options).stats["skipped"]

    seen = [(50, "red", 0.0), (100, "red", 0.5)]
    assert skipped([(0, "red", 0.0), (255, "red", 0.0)]) == 1
    assert skipped([(0, "red", 0.5), (255, "red", 0.5)]) == 0
    assert 0.35 < skipped(seen) < 0.5
    assert skipped(seen, skip_empty=False) == 0


@pytest.mark.parametrize(
    "integrator",
    [
        wvr.Riemann(1e-9),
        wvr.Simpson(1e-9),
        wvr.Preintegrated(1e-3, oversampling=10**6),
        wvr.AdaptivePreintegrated(0.1, hmin=1e-9),
        wvr.AdaptiveSimpson(0.1, hmin=1e-9),
    ],
    ids=lambda i: type(i).__name__,
)
def test_more_steps_than_can_be_counted_are_refused(scene, integrator):
    message = r"integrator must take at most 16777216 steps .* got .*, which takes 5.37e\+10 along its diagonal of 53"
    with pytest.raises(ValueError, match=message):
        wvr.render(*scene, (4, 4), integrator=integrator)


def test_the_shortest_step_that_is_accepted(scene):
    """It is the one that the message says, along the longest diagonal in space."""
    volume, tf, _ = scene
    skewed = wvr.Volume(volume.numpy()[:2, :2, :2], direction=[[1, 0.9, 0], [0, 0.5, 0], [0, 0, 1]])
    longest = np.linalg.norm(np.array([1.9, 0.5, 1.0])) / skewed.smallest_spacing
    limit = longest / 2**24
    wvr.render(skewed, tf, wvr.Camera.fit(skewed), (1, 1), integrator=wvr.Riemann(1.001 * limit))
    with pytest.raises(ValueError, match=f"a step must be {limit:.3g} or longer"):
        wvr.render(skewed, tf, wvr.Camera.fit(skewed), (1, 1), integrator=wvr.Riemann(0.999 * limit))


def test_all_that_takes_steps_is_refused_too_many(scene):
    far = wvr.Volume(np.zeros((2, 2, 2)), spacing=(2.0**31, 1, 1))
    with pytest.raises(ValueError, match=r"a step must be 128 or longer"):
        wvr.render(far, TF, wvr.Camera.fit(far), (4, 4), integrator=wvr.Preintegrated(1))
    wvr.render(far, TF, wvr.Camera.fit(far), (4, 4))
    with pytest.raises(ValueError, match="integrator must take at most 16777216 steps"):
        wvr.single_scattering(*scene, (4, 4), step=1e-9)
    for shadows in (wvr.ConvolutionShadows(slice_distance=1e-9), wvr.ConvolutionShadows(subsamples=10**9)):
        with pytest.raises(ValueError, match="shadows must take at most 16777216 steps"):
            wvr.render(*scene, (4, 4), shadows=shadows)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda r: pickle.loads(pickle.dumps(r))])
def test_a_copy_has_frames_of_its_own(blobs, smooth_tf, copied):
    renderer, camera = wvr.Renderer(blobs, smooth_tf, tolerance=0.01), wvr.Camera.fit(blobs)
    image = renderer.render(camera, (8, 8))
    other = copied(renderer)
    other.transfer_function = wvr.TransferFunction([(0, "red", 0.1), (1, "blue", 0.9)])
    assert other.builds == {} and other.tolerance == 0.01
    assert np.any(other.render(camera, (8, 8)).rgba != image.rgba)
    np.testing.assert_array_equal(renderer.render(camera, (8, 8)).rgba, image.rgba)
    np.testing.assert_array_equal(copied(renderer).render(camera, (8, 8)).rgba, image.rgba)
