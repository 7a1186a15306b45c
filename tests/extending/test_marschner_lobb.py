"""The field of the recipe: rays through it in closed form, and volumes that sample it."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

import wvr

from ..helpers import max_error
from .gauss import Gauss
from .marschner_lobb import MarschnerLobb

FIELD = MarschnerLobb(frequency=2.0)
TF = wvr.TransferFunction.from_arrays([0, 1], [[0.9, 0.1, 0.3], [0.1, 0.6, 1.0]], [0.0, 0.3], unit_distance=0.1)
CAMERA = wvr.Camera.fit(FIELD)
SIZE = (32, 32)


def signal(x, y, z, field=FIELD):
    wave = np.cos(2 * np.pi * field.frequency * np.cos(np.pi * np.hypot(x, y) / 2))
    return (1 - np.sin(np.pi * z / 2) + field.alpha * (1 + wave)) / (2 * (1 + field.alpha))


def sampled(n, field=FIELD):
    x = np.linspace(-1, 1, n)
    z, y, x = np.meshgrid(x, x, x, indexing="ij")
    return wvr.Volume(signal(x, y, z, field).astype(np.float32), (2 / (n - 1),) * 3, (-1, -1, -1))


def image(field, integrator, **kwargs):
    return wvr.render(field, TF, CAMERA, SIZE, integrator=integrator, termination=0, **kwargs)


def test_rays_are_those_of_the_formula():
    """Along x, by quadrature in NumPy: emission at 400 nodes of Gauss and Legendre, of 50 pieces."""
    camera = wvr.Camera((10, 0, 0), (0, 0, 0), parallel_scale=0.9)
    found = wvr.render(FIELD, TF, camera, (5, 5), integrator=Gauss(0.1), precision="float64", termination=0).rgba
    right, up, _ = camera.basis()
    nodes, weights = leggauss(8)
    edges = np.linspace(1, -1, 51)
    half = 0.02
    x = (edges[:-1, None] - half * (1 + nodes)).ravel()
    # Optical depth up to each node: that of whole pieces before, and of its own piece from its own quadrature.
    for row in range(5):
        for column in range(5):
            _, y, z = 0.36 * ((column - 2) * right + (2 - row) * up)
            whole = TF.extinction(signal(x, y, z)).reshape(50, 8) @ weights * half
            before = np.concatenate([[0.0], np.cumsum(whole)[:-1]])
            own = np.empty((50, 8))
            for n, node in enumerate(nodes):
                inner = edges[:-1, None] - half * (1 + node) * (1 + nodes) / 2
                own[:, n] = TF.extinction(signal(inner, y, z)) @ weights * half * (1 + node) / 2
            seen = TF.extinction(signal(x, y, z)).reshape(50, 8) * np.exp(-before[:, None] - own) * weights * half
            s = signal(x, y, z).reshape(50, 8, 1)
            color = TF.colors[0] + s * (TF.colors[1] - TF.colors[0])
            expected = np.append((seen[..., None] * color).sum(axis=(0, 1)), -np.expm1(-whole.sum()))
            assert np.abs(found[row, column] - expected).max() < 1e-6


@pytest.mark.parametrize(
    ("method", "lighting"), [(wvr.Simpson, None), (wvr.Riemann, wvr.Lighting())], ids=["unlit", "lit"]
)
def test_volumes_that_sample_it_converge_to_it(method, lighting):
    """With order 2 in the distance of their samples, as trilinear interpolation does; lit, by gradients that do."""
    truth = image(FIELD, method(0.2), lighting=lighting).rgba
    errors = []
    for n in (21, 41, 81):
        one = image(sampled(n), method(0.2 * (n - 1) / 40), lighting=lighting)
        errors.append(np.abs(one.rgba - truth).mean())
    order = np.log2(errors[0] / errors[2]) / 2
    assert errors[2] < 1e-3 and order == pytest.approx(2, abs=0.4)


@pytest.mark.parametrize(
    ("integrator", "most"),
    [
        (wvr.Simpson(0.25), 1e-5),
        (wvr.Preintegrated(0.25), 1e-3),
        (wvr.AdaptiveSimpson(1e-6, hmin=0.01), 1e-5),
    ],
    ids=lambda value: type(value).__name__,
)
def test_integrators_agree(integrator, most):
    assert max_error(image(FIELD, integrator), image(FIELD, Gauss(0.05), precision="float64").rgba) < most


def test_clips_and_labels():
    def cut(step, **cuts):
        return image(FIELD, Gauss(step), precision="float64", **cuts)

    truth = cut(0.2).rgba
    across = np.cross(CAMERA.basis()[2], (0, 0, 1))
    halves = [cut(0.2, clip=wvr.ClipPlane((0, 0, 0), side * across)) for side in (1, -1)]
    assert np.abs(sum(half.rgba for half in halves) - truth).max() < 1e-5
    labels = (np.indices(FIELD.shape)[0] > 20).astype(np.uint8)
    for skip in (True, False):
        same = wvr.Segmentation(labels, {0: TF, 1: TF})
        assert max_error(cut(0.2, segmentation=same, skip_empty=skip), truth) < 1e-6
        part = wvr.Segmentation(labels, {0: TF})
        below = cut(0.05, clip=wvr.ClipPlane((0, 0, 0.025), (0, 0, -1)))
        assert max_error(cut(0.05, segmentation=part, skip_empty=skip), below.rgba) < 1e-5


def test_shadows():
    shadows = wvr.ConvolutionShadows(light=wvr.DirectionalLight((1, 1, 1)), slice_distance=0.5)
    options = {"shadows": shadows, "precision": "float64"}
    found = image(FIELD, Gauss(0.2), **options)
    assert max_error(found, image(sampled(41), wvr.Exact(), **options).rgba) < 0.02
    assert max_error(found, image(FIELD, Gauss(0.2), precision="float64").rgba) > 0.05


def test_renderer_keeps_what_an_equal_field_has_built():
    renderer = wvr.Renderer(FIELD, TF, integrator=wvr.Preintegrated(0.5))
    first = renderer.render(CAMERA, SIZE).rgba
    before = dict(renderer.builds)
    renderer.volume = MarschnerLobb(frequency=2.0)
    assert np.array_equal(renderer.render(CAMERA, SIZE).rgba, first) and dict(renderer.builds) == before
    renderer.volume = MarschnerLobb(frequency=3.0)
    assert max_error(renderer.render(CAMERA, SIZE), first) > 0.01
    # The range is the same, so the table is; the blocks are another field's.
    changed = {name: count - before[name] for name, count in renderer.builds.items() if count > before[name]}
    assert changed == {"everything": 1}
    renderer.volume = sampled(41)
    renderer.render(CAMERA, SIZE)
    assert renderer.builds["volume"] == renderer.builds["kinds"] == 1


@pytest.mark.parametrize(
    "integrator",
    [wvr.Certified(1e-3), wvr.Exact(), wvr.AdaptivePreintegrated(1e-3)],
    ids=lambda one: type(one).__name__,
)
def test_integrators_that_go_cell_by_cell_are_refused(integrator):
    with pytest.raises(ValueError, match=r"integrator must be one that only samples the volume, .* a MarschnerLobb"):
        image(FIELD, integrator)


def test_what_needs_samples_says_so():
    with pytest.raises(ValueError, match="memory_limit is for volumes of samples, which a MarschnerLobb does not have"):
        image(FIELD, wvr.Riemann(0.5), memory_limit="1 GiB")
