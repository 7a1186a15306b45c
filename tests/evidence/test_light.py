"""Studies of light and shadows: what they promise holds, in small."""

import numpy as np
import pytest
from matplotlib import rc_context

import wvr
from studies import angelelli2017, campagnolo2015, lighting, roettger2003, slab_passes
from studies.angelelli2017 import methods, slice_by_slice, slices
from studies.angelelli2017.aliasing import aliasing
from studies.base import scenes
from studies.base.harness import STYLE

from .helpers import rows_of


def test_lighting(results):
    folder = results("lighting")
    pictures = {"modes", *(f"figure{n}" for n in (1, 2, 7, 8)), "figure8-bonsai", "plate1", "plates"}
    assert {path.stem for path in folder.glob("*/*.png")} == pictures
    rows = rows_of(folder / "modes", "modes")
    share = {row["scene"]: row["over center"] for row in rows if row["mode"] == lighting.EXACT}
    assert share["sphere"] < 0.3 and max(share.values()) < 0.9
    assert len(rows_of(folder / "table2", "table2")) == 4


def test_factors():
    """Of a clip field that is linear between the ends: where it is 0.5."""
    front, back = np.random.default_rng(0).random((2, 1000))
    factors = slab_passes.factors(front, back)
    t = np.linspace(0, 1, 20001)
    visible = front[:, None] + t * (back - front)[:, None] >= 0.5
    np.testing.assert_allclose(factors["b"], visible.mean(axis=1), atol=1e-4)
    some = visible.any(axis=1)
    np.testing.assert_allclose(factors["r"][some], t[visible[some].argmax(axis=1)], atol=1e-4)


def test_frame_buffer():
    """Without rounding, slabs blended in groups are the float image; with it, what is thin is lost."""
    scene = roettger2003.make_scene("NegHIP, semi-transparent", quick=True)
    camera = wvr.Camera.fit(scene.volume, parallel=True)
    scene = roettger2003.replace(scene, camera=camera, size=(12, 12))
    buffers = roettger2003.blended(scene, 4, {"one": (1, None), "four": (4, None), "fine": (1, 2**24), "2": (1, 2)})
    np.testing.assert_allclose(buffers["four"], buffers["one"], atol=1e-12)
    np.testing.assert_allclose(buffers["fine"], buffers["one"], atol=1e-4)
    assert buffers["one"].max() > 0.1 and not buffers["2"].any()
    assert wvr.compare(buffers["one"], scene.render(wvr.Exact())).max < 5e-3


def test_angelelli2017(tmp_path, monkeypatch):
    for name, value in (("DISTANCES", (0.5, 1.0, 2.0)), ("SUBSAMPLES", (1, 3)), ("FINE", 0.25)):
        monkeypatch.setattr(methods, name, value)
    for name, value in (("SUBSAMPLES", (1,)), ("KERNELS", (5, 9)), ("SCENES", ("bonsai",))):
        monkeypatch.setattr(slice_by_slice, name, value)
    # Of grey levels all of them, so that they share kernels.
    for name in ("cthead", "stent"):
        monkeypatch.setitem(scenes.SCANS, name, scenes.SCANS["engine"])
    with rc_context(STYLE):
        for part in angelelli2017.STUDY.parts.values():
            assert part.work(tmp_path, True)
    assert {f"figure{i}.png" for i in (1, 3, 4, 5, 6, 7)} <= {path.name for path in tmp_path.iterdir()}
    rows = {name: rows_of(tmp_path, name) for name in ("convergence", "streaming", "table1", "figure5")}
    order = {row["variant"]: row["order"] for row in rows["convergence"]}
    assert order["Strang, traced light"] > 1.8 and 0.9 < order["Lie, front light"] < 1.2
    # With the kernel of the papers finer slices go away from it.
    fixed = rows["convergence"][-1]
    assert fixed["0.25"] > max(3 * fixed["0.5"], fixed["1"])
    assert all("extents" not in row["built"] for row in rows["streaming"])
    difference = {(row["distance"], row["subsamples"]): row["difference"] for row in rows["table1"]}
    assert difference[0.2, 0] == 0 and difference[0.8, 3] < difference[0.8, 0]
    assert rows["table1"][-1]["paper ms"] == 182
    assert {row["method"] for row in rows["figure5"]} == {"ray cast", "Phong", "ICS", "SCS", "PI-ICS", "PI-SCS"}
    assert [row["K"] for row in rows_of(tmp_path, "slices")] == [5, 9]


def test_slices_have_the_light_of_the_sweep():
    """Of the same light the algorithm of the paper and the sweep come to the same image, and its kernel keeps what it
    is given: all light, its mean and its variance.
    """
    for taps in (5, 9):
        line = slices.kernel_of(0.4, 0.7, taps)
        i = np.arange(taps) - taps // 2
        assert np.allclose([line.sum(), line @ i, line @ i**2 - (line @ i) ** 2], [1, -0.4, 0.7])
    volume = wvr.datasets.load("blobs", 32)
    tf = wvr.TransferFunction([(60, "red", 0.0), (200, "white", 0.3)])
    camera = wvr.Camera.fit(volume, (0.3, 0.2, 1), (0, 1, 0), parallel=True)
    right, up, forward = camera.basis()
    light = wvr.DirectionalLight(tuple(slices.TILT * (up - right) - forward))
    sweep = wvr.ConvolutionShadows(
        0.25, light=light, spread=slices.SPREAD, cell=0.5, mode="view-aligned", image="slices"
    )
    truth = wvr.render(volume, tf, camera, (64, 64), shadows=sweep, lighting=False).rgba
    shown = truth[..., 3] > 0
    errors = [np.abs(slices.Slices(volume, tf).draw(camera, 64, d, 1).rgba - truth)[shown].mean() for d in (0.5, 0.25)]
    plain = wvr.render(volume, tf, camera, (64, 64), lighting=False).rgba
    print(errors, np.abs(plain - truth)[shown].mean())
    assert errors[1] < 0.6 * errors[0] and errors[1] < 0.1 * np.abs(plain - truth)[shown].mean()


def test_aliasing_is_what_is_fine():
    """Brightness that changes over the image is none; stripes are, but for the ninth of them in a window's mean."""
    x = np.arange(64)
    rgba = np.ones((64, 64, 4), np.float32)

    def image(red):
        rgba[..., :3] = linear(np.broadcast_to(red, (64, 64)))[..., None]
        return wvr.Image(rgba.copy(), np.zeros((64, 64), np.int32))

    def linear(s):
        return np.where(s < 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)

    plain = image(0.5)
    assert aliasing(plain, plain) == 0
    assert aliasing(image(0.3 + x / 256), plain) < 2e-3
    assert aliasing(image(0.5 + 0.1 * (-1.0) ** x), plain) == pytest.approx(0.1 * 8 / 9, rel=0.02)


def test_linear_opacity():
    """The opacity of a step is tau h, in world units of any size."""
    tf = wvr.TransferFunction([(0, "red", 0.0), (1, "blue", 0.6)])
    changed = campagnolo2015.linear_opacity(tf, unit=0.1, h=0.5)
    s = np.linspace(0, 1, 7)
    np.testing.assert_allclose(
        -np.expm1(-changed.extinction(s, 0.1) * 0.05), tf.extinction(s, 0.1) * 0.05, rtol=0, atol=1e-7
    )
    np.testing.assert_allclose(changed.color(s), tf.color(s), atol=1e-12)
