"""``Exact`` against enclosures, and its quadrature against what is said of it."""

import numpy as np
import pytest

import wvr
from studies.base.adversarial import KINDS, adversary, errors
from studies.enclosure import brightest, piece
from wvr.kernels.integrators.pieces import ACCURACY, NODES, deepest


@pytest.mark.parametrize("n", NODES)
def test_quadrature_is_as_exact_as_it_says(n):
    """On pieces of the largest depth that a rule is for, against a rule of twice as many nodes."""
    rng = np.random.default_rng(n)
    few, many = (np.polynomial.legendre.leggauss(number) for number in (n, 80))
    X = deepest(n)
    worst = 0.0
    for trial in range(2000):
        # A cubic from 0 to 1: Bernstein's coefficients say so, or Chebyshev's extremes.
        b = rng.random(4) ** 0.3 if trial % 3 else np.array([0, 3, -2, 1.0]) * rng.choice([-1, 1])
        b = b - min(b.min(), 0) if trial % 3 else b + (b[1] < 0)
        ends = rng.random(2) * (rng.random(2) < 0.8)
        if not ends.any():
            continue

        def scalar(x, b=b):
            t = (x + 1) / 2
            return b[0] * (1 - t) ** 3 + 3 * b[1] * t * (1 - t) ** 2 + 3 * b[2] * t**2 * (1 - t) + b[3] * t**3

        v = np.polynomial.Polynomial.fit(few[0], scalar(few[0]), 3, domain=[-1, 1])
        q = ends[0] + (ends[1] - ends[0]) * v
        D = q.integ()
        q, D = (one * X / (D(1) - D(-1)) for one in (q, D - D(-1)))
        rule, truth = (float(w @ (v(x) * q(x) * np.exp(-D(x)))) for x, w in (few, many))
        worst = max(worst, abs(rule - truth) / -np.expm1(-X))
    assert worst < ACCURACY + 1e-14


def test_rules_reach_farther_the_more_nodes_they_have():
    depths = [deepest(n) for n in NODES]
    assert depths == sorted(depths) and depths[0] > 1e-4 and depths[-1] > 6


@pytest.mark.parametrize("seed", range(24))
def test_pieces_are_exact(seed):
    scene, _ = piece(seed, 4)
    image = scene.render(wvr.Exact())
    for y, x in np.ndindex(image.rgba.shape[:2]):
        truth = scene.enclose(x, y)
        assert errors(image.rgba[y, x], truth)[1] < 1e-13


@pytest.mark.parametrize("name", [name for name in KINDS if name != "spikes"])
def test_rays_are_exact(name):
    """But where slopes are so steep that rounding of the scalar matters."""
    for seed in range(2, 5):
        scene = adversary(name, seed)
        image = scene.render(wvr.Exact())
        for y, x in np.ndindex(image.rgba.shape[:2]):
            truth = scene.enclose(x, y)
            assert errors(image.rgba[y, x], truth)[0] < 1e-12 * brightest(scene)
