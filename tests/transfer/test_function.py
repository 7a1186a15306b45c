"""The transfer function on the device is that of NumPy, for any knots."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from wvr.kernels.precision import REALS, vec4_of
from wvr.kernels.transfer.function import make_transfer
from wvr.launch import get_device, launch
from wvr.transfer.function import transfer_arrays, transfer_values


def make_classifier(precision):
    real = REALS[precision]
    Transfer, _, classify = make_transfer(real)

    @wp.kernel(enable_backward=False, module="unique")
    def classified(base: int, tf: Transfer, s: wp.array(dtype=real), out: wp.array(dtype=vec4_of(real))):
        i = wp.tid() + base
        out[i] = classify(tf, s[i])

    return classified


CLASSIFIERS = {precision: make_classifier(precision) for precision in REALS}


def classified(tf, s, precision, device="cpu", shift=0.0, unit=1.0):
    device, real = get_device(device), REALS[precision]
    out = wp.zeros(len(s), dtype=vec4_of(real), device=device)
    scalars = wp.array((s - shift).astype(precision), dtype=real, device=device)
    launch(
        CLASSIFIERS[precision],
        len(s),
        [transfer_arrays(tf.knots, transfer_values(tf, unit), shift, precision, device), scalars, out],
        device,
    )
    return out.numpy()


def expected(tf, s, unit=1.0):
    return np.concatenate([tf.color(s), unit * tf.extinction(s, unit)[:, None]], axis=1)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    knots=st.integers(2, 300),
    clustered=st.sampled_from([1.0, 6.0, 40.0]),
    jumps=st.booleans(),
    scale=st.sampled_from([1e-6, 1.0, 1e9]),
)
def test_exact_between_any_knots(seed, knots, clustered, jumps, scale):
    """Uniform or crowded knots, jumps, any scale: at the knots, just beside them, between and far outside."""
    rng = np.random.default_rng(seed)
    k = scale * np.sort(rng.random(knots) ** clustered - 0.3)
    if jumps and knots > 3:
        k[2] = k[1]
    if np.any(k[2:] == k[:-2]):
        return
    tf = wvr.TransferFunction.from_arrays(k, rng.random((knots, 3)), rng.random(knots))
    s = np.concatenate([k, np.nextafter(k, -np.inf), np.nextafter(k, np.inf), (k[1:] + k[:-1]) / 2])
    s = np.concatenate([s, rng.uniform(k[0], k[-1], 100), scale * np.array([-1e12, -10, 10, 1e12])])
    np.testing.assert_allclose(classified(tf, s, "float64"), expected(tf, s), rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("precision", list(REALS))
def test_jumps_between_integers(device, precision):
    """Labels: the right value at the jump and above, the left one below, with every label a knot of the table."""
    labels = np.arange(50.0)
    rgb, opacity = np.random.default_rng(0).random((50, 3)), np.random.default_rng(1).random(50)
    tf = wvr.TransferFunction.from_arrays(
        np.repeat(labels, 2)[1:-1], np.repeat(rgb, 2, axis=0)[:-2], np.repeat(opacity, 2)[:-2]
    )
    for s, label in ((labels[:-1], labels[:-1]), (labels[1:] - 1e-5, labels[:-1])):
        values = classified(tf, s, precision, device)
        np.testing.assert_allclose(values[:, :3], rgb[label.astype(int)], atol=1e-6)


def test_fine_spikes_in_float32(device):
    """Spikes far narrower than a bin are there, at their height."""
    tf = wvr.TransferFunction.isosurfaces([10.0, 4000.0, 65000.0], opacity=[0.9, 0.5, 0.3], width=0.5)
    s = np.array([10.0, 4000.0, 65000.0, 10.125, 9.75, 64999.875, 30000.0])
    values = classified(tf, s, "float32", device)
    np.testing.assert_allclose(values, expected(tf, s), rtol=1e-6, atol=1e-6)


def test_shift_keeps_the_range(device):
    tf = wvr.TransferFunction([(1e7 - 1, "red", 0.1), (1e7, "blue", 0.9), (1e7 + 1, "green", 0.2)])
    s = 1e7 + np.linspace(-2, 2, 65)
    values = classified(tf, s, "float32", device, shift=1e7, unit=3.0)
    np.testing.assert_allclose(values, expected(tf, s, 3.0), rtol=1e-5, atol=1e-6)
