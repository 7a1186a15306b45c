"""Volumes of more samples than 32 bits count; in a file of its own, since its blocks take long."""

import numpy as np
import pytest

import wvr


def test_more_than_two_to_the_31_samples():
    """Indices beyond 32 bits: a voxel at the far end of 2.2 G samples is where it is, and nothing else is."""
    shape = (1300, 1300, 1300)
    try:
        data = np.zeros(shape, np.uint8)  # pages that nothing is written to take no memory
    except MemoryError:
        pytest.skip("not enough address space")
    data[1290, 1280, 1270] = 200
    volume = wvr.Volume(data)
    tf = wvr.TransferFunction([(0, (1, 1, 1), 0.0), (200, (1, 1, 1), 0.5)])
    camera = wvr.Camera((1270, 1280, 2000), (1270, 1280, 1290), up=(0, 1, 0), parallel_scale=4.0)
    alpha = wvr.render(volume, tf, camera, (16, 16), integrator=wvr.Riemann(0.25), device="cpu").rgba[..., 3]
    y, x = np.nonzero(alpha)
    assert (x.min(), x.max(), y.min(), y.max()) == (6, 9, 6, 9) and alpha[7:9, 7:9].min() > 0.2
