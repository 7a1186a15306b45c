"""Numbers that a precision cannot hold: refused with a message that says which, or rendered right."""

import numpy as np
import pytest

import wvr

SIZE = (16, 16)
INTEGRATORS = {
    type(one).__name__: one
    for one in (
        wvr.Riemann(0.25),
        wvr.Simpson(0.25),
        wvr.Preintegrated(0.5),
        wvr.AdaptivePreintegrated(1e-2),
        wvr.AdaptiveSimpson(1e-2),
        wvr.Certified(1 / 512),
        wvr.Exact(),
    )
}
RAMP = np.broadcast_to(np.arange(5.0), (5, 5, 5)).copy()  # along x


def render(volume, tf, integrator, **options):
    """The image, checked for what an image can be, or the error that refuses it."""
    try:
        image = wvr.render(volume, tf, wvr.Camera.fit(volume), SIZE, integrator=integrator, **options)
    except ValueError as error:
        assert any(word in str(error) for word in ("transfer_function", "volume", "tolerance"))
        assert any(digit in str(error) for digit in "0123456789")
        return error
    assert np.all(np.isfinite(image.rgba))
    assert image.rgba.min() >= 0
    assert image.rgba[..., 3].max() <= 1
    if image.error_bound is not None:
        assert np.all(np.isfinite(image.error_bound))
        assert image.error_bound.min(initial=1, where=image.rgba[..., 3] > 0) > 0
    return image


def ramp(scale, offset=0.0, dtype="float64"):
    """A scene that is the same at any scale and offset, but for rounding."""
    tf = wvr.TransferFunction(
        [
            (offset, "red", 0.0),
            (offset + scale, "blue", 0.3),
            (offset + scale, "green", 0.1),
            (offset + 4 * scale, "white", 0.6),
        ]
    )
    return wvr.Volume((RAMP * scale + offset).astype(dtype)), tf


@pytest.mark.parametrize("exponent", [-300, -170, -45, -30, 30, 38, 170, 300])
def test_scales_of_float64_samples(exponent):
    volume, tf = ramp(10.0**exponent)
    truth = render(*ramp(1.0), wvr.Exact()).rgba
    assert truth[..., 3].max() > 0.6
    exact = render(volume, tf, wvr.Exact())
    # A jump is where it is but for rounding of its scalar.
    assert np.abs(exact.rgba - truth).max() < 1e-12
    image = render(volume, tf, wvr.Certified(1e-5))
    assert np.all(np.abs(image.rgba - truth).max(-1) <= image.error_bound)
    assert image.error_bound.max() <= 1e-5


@pytest.mark.parametrize("exponent", [-300, -40, -20, 20, 30, 37, 200])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_scales_and_integrators(exponent, name):
    dtype = "float32" if abs(exponent) < 38 else "float64"
    image = render(*ramp(10.0**exponent, dtype=dtype), INTEGRATORS[name])
    if not isinstance(image, ValueError):
        expected = render(*ramp(1.0), INTEGRATORS[name]).rgba
        assert np.abs(image.rgba - expected).max() < 2e-3


@pytest.mark.parametrize("offset", [1e3, -1e6, 1e10])
def test_offsets(offset):
    volume, tf = ramp(1.0, offset)
    truth = render(*ramp(1.0), wvr.Exact()).rgba
    assert np.abs(render(volume, tf, wvr.Exact()).rgba - truth).max() < 1e-15 * abs(offset) + 1e-13
    image = render(volume, tf, wvr.Certified(1e-4))
    assert np.all(np.abs(image.rgba - truth).max(-1) <= image.error_bound)


@pytest.mark.parametrize("value, extinction", [(0.0, 0.0), (5e-14, 0.5), (1e-13, 1.0), (1.0, 1.0), (2e4, 1.0)])
@pytest.mark.parametrize(
    "name", [name for name in INTEGRATORS if "Preintegrated" not in name]
)  # whose tables are coarser
def test_control_points_close_to_each_other_beside_large_ones(value, extinction, name):
    tf = wvr.TransferFunction([(0, "red", 0.0), (1e-13, "red", 1 - np.exp(-1)), (1e4, "red", 1 - np.exp(-1))])
    volume = wvr.Volume(np.full((5, 5, 5), value))
    camera = wvr.Camera([2, 2, 20], [2, 2, 2], up=(0, 1, 0), parallel_scale=1)
    image = wvr.render(volume, tf, camera, SIZE, integrator=INTEGRATORS[name])
    assert np.abs(image.rgba[..., 3] - (1 - np.exp(-4 * extinction))).max() < 1 / 512


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("at", [1e-9, 1e-20, -1e-20, 1e-30])
def test_samples_close_to_a_jump_beside_large_ones(name, at, dtype):
    tf = wvr.TransferFunction([(at, "red", 0), (at, "red", 0.5), (1, "red", 0.5)])
    image = render(wvr.Volume(np.zeros((5, 5, 5), dtype)), tf, INTEGRATORS[name])
    assert (image.rgba.max() > 0.9) == (at <= 0)


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("gap", [1e-45, 1e-38, 1e-30, 1e-130, 1e-300, 5e-324])
@pytest.mark.parametrize("kind", ["steps", "zeros", "smooth"])
def test_control_points_at_almost_one_scalar(name, gap, kind):
    samples = {"steps": RAMP // 3, "zeros": 0 * RAMP, "smooth": RAMP / 4}[kind].astype(np.float32)
    tf = wvr.TransferFunction([(0, "red", 0), (gap, "white", 0.5), (1, "blue", 0.1)])
    jump = wvr.TransferFunction([(0, "red", 0), (0, "white", 0.5), (1, "blue", 0.1)])
    image = render(wvr.Volume(samples), tf, INTEGRATORS[name])
    if not isinstance(image, ValueError):
        if kind == "zeros":
            assert image.rgba.max() == 0
        else:
            if kind == "steps":
                # At the foot, where samples are 0, a jump sees all.
                jump = wvr.TransferFunction([(0.5 * gap, "red", 0), (0.5 * gap or gap, "white", 0.5), (1, "blue", 0.1)])
            truth = render(wvr.Volume(samples), jump, wvr.Exact()).rgba
            # Samples of a step miss where it begins.
            exact = name in ("Certified", "Exact")
            assert np.abs(image.rgba - truth).max() < (1 / 512 if exact else 0.05 if kind == "smooth" else 0.3)


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("unit_distance", [1e-38, 1e-45, 1e-150, 1e-300, 1e38, 1e150, 1e300])
@pytest.mark.parametrize("opacity", [0.5, 1.0])
def test_unit_distances(name, unit_distance, opacity):
    tf = wvr.TransferFunction([(0, "red", 0), (4, "white", opacity)], unit_distance=unit_distance)
    image = render(wvr.Volume(RAMP), tf, INTEGRATORS[name])
    if isinstance(image, ValueError):
        assert unit_distance < 1 and "unit_distance" in str(image)
    else:
        assert (image.rgba[..., 3].max() > 0.99) == (unit_distance < 1)


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("brightness", [1e20, 1e30, 1e39, 1e90, 1e150, 1e300, 1e-40, 1e-300])
def test_colours(name, brightness):
    tf = wvr.TransferFunction([(0, (brightness, 0, 0), 0), (4, (brightness, brightness / 2, 0), 0.5)])
    image = render(wvr.Volume(RAMP), tf, INTEGRATORS[name])
    if not isinstance(image, ValueError) and brightness > 1e-30:
        ones = wvr.TransferFunction([(0, (1, 0, 0), 0), (4, (1, 0.5, 0), 0.5)])
        expected = render(wvr.Volume(RAMP), ones, INTEGRATORS[name]).rgba
        assert np.abs(image.rgba[..., :3] / brightness - expected[..., :3]).max() < 2e-3


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("scale", [1e28, 1e30, 3e38, 1e100, 1e300])
def test_samples_far_beyond_the_control_points(name, scale):
    dtype = "float32" if scale < 1e39 else "float64"
    tf = wvr.TransferFunction([(0, "red", 0.2), (1, "white", 0.5)])
    volume = wvr.Volume(((RAMP / 4 - 0.5) * scale).astype(dtype))
    image = render(volume, tf, INTEGRATORS[name])
    if not isinstance(image, ValueError):
        jump = wvr.TransferFunction([(-1, "red", 0.2), (0, "red", 0.2), (0, "white", 0.5), (1, "white", 0.5)])
        truth = render(wvr.Volume(RAMP / 4 - 0.5), jump, wvr.Exact()).rgba
        # AdaptiveSimpson steps over a jump.
        assert np.abs(image.rgba - truth).max() < 0.08


@pytest.mark.parametrize("spacing", [1e-300, 1e-150, 1e-45, 1e-20, 1e20, 1e150, 1e300])
@pytest.mark.parametrize("name", INTEGRATORS)
def test_spacings(name, spacing):
    tf = wvr.TransferFunction([(0, "red", 0), (4, "white", 0.5)])
    try:
        volume = wvr.Volume(RAMP, spacing=(spacing, 2 * spacing, spacing))
    except ValueError as error:
        assert "spacing" in str(error)
        return
    image = render(volume, tf, INTEGRATORS[name])
    if not isinstance(image, ValueError):
        expected = render(wvr.Volume(RAMP, spacing=(1, 2, 1)), tf, INTEGRATORS[name]).rgba
        assert np.abs(image.rgba - expected).max() < 2e-3


@pytest.mark.parametrize("spacing", [(1e-150, 1, 1e-45), (1e-5, 1, 1), (1, 1e6, 1), (1e-12, 1, 1e12)])
@pytest.mark.parametrize("name", ["Certified", "Exact"])
def test_spacings_that_differ(name, spacing):
    try:
        volume = wvr.Volume(RAMP, spacing=spacing, origin=(-1e3, 0, 7))
    except ValueError as error:
        assert "spacing" in str(error)
        return
    tf = wvr.TransferFunction([(0, "red", 0), (4, "white", 0.5)])
    render(volume, tf, INTEGRATORS[name])


@pytest.mark.filterwarnings("ignore:the volume.s scalars")
@pytest.mark.parametrize("spacing", [(1, 1, 1e30), (1e-20, 1, 1e20), (1e30, 1e-30, 1e-30)])
@pytest.mark.parametrize("scale", [1e-290, 1e-125, 1])
def test_samples_that_underflow_along_a_long_cell(spacing, scale):
    """What is off by 5e-324 in a coefficient counts by cubes of a ray's length in the cell: noise about a jump."""
    spacing, rng = np.array(spacing), np.random.default_rng(5)
    volume = wvr.Volume((rng.random((6, 6, 6)) - 0.5) * scale, spacing)
    tf = wvr.TransferFunction([(-1, "red", 0), (0, "red", 0), (0, "lime", 0.6), (1, "white", 0.6)], spacing.max())
    middle = 2.5 * spacing
    camera = wvr.Camera(middle + 10 * rng.normal(size=3) * spacing, middle, (1, 2, 3), parallel_scale=spacing.min())
    image = wvr.render(volume, tf, camera, (3, 2), tolerance=1e-2)
    for x, y in np.ndindex(3, 2):
        truth = wvr.enclose(volume, tf, camera, x, y, (3, 2))
        off = max((truth.lower - image.rgba[y, x]).max(), (image.rgba[y, x] - truth.upper).max())
        assert off <= image.error_bound[y, x]


@pytest.mark.parametrize("exponent", [-310, -600, -900, 600])
def test_places_and_colours_of_scalars_of_any_size(exponent):
    """Probes take scalars as they are: control points that are all little stay where they are."""
    samples = np.random.default_rng(3).random((6, 6, 6))
    camera = wvr.Camera.fit(wvr.Volume(samples), (1, 2, 3))

    def seen(scale):
        points = [(0, "red", 0), (0.3 * scale, "lime", 0.1), (0.5 * scale, "blue", 0.2), (scale, "white", 0.4)]
        scene = wvr.Volume(samples * scale), wvr.TransferFunction(points), camera, (8, 8)
        image, most = wvr.render(*scene), wvr.render(*scene, integrator=wvr.Projection("max"))
        return image.depth(0.5), image.pick(4, 4).value / scale, most.rgba

    for ours, theirs in zip(seen(2.0**exponent), seen(1.0), strict=True):
        assert np.array_equal(ours, theirs, equal_nan=True) and np.isfinite(theirs).any()


@pytest.mark.parametrize("integrator", [wvr.Projection("max"), wvr.Isosurface(5e-313)])
def test_denormal_control_points_are_not_looked_up(integrator):
    samples = np.random.default_rng(3).random((4, 4, 4)) * 1e-312
    with pytest.raises(ValueError, match=r"transfer_function has control points up to .*e-31.*, below 1e-300"):
        wvr.render(samples, size=(4, 4), integrator=integrator)
    tf = wvr.TransferFunction([(0, "red", 0.1), (1e-312, "blue", 0.5)])
    image = wvr.render(samples, tf, size=(4, 4))
    assert np.isfinite(image.rgba).all() and image.rgba.max() > 0.1
    with pytest.raises(ValueError, match="below 1e-300"):
        image.depth()


@pytest.mark.parametrize("spacing", [(1, 1, 1e62), (1e45, 1e-45, 1e45)])
def test_cells_that_are_too_long(spacing):
    with pytest.raises(ValueError, match=r"spacing must have cells .* none more than 1e\+60 times as long as another"):
        wvr.Volume(RAMP, spacing=spacing)
    with pytest.raises(ValueError, match="with the direction"):
        wvr.Volume(RAMP, direction=np.diag(spacing))


@pytest.mark.parametrize("scale, edge", [(1e-14, 1e-4), (1e-16, 1e-2), (1e-17, 0.05)])
def test_slopes_that_single_precision_does_not_hold(scale, edge):
    """Extinction that rises by more than 1e18 in a unit of the scalar: no bound is negative."""
    data = (scale * np.random.default_rng(0).random((6, 6, 6))).astype(np.float32)
    volume = wvr.Volume(data)
    points = np.array([0, 0.5, 0.5 + edge, 1.0]) * scale
    colors = np.array([[0, 0, 0], [1, 0.5, 0], [1, 1, 1], [1, 1, 1.0]])
    tf = wvr.TransferFunction.from_arrays(points, colors, np.array([0, 0, 0.9, 0.9]))
    camera = wvr.Camera.fit(volume, (1, 2, 3))
    image = wvr.render(volume, tf, camera, (12, 12), tolerance=1e-2)
    exact = wvr.render(volume, tf, camera, (12, 12), integrator=wvr.Exact())
    assert exact.rgba[..., 3].max() > 0.1
    assert image.error_bound.min() >= 0
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=-1) <= image.error_bound + 1e-6)


def test_large_samples_in_cut_cells():
    """Cubes of what the scalar changes by are beyond single precision: left to double, not infinite."""
    scale = 2e17
    z, y, x = np.indices((8, 9, 10)) / 10
    volume = wvr.Volume((scale * (0.3 * x + 0.2 * y * y + 0.3 * z * x + 0.01)).astype(np.float32))
    at = np.linspace(0, 1, 256)
    colors = 0.5 + 0.5 * np.stack([np.sin(5 * at + i) for i in range(3)], axis=-1)
    tf = wvr.TransferFunction.from_arrays(scale * at, colors, 0.018 * at**2)
    camera = wvr.Camera.fit(volume, (1, 2, 3))
    image = wvr.render(volume, tf, camera, (12, 12), tolerance=1e-3, precision="float32")
    exact = wvr.render(volume, tf, camera, (12, 12), integrator=wvr.Exact())
    assert np.all(np.abs(image.rgba - exact.rgba).max(axis=-1) <= image.error_bound + 1e-6)
