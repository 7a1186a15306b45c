"""Enclosures against closed forms, quadrature of another making, and themselves; what is refused."""

import sys
from itertools import product

import mpmath
import numpy as np
import pytest
from flint import arb, ctx

import wvr
from studies.base.adversarial import adversary, function
from studies.base.reference import trilinear
from wvr.enclosure.balls import Break, Cubic, Gap, break_of, parts, zeros

from ..helpers import along

STEP = [(0, "red", 0), (1, "red", 0), (1, "red", 0.5), (2, "red", 0.5)]


def enclosed(volume, tf, camera, size=(3, 3), **options):
    """Lower and upper values of a whole image, (2, height, width, 4)."""
    found = [[wvr.enclose(volume, tf, camera, x, y, size, **options) for x in range(size[0])] for y in range(size[1])]
    return np.array([[[one.lower for one in row] for row in found], [[one.upper for one in row] for row in found]])


def assert_encloses(bounds, truth, width=1e-14):
    """A truth that is itself rounded."""
    assert np.all(bounds[0] - width <= truth) and np.all(truth <= bounds[1] + width)
    assert np.all(bounds[1] - bounds[0] <= width)


# --- Closed forms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["uint8", "int8", "int16", "uint16", "float16", "float32", "float64"])
@pytest.mark.parametrize("axis", range(3))
def test_a_homogeneous_block(dtype, axis):
    volume = wvr.Volume(np.ones((4, 5, 6), dtype), (0.5, 1.25, 2))
    tf = wvr.TransferFunction([(0, (0.25, 0.5, 1), 0.5), (2, (0.25, 0.5, 1), 0.5)], unit_distance=2.0)
    middle = volume.corners.mean(0)
    length = np.ptp(volume.corners[:, axis])
    opacity = 1 - 0.5 ** (length / 2)
    found = enclosed(volume, tf, along(axis, center=middle))
    assert_encloses(found, opacity * np.array([0.25, 0.5, 1, 1]))


@pytest.mark.parametrize("depth", [1e-12, 1e-3, 1.0, 30.0, 1e6])
@pytest.mark.parametrize("way", [1, -1])
def test_a_linear_ramp(depth, way):
    """From 0 to 1 along z, seen from either end, colour with extinction: closed forms by the error function."""
    volume = wvr.Volume(np.broadcast_to(np.arange(3.0)[:, None, None], (3, 3, 3)).copy())
    unit = float(np.log(2) * 4 / (2 * depth))  # extinction reaches log(2) / unit, of which the mean counts
    tf = wvr.TransferFunction([(0, (0, 1, 0), 0), (4, (4, 1, 0), 0.75)], unit_distance=unit)
    # Extinction k z, k = log(4) / (4 unit); colour z in red.
    with mpmath.workdps(40):
        k = mpmath.log(4) / (4 * mpmath.mpf(unit))
        a = mpmath.sqrt(k / 2)
        if way > 0:  # towards +z: int z k z exp(-k z^2 / 2) = -2 exp(-2 k) + int exp(-k z^2 / 2)
            red = -2 * mpmath.exp(-2 * k) + mpmath.sqrt(mpmath.pi) / (2 * a) * mpmath.erf(2 * a)
        else:  # int z k z exp(-k (4 - z^2) / 2) = 2 - exp(-2 k) int exp(k z^2 / 2)
            red = 2 - mpmath.exp(-2 * k) * mpmath.sqrt(mpmath.pi) / (2 * a) * mpmath.erfi(2 * a)
        opacity = -mpmath.expm1(-2 * k)
        truth = [float(red), float(opacity), 0.0, float(opacity)]
    found = enclosed(volume, tf, along(2, way, center=(1, 1, 1)), (1, 1))
    assert_encloses(found, truth)
    assert np.all(found[1] - found[0] <= 4e-16 * np.maximum(found[1], 1e-300))


@pytest.mark.parametrize("invert", [False, True])
def test_clips_of_a_homogeneous_block(invert):
    """Chords of a ball, a box and a slab, of rays along z through a block of 8."""
    volume = wvr.Volume(np.ones((9, 9, 9), np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    camera, size = along(2, center=(4, 4, 4), scale=4), (5, 5)
    x, y = camera.rays(size)[0][..., 0], camera.rays(size)[0][..., 1]
    steps = wvr.Volume(np.arange(27.0).reshape(3, 3, 3) // 9, (3, 3, 3))  # a third of z
    inside = [
        (wvr.ClipSphere((4, 4, 3), 2.5, invert), 2 * np.sqrt(np.maximum(6.25 - (x - 4) ** 2 - (y - 4) ** 2, 0))),
        (wvr.ClipBox((1, 2.5, -9), (5, 9, 6), invert), 6.0 * ((x >= 1) & (x <= 5) & (y >= 2.5))),
        (wvr.ClipPlane((4, 4, 4), (0, 0.5, 1), invert), 4 + 0.5 * (y - 4)),
        (wvr.ClipVolume(steps, 1.25, invert), (6 - 3.75) * ((x <= 6) & (y <= 6))),
    ]
    for clip, length in inside:
        length = 8 - length if invert else length
        found = enclosed(volume, tf, camera, size, clip=clip)
        truth = np.repeat(1 - 0.5 ** length[..., None], 4, -1)
        assert_encloses(found, truth)


def test_several_clips_leave_what_all_of_them_do():
    volume = wvr.Volume(np.ones((9, 9, 9), np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    hole = wvr.ClipBox((0, 0, 5), (9, 9, 6), invert=True)
    clips = [wvr.ClipPlane((4, 4, 3), (0, 0, 1)), wvr.ClipSphere((4, 4, 4), 3), hole]
    found = enclosed(volume, tf, along(2, center=(4, 4, 4)), (1, 1), clip=clips)
    assert_encloses(found, 1 - 0.5 ** (2 + 1))


def test_a_mask_whose_samples_are_where_the_jump_is():
    samples = np.zeros((9, 9, 9), np.uint8)
    samples[2:8, 2:8, 2:8] = 1
    volume, tf = wvr.Volume(samples), wvr.TransferFunction(STEP)
    found = enclosed(volume, tf, along(0, center=(4, 4.25, 4.25)), (1, 1))
    assert_encloses(found, [[[1 - 0.5**5, 0, 0, 1 - 0.5**5]]])


def test_labels_meet_half_way():
    labels = np.zeros((4, 4, 8), np.uint16)
    labels[:, :, 3:], labels[:, :, 6:] = 1, 500
    volume = wvr.Volume(np.ones((4, 4, 8), np.float32))
    red, green = (wvr.TransferFunction([(0, c, 0.5), (2, c, 0.5)]) for c in ((1, 0, 0), (0, 1, 0)))
    segmentation = wvr.Segmentation(labels, {1: red, 500: green})
    camera = along(0, center=volume.corners.mean(0), scale=1.1)
    found = enclosed(volume, None, camera, (2, 2), segmentation=segmentation)
    # Nothing up to 2.5, red to 5.5, green to 7.
    assert_encloses(found, [1 - 0.5**3, 0.5**3 * (1 - 0.5**1.5), 0, 1 - 0.5**4.5])
    # Of three labels at a corner, by weights that are linear along z.
    labels = np.zeros((2, 2, 2), np.uint8)
    labels[0], labels[1, 0], labels[1, 1] = 1, 2, 3
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    clear = {n: wvr.TransferFunction([(0, c, 0), (2, c, 0)]) for n, c in ((2, "red"), (3, "blue"))}
    segmentation = wvr.Segmentation(labels, {1: tf, **clear})
    camera = along(2, center=(0.5, 0.75, 0.5))
    found = enclosed(wvr.Volume(np.ones((2, 2, 2))), None, camera, (1, 1), segmentation=segmentation)
    # 1 - z against z times 3 / 4.
    assert_encloses(found, 1 - 0.5 ** (4 / 7))


def test_samples_that_were_copied_are_those_that_are_there_now():
    """Of the volume, labels and a clip: they were enclosed as they had been."""
    samples, labels, kept = np.ones((4, 4, 8)), np.ones((4, 4, 8), np.int64), np.ones((4, 4, 8))
    volume, inside = wvr.Volume(samples[::-1]), wvr.Volume(kept[::-1])
    tf = wvr.TransferFunction([(0, "white", 0.5), (1, "white", 0.5), (1, "white", 0.75), (2, "white", 0.75)])
    options = {"clip": wvr.ClipVolume(inside), "segmentation": wvr.Segmentation(labels, {1: tf})}
    camera = along(0, center=volume.corners.mean(0))
    assert_encloses(enclosed(volume, None, camera, (1, 1), **options), 1 - 0.25**7)
    samples[:] = 0.5
    assert_encloses(enclosed(volume, None, camera, (1, 1), **options), 1 - 0.5**7)
    labels[:, :, 5:] = 2
    assert_encloses(enclosed(volume, None, camera, (1, 1), **options), 1 - 0.5**4.5)
    kept[:, :, :2] = 0
    assert_encloses(enclosed(volume, None, camera, (1, 1), **options), 1 - 0.5**3)


def test_cells_that_touch_nan_are_absent():
    samples = np.ones((3, 3, 9))
    samples[0, 0, 4] = np.nan
    volume = wvr.Volume(samples, nan="transparent")
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    for height, length in ((0.5, 6), (1.5, 8)):
        found = enclosed(volume, tf, along(0, center=(4, 0.5, height)), (1, 1))
        assert_encloses(found, 1 - 0.5**length)
    # In the face between both: either.
    found = enclosed(volume, tf, along(0, center=(4, 0.5, 1)), (1, 1))
    assert np.all(found[0] <= 1 - 0.5**6) and np.all(found[1] >= 1 - 0.5**8) and np.all(found[1] < 1)


def test_the_camera_inside():
    volume = wvr.Volume(np.ones((9, 9, 9), np.uint8))
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    for start in (0, 3, 3.75, 8, 8.5):
        found = enclosed(volume, tf, wvr.Camera((4, 4, start), (4, 4, 20), up=(0, 1, 0)), (1, 1))
        assert_encloses(found, 1 - 0.5 ** max(8 - start, 0))


def test_a_length_that_the_volume_says():
    """PyVista's unit distance, of the transfer function and of labels."""
    volume = wvr.Volume(np.ones((4, 4, 4)), (1, 2, 3))
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)], unit_distance="pyvista")
    truth = 1 - 0.5 ** (9 / tf.for_volume(volume).unit_distance)
    labels = wvr.Segmentation(np.ones((4, 4, 4), np.uint8), {1: tf})
    for own, segmentation in ((tf, None), (None, labels)):
        found = enclosed(volume, own, along(2, center=(1.5, 3, 4)), (1, 1), segmentation=segmentation)
        assert_encloses(found, truth)


def test_a_thin_volume_is_one_spacing_thick():
    volume = wvr.Volume(np.ones((1, 1, 1), np.uint8), (1, 2, 3), (5, 6, 7))
    tf = wvr.TransferFunction([(0, "white", 0.5), (2, "white", 0.5)])
    for axis, length in enumerate((1, 2, 3)):
        found = enclosed(volume, tf, along(axis, center=(5, 6, 7), scale=0.25), (1, 1))
        assert_encloses(found, 1 - 0.5**length)
        # On the box's face, which belongs to it, and beside.
        for off, truth in ((0.5, 1 - 0.5**length), (0.5001, 0.0)):
            center = np.array([5.0, 6, 7])
            center[axis - 1] += off * (1, 2, 3)[axis - 1]
            assert_encloses(enclosed(volume, tf, along(axis, center=center), (1, 1)), truth)


# --- Another quadrature ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trial", range(12))
def test_a_piece_by_quadrature_of_many_digits(trial):
    """One cell, extinction and colour linear over its range: mpmath's tanh-sinh rule along the ray."""
    rng = np.random.default_rng(trial)
    volume = wvr.Volume(rng.random((2, 2, 2)))
    unit = 10.0 ** rng.uniform(-2, 1)
    tf = wvr.TransferFunction.from_arrays([0, 1], rng.random((2, 3)), rng.random(2), unit)
    ends = rng.random((2, 3)) * np.array([[0, 1, 1], [0, 1, 1]]) + [[0, 0, 0], [1, 0, 0]]
    camera = wvr.Camera(ends[0], ends[1], (0, 0, 1), view_angle=1.0)
    found = wvr.enclose(volume, tf, camera, 0, 0, (1, 1))
    with mpmath.workdps(30):
        o, e = ([mpmath.mpf(float(x)) for x in end] for end in ends)
        way = [b - a for a, b in zip(o, e, strict=True)]
        length = mpmath.sqrt(sum(w * w for w in way))
        corners = [[[mpmath.mpf(float(x)) for x in row] for row in plane] for plane in volume.numpy()]

        def scalar(t):
            x, y, z = (a + t * w for a, w in zip(o, way, strict=True))
            return sum(
                corners[k][j][i] * (x if i else 1 - x) * (y if j else 1 - y) * (z if k else 1 - z)
                for i, j, k in product((0, 1), repeat=3)
            )

        low, high = (-mpmath.log1p(-mpmath.mpf(float(a))) / mpmath.mpf(unit) * length for a in tf.opacities)
        # A cubic by its values at four places.
        nodes = [mpmath.mpf(n) / 3 for n in range(4)]
        powers = mpmath.matrix([[t**n for n in range(4)] for t in nodes])
        tau = list(mpmath.lu_solve(powers, mpmath.matrix([low + (high - low) * scalar(t) for t in nodes])))

        def depth(t):
            return sum(term * t ** (n + 1) / (n + 1) for n, term in enumerate(tau))

        def emission(t, c0, c1):
            color = c0 + (mpmath.mpf(c1) - c0) * scalar(t)
            return color * sum(term * t**n for n, term in enumerate(tau)) * mpmath.exp(-depth(t))

        cuts = mpmath.linspace(0, 1, 9)
        truth = [mpmath.quad(lambda t, c=c: emission(t, *c), cuts) for c in tf.colors.T.tolist()]
        truth.append(-mpmath.expm1(-depth(mpmath.mpf(1))))
        truth = [float(one) for one in truth]
    assert found.width < 1e-15
    assert np.all(found.lower - 4e-16 <= truth) and np.all(truth <= found.upper + 4e-16)


@pytest.mark.parametrize("trial", range(6))
def test_whole_rays_by_fine_sums(trial):
    """The midpoint rule, whose error falls with the square of the step, of continuous scenes, extrapolated."""
    rng = np.random.default_rng(trial)
    volume = wvr.Volume(rng.random((5, 6, 4)), (1, 0.8, 1.3))
    tf = function(rng, 0, 1, jumps=False)
    camera = wvr.Camera.fit(volume, rng.normal(size=3))
    size = (3, 3)
    origins, directions = camera.rays(size)
    found = enclosed(volume, tf, camera, size)
    o, d = origins[1, 1] - volume.origin, directions[1, 1]
    far = 2 * np.linalg.norm(camera.position - camera.target)
    n = 400_000
    t = (np.arange(n) + 0.5) / n * far
    p = (o + t[:, None] * d) / volume.spacing
    within = np.all((p >= 0) & (p <= np.array(volume.shape[::-1]) - 1), axis=1)
    s = trilinear(volume.numpy(), np.where(within[:, None], p, 0))
    tau = tf.extinction(s, volume.smallest_spacing) * within * far / n
    T = np.exp(-np.cumsum(tau)) / np.exp(-tau / 2)
    truth = np.append((tf.color(s) * (tau * T)[:, None]).sum(0), -np.expm1(-tau.sum()))
    # The ends of the box are met to half a step.
    assert_encloses(found[:, 1, 1], truth, width=2e-5)


# --- What an enclosure is -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sheared", "labels", "clips", "spikes", "distant"])
def test_more_bits_are_never_outside_fewer(name, monkeypatch):
    """Enclosures of different precisions overlap, since they have the truth in them; and finer ones are narrower."""
    from wvr.enclosure import rays

    scene = adversary(name, 3)
    widths, before = [], None
    for bits in (64, 128, 192, 384):
        monkeypatch.setattr(rays, "LEAST", bits)
        monkeypatch.setattr(rays, "MOST", bits)
        found = [scene.enclose(x, y, width=1e-300) for x in range(6) for y in range(6)]
        widths.append(max(one.width for one in found))
        for one, other in zip(found, before or found, strict=True):
            assert np.all(one.lower <= other.upper) and np.all(other.lower <= one.upper)
        before = found
    assert widths == sorted(widths, reverse=True) and widths[-1] < 1e-15
    assert ctx.prec == 53


def test_a_ray_along_a_jump_is_undecided_and_says_so_soon():
    """All along the ray the scalar is that of the jump, but for a third that no binary fraction is."""
    samples = np.broadcast_to(np.arange(7.0)[None, :, None], (7, 7, 7)).copy()
    volume = wvr.Volume(samples)
    tf = wvr.TransferFunction([(0, "red", 0), (3, "red", 0), (3, "red", 0.5), (7, "red", 0.5)])
    # The plane y = 3 exactly: decided, since all is exact there; "at and above" holds.
    found = enclosed(volume, tf, along(2, center=(3.25, 3, 3)), (1, 1))
    assert_encloses(found, [[[1 - 0.5**6, 0, 0, 1 - 0.5**6]]])
    # A view that is turned by what is not exact: the same plane, which nobody can tell.
    turned = wvr.Camera((3.25, 3, 20), (3.25, 3, 3), up=(1, 1, 0), parallel_scale=1)
    pixel = wvr.enclose(volume, tf, wvr.Camera((1.0, 3, 20), (3.7, 3, 2.9), up=(0, 1, 0), view_angle=77), 0, 1, (3, 3))
    assert pixel.width < 1 and pixel.lower[3] <= pixel.upper[3]
    assert wvr.enclose(volume, tf, turned, 1, 1, (3, 3)).width < 1e-12


@pytest.mark.parametrize("levels", [[0.0], [-0.25, 0.0, 0.1]])
def test_all_crossings_are_found(levels):
    """Of cubics made of their roots, single, double and triple, or about as close."""
    rng = np.random.default_rng(0)
    with ctx.workprec(192):
        for _ in range(200):
            roots = rng.choice(17, 3) / 8 - 1 + rng.choice([0, 1e-9, 1e-15], 3)
            r, s, t = (arb(float(root)) for root in roots)
            c = Cubic(-r * s * t, r * s + s * t + t * r, -(r + s + t), arb(1))
            found = zeros(c, [arb(level) for level in levels], arb(-2), arb(2), arb(2) ** -64)
            for root in roots:
                assert any(one.low <= root <= one.high for one in found)
            assert sum(float(one.high - one.low) for one in found) < 1e-15
            assert len(found) < 40


def test_parts_cover_everything_in_order():
    rng = np.random.default_rng(1)
    with ctx.workprec(128):
        for _ in range(50):
            breaks = [break_of(arb(float(t), float(r))) for t, r in zip(rng.random(9), rng.random(9) / 30, strict=True)]
            found = list(parts(breaks))
            assert isinstance(found[0], Break) and isinstance(found[-1], Break) and len(found) % 2
            for one, gap, two in zip(found[::2], found[1::2], found[2::2], strict=False):
                assert isinstance(gap, Gap) and one.high < gap.middle < two.low
            for one in breaks:
                assert any(part.low <= one.low and one.high <= part.high for part in found[::2])
            assert [part.once for part in found[::2]].count(True) == sum(
                sum(a.low <= b.high and b.low <= a.high for b in breaks) == 1 for a in breaks
            )


# --- What is refused ------------------------------------------------------------------------------------------------


def test_what_is_refused():
    volume, tf = wvr.Volume(np.ones((3, 3, 3))), wvr.TransferFunction(STEP)
    camera = wvr.Camera.fit(volume)

    class Other(wvr.ClipSphere):
        """Whose device half may be anything."""

    labels = wvr.Segmentation(np.ones((2, 3, 3), np.uint8), {1: tf})
    for error, message, options in (
        (ValueError, "x must be from 0 to 511", {"x": 512}),
        (ValueError, "y must be from 0 to 511", {"y": -1}),
        (TypeError, "x must be an integer", {"x": 1.5}),
        (ValueError, "width must be finite and > 0", {"width": 0.0}),
        (ValueError, "lighting must be None", {"lighting": wvr.Lighting()}),
        (ValueError, "shadows must be None", {"shadows": wvr.ConvolutionShadows()}),
        (ValueError, "without naive or parts", {"clip": wvr.ClipPlane((0, 0, 0), (0, 0, 1), naive=True)}),
        (ValueError, "without naive or parts", {"clip": wvr.ClipVolume(volume, parts="power")}),
        (TypeError, "clip must be", {"clip": "plane"}),
        (TypeError, "clip must be ClipPlane, .* got Other", {"clip": Other((0, 0, 0), 1)}),
        (TypeError, "volume must be a Volume", {"volume": np.ones((3, 3, 3))}),
        (TypeError, "transfer_function must be", {"transfer_function": None}),
        (TypeError, "camera must be a Camera", {"camera": "iso"}),
        (ValueError, "labels of the volume's shape", {"segmentation": labels}),
        (ValueError, "size must be", {"size": (0, 3)}),
    ):
        given = {"volume": volume, "transfer_function": tf, "camera": camera, "x": 0, "y": 0} | options
        with pytest.raises(error, match=message):
            wvr.enclose(**given)


def test_without_flint_it_says_what_to_install(monkeypatch):
    volume = wvr.Volume(np.ones((3, 3, 3)))
    for name in [name for name in sys.modules if name.startswith("wvr.enclosure.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(ImportError, match=r"python-flint: pip install \"wvr\[enclose\]\""):
        wvr.enclose(volume, wvr.TransferFunction(STEP), wvr.Camera.fit(volume), 0, 0)
