"""Kernels compile for CUDA, on machines without a GPU too: a sample here, all in the study."""

import numpy as np
import pytest
import warp as wp

import wvr
from benchmarks.kernels import GROWTH, regressions
from studies import cuda
from studies.base import ptx
from studies.base.cuda import compiled, instructions


def test_kernels_compile_for_cuda(tmp_path):
    assert cuda.kernels(tmp_path, quick=True).startswith("All of ")
    assert "certified smooth again" in (tmp_path / "kernels.csv").read_text()


def test_a_mistake_is_found(tmp_path):
    """The compiler does look: what only a CPU has does not compile."""

    @wp.func_native("return std::vector<double>(1)[0];")
    def host_only() -> wp.float64: ...

    @wp.kernel(enable_backward=False, module="unique")
    def wrong(out: wp.array(dtype=wp.float64)):
        out[wp.tid()] = host_only()

    with pytest.raises(RuntimeError, match="does not compile for sm_"):
        compiled(wrong, tmp_path)


def test_instructions_are_counted():
    text = ".version 9.4\n.reg .f64 %fd<3>;\n\tadd.f64 %fd1, %fd1, %fd2;\n// no;\n\tret;\n"
    assert instructions(text) == (2, 0.5)


@pytest.mark.skipif(not ptx.has_compiler(), reason="there is no C compiler")
def test_code_for_cuda_makes_the_image(blobs):
    """The compiler's own code for a GPU, run on the CPU: the same image, and next to nothing in float64."""
    tf = wvr.TransferFunction([(0, "black", 0.0), (90, "red", 0.0), (90, "gold", 0.2), (255, "white", 0.3)])
    renderer = wvr.Renderer(blobs, tf, integrator=wvr.Riemann(0.1), device="cpu")
    camera, executed = wvr.Camera.fit(blobs), {}
    with ptx.cast_by_cuda(executed) as usual:
        image = renderer.render(camera, (17, 13))
        with usual():
            reference = renderer.render(camera, (17, 13))
    (counts,) = executed.values()
    assert np.abs(image.rgba - reference.rgba).max() <= 2.0**-22 and reference.rgba.max() > 0.2
    np.testing.assert_array_equal(image.samples, reference.samples)
    assert sum(counts.values()) > 10 * image.samples.sum() > 10_000
    assert ptx.float64(counts) < 0.02


@wp.kernel(enable_backward=False, module="unique")
def arithmetic(base: int, a: wp.array(dtype=float), b: wp.array(dtype=wp.float64), n: wp.array(dtype=wp.int32)):
    i = wp.tid() + base
    x = wp.float64(a[i])
    y = wp.exp(-x * x) + wp.sqrt(wp.abs(x)) / (x * x + wp.float64(3.0))
    k = wp.int32(wp.floor(a[i] * 7.0)) ^ (i << 3)
    for _ in range(i % 5):
        y = wp.max(y - wp.float64(0.25), wp.log(y + wp.float64(2.0)))
        k = (k >> 1) * 3 - (k & 5) // 2 + k % 7
    b[i] = wp.where(k > 4, y, -y) + wp.float64(wp.sin(a[i])) + wp.float64(wp.exp(a[i]))
    n[i] = k


@pytest.mark.skipif(not ptx.has_compiler(), reason="there is no C compiler")
def test_instructions_do_what_they_say(tmp_path):
    """Of integers and floats, signed, shifted, rounded and compared, as Warp has them on the CPU; no items beyond."""
    values = np.linspace(-3, 3, 300).astype(np.float32)
    found = []
    for run in ("usual", "cuda"):
        a = wp.array(values, dtype=float, device="cpu")
        b, n = wp.zeros(300, dtype=wp.float64, device="cpu"), wp.full(300, -99, dtype=wp.int32, device="cpu")
        if run == "usual":
            wp.launch(arithmetic, 290, [0, a, b, n], device="cpu")
        else:
            code = ptx.Compiled(arithmetic, tmp_path)
            counts = code(290, [a, b, n])
            assert counts["st.global.f64"] == 290
            # Of what a GPU would read beyond, or could not.
            for given in (a[:289], wp.array(ptr=a.ptr + 2, shape=290, dtype=float, device="cpu")):
                with pytest.raises(RuntimeError, match="addresses are outside"):
                    code(290, [given, *(wp.clone(one) for one in (b, n))])
        found.append((b.numpy(), n.numpy()))
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=1e-6)
    np.testing.assert_array_equal(found[1][1], found[0][1])
    assert np.all(found[1][1][290:] == -99)


def test_what_grew_is_found():
    before = [{"kernel": "a", "registers": 128.0, "float64 [%]": 3.0, "instructions": 1000.0}, {"kernel": "b"}]
    same = [
        {"kernel": "a", "registers": 130, "float64 [%]": 3.5, "instructions": 1060},
        {"kernel": "c", "registers": 255},
    ]
    assert set(before[0]) - {"kernel"} < set(GROWTH) and regressions(before, same) == []
    grown = [
        {"kernel": "a", "registers": 140, "float64 [%]": 9.0, "instructions": 1200},
        {"kernel": "b", "registers": 9},
    ]
    assert [column for _, column, _, _ in regressions(before, grown)] == ["instructions", "float64 [%]", "registers"]
