"""Certified images, and exact ones, against enclosures of their pixels, in scenes where bounds are easily false."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wvr
from studies.base.adversarial import KINDS, adversary, errors

# From which on an enclosure does not say on which side of a jump the truth is.
WIDE = 1e-9


def assert_bounded(scene, tolerance, precision):
    """Every pixel is within its bound of all values that the truth may have. The number of those that are decided."""
    try:
        image = scene.render(wvr.Certified(tolerance), precision=precision)
    except ValueError as error:
        assert "tolerance must be at least" in str(error)
        return 0
    decided = 0
    for y, x in np.ndindex(image.rgba.shape[:2]):
        truth = scene.enclose(x, y)
        least, most = errors(image.rgba[y, x], truth)
        bound = float(image.error_bound[y, x])
        assert least <= bound, f"pixel {x}, {y}: off by {least:.3g}, bound {bound:.3g}"
        # Of a ray that nothing is left of by a clip whose face is a cell's, nothing is known to be less than 1e-30.
        open_ended = truth.width > WIDE or (bound == 0 and truth.width < 1e-30)
        assert open_ended or most <= bound, f"pixel {x}, {y}: off by up to {most:.3g}, bound {bound:.3g}"
        decided += truth.width <= WIDE
    return decided


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(("tolerance", "precision"), [(0.1, "float32"), (1e-3, "auto"), (1e-5, "float64")])
def test_certified_images_are_within_their_bounds(name, tolerance, precision):
    scenes = [adversary(name, seed) for seed in range(1, 3)]
    assert sum(assert_bounded(scene, tolerance, precision) for scene in scenes) > 0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(list(KINDS)), st.integers(0, 2**32), st.floats(-7, -0.5))
def test_any_scene(name, seed, exponent):
    assert_bounded(adversary(name, seed), 10**exponent, "auto")
