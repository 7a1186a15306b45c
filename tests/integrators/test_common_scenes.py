"""Every integrator against all common scenes: the exact image to its own error, in whatever numbers samples come."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import wvr
from studies.base.reference import quadrature

from ..helpers import INTEGRATORS, KINDS, along
from ..scenes import SCENES, Scene

# What steps of 0.37 leave in the mean of all pixels, at jumps and in cells of masks: a small part of a segment.
ACCEPTED = {
    "Riemann": 5e-3,
    "Simpson": 5e-3,
    "Preintegrated": 5e-3,
    "oversampled": 5e-3,
    "AdaptivePreintegrated": 5e-3,
    "AdaptiveSimpson": 5e-3,
    "Exact": 0.0,
    "Certified": 1e-4,
}
INTEGERS = ("uint8", "int16")
NUMBERS = {dtype: {"dtype": dtype} for dtype in (*INTEGERS, "float32")}
NUMBERS |= {f"float64 + {offset:g}": {"offset": offset} for offset in (1e6, 1e12)}
NUMBERS |= {f"float64 x {scale:g}": {"scale": scale} for scale in (1e-200, 1e-30, 1e30, 1e200)}
NUMBERS |= {f"float32 x {scale:g}": {"dtype": "float32", "scale": scale} for scale in (1e-30, 1e30)}
PLAIN = {name: scene for name, scene in SCENES.items() if scene.labels is None}
every_scene = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def in_numbers(scene: Scene, name: str) -> Scene:
    """Integers count eighths, unless 0 and 1 are all there is."""
    binary = np.isin(scene.data, (0, 1)).all()
    return scene.of(**NUMBERS[name], **({} if binary or name not in INTEGERS else {"scale": 8.0}))


@cache
def exact(scene: Scene) -> np.ndarray:
    rgba = scene.render(wvr.Exact()).rgba
    assert rgba[..., 3].max() > 0.7
    return rgba


def off(image: wvr.Image, reference: np.ndarray) -> np.ndarray:
    """Largest error of a channel, by pixel."""
    assert np.all(np.isfinite(image.rgba))
    return np.abs(image.rgba - reference).max(axis=2)


@every_scene
@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name not in ("left", "trapezoid")])
def test_the_exact_image_to_its_own_error(name, scene):
    error = off(image := scene.render(INTEGRATORS[name]), exact(scene))
    assert error.mean() <= ACCEPTED[name]
    if image.error_bound is not None:
        assert np.all(error <= image.error_bound) and image.error_bound.max() <= INTEGRATORS[name].tolerance


@every_scene
@pytest.mark.parametrize("make", [wvr.Riemann, wvr.Simpson, wvr.Preintegrated], ids=lambda make: make.__name__)
def test_shorter_steps_come_closer(make, scene):
    """Of order one where jumps are, whatever the order elsewhere; eight times shorter ones, of random phase."""
    # Jumps at entries of the table: between two entries they are smeared, however short steps are.
    options = {"table_size": 801} if make is wvr.Preintegrated else {}
    coarse, fine = (off(scene.render(make(step, **options)), exact(scene)).mean() for step in (0.4, 0.05))
    assert fine < coarse / 3


@pytest.mark.parametrize("scene", PLAIN.values(), ids=PLAIN)
@pytest.mark.parametrize("name", KINDS)
def test_numbers_change_nothing(name, scene):
    """Types, units and zero points of scalars: the picture of the same scene in float64, to rounding."""
    integrator = INTEGRATORS[name]
    tabulated = "Preintegrated" in name
    image = scene.render(integrator)
    plain = image.rgba
    for numbers, how in NUMBERS.items():
        if name not in ("Exact", "Certified", "Riemann") and how.get("dtype") in ("int16", "float32"):
            # Samples of any type are read alike by all integrators.
            continue
        if tabulated and numbers in INTEGERS:
            # Their tables have entries where the levels are.
            error = off(in_numbers(scene, numbers).render(integrator), exact(scene))
            assert error.mean() <= ACCEPTED[name], numbers
            continue
        other = in_numbers(scene, numbers).render(integrator)
        error = off(other, plain)
        if tabulated and how.get("offset") == 1e12:
            # Entries 1/511 apart, among numbers that are 1.2e-4 apart.
            assert error.max() < 5e-3 and error.mean() < 2e-4, numbers
        elif name == "AdaptivePreintegrated":
            # Rounding may say that a cell is one segment more. Elsewhere it is rounding, in single precision, of places
            # among 511 entries of a table that has jumps; and all is as good as it was.
            same = other.samples == image.samples
            assert same.mean() > 0.85 and error[same].max() < 511 * 2.0**-24, numbers
            assert off(other, exact(scene)).mean() < 1.03 * off(image, exact(scene)).mean(), numbers
        else:
            # What is certified is measured in single precision, and cut where that is not good enough.
            rounding = 2e-9 if name == "Exact" and how.get("dtype") != "float32" else 1e-5
            assert error.max() < rounding, numbers


def test_units_and_zero_points_change_nothing_beside_labels():
    """All labels' control points are in them. Of float64 samples, which one kernel sees."""
    scene = SCENES["labels"]
    plain = scene.render(INTEGRATORS["Certified"]).rgba
    for numbers, how in NUMBERS.items():
        if how.get("dtype", "float64") == "float64":
            assert off(scene.of(**how).render(INTEGRATORS["Certified"]), plain).max() < 1e-5, numbers


@pytest.mark.parametrize("name", ["Exact", "Certified"])
@pytest.mark.parametrize("numbers", [None, *NUMBERS])
def test_slabs_of_a_mask_in_closed_form(name, numbers):
    """Planes of 0 and 1: constant, on a side of a jump, or linear; a ray along their normal."""
    planes = np.array([0, 1, 1, 1, 0, 0, 1, 0, 1.0])
    for scene in (SCENES["mask"], SCENES["mask with jumps"]):
        plain = Scene(planes[:, None, None] * np.ones((1, 3, 3)), scene.points)
        slabs = plain if numbers is None else in_numbers(plain, numbers)
        tf = wvr.TransferFunction([(float(s), color, opacity) for s, color, opacity in plain.points])
        expected = np.zeros(4)
        for front, back in pairwise(planes):
            # Slabs are 0.9 apart, which is the smallest spacing.
            expected += (1 - expected[3]) * quadrature(tf, front, back, 1.0)
        # What is certified says itself how far its rounding may have brought it.
        precision = "float64" if name == "Exact" else "auto"
        image = slabs.render(INTEGRATORS[name], along(2, scale=0.1), (2, 2), precision=precision)
        atol = 1e-6 if numbers is not None and "float32 x" in numbers else 1e-9
        if name == "Certified":
            assert image.error_bound.max() <= 1e-4
            atol += image.error_bound.max()
        np.testing.assert_allclose(image.rgba, np.broadcast_to(expected, (2, 2, 4)), rtol=0, atol=atol)
