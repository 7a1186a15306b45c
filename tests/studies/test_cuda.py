"""Kernels compile for CUDA, on machines without a GPU too: a sample here, all in the study."""

import pytest
import warp as wp

from studies import cuda
from studies.base.cuda import compiled, instructions


def test_kernels_compile_for_cuda(tmp_path):
    assert cuda.kernels(tmp_path, quick=True).startswith("All of ")
    assert "preintegrated lit" in (tmp_path / "kernels.csv").read_text()


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
