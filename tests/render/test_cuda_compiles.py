"""The CUDA kernels compile, also on a machine without a GPU."""

import pytest
import warp as wp

from diffphys_ros.render import cuda_composite, cuda_tiles, harmonics, project

pytestmark = pytest.mark.slow
COMPUTE_CAPABILITY = 90


@pytest.mark.parametrize("kernels", [cuda_composite, cuda_tiles, harmonics, project], ids=lambda m: m.__name__.rsplit(".")[-1])
def test_kernels_compile_for_cuda(kernels, tmp_path):
    wp.init()
    if COMPUTE_CAPABILITY not in wp.get_cuda_supported_archs():
        pytest.skip("this build of Warp has no CUDA compiler")
    for module in {kernel.module for kernel in vars(kernels).values() if isinstance(kernel, wp.Kernel)}:
        (binary,) = wp.compile_aot_module(module, arch=COMPUTE_CAPABILITY, module_dir=tmp_path)
        assert binary.stat().st_size > 1000
