"""Sums of segments in single precision, as GPUs have them, beside those in double."""

import numpy as np
import pytest
import warp as wp

import wvr
from studies.base.cuda import as_on_gpus
from wvr.kernels.segment import make_sum
from wvr.launch import get_device

SEGMENTS = 20_000
Sum, add, opacity, total, _ = make_sum(wp.float32, doubled=False)


@wp.kernel(enable_backward=False, module="unique")
def compose(segments: wp.array2d(dtype=wp.vec4f), sums: wp.array(dtype=wp.vec4d), plain: wp.array(dtype=wp.vec4f)):
    n = wp.tid()
    ray = Sum()
    product = wp.vec4f()
    for i in range(segments.shape[1]):
        ray = add(ray, segments[n, i])
        product += (wp.float32(1.0) - product[3]) * segments[n, i]
    sums[n] = total(ray)
    plain[n] = product


@pytest.mark.parametrize("depth", [0.01, 1.0, 12.0])
def test_sums_of_many_segments_are_rounded_once(depth):
    """Of rays that stay clear and that become opaque; each is as if added up in double, to two roundings."""
    rng = np.random.default_rng(1)
    A = (rng.uniform(0, 2 * depth / SEGMENTS, (8, SEGMENTS, 1))).astype(np.float32)
    segments = np.concatenate([A * rng.uniform(0, 1, (8, SEGMENTS, 3)).astype(np.float32), A], axis=2)
    exact = np.zeros((8, 4))
    for segment in segments.transpose(1, 0, 2).astype(np.float64):
        exact += (1 - exact[:, 3:]) * segment
    get_device()
    sums, plain = wp.zeros(8, dtype=wp.vec4d, device="cpu"), wp.zeros(8, dtype=wp.vec4f, device="cpu")
    wp.launch(compose, 8, [wp.array(segments, dtype=wp.vec4f, device="cpu"), sums, plain], device="cpu")
    error = np.abs(sums.numpy() - exact)
    assert np.all(error <= 2.0**-23 * exact)
    assert error.max() < np.abs(plain.numpy() - exact).max() / 20


def test_images_are_those_of_double_sums(blobs):
    """To one rounding of the image, with as many samples: rays end where they do."""
    scene = {"transfer_function": wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.4)]), "camera": "iso"}
    options = {"integrator": wvr.Riemann(0.02), "lighting": False, "size": (24, 24), "device": "cpu"}
    usual = wvr.render(blobs, **scene, **options)
    with as_on_gpus():
        image = wvr.render(blobs, **scene, **options)
    assert np.abs(image.rgba - usual.rgba).max() <= 2.0**-23
    np.testing.assert_array_equal(image.samples, usual.samples)
    assert usual.samples.max() > 1000
